//! A dense workspace of COLMAP: images, model, depth and normal maps, configurations, the cloud and the views
//! of its points.
//!
//! The photometric maps hold all depths, the geometric ones the confident depths. The model's
//! points are a sample of the cloud, from which COLMAP finds which images overlap.

use std::path::{Path, PathBuf};

use vamvs_core::Pinhole;
use vamvs_fusion::Surface;
use vamvs_io::colmap::dense::{self, MapKind};
use vamvs_io::colmap::{Image, Model, Observation, Point, SeenByWriter};
use vamvs_io::openmvs::ObservedPoint;
use vamvs_io::{IoError, atomic, image};

use super::ExportedView;
use crate::output::make_folder;
use crate::{Maps, VamvsError};

/// A workspace that is being written.
pub(super) struct ColmapWorkspace {
    root: PathBuf,
    images: Vec<String>,
    seen_by: SeenByWriter,
}

impl ColmapWorkspace {
    pub fn begin(maps: &Maps, root: &Path) -> Result<Self, VamvsError> {
        for folder in
            ["images", "sparse", "stereo/depth_maps", "stereo/normal_maps", "stereo/consistency_graphs"]
        {
            make_folder(&root.join(folder))?;
        }
        let images = maps.names().iter().map(|name| format!("{name}.png")).collect();
        let seen_by = SeenByWriter::create(&root.join("fused.ply.vis"))?;
        Ok(Self { root: root.to_owned(), images, seen_by })
    }

    pub fn push(&mut self, views: &[u32]) -> Result<(), VamvsError> {
        Ok(self.seen_by.push(views)?)
    }

    pub fn write_view(&self, view: &ExportedView) -> Result<(), VamvsError> {
        let name = &self.images[view.number];
        image::save_png_rgb(&self.root.join("images").join(name), &view.loaded.colour)?;
        self.write_maps(name, MapKind::Photometric, &view.all)?;
        self.write_maps(name, MapKind::Geometric, &view.confident)
    }

    fn write_maps(&self, name: &str, kind: MapKind, surface: &Surface) -> Result<(), VamvsError> {
        dense::write_depth_map(&dense::depth_map_path(&self.root, name, kind), &surface.depth)?;
        Ok(dense::write_normal_map(&dense::normal_map_path(&self.root, name, kind), &surface.normal)?)
    }

    pub fn finish(
        self,
        maps: &Maps,
        cameras: &[Pinhole],
        points: &[ObservedPoint],
        cloud: &Path,
    ) -> Result<(), VamvsError> {
        dense::write_configurations(&self.root, &self.images)?;
        self.model(maps, cameras, points).write_binary(&self.root.join("sparse"))?;
        copy(cloud, &self.root.join("fused.ply"))?;
        Ok(self.seen_by.finish()?)
    }

    /// Image and camera ids count from 1, as in COLMAP. Images are in the order of the views,
    /// because `fused.ply.vis` refers to them by index.
    fn model(&self, maps: &Maps, cameras: &[Pinhole], points: &[ObservedPoint]) -> Model {
        let image = |(view, name): (usize, &String)| Image {
            id: view as u32 + 1,
            name: name.clone(),
            camera_id: view as u32 + 1,
            cam_from_world: *maps.pose(view),
            observations: Vec::new(),
        };
        let mut images: Vec<Image> = self.images.iter().enumerate().map(image).collect();
        let points = (1..).zip(points).map(|(id, point)| observe(id, point, cameras, &mut images)).collect();
        let cameras = (1..).zip(cameras).map(|(id, &camera)| (id, camera.into())).collect();
        Model { cameras, images, points, ..Model::default() }
    }
}

/// A point with its track; adds its projections to the images as observations.
fn observe(id: u64, (point, views): &ObservedPoint, cameras: &[Pinhole], images: &mut [Image]) -> Point {
    let x_in_world = point.x_in_world.into();
    let mut track = Vec::with_capacity(views.len());
    for &view in views {
        let (image, camera) = (&mut images[view as usize], &cameras[view as usize]);
        let pixel = camera.intrinsics.project(&image.cam_from_world.transform(&x_in_world));
        track.push((image.id, image.observations.len() as u32));
        image.observations.push(Observation { pixel, point_id: Some(id) });
    }
    Point { id, x_in_world, rgb: point.colour, error: 0.0, track }
}

fn copy(from: &Path, to: &Path) -> Result<(), VamvsError> {
    let failed = |source| IoError::System { action: "read", path: from.to_owned(), source };
    let mut file = std::fs::File::open(from).map_err(failed)?;
    Ok(atomic::write(to, |mut out| std::io::copy(&mut file, &mut out).map(drop))?)
}
