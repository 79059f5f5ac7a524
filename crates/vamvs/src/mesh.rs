//! From depth maps to a triangle mesh.

use std::borrow::Borrow;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use vamvs_core::{Grid, Mesh, Part};
use vamvs_fusion::{ConsistentPixels, FuseError, FuseEvent, FuseJob, FusionView, MapSource, Schedule};
use vamvs_io::atomic;
use vamvs_io::mesh::MeshFormat;
use vamvs_mesh::{MeshOptions, MeshView, Mesher};

use crate::event::{OnEvent, tell};
use crate::fuse::{lock, with_own_confidence, working_memory};
use crate::view_map::InMemory;
use crate::{Event, FusionOptions, Maps, VamvsError, ViewMap};

/// The result of meshing.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct MeshSummary {
    /// The file.
    pub file: PathBuf,
    /// Vertices of the mesh.
    pub vertices: usize,
    /// Triangles of the mesh.
    pub triangles: usize,
    /// Time, with reading depth maps and writing the mesh.
    pub time: Duration,
}

/// Makes a mesh of depth maps and writes it to a file, of which the extension names the format: PLY, OBJ or GLB.
///
/// # Errors
/// As [`mesh_of`]; if the name has another extension, the file is there and not of the format, it cannot be written, or
/// no triangle is left: then nothing is written.
pub fn mesh(
    maps: &Maps,
    file: &Path,
    (options, fusion): (&MeshOptions, &FusionOptions),
    on_event: &mut OnEvent<'_>,
) -> Result<MeshSummary, VamvsError> {
    let begin = Instant::now();
    let format = MeshFormat::of(file).ok_or_else(|| VamvsError::Folder {
        path: file.to_owned(),
        problem: "expected a name that ends in .ply, .obj or .glb, which are the formats of meshes"
            .to_owned(),
    })?;
    atomic::expect_kind(file, |begin| format.may_begin(begin))?;
    let _lock = lock(maps, file)?;
    let mesh = mesh_of(maps, (options, fusion), on_event)?;
    if mesh.triangles.is_empty() {
        let problem = "no triangle is left: no depth is confirmed by other views, or all pieces are smaller than \
                       --min-triangles; look at the depth maps, or at the cloud that `vamvs fuse` makes of them";
        return Err(VamvsError::Folder { path: maps.root().to_owned(), problem: problem.to_owned() });
    }
    vamvs_io::mesh::write(file, &mesh, format)?;
    Ok(MeshSummary {
        file: file.to_owned(),
        vertices: mesh.positions.len(),
        triangles: mesh.triangles.len(),
        time: begin.elapsed(),
    })
}

/// Makes a mesh of depth maps: of the pixels that other views confirm, as in fusion.
///
/// # Errors
/// If an option is invalid, a depth map cannot be read, or `on_event` breaks.
pub fn mesh_of(
    maps: &Maps,
    (options, fusion): (&MeshOptions, &FusionOptions),
    on_event: &mut OnEvent<'_>,
) -> Result<Mesh, VamvsError> {
    fusion.validate()?;
    let fusion = with_own_confidence(maps, fusion)?;
    assemble(maps, &maps.neighbours(fusion.neighbours), (options, &fusion), on_event)
}

/// Makes a mesh of depth maps that are in memory, as [`mesh_of`].
///
/// # Errors
/// If an option is invalid or needs what maps in memory do not keep, a grid differs in size from its depth map, or `on_event` breaks.
pub fn mesh_in_memory<M: Borrow<ViewMap> + Sync>(
    maps: &[M],
    (options, fusion): (&MeshOptions, &FusionOptions),
    on_event: &mut OnEvent<'_>,
) -> Result<Mesh, VamvsError> {
    let maps = InMemory::new(maps, fusion)?;
    assemble(&maps, &maps.neighbours(fusion.neighbours), (options, fusion), on_event)
}

/// Makes a mesh of depth maps from anywhere.
fn assemble<S: MapSource + ?Sized>(
    source: &S,
    neighbours: &[Vec<usize>],
    (options, fusion): (&MeshOptions, &FusionOptions),
    on_event: &mut OnEvent<'_>,
) -> Result<Mesh, VamvsError> {
    let mut mesher = Mesher::new(options.clone())?;
    let (filter, memory) = (&fusion.filter, working_memory(fusion.max_memory));
    let job = FuseJob { source, neighbours, options: filter, roi: fusion.roi, memory };
    let schedule = Schedule::new(neighbours, source.len())?;
    let (mut done, total) = (0, 2 * source.len() + 1);
    let mut step = || {
        done += 1;
        Event::Mesh { done, total }
    };
    let all = Part::new(0, 1).expect("one part of one");
    let mut progress = |_: FuseEvent| on_event(step());
    let (pixels, _) = vamvs_fusion::confirm(&job, &schedule, all, &mut progress)?;
    for (&view, pixels) in &pixels {
        let loaded = source.load(view).map_err(|error| FuseError::Load { view, source: error.into() })?;
        mesher.add(confirmed(loaded, pixels))?;
        tell(on_event, step())?;
    }
    let volume = mesher.volume(memory as u64);
    if volume.cell() > options.cell {
        let text = format!(
            "a mesh with cells of {} pixels (--cell) would take more memory than the limit of {}: it is made with cells of {:.1}",
            options.cell,
            fusion.max_memory,
            volume.cell()
        );
        tell(on_event, Event::Warning(text))?;
    }
    let mesh = volume.mesh();
    tell(on_event, step())?;
    Ok(mesh)
}

/// A view with what other views confirm of it.
fn confirmed(view: FusionView, pixels: &ConsistentPixels) -> MeshView {
    let FusionView { map, mask, colour, normals, sigma } = view;
    let confirmed = Some(Grid::from_fn(map.depth.size(), |x, y| pixels.contains(x, y)));
    let (camera, cam_from_world, mut depth) = (map.camera, map.cam_from_world, map.depth);
    if let Some(mask) = mask {
        depth
            .data_mut()
            .iter_mut()
            .zip(mask.data())
            .filter(|(_, counts)| !**counts)
            .for_each(|(depth, _)| *depth = 0.0);
    }
    MeshView { camera, cam_from_world, depth, confirmed, sigma, normals, colour }
}
