//! A scene with ground truth as a run sees it: cameras, source views and depth ranges, and the true depths of its depth maps.

use vamvs_core::{Camera, Grid, Scene, Size, View};
use vamvs_io::pfm;

use crate::TrainError;
use crate::dataset::{TrainingScene, TrainingView};
use crate::ground_truth::GroundTruth;
use crate::sample::{centres, run_range};

impl TrainingScene {
    /// The scene, with the depth ranges of the ground truth, wider by a factor of 1.1 at each end. The number of a view is its
    /// index.
    ///
    /// # Errors
    /// If a view's ground truth cannot be read or has no depth.
    pub fn as_scene(&self) -> Result<Scene, TrainError> {
        let view = |(index, view): (usize, &TrainingView)| {
            let range = run_range(&pfm::read_depth(&view.depth)?, view)?;
            Ok(View {
                id: index as u32,
                name: view.image.file_name().unwrap_or_default().to_string_lossy().into_owned(),
                camera: Camera::from(view.camera),
                cam_from_world: view.cam_from_world,
                depth_range: Some(range),
            })
        };
        let views = self.views.iter().enumerate().map(view).collect::<Result<_, TrainError>>()?;
        Ok(Scene { views, points: Vec::new(), pairs: Some(self.sources.clone()) })
    }

    /// The true depths of a view at the pixel centres of a depth map of this size, 0 where they are unknown.
    ///
    /// # Errors
    /// If the ground truth cannot be read.
    pub fn true_depths(&self, view: usize, size: Size) -> Result<Grid<f32>, TrainError> {
        let depth = pfm::read_depth(&self.views[view].depth)?;
        let step = [depth.width() as f64 / size.width as f64, depth.height() as f64 / size.height as f64];
        let ground_truth =
            GroundTruth { depth, is_complete: false, visibility: Vec::new(), origin: [0.0; 2], step };
        Ok(ground_truth.depths(&centres(size.width, 1), &centres(size.height, 1)))
    }
}
