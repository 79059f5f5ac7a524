//! A cloud against points of the true surface, by one of three protocols.

use std::path::Path;

use serde::Serialize;
use vamvs_core::Cloud;
use vamvs_eval::dtu::{DtuProtocol, DtuScores};
use vamvs_eval::tnt::{TntProtocol, TntScores};
use vamvs_eval::{CloudErrors, TooFine, area, compare_clouds, samples};
use vamvs_io::ply;

use crate::VamvsError;

/// The most points that are taken of a mesh.
const MOST_POINTS: f64 = 2e7;

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
        let resolution = self.resolution();
        let (cloud, ground_truth) = (read(cloud, resolution)?, read(ground_truth, resolution)?);
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

/// The positions of a PLY file's points or, if it is a mesh, of points on it.
fn read(path: &Path, resolution: Option<f64>) -> Result<Vec<[f64; 3]>, VamvsError> {
    let points = match ply::is_mesh(path)? {
        true => on_mesh(path, resolution)?.iter().map(|point| point.x_in_world).collect(),
        false => ply::read_positions(path)?,
    };
    match points.len() {
        0 => Err(VamvsError::Request(format!("{}: expected a cloud, found no points", path.display()))),
        _ => Ok(points),
    }
}

/// Points on a mesh, half the resolution apart; fewer where these are too many, and the most where no resolution is given.
pub(super) fn on_mesh(path: &Path, resolution: Option<f64>) -> Result<Cloud, VamvsError> {
    let (vertices, triangles) = ply::read_mesh(path)?;
    let least = (area(&vertices, &triangles) / MOST_POINTS).sqrt();
    Ok(samples(&vertices, &triangles, least.max(resolution.unwrap_or(0.0) / 2.0)))
}
