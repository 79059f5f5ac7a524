//! The arguments of `vamvs calibrate`.

use std::path::PathBuf;

use clap::Args;

/// The end of the command's help.
pub const EXAMPLES: &str = "\
Example:
  vamvs calibrate --data hold-out --weights run/best.pt --out tuned.pt

A depth counts as right if its error is at most 1 %. Half of the views are fitted to, the other half tell
what came of it. The network's own confidence is calibrated, and that of the refined depth maps.";

/// `calibrate`.
#[derive(Debug, Args)]
pub struct CalibrateArguments {
    /// Scenes with ground truth that the network was not trained on.
    #[arg(long, value_name = "DIR", num_args = 1.., required = true)]
    pub data: Vec<PathBuf>,
    /// The network.
    #[arg(long, value_name = "FILE.pt")]
    pub weights: PathBuf,
    /// The calibrated network.
    #[arg(short, long, value_name = "FILE.pt")]
    pub out: PathBuf,
    /// Write a page with reliability diagrams before and after.
    #[arg(long, value_name = "FILE.html")]
    pub page: Option<PathBuf>,
    /// Reference views, spread evenly over the scenes.
    #[arg(long, value_name = "N", default_value_t = 40)]
    pub references: usize,
    /// Number of views for a depth map, as with `vamvs depth --views`.
    #[arg(long, value_name = "N", default_value_t = 5)]
    pub views: usize,
    /// Calibrate the network's own confidence only: refined depth maps take longer.
    #[arg(long)]
    pub no_refine: bool,
    /// auto, cpu, cuda or cuda:N.
    #[arg(long, value_name = "DEVICE", default_value = "auto")]
    pub device: String,
    /// Threads [default: one per core].
    #[arg(long, value_name = "N")]
    pub threads: Option<usize>,
    /// Print the result as JSON.
    #[arg(long)]
    pub json: bool,
}
