//! Makes a set of scenes. Each depends only on its number, the seed, the options and the assets; a complete
//! one is kept.

use std::ops::Range;
use std::path::Path;
use std::time::{Duration, Instant};

use rand::RngExt;
use rayon::prelude::*;
use vamvs_core::{Grid, Rgb, Size, Visibility, depth_map::is_valid};
use vamvs_io::{image, mvsnet};

use crate::random::stream;
use crate::sheet::Sheet;
use crate::{
    Assets, Effects, Recipe, RenderOptions, Rig, RigOptions, SceneFolder, Shot, Station, Style, SynthError,
    Tracer, develop, layout, overlap, rig,
};

/// Options of a set of scenes.
#[derive(Clone, Debug, PartialEq)]
pub struct SynthOptions {
    /// The styles; scenes take them in turn.
    pub styles: Vec<Style>,
    /// The rigs; each scene takes one at random.
    pub rigs: Vec<Rig>,
    /// Number of cameras in a scene, 2 to 999.
    pub views: usize,
    /// Size of the photographs, 16 to 8192 pixels per side.
    pub size: Size,
    /// How the photographs are rendered.
    pub render: RenderOptions,
    /// Limits of the lens and sensor effects added to the photographs.
    pub effects: Effects,
    /// Whether normals are written.
    pub normals: bool,
}

impl Default for SynthOptions {
    /// The paper's (section 4.1): nine cameras of 512×512 pixels on a dome; but scenes of all styles.
    fn default() -> Self {
        Self {
            styles: Style::ALL.to_vec(),
            rigs: vec![Rig::Dome],
            views: 9,
            size: Size::new(512, 512),
            render: RenderOptions::default(),
            effects: Effects::default(),
            normals: false,
        }
    }
}

/// A set of scenes to be made.
#[derive(Clone, Copy, Debug)]
pub struct SynthJob<'a> {
    /// What the scenes are made of.
    pub assets: &'a Assets,
    /// The options of all scenes.
    pub options: &'a SynthOptions,
    /// The seed of the set.
    pub seed: u64,
    /// The set's folder; each scene gets a folder in it.
    pub out: &'a Path,
    /// Whether complete scenes that were made with other options are overwritten; else they are an error.
    pub force: bool,
}

/// Progress of the making of scenes.
#[derive(Clone, Debug, PartialEq)]
pub enum SynthEvent {
    /// A view was rendered.
    View {
        /// The scene's number.
        scene: u64,
        /// Number of its views that are rendered.
        done: usize,
        /// Number of its views.
        total: usize,
    },
    /// A scene is complete.
    Scene {
        /// Its number.
        scene: u64,
        /// Its style.
        style: Style,
        /// Whether it was complete before, and kept.
        kept: bool,
        /// How long it took.
        time: Duration,
    },
}

/// Numbers of scenes made and kept.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SynthSummary {
    /// Scenes made.
    pub made: usize,
    /// Scenes that were complete before.
    pub kept: usize,
}

/// Number of stages that are tried for a scene before it fails for lack of room for the cameras.
const STAGES: u32 = 12;

impl SynthJob<'_> {
    /// Makes the scenes with these numbers. A scene depends only on its number, the seed, the options and the
    /// assets; so a set can be continued, or shared between machines.
    ///
    /// # Errors
    /// If an option is out of its range, an asset cannot be used, there is no room for the cameras on any stage, a
    /// file cannot be read or written, or a scene that was made with other options is there and `force` is not
    /// set. Scenes that are complete by then are kept.
    pub fn run(
        &self,
        scenes: Range<u64>,
        show: &mut dyn FnMut(SynthEvent),
    ) -> Result<SynthSummary, SynthError> {
        self.options.validate()?;
        let mut summary = SynthSummary::default();
        for scene in scenes {
            let begin = Instant::now();
            let kept = self.is_there(scene)?;
            if !kept {
                self.make(scene, show)?;
            }
            summary.made += usize::from(!kept);
            summary.kept += usize::from(kept);
            show(SynthEvent::Scene { scene, style: self.style(scene), kept, time: begin.elapsed() });
        }
        Ok(summary)
    }

    fn is_there(&self, scene: u64) -> Result<bool, SynthError> {
        let record = SceneFolder::of(self.out, scene).record();
        match self.recipe(scene).is_at(&record) {
            Err(SynthError::OtherScene { .. } | SynthError::Record { .. }) if self.force => Ok(false),
            other => other,
        }
    }

    fn make(&self, scene: u64, show: &mut dyn FnMut(SynthEvent)) -> Result<(), SynthError> {
        let recipe = self.recipe(scene);
        let folder = SceneFolder::of(self.out, scene);
        folder.begin(recipe.normals)?;
        let (tracer, stations) = self.stage(&recipe)?;
        let shots = shoot(&tracer, &stations, &recipe, show);
        let photographs = develop::develop(&shots, &recipe.effects, &mut self.random(scene, "develop"));
        let views = Views { tracer: &tracer, stations: &stations, shots: &shots, photographs: &photographs };
        views.write(&folder, recipe.normals)?;
        recipe.save(&folder.record())?;
        folder.end()
    }

    /// The first stage that has room for the cameras, and the cameras.
    fn stage(&self, recipe: &Recipe) -> Result<(Tracer, Vec<Station>), SynthError> {
        let Recipe { scene, style, rig, views, size, .. } = *recipe;
        let cameras = RigOptions { rig, views, size };
        for attempt in 0..STAGES {
            let random = |purpose| self.random(scene, &format!("{purpose} {attempt}"));
            let stage = layout::stage(style, self.assets, &mut random("stage"))?;
            let tracer = Tracer::new(&stage.world);
            let stations = rig::place(&cameras, &stage.focus, &tracer, &mut random("rig"));
            if let Some(stations) = stations {
                return Ok((tracer, stations));
            }
        }
        Err(SynthError::NoPlace { scene, style: style.name(), views, rig: rig.name() })
    }

    fn recipe(&self, scene: u64) -> Recipe {
        let options = self.options;
        let rig = self.random(scene, "kind of rig").random_range(0..options.rigs.len());
        Recipe {
            version: Recipe::version(),
            seed: self.seed,
            scene,
            style: self.style(scene),
            rig: options.rigs[rig],
            views: options.views,
            size: options.size,
            render: options.render,
            effects: options.effects,
            normals: options.normals,
            assets: self.assets.fingerprint().to_owned(),
        }
    }

    fn style(&self, scene: u64) -> Style {
        self.options.styles[scene as usize % self.options.styles.len()]
    }

    fn random(&self, scene: u64, purpose: &str) -> rand_pcg::Pcg64 {
        stream(self.seed, scene, purpose)
    }
}

impl SynthOptions {
    fn validate(&self) -> Result<(), SynthError> {
        let check = |good: bool, name, expected, got: &dyn std::fmt::Debug| {
            if good { Ok(()) } else { Err(SynthError::Option { name, expected, got: format!("{got:?}") }) }
        };
        let sides = [self.size.width, self.size.height];
        check(!self.styles.is_empty(), "styles", "at least one", &self.styles)?;
        check(!self.rigs.is_empty(), "rigs", "at least one", &self.rigs)?;
        check((2..=999).contains(&self.views), "views", "from 2 to 999", &self.views)?;
        check(sides.iter().all(|side| (16..=8192).contains(side)), "size", "from 16 to 8192 pixels", &sides)?;
        check(self.render.samples >= 1, "samples", "at least 1", &self.render.samples)?;
        check(self.render.max_bounces >= 1, "bounces", "at least 1", &self.render.max_bounces)
    }
}

fn shoot(
    tracer: &Tracer,
    stations: &[Station],
    recipe: &Recipe,
    show: &mut dyn FnMut(SynthEvent),
) -> Vec<Shot> {
    let mut seeds = stream(recipe.seed, recipe.scene, "light");
    let total = stations.len();
    let shoot = |(view, station): (usize, &Station)| {
        let shot = tracer.shoot(&station.camera, &station.cam_from_world, &recipe.render, seeds.random());
        show(SynthEvent::View { scene: recipe.scene, done: view + 1, total });
        shot
    };
    stations.iter().enumerate().map(shoot).collect()
}

/// All views of a scene, ready to be written.
struct Views<'a> {
    tracer: &'a Tracer,
    stations: &'a [Station],
    shots: &'a [Shot],
    photographs: &'a [Grid<Rgb>],
}

impl Views<'_> {
    /// Writes all files of the scene except the record.
    fn write(&self, folder: &SceneFolder, normals: bool) -> Result<(), SynthError> {
        let mut sheet = Sheet::default();
        let mut pairs = Vec::with_capacity(self.stations.len());
        for (view, (station, shot)) in self.stations.iter().zip(self.shots).enumerate() {
            let (photograph, depth) = (&self.photographs[view], &shot.ground_truth.depth);
            let visibility = self.visibility(view);
            folder.write_photograph(view, photograph, station, depth)?;
            folder.write_truth(view, &shot.ground_truth, normals)?;
            folder.write_visibility(view, &visibility)?;
            pairs.push(overlap::sources(view, self.stations, depth, &visibility));
            sheet.add(photograph, depth, &visibility);
        }
        let ids: Vec<u32> = (0..self.stations.len() as u32).collect();
        mvsnet::write_pairs(&folder.pairs(), &ids, &pairs)?;
        Ok(image::save_png_rgb(&folder.sheet(), &sheet.paint())?)
    }

    /// The visibility of a view's pixels in every view; in the view itself every surface is visible.
    fn visibility(&self, view: usize) -> Vec<Grid<Visibility>> {
        let Station { camera, cam_from_world } = &self.stations[view];
        let depth = &self.shots[view].ground_truth.depth;
        let tile = |(other, source): (usize, &Station)| {
            if other == view {
                return depth.map(|&z| if is_valid(z) { Visibility::Visible } else { Visibility::None });
            }
            let source = (&source.camera, &source.cam_from_world);
            self.tracer.visibility((camera, cam_from_world, depth), source)
        };
        self.stations.par_iter().enumerate().map(tile).collect()
    }
}
