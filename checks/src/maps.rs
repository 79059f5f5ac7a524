//! The depth maps of an output folder.

use std::path::Path;

use anyhow::Result;
use vamvs_core::Grid;
use vamvs_eval::depth::MapPair;
use vamvs_eval::{DepthErrors, DepthSamples, Region, Threshold};
use vamvs_fusion::FuseOptions;
use vamvs_io::pfm;

/// The depth map that `vamvs` estimated for a view, with its confidence.
pub struct Map {
    /// Depth z, scene units; 0 where there is none.
    pub depth: Grid<f32>,
    /// Confidence of the depth, 0 to 1.
    pub confidence: Grid<f32>,
    /// Confidence of the coarse stage, 0 to 1; `None` for refined maps, which have no coarse confidence.
    coarse_confidence: Option<Grid<f32>>,
}

impl Map {
    /// Reads the maps of the view `name` from the output folder `out`.
    pub fn read(out: &Path, name: &str) -> Result<Self> {
        let confidence = out.join("confidence");
        let coarse = confidence.join(format!("{name}.coarse.pfm"));
        Ok(Self {
            depth: pfm::read_depth(&out.join("depths").join(format!("{name}.pfm")))?,
            confidence: pfm::read(&confidence.join(format!("{name}.pfm")))?,
            coarse_confidence: coarse.is_file().then(|| pfm::read(&coarse)).transpose()?,
        })
    }

    /// The depths that pass the photometric filter of fusion with its default thresholds; 0 elsewhere.
    pub fn confident(&self) -> Grid<f32> {
        let limits = FuseOptions::default();
        let mut depth = self.depth.clone();
        let mut limit = |confidence: &Grid<f32>, least: f32| {
            let pixels = depth.data_mut().iter_mut().zip(confidence.data());
            pixels.filter(|(_, confidence)| **confidence < least).for_each(|(depth, _)| *depth = 0.0);
        };
        limit(&self.confidence, limits.min_confidence);
        self.coarse_confidence.iter().for_each(|coarse| limit(coarse, limits.min_coarse_confidence));
        depth
    }
}

/// The errors of depth maps against true ones of the same sizes, over all pixels of all maps. `thresholds` are
/// relative errors.
pub fn relative_errors<'a>(
    depths: impl IntoIterator<Item = &'a Grid<f32>>,
    ground_truth: impl IntoIterator<Item = &'a Grid<f32>>,
    thresholds: &[f64],
) -> Result<DepthErrors> {
    let mut samples = DepthSamples::default();
    for (depth, ground_truth) in depths.into_iter().zip(ground_truth) {
        samples.add(&MapPair { depth, ground_truth, visible: None, plane: None })?;
    }
    let thresholds: Vec<_> = thresholds.iter().copied().map(Threshold::Relative).collect();
    Ok(samples.errors(Region::All, &thresholds))
}
