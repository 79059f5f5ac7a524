//! Prints the machine's own speed with libtorch on all its cores, so that times of different machines can be compared: a matrix
//! product, a copy of memory, and a 3D convolution like those of the cost volume's regularisation.

use std::time::Instant;

use vamvs_net::tch::{Device, Kind, Tensor, no_grad};

/// Runs of each; the fastest counts.
const RUNS: usize = 5;

fn main() {
    no_grad(|| {
        println!("product {:.0} GFLOP/s", product() / 1e9);
        println!("copy {:.1} GB/s", copy() / 1e9);
        println!("convolution {:.0} GFLOP/s", convolution() / 1e9);
    });
}

/// Seconds of the fastest run.
fn fastest(mut work: impl FnMut()) -> f64 {
    let time = |_| {
        let begin = Instant::now();
        work();
        begin.elapsed().as_secs_f64()
    };
    (0..RUNS).map(time).fold(f64::INFINITY, f64::min)
}

fn random(size: &[i64]) -> Tensor {
    Tensor::rand(size, (Kind::Float, Device::Cpu))
}

/// A product of two matrices of 2048×2048 numbers, operations a second.
fn product() -> f64 {
    let side = 2048_i64;
    let (a, b) = (random(&[side, side]), random(&[side, side]));
    2.0 * (side as f64).powi(3) / fastest(|| drop(a.matmul(&b)))
}

/// A copy of 256 MiB into memory that is there already, bytes copied a second.
fn copy() -> f64 {
    let from = random(&[64 << 20]);
    let mut to = from.copy();
    (256 << 20) as f64 / fastest(|| to.copy_(&from))
}

/// 8 channels to 8 with kernels of 3×3×3, on 48 planes of 160×128, operations a second.
fn convolution() -> f64 {
    let (channels, cells) = (8_i64, [48_i64, 128, 160]);
    let volume = random(&[1, channels, cells[0], cells[1], cells[2]]);
    let kernel = random(&[channels, channels, 3, 3, 3]);
    let convolve = || drop(volume.conv3d::<&Tensor>(&kernel, None, [1; 3], [1; 3], [1; 3], 1));
    let operations = 2 * channels * channels * 27 * cells.iter().product::<i64>();
    operations as f64 / fastest(convolve)
}
