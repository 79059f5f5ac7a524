//! All that makes a scene, and its record beside the scene.

use std::path::Path;

use serde::{Deserialize, Serialize};
use serde_json::Value;
use vamvs_core::Size;
use vamvs_io::{IoError, atomic};

use crate::{Effects, RenderOptions, Rig, Style, SynthError};

/// Changes whenever the same recipe gives another scene.
const VERSION: u32 = 1;

/// All that makes a scene: equal recipes, equal files.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Recipe {
    /// The version of this crate's scenes.
    pub version: u32,
    /// The seed of the set.
    pub seed: u64,
    /// The scene's number in the set.
    pub scene: u64,
    /// What the scene is.
    pub style: Style,
    /// How the cameras stand.
    pub rig: Rig,
    /// Number of cameras.
    pub views: usize,
    /// Size of the photographs.
    pub size: Size,
    /// How they are rendered.
    pub render: RenderOptions,
    /// What makes them look real.
    pub effects: Effects,
    /// Whether normals are kept.
    pub normals: bool,
    /// [`Assets::fingerprint`](crate::Assets::fingerprint).
    pub assets: String,
}

impl Recipe {
    /// The version of the scenes that this crate makes.
    pub(crate) const fn version() -> u32 {
        VERSION
    }

    /// Whether the record at `path` is there and is this recipe.
    ///
    /// # Errors
    /// If the record is another recipe's, or none.
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

    /// Writes the record.
    pub(crate) fn save(&self, path: &Path) -> Result<(), SynthError> {
        Ok(atomic::write(path, |out| writeln!(out, "{:#}", self.to_value()))?)
    }

    fn to_value(&self) -> Value {
        serde_json::to_value(self).expect("a recipe is plain data")
    }
}

/// The fields whose values differ, as `name old instead of new`.
fn differences(old: &Value, new: &Value) -> Vec<String> {
    let (Value::Object(old), Value::Object(new)) = (old, new) else {
        return vec!["no record of a scene".to_owned()];
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
