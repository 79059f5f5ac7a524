//! The commands, one a file.

#[cfg(feature = "torch")]
mod calibrate;
mod capture;
pub mod depth;
mod eval;
mod fuse;
mod info;
mod manual;
mod mesh;
mod pseudo;
mod reconstruct;
mod refine;
mod report;
#[cfg(feature = "synth")]
mod synth;
mod tasks;
#[cfg(feature = "torch")]
mod train;

use std::ops::ControlFlow;
use std::path::Path;

use anyhow::{Result, bail};
use vamvs::core::{Part, View};
use vamvs::io::Loaded;
use vamvs::io::masks::Masks;
use vamvs::output::LeftOut;
use vamvs::{Event, Maps};

use crate::arguments::{Arguments, Command, CommonFlags, InputFlags};
use crate::progress::Progress;
use crate::settings;

/// Runs a command.
pub fn run(arguments: &Arguments) -> Result<()> {
    match &arguments.command {
        Command::Reconstruct(arguments) => reconstruct::run(arguments),
        Command::Depth(arguments) => depth::run(arguments),
        Command::Tasks(arguments) => tasks::run(arguments),
        Command::Refine(arguments) => refine::run(arguments),
        Command::Fuse(arguments) => fuse::run(arguments),
        Command::Mesh(arguments) => mesh::run(arguments),
        #[cfg(feature = "synth")]
        Command::Synth(arguments) => synth::run(arguments),
        #[cfg(not(feature = "synth"))]
        Command::Synth(_) => bail!(
            "this vamvs was built without synthetic scenes, which `vamvs synth` makes: expected a build with them (`cargo build \
             --release -p vamvs-cli --features synth`)"
        ),
        Command::Pseudo(arguments) => pseudo::run(arguments),
        #[cfg(feature = "torch")]
        Command::Train(arguments) => train::run(arguments),
        #[cfg(feature = "torch")]
        Command::Calibrate(arguments) => calibrate::run(arguments),
        #[cfg(not(feature = "torch"))]
        Command::Train(_) => needs_libtorch("train"),
        #[cfg(not(feature = "torch"))]
        Command::Calibrate(_) => needs_libtorch("calibrate"),
        Command::Eval(arguments) => eval::run(arguments),
        Command::Info(arguments) => info::run(arguments),
        Command::Report(arguments) => report::run(arguments),
        Command::Completions(arguments) => manual::completions(arguments),
        Command::Man(arguments) => manual::run(arguments),
    }
}

/// A command that this build is without.
#[cfg(not(feature = "torch"))]
fn needs_libtorch(command: &str) -> Result<()> {
    bail!(
        "this vamvs was built without libtorch, which `vamvs {command}` needs: expected {}",
        vamvs::WITH_LIBTORCH
    )
}

/// Opens depth maps; the scene of the flags, if there is one, has the cameras and photographs of a folder that has none.
fn open_maps(
    (folder, png_step): (&Path, Option<f64>),
    (input, common): (&InputFlags, &CommonFlags),
    masks: Masks,
    show: &mut dyn FnMut(Event) -> ControlFlow<()>,
) -> Result<Maps> {
    let Some(scene) = settings::given_scene(input)? else {
        return Ok(Maps::open(folder, masks, show)?);
    };
    let loaded = scene.load()?;
    expect_all_cameras(common, &loaded)?;
    Ok(Maps::open_with(folder, &loaded, png_step, masks, show)?)
}

/// Says whether a part of a step was done now or before.
fn say_part(part: Part, did: bool, progress: &Progress) {
    progress.finish();
    progress.say(&format!("part {part}: {}", if did { "done" } else { "was done" }));
}

/// Refuses photographs, given by a flag, without the cameras of their scene.
fn expect_scene(input: &InputFlags) -> Result<()> {
    if input.images.is_some() && settings::given_scene(input)?.is_none() {
        bail!(
            "--images needs the scene that the photographs are of: give its cameras too, as with --cams or --colmap"
        );
    }
    Ok(())
}

/// Refuses a folder of masks, given by a flag, that has none of any view.
fn expect_masks(folder: Option<&Path>, views: &[View]) -> Result<()> {
    let Some((folder, first)) = folder.filter(|folder| folder.is_dir()).zip(views.first()) else {
        return Ok(());
    };
    let masks = Masks::Folder(folder.to_owned());
    if views.iter().any(|view| masks.find(&view.file()).is_some()) {
        return Ok(());
    }
    let mut there: Vec<String> = std::fs::read_dir(folder)
        .into_iter()
        .flatten()
        .flatten()
        .map(|entry| entry.file_name().to_string_lossy().into_owned())
        .collect();
    there.sort();
    let found = match there.len() {
        0 => "an empty folder".to_owned(),
        1..=3 => there.join(", "),
        _ => format!("{}, …", there[..3].join(", ")),
    };
    let name = first.file();
    let stem = Path::new(&name).with_extension("");
    let stem = stem.display();
    bail!(
        "--masks {}: none of the {} views has a mask there: expected for {name} one of {name}.png, {stem}.png, {stem}_mask.png and {stem}.mask.png, found {found}",
        folder.display(),
        views.len()
    )
}

/// With `--strict`, cameras that cannot be used are an error.
fn expect_all_cameras(common: &CommonFlags, loaded: &Loaded) -> Result<()> {
    if common.strict && !loaded.broken.is_empty() {
        let broken = &loaded.broken;
        bail!("{} camera(s) cannot be used, and --strict allows none: {}", broken.len(), broken.join("; "));
    }
    Ok(())
}

/// With `--strict`, views that are left out are an error.
fn expect_all_views(common: &CommonFlags, left_out: &[LeftOut]) -> Result<()> {
    if common.strict && !left_out.is_empty() {
        let views: Vec<String> =
            left_out.iter().map(|LeftOut { view, reason }| format!("{view}: {reason}")).collect();
        bail!("{} view(s) were left out, and --strict allows none: {}", views.len(), views.join("; "));
    }
    Ok(())
}
