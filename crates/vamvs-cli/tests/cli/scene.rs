//! A small rendered scene on disk, and the program run on it.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use tempfile::TempDir;
use vamvs::core::Grid;
use vamvs::io::colmap::Model;
use vamvs::io::mvsnet;
use vamvs_tests::{Rendered, fixtures, folder};

/// A scene in a folder of its own, whose name has a space and letters beyond ASCII.
pub struct Scene {
    _guard: TempDir,
    pub root: PathBuf,
    pub views: Vec<Rendered>,
}

impl Scene {
    /// The still life from `views` places.
    pub fn new(width: usize, height: usize, views: usize) -> Self {
        let guard = TempDir::new().unwrap();
        let root = guard.path().join("Szene mit Äpfeln");
        let views = fixtures::still_life(vamvs::core::Size::new(width, height), views);
        folder::write_mvsnet(&root, &views, |view| format!("{view:04}"), 1.05).unwrap();
        Self { _guard: guard, root, views }
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.root.join(name)
    }

    pub fn out(&self) -> PathBuf {
        self.path("out")
    }

    /// `vamvs COMMAND --cams … --images … --out …` with more arguments.
    pub fn command(&self, command: &str, arguments: &[&str]) -> Command {
        self.command_to(&self.out(), command, arguments)
    }

    /// The same with another output folder.
    pub fn command_to(&self, out: &Path, command: &str, arguments: &[&str]) -> Command {
        let mut run = vamvs();
        run.arg(command).arg("--cams").arg(self.path("cams")).arg("--images").arg(self.path("images"));
        run.arg("--out").arg(out).args(arguments);
        run
    }

    /// Writes the scene as a COLMAP model to a folder; gives it as it was read from the camera files.
    pub fn write_colmap(&self, model: &str) -> vamvs::core::Scene {
        let (cams, images) = (self.path("cams"), self.path("images"));
        let loaded = mvsnet::read_scene(&cams, &images, None, &mvsnet::Options::default()).unwrap().scene;
        std::fs::create_dir_all(self.path(model)).unwrap();
        Model::from_scene(&loaded).write_text(&self.path(model)).unwrap();
        loaded
    }

    pub fn run(&self, command: &str, arguments: &[&str]) -> Output {
        self.command(command, arguments).output().unwrap()
    }

    /// Runs a command that must fail with exit code 1 and gives what it says.
    pub fn error(&self, command: &str, arguments: &[&str]) -> String {
        error_of(&self.run(command, arguments))
    }
}

pub fn vamvs() -> Command {
    Command::new(env!("CARGO_BIN_EXE_vamvs"))
}

pub fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// What a run says that ended with exit code 1 and without panic.
pub fn error_of(output: &Output) -> String {
    let said = stderr(output);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("error: ") && !said.contains("panicked"), "{said}");
    said
}

pub fn expect_success(output: &Output) {
    assert!(output.status.success(), "{}", stderr(output));
}

pub fn write(path: &Path, bytes: impl AsRef<[u8]>) {
    vamvs::io::atomic::write(path, |out| out.write_all(bytes.as_ref())).unwrap();
}

/// The share of the pixels with ground truth whose depth is right to `share`.
pub fn right(depth: &Grid<f32>, ground_truth: &Grid<f32>, share: f32) -> f64 {
    let known = ground_truth.data().iter().zip(depth.data()).filter(|(ground_truth, _)| **ground_truth > 0.0);
    let errors: Vec<f32> = known.map(|(ground_truth, depth)| (depth / ground_truth - 1.0).abs()).collect();
    errors.iter().filter(|error| **error < share).count() as f64 / errors.len() as f64
}

/// Cuts a file in half.
pub fn truncate(path: &Path) {
    let bytes = std::fs::read(path).unwrap();
    write(path, &bytes[..bytes.len() / 2]);
}

/// All files below a folder with their bytes.
pub fn content(folder: &Path) -> std::collections::BTreeMap<PathBuf, Vec<u8>> {
    let mut files = std::collections::BTreeMap::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files.extend(content(&path));
        } else {
            files.insert(path.clone(), std::fs::read(&path).unwrap());
        }
    }
    files
}
