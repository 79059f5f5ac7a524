//! The surface that a single view sees: what passes the photometric filter, with normals.

use nalgebra::Vector3;
use vamvs_core::Grid;

use crate::normals::normals_in_cam;
use crate::photometric::FilteredView;
use crate::{FuseError, FuseOptions, FusionView, MaskedMap};

/// Depths of one view with their normals.
#[derive(Clone, Debug, PartialEq)]
pub struct Surface {
    /// Depth z in scene units; 0 where there is none or it was filtered out.
    pub depth: Grid<f32>,
    /// Unit normals in the camera's frame, towards the camera: those of the view if it has some, else of the depths; 0
    /// where there is no depth.
    pub normal: Grid<[f32; 3]>,
}

impl Surface {
    /// The depths of a view that are confident and not masked, by the photometric thresholds of `options`.
    ///
    /// # Errors
    /// If the view's rasters differ in size; the error says view 0.
    pub fn of(view: &FusionView, options: &FuseOptions) -> Result<Self, FuseError> {
        view.check(0)?;
        let filtered = FilteredView::new(0, &masked(view), options)?;
        let passes = |x: usize, y: usize| filtered.inverse_depth((x, y)) > 0.0;
        let depth = |x: usize, y: usize| if passes(x, y) { view.map.depth[(x, y)] } else { 0.0 };
        let cam_from_world = view.map.cam_from_world.rotation.cast::<f32>();
        let normal = match &view.normals {
            None => normals_in_cam(&filtered).map(|(normal, _)| (*normal).into()),
            Some(given) => Grid::from_fn(filtered.size(), |x, y| {
                let normal = cam_from_world * Vector3::from(given[(x, y)]);
                if passes(x, y) { normal.into() } else { [0.0; 3] }
            }),
        };
        Ok(Self { depth: Grid::from_fn(filtered.size(), depth), normal })
    }
}

fn masked(view: &FusionView) -> MaskedMap {
    MaskedMap { map: view.map.clone(), mask: view.mask.clone() }
}
