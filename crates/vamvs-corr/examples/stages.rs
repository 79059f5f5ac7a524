//! Time of a depth map by stage, on photographs of a pattern:
//! `cargo run --release -p vamvs-corr --example stages -- WEIGHTS.safetensors WIDTH HEIGHT VIEWS PLANES`.

use std::time::{Duration, Instant};

use vamvs_core::{DepthRange, Grid, Intrinsics, Photo, Pinhole, Planes, Pose, Size, Spacing};
use vamvs_corr::{Network, Stage};

/// The shortest of so many runs counts.
const RUNS: usize = 3;

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    assert_eq!(arguments.len(), 5, "expected WEIGHTS.safetensors WIDTH HEIGHT VIEWS PLANES");
    let numbers: Vec<usize> = arguments[1..].iter().map(|text| text.parse().expect("a number")).collect();
    let [width, height, views, planes] = numbers[..] else { unreachable!("there are four numbers") };
    let weights = std::fs::read(&arguments[0]).expect("the weights can be read");
    let network = Network::new(&weights).expect("the weights are those of a vis-corr");
    let photos: Vec<Photo> = (0..views).map(|view| photo(Size::new(width, height), view)).collect();
    let range = DepthRange { near: 4.0, far: 12.0 };
    let planes = Planes { range, count: planes, spacing: Spacing::InverseDepth };
    let best = (0..RUNS)
        .map(|_| times(&network, &photos, &planes))
        .min_by_key(|times| times.iter().sum::<Duration>());
    let [encode, sweep, regularize, rest] = best.expect("there are runs");
    let total: Duration = [encode, sweep, regularize, rest].iter().sum();
    for (name, time) in [("Encode", encode), ("Sweep", sweep), ("Regularize", regularize), ("total", total)] {
        println!("{name} {:.3} s", time.as_secs_f64());
    }
}

/// A photograph of a pattern, from a camera beside the others.
fn photo(size: Size, view: usize) -> Photo {
    let focal = size.width as f64;
    let intrinsics = Intrinsics { fx: focal, fy: focal, cx: 0.5 * focal, cy: 0.5 * size.height as f64 };
    let mut cam_from_world = Pose::identity();
    cam_from_world.translation.x = -0.3 * view as f64;
    let image = Grid::from_fn(size, |x, y| [(x * 7 + y * 13 + view) as u8, (x * y) as u8, (x ^ y) as u8]);
    Photo { camera: Pinhole { size, intrinsics }, cam_from_world, image, mask: None }
}

/// The times of encoding all photographs, of both sweeps, of both regularisations, and of the rest.
fn times(network: &Network, photos: &[Photo], planes: &Planes) -> [Duration; 4] {
    let begin = Instant::now();
    let encoded: Vec<_> = photos.iter().map(|photo| network.encode(photo).expect("a photograph")).collect();
    let encode = begin.elapsed();
    let sources: Vec<_> = encoded[1..].iter().collect();
    let (mut sweep, mut regularize) = (Duration::ZERO, Duration::ZERO);
    let mut time = |stage, run: &mut dyn FnMut()| {
        let begin = Instant::now();
        run();
        match stage {
            Stage::Sweep => sweep += begin.elapsed(),
            Stage::Regularize => regularize += begin.elapsed(),
        }
    };
    let begin = Instant::now();
    network.estimate(&encoded[0], &sources, planes, &mut time).expect("there are sources and planes");
    let rest = begin.elapsed() - sweep - regularize;
    [encode, sweep, regularize, rest]
}
