//! What is rendered: textured shapes under a sun and a sky.

use nalgebra::{Matrix3, Rotation3, Vector3};
use vamvs_core::Pose;

use crate::shape::{Hit, Ray, Shape};
use crate::texture::{Texture, TexturePoint};

/// A textured shape at its place in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface {
    /// The shape.
    pub shape: Shape,
    /// Where it is.
    pub object_from_world: Pose,
    /// Its colour.
    pub texture: Texture,
}

/// Surfaces and light.
#[derive(Clone, Debug, PartialEq)]
pub struct World {
    /// What is seen.
    pub surfaces: Vec<Surface>,
    /// Unit direction to the sun.
    pub to_sun: Vector3<f64>,
}

/// What a ray meets first.
#[derive(Clone, Copy, Debug)]
pub struct WorldHit<'a> {
    /// The surface.
    pub surface: &'a Surface,
    /// The ray's parameter.
    pub t: f64,
    /// Unit normal in the world, towards the ray's origin.
    pub normal: Vector3<f64>,
    /// Where on the surface.
    pub at: TexturePoint,
}

/// The object's frame at `centre`, turned by `yaw` about its z axis (radians) and tilted by `tilt`
/// about the x axis before that.
#[must_use]
pub fn place(centre: [f64; 3], yaw: f64, tilt: f64) -> Pose {
    let rotation = Rotation3::from_axis_angle(&Vector3::z_axis(), yaw)
        * Rotation3::from_axis_angle(&Vector3::x_axis(), tilt);
    Pose { rotation: Matrix3::from(rotation), translation: Vector3::from(centre) }.inverse()
}

impl Surface {
    fn intersect(&self, ray: &Ray, t_min: f64) -> Option<Hit> {
        self.shape.intersect(&self.ray_in_object(ray), t_min)
    }

    fn ray_in_object(&self, ray: &Ray) -> Ray {
        Ray {
            origin: self.object_from_world.transform(&ray.origin),
            direction: self.object_from_world.rotation * ray.direction,
        }
    }

    fn world_hit(&self, ray: &Ray, hit: &Hit) -> WorldHit<'_> {
        let ray_in_object = self.ray_in_object(ray);
        let normal = self.object_from_world.rotation.transpose() * hit.normal;
        let facing = if normal.dot(&ray.direction) > 0.0 { -normal } else { normal };
        let at = TexturePoint { x_in_object: ray_in_object.at(hit.t), uv: hit.uv };
        WorldHit { surface: self, t: hit.t, normal: facing, at }
    }
}

impl World {
    /// What `ray` meets first beyond `t_min`.
    #[must_use]
    pub fn trace(&self, ray: &Ray, t_min: f64) -> Option<WorldHit<'_>> {
        let hits = self.surfaces.iter().filter_map(|s| Some((s, s.intersect(ray, t_min)?)));
        let (surface, hit) = hits.min_by(|(_, a), (_, b)| a.t.total_cmp(&b.t))?;
        Some(surface.world_hit(ray, &hit))
    }

    /// Whether anything is between `ray`'s origin and infinity.
    #[must_use]
    pub fn is_blocked(&self, ray: &Ray) -> bool {
        self.surfaces.iter().any(|surface| surface.intersect(ray, 1e-6).is_some())
    }
}
