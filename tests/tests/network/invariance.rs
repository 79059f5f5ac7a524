//! What changes no depth: the order of the views, units and frame of the world, pieces and threads, cropping.

use std::num::NonZeroUsize;

use nalgebra::{Rotation3, Vector3};
use vamvs_core::roi::PixelBox;
use vamvs_core::{DepthRange, Photo, Planes, Pose, Size};
use vamvs_io::image::resize;
use vamvs_net::tch::{self, Kind, Tensor};
use vamvs_net::{Device, EncodedView, Estimator, EstimatorOptions, Iteration, Profile};
use vamvs_tests::{Rendered, fixtures};

use crate::{agreement, depth, estimator, module, of_each_aggregation, planes};

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

#[test]
fn a_region_gives_the_depth_of_the_whole_there() {
    let views = fixtures::tilted_plane(Size::new(320, 240), 3);
    let planes = planes(&views[1], 48);
    // A learned network looks further around a pixel than the margin that a region has.
    for (name, stride, margin, tolerance, share) in
        [("weights/photometric", 2, 16, 0.005, 0.98), ("weights/vis-corr", 4, 32, 0.01, 0.85)]
    {
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
        for y in margin / stride..(152 - margin) / stride {
            for x in margin / stride..(160 - margin) / stride {
                let (a, b) = (depth[(x, y)], whole[(x + 80 / stride, y + 48 / stride)]);
                // Where there is no surface, both are 0.
                same += u32::from((a - b).abs() <= tolerance * b);
                count += 1;
            }
        }
        assert!(f64::from(same) > share * f64::from(count), "{name}: {same} of {count}");
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
