//! Times of the stages on photographs of noise: `cargo run --release -p vamvs-corr --example stages -- WEIGHTS WIDTH HEIGHT PLANES VIEWS`.

use std::time::Instant;

use vamvs_core::{DepthRange, Grid, Intrinsics, Photo, Pinhole, Planes, Pose, Size, Spacing};
use vamvs_corr::Network;

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let number = |at: usize| arguments[at].parse::<usize>().expect("a number");
    let network = Network::new(&std::fs::read(&arguments[0]).expect("weights")).expect("weights");
    let (size, planes, views) = (Size::new(number(1), number(2)), number(3), number(4));
    let focal = size.width as f64;
    let intrinsics = Intrinsics { fx: focal, fy: focal, cx: 0.5 * focal, cy: 0.5 * size.height as f64 };
    let photo = |view: usize| {
        let mut cam_from_world = Pose::identity();
        cam_from_world.translation.x = -0.3 * view as f64;
        let image = Grid::from_fn(size, |x, y| [(x * 7 + y * 13 + view) as u8, (x * y) as u8, (x ^ y) as u8]);
        Photo { camera: Pinhole { size, intrinsics }, cam_from_world, image, mask: None }
    };
    let range = DepthRange { near: 4.0, far: 12.0 };
    let planes = Planes { range, count: planes, spacing: Spacing::InverseDepth };
    for _ in 0..2 {
        let begin = Instant::now();
        let encoded: Vec<_> = (0..views).map(|view| network.encode(&photo(view)).expect("encoded")).collect();
        println!("encode a view {:.3} s", begin.elapsed().as_secs_f64() / views as f64);
        let sources: Vec<_> = encoded[1..].iter().collect();
        let begin = Instant::now();
        let mut time = |stage, run: &mut dyn FnMut()| {
            let begin = Instant::now();
            run();
            println!("  {stage:?} {:.3} s", begin.elapsed().as_secs_f64());
        };
        network.estimate(&encoded[0], &sources, &planes, &mut time).expect("estimated");
        println!("estimate {:.3} s", begin.elapsed().as_secs_f64());
    }
}
