//! What modules and native kernels compute, compared with other ways to compute the same.

use vamvs_core::Size;
use vamvs_net::cost_volume::{CostVolume, sweep};
use vamvs_net::tch::{self, Kind, Tensor};
use vamvs_net::{Device, EncodedView, Iteration, Profile};
use vamvs_tests::fixtures;

use crate::{estimator, of_each_aggregation, planes, swept};

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

/// The native kernels against the tensor operations and module methods that they replace. Features that need gradients
/// still use those.
#[test]
fn native_kernels_give_what_tensors_give() {
    let views = fixtures::still_life(Size::new(107, 85), 4);
    let of_paper = of_each_aggregation().filter(|name| *name != "weights/vis-corr");
    for name in of_paper.chain(["weights/vis-max", "weights/vis-var", "weights/var"]) {
        let estimator = estimator(name);
        let (network, planes) = (estimator.network(), planes(&views[0], 13));
        assert!(network.manifest().layers, "{name}");
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
