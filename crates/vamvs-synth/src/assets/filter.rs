//! Selects assets by name.

use std::path::Path;

use glob::Pattern;

use super::AssetError;

/// Which assets may be used. A name is a glob (`*`, `?`, `[…]`). It matches an asset if it matches the asset's
/// path relative to the asset folder or any part of that path, with or without extension: `025_mug`, `bsds_*`,
/// `sunset.hdr`, `kitchen/*`.
#[derive(Clone, Debug, Default)]
pub struct AssetFilter {
    only: Vec<Pattern>,
    exclude: Vec<Pattern>,
}

impl AssetFilter {
    /// Admits the assets that a name in `only` matches (all, if `only` is empty) and no name in `exclude` matches.
    ///
    /// # Errors
    /// If a name is not a valid glob.
    pub fn new<S: AsRef<str>>(only: &[S], exclude: &[S]) -> Result<Self, AssetError> {
        Ok(Self { only: patterns(only)?, exclude: patterns(exclude)? })
    }

    /// Whether the asset at `path`, relative to its folder, may be used.
    #[must_use]
    pub fn admits(&self, path: &Path) -> bool {
        let named = |patterns: &[Pattern]| patterns.iter().any(|pattern| means(pattern, path));
        (self.only.is_empty() || named(&self.only)) && !named(&self.exclude)
    }
}

fn patterns<S: AsRef<str>>(names: &[S]) -> Result<Vec<Pattern>, AssetError> {
    let compile = |name: &str| {
        Pattern::new(name).map_err(|source| AssetError::Pattern { pattern: name.to_owned(), source })
    };
    names.iter().map(|name| compile(name.as_ref())).collect()
}

fn means(pattern: &Pattern, path: &Path) -> bool {
    let matches = |path: &Path| pattern.matches_path(path) || pattern.matches_path(&path.with_extension(""));
    matches(path) || path.iter().any(|part| matches(Path::new(part)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn admitted(only: &[&str], exclude: &[&str]) -> Vec<&'static str> {
        let assets = ["025_mug/textured.obj", "bsds_10.jpg", "kitchen/bsds_2.jpg", "sunset.hdr"];
        let filter = AssetFilter::new(only, exclude).unwrap();
        assets.into_iter().filter(|asset| filter.admits(Path::new(asset))).collect()
    }

    #[test]
    fn names_mean_paths_folders_files_and_stems() {
        assert_eq!(admitted(&[], &[]).len(), 4);
        assert_eq!(admitted(&["025_mug"], &[]), ["025_mug/textured.obj"]);
        assert_eq!(admitted(&["bsds_*"], &[]), ["bsds_10.jpg", "kitchen/bsds_2.jpg"]);
        assert_eq!(admitted(&["bsds_*"], &["kitchen"]), ["bsds_10.jpg"]);
        assert_eq!(admitted(&["bsds_?"], &[]), ["kitchen/bsds_2.jpg"]);
        assert_eq!(admitted(&[], &["*/*", "sunset"]), ["bsds_10.jpg"]);
        assert_eq!(admitted(&["sunset.hdr"], &[]), ["sunset.hdr"]);
        assert_eq!(admitted(&["bsds_1"], &[]), [""; 0]);
    }

    #[test]
    fn a_bad_pattern_is_named() {
        let error = AssetFilter::new(&[], &["a", "x[b"]).unwrap_err();
        assert!(error.to_string().contains("x[b"), "{error}");
    }
}
