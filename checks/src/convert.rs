//! Converts public data sets to MVSNet's layout: `images/NAME.EXT` and `cams/NAME_cam.txt`.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use nalgebra::{Matrix3, Vector3};
use vamvs_core::{Intrinsics, Pinhole, Pose, Source};
use vamvs_io::{image, mvsnet};

/// A scene in MVSNet's layout.
pub struct Layout {
    /// Folder of photographs.
    pub images: PathBuf,
    /// Folder of cameras.
    pub cams: PathBuf,
}

impl Layout {
    /// Makes an empty scene in the folder `root`. Existing folders `images` and `cams` there are removed.
    pub fn create(root: &Path) -> Result<Self> {
        let layout = Self { images: root.join("images"), cams: root.join("cams") };
        for folder in [&layout.images, &layout.cams] {
            if folder.exists() {
                fs::remove_dir_all(folder)
                    .with_context(|| format!("{} could not be removed", folder.display()))?;
            }
            fs::create_dir_all(folder).with_context(|| format!("{} could not be made", folder.display()))?;
        }
        Ok(layout)
    }

    /// Adds a view and copies its photograph, as `name` with the photograph's extension. `k` is in pixels.
    pub fn add(&self, name: &str, photograph: &Path, k: &Matrix3<f64>, cam_from_world: &Pose) -> Result<()> {
        let extension = photograph.extension().unwrap_or_default().to_string_lossy();
        let copy = self.images.join(format!("{name}.{extension}"));
        fs::copy(photograph, &copy).with_context(|| format!("{} cannot be copied", photograph.display()))?;
        let camera = Pinhole {
            size: image::stored_size(photograph)?,
            intrinsics: Intrinsics::try_from_matrix(k).context("intrinsics")?,
        };
        Ok(mvsnet::write_cam(&self.cams.join(format!("{name}_cam.txt")), &camera, cam_from_world, None)?)
    }
}

/// Converts the first `most` views of a scene of the Middlebury multi-view benchmark. Its `NAME_par.txt` has a line for
/// each photograph: file name, K, R and t (`cam_from_world`), matrices row by row.
pub fn middlebury(from: &Path, to: &Path, most: usize) -> Result<Layout> {
    let file = find(from, "_par.txt")?;
    let text = fs::read_to_string(&file).with_context(|| format!("{} cannot be read", file.display()))?;
    let layout = Layout::create(to)?;
    for line in text.lines().skip(1).filter(|line| !line.trim().is_empty()).take(most) {
        let (photograph, rest) = line.split_once(' ').context("expected a name and 21 numbers in a line")?;
        let values = parse::<21>(rest).with_context(|| format!("{}: {photograph}", file.display()))?;
        let pose =
            Pose::try_new(Matrix3::from_row_slice(&values[9..18]), Vector3::from_row_slice(&values[18..]));
        let pose = pose.with_context(|| format!("{}: {photograph}", file.display()))?;
        let stem = Path::new(photograph).file_stem().unwrap_or_default().to_string_lossy();
        layout.add(&stem, &from.join(photograph), &Matrix3::from_row_slice(&values[..9]), &pose)?;
    }
    Ok(layout)
}

fn find(folder: &Path, suffix: &str) -> Result<PathBuf> {
    let entries = fs::read_dir(folder).with_context(|| format!("{} cannot be read", folder.display()))?;
    let mut paths = entries.flatten().map(|entry| entry.path());
    let found = paths.find(|path| path.to_string_lossy().ends_with(suffix));
    found.with_context(|| format!("{} has no file *{suffix}", folder.display()))
}

/// Copies the first `most` views of a scene in MVSNet's layout, and the part of `pair.txt` that is about them.
pub fn first_views(from: &Path, to: &Path, most: usize) -> Result<Layout> {
    let (cams, images) = (from.join("cams"), from.join("images"));
    let scene = mvsnet::read_scene(&cams, &images, None, &mvsnet::Options::default())?.scene;
    let layout = Layout::create(to)?;
    let count = most.min(scene.views.len());
    for view in &scene.views[..count] {
        let stem = Path::new(&view.name).file_stem().unwrap_or_default().to_string_lossy();
        let copies = [
            (images.join(&view.name), layout.images.join(&view.name)),
            (cams.join(format!("{stem}_cam.txt")), layout.cams.join(format!("{stem}_cam.txt"))),
        ];
        for (original, copy) in copies {
            fs::copy(&original, &copy).with_context(|| format!("{} cannot be copied", original.display()))?;
        }
    }
    if let Some(pairs) = &scene.pairs {
        let ids: Vec<_> = scene.views[..count].iter().map(|view| view.id).collect();
        let among_first =
            |pairs: &Vec<Source>| pairs.iter().copied().filter(|source| source.view < count).collect();
        let pairs: Vec<Vec<Source>> = pairs[..count].iter().map(among_first).collect();
        mvsnet::write_pairs(&to.join("pair.txt"), &ids, &pairs)?;
    }
    Ok(layout)
}

/// Reads a file of exactly `N` numbers.
pub fn numbers<const N: usize>(path: &Path) -> Result<[f64; N]> {
    let text = fs::read_to_string(path).with_context(|| format!("{} cannot be read", path.display()))?;
    parse(&text).with_context(|| path.display().to_string())
}

fn parse<const N: usize>(text: &str) -> Result<[f64; N]> {
    let words = text.split_whitespace();
    let values = words.map(|word| word.parse().with_context(|| format!("expected a number, found {word:?}")));
    match <[f64; N]>::try_from(values.collect::<Result<Vec<f64>>>()?) {
        Ok(values) => Ok(values),
        Err(values) => bail!("expected {N} numbers, found {}", values.len()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vamvs_core::{Grid, Size};

    fn photograph(path: &Path) {
        image::save_png_rgb(path, &Grid::filled(Size::new(8, 6), [9; 3])).unwrap();
    }

    fn text(path: &Path, text: &str) {
        vamvs_io::atomic::write(path, |out| out.write_all(text.as_bytes())).unwrap();
    }

    fn only_view(layout: &Layout) -> vamvs_core::View {
        let options = mvsnet::Options::default();
        let mut views = mvsnet::read_scene(&layout.cams, &layout.images, None, &options).unwrap().scene.views;
        assert_eq!(views.len(), 1);
        views.remove(0)
    }

    #[test]
    fn middlebury_lines_are_cameras() {
        let folder = tempfile::tempdir().unwrap();
        let (from, to) = (folder.path().join("from"), folder.path().join("to"));
        fs::create_dir(&from).unwrap();
        photograph(&from.join("d1.png"));
        text(&from.join("d_par.txt"), "1\nd1.png 5 0 4 0 6 3 0 0 1 0 1 0 0 0 1 1 0 0 7 8 9\n");
        let view = only_view(&middlebury(&from, &to, 5).unwrap());
        assert_eq!(view.name, "d1.png");
        assert!((view.cam_from_world.translation - Vector3::new(7.0, 8.0, 9.0)).norm() < 1e-12);
        assert!((view.cam_from_world.forward() - Vector3::x()).norm() < 1e-12);
        text(&from.join("d_par.txt"), "1\nd1.png 5 0 4\n");
        assert!(middlebury(&from, &to, 5).is_err());
    }
}
