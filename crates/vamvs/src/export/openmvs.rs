//! A scene of OpenMVS: `scene.mvs`, undistorted images, `depthNNNN.dmap`, and `scene_dense.ply`
//! with the views of its points, which `ReconstructMesh` needs.

use std::path::{Path, PathBuf};

use vamvs_core::{CloudPoint, Pinhole};
use vamvs_io::image;
use vamvs_io::openmvs::{DepthMapFile, ObservedPoint, write_depth_map, write_scene};
use vamvs_io::ply::PlyWriter;

use super::ExportedView;
use crate::output::make_folder;
use crate::{Maps, VamvsError};

/// Largest number of views that a .dmap file can list, its own included.
const MOST_VIEWS: usize = 255;

/// A scene that is being written.
pub(super) struct OpenmvsScene {
    root: PathBuf,
    images: Vec<String>,
    dense: PlyWriter,
}

impl OpenmvsScene {
    pub fn begin(maps: &Maps, root: &Path) -> Result<Self, VamvsError> {
        make_folder(&root.join("images"))?;
        let images = maps.names().iter().map(|name| format!("images/{name}.png")).collect();
        let dense = PlyWriter::create_with_views(&root.join("scene_dense.ply"), maps.coordinates())?;
        Ok(Self { root: root.to_owned(), images, dense })
    }

    pub fn push(&mut self, point: &CloudPoint, views: &[u32]) -> Result<(), VamvsError> {
        Ok(self.dense.push_seen(point, views)?)
    }

    pub fn write_view(&self, view: &ExportedView, neighbours: &[usize]) -> Result<(), VamvsError> {
        let name = &self.images[view.number];
        image::save_png_rgb(&self.root.join(name), &view.loaded.colour)?;
        let mut map = view.loaded.map.clone();
        map.depth = view.confident.depth.clone();
        let views: Vec<u32> = std::iter::once(view.number)
            .chain(neighbours.iter().copied())
            .take(MOST_VIEWS)
            .map(|view| view as u32)
            .collect();
        let file = DepthMapFile { map: &map, normals: &view.confident.normal, image: name, views: &views };
        Ok(write_depth_map(&self.root.join(format!("depth{:04}.dmap", view.number)), &file)?)
    }

    pub fn finish(
        self,
        maps: &Maps,
        cameras: &[Pinhole],
        points: &[ObservedPoint],
    ) -> Result<(), VamvsError> {
        let view = |(view, name): (usize, &String)| (name.clone(), cameras[view], *maps.pose(view));
        let views: Vec<_> = self.images.iter().enumerate().map(view).collect();
        write_scene(&self.root.join("scene.mvs"), &views, points)?;
        Ok(self.dense.finish()?)
    }
}
