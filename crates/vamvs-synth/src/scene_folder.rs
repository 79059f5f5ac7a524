//! The files of a scene: MVSNet's layout, with the ground truth in further folders.

use std::fs;
use std::path::{Path, PathBuf};

use vamvs_core::{DepthRange, Grid, Rgb, Visibility, depth_map::is_valid};
use vamvs_io::{IoError, atomic, image, mvsnet, pfm, visibility};

use crate::{GroundTruth, Station, SynthError};

/// Factor by which a depth range extends beyond the nearest and the farthest ground-truth depth.
const MARGIN: f64 = 1.05;

/// The subfolders of a scene, each with one file per view.
const FOLDERS: [&str; 6] = ["images", "cams", "depths", "visibility", "objects", "normals"];

/// The folder of a scene.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SceneFolder {
    root: PathBuf,
}

impl SceneFolder {
    /// The folder of scene number `scene` of the set in `set`.
    #[must_use]
    pub fn of(set: &Path, scene: u64) -> Self {
        Self { root: set.join(format!("scene-{scene:05}")) }
    }

    /// The folder itself.
    #[must_use]
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// The scene's recipe (JSON). It is written last, so a scene that has it is complete.
    #[must_use]
    pub fn record(&self) -> PathBuf {
        self.root.join("scene.json")
    }

    /// The contact sheet of up to nine views (PNG).
    #[must_use]
    pub fn sheet(&self) -> PathBuf {
        self.root.join("sheet.png")
    }

    /// The source views of each view with their scores, in MVSNet's format.
    #[must_use]
    pub fn pairs(&self) -> PathBuf {
        self.root.join("pair.txt")
    }

    /// The photograph of a view (PNG).
    #[must_use]
    pub fn image(&self, view: usize) -> PathBuf {
        self.root.join(format!("images/{view:08}.png"))
    }

    /// Camera, pose and depth range of a view, in MVSNet's format.
    #[must_use]
    pub fn cam(&self, view: usize) -> PathBuf {
        self.root.join(format!("cams/{view:08}_cam.txt"))
    }

    /// The ground-truth depth z of a view (PFM), 0 without a surface.
    #[must_use]
    pub fn depth(&self, view: usize) -> PathBuf {
        self.root.join(format!("depths/{view:08}.pfm"))
    }

    /// The visibility of a view's pixels in all views (PNG).
    #[must_use]
    pub fn visibility(&self, view: usize) -> PathBuf {
        self.root.join(format!("visibility/{view:08}.png"))
    }

    /// The object ids of a view's pixels (16-bit PNG), 0 without a surface.
    #[must_use]
    pub fn objects(&self, view: usize) -> PathBuf {
        self.root.join(format!("objects/{view:08}.png"))
    }

    /// The normals of a view in the world's frame (PFM).
    #[must_use]
    pub fn normals(&self, view: usize) -> PathBuf {
        self.root.join(format!("normals/{view:08}.pfm"))
    }

    /// Makes the subfolders, empty. Files of earlier runs are removed, the record first.
    ///
    /// # Errors
    /// If there are such files but neither a record nor the mark of an interrupted run, or the system refuses.
    pub(crate) fn begin(&self, normals: bool) -> Result<(), SynthError> {
        if !(self.record().is_file() || self.mark().is_file()) {
            self.expect_empty()?;
        }
        fs::create_dir_all(&self.root).map_err(system("make", &self.root))?;
        atomic::write(&self.mark(), |out| writeln!(out, "vamvs synth is at work here, or was interrupted."))?;
        remove_file(&self.record())?;
        for folder in FOLDERS {
            remove_folder(&self.root.join(folder))?;
        }
        let wanted = FOLDERS.iter().filter(|folder| normals || **folder != "normals");
        for folder in wanted.map(|folder| self.root.join(folder)) {
            fs::create_dir_all(&folder).map_err(system("make", &folder))?;
        }
        remove_temporary(&self.root)
    }

    /// Removes the mark of an unfinished scene.
    pub(crate) fn end(&self) -> Result<(), SynthError> {
        remove_file(&self.mark())
    }

    /// The mark of a scene that is not complete.
    fn mark(&self) -> PathBuf {
        self.root.join("unfinished")
    }

    /// Refuses files that this program has not made and would remove.
    fn expect_empty(&self) -> Result<(), SynthError> {
        let folders = FOLDERS.iter().map(|folder| self.root.join(folder));
        let has_files =
            |folder: &PathBuf| folder.read_dir().is_ok_and(|mut entries| entries.next().is_some());
        let files = [self.pairs(), self.sheet()].into_iter().filter(|file| file.exists());
        match folders.filter(has_files).chain(files).next() {
            None => Ok(()),
            Some(path) => Err(SynthError::Occupied { path }),
        }
    }

    /// Writes a view's photograph and camera.
    pub(crate) fn write_photograph(
        &self,
        view: usize,
        photograph: &Grid<Rgb>,
        station: &Station,
        depth: &Grid<f32>,
    ) -> Result<(), SynthError> {
        let range = depth_range(depth);
        mvsnet::write_cam(&self.cam(view), &station.camera, &station.cam_from_world, range)?;
        Ok(image::save_png_rgb(&self.image(view), photograph)?)
    }

    /// Writes a view's ground truth: depth, object ids and, if wanted, normals.
    pub(crate) fn write_truth(
        &self,
        view: usize,
        ground_truth: &GroundTruth,
        normals: bool,
    ) -> Result<(), SynthError> {
        pfm::write(&self.depth(view), &ground_truth.depth)?;
        image::save_png_gray16(&self.objects(view), &ground_truth.id)?;
        if normals {
            pfm::write_rgb(&self.normals(view), &ground_truth.normal)?;
        }
        Ok(())
    }

    /// Writes the visibility of a view's pixels in all views.
    pub(crate) fn write_visibility(&self, view: usize, tiles: &[Grid<Visibility>]) -> Result<(), SynthError> {
        Ok(visibility::write(&self.visibility(view), tiles)?)
    }
}

/// The range of the depths, extended by [`MARGIN`]; `None` without any depth.
fn depth_range(depth: &Grid<f32>) -> Option<DepthRange> {
    let depths = || depth.data().iter().copied().filter(|&depth| is_valid(depth));
    let (near, far) = (depths().reduce(f32::min)?, depths().reduce(f32::max)?);
    DepthRange::try_new(f64::from(near) / MARGIN, f64::from(far) * MARGIN).ok()
}

/// Removes temporary files that an interrupted run left in `folder`.
fn remove_temporary(folder: &Path) -> Result<(), SynthError> {
    for entry in fs::read_dir(folder).map_err(system("list", folder))? {
        let entry = entry.map_err(system("list", folder))?;
        if entry.file_name().to_string_lossy().starts_with(atomic::PREFIX) {
            remove_file(&entry.path())?;
        }
    }
    Ok(())
}

fn remove_file(path: &Path) -> Result<(), SynthError> {
    gone(fs::remove_file(path), path)
}

fn remove_folder(path: &Path) -> Result<(), SynthError> {
    gone(fs::remove_dir_all(path), path)
}

/// Maps the result of removing `path`: a file that does not exist counts as removed.
fn gone(removed: std::io::Result<()>, path: &Path) -> Result<(), SynthError> {
    match removed {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(system("remove", path)(error)),
        _ => Ok(()),
    }
}

fn system(action: &'static str, path: &Path) -> impl FnOnce(std::io::Error) -> SynthError {
    move |source| IoError::System { action, path: path.to_owned(), source }.into()
}

#[cfg(test)]
mod tests {
    use vamvs_core::Size;

    use super::*;

    #[test]
    fn the_range_holds_all_depths_and_a_margin() {
        let depth = Grid::from_vec(Size::new(4, 1), vec![0.0, 2.0, 4.0, f32::NAN]);
        let range = depth_range(&depth).unwrap();
        assert!((range.near - 2.0 / 1.05).abs() < 1e-12 && (range.far - 4.2).abs() < 1e-12);
        assert_eq!(depth_range(&Grid::filled(Size::new(2, 2), 0.0)), None);
    }

    #[test]
    fn beginning_removes_what_was_left_and_nothing_else() {
        let set = tempfile::tempdir().unwrap();
        let folder = SceneFolder::of(set.path(), 12);
        assert!(folder.root().ends_with("scene-00012"));
        folder.begin(true).unwrap();
        let notes = folder.root().join("notes.txt");
        let left = [folder.image(7), folder.normals(0), folder.record(), folder.root().join(".vamvs-a1")];
        for path in left.iter().chain([&notes]) {
            atomic::write(path, |_| Ok(())).unwrap();
        }
        folder.begin(false).unwrap();
        folder.end().unwrap();
        atomic::write(&folder.image(0), |_| Ok(())).unwrap();
        assert!(matches!(folder.begin(false), Err(SynthError::Occupied { .. })), "not an unfinished scene");
        assert!(folder.image(0).exists());
        assert!(left.iter().all(|path| !path.exists()) && notes.exists());
        assert!(folder.root().join("images").is_dir() && !folder.root().join("normals").exists());
    }
}
