//! vis-corr in Rust alone (`vamvs_corr`) is the network that libtorch runs.

use vamvs_core::roi::PixelBox;
use vamvs_core::{Grid, Size, Spacing};
use vamvs_corr::{Estimate, Network};
use vamvs_net::Profile;
use vamvs_net::tch::no_grad;
use vamvs_tests::{Rendered, fixtures};

use crate::{estimator, planes};

fn network() -> Network {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../weights/vis-corr.safetensors");
    Network::new(&std::fs::read(path).unwrap()).unwrap()
}

fn estimate(network: &Network, views: &[Rendered], spacing: Spacing, region: Option<PixelBox>) -> Estimate {
    let encoded: Vec<_> = views.iter().map(|view| network.encode(&view.photo).unwrap()).collect();
    let sources: Vec<_> = encoded[1..].iter().collect();
    let planes = vamvs_core::Planes { spacing, ..planes(&views[0], 40) };
    let reference = region.map_or(encoded[0].clone(), |region| encoded[0].cropped(&region).unwrap().0);
    network.estimate(&reference, &sources, &planes, &mut |_, run| run()).unwrap()
}

/// The largest and the mean difference of two maps.
fn difference(a: &Grid<f32>, b: &Grid<f32>) -> (f32, f32) {
    assert_eq!(a.size(), b.size());
    let differences = || a.data().iter().zip(b.data()).map(|(a, b)| (a - b).abs());
    (differences().fold(0.0, f32::max), differences().sum::<f32>() / a.data().len() as f32)
}

/// The share of pixels whose depths differ by more than 1e-4 of the depth.
fn share_of_others(a: &Grid<f32>, b: &Grid<f32>) -> f64 {
    let others = a.data().iter().zip(b.data()).filter(|(a, b)| (*a - *b).abs() > 1e-4 * b.abs());
    others.count() as f64 / a.data().len() as f64
}

/// Sides that need padding at every level, with both spacings; whole maps and parts.
#[test]
fn depths_are_those_of_the_module() {
    let (network, module) = (network(), estimator("weights/vis-corr"));
    let region = PixelBox { x0: 50, y0: 40, x1: 150, y1: 130 };
    for (size, count, spacing, region) in [
        (Size::new(203, 149), 4, Spacing::Depth, None),
        (Size::new(256, 192), 3, Spacing::InverseDepth, None),
        (Size::new(256, 192), 3, Spacing::Depth, Some(region)),
    ] {
        let views = fixtures::still_life(size, count);
        let found = estimate(&network, &views, spacing, region);
        let (expected, seen) = no_grad(|| {
            let encoded: Vec<_> =
                views.iter().map(|view| module.network().encode(&view.photo).unwrap()).collect();
            let sources: Vec<_> = encoded[1..].iter().collect();
            let planes = vamvs_core::Planes { spacing, ..planes(&views[0], 40) };
            let part = region.map(|region| encoded[0].cropped(&region).unwrap().0);
            let reference = part.as_ref().unwrap_or(&encoded[0]);
            module.estimate_seen(reference, &sources, &planes, &mut Profile::default()).unwrap()
        });
        let (largest, mean) = difference(&found.map.confidence, &expected.confidence);
        assert!(mean < 1e-4 && largest < 0.02, "confidence of {size}: {largest}, {mean}");
        // A pixel that two planes or two parents suit equally well may fall to either.
        let others = share_of_others(&found.map.depth, &expected.depth);
        assert!(others < 0.002, "{others} of the depths of {size} differ");
        assert_eq!((found.map.camera, found.map.cam_from_world), (expected.camera, expected.cam_from_world));
        assert_eq!(found.visibility.len(), count - 1);
        for (found, expected) in found.visibility.iter().zip(&seen) {
            let (largest, _) = difference(found, expected);
            assert!(largest < 1e-3, "visibility of {size}: {largest}");
        }
    }
}

/// The same bits for any number of threads.
#[test]
fn threads_change_nothing() {
    let (network, views) = (network(), fixtures::still_life(Size::new(160, 120), 3));
    let of = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| estimate(&network, &views, Spacing::Depth, None))
    };
    let (one, three) = (of(1), of(3));
    assert_eq!(one.map.depth.data(), three.map.depth.data());
    assert_eq!(one.map.confidence.data(), three.map.confidence.data());
    assert_eq!(one.surface.data(), three.surface.data());
}
