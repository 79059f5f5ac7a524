//! The layouts of folders of depth maps.

use std::path::{Path, PathBuf};

use vamvs_core::View;
use vamvs_io::colmap::dense::{MapKind, depth_map_path};
use vamvs_io::{Loaded, colmap, mvsnet};

use super::MapFiles;
use crate::output::names;
use crate::{OutputFolder, VamvsError};

/// A folder of depth maps, with its root.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Layout {
    /// As vamvs writes them.
    Vamvs(OutputFolder),
    /// A dense workspace of COLMAP.
    Colmap(PathBuf),
    /// As networks like MVSNet write them.
    Network(PathBuf),
}

impl Layout {
    /// The layout at `path`, which is its root or its folder of depth maps.
    pub(super) fn of(path: &Path) -> Result<Self, VamvsError> {
        // Folders of other programs may hold our export `depths/` too, so it is looked for last.
        if let Some(root) = root_of(path, "stereo/depth_maps").or_else(|| root_of(path, "stereo")) {
            Ok(Self::Colmap(root))
        } else if let Some(root) = root_of(path, "depth_est") {
            Ok(Self::Network(root))
        } else if let Some(root) = root_of(path, "depths") {
            Ok(Self::Vamvs(OutputFolder::new(&root)))
        } else {
            let problem = "expected a folder with depth maps: `depths/` and `cams/` as `vamvs depth` writes them, COLMAP's `stereo/depth_maps/`, or `depth_est/` and `cams/` of a network";
            Err(VamvsError::Folder { path: path.to_owned(), problem: problem.to_owned() })
        }
    }

    /// The output folder, if vamvs wrote it.
    pub(super) fn own(&self) -> Option<&OutputFolder> {
        match self {
            Self::Vamvs(folder) => Some(folder),
            Self::Colmap(_) | Self::Network(_) => None,
        }
    }

    pub(super) fn root(&self) -> &Path {
        match self {
            Self::Vamvs(folder) => folder.root(),
            Self::Colmap(root) | Self::Network(root) => root,
        }
    }

    /// The folder of depth maps.
    pub(super) fn depths(&self) -> PathBuf {
        self.root().join(match self {
            Self::Vamvs(_) => "depths",
            Self::Colmap(_) => "stereo/depth_maps",
            Self::Network(_) => "depth_est",
        })
    }

    /// Cameras, photographs and, if known, which views see the same surfaces.
    pub(super) fn read_scene(&self) -> Result<Loaded, VamvsError> {
        let (root, images) = (self.root(), self.root().join("images"));
        Ok(match self {
            Self::Colmap(_) => colmap::read_scene(&root.join("sparse"), Some(&images))?,
            Self::Vamvs(_) | Self::Network(_) => {
                mvsnet::read_scene(&root.join("cams"), &images, None, &mvsnet::Options::default())?
            }
        })
    }

    /// The files of each view that has a depth map.
    pub(super) fn files(&self, views: &[View]) -> Vec<Option<MapFiles>> {
        let files = |(view, name): (&View, String)| {
            let image = self.root().join("images").join(&view.name);
            let (depth, confidence, coarse) = self.maps(view, &name);
            let file = |path: PathBuf| path.is_file().then_some(path);
            let coarse_confidence = coarse.and_then(file);
            Some(MapFiles {
                image,
                depth: file(depth)?,
                confidence: confidence.and_then(file),
                coarse_confidence,
                normals: self.own().and_then(|own| file(own.normals(&name))),
            })
        };
        views.iter().zip(names(views)).map(files).collect()
    }

    /// The paths of a view's depth, confidence and coarse confidence, which need not exist.
    fn maps(&self, view: &View, name: &str) -> (PathBuf, Option<PathBuf>, Option<PathBuf>) {
        match self {
            Self::Vamvs(folder) => {
                (folder.depth(name), Some(folder.confidence(name)), Some(folder.coarse_confidence(name)))
            }
            Self::Colmap(root) => {
                let kinds = [MapKind::Geometric, MapKind::Photometric];
                let [geometric, photometric] = kinds.map(|kind| depth_map_path(root, &view.name, kind));
                (if geometric.is_file() { geometric } else { photometric }, None, None)
            }
            Self::Network(root) => {
                let map = |folder: &str| root.join(folder).join(format!("{name}.pfm"));
                (map("depth_est"), Some(map("confidence")), None)
            }
        }
    }
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
