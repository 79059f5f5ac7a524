//! Collision bodies: each mesh is approximated by convex pieces.

use std::cell::Cell;
use std::collections::BTreeSet;
use std::f64::consts::PI;
use std::panic::{self, AssertUnwindSafe};
use std::sync::Once;

use nalgebra::Vector3;
use rapier3d::math::Vector;
use rapier3d::parry::transformation::try_convex_hull;
use rapier3d::parry::transformation::vhacd::{VHACD, VHACDParameters};

use crate::Mesh;

/// A mesh that fills more than this share of its convex hull is replaced by the hull.
const NEARLY_CONVEX: f32 = 0.9;

/// Resolutions of the decomposition's voxels: the first is used, and the others in turn where it fails.
const RESOLUTIONS: [u32; 3] = [48, 44, 40];

/// Upper limit of a piece's vertices: more make collisions slower, not better.
const MOST_VERTICES: usize = 400;

/// How far points may lie outside the hull that [`extremes`] chooses for them, as a share of the diameter of
/// their bounding box.
const ALLOWED: f32 = 1e-3;

/// Number of directions in which [`extremes`] first looks for the outermost points.
const DIRECTIONS: usize = 200;

/// Half the thickness that a flat mesh is given, in the mesh's unit (metres).
const HALF_THICKNESS: f32 = 5e-4;

/// A mesh is flat if the volume of its hull, divided by its diameter cubed, is below this.
const FLAT: f32 = 1e-5;

/// A body for physics: the union of convex pieces, each the hull of its points, in the mesh's frame.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Solid {
    pub pieces: Vec<Vec<[f32; 3]>>,
}

impl Solid {
    /// The body that `meshes`, all in one frame, enclose together: their convex hull if they nearly fill
    /// it, the hull thickened if they are flat, an approximate convex decomposition (V-HACD) otherwise.
    pub fn of(meshes: &[&Mesh]) -> Self {
        let (points, triangles) = join(meshes);
        let outer = extremes(&points);
        let hull = try_convex_hull(&outer).map_or(0.0, |(points, triangles)| volume(&points, &triangles));
        if hull < FLAT * diameter(&outer).powi(3) {
            return Self { pieces: vec![arrays(&extremes(&thickened(&outer)))] };
        }
        let filled = volume(&points, &triangles) / hull;
        if filled > NEARLY_CONVEX {
            return Self { pieces: vec![arrays(&outer)] };
        }
        let pieces = decompose(&points, &triangles);
        Self { pieces: if pieces.is_empty() { vec![arrays(&outer)] } else { pieces } }
    }

    /// The centre of the bounding box, in the mesh's frame.
    pub fn middle(&self) -> Vector3<f32> {
        let [low, high] = self.bounds();
        0.5 * (low + high)
    }

    /// The radius of the smallest ball around [`middle`](Self::middle) that contains the body.
    pub fn radius(&self) -> f32 {
        let middle = self.middle();
        self.points().map(|&point| (Vector3::from(point) - middle).norm()).fold(0.0, f32::max)
    }

    fn points(&self) -> impl Iterator<Item = &[f32; 3]> {
        self.pieces.iter().flatten()
    }

    fn bounds(&self) -> [Vector3<f32>; 2] {
        let start = [Vector3::repeat(f32::INFINITY), Vector3::repeat(f32::NEG_INFINITY)];
        self.points()
            .map(|&point| Vector3::from(point))
            .fold(start, |[low, high], point| [low.inf(&point), high.sup(&point)])
    }
}

fn join(meshes: &[&Mesh]) -> (Vec<Vector>, Vec<[u32; 3]>) {
    let (mut points, mut triangles) = (Vec::new(), Vec::new());
    for mesh in meshes {
        let first = points.len() as u32;
        points.extend(mesh.positions.iter().map(|&p| Vector::from(p)));
        triangles.extend(mesh.triangles.iter().map(|t| t.map(|vertex| first + vertex)));
    }
    (points, triangles)
}

fn arrays(points: &[Vector]) -> Vec<[f32; 3]> {
    points.iter().map(|p| p.to_array()).collect()
}

/// The signed volume of a closed mesh.
fn volume(points: &[Vector], triangles: &[[u32; 3]]) -> f32 {
    let of_triangle = |triangle: &[u32; 3]| {
        let [a, b, c] = triangle.map(|vertex| points[vertex as usize]);
        a.dot(b.cross(c)) / 6.0
    };
    triangles.iter().map(of_triangle).sum()
}

/// The pieces of the mesh's approximate convex decomposition; none if it fails at all resolutions.
fn decompose(points: &[Vector], triangles: &[[u32; 3]]) -> Vec<Vec<[f32; 3]>> {
    let hulls = RESOLUTIONS.iter().find_map(|&resolution| hulls(points, triangles, resolution));
    let pieces = hulls.into_iter().flatten().map(|(points, _)| extremes(&points));
    pieces.filter(|piece| try_convex_hull(piece).is_ok()).map(|piece| arrays(&piece)).collect()
}

/// The points and triangles of a convex hull.
type Hull = (Vec<Vector>, Vec<[u32; 3]>);

/// The hulls of the mesh's approximate convex decomposition with so many voxels along its longest side. `None` if
/// the library panics, as it does for a few meshes at some resolutions (dimforge/parry issue 347).
fn hulls(points: &[Vector], triangles: &[[u32; 3]], resolution: u32) -> Option<Vec<Hull>> {
    let parameters =
        VHACDParameters { concavity: 0.01, resolution, max_convex_hulls: 12, ..Default::default() };
    caught(|| {
        let parts = VHACD::decompose(&parameters, points, triangles, true);
        parts.compute_exact_convex_hulls(points, triangles)
    })
}

thread_local! {
    /// Whether a panic of this thread is expected, and nothing is to be printed of it.
    static EXPECTED: Cell<bool> = const { Cell::new(false) };
}

/// What `work` returns; `None`, and no message, if it panics.
fn caught<T>(work: impl FnOnce() -> T) -> Option<T> {
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        let before = panic::take_hook();
        panic::set_hook(Box::new(move |info| {
            if !EXPECTED.get() {
                before(info);
            }
        }));
    });
    EXPECTED.set(true);
    let result = panic::catch_unwind(AssertUnwindSafe(work));
    EXPECTED.set(false);
    result.ok()
}

/// At most [`MOST_VERTICES`] points whose hull is nearly the hull of all. It starts with the outermost points
/// in [`DIRECTIONS`] evenly spread directions, then repeatedly adds, for each face of the hull so far, the
/// point farthest outside it, until none is farther outside than [`ALLOWED`].
fn extremes(points: &[Vector]) -> Vec<Vector> {
    if points.len() <= MOST_VERTICES {
        return points.to_vec();
    }
    let allowed = ALLOWED * diameter(points);
    let mut chosen: BTreeSet<usize> =
        (0..DIRECTIONS).map(|i| outermost(points, spread(i, DIRECTIONS)).0).collect();
    loop {
        let few: Vec<Vector> = chosen.iter().map(|&index| points[index]).collect();
        let Ok((hull, triangles)) = try_convex_hull(&few) else { return few };
        let before = chosen.len();
        for [a, b, c] in triangles.iter().map(|triangle| triangle.map(|vertex| hull[vertex as usize])) {
            let normal = (b - a).cross(c - a).normalize_or_zero();
            let (index, height) = outermost(points, normal);
            if height > a.dot(normal) + allowed && chosen.len() < MOST_VERTICES {
                chosen.insert(index);
            }
        }
        if chosen.len() == before {
            return few;
        }
    }
}

/// Index of the point farthest along the unit vector `direction`, and its coordinate in that direction.
fn outermost(points: &[Vector], direction: Vector) -> (usize, f32) {
    let heights = points.iter().map(|point| point.dot(direction)).enumerate();
    heights.fold((0, f32::NEG_INFINITY), |best, other| if other.1 > best.1 { other } else { best })
}

/// Unit vector `index` of `count`, spread evenly over the sphere along a Fibonacci spiral.
fn spread(index: usize, count: usize) -> Vector {
    let z = 1.0 - (2.0 * index as f64 + 1.0) / count as f64;
    let angle = PI * (3.0 - 5.0_f64.sqrt()) * index as f64;
    let radius = (1.0 - z * z).sqrt();
    Vector::new((radius * angle.cos()) as f32, (radius * angle.sin()) as f32, z as f32)
}

/// The corners of a cube of half side [`HALF_THICKNESS`] around each point.
fn thickened(points: &[Vector]) -> Vec<Vector> {
    let side =
        |corner: usize, axis: usize| if corner >> axis & 1 == 0 { -HALF_THICKNESS } else { HALF_THICKNESS };
    let corner = |index| Vector::new(side(index, 0), side(index, 1), side(index, 2));
    points.iter().flat_map(|&point| (0..8).map(move |index| point + corner(index))).collect()
}

/// The diagonal of the bounding box.
fn diameter(points: &[Vector]) -> f32 {
    let low = points.iter().fold(Vector::MAX, |low, &point| low.min(point));
    let high = points.iter().fold(Vector::MIN, |high, &point| high.max(point));
    (high - low).length()
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_pcg::Pcg64;

    use super::*;
    use crate::assets::Assets;
    use crate::primitive::{cuboid, heightfield, lathe, rectangle, sphere};

    #[test]
    fn convex_meshes_are_one_piece_of_their_own_points() {
        let solid = Solid::of(&[&sphere(0.05, 32)]);
        assert_eq!(solid.pieces.len(), 1);
        assert!(solid.points().all(|&p| (Vector::from(p).length() - 0.05).abs() < 1e-6));
        assert_eq!(Solid::of(&[&cuboid([0.1, 0.2, 0.3])]).pieces.len(), 1);
    }

    #[test]
    fn meshes_hardly_reach_out_of_their_hulls() {
        // A box of 10 cm with a bulge of 2 mm on top: in most directions a corner lies farther out than it.
        let bulge = |x: f32, y: f32| 0.1 + 0.002 * (1.0 - 400.0 * (x * x + y * y)).max(0.0);
        let top = heightfield([0.1, 0.1], [40, 40], bulge);
        let solid = Solid::of(&[&top, &cuboid([0.1, 0.1, 0.2])]);
        let piece: Vec<Vector> = solid.points().map(|&p| Vector::from(p)).collect();
        let (hull, triangles) = try_convex_hull(&piece).unwrap();
        let outside = |point: Vector| {
            let height = |[a, b, c]: [Vector; 3]| (b - a).cross(c - a).normalize().dot(point - a);
            triangles.iter().map(|t| height(t.map(|v| hull[v as usize]))).fold(f32::MIN, f32::max)
        };
        let farthest = top.positions.iter().map(|&p| outside(Vector::from(p))).fold(0.0, f32::max);
        assert!(farthest < 3e-4 && piece.len() <= MOST_VERTICES, "{farthest} m, {} points", piece.len());
    }

    #[test]
    fn bowls_stay_hollow() {
        let profile = [[0.0, 0.0], [0.05, 0.0], [0.09, 0.08], [0.08, 0.08], [0.045, 0.01], [0.0, 0.01]];
        let solid = Solid::of(&[&lathe(&profile, 48)]);
        assert!(solid.pieces.len() > 2);
        // No piece reaches far into the hollow: a point above the bottom is 2 cm away from all of them.
        let probe = Vector::new(0.0, 0.0, 0.05);
        for piece in &solid.pieces {
            let points: Vec<Vector> = piece.iter().map(|&p| Vector::from(p)).collect();
            let hull = rapier3d::geometry::ColliderBuilder::convex_hull(&points).unwrap().build();
            let distance = hull.shape().distance_to_local_point(probe, true);
            assert!(distance > 0.02, "a piece comes within {distance} m of the hollow's middle");
        }
    }

    #[test]
    fn a_mesh_that_cannot_be_decomposed_at_the_first_resolution_is_at_another() {
        let mut rng = Pcg64::seed_from_u64(9487094142136816881);
        let thing = Assets::procedural().thing(&mut rng).unwrap();
        let mesh = &thing.parts[0].0;
        let points: Vec<Vector> = mesh.positions.iter().map(|&p| Vector::from(p)).collect();
        assert!(hulls(&points, &mesh.triangles, RESOLUTIONS[0]).is_none());
        assert!(thing.solid.pieces.len() > 1);
    }

    #[test]
    fn flat_meshes_get_thickness() {
        let tilted = heightfield([0.1, 0.1], [4, 4], |x, y| 0.7 * x - 0.2 * y);
        for mesh in [rectangle([0.1, 0.1]), tilted] {
            let solid = Solid::of(&[&mesh]);
            let points: Vec<Vector> = solid.points().map(|&p| Vector::from(p)).collect();
            let (hull, triangles) = try_convex_hull(&points).unwrap();
            let sheet = 0.01 * 2.0 * HALF_THICKNESS;
            assert!(volume(&hull, &triangles) > 0.9 * sheet && volume(&hull, &triangles) < 2.0 * sheet);
        }
    }
}
