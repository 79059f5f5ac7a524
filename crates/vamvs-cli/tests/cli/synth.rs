//! Scenes with known ground truth, made by the program; killed at any moment and started again.

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use tempfile::tempdir;

use crate::scene::{content, error_of, expect_success, stderr, vamvs, write};

fn synth(out: &Path, arguments: &[&str]) -> Command {
    let mut run = vamvs();
    run.args(["synth", "--out"]).arg(out).args(arguments);
    run
}

/// Scenes that take no time.
fn small(out: &Path, scenes: &str, arguments: &[&str]) -> Command {
    let mut run = synth(out, arguments);
    run.args(["--views", "3", "--size", "64x48", "--samples", "2", "--styles", "turntable,facade"]);
    run.args(["--scenes", scenes]);
    run
}

#[test]
fn a_killed_run_resumes_to_the_same_set() {
    let folder = tempdir().unwrap();
    let (whole, killed) = (folder.path().join("whole"), folder.path().join("killed"));
    let begin = Instant::now();
    expect_success(&small(&whole, "3", &["--quiet"]).output().unwrap());
    let whole_time = begin.elapsed().as_secs_f64();
    for share in [0.1, 0.3, 0.5, 0.7, 0.9] {
        let mut run = small(&killed, "3", &["--quiet"]).stdout(Stdio::null()).spawn().unwrap();
        std::thread::sleep(Duration::from_secs_f64(share * whole_time));
        run.kill().unwrap();
        run.wait().unwrap();
    }
    expect_success(&small(&killed, "3", &["--quiet"]).output().unwrap());
    let relative = |root: &Path| -> Vec<_> {
        let files = content(root).into_iter();
        files.map(|(path, bytes)| (path.strip_prefix(root).unwrap().to_owned(), bytes)).collect()
    };
    let (resumed, undisturbed) = (relative(&killed), relative(&whole));
    assert_eq!(resumed.len(), undisturbed.len(), "nothing half-written may be left");
    for (found, expected) in resumed.iter().zip(&undisturbed) {
        assert!(found == expected, "{} differs", expected.0.display());
    }
}

#[test]
fn a_set_is_continued_and_never_overwritten_unasked() {
    let folder = tempdir().unwrap();
    let out = folder.path().join("Übungs set");
    let run = |scenes, arguments: &[&str]| small(&out, scenes, arguments).output().unwrap();
    let made = run("1", &["--json"]);
    expect_success(&made);
    assert!(stderr(&made).contains("1 scenes made, 0 were there"), "{}", stderr(&made));
    let summary = String::from_utf8(made.stdout).unwrap();
    assert!(summary.contains("\"made\":1") && summary.contains("\"style\":\"turntable\""), "{summary}");
    assert!(stderr(&run("2", &[])).contains("1 scenes made, 1 were there"));
    let said = error_of(&run("2", &["--seed", "9"]));
    assert!(said.contains("seed 0 instead of 9") && said.contains("--force"), "{said}");
    assert!(stderr(&run("1", &["--seed", "9", "--force"])).contains("1 scenes made"));
}

#[test]
fn wrong_input_is_told() {
    let folder = tempdir().unwrap();
    let run = |arguments: &[&str]| synth(folder.path(), arguments).output().unwrap();
    let said = error_of(&run(&["--views", "1"]));
    assert!(said.contains("views") && said.contains("got 1"), "{said}");
    let said = error_of(&run(&["--meshes", "no such folder"]));
    assert!(said.contains("no such folder"), "{said}");
    let names = folder.path().join("names.txt");
    write(
        &names,
        "# hold-out
[a\n",
    );
    let said = error_of(&run(&["--exclude", &names.to_string_lossy()]));
    assert!(said.contains("[a"), "{said}");
    for wrong in [["--size", "64"], ["--styles", "garden"], ["--rig", "sphere"]] {
        let output = run(&wrong);
        assert_eq!(output.status.code(), Some(2));
        assert!(stderr(&output).contains(wrong[1]), "{}", stderr(&output));
    }
}
