//! Where depth maps come from.

use std::convert::Infallible;

use vamvs_core::{DepthMap, Grid, Rgb};

use crate::BoxError;

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
