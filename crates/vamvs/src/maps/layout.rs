//! The layouts of folders of depth maps.

use std::path::{Path, PathBuf};

use vamvs_core::View;
use vamvs_io::colmap::dense::{MapKind, depth_map_path};
use vamvs_io::{Loaded, colmap, depth, mvsnet};

use super::MapFiles;
use crate::output::names;
use crate::{OutputFolder, VamvsError};

/// The folders in which other programs put depth maps.
const DEPTH_FOLDERS: [&str; 3] = ["depth_est", "depths", "depth"];

/// How other programs name the depth map of the view `*`.
const DEPTH_NAMES: [&str; 5] = ["*", "*_depth", "depth_*", "*_init", "*_depth_map"];

/// How they name its confidence map, in `confidence/` or beside the depth map.
const CONFIDENCE_NAMES: [&str; 4] = ["*", "*_confidence", "*_conf", "*_prob"];

/// A folder of depth maps, with its root.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Layout {
    /// As vamvs writes them.
    Vamvs(OutputFolder),
    /// A dense workspace of COLMAP.
    Colmap(PathBuf),
    /// As networks like MVSNet and many other programs write them.
    Other {
        /// The folder that may hold cameras, photographs and confidence maps.
        root: PathBuf,
        /// The folder of depth maps: one of [`DEPTH_FOLDERS`] in the root, or the root.
        depths: PathBuf,
        /// The cameras and photographs, where the root has none.
        given: Option<Box<Loaded>>,
    },
}

impl Layout {
    /// The layout at `path`, which is its root or its folder of depth maps. `given` has the cameras and photographs of a
    /// folder that has none.
    pub(super) fn of(path: &Path, given: Option<&Loaded>) -> Result<Self, VamvsError> {
        // Folders of other programs may hold our export `depths/` too, so it is looked for last.
        if let Some(root) = root_of(path, "stereo/depth_maps").or_else(|| root_of(path, "stereo")) {
            return Ok(Self::Colmap(root));
        }
        let (root, depths) = if let Some(found) = folder_of_depths(path) {
            found
        } else if given.is_some() && !map_files(path).is_empty() {
            (path.to_owned(), path.to_owned())
        } else {
            return Err(problem(path, NO_DEPTHS));
        };
        if root.join("cams").is_dir() {
            return Ok(if depths.ends_with("depths") {
                Self::Vamvs(OutputFolder::new(&root))
            } else {
                Self::Other { root, depths, given: None }
            });
        }
        match given {
            Some(given) => Ok(Self::Other { root, depths, given: Some(Box::new(given.clone())) }),
            None => Err(problem(
                &depths,
                "there is no folder of cameras, cams/, beside these depth maps: give the scene they were made of, as with --cams and --images, or --colmap",
            )),
        }
    }

    /// The output folder, if vamvs wrote it.
    pub(super) fn own(&self) -> Option<&OutputFolder> {
        match self {
            Self::Vamvs(folder) => Some(folder),
            Self::Colmap(_) | Self::Other { .. } => None,
        }
    }

    pub(super) fn root(&self) -> &Path {
        match self {
            Self::Vamvs(folder) => folder.root(),
            Self::Colmap(root) | Self::Other { root, .. } => root,
        }
    }

    /// The folder of depth maps.
    pub(super) fn depths(&self) -> PathBuf {
        match self {
            Self::Vamvs(folder) => folder.root().join("depths"),
            Self::Colmap(root) => root.join("stereo/depth_maps"),
            Self::Other { depths, .. } => depths.clone(),
        }
    }

    /// Cameras, photographs and, if known, which views see the same surfaces.
    pub(super) fn read_scene(&self) -> Result<Loaded, VamvsError> {
        let (root, images) = (self.root(), self.root().join("images"));
        Ok(match self {
            Self::Colmap(_) => colmap::read_scene(&root.join("sparse"), Some(&images))?,
            Self::Other { given: Some(given), .. } => Loaded::clone(given),
            Self::Vamvs(_) | Self::Other { .. } => {
                mvsnet::read_scene(&root.join("cams"), &images, None, &mvsnet::Options::default())?
            }
        })
    }

    /// The files of each view that has a depth map; `images` is the folder of photographs.
    pub(super) fn files(&self, views: &[View], images: &Path) -> Vec<Option<MapFiles>> {
        let files = |(view, name): (&View, String)| {
            let [depth, confidence, coarse_confidence] = self.maps(view, &name);
            Some(MapFiles {
                image: images.join(&view.name),
                depth: depth?,
                confidence,
                coarse_confidence,
                normals: self.own().and_then(|own| file(own.normals(&name))),
                sigma: self.own().and_then(|own| file(own.sigma(&name))),
            })
        };
        views.iter().zip(names(views)).map(files).collect()
    }

    /// A view's maps of depth, confidence and coarse confidence, those that there are.
    fn maps(&self, view: &View, name: &str) -> [Option<PathBuf>; 3] {
        match self {
            Self::Vamvs(folder) => {
                [folder.depth(name), folder.confidence(name), folder.coarse_confidence(name)].map(file)
            }
            Self::Colmap(root) => {
                let kinds = [MapKind::Geometric, MapKind::Photometric];
                let [geometric, photometric] = kinds.map(|kind| depth_map_path(root, &view.name, kind));
                [file(geometric).or_else(|| file(photometric)), None, None]
            }
            Self::Other { root, depths, .. } => {
                let names = [name, &view.name];
                let depth = find(std::slice::from_ref(depths), &DEPTH_NAMES, names);
                let beside = |path: &PathBuf| depth.as_ref() != Some(path);
                let folders = [root.join("confidence"), depths.clone()];
                let confidence = find(&folders, &CONFIDENCE_NAMES, names).filter(beside);
                [depth, confidence, None]
            }
        }
    }

    /// What was sought for a view and what is there, for a message that there is nothing.
    pub(super) fn sought(&self, view: &View) -> String {
        let name = names(std::slice::from_ref(view)).pop().unwrap_or_default();
        match self {
            Self::Vamvs(folder) => format!("expected {}", folder.depth(&name).display()),
            Self::Colmap(root) => {
                format!("expected {}", depth_map_path(root, &view.name, MapKind::Geometric).display())
            }
            Self::Other { depths, .. } => {
                let expected = DEPTH_NAMES.map(|pattern| pattern.replace('*', &name)).join(", ");
                let mut there: Vec<String> = map_files(depths)
                    .iter()
                    .filter_map(|path| Some(path.file_name()?.to_string_lossy().into_owned()))
                    .collect();
                there.sort();
                let more = if there.len() > 3 { ", \u{2026}" } else { "" };
                there.truncate(3);
                let found = if there.is_empty() { "none".to_owned() } else { there.join(", ") };
                let formats = depth::EXTENSIONS.join(", .");
                format!("expected for {} one of {expected} with .{formats}, found {found}{more}", view.name)
            }
        }
    }
}

const NO_DEPTHS: &str = "expected a folder with depth maps: `depths/` and `cams/` as `vamvs depth` writes them, COLMAP's `stereo/depth_maps/`, or `depth_est/`, `depths/` or `depth/` of another program with `cams/`; or depth maps whose cameras are given, as with --cams and --images, or --colmap";

fn problem(path: &Path, problem: &str) -> VamvsError {
    VamvsError::Folder { path: path.to_owned(), problem: problem.to_owned() }
}

fn file(path: PathBuf) -> Option<PathBuf> {
    path.is_file().then_some(path)
}

/// The first file in the folders with one of these names, where `*` is one of the view's, and an extension of depth maps.
fn find(folders: &[PathBuf], patterns: &[&str], views: [&str; 2]) -> Option<PathBuf> {
    for folder in folders {
        for (pattern, view) in patterns.iter().flat_map(|pattern| views.map(|view| (pattern, view))) {
            let name = pattern.replace('*', view);
            let named = |extension: &&str| folder.join(format!("{name}.{extension}"));
            if let Some(found) = depth::EXTENSIONS.iter().map(named).find(|path| path.is_file()) {
                return Some(found);
            }
        }
    }
    None
}

/// The files of a folder that may be depth maps; none if it cannot be read.
pub(crate) fn map_files(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let is_map = |path: &PathBuf| {
        let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        depth::EXTENSIONS.contains(&extension.as_str())
    };
    entries.map(|entry| entry.path()).filter(is_map).collect()
}

/// The root and the folder of depth maps, if `path` is one of the two.
fn folder_of_depths(path: &Path) -> Option<(PathBuf, PathBuf)> {
    DEPTH_FOLDERS
        .iter()
        .find_map(|folder| root_of(path, folder).map(|root| (root.clone(), root.join(folder))))
}

/// The folder that has the subfolder `depths`, if `path` is one of the two.
fn root_of(path: &Path, depths: &str) -> Option<PathBuf> {
    if path.join(depths).is_dir() {
        return Some(path.to_owned());
    }
    let absolute = std::path::absolute(path).ok().filter(|path| path.is_dir() && path.ends_with(depths))?;
    let levels = Path::new(depths).components().count();
    absolute.ancestors().nth(levels).map(Path::to_owned)
}
