//! All triangles of a world, and their intersections with rays.

mod ray;

use nalgebra::{Point3, Vector3};
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::builder::build_cwbvh;
use obvhs::ray::{Ray as BoxRay, RayHit};

use crate::World;
use ray::{Corners, Crossing, Sheared};

/// Padding of the triangles' bounding boxes, as a share of the scene's extent, so that rounding in the box test
/// misses no triangle.
const PADDING: f32 = 4e-6;
/// Unit of the ray parameter in box tests, as a share of the scene's extent: the bounding volume hierarchy treats
/// parameters below 1e-4 as zero.
const UNIT: f32 = 1e-3;

/// All triangles of a world in a bounding volume hierarchy.
pub(crate) struct Geometry {
    bvh: CwBvh,
    /// Triangles in the order of the hierarchy's leaves.
    corners: Vec<Corners>,
    faces: Vec<Face>,
    /// The largest absolute coordinate; rounding errors are proportional to it.
    extent: f32,
}

/// A triangle of a world.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Face {
    /// Index in [`World::objects`].
    pub object: u32,
    /// Index in the object's triangles.
    pub triangle: u32,
}

/// A ray in the world; its direction has unit length.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ray {
    pub origin: Vector3<f32>,
    pub direction: Vector3<f32>,
}

/// Where a ray meets a triangle first.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Meeting {
    pub face: Face,
    /// Distance from the ray's origin.
    pub distance: f32,
    /// Barycentric weights of the triangle's corners.
    pub weights: [f32; 3],
    /// The triangle's corners in the world.
    pub corners: [Vector3<f32>; 3],
}

impl Geometry {
    pub fn new(world: &World) -> Self {
        let (corners, faces) = collect(world);
        let extent = extent(&corners);
        let boxes: Vec<Aabb> = corners.iter().map(|corners| padded_box(corners, PADDING * extent)).collect();
        let bvh = build_cwbvh(&boxes, BvhBuildParams::medium_build(), &mut std::time::Duration::default());
        let leaf_order = |index: &u32| (corners[*index as usize], faces[*index as usize]);
        let (corners, faces) = bvh.primitive_indices.iter().map(leaf_order).unzip();
        Self { bvh, corners, faces, extent }
    }

    /// The first triangle that the ray meets.
    pub fn nearest(&self, ray: &Ray) -> Option<Meeting> {
        if self.corners.is_empty() {
            return None;
        }
        let (unit, sheared) = (UNIT * self.extent, Sheared::new(ray.origin.into(), ray.direction.into()));
        let mut best = Crossing { t: f32::INFINITY, ..Crossing::default() };
        let mut best_index = None;
        self.bvh.ray_traverse(
            box_ray(ray, unit, f32::INFINITY),
            &mut RayHit::none(),
            |_, index| match sheared.meet(&self.corners[index]) {
                Some(crossing) if crossing.t > 0.0 && crossing.t < best.t => {
                    (best, best_index) = (crossing, Some(index));
                    crossing.t / unit
                }
                _ => f32::INFINITY,
            },
        );
        let index = best_index?;
        let corners = self.corners[index].map(Vector3::from);
        Some(Meeting { face: self.faces[index], distance: best.t, weights: best.weights, corners })
    }

    /// Whether the ray meets anything before `distance`.
    pub fn is_blocked(&self, ray: &Ray, distance: f32) -> bool {
        if self.corners.is_empty() {
            return false;
        }
        let (unit, sheared) = (UNIT * self.extent, Sheared::new(ray.origin.into(), ray.direction.into()));
        let in_between = |crossing: Crossing| crossing.t > 0.0 && crossing.t < distance;
        !self.bvh.ray_traverse_miss(box_ray(ray, unit, distance / unit), |_, index| {
            if sheared.meet(&self.corners[index]).is_some_and(in_between) { 0.0 } else { f32::INFINITY }
        })
    }
}

/// The parameter t at which the line `origin + t · direction` meets the plane of a face, in double precision from
/// the object's vertices. It is clamped to the range of the face's corners, for lines nearly parallel to the plane.
pub(crate) fn exact_crossing(
    world: &World,
    face: Face,
    origin: &Vector3<f64>,
    direction: &Vector3<f64>,
) -> f64 {
    let corners = exact_corners(world, face).map(|corner| corner - origin);
    let normal = (corners[1] - corners[0]).cross(&(corners[2] - corners[0]));
    let t = normal.dot(&corners[0]) / normal.dot(direction);
    let along = corners.map(|corner| corner.dot(direction) / direction.norm_squared());
    let (near, far) = (along[0].min(along[1]).min(along[2]), along[0].max(along[1]).max(along[2]));
    t.max(near).min(far)
}

/// The corners of a face in the world, in double precision.
pub(crate) fn exact_corners(world: &World, face: Face) -> [Vector3<f64>; 3] {
    let object = &world.objects[face.object as usize];
    object.mesh.triangles[face.triangle as usize].map(|vertex| {
        let in_object = Point3::from(object.mesh.positions[vertex as usize]).cast();
        object.world_from_object.transform_point(&in_object).coords
    })
}

fn collect(world: &World) -> (Vec<Corners>, Vec<Face>) {
    let faces: Vec<Face> = (0_u32..)
        .zip(&world.objects)
        .flat_map(|(object, it)| {
            (0..it.mesh.triangles.len() as u32).map(move |triangle| Face { object, triangle })
        })
        .collect();
    let corners = |face: &Face| exact_corners(world, *face).map(|corner| corner.cast::<f32>().into());
    (faces.iter().map(corners).collect(), faces)
}

fn extent(corners: &[Corners]) -> f32 {
    let largest = corners.iter().flatten().flatten().fold(0.0_f32, |largest, v| largest.max(v.abs()));
    if largest > 0.0 { largest } else { 1.0 }
}

fn padded_box(corners: &Corners, padding: f32) -> Aabb {
    let bound = |pick: fn(f32, f32) -> f32, padding: f32| -> [f32; 3] {
        std::array::from_fn(|i| pick(pick(corners[0][i], corners[1][i]), corners[2][i]) + padding)
    };
    Aabb::new(bound(f32::min, -padding).into(), bound(f32::max, padding).into())
}

/// The ray for box tests, its parameter in multiples of `unit`.
fn box_ray(ray: &Ray, unit: f32, t_max: f32) -> BoxRay {
    let direction = ray.direction * unit;
    // Where a component is 0, a finite inverse avoids NaN: its slope is too small to leave the boxes' padding.
    let inverse = direction.map(|d| if d.abs() < 1e-20 { 1e20_f32.copysign(d) } else { 1.0 / d });
    BoxRay {
        origin: <[f32; 3]>::from(ray.origin).into(),
        direction: <[f32; 3]>::from(direction).into(),
        inv_direction: <[f32; 3]>::from(inverse).into(),
        tmin: 0.0,
        tmax: t_max,
    }
}
