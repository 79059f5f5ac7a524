//! Time of a depth map on a GPU by stage, with the speed of the convolutions, on photographs of a pattern:
//! `cargo run --release -p vamvs-gpu --example stages -- WEIGHTS.safetensors WIDTH HEIGHT VIEWS PLANES GPU`, with the number of the GPU.

use std::time::{Duration, Instant};

use vamvs_core::{DepthRange, Grid, Intrinsics, Photo, Pinhole, Planes, Pose, Size, Spacing};
use vamvs_corr::Stage;
use vamvs_gpu::{Gpu, Network};

/// The shortest of so many runs counts.
const RUNS: usize = 3;

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    assert_eq!(arguments.len(), 6, "expected WEIGHTS.safetensors WIDTH HEIGHT VIEWS PLANES GPU");
    let numbers: Vec<usize> = arguments[1..].iter().map(|text| text.parse().expect("a number")).collect();
    let [width, height, views, planes, number] = numbers[..] else { unreachable!("there are five numbers") };
    let weights = std::fs::read(&arguments[0]).expect("the weights can be read");
    let network = vamvs_corr::Network::new(&weights).expect("the weights are those of a vis-corr");
    let network = Network::new(Gpu::open(Some(number)).expect("a GPU"), &network).expect("the network");
    let photos: Vec<Photo> = (0..views).map(|view| photo(Size::new(width, height), view)).collect();
    let range = DepthRange { near: 4.0, far: 12.0 };
    let planes = Planes { range, count: planes, spacing: Spacing::InverseDepth };
    let runs = (0..RUNS).map(|_| times(&network, &photos, &planes));
    let best = runs.min_by_key(|(times, _)| times.iter().sum::<Duration>()).expect("there are runs");
    let ([encode, sweep, regularize, rest], [encoding, regularizing]) = best;
    let total: Duration = [encode, sweep, regularize, rest].iter().sum();
    let speed = |operations: u64, time: Duration| {
        let operations = operations as f64 / 1e9;
        format!("{operations:.1} GFLOP {:.0} GFLOP/s", operations / time.as_secs_f64())
    };
    println!("Adapter {}", network.gpu().adapter().name);
    println!("Encode {:.4} s {}", encode.as_secs_f64(), speed(encoding, encode));
    println!("Sweep {:.4} s", sweep.as_secs_f64());
    println!("Regularize {:.4} s {}", regularize.as_secs_f64(), speed(regularizing, regularize));
    println!("total {:.4} s", total.as_secs_f64());
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

/// The times of encoding all photographs, of both sweeps, of both regularisations, and of the rest, and the operations of the
/// convolutions of encoding and of regularising.
fn times(network: &Network, photos: &[Photo], planes: &Planes) -> ([Duration; 4], [u64; 2]) {
    let (begin, before) = (Instant::now(), network.gpu().operations());
    let encoded: Vec<_> = photos.iter().map(|photo| network.encode(photo).expect("a photograph")).collect();
    let (encode, encoding) = (begin.elapsed(), network.gpu().operations() - before);
    let sources: Vec<_> = encoded[1..].iter().collect();
    let (mut sweep, mut regularize, mut regularizing) = (Duration::ZERO, Duration::ZERO, 0);
    let mut time = |stage, run: &mut dyn FnMut()| {
        let (begin, before) = (Instant::now(), network.gpu().operations());
        run();
        match stage {
            Stage::Sweep => sweep += begin.elapsed(),
            Stage::Regularize => {
                regularize += begin.elapsed();
                regularizing += network.gpu().operations() - before;
            }
        }
    };
    let begin = Instant::now();
    network.estimate(&encoded[0], &sources, planes, &mut time).expect("there are sources and planes");
    let rest = begin.elapsed() - sweep - regularize;
    ([encode, sweep, regularize, rest], [encoding, regularizing])
}
