//! The surface that a single view sees: what passes the photometric filter, with normals.

use vamvs_core::Grid;

use crate::normals::normal_in_cam;
use crate::photometric::FilteredView;
use crate::{FuseError, FuseOptions, FusionView};

/// Depths of one view with their normals.
#[derive(Clone, Debug, PartialEq)]
pub struct Surface {
    /// Depth z in scene units; 0 where there is none or it was filtered out.
    pub depth: Grid<f32>,
    /// Unit normals in the camera's frame, towards the camera; 0 where there is no depth.
    pub normal: Grid<[f32; 3]>,
}

impl Surface {
    /// The depths of a view that are confident and not masked, by the photometric thresholds of `options`.
    ///
    /// # Errors
    /// If the view's rasters differ in size; the error calls it view 0.
    pub fn of(view: &FusionView, options: &FuseOptions) -> Result<Self, FuseError> {
        let filtered = FilteredView::new(0, view.clone(), options)?;
        let passes = |x: usize, y: usize| filtered.inverse_depth[(x, y)] > 0.0;
        let depth = |x: usize, y: usize| if passes(x, y) { view.map.depth[(x, y)] } else { 0.0 };
        let normal =
            |x: usize, y: usize| if passes(x, y) { normal_in_cam(&filtered, x, y).into() } else { [0.0; 3] };
        let size = filtered.size();
        Ok(Self { depth: Grid::from_fn(size, depth), normal: Grid::from_fn(size, normal) })
    }
}
