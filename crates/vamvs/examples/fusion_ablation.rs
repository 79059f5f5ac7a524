//! Compares the rules of fusion on scenes with ground truth.
//!
//! `cargo run --release -p vamvs --no-default-features --example fusion_ablation -- OUT
//! GROUND_TRUTH [OUT GROUND_TRUTH …]` fuses the depth maps in each folder OUT in several ways and
//! compares the clouds with the true depth maps in GROUND_TRUTH, a scene of `vamvs synth`. For each
//! way it prints the mean over the scenes of the F-score, precision and recall at 0.3 % and 1 % of
//! the median depth, in percent, the floaters (points farther than 5 % of the median depth from any
//! surface that a view sees) in percent of the points, and the number of points.

use std::path::PathBuf;

use vamvs::core::DepthMap;
use vamvs::core::depth_map::is_valid;
use vamvs::core::lift::lift_map;
use vamvs::fusion::{FuseJob, FuseOptions, FusionView, MapSource, fuse_to_cloud};
use vamvs::io::masks::Masks;
use vamvs::measures::CloudDistances;
use vamvs::{FusionOptions, Maps};

/// Distance thresholds of the F-score, as shares of the median depth.
const NEAR: [f64; 2] = [0.003, 0.01];

/// A point farther than this share of the median depth from any surface is a floater.
const FLOATING: f64 = 0.05;

/// Step, in pixels in both directions, at which the true depth maps are sampled.
const STEP: usize = 2;

type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

/// Estimated maps with the ground truth.
struct Scene {
    views: Vec<FusionView>,
    neighbours: Vec<Vec<usize>>,
    /// Points of all surfaces that a view sees.
    ground_truth: Vec<[f64; 3]>,
    median_depth: f64,
}

/// The scores of a cloud.
#[derive(Clone, Copy, Default)]
struct Scores {
    /// F-score, precision and recall at each of [`NEAR`].
    near: [[f64; 3]; 2],
    floaters: f64,
    points: f64,
}

fn main() -> Result<()> {
    let folders: Vec<PathBuf> = std::env::args_os().skip(1).map(PathBuf::from).collect();
    let scenes: Vec<Scene> =
        folders.chunks_exact(2).map(|pair| Scene::read(&pair[0], &pair[1])).collect::<Result<_>>()?;
    println!("{:44} {:>19} {:>19}  floaters    points", "", "F, P, R at 0.3 %", "F, P, R at 1 %");
    for (name, options) in variants() {
        let scores: Vec<Scores> = scenes.iter().map(|scene| scene.scores(&options)).collect::<Result<_>>()?;
        let Scores { near: [fine, coarse], floaters, points } = mean(&scores);
        let shares = |near: [f64; 3]| near.map(|share| format!("{:6.2}", 100.0 * share)).concat();
        println!(
            "{name:44} {:>19} {:>19}  {:7.3} {points:10.0}",
            shares(fine),
            shares(coarse),
            100.0 * floaters
        );
    }
    Ok(())
}

/// The ways to fuse, with their names.
fn variants() -> Vec<(String, FuseOptions)> {
    let mut variants = Vec::new();
    for min_views in [2, 3, 4] {
        let mut options = FuseOptions::classic();
        options.min_views = min_views;
        variants.push((format!("classic, {min_views} views"), options));
    }
    let default = FuseOptions::default();
    for min_support in [default.min_support, 0.6, 0.8] {
        for contradiction in [0.0, default.contradiction, 1.0] {
            let name = format!("dynamic, support {min_support}, contradiction {contradiction}");
            let mut options = FuseOptions::default();
            (options.min_support, options.contradiction) = (min_support, contradiction);
            variants.push((name, options));
        }
    }
    variants
}

impl Scene {
    fn read(estimated: &std::path::Path, ground_truth: &std::path::Path) -> Result<Self> {
        let maps = Maps::open(estimated, Masks::None, &mut |_| std::ops::ControlFlow::Continue(()))?;
        let ground_truth =
            Maps::open(ground_truth, Masks::None, &mut |_| std::ops::ControlFlow::Continue(()))?;
        let true_maps: Vec<DepthMap> = (0..ground_truth.len())
            .map(|view| ground_truth.depth_map(view))
            .collect::<std::result::Result<_, _>>()?;
        let mut depths: Vec<f32> =
            true_maps.iter().flat_map(|map| map.depth.data()).copied().filter(|&d| is_valid(d)).collect();
        depths.sort_by(f32::total_cmp);
        Ok(Self {
            neighbours: maps.neighbours(FusionOptions::default().neighbours),
            views: (0..maps.len()).map(|view| maps.load(view)).collect::<std::result::Result<_, _>>()?,
            ground_truth: true_maps.iter().flat_map(surface).collect(),
            median_depth: depths[depths.len() / 2].into(),
        })
    }

    fn scores(&self, options: &FuseOptions) -> Result<Scores> {
        let job = FuseJob {
            source: &self.views[..],
            neighbours: &self.neighbours,
            options,
            roi: None,
            memory: usize::MAX / 2,
        };
        let cloud: Vec<[f64; 3]> = fuse_to_cloud(&job)?.0.into_iter().map(|point| point.x_in_world).collect();
        let distances = CloudDistances::between(&cloud, &self.ground_truth);
        let agreement = |share| {
            let at = distances.agreement(share * self.median_depth);
            [at.f_score, at.precision, at.recall]
        };
        let floats = |&&distance: &&f64| distance > FLOATING * self.median_depth;
        let floaters =
            distances.to_ground_truth.iter().filter(floats).count() as f64 / cloud.len().max(1) as f64;
        Ok(Scores { near: NEAR.map(agreement), floaters, points: cloud.len() as f64 })
    }
}

/// Points of the surfaces that a view sees, one every [`STEP`] pixels in both directions.
fn surface(map: &DepthMap) -> Vec<[f64; 3]> {
    let width = map.depth.width();
    let sampled = |i: usize| (i % width).is_multiple_of(STEP) && (i / width).is_multiple_of(STEP);
    let points = lift_map(map).enumerate().filter(|&(i, _)| sampled(i));
    points.filter_map(|(_, point)| Some(point?.into())).collect()
}

fn mean(scores: &[Scores]) -> Scores {
    let of = |value: &dyn Fn(&Scores) -> f64| scores.iter().map(value).sum::<f64>() / scores.len() as f64;
    Scores {
        near: [0, 1].map(|at| [0, 1, 2].map(|which| of(&|scores| scores.near[at][which]))),
        floaters: of(&|scores| scores.floaters),
        points: of(&|scores| scores.points),
    }
}
