//! Reads the files of a view.

use std::path::{Path, PathBuf};

use vamvs_core::{DepthMap, Grid, Rgb, Size};
use vamvs_fusion::{FusionView, MapSource, MaskedMap, expect_sizes};
use vamvs_io::colmap::dense;
use vamvs_io::{depth, image, masks, pfm};

use super::Maps;
use crate::{VamvsError, memory};

/// Pixels of a map from which on the memory of its parts is returned to the system before the next part is read.
/// Otherwise freed parts of a large map stay resident for a while, beside those that are read.
const LARGE: usize = 1 << 23;

impl Maps {
    /// Reads a view's depth map.
    ///
    /// # Errors
    /// If a file is missing or malformed.
    pub fn depth_map(&self, view: usize) -> Result<DepthMap, VamvsError> {
        let files = &self.files[view];
        let depth = match files.is_of_colmap() {
            true => dense::read_depth_map(&files.depth)?,
            false => depth::read(&files.depth, self.png_step(&files.depth)?)?,
        };
        let confidence = match &files.confidence {
            Some(path) => depth::read_confidence(path)?,
            None => depth.map(|depth| f32::from(u8::from(*depth > 0.0))),
        };
        Ok(DepthMap {
            camera: self.cameras[view].resized(depth.size()),
            cam_from_world: self.scene.views[view].cam_from_world,
            depth,
            confidence,
            coarse_confidence: files.coarse_confidence.as_deref().map(pfm::read).transpose()?,
        })
    }

    /// The depth of one grey level of a depth map; 1 if it is no PNG.
    fn png_step(&self, path: &Path) -> Result<f64, VamvsError> {
        if !path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("png")) {
            return Ok(1.0);
        }
        let step = self.png_step.map_or_else(|| depth::png_step_beside(path), |step| Ok(Some(step)))?;
        step.ok_or_else(|| {
            let problem = format!(
                "the depth of one grey level is not known: give it with --png-step, or in a file {} beside it",
                depth::PNG_STEP_FILE
            );
            VamvsError::Folder { path: path.to_owned(), problem }
        })
    }

    /// Checks that a view's files can be read and fit together. Of float maps the header tells that; photographs and masks
    /// are decoded.
    pub(super) fn checked(&self, view: usize) -> Result<(), VamvsError> {
        let files = &self.files[view];
        let map_size = |path: &Option<PathBuf>| path.as_deref().map(depth::stored_size).transpose();
        let size = match files.is_of_colmap() {
            true => dense::read_depth_map(&files.depth)?.size(),
            false => depth::stored_size(&files.depth)?,
        };
        let parts = [
            ("a confidence map", map_size(&files.confidence)?),
            ("a coarse confidence map", map_size(&files.coarse_confidence)?),
            ("a map of standard deviations", map_size(&files.sigma)?),
            ("a map of normals", files.normals.as_deref().map(|path| pfm::stored_size(path, 3)).transpose()?),
        ];
        expect_sizes(view, size, &parts)?;
        self.mask(view, size)?;
        image::load_rgb(&files.image)?;
        Ok(())
    }

    /// A view's photograph at the size of its depth map.
    pub(crate) fn photograph(&self, view: usize, size: Size) -> Result<Grid<Rgb>, VamvsError> {
        let photograph = image::load_rgb(&self.files[view].image)?;
        Ok(if photograph.size() == size { photograph } else { image::resize(&photograph, size) })
    }

    fn mask(&self, view: usize, size: Size) -> Result<Option<Grid<bool>>, VamvsError> {
        Ok(self.mask_file(view).map(|path| masks::load(&path, size)).transpose()?)
    }
}

impl MapSource for Maps {
    type Error = VamvsError;

    fn len(&self) -> usize {
        self.names.len()
    }

    fn load(&self, view: usize) -> Result<FusionView, VamvsError> {
        let MaskedMap { map, mask } = self.load_map(view)?;
        let colour = self.photograph(view, map.depth.size())?;
        let (normals, sigma) = (self.load_normals(view)?, self.load_sigma(view)?);
        Ok(FusionView { map, mask, colour, normals, sigma })
    }

    fn load_map(&self, view: usize) -> Result<MaskedMap, VamvsError> {
        give_back_if_large(self.cameras[view].size);
        let map = self.depth_map(view)?;
        Ok(MaskedMap { mask: self.mask(view, map.depth.size())?, map })
    }

    fn load_colour(&self, view: usize, size: Size) -> Result<Grid<Rgb>, VamvsError> {
        give_back_if_large(size);
        self.photograph(view, size)
    }

    fn load_normals(&self, view: usize) -> Result<Option<Grid<[f32; 3]>>, VamvsError> {
        give_back_if_large(self.cameras[view].size);
        Ok(self.files[view].normals.as_deref().map(pfm::read_rgb).transpose()?)
    }

    fn load_sigma(&self, view: usize) -> Result<Option<Grid<f32>>, VamvsError> {
        give_back_if_large(self.cameras[view].size);
        Ok(self.files[view].sigma.as_deref().map(pfm::read).transpose()?)
    }
}

fn give_back_if_large(size: Size) {
    if size.area() >= LARGE {
        memory::give_back();
    }
}
