//! The flags of fusion.

use clap::{Args, ValueEnum};
use vamvs::fusion::Consistency;
use vamvs::fusion::PointSpacing;

/// How depth maps are filtered.
#[derive(Debug, Args)]
#[command(next_help_heading = "Fusion")]
pub struct FusionFlags {
    /// A set of thresholds; other flags change them.
    #[arg(long, value_enum)]
    pub preset: Option<Preset>,
    /// How it is decided whether other views confirm a point [default: dynamic].
    #[arg(long, value_enum, value_name = "RULE")]
    pub consistency: Option<Consistency>,
    /// Views that must agree on a point, its own included [default: dynamic 2, classic 3].
    #[arg(long, value_name = "N")]
    pub min_views: Option<usize>,
    /// dynamic: what the votes for a point times the number of voters must come to; a vote is at most 1 [default: 0.6].
    #[arg(long, value_name = "VOTES")]
    pub min_support: Option<f32>,
    /// dynamic: what a view that sees through a point takes away from its votes; 0 for nothing
    /// [default: 0.25].
    #[arg(long, value_name = "VOTES")]
    pub contradiction: Option<f32>,
    /// How far a pixel may come back from itself by way of another view, pixels of the depth map [default: 1].
    #[arg(long, value_name = "PIXELS")]
    pub max_reprojection: Option<f32>,
    /// How much the depth that comes back may differ, as a share [default: 0.01].
    #[arg(long, value_name = "SHARE")]
    pub max_relative_depth: Option<f32>,
    /// Least confidence of the final depth, 0 to 1 [default: 0.1].
    #[arg(long, value_name = "SHARE")]
    pub confidence: Option<f32>,
    /// Least confidence of the coarse depth, 0 to 1 [default: 0.2].
    #[arg(long, value_name = "SHARE")]
    pub coarse_confidence: Option<f32>,
    /// Other views asked whether they agree with a view's depth [default: 10].
    #[arg(long, value_name = "N")]
    pub neighbours: Option<usize>,
    /// How far apart points are at least: a distance in scene units, or pixels as in 2px [default: every place once, as
    /// dense as the view that sees it in most detail].
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
    /// The paper's values for DTU.
    Dtu,
}
