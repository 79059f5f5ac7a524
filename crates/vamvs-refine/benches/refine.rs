//! Time to refine a depth map of 768×576 pixels with four source views, by number of threads: the photometric pass, which
//! stops at half the size as in use, and the geometric pass to full size. The source views' depth maps are their own.
#![allow(missing_docs, reason = "criterion's macros make undocumented functions")]

#[path = "../tests/common/mod.rs"]
mod common;

use common::{HERE, SIZE, enlarged, seed, sources, true_map};
use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use vamvs_core::{DepthMap, Size};
use vamvs_refine::{RefineOptions, refine, refine_geometric};

fn benchmarks(criterion: &mut Criterion) {
    let mut set = enlarged(common::sphere, HERE, 4);
    // Sensor noise; without it all planes would settle at once.
    let mut state = 1_u32;
    for value in set.photos.iter_mut().flat_map(|photo| photo.image.data_mut()) {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        *value = [value[0].saturating_add((state >> 28) as u8); 3];
    }
    let (mut options, seed) = (RefineOptions::default(), seed(&set));
    options.halvings = 1;
    let first = refine(&set.photos[0], &sources(&set), &seed, &[], &options).expect("the set fits together");
    let half = Size::new(2 * SIZE.width, 2 * SIZE.height);
    let maps: Vec<DepthMap> =
        set.photos[1..].iter().map(|photo| true_map(common::sphere, photo, half)).collect();
    let maps: Vec<Option<&DepthMap>> = maps.iter().map(Some).collect();
    let mut group = criterion.benchmark_group("refine");
    group.sample_size(10);
    for threads in [1, 2] {
        let pool =
            rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads can be started");
        group.bench_function(BenchmarkId::new("photometric", threads), |bencher| {
            bencher.iter(|| pool.install(|| refine(&set.photos[0], &sources(&set), &seed, &[], &options)));
        });
        group.bench_function(BenchmarkId::new("geometric", threads), |bencher| {
            let geometric =
                || refine_geometric(&set.photos[0], &sources(&set), &first.surface(), &maps, &options);
            bencher.iter(|| pool.install(geometric));
        });
    }
    group.finish();
}

criterion_group!(benches, benchmarks);
criterion_main!(benches);
