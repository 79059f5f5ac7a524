//! The flags of fusion.

use clap::{Args, ValueEnum};
use vamvs::fusion::Consistency;
use vamvs::fusion::PointSpacing;

/// How depth maps are filtered.
#[derive(Debug, Args)]
#[command(next_help_heading = "Fusion")]
pub struct FusionFlags {
    /// A set of thresholds; other flags override them.
    #[arg(long, value_enum)]
    pub preset: Option<Preset>,
    /// Rule of geometric consistency: which points other views confirm [default: dynamic].
    #[arg(long, value_enum, value_name = "RULE")]
    pub consistency: Option<Consistency>,
    /// Number of views that must agree on a point, its own included [default: dynamic 2, classic 3].
    #[arg(long, value_name = "N")]
    pub min_views: Option<usize>,
    /// dynamic: threshold of the sum of votes times the number of voters; a vote is at most 1 [default: 0.4].
    #[arg(long, value_name = "VOTES")]
    pub min_support: Option<f32>,
    /// dynamic: what each free-space violation (a view that sees through the point) subtracts from the votes
    /// [default: 0.25].
    #[arg(long, value_name = "VOTES")]
    pub contradiction: Option<f32>,
    /// Largest reprojection error, into another view and back, pixels of the depth map [default: 1].
    #[arg(long, value_name = "PIXELS")]
    pub max_reprojection: Option<f32>,
    /// Largest relative difference of the depth that is projected back [default: 0.01].
    #[arg(long, value_name = "SHARE")]
    pub max_relative_depth: Option<f32>,
    /// Photometric filter: least confidence of the final depth, 0 to 1 [default: 0.15].
    #[arg(long, value_name = "SHARE")]
    pub confidence: Option<f32>,
    /// Photometric filter: least confidence of the coarse depth, 0 to 1 [default: 0.2].
    #[arg(long, value_name = "SHARE")]
    pub coarse_confidence: Option<f32>,
    /// Leave out points whose standard deviation along the ray is larger, scene units [default: no limit].
    #[arg(long, value_name = "DISTANCE")]
    pub max_sigma: Option<f64>,
    /// Number of source views that a view is checked against [default: 10].
    #[arg(long, value_name = "N")]
    pub neighbours: Option<usize>,
    /// Least distance between points: in scene units, or in pixels as in 2px [default: as dense as the view that sees a
    /// surface in most detail].
    #[arg(long, value_name = "DISTANCE|PIXELSpx", value_parser = point_spacing)]
    pub point_spacing: Option<PointSpacing>,
}

/// Reads a `--point-spacing`.
fn point_spacing(text: &str) -> Result<PointSpacing, String> {
    let expected = "expected a positive distance in scene units, such as 0.01, or pixels, such as 2px";
    let pixels = text.strip_suffix("px");
    let number: f64 = pixels.unwrap_or(text).trim().parse().map_err(|_| expected.to_owned())?;
    if !(number > 0.0 && number.is_finite()) {
        return Err(expected.to_owned());
    }
    Ok(if pixels.is_some() { PointSpacing::Pixels(number) } else { PointSpacing::Units(number) })
}

/// Sets of thresholds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Preset {
    /// Relative thresholds that fit any scene.
    Default,
    /// The paper's values for DTU, for depth maps that are not refined, as in the paper: `reconstruct` then makes such.
    /// Least confidences are the network's probabilities before their calibration.
    Dtu,
}
