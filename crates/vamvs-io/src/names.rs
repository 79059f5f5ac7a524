//! Names of photographs that are nearly those of files: other case, another or no extension, invisible characters, other
//! Unicode normal form (macOS writes é as two characters).

use std::collections::BTreeSet;
use std::fmt::Write;
use std::path::Path;

use unicode_normalization::UnicodeNormalization;

use crate::image::EXTENSIONS;

/// The one of `found` that `name` nearly names; `None` if there is none or more than one. The whole path decides, or else the
/// last part of it.
pub(crate) fn near<'a>(found: &'a BTreeSet<String>, name: &str) -> Option<&'a str> {
    let wanted = key(name);
    let last = |key: &str| key.rsplit('/').next().unwrap_or_default().to_owned();
    let one = |matches: &dyn Fn(&str) -> bool| {
        let mut matching = found.iter().filter(|found| matches(&key(found)));
        matching.next().filter(|_| matching.next().is_none()).map(String::as_str)
    };
    one(&|key| key == wanted).or_else(|| one(&|key| last(key) == last(&wanted)))
}

/// What nearly equal names have in common: lower case, `/` between folders, composed and no invisible characters, no extension of
/// an image.
fn key(name: &str) -> String {
    let visible: String = name.nfc().filter(|&c| !is_invisible(c)).collect();
    let plain = visible.trim().replace('\\', "/").to_lowercase();
    match plain.rsplit_once('.') {
        Some((stem, extension)) if EXTENSIONS.contains(&extension) => stem.to_owned(),
        _ => plain,
    }
}

/// The name as a message shows it: invisible characters are escaped.
pub(crate) fn shown(name: &str) -> String {
    let mut text = String::with_capacity(name.len());
    for c in name.chars() {
        if is_invisible(c) {
            write!(text, "{}", c.escape_unicode()).expect("writing to a string cannot fail");
        } else {
            text.push(c);
        }
    }
    text
}

/// Whether a character takes no place on paper: controls, byte order marks, joiners, marks of direction.
fn is_invisible(c: char) -> bool {
    let ranges = [
        '\u{ad}'..='\u{ad}',
        '\u{200b}'..='\u{200f}',
        '\u{202a}'..='\u{202e}',
        '\u{2060}'..='\u{2064}',
        '\u{feff}'..='\u{feff}',
    ];
    c.is_control() || ranges.iter().any(|range| range.contains(&c))
}

/// A warning that photographs were found under other names than the scene's files have; `pairs` are name and file.
pub(crate) fn warn_of_renamed(folder: &Path, pairs: &[(String, String)]) -> Option<String> {
    let (name, file) = pairs.first()?;
    Some(format!(
        "{} of the scene's images are in {} under nearly the same name ({} is {})",
        pairs.len(),
        folder.display(),
        shown(name),
        shown(file)
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_only_near_name_is_found_and_of_two_none() {
        let found: BTreeSet<String> =
            ["a/IMG_1.JPG", "a/img_2.png", "a/img_2.jpg", "b/x.tif", "c/x.tif", "b/é.jpg"]
                .map(str::to_owned)
                .into();
        assert_eq!(near(&found, "a/img_1.jpg"), Some("a/IMG_1.JPG"));
        assert_eq!(near(&found, "\u{feff}a\\img_1"), Some("a/IMG_1.JPG"));
        assert_eq!(near(&found, "elsewhere/Img_1.png"), Some("a/IMG_1.JPG"));
        assert_eq!(near(&found, "a/img_2.webp"), None);
        assert_eq!(near(&found, "b/e\u{301}.JPG"), Some("b/é.jpg"), "decomposed, as macOS writes it");
        assert_eq!(near(&found, "b/X.tiff"), Some("b/x.tif"));
        assert_eq!(near(&found, "x.tif"), None);
        assert_eq!(near(&found, "a/img_3.jpg"), None);
    }

    #[test]
    fn invisible_characters_are_shown() {
        assert_eq!(shown("\u{feff}é 1.jpg\t"), "\\u{feff}é 1.jpg\\u{9}");
    }
}
