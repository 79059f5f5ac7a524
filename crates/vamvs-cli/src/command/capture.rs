//! `vamvs info` of a capture: what it is, what a reconstruction would do with it, what is odd, and the command to run.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::Result;
use serde_json::{Map, Value, json};
use vamvs::core::Lens;
use vamvs::core::depth_range::RangeOrigin;
use vamvs::io::{Loaded, colmap, mvsnet};
use vamvs::{DepthOptions, Input, Photographs, Plan, ViewPlan};

use super::info::{counted, object};

/// Pixels between neighbouring planes; it does not change what is told.
const PLANE_STEP: f64 = 1.0;

/// Views that are named.
const NAMED: usize = 5;

/// The capture at a path, with the kind that it is of and the flags that name it; `None` if there is none.
pub fn input(path: &Path) -> Option<(Input, &'static str, String)> {
    let shown = path.display();
    let (cams, images) = (path.join("cams"), path.join("images"));
    let named = |name: &str| path.file_name().is_some_and(|file| file == name);
    let has_extension = |end: &str| path.extension().is_some_and(|extension| extension == end);
    if cams.is_dir() && images.is_dir() {
        let flags = format!("--cams {} --images {}", cams.display(), images.display());
        let options = mvsnet::Options::default();
        return Some((
            Input::Mvsnet { cams, images, pairs: None, options },
            "cameras and photographs (MVSNet)",
            flags,
        ));
    }
    let path_of = || path.to_owned();
    if named("transforms.json") || path.join("transforms.json").is_file() {
        let input = Input::Nerfstudio { transforms: path_of(), images: None };
        return Some((input, "nerfstudio or instant-ngp", format!("--nerfstudio {shown}")));
    }
    if path.is_file() && has_extension("nvm") {
        return Some((Input::Nvm { nvm: path_of(), images: None }, "VisualSFM", format!("--nvm {shown}")));
    }
    if path.is_file() && has_extension("mvs") {
        return Some((
            Input::Openmvs { mvs: path_of(), images: None },
            "OpenMVS",
            format!("--openmvs {shown}"),
        ));
    }
    if path.is_file() && has_extension("out") {
        return Some((
            Input::Bundler { bundle: path_of(), images: None },
            "Bundler",
            format!("--bundler {shown}"),
        ));
    }
    let model = path.is_dir().then(|| colmap::workspace::model(path).ok()).flatten()?;
    // The folders of a workspace hold photographs beside sparse/.
    let beside =
        model.ancestors().skip(1).take(2).map(|folder| folder.join("images")).find(|images| images.is_dir());
    let flags = match &beside {
        Some(images) => format!("--colmap {} --images {}", model.display(), images.display()),
        None => format!("--colmap {} --images DIR", model.display()),
    };
    Some((Input::Colmap { model, images: beside }, "COLMAP model", flags))
}

/// What a reconstruction with default settings would do with a capture.
pub fn facts((input, kind, flags): (Input, &str, String)) -> Result<Map<String, Value>> {
    let loaded = input.load()?;
    let options = DepthOptions::default();
    let photographs = Photographs::new(&loaded.images, loaded.masks.clone(), &options);
    let mut facts = scene(kind, &loaded);
    let mut warnings = loaded.warnings.clone();
    warnings.extend(vamvs::warn_of_lenses(&loaded.scene.views));
    let (photographs, note) = photographs.stretched(&loaded.scene.views, &options);
    warnings.extend(note);
    match vamvs::plan(&loaded.scene, &photographs, &options, PLANE_STEP) {
        Ok(plan) => facts.extend(planned(&loaded, &plan)),
        Err(error) => warnings.push(error.to_string()),
    }
    if !warnings.is_empty() {
        facts.insert("warnings".to_owned(), warnings.into());
    }
    facts.insert("command".to_owned(), format!("vamvs reconstruct {flags} --out out").into());
    Ok(facts)
}

fn scene(kind: &str, loaded: &Loaded) -> Map<String, Value> {
    let views = &loaded.scene.views;
    let mut lenses: BTreeMap<&str, usize> = BTreeMap::new();
    for view in views {
        let kind = match view.camera.lens {
            Lens::None => "pinhole",
            Lens::Face(_) => "face of a wider photograph",
            _ => "distorted",
        };
        *lenses.entry(kind).or_default() += 1;
    }
    object(json!({
        "kind": kind,
        "views": views.len(),
        "photographs": loaded.images.display().to_string(),
        "size": counted(views.iter().map(|view| view.camera.size.to_string())),
        "cameras": lenses,
        "points": loaded.scene.points.len(),
        "pairs": loaded.scene.pairs.is_some(),
    }))
}

fn planned(loaded: &Loaded, plan: &Plan) -> Map<String, Value> {
    let views: Vec<&ViewPlan> = plan.views.iter().flatten().collect();
    let mut origins: BTreeMap<String, usize> = BTreeMap::new();
    for view in &views {
        let origin = match view.origin {
            Some(RangeOrigin::Geometry) => "a draft around what the cameras suggest".to_owned(),
            origin => origin.map_or_else(String::new, |origin| origin.to_string()),
        };
        *origins.entry(origin).or_default() += 1;
    }
    let mut facts = object(json!({
        "views that share surfaces": spread(plan.neighbours.iter().map(|views| views.len() as f64)),
        "compared with": spread(views.iter().map(|view| view.sources.len() as f64)),
        "nearest depth": spread(views.iter().map(|view| view.planes.range.near)),
        "farthest depth": spread(views.iter().map(|view| view.planes.range.far)),
        "depth range from": origins,
    }));
    let left_out = plan.views.iter().zip(&loaded.scene.views);
    let left_out: Vec<String> = left_out
        .filter_map(|(plan, view)| Some(format!("{}: {}", view.name, plan.as_ref().err()?)))
        .collect();
    if !left_out.is_empty() {
        let more = left_out.len().saturating_sub(NAMED);
        let mut named: Vec<String> = left_out.into_iter().take(NAMED).collect();
        named.extend((more > 0).then(|| format!("{more} more")));
        facts.insert("left out".to_owned(), named.into());
    }
    facts
}

/// The least, the middle and the largest of some numbers.
fn spread(numbers: impl Iterator<Item = f64>) -> Value {
    let mut numbers: Vec<f64> = numbers.collect();
    numbers.sort_by(f64::total_cmp);
    let (Some(least), Some(most)) = (numbers.first(), numbers.last()) else { return Value::Null };
    let round =
        |number: f64| if number.fract() == 0.0 { format!("{number}") } else { format!("{number:.4}") };
    if least == most {
        return round(*least).into();
    }
    let middle = numbers[numbers.len() / 2];
    format!("{} to {}, median {}", round(*least), round(*most), round(middle)).into()
}
