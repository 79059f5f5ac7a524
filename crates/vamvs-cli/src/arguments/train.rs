//! What `vamvs train` understands.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use vamvs_train::options::Rule;

/// The end of the command's help.
pub const EXAMPLES: &str = "\
Examples:
  vamvs synth --out set --scenes 200 --rig mixed
  vamvs synth --out hold-out --scenes 20 --rig mixed --seed 1
  vamvs train --data set --validation hold-out --network vis-max.pt --out run
  vamvs train --data my-scans --network weights/vis-max.pt --learning-rate 1e-4 --steps 2000 --out tuned

The same command again goes on where an interrupted run was. OUT holds module.pt (the last weights),
best.pt (the best on the validation scenes), curves.html, validation.png, log.jsonl and checkpoints/.
models/README.md tells how to export an untrained network.";

/// `train`.
#[derive(Debug, Args)]
pub struct TrainArguments {
    /// Scenes with true depths, or folders of such: of `vamvs synth`, BlendedMVS, DTU's training set.
    #[arg(long, value_name = "DIR", num_args = 1.., required = true)]
    pub data: Vec<PathBuf>,
    /// Scenes to measure with.
    #[arg(long, value_name = "DIR", num_args = 1..)]
    pub validation: Vec<PathBuf>,
    /// The network to begin with: an untrained one, or one to be tuned.
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
    /// Threads [default: one a core].
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
    /// Values for all that is not given.
    #[arg(long, value_enum, default_value_t = TrainPreset::Compact)]
    pub preset: TrainPreset,
    /// Steps of the optimiser [default: 40000].
    #[arg(long, value_name = "N")]
    pub steps: Option<usize>,
    /// Steps at the beginning for the coarse part alone [default: a tenth; paper: a sixth].
    #[arg(long, value_name = "N")]
    pub coarse_steps: Option<usize>,
    /// Train the flow alone, on coarse maps as the network makes them, normalisation as in use.
    #[arg(long, conflicts_with_all = ["coarse_steps", "freeze_norm_after"])]
    pub flow_alone: bool,
    /// Steps after which normalisation keeps its statistics, as in use [default: half; paper: never].
    #[arg(long, value_name = "N")]
    pub freeze_norm_after: Option<usize>,
    /// Samples a step [default: 2; paper: 4].
    #[arg(long, value_name = "N")]
    pub batch: Option<usize>,
    /// How weights follow the gradient [default: adam-w; paper: rms-prop].
    #[arg(long, value_enum)]
    pub optimizer: Option<Rule>,
    /// The learning rate after the warm-up [default: 1e-3; paper: 5e-4].
    #[arg(long, value_name = "RATE")]
    pub learning_rate: Option<f64>,
    /// Steps over which the learning rate grows from nothing [default: 500; paper: 0].
    #[arg(long, value_name = "N")]
    pub warm_up: Option<usize>,
    /// Weight decay [default: 0.01; paper: 0.001].
    #[arg(long, value_name = "SHARE")]
    pub weight_decay: Option<f64>,
    /// Largest norm of a gradient, 0 for any [default: 1; paper: 0].
    #[arg(long, value_name = "NORM")]
    pub clip: Option<f64>,
    /// Weight of the supervised visibility of vis-var [default: 0.01].
    #[arg(long, value_name = "WEIGHT")]
    pub visibility_weight: Option<f64>,
    /// Flow does not learn where the depth before is wrong by more than this many times its reach; 0: it
    /// learns everywhere [default: 2; paper: 0].
    #[arg(long, value_name = "TIMES")]
    pub flow_reach: Option<f64>,
    /// Weight of the cross entropy of the coarse stage's planes; 0: equation 8 alone [default: 1; paper: 0].
    #[arg(long, value_name = "WEIGHT")]
    pub cross_entropy: Option<f64>,
    /// Other seeds, other samples [default: 0].
    #[arg(long, value_name = "N")]
    pub seed: Option<u64>,
}

/// What is shown to the network.
#[derive(Debug, Args)]
#[command(next_help_heading = "Samples")]
pub struct SampleFlags {
    /// Size of the cut-outs, multiples of 8 [default: 256 192; paper: 640 512].
    #[arg(long, num_args = 2, value_names = ["WIDTH", "HEIGHT"])]
    pub crop: Option<Vec<usize>>,
    /// Fewest and most views, the reference included [default: 2 5; paper: 3 3].
    #[arg(long, num_args = 2, value_names = ["FEWEST", "MOST"])]
    pub views: Option<Vec<usize>>,
    /// Most planes [default: 64; paper: 48].
    #[arg(long, value_name = "N")]
    pub max_planes: Option<usize>,
    /// Smallest scale to which photographs are reduced [default: 0.5; paper: 1].
    #[arg(long, value_name = "SCALE")]
    pub min_scale: Option<f64>,
    /// Largest change of the ends of the depth range, as a logarithm [default: 0.25; paper: 0].
    #[arg(long, value_name = "LOG")]
    pub range_jitter: Option<f64>,
    /// Deviation of the errors of the sources' cameras, pixels [default: 0.3; paper: 0].
    #[arg(long, value_name = "PIXELS")]
    pub camera_noise: Option<f64>,
    /// Photographs as they are, as with the paper's preset: no change of colours, exposure, sharpness, no noise.
    #[arg(long)]
    pub no_augmentation: bool,
    /// Weigh views by the scenes' true visibility instead of the network's (vis-var, an experiment).
    #[arg(long)]
    pub true_visibility: bool,
}

/// What is written when.
#[derive(Debug, Args)]
#[command(next_help_heading = "Watching")]
pub struct WatchingFlags {
    /// Steps between measurements.
    #[arg(long, value_name = "N", default_value_t = 1000)]
    pub validate_every: usize,
    /// Reference views that are measured.
    #[arg(long, value_name = "N", default_value_t = 16)]
    pub validation_views: usize,
    /// Minutes between checkpoints.
    #[arg(long, value_name = "N", default_value_t = 5.0)]
    pub checkpoint_minutes: f64,
}

/// Values for all that is not given.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum TrainPreset {
    /// Small cut-outs, many steps.
    Compact,
    /// The paper's training: two flow iterations (s = 0.75 and 0.375), no augmentation. Not as in the paper: samples of
    /// a batch come one after the other, so that batch normalisation sees one at a time; photographs larger than the
    /// cut-outs are cut; planes span each view's own depth range.
    Paper,
}
