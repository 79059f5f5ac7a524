//! The cost volume: slab by slab, level by level, channel by channel.

use vamvs_core::Size;
use vamvs_net::Profile;
use vamvs_net::cost_volume::{SweepInputs, costs, regularize, sweep};
use vamvs_net::tch::{self, Kind, Tensor};
use vamvs_tests::fixtures;

use crate::{module, planes, swept};

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
                let expected = regularize(&whole, &sweep(&whole, None).unwrap().volume).unwrap();
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

/// vis-corr regularises its volume in the context of the photograph: with the features of another one the costs differ.
#[test]
fn of_vis_corr_the_costs_depend_on_the_features_of_the_reference_view() {
    let views = fixtures::still_life(Size::new(107, 85), 2);
    let network = module("weights/vis-corr");
    tch::no_grad(|| {
        let encoded: Vec<_> = views.iter().map(|view| network.encode(&view.photo).unwrap()).collect();
        let sources: Vec<_> = encoded[1..].iter().collect();
        let planes = planes(&views[0], 24);
        let inputs = swept(&network, &encoded[0], &sources, &planes, 0);
        let volume = sweep(&inputs, None).unwrap().volume;
        let with =
            |view: usize| regularize(&SweepInputs { reference: &encoded[view], ..inputs }, &volume).unwrap();
        let found = costs(&inputs, None, &mut Profile::default()).unwrap().costs;
        assert!(found.allclose(&with(0), 1e-5, 1e-5, false));
        assert!((with(1) - with(0)).abs().max().double_value(&[]) > 0.01);
    });
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
