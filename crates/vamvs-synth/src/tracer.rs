//! Casts rays through a world, for photographs and for ground truth.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use vamvs_core::Grid;

use crate::World;
use crate::geometry::{Geometry, Ray, exact_corners, exact_crossing};
use crate::light::Lights;
use crate::surface::{Skin, skins};

/// A world prepared for ray tracing.
pub struct Tracer {
    world: World,
    pub(crate) geometry: Geometry,
    pub(crate) skins: Vec<Skin>,
    pub(crate) lights: Lights,
}

/// The first surface that a ray meets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance from the ray's origin, scene units.
    pub distance: f64,
    /// Index in [`World::objects`].
    pub object: usize,
    /// The triangle's unit normal in the world, facing the ray's origin.
    pub normal: Vector3<f64>,
    /// Whether the ray meets the triangle from outside, where its corners are counter-clockwise.
    pub outside: bool,
}

/// How photographs are rendered.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct RenderOptions {
    /// Light paths per pixel, at least 1.
    pub samples: usize,
    /// Largest number of surfaces on a path from a light to the camera, at least 1; 1 is direct light alone.
    pub max_bounces: usize,
    /// Whether noise is smoothed, guided by normals and positions; textures are not blurred.
    pub denoise: bool,
}

impl Default for RenderOptions {
    fn default() -> Self {
        Self { samples: 8, max_bounces: 6, denoise: true }
    }
}

/// A rendered view.
#[derive(Clone, Debug)]
pub struct Shot {
    /// Linear radiance: red, green, blue.
    pub radiance: Grid<[f32; 3]>,
    /// Ground truth at the pixels' centres.
    pub ground_truth: GroundTruth,
}

/// Ground truth of a view at its pixels' centres.
#[derive(Clone, Debug, PartialEq)]
pub struct GroundTruth {
    /// Depth z in scene units; 0 without a surface.
    pub depth: Grid<f32>,
    /// Index in [`World::objects`] plus one; 0 without a surface.
    pub id: Grid<u16>,
    /// Unit normal of the triangle in the world, facing the camera; 0 without a surface.
    pub normal: Grid<[f32; 3]>,
}

impl Tracer {
    /// Prepares a world for ray tracing.
    ///
    /// # Panics
    /// If the world has more than 65535 objects, or a triangle has the index of a vertex that does not exist.
    #[must_use]
    pub fn new(world: &World) -> Self {
        assert!(world.objects.len() <= usize::from(u16::MAX), "object ids have 16 bits");
        Self {
            world: world.clone(),
            geometry: Geometry::new(world),
            skins: skins(world),
            lights: Lights::new(world),
        }
    }

    /// The first surface that the ray from `origin` meets; `direction` may have any length except 0.
    #[must_use]
    pub fn first_hit(&self, origin: &Vector3<f64>, direction: &Vector3<f64>) -> Option<Hit> {
        let direction = direction.normalize();
        let meeting = self.geometry.nearest(&Ray { origin: origin.cast(), direction: direction.cast() })?;
        let [a, b, c] = exact_corners(&self.world, meeting.face);
        let normal = (b - a).cross(&(c - a)).normalize();
        Some(Hit {
            distance: exact_crossing(&self.world, meeting.face, origin, &direction),
            object: meeting.face.object as usize,
            normal: if normal.dot(&direction) > 0.0 { -normal } else { normal },
            outside: normal.dot(&direction) <= 0.0,
        })
    }
}
