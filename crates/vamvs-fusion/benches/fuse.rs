//! Depth pixels fused a second: nine 640×480 maps in memory, each compared with the eight others.

#[path = "../tests/synthetic/mod.rs"]
mod synthetic;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use synthetic::{Surface, all_others, views};
use vamvs_core::Size;
use vamvs_fusion::{FuseJob, FuseOptions, fuse_to_cloud};

fn fusion(criterion: &mut Criterion) {
    let size = Size::new(640, 480);
    let views = views(Surface::SphereOnPlane, 9, size, 4.0);
    let neighbours = all_others(views.len());
    let options = FuseOptions::default();
    let job = FuseJob {
        source: &views[..],
        neighbours: &neighbours,
        options: &options,
        roi: None,
        memory: usize::MAX / 2,
    };
    let mut group = criterion.benchmark_group("fuse");
    group.sample_size(10).throughput(Throughput::Elements((views.len() * size.area()) as u64));
    group.bench_function("9 views of 640x480, 8 sources each", |b| b.iter(|| fuse_to_cloud(&job)));
    group.finish();
}

criterion_group!(benches, fusion);
criterion_main!(benches);
