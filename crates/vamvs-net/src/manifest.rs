//! The manifest, which describes a module.

use std::num::NonZeroUsize;

use crate::depth_completion::Completion;
use serde::{Deserialize, Serialize};
use tch::{Device, Kind, TchError, Tensor};
use vamvs_core::MonotoneMap;

use crate::{Aggregation, NetError};

/// The stride of the paper's coarse features, which is the largest stride. Images are padded to a multiple of it.
pub const LARGEST_STRIDE: usize = 8;

/// The strides of the flow features.
pub const FLOW_SCALES: [usize; 3] = [2, 4, 8];

/// The version of the contract between modules and this crate.
pub const CONTRACT: u32 = 1;

/// A module's manifest, which the module stores as JSON.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// The version of the contract that the module was written for.
    pub contract: u32,
    /// The network's name.
    pub name: String,
    /// How the features of several views are aggregated (figure 3).
    pub aggregation: Aggregation,
    /// Number of nearest neighbours of a point, k.
    pub neighbours: usize,
    /// Number of hypotheses to each side of a point, m; 0: `flow` gives the offset itself, in steps of the iteration
    /// (direct regression, table 8).
    pub hypotheses: usize,
    /// The number of layers of `flow` that gather from a point's neighbours; each widens the receptive field by one
    /// neighbourhood.
    pub flow_layers: usize,
    /// Whether the module has `regularize_slab` and `regularize_slabs`, which regularise a volume that is never held
    /// as a whole.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub slabs: bool,
    /// Whether the module has `layers`, which gives the layers that kernels run on the CPU.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub layers: bool,
    /// vis-corr: whether `encode_coarse` gives the coarse features without the other levels of the pyramid.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub coarse_alone: bool,
    /// vis-corr: whether the module has `regularize_in_context`, which also takes the coarse features of the reference
    /// view, instead of `regularize`.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub context: bool,
    /// vis-avg, vis-max: this many of the last channels of `relate` are averaged over the source views, whatever the
    /// aggregation of the others; not in the paper.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub averaged: usize,
    /// The soft-argmin of the coarse stage is taken over the planes within this many of the most probable one; absent:
    /// over all planes, as in the paper.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub window: Option<usize>,
    /// Stride of the coarse depth map, pixels of the photograph: 8 or 4; absent: 8, as in the paper. If it is half of
    /// `feature_stride`, the network sees the photograph at twice its size.
    #[serde(alias = "cells", default = "paper_stride", skip_serializing_if = "is_paper_stride")]
    pub coarse_stride: usize,
    /// Stride of the coarse features in the image that the network sees: 8 or 4; absent: 8, as in the paper.
    #[serde(alias = "stride", default = "paper_stride", skip_serializing_if = "is_paper_stride")]
    pub feature_stride: usize,
    /// How far features lie from the centres of the pixels that they cover, towards the left and the top, pixels of the
    /// image that the network sees, at the strides 2, 4 and 8; absent: 0. Layers that halve an image by an odd kernel
    /// give 0.5, 1.5 and 3.5.
    #[serde(default, skip_serializing_if = "are_zero")]
    pub feature_offsets: [f64; 3],
    /// vis-corr: number of channels in a group; the channels of every level of features are a multiple of it.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub group: usize,
    /// vis-corr: the planes of a second volume around the depth of the first one; absent: one volume.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cascade: Option<Cascade>,
    /// The number of planes for which the network is meant; runs choose theirs from the cameras.
    pub planes: usize,
    /// Distance between neighbouring planes in the source views, pixels of the photograph; absent: 4, half a pixel of the
    /// paper's coarse depth map.
    #[serde(default = "paper_plane_step", skip_serializing_if = "is_paper_plane_step")]
    pub plane_step: f64,
    /// The default flow iterations; those coarser than the coarse depth map are skipped.
    pub iterations: Vec<Iteration>,
    /// Depth completion on textureless surfaces, for maps at the coarse resolution; absent: none, as in the paper.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub completion: Option<Completion>,
    /// Standard deviation of colours on one surface, grey values, for joint bilateral upsampling; absent:
    /// nearest-neighbour upsampling, as in the paper.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub guide: Option<f32>,
    /// The flow uses only this many source views, the first ones; absent: all, as in the paper.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub flow_sources: Option<NonZeroUsize>,
    /// The licence of the weights.
    pub licence: String,
    /// What the weights were trained on.
    pub trained_on: String,
    /// Measured scores.
    pub scores: serde_json::Map<String, serde_json::Value>,
    /// The calibration: maps the confidence after the last of `iterations` to the fraction of pixels with an error of
    /// at most 1 %. Absent: not calibrated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub calibration: Option<MonotoneMap>,
    /// The calibration of refined depth maps: maps the confidence after refinement to the same fraction. Absent: not
    /// calibrated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub refined_calibration: Option<MonotoneMap>,
}

fn paper_stride() -> usize {
    LARGEST_STRIDE
}

fn is_paper_stride(coarse_stride: &usize) -> bool {
    *coarse_stride == LARGEST_STRIDE
}

fn paper_plane_step() -> f64 {
    LARGEST_STRIDE as f64 / 2.0
}

fn is_paper_plane_step(step: &f64) -> bool {
    *step == paper_plane_step()
}

fn are_zero(offsets: &[f64; 3]) -> bool {
    *offsets == [0.0; 3]
}

fn is_zero(count: &usize) -> bool {
    *count == 0
}

/// One flow iteration.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Iteration {
    /// The depth map's size is the photograph's divided by this: 8, 4, 2 or 1.
    pub scale: usize,
    /// Distance s between hypotheses, in plane distances.
    pub step: f64,
}

/// The second volume of a cascade. The first one is swept at twice the coarse stride, in a photograph of half the size.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Cascade {
    /// The number of planes around the depth of the first volume.
    pub planes: usize,
    /// Their distance, in plane distances of the first volume.
    pub step: f64,
}

impl Cascade {
    /// The places of the planes relative to the depth that they lie around, in plane distances of the first volume: (K).
    pub(crate) fn offsets(self, device: Device) -> Result<Tensor, TchError> {
        let middle = 0.5 * (self.planes - 1) as f64;
        let index = Tensor::f_arange(self.planes as i64, (Kind::Float, device))?;
        index.f_sub_scalar(middle)?.f_mul_scalar(self.step)
    }
}

impl Manifest {
    /// Parses and checks a manifest.
    ///
    /// # Errors
    /// If it is not the JSON of the contract, has another contract version, or has a value out of range.
    pub fn parse(json: &str, module: &str) -> Result<Self, NetError> {
        let wrong = |problem: String| NetError::Manifest { module: module.to_owned(), problem };
        let manifest: Self = serde_json::from_str(json)
            .map_err(|error| wrong(format!("is not the JSON that models/README.md describes: {error}")))?;
        if manifest.contract != CONTRACT {
            return Err(wrong(format!(
                "says contract {}, this program knows contract {CONTRACT}: export the module anew",
                manifest.contract
            )));
        }
        if !(1..=64).contains(&manifest.neighbours) || manifest.hypotheses > 8 {
            return Err(wrong(format!(
                "has {} neighbours (expected 1 to 64) and {} hypotheses (expected 0 to 8)",
                manifest.neighbours, manifest.hypotheses
            )));
        }
        manifest
            .check_strides(manifest.coarse_stride)
            .map_err(|problem| wrong(format!("cannot be used: {problem}")))?;
        if manifest.aggregation.correlates() && !(1..=256).contains(&manifest.group) {
            let group = manifest.group;
            return Err(wrong(format!("correlates groups of {group} channels: expected 1 to 256 (group)")));
        }
        if !(0.125..=64.0).contains(&manifest.plane_step) {
            return Err(wrong(format!(
                "has a plane_step of {} pixels: expected 0.125 to 64",
                manifest.plane_step
            )));
        }
        let offsets = manifest.feature_offsets;
        if !offsets.iter().zip(FLOW_SCALES).all(|(offset, scale)| (0.0..scale as f64 / 2.0).contains(offset))
        {
            return Err(wrong(format!(
                "has feature_offsets of {offsets:?} pixels: expected three, from 0 to less than 1, 2 and 4"
            )));
        }
        if manifest.aggregation.correlates() && !are_zero(&offsets) {
            return Err(wrong("has feature_offsets: expected none for vis-corr".to_owned()));
        }
        if !manifest.aggregation.has_flow() && !manifest.iterations.is_empty() {
            return Err(wrong("has iterations: expected none for vis-corr, which has no flow".to_owned()));
        }
        if let Some(cascade) = manifest.cascade {
            manifest.check_cascade(cascade).map_err(wrong)?;
        }
        if let Some(window) = manifest.window.filter(|window| *window > 64) {
            return Err(wrong(format!("has a window of {window} planes: expected 0 to 64")));
        }
        if let Some(Completion { stiffness, power }) = manifest.completion
            && !((0.0..=1e4).contains(&stiffness) && (0.0..=100.0).contains(&power))
        {
            return Err(wrong(format!(
                "has a completion of stiffness {stiffness} (expected 0 to 10000) and power {power} (expected 0 to 100)"
            )));
        }
        if let Some(colour) = manifest.guide.filter(|colour| !(1e-3..=1e4).contains(colour)) {
            return Err(wrong(format!("has a guide of {colour} grey values: expected 0.001 to 10000")));
        }
        if !(1..=8).contains(&manifest.flow_layers) || !(2..=4096).contains(&manifest.planes) {
            return Err(wrong(format!(
                "has {} flow_layers (expected 1 to 8) and {} planes (expected 2 to 4096)",
                manifest.flow_layers, manifest.planes
            )));
        }
        check_iterations(&manifest.iterations).map_err(wrong)?;
        Ok(manifest)
    }

    /// The entry of `feature_offsets` for features of this stride, 2, 4, 8 or, of a photograph that is enlarged for the
    /// others, 16.
    pub(crate) fn feature_offset(&self, stride: usize) -> f64 {
        let [half, quarter, eighth] = self.feature_offsets;
        match stride {
            2 => half,
            4 => quarter,
            _ => eighth * (stride / LARGEST_STRIDE) as f64,
        }
    }

    fn check_cascade(&self, Cascade { planes, step }: Cascade) -> Result<(), String> {
        if !(2..=64).contains(&planes) || !(0.01..=8.0).contains(&step) {
            return Err(format!(
                "has a cascade of {planes} planes (expected 2 to 64) with a step of {step} (expected 0.01 to 8)"
            ));
        }
        if !self.aggregation.correlates() || !self.context || !self.coarse_alone || self.feature_stride != 4 {
            return Err(
                "has a cascade: expected it of a vis-corr alone that has context, coarse_alone, and a \
                        feature_stride of 4"
                    .to_owned(),
            );
        }
        Ok(())
    }

    /// Checks that the network can work with this coarse stride.
    pub(crate) fn check_strides(&self, coarse: usize) -> Result<(), String> {
        match (coarse, self.feature_stride) {
            (4, 8) if self.aggregation.correlates() => Err(
                "a coarse stride of 4 is asked for: expected 8, as the network correlates features of the \
                     photograph as it is"
                    .to_owned(),
            ),
            (8, 8) | (4, 8 | 4) => Ok(()),
            (_, 8) => Err(format!("a coarse stride of {coarse} is asked for: expected 8 or 4")),
            (_, 4) => Err(format!(
                "a coarse stride of {coarse} is asked for: expected 4, the stride of the network's features"
            )),
            (_, features) => {
                Err(format!("coarse features have a stride of {features} pixels: expected 8 or 4"))
            }
        }
    }
}

/// Checks that scales are 8, 4, 2 or 1 and do not increase, and that steps are positive.
pub(crate) fn check_iterations(iterations: &[Iteration]) -> Result<(), String> {
    let mut before = LARGEST_STRIDE;
    for Iteration { scale, step } in iterations {
        if ![8, 4, 2, 1].contains(scale) || *scale > before {
            return Err(format!(
                "has an iteration at scale {scale} after {before}: expected 8, 4, 2 or 1, never growing"
            ));
        }
        if !(step.is_finite() && *step > 0.0) {
            return Err(format!(
                "has an iteration with step {step}: expected a positive number of plane distances"
            ));
        }
        before = *scale;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: &str = r#"{"contract":1,"name":"n","aggregation":"vis-max","neighbours":16,"hypotheses":2,"flow_layers":3,
        "planes":96,"iterations":[{"scale":8,"step":1.0},{"scale":2,"step":0.15}],"licence":"","trained_on":"","scores":{}}"#;

    #[test]
    fn a_good_manifest_is_read() {
        let manifest = Manifest::parse(GOOD, "test").unwrap();
        assert_eq!(manifest.aggregation, Aggregation::VisMax);
        assert_eq!(manifest.iterations[1], Iteration { scale: 2, step: 0.15 });
    }

    #[test]
    fn bad_ones_are_refused_with_the_reason() {
        for (from, to, reason) in [
            ("\"contract\":1", "\"contract\":7", "contract 7"),
            ("\"scale\":2", "\"scale\":3", "scale 3"),
            ("\"scale\":8", "\"scale\":1", "scale 2 after 1"),
            ("\"step\":0.15", "\"step\":0.0", "step 0"),
            ("\"neighbours\":16", "\"neighbours\":0", "0 neighbours"),
            ("vis-max", "vis-min", "vis-min"),
            ("\"scores\":{}", "\"scores\":{},\"calibration\":[[0.5,0.5],[0.4,0.9]]", "x to grow"),
            ("\"planes\":96", "\"planes\":96,\"plane_step\":0", "plane_step of 0 pixels"),
            ("\"planes\":96", "\"planes\":96,\"feature_offsets\":[0.5,1.5,4]", "less than 1, 2 and 4"),
            ("vis-max\"", "vis-corr\",\"group\":4,\"feature_offsets\":[0.5,1.5,3.5]", "none for vis-corr"),
            ("\"planes\":96", "\"planes\":96,\"window\":65", "window of 65"),
            ("\"planes\":96", "\"planes\":96,\"cascade\":{\"planes\":1,\"step\":0.5}", "cascade of 1 planes"),
            ("\"planes\":96", "\"planes\":96,\"cascade\":{\"planes\":8,\"step\":0.5}", "vis-corr alone"),
            ("\"planes\":96", "\"planes\":96,\"coarse_stride\":16", "a coarse stride of 16"),
            ("\"planes\":96", "\"planes\":96,\"feature_stride\":2", "stride of 2"),
            ("\"planes\":96", "\"planes\":96,\"feature_stride\":4", "the stride of the network's features"),
            ("vis-max", "vis-corr", "groups of 0 channels"),
            ("vis-max\"", "vis-corr\",\"coarse_stride\":4", "correlates features of the photograph as it is"),
            ("\"planes\":96", "\"planes\":96,\"guide\":0", "guide of 0"),
            ("\"planes\":96", "\"planes\":96,\"flow_sources\":0", "nonzero"),
            ("\"planes\":96", "\"planes\":96,\"completion\":{\"stiffness\":-1,\"power\":4}", "stiffness -1"),
            ("{\"contract\"", "[\"contract\"", "JSON"),
        ] {
            let error = Manifest::parse(&GOOD.replace(from, to), "test").unwrap_err().to_string();
            assert!(error.contains(reason), "{error}");
        }
    }
}
