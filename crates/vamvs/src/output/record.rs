//! What an output folder tells of its depth maps, and of views without one.

use serde::{Deserialize, Serialize};
use vamvs_core::{MonotoneMap, Planes};

use crate::VamvsError;

/// The record of how a depth map was made, stored next to it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// The hash of all inputs of the depth map.
    pub made_of: String,
    /// The planes of the sweep; `None` if there were none or they are unknown.
    #[serde(default)]
    pub planes: Option<Planes>,
    /// Names of the source views, best first; empty if unknown.
    #[serde(default)]
    pub sources: Vec<String>,
    /// What the values of its confidence map are.
    #[serde(default)]
    pub confidence: ConfidenceKind,
    /// The photograph and mask of the view itself; `None` if they were not files or are unknown.
    #[serde(default)]
    pub photograph: Option<PhotographRecord>,
}

/// The content of a photograph and its mask.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PhotographRecord {
    /// The paths, sizes and times of last change of the files. As long as they are the same, the content is taken to be the same
    /// too and is not read to be compared.
    pub stamp: String,
    /// The hash of the content, 64 hexadecimal digits.
    pub hash: String,
}

/// What the values of a confidence map are.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum ConfidenceKind {
    /// Unknown.
    #[default]
    Unknown,
    /// The network's probability of the depth, as in the paper (sections 3.2 and 3.4).
    Probability,
    /// The share of pixels with an error of at most 1 %, to which this map takes the network's probability.
    Calibrated(MonotoneMap),
    /// An estimate of that share by the refinement, which does not know the network's probability.
    Refined,
}

/// A view that is left out of a result.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct LeftOut {
    /// The view's name.
    pub view: String,
    /// Why.
    pub reason: String,
}

impl LeftOut {
    /// The error of a run in which this is the first of the views, and none has a depth map.
    pub(crate) fn of_all(self) -> VamvsError {
        let Self { view, reason } = self;
        VamvsError::Request(format!("no depth map could be made: {view}: {reason}"))
    }
}
