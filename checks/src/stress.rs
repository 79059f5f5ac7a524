//! `cargo xtask stress`: time and memory of fusing a thousand depth maps.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, ensure};
use clap::Args;
use nalgebra::Vector3;
use sha2::{Digest, Sha256};
use vamvs_core::{Grid, Pose, Size};
use vamvs_io::{image, mvsnet, pfm};
use vamvs_tests::{Rendered, fixtures};

use crate::vamvs::{Taken, binary, measured};

/// Size of the depth maps, pixels.
const SIZE: Size = Size::new(640, 480);

/// Views around each copy of the rendered scene.
const VIEWS_PER_PLACE: usize = 20;

/// Distance from one copy of the scene to the next, scene units: ten times the cameras' distance from it.
const BETWEEN_PLACES: f64 = 40.0;

/// Largest relative error that is added to a depth.
const DEPTH_NOISE: f32 = 0.005;

/// Fuse a scene of many depth maps within several memory budgets, and compare results, time and memory.
///
/// The scene consists of copies of one rendered still life, far from one another. Each copy has the same twenty
/// views, whose depth maps are the true ones with noise; files of further copies are hard links to those of the
/// first. Views are numbered at random, so that their order does not tell which of them overlap.
#[derive(Args)]
pub struct Stress {
    /// Folder for the scene and its clouds.
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// Number of depth maps.
    #[arg(long, value_name = "N", default_value_t = 1000)]
    views: usize,
    /// Memory budgets; fusion runs once for each budget and number of threads.
    #[arg(long, value_name = "SIZE", value_delimiter = ',', default_values = ["2GiB", "8GiB"])]
    max_memory: Vec<String>,
    /// Numbers of threads.
    #[arg(long, value_name = "N", value_delimiter = ',', default_values = ["2", "1"])]
    threads: Vec<usize>,
}

/// Time, memory and result of one fusion.
struct Measured {
    budget: String,
    threads: usize,
    taken: Taken,
    /// Time of fusion alone, without opening the depth maps and writing the report, seconds.
    fusing: f64,
    /// SHA-256 of the cloud's file.
    cloud: [u8; 32],
    points: u64,
}

impl Stress {
    pub fn run(&self) -> Result<()> {
        write_scene(&self.folder, self.views)?;
        let settings =
            self.max_memory.iter().flat_map(|budget| self.threads.iter().map(move |&n| (budget, n)));
        let measured: Vec<_> =
            settings.map(|(budget, threads)| self.fuse(budget, threads)).collect::<Result<_>>()?;
        print_table(&measured, self.views * SIZE.area());
        let differs = measured.iter().find(|other| other.cloud != measured[0].cloud);
        ensure!(differs.is_none(), "the clouds differ: they must not depend on memory or threads");
        Ok(())
    }

    fn fuse(&self, budget: &str, threads: usize) -> Result<Measured> {
        let cloud = self.folder.join("fused.ply");
        let mut command = Command::new(binary()?);
        command.arg("fuse").arg(&self.folder).args(["--max-memory", budget]);
        command.args(["--threads", &threads.to_string()]);
        let (summary, taken) = measured::<serde_json::Value>(&mut command)?;
        Ok(Measured {
            budget: budget.to_owned(),
            threads,
            taken,
            fusing: summary["seconds"]["fuse"].as_f64().context("the summary has no seconds of fusion")?,
            cloud: digest(&cloud)?,
            points: summary["points"].as_u64().context("the summary has no number of points")?,
        })
    }
}

fn digest(file: &Path) -> Result<[u8; 32]> {
    let mut hash = Sha256::new();
    let mut reader = fs::File::open(file).with_context(|| format!("{}", file.display()))?;
    std::io::copy(&mut reader, &mut hash)?;
    Ok(hash.finalize().into())
}

fn print_table(measured: &[Measured], pixels: usize) {
    println!(
        "\n{:>8} {:>8} {:>8} {:>10} {:>8} {:>10} {:>8} {:>12}  cloud",
        "budget", "threads", "wall", "processor", "fusion", "Mpixel/s", "peak", "points"
    );
    for m in measured {
        let rate = pixels as f64 / 1e6 / m.fusing;
        let hash: String = m.cloud[..4].iter().map(|byte| format!("{byte:02x}")).collect();
        println!(
            "{:>8} {:>8} {:>6.1} s {:>8.1} s {:>6.1} s {rate:>10.2} {:>4} MiB {:>12}  {hash}",
            m.budget,
            m.threads,
            m.taken.seconds,
            m.taken.processor_seconds,
            m.fusing,
            m.taken.peak_bytes >> 20,
            m.points
        );
    }
}

/// Writes the scene in the layout of an output folder of `vamvs depth`, unless `views.txt` says that it is complete.
fn write_scene(folder: &Path, views: usize) -> Result<()> {
    let done = folder.join("views.txt");
    if fs::read_to_string(&done).is_ok_and(|text| text == views.to_string()) {
        return Ok(());
    }
    ensure!(!folder.join("depths").exists(), "{} holds other depth maps: remove them", folder.display());
    for sub in ["cams", "images", "depths", "confidence"] {
        fs::create_dir_all(folder.join(sub))?;
    }
    let rendered = fixtures::still_life(SIZE, VIEWS_PER_PLACE);
    let mut first = Vec::new();
    for (index, number) in shuffled(views).into_iter().enumerate() {
        let (place, view) = (index / VIEWS_PER_PLACE, index % VIEWS_PER_PLACE);
        let name = format!("{number:06}");
        write_camera(folder, &name, &rendered[view], place)?;
        if place == 0 {
            write_maps(folder, &name, view, &rendered[view])?;
            first.push(name);
        } else {
            link_maps(folder, &first[view], &name)?;
        }
    }
    Ok(vamvs_io::atomic::write(&done, |out| write!(out, "{views}"))?)
}

/// The numbers below `count` in a pseudo-random order, always the same.
fn shuffled(count: usize) -> Vec<usize> {
    let mut order: Vec<usize> = (0..count).collect();
    order.sort_by(|&a, &b| random([a, 0, 0, 0]).total_cmp(&random([b, 0, 0, 0])));
    order
}

/// A pseudo-random number in [0, 1): a hash of the four numbers.
fn random(of: [usize; 4]) -> f32 {
    let mix = |hash: u64, number: usize| {
        let hash = (hash ^ number as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        hash ^ (hash >> 32)
    };
    (of.into_iter().fold(1, mix) >> 40) as f32 / (1 << 24) as f32
}

fn write_camera(folder: &Path, name: &str, view: &Rendered, place: usize) -> Result<()> {
    let offset = BETWEEN_PLACES * Vector3::new((place % 10) as f64, (place / 10) as f64, 0.0);
    let Pose { rotation, translation } = view.photo.cam_from_world;
    let moved = Pose { rotation, translation: translation - rotation * offset };
    let range = vamvs_tests::folder::depth_range(view, 1.05);
    let file = folder.join(format!("cams/{name}_cam.txt"));
    Ok(mvsnet::write_cam(&file, &view.photo.camera, &moved, range)?)
}

/// The files of a view: photograph, confidence, coarse confidence and depth.
fn map_files(folder: &Path, name: &str) -> [PathBuf; 4] {
    ["images/NAME.png", "confidence/NAME.pfm", "confidence/NAME.coarse.pfm", "depths/NAME.pfm"]
        .map(|file| folder.join(file.replace("NAME", name)))
}

fn write_maps(folder: &Path, name: &str, view: usize, rendered: &Rendered) -> Result<()> {
    let random = |x: usize, y: usize, purpose| random([x, y, view, purpose]);
    let noise = |x, y| 1.0 + DEPTH_NOISE * (2.0 * random(x, y, 1) - 1.0);
    let [image, confidence, coarse, depth] = map_files(folder, name);
    image::save_png_rgb(&image, &rendered.photo.image)?;
    pfm::write(&confidence, &Grid::from_fn(SIZE, |x, y| random(x, y, 2)))?;
    pfm::write(&coarse, &Grid::from_fn(SIZE, |x, y| random(x, y, 3).sqrt()))?;
    Ok(pfm::write(&depth, &Grid::from_fn(SIZE, |x, y| rendered.depth[(x, y)] * noise(x, y)))?)
}

fn link_maps(folder: &Path, from: &str, to: &str) -> Result<()> {
    for (from, to) in map_files(folder, from).iter().zip(map_files(folder, to)) {
        fs::hard_link(from, &to).with_context(|| format!("linking {}", to.display()))?;
    }
    Ok(())
}
