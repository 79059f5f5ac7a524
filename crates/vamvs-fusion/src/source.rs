//! Where depth maps come from.

use std::convert::Infallible;

use vamvs_core::{DepthMap, Grid, Rgb, Size};

use crate::{BoxError, FuseError};

/// A depth map with its mask. Both rasters have the depth map's size.
#[derive(Clone, Debug, PartialEq)]
pub struct MaskedMap {
    /// Depth and confidence with their camera.
    pub map: DepthMap,
    /// Pixels that count (`true`); `None` if all do.
    pub mask: Option<Grid<bool>>,
}

/// What fusion needs of a view. All rasters have the depth map's size.
#[derive(Clone, Debug, PartialEq)]
pub struct FusionView {
    /// Depth and confidence with their camera.
    pub map: DepthMap,
    /// Pixels that count (`true`); `None` if all do.
    pub mask: Option<Grid<bool>>,
    /// The photograph's colours.
    pub colour: Grid<Rgb>,
    /// Unit normals in the world's frame, towards the camera, 0 where there is none; `None` to derive them from the
    /// depths.
    pub normals: Option<Grid<[f32; 3]>>,
    /// Standard deviations of the depths, scene units, 0 where they are not known; `None` if there are none.
    pub sigma: Option<Grid<f32>>,
}

impl MaskedMap {
    /// Checks that all rasters have the depth map's size; `view` is the view's number in errors.
    ///
    /// # Errors
    /// If a raster has another size.
    pub fn check(&self, view: usize) -> Result<(), FuseError> {
        let map = &self.map;
        let parts = [
            ("a camera", Some(map.camera.size)),
            ("a confidence map", Some(map.confidence.size())),
            ("a coarse confidence map", map.coarse_confidence.as_ref().map(Grid::size)),
            ("a mask", self.mask.as_ref().map(Grid::size)),
        ];
        expect_sizes(view, map.depth.size(), &parts)
    }
}

impl FusionView {
    /// Checks that all rasters have the depth map's size; `view` is the view's number in errors.
    ///
    /// # Errors
    /// If a raster has another size.
    pub fn check(&self, view: usize) -> Result<(), FuseError> {
        let map = &self.map;
        let parts = [
            ("a camera", Some(map.camera.size)),
            ("a confidence map", Some(map.confidence.size())),
            ("a coarse confidence map", map.coarse_confidence.as_ref().map(Grid::size)),
            ("a colour image", Some(self.colour.size())),
            ("a map of normals", self.normals.as_ref().map(Grid::size)),
            ("a map of standard deviations", self.sigma.as_ref().map(Grid::size)),
            ("a mask", self.mask.as_ref().map(Grid::size)),
        ];
        expect_sizes(view, map.depth.size(), &parts)
    }
}

/// Checks that parts of a view have the size `expected`, that of its depth map: each is named as errors name it, with its
/// size if the view has it; `view` is the view's number in errors.
///
/// # Errors
/// If a part has another size.
pub fn expect_sizes(
    view: usize,
    expected: Size,
    parts: &[(&'static str, Option<Size>)],
) -> Result<(), FuseError> {
    let other = |found: &Size| *found != expected;
    let wrong = parts.iter().find_map(|&(what, found)| Some((what, found.filter(other)?)));
    wrong.map_or(Ok(()), |(what, found)| Err(FuseError::Size { view, what, expected, found }))
}

/// A set of views that can be loaded one by one, more than once and from several threads.
pub trait MapSource: Sync {
    /// Why a view could not be loaded.
    type Error: Into<BoxError>;

    /// Number of views.
    fn len(&self) -> usize;

    /// Whether there are no views.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Loads a view; must give the same each time.
    ///
    /// # Errors
    /// If it cannot be loaded. Fusion stops then.
    fn load(&self, view: usize) -> Result<FusionView, Self::Error>;

    /// Loads only the depth map and mask of a view, the same as [`MapSource::load`] gives.
    ///
    /// # Errors
    /// If it cannot be loaded. Fusion stops then.
    fn load_map(&self, view: usize) -> Result<MaskedMap, Self::Error> {
        let FusionView { map, mask, .. } = self.load(view)?;
        Ok(MaskedMap { map, mask })
    }

    /// Loads only the colours of a view whose depth map has the given size, the same as [`MapSource::load`] gives. Fusion
    /// loads the parts of a view one after the other, so that large ones are not in memory together.
    ///
    /// # Errors
    /// If they cannot be loaded. Fusion stops then.
    fn load_colour(&self, view: usize, _size: Size) -> Result<Grid<Rgb>, Self::Error> {
        Ok(self.load(view)?.colour)
    }

    /// Loads only the normals of a view, the same as [`MapSource::load`] gives.
    ///
    /// # Errors
    /// If they cannot be loaded. Fusion stops then.
    fn load_normals(&self, view: usize) -> Result<Option<Grid<[f32; 3]>>, Self::Error> {
        Ok(self.load(view)?.normals)
    }

    /// Loads only the standard deviations of a view, the same as [`MapSource::load`] gives.
    ///
    /// # Errors
    /// If they cannot be loaded. Fusion stops then.
    fn load_sigma(&self, view: usize) -> Result<Option<Grid<f32>>, Self::Error> {
        Ok(self.load(view)?.sigma)
    }
}

/// Views in memory.
impl MapSource for [FusionView] {
    type Error = Infallible;

    fn len(&self) -> usize {
        self.len()
    }

    fn load(&self, view: usize) -> Result<FusionView, Infallible> {
        Ok(self[view].clone())
    }

    fn load_map(&self, view: usize) -> Result<MaskedMap, Infallible> {
        Ok(MaskedMap { map: self[view].map.clone(), mask: self[view].mask.clone() })
    }

    fn load_colour(&self, view: usize, _size: Size) -> Result<Grid<Rgb>, Infallible> {
        Ok(self[view].colour.clone())
    }

    fn load_normals(&self, view: usize) -> Result<Option<Grid<[f32; 3]>>, Infallible> {
        Ok(self[view].normals.clone())
    }

    fn load_sigma(&self, view: usize) -> Result<Option<Grid<f32>>, Infallible> {
        Ok(self[view].sigma.clone())
    }
}
