//! Time to decode a JPEG photograph of 12 megapixels and reduce it to 2000 and to 1000 pixels: from all its pixels, and
//! decoded at 1/2 and 1/4 of its size.
#![allow(missing_docs, reason = "criterion's macros make undocumented functions")]

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use vamvs_core::{Camera, Grid, Intrinsics, Lens, Size};
use vamvs_io::{atomic, image};

const SIZE: Size = Size::new(4000, 3000);

fn photograph(criterion: &mut Criterion) {
    let mut noise = 1_u32;
    let pixels = Grid::from_fn(SIZE, |x, y| {
        noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let grey = 120.0 + 60.0 * (x as f32 / 37.0).sin() + 40.0 * (y as f32 / 23.0).cos();
        [grey as u8 + (noise >> 28) as u8; 3]
    });
    let folder = tempfile::tempdir().expect("there is room for temporary files");
    let path = folder.path().join("a.jpg");
    atomic::write(&path, |out| out.write_all(&image::jpeg_rgb(&pixels, 92))).expect("there is room for it");
    let intrinsics = Intrinsics { fx: 3000.0, fy: 3000.0, cx: 2000.0, cy: 1500.0 };
    let camera = Camera { size: SIZE, intrinsics, lens: Lens::None };
    let mut group = criterion.benchmark_group("photograph");
    group.sample_size(10);
    for width in [2000, 1000] {
        for (name, least) in [("whole", usize::MAX), ("reduced", width)] {
            group.bench_function(BenchmarkId::new(name, width), |bencher| {
                bencher.iter(|| {
                    let loaded = image::load_for_camera(&path, &camera, &|_| least, None)
                        .expect("the JPEG is sound")
                        .0;
                    let to = Size::new(width, width * 3 / 4);
                    black_box(if loaded.rgb.size() == to {
                        loaded.rgb
                    } else {
                        image::resize(&loaded.rgb, to)
                    })
                });
            });
        }
    }
    group.finish();
}

criterion_group!(benches, photograph);
criterion_main!(benches);
