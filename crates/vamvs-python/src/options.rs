//! Keyword arguments as options: those of `run.toml`, with underscores.

use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{IntoPyDict, PyDict};
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::{Map, Value, json};
use vamvs::fusion::FuseOptions;
use vamvs::meshing::MeshOptions;
use vamvs::{DepthOptions, FusionOptions, Quality};

/// Keyword arguments, and the names of the options known so far.
pub struct Options {
    given: Map<String, Value>,
    known: Vec<String>,
}

impl Options {
    pub fn new(given: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let mut options = Self { given: Map::new(), known: Vec::new() };
        let Some(given) = given else { return Ok(options) };
        // Numbers and arrays of NumPy become Python's.
        let plain = given.py().import("operator")?.call_method1("methodcaller", ("tolist",))?;
        let default = [("default", plain)].into_py_dict(given.py())?;
        let text: String =
            given.py().import("json")?.call_method("dumps", (given,), Some(&default))?.extract()?;
        let values: Map<String, Value> =
            serde_json::from_str(&text).map_err(|error| PyValueError::new_err(error.to_string()))?;
        for (name, value) in values {
            let name = name.replace('_', "-");
            let value = named(&name, value)?;
            options.given.insert(name, value);
        }
        Ok(options)
    }

    /// The quality, if one is asked for.
    pub fn quality(&mut self) -> PyResult<Option<Quality>> {
        self.known.push("quality".to_owned());
        let Some(value) = self.given.get("quality").filter(|value| !value.is_null()) else { return Ok(None) };
        Ok(Some(match value.as_str() {
            Some("draft") => Quality::Draft,
            Some("normal") => Quality::Normal,
            Some("best") => Quality::Best,
            _ => {
                let text = format!("quality: expected \"draft\", \"normal\" or \"best\", found {value}");
                return Err(PyValueError::new_err(text));
            }
        }))
    }

    /// How depth maps are made; the defaults are those of this quality.
    pub fn depth(&mut self, quality: Quality) -> PyResult<DepthOptions> {
        self.take(&quality.applied(&DepthOptions::default()), &[])
    }

    /// How depth maps become a cloud.
    pub fn fusion(&mut self) -> PyResult<FusionOptions> {
        let mut options = self.take(&FusionOptions::default(), &["filter"])?;
        options.filter = self.take(&FuseOptions::default(), &[])?;
        options.validate().map_err(|error| PyValueError::new_err(error.to_string()))?;
        Ok(options)
    }

    /// How depth maps become a mesh.
    pub fn mesh(&mut self) -> PyResult<MeshOptions> {
        self.take(&MeshOptions::default(), &[])
    }

    /// Refuses unknown arguments.
    pub fn finish(self) -> PyResult<()> {
        match self.given.keys().find(|name| !self.known.contains(name)) {
            None => Ok(()),
            Some(unknown) => Err(PyTypeError::new_err(format!(
                "unknown option {:?}: expected one of {}",
                unknown.replace('-', "_"),
                self.known.join(", ").replace('-', "_")
            ))),
        }
    }

    /// The options of one kind, with the values of `base` for those that are not given; kinds may
    /// share names.
    fn take<T: Serialize + DeserializeOwned>(&mut self, base: &T, without: &[&str]) -> PyResult<T> {
        let wrong = |error: serde_json::Error| PyValueError::new_err(error.to_string());
        let mut options: Map<String, Value> =
            serde_json::to_value(base).and_then(serde_json::from_value).map_err(wrong)?;
        let names: Vec<String> =
            options.keys().filter(|name| !without.contains(&name.as_str())).cloned().collect();
        for name in &names {
            let Some(value) = self.given.get(name) else { continue };
            let alone = serde_json::from_value::<T>(json!({name: value}));
            alone.map_err(|error| PyValueError::new_err(format!("{}: {error}", name.replace('-', "_"))))?;
            options.insert(name.clone(), value.clone());
        }
        self.known.extend(names);
        serde_json::from_value(Value::Object(options)).map_err(wrong)
    }
}

/// Gives names to the values of options that are plain numbers or text in Python.
fn named(name: &str, value: Value) -> PyResult<Value> {
    let numbers = |count: usize| {
        let numbers: Option<Vec<f64>> = value.as_array()?.iter().map(Value::as_f64).collect();
        numbers.filter(|numbers| numbers.len() == count)
    };
    let wrong = |expected: &str| PyValueError::new_err(format!("{name}: expected {expected}, found {value}"));
    Ok(match name {
        _ if value.is_null() => value,
        "depth-range" => {
            let range = numbers(2).ok_or_else(|| wrong("(near, far)"))?;
            json!({"near": range[0], "far": range[1]})
        }
        "roi" => {
            let bounds = numbers(6).ok_or_else(|| wrong("(xmin, ymin, zmin, xmax, ymax, zmax)"))?;
            json!({"min": bounds[..3], "max": bounds[3..]})
        }
        "point-spacing" => {
            let pixels = value.as_str().and_then(|text| text.strip_suffix("px")?.trim().parse::<f64>().ok());
            match (value.as_f64(), pixels) {
                (Some(units), _) => json!({"units": units}),
                (None, Some(pixels)) => json!({"pixels": pixels}),
                _ => return Err(wrong("a distance, or \"Npx\"")),
            }
        }
        _ => value,
    })
}
