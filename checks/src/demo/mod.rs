//! `cargo xtask demo`: reconstructs a scene with known ground truth, measures the result and shows it on a page.

mod judge;
mod report;
mod scene;

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::Result;
use clap::Args;

use crate::vamvs;
use report::{Pictures, Run};
use scene::DemoScene;

/// Reconstruct a rendered still life, compare the result with the ground truth and show all on one page.
#[derive(Args)]
pub struct Demo {
    /// Folder for the scene, the result, pictures and the report.
    #[arg(long, value_name = "DIR", default_value = "demo")]
    out: PathBuf,
}

/// Name and wall-clock time of each step, seconds, in order.
#[derive(Default)]
pub struct Times(Vec<(&'static str, f64)>);

impl Demo {
    pub fn run(&self) -> Result<()> {
        let mut times = Times::default();
        let scene = times.of("render the photographs", || {
            let scene = DemoScene::render(&self.out.join("scene"));
            scene.write().map(|()| scene)
        })?;
        let result = self.out.join("result");
        let reconstruction = times.of("reconstruct", || reconstruct(&scene, &result))?;
        let verdict = times.of("compare with the ground truth", || judge::judge(&scene, &result))?;
        let pictures = times.of("draw pictures", || Pictures::draw(&scene, &verdict, &self.out))?;
        let report = self.out.join("report.html");
        let run = Run {
            scene: &scene,
            result: &result,
            reconstruction: &reconstruction,
            verdict: &verdict,
            pictures: &pictures,
        };
        run.page(&times)?.save(&report)?;
        times.print();
        print_results(&run, &self.out, &report);
        Ok(())
    }
}

fn reconstruct(scene: &DemoScene, out: &Path) -> Result<vamvs::Reconstruction> {
    let (cams, images) = (scene.cams(), scene.images());
    let arguments = ["--cams".as_ref(), cams.as_os_str(), "--images".as_ref(), images.as_os_str()];
    // The light network, so that the demo takes about a minute.
    let how = ["--weights", "vis-corr", "--force"].map(str::as_ref);
    vamvs::reconstruct(&[&arguments[..], &how].concat(), out)
}

fn print_results(run: &Run, out: &Path, report: &Path) {
    let agreement = &run.verdict.agreement.agreement[0];
    println!(
        "\n{} points, at a threshold of 1 % of the median depth: precision {:.3}, recall {:.3}, F-score {:.3}",
        run.verdict.cloud.len(),
        agreement.precision,
        agreement.recall,
        agreement.f_score
    );
    println!("\nscene     {}", out.join("scene").display());
    println!("cloud     {}", run.result.join("fused.ply").display());
    println!("pictures  {}", out.join("pictures").display());
    println!("report    {}   (open it in a browser)", report.display());
}

impl Times {
    /// Runs a step and records its time.
    fn of<T>(&mut self, step: &'static str, work: impl FnOnce() -> Result<T>) -> Result<T> {
        let start = Instant::now();
        let result = work()?;
        self.0.push((step, start.elapsed().as_secs_f64()));
        Ok(result)
    }

    /// Name and seconds of each step.
    pub fn steps(&self) -> &[(&'static str, f64)] {
        &self.0
    }

    fn print(&self) {
        println!();
        for (step, seconds) in &self.0 {
            println!("{step:24} {seconds:7.1} s");
        }
    }
}
