//! Keyword arguments as options: those of `run.toml`, with underscores.

use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::{Map, Value, json};
use vamvs::fusion::FuseOptions;
use vamvs::{DepthOptions, FusionOptions};

/// Keyword arguments that have not been taken yet.
pub struct Options {
    given: Map<String, Value>,
    known: Vec<String>,
}

impl Options {
    pub fn new(given: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let mut options = Self { given: Map::new(), known: Vec::new() };
        let Some(given) = given else { return Ok(options) };
        let text: String = given.py().import("json")?.call_method1("dumps", (given,))?.extract()?;
        let values: Map<String, Value> =
            serde_json::from_str(&text).map_err(|error| PyValueError::new_err(error.to_string()))?;
        for (name, value) in values {
            let name = name.replace('_', "-");
            let value = named(&name, value)?;
            options.given.insert(name, value);
        }
        Ok(options)
    }

    /// How depth maps are made.
    pub fn depth(&mut self) -> PyResult<DepthOptions> {
        self.take::<DepthOptions>(&[])
    }

    /// How depth maps become a cloud.
    pub fn fusion(&mut self) -> PyResult<FusionOptions> {
        let mut options = self.take::<FusionOptions>(&["filter"])?;
        options.filter = self.take::<FuseOptions>(&[])?;
        options.filter.validate().map_err(|error| PyValueError::new_err(error.to_string()))?;
        Ok(options)
    }

    /// Refuses arguments that nobody knows.
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

    /// The options of one kind; others may know the same names.
    fn take<T: Default + Serialize + DeserializeOwned>(&mut self, without: &[&str]) -> PyResult<T> {
        let wrong = |error: serde_json::Error| PyValueError::new_err(error.to_string());
        let defaults = serde_json::to_value(T::default()).map_err(wrong)?;
        let names = defaults.as_object().into_iter().flat_map(Map::keys);
        let names: Vec<String> = names.filter(|name| !without.contains(&name.as_str())).cloned().collect();
        let given = names.iter().filter_map(|name| Some((name.clone(), self.given.get(name)?.clone())));
        let own: Map<String, Value> = given.collect();
        self.known.extend(names);
        for (name, value) in &own {
            let alone = serde_json::from_value::<T>(json!({name: value}));
            alone.map_err(|error| PyValueError::new_err(format!("{}: {error}", name.replace('-', "_"))))?;
        }
        serde_json::from_value(Value::Object(own)).map_err(wrong)
    }
}

/// What is told by numbers in Python, by name.
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
