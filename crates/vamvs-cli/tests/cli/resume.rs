//! Killed at any moment and started again: the run goes on and ends as if nothing had happened.

use std::fs::File;
use std::process::Stdio;
use std::time::{Duration, Instant, SystemTime};

use crate::scene::{Scene, content, expect_success, stderr, truncate, write};

#[test]
fn a_killed_run_resumes_to_the_same_result() {
    let scene = Scene::new(160, 120, 6);
    let begin = Instant::now();
    expect_success(&scene.run("reconstruct", &["--quiet"]));
    let whole = begin.elapsed();
    let undisturbed = content(&scene.out());
    std::fs::remove_dir_all(scene.out()).unwrap();
    for share in [0.15, 0.35, 0.5, 0.7, 0.9] {
        let mut run = scene.command("reconstruct", &["--quiet"]).stdout(Stdio::null()).spawn().unwrap();
        std::thread::sleep(Duration::from_secs_f64(share * whole.as_secs_f64()));
        run.kill().unwrap();
        run.wait().unwrap();
    }
    expect_success(&scene.run("reconstruct", &["--quiet"]));
    let resumed = content(&scene.out());
    let (all, expected): (Vec<_>, Vec<_>) = (resumed.keys().collect(), undisturbed.keys().collect());
    assert_eq!(all, expected, "nothing half-written may be left");
    for (path, bytes) in &undisturbed {
        assert!(resumed.get(path) == Some(bytes), "{} differs", path.display());
    }
}

#[test]
fn a_second_run_keeps_what_is_there_and_other_settings_or_photographs_redo_it() {
    let scene = Scene::new(128, 96, 3);
    let summary = |arguments: &[&str]| {
        let output = scene.run("depth", arguments);
        expect_success(&output);
        let said = stderr(&output);
        said.lines().find(|line| line.contains("depth maps made")).unwrap().to_owned()
    };
    assert!(summary(&[]).starts_with("3 depth maps made, 0 were there"));
    assert!(summary(&[]).starts_with("0 depth maps made, 3 were there"));
    assert!(summary(&["--threads", "1"]).starts_with("0 depth maps made, 3 were there"));
    assert!(summary(&["--force"]).starts_with("3 depth maps made, 0 were there"));
    assert!(summary(&["--planes", "24"]).starts_with("3 depth maps made, 0 were there"));
    // Files are damaged after the run, in two ways.
    let depth = scene.out().join("depths/0001.pfm");
    let whole = std::fs::read(&depth).unwrap();
    truncate(&depth);
    let half = vamvs::io::image::resize(&scene.views[0].photo.image, vamvs::core::Size::new(48, 32));
    vamvs::io::image::save_png_rgb(&scene.out().join("images/0002.png"), &half).unwrap();
    assert!(summary(&["--planes", "24"]).starts_with("2 depth maps made, 1 were there"));
    assert!(std::fs::read(&depth).unwrap() == whole);
    // One view's source photograph changes: the maps that use it are made anew.
    let image = scene.path("images/0002.png");
    vamvs::io::image::save_png_rgb(&image, &scene.views[0].photo.image).unwrap();
    assert!(summary(&["--planes", "24", "--views", "2"]).starts_with("3 depth maps made, 0 were there"));
    vamvs::io::image::save_png_rgb(&image, &scene.views[2].photo.image).unwrap();
    assert!(!summary(&["--planes", "24", "--views", "2"]).starts_with("0 depth maps made"));
}

#[test]
fn photographs_are_read_again_only_if_their_size_or_time_has_changed() {
    let scene = Scene::new(128, 96, 4);
    let made_again = |arguments: &[&str]| {
        let output = scene.run("depth", arguments);
        expect_success(&output);
        !stderr(&output).contains("0 depth maps made, 4 were there")
    };
    for arguments in [["--quality", "normal"].as_slice(), &["--no-refine"]] {
        made_again(arguments);
        let path = scene.path("images/0002.png");
        let (whole, changed) =
            (std::fs::read(&path).unwrap(), std::fs::metadata(&path).unwrap().modified().unwrap());
        let mut damaged = whole.clone();
        damaged[whole.len() / 2] ^= 1;
        let put = |bytes: &[u8], time: SystemTime| {
            write(&path, bytes);
            File::options().write(true).open(&path).unwrap().set_modified(time).unwrap();
        };
        put(&damaged, changed);
        assert!(!made_again(arguments), "the photograph was read");
        put(&damaged, changed + Duration::from_secs(1));
        assert!(made_again(arguments), "the photograph was not read");
        put(&whole, changed);
    }
}

#[test]
fn a_draft_is_quick_is_recorded_and_gives_way_to_flags() {
    let scene = Scene::new(256, 192, 2);
    let size_and_settings = |arguments: &[&str]| {
        expect_success(&scene.run("depth", &[arguments, &["--planes", "8", "--quiet", "--force"]].concat()));
        let map = vamvs::io::pfm::read(&scene.out().join("depths/0000.pfm")).unwrap();
        (map.size(), std::fs::read_to_string(scene.out().join("run.toml")).unwrap())
    };
    let decided = ["max-size = 800", "network-size = 800", "geometric = false", "weights = \"vis-corr\""];
    for quality in [&["--quality", "draft"][..], &["--preview"]] {
        let (size, settings) = size_and_settings(quality);
        assert_eq!(size, vamvs::core::Size::new(256, 192));
        assert!(decided.iter().all(|line| settings.contains(line)), "{settings}");
    }
    let flags = ["--quality", "draft", "--max-size", "160", "--weights", "photometric", "--no-refine"];
    let (size, settings) = size_and_settings(&flags);
    assert_eq!(size, vamvs::core::Size::new(80, 60));
    assert!(settings.contains("max-size = 160") && settings.contains("network-size = 800"), "{settings}");
    // The stored settings give the same again, unless another quality is asked for.
    let kept = scene.path("kept.toml");
    crate::scene::write(&kept, &settings);
    assert_eq!(size_and_settings(&["--config", kept.to_str().unwrap()]).0, size);
    let again = ["--config", kept.to_str().unwrap(), "--quality", "draft"];
    assert_eq!(size_and_settings(&again).0, vamvs::core::Size::new(256, 192));
}

#[test]
fn depth_maps_are_refined_to_the_size_of_their_photographs_unless_that_is_not_wanted() {
    let scene = Scene::new(256, 192, 3);
    let ground_truth = &scene.views[0].depth;
    let run = |arguments: &[&str]| {
        let output =
            scene.run("depth", &[&["--weights", "photometric", "--planes", "32"], arguments].concat());
        expect_success(&output);
        (vamvs::io::pfm::read(&scene.out().join("depths/0000.pfm")).unwrap(), stderr(&output))
    };
    let share_within = |map: &vamvs::core::Grid<f32>, error: f32| {
        let step = ground_truth.width() / map.width();
        let places = (0..map.height()).flat_map(|y| (0..map.width()).map(move |x| (x, y)));
        let right = places.filter(|&(x, y)| {
            let expected = ground_truth[(x * step + step / 2, y * step + step / 2)];
            (map[(x, y)] - expected).abs() < error * expected
        });
        right.count() as f64 / map.size().area() as f64
    };
    let share = |map: &vamvs::core::Grid<f32>| share_within(map, 0.003);
    let normals = scene.out().join("normals/0000.pfm");
    let (rough, _) = run(&["--no-refine"]);
    assert_eq!(rough.size(), vamvs::core::Size::new(128, 96));
    assert!(!normals.exists());
    let (refined, said) = run(&[]);
    assert!(said.contains("3 depth maps made, 0 were there"), "{said}");
    assert_eq!(refined.size(), ground_truth.size());
    assert!(share(&refined) > 1.2 * share(&rough), "{} and {}", share(&refined), share(&rough));
    let facing = vamvs::io::pfm::read_rgb(&normals).unwrap();
    assert_eq!(facing.size(), ground_truth.size());
    assert!(run(&[]).1.contains("0 depth maps made, 3 were there"));
    // The pass with the other views' depth maps helps, and leaves nothing else behind.
    assert!(!scene.out().join("photometric").exists());
    let (alone, _) = run(&["--no-geometric"]);
    let exact = [&refined, &alone].map(|map| share_within(map, 0.001));
    assert!(exact[0] > 1.1 * exact[1], "{exact:?}");
    // Photographs for the network are smaller, depth maps are not.
    assert_eq!(run(&["--network-size", "128"]).0.size(), ground_truth.size());
    let (half, _) = run(&["--max-size", "128"]);
    assert_eq!(half.size(), vamvs::core::Size::new(128, 96));
    // Without refinement no normals are left behind.
    assert_eq!(run(&["--no-refine"]).0, rough);
    assert!(!normals.exists());
}

#[test]
fn iterations_are_counted_from_the_coarse_stride_of_the_network() {
    let scene = Scene::new(64, 48, 2);
    // vis-max has a coarse stride of 4: one iteration ends where the coarse map is, and refines it.
    let map = |iterations: &str| {
        let network = ["--weights", "vis-max", "--iterations", iterations];
        let fixed = [&["--planes", "8", "--quiet", "--force", "--no-refine"], &network[..]].concat();
        expect_success(&scene.run("depth", &fixed));
        vamvs::io::pfm::read(&scene.out().join("depths/0000.pfm")).unwrap()
    };
    let [none, one, two] = ["0", "1", "2"].map(map);
    assert_eq!([none.size(), one.size()], [vamvs::core::Size::new(16, 12); 2]);
    assert_eq!(two.size(), vamvs::core::Size::new(32, 24));
    assert_ne!(none.data(), one.data());
}

#[test]
fn coarse_maps_of_small_photographs_have_the_colours_of_their_place() {
    // A coarse stride of 8 loses 4 of 36 pixels, so that the sizes alone would suggest a coarse
    // stride of 9.
    let scene = Scene::new(36, 64, 2);
    let fixed = ["--weights", "photometric", "--iterations", "0", "--planes", "8", "--no-refine", "--quiet"];
    expect_success(&scene.run("depth", &fixed));
    let colours = vamvs::io::image::load_rgb(&scene.out().join("images/0000.png")).unwrap();
    assert_eq!(colours.size(), vamvs::core::Size::new(4, 8));
    let photograph = &scene.views[0].photo.image;
    let cell = vamvs::core::Grid::from_fn(vamvs::core::Size::new(8, 8), |x, y| photograph[(24 + x, 56 + y)]);
    let mean = |channel: usize| {
        cell.data().iter().map(|pixel| f64::from(pixel[channel])).sum::<f64>() / cell.data().len() as f64
    };
    for channel in 0..3 {
        assert!((f64::from(colours[(3, 7)][channel]) - mean(channel)).abs() < 24.0, "{:?}", colours[(3, 7)]);
    }
}

#[test]
fn enlarged_photographs_give_larger_maps_and_a_smaller_stride_more_that_is_right() {
    let scene = Scene::new(256, 192, 3);
    let ground_truth = &scene.views[0].depth;
    let size_and_share = |arguments: &[&str]| {
        expect_success(
            &scene
                .run("depth", &[&["--quiet", "--no-refine", "--weights", "photometric"], arguments].concat()),
        );
        let map = vamvs::io::pfm::read(&scene.out().join("depths/0000.pfm")).unwrap();
        let step = ground_truth.width() / map.width();
        let places = (0..map.height()).flat_map(|y| (0..map.width()).map(move |x| (x, y)));
        let right = places.filter(|&(x, y)| {
            let expected = ground_truth[(x * step + step / 2, y * step + step / 2)];
            (map[(x, y)] - expected).abs() < 0.01 * expected
        });
        (map.size(), right.count() as f64 / map.size().area() as f64)
    };
    let (size, share) = size_and_share(&[]);
    assert_eq!(size, vamvs::core::Size::new(128, 96));
    let (size, larger_share) = size_and_share(&["--enlarge", "2"]);
    assert_eq!(size, vamvs::core::Size::new(256, 192));
    assert!(larger_share > share + 0.05, "{larger_share} and {share}");
    let (size, _) = size_and_share(&["--enlarge", "2", "--max-size", "320"]);
    assert_eq!(size, vamvs::core::Size::new(160, 120));
    let (size, finer_share) = size_and_share(&["--coarse-stride", "4"]);
    assert_eq!(size, vamvs::core::Size::new(128, 96));
    assert!(finer_share > share + 0.05, "{finer_share} and {share}");
}

#[test]
fn a_depth_map_that_does_not_fit_into_the_memory_becomes_smaller_and_that_is_told() {
    let scene = Scene::new(400, 300, 2);
    let size_and_words = |memory: &str| {
        let network = ["--weights", "vis-max", "--coarse-stride", "8", "--iterations", "0"];
        let fixed = ["--planes", "16", "--no-refine", "--max-memory", memory];
        let output = scene.run("depth", &[&network[..], &fixed].concat());
        expect_success(&output);
        let map = vamvs::io::pfm::read(&scene.out().join("depths/0000.pfm")).unwrap();
        (map.size(), stderr(&output))
    };
    let (whole, said) = size_and_words("100%");
    assert_eq!(whole, vamvs::core::Size::new(50, 37));
    assert!(!said.contains("--max-memory"), "{said}");
    // Nothing fits, so that photographs are as small as they get: 400 · 0.9⁴ = 262 pixels.
    let (small, said) = size_and_words("1MB");
    assert_eq!(small, vamvs::core::Size::new(32, 24));
    assert!(said.contains("--max-memory") && said.contains("photographs of 262 pixels"), "{said}");
}
