//! The arguments of `vamvs refine`.

use std::path::PathBuf;

use clap::Args;

use super::{CommonFlags, InputFlags};

pub const EXAMPLES: &str = "\
Examples:
  vamvs refine out --colmap sparse/0 --images images     photographs as `vamvs reconstruct` got them
  vamvs fuse out/refined
  vamvs refine dense                                     COLMAP's workspace, with its own photographs
  vamvs refine out --cams cams --images images --max-size 3000 --out fine

Depth maps that are in --out already, made of the same depth maps, photographs and settings, are kept,
so a run that was interrupted goes on where it was.";

/// `refine`.
#[derive(Debug, Args)]
pub struct RefineArguments {
    /// Folder of depth maps, as for `vamvs fuse`.
    #[arg(value_name = "DEPTHS")]
    pub depths: PathBuf,
    /// Depth of one grey level of 16-bit PNG depth maps, scene units [default: as png-step.txt beside them says].
    #[arg(long, value_name = "DEPTH")]
    pub png_step: Option<f64>,
    /// The scene with the photographs, and the cameras of depth maps that have none beside them [default: that of run.toml next to the depth maps, else the photographs there].
    #[command(flatten)]
    pub input: InputFlags,
    /// Folder for refined depth maps [default: refined/ next to the depth maps].
    #[arg(short, long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Larger photographs are reduced to this longer side, pixels; depth maps get the same size [default: 2000].
    #[arg(long, value_name = "PIXELS")]
    pub max_size: Option<usize>,
    /// Number of views for a depth map, the reference view included [default: 5].
    #[arg(long, value_name = "N")]
    pub views: Option<usize>,
    /// Use the photographs alone, without the geometric pass: faster, with more outliers.
    #[arg(long)]
    pub no_geometric: bool,
    /// Where planes are matched: cpu, gpu or gpu:N, a GPU of any vendor; `vamvs info device` lists them; auto is such a GPU, if there is one [default: cpu].
    #[cfg(feature = "gpu")]
    #[arg(long, value_name = "DEVICE")]
    pub device: Option<String>,
    /// Refine again what exists already.
    #[arg(long)]
    pub force: bool,
    /// What every command has.
    #[command(flatten)]
    pub common: CommonFlags,
}
