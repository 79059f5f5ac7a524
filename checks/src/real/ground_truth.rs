//! Ground truth of real scenes: depth maps of some views, against which depth maps and clouds are compared.

use std::path::Path;

use anyhow::{Context, Result};
use nalgebra::{Vector2, Vector3};
use serde::Serialize;
use vamvs_core::depth_map::is_valid;
use vamvs_core::lift::lift;
use vamvs_core::{CloudPoint, Grid};
use vamvs_eval::{CloudDistances, thin};
use vamvs_io::{depth, pfm};

use super::cameras::Shot;
use super::scenes::{RealScene, SceneLayout};
use crate::frames;

/// Points that lie this many times the largest threshold behind a true surface are hidden, and are not judged.
const HIDDEN: f64 = 2.0;

/// A view with its true depth, scene units; 0 where it is unknown.
pub struct TrueView {
    shot: Shot,
    depth: Grid<f32>,
}

/// Shares for each of a scene's thresholds.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Scores {
    /// Of the true pixels, those whose depth is within a share of the true one; missing ones are not.
    pub within: [f64; 5],
    /// Of the cloud's points before known surfaces, those within a share of the median depth of one.
    pub precision: [f64; 5],
    /// Of the true surface, what is within that distance of a point.
    pub recall: [f64; 5],
}

impl Scores {
    /// The harmonic mean of precision and recall.
    pub fn f(&self, threshold: usize) -> f64 {
        let (p, r) = (self.precision[threshold], self.recall[threshold]);
        if p + r > 0.0 { 2.0 * p * r / (p + r) } else { 0.0 }
    }
}

/// The ground truth of the views of an output folder; empty if the scene has none.
pub fn read(scene: &RealScene, views: Vec<Shot>) -> Result<Vec<TrueView>> {
    let gt = scene.folder.join("gt");
    let scale = match gt.join("scale.txt") {
        file if file.is_file() => Some(step(&file)?),
        _ => None,
    };
    let mut ground_truth = Vec::new();
    for shot in views {
        let file = gt.join(format!("{}.png", shot.name));
        let depth = match scale {
            Some(scale) if file.is_file() => depth::read(&file, scale)?,
            _ if scene.layout == SceneLayout::Frames => {
                frames::sensor_depth(&scene.folder, &shot.name, shot.camera.size)?
            }
            _ => continue,
        };
        ground_truth.push(TrueView { shot, depth });
    }
    Ok(ground_truth)
}

fn step(file: &Path) -> Result<f64> {
    let text = std::fs::read_to_string(file).with_context(|| format!("{} cannot be read", file.display()))?;
    let word = text.split_whitespace().next().unwrap_or_default();
    word.parse().with_context(|| format!("{}: expected a number, found {word:?}", file.display()))
}

/// Compares the depth maps in the folder `out` and a cloud with the ground truth.
pub fn scores(
    ground_truth: &[TrueView],
    out: &Path,
    cloud: &[CloudPoint],
    thresholds: &[f64; 5],
) -> Result<Scores> {
    let mut scores = Scores::default();
    let (mut within, mut known) = ([0_usize; 5], 0_usize);
    for TrueView { shot, depth } in ground_truth {
        let file = out.join("depths").join(format!("{}.pfm", shot.name));
        let map = if file.is_file() { pfm::read_depth(&file)? } else { Grid::filled(depth.size(), 0.0) };
        for (x, y) in places(depth) {
            let (true_depth, found) = (depth[(x, y)], map[scaled((x, y), depth, &map)]);
            known += 1;
            let error = f64::from((found / true_depth - 1.0).abs());
            (0..5).for_each(|i| within[i] += usize::from(error <= thresholds[i]));
        }
    }
    scores.within = within.map(|count| count as f64 / known.max(1) as f64);
    let distances = thresholds.map(|share| share * median_depth(ground_truth));
    let points = thin(&surface(ground_truth), 0.5 * distances[0], 0)?;
    let judged = judged(ground_truth, cloud, HIDDEN * thresholds[4]);
    let errors = CloudDistances::between(&judged, &points).errors(&distances);
    for (i, agreement) in errors.agreement.iter().enumerate() {
        (scores.precision[i], scores.recall[i]) = (agreement.precision, agreement.recall);
    }
    Ok(scores)
}

/// The pixels with a known depth.
fn places(depth: &Grid<f32>) -> impl Iterator<Item = (usize, usize)> + '_ {
    let width = depth.width();
    let all = depth.data().iter().enumerate();
    all.filter(|(_, depth)| is_valid(**depth)).map(move |(at, _)| (at % width, at / width))
}

/// The pixel of another grid with the same field of view.
fn scaled<A, B>((x, y): (usize, usize), from: &Grid<A>, to: &Grid<B>) -> (usize, usize) {
    let at = |i: usize, from: usize, to: usize| ((2 * i + 1) * to / (2 * from)).min(to - 1);
    (at(x, from.width(), to.width()), at(y, from.height(), to.height()))
}

fn median_depth(ground_truth: &[TrueView]) -> f64 {
    let mut depths: Vec<f32> = ground_truth
        .iter()
        .flat_map(|view| view.depth.data())
        .copied()
        .filter(|depth| is_valid(*depth))
        .collect();
    depths.sort_by(f32::total_cmp);
    depths.get(depths.len() / 2).map_or(1.0, |&depth| f64::from(depth))
}

/// Points of the true surface in the world, one for each known pixel.
fn surface(ground_truth: &[TrueView]) -> Vec<[f64; 3]> {
    let of_view = |TrueView { shot, depth }: &TrueView| {
        let world_from_cam = shot.cam_from_world.inverse();
        let camera = shot.camera.resized(depth.size());
        let point = |(x, y): (usize, usize)| {
            let pixel = Vector2::new(x as f64 + 0.5, y as f64 + 0.5);
            world_from_cam.transform(&lift(&camera, &pixel, f64::from(depth[(x, y)]))).into()
        };
        places(depth).map(point).collect::<Vec<[f64; 3]>>()
    };
    ground_truth.iter().flat_map(of_view).collect()
}

/// The points of a cloud about which the ground truth says something: they are seen by a view that knows the depth there,
/// and are not hidden behind it.
fn judged(ground_truth: &[TrueView], cloud: &[CloudPoint], hidden: f64) -> Vec<[f64; 3]> {
    let is_known = |point: &Vector3<f64>| {
        ground_truth.iter().any(|TrueView { shot, depth }| {
            let Some((pixel, z)) = shot.pixel_of(&(*point).into()) else { return false };
            let true_depth = depth[scaled(pixel, &shot.photo, depth)];
            is_valid(true_depth) && z <= f64::from(true_depth) * (1.0 + hidden)
        })
    };
    let places = cloud.iter().map(|point| point.x_in_world);
    places.filter(|place| is_known(&Vector3::from(*place))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use vamvs_core::{Intrinsics, Pinhole, Pose, Size};

    #[test]
    fn a_plane_at_its_place_is_right_and_one_a_per_cent_off_is_within_two() {
        let size = Size::new(40, 30);
        let intrinsics = Intrinsics { fx: 400.0, fy: 400.0, cx: 20.0, cy: 15.0 };
        let shot = || Shot {
            name: "v".to_owned(),
            camera: Pinhole { size, intrinsics },
            cam_from_world: Pose::identity(),
            photo: Grid::filled(size, [0; 3]),
        };
        let ground_truth = [TrueView { shot: shot(), depth: Grid::filled(size, 4.0) }];
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("depths")).unwrap();
        let half = |x: usize, _| if x < 20 { 4.04 } else { 0.0 };
        let map = Grid::from_fn(size, half);
        pfm::write(&folder.path().join("depths/v.pfm"), &map).unwrap();
        let thresholds = [0.001, 0.002, 0.005, 0.0101, 0.02];
        let point = |depth: f64| {
            move |place: [f64; 3]| CloudPoint {
                x_in_world: place.map(|side| side * depth / 4.0),
                normal: [0.0, 0.0, -1.0],
                colour: [0; 3],
                confidence: 1.0,
                sigma: 0.0,
                views: 2,
            }
        };
        let places = surface(&ground_truth);
        let mut cloud: Vec<CloudPoint> = places.iter().take(600).copied().map(point(4.0)).collect();
        cloud.extend(places.iter().take(600).copied().map(point(3.5))); // before the surface: wrong
        cloud.extend(places.iter().copied().map(point(6.0))); // hidden behind it
        let found = scores(&ground_truth, folder.path(), &cloud, &thresholds).unwrap();
        assert_eq!(found.within, [0.0, 0.0, 0.0, 0.5, 0.5]);
        assert!((found.precision[0] - 0.5).abs() < 1e-9, "{found:?}");
        assert!((found.recall[0] - 0.5).abs() < 0.03 && found.f(0) > 0.48, "{found:?}");
    }
}
