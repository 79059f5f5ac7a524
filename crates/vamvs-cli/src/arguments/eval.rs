//! The arguments of `vamvs eval`.

use std::path::PathBuf;

use clap::{Args, Subcommand, ValueEnum};
use vamvs::eval::CloudThreshold;

/// The end of the command's help.
pub const EXAMPLES: &str = "\
Examples:
  vamvs eval depth out ground-truth                              depth maps of a scene, or of folders of scenes
  vamvs eval cloud out/fused.ply ground_truth.ply --thresholds 0.01,0.02
  vamvs eval cloud scan1.ply stl001_total.ply --preset dtu --mask ObsMask1_10.mat --plane Plane1.mat
  vamvs eval cloud Barn.ply ground_truth/Barn.ply --preset tnt --tau 0.01 --crop Barn.json --align Barn_trans.txt
  vamvs eval scene out ground-truth                              both, with a page of pictures: out/eval.html
  vamvs eval network vis-max my.pt --data hold-out --views 3 5 7        networks side by side";

/// `eval`.
#[derive(Debug, Args)]
pub struct EvalArguments {
    /// What to measure.
    #[command(subcommand)]
    pub what: EvalCommand,
}

/// What can be measured.
#[derive(Debug, Subcommand)]
pub enum EvalCommand {
    /// Compare depth maps with true ones.
    Depth(EvalDepthArguments),
    /// Compare a cloud with points of the true surface.
    Cloud(EvalCloudArguments),
    /// Compare depth maps and cloud of a scene with its true depth maps; write a page of the errors.
    Scene(EvalSceneArguments),
    /// Measure networks on scenes with ground truth, after each stage, and by visibility in the source views.
    #[cfg(feature = "torch")]
    Network(EvalNetworkArguments),
    /// As above, in a build with libtorch.
    #[cfg(not(feature = "torch"))]
    #[command(hide = true)]
    Network(super::Absent),
}

/// `eval depth`.
#[derive(Debug, Args)]
pub struct EvalDepthArguments {
    /// Folder of depth maps, as `vamvs depth` or others write it; a folder of such; or one depth map.
    #[arg(value_name = "PRED")]
    pub prediction: PathBuf,
    /// The same of the ground truth: depths/, cams/, images/, and perhaps visibility/ and pair.txt; or a folder of .pfm or
    /// .png depth maps with the same names.
    #[arg(value_name = "GROUND_TRUTH")]
    pub ground_truth: PathBuf,
    /// Thresholds.
    #[command(flatten)]
    pub thresholds: DepthThresholdFlags,
    /// Depth of one grey level of a 16-bit PNG, scene units [default: as `png-step.txt` beside it says, else 0.001].
    #[arg(long, value_name = "DEPTH")]
    pub png_step: Option<f64>,
    /// General flags.
    #[command(flatten)]
    pub general: EvalGeneralFlags,
}

/// `eval cloud`.
#[derive(Debug, Args)]
pub struct EvalCloudArguments {
    /// The cloud.
    #[arg(value_name = "CLOUD.ply")]
    pub cloud: PathBuf,
    /// Points of the true surface.
    #[arg(value_name = "GROUND_TRUTH.ply")]
    pub ground_truth: PathBuf,
    /// The protocol.
    #[arg(long, value_enum, default_value_t = CloudPreset::Generic)]
    pub preset: CloudPreset,
    /// generic: distance thresholds, scene units.
    #[arg(long, value_name = "DISTANCE,…", value_delimiter = ',', value_parser = positive)]
    pub thresholds: Vec<f64>,
    /// dtu.
    #[command(flatten)]
    pub dtu: DtuFlags,
    /// tnt.
    #[command(flatten)]
    pub tnt: TntFlags,
    /// General flags.
    #[command(flatten)]
    pub general: EvalGeneralFlags,
}

/// Protocols.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum CloudPreset {
    /// Distances in both directions, and shares within --thresholds.
    Generic,
    /// DTU: thinned to 0.2 mm, mask, ground plane, distances below 20 mm.
    Dtu,
    /// Tanks and Temples: aligned, cropped, voxels of τ/2, precision and recall at τ.
    Tnt,
}

/// What DTU's protocol needs.
#[derive(Debug, Args)]
#[command(next_help_heading = "DTU")]
pub struct DtuFlags {
    /// The scan's observability mask.
    #[arg(long, value_name = "ObsMaskN_10.mat")]
    pub mask: Option<PathBuf>,
    /// The scan's ground plane.
    #[arg(long, value_name = "PlaneN.mat")]
    pub plane: Option<PathBuf>,
    /// Seed of the random order in which points are visited for thinning [default: 0].
    #[arg(long, value_name = "N")]
    pub seed: Option<u64>,
}

/// What the protocol of Tanks and Temples needs.
#[derive(Debug, Args)]
#[command(next_help_heading = "Tanks and Temples")]
pub struct TntFlags {
    /// The scene's threshold: Barn 0.01, Caterpillar 0.005, Church 0.025, Courthouse 0.025, Ignatius 0.003,
    /// Meetingroom 0.01, Truck 0.005.
    #[arg(long, value_name = "DISTANCE", value_parser = positive)]
    pub tau: Option<f64>,
    /// The crop volume of the ground truth (SCENE.json).
    #[arg(long, value_name = "SCENE.json")]
    pub crop: Option<PathBuf>,
    /// The transform from the cloud to the ground truth, 4×4 numbers [default: identity].
    #[arg(long, value_name = "FILE")]
    pub align: Option<PathBuf>,
    /// Refine the alignment (ICP with scale, in the benchmark's three steps).
    #[arg(long)]
    pub icp: bool,
}

impl DtuFlags {
    /// Whether one of them is given.
    pub fn is_given(&self) -> bool {
        self.mask.is_some() || self.plane.is_some() || self.seed.is_some()
    }
}

impl TntFlags {
    /// Whether one of them is given.
    pub fn is_given(&self) -> bool {
        self.tau.is_some() || self.crop.is_some() || self.align.is_some() || self.icp
    }
}

/// `eval scene`.
#[derive(Debug, Args)]
pub struct EvalSceneArguments {
    /// Output folder of `vamvs reconstruct`.
    #[arg(value_name = "OUT")]
    pub out: PathBuf,
    /// Folder of the ground truth: depths/, cams/, images/, and perhaps visibility/ and pair.txt.
    #[arg(value_name = "GROUND_TRUTH")]
    pub ground_truth: PathBuf,
    /// The cloud [default: OUT/fused.ply, if it is there].
    #[arg(long, value_name = "FILE.ply")]
    pub cloud: Option<PathBuf>,
    /// Distance thresholds for the cloud, in scene units or, as in 0.3%, of the median depth [default: 0.5%,1%].
    #[arg(long, value_name = "DISTANCE|N%,…", value_delimiter = ',', value_parser = cloud_threshold)]
    pub distances: Option<Vec<CloudThreshold>>,
    /// The page to write [default: OUT/eval.html].
    #[arg(long, value_name = "FILE.html")]
    pub html: Option<PathBuf>,
    /// Thresholds.
    #[command(flatten)]
    pub thresholds: DepthThresholdFlags,
    /// General flags.
    #[command(flatten)]
    pub general: EvalGeneralFlags,
}

/// `eval network`.
#[cfg(feature = "torch")]
#[derive(Debug, Args)]
pub struct EvalNetworkArguments {
    /// The networks: names of built-in ones, or files.
    #[arg(value_name = "NAME|FILE.pt", required = true)]
    pub networks: Vec<PathBuf>,
    /// Scenes with ground truth, or folders of such: of `vamvs synth`, BlendedMVS, DTU's training set.
    #[arg(long, value_name = "DIR", num_args = 1.., required = true)]
    pub data: Vec<PathBuf>,
    /// Number of views for a depth map, as with `vamvs depth --views`; several values are measured in turn.
    #[arg(long, value_name = "N", num_args = 1.., default_values_t = [5])]
    pub views: Vec<usize>,
    /// Reference views, spread evenly over the scenes.
    #[arg(long, value_name = "N", default_value_t = 16)]
    pub references: usize,
    /// Larger photographs are reduced to this longer side, pixels.
    #[arg(long, value_name = "PIXELS", default_value_t = 512)]
    pub max_size: usize,
    /// Upper limit of the number of planes; the depth range is a tenth wider than the true one.
    #[arg(long, value_name = "N", default_value_t = 96)]
    pub max_planes: usize,
    /// Stride of the coarse depth map, 8 or 4 pixels [default: each network's own].
    #[arg(long, alias = "cells", value_name = "PIXELS")]
    pub coarse_stride: Option<usize>,
    /// Weight views by the true visibility instead of the network's (an experiment with vis-var).
    #[arg(long)]
    pub true_visibility: bool,
    /// auto, cpu, cuda or cuda:N.
    #[arg(long, value_name = "DEVICE", default_value = "auto")]
    pub device: String,
    /// General flags.
    #[command(flatten)]
    pub general: EvalGeneralFlags,
}

/// Thresholds of the error of depth.
#[derive(Debug, Args)]
#[command(next_help_heading = "Thresholds")]
pub struct DepthThresholdFlags {
    /// In scene units.
    #[arg(long, value_name = "DEPTH,…", value_delimiter = ',', value_parser = positive)]
    pub absolute: Vec<f64>,
    /// As shares of the true depth [default: 0.002,0.005,0.01,0.02, if no threshold is given].
    #[arg(long, value_name = "SHARE,…", value_delimiter = ',', value_parser = positive)]
    pub relative: Vec<f64>,
    /// In distances of the sweep's planes [default: 1,3, if no threshold is given and the distance is known].
    #[arg(long, value_name = "N,…", value_delimiter = ',', value_parser = positive)]
    pub planes: Vec<f64>,
    /// Distance of the planes, scene units [default: from depths/NAME.json].
    #[arg(long, value_name = "DEPTH", value_parser = positive)]
    pub plane_distance: Option<f64>,
}

/// General flags.
#[derive(Debug, Args)]
#[command(next_help_heading = "General")]
pub struct EvalGeneralFlags {
    /// Threads [default: one per core].
    #[arg(long, value_name = "N")]
    pub threads: Option<usize>,
    /// Print nothing but results, errors and warnings.
    #[arg(short, long)]
    pub quiet: bool,
    /// Print results as JSON.
    #[arg(long)]
    pub json: bool,
}

fn cloud_threshold(text: &str) -> Result<CloudThreshold, String> {
    match text.trim().strip_suffix('%') {
        Some(percent) => Ok(CloudThreshold::ShareOfMedianDepth(positive(percent)? / 100.0)),
        None => Ok(CloudThreshold::Distance(positive(text)?)),
    }
}

fn positive(text: &str) -> Result<f64, String> {
    match text.trim().parse() {
        Ok(value) if value > 0.0 && f64::is_finite(value) => Ok(value),
        _ => Err("expected a number above 0".to_owned()),
    }
}
