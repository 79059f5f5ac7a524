//! The tables and figures, one function each.

use anyhow::Result;

use super::networks::{Stage, TRUE_VISIBILITY, UNSUPERVISED, VAR, VIS_AVG, VIS_MAX, VIS_VAR, Variant};
use super::page::{Section, share};
use super::{Lab, clouds};

/// Number of views with which the paper measures its synthetic scenes.
const SYNTHETIC_VIEWS: usize = 7;
/// Number of views with which the paper measures DTU.
const DTU_VIEWS: usize = 5;

/// Heads of the columns of [`accuracy`]: shares within d and 3d of all pixels, of `Invis` and of `Fully-vis` ones.
const ACCURACY: [&str; 6] = ["<d", "<3d", "Invis <d", "Invis <3d", "Fully-vis <d", "Fully-vis <3d"];

fn accuracy(stage: &Stage) -> Vec<String> {
    let regions = [stage.overall, stage.invisible, stage.fully_visible];
    regions.iter().flat_map(|region| region.shares().into_iter().take(2)).map(share).collect()
}

fn headed(first: &[&'static str]) -> Vec<&'static str> {
    first.iter().copied().chain(ACCURACY).collect()
}

/// A row: `name`, then the accuracy of a network's last stage.
fn row(lab: &Lab, name: &str, variant: &Variant, views: usize) -> Result<Vec<String>> {
    let measured = lab.measured(variant, views)?;
    Ok([name.to_owned()].into_iter().chain(accuracy(&measured.last())).collect())
}

fn rows(lab: &Lab, variants: &[(&str, Variant)], views: usize) -> Result<Vec<Vec<String>>> {
    variants.iter().map(|(name, variant)| row(lab, name, variant, views)).collect()
}

pub fn aggregations(lab: &Lab) -> Result<Section> {
    let six = [Variant::plain("avg"), Variant::plain("max"), VAR, VIS_VAR, VIS_AVG, VIS_MAX];
    let mut rows = Vec::new();
    for variant in lab.compared(&six) {
        let measured = lab.measured(variant, SYNTHETIC_VIEWS)?;
        let (coarse, refined) = (&measured.stages()[0], &measured.last());
        for (stage, scores) in [("coarse", coarse), ("refined", refined)] {
            let name = [variant.name.to_owned(), stage.to_owned()];
            rows.push(name.into_iter().chain(accuracy(scores)).collect());
        }
    }
    Ok(Section {
        title: "Table 1: six ways to aggregate views",
        text: "Trained with 3 views, measured with 7. For the coarse map d is one distance of planes. The paper: the \
               visibility-aware ones (vis-) are better than avg, max and var, most of all where some source view \
               does not see.",
        head: headed(&["", "map"]),
        rows,
    })
}

pub fn supervision(lab: &Lab) -> Result<Section> {
    let variants = [("unsupervised", UNSUPERVISED), ("supervised", VIS_VAR), ("true masks", TRUE_VISIBILITY)];
    Ok(Section {
        title: "Table 2: supervised, unsupervised and true visibility",
        text: "vis-var, 7 views. The paper: unsupervised is better overall, supervised in invisible areas, and true \
               masks in training and use are best there.",
        head: headed(&["visibility"]),
        rows: rows(lab, &variants, SYNTHETIC_VIEWS)?,
    })
}

pub fn plane_depth(lab: &Lab) -> Result<Section> {
    let without = Variant::changed("vis-var-no-depth", "vis-var", &["--no-plane-depth"]);
    let mut rows = rows(lab, &[("with depth", VIS_VAR), ("without", without)], SYNTHETIC_VIEWS)?;
    let paper = [
        ["paper: with depth", "0.8899", "0.9665", "0.8407", "0.9391", "0.9529", "0.9908"],
        ["paper: without", "0.8856", "0.9628", "0.8307", "0.9333", "0.9488", "0.9901"],
    ];
    rows.extend(paper.map(|row| row.map(str::to_owned).to_vec()));
    Ok(Section {
        title: "Table 3: visibility with and without the planes' normalised depth",
        text: "vis-var, 7 views.",
        head: headed(&["visibility"]),
        rows,
    })
}

pub fn iterations(lab: &Lab) -> Result<Section> {
    let measured = lab.measured(&VAR, DTU_VIEWS)?;
    let clouds = clouds::by_iterations(lab, &VAR, measured.stages().len() - 1)?;
    // The paper's figures on DTU: overall error (mm), F-score at 0.5 mm, memory, time.
    let paper = [
        "0.726, 47.95, 7219 MB, 0.34 s",
        "0.712, 48.63, 7221 MB, 0.61 s",
        "0.468, 76.08, 7235 MB, 1.14 s",
        "0.391, 84.27, 8731 MB, 3.35 s",
    ];
    let row = |(index, (stage, cloud)): (usize, (&Stage, &clouds::Cloud))| {
        let [_, _, outliers] = stage.overall.shares();
        let mut cells = vec![index.to_string(), format!("{:.1} %", 100.0 * outliers)];
        cells.extend(cloud.cells());
        cells.push(paper.get(index).copied().unwrap_or("–").to_owned());
        cells
    };
    Ok(Section {
        title: "Table 5: flow iterations",
        text: "var, 5 views. Outliers are pixels with an error > 1 % of the depth, on the hold-out scenes. The other \
               columns are of the large scene: `vamvs reconstruct --no-refine --iterations N --planes 96`, time and peak \
               memory of a depth map and of the process, the cloud at 0.5 % of the median depth. The paper's column is \
               its overall error (mm), its F-score at 0.5 mm, memory and time (GTX 1080 Ti) on DTU.",
        head: vec![
            "iterations",
            "outliers",
            "map",
            "memory",
            "time a map",
            "points",
            "precision",
            "recall",
            "F-score",
            "paper",
        ],
        rows: measured.stages().iter().zip(&clouds).enumerate().map(row).collect(),
    })
}

pub fn left_out(lab: &Lab) -> Result<Section> {
    let variants = [
        ("all", VAR),
        ("without hypotheses (the offset is regressed)", DIRECT),
        ("without neighbours (k = 1)", Variant::changed("var-no-neighbours", "var", &["--neighbours", "1"])),
        ("without image features", Variant::changed("var-no-images", "var", &["--no-image-features"])),
    ];
    Ok(Section {
        title: "Table 6: parts left out",
        text: "var, 5 views. The paper: each part that is left out costs quality.",
        head: headed(&["network"]),
        rows: rows(lab, &variants, DTU_VIEWS)?,
    })
}

pub fn hypotheses(lab: &Lab) -> Result<Section> {
    let variants = [
        ("1", Variant::changed("var-m1", "var", &["--hypotheses", "1"])),
        ("2", VAR),
        ("3", Variant::changed("var-m3", "var", &["--hypotheses", "3"])),
    ];
    Ok(Section {
        title: "Table 7: hypotheses to each side of a point (m)",
        text: "var, 5 views. The paper uses m = 2.",
        head: headed(&["m"]),
        rows: rows(lab, &variants, DTU_VIEWS)?,
    })
}

const DIRECT: Variant = Variant::changed("var-direct", "var", &["--hypotheses", "0"]);

pub fn regression(lab: &Lab) -> Result<Section> {
    let [direct, ours] = [lab.measured(&DIRECT, DTU_VIEWS)?, lab.measured(&VAR, DTU_VIEWS)?];
    let paper = [["0.751", "0.726"], ["0.756", "0.712"], ["0.501", "0.468"], ["0.464", "0.391"]];
    let outliers = |stage: &Stage| format!("{:.1} %", 100.0 * stage.overall.shares()[2]);
    let row = |(index, (direct, ours)): (usize, (&Stage, &Stage))| {
        let paper = paper.get(index).copied().unwrap_or(["–"; 2]).map(str::to_owned);
        [index.to_string(), outliers(direct), outliers(ours)].into_iter().chain(paper).collect()
    };
    Ok(Section {
        title: "Table 8: direct regression instead of hypotheses",
        text: "var, 5 views: pixels with an error > 1 % of the depth after each iteration. The paper's columns are \
               its overall error (mm) on DTU.",
        head: vec!["iterations", "direct", "hypotheses", "paper: direct", "paper: hypotheses"],
        rows: direct.stages().iter().zip(ours.stages()).enumerate().map(row).collect(),
    })
}

pub fn views(lab: &Lab) -> Result<Section> {
    const VIEWS: [usize; 4] = [2, 3, 5, 7];
    let row = |variant: &Variant| -> Result<Vec<String>> {
        let mut cells = vec![variant.name.to_owned()];
        for views in VIEWS {
            let [_, _, outliers] = lab.measured(variant, views)?.last().overall.shares();
            cells.push(format!("{:.1} %", 100.0 * outliers));
        }
        Ok(cells)
    };
    Ok(Section {
        title: "Figure 12: number of views",
        text: "Pixels with an error > 1 % of the depth; trained with 3 views. The paper: all improve from 2 to 5 \
               views; var and vis-var get worse from 5 to 7, vis-avg and vis-max keep improving; vis-avg and \
               vis-max fail with 2.",
        head: vec!["", "2 views", "3 views", "5 views", "7 views"],
        rows: lab.compared(&[VAR, VIS_VAR, VIS_AVG, VIS_MAX]).iter().map(row).collect::<Result<_>>()?,
    })
}

pub fn fovea(lab: &Lab) -> Result<Section> {
    Ok(Section {
        title: "Figure 15: foveated depth",
        text: "The built-in vis-max with `--coarse-stride 8` on the large scene, 5 views, 96 planes: the whole photographs, and \
               `--fovea` with a region of interest of about 1/16 of their area. The foveated cloud has three densities.",
        head: vec!["", "region", "memory", "time a map", "of it iterations", "points"],
        rows: clouds::foveated(lab)?,
    })
}
