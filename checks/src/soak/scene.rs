//! Renders a small synthetic scene and writes its cameras in the round's layout.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use serde_json::{Value, json};

use super::case::{Case, Layout, Lens};
use super::process::Program;
use crate::files::save;

/// A scene on disk.
pub struct Scene {
    /// The flags of `vamvs reconstruct` that name the scene's cameras, photographs and masks.
    pub arguments: Vec<String>,
    /// Files of the photographs.
    pub photographs: Vec<PathBuf>,
}

/// A view: file name of the photograph, pose `cam_from_world` (rows of R | t), and fx, fy, cx, cy in pixels.
struct View {
    name: String,
    pose: [[f64; 4]; 3],
    intrinsics: [f64; 4],
}

/// The arguments of `vamvs synth` that render the round's scene into `folder`.
pub fn synth_arguments(case: &Case, folder: &Path) -> Vec<String> {
    let (width, height) = case.size;
    let given = format!(
        "synth --scenes 1 --seed {} --size {width}x{height} --views {} --samples 1 --threads 2 --quiet --out",
        case.seed, case.views
    );
    given.split(' ').map(str::to_owned).chain([folder.display().to_string()]).collect()
}

/// Renders the scene into a folder and writes its cameras in the round's layout.
pub fn make(program: &Program, case: &Case, folder: &Path) -> Result<Scene> {
    let set = folder.join("set");
    let ended = program.run(&synth_arguments(case, &set), folder, &[])?;
    ensure!(ended.code == Some(0), "vamvs synth ended with {ended}: {}", ended.last_line());
    let scene = set.join("scene-00000");
    let views = views(&scene)?;
    let path = |name: &str| scene.join(name).display().to_string();
    let mut arguments = match case.layout {
        Layout::Mvsnet => vec!["--cams".to_owned(), path("cams"), "--images".to_owned(), path("images")],
        Layout::Nerfstudio => {
            save(&scene.join("transforms.json"), nerfstudio(&views, case).to_string())?;
            vec!["--nerfstudio".to_owned(), path("transforms.json")]
        }
        Layout::Bundler => {
            save(&scene.join("bundle.out"), bundle(&views, case))?;
            save(&scene.join("list.txt"), lines(&views, |view| format!("images/{}", view.name)))?;
            vec!["--bundler".to_owned(), path("bundle.out")]
        }
        Layout::Colmap => {
            write_colmap(&scene.join("sparse"), &views, case)?;
            vec!["--colmap".to_owned(), path("sparse"), "--images".to_owned(), path("images")]
        }
    };
    if case.masks {
        arguments.extend(["--masks".to_owned(), path("objects")]);
    }
    let photographs = views.iter().map(|view| scene.join("images").join(&view.name)).collect();
    Ok(Scene { arguments, photographs })
}

fn views(scene: &Path) -> Result<Vec<View>> {
    let mut files: Vec<PathBuf> =
        fs::read_dir(scene.join("cams"))?.map(|entry| Ok(entry?.path())).collect::<Result<_>>()?;
    files.sort();
    files.iter().map(|file| view(scene, file)).collect()
}

fn view(scene: &Path, cam: &Path) -> Result<View> {
    let stem = cam.file_name().and_then(|name| name.to_str()?.strip_suffix("_cam.txt"));
    let stem = stem.with_context(|| format!("the name of {}", cam.display()))?;
    let images =
        fs::read_dir(scene.join("images"))?.filter_map(|entry| entry.ok()?.file_name().into_string().ok());
    let name =
        images.into_iter().find(|name| name.rsplit_once('.').is_some_and(|(before, _)| before == stem));
    let text = fs::read_to_string(cam)?;
    let numbers: Vec<f64> = text.split_whitespace().filter_map(|word| word.parse().ok()).collect();
    ensure!(numbers.len() >= 25, "{}: expected 25 numbers, found {}", cam.display(), numbers.len());
    let row = |i: usize| [numbers[4 * i], numbers[4 * i + 1], numbers[4 * i + 2], numbers[4 * i + 3]];
    Ok(View {
        name: name.with_context(|| format!("the photograph of {stem}"))?,
        pose: [row(0), row(1), row(2)],
        intrinsics: [numbers[16], numbers[20], numbers[18], numbers[21]],
    })
}

fn lines(views: &[View], line: impl Fn(&View) -> String) -> String {
    views.iter().map(|view| line(view) + "\n").collect()
}

fn spaced(numbers: &[f64]) -> String {
    numbers.iter().map(ToString::to_string).collect::<Vec<_>>().join(" ")
}

/// The camera's centre, −Rᵀt.
fn centre(pose: &[[f64; 4]; 3]) -> [f64; 3] {
    [0, 1, 2].map(|i| -(0..3).map(|row| pose[row][i] * pose[row][3]).sum::<f64>())
}

fn nerfstudio(views: &[View], case: &Case) -> Value {
    let frame = |view: &View| {
        let (pose, centre) = (&view.pose, centre(&view.pose));
        // World from camera; the camera's axes point right, up and backwards.
        let row = |i: usize| json!([pose[0][i], -pose[1][i], -pose[2][i], centre[i]]);
        let [fx, fy, cx, cy] = view.intrinsics;
        json!({
            "file_path": format!("images/{}", view.name), "fl_x": fx, "fl_y": fy, "cx": cx, "cy": cy,
            "transform_matrix": [row(0), row(1), row(2), [0, 0, 0, 1]],
        })
    };
    let (model, k) = match case.lens {
        Lens::Pinhole => ("OPENCV", [0.0; 4]),
        Lens::Radial([k1, k2]) => ("OPENCV", [k1, k2, 0.0, 0.0]),
        Lens::Fisheye(k) => ("OPENCV_FISHEYE", k),
    };
    let frames: Vec<Value> = views.iter().map(frame).collect();
    json!({"camera_model": model, "k1": k[0], "k2": k[1], "k3": k[2], "k4": k[3], "frames": frames})
}

fn bundle(views: &[View], case: &Case) -> String {
    let [k1, k2] = if let Lens::Radial(k) = case.lens { k } else { [0.0; 2] };
    let camera = |view: &View| {
        // Bundler's camera looks along −z and has y up, so rows 1 and 2 change sign.
        let rows = [0, 1, 2].map(|i| view.pose[i].map(|value| if i == 0 { value } else { -value }));
        let rotation = rows.map(|row| spaced(&row[..3])).join("\n");
        format!("{} {k1} {k2}\n{rotation}\n{}", view.intrinsics[0], spaced(&rows.map(|row| row[3])))
    };
    format!("# Bundle file v0.3\n{} 0\n{}", views.len(), lines(views, camera))
}

fn write_colmap(folder: &Path, views: &[View], case: &Case) -> Result<()> {
    fs::create_dir_all(folder)?;
    let (model, k): (&str, &[f64]) = match &case.lens {
        Lens::Pinhole => ("PINHOLE", &[]),
        Lens::Radial([k1, k2]) => ("OPENCV", &[*k1, *k2, 0.001, -0.001]),
        Lens::Fisheye(k) => ("OPENCV_FISHEYE", k),
    };
    let (width, height) = case.size;
    let (mut cameras, mut images) = (String::new(), String::new());
    for (id, view) in (1..).zip(views) {
        let parameters = spaced(&[&view.intrinsics, k].concat());
        cameras += &format!("{id} {model} {width} {height} {parameters}\n");
        let translation = spaced(&view.pose.map(|row| row[3]));
        images += &format!("{id} {} {translation} {id} {}\n\n", spaced(&quaternion(&view.pose)), view.name);
    }
    save(&folder.join("cameras.txt"), cameras)?;
    save(&folder.join("images.txt"), images)
}

/// The unit quaternion (w, x, y, z) of a rotation, computed from its largest component for accuracy.
fn quaternion(r: &[[f64; 4]; 3]) -> [f64; 4] {
    let squares = [
        1.0 + r[0][0] + r[1][1] + r[2][2],
        1.0 + r[0][0] - r[1][1] - r[2][2],
        1.0 - r[0][0] + r[1][1] - r[2][2],
        1.0 - r[0][0] - r[1][1] + r[2][2],
    ];
    let largest = (0..4).max_by(|&a, &b| squares[a].total_cmp(&squares[b])).unwrap_or(0);
    let (x, y, z) = (r[2][1] - r[1][2], r[0][2] - r[2][0], r[1][0] - r[0][1]);
    let (xy, xz, yz) = (r[0][1] + r[1][0], r[0][2] + r[2][0], r[1][2] + r[2][1]);
    let s = squares[largest];
    let q = [[s, x, y, z], [x, s, xy, xz], [y, xy, s, yz], [z, xz, yz, s]][largest];
    q.map(|component| 0.5 * component / s.sqrt())
}
