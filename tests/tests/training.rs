//! Training: gradients against finite differences, a run that lowers its loss, a run that is interrupted, sampling,
//! calibration and given visibility.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::time::Duration;

use vamvs_core::{Grid, Planes, Size, Spacing, Visibility};
use vamvs_io::pfm;
use vamvs_net::cost_volume::{SweepInputs, sweep};
use vamvs_net::tch::{self, Kind, Tensor};
use vamvs_net::{Device, EncodedView, Estimator, EstimatorOptions, Mode, Network, Profile};
use vamvs_tests::{Rendered, fixtures, folder};
use vamvs_train::optimizer::Optimizer;
use vamvs_train::options::SampleOptions;
use vamvs_train::sample::{draw, whole};
use vamvs_train::{Dataset, TrainEvent, TrainJob, TrainOptions, Validation, calibrate, train, write_module};

fn network(name: &str) -> Network {
    let path = format!("{}/modules/{name}.pt", env!("CARGO_MANIFEST_DIR"));
    Network::load(path.as_ref(), Device::Cpu).unwrap()
}

/// Asserts that the slope of the loss along its gradient, by central differences, is the gradient's norm to 5 %. Only
/// the parameters whose names begin with one of `parts` count. The loss is strongly curved, so the step is as short as
/// single precision allows.
fn assert_gradient(network: &Network, parts: &[&str], loss: impl Fn() -> Tensor) {
    let parameters: Vec<Tensor> = network
        .parameters()
        .unwrap()
        .into_iter()
        .filter(|(name, _)| parts.iter().any(|part| name.starts_with(part)))
        .map(|(_, parameter)| parameter)
        .collect();
    loss().backward();
    let gradients: Vec<Tensor> = parameters.iter().map(|p| p.grad().detach().copy()).collect();
    let norm = gradients.iter().map(|g| g.square().sum(Kind::Double).double_value(&[])).sum::<f64>().sqrt();
    assert!(norm > 1e-6, "{parts:?}: the gradient vanishes");
    let moved = |step: f64| {
        tch::no_grad(|| {
            for (parameter, gradient) in parameters.iter().zip(&gradients) {
                let _ = parameter.shallow_clone().f_add_(&(gradient * (step / norm))).unwrap();
            }
            let value = loss().double_value(&[]);
            for (parameter, gradient) in parameters.iter().zip(&gradients) {
                let _ = parameter.shallow_clone().f_sub_(&(gradient * (step / norm))).unwrap();
            }
            value
        })
    };
    let step = 3e-6;
    let slope = (moved(step) - moved(-step)) / (2.0 * step);
    assert!((slope / norm - 1.0).abs() < 0.05, "{parts:?}: gradient {norm}, finite differences {slope}");
    parameters.iter().for_each(|p| p.shallow_clone().zero_grad());
}

/// Randomises all biases. Those of a new network are 0, so that zero inputs, such as features beyond the image
/// border, sit exactly on the kink of ReLU, where there is no derivative.
fn move_off_kinks(network: &Network) {
    tch::manual_seed(5);
    tch::no_grad(|| {
        for (_, mut bias) in
            network.parameters().unwrap().into_iter().filter(|(name, _)| name.ends_with("bias"))
        {
            bias += bias.randn_like() * 0.1;
        }
    });
}

/// Runs the network 20 times, so that the running statistics of its normalisation layers approach the scene's.
fn gather_statistics(estimator: &Estimator, views: &[Rendered], planes: &Planes) {
    tch::no_grad(|| {
        for _ in 0..20 {
            let encode = |view: &Rendered| estimator.network().encode(&view.photo).unwrap();
            let views: Vec<_> = views.iter().map(encode).collect();
            let sources: Vec<_> = views[1..].iter().collect();
            estimator.stages(&views[0], &sources, planes, None, &mut Profile::default()).unwrap();
        }
    });
}

/// A smooth loss of a map: a weighted mean. It is in double precision so that the small change over a short step is not
/// rounded away.
fn loss(map: &Tensor) -> Tensor {
    let size = map.numel() as i64;
    let weights = (Tensor::arange(size, (Kind::Float, Device::Cpu)) * 0.7).sin() + 0.3;
    (map.flatten(0, -1).to_kind(Kind::Double) * weights).mean(Kind::Double)
}

#[test]
fn gradients_of_every_stage_are_those_of_finite_differences() {
    let views = fixtures::still_life(Size::new(128, 96), 3);
    let range = folder::depth_range(&views[0], 1.05).unwrap();
    let planes = Planes { range, count: 16, spacing: Spacing::Depth };
    for name in ["var", "vis-max", "vis-var"] {
        for mode in [Mode::Training, Mode::Evaluation] {
            let mut network = network(name);
            move_off_kinks(&network);
            network.set_mode(Mode::Training).unwrap();
            let options = EstimatorOptions { slab_bytes: usize::MAX, ..EstimatorOptions::of(&network) };
            let mut estimator = Estimator::new(network, options).unwrap();
            gather_statistics(&estimator, &views, &planes);
            estimator.network_mut().set_mode(mode).unwrap();
            let network = estimator.network();
            let encode = || -> Vec<EncodedView> {
                views.iter().map(|view| network.encode(&view.photo).unwrap()).collect()
            };
            let coarse = |views: &[EncodedView]| {
                let sources: Vec<_> = views[1..].iter().collect();
                estimator.coarse(&views[0], &sources, &planes, None, &mut Profile::default()).unwrap()
            };
            let parts = ["coarse_images", "volume", "pair_coarse", "pair_visibility", "visibility_head"];
            assert_gradient(network, &parts, || loss(&coarse(&encode()).map.u));
            if name == "vis-var" {
                let parts = ["coarse_images", "pair_visibility", "visibility_head"];
                assert_gradient(network, &parts, || loss(&coarse(&encode()).visibility[1]));
            }
            let given = tch::no_grad(|| coarse(&encode()));
            for &iteration in &estimator.options().iterations {
                assert_gradient(network, &["flow_images", "flow_net", "pair_flow"], || {
                    let views = encode();
                    let sources: Vec<_> = views[1..].iter().collect();
                    let stage =
                        estimator.flow_stage(&views[0], &sources, &planes, &given.visibility, iteration);
                    let first = 8 / iteration.scale / 2;
                    loss(&stage.refine_phase((first, 0), &given.map.u, &mut Profile::default()).unwrap().u)
                });
            }
        }
    }
}

/// Writes a rendered scene of four views with true depth maps into a folder.
fn scene(folder: &Path) {
    let views = fixtures::still_life(Size::new(128, 96), 4);
    folder::write_mvsnet(folder, &views, |index| format!("{index:08}"), 1.05).unwrap();
    std::fs::create_dir_all(folder.join("depths")).unwrap();
    for (index, view) in views.iter().enumerate() {
        pfm::write(&folder.join(format!("depths/{index:08}.pfm")), &view.depth).unwrap();
    }
}

fn job(folder: &Path, out: &str, steps: usize) -> TrainJob {
    let data = folder.join("data");
    if !data.is_dir() {
        scene(&data);
    }
    let mut options = TrainOptions { steps, coarse_steps: 2, batch: 1, ..TrainOptions::default() };
    options.freeze_norm_after = steps / 2;
    options.optimizer.warm_up = 0;
    options.optimizer.learning_rate = 3e-3;
    options.sample =
        SampleOptions { crop: [96, 64], views: [3, 3], max_planes: 16, ..SampleOptions::default() };
    let dataset = Dataset::open(&[data]).unwrap();
    TrainJob {
        training: dataset.clone(),
        validation: dataset,
        options,
        measure: Validation {
            views: 3,
            max_size: 128,
            max_planes: 16,
            references: 2,
            ..Validation::default()
        },
        validate_every: 1000,
        checkpoint_every: Duration::ZERO,
        out: folder.join(out),
    }
}

#[test]
fn a_short_run_lowers_its_loss_by_a_quarter() {
    let folder = tempfile::tempdir().unwrap();
    let mut job = job(folder.path(), "out", 120);
    job.checkpoint_every = Duration::from_secs(3600);
    let mut losses = Vec::new();
    train(&job, network("vis-max"), &mut |event| {
        if let TrainEvent::Step(record) = event {
            losses.push(record.stages[0].unwrap());
        }
    })
    .unwrap();
    let mean = |part: &[f64]| part.iter().sum::<f64>() / part.len() as f64;
    let (before, after) = (mean(&losses[..10]), mean(&losses[110..]));
    assert!(after < 0.75 * before, "the coarse loss went from {before} to {after}");
    for file in ["log.jsonl", "curves.html", "validation.png"] {
        assert!(job.out.join(file).metadata().unwrap().len() > 0, "{file}");
    }
    for module in ["module.pt", "best.pt"] {
        let written = Network::load(&job.out.join(module), Device::Cpu).unwrap();
        assert!(written.manifest().trained_on.starts_with("120 samples"), "{module}");
    }
}

#[test]
fn the_flow_alone_learns_without_a_change_of_coarse_weights() {
    let folder = tempfile::tempdir().unwrap();
    let mut job = job(folder.path(), "out", 3);
    (job.options.coarse_steps, job.options.freeze_norm_after, job.options.flow_alone) = (0, 0, true);
    let coarse = |name: &str| {
        ["coarse_images", "pair_visibility", "visibility_head", "volume"]
            .iter()
            .any(|part| name.starts_with(part))
    };
    let before = network("vis-var").parameters().unwrap();
    let after = train(&job, network("vis-var"), &mut |_| ()).unwrap().parameters().unwrap();
    for ((name, before), (_, after)) in before.iter().zip(&after) {
        assert_eq!(before.equal(after), coarse(name), "{name}");
    }
    let vis_corr = concat!(env!("CARGO_MANIFEST_DIR"), "/../weights/vis-corr.pt");
    let cascade = Network::load(vis_corr.as_ref(), Device::Cpu).unwrap();
    let error = train(&job, cascade, &mut |_| ()).err().unwrap().to_string();
    assert!(error.contains("flow-alone") && error.contains("cascade"), "{error}");
    job.options.coarse_steps = 1;
    let error = train(&job, network("vis-var"), &mut |_| ()).err().unwrap().to_string();
    assert!(error.contains("coarse-steps"), "{error}");
}

/// Of a cascade all parts learn: both volumes, and the probability of a surface.
#[test]
fn all_parts_of_a_cascade_learn() {
    let folder = tempfile::tempdir().unwrap();
    let mut job = job(folder.path(), "out", 2);
    (job.options.coarse_steps, job.options.freeze_norm_after, job.options.sample.beyond) = (2, 0, 0.5);
    let cascade = || {
        Network::load(concat!(env!("CARGO_MANIFEST_DIR"), "/../weights/vis-corr.pt").as_ref(), Device::Cpu)
            .unwrap()
    };
    let before = cascade().parameters().unwrap();
    let after = train(&job, cascade(), &mut |_| ()).unwrap().parameters().unwrap();
    for part in ["pyramid", "volume", "seen", "fine", "surface_net", "enlarge_net"] {
        let mut of_part = before.iter().zip(&after).filter(|((name, _), _)| name.starts_with(part));
        assert!(of_part.any(|((_, before), (_, after))| !before.equal(after)), "{part}");
    }
    assert!(after.iter().all(|(_, parameter)| parameter.isfinite().all().int64_value(&[]) == 1));
}

#[test]
fn an_interrupted_run_ends_with_the_weights_of_an_undisturbed_one() {
    let folder = tempfile::tempdir().unwrap();
    let undisturbed = train(&job(folder.path(), "a", 8), network("vis-var"), &mut |_| ()).unwrap();
    let job = job(folder.path(), "b", 8);
    for stop in [3, 6] {
        let stopped = catch_unwind(AssertUnwindSafe(|| {
            train(&job, network("vis-var"), &mut |event| {
                assert!(!matches!(event, TrainEvent::Step(record) if record.step == stop), "stop");
            })
        }));
        assert!(stopped.is_err());
    }
    let resumed = train(&job, network("vis-var"), &mut |event| {
        if let TrainEvent::Begun { step, .. } = event {
            assert_eq!(*step, 5, "the step that was interrupted is done again");
        }
    });
    let (a, b) = (undisturbed.parameters().unwrap(), resumed.unwrap().parameters().unwrap());
    for ((name, a), (_, b)) in a.iter().zip(&b) {
        assert!(a.equal(b), "{name} differs");
    }
}

#[test]
fn another_run_in_the_same_folder_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let mut job = job(folder.path(), "out", 2);
    train(&job, network("var"), &mut |_| ()).unwrap();
    job.options.seed = 1;
    let error = train(&job, network("var"), &mut |_| ()).unwrap_err().to_string();
    assert!(error.contains("other options") && error.contains("--out"), "{error}");
    job.options.seed = TrainOptions::default().seed;
    let error = train(&job, network("vis-var"), &mut |_| ()).unwrap_err().to_string();
    assert!(error.contains("another network"), "{error}");
    assert!(train(&job, network("var"), &mut |_| ()).is_ok());
}

#[test]
fn a_view_with_little_truth_is_learnt_from_and_one_without_any_is_not() {
    let folder = tempfile::tempdir().unwrap();
    let TrainJob { training, options, .. } = job(folder.path(), "out", 1);
    let views = &training.scenes[0].views;
    let whole = pfm::read_depth(&views[0].depth).unwrap();
    let nothing = Grid::filled(whole.size(), 0.0_f32);
    let island = |x: usize, y: usize| x.abs_diff(70) < 2 && y.abs_diff(50) < 2;
    let little = Grid::from_fn(whole.size(), |x, y| if island(x, y) { whole[(x, y)] } else { 0.0 });
    let options = SampleOptions { crop: [32, 32], min_scale: 1.0, ..options.sample };
    for view in views {
        pfm::write(&view.depth, &nothing).unwrap();
    }
    let error = draw(&training, (&options, 4.0), 0, 0).unwrap_err().to_string();
    assert!(error.contains("found none, nor in 7 others"), "{error}");
    pfm::write(&views[0].depth, &little).unwrap();
    let drawn: Vec<_> =
        (0..8).filter_map(|number| draw(&training, (&options, 4.0), 0, number).ok()).collect();
    assert!(drawn.len() >= 6, "the view is found in nine of ten draws, {}", drawn.len());
    for sample in drawn {
        assert!(sample.true_depths(1).data().iter().any(|depth| *depth > 0.0));
    }
}

#[test]
fn a_gradient_that_is_not_finite_leaves_the_weights_alone() {
    let network = network("var");
    let mut optimizer = Optimizer::new(&network, &TrainOptions::default().optimizer).unwrap();
    let copies = || network.parameters().unwrap().into_iter().map(|(_, value)| value.copy()).collect();
    let before: Vec<Tensor> = copies();
    (&network.parameters().unwrap()[0].1 * f64::INFINITY).sum(Kind::Float).backward();
    assert!(!optimizer.step(1e-3).unwrap().is_finite());
    let after: Vec<Tensor> = copies();
    assert!(before.iter().zip(&after).all(|(before, after)| before.equal(after)));
}

#[test]
fn a_calibrated_network_tells_the_fitted_share_as_its_confidence() {
    let folder = tempfile::tempdir().unwrap();
    let TrainJob { training, measure, .. } = job(folder.path(), "out", 1);
    let network = network("vis-max");
    let options = EstimatorOptions::of(&network);
    let mut estimator = Estimator::new(network, options).unwrap();
    let sample = whole(&training.scenes[0], 0, (&measure, 4.0)).unwrap();
    let confidence = |estimator: &Estimator| {
        let views = tch::no_grad(|| sample.encode(estimator.network()).unwrap());
        let sources: Vec<_> = views[1..].iter().collect();
        estimator.estimate(&views[0], &sources, &sample.planes, &mut Profile::default()).unwrap().confidence
    };
    let raw = confidence(&estimator);
    let measured = calibrate(&mut estimator, &training, &measure).unwrap();
    assert!(measured.before.pixels() > 0 && measured.before.pixels() == measured.after.pixels());
    let file = folder.path().join("calibrated.pt");
    write_module(estimator.network(), &file).unwrap();
    let network = Network::load(&file, Device::Cpu).unwrap();
    let map = network.manifest().calibration.clone().unwrap();
    let options = EstimatorOptions::of(&network);
    let told = confidence(&Estimator::new(network, options).unwrap());
    for (told, raw) in told.data().iter().zip(raw.data()) {
        assert_eq!(*told, map.at(f64::from(*raw)) as f32);
    }
    // Other weights have no calibration.
    let mut calibrated = Network::load(&file, Device::Cpu).unwrap();
    let mut manifest = calibrated.manifest().clone();
    manifest.refined_calibration = manifest.calibration.clone();
    calibrated.set_manifest(manifest).unwrap();
    let trained = train(&job(folder.path(), "trained", 1), calibrated, &mut |_| ()).unwrap();
    let manifest = trained.manifest();
    assert_eq!((&manifest.calibration, &manifest.refined_calibration), (&None, &None));
    // Calibrating again starts from the raw confidence and gives the same map.
    calibrate(&mut estimator, &training, &measure).unwrap();
    assert_eq!(estimator.network().manifest().calibration, Some(map));
}

#[test]
fn views_can_be_weighted_by_the_true_visibility() {
    let folder = tempfile::tempdir().unwrap();
    let TrainJob { training, measure, .. } = job(folder.path(), "out", 1);
    let network = network("vis-var");
    let options = EstimatorOptions::of(&network);
    let estimator = Estimator::new(network, options).unwrap();
    let mut sample = whole(&training.scenes[0], 0, (&measure, 4.0)).unwrap();
    let views = tch::no_grad(|| sample.encode(estimator.network()).unwrap());
    assert!(sample.masks(estimator.network(), &views[0]).unwrap().is_none(), "it is off by default");
    sample.true_visibility = true;
    let unknown = sample.masks(estimator.network(), &views[0]).unwrap_err().to_string();
    assert!(unknown.contains("true-visibility") && unknown.contains("visibility/"), "{unknown}");

    // The second source view sees only the left half of the reference photograph.
    let size = sample.ground_truth.depth.size();
    let half = |x: usize, _: usize| if x < 64 { Visibility::Visible } else { Visibility::Occluded };
    sample.ground_truth.visibility = vec![Grid::filled(size, Visibility::Visible), Grid::from_fn(size, half)];
    let masks = sample.masks(estimator.network(), &views[0]).unwrap().unwrap();
    let left = Tensor::from_slice(&[[1.0_f32; 8], [0.0; 8]].concat())
        .view([1, 1, 1, 16])
        .expand([1, 1, 12, 16], false);
    assert!(masks[0].equal(&left.ones_like()) && masks[1].equal(&left), "{:?}", masks[1]);
    let swept = |seen| {
        let sources: Vec<_> = views[1..].iter().collect();
        let swept = SweepInputs {
            network: estimator.network(),
            reference: &views[0],
            sources: &sources,
            planes: &sample.planes,
            level: 0,
            around: None,
            slab_bytes: usize::MAX,
        };
        tch::no_grad(|| sweep(&swept, seen)).unwrap()
    };
    let (own, given) = (swept(None), swept(Some(masks)));
    assert!(given.visibility[1].equal(&left) && !own.visibility[1].equal(&left));
    assert!(!own.volume.equal(&given.volume));
}

#[test]
fn files_of_others_are_not_replaced_by_those_of_a_run() {
    let folder = tempfile::tempdir().unwrap();
    for file in ["module.pt", "log.jsonl"] {
        let job = job(folder.path(), file, 1);
        std::fs::create_dir_all(&job.out).unwrap();
        vamvs_io::atomic::write(&job.out.join(file), |out| out.write_all(b"of somebody")).unwrap();
        let error = train(&job, network("vis-max"), &mut |_| ()).unwrap_err().to_string();
        assert!(error.contains(file) && error.contains("choose another --out"), "{error}");
        assert_eq!(std::fs::read(job.out.join(file)).unwrap(), b"of somebody");
    }
}
