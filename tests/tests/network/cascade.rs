//! A cascade: the second volume is a sweep of planes around a depth map, and both stages see what they should.

use vamvs_core::{Planes, Size, Spacing};
use vamvs_net::Profile;
use vamvs_net::cost_volume::{SweepInputs, sweep};
use vamvs_net::tch::{self, Kind, Tensor};
use vamvs_tests::fixtures;

use crate::{depth, estimator, module, planes, swept};

const CASCADE: &str = "weights/vis-corr";

/// Around a depth map that is the same everywhere, the planes of the second volume are planes of a finer sweep.
#[test]
fn around_a_plane_the_second_volume_is_a_part_of_a_plane_sweep() {
    let views = fixtures::still_life(Size::new(112, 80), 3);
    let network = module(CASCADE);
    tch::no_grad(|| {
        let encoded: Vec<_> = views.iter().map(|view| network.encode(&view.photo).unwrap()).collect();
        let sources: Vec<_> = encoded[1..].iter().collect();
        let coarse = planes(&views[0], 25);
        let fine = Planes { count: 97, spacing: Spacing::Depth, ..coarse }; // 4 planes for one of the coarse sweep
        let options = (Kind::Float, tch::Device::Cpu);
        let around = Tensor::full([20, 28], 12.0, options);
        let masks =
            || Some(vec![Tensor::ones([1, 1, 20, 28], options), Tensor::full([1, 1, 20, 28], 0.3, options)]);
        let whole = sweep(&swept(&network, &encoded[0], &sources, &fine, 0), masks()).unwrap().volume;
        let inputs =
            SweepInputs { around: Some(&around), ..swept(&network, &encoded[0], &sources, &coarse, 0) };
        let narrow = sweep(&inputs, masks()).unwrap().volume;
        let cascade = network.manifest().cascade.unwrap();
        for plane in 0..cascade.planes {
            let u = 12.0 + cascade.step * (plane as f64 - 0.5 * (cascade.planes - 1) as f64);
            let (expected, found) = (whole.select(2, (4.0 * u) as i64), narrow.select(2, plane as i64));
            let difference = (&expected - &found).abs().max().double_value(&[]);
            assert!(
                difference < 1e-3 * expected.abs().max().double_value(&[]),
                "plane {plane}: {difference}"
            );
        }
    });
}

/// The native kernels and the tensor operations, which training uses, make the same second volume of a depth map that differs
/// from pixel to pixel.
#[test]
fn kernels_and_tensors_sweep_the_same_planes() {
    let views = fixtures::still_life(Size::new(107, 85), 3);
    let network = module(CASCADE);
    let encode = || views.iter().map(|view| network.encode(&view.photo).unwrap()).collect::<Vec<_>>();
    let planes = planes(&views[0], 24);
    let volume = |encoded: &[vamvs_net::EncodedView]| {
        let size = encoded[0].size_at(4);
        let shape = [size.height as i64, size.width as i64];
        let around =
            Tensor::linspace(2.0, 20.0, shape[0] * shape[1], (Kind::Float, tch::Device::Cpu)).view(shape);
        let sources: Vec<_> = encoded[1..].iter().collect();
        let inputs =
            SweepInputs { around: Some(&around), ..swept(&network, &encoded[0], &sources, &planes, 0) };
        let mask = || Tensor::ones([1, 1, shape[0], shape[1]], (Kind::Float, tch::Device::Cpu));
        sweep(&inputs, Some(vec![mask(), mask()])).unwrap().volume
    };
    let native = tch::no_grad(|| volume(&encode()));
    let tensors = volume(&encode());
    assert!(tensors.requires_grad() && !native.requires_grad());
    let difference = (&native - &tensors).abs().max().double_value(&[]);
    assert!(difference < 1e-3 * tensors.abs().max().double_value(&[]), "{difference}");
}

/// The second stage sharpens the first: its map has twice the resolution and is nearer to the ground truth. Most of a scene without
/// sky is a surface.
#[test]
fn the_second_stage_is_nearer_to_the_truth() {
    let views = fixtures::still_life(Size::new(256, 192), 4);
    let estimator = estimator(CASCADE);
    let planes = planes(&views[0], 32);
    let photos: Vec<_> = views.iter().map(|view| &view.photo).collect();
    let map = depth(&estimator, &photos, &planes);
    assert_eq!(map.depth.size(), Size::new(64, 48));
    let share = map.depth.data().iter().filter(|depth| **depth > 0.0).count() as f64 / (64.0 * 48.0);
    assert!(share > 0.95, "{share} of the pixels show a surface");
    let errors = tch::no_grad(|| {
        let encoded: Vec<_> = photos.iter().map(|photo| estimator.network().encode(photo).unwrap()).collect();
        let sources: Vec<_> = encoded[1..].iter().collect();
        let stages = estimator.stages(&encoded[0], &sources, &planes, None, &mut Profile::default()).unwrap();
        stages.iter().map(|stage| error(&views[0], &planes, &stage.u)).collect::<Vec<_>>()
    });
    assert!(errors.len() == 2 && errors[1] < 0.8 * errors[0], "median errors, plane distances: {errors:?}");
}

/// The median error of a map in plane coordinates, at its pixels' centres.
fn error(view: &vamvs_tests::Rendered, planes: &Planes, u: &Tensor) -> f64 {
    let (height, width) = u.size2().unwrap();
    let scale = view.depth.width() / width as usize;
    let mut errors = Vec::new();
    for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
        let place = [x, y].map(|i| i as usize * scale + scale / 2);
        let ground_truth = planes.coordinate(f64::from(view.depth[(place[0], place[1])]));
        errors.push((u.double_value(&[y, x]) - ground_truth).abs());
    }
    errors.sort_by(f64::total_cmp);
    errors[errors.len() / 2]
}
