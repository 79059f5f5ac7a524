//! A scene of OpenMVS: `scene.mvs`, undistorted images, `depthNNNN.dmap`, and `scene_dense.ply`
//! with the views of its points, which `ReconstructMesh` needs.
//!
//! OpenMVS keeps points as `float`. Far from the origin, as in UTM coordinates, these are steps of half a metre. A scene there is moved
//! to an origin of its own, which `origin.txt` tells.

use std::path::{Path, PathBuf};

use nalgebra::Vector3;
use vamvs_core::{CloudPoint, Pinhole, Pose};
use vamvs_io::openmvs::{DepthMapFile, ObservedPoint, write_depth_map, write_scene};
use vamvs_io::ply::Coordinates;
use vamvs_io::ply::PlyWriter;
use vamvs_io::{atomic, image};

use super::ExportedView;
use crate::output::{make_folder, remove};
use crate::{Maps, VamvsError};

/// Largest number of views that a .dmap file can list, its own included.
const MOST_VIEWS: usize = 255;

/// A scene that is being written.
pub(super) struct OpenmvsScene {
    root: PathBuf,
    images: Vec<String>,
    dense: PlyWriter,
    /// Where the origin of the scene lies in the world.
    origin: Vector3<f64>,
}

/// The file that tells the origin, if it is not that of the world.
const ORIGIN: &str = "origin.txt";

impl OpenmvsScene {
    pub fn begin(maps: &Maps, root: &Path) -> Result<Self, VamvsError> {
        make_folder(&root.join("images"))?;
        let images = maps.names().iter().map(|name| format!("images/{name}.png")).collect();
        let dense = PlyWriter::create_with_views(&root.join("scene_dense.ply"), Coordinates::Float)?;
        let scene = Self { root: root.to_owned(), images, dense, origin: origin(maps) };
        scene.write_origin()?;
        Ok(scene)
    }

    /// Tells the origin in a file; where it is that of the world, an older file goes.
    fn write_origin(&self) -> Result<(), VamvsError> {
        let file = self.root.join(ORIGIN);
        if self.is_at_origin() {
            return remove(&file);
        }
        let [x, y, z]: [f64; 3] = self.origin.into();
        Ok(atomic::write(&file, |out| writeln!(out, "{x} {y} {z}"))?)
    }

    fn is_at_origin(&self) -> bool {
        self.origin == Vector3::zeros()
    }

    /// What users should know about coordinates.
    pub fn note(&self) -> Option<String> {
        let [x, y, z]: [f64; 3] = self.origin.into();
        (!self.is_at_origin()).then(|| {
            format!(
                "{}: the scene is moved by {} {} {}, as OpenMVS keeps coordinates as floats; add {x} {y} {z} ({ORIGIN}) to what it makes",
                self.root.display(),
                -x,
                -y,
                -z
            )
        })
    }

    /// The pose of a view in the moved scene.
    fn moved(&self, cam_from_world: &Pose) -> Pose {
        let translation = cam_from_world.translation + cam_from_world.rotation * self.origin;
        Pose { translation, ..*cam_from_world }
    }

    fn moved_point(&self, point: &CloudPoint) -> CloudPoint {
        CloudPoint { x_in_world: (Vector3::from(point.x_in_world) - self.origin).into(), ..*point }
    }

    pub fn push(&mut self, point: &CloudPoint, views: &[u32]) -> Result<(), VamvsError> {
        let point = self.moved_point(point);
        Ok(self.dense.push_seen(&point, views)?)
    }

    pub fn write_view(&self, view: &ExportedView, neighbours: &[usize]) -> Result<(), VamvsError> {
        let name = &self.images[view.number];
        image::save_png_rgb(&self.root.join(name), &view.loaded.colour)?;
        let mut map = view.loaded.map.clone();
        map.depth = view.confident.depth.clone();
        map.cam_from_world = self.moved(&map.cam_from_world);
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
        let view =
            |(view, name): (usize, &String)| (name.clone(), cameras[view], self.moved(maps.pose(view)));
        let views: Vec<_> = self.images.iter().enumerate().map(view).collect();
        let points: Vec<ObservedPoint> =
            points.iter().map(|(point, views)| (self.moved_point(point), views.clone())).collect();
        write_scene(&self.root.join("scene.mvs"), &views, &points)?;
        Ok(self.dense.finish()?)
    }
}

/// The origin for a scene: that of the world, or, if floats are too coarse there, the middle of the cameras in whole units.
fn origin(maps: &Maps) -> Vector3<f64> {
    if maps.coordinates() == Coordinates::Float {
        return Vector3::zeros();
    }
    let centres = (0..maps.names().len()).map(|view| maps.pose(view).centre());
    (centres.sum::<Vector3<f64>>() / maps.names().len() as f64).map(f64::round)
}
