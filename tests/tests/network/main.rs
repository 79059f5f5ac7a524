//! The network crate on rendered scenes: accuracy against exact ground truth, invariances, and independence of the
//! sizes of slabs and strips.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

mod cascade;
mod cost_volume;
mod estimates;
mod invariance;
mod layers;
mod rust_alone;

use vamvs_core::{DepthMap, Photo, Planes, Spacing};
use vamvs_net::cost_volume::SweepInputs;
use vamvs_net::tch;
use vamvs_net::{Device, EncodedView, Estimator, EstimatorOptions, Network, Profile};
use vamvs_tests::{Rendered, folder};

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

/// A sweep without a limit on the size of its slabs: all planes are one slab.
fn swept<'a>(
    network: &'a Network,
    reference: &'a EncodedView,
    sources: &'a [&'a EncodedView],
    planes: &'a Planes,
    level: usize,
) -> SweepInputs<'a> {
    SweepInputs { network, reference, sources, planes, level, around: None, slab_bytes: usize::MAX }
}
