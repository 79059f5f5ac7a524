//! Closes small holes of a mesh (Liepa, "Filling holes in meshes"), but not those that a view sees through.

use std::collections::{HashMap, HashSet};

use nalgebra::Vector3;
use rayon::prelude::*;
use vamvs_core::Mesh;

use crate::manifold::{Side, sides};
use crate::view::SeenView;

/// The least cosine of the angle between the normal of a hole and the mean of those around it: of a loop around a piece, rather
/// than a hole in it, they are opposite.
const LEAST_COSINE: f64 = 0.3;

/// Holes of a mesh, and what may close them.
pub(crate) struct Holes {
    closings: Vec<Closing>,
}

/// The triangles that close a hole, and whether a view sees past them.
struct Closing {
    triangles: Vec<[u32; 3]>,
    middles: Vec<Vector3<f64>>,
    is_seen_through: bool,
}

/// A hole: its vertices in the order in which what closes it has them, and the normal of the triangle beyond the edge to the
/// next one.
struct Loop {
    vertices: Vec<u32>,
    normals: Vec<Vector3<f64>>,
}

impl Loop {
    /// Whether what closes the loop would go on where the triangles around it end.
    fn continues(&self, mesh: &Mesh) -> bool {
        let at = |number: usize| Vector3::from(mesh.positions[self.vertices[number] as usize]).cast::<f64>();
        let count = self.vertices.len();
        let begin = at(0);
        let area = |number: usize| (at(number) - begin).cross(&(at((number + 1) % count) - begin));
        let normal = (0..count).map(area).sum::<Vector3<f64>>().normalize();
        let around = self.normals.iter().sum::<Vector3<f64>>().normalize();
        normal.dot(&around) >= LEAST_COSINE
    }
}

impl Holes {
    /// The holes of a manifold with at most so many edges around.
    pub fn of(mesh: &Mesh, most_edges: usize) -> Self {
        let sides = sides(mesh);
        let border: Vec<&Side> = sides
            .chunk_by(|a, b| a.vertices == b.vertices)
            .filter(|edge| edge.len() == 1)
            .map(|edge| &edge[0])
            .collect();
        let loops = loops(mesh, &border, most_edges);
        let at_holes: HashSet<u32> = loops.iter().flat_map(|hole| hole.vertices.iter().copied()).collect();
        let is_chord = |side: &&Side| side.vertices.iter().all(|vertex| at_holes.contains(vertex));
        let edges: HashSet<[u32; 2]> = sides.iter().filter(is_chord).map(|side| side.vertices).collect();
        let closing = |hole: &Loop| {
            let triangles = triangulated(mesh, hole, &edges)?;
            let middle = |triangle: &[u32; 3]| {
                triangle.map(|vertex| mesh.x_in_world(vertex)).iter().sum::<Vector3<f64>>() / 3.0
            };
            Some(Closing {
                middles: triangles.iter().map(middle).collect(),
                triangles,
                is_seen_through: false,
            })
        };
        Self { closings: loops.par_iter().filter_map(closing).collect() }
    }

    /// Places on what closes the holes.
    pub fn places(&self) -> impl Iterator<Item = &Vector3<f64>> {
        self.closings.iter().filter(|closing| !closing.is_seen_through).flat_map(|closing| &closing.middles)
    }

    /// Leaves open the holes that a view sees through.
    pub fn look(&mut self, view: &SeenView) {
        self.closings.par_iter_mut().for_each(|closing| {
            let sees_past = |place| view.sees_past(&view.sight.cam_from_world.transform(place));
            closing.is_seen_through |= closing.middles.iter().any(sees_past);
        });
    }

    /// Closes the others.
    pub fn close(self, mesh: &mut Mesh) {
        let closed = self.closings.into_iter().filter(|closing| !closing.is_seen_through);
        mesh.triangles.extend(closed.flat_map(|closing| closing.triangles));
    }
}

/// The loops of at most so many sides that have a triangle on one side only.
fn loops(mesh: &Mesh, border: &[&Side], most_edges: usize) -> Vec<Loop> {
    // What closes a hole has its edges the other way round.
    let ends = |side: &Side| {
        let place = side.number as usize % 3;
        let triangle = mesh.triangles[side.number as usize / 3];
        (triangle[(place + 1) % 3], triangle[place])
    };
    let next: HashMap<u32, &Side> = border.iter().map(|side| (ends(side).0, *side)).collect();
    let mut visited = HashSet::new();
    let mut loops = Vec::new();
    for side in border {
        let mut hole = Loop { vertices: Vec::new(), normals: Vec::new() };
        let (first, mut side) = (ends(side).0, *side);
        let mut is_closed = true;
        while visited.insert(side.number) {
            let [a, b, c] =
                mesh.corners(mesh.triangles[side.number as usize / 3]).map(|corner| corner.cast::<f64>());
            hole.vertices.push(ends(side).0);
            hole.normals.push((b - a).cross(&(c - a)).try_normalize(0.0).unwrap_or_default());
            match next.get(&ends(side).1) {
                Some(next) => side = next,
                None => is_closed = false,
            }
        }
        is_closed &= ends(side).0 == first && (3..=most_edges).contains(&hole.vertices.len());
        if is_closed && hole.continues(mesh) {
            loops.push(hole);
        }
    }
    loops
}

/// How bad a triangulation is: by the sharpest fold, then by area.
#[derive(Clone, Copy, PartialEq, PartialOrd)]
struct Cost(f64, f64);

impl Cost {
    fn with(self, other: Self) -> Self {
        Self(self.0.max(other.0), self.1 + other.1)
    }
}

/// The best triangulation of a part of a hole between two of its vertices.
#[derive(Clone, Copy)]
struct Best {
    cost: Cost,
    /// The third vertex of the triangle at the chord, and its normal.
    third: usize,
    normal: Vector3<f64>,
}

/// The triangles that close a hole with the least sharp folds; `None` if it is none, or its vertices have edges across.
fn triangulated(mesh: &Mesh, hole: &Loop, edges: &HashSet<[u32; 2]>) -> Option<Vec<[u32; 3]>> {
    let count = hole.vertices.len();
    let at: Vec<Vector3<f64>> =
        hole.vertices.iter().map(|&vertex| Vector3::from(mesh.positions[vertex as usize]).cast()).collect();
    let is_open = |a: usize, b: usize| {
        let (a, b) = (hole.vertices[a], hole.vertices[b]);
        !edges.contains(&[a.min(b), a.max(b)])
    };
    // Of vertices `first` and `last`, at `first * count + last`.
    let mut all: Vec<Option<Best>> = vec![None; count * count];
    for first in 0..count - 1 {
        let none = Best { cost: Cost(0.0, 0.0), third: first, normal: hole.normals[first] };
        all[first * count + first + 1] = Some(none);
    }
    for length in 2..count {
        for first in 0..count - length {
            let last = first + length;
            let is_whole = length == count - 1;
            if !is_whole && !is_open(first, last) {
                continue;
            }
            let with = |third: usize| -> Option<Best> {
                let (before, behind) = (all[first * count + third]?, all[third * count + last]?);
                let doubled = (at[third] - at[first]).cross(&(at[last] - at[first]));
                let normal = doubled.try_normalize(0.0).unwrap_or_default();
                let mut fold = (1.0 - normal.dot(&before.normal)).max(1.0 - normal.dot(&behind.normal));
                if is_whole {
                    fold = fold.max(1.0 - normal.dot(&hole.normals[last]));
                }
                let own = Cost(fold, doubled.norm() / 2.0);
                Some(Best { cost: own.with(before.cost).with(behind.cost), third, normal })
            };
            let better = |a: Best, b: Best| if b.cost < a.cost { b } else { a };
            all[first * count + last] = (first + 1..last).filter_map(with).reduce(better);
        }
    }
    let mut triangles = Vec::with_capacity(count - 2);
    let mut open = vec![(0, count - 1)];
    while let Some((first, last)) = open.pop() {
        if last == first + 1 {
            continue;
        }
        let third = all[first * count + last]?.third;
        triangles.push([first, third, last].map(|number| hole.vertices[number]));
        open.extend([(first, third), (third, last)]);
    }
    Some(triangles)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::MeshView;
    use nalgebra::Matrix3;
    use vamvs_core::{Grid, Intrinsics, Pinhole, Pose, Size};

    /// A height field of 20×20 vertices on a dome, without the cells around the middle.
    fn dome(is_there: impl Fn(i32, i32) -> bool) -> Mesh {
        let height = |x: i32, y: i32| 20.0 - 0.05 * ((x - 10).pow(2) + (y - 10).pow(2)) as f32;
        let number = |x: i32, y: i32| (20 * y + x) as u32;
        let mut mesh = Mesh::default();
        for y in 0..20 {
            for x in 0..20 {
                mesh.positions.push([x as f32, y as f32, height(x, y)]);
                if x < 19 && y < 19 && is_there(x, y) {
                    let [a, b, c, d] =
                        [number(x, y), number(x + 1, y), number(x + 1, y + 1), number(x, y + 1)];
                    mesh.triangles.extend([[a, b, c], [a, c, d]]);
                }
            }
        }
        mesh.retain(|_| true);
        mesh
    }

    fn border(mesh: &Mesh) -> usize {
        let sides = sides(mesh);
        let edges = sides.chunk_by(|a, b| a.vertices == b.vertices);
        assert!(edges.clone().all(|edge| edge.len() <= 2));
        edges.filter(|edge| edge.len() == 1).count()
    }

    #[test]
    fn a_hole_is_closed_where_the_surface_goes_on_and_a_border_stays_open() {
        let mut mesh = dome(|x, y| !(8..11).contains(&x) || !(8..12).contains(&y));
        assert_eq!(border(&mesh), 4 * 19 + 14);
        let before = mesh.triangles.len();
        assert!(Holes::of(&mesh, 13).closings.is_empty());
        Holes::of(&mesh, 200).close(&mut mesh);
        assert_eq!(mesh.triangles.len(), before + 12);
        assert_eq!(border(&mesh), 4 * 19);
        for &triangle in &mesh.triangles[before..] {
            let [a, b, c] = mesh.corners(triangle);
            let normal = (b - a).cross(&(c - a)).normalize();
            assert!(normal.z > 0.9, "{normal:?}");
        }
    }

    #[test]
    fn a_hole_that_a_view_sees_through_stays_open() {
        let size = Size::new(240, 240);
        let intrinsics = Intrinsics { fx: 400.0, fy: 400.0, cx: 120.0, cy: 120.0 };
        // From above: the hole is 3 to 4 units wide, and a unit 10 pixels.
        let look_down = Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0));
        let pose = Pose { rotation: look_down, translation: Vector3::new(-9.5, 9.5, 60.0) };
        let is_hole = |x: usize, y: usize| (100..140).contains(&x) && (100..140).contains(&y);
        let closed_with = |depth: f32, confirmed: bool| {
            let view = MeshView {
                camera: Pinhole { size, intrinsics },
                cam_from_world: pose,
                depth: Grid::from_fn(size, |x, y| if is_hole(x, y) { depth } else { 40.2 }),
                confirmed: Some(Grid::from_fn(size, |x, y| confirmed || !is_hole(x, y))),
                sigma: None,
                normals: None,
                colour: Grid::filled(size, [0; 3]),
            };
            let mut mesh = dome(|x, y| !(8..11).contains(&x) || !(8..12).contains(&y));
            let before = mesh.triangles.len();
            let mut holes = Holes::of(&mesh, 30);
            holes.look(&SeenView::new(0, view).expect("rasters of one size"));
            holes.close(&mut mesh);
            mesh.triangles.len() - before
        };
        assert_eq!(closed_with(50.0, false), 12, "what is seen there is not confirmed");
        assert_eq!(closed_with(50.0, true), 0, "another surface");
        assert_eq!(closed_with(0.0, true), 0, "no surface");
        assert_eq!(closed_with(30.0, true), 12, "a surface before it");
    }

    #[test]
    fn a_small_piece_gets_no_other_side() {
        let mut mesh = dome(|x, y| (4..7).contains(&x) && (5..8).contains(&y));
        Holes::of(&mesh, 200).close(&mut mesh);
        assert_eq!(mesh.triangles.len(), 18);
    }
}
