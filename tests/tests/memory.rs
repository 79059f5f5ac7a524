//! The predicted peak memory of a depth map against the measured peak of the process.

#![cfg(target_os = "linux")]
#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::process::Command;

use vamvs_core::{Planes, Size, Spacing};
use vamvs_net::{Device, Estimator, EstimatorOptions, Network, Profile, tch};
use vamvs_tests::{Rendered, fixtures, folder};

/// The allocator of the command.
#[global_allocator]
static MIMALLOC: mimalloc::MiMalloc = mimalloc::MiMalloc;

/// Views of a depth map, the reference view included.
const VIEWS: usize = 3;
/// Planes of the sweep.
const PLANES: usize = 64;

/// Accepted ratios of the predicted to the measured peak, which varies by a twentieth from run to run. Small
/// maps are the hardest to predict, since most of their memory is not in tensors.
const LIKELY: std::ops::Range<f64> = 0.9..1.3;

/// Environment variable that tells the child process what to measure: `NETWORK COARSE_STRIDE WIDTHxHEIGHT`.
const ASKED: &str = "VAMVS_TEST_PEAK";

/// Built-in networks with the coarse strides they are used with.
const NETWORKS: [(&str, usize); 5] =
    [("photometric", 8), ("vis-max", 8), ("vis-max", 4), ("vis-corr", 4), (WITHOUT_LIBTORCH, 4)];

/// Stands for vis-corr in Rust alone.
const WITHOUT_LIBTORCH: &str = "vis-corr.safetensors";

#[test]
fn the_expected_peak_is_that_of_the_process() {
    if let Ok(asked) = std::env::var(ASKED) {
        return measure(&asked);
    }
    let mut ratios = Vec::new();
    for (network, coarse_stride) in NETWORKS {
        for size in ["320x240", "512x384"] {
            let (expected, peak) = peak_in_a_process(&format!("{network} {coarse_stride} {size}"));
            let ratio = expected / peak;
            println!(
                "{network}, a coarse stride of {coarse_stride}, {size}: {expected:.0} MiB predicted, {peak:.0} measured"
            );
            ratios
                .push((format!("{network}, a coarse stride of {coarse_stride}, {size}: {ratio:.2}"), ratio));
        }
    }
    let wrong: Vec<_> = ratios.iter().filter(|(_, ratio)| !LIKELY.contains(ratio)).collect();
    assert!(wrong.is_empty(), "predicted over measured: {wrong:?}");
}

/// The predicted and the measured peak of a child process that makes one depth map, MiB.
fn peak_in_a_process(asked: &str) -> (f64, f64) {
    let name = "the_expected_peak_is_that_of_the_process";
    let mut child = Command::new(std::env::current_exe().unwrap());
    // Freed memory is returned after a tenth of a second instead of one: one is as long as such a small map takes, and
    // the peak would depend on how fast the machine is.
    child.env(ASKED, asked).env("MIMALLOC_PURGE_DELAY", "10");
    let output = child.args([name, "--exact", "--nocapture"]).output().unwrap();
    let said = String::from_utf8(output.stdout).unwrap();
    let line = said.lines().find_map(|line| line.split_once("peak of ")).expect(&said).1;
    let (expected, peak) = line.split_once(' ').unwrap();
    (expected.parse().unwrap(), peak.parse().unwrap())
}

/// Makes a depth map in this process and prints the predicted and the measured peak.
fn measure(asked: &str) {
    let parts: Vec<&str> = asked.split(' ').collect();
    let (width, height) = parts[2].split_once('x').unwrap();
    let size = Size::new(width.parse().unwrap(), height.parse().unwrap());
    let views = fixtures::still_life(size, VIEWS);
    if parts[0] == WITHOUT_LIBTORCH {
        return measure_without_libtorch(&views, size);
    }
    let path = format!("{}/../weights/{}.pt", env!("CARGO_MANIFEST_DIR"), parts[0]);
    let mut network = Network::load(path.as_ref(), Device::Cpu).unwrap();
    network.set_coarse_stride(parts[1].parse().unwrap()).unwrap();
    let options = EstimatorOptions::of(&network);
    let estimator = Estimator::new(network, options).unwrap();
    let range = folder::depth_range(&views[0], 1.05).unwrap();
    let planes = Planes { range, count: PLANES, spacing: Spacing::Depth };
    let before = held("VmRSS:");
    let encoded: Vec<_> =
        tch::no_grad(|| views.iter().map(|view| estimator.network().encode(&view.photo).unwrap()).collect());
    let sources: Vec<_> = encoded[1..].iter().collect();
    estimator.estimate(&encoded[0], &sources, &planes, &mut Profile::default()).unwrap();
    let expected = before + estimator.peak_bytes(size, VIEWS, PLANES) as f64 / f64::from(1 << 20);
    println!("\npeak of {expected:.1} {:.1}", held("VmHWM:"));
}

/// As [`measure`], of vis-corr in Rust alone.
fn measure_without_libtorch(views: &[Rendered], size: Size) {
    let network = vamvs_corr::Network::new(vamvs_weights::VIS_CORR).unwrap();
    let range = folder::depth_range(&views[0], 1.05).unwrap();
    let planes = Planes { range, count: PLANES, spacing: Spacing::Depth };
    let before = held("VmRSS:");
    let encoded: Vec<_> = views.iter().map(|view| network.encode(&view.photo).unwrap()).collect();
    let sources: Vec<_> = encoded[1..].iter().collect();
    network.estimate(&encoded[0], &sources, &planes, &mut |_, run| run()).unwrap();
    let expected = before + network.peak_bytes(size, VIEWS, PLANES) as f64 / f64::from(1 << 20);
    println!("\npeak of {expected:.1} {:.1}", held("VmHWM:"));
}

/// The value of the line of `/proc/self/status` that begins with `what`, MiB.
fn held(what: &str) -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find_map(|line| line.strip_prefix(what)).unwrap();
    line.trim().trim_end_matches(" kB").parse::<f64>().unwrap() / 1024.0
}
