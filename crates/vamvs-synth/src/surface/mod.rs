//! Shading: the surface points that rays meet, and how they reflect light.

mod coat;
mod frame;
mod pyramid;
mod reflectance;

use std::collections::HashMap;
use std::sync::Arc;

use nalgebra::{Matrix3, Vector3};
use vamvs_core::{Grid, Rgb};

use crate::geometry::{Meeting, Ray};
use crate::{Object, World};
use coat::Coat;
pub(crate) use frame::{Frame, around};
use pyramid::Pyramid;
pub(crate) use reflectance::{Reflectance, Split};

/// The distance at which rays start from their surface, as a share of the triangle's largest coordinate: a few
/// rounding errors.
const CLEARANCE: f32 = 1e-6;

/// What is needed to shade an object.
pub(crate) struct Skin {
    object: Object,
    texture: Arc<Pyramid>,
    coat: Option<Coat>,
    /// The rotation only, for normals.
    world_from_object: Matrix3<f32>,
}

/// A point of a surface, seen from one side.
pub(crate) struct Surface {
    position: Vector3<f32>,
    /// The triangle's unit normal in the world, on the viewer's side.
    pub out: Vector3<f32>,
    clearance: f32,
    frame: Frame,
    /// The local direction to the viewer.
    wo: Vector3<f32>,
    pub reflectance: Reflectance,
}

/// The skins of a world's objects. Objects with the same texture (by address) share its pyramid.
pub(crate) fn skins(world: &World) -> Vec<Skin> {
    let mut textures: HashMap<*const Grid<Rgb>, Arc<Pyramid>> = HashMap::new();
    let mut skin = |object: &Object| {
        let albedo = &object.material.albedo;
        let texture =
            textures.entry(Arc::as_ptr(albedo)).or_insert_with(|| Arc::new(Pyramid::new(albedo.clone())));
        Skin {
            object: object.clone(),
            texture: texture.clone(),
            coat: Coat::of(&object.material),
            world_from_object: object
                .world_from_object
                .isometry
                .rotation
                .to_rotation_matrix()
                .into_inner()
                .cast(),
        }
    };
    world.objects.iter().map(&mut skin).collect()
}

impl Skin {
    /// The surface point that a ray meets; `width` is the width of the ray's footprint there, metres.
    pub fn surface(&self, ray: &Ray, meeting: &Meeting, width: f32) -> Surface {
        let [a, b, c] = &meeting.corners;
        let double_area = (b - a).cross(&(c - a));
        let out = towards(-ray.direction, double_area.normalize());
        let frame = Frame::around(self.shading_normal(meeting, &ray.direction, &out));
        let density = self.texels_per_area(meeting) / double_area.norm();
        Surface {
            position: weighted(&meeting.weights, &meeting.corners),
            out,
            clearance: CLEARANCE * a.amax().max(b.amax()).max(c.amax()),
            wo: frame.local(&-ray.direction),
            frame,
            reflectance: Reflectance {
                albedo: self.albedo(meeting, width * density.sqrt()),
                coat: self.coat,
            },
        }
    }

    /// The interpolated normal, or the triangle's where the viewer would see the back of the interpolated one.
    fn shading_normal(
        &self,
        meeting: &Meeting,
        direction: &Vector3<f32>,
        out: &Vector3<f32>,
    ) -> Vector3<f32> {
        let normals = self.corners_of(meeting).map(|vertex| Vector3::from(self.object.mesh.normals[vertex]));
        let in_world = self.world_from_object * weighted(&meeting.weights, &normals);
        let normal = towards(*out, in_world.normalize());
        if normal.dot(direction) < 0.0 { normal } else { *out }
    }

    fn albedo(&self, meeting: &Meeting, texels: f32) -> Vector3<f32> {
        let uv = weighted(&meeting.weights, &self.uvs(meeting));
        let colour = self.texture.colour([uv.x, uv.y], texels);
        colour.component_mul(&Vector3::from(self.object.material.tint)).map(|share| share.clamp(0.0, 1.0))
    }

    /// Twice the area of the triangle in the texture, in pixels.
    fn texels_per_area(&self, meeting: &Meeting) -> f32 {
        let [a, b, c] = self.uvs(meeting);
        let ((ux, uy), (vx, vy)) = (((b - a).x, (b - a).y), ((c - a).x, (c - a).y));
        (ux * vy - uy * vx).abs() * self.texture.size().area() as f32
    }

    fn uvs(&self, meeting: &Meeting) -> [Vector3<f32>; 3] {
        let [tile_u, tile_v] = self.object.material.tiling;
        self.corners_of(meeting).map(|vertex| {
            let [u, v] = self.object.mesh.uvs[vertex];
            Vector3::new(u * tile_u, v * tile_v, 0.0)
        })
    }

    fn corners_of(&self, meeting: &Meeting) -> [usize; 3] {
        self.object.mesh.triangles[meeting.face.triangle as usize].map(|vertex| vertex as usize)
    }
}

impl Surface {
    /// A ray that leaves the surface; it starts slightly above it, on the viewer's side.
    pub fn leaving(&self, direction: Vector3<f32>) -> Ray {
        Ray { origin: self.position + self.out * self.clearance, direction }
    }

    /// The normal for shading.
    pub fn normal(&self) -> &Vector3<f32> {
        self.frame.normal()
    }

    /// The BRDF for light from `direction` (in the world) towards the viewer, times the cosine.
    pub fn reflected(&self, direction: &Vector3<f32>) -> Split {
        if self.out.dot(direction) <= 0.0 {
            return Split::default();
        }
        self.reflectance.reflected(&self.wo, &self.frame.local(direction))
    }

    /// Probability density of [`Self::sample`], by solid angle.
    pub fn density(&self, direction: &Vector3<f32>) -> f32 {
        self.reflectance.density(&self.wo, &self.frame.local(direction))
    }

    /// Samples a direction in the world that light towards the viewer may come from; it may point into the surface.
    pub fn sample(&self, choice: f32, uv: [f32; 2]) -> Vector3<f32> {
        self.frame.world(&self.reflectance.sample(&self.wo, choice, uv)).normalize()
    }
}

fn weighted(weights: &[f32; 3], corners: &[Vector3<f32>; 3]) -> Vector3<f32> {
    corners[0] * weights[0] + corners[1] * weights[1] + corners[2] * weights[2]
}

/// `normal` or its opposite, whichever is on the side of `side`; `side` itself if `normal` is NaN.
fn towards(side: Vector3<f32>, normal: Vector3<f32>) -> Vector3<f32> {
    let cos = normal.dot(&side);
    if cos.is_nan() {
        side
    } else if cos < 0.0 {
        -normal
    } else {
        normal
    }
}
