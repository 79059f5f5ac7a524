//! Speed of the neighbour search in the paper's setting: 5 hypotheses per pixel, 5×5 windows, 16
//! neighbours.
//!
//! The points come from a wavy, noisy depth map. Throughput is in points.

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use vamvs_core::window_knn::WindowKnn;

const WIDTH: usize = 320;
const HEIGHT: usize = 240;
const HYPOTHESES: usize = 5;

/// Hypotheses along the rays of a depth map: index `(y * WIDTH + x) * HYPOTHESES + j`.
fn points() -> Vec<[f32; 3]> {
    let mut noise = 1_u32;
    let mut points = Vec::with_capacity(WIDTH * HEIGHT * HYPOTHESES);
    for (y, x) in (0..HEIGHT).flat_map(|y| (0..WIDTH).map(move |x| (y, x))) {
        noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let depth = 4.0 + (0.1 * x as f32).sin() + 0.02 * (noise >> 16) as f32 / 65_536.0;
        let ray = [(x as f32 - 160.0) / 300.0, (y as f32 - 120.0) / 300.0, 1.0];
        points.extend((-2..=2).map(|j| ray.map(|r| r * (depth + 0.01 * j as f32))));
    }
    points
}

fn window_knn(c: &mut Criterion) {
    let points = points();
    let mut out = vec![0; points.len() * 16];
    let mut group = c.benchmark_group("window_knn");
    group.throughput(Throughput::Elements(points.len() as u64)).sample_size(10);
    for dilation in [1, 2, 4] {
        let search = WindowKnn { k: 16, radius: 2, dilation };
        group.bench_function(format!("dilation {dilation}"), |b| {
            b.iter(|| search.neighbours(black_box(&points), WIDTH, HEIGHT, HYPOTHESES, &mut out));
        });
    }
    group.finish();
}

criterion_group!(benches, window_knn);
criterion_main!(benches);
