//! `report.html`, and what it is made of; needs no network.

use crate::fuse::true_maps;
use crate::scene::{Scene, error_of, expect_success, vamvs};
use serde_json::Value;
use std::path::Path;
use std::process::Output;

fn read(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap()
}

fn run(command: &str, folder: &Path, arguments: &[&str]) -> Output {
    vamvs().arg(command).arg(folder).args(arguments).output().unwrap()
}

/// A number as the page shows it.
fn grouped(value: &Value) -> String {
    let digits: Vec<char> = value.as_u64().unwrap().to_string().chars().rev().collect();
    let groups: Vec<String> = digits.chunks(3).map(|group| group.iter().collect()).collect();
    groups.join("\u{202f}").chars().rev().collect()
}

#[test]
fn the_page_tells_what_the_fusion_told() {
    let scene = Scene::new(128, 96, 4);
    let folder = true_maps(&scene);
    let output = run("fuse", folder.root(), &["--json", "--quiet"]);
    expect_success(&output);
    let told: Value = serde_json::from_slice(&output.stdout).unwrap();
    let kept: Value = serde_json::from_str(&read(&folder.root().join("fusion.json"))).unwrap();
    assert_eq!(kept["views"], told["views"]);
    assert_eq!(kept["cloud"], "fused.ply");
    let page = read(&folder.root().join("report.html"));
    for fused in told["views"].as_array().unwrap() {
        let pixels = &fused["pixels"];
        let names = [
            "pixels",
            "without_depth",
            "masked",
            "unconfident",
            "outside_roi",
            "inconsistent",
            "merged",
            "points",
        ];
        let cells: String = names.iter().map(|name| format!("<td>{}</td>", grouped(&pixels[name]))).collect();
        let row = format!("<tr><td>{}</td>{cells}</tr>", fused["view"].as_str().unwrap());
        assert!(page.contains(&row), "{row}");
    }
    assert_eq!(page.matches("data:image/jpeg;base64,").count(), 3 * 4);
    assert!(!page.contains("http://") && !page.contains("https://"), "the page needs no network");
    assert!(read(&folder.root().join("report.html")).len() < 2 << 20);
}

#[test]
fn the_page_shows_the_mesh_beside_the_cloud() {
    let scene = Scene::new(96, 64, 4);
    let folder = true_maps(&scene);
    let page = folder.root().join("report.html");
    let has_mesh = || read(&page).contains("\"mesh\":{\"vertices\"");
    expect_success(&run("mesh", folder.root(), &["--min-triangles", "10"]));
    assert!(!page.exists(), "a mesh alone makes no page");
    std::fs::rename(folder.root().join("mesh.ply"), scene.path("kept.ply")).unwrap();
    expect_success(&run("fuse", folder.root(), &[]));
    assert!(!has_mesh());
    expect_success(&run("mesh", folder.root(), &["--no-report"]));
    assert!(!has_mesh());
    expect_success(&run("mesh", folder.root(), &[]));
    assert!(has_mesh());
    let shown = read(&page);
    expect_success(&run("report", folder.root(), &[]));
    assert_eq!(read(&page), shown);
}

#[test]
fn the_page_is_left_out_made_again_and_made_without_a_cloud() {
    let scene = Scene::new(96, 64, 3);
    let folder = true_maps(&scene);
    let page = folder.root().join("report.html");
    let output = run("report", folder.root(), &[]);
    expect_success(&output);
    assert_eq!(String::from_utf8_lossy(&output.stdout).trim(), page.display().to_string());
    let bare = read(&page);
    assert!(bare.contains("not fused yet") && !bare.contains("cloud-data"));
    std::fs::remove_file(&page).unwrap();
    let elsewhere = scene.path("elsewhere.ply");
    expect_success(&run("fuse", folder.root(), &["--out", elsewhere.to_str().unwrap()]));
    assert!(!page.exists() && !folder.root().join("fusion.json").exists(), "the cloud is not in the folder");
    expect_success(&run("fuse", folder.root(), &["--no-report"]));
    assert!(!page.exists());
    expect_success(&run("report", &folder.root().join("depths"), &["--quiet"]));
    let first = read(&page);
    assert!(first.contains("cloud-data"));
    expect_success(&run("fuse", folder.root(), &[]));
    assert_eq!(read(&page), first, "the same folder gives the same page");
    // With another depth map the record of the fusion is outdated.
    let record = folder.saved("0000").unwrap();
    let map = vamvs::Maps::open(folder.root(), vamvs::io::masks::Masks::None, &mut |_| {
        std::ops::ControlFlow::Continue(())
    })
    .unwrap();
    let (map, colour) =
        (map.depth_map(0).unwrap(), vamvs::io::image::load_rgb(&folder.images().join("0000.png")));
    let range = vamvs::core::DepthRange { near: 1.0, far: 9.0 };
    folder
        .save(
            "0000",
            &vamvs::output::SavedMap {
                map: &map,
                range,
                colour: &colour.unwrap(),
                normals: None,
                sigma: None,
            },
            &record,
        )
        .unwrap();
    expect_success(&run("report", folder.root(), &[]));
    assert!(read(&page).contains("not fused yet"));
}

#[test]
fn names_stay_names() {
    let scene = Scene::new(96, 64, 3);
    let folder = true_maps(&scene);
    let (odd, escaped) = ("<b>\"quoted\" & 'so'", "&lt;b&gt;&quot;quoted&quot; &amp; &#39;so&#39;");
    for (place, end) in [("depths", ".pfm"), ("confidence", ".pfm"), ("images", ".png"), ("cams", "_cam.txt")]
    {
        let path = |name: &str| folder.root().join(place).join(format!("{name}{end}"));
        std::fs::rename(path("0001"), path(odd)).unwrap();
    }
    std::fs::remove_file(folder.pairs()).unwrap();
    expect_success(&run("fuse", folder.root(), &[]));
    let page = read(&folder.root().join("report.html"));
    assert!(page.contains(&format!("<h3>{escaped}</h3>")) && page.contains(&format!(">{escaped}</option>")));
    assert!(!page.contains("<b>\"quoted\""));
}

#[test]
fn folders_that_are_none_and_records_that_are_broken_are_named() {
    let scene = Scene::new(96, 64, 3);
    let missing = error_of(&run("report", &scene.path("nothing"), &[]));
    assert!(missing.contains("nothing") && missing.contains("depths/"), "{missing}");
    let folder = true_maps(&scene);
    crate::scene::write(&folder.root().join("fusion.json"), "{}");
    let broken = error_of(&run("report", folder.root(), &[]));
    assert!(broken.contains("fusion.json"), "{broken}");
}
