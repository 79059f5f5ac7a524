//! The sizes of photographs: as stated in a scene's files or, where they state none, from the photographs'
//! headers.

use std::collections::BTreeMap;
use std::path::Path;

use vamvs_core::Size;

use crate::{IoError, image};

/// The size in pixels of each of the photographs `names` in `folder`: the `stated` one, or else the one in its
/// header.
///
/// One damaged photograph must not prevent a scene from being read. A photograph whose header cannot be read
/// therefore gets the most frequent size of the others; the error is reported when it is decoded.
///
/// # Errors
/// If no size is stated and no header can be read.
pub(crate) fn sizes(folder: &Path, names: &[&str], stated: &[Option<Size>]) -> Result<Vec<Size>, IoError> {
    let size = |(name, stated): (&&str, &Option<Size>)| match stated {
        Some(size) => Ok(*size),
        None => image::stored_size(&folder.join(name)),
    };
    let found: Vec<Result<Size, IoError>> = names.iter().zip(stated).map(size).collect();
    let usual = commonest(found.iter().flatten());
    found.into_iter().map(|size| size.or_else(|error| usual.ok_or(error))).collect()
}

/// As [`sizes`], for photographs of which no size is stated.
pub(crate) fn stored_sizes(folder: &Path, names: &[&str]) -> Result<Vec<Size>, IoError> {
    sizes(folder, names, &vec![None; names.len()])
}

/// The most frequent size; of equally frequent ones, the one with the largest area.
fn commonest<'a>(sizes: impl Iterator<Item = &'a Size>) -> Option<Size> {
    let mut counts: BTreeMap<(usize, usize), usize> = BTreeMap::new();
    sizes.for_each(|size| *counts.entry((size.width, size.height)).or_default() += 1);
    let most = counts.into_iter().max_by_key(|&((width, height), count)| (count, width * height));
    most.map(|((width, height), _)| Size::new(width, height))
}

#[cfg(test)]
mod tests {
    use vamvs_core::Grid;

    use super::*;

    #[test]
    fn a_photograph_without_header_gets_the_size_of_most_others() {
        let folder = tempfile::tempdir().unwrap();
        let (large, small) = (Size::new(8, 6), Size::new(4, 3));
        for (name, size) in [("a.png", large), ("b.png", small), ("d.png", large)] {
            image::save_png_rgb(&folder.path().join(name), &Grid::filled(size, [9; 3])).unwrap();
        }
        crate::atomic::write(&folder.path().join("c.png"), |_| Ok(())).unwrap();
        let stored = stored_sizes(folder.path(), &["a.png", "b.png", "c.png", "d.png"]).unwrap();
        assert_eq!(stored, [large, small, large, large]);
        let stated = [None, Some(small), None];
        assert_eq!(sizes(folder.path(), &["c.png", "a.png", "gone.png"], &stated).unwrap(), [small; 3]);
        let error = stored_sizes(folder.path(), &["c.png"]).unwrap_err();
        assert!(error.to_string().contains("c.png"), "{error}");
    }
}
