//! The output folder: MVSNet-like, `cams/NAME_cam.txt`, `depths/NAME.pfm`, `confidence/NAME.pfm`,
//! `images/NAME.png`, `pair.txt`, `fused.ply`; where depth maps were refined, `normals/NAME.pfm` and
//! `sigma/NAME.pfm` too.
//!
//! NAME is the photograph's name without its extension, `__` for each `/` between folders. Cameras and
//! photographs are undistorted and of the depth map's size, so the folder is itself a scene that this
//! and other programs read.

mod claim;
mod files;
mod record;

use std::collections::{BTreeMap, HashMap, HashSet};
use std::path::{Path, PathBuf};

use vamvs_core::{DepthMap, DepthRange, Grid, Rgb, Size, Source, View};
use vamvs_io::{IoError, image, mvsnet, pfm, visibility};

use crate::VamvsError;

use claim::release;
pub(crate) use claim::{Lock, claim, is_claimed};
pub use files::{folder_of, is_same, write_json};
pub(crate) use files::{make_folder, read_json, remove, remove_unfinished};
pub use record::{ConfidenceKind, LeftOut, PhotographRecord, Record};

/// The folders that every folder of depth maps has.
const FOLDERS: [&str; 4] = ["cams", "images", "depths", "confidence"];

/// A folder of depth maps.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OutputFolder {
    root: PathBuf,
}

/// The contents of a depth map's files.
#[derive(Clone, Debug)]
pub struct SavedMap<'a> {
    /// The depth map.
    pub map: &'a DepthMap,
    /// The range in which depth was searched.
    pub range: DepthRange,
    /// The photograph at the depth map's size.
    pub colour: &'a Grid<Rgb>,
    /// Unit normals in the world's frame, 0 where there is no depth, if there are any.
    pub normals: Option<&'a Grid<[f32; 3]>>,
    /// Standard deviations of the depths, scene units, 0 where there is no depth, if there are any.
    pub sigma: Option<&'a Grid<f32>>,
}

/// A depth map as it was saved.
#[derive(Clone, Debug)]
pub struct LoadedMap {
    /// The depth map.
    pub map: DepthMap,
    /// Unit normals in the world's frame, 0 where there is no depth; `None` if there are none.
    pub normals: Option<Grid<[f32; 3]>>,
}

impl OutputFolder {
    /// The folder `root`, which need not exist yet.
    #[must_use]
    pub fn new(root: &Path) -> Self {
        Self { root: root.to_owned() }
    }

    /// The folder itself.
    #[must_use]
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// `photometric/`: first-pass depth maps, removed when the geometric pass of all views is done.
    #[must_use]
    pub fn photometric(&self) -> Self {
        Self { root: self.root.join("photometric") }
    }

    /// `cams/`.
    #[must_use]
    pub fn cams(&self) -> PathBuf {
        self.root.join("cams")
    }

    /// `images/`.
    #[must_use]
    pub fn images(&self) -> PathBuf {
        self.root.join("images")
    }

    /// `depths/NAME.pfm`.
    #[must_use]
    pub fn depth(&self, name: &str) -> PathBuf {
        self.file("depths", name, ".pfm")
    }

    /// `confidence/NAME.pfm`: of the final depth.
    #[must_use]
    pub fn confidence(&self, name: &str) -> PathBuf {
        self.file("confidence", name, ".pfm")
    }

    /// `confidence/NAME.coarse.pfm`: of the coarse stage.
    #[must_use]
    pub fn coarse_confidence(&self, name: &str) -> PathBuf {
        self.file("confidence", name, ".coarse.pfm")
    }

    /// `sigma/NAME.pfm`: standard deviations of the depths, scene units, 0 where there is no depth.
    #[must_use]
    pub fn sigma(&self, name: &str) -> PathBuf {
        self.file("sigma", name, ".pfm")
    }

    /// `normals/NAME.pfm`: unit normals in the world, towards the camera, zero where there is no depth.
    #[must_use]
    pub fn normals(&self, name: &str) -> PathBuf {
        self.file("normals", name, ".pfm")
    }

    /// `visibility/NAME.png`: the visibility of the view's pixels in its source views, as the network predicts it; in the
    /// format of [`vamvs_io::visibility::write_predicted`], in the order of [`Record::sources`].
    #[must_use]
    pub fn visibility(&self, name: &str) -> PathBuf {
        self.file("visibility", name, ".png")
    }

    /// `pair.txt`.
    #[must_use]
    pub fn pairs(&self) -> PathBuf {
        self.root.join("pair.txt")
    }

    /// `left-out.json`: the scene's views that have no depth map.
    fn left_out_file(&self) -> PathBuf {
        self.root.join("left-out.json")
    }

    fn cam(&self, name: &str) -> PathBuf {
        self.file("cams", name, "_cam.txt")
    }

    fn image(&self, name: &str) -> PathBuf {
        self.file("images", name, ".png")
    }

    fn record(&self, name: &str) -> PathBuf {
        self.file("depths", name, ".json")
    }

    fn file(&self, folder: &str, name: &str, end: &str) -> PathBuf {
        self.root.join(folder).join(format!("{name}{end}"))
    }

    /// Refuses to be the folder of the scene, whose photographs and cameras would be overwritten.
    ///
    /// # Errors
    /// If a folder of the scene is also a folder of this output.
    pub fn expect_apart<'a>(&self, scene: impl IntoIterator<Item = &'a Path>) -> Result<(), VamvsError> {
        let own: Vec<_> =
            [self.cams(), self.images()].iter().filter_map(|own| own.canonicalize().ok()).collect();
        let taken = |folder: &&Path| folder.canonicalize().is_ok_and(|folder| own.contains(&folder));
        match scene.into_iter().find(taken) {
            None => Ok(()),
            Some(folder) => Err(VamvsError::Folder {
                path: folder.to_owned(),
                problem: "belongs to the scene and would be overwritten: choose another --out".to_owned(),
            }),
        }
    }

    /// Makes the folders for depth maps of views of these names.
    ///
    /// # Errors
    /// If a folder cannot be made, or the folder holds depth maps of other views, or files that vamvs has not written and
    /// would overwrite.
    pub fn prepare(&self, names: &[&str]) -> Result<(), VamvsError> {
        self.prepare_alone(names, names).map(drop)
    }

    /// As [`OutputFolder::prepare`], but depth maps of other names that an earlier run has made of the views called `views`
    /// are removed. While the lock is held, no other process may write to the folder.
    pub(crate) fn prepare_alone(&self, names: &[&str], views: &[&str]) -> Result<Lock, VamvsError> {
        let stale = self.stale(names, views)?;
        self.make_folders(names)?;
        let lock = Lock::alone(&self.root)?;
        stale.iter().try_for_each(|name| self.discard(name))?;
        let folders = FOLDERS.iter().chain(&["normals", "sigma", "visibility", "."]);
        folders.into_iter().try_for_each(|folder| remove_unfinished(&self.root.join(folder)))?;
        Ok(lock)
    }

    /// Makes the folders for depth maps of these names, unless files are there that vamvs has not written.
    pub(crate) fn make_folders(&self, names: &[&str]) -> Result<(), VamvsError> {
        let targets = || {
            let of_maps =
                names.iter().flat_map(|name| self.map_files(name).into_iter().chain([self.visibility(name)]));
            let whole = ["fused.ply", "report.html", "run.toml"].map(|name| self.root.join(name));
            of_maps.chain([self.pairs(), self.left_out_file(), self.fusion()]).chain(whole)
        };
        let known = self.is_own();
        claim(&self.root, (!known).then(targets).into_iter().flatten())?;
        Ok(FOLDERS.iter().try_for_each(|folder| make_folder(&self.root.join(folder)))?)
    }

    /// Writes `pair.txt` once all views of these names are there: for each its source views, indices
    /// into `names`. Until then the folder has none, and `vamvs fuse` chooses from the cameras.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn write_pairs(&self, names: &[&str], sources: &[Vec<Source>]) -> Result<(), VamvsError> {
        let sorted: BTreeMap<String, usize> =
            (0..names.len()).map(|view| (names[view].to_owned(), view)).collect();
        let mut ids = vec![0; names.len()];
        for (&view, id) in sorted.values().zip(mvsnet::view_ids(sorted.keys())) {
            ids[view] = id;
        }
        Ok(mvsnet::write_pairs(&self.pairs(), &ids, sources)?)
    }

    /// Removes `pair.txt` and `left-out.json`, which a run may change.
    ///
    /// # Errors
    /// If one cannot be removed.
    pub fn forget_views(&self) -> Result<(), VamvsError> {
        [self.pairs(), self.left_out_file()].iter().try_for_each(|file| remove(file))
    }

    /// `fusion.json`: what the last fusion did.
    #[must_use]
    pub fn fusion(&self) -> PathBuf {
        self.root.join("fusion.json")
    }

    /// Writes which views have no depth map, and why; no file if all have one.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn write_left_out(&self, views: &[LeftOut]) -> Result<(), VamvsError> {
        let file = self.left_out_file();
        if views.is_empty() { remove(&file) } else { write_json(&file, &views) }
    }

    /// The views that have no depth map, and why, as the last run wrote it.
    ///
    /// # Errors
    /// If the file cannot be read or is malformed.
    pub fn left_out(&self) -> Result<Vec<LeftOut>, VamvsError> {
        let file = self.left_out_file();
        if file.is_file() { read_json(&file) } else { Ok(Vec::new()) }
    }

    /// The depth maps that are there but not among `names`. Refuses those of views other than `views`, which would be fused
    /// with these.
    fn stale(&self, names: &[&str], views: &[&str]) -> Result<Vec<String>, VamvsError> {
        let (names, views): (HashSet<_>, HashSet<_>) = (names.iter().collect(), views.iter().collect());
        let Ok(entries) = std::fs::read_dir(self.cams()) else { return Ok(Vec::new()) };
        let files = entries.flatten().map(|entry| entry.file_name().to_string_lossy().into_owned());
        let maps = files.filter_map(|file| Some(file.strip_suffix("_cam.txt")?.to_owned()));
        let stale: Vec<String> = maps.filter(|map| !names.contains(&map.as_str())).collect();
        // Coarser maps of a view are called NAME@SCALE.
        let view = |map: &str| map.rsplit_once('@').map_or(map, |(view, _)| view).to_owned();
        let is_known = |map: &String| views.contains(&map.as_str()) || views.contains(&view(map).as_str());
        let is_own = self.is_own();
        match stale.iter().find(|map| !is_own || !is_known(map)) {
            None => Ok(stale),
            Some(map) => Err(VamvsError::Folder {
                path: self.cams(),
                problem: format!(
                    "{map}_cam.txt is of a view that is not part of this run: choose another --out, or remove the old folder"
                ),
            }),
        }
    }

    /// Saves a depth map with its files. The camera, by which readers find the view, is written
    /// after the maps, and the record last, so a depth map with a record is complete. `fusion.json`
    /// is removed, because it describes a fusion of other depth maps.
    ///
    /// # Errors
    /// If a file cannot be written.
    pub fn save(&self, name: &str, saved: &SavedMap, record: &Record) -> Result<(), VamvsError> {
        remove(&self.fusion())?;
        self.discard_map(name)?;
        let map = saved.map;
        image::save_png_rgb(&self.image(name), saved.colour)?;
        pfm::write(&self.confidence(name), &map.confidence)?;
        if let Some(coarse) = &map.coarse_confidence {
            pfm::write(&self.coarse_confidence(name), coarse)?;
        }
        if let Some(normals) = saved.normals {
            make_folder(&self.root.join("normals"))?;
            pfm::write_rgb(&self.normals(name), normals)?;
        }
        if let Some(sigma) = saved.sigma {
            make_folder(&self.root.join("sigma"))?;
            pfm::write(&self.sigma(name), sigma)?;
        }
        pfm::write(&self.depth(name), &map.depth)?;
        mvsnet::write_cam(&self.cam(name), &map.camera, &map.cam_from_world, Some(saved.range))?;
        write_json(&self.record(name), record)
    }

    /// Saves the predicted visibility of a view's pixels in its source views; `None` removes what is there.
    ///
    /// # Errors
    /// If the file cannot be written or removed.
    pub fn save_visibility(&self, name: &str, tiles: Option<&[Grid<f32>]>) -> Result<(), VamvsError> {
        let Some(tiles) = tiles else { return remove(&self.visibility(name)) };
        make_folder(&self.root.join("visibility"))?;
        Ok(visibility::write_predicted(&self.visibility(name), tiles)?)
    }

    /// Removes the files of a view's depth map, and its predicted visibility.
    ///
    /// # Errors
    /// If a file cannot be removed.
    pub fn discard(&self, name: &str) -> Result<(), VamvsError> {
        remove(&self.visibility(name))?;
        self.discard_map(name)
    }

    fn discard_map(&self, name: &str) -> Result<(), VamvsError> {
        self.map_files(name).iter().try_for_each(|file| remove(file))
    }

    /// The files of a depth map, the record first, with those in other formats.
    fn map_files(&self, name: &str) -> [PathBuf; 11] {
        let exported = |extension: &str| self.file("depths", name, extension);
        [
            self.record(name),
            self.cam(name),
            self.depth(name),
            self.confidence(name),
            self.image(name),
            self.coarse_confidence(name),
            self.normals(name),
            self.sigma(name),
            exported(".png"),
            exported(".exr"),
            exported(".npy"),
        ]
    }

    /// Whether vamvs has made the folder. Earlier versions did not mark it, but left records in it.
    pub(crate) fn is_own(&self) -> bool {
        let is_record = |entry: std::fs::DirEntry| {
            let path = entry.path();
            path.extension().is_some_and(|end| end == "json") && read_json::<Record>(&path).is_ok()
        };
        let has_records =
            || self.root.join("depths").read_dir().is_ok_and(|all| all.flatten().any(is_record));
        is_claimed(&self.root) || has_records()
    }

    /// Removes the depth maps of these names, and the folders that are empty then.
    ///
    /// # Errors
    /// If a file cannot be removed.
    pub fn remove(&self, names: &[&str]) -> Result<(), VamvsError> {
        names.iter().try_for_each(|name| self.discard(name))?;
        let folders = ["cams", "images", "depths", "confidence", "normals", "sigma", "visibility"]
            .map(|name| self.root.join(name));
        // A folder that holds something else stays.
        folders.iter().for_each(|folder| drop(std::fs::remove_dir(folder)));
        release(&self.root);
        Ok(())
    }

    /// The record of a view's depth map, if there is a complete one.
    #[must_use]
    pub fn saved(&self, name: &str) -> Option<Record> {
        let files = [self.depth(name), self.confidence(name), self.cam(name), self.image(name)];
        if !files.iter().all(|file| file.is_file()) {
            return None;
        }
        read_json(&self.record(name)).ok()
    }

    /// A view's depth map as it was saved, without the confidence of the coarse stage.
    ///
    /// # Errors
    /// If a file cannot be read.
    pub fn load(&self, name: &str) -> Result<LoadedMap, VamvsError> {
        let normals = self.normals(name);
        let normals = normals.is_file().then(|| pfm::read_rgb(&normals)).transpose()?;
        Ok(LoadedMap { normals, ..self.load_without_normals(name)? })
    }

    /// As [`OutputFolder::load`], without the normals.
    ///
    /// # Errors
    /// If a file cannot be read.
    pub fn load_without_normals(&self, name: &str) -> Result<LoadedMap, VamvsError> {
        let depth = pfm::read_depth(&self.depth(name))?;
        let camera = mvsnet::read_cam(&self.cam(name), &mvsnet::Options::default())?;
        let map = DepthMap {
            camera: vamvs_core::Pinhole { size: depth.size(), intrinsics: camera.intrinsics },
            cam_from_world: camera.cam_from_world,
            depth,
            confidence: pfm::read(&self.confidence(name))?,
            coarse_confidence: None,
        };
        Ok(LoadedMap { map, normals: None })
    }

    /// Whether all files of a view's depth map can be read and have the same size.
    #[must_use]
    pub fn is_readable(&self, name: &str) -> bool {
        let sizes = || -> Result<Vec<Size>, IoError> {
            mvsnet::read_cam(&self.cam(name), &mvsnet::Options::default())?;
            let optional =
                [(self.coarse_confidence(name), 1), (self.normals(name), 3), (self.sigma(name), 1)];
            let maps = [(self.depth(name), 1), (self.confidence(name), 1)];
            let maps = maps.into_iter().chain(optional.into_iter().filter(|(path, _)| path.is_file()));
            let sizes = maps.map(|(path, channels)| pfm::stored_size(&path, channels));
            sizes.chain([Ok(image::load_rgb(&self.image(name))?.size())]).collect()
        };
        sizes().is_ok_and(|sizes| sizes.iter().all(|size| *size == sizes[0]))
    }

    /// `fused.ply`.
    #[must_use]
    pub fn cloud(&self) -> PathBuf {
        self.root.join("fused.ply")
    }
}

/// The views' names in the output folder: the photographs' names without extension; with it if two
/// names are the same otherwise, or if the name ends in `.coarse`, as files of coarse confidence do; with the view's number
/// if they are still the same.
#[must_use]
pub fn names(views: &[View]) -> Vec<String> {
    let flat = |view: &View| view.name.replace('/', "__");
    let stem = |view: &View| {
        let name = flat(view);
        name.rsplit_once('.').map_or(name.clone(), |(stem, _)| stem.to_owned())
    };
    let mut count = HashMap::new();
    views.iter().for_each(|view| *count.entry(stem(view)).or_insert(0) += 1);
    let stem_or_name = |view: &View| {
        let stem = stem(view);
        if count[&stem] == 1 && !stem.ends_with(".coarse") { stem } else { flat(view) }
    };
    let mut names: Vec<String> = views.iter().map(stem_or_name).collect();
    let mut taken = HashSet::new();
    for (number, name) in names.iter_mut().enumerate() {
        while !taken.insert(name.clone()) {
            name.push_str(&format!("_{number}"));
        }
    }
    names
}

#[cfg(test)]
mod tests {
    use super::*;
    use vamvs_core::{Grid, Intrinsics, Pinhole, Pose, Rgb};

    fn save(folder: &OutputFolder, name: &str) {
        let size = Size::new(2, 1);
        let intrinsics = Intrinsics { fx: 2.0, fy: 2.0, cx: 1.0, cy: 0.5 };
        let map = DepthMap {
            camera: Pinhole { size, intrinsics },
            cam_from_world: Pose::identity(),
            depth: Grid::filled(size, 1.0),
            confidence: Grid::filled(size, 1.0),
            coarse_confidence: None,
        };
        let colour = Grid::filled(size, Rgb::default());
        let range = DepthRange { near: 0.5, far: 2.0 };
        let saved = SavedMap { map: &map, range, colour: &colour, normals: None, sigma: None };
        folder.save(name, &saved, &Record::default()).unwrap();
    }

    #[test]
    fn depth_maps_that_are_not_planned_any_more_go_and_those_of_other_scenes_are_refused() {
        let guard = tempfile::tempdir().unwrap();
        let folder = OutputFolder::new(guard.path());
        let there = || ["a", "b", "b@4"].map(|name| folder.saved(name).is_some());
        folder.prepare(&["a", "b", "b@4"]).unwrap();
        ["a", "b", "b@4"].iter().for_each(|name| save(&folder, name));
        drop(folder.prepare_alone(&["a", "b"], &["a", "b"]).unwrap());
        assert_eq!(there(), [true, true, false]);
        assert!(folder.prepare_alone(&["a"], &["a"]).is_err());
        assert_eq!(there(), [true, true, false]);
        drop(folder.prepare_alone(&["a"], &["a", "b"]).unwrap());
        assert_eq!(there(), [true, false, false]);
    }
}
