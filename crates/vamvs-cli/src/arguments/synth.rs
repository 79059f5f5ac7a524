//! The arguments of `vamvs synth`.

use std::path::PathBuf;

use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::{Args, ValueEnum};
use vamvs::core::Size;
use vamvs_synth::{Rig, Style};

/// The end of the command's help.
pub const EXAMPLES: &str = "\
Examples:
  vamvs synth --out set                                     four scenes of procedural things
  vamvs synth --out set --first 4 --scenes 96               the same set, continued
  vamvs synth --out set --styles clutter,room --rig mixed --meshes ycb --textures photos --environments hdri

A scene depends on its number, the seed, the options and the assets alone: a set can be made by
several machines. Complete scenes are kept, an interrupted one is made anew.";

/// `synth`.
#[derive(Debug, Args)]
pub struct SynthArguments {
    /// Folder of the set; a scene is OUT/scene-NNNNN.
    #[arg(short, long, value_name = "DIR")]
    pub out: PathBuf,
    /// Number of scenes.
    #[arg(long, value_name = "N", default_value_t = 4)]
    pub scenes: u64,
    /// Number of the first scene.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub first: u64,
    /// Seed of the random numbers.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub seed: u64,
    /// Styles of the scenes, in turn [default: all].
    #[arg(long, value_name = "STYLE,…", value_delimiter = ',', value_parser = styles())]
    pub styles: Vec<Style>,
    /// Replace scenes that were made with other options.
    #[arg(long)]
    pub force: bool,
    /// How photographs are taken.
    #[command(flatten)]
    pub photographs: PhotographFlags,
    /// What scenes are made of.
    #[command(flatten)]
    pub assets: AssetFlags,
    /// What commands have.
    #[command(flatten)]
    pub general: GeneralFlags,
}

/// How photographs are taken.
#[derive(Debug, Args)]
#[command(next_help_heading = "Photographs")]
pub struct PhotographFlags {
    /// Arrangement of the cameras; mixed draws one for each scene.
    #[arg(long, value_enum, default_value_t = RigChoice::Dome)]
    pub rig: RigChoice,
    /// Number of cameras of a scene.
    #[arg(long, value_name = "N", default_value_t = 9)]
    pub views: usize,
    /// Size of the photographs, pixels.
    #[arg(long, value_name = "WxH", default_value = "512x512", value_parser = parse_size)]
    pub size: Size,
    /// Light paths per pixel [default: 8].
    #[arg(long, value_name = "N")]
    pub samples: Option<usize>,
    /// Write normals too, in normals/NAME.pfm.
    #[arg(long)]
    pub normals: bool,
    /// Photographs without blur, noise, vignetting, and differences of exposure and white balance.
    #[arg(long)]
    pub no_effects: bool,
}

/// What scenes are made of.
#[derive(Debug, Args)]
#[command(next_help_heading = "Assets")]
pub struct AssetFlags {
    /// Folder of meshes in metres, .obj with .mtl [default: procedural ones].
    #[arg(long, value_name = "DIR")]
    pub meshes: Option<PathBuf>,
    /// Folder of photographs for surfaces [default: procedural ones].
    #[arg(long, value_name = "DIR")]
    pub textures: Option<PathBuf>,
    /// Folder of panoramas of light, .hdr or .exr [default: procedural ones].
    #[arg(long, value_name = "DIR")]
    pub environments: Option<PathBuf>,
    /// Leave out the assets named in this file, one per line; * and ? are wildcards.
    #[arg(long, value_name = "FILE")]
    pub exclude: Option<PathBuf>,
    /// Use only the assets named in this file.
    #[arg(long, value_name = "FILE")]
    pub only: Option<PathBuf>,
}

/// What commands without a settings file have.
#[derive(Debug, Args)]
#[command(next_help_heading = "General")]
pub struct GeneralFlags {
    /// Threads [default: one per core].
    #[arg(long, value_name = "N")]
    pub threads: Option<usize>,
    /// Print nothing but errors and warnings.
    #[arg(short, long)]
    pub quiet: bool,
    /// Print a summary as JSON on standard output.
    #[arg(long)]
    pub json: bool,
}

/// Arrangement of the cameras.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum RigChoice {
    /// Spread over a cap of a dome.
    Dome,
    /// Along an arc, hand-held.
    Arc,
    /// In rows and columns.
    Grid,
    /// On a circle at one height.
    Ring,
    /// One of these in each scene.
    Mixed,
}

impl RigChoice {
    /// The rigs that scenes may have.
    pub fn rigs(self) -> Vec<Rig> {
        match self {
            Self::Dome => vec![Rig::Dome],
            Self::Arc => vec![Rig::Arc],
            Self::Grid => vec![Rig::Grid],
            Self::Ring => vec![Rig::Ring],
            Self::Mixed => Rig::ALL.to_vec(),
        }
    }
}

fn styles() -> impl TypedValueParser<Value = Style> {
    let of_name = |given: String| Style::ALL.into_iter().find(|style| style.name() == given);
    PossibleValuesParser::new(Style::ALL.map(Style::name))
        .map(move |given| of_name(given).expect("only the names of styles are possible"))
}

fn parse_size(text: &str) -> Result<Size, String> {
    let sides = text.split_once('x').and_then(|(w, h)| Some(Size::new(w.parse().ok()?, h.parse().ok()?)));
    sides.ok_or_else(|| "expected WIDTHxHEIGHT, such as 640x480".to_owned())
}
