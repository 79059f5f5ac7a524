//! Where depth maps come from.

use std::convert::Infallible;

use vamvs_core::{DepthMap, Grid, Rgb, Size};

use crate::{BoxError, FuseError};

/// What fusion needs of a view. All rasters have the depth map's size.
#[derive(Clone, Debug, PartialEq)]
pub struct FusionView {
    /// Depth and confidence with their camera.
    pub map: DepthMap,
    /// The photograph's colours.
    pub colour: Grid<Rgb>,
    /// Pixels that count (`true`); `None` if all do.
    pub mask: Option<Grid<bool>>,
}

impl FusionView {
    /// Checks that all rasters have the depth map's size; the error calls it view number `view`.
    ///
    /// # Errors
    /// If one has not.
    pub fn check(&self, view: usize) -> Result<(), FuseError> {
        let map = &self.map;
        let expected = map.depth.size();
        let parts = [
            ("a camera", Some(map.camera.size)),
            ("a confidence map", Some(map.confidence.size())),
            ("a coarse confidence map", map.coarse_confidence.as_ref().map(Grid::size)),
            ("a colour image", Some(self.colour.size())),
            ("a mask", self.mask.as_ref().map(Grid::size)),
        ];
        let other = |found: &Size| *found != expected;
        let wrong = parts.into_iter().find_map(|(what, found)| Some((what, found.filter(other)?)));
        wrong.map_or(Ok(()), |(what, found)| Err(FuseError::Size { view, what, expected, found }))
    }
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

    /// Loads a view; each time the same.
    ///
    /// # Errors
    /// If it cannot be loaded. Fusion stops then.
    fn load(&self, view: usize) -> Result<FusionView, Self::Error>;
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
}
