//! Speed of comparing and thinning clouds.

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use rand::{RngExt, SeedableRng};
use vamvs_eval::{CloudDistances, thin};

const POINTS: usize = 200_000;

/// Points on a sphere of radius 100 mm with a roughness of 1 mm, on average 0.8 mm apart.
fn sphere(seed: u64) -> Vec<[f64; 3]> {
    let mut random = rand_pcg::Pcg64::seed_from_u64(seed);
    let point = |random: &mut rand_pcg::Pcg64| {
        let (z, angle): (f64, f64) =
            (2.0 * random.random::<f64>() - 1.0, std::f64::consts::TAU * random.random::<f64>());
        let (radius, flat) = (100.0 + random.random::<f64>(), (1.0 - z * z).sqrt());
        [radius * flat * angle.cos(), radius * flat * angle.sin(), radius * z]
    };
    (0..POINTS).map(|_| point(&mut random)).collect()
}

fn clouds(c: &mut Criterion) {
    let (cloud, ground_truth) = (sphere(1), sphere(2));
    let mut group = c.benchmark_group("cloud");
    group.sample_size(10).throughput(Throughput::Elements(POINTS as u64));
    let distances = || CloudDistances::between(black_box(&cloud), &ground_truth);
    group.bench_function("distances both ways", |b| b.iter(distances));
    let thinned = || thin(black_box(&cloud), 1.3, 0);
    group.bench_function("thin", |b| b.iter(thinned));
    group.finish();
}

criterion_group!(benches, clouds);
criterion_main!(benches);
