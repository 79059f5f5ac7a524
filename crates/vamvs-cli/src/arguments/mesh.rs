//! Arguments of `vamvs mesh`.

use std::path::PathBuf;

use clap::{ArgAction, Args};

use super::tasks::MeshStepFlags;
use super::{CommonFlags, FusionFlags, InputFlags};

/// `mesh`.
#[derive(Debug, Args)]
pub struct MeshArguments {
    /// Folder of depth maps, as for `vamvs fuse`.
    #[arg(value_name = "DEPTHS")]
    pub depths: PathBuf,
    /// The cameras and photographs of depth maps that have none beside them.
    #[command(flatten)]
    pub input: InputFlags,
    /// The mesh to write: .ply, .obj or .glb [default: mesh.ply beside the depth maps].
    #[arg(short, long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Do not make the report again, which shows the mesh of a run.
    #[arg(long)]
    pub no_report: bool,
    /// How the mesh is made.
    #[command(flatten)]
    pub mesh: MeshFlags,
    /// The mesh only in this box of the world.
    #[arg(long, action = ArgAction::Set, num_args = 6, value_names = ["XMIN", "YMIN", "ZMIN", "XMAX", "YMAX", "ZMAX"], allow_hyphen_values = true)]
    pub roi: Option<Vec<f64>>,
    /// How depth maps are filtered.
    #[command(flatten)]
    pub fusion: FusionFlags,
    /// One step of a mesh that is spread over processes.
    #[command(flatten)]
    pub step: MeshStepFlags,
    /// Flags of every command.
    #[command(flatten)]
    pub common: CommonFlags,
}

/// How a mesh is made.
#[derive(Debug, Args)]
#[command(next_help_heading = "Mesh")]
pub struct MeshFlags {
    /// Width of the volume's cells, in sizes of the finest pixel that sees a place [default: 1.5].
    #[arg(long, value_name = "PIXELS")]
    pub cell: Option<f64>,
    /// Reduce the mesh to N triangles or, below 1, to this share of them; borders and colours are kept.
    #[arg(long, value_name = "N|SHARE")]
    pub triangles: Option<f64>,
    /// Close holes with at most N edges around, which are about as long as a cell is wide, unless a view sees through them
    /// [default: 30].
    #[arg(long, value_name = "N")]
    pub close_holes: Option<usize>,
    /// Leave out pieces of fewer triangles [default: 100].
    #[arg(long, value_name = "N")]
    pub min_triangles: Option<usize>,
}

pub(super) const EXAMPLES: &str = "\
Examples:
  vamvs mesh out                       of a run of vamvs: out/mesh.ply
  vamvs mesh out --out house.glb       for browsers, Blender, phones
  vamvs mesh workspace/dense           of COLMAP's depth maps";
