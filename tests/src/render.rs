//! Rendered photographs of a world, with exact depth and normals.

use rand::SeedableRng;
use rand_pcg::Pcg64;
use vamvs_core::{Grid, Photo};
use vamvs_synth::develop::develop;
use vamvs_synth::{Effects, RenderOptions, Shot, Tracer};

use crate::rig::Station;

/// A rendered photograph and its ground truth, all of one size.
#[derive(Clone, Debug)]
pub struct Rendered {
    /// The photograph with its camera and pose.
    pub photo: Photo,
    /// Depth z at the pixel centres, scene units; 0 where there is no surface.
    pub depth: Grid<f32>,
    /// Unit normal in the world frame at the pixel centres, towards the camera; the zero vector where there is no
    /// surface.
    pub normal: Grid<[f32; 3]>,
}

/// Renders one photograph for each station, all with the same exposure and without camera effects (noise, blur,
/// vignetting).
#[must_use]
pub fn render(tracer: &Tracer, stations: &[Station], options: &RenderOptions) -> Vec<Rendered> {
    let shoot = |(seed, (camera, pose)): (u64, &Station)| tracer.shoot(camera, pose, options, seed);
    let shots: Vec<Shot> = (0..).zip(stations).map(shoot).collect();
    let images = develop(&shots, &Effects::NONE, &mut Pcg64::seed_from_u64(0));
    let rendered = |((&(camera, cam_from_world), shot), image): ((&Station, Shot), Grid<_>)| Rendered {
        photo: Photo { camera, cam_from_world, image, mask: None },
        depth: shot.ground_truth.depth,
        normal: shot.ground_truth.normal,
    };
    stations.iter().zip(shots).zip(images).map(rendered).collect()
}
