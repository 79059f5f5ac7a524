//! How the program behaves in a terminal, a pipe and when it is interrupted; needs no network.

use crate::fuse::true_maps;
use crate::scene::{Scene, content, expect_success, stderr, vamvs};

#[cfg(all(unix, feature = "synth"))]
#[test]
fn an_interrupted_run_says_how_to_go_on_and_leaves_nothing_half_written() {
    use std::process::{Command, Stdio};
    let scene = Scene::new(96, 64, 3);
    let set = scene.path("set");
    let synth = |scenes: &str| {
        let mut run = vamvs();
        run.args([
            "synth",
            "--quiet",
            "--views",
            "3",
            "--size",
            "64x48",
            "--samples",
            "2",
            "--styles",
            "facade",
        ]);
        run.args(["--scenes", scenes, "--out"]).arg(&set);
        run
    };
    let mut run = synth("100000").stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    while !set.join("scene-00001/scene.json").exists() {
        assert!(run.try_wait().unwrap().is_none(), "the run ended by itself");
        std::thread::sleep(std::time::Duration::from_millis(10));
    }
    assert!(Command::new("kill").arg("-INT").arg(run.id().to_string()).status().unwrap().success());
    let output = run.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130), "{}", stderr(&output));
    assert!(stderr(&output).contains("the same command again goes on"), "{}", stderr(&output));
    let hidden =
        |path: &std::path::PathBuf| path.file_name().unwrap().to_string_lossy().starts_with(".vamvs-");
    assert!(!content(&set).keys().any(hidden));
    let again = synth("2").arg("--json").output().unwrap();
    expect_success(&again);
    let told: serde_json::Value = serde_json::from_slice(&again.stdout).unwrap();
    assert_eq!((&told["made"], &told["kept"]), (&0.into(), &2.into()));
}

/// The farewell cannot be written, because the pipe is full and nobody reads it: the first Ctrl-C
/// waits forever.
#[cfg(all(unix, feature = "synth"))]
#[test]
fn a_second_interruption_ends_at_once() {
    use std::io::Write;
    use std::process::{Command, Stdio};
    use std::time::Duration;
    let scene = Scene::new(96, 64, 3);
    let set = scene.path("set");
    let (_unread, mut pipe) = std::io::pipe().unwrap();
    let mut run = vamvs();
    run.args(["synth", "--quiet", "--views", "3", "--size", "64x48", "--samples", "2", "--styles", "facade"]);
    run.args(["--scenes", "100000", "--out"]).arg(&set);
    let mut run = run.stdout(Stdio::null()).stderr(pipe.try_clone().unwrap()).spawn().unwrap();
    std::thread::spawn(move || while pipe.write_all(&[b' '; 4096]).is_ok() {});
    while !set.join("scene-00001/scene.json").exists() {
        assert!(run.try_wait().unwrap().is_none(), "the run ended by itself");
        std::thread::sleep(Duration::from_millis(10));
    }
    let mut interrupt = || {
        assert!(Command::new("kill").arg("-INT").arg(run.id().to_string()).status().unwrap().success());
        std::thread::sleep(Duration::from_millis(500));
        run.try_wait().unwrap()
    };
    assert_eq!(interrupt(), None, "the first waits for the pipe");
    // The second ends it; more only if the first has not been noticed yet.
    let ended = (0..20).find_map(|_| interrupt());
    run.kill().unwrap();
    assert_eq!(ended.and_then(|status| status.code()), Some(130));
}

#[test]
fn a_pipe_gets_plain_lines_a_table_of_times_and_no_codes() {
    let scene = Scene::new(96, 64, 3);
    let folder = true_maps(&scene);
    let fuse = |arguments: &[&str]| {
        let output = vamvs().arg("fuse").arg(folder.root()).args(arguments).output().unwrap();
        expect_success(&output);
        stderr(&output)
    };
    let said = fuse(&[]);
    for step in ["fusion", "report", "all"] {
        let line = said.lines().find(|line| line.starts_with(step) && line.ends_with(" s"));
        assert!(line.is_some(), "no {step} in {said}");
    }
    assert!(!said.contains(['\u{1b}', '\r']), "{said:?}");
    assert_eq!(fuse(&["--quiet"]), "");
}

#[test]
fn a_run_goes_on_when_nobody_reads_what_it_prints() {
    let scene = Scene::new(96, 64, 3);
    let folder = true_maps(&scene);
    let closed = || {
        let (reader, writer) = std::io::pipe().unwrap();
        drop(reader);
        writer
    };
    let status = vamvs()
        .arg("fuse")
        .arg(folder.root())
        .arg("--json")
        .stdout(closed())
        .stderr(closed())
        .status()
        .unwrap();
    assert!(status.success(), "{status}");
    assert!(folder.cloud().is_file());
}

#[cfg(target_os = "linux")]
#[test]
fn a_result_that_cannot_be_printed_is_a_failure() {
    let scene = Scene::new(96, 64, 3);
    let folder = true_maps(&scene);
    let full = std::fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    let output = vamvs().arg("fuse").arg(folder.root()).stdout(full).output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    assert!(stderr(&output).contains("cannot write to standard output"), "{}", stderr(&output));
}

#[test]
fn no_colour_where_none_is_wanted() {
    let help = |variable: &str| {
        let output = vamvs().arg("--help").env("CLICOLOR_FORCE", "1").env(variable, "1").output().unwrap();
        String::from_utf8(output.stdout).unwrap()
    };
    assert!(help("UNRELATED").contains('\u{1b}'));
    let plain = vamvs().arg("--help").env("NO_COLOR", "1").output().unwrap();
    assert!(!String::from_utf8(plain.stdout).unwrap().contains('\u{1b}'));
}

#[test]
fn shells_and_man_are_told_all_commands() {
    for shell in ["bash", "zsh", "fish"] {
        let output = vamvs().args(["completions", shell]).output().unwrap();
        expect_success(&output);
        let script = String::from_utf8(output.stdout).unwrap();
        assert!(["report", "fuse", "min-views"].iter().all(|word| script.contains(word)), "{shell}");
    }
    let folder = tempfile::tempdir().unwrap();
    expect_success(&vamvs().arg("man").arg(folder.path()).output().unwrap());
    let pages = content(folder.path());
    let names: Vec<_> = pages.keys().map(|path| path.file_name().unwrap().to_string_lossy()).collect();
    for name in ["vamvs.1", "vamvs-fuse.1", "vamvs-eval-cloud.1"] {
        assert!(names.contains(&name.into()), "{names:?}");
    }
    let page = vamvs().arg("man").output().unwrap();
    expect_success(&page);
    assert!(page.stdout.starts_with(b".") && pages[&folder.path().join("vamvs.1")] == page.stdout);
}
