//! A depth map from what the network's stages found.

use vamvs_core::{DepthMap, Grid, MonotoneMap, Pinhole, Planes, Pose, Size};

use crate::pyramid::STRIDE;
use crate::sweep::PlaneDepth;
use crate::weights::Manifest;

/// Pixels that are less likely than this to show a surface have no depth.
const LEAST_SURFACE: f32 = 0.5;

/// A depth map, and what else the network tells.
#[derive(Clone, Debug)]
pub struct Estimate {
    /// The depth map, its camera of its own size: a quarter of the photograph's. Where there is likely no surface, its depth is 0.
    pub map: DepthMap,
    /// The probability that a pixel shows a surface inside the depth range.
    pub surface: Grid<f32>,
    /// For each source view, how likely it sees each pixel.
    pub visibility: Vec<Grid<f32>>,
}

/// What the stages found for each pixel of the depth map with its padding, (h, w).
#[derive(Clone, Debug)]
pub struct Found {
    /// The size of the map with its padding.
    pub padded: Size,
    /// Depths in plane coordinates.
    pub u: Vec<f32>,
    /// The confidence of the second volume.
    pub confidence: Vec<f32>,
    /// That of the first one.
    pub coarse_confidence: Vec<f32>,
    /// The probability that there is a surface.
    pub surface: Vec<f32>,
    /// How likely each source view sees the pixel.
    pub masks: Vec<Vec<f32>>,
}

impl Found {
    /// The result without the padding, for a photograph of this camera: where there may be no surface, there is less confidence in a
    /// depth; where there likely is none, there is no depth.
    #[must_use]
    pub fn estimate(
        &self,
        manifest: &Manifest,
        (camera, cam_from_world): (&Pinhole, Pose),
        planes: &Planes,
    ) -> Estimate {
        let size = Size::new(camera.size.width / STRIDE, camera.size.height / STRIDE);
        let grid = |values: &[f32]| Grid::from_fn(size, |x, y| values[y * self.padded.width + x]);
        let depth_of = PlaneDepth::new(planes);
        let (near, surface) = (planes.range.near as f32, grid(&self.surface));
        let mut depth = grid(&self.u).map(|&u| near * depth_of.of(u));
        let coarse_confidence = grid(&self.coarse_confidence);
        let calibration: Option<&MonotoneMap> = manifest.calibration.as_ref();
        let calibrated = |value: f32| calibration.map_or(value, |map| map.at(f64::from(value)) as f32);
        let mut confidence = Grid::from_fn(size, |x, y| {
            let at = y * self.padded.width + x;
            calibrated(self.confidence[at] * self.coarse_confidence[at])
        });
        let pixels = depth.data_mut().iter_mut().zip(confidence.data_mut()).zip(surface.data());
        for ((depth, confidence), surface) in pixels {
            *confidence *= surface;
            if surface.is_nan() || *surface < LEAST_SURFACE {
                (*depth, *confidence) = (0.0, 0.0);
            }
        }
        let ratio = 1.0 / STRIDE as f64;
        Estimate {
            map: DepthMap {
                camera: Pinhole { size, intrinsics: camera.intrinsics.scaled(ratio, ratio) },
                cam_from_world,
                depth,
                confidence,
                coarse_confidence: Some(coarse_confidence),
            },
            surface,
            visibility: self.masks.iter().map(|mask| grid(mask)).collect(),
        }
    }
}
