//! Sets of scenes: what they depend on, which scenes are kept, and that their files fit together.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::collections::BTreeMap;
use std::fs;
use std::ops::Range;
use std::path::{Path, PathBuf};

use tempfile::{TempDir, tempdir};
use vamvs_core::{Size, Visibility};
use vamvs_io::{image, mvsnet, pfm, visibility};
use vamvs_synth::{
    Assets, Effects, RenderOptions, Rig, SceneFolder, Style, SynthError, SynthEvent, SynthJob, SynthOptions,
    SynthSummary,
};

fn options() -> SynthOptions {
    SynthOptions {
        styles: vec![Style::Turntable, Style::Facade],
        rigs: Rig::ALL.to_vec(),
        views: 3,
        size: Size::new(48, 32),
        render: RenderOptions { samples: 1, ..RenderOptions::default() },
        effects: Effects::default(),
        normals: true,
    }
}

/// A set of scenes in a temporary folder.
struct Set {
    folder: TempDir,
    assets: Assets,
    options: SynthOptions,
    seed: u64,
    force: bool,
}

impl Set {
    fn new() -> Self {
        let (folder, assets) = (tempdir().unwrap(), Assets::procedural());
        Self { folder, assets, options: options(), seed: 5, force: false }
    }

    fn run(&self, scenes: Range<u64>) -> Result<SynthSummary, SynthError> {
        self.run_showing(scenes, &mut |_| {})
    }

    fn run_showing(
        &self,
        scenes: Range<u64>,
        show: &mut dyn FnMut(SynthEvent),
    ) -> Result<SynthSummary, SynthError> {
        let Self { folder, assets, options, seed, force } = self;
        let job = SynthJob { assets, options, seed: *seed, out: folder.path(), force: *force };
        job.run(scenes, show)
    }

    fn made(self, scenes: Range<u64>) -> Self {
        self.run(scenes).unwrap();
        self
    }

    fn scene(&self, scene: u64) -> SceneFolder {
        SceneFolder::of(self.folder.path(), scene)
    }

    fn files(&self) -> BTreeMap<PathBuf, Vec<u8>> {
        let mut files = BTreeMap::new();
        collect(self.folder.path(), Path::new(""), &mut files);
        files
    }
}

fn collect(folder: &Path, below: &Path, files: &mut BTreeMap<PathBuf, Vec<u8>>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = below.join(path.file_name().unwrap());
        if path.is_dir() {
            collect(&path, &name, files);
        } else {
            files.insert(name, fs::read(&path).unwrap());
        }
    }
}

fn expect_equal(found: &BTreeMap<PathBuf, Vec<u8>>, expected: &BTreeMap<PathBuf, Vec<u8>>) {
    assert_eq!(found.keys().collect::<Vec<_>>(), expected.keys().collect::<Vec<_>>());
    for (path, bytes) in expected {
        assert!(found[path] == *bytes, "{} differs", path.display());
    }
}

#[test]
fn scenes_depend_on_their_number_and_the_seed_but_not_on_threads_and_other_scenes() {
    let with_threads = |threads, scenes| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| Set::new().made(scenes))
    };
    let (both, second) = (with_threads(1, 0..2).files(), with_threads(3, 1..2));
    assert_eq!(both.len(), 2 * (6 * 3 + 3), "six files a view; pairs, sheet and record");
    let of_second = |path: &PathBuf| path.starts_with("scene-00001");
    expect_equal(&second.files(), &both.into_iter().filter(|(path, _)| of_second(path)).collect());
    let other = Set { seed: 6, ..Set::new() }.made(1..2);
    let image = |set: &Set| fs::read(set.scene(1).image(0)).unwrap();
    assert_ne!(image(&other), image(&second));
}

#[test]
fn complete_scenes_are_kept_and_others_refused_unless_forced() {
    let mut set = Set::new().made(0..1);
    let before = set.files();
    assert_eq!(set.run(0..1).unwrap(), SynthSummary { made: 0, kept: 1 });
    set.options.effects = Effects::NONE;
    let error = set.run(0..1).unwrap_err().to_string();
    assert!(
        error.contains("scene-00000") && error.contains("effects") && error.contains("--force"),
        "{error}"
    );
    expect_equal(&set.files(), &before);
    set.force = true;
    assert_eq!(set.run(0..1).unwrap(), SynthSummary { made: 1, kept: 0 });
    assert_eq!(set.run(0..1).unwrap(), SynthSummary { made: 0, kept: 1 });
    let after = set.files();
    let depth =
        |files: &BTreeMap<PathBuf, Vec<u8>>| files[Path::new("scene-00000/depths/00000000.pfm")].clone();
    assert_eq!(depth(&after), depth(&before), "effects change photographs alone");
    assert_ne!(after, before);
}

#[test]
fn an_interrupted_scene_is_made_anew() {
    let set = Set::new().made(0..1);
    let undisturbed = set.files();
    let scene = set.scene(0);
    fs::remove_file(scene.record()).unwrap();
    fs::remove_file(scene.depth(1)).unwrap();
    for (from, to) in [(scene.image(0), scene.image(1)), (scene.image(0), scene.image(8))] {
        fs::copy(from, to).unwrap();
    }
    for left in [".vamvs-killed", "unfinished"] {
        fs::copy(scene.pairs(), scene.root().join(left)).unwrap();
    }
    assert_eq!(set.run(0..1).unwrap(), SynthSummary { made: 1, kept: 0 });
    expect_equal(&set.files(), &undisturbed);
}

#[test]
fn options_that_make_no_scene_are_refused() {
    let wrong = [
        SynthOptions { views: 1, ..options() },
        SynthOptions { styles: Vec::new(), ..options() },
        SynthOptions { size: Size::new(0, 32), ..options() },
        SynthOptions { render: RenderOptions { samples: 0, ..options().render }, ..options() },
    ];
    for (options, name) in wrong.into_iter().zip(["views", "styles", "size", "samples"]) {
        let set = Set { options, ..Set::new() };
        let error = set.run(0..1).unwrap_err().to_string();
        assert!(error.contains(name), "{error}");
        assert!(set.files().is_empty());
    }
}

/// Asserts that there is an event for each of three views and then one for the scene, for two scenes.
fn expect_all_events(events: &[SynthEvent]) {
    let styles = [Style::Turntable, Style::Facade];
    for ((scene, events), style) in (0..).zip(events.chunks(4)).zip(styles) {
        let views = (1..=3).map(|done| SynthEvent::View { scene, done, total: 3 });
        assert!(events.iter().take(3).cloned().eq(views), "{events:?}");
        let Some(SynthEvent::Scene { scene: of, style: told, kept: false, .. }) = events.last() else {
            panic!("{events:?}")
        };
        assert_eq!((*of, *told), (scene, style));
    }
    assert_eq!(events.len(), 8);
}

#[test]
fn the_files_are_one_scene() {
    let (set, mut events) = (Set::new(), Vec::new());
    set.run_showing(0..2, &mut |event| events.push(event)).unwrap();
    expect_all_events(&events);
    for number in 0..2 {
        let folder = set.scene(number);
        let read = |name: &str| folder.root().join(name);
        let options = mvsnet::Options::default();
        let loaded = mvsnet::read_scene(&read("cams"), &read("images"), None, &options).unwrap();
        assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
        let pairs = loaded.scene.pairs.unwrap();
        for (index, view) in loaded.scene.views.iter().enumerate() {
            let size = view.camera.size;
            let depth = pfm::read_depth(&folder.depth(index)).unwrap();
            let tiles = visibility::read(&folder.visibility(index), size, pairs.len()).unwrap();
            let range = view.depth_range.unwrap();
            let inside = |&z: &f32| z == 0.0 || (range.near..range.far).contains(&f64::from(z));
            assert!(depth.data().iter().all(inside) && depth.data().iter().any(|&z| z > 0.0));
            let own = depth.map(|&z| if z > 0.0 { Visibility::Visible } else { Visibility::None });
            assert_eq!(tiles[index], own);
            assert_eq!((depth.size(), tiles.len()), (size, 3));
            assert_eq!(image::stored_size(&folder.objects(index)).unwrap(), size);
            let normals = pfm::read_rgb(&folder.normals(index)).unwrap();
            let is_unit = |n: &[f32; 3]| (n.iter().map(|v| v * v).sum::<f32>() - 1.0).abs() < 1e-5;
            let agree = normals.data().iter().zip(depth.data()).all(|(n, &z)| is_unit(n) == (z > 0.0));
            assert!(agree, "normals are where depths are");
            assert!(pairs[index].iter().all(|source| source.view != index));
        }
    }
}
