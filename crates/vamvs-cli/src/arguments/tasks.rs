//! The flags of reconstructions that are spread over many machines.

use std::num::NonZeroUsize;

use clap::{Args, ValueEnum};
use vamvs::core::Part;

use super::{DepthArguments, ReconstructArguments};

pub const EXAMPLES: &str = "\
Example:
  vamvs tasks --colmap sparse/0 --images images --out out --batch 16 > tasks.jsonl

Each line has id, argv, inputs, outputs, dependencies, cores, memory (bytes) and gpu. A task can run on any machine that
sees the photographs and --out at the same paths, once the tasks it depends on are done. A task that is done already does
nothing. The cloud is byte for byte that of `vamvs reconstruct`.";

/// `tasks`.
#[derive(Debug, Args)]
pub struct TasksArguments {
    /// What is reconstructed, and how.
    #[command(flatten)]
    pub reconstruct: ReconstructArguments,
    /// Number of views of a task.
    #[arg(long, value_name = "VIEWS", default_value = "16", help_heading = "Tasks")]
    pub batch: NonZeroUsize,
}

/// `depth`.
#[derive(Debug, Args)]
pub struct DepthCommand {
    /// Depth estimation.
    #[command(flatten)]
    pub depth: DepthArguments,
    /// One step of a run that is spread over processes.
    #[command(flatten)]
    pub step: DepthStepFlags,
}

/// One step of depth estimation.
#[derive(Debug, Args)]
#[command(next_help_heading = "Many machines")]
pub struct DepthStepFlags {
    /// Do only this step of a run that `vamvs tasks` spreads over processes.
    #[arg(long, value_enum, value_name = "STEP")]
    pub step: Option<DepthTask>,
    /// Part of the views, for --step photometric and geometric: 1/4 is the first of four.
    #[arg(long, value_name = "I/N", requires = "step", required_if_eq_any = [("step", "photometric"), ("step", "geometric")])]
    pub part: Option<Part>,
    /// Number of parts, for --step collect.
    #[arg(long, value_name = "N", requires = "step", required_if_eq("step", "collect"))]
    pub parts: Option<NonZeroUsize>,
}

/// A step of depth estimation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum DepthTask {
    /// The network, and the refinement by photographs alone, for a part of the views.
    Photometric,
    /// The refinement with the source views' depth maps, for a part of the views.
    Geometric,
    /// pair.txt and left-out.json, when all parts are done.
    Collect,
}

/// One step of a fusion.
#[derive(Debug, Args)]
#[command(next_help_heading = "Many machines")]
pub struct FusionStepFlags {
    /// Do only this step of a fusion that `vamvs tasks` spreads over processes.
    #[arg(long, value_enum, value_name = "STEP")]
    pub step: Option<FusionTask>,
    /// Part of the views, for --step confirm and merge: 1/4 is the first of four.
    #[arg(long, value_name = "I/N", requires = "step", required_if_eq_any = [("step", "confirm"), ("step", "merge")])]
    pub part: Option<Part>,
    /// Number of parts, for --step concatenate.
    #[arg(long, value_name = "N", requires = "step", required_if_eq("step", "concatenate"))]
    pub parts: Option<NonZeroUsize>,
}

/// A step of a fusion.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum FusionTask {
    /// The pixels that other views confirm, for a part of the views.
    Confirm,
    /// The points that they make, for a part of the views, when all parts are confirmed.
    Merge,
    /// The cloud, its exports and the report, when all parts are merged.
    Concatenate,
}

/// One step of a mesh.
#[derive(Debug, Args)]
#[command(next_help_heading = "Many machines")]
pub struct MeshStepFlags {
    /// Do only this step of a mesh that `vamvs tasks` spreads over processes.
    #[arg(long, value_enum, value_name = "STEP")]
    pub step: Option<MeshTask>,
    /// Part of the views or of the volume, for --step outline and surface: 1/4 is the first of four.
    #[arg(long, value_name = "I/N", requires = "step", required_if_eq_any = [("step", "outline"), ("step", "surface")])]
    pub part: Option<Part>,
    /// Number of parts, for --step join.
    #[arg(long, value_name = "N", requires = "step", required_if_eq("step", "join"))]
    pub parts: Option<NonZeroUsize>,
}

/// A step of a mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum MeshTask {
    /// What a part of the views sees, in short; all parts must be confirmed (`vamvs fuse --step confirm`).
    Outline,
    /// The surface in a part of the volume, when all parts have outlines.
    Surface,
    /// The mesh, when all parts have their surface.
    Join,
}
