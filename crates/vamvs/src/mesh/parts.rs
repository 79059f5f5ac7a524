//! Meshing spread over processes, also on different machines that share the folder: the outlines of parts of the views, the
//! surface in parts of the volume, and a last step that joins them. It begins with the pixels that the first pass of a
//! fusion has found ([`PartialFusion::confirm`]). The mesh is byte for byte that of [`crate::mesh()`].

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

use vamvs_core::Part;
use vamvs_fusion::ConsistentViews;
use vamvs_mesh::{Assembly, MeshOptions, MeshView, Mesher, Outline, Volume};

use super::{MeshSummary, confirmed, memory_for, prepare, warn_of_cells, write};
use crate::event::{OnEvent, tell};
use crate::part_files::{Kind, PartFiles, path};
use crate::{Event, FusionOptions, Maps, MemoryLimit, PartialFusion, VamvsError};

/// Increased whenever a change gives other part files for the same depth maps.
const VERSION: u32 = 1;

/// A mesh that is made in parts.
pub struct PartialMesh<'a> {
    fusion: PartialFusion<'a>,
    options: MeshOptions,
    limit: MemoryLimit,
    files: PartFiles,
}

impl<'a> PartialMesh<'a> {
    /// A mesh of these depth maps, with part files in the folder `parts/` next to them.
    ///
    /// # Errors
    /// If an option is invalid, or asks for the network's confidence, which the depth maps do not have.
    pub fn new(maps: &'a Maps, options: &MeshOptions, fusion: &FusionOptions) -> Result<Self, VamvsError> {
        options.validate()?;
        let limit = fusion.max_memory;
        let fusion = PartialFusion::new(maps, fusion)?;
        let inputs = format!("{VERSION} {} {:?} {}", fusion.made_of(), options.cell, memory_for(limit));
        let files = PartFiles::new(maps.root(), blake3::hash(inputs.as_bytes()).to_hex().to_string());
        Ok(Self { fusion, options: options.clone(), limit, files })
    }

    /// The file that the finished outlines of a part of the views leave.
    #[must_use]
    pub fn outlines_file(root: &Path, part: Part) -> PathBuf {
        path(root, Kind::Outlines, part)
    }

    /// The file that the finished surface in a part of the volume leaves.
    #[must_use]
    pub fn surfaces_file(root: &Path, part: Part) -> PathBuf {
        path(root, Kind::Surfaces, part)
    }

    /// The outlines of a part of the views, those of the part of the first pass of the fusion, unless that is done. Returns
    /// whether it did anything.
    ///
    /// # Errors
    /// If a depth map or a file of the fusion cannot be read, a file cannot be written, or `on_event` breaks.
    pub fn outline(&self, part: Part, on_event: &mut OnEvent<'_>) -> Result<bool, VamvsError> {
        if self.files.is_there(Kind::Outlines, part) {
            return Ok(false);
        }
        let mut mesher = self.mesher(part.count())?;
        let mut file = self.files.create(Kind::Outlines, part)?;
        let views = self.fusion.views_in(part);
        for (done, &view) in views.iter().enumerate() {
            file.push(&(view, mesher.outline(view)?))?;
            tell(on_event, Event::Mesh { done: done + 1, total: views.len() })?;
        }
        file.finish()?;
        Ok(true)
    }

    /// The surface in a part of the volume, unless that is done; the outlines must be done for all parts, with the same number
    /// of parts. Returns whether it did anything.
    ///
    /// # Errors
    /// As [`PartialMesh::outline`].
    pub fn surface(&self, part: Part, on_event: &mut OnEvent<'_>) -> Result<bool, VamvsError> {
        if self.files.is_there(Kind::Surfaces, part) {
            return Ok(false);
        }
        let mut mesher = self.mesher(part.count())?;
        let volume = self.volume(&mut mesher, part.count(), on_event)?;
        let mut file = self.files.create(Kind::Surfaces, part)?;
        let blocks = volume.blocks(part);
        for (done, block) in blocks.iter().enumerate() {
            file.push(&mesher.surface(&volume, block)?)?;
            tell(on_event, Event::Mesh { done: done + 1, total: blocks.len() })?;
        }
        file.finish()?;
        Ok(true)
    }

    /// Joins the surfaces of all `parts` parts, writes the mesh, and removes the part files.
    ///
    /// # Errors
    /// If a file of a part is missing or damaged, or as [`crate::mesh()`].
    pub fn join(
        &self,
        parts: usize,
        file: &Path,
        on_event: &mut OnEvent<'_>,
    ) -> Result<MeshSummary, VamvsError> {
        let begin = Instant::now();
        let _lock = prepare(self.fusion.maps(), file)?;
        let mut mesher = self.mesher(parts)?;
        let volume = self.volume(&mut mesher, parts, on_event)?;
        let mut surfaces = Assembly::default();
        for (done, part) in Part::all(parts).enumerate() {
            let mut frames = self.files.open(Kind::Surfaces, part)?;
            while let Some(surface) = frames.next()? {
                surfaces.push(surface);
            }
            tell(on_event, Event::Mesh { done: done + 1, total: parts })?;
        }
        let mesh = mesher.finish(&volume, surfaces)?;
        let made = write(self.fusion.maps(), file, (&mesh, begin))?;
        self.files.remove(&[Kind::Outlines, Kind::Surfaces], parts);
        Ok(made)
    }

    fn mesher(
        &self,
        parts: usize,
    ) -> Result<Mesher<impl FnMut(usize) -> Result<MeshView, VamvsError>>, VamvsError> {
        let mut pixels = ConsistentViews::new();
        let load = move |view| {
            self.fusion.expect_pixels(view, parts, &mut pixels)?;
            confirmed(self.fusion.maps(), view, &pixels)
        };
        Ok(Mesher::new(self.options.clone(), memory_for(self.limit), load)?)
    }

    fn volume<L>(
        &self,
        mesher: &mut Mesher<L>,
        parts: usize,
        on_event: &mut OnEvent<'_>,
    ) -> Result<Volume, VamvsError>
    where
        L: FnMut(usize) -> Result<MeshView, VamvsError>,
    {
        let mut outlines = BTreeMap::new();
        for part in Part::all(parts) {
            let mut frames = self.files.open(Kind::Outlines, part)?;
            while let Some((view, outline)) = frames.next::<(usize, Outline)>()? {
                outlines.insert(view, outline);
            }
        }
        let volume = mesher.volume(outlines.into_values().collect());
        warn_of_cells(&volume, &self.options, self.limit, on_event)?;
        Ok(volume)
    }
}
