//! A cloud against points of the true surface, by one of three protocols.

use std::path::Path;

use serde::Serialize;
use vamvs_eval::dtu::{DtuProtocol, DtuScores};
use vamvs_eval::tnt::{TntProtocol, TntScores};
use vamvs_eval::{CloudErrors, TooFine, compare_clouds};
use vamvs_io::ply;

use crate::VamvsError;

/// How a cloud is measured.
#[derive(Clone, Debug, PartialEq)]
pub enum CloudProtocol {
    /// That of DTU.
    Dtu(DtuProtocol),
    /// That of Tanks and Temples.
    Tnt {
        /// The protocol.
        protocol: TntProtocol,
        /// Whether to refine the alignment of the clouds (ICP) first.
        refine: bool,
    },
    /// Distances in both directions, without alignment.
    Generic {
        /// Thresholds, scene units.
        thresholds: Vec<f64>,
    },
}

/// The scores of a cloud.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "protocol", rename_all = "kebab-case")]
pub enum CloudScores {
    /// DTU's, mm.
    Dtu(DtuScores),
    /// Those of Tanks and Temples.
    Tnt(TntScores),
    /// In both directions.
    Generic(CloudErrors),
}

impl CloudProtocol {
    /// Measures the PLY file `cloud` against the PLY file `ground_truth`.
    ///
    /// # Errors
    /// If a file cannot be read or has no points, or the clouds do not fit the protocol.
    pub fn scores(&self, cloud: &Path, ground_truth: &Path) -> Result<CloudScores, VamvsError> {
        let (cloud, ground_truth) = (read(cloud)?, read(ground_truth)?);
        let refused = |error: TooFine| VamvsError::Request(error.to_string());
        Ok(match self {
            Self::Dtu(protocol) => CloudScores::Dtu(protocol.scores(&cloud, &ground_truth).map_err(refused)?),
            Self::Tnt { protocol, refine } => {
                let protocol = protocol.clone();
                let protocol = if *refine {
                    protocol.refined(&cloud, &ground_truth).map_err(refused)?
                } else {
                    protocol
                };
                CloudScores::Tnt(protocol.scores(&cloud, &ground_truth).map_err(refused)?)
            }
            Self::Generic { thresholds } => {
                CloudScores::Generic(compare_clouds(&cloud, &ground_truth, thresholds))
            }
        })
    }
}

fn read(path: &Path) -> Result<Vec<[f64; 3]>, VamvsError> {
    let points = ply::read_positions(path)?;
    match points.len() {
        0 => Err(VamvsError::Request(format!("{}: expected a cloud, found no points", path.display()))),
        _ => Ok(points),
    }
}
