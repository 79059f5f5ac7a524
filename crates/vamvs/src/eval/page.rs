//! The page of a scene and its ground truth: numbers, error maps, and pictures of the accuracy and
//! completeness of the cloud.

use nalgebra::Vector3;
use vamvs_core::{Cloud, CloudPoint, Size};
use vamvs_eval::reliability::{AboveConfidence, RIGHT_WITHIN};
use vamvs_eval::{Region, Threshold};
use vamvs_fusion::MapSource;
use vamvs_picture::map::{relative_errors, spread, valid};
use vamvs_picture::viewpoint::best_direction;
use vamvs_picture::{Chart, Curve, Legend, Look, Page, Picture, Scale, Surfels, Viewpoint, number, panel};

pub use vamvs_picture::number::length;

use super::depth::{ComparedMap, RegionErrors};
use super::scene::{ComparedCloud, SceneEvaluation};
use crate::VamvsError;

/// Number of views that are shown, evenly spaced.
const SHOWN: usize = 4;

/// Width of each picture of a view, pixels.
const PANEL_WIDTH: usize = 360;

/// The relative depth error at the end of the colour scale.
const ERROR_END: f32 = 0.02;

/// Size of the pictures of the cloud.
const CLOUD_SIZE: Size = Size::new(960, 720);

impl SceneEvaluation {
    /// The page.
    ///
    /// # Errors
    /// If a depth map or photograph cannot be read.
    pub fn page(&self) -> Result<Page, VamvsError> {
        let lead = format!("{} depth maps against true ones", self.maps.len());
        let mut page =
            Page::new(&format!("{} against ground truth", self.maps.prediction().root().display()), &lead);
        self.figures(&mut page);
        if let Some(cloud) = &self.cloud {
            self.clouds(&mut page, cloud);
        }
        self.depth_table(&mut page);
        self.confidence(&mut page);
        self.views(&mut page)?;
        Ok(page)
    }

    fn figures(&self, page: &mut Page) {
        let all = &self.scores.depth.total[0].errors;
        let mut figures = vec![
            (percent(all.relative.median), "median depth error"),
            (percent(all.coverage), "of pixels with ground truth have a depth"),
        ];
        let best = self.scores.cloud.as_ref().and_then(|cloud| cloud.agreement.last());
        if let Some(agreement) = best {
            figures.push((format!("{:.3}", agreement.f_score), "F-score"));
            figures.push((format!("{:.3}", agreement.precision), "precision"));
            figures.push((format!("{:.3}", agreement.recall), "recall"));
        }
        page.figures(&figures);
    }

    fn clouds(&self, page: &mut Page, compared: &ComparedCloud) {
        page.heading("The cloud");
        self.cloud_table(page);
        let up = self.up();
        let to_eye = best_direction(&compared.cloud, &up);
        let view = Viewpoint::from_direction(&compared.cloud, &to_eye, &up, CLOUD_SIZE);
        let picture = |cloud: &[CloudPoint], look| Picture::new(&Surfels::new(cloud).render(&view, look));
        let end = 2.0 * compared.thresholds.last().copied().unwrap_or(1.0);
        page.legends(&[Legend {
            what: "distance",
            scale: Scale::Error,
            low: "0".to_owned(),
            high: format!("{} and more: twice the last threshold", length(end)),
        }]);
        let bare = compared.ground_truth.iter().map(bare).collect::<Vec<_>>();
        page.gallery(&[
            (&picture(&compared.cloud, Look::Colours), "The cloud"),
            (&picture(&compared.cloud, Look::Clay), "Its shape, by the normals"),
            (
                &picture(&coloured(&compared.cloud, &compared.distances.to_ground_truth, end), Look::Colours),
                "Accuracy: the cloud by its distance to the true surface",
            ),
            (
                &picture(&coloured(&bare, &compared.distances.to_cloud, end), Look::Colours),
                "Completeness: the true surface by its distance to the cloud",
            ),
        ]);
    }

    fn cloud_table(&self, page: &mut Page) {
        let Some(errors) = &self.scores.cloud else { return };
        let row = |agreement: &vamvs_eval::Agreement| {
            let shares = [agreement.precision, agreement.recall, agreement.f_score];
            let cells = shares.map(|share| format!("{share:.4}"));
            [vec![length(agreement.threshold)], cells.to_vec()].concat()
        };
        let rows: Vec<_> = errors.agreement.iter().map(row).collect();
        page.table(&["nearer than", "precision", "recall", "F-score"], &rows);
        let spread = |what: &str, spread: &vamvs_eval::Spread| {
            let numbers = [spread.mean, spread.median].map(length);
            [vec![what.to_owned(), spread.count.to_string()], numbers.to_vec()].concat()
        };
        let rows = [
            spread("cloud to ground truth", &errors.accuracy),
            spread("ground truth to cloud", &errors.completeness),
        ];
        page.table(&["distance", "points", "mean", "median"], &rows);
        page.paragraph(
            "The true surface is what at least two of the true depth maps show, as points at least half of the narrowest \
             threshold apart. Distances are in scene units.",
        );
    }

    fn depth_table(&self, page: &mut Page) {
        page.heading("Depth");
        let all = &self.scores.depth.total;
        let mut head = ["pixels", "true", "with depth", "mean error", "median", "relative", "median"]
            .map(str::to_owned)
            .to_vec();
        head.extend(
            all[0].errors.within.iter().map(|within| format!("within {}", threshold(within.threshold))),
        );
        let head: Vec<&str> = head.iter().map(String::as_str).collect();
        let mut rows: Vec<_> = all.iter().map(|part| row(region(part.region), part)).collect();
        let views = &self.scores.depth.views;
        rows.extend(views.iter().map(|view| row(&view.view, &view.regions[0])));
        page.table(&head, &rows);
        page.paragraph("Errors and shares count the pixels that have both a depth and a true depth.");
    }

    fn confidence(&self, page: &mut Page) {
        let reliability = &self.scores.depth.reliability;
        let points = |of: &dyn Fn(&AboveConfidence) -> f64| {
            reliability.above_confidences().iter().map(|kept| [kept.confidence, of(kept)]).collect()
        };
        let curve = |name: &str, points| Curve { name: name.to_owned(), points };
        page.heading("Confidence");
        page.chart(&Chart {
            title: "Share of right pixels by confidence, and what a threshold on the confidence keeps",
            across: ("confidence", 1.0),
            top: 1.0,
            curves: vec![
                curve("right", reliability.curve()),
                curve("ideal", vec![[0.0; 2], [1.0; 2]]),
                curve("right of kept", points(&|kept| kept.right)),
                curve("kept", points(&|kept| kept.share)),
            ],
        });
        page.paragraph(&format!(
            "A pixel is right if the error of its depth is at most {}. The mean calibration error of the confidence is {}.",
            percent(RIGHT_WITHIN),
            percent(reliability.error())
        ));
    }

    fn views(&self, page: &mut Page) -> Result<(), VamvsError> {
        page.heading("Depth maps");
        page.legends(&[
            Legend::new("depth", Scale::Turbo, "near", "far"),
            Legend::new("relative error", Scale::Error, "0", "2 % and more; grey: none"),
            Legend::new("confidence", Scale::Confidence, "0", "1"),
        ]);
        let shown = SHOWN.min(self.maps.len());
        for view in (0..shown).map(|index| index * self.maps.len() / shown) {
            self.strip(page, view)?;
        }
        Ok(())
    }

    fn strip(&self, page: &mut Page, view: usize) -> Result<(), VamvsError> {
        let ComparedMap { map, ground_truth, visible } = self.maps.compared(view)?;
        let (near, far) = spread(&valid(&ground_truth));
        let mut captions = vec!["photograph", "true depth", "depth", "error", "confidence"];
        let mut parts = vec![
            self.maps.photograph(view, map.depth.size())?,
            Scale::Turbo.paint(&valid(&ground_truth), near, far),
            Scale::Turbo.paint(&valid(&map.depth), near, far),
            Scale::Error.paint(&relative_errors(&map.depth, &ground_truth), 0.0, ERROR_END),
            Scale::Confidence.paint(&map.confidence.map(|&confidence| Some(confidence)), 0.0, 1.0),
        ];
        if let Some(visible) = visible {
            let hidden = visible.map(|seen| seen.map(|seen| f32::from(u8::from(!seen))));
            captions.push("red: invisible in some source");
            parts.push(Scale::Error.paint(&hidden, 0.0, 1.5));
        }
        let row = panel::row(&parts, panel::of_width(parts[0].size(), PANEL_WIDTH));
        let below = format!(
            "{}: depth {} to {}",
            self.maps.name(view),
            length(f64::from(near)),
            length(f64::from(far))
        );
        page.strip(&Picture::new(&row), &captions, &below);
        Ok(())
    }

    /// Up in the world: the mean up direction of the cameras.
    fn up(&self) -> Vector3<f64> {
        let maps = self.maps.prediction();
        let ups = (0..maps.len()).map(|view| -maps.pose(view).rotation.row(1).transpose());
        ups.sum::<Vector3<f64>>().try_normalize(1e-6).unwrap_or(-Vector3::y())
    }
}

fn row(name: &str, part: &RegionErrors) -> Vec<String> {
    let errors = &part.errors;
    let mut row = vec![name.to_owned(), errors.true_pixels.to_string(), percent(errors.coverage)];
    row.extend([errors.absolute.mean, errors.absolute.median].map(length));
    row.extend([errors.relative.mean, errors.relative.median].map(percent));
    row.extend(errors.within.iter().map(|within| percent(within.share)));
    row
}

/// A region in words.
#[must_use]
pub fn region(region: Region) -> &'static str {
    match region {
        Region::All => "all",
        Region::Invisible => "invisible in some source",
        Region::Visible => "visible in all sources",
    }
}

/// A threshold in words.
#[must_use]
pub fn threshold(threshold: Threshold) -> String {
    match threshold {
        Threshold::Absolute(limit) => format!("{limit}"),
        // Shares such as 0.011 have no exact percentage: six digits are enough.
        Threshold::Relative(limit) => format!("{} %", (1e6 * limit).round() / 1e4),
        Threshold::Planes(limit) => format!("{limit} d"),
    }
}

/// A share.
#[must_use]
pub fn percent(share: f64) -> String {
    number::percent(share, 2)
}

/// A point with nothing but its position.
fn bare(x_in_world: &[f64; 3]) -> CloudPoint {
    CloudPoint {
        x_in_world: *x_in_world,
        normal: [0.0; 3],
        colour: [0; 3],
        confidence: 1.0,
        sigma: 0.0,
        views: 0,
    }
}

/// Points coloured by their distances.
fn coloured(cloud: &[CloudPoint], distances: &[f64], end: f64) -> Cloud {
    let colour = |distance: f64| Scale::Error.at((distance / end) as f32);
    cloud
        .iter()
        .zip(distances)
        .map(|(point, &distance)| CloudPoint { colour: colour(distance), ..*point })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_are_told_in_percent_without_rounding_errors() {
        let texts = [0.011, 0.002, 0.5, 0.000_25].map(|limit| threshold(Threshold::Relative(limit)));
        assert_eq!(texts, ["1.1 %", "0.2 %", "50 %", "0.025 %"]);
    }
}
