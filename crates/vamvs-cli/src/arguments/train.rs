//! The arguments of `vamvs train`.

use std::path::PathBuf;

use clap::{ArgAction, Args, ValueEnum};
use vamvs_train::options::Rule;

/// The end of the command's help.
pub const EXAMPLES: &str = "\
Examples:
  vamvs synth --out set --scenes 200 --rig mixed
  vamvs synth --out hold-out --scenes 20 --rig mixed --seed 1
  vamvs train --data set --validation hold-out --network start.pt --out run
  vamvs train --data my-scans --network weights/vis-max.pt --learning-rate 1e-4 --steps 2000 --out tuned

The same command again goes on where an interrupted run was. OUT holds module.pt (the last weights),
best.pt (the best on the validation scenes), curves.html, validation.png, log.jsonl and checkpoints/.
models/README.md tells how to export an untrained network.";

/// `train`.
#[derive(Debug, Args)]
pub struct TrainArguments {
    /// Scenes with ground truth, or folders of such: of `vamvs synth`, BlendedMVS, DTU's training set.
    #[arg(long, value_name = "DIR", num_args = 1.., required = true)]
    pub data: Vec<PathBuf>,
    /// Scenes to validate on.
    #[arg(long, value_name = "DIR", num_args = 1..)]
    pub validation: Vec<PathBuf>,
    /// The network to start from, untrained or trained.
    #[arg(long, value_name = "FILE.pt")]
    pub network: PathBuf,
    /// Folder of the run.
    #[arg(short, long, value_name = "DIR")]
    pub out: PathBuf,
    /// How it is trained.
    #[command(flatten)]
    pub training: TrainingFlags,
    /// What is shown to the network.
    #[command(flatten)]
    pub samples: SampleFlags,
    /// What is written when.
    #[command(flatten)]
    pub watching: WatchingFlags,
    /// auto, cpu, cuda or cuda:N.
    #[arg(long, value_name = "DEVICE", default_value = "auto")]
    pub device: String,
    /// Threads [default: one per core].
    #[arg(long, value_name = "N")]
    pub threads: Option<usize>,
    /// Print nothing but errors and warnings.
    #[arg(short, long)]
    pub quiet: bool,
    /// Print events as JSON lines on standard output.
    #[arg(long)]
    pub json: bool,
}

/// How a network is trained.
#[derive(Debug, Args)]
#[command(next_help_heading = "Training")]
pub struct TrainingFlags {
    /// Defaults of all other flags.
    #[arg(long, value_enum, default_value_t = TrainPreset::Compact)]
    pub preset: TrainPreset,
    /// Steps of the optimiser [default: 40000].
    #[arg(long, value_name = "N")]
    pub steps: Option<usize>,
    /// Steps at the beginning that train the coarse part alone [default: a tenth; paper: a sixth].
    #[arg(long, value_name = "N")]
    pub coarse_steps: Option<usize>,
    /// Train the flow alone, on the network's own coarse maps, with normalisation as at inference.
    #[arg(long, conflicts_with_all = ["coarse_steps", "freeze_norm_after"])]
    pub flow_alone: bool,
    /// Step after which normalisation uses its running statistics, as at inference [default: half; paper: never].
    #[arg(long, value_name = "N")]
    pub freeze_norm_after: Option<usize>,
    /// Samples per step [default: 2; paper: 4].
    #[arg(long, value_name = "N")]
    pub batch: Option<usize>,
    /// The optimiser [default: adam-w; paper: rms-prop].
    #[arg(long, value_enum)]
    pub optimizer: Option<Rule>,
    /// The learning rate after the warm-up [default: 1e-3; paper: 5e-4].
    #[arg(long, value_name = "RATE")]
    pub learning_rate: Option<f64>,
    /// Steps of linear warm-up of the learning rate [default: 500; paper: 0].
    #[arg(long, value_name = "N")]
    pub warm_up: Option<usize>,
    /// Weight decay [default: 0.01; paper: 0.001].
    #[arg(long, value_name = "SHARE")]
    pub weight_decay: Option<f64>,
    /// Largest norm of the gradient (clipping), 0 for none [default: 1; paper: 0].
    #[arg(long, value_name = "NORM")]
    pub clip: Option<f64>,
    /// Weight of the supervised visibility of vis-var [default: 0.01].
    #[arg(long, value_name = "WEIGHT")]
    pub visibility_weight: Option<f64>,
    /// The flow does not learn where the error of the depth before is more than this many times its reach; 0: it learns
    /// everywhere [default: 2; paper: 0].
    #[arg(long, value_name = "TIMES")]
    pub flow_reach: Option<f64>,
    /// Weight of the cross entropy of the coarse stage's planes; 0: equation 8 alone [default: 1; paper: 0].
    #[arg(long, value_name = "WEIGHT")]
    pub cross_entropy: Option<f64>,
    /// Weight of the probability of a surface, of a cascade [default: 1].
    #[arg(long, value_name = "WEIGHT")]
    pub surface_weight: Option<f64>,
    /// Seed of the random numbers [default: 0].
    #[arg(long, value_name = "N")]
    pub seed: Option<u64>,
}

/// What is shown to the network.
#[derive(Debug, Args)]
#[command(next_help_heading = "Samples")]
pub struct SampleFlags {
    /// Size of the crops, multiples of 8 [default: 256 192; paper: 640 512].
    #[arg(long, action = ArgAction::Set, num_args = 2, value_names = ["WIDTH", "HEIGHT"])]
    pub crop: Option<Vec<usize>>,
    /// Fewest and most views, the reference included [default: 2 5; paper: 3 3].
    #[arg(long, action = ArgAction::Set, num_args = 2, value_names = ["FEWEST", "MOST"])]
    pub views: Option<Vec<usize>>,
    /// Upper limit of the number of planes [default: 64; paper: 48].
    #[arg(long, value_name = "N")]
    pub max_planes: Option<usize>,
    /// Smallest scale to which photographs are reduced [default: 0.5; paper: 1].
    #[arg(long, value_name = "SCALE")]
    pub min_scale: Option<f64>,
    /// Largest change of the ends of the depth range, as a logarithm [default: 0.25; paper: 0].
    #[arg(long, value_name = "LOG")]
    pub range_jitter: Option<f64>,
    /// Share of samples whose depth range ends before the farthest surfaces, 0 to 1 [default: 0].
    #[arg(long, value_name = "SHARE")]
    pub beyond: Option<f64>,
    /// Standard deviation of the errors of the source cameras, pixels [default: 0.3; paper: 0].
    #[arg(long, value_name = "PIXELS")]
    pub camera_noise: Option<f64>,
    /// No augmentation of the photographs (colours, exposure, sharpness, noise), as in the paper.
    #[arg(long)]
    pub no_augmentation: bool,
    /// Weight views by the true visibility instead of the network's (an experiment with vis-var).
    #[arg(long)]
    pub true_visibility: bool,
}

/// What is written when.
#[derive(Debug, Args)]
#[command(next_help_heading = "Watching")]
pub struct WatchingFlags {
    /// Steps between validations.
    #[arg(long, value_name = "N", default_value_t = 1000)]
    pub validate_every: usize,
    /// Reference views of a validation.
    #[arg(long, value_name = "N", default_value_t = 16)]
    pub validation_views: usize,
    /// Minutes between checkpoints.
    #[arg(long, value_name = "N", default_value_t = 5.0)]
    pub checkpoint_minutes: f64,
}

/// Defaults of all other flags.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum TrainPreset {
    /// Small crops, many steps.
    Compact,
    /// The paper's training: two flow iterations (s = 0.75 and 0.375), no augmentation. Not as in the paper: samples of
    /// a batch come one after the other, so that batch normalisation sees one at a time; photographs larger than the
    /// crops are cropped; planes span each view's own depth range.
    Paper,
}
