//! The flags that say where the scene is.

use std::path::PathBuf;

use clap::Args;
use vamvs::io::mvsnet::{DepthLine, PixelCentre};

/// Where the scene is.
#[derive(Debug, Args)]
#[command(next_help_heading = "Input")]
pub struct InputFlags {
    /// MVSNet layout: folder of NAME_cam.txt files.
    #[arg(long, value_name = "DIR", group = "scene")]
    pub cams: Option<PathBuf>,
    /// COLMAP model: folder with cameras, images and points3D, .txt or .bin, or a workspace with one model in
    /// sparse or sparse/0.
    #[arg(long, value_name = "DIR", group = "scene")]
    pub colmap: Option<PathBuf>,
    /// nerfstudio or instant-ngp: transforms.json, or its folder.
    #[arg(long, value_name = "FILE", group = "scene")]
    pub nerfstudio: Option<PathBuf>,
    /// Bundler: bundle.out, with list.txt in its folder or the one above.
    #[arg(long, value_name = "FILE", group = "scene")]
    pub bundler: Option<PathBuf>,
    /// VisualSFM: an .nvm file.
    #[arg(long, value_name = "FILE", group = "scene")]
    pub nvm: Option<PathBuf>,
    /// OpenMVS: an interface file .mvs of undistorted images.
    #[arg(long, value_name = "FILE", group = "scene")]
    pub openmvs: Option<PathBuf>,
    /// Folder of photographs [default: as the scene's file says; COLMAP: images/ of the workspace;
    /// required with --cams].
    #[arg(long, value_name = "DIR")]
    pub images: Option<PathBuf>,
    /// MVSNet layout: source views [default: pair.txt in or next to --cams; else chosen from the cameras].
    #[arg(long, value_name = "FILE")]
    pub pairs: Option<PathBuf>,
    /// Folder of masks: NAME.png or NAME.EXT.png, 0 = ignore [default: those that the scene's file names,
    /// else masks/ next to the photographs].
    #[arg(long, value_name = "DIR")]
    pub masks: Option<PathBuf>,
    /// Use no masks but the photographs' own alpha channels.
    #[arg(long, conflicts_with = "masks")]
    pub no_masks: bool,
    /// MVSNet layout: meaning of the first two numbers of the depth line [default: auto].
    #[arg(long, value_enum)]
    pub depth_line: Option<DepthLine>,
    /// MVSNet layout: convention of pixel centres [default: half].
    #[arg(long, value_enum)]
    pub pixel_centre: Option<PixelCentre>,
}
