//! Photographs of all directions, in a room without sparse points.

use std::f64::consts::{PI, TAU};
use std::path::Path;
use std::process::Command;

use serde_json::json;
use vamvs::core::{Grid, Pose, Rgb, Size, lift::lift};
use vamvs::io::{image, mvsnet, pfm, ply};
use vamvs::output::OutputFolder;

use crate::scene::{expect_success, stderr};

const PANORAMA: Size = Size::new(480, 240);

/// Half of the room's sides, which is around the origin; z is up.
const ROOM: [f64; 3] = [2.5, 2.0, 1.4];

/// Where a ray from inside the room meets its wall, as a multiple of the ray.
fn distance(eye: [f64; 3], ray: [f64; 3]) -> f64 {
    let along = |axis: usize| (ROOM[axis] * ray[axis].signum() - eye[axis]) / ray[axis];
    (0..3).map(along).filter(|distance| *distance > 0.0).fold(f64::INFINITY, f64::min)
}

/// The colour of a wall: waves of several lengths, no two of which are alike anywhere.
fn colour(x: [f64; 3]) -> Rgb {
    let wave = |a: f64, b: f64, c: f64| (a * x[0] + b * x[1] + c * x[2] + (a - b + c)).sin();
    let grey = wave(9.0, 4.0, 5.0) * wave(-5.0, 7.0, 11.0)
        + 0.7 * wave(23.0, -19.0, 17.0)
        + 0.5 * wave(-41.0, 37.0, 43.0);
    [0.0, 0.3, 0.6]
        .map(|shift| (120.0 + 50.0 * (grey + shift * wave(3.0, -6.0, 8.0))).clamp(0.0, 255.0) as u8)
}

fn panorama(eye: [f64; 3]) -> Grid<Rgb> {
    Grid::from_fn(PANORAMA, |x, y| {
        let sample = |dx: f64, dy: f64| {
            let longitude = ((x as f64 + dx) / PANORAMA.width as f64 - 0.5) * TAU;
            let up = (0.5 - (y as f64 + dy) / PANORAMA.height as f64) * PI;
            // Forward is +y of the world, right is +x.
            let ray = [up.cos() * longitude.sin(), up.cos() * longitude.cos(), up.sin()];
            let distance = distance(eye, ray);
            colour([0, 1, 2].map(|axis| eye[axis] + distance * ray[axis]))
        };
        let samples = [(0.25, 0.25), (0.75, 0.25), (0.25, 0.75), (0.75, 0.75)].map(|(x, y)| sample(x, y));
        [0, 1, 2].map(|channel| (samples.iter().map(|s| u32::from(s[channel])).sum::<u32>() / 4) as u8)
    })
}

fn save_capture(folder: &Path) {
    std::fs::create_dir(folder.join("images")).unwrap();
    let eyes = [[-0.6, -0.3, 0.0], [-0.2, 0.1, 0.1], [0.2, -0.25, -0.05], [0.6, 0.2, 0.05]];
    let frames = eyes.iter().enumerate().map(|(number, eye)| {
        let name = format!("images/p{number}.png");
        image::save_png_rgb(&folder.join(&name), &panorama(*eye)).unwrap();
        // World from camera in OpenGL's axes: x right, y up, z backwards.
        let rows = [
            [1.0, 0.0, 0.0, eye[0]],
            [0.0, 0.0, -1.0, eye[1]],
            [0.0, 1.0, 0.0, eye[2]],
            [0.0, 0.0, 0.0, 1.0],
        ];
        json!({"file_path": name, "transform_matrix": rows})
    });
    let frames: Vec<serde_json::Value> = frames.collect();
    let transforms = json!({"camera_model": "EQUIRECTANGULAR", "frames": frames});
    vamvs::io::atomic::write(&folder.join("transforms.json"), |out| {
        out.write_all(transforms.to_string().as_bytes())
    })
    .unwrap();
}

/// Each panorama becomes six views of one centre, whose depth ranges a draft finds; one cloud, on the walls.
#[test]
fn a_room_is_reconstructed_from_photographs_of_all_directions() {
    let folder = tempfile::tempdir().unwrap();
    save_capture(folder.path());
    let out = folder.path().join("out");
    let mut command = Command::new(env!("CARGO_BIN_EXE_vamvs"));
    command
        .args(["reconstruct", "--quality", "draft", "--no-report", "--nerfstudio"])
        .arg(folder.path())
        .arg("--out")
        .arg(&out);
    let output = command.output().unwrap();
    expect_success(&output);
    let said = stderr(&output);
    assert!(said.contains("24 of 24 views") && !said.contains("guesses from the cameras alone"), "{said}");
    let maps = OutputFolder::new(&out);
    let (mut right, mut pixels) = (0, 0);
    for number in 0..4 {
        for side in ["front", "right", "back", "left", "up", "down"] {
            let name = format!("p{number}@{side}");
            let camera =
                mvsnet::read_cam(&out.join(format!("cams/{name}_cam.txt")), &mvsnet::Options::default())
                    .unwrap();
            let depth = pfm::read_depth(&maps.depth(&name)).unwrap();
            let world_from_cam: Pose = camera.cam_from_world.inverse();
            let eye: [f64; 3] = world_from_cam.translation.into();
            for (index, &found) in depth.data().iter().enumerate() {
                let pixel = [index % depth.width(), index / depth.width()].map(|at| at as f64 + 0.5);
                let pinhole = vamvs::core::Pinhole { size: depth.size(), intrinsics: camera.intrinsics };
                let ray: [f64; 3] = (world_from_cam.rotation * lift(&pinhole, &pixel.into(), 1.0)).into();
                let expected = distance(eye, ray);
                right += usize::from((f64::from(found) - expected).abs() < 0.02 * expected);
                pixels += 1;
            }
        }
    }
    let share = right as f64 / pixels as f64;
    println!("{share:.3} of {pixels} pixels within 2 %");
    assert!(share > 0.85, "{share:.3} of {pixels} pixels are within 2 %");
    let cloud = ply::read(&out.join("fused.ply")).unwrap();
    let off =
        |x: &[f64; 3]| (0..3).map(|axis| (x[axis].abs() - ROOM[axis]).abs()).fold(f64::INFINITY, f64::min);
    let on_walls = cloud.iter().filter(|point| off(&point.x_in_world) < 0.03).count();
    assert!(cloud.len() > 15_000, "{} points", cloud.len());
    assert!(on_walls * 100 > cloud.len() * 97, "{on_walls} of {} on the walls", cloud.len());
}
