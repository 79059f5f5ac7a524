//! Depth maps as callers ask for them: sizes, accuracy, memory, and errors.

use vamvs_core::roi::PixelBox;
use vamvs_core::{DepthMap, DepthRange, Planes, Size};
use vamvs_net::tch;
use vamvs_net::{Estimator, EstimatorOptions, Profile};
use vamvs_tests::{Rendered, fixtures};

use crate::{PAPER_AGGREGATIONS, depth, estimator, module, of_each_aggregation, planes};

#[test]
fn all_aggregations_give_depth_and_confidence_for_any_size_and_number_of_views() {
    let views = fixtures::still_life(Size::new(107, 85), 4);
    for name in of_each_aggregation() {
        let estimator = estimator(name);
        for count in [2, 4] {
            let photos: Vec<_> = views[..count].iter().map(|view| &view.photo).collect();
            let planes = planes(&views[0], 16);
            let map = depth(&estimator, &photos, &planes);
            // vis-corr has no flow iterations, so its map is a quarter of the photograph's size.
            let has_flow = !estimator.network().iterations().is_empty();
            let size = if has_flow { Size::new(53, 42) } else { Size::new(26, 21) };
            assert_eq!(map.depth.size(), size, "{name}");
            let DepthRange { near, far } = planes.range;
            let margin = 0.3 * (far - near);
            let in_range = |d: &f32| (near - margin..far + margin).contains(&f64::from(*d));
            assert!(map.depth.data().iter().all(in_range), "{name}, {count} views");
            let shares = map.confidence.data().iter().chain(map.coarse_confidence.as_ref().unwrap().data());
            assert!(shares.into_iter().all(|c| (0.0..=1.0001).contains(c)), "{name}, {count} views");
        }
    }
}

#[test]
fn photometric_reconstructs_a_tilted_plane() {
    let views = fixtures::tilted_plane(Size::new(480, 360), 5);
    let order = [2, 1, 3, 0, 4];
    let map =
        depth(&estimator("weights/photometric"), &order.map(|i| &views[i].photo), &planes(&views[2], 64));
    let ground_truth = &views[2].depth;
    let (mut errors, mut inner) = (Vec::new(), Vec::new());
    for y in 0..map.depth.height() {
        for x in 0..map.depth.width() {
            // Inverse depth is linear over the image of a plane. So the depth at the corner that four pixels share is
            // the harmonic mean of the depths at their centres.
            let four = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(i, j)| ground_truth[(2 * x + i, 2 * y + j)]);
            let ground_truth = 4.0 / four.iter().map(|d| 1.0 / d).sum::<f32>();
            let error = (map.depth[(x, y)] - ground_truth).abs() / ground_truth;
            errors.push(error);
            if (40..200).contains(&x) && (30..150).contains(&y) {
                inner.push(error);
            }
        }
    }
    let share = |errors: &[f32], limit: f32| {
        errors.iter().filter(|e| **e < limit).count() as f64 / errors.len() as f64
    };
    assert!(share(&inner, 0.005) > 0.95, "inner pixels within 0.5 %: {}", share(&inner, 0.005));
    assert!(share(&inner, 0.01) > 0.99, "inner pixels within 1 %: {}", share(&inner, 0.01));
    assert!(share(&errors, 0.02) > 0.9, "all pixels within 2 %: {}", share(&errors, 0.02));
}

#[test]
fn foveated_maps_are_the_whole_map_inside_and_coarser_around() {
    let views = fixtures::still_life(Size::new(256, 192), 3);
    let planes = planes(&views[0], 16);
    // The number of pixels that each scale contributes, from coarse to fine. With a coarse stride of 8: at 1/2 the
    // region, 32×24 pixels. At 1/4 the region grown by a quarter of its size on each side, 24×18 pixels (48..144 by
    // 36..108 of the image), less the 16×12 of the region itself. At 1/8 the rest. With a coarse stride of 4 there is
    // no map between the coarse one, at 1/4, and the finest.
    let (wide, small) = ([32 * 24 - 12 * 9, 24 * 18 - 16 * 12, 32 * 24], [64 * 48 - 16 * 12, 32 * 24]);
    for (name, counts) in [("vis-max", &wide[..]), ("vis-var", &wide), ("weights/vis-max", &small)] {
        let estimator = estimator(name);
        let last = counts.len() - 1;
        let encode = |view: &Rendered| estimator.network().encode(&view.photo).unwrap();
        let encoded: Vec<_> = tch::no_grad(|| views.iter().map(encode).collect());
        let sources: Vec<_> = encoded[1..].iter().collect();
        let foveated = |region: Option<PixelBox>| {
            let profile = &mut Profile::default();
            estimator.estimate_foveated(&encoded[0], &sources, &planes, region, profile).unwrap()
        };
        let pixels = |map: &DepthMap| map.depth.data().iter().filter(|depth| **depth > 0.0).count();
        let whole = estimator.estimate(&encoded[0], &sources, &planes, &mut Profile::default()).unwrap();
        let everywhere = foveated(Some(PixelBox { x0: 0, y0: 0, x1: 256, y1: 192 }));
        let filled: Vec<_> = everywhere.iter().map(pixels).filter(|count| *count > 0).collect();
        assert_eq!((everywhere.len(), filled), (counts.len(), vec![128 * 96]), "{name}");
        assert_eq!(everywhere[last], whole, "{name}");

        let nowhere = foveated(None);
        let coarse_stride = estimator.network().manifest().coarse_stride;
        let coarse = (256 / coarse_stride) * (192 / coarse_stride);
        assert_eq!(nowhere.iter().map(pixels).collect::<Vec<_>>(), [coarse], "{name}: the coarse map");

        let maps = foveated(Some(PixelBox { x0: 64, y0: 48, x1: 128, y1: 96 }));
        assert_eq!(maps.iter().map(pixels).collect::<Vec<_>>(), counts, "{name}");
        let map = &maps[last];
        assert_eq!(map.camera, whole.camera);
        // Far from the region's border the depth is that of the whole map.
        let centre =
            |x: usize, y: usize| (map.depth[(x, y)] - whole.depth[(x, y)]).abs() / whole.depth[(x, y)];
        assert!(centre(48, 36) < 1e-4, "{name}: {}", centre(48, 36));
    }
}

/// Only the features' part of the estimated peak is exact. The example `profile` of
/// `vamvs-net` prints both the predicted and the measured peak.
#[test]
fn of_a_peak_features_are_counted_and_smaller_pieces_take_less() {
    let size = Size::new(107, 85);
    let view = &fixtures::still_life(size, 2)[0];
    for name in PAPER_AGGREGATIONS.iter().chain(&["weights/photometric"]) {
        let mut estimator = estimator(name);
        let features = tch::no_grad(|| estimator.network().encode(&view.photo).unwrap().bytes());
        let peak = |estimator: &Estimator, views, planes| estimator.peak_bytes(size, views, planes);
        let more = peak(&estimator, 6, 48) - peak(&estimator, 5, 48);
        // Where kernels relate pairs, a view also has what the first layer gives for it.
        let relates = estimator.network().manifest().aggregation.relates_pairs();
        assert!(
            more == features || relates && more > features,
            "{name}: {more} for a view, features {features}"
        );
        let whole = peak(&estimator, 5, 200);
        assert!(peak(&estimator, 5, 100) < whole, "{name}");
        estimator.options_mut().slab_bytes = 1 << 16;
        estimator.options_mut().strip_points = 1 << 10;
        assert!(peak(&estimator, 5, 200) < whole, "{name}");
    }
}

#[test]
fn requests_without_sense_are_errors() {
    let views = fixtures::tilted_plane(Size::new(64, 64), 2);
    let estimator = estimator("weights/photometric");
    let encoded = estimator.network().encode(&views[0].photo).unwrap();
    let planes = planes(&views[0], 16);
    assert!(estimator.estimate(&encoded, &[], &planes, &mut Profile::default()).is_err());
    let one = Planes { count: 1, ..planes };
    assert!(estimator.estimate(&encoded, &[&encoded], &one, &mut Profile::default()).is_err());
    let tiny = fixtures::tilted_plane(Size::new(16, 64), 1);
    assert!(estimator.network().encode(&tiny[0].photo).unwrap_err().to_string().contains("16×64"));
    let network = module("weights/vis-max");
    let options = EstimatorOptions {
        iterations: network.manifest().iterations.clone(),
        ..EstimatorOptions::of(&network)
    };
    let error = Estimator::new(network, options).unwrap_err().to_string();
    assert!(error.contains("1/8") && error.contains("a coarse stride of 4"), "{error}");
}
