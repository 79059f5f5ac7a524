//! The network on a GPU beside the same on the processor. Where there is no GPU, not even a software one, nothing is tested, which is
//! said.

use vamvs_core::roi::PixelBox;
use vamvs_core::{DepthRange, Grid, Intrinsics, Photo, Pinhole, Planes, Pose, Size, Spacing};
use vamvs_corr::{Estimate, Network};
use vamvs_gpu::{Gpu, GpuError, adapters};

/// Photographs of a wall with blotches, five units away, from cameras side by side.
fn photos(size: Size, count: usize) -> Vec<Photo> {
    let focal = size.width as f64;
    let intrinsics = Intrinsics { fx: focal, fy: focal, cx: 0.5 * focal, cy: 0.5 * size.height as f64 };
    let shade = |x: f64, y: f64, phase: f64| {
        (127.0 + 60.0 * (0.31 * x + phase).sin() + 60.0 * (0.23 * y - phase * x).cos()) as u8
    };
    let photo = |view: usize| {
        let mut cam_from_world = Pose::identity();
        cam_from_world.translation.x = -0.25 * view as f64;
        let shift = 0.25 * view as f64 * focal / 5.0;
        let image =
            Grid::from_fn(size, |x, y| [0.1, 0.5, 0.9].map(|phase| shade(x as f64 + shift, y as f64, phase)));
        Photo { camera: Pinhole { size, intrinsics }, cam_from_world, image, mask: None }
    };
    (0..count).map(photo).collect()
}

fn planes(count: usize, spacing: Spacing) -> Planes {
    Planes { range: DepthRange { near: 3.0, far: 12.0 }, count, spacing }
}

fn network() -> Network {
    Network::new(vamvs_weights::VIS_CORR).expect("the built-in weights")
}

/// The first adapter, whatever it is, or a line that says that nothing is tested.
fn gpu(largest_buffer: u64) -> Option<Gpu> {
    if adapters().is_empty() {
        println!("no GPU, not even a software one: nothing is tested");
        return None;
    }
    Some(Gpu::open_within(Some(0), largest_buffer).expect("the first GPU"))
}

fn on_processor(photos: &[Photo], planes: &Planes) -> Estimate {
    let network = network();
    let encoded: Vec<_> = photos.iter().map(|photo| network.encode(photo).expect("a photograph")).collect();
    let sources: Vec<_> = encoded[1..].iter().collect();
    network.estimate(&encoded[0], &sources, planes, &mut |_, run| run()).expect("a depth map")
}

/// The share of pixels whose values differ by more than `tolerance`.
fn apart(a: &Grid<f32>, b: &Grid<f32>, tolerance: impl Fn(f32) -> f32) -> f64 {
    assert_eq!(a.size(), b.size());
    let differ = a.data().iter().zip(b.data()).filter(|&(a, b)| (a - b).abs() > tolerance(*a));
    differ.count() as f64 / a.data().len() as f64
}

fn assert_alike(gpu: &Estimate, processor: &Estimate, what: &str) {
    let depth = apart(&processor.map.depth, &gpu.map.depth, |depth| 1e-5 * depth);
    assert!(depth <= 0.005, "{what}: {:.2} % of the depths differ by more than 10⁻⁵", 100.0 * depth);
    let confidence = apart(&processor.map.confidence, &gpu.map.confidence, |_| 1e-3);
    assert!(confidence <= 0.005, "{what}: {:.2} % of the confidences differ", 100.0 * confidence);
    let surface = apart(&processor.surface, &gpu.surface, |_| 1e-3);
    assert!(surface <= 0.005, "{what}: {:.2} % of the surfaces differ", 100.0 * surface);
    assert_eq!(gpu.visibility.len(), processor.visibility.len());
    for (a, b) in gpu.visibility.iter().zip(&processor.visibility) {
        let seen = apart(b, a, |_| 1e-3);
        assert!(seen <= 0.001, "{what}: visibility differs in {:.2} %", 100.0 * seen);
    }
    assert_eq!(gpu.map.camera, processor.map.camera);
}

#[test]
fn depth_maps_are_those_of_the_processor() {
    let Some(gpu) = gpu(u64::MAX) else { return };
    let on_gpu = vamvs_gpu::Network::new(gpu, &network()).expect("the network");
    // Sides and planes that are multiples of 8 and such that are not, both spacings, one source and three.
    for (size, views, planes) in [
        (Size::new(128, 96), 4, planes(24, Spacing::InverseDepth)),
        (Size::new(107, 83), 2, planes(21, Spacing::Depth)),
    ] {
        let photos = photos(size, views);
        let encoded: Vec<_> = photos.iter().map(|photo| on_gpu.encode(photo).expect("features")).collect();
        let sources: Vec<_> = encoded[1..].iter().collect();
        let found = on_gpu.estimate(&encoded[0], &sources, &planes, &mut |_, run| run());
        let found = found.expect("a depth map");
        let depths = found.map.depth.data();
        let near = depths.iter().filter(|depth| (**depth - 5.0).abs() < 0.25).count();
        // With one source the blotches, which repeat, may match at other depths too.
        let is_wall = views == 2 || near as f64 > 0.7 * depths.len() as f64;
        assert!(is_wall, "{near} of {} depths are the wall's", depths.len());
        assert_alike(&found, &on_processor(&photos, &planes), &format!("{size}"));
    }
}

#[test]
fn a_region_is_that_of_the_processor() {
    let Some(gpu) = gpu(u64::MAX) else { return };
    let (network, photos, planes) =
        (network(), photos(Size::new(128, 96), 3), planes(24, Spacing::InverseDepth));
    let on_gpu = vamvs_gpu::Network::new(gpu, &network).expect("the network");
    let region = PixelBox { x0: 30, y0: 20, x1: 101, y1: 90 };
    let encoded: Vec<_> = photos.iter().map(|photo| on_gpu.encode(photo).expect("features")).collect();
    let (part, place) = encoded[0].cropped(on_gpu.gpu(), &region).expect("inside");
    let sources: Vec<_> = encoded[1..].iter().collect();
    let found = on_gpu.estimate(&part, &sources, &planes, &mut |_, run| run()).expect("a depth map");
    let expected: Vec<_> = photos.iter().map(|photo| network.encode(photo).expect("features")).collect();
    let (part, expected_place) = expected[0].cropped(&region).expect("inside");
    let sources: Vec<_> = expected[1..].iter().collect();
    let expected = network.estimate(&part, &sources, &planes, &mut |_, run| run()).expect("a depth map");
    assert_eq!(place, expected_place);
    assert_alike(&found, &expected, "a region");
}

#[test]
fn what_is_too_large_or_too_small_is_told() {
    let Some(gpu) = gpu(200_000) else { return };
    let name = gpu.adapter().name.clone();
    let Err(error) = vamvs_gpu::Network::new(gpu, &network()) else { panic!("weights of 442 KB do not fit") };
    assert!(matches!(&error, GpuError::Memory { .. }) && error.to_string().contains(&name), "{error}");
    let gpu = Gpu::open(Some(0)).expect("the first GPU");
    let on_gpu = vamvs_gpu::Network::new(gpu, &network()).expect("the network");
    let error = on_gpu.encode(&photos(Size::new(31, 64), 1)[0]).err().expect("too small");
    assert!(error.to_string().contains("32×32"), "{error}");
    let error = Gpu::open(Some(1000)).expect_err("there are no thousand GPUs");
    assert!(error.to_string().contains("no GPU 1000") && error.to_string().contains("gpu:0"), "{error}");
}
