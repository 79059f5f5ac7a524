//! The recipe that determines a scene, and its record in the scene's folder.

use std::path::Path;

use serde::{Deserialize, Serialize};
use serde_json::Value;
use vamvs_core::Size;
use vamvs_io::{IoError, atomic};

use crate::{Effects, RenderOptions, Rig, Style, SynthError};

/// Version of the generator: it changes whenever the same recipe would give a different scene.
const VERSION: u32 = 1;

/// Everything that determines a scene: equal recipes give equal files.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Recipe {
    /// Version of the generator.
    pub version: u32,
    /// The seed of the set.
    pub seed: u64,
    /// The scene's number in the set.
    pub scene: u64,
    /// The kind of scene.
    pub style: Style,
    /// How the cameras are arranged.
    pub rig: Rig,
    /// Number of cameras.
    pub views: usize,
    /// Size of the photographs, pixels.
    pub size: Size,
    /// How the photographs are rendered.
    pub render: RenderOptions,
    /// Limits of the lens and sensor effects added to the photographs.
    pub effects: Effects,
    /// Whether normals are written.
    pub normals: bool,
    /// Hash of the assets: [`Assets::fingerprint`](crate::Assets::fingerprint).
    pub assets: String,
}

impl Recipe {
    /// The version of recipes that are made now.
    pub(crate) const fn version() -> u32 {
        VERSION
    }

    /// Whether there is a record at `path` that equals this recipe; `false` if there is no file.
    ///
    /// # Errors
    /// If the record is that of another recipe, is not valid JSON, or cannot be read.
    pub(crate) fn is_at(&self, path: &Path) -> Result<bool, SynthError> {
        let text = match std::fs::read(path) {
            Ok(text) => text,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(false),
            Err(source) => {
                return Err(IoError::System { action: "read", path: path.to_owned(), source }.into());
            }
        };
        let not_a_record = |source| SynthError::Record { path: path.to_owned(), source };
        let found: Value = serde_json::from_slice(&text).map_err(not_a_record)?;
        let differences = differences(&found, &self.to_value());
        if differences.is_empty() {
            return Ok(true);
        }
        let folder = path.parent().unwrap_or(path).to_owned();
        Err(SynthError::OtherScene { folder, differences: differences.join(", ") })
    }

    /// Writes the record to `path`.
    pub(crate) fn save(&self, path: &Path) -> Result<(), SynthError> {
        Ok(atomic::write(path, |out| writeln!(out, "{:#}", self.to_value()))?)
    }

    fn to_value(&self) -> Value {
        serde_json::to_value(self).expect("a recipe is plain data")
    }
}

/// The fields that differ, each as `name old instead of new`.
fn differences(old: &Value, new: &Value) -> Vec<String> {
    let (Value::Object(old), Value::Object(new)) = (old, new) else {
        return vec!["an unreadable recipe".to_owned()];
    };
    let names = old.keys().chain(new.keys().filter(|name| !old.contains_key(*name)));
    let value = |of: Option<&Value>| of.map_or("none".to_owned(), Value::to_string);
    let differing = names.filter(|name| old.get(*name) != new.get(*name));
    differing
        .map(|name| format!("{name} {} instead of {}", value(old.get(name)), value(new.get(name))))
        .collect()
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    pub(crate) fn recipe() -> Recipe {
        Recipe {
            version: VERSION,
            seed: 7,
            scene: 3,
            style: Style::Clutter,
            rig: Rig::Dome,
            views: 3,
            size: Size::new(32, 24),
            render: RenderOptions::default(),
            effects: Effects::default(),
            normals: false,
            assets: "0".repeat(64),
        }
    }

    #[test]
    fn a_saved_recipe_is_the_same() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("scene.json");
        assert!(!recipe().is_at(&path).unwrap());
        recipe().save(&path).unwrap();
        assert!(recipe().is_at(&path).unwrap());
        assert_eq!(serde_json::from_slice::<Recipe>(&std::fs::read(&path).unwrap()).unwrap(), recipe());
    }

    #[test]
    fn another_recipe_is_refused_with_what_differs() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("scene.json");
        recipe().save(&path).unwrap();
        let other = Recipe { seed: 8, rig: Rig::Arc, ..recipe() };
        let error = other.is_at(&path).unwrap_err().to_string();
        assert!(error.contains("seed 7 instead of 8") && error.contains("rig \"dome\" instead of \"arc\""));
        assert!(!error.contains("views"), "{error}");
        atomic::write(&path, |out| out.write_all(b"{ half")).unwrap();
        assert!(other.is_at(&path).unwrap_err().to_string().contains("scene.json"));
    }
}
