//! A network's confidence, calibrated on synthetic scenes, and what depth maps tell with it.

use std::path::Path;

use tempfile::tempdir;
use vamvs::core::MonotoneMap;
use vamvs::io::pfm;

use crate::scene::{error_of, expect_success, vamvs};

#[test]
fn refined_depth_maps_have_the_share_that_was_measured() {
    let folder = tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let set =
        ["synth", "--scenes", "2", "--views", "3", "--size", "160x120", "--samples", "2", "--quiet", "--out"];
    expect_success(&vamvs().args(set).arg(path("set")).output().unwrap());
    let raw = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../weights/vis-corr.pt");
    let calibrate = |weights: &Path, out: &str, more: &[&str]| {
        let mut run = vamvs();
        run.args(["calibrate", "--references", "6", "--json", "--data"]).arg(path("set"));
        run.arg("--weights").arg(weights).arg("--out").arg(path(out)).args(more).output().unwrap()
    };
    let told = calibrate(&raw, "plain.pt", &["--no-refine"]);
    expect_success(&told);
    let told: serde_json::Value = serde_json::from_slice(&told.stdout).unwrap();
    assert!(told["refined"].is_null() && told["network"]["after"]["bins"].is_array(), "{told}");
    let told = calibrate(&raw, "refined.pt", &["--page", &path("page.html").to_string_lossy()]);
    expect_success(&told);
    let told: serde_json::Value = serde_json::from_slice(&told.stdout).unwrap();
    assert!(told["refined"]["after"]["bins"].is_array(), "{told}");
    assert!(std::fs::read_to_string(path("page.html")).unwrap().contains("refined: share of right pixels"));

    let manifest = vamvs().args(["info", "--json"]).arg(path("refined.pt")).output().unwrap();
    let manifest: serde_json::Value = serde_json::from_slice(&manifest.stdout).unwrap();
    let map: MonotoneMap = serde_json::from_value(manifest["refined_calibration"].clone()).unwrap();
    let confidence = |weights: &str, out: &str, more: &[&str]| {
        let mut run = vamvs();
        run.args(["depth", "--quiet", "--cams"]).arg(path("set/scene-00000/cams")).arg("--images");
        run.arg(path("set/scene-00000/images")).arg("--weights").arg(path(weights));
        expect_success(&run.arg("--out").arg(path(out)).args(more).output().unwrap());
        pfm::read(&path(out).join("confidence/00000000.pfm")).unwrap()
    };
    for (pass, more) in [("both", &[][..]), ("first", &["--no-geometric"])] {
        let before = confidence("plain.pt", &format!("{pass} plain"), more);
        let after = confidence("refined.pt", &format!("{pass} refined"), more);
        assert!(before != after);
        for (before, after) in before.data().iter().zip(after.data()) {
            assert!(*after == map.at(f64::from(*before)) as f32 || (*before, *after) == (0.0, 0.0));
        }
    }
    // What is calibrated already is calibrated anew, from the confidence as it was.
    expect_success(&calibrate(&path("refined.pt"), "again.pt", &[]));
    let bytes = |out: &str| vamvs().args(["info", "--json"]).arg(path(out)).output().unwrap().stdout;
    assert_eq!(bytes("again.pt"), bytes("refined.pt"));
    assert!(error_of(&calibrate(&raw, "x.pt", &["--views", "1"])).contains("--views must be 2 at least"));
}
