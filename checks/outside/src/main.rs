//! A program outside the workspace that embeds vamvs. It cancels a run, reconstructs a scene in memory, and prints one
//! line at the end. `cargo xtask publish-check` runs it and fails if it prints anything else.
//!
//! The scene is a patterned wall 4 m away, seen by six cameras. Without the feature `net` the true depth maps are fused
//! instead of estimated ones.

use std::error::Error;
use std::ops::ControlFlow;

use vamvs::core::{Camera, Cloud, Grid, Intrinsics, Lens, Pose, Rgb, Scene, Size, View};
use vamvs::nalgebra::Vector3;
use vamvs::{FusionOptions, VamvsError, ViewMap, fuse_in_memory};

type Result<T> = std::result::Result<T, Box<dyn Error>>;

const SIZE: Size = Size::new(320, 240);

const CAMERA: Camera = Camera {
    size: SIZE,
    intrinsics: Intrinsics { fx: 300.0, fy: 300.0, cx: 160.0, cy: 120.0 },
    lens: Lens::None,
};

/// Distance of the wall from the cameras (the plane z = 4), metres.
const DISTANCE: f64 = 4.0;

fn main() -> Result<()> {
    let scene = scene();
    cancel_fusion(&exact(&scene))?;
    #[cfg(feature = "torch")]
    let maps = network::maps(&scene)?;
    #[cfg(not(feature = "torch"))]
    let maps = exact(&scene);
    let cloud = fuse_in_memory(&maps, &FusionOptions::default(), &mut |_| ControlFlow::Continue(()))?;
    println!("{} points, median error {:.4} m", cloud.len(), median_error(&cloud));
    Ok(())
}

fn scene() -> Scene {
    let eyes = (0..6).map(|n| Vector3::new(0.25 * f64::from(n % 3), 0.25 * f64::from(n / 3), 0.0));
    let views = eyes.enumerate().map(|(n, eye)| View {
        id: n as u32,
        name: format!("view-{n}"),
        camera: CAMERA,
        cam_from_world: Pose { translation: -eye, ..Pose::identity() },
        depth_range: None,
    });
    Scene { views: views.collect(), points: Vec::new(), pairs: None }
}

/// The photograph of the wall from a view.
fn image(view: &View) -> Grid<Rgb> {
    let (eye, camera) = (view.cam_from_world.centre(), CAMERA.intrinsics);
    Grid::from_fn(SIZE, |x, y| {
        let along = |at: usize, centre: f64, focal: f64| (at as f64 + 0.5 - centre) / focal * DISTANCE;
        pattern(eye.x + along(x, camera.cx, camera.fx), eye.y + along(y, camera.cy, camera.fy))
    })
}

/// The wall's colour at (x, y), metres.
fn pattern(x: f64, y: f64) -> Rgb {
    let wave = |a: f64, b: f64, c: f64| (a * x + b * y + c * (3.0 * x * y).sin()).sin();
    [wave(23.0, 7.0, 2.0), wave(-9.0, 31.0, 3.0), wave(41.0, 37.0, 1.0)].map(|v| (128.0 + 100.0 * v) as u8)
}

/// The true depth maps, with a confidence of 1.
fn exact(scene: &Scene) -> Vec<ViewMap> {
    let map = |(number, view): (usize, &View)| ViewMap {
        name: view.name.clone(),
        view: number,
        map: vamvs::core::DepthMap {
            camera: vamvs::core::Pinhole { size: SIZE, intrinsics: CAMERA.intrinsics },
            cam_from_world: view.cam_from_world,
            depth: Grid::from_fn(SIZE, |_, _| DISTANCE as f32),
            confidence: Grid::from_fn(SIZE, |_, _| 1.0),
            coarse_confidence: None,
        },
        normals: None,
        sigma: None,
        colour: image(view),
        neighbours: Vec::new(),
    };
    scene.views.iter().enumerate().map(map).collect()
}

/// Cancels a fusion at its first event, which must give [`VamvsError::Cancelled`].
fn cancel_fusion(maps: &[ViewMap]) -> Result<()> {
    match fuse_in_memory(maps, &FusionOptions::default(), &mut |_| ControlFlow::Break(())) {
        Err(VamvsError::Cancelled) => Ok(()),
        other => Err(format!("expected a cancelled fusion, found {other:?}").into()),
    }
}

fn median_error(cloud: &Cloud) -> f64 {
    let mut errors: Vec<f64> = cloud.iter().map(|point| (point.x_in_world[2] - DISTANCE).abs()).collect();
    errors.sort_unstable_by(f64::total_cmp);
    errors.get(errors.len() / 2).copied().unwrap_or(f64::NAN)
}

#[cfg(feature = "torch")]
mod network {
    use vamvs::{Picture, PhotoSource, Reconstruction};

    use super::*;

    struct Wall;

    impl PhotoSource for Wall {
        fn picture(&self, view: &View) -> std::result::Result<Picture, Box<dyn Error + Send + Sync>> {
            Ok(Picture { image: image(view), mask: None })
        }
    }

    /// The depth maps that vis-corr estimates, after a first run that is cancelled at its first event.
    pub fn maps(scene: &Scene) -> Result<Vec<ViewMap>> {
        let run = || Reconstruction::with_photographs(scene.clone(), Wall).weights("vis-corr");
        let cancelled = run().prepare(&mut |_| ControlFlow::Continue(()))?;
        let first = cancelled.depth_maps(Box::new(|_| ControlFlow::Break(()))).next();
        if !matches!(first, Some(Err(VamvsError::Cancelled))) {
            return Err("expected a cancelled run".into());
        }
        let work = run().prepare(&mut |_| ControlFlow::Continue(()))?;
        let maps = work.depth_maps(Box::new(|_| ControlFlow::Continue(())));
        Ok(maps.collect::<std::result::Result<_, _>>()?)
    }
}
