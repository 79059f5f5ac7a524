//! Arguments of the command line. Flags that are not given leave the configuration as it is.

#[cfg(feature = "torch")]
mod calibrate;
mod eval;
mod fusion;
mod input;
mod mesh;
mod refine;
#[cfg(feature = "synth")]
mod synth;
mod tasks;
#[cfg(feature = "torch")]
mod train;

use std::path::PathBuf;

use clap::{ArgAction, Args, Parser, Subcommand};
use vamvs::MemoryLimit;
use vamvs::export::{DepthFormat, ExportTarget};
use vamvs::output::folder_of;
use vamvs::{Quality, core::Spacing};

#[cfg(feature = "torch")]
pub use calibrate::CalibrateArguments;
#[cfg(feature = "torch")]
pub use eval::EvalNetworkArguments;
pub use eval::{
    CloudPreset, DepthThresholdFlags, DtuFlags, EvalArguments, EvalCloudArguments, EvalCommand,
    EvalDepthArguments, EvalGeneralFlags, EvalSceneArguments, TntFlags,
};
pub use fusion::{FusionFlags, Preset};
pub use input::InputFlags;
pub use mesh::{MeshArguments, MeshFlags};
pub use refine::RefineArguments;
#[cfg(feature = "synth")]
pub use synth::{AssetFlags, SynthArguments};
pub use tasks::{DepthCommand, DepthStepFlags, DepthTask, TasksArguments};
pub use tasks::{FusionStepFlags, FusionTask, MeshStepFlags, MeshTask};
#[cfg(feature = "torch")]
pub use train::{SampleFlags, TrainArguments, TrainPreset, TrainingFlags};

/// Dense multi-view stereo: photographs with known cameras to depth maps and one coloured point cloud.
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
    /// Make depth maps and one cloud from photographs and cameras.
    #[command(after_help = RECONSTRUCT_EXAMPLES)]
    Reconstruct(ReconstructArguments),
    /// Make depth maps from photographs and cameras.
    #[command(after_help = "Example:\n  vamvs depth --colmap sparse/0 --images images --out out")]
    Depth(DepthCommand),
    /// Write a reconstruction as tasks for many machines: one JSON object a line, each a `vamvs` command.
    #[command(after_help = tasks::EXAMPLES)]
    Tasks(TasksArguments),
    /// Refine depth maps to the full resolution of their photographs, with normals.
    #[command(after_help = refine::EXAMPLES)]
    Refine(RefineArguments),
    /// Fuse depth maps into one cloud.
    #[command(after_help = FUSE_EXAMPLES)]
    Fuse(FuseArguments),
    /// Make a triangle mesh of depth maps.
    #[command(after_help = mesh::EXAMPLES)]
    Mesh(MeshArguments),
    /// Write a report of a run: depth maps, cameras, cloud, and the pixels that each filter removed.
    #[command(
        after_help = "Example:\n  vamvs report out        writes out/report.html, for any browser, offline too"
    )]
    Report(ReportArguments),
    /// Render synthetic scenes with exact depth and visibility.
    #[cfg(feature = "synth")]
    #[command(after_help = synth::EXAMPLES)]
    Synth(SynthArguments),
    /// As above, in a build with the feature `synth`.
    #[cfg(not(feature = "synth"))]
    #[command(hide = true)]
    Synth(Absent),
    /// Make training scenes of reconstructions: depths that several views verify are pseudo ground truth.
    #[command(after_help = PSEUDO_EXAMPLES)]
    Pseudo(PseudoArguments),
    /// Train a network on scenes with ground truth.
    #[cfg(feature = "torch")]
    #[command(after_help = train::EXAMPLES)]
    Train(TrainArguments),
    /// As above, in a build with libtorch.
    #[cfg(not(feature = "torch"))]
    #[command(hide = true)]
    Train(Absent),
    /// Calibrate the confidence of a network: make it the share of depths that are right.
    #[cfg(feature = "torch")]
    #[command(after_help = calibrate::EXAMPLES)]
    Calibrate(CalibrateArguments),
    /// As above, in a build with libtorch.
    #[cfg(not(feature = "torch"))]
    #[command(hide = true)]
    Calibrate(Absent),
    /// Compare depth maps, clouds or whole scenes with ground truth.
    #[command(after_help = eval::EXAMPLES)]
    Eval(EvalArguments),
    /// Describe a file or folder: weights, cloud, depth map, COLMAP model; or the `device`.
    #[command(
        after_help = "Examples:\n  vamvs info weights/photometric.pt\n  vamvs info out/fused.ply\n  vamvs info sparse/0\n  vamvs info out\n  vamvs info device"
    )]
    Info(InfoArguments),
    /// Print completions for a shell.
    #[command(
        after_help = "Example:\n  vamvs completions bash > ~/.local/share/bash-completion/completions/vamvs"
    )]
    Completions(CompletionsArguments),
    /// Print the manual, or write it as pages for `man`.
    #[command(after_help = "Examples:\n  vamvs man | man -l -\n  vamvs man ~/.local/share/man/man1")]
    Man(ManArguments),
}

/// Arguments of `vamvs pseudo`.
#[derive(Debug, Args)]
pub struct PseudoArguments {
    /// Output folders of `vamvs reconstruct`, best with `--quality best --views 9`, or other folders that `vamvs fuse` takes.
    #[arg(value_name = "OUT", required = true)]
    pub runs: Vec<PathBuf>,
    /// Folder for the set: a scene for each reconstruction, called like it.
    #[arg(long, value_name = "SET")]
    pub out: PathBuf,
    /// Configuration, filters excepted.
    #[command(flatten)]
    pub common: CommonFlags,
}

const PSEUDO_EXAMPLES: &str = "Example:
  vamvs reconstruct --colmap sparse/0 --images images --quality best --views 9 --out garden
  vamvs pseudo garden house --out real
  vamvs train --data set real --validation hold-out --network start.pt --out run";

impl Command {
    /// What to do after the command was interrupted.
    pub fn resumption(&self) -> &'static str {
        match self {
            #[cfg(feature = "torch")]
            Self::Train(_) => GOES_ON,
            Self::Reconstruct(arguments) if arguments.depth.force => GOES_ON_WITHOUT_FORCE,
            Self::Depth(DepthCommand { depth, .. }) if depth.force => GOES_ON_WITHOUT_FORCE,
            Self::Refine(arguments) if arguments.force => GOES_ON_WITHOUT_FORCE,
            #[cfg(feature = "synth")]
            Self::Synth(_) => GOES_ON,
            Self::Reconstruct(_) | Self::Depth(_) | Self::Refine(_) => GOES_ON,
            _ => "stopped; no file is half-written, the same command again starts anew",
        }
    }
}

/// The arguments, unread, of a command that this build is without.
#[cfg(not(all(feature = "synth", feature = "torch")))]
#[derive(Debug, Args)]
#[command(disable_help_flag = true)]
pub struct Absent {
    /// Any.
    #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
    arguments: Vec<std::ffi::OsString>,
}

/// For commands that keep finished work.
const GOES_ON: &str = "stopped; what is finished is kept, the same command again goes on from there";

/// For those that were asked to make everything anew.
const GOES_ON_WITHOUT_FORCE: &str =
    "stopped; what is finished is kept, the same command without --force goes on from there";

const RECONSTRUCT_EXAMPLES: &str = "\
Examples:
  vamvs reconstruct --cams cams --images images --out out        MVSNet layout
  vamvs reconstruct --colmap sparse/0 --images images --out out  COLMAP model, distorted or not
  vamvs reconstruct --colmap sparse/0 --images images --quality draft  a quick look
  vamvs reconstruct --nerfstudio capture --export colmap         transforms.json; workspace for COLMAP too
  vamvs reconstruct --config out/run.toml --min-views 3          the same again, fused otherwise

Depth maps that are in --out already, made of the same photographs, cameras and settings, are kept,
so a run that was interrupted goes on where it was.";

const FUSE_EXAMPLES: &str = "\
Examples:
  vamvs fuse out/depths
  vamvs fuse out --min-views 4 --max-relative-depth 0.005 --out strict.ply
  vamvs fuse dense --out fused.ply                     depth maps of COLMAP's patch_match_stereo
  vamvs fuse out --export colmap,openmvs --depth-format exr";

/// `reconstruct`.
#[derive(Debug, Args)]
pub struct ReconstructArguments {
    /// Depth estimation.
    #[command(flatten)]
    pub depth: DepthArguments,
    /// Fusion.
    #[command(flatten)]
    pub fusion: FusionFlags,
    /// Also make a triangle mesh, OUT/mesh.ply, as `vamvs mesh` does.
    #[arg(long)]
    pub mesh: bool,
    /// Exports for other programs.
    #[command(flatten)]
    pub export: ExportFlags,
    /// Write no OUT/report.html.
    #[arg(long)]
    pub no_report: bool,
}

/// `depth`.
#[derive(Debug, Args)]
pub struct DepthArguments {
    /// Where the scene is.
    #[command(flatten)]
    pub input: InputFlags,
    /// How depth is estimated.
    #[command(flatten)]
    pub depth: DepthFlags,
    /// Flags of every command.
    #[command(flatten)]
    pub common: CommonFlags,
    /// Folder for depth maps, cloud and settings [default: that of the --config run.toml, else vamvs-out].
    #[arg(short, long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Make depth maps again even if they exist already.
    #[arg(long)]
    pub force: bool,
}

impl DepthArguments {
    /// The output folder.
    pub fn out(&self) -> PathBuf {
        let settings = self.common.config.as_deref().filter(|file| file.ends_with("run.toml"));
        let of_settings = || Some(folder_of(settings?).to_owned());
        self.out.clone().or_else(of_settings).unwrap_or_else(|| PathBuf::from("vamvs-out"))
    }
}

/// `fuse`.
#[derive(Debug, Args)]
pub struct FuseArguments {
    /// Folder of depth maps: OUT or OUT/depths of `vamvs depth`; COLMAP's dense workspace, with stereo/ and
    /// sparse/; or that of another program, depth_est/, depths/, depth/ or flat, with cams/ and images/ beside it or
    /// the scene given.
    #[arg(value_name = "DEPTHS")]
    pub depths: PathBuf,
    /// The cameras and photographs of depth maps that have none beside them.
    #[command(flatten)]
    pub input: InputFlags,
    /// The cloud to write [default: OUT/fused.ply; vamvs.ply in the folder of another program].
    #[arg(short, long, value_name = "FILE.ply")]
    pub out: Option<PathBuf>,
    /// Points only in this box of the world.
    #[arg(long, action = ArgAction::Set, num_args = 6, value_names = ["XMIN", "YMIN", "ZMIN", "XMAX", "YMAX", "ZMAX"], allow_hyphen_values = true)]
    pub roi: Option<Vec<f64>>,
    /// How depth maps are filtered.
    #[command(flatten)]
    pub fusion: FusionFlags,
    /// Exports for other programs.
    #[command(flatten)]
    pub export: ExportFlags,
    /// One step of a fusion that is spread over processes.
    #[command(flatten)]
    pub step: FusionStepFlags,
    /// Write no report.html next to the depth maps. (A cloud in another folder gets none.)
    #[arg(long)]
    pub no_report: bool,
    /// Flags of every command.
    #[command(flatten)]
    pub common: CommonFlags,
}

/// `report`.
#[derive(Debug, Args)]
pub struct ReportArguments {
    /// Folder of depth maps, as for `vamvs fuse`.
    #[arg(value_name = "OUT")]
    pub out: PathBuf,
    /// Print nothing but results, errors and warnings.
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
    /// A .pt, .safetensors, .ply, .pfm or image file; a folder of depth maps, of a COLMAP model or of cams/ and images/;
    /// transforms.json, an .nvm, .mvs or bundle.out file; or the word `device`.
    #[arg(value_name = "FILE|DIR|device")]
    pub what: PathBuf,
    /// Print JSON.
    #[arg(long)]
    pub json: bool,
}

/// How depth is estimated.
#[derive(Debug, Args)]
#[command(next_help_heading = "Depth")]
pub struct DepthFlags {
    #[cfg_attr(
        feature = "torch",
        doc = "The network: vis-corr (light), vis-max (the paper's aggregation, for six times the time) or photometric"
    )]
    #[cfg_attr(
        feature = "torch",
        doc = "(handcrafted), which are built in, a TorchScript module, weights of vis-corr in a .safetensors file, or none: a plane sweep"
    )]
    #[cfg_attr(feature = "torch", doc = "with semi-global matching [default: vis-corr].")]
    #[cfg_attr(
        not(feature = "torch"),
        doc = "The network: vis-corr, which is built in, a .safetensors file with its weights, or none: a plane sweep with semi-global"
    )]
    #[cfg_attr(not(feature = "torch"), doc = "matching [default: vis-corr].")]
    #[arg(long, value_name = "NAME|FILE")]
    pub weights: Option<PathBuf>,
    /// Trade-off between time and quality; other flags override parts of it [default: normal].
    #[arg(long, value_enum, conflicts_with = "preview")]
    pub quality: Option<Quality>,
    /// The former name of --quality draft.
    #[arg(long, hide = true)]
    pub preview: bool,
    /// Larger photographs are reduced to this longer side, pixels; depth maps have the same size [default: 2000].
    #[arg(long, value_name = "PIXELS")]
    pub max_size: Option<usize>,
    /// The network, or the plane sweep without one, sees larger photographs reduced to this longer side, pixels. vis-corr
    /// sees smaller ones enlarged to it, at most twice [default: 1536].
    #[arg(long, value_name = "PIXELS")]
    pub network_size: Option<usize>,
    /// Write the depth maps that refinement would start from, smaller than their photographs and without normals.
    #[arg(long)]
    pub no_refine: bool,
    /// Refine depth maps with the photographs alone, without the geometric pass, which uses the source views' depth maps.
    #[arg(long)]
    pub no_geometric: bool,
    /// Enlarge smaller photographs, and their depth maps, by up to this factor, but not beyond --max-size; 2 takes four
    /// times as long [default: 1].
    #[arg(long, value_name = "TIMES")]
    pub enlarge: Option<f64>,
    /// Mask out pixels with red, green and blue all below LEVEL (of 255): a black backdrop [default: 0, none].
    #[arg(long, value_name = "LEVEL")]
    pub min_brightness: Option<u8>,
    /// Mask out pixels with red, green and blue all above LEVEL (of 255): a white backdrop, but highlights too
    /// [default: 255, none].
    #[arg(long, value_name = "LEVEL")]
    pub max_brightness: Option<u8>,
    /// Photographs of 16 bits: the values that become 0 and 255, or none: their upper 8 bits [default: those between which nearly all
    /// values of all photographs lie, if they are close together].
    #[arg(long, num_args = 1..=2, value_names = ["LOW", "HIGH"], action = ArgAction::Set)]
    pub stretch: Option<Vec<String>>,
    /// Number of views for a depth map, the reference view included; fewer where no more of them show the same surfaces
    /// [default: 5].
    #[arg(long, value_name = "N")]
    pub views: Option<usize>,
    /// Number of planes of the plane sweep [default: from the cameras, about one every 4 pixels of disparity].
    #[arg(long, value_name = "N")]
    pub planes: Option<usize>,
    /// Upper limit of the number of planes chosen from the cameras [default: 192].
    #[arg(long, value_name = "N")]
    pub max_planes: Option<usize>,
    /// Spacing of the planes [default: inverse-depth if the depth range is wide, else depth].
    #[arg(long, value_enum)]
    pub spacing: Option<Spacing>,
    /// Depth range of all views, scene units [default: each view's own].
    #[arg(long, action = ArgAction::Set, num_args = 2, value_names = ["NEAR", "FAR"], allow_hyphen_values = true)]
    pub depth_range: Option<Vec<f64>>,
    /// Region of interest: depth only inside of this box in world coordinates.
    #[arg(long, action = ArgAction::Set, num_args = 6, value_names = ["XMIN", "YMIN", "ZMIN", "XMAX", "YMAX", "ZMAX"], allow_hyphen_values = true)]
    pub roi: Option<Vec<f64>>,
    /// Also write how likely each source view sees each pixel, as the network predicts it: visibility/NAME.png, a tile
    /// for each source view. Networks that weigh views have it, such as vis-corr.
    #[arg(long)]
    pub visibility: bool,
    /// Where the network runs.
    #[cfg(any(feature = "torch", feature = "gpu"))]
    #[command(flatten)]
    pub device: DeviceFlags,
    /// What only libtorch has.
    #[cfg(feature = "torch")]
    #[command(flatten)]
    pub network: NetworkFlags,
}

/// Where the network runs.
#[cfg(any(feature = "torch", feature = "gpu"))]
#[derive(Debug, Args)]
#[command(next_help_heading = "Network")]
pub struct DeviceFlags {
    #[cfg_attr(
        all(feature = "torch", feature = "gpu"),
        doc = "auto, cpu, gpu, gpu:N, cuda or cuda:N: gpu is one of any vendor, for vis-corr; auto is such a one, if there is one, else cuda, else cpu [default: cuda, if there is one, else cpu]."
    )]
    #[cfg_attr(
        all(feature = "torch", not(feature = "gpu")),
        doc = "auto, cpu, cuda or cuda:N [default: auto]."
    )]
    #[cfg_attr(
        all(feature = "gpu", not(feature = "torch")),
        doc = "cpu, gpu or gpu:N, a GPU of any vendor; `vamvs info device` lists them; auto is such a GPU, if there is one [default: cpu]."
    )]
    #[arg(long, value_name = "DEVICE")]
    pub device: Option<String>,
}

/// What only libtorch has.
#[cfg(feature = "torch")]
#[derive(Debug, Args)]
#[command(next_help_heading = "Network")]
pub struct NetworkFlags {
    /// Stride of the coarse depth map: 8 pixels of the photograph, or 4, which keeps thin structures and edges but
    /// takes three times as long [default: the network's, 4 for vis-corr and vis-max, 8 for photometric].
    #[arg(long, alias = "cells", value_name = "PIXELS")]
    pub coarse_stride: Option<usize>,
    /// Number of flow iterations; later ones are finer [default: all that the network has].
    #[arg(long, value_name = "N")]
    pub iterations: Option<usize>,
    /// Foveated depth: fine inside of --roi, coarse outside; one cloud of several densities, in less time. Coarser
    /// maps are called NAME@8 (at a stride of 8) and NAME@4.
    #[arg(long)]
    pub fovea: bool,
}

/// Exports for other programs.
#[derive(Debug, Args)]
#[command(next_help_heading = "Export")]
pub struct ExportFlags {
    /// Export for these programs, each into a folder of its name: colmap (dense workspace for stereo_fusion,
    /// poisson_mesher, delaunay_mesher), openmvs (scene.mvs, .dmap, scene_dense.ply).
    #[arg(long, value_enum, value_name = "PROGRAM", value_delimiter = ',')]
    pub export: Option<Vec<ExportTarget>>,
    /// Also write depth maps in these formats, in depths/.
    #[arg(long, value_enum, value_name = "FORMAT", value_delimiter = ',')]
    pub depth_format: Option<Vec<DepthFormat>>,
    /// Depth of one grey level of a 16-bit PNG, scene units, of those that are written and, without png-step.txt beside
    /// them, of those that are read [default: written: a round number, told in png-step.txt].
    #[arg(long, value_name = "DEPTH")]
    pub png_step: Option<f64>,
}

/// Flags of every command.
#[derive(Debug, Args)]
#[command(next_help_heading = "General")]
pub struct CommonFlags {
    /// Read settings from a TOML file, such as OUT/run.toml; flags override them.
    #[arg(long, value_name = "FILE.toml")]
    pub config: Option<PathBuf>,
    /// Number of threads [default: one per core].
    #[arg(long, value_name = "N")]
    pub threads: Option<usize>,
    /// Limit of resident memory: 2GiB, 500MB, or 50% of what is available [default: 70%]. Results do not depend on it,
    /// unless a single depth map needs more: then photographs are reduced, with a warning.
    #[arg(long, value_name = "SIZE")]
    pub max_memory: Option<MemoryLimit>,
    /// Treat a view that is left out as an error (exit code 1).
    #[arg(long)]
    pub strict: bool,
    /// Print nothing but results, errors and warnings.
    #[arg(short, long)]
    pub quiet: bool,
    /// Print the source views, depth range and planes of each view, and all times.
    #[arg(short, long, conflicts_with = "quiet")]
    pub verbose: bool,
    /// Print a summary as JSON on standard output.
    #[arg(long)]
    pub json: bool,
}
