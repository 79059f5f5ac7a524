//! The default network on a GPU, a software one where there is no other. Where there is none at all, only messages are tested.

use std::path::Path;

use crate::scene::{Scene, expect_success, right, stderr, vamvs};
use vamvs::core::Grid;
use vamvs::io::pfm;
use vamvs::output::OutputFolder;

fn depth(out: &Path, view: usize) -> Grid<f32> {
    pfm::read_depth(&OutputFolder::new(out).depth(&format!("{view:04}"))).unwrap()
}

#[test]
fn depth_maps_of_a_gpu_are_as_good_as_those_of_the_processor() {
    let scene = Scene::new(160, 120, 3);
    if vamvs::gpu::adapters().is_empty() {
        println!("no GPU, not even a software one: nothing is tested");
        return;
    }
    let on_gpu = scene.path("on-gpu");
    expect_success(&scene.run("depth", &[]));
    let output = scene.command_to(&on_gpu, "depth", &["--device", "gpu:0"]).output().unwrap();
    expect_success(&output);
    for (number, view) in scene.views.iter().enumerate() {
        let share = |out: &Path| right(&depth(out, number), &view.depth, 0.01);
        let (gpu, processor) = (share(&on_gpu), share(&scene.out()));
        assert!(
            (gpu - processor).abs() < 0.005,
            "view {number}: {gpu} on the GPU, {processor} on the processor"
        );
    }
    // Maps of the one are not taken for those of the other.
    let again = scene.command_to(&on_gpu, "depth", &[]).output().unwrap();
    assert!(!again.status.success() || stderr(&again).contains("0 were there"), "{}", stderr(&again));
    // A region is made of a part of the features.
    let part = scene.path("part");
    let roi = ["--roi", "-0.6", "-0.6", "-0.6", "0.6", "0.6", "0.6", "--no-refine", "--device", "gpu:0"];
    expect_success(&scene.command_to(&part, "depth", &roi).output().unwrap());
    let inside = depth(&part, 1);
    let with_depth = inside.data().iter().filter(|depth| **depth > 0.0).count();
    assert!((1..inside.data().len()).contains(&with_depth), "{with_depth} pixels have depth");
}

#[test]
fn a_gpu_refines_the_depth_maps_of_a_folder() {
    let scene = Scene::new(160, 120, 3);
    expect_success(&scene.run("depth", &["--no-refine"]));
    let refined = |device: &str| {
        let out = scene.path(device);
        let mut command = vamvs();
        command.arg("refine").arg(scene.out()).args(["--device", device, "--out"]).arg(&out);
        (command.output().unwrap(), out)
    };
    let (output, on_processor) = refined("cpu");
    expect_success(&output);
    let (output, _) = refined("cuda");
    assert!(stderr(&output).contains("expected cpu, gpu, gpu:N or auto"), "{}", stderr(&output));
    if vamvs::gpu::adapters().is_empty() {
        println!("no GPU, not even a software one: no more is tested");
        return;
    }
    let (output, on_gpu) = refined("gpu:0");
    expect_success(&output);
    for (number, view) in scene.views.iter().enumerate() {
        let share = |out: &Path| right(&depth(out, number), &view.depth, 0.01);
        let (gpu, processor) = (share(&on_gpu), share(&on_processor));
        assert!((gpu - processor).abs() < 0.005, "view {number}: {gpu}, on the processor {processor}");
    }
}

#[test]
fn a_gpu_of_software_is_not_chosen_by_itself() {
    let scene = Scene::new(160, 120, 3);
    let output = scene.run("depth", &["--device", "auto"]);
    expect_success(&output);
    let is_hardware = vamvs::gpu::adapters().iter().any(|adapter| !adapter.is_software);
    assert_eq!(stderr(&output).contains("vis-corr on cpu"), !is_hardware, "{}", stderr(&output));
}

#[test]
fn a_gpu_that_is_not_there_is_named_and_nothing_is_written() {
    let scene = Scene::new(160, 120, 3);
    let said = scene.error("depth", &["--device", "gpu:1000"]);
    assert!(said.contains("no GPU 1000"), "{said}");
    let said = scene.error("depth", &["--device", "gpux"]);
    assert!(said.contains("expected gpu"), "{said}");
    let said = scene.error("depth", &["--device", "gpu:0", "--weights", "vis-max"]);
    assert!(said.contains("vis-max") && said.contains("--weights vis-corr"), "{said}");
    let said = scene.error("depth", &["--device", "gpu:0", "--weights", "none"]);
    assert!(said.contains("--weights none has no network"), "{said}");
    let listed = vamvs().args(["info", "device"]).output().unwrap();
    expect_success(&listed);
    let listed = String::from_utf8(listed.stdout).unwrap();
    assert!(listed.contains("cpu: "), "{listed}");
    for (number, adapter) in vamvs::gpu::adapters().iter().enumerate() {
        assert!(listed.contains(&format!("gpu:{number}: {}", adapter.name)), "{listed}");
    }
}
