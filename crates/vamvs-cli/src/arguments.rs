//! What the command line understands. Flags that are not given leave the configuration as it is.

#[cfg(feature = "net")]
mod calibrate;
mod eval;
mod fusion;
mod input;
mod refine;
mod synth;
#[cfg(feature = "net")]
mod train;

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand};
use vamvs::MemoryLimit;
use vamvs::export::{DepthFormat, Program};
#[cfg(feature = "net")]
use vamvs::{Quality, core::Spacing};

#[cfg(feature = "net")]
pub use calibrate::CalibrateArguments;
#[cfg(feature = "net")]
pub use eval::EvalNetworkArguments;
pub use eval::{
    CloudPreset, DepthThresholdFlags, DtuFlags, EvalArguments, EvalCloudArguments, EvalCommand,
    EvalDepthArguments, EvalGeneralFlags, EvalSceneArguments, TntFlags,
};
pub use fusion::{FusionFlags, Preset};
pub use input::InputFlags;
pub use refine::RefineArguments;
pub use synth::{AssetFlags, SynthArguments};
#[cfg(feature = "net")]
pub use train::{SampleFlags, TrainArguments, TrainPreset, TrainingFlags};

/// Photographs with known cameras in, depth maps and one dense, coloured cloud out.
#[derive(Debug, Parser)]
#[command(name = "vamvs", version, arg_required_else_help = true, max_term_width = 100)]
pub struct Arguments {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Photographs and cameras → depth maps → one cloud.
    #[cfg(feature = "net")]
    #[command(after_help = RECONSTRUCT_EXAMPLES)]
    Reconstruct(ReconstructArguments),
    /// Photographs and cameras → depth maps only.
    #[cfg(feature = "net")]
    #[command(after_help = "Example:\n  vamvs depth --colmap sparse/0 --images images --out out")]
    Depth(DepthArguments),
    /// Depth maps → depth maps of the photographs' full size, with normals.
    #[command(after_help = refine::EXAMPLES)]
    Refine(RefineArguments),
    /// Depth maps → one cloud: filter and merge.
    #[command(after_help = FUSE_EXAMPLES)]
    Fuse(FuseArguments),
    /// A run on one page: depth maps, cameras, cloud, and what became of the pixels.
    #[command(
        after_help = "Example:\n  vamvs report out        writes out/report.html, for any browser, offline too"
    )]
    Report(ReportArguments),
    /// Scenes with exact depth and visibility, to train and test with.
    #[command(after_help = synth::EXAMPLES)]
    Synth(SynthArguments),
    /// Weights of a network from scenes with true depth.
    #[cfg(feature = "net")]
    #[command(after_help = train::EXAMPLES)]
    Train(TrainArguments),
    /// A network whose confidence is the share of depths that are right.
    #[cfg(feature = "net")]
    #[command(after_help = calibrate::EXAMPLES)]
    Calibrate(CalibrateArguments),
    /// Results against ground truth: depth maps, clouds, whole scenes.
    #[command(after_help = eval::EXAMPLES)]
    Eval(EvalArguments),
    /// What a file or folder is: weights, cloud, depth map, COLMAP model; or `device`.
    #[command(
        after_help = "Examples:\n  vamvs info weights/photometric.pt\n  vamvs info out/fused.ply\n  vamvs info sparse/0\n  vamvs info device"
    )]
    Info(InfoArguments),
    /// Completions for a shell, on standard output.
    #[command(
        after_help = "Example:\n  vamvs completions bash > ~/.local/share/bash-completion/completions/vamvs"
    )]
    Completions(CompletionsArguments),
    /// The manual, as pages for `man`.
    #[command(after_help = "Examples:\n  vamvs man | man -l -\n  vamvs man ~/.local/share/man/man1")]
    Man(ManArguments),
}

impl Command {
    /// What to do after the command was interrupted.
    pub fn resumption(&self) -> &'static str {
        match self {
            #[cfg(feature = "net")]
            Self::Reconstruct(_) | Self::Depth(_) | Self::Train(_) => GOES_ON,
            Self::Synth(_) | Self::Refine(_) => GOES_ON,
            _ => "stopped; no file is half-written, the same command again starts anew",
        }
    }
}

/// Of commands that keep what is done.
const GOES_ON: &str = "stopped; what is finished is kept, the same command again goes on from there";

#[cfg(feature = "net")]
const RECONSTRUCT_EXAMPLES: &str = "\
Examples:
  vamvs reconstruct --cams cams --images images --out out        MVSNet layout
  vamvs reconstruct --colmap sparse/0 --images images --out out  COLMAP model, distorted or not
  vamvs reconstruct --colmap sparse/0 --images images --quality draft  a quick look
  vamvs reconstruct --nerfstudio capture --export colmap         transforms.json; workspace for COLMAP too
  vamvs reconstruct --config out/run.toml --min-views 2          the same again, fused otherwise

Depth maps that are in --out already, made of the same photographs, cameras and settings, are kept,
so a run that was interrupted goes on where it was.";

const FUSE_EXAMPLES: &str = "\
Examples:
  vamvs fuse out/depths
  vamvs fuse out --min-views 4 --max-relative-depth 0.005 --out strict.ply
  vamvs fuse dense --out fused.ply                     depth maps of COLMAP's patch_match_stereo
  vamvs fuse out --export colmap,openmvs --depth-format exr";

/// `reconstruct`.
#[cfg(feature = "net")]
#[derive(Debug, Args)]
pub struct ReconstructArguments {
    /// Depth estimation.
    #[command(flatten)]
    pub depth: DepthArguments,
    /// Fusion.
    #[command(flatten)]
    pub fusion: FusionFlags,
    /// What other programs get.
    #[command(flatten)]
    pub export: ExportFlags,
    /// Write no OUT/report.html.
    #[arg(long)]
    pub no_report: bool,
}

/// `depth`.
#[cfg(feature = "net")]
#[derive(Debug, Args)]
pub struct DepthArguments {
    /// Where the scene is.
    #[command(flatten)]
    pub input: InputFlags,
    /// How depth is estimated.
    #[command(flatten)]
    pub depth: DepthFlags,
    /// What every command has.
    #[command(flatten)]
    pub common: CommonFlags,
    /// Folder for depth maps, cloud and settings [default: that of the --config run.toml, else vamvs-out].
    #[arg(short, long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Make depth maps anew even if they are there already.
    #[arg(long)]
    pub force: bool,
}

#[cfg(feature = "net")]
impl DepthArguments {
    /// The output folder.
    pub fn out(&self) -> PathBuf {
        let settings = self.common.config.as_deref().filter(|file| file.ends_with("run.toml"));
        let of_settings = || Some(settings?.parent()?.to_owned());
        self.out.clone().or_else(of_settings).unwrap_or_else(|| PathBuf::from("vamvs-out"))
    }
}

/// `fuse`.
#[derive(Debug, Args)]
pub struct FuseArguments {
    /// Folder of depth maps: OUT or OUT/depths of `vamvs depth`; COLMAP's dense workspace, with stereo/ and
    /// sparse/; or depth_est/ of a network like MVSNet, with cams/ and images/ beside it.
    #[arg(value_name = "DEPTHS")]
    pub depths: PathBuf,
    /// The cloud to write [default: OUT/fused.ply; vamvs.ply in the folder of another program].
    #[arg(short, long, value_name = "FILE.ply")]
    pub out: Option<PathBuf>,
    /// Folder of masks of the images in OUT/images: NAME.png, 0 = ignore.
    #[arg(long, value_name = "DIR")]
    pub masks: Option<PathBuf>,
    /// Points only in this box of the world.
    #[arg(long, num_args = 6, value_names = ["XMIN", "YMIN", "ZMIN", "XMAX", "YMAX", "ZMAX"], allow_negative_numbers = true)]
    pub roi: Option<Vec<f64>>,
    /// How depth maps are filtered.
    #[command(flatten)]
    pub fusion: FusionFlags,
    /// What other programs get.
    #[command(flatten)]
    pub export: ExportFlags,
    /// Write no report.html beside the depth maps; there is none for a cloud elsewhere anyway.
    #[arg(long)]
    pub no_report: bool,
    /// What every command has.
    #[command(flatten)]
    pub common: CommonFlags,
}

/// `report`.
#[derive(Debug, Args)]
pub struct ReportArguments {
    /// Folder of depth maps, as for `vamvs fuse`.
    #[arg(value_name = "OUT")]
    pub out: PathBuf,
    /// Print nothing but errors and warnings.
    #[arg(short, long)]
    pub quiet: bool,
}

/// `completions`.
#[derive(Debug, Args)]
pub struct CompletionsArguments {
    /// The shell.
    #[arg(value_enum, value_name = "SHELL")]
    pub shell: clap_complete::Shell,
}

/// `man`.
#[derive(Debug, Args)]
pub struct ManArguments {
    /// Folder for a page for each command [default: that of `vamvs` itself, on standard output].
    #[arg(value_name = "DIR")]
    pub folder: Option<PathBuf>,
}

/// `info`.
#[derive(Debug, Args)]
pub struct InfoArguments {
    /// A .pt, .ply, .pfm file, a COLMAP model folder, or the word `device`.
    #[arg(value_name = "FILE|device")]
    pub what: PathBuf,
    /// Print JSON.
    #[arg(long)]
    pub json: bool,
}

/// How depth is estimated.
#[cfg(feature = "net")]
#[derive(Debug, Args)]
#[command(next_help_heading = "Depth")]
pub struct DepthFlags {
    /// The network: vis-max (trained), vis-corr (light, still in training) or photometric (handcrafted), which are built
    /// in, or a TorchScript module [default: vis-max].
    #[arg(long, value_name = "NAME|FILE.pt")]
    pub weights: Option<PathBuf>,
    /// auto, cpu, cuda or cuda:N [default: auto].
    #[arg(long, value_name = "DEVICE")]
    pub device: Option<String>,
    /// What a run takes and gives; other flags change parts of it [default: normal].
    #[arg(long, value_enum, conflicts_with = "preview")]
    pub quality: Option<Quality>,
    /// What --quality draft was called.
    #[arg(long, hide = true)]
    pub preview: bool,
    /// Longer side to which larger photographs are reduced, pixels: the size of depth maps [default: 2000].
    #[arg(long, value_name = "PIXELS")]
    pub max_size: Option<usize>,
    /// Longer side to which the network sees larger photographs reduced, pixels [default: 800].
    #[arg(long, value_name = "PIXELS")]
    pub network_size: Option<usize>,
    /// Depth maps as the network gives them, a fraction of their photographs' size, without normals.
    #[arg(long)]
    pub no_refine: bool,
    /// Depth maps refined by the photographs alone, not once more with the depth maps of the source views.
    #[arg(long)]
    pub no_geometric: bool,
    /// Smaller photographs are enlarged up to so many times, but not beyond --max-size, and depth maps with them; 2
    /// takes four times the time [default: 1].
    #[arg(long, value_name = "TIMES")]
    pub enlarge: Option<f64>,
    /// Pixels with red, green and blue all below LEVEL, of 255, count as masked: a black backdrop [default: 0, none].
    #[arg(long, value_name = "LEVEL")]
    pub min_brightness: Option<u8>,
    /// Pixels with red, green and blue all above LEVEL, of 255, count as masked: a white backdrop, but highlights too
    /// [default: 255, none].
    #[arg(long, value_name = "LEVEL")]
    pub max_brightness: Option<u8>,
    /// Stride of the coarse depth map: 8 pixels of the photograph, or 4, which keeps thin structures and edges but
    /// takes three times as long [default: the network's, 4 for vis-max, 8 for photometric].
    #[arg(long, alias = "cells", value_name = "PIXELS")]
    pub coarse_stride: Option<usize>,
    /// Views compared for a depth map, the reference included; beyond five only those that share at least 0.3
    /// as much with it as the best one [default: 5].
    #[arg(long, value_name = "N")]
    pub views: Option<usize>,
    /// Depth planes of the sweep [default: from the cameras, about one every 4 pixels].
    #[arg(long, value_name = "N")]
    pub planes: Option<usize>,
    /// Most planes chosen by default [default: 192].
    #[arg(long, value_name = "N")]
    pub max_planes: Option<usize>,
    /// What is uniform between planes [default: inverse-depth if the range is wide, else depth].
    #[arg(long, value_enum)]
    pub spacing: Option<Spacing>,
    /// Depth range of all views, scene units [default: each view's own].
    #[arg(long, num_args = 2, value_names = ["NEAR", "FAR"])]
    pub depth_range: Option<Vec<f64>>,
    /// How many of the network's flow iterations to run, the later the finer [default: all].
    #[arg(long, value_name = "N")]
    pub iterations: Option<usize>,
    /// Depth only in this box of the world.
    #[arg(long, num_args = 6, value_names = ["XMIN", "YMIN", "ZMIN", "XMAX", "YMAX", "ZMAX"], allow_negative_numbers = true)]
    pub roi: Option<Vec<f64>>,
    /// Depth outside of the box of --roi too, but coarsely, and finely only in it: one cloud of several
    /// densities, in less time. Coarser maps are called NAME@8 (with a coarse stride of 8) and NAME@4.
    #[arg(long)]
    pub fovea: bool,
}

/// What other programs get, beside the cloud.
#[derive(Debug, Args)]
#[command(next_help_heading = "Export")]
pub struct ExportFlags {
    /// For these programs, each in a folder of its name: colmap (dense workspace for stereo_fusion,
    /// poisson_mesher, delaunay_mesher), openmvs (scene.mvs, .dmap, scene_dense.ply).
    #[arg(long, value_enum, value_name = "PROGRAM", value_delimiter = ',')]
    pub export: Option<Vec<Program>>,
    /// Depth maps in these formats too, in depths/.
    #[arg(long, value_enum, value_name = "FORMAT", value_delimiter = ',')]
    pub depth_format: Option<Vec<DepthFormat>>,
    /// Depth of one step of a 16-bit PNG, scene units [default: a round number, told in png-step.txt].
    #[arg(long, value_name = "DEPTH")]
    pub png_step: Option<f64>,
}

/// What every command has.
#[derive(Debug, Args)]
#[command(next_help_heading = "General")]
pub struct CommonFlags {
    /// Settings from a TOML file, such as OUT/run.toml; flags win.
    #[arg(long, value_name = "FILE.toml")]
    pub config: Option<PathBuf>,
    /// Threads [default: one a core].
    #[arg(long, value_name = "N")]
    pub threads: Option<usize>,
    /// The most memory to take, such as 2GiB, 500MB or 50% of the machine's [default: 70%]. Results do not depend
    /// on it, unless a depth map would take more: then photographs are reduced, with a warning.
    #[arg(long, value_name = "SIZE")]
    pub max_memory: Option<MemoryLimit>,
    /// Call it an error, with exit code 1, if a view is left out.
    #[arg(long)]
    pub strict: bool,
    /// Print nothing but errors and warnings.
    #[arg(short, long)]
    pub quiet: bool,
    /// Print more: what was chosen for each view (source views, depth range, planes), and all times.
    #[arg(short, long, conflicts_with = "quiet")]
    pub verbose: bool,
    /// Print a summary as JSON on standard output.
    #[arg(long)]
    pub json: bool,
}
