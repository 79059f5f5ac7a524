//! A reconstruction in tasks: the same bytes as in one process, whatever order they are done in.

use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;

use crate::scene::{Scene, content, error_of, expect_success, stderr, truncate, vamvs, write};

/// A network, where there are any.
const METHOD: &str = "vis-corr";

const WEIGHTS: [&str; 5] = ["--weights", METHOD, "--planes", "24", "--quiet"];

/// The tasks of a scene, of two views each.
fn tasks(scene: &Scene) -> Vec<Value> {
    tasks_with(scene, &[])
}

/// The same with more arguments.
fn tasks_with(scene: &Scene, arguments: &[&str]) -> Vec<Value> {
    let output = scene.run("tasks", &[&WEIGHTS[..], &["--batch", "2"], arguments].concat());
    expect_success(&output);
    String::from_utf8(output.stdout)
        .unwrap()
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect()
}

fn strings(value: &Value) -> Vec<&str> {
    value.as_array().unwrap().iter().map(|item| item.as_str().unwrap()).collect()
}

fn command(task: &Value) -> Command {
    let argv = strings(&task["argv"]);
    assert_eq!(argv[0], "vamvs");
    let mut command = vamvs();
    command.args(&argv[1..]);
    command
}

fn done(task: &Value) -> Output {
    command(task).output().unwrap()
}

/// Runs tasks, always the last one whose dependencies are done, and checks that their inputs and
/// outputs exist.
fn do_all(tasks: &[Value]) {
    let mut left: Vec<&Value> = tasks.iter().collect();
    while !left.is_empty() {
        let waits = |task: &&Value| {
            let ids = strings(&task["dependencies"]);
            left.iter().any(|other| ids.contains(&other["id"].as_str().unwrap()))
        };
        let next = left.iter().rposition(|task| !waits(task)).expect("the graph has no circle");
        let task = left.remove(next);
        let all_there = |files: &Value| strings(files).iter().all(|file| Path::new(file).is_file());
        assert!(all_there(&task["inputs"]), "{task}");
        expect_success(&done(task));
        assert!(all_there(&task["outputs"]), "{task}");
    }
}

fn with_id<'a>(tasks: &'a [Value], id: &str) -> &'a Value {
    tasks.iter().find(|task| task["id"] == id).unwrap_or_else(|| panic!("no task {id}"))
}

/// Everything that a run leaves but times, settings and records of tasks.
fn results(scene: &Scene) -> Vec<(String, Vec<u8>)> {
    let mut files: Vec<_> = content(&scene.out())
        .into_iter()
        .map(|(path, bytes)| (path.strip_prefix(scene.out()).unwrap().to_str().unwrap().to_owned(), bytes))
        .filter(|(name, _)| {
            !name.starts_with("parts") && !["run.toml", "fusion.json", "report.html"].contains(&&**name)
        })
        .collect();
    files.sort();
    files
}

#[test]
fn tasks_in_any_order_give_the_bytes_of_one_process() {
    let scene = Scene::new(128, 96, 6);
    expect_success(&scene.run("reconstruct", &[&WEIGHTS[..], &["--mesh"]].concat()));
    let whole = results(&scene);
    assert!(whole.iter().any(|(name, _)| name == "mesh.ply"));
    std::fs::remove_dir_all(scene.out()).unwrap();
    let tasks = tasks_with(&scene, &["--mesh"]);
    assert_eq!(tasks.len(), 3 + 3 + 1 + 3 + 3 + 3 + 3 + 1 + 1);
    do_all(&tasks);
    let names = |results: &[(String, Vec<u8>)]| -> Vec<String> {
        results.iter().map(|(name, _)| name.clone()).collect()
    };
    let spread = results(&scene);
    assert_eq!(names(&spread), names(&whole));
    for ((name, spread), (_, whole)) in spread.iter().zip(&whole) {
        assert!(spread == whole, "{name} differs");
    }
}

#[test]
fn a_killed_task_is_done_again_and_what_is_done_stays() {
    let scene = Scene::new(128, 96, 4);
    let tasks = tasks(&scene);
    let first = with_id(&tasks, "photometric-1-of-2");
    let mut killed = command(first).spawn().unwrap();
    std::thread::sleep(std::time::Duration::from_millis(300));
    killed.kill().unwrap();
    killed.wait().unwrap();
    do_all(&tasks);
    let cloud = std::fs::read(scene.out().join("fused.ply")).unwrap();
    let written = |name: &str| std::fs::metadata(scene.out().join(name)).unwrap().modified().unwrap();
    let before = written("depths/0001.pfm");
    do_all(&tasks);
    assert!(written("depths/0001.pfm") == before, "a depth map that is there is not made again");
    assert!(std::fs::read(scene.out().join("fused.ply")).unwrap() == cloud);
}

#[test]
fn what_is_missing_or_damaged_is_named() {
    let scene = Scene::new(128, 96, 4);
    let tasks = tasks_with(&scene, &["--mesh"]);
    let fails = |id: &str| error_of(&done(with_id(&tasks, id)));
    assert!(fails("collect").contains("part 1/2 of the geometric step is not done"));
    assert!(fails("geometric-1-of-2").contains("part 1/2 of the photometric step is not done"));
    // A part holds views that see the same surfaces, but some of their source views are in the other one.
    expect_success(&done(with_id(&tasks, "photometric-1-of-2")));
    assert!(fails("geometric-1-of-2").contains("part 2/2 of the photometric step is not done"));
    assert!(!scene.out().join("parts/geometric-1-of-2.json").exists());
    for id in ["photometric-1-of-2", "photometric-2-of-2", "geometric-1-of-2", "geometric-2-of-2", "collect"]
    {
        expect_success(&done(with_id(&tasks, id)));
    }
    assert!(fails("merge-1-of-2").contains("counts-1-of-2"));
    for id in ["confirm-1-of-2", "confirm-2-of-2"] {
        expect_success(&done(with_id(&tasks, id)));
    }
    let pixels = scene.out().join("parts/pixels-1-of-2");
    let whole = std::fs::read(&pixels).unwrap();
    truncate(&pixels);
    assert!(fails("merge-1-of-2").contains("pixels-1-of-2"));
    let mut wrong = whole;
    let last = wrong.len() - 1;
    wrong[last] ^= 1;
    write(&pixels, &wrong);
    assert!(fails("merge-1-of-2").contains("damaged"));
    // The task that made it notices the damage too.
    expect_success(&done(with_id(&tasks, "confirm-1-of-2")));
    expect_success(&done(with_id(&tasks, "merge-1-of-2")));
    assert!(fails("concatenate").contains("points-2-of-2"));
    assert!(fails("surface-1-of-2").contains("outlines-1-of-2: is missing: run `vamvs mesh --step outline`"));
    truncate(&pixels);
    assert!(fails("outline-1-of-2").contains("pixels-1-of-2"));
    assert!(!scene.out().join("parts/outlines-1-of-2").exists());
    expect_success(&done(with_id(&tasks, "confirm-1-of-2")));
    for id in ["outline-1-of-2", "outline-2-of-2", "surface-1-of-2"] {
        expect_success(&done(with_id(&tasks, id)));
    }
    assert!(fails("join").contains("surfaces-2-of-2"));
    assert!(!scene.out().join("mesh.ply").exists());
    assert!(!scene.out().join("fused.ply").exists());
}

#[test]
fn depth_maps_of_other_settings_and_damaged_ones_are_not_refined_further() {
    let scene = Scene::new(128, 96, 4);
    let photometric = ["photometric-1-of-2", "photometric-2-of-2"];
    let before = tasks_with(&scene, &["--views", "3"]);
    photometric.iter().for_each(|id| expect_success(&done(with_id(&before, id))));
    let tasks = tasks(&scene);
    let geometric = with_id(&tasks, "geometric-1-of-2");
    assert!(error_of(&done(geometric)).contains("of the photometric step is not done"));
    photometric.iter().for_each(|id| expect_success(&done(with_id(&tasks, id))));
    let map = scene.out().join("photometric/depths/0001.pfm");
    let whole = std::fs::read(&map).unwrap();
    truncate(&map);
    assert!(error_of(&done(geometric)).contains("of the photometric step is not done"));
    photometric.iter().for_each(|id| expect_success(&done(with_id(&tasks, id))));
    assert!(std::fs::read(&map).unwrap() == whole);
    expect_success(&done(geometric));
}

#[test]
fn tasks_are_strict_if_that_is_asked_for_and_never_forced() {
    let scene = Scene::new(64, 48, 4);
    let tasks = tasks_with(&scene, &["--strict"]);
    for task in &tasks {
        let id = task["id"].as_str().unwrap();
        let is_strict = strings(&task["argv"]).contains(&"--strict");
        assert_eq!(is_strict, !id.starts_with("photometric") && !id.starts_with("geometric"), "{id}");
    }
    let forced = scene.run("tasks", &[&WEIGHTS[..], &["--force"]].concat());
    assert!(error_of(&forced).contains("--force"));
}

#[test]
fn a_damaged_photograph_costs_its_view_alone_and_is_told_at_the_end() {
    let scene = Scene::new(128, 96, 4);
    let tasks = tasks(&scene);
    truncate(&scene.path("images/0002.png"));
    let collect = with_id(&tasks, "collect");
    for task in &tasks {
        let output = done(task);
        expect_success(&output);
        if task["id"] == collect["id"] {
            assert!(stderr(&output).contains("0002.png is left out"), "{}", stderr(&output));
        }
    }
    assert!(scene.out().join("depths/0001.pfm").exists() && !scene.out().join("depths/0002.pfm").exists());
    assert!(std::fs::read_to_string(scene.out().join("left-out.json")).unwrap().contains("0002.png"));
    // A second start finds the other views done, though one of their source views is not.
    let written = || std::fs::metadata(scene.out().join("depths/0001.pfm")).unwrap().modified().unwrap();
    let before = written();
    tasks.iter().for_each(|task| expect_success(&done(task)));
    assert!(written() == before);
}

#[test]
fn steps_want_their_part() {
    let scene = Scene::new(64, 48, 2);
    for (arguments, expected) in [
        (&["--step", "photometric"][..], "--part"),
        (&["--step", "collect"], "--parts"),
        (&["--part", "1/2"], "--step"),
        (&["--step", "photometric", "--part", "3/2"], "expected a part such as 1/4"),
    ] {
        let output = scene.run("depth", arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        assert!(stderr(&output).contains(expected), "{}", stderr(&output));
    }
    let said = scene.error("depth", &[&WEIGHTS[..], &["--step", "photometric", "--part", "1/3"]].concat());
    assert!(said.contains("at most as many parts as the 2 views"), "{said}");
}
