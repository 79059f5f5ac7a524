//! The network crate on rendered scenes: accuracy against exact ground truth, invariances, and independence of the
//! sizes of slabs and strips.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::num::NonZeroUsize;

use nalgebra::{Rotation3, Vector3};
use vamvs_core::roi::PixelBox;
use vamvs_core::{DepthMap, DepthRange, Photo, Planes, Pose, Size, Spacing};
use vamvs_io::image::resize;
use vamvs_net::cost_volume::{CostVolume, SweepInputs, costs, sweep};
use vamvs_net::tch::{self, Kind, Tensor};
use vamvs_net::{Device, EncodedView, Estimator, EstimatorOptions, Iteration, Network, Profile};
use vamvs_tests::{Rendered, fixtures, folder};

const PAPER_AGGREGATIONS: [&str; 6] = ["avg", "max", "var", "vis-avg", "vis-max", "vis-var"];

/// The names of one network for each aggregation, for [`module`].
fn of_each_aggregation() -> impl Iterator<Item = &'static str> {
    PAPER_AGGREGATIONS.into_iter().chain(["kernel5", "weights/vis-corr"])
}

/// Loads a small untrained network of `tests/modules`, or, if the name begins with `weights/`, a shipped one.
fn module(name: &str) -> Network {
    let folder = if name.starts_with("weights/") { ".." } else { "modules" };
    let path = format!("{}/{folder}/{name}.pt", env!("CARGO_MANIFEST_DIR"));
    Network::load(path.as_ref(), Device::Cpu).unwrap()
}

fn estimator(name: &str) -> Estimator {
    let network = module(name);
    let options = EstimatorOptions::of(&network);
    Estimator::new(network, options).unwrap()
}

/// Estimates the depth map of the first photograph; the others are its source views.
fn depth(estimator: &Estimator, photos: &[&Photo], planes: &Planes) -> DepthMap {
    let encoded: Vec<_> =
        tch::no_grad(|| photos.iter().map(|photo| estimator.network().encode(photo).unwrap()).collect());
    let sources: Vec<_> = encoded[1..].iter().collect();
    estimator.estimate(&encoded[0], &sources, planes, &mut Profile::default()).unwrap()
}

fn planes(view: &Rendered, count: usize) -> Planes {
    Planes { range: folder::depth_range(view, 1.05).unwrap(), count, spacing: Spacing::Depth }
}

/// Share of pixels at which the depth of `a`, times `scale`, differs from that of `b` by less than `limit`, relative to
/// `b`.
fn agreement(a: &DepthMap, b: &DepthMap, scale: f64, limit: f64) -> f64 {
    assert_eq!(a.depth.size(), b.depth.size());
    let pairs = a.depth.data().iter().zip(b.depth.data());
    let close =
        pairs.filter(|(a, b)| (f64::from(**a) * scale - f64::from(**b)).abs() < limit * f64::from(**b));
    close.count() as f64 / a.depth.data().len() as f64
}

/// The outputs of a module's method, which gives a tensor or three.
fn outputs(module: &tch::CModule, method: &str, inputs: &[&Tensor]) -> Vec<Tensor> {
    let inputs: Vec<_> = inputs.iter().map(|tensor| tch::IValue::Tensor(tensor.shallow_clone())).collect();
    match module.method_is(method, &inputs).unwrap() {
        tch::IValue::Tensor(tensor) => vec![tensor],
        tch::IValue::Tuple(levels) => {
            levels.into_iter().map(|level| Tensor::try_from(level).unwrap()).collect()
        }
        other => panic!("{method} gave {other:?}"),
    }
}

/// `models/plain.py` writes both modules.
#[test]
fn the_network_is_the_authors_layers_in_their_order() {
    let load = |name: &str| {
        let path = format!("{}/modules/{name}.pt", env!("CARGO_MANIFEST_DIR"));
        tch::CModule::load(path).unwrap()
    };
    let (network, plain) = (load("kernel5"), load("plain"));
    let random = |shape: &[i64]| Tensor::rand(shape, (Kind::Float, Device::Cpu));
    let images = random(&[1, 3, 48, 64]);
    let neighbours = Tensor::randint(200, [1, 200, 16], (Kind::Int64, Device::Cpu));
    let calls: [(&str, Vec<Tensor>); 4] = [
        ("encode_coarse", vec![images.shallow_clone()]),
        ("encode_flow", vec![images]),
        ("regularize", vec![random(&[1, 16, 16, 8, 24])]),
        ("flow", vec![random(&[1, 52, 200]), neighbours]),
    ];
    for (method, inputs) in calls {
        let inputs: Vec<&Tensor> = inputs.iter().collect();
        let (found, expected) = (outputs(&network, method, &inputs), outputs(&plain, method, &inputs));
        assert_eq!(found.len(), expected.len());
        for (found, expected) in found.iter().zip(&expected) {
            assert_eq!(found.size(), expected.size());
            assert!(expected.std(false).double_value(&[]) > 1e-3, "{method} gives almost a constant");
            assert!(found.allclose(expected, 1e-4, 1e-4, false), "{method}");
        }
    }
}

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
fn without_a_flow_the_coarse_features_alone_give_the_same_depth() {
    let views = fixtures::still_life(Size::new(107, 85), 3);
    let planes = planes(&views[0], 24);
    for name in ["vis-var", "vis-max", "weights/vis-corr"] {
        let mut estimator = estimator(name);
        estimator.options_mut().iterations.clear();
        let depth = |encode: &dyn Fn(&Photo) -> EncodedView| {
            let encoded: Vec<_> = tch::no_grad(|| views.iter().map(|view| encode(&view.photo)).collect());
            let sources: Vec<_> = encoded[1..].iter().collect();
            let map = estimator.estimate(&encoded[0], &sources, &planes, &mut Profile::default()).unwrap();
            (map, encoded[0].bytes())
        };
        let (all, with_flow) = depth(&|photo| estimator.network().encode(photo).unwrap());
        let (coarse, without) = depth(&|photo| estimator.encode(photo).unwrap());
        assert_eq!(all.depth, coarse.depth, "{name}");
        assert!(without < with_flow, "{name}: {without} and {with_flow} bytes");
    }
}

#[test]
fn the_order_of_source_views_does_not_matter() {
    let views = fixtures::still_life(Size::new(96, 64), 4);
    for name in of_each_aggregation() {
        let estimator = estimator(name);
        let planes = planes(&views[0], 16);
        let in_order = |order: [usize; 4]| depth(&estimator, &order.map(|i| &views[i].photo), &planes);
        let (a, b) = (in_order([0, 1, 2, 3]), in_order([0, 3, 1, 2]));
        assert!(agreement(&a, &b, 1.0, 1e-4) > 0.999, "{name}: {}", agreement(&a, &b, 1.0, 1e-4));
    }
}

#[test]
fn a_network_that_asks_for_it_looks_at_the_first_sources_alone_in_its_flow() {
    let views = fixtures::still_life(Size::new(96, 64), 4);
    let mut estimator = estimator("vis-max");
    let mut manifest = estimator.network().manifest().clone();
    manifest.flow_sources = NonZeroUsize::new(2);
    let planes = planes(&views[0], 16);
    let flow = |estimator: &Estimator, sources: &[usize]| {
        tch::no_grad(|| {
            let encode = |view: &Rendered| estimator.network().encode(&view.photo).unwrap();
            let encoded: Vec<_> = views.iter().map(encode).collect();
            let sources: Vec<_> = sources.iter().map(|&source| &encoded[source]).collect();
            let iteration = estimator.iterations()[0];
            let stage = estimator.flow_stage(&encoded[0], &sources, &planes, &[], iteration);
            let before = Tensor::full([8, 12], 7.0, (Kind::Float, Device::Cpu));
            stage.refine(&before, &mut Profile::default()).unwrap().u
        })
    };
    let [all, two] = [&[1, 2, 3][..], &[1, 2]].map(|sources| flow(&estimator, sources));
    assert!(!all.equal(&two), "the third source matters");
    estimator.network_mut().set_manifest(manifest).unwrap();
    assert!(flow(&estimator, &[1, 2, 3]).equal(&two));
}

/// A sweep without a limit on the size of its slabs: all planes are one slab.
fn swept<'a>(
    network: &'a Network,
    reference: &'a EncodedView,
    sources: &'a [&'a EncodedView],
    planes: &'a Planes,
    level: usize,
) -> SweepInputs<'a> {
    SweepInputs { network, reference, sources, planes, level, slab_bytes: usize::MAX }
}

/// The paper's networks never hold the whole cost volume: [`costs`] regularises it slab by slab. The costs must equal
/// those of regularising the whole volume of [`sweep`].
#[test]
fn a_volume_that_is_never_whole_gives_the_costs_of_a_whole_one() {
    let views = fixtures::still_life(Size::new(107, 85), 3);
    for (name, level) in [("weights/vis-max", 0), ("weights/vis-max", 1), ("weights/vis-var", 0), ("var", 0)]
    {
        let network = module(name);
        assert!(network.manifest().slabs, "{name}");
        tch::no_grad(|| {
            let encoded: Vec<_> = views.iter().map(|view| network.encode(&view.photo).unwrap()).collect();
            let sources: Vec<_> = encoded[1..].iter().collect();
            for count in [13, 24] {
                let planes = planes(&views[0], count);
                let whole = swept(&network, &encoded[0], &sources, &planes, level);
                let expected = network.regularize(&sweep(&whole, None).unwrap().volume).unwrap();
                for slab_bytes in [1, 100_000, usize::MAX] {
                    let cut = SweepInputs { slab_bytes, ..whole };
                    let found = costs(&cut, None, &mut Profile::default()).unwrap().costs;
                    let difference = (&found - &expected).abs().max().double_value(&[]);
                    let largest = expected.abs().max().double_value(&[]);
                    assert!(difference < 1e-4 * largest, "{name}, {count} planes: {difference} of {largest}");
                }
            }
        });
    }
}

/// The native kernels against the tensor operations and module methods that they replace. Features that need gradients
/// still use those.
#[test]
fn native_kernels_give_what_tensors_give() {
    let views = fixtures::still_life(Size::new(107, 85), 4);
    for name in of_each_aggregation().chain(["weights/vis-max", "weights/vis-var", "weights/var"]) {
        let estimator = estimator(name);
        let (network, planes) = (estimator.network(), planes(&views[0], 13));
        assert!(network.manifest().layers || network.manifest().aggregation.correlates(), "{name}");
        let encode = || -> Vec<EncodedView> {
            views.iter().map(|view| network.encode(&view.photo).unwrap()).collect()
        };
        let (native, tensors) = (tch::no_grad(encode), encode());
        let volume = |views: &[EncodedView]| {
            let sources: Vec<_> = views[1..].iter().collect();
            let CostVolume { volume, visibility } =
                sweep(&swept(network, &views[0], &sources, &planes, 0), None).unwrap();
            (volume.detach(), visibility.iter().map(Tensor::detach).collect::<Vec<_>>())
        };
        let (found, expected) = (volume(&native), volume(&tensors));
        assert!(expected.0.std(true).double_value(&[]) > 0.0, "{name}: the volume is not constant");
        assert_near(name, &found.0, &expected.0);
        found.1.iter().zip(&expected.1).for_each(|(found, expected)| assert_near(name, found, expected));
        for scale in [8, 4, 2] {
            let refined = |views: &[EncodedView]| {
                let sources: Vec<_> = views[1..].iter().collect();
                let u = Tensor::linspace(2.0, 10.0, 22 * 28, (Kind::Float, Device::Cpu)).view([22, 28]);
                let stage = estimator.flow_stage(
                    &views[0],
                    &sources,
                    &planes,
                    &expected.1,
                    Iteration { scale, step: 0.5 },
                );
                let map = stage.refine(&u, &mut Profile::default()).unwrap();
                (map.u.detach(), map.confidence.detach())
            };
            if scale > native[0].stride {
                continue;
            }
            let (found, expected) = (refined(&native), refined(&tensors));
            assert_near(name, &found.0, &expected.0);
            assert_near(name, &found.1, &expected.1);
        }
    }
}

/// Asserts equality up to rounding, which depends on the order of summation.
fn assert_near(name: &str, found: &Tensor, expected: &Tensor) {
    assert_eq!(found.size(), expected.size(), "{name}");
    let apart = (found - expected).abs().max().double_value(&[]);
    let largest = expected.abs().max().double_value(&[]);
    assert!(apart < 1e-4 * largest, "{name}: difference {apart}, largest value {largest}");
}

/// The shipped vis-max takes the maximum over the source views of all channels but the last, which it averages.
#[test]
fn of_a_volume_the_last_channels_are_means_over_the_views_and_the_others_maxima() {
    let views = fixtures::still_life(Size::new(96, 64), 4);
    let network = module("weights/vis-max");
    let averaged = network.manifest().averaged as i64;
    assert_eq!(averaged, 1);
    tch::no_grad(|| {
        let encoded: Vec<_> = views.iter().map(|view| network.encode(&view.photo).unwrap()).collect();
        let sources: Vec<_> = encoded[1..].iter().collect();
        let planes = planes(&views[0], 16);
        let volume =
            |sources: &[_]| sweep(&swept(&network, &encoded[0], sources, &planes, 0), None).unwrap().volume;
        let single = Tensor::cat(&sources.iter().map(|source| volume(&[*source])).collect::<Vec<_>>(), 0);
        let split = single.size()[1] - averaged;
        let largest = single.narrow(1, 0, split).amax(0, true);
        let mean = single.narrow(1, split, averaged).mean_dim(0, true, Kind::Float);
        assert!(volume(&sources).allclose(&Tensor::cat(&[largest, mean], 1), 1e-5, 1e-5, false));
    });
}

#[test]
fn the_result_does_not_depend_on_slabs_strips_or_threads() {
    let views = fixtures::still_life(Size::new(160, 224), 3);
    let photos: Vec<_> = views.iter().map(|view| &view.photo).collect();
    for name in ["vis-var", "vis-max", "weights/photometric"] {
        let planes = planes(&views[0], 24);
        let with = |slab_bytes: usize, strip_points: usize, threads: i32| {
            let network = module(name);
            let options = EstimatorOptions { slab_bytes, strip_points, ..EstimatorOptions::of(&network) };
            let before = tch::get_num_threads();
            tch::set_num_threads(threads);
            let map = depth(&Estimator::new(network, options).unwrap(), &photos, &planes);
            tch::set_num_threads(before);
            map
        };
        // At 1/8 a row has 5 hypotheses × 20 columns = 100 points, so 800 points are strips of 8 of the 28 rows.
        let (whole, cut) = (with(1 << 30, 1 << 30, 2), with(1, 800, 1));
        let same = agreement(&whole, &cut, 1.0, 1e-4);
        assert!(same > 0.999, "{name}: {same}");
    }
}

#[test]
fn scale_rotation_and_place_of_the_scene_change_nothing() {
    let views = fixtures::still_life(Size::new(160, 128), 4);
    let planes = planes(&views[0], 32);
    let photos: Vec<_> = views.iter().map(|view| &view.photo).collect();
    let rotation = Rotation3::from_euler_angles(0.4, -1.1, 2.0).into_inner();
    for name in ["weights/photometric", "weights/vis-max", "vis-var"] {
        let estimator = estimator(name);
        let original = depth(&estimator, &photos, &planes);
        for scale in [0.001, 1000.0] {
            let shift = scale * Vector3::new(31.0, -17.0, 53.0);
            let moved: Vec<Photo> =
                photos.iter().map(|photo| moved(photo, scale, &rotation, &shift)).collect();
            let range = DepthRange { near: planes.range.near * scale, far: planes.range.far * scale };
            let map = depth(&estimator, &moved.iter().collect::<Vec<_>>(), &Planes { range, ..planes });
            let same = agreement(&original, &map, scale, 1e-3);
            assert!(same > 0.99, "{name} at scale {scale}: {same}");
        }
    }
}

/// The same photograph with the pose it has when the world is transformed by x ↦ scale · R · x + t.
fn moved(photo: &Photo, scale: f64, rotation: &nalgebra::Matrix3<f64>, shift: &Vector3<f64>) -> Photo {
    let new_rotation = photo.cam_from_world.rotation * rotation.transpose();
    let translation = scale * photo.cam_from_world.translation - new_rotation * shift;
    Photo { cam_from_world: Pose { rotation: new_rotation, translation }, ..photo.clone() }
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
fn a_region_gives_the_depth_of_the_whole_there() {
    let views = fixtures::tilted_plane(Size::new(320, 240), 3);
    let planes = planes(&views[1], 48);
    for (name, stride) in [("weights/photometric", 2), ("weights/vis-corr", 4)] {
        let estimator = estimator(name);
        let encode = |view: &Rendered| estimator.network().encode(&view.photo).unwrap();
        let encoded: Vec<_> = tch::no_grad(|| views.iter().map(encode).collect());
        let sources = [&encoded[0], &encoded[2]];
        let estimate = |reference| {
            estimator.estimate(reference, &sources, &planes, &mut Profile::default()).unwrap().depth
        };
        let whole = estimate(&encoded[1]);
        let (part, place) = encoded[1].cropped(&PixelBox { x0: 83, y0: 50, x1: 240, y1: 199 }).unwrap();
        assert_eq!((place.x0, place.y0, place.x1, place.y1), (80, 48, 240, 200));
        let depth = estimate(&part);
        assert_eq!(depth.size(), Size::new(160 / stride, 152 / stride), "{name}");
        let (mut same, mut count) = (0, 0);
        for y in 16 / stride..136 / stride {
            for x in 16 / stride..144 / stride {
                let (a, b) = (depth[(x, y)], whole[(x + 80 / stride, y + 48 / stride)]);
                same += u32::from((a - b).abs() < 0.005 * b);
                count += 1;
            }
        }
        assert!(f64::from(same) > 0.95 * f64::from(count), "{name}: {same} of {count}");
    }
}

/// With a coarse stride of 4 the network enlarges the photograph internally. All sizes, regions and cameras that go in
/// and out are still those of the photograph.
#[test]
fn smaller_cells_give_what_enlarged_photographs_give() {
    let views = fixtures::tilted_plane(Size::new(202, 150), 3);
    let planes = planes(&views[1], 32);
    let order = [1, 0, 2].map(|i| &views[i].photo);
    let mut network = module("weights/photometric");
    network.set_coarse_stride(4).unwrap();
    assert!(network.set_coarse_stride(16).unwrap_err().to_string().contains("16"));
    let options = EstimatorOptions::of(&network);
    let small = Estimator::new(network, options).unwrap();
    assert_eq!(small.scales(), [4, 2]);
    let map = depth(&small, &order, &planes);
    assert_eq!(map.depth.size(), Size::new(101, 75));
    assert_eq!(map.camera, order[0].camera.resized(map.depth.size()));

    // A region is extended to whole strides.
    let encoded = tch::no_grad(|| small.network().encode(order[0]).unwrap());
    let (part, place) = encoded.cropped(&PixelBox { x0: 21, y0: 30, x1: 131, y1: 201 }).unwrap();
    assert_eq!((place.x0, place.y0, place.x1, place.y1), (16, 24, 136, 152));
    assert_eq!(part.camera.size, Size::new(2 * 120, 2 * 126));

    let enlarged = order.map(|photo| {
        let size = Size::new(404, 300);
        Photo { camera: photo.camera.resized(size), image: resize(&photo.image, size), ..photo.clone() }
    });
    let mut large = estimator("weights/photometric");
    let iterations = small.options().iterations.iter();
    large.options_mut().iterations = iterations.map(|i| Iteration { scale: 2 * i.scale, ..*i }).collect();
    let other = depth(&large, &enlarged.each_ref(), &planes);
    assert_eq!(other.camera, map.camera);
    // The only difference is that `small` blends in the costs at a stride of 8.
    let same = agreement(&map, &other, 1.0, 0.005);
    assert!(same > 0.9, "{same}");
}

/// With a coarse stride of 4, level 1 of the sweep has a stride of 8. Its volume is that of a network with a coarse
/// stride of 8.
#[test]
fn the_wide_cells_of_enlarged_photographs_are_the_cells_of_the_photographs() {
    let views = fixtures::still_life(Size::new(107, 85), 3);
    let planes = planes(&views[0], 16);
    let volume = |coarse_stride: usize, level: usize| {
        let mut network = module("weights/vis-max");
        network.set_coarse_stride(coarse_stride).unwrap();
        tch::no_grad(|| {
            let encoded: Vec<_> = views.iter().map(|view| network.encode(&view.photo).unwrap()).collect();
            let sources: Vec<_> = encoded[1..].iter().collect();
            sweep(&swept(&network, &encoded[0], &sources, &planes, level), None).unwrap().volume
        })
    };
    let (wide, small) = (volume(8, 0), volume(4, 0));
    assert_eq!((wide.size()[3..].to_vec(), small.size()[3..].to_vec()), (vec![11, 14], vec![22, 28]));
    assert!(volume(4, 1).allclose(&wide, 1e-3, 1e-3, false));
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
