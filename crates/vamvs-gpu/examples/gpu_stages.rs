//! Time of a depth map on a GPU by stage, with the speed of the convolutions, and of both passes of refinement, on photographs of a
//! wall with a pattern: `cargo run --release -p vamvs-gpu --example gpu_stages -- WEIGHTS.safetensors WIDTH HEIGHT VIEWS PLANES GPU`, with the number of the GPU.

use std::sync::Mutex;
use std::time::{Duration, Instant};

use vamvs_core::{DepthMap, DepthRange, Grid, Intrinsics, Photo, Pinhole, Planes, Pose, Size, Spacing};
use vamvs_corr::Stage;
use vamvs_gpu::{Gpu, Network};
use vamvs_refine::matching::{Device, DeviceError, Matched, Matching};
use vamvs_refine::{RefineOptions, refine_geometric_on, refine_on};

/// The depth of the wall that the photographs show.
const WALL: f64 = 6.0;

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
    // What is between commas is read as lines of its own.
    println!("Adapter {}", network.gpu().adapter().name.replace(',', ""));
    println!("Encode {:.4} s {}", encode.as_secs_f64(), speed(encoding, encode));
    println!("Sweep {:.4} s", sweep.as_secs_f64());
    println!("Regularize {:.4} s {}", regularize.as_secs_f64(), speed(regularizing, regularize));
    println!("total {:.4} s", total.as_secs_f64());
    for (name, [matching, all]) in
        ["First-pass", "Geometric-pass"].iter().zip(refinement(network.gpu(), &photos))
    {
        println!("{name} {:.4} s matching of {:.4} s", matching.as_secs_f64(), all.as_secs_f64());
    }
}

/// A GPU that measures how long it matches planes.
#[derive(Debug)]
struct Measured<'a> {
    gpu: &'a Gpu,
    time: Mutex<Duration>,
}

impl Device for Measured<'_> {
    fn planes(&self, matching: &Matching<'_>) -> Result<Vec<Matched>, DeviceError> {
        let begin = Instant::now();
        let matched = self.gpu.planes(matching);
        *self.time.lock().expect("no run fails") += begin.elapsed();
        matched
    }
}

/// The times of the matching of both passes of refinement, and of all of them, of the shortest run.
fn refinement(gpu: &Gpu, photos: &[Photo]) -> [[Duration; 2]; 2] {
    let mut options = RefineOptions::default();
    options.halvings = 1;
    let sources: Vec<&Photo> = photos[1..].iter().collect();
    let seed = wall(&photos[0], 4);
    let maps: Vec<DepthMap> = photos[1..].iter().map(|photo| wall(photo, 2)).collect();
    let maps: Vec<Option<&DepthMap>> = maps.iter().map(Some).collect();
    let run = || {
        let device = Measured { gpu, time: Mutex::default() };
        let taken = |begin: Instant| {
            [std::mem::take(&mut *device.time.lock().expect("no run fails")), begin.elapsed()]
        };
        let begin = Instant::now();
        let first = refine_on(Some(&device), &photos[0], &sources, (&seed, &[]), &options).expect("a set");
        let of_first = taken(begin);
        let begin = Instant::now();
        let again = (&first.surface(), &maps[..]);
        refine_geometric_on(Some(&device), &photos[0], &sources, again, &options).expect("a set");
        [of_first, taken(begin)]
    };
    let runs = (0..RUNS).map(|_| run());
    runs.min_by_key(|[first, second]| first[1] + second[1]).expect("there are runs")
}

/// The depth map of the wall that the photographs show, so many times smaller.
fn wall(photo: &Photo, ratio: usize) -> DepthMap {
    let Size { width, height } = photo.camera.size;
    let camera = photo.camera.resized(Size::new(width / ratio, height / ratio));
    DepthMap {
        camera,
        cam_from_world: photo.cam_from_world,
        depth: Grid::filled(camera.size, WALL as f32),
        confidence: Grid::filled(camera.size, 1.0),
        coarse_confidence: None,
    }
}

/// A photograph of a wall with a pattern, from a camera beside the others.
fn photo(size: Size, view: usize) -> Photo {
    let focal = size.width as f64;
    let intrinsics = Intrinsics { fx: focal, fy: focal, cx: 0.5 * focal, cy: 0.5 * size.height as f64 };
    let mut cam_from_world = Pose::identity();
    cam_from_world.translation.x = -0.3 * view as f64;
    let shift = 0.3 * view as f64 * focal / WALL;
    let image = Grid::from_fn(size, |x, y| {
        let (x, y) = (x as f64 + shift, y as f64);
        let wave = (0.31 * x).sin() + (0.23 * y + 0.1 * x).cos() + (0.77 * x + 0.53 * y).sin();
        [(127.0 + 40.0 * wave) as u8; 3]
    });
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
