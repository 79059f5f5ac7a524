//! A cloud against points of the true surface, by one of three protocols.

use std::path::Path;

use serde::Serialize;
use vamvs_core::Cloud;
use vamvs_eval::dtu::{DtuProtocol, DtuScores};
use vamvs_eval::tnt::{TntProtocol, TntScores};
use vamvs_eval::{CloudErrors, TooFine, area, compare_clouds, samples};
use vamvs_io::ply;

use crate::VamvsError;

/// The points on a mesh where no resolution is given.
const A_MILLION: f64 = 1e6;

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
    /// What is resolved; `None` if nothing tells.
    fn resolution(&self) -> Option<f64> {
        match self {
            Self::Dtu(protocol) => Some(protocol.spacing),
            Self::Tnt { protocol, .. } => Some(protocol.tau),
            Self::Generic { thresholds } => thresholds.iter().copied().min_by(f64::total_cmp),
        }
    }

    /// Measures the PLY file `cloud`, a cloud or a mesh, against the PLY file `ground_truth`.
    ///
    /// # Errors
    /// If a file cannot be read or has no points, or the clouds do not fit the protocol.
    pub fn scores(&self, cloud: &Path, ground_truth: &Path) -> Result<CloudScores, VamvsError> {
        let places = |points: Cloud| points.iter().map(|point| point.x_in_world).collect::<Vec<_>>();
        let [cloud, ground_truth] =
            [points(cloud, self.resolution())?, points(ground_truth, self.resolution())?].map(places);
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

/// The points of a PLY file or, if it is a mesh, points on its triangles: half the resolution apart or, without one, a million.
pub(super) fn points(path: &Path, resolution: Option<f64>) -> Result<Cloud, VamvsError> {
    let (vertices, triangles) = ply::read_mesh(path)?;
    let points = match triangles.is_empty() {
        true => vertices.into_iter().filter(|point| point.x_in_world.iter().all(|x| x.is_finite())).collect(),
        false => {
            let spacing =
                resolution.filter(|resolution| *resolution > 0.0).map(|resolution| resolution / 2.0);
            let spacing = spacing.unwrap_or_else(|| (area(&vertices, &triangles) / A_MILLION).sqrt());
            samples(&vertices, &triangles, spacing)
        }
    };
    match points.len() {
        0 => Err(VamvsError::Request(format!("{}: expected a cloud, found no points", path.display()))),
        _ => Ok(points),
    }
}
