//! Photographs, depth maps and cloud in memory: no file is read or written.
//! `cargo run --release -p vamvs --example in_memory`
//!
//! The photographs are drawn: a wall with a pattern, 4 m away, seen from six places.

use std::error::Error;
use std::ops::ControlFlow;

use vamvs::core::{Camera, Grid, Intrinsics, Lens, Pose, Rgb, Scene, Size, View};
use vamvs::nalgebra::Vector3;
use vamvs::{Event, FusionOptions, PhotoSource, Picture, Reconstruction, fuse_in_memory};

const CAMERA: Camera = Camera {
    size: Size::new(320, 240),
    intrinsics: Intrinsics { fx: 300.0, fy: 300.0, cx: 160.0, cy: 120.0 },
    lens: Lens::None,
};

/// How far the wall is, metres.
const DISTANCE: f64 = 4.0;

/// Draws the wall as a view sees it.
struct Wall;

impl PhotoSource for Wall {
    fn picture(&self, view: &View) -> Result<Picture, Box<dyn Error + Send + Sync>> {
        let eye = view.cam_from_world.centre();
        let Camera { size, intrinsics: camera, .. } = view.camera;
        let image = Grid::from_fn(size, |x, y| {
            let along = |at: usize, centre: f64, focal: f64| (at as f64 + 0.5 - centre) / focal * DISTANCE;
            pattern(eye.x + along(x, camera.cx, camera.fx), eye.y + along(y, camera.cy, camera.fy))
        });
        Ok(Picture { image, mask: None })
    }
}

/// The wall's colour at a place, metres.
fn pattern(x: f64, y: f64) -> Rgb {
    let wave = |a: f64, b: f64, c: f64| (a * x + b * y + c * (3.0 * x * y).sin()).sin();
    [wave(23.0, 7.0, 2.0), wave(-9.0, 31.0, 3.0), wave(41.0, 37.0, 1.0)].map(|v| (128.0 + 100.0 * v) as u8)
}

fn main() -> Result<(), Box<dyn Error>> {
    let eyes = (0..6).map(|n| Vector3::new(0.25 * f64::from(n % 3), 0.25 * f64::from(n / 3), 0.0));
    let views = eyes.enumerate().map(|(n, eye)| View {
        id: n as u32,
        name: format!("view-{n}"),
        camera: CAMERA,
        cam_from_world: Pose { translation: -eye, ..Pose::identity() },
        depth_range: None,
    });
    let scene = Scene { views: views.collect(), points: Vec::new(), pairs: None };
    let mut show = |event: Event| {
        eprintln!("{event:?}");
        ControlFlow::Continue(())
    };
    let work = Reconstruction::with_photographs(scene, Wall).weights("vis-corr").prepare(&mut show)?;
    let mut maps = Vec::new();
    for map in work.depth_maps(Box::new(show)) {
        let map = map?;
        println!(
            "{}: {} pixels have a depth",
            map.name,
            map.map.depth.data().iter().filter(|z| **z > 0.0).count()
        );
        maps.push(map);
    }
    let cloud = fuse_in_memory(&maps, &FusionOptions::default(), &mut show)?;
    let mut errors: Vec<f64> = cloud.iter().map(|point| (point.x_in_world[2] - DISTANCE).abs()).collect();
    errors.sort_unstable_by(f64::total_cmp);
    println!(
        "{} points, median error {:.4} m",
        cloud.len(),
        errors.get(errors.len() / 2).unwrap_or(&f64::NAN)
    );
    Ok(())
}
