//! Bad input: a clear error with exit code 1, or handling that the documentation describes.

use crate::scene::{Scene, content, error_of, expect_success, stderr, truncate, vamvs, write};
use vamvs::core::{Grid, Size};
use vamvs::io::image;
use vamvs::output::Record;

const QUICK: [&str; 4] = ["--iterations", "0", "--planes", "16"];

fn small() -> Scene {
    Scene::new(96, 64, 3)
}

/// Replaces a line of a camera file.
fn edit_cam(scene: &Scene, view: usize, line: usize, text: &str) {
    let path = scene.path(&format!("cams/{view:04}_cam.txt"));
    let old = std::fs::read_to_string(&path).unwrap();
    let lines: Vec<_> = old.lines().enumerate().map(|(i, old)| if i == line { text } else { old }).collect();
    write(&path, lines.join("\n"));
}

/// The line of a camera file that holds the depth range.
const DEPTH_LINE: usize = 11;

#[test]
fn a_missing_photograph_is_named_and_an_extra_one_is_a_warning() {
    let scene = small();
    image::save_png_rgb(&scene.path("images/extra.png"), &scene.views[0].photo.image).unwrap();
    let output = scene.run("depth", &QUICK);
    expect_success(&output);
    assert!(stderr(&output).contains("warning: "), "{}", stderr(&output));
    std::fs::remove_file(scene.path("images/0001.png")).unwrap();
    let output = scene.run("depth", &QUICK);
    expect_success(&output);
    let said = stderr(&output);
    assert!(said.contains("1 of the scene's 3 photographs are missing") && said.contains("0001"), "{said}");
    std::fs::remove_file(scene.path("images/0000.png")).unwrap();
    let said = scene.error("depth", &QUICK);
    assert!(
        said.contains("half of the scene's photographs or more are missing there, 2")
            && said.contains("0001"),
        "{said}"
    );
}

#[test]
fn depth_lines_without_a_range_are_warned_of_and_the_flag_wins() {
    for text in ["5 0 10 5", "5 0.1 10 2", "-1 0.1", "0 0.1"] {
        let scene = small();
        edit_cam(&scene, 1, DEPTH_LINE, text);
        let output = scene.run("depth", &[&QUICK[..], &["--depth-range", "2", "9"]].concat());
        expect_success(&output);
        let said = stderr(&output);
        assert!(said.contains("0001_cam.txt: the depth line is not used"), "{text}: {said}");
    }
}

#[test]
fn cameras_that_are_none_are_named_with_file_and_field() {
    for (line, text, expected) in [
        (1, "nan 0 0 0", "not a finite number"),
        (1, "5 0 0 0", "not a rotation"),
        (7, "0 0 48", "focal lengths"),
        (7, "inf 0 48", "focal lengths"),
        (DEPTH_LINE, "5", "depth line"),
    ] {
        let scene = small();
        [1, 2].into_iter().for_each(|view| edit_cam(&scene, view, line, text));
        let said = scene.error("depth", &QUICK);
        assert!(said.contains("0001_cam.txt") && said.contains(expected), "{text}: {said}");
        assert!(!scene.out().exists(), "{text}: nothing may be written");
    }
}

#[test]
fn one_broken_camera_among_good_ones_is_left_out_and_told() {
    let scene = small();
    edit_cam(&scene, 1, 1, "-nan(ind) 0 0 0");
    let output = scene.run("depth", &QUICK);
    expect_success(&output);
    let said = stderr(&output);
    assert!(
        said.contains("1 of the scene's 3 cameras cannot be used") && said.contains("0001_cam.txt"),
        "{said}"
    );
    assert!(said.contains("2 depth maps made"), "{said}");
    let said = scene.error("depth", &[&QUICK[..], &["--strict"]].concat());
    assert!(said.contains("1 camera(s) cannot be used, and --strict allows none"), "{said}");
}

#[test]
fn a_depth_line_of_min_and_max_is_read_as_such_and_said() {
    let scene = small();
    edit_cam(&scene, 1, DEPTH_LINE, "3 9");
    let output = scene.run("depth", &[&QUICK[..], &["--verbose"]].concat());
    expect_success(&output);
    let said = stderr(&output);
    assert!(said.contains("warning: ") && said.contains("0001.png: depth 3.0000 to 9.0000"), "{said}");
    let output =
        scene.run("depth", &["--depth-line", "min-interval", "--iterations", "0", "--planes", "16", "-v"]);
    expect_success(&output);
    assert!(stderr(&output).contains("0001.png: depth 3.0000 to 1722.0000"), "{}", stderr(&output));
}

#[test]
fn one_view_and_views_without_overlap_are_errors() {
    let alone = Scene::new(96, 64, 1);
    assert!(alone.error("depth", &QUICK).contains("at least 2"));
    let scene = Scene::new(96, 64, 2);
    // The second camera looks away from what the first one sees, from far away.
    let (r, t) = (scene.views[0].photo.cam_from_world.rotation, [900.0, 0.0, -900.0]);
    for row in 0..3 {
        let flip = if row == 1 { 1.0 } else { -1.0 };
        let numbers =
            format!("{} {} {} {}", flip * r[(row, 0)], flip * r[(row, 1)], flip * r[(row, 2)], t[row]);
        edit_cam(&scene, 1, 1 + row, &numbers);
    }
    let said = scene.error("depth", &QUICK);
    assert!(said.contains("no depth can be estimated for any of the 2 views"), "{said}");
}

#[test]
fn grey_sixteen_bit_and_transparent_photographs_work() {
    let scene = small();
    let first = &scene.views[0].photo.image;
    let grey = first.map(|[r, g, b]| 257 * ((u16::from(*r) + u16::from(*g) + u16::from(*b)) / 3));
    image::save_png_gray16(&scene.path("images/0000.png"), &grey).unwrap();
    expect_success(&scene.run("depth", &QUICK));
}

#[test]
fn a_photograph_of_another_size_is_fitted_with_a_note_or_refused() {
    let scene = small();
    let half = image::resize(&scene.views[1].photo.image, Size::new(48, 32));
    image::save_png_rgb(&scene.path("images/0001.png"), &half).unwrap();
    let output = scene.run("depth", &QUICK);
    expect_success(&output);
    let square = Grid::filled(Size::new(64, 64), [9, 9, 9]);
    image::save_png_rgb(&scene.path("images/0001.png"), &square).unwrap();
    // Camera files of MVSNet have no size, so a square photograph only contradicts those of COLMAP.
    let model = scene.path("sparse");
    std::fs::create_dir_all(&model).unwrap();
    write(&model.join("cameras.txt"), "1 PINHOLE 96 64 90 90 48 32\n");
    write(&model.join("images.txt"), "1 1 0 0 0 0 0 0 1 0000.png\n\n2 1 0 0 0 1 0 0 1 0001.png\n\n");
    write(&model.join("points3D.txt"), "");
    let run = |arguments: &[&str]| {
        let mut run = vamvs();
        run.args(["depth", "--colmap"]).arg(&model).arg("--images").arg(scene.path("images"));
        run.arg("--out").arg(scene.path("out2")).args(arguments).output().unwrap()
    };
    let said = error_of(&run(&["--depth-range", "2", "8", "--iterations", "0", "--planes", "16"]));
    assert!(said.contains("64×64") && said.contains("96×64"), "{said}");
}

#[test]
fn a_corrupt_photograph_is_named_and_its_view_left_out() {
    let scene = small();
    let bytes = std::fs::read(scene.path("images/0001.png")).unwrap();
    write(&scene.path("images/0001.png"), &bytes[..bytes.len() / 2]);
    let output = scene.run("depth", &QUICK);
    expect_success(&output);
    let said = stderr(&output);
    assert!(said.contains("warning: 0001.png is left out") && said.contains("1 views left out"), "{said}");
    let map = |name: &str| scene.out().join(format!("depths/{name}.pfm"));
    assert!(map("0000").exists() && !map("0001").exists() && map("0002").exists());
    let pairs = std::fs::read_to_string(scene.out().join("pair.txt")).unwrap();
    assert!(pairs.starts_with("2\n"), "{pairs}");
    let said = scene.error("depth", &[&QUICK[..], &["--strict"]].concat());
    assert!(said.contains("0001.png"), "{said}");
    let page = || {
        expect_success(&vamvs().arg("report").arg(scene.out()).output().unwrap());
        std::fs::read_to_string(scene.out().join("report.html")).unwrap()
    };
    assert!(page().contains("Views left out") && page().contains("<td>0001.png</td>"));
    write(&scene.path("images/0001.png"), &bytes);
    expect_success(&scene.run("depth", &QUICK));
    assert!(!page().contains("Views left out"));
}

#[test]
fn truncated_and_boastful_colmap_models_are_named() {
    let scene = small();
    let model = scene.path("sparse");
    std::fs::create_dir_all(&model).unwrap();
    for (cameras, expected) in [(&[1, 0, 0][..], "cameras.bin"), (&[255; 8][..], "cameras.bin")] {
        write(&model.join("cameras.bin"), cameras);
        write(&model.join("images.bin"), [0; 8]);
        write(&model.join("points3D.bin"), [0; 8]);
        let output = vamvs()
            .arg("depth")
            .arg("--colmap")
            .arg(&model)
            .arg("--images")
            .arg(scene.path("images"))
            .output();
        let said = error_of(&output.unwrap());
        assert!(said.contains(expected), "{said}");
    }
}

#[test]
fn a_missing_photograph_of_a_colmap_model_costs_its_view_alone() {
    let scene = Scene::new(96, 64, 4);
    let (images, loaded) = (scene.path("images"), scene.write_colmap("sparse/0"));
    std::fs::remove_file(images.join("0002.png")).unwrap();
    let range = loaded.views[1].depth_range.unwrap();
    let depth = |more: &[&str]| {
        let mut run = vamvs();
        run.arg("depth")
            .arg("--colmap")
            .arg(&scene.root)
            .arg("--out")
            .arg(scene.out())
            .args(QUICK)
            .args(more);
        run.arg("--depth-range")
            .args([range.near, range.far].map(|depth| depth.to_string()))
            .output()
            .unwrap()
    };
    let output = depth(&[]);
    expect_success(&output);
    assert!(stderr(&output).contains("0002.png is left out"), "{}", stderr(&output));
    assert!(scene.out().join("depths/0001.pfm").exists() && !scene.out().join("depths/0002.pfm").exists());
    assert!(error_of(&depth(&["--strict"])).contains("0002.png"));
    std::fs::remove_file(images.join("0003.png")).unwrap();
    assert!(error_of(&depth(&[])).contains("half of the scene's photographs or more are missing there, 2"));
}

#[test]
fn other_views_take_the_place_of_missing_photographs() {
    let scene = Scene::new(96, 64, 8);
    let (images, loaded) = (scene.path("images"), scene.write_colmap("sparse/0"));
    for name in ["0001.png", "0003.png", "0005.png"] {
        std::fs::remove_file(images.join(name)).unwrap();
    }
    let mut run = vamvs();
    run.arg("depth").arg("--colmap").arg(&scene.root).arg("--out").arg(scene.out()).args(QUICK);
    let range = loaded.views[1].depth_range.unwrap();
    run.arg("--depth-range").args([range.near, range.far].map(|depth| depth.to_string()));
    expect_success(&run.output().unwrap());
    for view in ["0000", "0002", "0004", "0006", "0007"] {
        let record = std::fs::read(scene.out().join(format!("depths/{view}.json"))).unwrap();
        let record: Record = serde_json::from_slice(&record).unwrap();
        assert_eq!(record.sources.len(), 4, "{view}: {:?}", record.sources);
    }
}

#[test]
fn one_run_at_a_time_writes_to_a_folder() {
    let scene = small();
    expect_success(&scene.run("depth", &QUICK));
    let mark = std::fs::File::open(scene.out().join(".vamvs")).unwrap();
    mark.lock().unwrap();
    let before = content(&scene.out());
    assert!(scene.error("depth", &QUICK).contains("another run of vamvs writes to this folder"));
    let cloud = scene.path("cloud.ply");
    for out in [&[][..], &["--out", cloud.to_str().unwrap()]] {
        let said = error_of(&vamvs().arg("fuse").arg(scene.out()).args(out).output().unwrap());
        assert!(said.contains("another run of vamvs"), "{said}");
    }
    assert!(content(&scene.out()) == before);
    mark.unlock().unwrap();
    expect_success(&scene.run("depth", &QUICK));
}

#[test]
fn output_that_cannot_be_written_is_named() {
    let scene = small();
    write(&scene.path("out"), "a file where the folder should be");
    let said = scene.error("depth", &QUICK);
    assert!(said.contains("out"), "{said}");
    assert_eq!(std::fs::read(scene.path("out")).unwrap(), b"a file where the folder should be");
}

#[test]
fn depth_maps_of_another_scene_are_not_mixed_in() {
    let scene = small();
    expect_success(&scene.run("depth", &QUICK));
    for folder in ["images/0002.png", "cams/0002_cam.txt"] {
        std::fs::remove_file(scene.path(folder)).unwrap();
    }
    let said = scene.error("depth", &QUICK);
    assert!(said.contains("0002_cam.txt") && said.contains("--out"), "{said}");
}

#[test]
fn the_scene_itself_is_never_overwritten() {
    let scene = small();
    let before = content(&scene.root);
    let said = error_of(&scene.command_to(&scene.root, "depth", &QUICK).output().unwrap());
    assert!(said.contains("would be overwritten"), "{said}");
    assert!(content(&scene.root) == before);
}

#[test]
fn files_that_vamvs_has_not_written_stay() {
    let scene = small();
    let mine = scene.path("mine");
    for file in [
        "pair.txt",
        "depths/0001.pfm",
        "depths/0002.png",
        "visibility/0000.png",
        "normals/0002.pfm",
        "fused.ply",
        "run.toml",
    ] {
        // Somebody's JSON is no record of vamvs.
        std::fs::create_dir_all(mine.join("depths")).unwrap();
        write(&mine.join("depths/camera.json"), "{}");
        std::fs::create_dir_all(mine.join(file).parent().unwrap()).unwrap();
        write(&mine.join(file), "of somebody");
        let before = content(&mine);
        for arguments in [&QUICK[..], &[&QUICK[..], &["--step", "photometric", "--part", "1/1"]].concat()] {
            let said = error_of(&scene.command_to(&mine, "depth", arguments).output().unwrap());
            assert!(said.contains(file) && said.contains("was not written by vamvs"), "{said}");
        }
        assert!(content(&mine) == before);
        std::fs::remove_dir_all(&mine).unwrap();
    }
    // Nor is a cloud written over what is none.
    expect_success(&scene.run("depth", &QUICK));
    let pairs = scene.out().join("pair.txt");
    let before = std::fs::read(&pairs).unwrap();
    let said = error_of(&vamvs().arg("fuse").arg(scene.out()).arg("--out").arg(&pairs).output().unwrap());
    assert!(said.contains("pair.txt") && std::fs::read(&pairs).unwrap() == before, "{said}");
    let report = scene.out().join("report.html");
    write(&report, "<html>of somebody</html>");
    assert!(error_of(&vamvs().arg("report").arg(scene.out()).output().unwrap()).contains("report.html"));
    // It is noticed before anything is fused, and so is somebody's record.
    let cloud = scene.out().join("fused.ply");
    let fuse = |arguments: &[&str]| vamvs().arg("fuse").arg(scene.out()).args(arguments).output().unwrap();
    assert!(error_of(&fuse(&[])).contains("report.html") && !cloud.exists());
    expect_success(&fuse(&["--no-report"]));
    std::fs::remove_file(&report).unwrap();
    write(&scene.out().join("fusion.json"), "of somebody");
    std::fs::remove_file(&cloud).unwrap();
    assert!(error_of(&fuse(&["--no-report"])).contains("fusion.json") && !cloud.exists());
    std::fs::remove_file(scene.out().join("fusion.json")).unwrap();
    // What is not in the way stays too, and does not hinder.
    std::fs::create_dir(&mine).unwrap();
    write(&mine.join("notes.txt"), "of somebody");
    for _ in 0..2 {
        expect_success(&scene.command_to(&mine, "depth", &QUICK).output().unwrap());
    }
    assert_eq!(std::fs::read(mine.join("notes.txt")).unwrap(), b"of somebody");
    assert!(!mine.join("photometric").exists());
}

#[test]
fn masks_leave_no_depth_and_a_wrong_folder_of_masks_is_an_error() {
    let scene = small();
    let masks = scene.path("masks");
    let arguments =
        ["--masks", masks.to_str().unwrap(), "--iterations", "0", "--planes", "16", "--no-refine"];
    assert!(scene.error("depth", &arguments).contains("expected a folder of masks"));
    std::fs::create_dir_all(&masks).unwrap();
    let black_left = Grid::from_fn(Size::new(96, 64), |x, _| if x < 48 { 0_u16 } else { u16::MAX });
    image::save_png_gray16(&masks.join("0001.png"), &black_left).unwrap();
    // The coarse map has a coarse stride of 4.
    let masked = |x: usize| x < 12;
    let depth_of = |arguments: &[&str], said: bool| {
        let output = scene.run("depth", arguments);
        expect_success(&output);
        let line = format!("masks in {}: 1 of 3 views have one", masks.display());
        assert_eq!(stderr(&output).contains(&line), said, "{}", stderr(&output));
        vamvs::io::pfm::read_depth(&scene.out().join("depths/0001.pfm")).unwrap().row(3).to_vec()
    };
    let depth = depth_of(&arguments, true);
    assert!(depth.iter().enumerate().all(|(x, depth)| (*depth == 0.0) == masked(x)), "{depth:?}");
    // Masks next to the photographs are found without a flag.
    assert_eq!(depth_of(&arguments[2..], true), depth);
    let without = depth_of(&[&arguments[2..], &["--no-masks"]].concat(), false);
    assert!(without.iter().all(|depth| *depth > 0.0), "{without:?}");
}

#[test]
fn a_black_or_white_backdrop_has_no_depth_if_that_is_asked_for() {
    let scene = small();
    let photograph = scene.path("images/0001.png");
    let lit = image::load_rgb(&photograph).unwrap();
    let (dark, white) = (|x: usize| x < 32, |x: usize| (32..48).contains(&x));
    let before = Grid::from_fn(lit.size(), |x, y| match x {
        _ if dark(x) => [9, 3, 15],
        _ if white(x) => [251, 255, 253],
        _ => lit[(x, y)].map(|channel| channel.clamp(16, 250)),
    });
    image::save_png_rgb(&photograph, &before).unwrap();
    let depth_of = |arguments: &[&str]| {
        // The handcrafted network has a depth everywhere, also where there may be no surface.
        let fixed = ["--weights", "photometric", "--coarse-stride", "4", "--planes", "16", "--no-refine"];
        expect_success(&scene.run("depth", &[&fixed, arguments].concat()));
        vamvs::io::pfm::read_depth(&scene.out().join("depths/0001.pfm")).unwrap().row(3).to_vec()
    };
    let all = depth_of(&[]);
    assert!(all.iter().all(|depth| *depth > 0.0), "{all:?}");
    let scale = 96 / all.len();
    let depth = depth_of(&["--min-brightness", "16"]);
    assert!(depth.iter().enumerate().all(|(x, depth)| (*depth == 0.0) == dark(scale * x)), "{depth:?}");
    let depth = depth_of(&["--max-brightness", "250"]);
    assert!(depth.iter().enumerate().all(|(x, depth)| (*depth == 0.0) == white(scale * x)), "{depth:?}");
}

#[test]
fn weights_that_are_no_module_are_named() {
    let scene = small();
    let weights = scene.path("weights.pt");
    let with_weights = ["--weights", weights.to_str().unwrap()];
    assert!(scene.error("depth", &with_weights).contains("weights.pt"));
    write(&weights, "not a module");
    let misspelt = scene.error("depth", &["--weights", "vis-cor"]);
    assert!(misspelt.contains("no such file") && misspelt.contains("vis-corr"), "{misspelt}");
    let said = scene.error("depth", &with_weights);
    assert!(said.contains("weights.pt") && said.contains("not a TorchScript module"), "{said}");
    // A module that lacks a method.
    let lacking = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/modules/lacks-flow.pt");
    let said = scene.error("depth", &["--weights", lacking]);
    assert!(said.contains("method `flow`"), "{said}");
}

#[test]
fn nonsense_on_the_command_line_is_refused() {
    let scene = small();
    for (arguments, expected) in [
        (&["--views", "1"][..], "at least 2"),
        (&["--planes", "1"], "from 8 to 2048"),
        (&["--max-size", "5"], "at least 64"),
        (&["--enlarge", "0.5"], "from 1 to 8"),
        (&["--coarse-stride", "16"], "a coarse stride of 16"),
        (&["--depth-range", "5", "2"], "near"),
        (&["--roi", "0", "0", "0", "0", "1", "1"], "--roi"),
        (&["--device", "abacus"], "abacus"),
        (&["--weights", "vis-max", "--iterations", "3"], "has 2"),
        (&["--iterations", "1"], "it has none"),
        (&["--stretch", "9", "3"], "low value below the high one"),
        (&["--stretch", "grey"], "two values from 0 to 65535"),
        (&["--fovea", "--roi", "0", "0", "0", "1", "1", "1"], "no flow iterations"),
        (&["--visibility", "--weights", "vis-max"], "predicts no visibility"),
        (&["--visibility", "--weights", "none"], "--visibility"),
        (&["--config", "/nowhere/run.toml"], "/nowhere/run.toml"),
    ] {
        let said = scene.error("depth", arguments);
        assert!(said.contains(expected), "{arguments:?}: {said}");
    }
    for flag in [&["--depth-range", "1", "2"][..], &["--roi", "0", "0", "0", "1", "1", "1"]] {
        let output = scene.run("depth", &[flag, flag].concat());
        assert_eq!(output.status.code(), Some(2));
        assert!(stderr(&output).contains("multiple times"), "{flag:?}");
    }
    for (arguments, expected) in [
        (&["--depth-format", "png", "--png-step=-1"][..], "--png-step"),
        (&["--neighbours", "0"], "--neighbours"),
        (&["--min-brightness", "200", "--max-brightness", "10"], "leave no pixel"),
    ] {
        let said = scene.error("reconstruct", arguments);
        assert!(said.contains(expected) && !scene.out().exists(), "{arguments:?}: {said}");
    }
    let other = ["depth", "--colmap", "/nowhere", "--pairs", "/nowhere/pair.txt"];
    assert!(error_of(&vamvs().args(other).output().unwrap()).contains("--cams"));
    let tiny = ["--roi", "-1e-2", "-1.5e-05", "-1", "1e-2", "1", "1", "--config", "/nowhere/run.toml"];
    assert!(scene.error("depth", &tiny).contains("/nowhere/run.toml"), "negative exponents are numbers");
    write(&scene.path("run.toml"), "[depth]\nveiws = 3\n");
    let said = scene.error("depth", &["--config", scene.path("run.toml").to_str().unwrap()]);
    assert!(said.contains("run.toml") && said.contains("veiws"), "{said}");
}

#[test]
fn the_settings_that_are_written_repeat_the_run() {
    let scene = small();
    expect_success(&scene.run("depth", &QUICK));
    let config = scene.out().join("run.toml");
    let output = vamvs().args(["depth", "--config"]).arg(&config).output().unwrap();
    expect_success(&output);
    assert!(stderr(&output).contains("0 depth maps made, 3 were there"), "{}", stderr(&output));
    // Also from the folder itself, in which everything else is as new as the cloud.
    expect_success(&vamvs().args(["reconstruct", "--config"]).arg(&config).output().unwrap());
    let fusion = || std::fs::read(scene.out().join("fusion.json")).unwrap();
    let before = fusion();
    let mut again = vamvs();
    again.current_dir(scene.out()).args(["reconstruct", "--config", "run.toml", "--min-views", "3"]);
    expect_success(&again.output().unwrap());
    assert!(fusion() != before);
    expect_success(
        &vamvs().current_dir(scene.out()).args(["tasks", "--config", "run.toml"]).output().unwrap(),
    );
}

#[test]
fn a_damaged_photograph_costs_no_first_pass_of_others_in_every_run() {
    let scene = Scene::new(128, 96, 5);
    truncate(&scene.path("images/0002.png"));
    let run = ["--weights", "none", "--planes", "16", "--views", "3"];
    expect_success(&scene.run("depth", &run));
    let again = stderr(&scene.run("depth", &run));
    assert!(again.contains("0 depth maps made, 4 were there, 1 views left out"), "{again}");
    assert!(!again.contains("first pass") && !scene.out().join("photometric").exists(), "{again}");
}
