//! Draws the demo's pictures and writes its page.

use std::path::Path;

use anyhow::{Context, Result};
use nalgebra::Vector3;
use vamvs_core::{CloudPoint, Grid, Rgb, Size};
use vamvs_eval::DepthErrors;
use vamvs_fusion::ViewReport;
use vamvs_picture::map::{relative_errors, spread, valid};
use vamvs_picture::number::{grouped, percent};
use vamvs_picture::viewpoint::{around, best_direction};
use vamvs_picture::{Legend, Look, Page, Picture, Scale, Surfels, Viewpoint, panel};

use super::Times;
use super::judge::{THRESHOLDS, Verdict};
use super::scene::DemoScene;
use crate::vamvs::Reconstruction;

/// Numbers of the views that are shown.
const SHOWN: [usize; 3] = [1, 5, 10];

/// Width of each panel in the picture of a view, pixels.
const PANEL_WIDTH: usize = 400;

/// The relative depth error at the end of the colour scale.
const ERROR_END: f32 = 0.02;

/// Size of the pictures of the cloud, pixels.
const CLOUD_SIZE: Size = Size::new(800, 600);

/// Viewpoints of the cloud: degrees to the right of the best direction, and a name.
const SIDES: [(f64, &str); 3] = [(-32.0, "left"), (0.0, "front"), (32.0, "right")];

/// All that the demo's page shows.
pub struct Run<'a> {
    /// The rendered scene.
    pub scene: &'a DemoScene,
    /// Output folder of `vamvs`.
    pub result: &'a Path,
    /// Summary and time of `vamvs reconstruct`.
    pub reconstruction: &'a Reconstruction,
    /// The comparison with the ground truth.
    pub verdict: &'a Verdict,
    /// The pictures of views and clouds.
    pub pictures: &'a Pictures,
}

/// The pictures of the page, also saved as files.
pub struct Pictures {
    views: Vec<ViewPicture>,
    colours: Vec<Picture>,
    clay: Vec<Picture>,
    wrong: Picture,
    missing: Picture,
}

struct ViewPicture {
    view: usize,
    picture: Picture,
    depths: (f32, f32),
}

impl Pictures {
    /// Draws all pictures into `out/pictures`.
    pub fn draw(scene: &DemoScene, verdict: &Verdict, out: &Path) -> Result<Self> {
        let folder = out.join("pictures");
        std::fs::create_dir_all(&folder)
            .with_context(|| format!("{} could not be made", folder.display()))?;
        let views = SHOWN.iter().map(|&view| view_picture(scene, verdict, view, &folder));
        let views = views.collect::<Result<_>>()?;
        let up = Vector3::z();
        let best = best_direction(&verdict.cloud, &up);
        let viewpoint = |angle: f64| {
            Viewpoint::from_direction(&verdict.cloud, &around(&best, &up, angle), &up, CLOUD_SIZE)
        };
        let surfels = Surfels::new(&verdict.cloud);
        let from_sides = |look: Look, what: &str| {
            let draw = |(angle, name): (f64, &str)| {
                let picture = surfels.render(&viewpoint(angle), look);
                saved(&picture, &folder.join(format!("cloud-{what}-{name}.png")))
            };
            SIDES.into_iter().map(draw).collect::<Result<Vec<_>>>()
        };
        let from_front = |cloud: &[CloudPoint], name: &str| {
            let picture = Surfels::new(cloud).render(&viewpoint(0.0), Look::Colours);
            saved(&picture, &folder.join(name))
        };
        Ok(Self {
            views,
            colours: from_sides(Look::Colours, "colour")?,
            clay: from_sides(Look::Clay, "shape")?,
            wrong: from_front(&verdict.wrong, "cloud-wrong.png")?,
            missing: from_front(&verdict.missing, "cloud-missing.png")?,
        })
    }
}

/// A row of panels: photograph, true depth, estimated depth, relative error and confidence of a view.
fn view_picture(scene: &DemoScene, verdict: &Verdict, view: usize, folder: &Path) -> Result<ViewPicture> {
    let (ground_truth, map) = (&verdict.ground_truth[view], &verdict.maps[view]);
    let true_depth = valid(ground_truth);
    let (near, far) = spread(&true_depth);
    let parts = [
        scene.views[view].photo.image.clone(),
        Scale::Turbo.paint(&true_depth, near, far),
        Scale::Turbo.paint(&valid(&map.depth), near, far),
        Scale::Error.paint(&relative_errors(&map.depth, ground_truth), 0.0, ERROR_END),
        Scale::Confidence.paint(&map.confidence.map(|&confidence| Some(confidence)), 0.0, 1.0),
    ];
    let row = panel::row(&parts, panel::of_width(parts[0].size(), PANEL_WIDTH));
    let picture = saved(&row, &folder.join(format!("{}.png", DemoScene::name(view))))?;
    Ok(ViewPicture { view, picture, depths: (near, far) })
}

fn saved(image: &Grid<Rgb>, file: &Path) -> Result<Picture> {
    let picture = Picture::new(image);
    picture.save(file)?;
    Ok(picture)
}

impl Run<'_> {
    /// Builds the page.
    pub fn page(&self, times: &Times) -> Result<Page> {
        let (photographs, size) = (self.scene.views.len(), self.scene.views[0].photo.image.size());
        let lead = format!(
            "{photographs} rendered photographs of {size} pixels, known cameras, depth maps of {} pixels, exact ground truth.",
            self.verdict.maps[0].depth.size()
        );
        let mut page = Page::new("A still life, reconstructed", &lead);
        self.numbers(&mut page);
        self.cloud(&mut page);
        self.views(&mut page);
        self.filters(&mut page);
        self.times(&mut page, times);
        self.settings(&mut page)?;
        Ok(page)
    }

    fn numbers(&self, page: &mut Page) {
        let (errors, depth) = (&self.verdict.agreement, &self.verdict.depth);
        let agreement = errors.agreement[0];
        page.figures(&[
            (format!("{:.3}", agreement.f_score), "F-score"),
            (format!("{:.3}", agreement.precision), "precision"),
            (format!("{:.3}", agreement.recall), "recall"),
            (grouped(self.verdict.cloud.len() as u64), "points"),
            (percent(depth.relative.median, 2), "median depth error"),
            (format!("{:.0} s", self.reconstruction.seconds), "from photographs to cloud"),
        ]);
        page.paragraph(&format!(
            "Precision is the share of the cloud's points that are within {:.4} of the true surface (1 % of the \
             scene's median depth). Recall is the share of the true surface that is within this distance of a \
             point; surface that fewer than two photographs show does not count. The F-score is their harmonic \
             mean. The mean distance from the cloud to the true surface is {:.4}, from the true surface to the \
             cloud {:.4}.",
            self.verdict.threshold, errors.accuracy.mean, errors.completeness.mean
        ));
    }

    fn cloud(&self, page: &mut Page) {
        page.heading("The cloud");
        for (pictures, what) in [(&self.pictures.colours, "Colours"), (&self.pictures.clay, "Shape")] {
            let captions = SIDES.map(|(_, side)| format!("{what}, from the {side}"));
            page.gallery(&pictures.iter().zip(captions.iter().map(String::as_str)).collect::<Vec<_>>());
        }
        page.heading("What is wrong, what is missing");
        page.legends(&[Legend {
            what: "distance",
            scale: Scale::Error,
            low: "0".to_owned(),
            high: format!("{:.3} and more: twice the threshold", 2.0 * self.verdict.threshold),
        }]);
        page.gallery(&[
            (&self.pictures.wrong, "The cloud by its distance to the true surface"),
            (&self.pictures.missing, "The true surface by its distance to the cloud"),
        ]);
    }

    fn views(&self, page: &mut Page) {
        page.heading("Depth maps");
        page.legends(&[
            legend("depth", Scale::Turbo, "near", "far"),
            legend("relative error", Scale::Error, "0", "2 % and more; grey: none"),
            legend("confidence", Scale::Confidence, "0", "1"),
        ]);
        for picture in &self.pictures.views {
            let (near, far) = picture.depths;
            page.strip(
                &picture.picture,
                &["photograph", "true depth", "estimated depth", "error", "confidence"],
                &format!("{}: depth {near:.2} to {far:.2}", DemoScene::name(picture.view)),
            );
        }
        let mut head = vec!["depths of all views".to_owned(), "share".to_owned(), "median error".to_owned()];
        head.extend(THRESHOLDS.map(|threshold| format!("within {}", percent(threshold, 1))));
        let head: Vec<_> = head.iter().map(String::as_str).collect();
        page.table(
            &head,
            &[row("all", &self.verdict.depth), row("confident enough for fusion", &self.verdict.confident)],
        );
    }

    fn filters(&self, page: &mut Page) {
        page.heading("What became of the pixels");
        page.table(&["", "pixels", "share"], &outcomes(&self.reconstruction.summary.fusion.total));
    }

    fn times(&self, page: &mut Page, times: &Times) {
        page.heading("Where the time went");
        let seconds = |(name, seconds): (&str, f64)| vec![name.to_owned(), format!("{seconds:.1} s")];
        let mut rows: Vec<_> = times.steps().iter().map(|&step| seconds(step)).collect();
        let mut stages: Vec<_> = self.reconstruction.summary.depth.seconds.iter().collect();
        stages.sort_by(|a, b| b.1.total_cmp(a.1));
        rows.extend(stages.iter().map(|(name, spent)| seconds((&format!("reconstruct: {name}"), **spent))));
        page.table(&["", "time"], &rows);
    }

    fn settings(&self, page: &mut Page) -> Result<()> {
        page.heading("Settings");
        let file = self.result.join("run.toml");
        let text = std::fs::read_to_string(&file)
            .with_context(|| format!("{} could not be read", file.display()))?;
        page.verbatim(&text);
        Ok(())
    }
}

fn legend(what: &'static str, scale: Scale, low: &str, high: &str) -> Legend {
    Legend { what, scale, low: low.to_owned(), high: high.to_owned() }
}

fn row(name: &str, errors: &DepthErrors) -> Vec<String> {
    let mut row = vec![name.to_owned(), percent(errors.coverage, 1), percent(errors.relative.median, 3)];
    row.extend(errors.within.iter().map(|within| percent(within.share, 1)));
    row
}

/// The rows of a table of pixel counts by outcome.
fn outcomes(total: &ViewReport) -> Vec<Vec<String>> {
    let outcomes = std::iter::once(("all", total.pixels)).chain(total.outcomes());
    let share = |count: u64| percent(count as f64 / total.pixels.max(1) as f64, 1);
    outcomes.map(|(name, count)| vec![name.to_owned(), grouped(count), share(count)]).collect()
}
