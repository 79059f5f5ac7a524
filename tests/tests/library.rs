//! The library as other programs use it: photographs in memory, depth maps one by one, and cancellation.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::error::Error;
use std::ops::ControlFlow;
use std::path::Path;

use vamvs::core::{CloudPoint, DepthMap, Grid, Rgb, Scene, Size, View};
use vamvs::meshing::MeshOptions;
use vamvs::{
    DepthOptions, Event, FusionOptions, Input, Maps, OutputFolder, PhotoSource, Picture, Reconstruction,
    VamvsError, ViewMap, fuse_in_memory, io, mesh_in_memory, mesh_of,
};
use vamvs_tests::{fixtures, folder};

const SIZE: Size = Size::new(192, 144);

/// A scene's files, and the same scene with its photographs in memory.
struct Fixture {
    files: tempfile::TempDir,
    scene: Scene,
    images: Vec<(String, Grid<Rgb>)>,
}

struct Images(Vec<(String, Grid<Rgb>)>);

impl PhotoSource for Images {
    fn picture(&self, view: &View) -> Result<Picture, Box<dyn Error + Send + Sync>> {
        let image = self.0.iter().find(|(name, _)| *name == view.name).ok_or("no such photograph")?;
        Ok(Picture { image: image.1.clone(), mask: None })
    }
}

impl Fixture {
    fn new() -> Self {
        let files = tempfile::tempdir().unwrap();
        let rendered = fixtures::still_life(SIZE, 4);
        folder::write_mvsnet(files.path(), &rendered, |view| format!("{view:04}"), 1.2).unwrap();
        let loaded = input(files.path()).load().unwrap();
        let read =
            |view: &View| (view.name.clone(), io::image::load_rgb(&loaded.images.join(&view.name)).unwrap());
        let images = loaded.scene.views.iter().map(read).collect();
        Self { files, scene: loaded.scene, images }
    }

    fn with_files(&self) -> Reconstruction {
        Reconstruction::new(input(self.files.path()).load().unwrap()).weights("photometric").depth(options())
    }

    fn in_memory(&self) -> Reconstruction {
        let images = Images(self.images.clone());
        Reconstruction::with_photographs(self.scene.clone(), images).weights("photometric").depth(options())
    }
}

fn input(root: &Path) -> Input {
    let (cams, images) = (root.join("cams"), root.join("images"));
    Input::Mvsnet { cams, images, pairs: None, options: io::mvsnet::Options::default() }
}

fn options() -> DepthOptions {
    let mut options = DepthOptions::default();
    options.planes = Some(32);
    options
}

fn ignore(_: Event) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

fn fusion() -> FusionOptions {
    FusionOptions::default()
}

#[test]
fn depth_maps_and_cloud_in_memory_are_those_of_the_files() {
    let fixture = Fixture::new();
    let out = fixture.files.path().join("out");
    let done = fixture.with_files().run(&out, &mut ignore).unwrap();
    assert_eq!((done.depth.made, done.depth.skipped.len()), (4, 0));
    let work = fixture.in_memory().prepare(&mut ignore).unwrap();
    let maps: Vec<ViewMap> = work.depth_maps(Box::new(ignore)).map(Result::unwrap).collect();
    let saved = Maps::open(&out, io::masks::Masks::None, &mut ignore).unwrap();
    assert_eq!(maps.iter().map(|map| map.name.as_str()).collect::<Vec<_>>(), saved.names());
    for (number, ViewMap { map, colour, .. }) in maps.iter().enumerate() {
        let DepthMap { depth, confidence, .. } = saved.depth_map(number).unwrap();
        assert!(map.depth == depth && map.confidence == confidence, "view {number}");
        assert_eq!(colour.size(), SIZE);
    }
    let cloud = fuse_in_memory(&maps, &fusion(), &mut ignore).unwrap();
    assert!(cloud.len() > 5000);
    let of_files = io::ply::read(&done.cloud).unwrap();
    assert_eq!((cloud.len() as u64, cloud.len()), (done.fusion.points, of_files.len()));
    // This PLY file stores positions in single precision, coordinates are below 2.
    let same_place = |a: [f64; 3], b: [f64; 3]| a.iter().zip(&b).all(|(a, b)| (a - b).abs() < 1.2e-7);
    let same =
        |a: &CloudPoint, b: &CloudPoint| same_place(a.x_in_world, b.x_in_world) && a.colour == b.colour;
    assert!(cloud.iter().zip(&of_files).all(|(a, b)| same(a, b)));
    let mesh = (MeshOptions::default(), fusion());
    let of_memory = mesh_in_memory(&maps, (&mesh.0, &mesh.1), &mut ignore).unwrap();
    assert!(of_memory.triangles.len() > 5000);
    assert_eq!(of_memory, mesh_of(&saved, (&mesh.0, &mesh.1), &mut ignore).unwrap());
    // A map that the program adds itself lists no neighbours. It takes part in fusion all the same.
    let mut mixed = maps;
    mixed[3] = ViewMap { view: 0, neighbours: Vec::new(), ..mixed[3].clone() };
    let mixed = fuse_in_memory(&mixed, &fusion(), &mut ignore).unwrap();
    assert!(mixed.len().abs_diff(cloud.len()) < cloud.len() / 20, "{} and {}", mixed.len(), cloud.len());
}

#[test]
fn a_photograph_that_cannot_be_had_is_told_and_has_no_part() {
    let mut fixture = Fixture::new();
    fixture.images.remove(1);
    let mut warnings = Vec::new();
    let work = fixture.in_memory().prepare(&mut ignore).unwrap();
    let listen = |event: Event| {
        if let Event::Warning(text) = event {
            warnings.push(text);
        }
        ControlFlow::Continue(())
    };
    let maps: Vec<ViewMap> = work.depth_maps(Box::new(listen)).map(Result::unwrap).collect();
    assert_eq!(maps.iter().map(|map| map.view).collect::<Vec<_>>(), [0, 2, 3]);
    assert!(warnings.len() == 1 && warnings[0].contains("no such photograph"), "{warnings:?}");
    // A single map gives an empty cloud, not an error.
    assert!(fuse_in_memory(&maps[..1], &fusion(), &mut ignore).unwrap().is_empty());
}

#[test]
fn a_run_ends_when_its_caller_says_so_and_goes_on_later() {
    let fixture = Fixture::new();
    let out = fixture.files.path().join("out");
    let undisturbed = fixture.files.path().join("undisturbed");
    fixture.with_files().run(&undisturbed, &mut ignore).unwrap();
    let end_at = |count: usize| {
        let mut seen = 0;
        let mut listen = move |_: Event| {
            seen += 1;
            if seen < count { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
        };
        fixture.with_files().run(&out, &mut listen)
    };
    for count in [1, 3, 6, 9] {
        let error = end_at(count).unwrap_err();
        assert!(matches!(error, VamvsError::Cancelled), "after {count} events: {error}");
        assert!(!OutputFolder::new(&out).cloud().exists());
    }
    let done = fixture.with_files().run(&out, &mut ignore).unwrap();
    let bytes = |root: &Path| std::fs::read(OutputFolder::new(root).cloud()).unwrap();
    assert!(done.depth.resumed > 0 && bytes(&out) == bytes(&undisturbed));
    let work = fixture.in_memory().prepare(&mut ignore).unwrap();
    let mut maps = work.depth_maps(Box::new(|_| ControlFlow::Break(())));
    assert!(matches!(maps.next(), Some(Err(VamvsError::Cancelled))) && maps.next().is_none());
}
