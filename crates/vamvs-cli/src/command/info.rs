//! `vamvs info`: what a file or folder is.

use std::path::Path;

use anyhow::{Result, bail};
use serde_json::{Map, Value, json};
use vamvs::io::{colmap, image, pfm, ply};

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
        return model(what);
    }
    match what.extension().and_then(|extension| extension.to_str()) {
        Some("pt") => weights(what),
        Some("ply") => cloud(what),
        Some("pfm") => depth_map(what),
        Some("jpg" | "jpeg" | "png" | "tif" | "tiff" | "bmp" | "webp") => {
            Ok(object(json!({"kind": "image", "size": image::stored_size(what)?.to_string()})))
        }
        _ => bail!(
            "{}: expected a .pt, .ply, .pfm or image file, a COLMAP model folder, or the word `device`",
            what.display()
        ),
    }
}

#[cfg(feature = "net")]
fn weights(path: &Path) -> Result<Map<String, Value>> {
    let network = vamvs::weights::load(Some(path), vamvs::net::Device::Cpu)?;
    let mut facts = object(json!({"kind": "network"}));
    facts.extend(object(serde_json::to_value(network.manifest())?));
    Ok(facts)
}

#[cfg(feature = "net")]
fn device() -> Result<Map<String, Value>> {
    let device = vamvs::net::device::open_device("auto")?;
    Ok(object(json!({
        "device": vamvs::net::device::device_name(device),
        "gpus": vamvs::net::tch::Cuda::device_count(),
        "threads": vamvs::net::tch::get_num_threads(),
    })))
}

#[cfg(not(feature = "net"))]
fn weights(path: &Path) -> Result<Map<String, Value>> {
    bail!("{}: this vamvs was built without libtorch and cannot read networks", path.display())
}

#[cfg(not(feature = "net"))]
fn device() -> Result<Map<String, Value>> {
    bail!("this vamvs was built without libtorch and uses no device but the processor")
}

fn model(folder: &Path) -> Result<Map<String, Value>> {
    let model = colmap::Model::read(folder)?;
    Ok(object(json!({
        "kind": "COLMAP model",
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
    Ok(object(json!({"kind": "point cloud", "points": cloud.len(), "min": low, "max": high})))
}

fn depth_map(path: &Path) -> Result<Map<String, Value>> {
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

fn object(value: Value) -> Map<String, Value> {
    match value {
        Value::Object(map) => map,
        other => Map::from_iter([("value".to_owned(), other)]),
    }
}

/// Strings without quotes.
fn plain(value: &Value) -> String {
    value.as_str().map_or_else(|| value.to_string(), str::to_owned)
}
