//! `vamvs info`: what a file or folder is; of a capture, what a reconstruction would do with it.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context, Result, bail};
use serde_json::{Map, Value, json};
use vamvs::Maps;
use vamvs::fusion::MapSource;
use vamvs::io::masks::Masks;
use vamvs::io::{colmap, image, pfm, ply};
use vamvs::output::ConfidenceKind;

use super::capture;
use crate::arguments::InfoArguments;

/// Runs the command.
pub fn run(arguments: &InfoArguments) -> Result<()> {
    let facts = facts(&arguments.what)?;
    if arguments.json {
        say!("{}", Value::Object(facts));
    } else {
        facts.iter().for_each(|(key, value)| say!("{key}: {}", plain(value)));
    }
    Ok(())
}

fn facts(what: &Path) -> Result<Map<String, Value>> {
    if what == Path::new("device") {
        return device();
    }
    if what.is_dir() {
        return folder(what);
    }
    if let Some(capture) = capture::input(what) {
        return capture::facts(capture);
    }
    match what.extension().and_then(|extension| extension.to_str()) {
        Some("pt") => weights(what),
        Some("safetensors") => vis_corr(what),
        Some("ply") => cloud(what),
        Some("pfm") => float_map(what),
        Some("jpg" | "jpeg" | "png" | "tif" | "tiff" | "bmp" | "webp") => {
            Ok(object(json!({"kind": "image", "size": image::stored_size(what)?.to_string()})))
        }
        _ if !what.exists() => bail!("{}: there is no such file or folder", what.display()),
        _ => bail!(
            "{}: expected a .pt, .safetensors, .ply, .pfm or image file; a folder of depth maps, of a COLMAP model or of cams/ and images/; transforms.json, an .nvm, .mvs or bundle.out file; or the word `device`",
            what.display()
        ),
    }
}

/// The weights of vis-corr.
fn vis_corr(path: &Path) -> Result<Map<String, Value>> {
    let bytes = vamvs::weights::without_libtorch(path)?.expect("a .safetensors file needs no libtorch");
    let network = vamvs::corr::Network::new(&bytes).with_context(|| path.display().to_string())?;
    let mut facts = object(json!({"kind": "network"}));
    facts.extend(object(serde_json::to_value(network.manifest())?));
    Ok(facts)
}

#[cfg(feature = "torch")]
fn weights(path: &Path) -> Result<Map<String, Value>> {
    let network = vamvs::weights::load(Some(path), vamvs::net::Device::Cpu)?;
    let mut facts = object(json!({"kind": "network"}));
    facts.extend(object(serde_json::to_value(network.manifest())?));
    Ok(facts)
}

/// What networks can run on.
fn device() -> Result<Map<String, Value>> {
    let mut facts = Map::new();
    #[cfg(feature = "torch")]
    facts.extend(object(json!({
        "device": vamvs::net::device::device_name(vamvs::net::device::open_device("auto")?),
        "gpus": vamvs::net::tch::Cuda::device_count(),
        "threads": vamvs::net::tch::get_num_threads(),
    })));
    #[cfg(feature = "gpu")]
    for (number, adapter) in vamvs::gpu::adapters().into_iter().enumerate() {
        let largest = adapter.largest_buffer / (1 << 20);
        facts.insert(format!("gpu:{number}"), json!(format!("{adapter}, maps of up to {largest} MiB")));
    }
    facts.insert("cpu".to_owned(), json!(format!("{} threads", rayon::current_num_threads())));
    Ok(facts)
}

#[cfg(not(feature = "torch"))]
fn weights(path: &Path) -> Result<Map<String, Value>> {
    bail!(
        "{}: this vamvs was built without libtorch, which TorchScript modules need: expected {}",
        path.display(),
        vamvs::WITH_LIBTORCH
    )
}

fn folder(folder: &Path) -> Result<Map<String, Value>> {
    if Maps::are_at(folder) {
        return depth_maps(folder);
    }
    match capture::input(folder) {
        Some(capture) => capture::facts(capture).or_else(|error| unusable(folder, error)),
        None => model(&colmap::workspace::model(folder)?),
    }
}

fn depth_maps(folder: &Path) -> Result<Map<String, Value>> {
    let mut warnings = Vec::new();
    let mut listen = |event| {
        warnings.extend(match event {
            vamvs::Event::Warning(text) => Some(text),
            _ => None,
        });
        std::ops::ControlFlow::Continue(())
    };
    let maps = Maps::open(folder, Masks::None, &mut listen)?;
    let records: Vec<_> = (0..maps.len()).filter_map(|view| maps.record(view)).collect();
    let refined = records.iter().filter(|record| record.confidence == ConfidenceKind::Refined).count();
    let cameras = (0..maps.len()).map(|view| maps.camera(view).size.to_string());
    let mut facts = object(json!({
        "kind": "depth maps",
        "views": maps.len(),
        "size": counted(cameras),
        "of this program": records.len(),
        "refined": refined,
        "pairs": maps.pairs().is_some(),
    }));
    let cloud = maps.default_cloud();
    if cloud.is_file() {
        facts.insert("cloud".to_owned(), cloud.display().to_string().into());
    }
    if !warnings.is_empty() {
        facts.insert("warnings".to_owned(), warnings.into());
    }
    Ok(facts)
}

/// The facts of a COLMAP model whose photographs cannot be used, with why; of other captures that is an error.
fn unusable(folder: &Path, error: anyhow::Error) -> Result<Map<String, Value>> {
    let Ok(found) = colmap::workspace::model(folder) else { return Err(error) };
    let mut facts = model(&found)?;
    facts.insert("warnings".to_owned(), vec![format!("{error:#}")].into());
    Ok(facts)
}

fn model(folder: &Path) -> Result<Map<String, Value>> {
    let model = colmap::Model::read(folder)?;
    Ok(object(json!({
        "kind": "COLMAP model",
        "folder": folder.display().to_string(),
        "cameras": model.cameras.len(),
        "images": model.images.len(),
        "points": model.points.len(),
    })))
}

fn cloud(path: &Path) -> Result<Map<String, Value>> {
    let cloud = ply::read(path)?;
    let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for point in &cloud {
        for axis in 0..3 {
            low[axis] = low[axis].min(point.x_in_world[axis]);
            high[axis] = high[axis].max(point.x_in_world[axis]);
        }
    }
    let with_normals = cloud.iter().any(|point| point.normal != [0.0; 3]);
    Ok(object(
        json!({"kind": "point cloud", "points": cloud.len(), "normals": with_normals, "min": low, "max": high}),
    ))
}

fn float_map(path: &Path) -> Result<Map<String, Value>> {
    if let Ok(size) = pfm::stored_size(path, 3) {
        return Ok(object(
            json!({"kind": "map of three channels, such as normals", "size": size.to_string()}),
        ));
    }
    let depth = pfm::read_depth(path)?;
    let valid: Vec<f32> = depth.data().iter().copied().filter(|depth| *depth > 0.0).collect();
    Ok(object(json!({
        "kind": "depth map",
        "size": depth.size().to_string(),
        "valid": valid.len() as f64 / depth.data().len() as f64,
        "min": valid.iter().copied().reduce(f32::min),
        "max": valid.iter().copied().reduce(f32::max),
    })))
}

pub fn object(value: Value) -> Map<String, Value> {
    match value {
        Value::Object(map) => map,
        other => Map::from_iter([("value".to_owned(), other)]),
    }
}

/// Strings without quotes.
fn plain(value: &Value) -> String {
    value.as_str().map_or_else(|| value.to_string(), str::to_owned)
}

/// Values that may be equal, each once, with their numbers if there are several: `3 of 640×480, 1 of 800×600`.
pub fn counted(values: impl Iterator<Item = String>) -> String {
    let mut counts: BTreeMap<String, usize> = BTreeMap::new();
    values.for_each(|value| *counts.entry(value).or_default() += 1);
    if let (1, Some(only)) = (counts.len(), counts.keys().next()) {
        return only.clone();
    }
    let each: Vec<String> = counts.iter().map(|(value, count)| format!("{count} of {value}")).collect();
    each.join(", ")
}
