//! The surface where the signed distance is zero, as triangles (dual contouring on an octree).
//!
//! Each patch of the surface in a cell becomes a vertex, at the mean of the places where the surface crosses the cell's
//! edges; each edge that the surface crosses becomes a polygon of the vertices of the cells around it. So the mesh has no
//! cracks between cells of different sizes. A cell with a corner that no view sees has no vertex: there the surface ends.

use std::collections::HashMap;
use std::ops::Range;
use std::sync::OnceLock;

use nalgebra::Vector3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::bricks::{BRICK, BRICK_BITS, Place};
use crate::field::Field;
use crate::patches::{CORNERS, Patches, Point, STEP, axes, face_polygon};

/// Cells of a brick.
const CELLS: usize = (BRICK * BRICK * BRICK) as usize;

/// The surface in some bricks.
#[derive(Default)]
pub(crate) struct Surface {
    /// The number of vertices of each brick.
    pub counts: Vec<u16>,
    /// The vertices' places in the grid, brick by brick.
    pub positions: Vec<Vector3<f64>>,
    /// The triangles that the bricks own; they have vertices of bricks around them too.
    pub triangles: Vec<[Vertex; 3]>,
}

/// A vertex: its brick, and its number among those of the brick.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Vertex {
    pub brick: u32,
    pub number: u16,
}

/// A cell of the octree.
#[derive(Clone, Copy, PartialEq)]
struct Cell {
    brick: usize,
    low: Place,
}

/// The vertices of a brick.
#[derive(Default)]
struct Vertices {
    /// For each cell that has vertices, 1 more than the place of its first among the brick's.
    of_cell: Option<Box<[u16; CELLS]>>,
    positions: Vec<Vector3<f64>>,
    /// The patches of the cells with finer ones beside them.
    irregular: HashMap<u16, Patches>,
}

/// The surface of a field in a range of bricks, of the polygons for which `is_kept` holds of middle and normal.
pub(crate) fn extract(
    field: &Field<'_>,
    bricks: Range<usize>,
    is_kept: impl Fn(&Vector3<f64>, &Vector3<f64>) -> bool + Sync,
) -> Surface {
    let vertices = field.bricks.all.iter().map(|_| OnceLock::new()).collect();
    let extractor = Extractor { field, is_kept, vertices };
    let triangles: Vec<Vec<[Vertex; 3]>> =
        bricks.clone().into_par_iter().map(|brick| extractor.triangles(brick)).collect();
    let positions = |brick| &extractor.vertices(brick).positions;
    Surface {
        counts: bricks.clone().map(|brick| positions(brick).len() as u16).collect(),
        positions: bricks.flat_map(|brick| positions(brick).iter().copied()).collect(),
        triangles: triangles.concat(),
    }
}

/// The place of a cell in its brick: x + 8 y + 64 z.
fn number_of(field: &Field<'_>, cell: Cell) -> u16 {
    let brick = field.bricks.all[cell.brick];
    let [x, y, z]: [i32; 3] = (cell.low - brick.low).map(|x| x >> brick.level).into();
    (x | y << BRICK_BITS | z << (2 * BRICK_BITS)) as u16
}

fn cell_of(field: &Field<'_>, brick: usize, number: u16) -> Cell {
    let number = i32::from(number);
    let at = Vector3::new(number, number >> BRICK_BITS, number >> (2 * BRICK_BITS)).map(|x| x & (BRICK - 1));
    let of_brick = field.bricks.all[brick];
    Cell { brick, low: of_brick.low + at * of_brick.cell() }
}

/// The place of a point of a cell's boundary.
fn place(low: Place, level: u32, point: Point) -> Place {
    let point = i32::from(point);
    low + Vector3::new(point % 3, point / 3 % 3, point / 9).map(|x| (x << level) / 2)
}

/// The vertices of a brick's cells.
fn vertices(field: &Field<'_>, brick: usize) -> Vertices {
    let mut vertices = Vertices::default();
    if !field.may_have_surface(brick) {
        return vertices;
    }
    let mut of_cell = Box::new([0; CELLS]);
    let level = field.bricks.all[brick].level;
    for number in 0..CELLS as u16 {
        let cell = cell_of(field, brick, number);
        let Some(values) = corner_values(field, cell) else { continue };
        if !is_seen(field, cell, &values) {
            continue;
        }
        let boundary = Boundary::of(field, cell);
        let Some(boundary) = boundary else {
            let patches = Patches::of_cube(mask(&values));
            let value =
                |point: Point| values[CORNERS.iter().position(|&corner| corner == point).unwrap_or(0)];
            push(&mut vertices, &mut of_cell[usize::from(number)], (cell.low, level), patches, value);
            continue;
        };
        let Some(all) = boundary.values(field, cell, &values) else { continue };
        let value = |point: Point| all[usize::from(point)];
        let patches = Patches::of(&boundary.polygons(), |point| value(point) < 0.0);
        push(&mut vertices, &mut of_cell[usize::from(number)], (cell.low, level), &patches, value);
        vertices.irregular.insert(number, patches);
    }
    vertices.of_cell = Some(of_cell).filter(|_| !vertices.positions.is_empty());
    vertices
}

/// Adds the vertices of a cell's patches.
fn push(
    vertices: &mut Vertices,
    of_cell: &mut u16,
    (low, level): (Place, u32),
    patches: &Patches,
    value: impl Fn(Point) -> f32,
) {
    if patches.count == 0 {
        return;
    }
    *of_cell = vertices.positions.len() as u16 + 1;
    let mut sums = vec![(Vector3::<f64>::zeros(), 0.0); usize::from(patches.count)];
    for &([a, b], patch) in &patches.crossings {
        let (at_a, at_b) = (value(a), value(b));
        let share = f64::from(at_a / (at_a - at_b));
        let [a, b] = [a, b].map(|point| place(low, level, point).cast::<f64>());
        let sum = &mut sums[usize::from(patch)];
        *sum = (sum.0 + a + (b - a) * share, sum.1 + 1.0);
    }
    vertices.positions.extend(sums.into_iter().map(|(sum, count)| sum / count));
}

/// The distances at a cell's corners; `None` if one is unknown.
fn corner_values(field: &Field<'_>, cell: Cell) -> Option<[f32; 8]> {
    let level = field.bricks.all[cell.brick].level;
    let mut values = [0.0; 8];
    for (value, corner) in values.iter_mut().zip(CORNERS) {
        *value = field.at(cell.brick, &place(cell.low, level, corner))?;
    }
    Some(values)
}

/// Whether a view sees the surface in a cell: there is one near an inner corner. Else what seems to be a surface is the end of
/// what is known to be inside, before what other views see through.
fn is_seen(field: &Field<'_>, cell: Cell, values: &[f32; 8]) -> bool {
    let level = field.bricks.all[cell.brick].level;
    let is_near = |point: Point| field.is_near(cell.brick, &place(cell.low, level, point));
    let is_inner = |value: &f32| *value < 0.0;
    !values.iter().any(is_inner)
        || CORNERS.iter().zip(values).any(|(&point, value)| *value < 0.0 && is_near(point))
}

/// Which corners are inside.
fn mask(values: &[f32; 8]) -> u8 {
    values.iter().enumerate().fold(0, |mask, (number, value)| mask | u8::from(*value < 0.0) << number)
}

/// How a cell with finer ones beside it is divided: the bricks of finer cells at its faces and edges.
struct Boundary {
    /// By face: at the low and high end of x, then y, then z.
    faces: [Option<usize>; 6],
    /// By edge: for each axis, low and high end of the next axis, then of the one behind it.
    edges: [Option<usize>; 12],
}

impl Boundary {
    /// `None` if no finer cell touches the cell.
    fn of(field: &Field<'_>, cell: Cell) -> Option<Self> {
        if !field.bricks.has_finer_beside(cell.brick) {
            return None;
        }
        let brick = field.bricks.all[cell.brick];
        let at = (cell.low - brick.low).map(|x| x >> brick.level);
        if at.iter().all(|&x| x > 0 && x < BRICK - 1) {
            return None;
        }
        let finer = |offset: Vector3<i32>| {
            let found = field.bricks.find(&(cell.low + offset))?;
            (field.bricks.all[found].level < brick.level).then_some(found)
        };
        let across = |end: usize| if end == 0 { -1 } else { brick.cell() };
        let faces = std::array::from_fn(|face| {
            let mut offset = Vector3::zeros();
            offset[face / 2] = across(face % 2);
            finer(offset)
        });
        let edges = std::array::from_fn(|edge| {
            let [_, first, second] = axes(edge / 4);
            let mut offset = Vector3::zeros();
            (offset[first], offset[second]) = (across(edge % 2), across(edge / 2 % 2));
            faces[2 * first + edge % 2].or(faces[2 * second + edge / 2 % 2]).or_else(|| finer(offset))
        });
        let is_divided = edges.iter().any(Option::is_some);
        is_divided.then_some(Self { faces, edges })
    }

    /// The polygons of the boundary.
    fn polygons(&self) -> Vec<Vec<Point>> {
        (0..6).flat_map(|face| self.face(face)).collect()
    }

    /// The polygons of a face: four if the cells beside it are finer, else one.
    fn face(&self, face: usize) -> Vec<Vec<Point>> {
        let corners = face_polygon(face);
        let middle = |a: Point, b: Point| (a + b) / 2;
        let between = |number: usize| middle(corners[number % 4], corners[(number + 1) % 4]);
        if self.faces[face].is_some() {
            let centre = middle(corners[0], corners[2]);
            return (0..4).map(|i| vec![corners[i], between(i), centre, between(i + 3)]).collect();
        }
        let [axis, first, second] = axes(face / 2);
        let end = face % 2;
        let is_divided = |number: usize| match number {
            0 => self.edge(first, [(second, 0), (axis, end)]),
            1 => self.edge(second, [(axis, end), (first, 1)]),
            2 => self.edge(first, [(second, 1), (axis, end)]),
            _ => self.edge(second, [(axis, end), (first, 0)]),
        };
        let side = |number: usize| {
            [Some(corners[number]), is_divided(number).map(|_| between(number))].into_iter().flatten()
        };
        vec![(0..4).flat_map(side).collect()]
    }

    /// The brick of finer cells at an edge along `axis`, which is at these ends of the next axis and the one behind it.
    fn edge(&self, axis: usize, ends: [(usize, usize); 2]) -> Option<usize> {
        let [_, first, _] = axes(axis);
        let [a, b] = if ends[0].0 == first { ends } else { [ends[1], ends[0]] };
        self.edges[4 * axis + a.1 + 2 * b.1]
    }

    /// The distances at all points of the boundary, in sizes of the cell; `None` if one is unknown. Points that the boundary
    /// has not stay 0.
    fn values(&self, field: &Field<'_>, cell: Cell, corners: &[f32; 8]) -> Option<[f32; 27]> {
        let mut values = [0.0; 27];
        for (corner, value) in CORNERS.iter().zip(corners) {
            values[usize::from(*corner)] = *value;
        }
        let level = field.bricks.all[cell.brick].level;
        let at = |brick: usize, point: Point| {
            let value = field.at(brick, &place(cell.low, level, point))?;
            Some(value / (1 << (level - field.bricks.all[brick].level)) as f32)
        };
        for (edge, brick) in self.edges.iter().enumerate() {
            let Some(brick) = *brick else { continue };
            let [axis, first, second] = axes(edge / 4);
            let ends = [(edge % 2) as Point, (edge / 2 % 2) as Point];
            let point = STEP[axis] + 2 * (ends[0] * STEP[first] + ends[1] * STEP[second]);
            values[usize::from(point)] = at(brick, point)?;
        }
        for (face, brick) in self.faces.iter().enumerate() {
            let Some(brick) = *brick else { continue };
            let corners = face_polygon(face);
            let point = (corners[0] + corners[2]) / 2;
            values[usize::from(point)] = at(brick, point)?;
        }
        Some(values)
    }
}

/// Makes the polygons.
struct Extractor<'a, K> {
    field: &'a Field<'a>,
    /// Whether a polygon with this middle and normal is a part of the surface.
    is_kept: K,
    /// The bricks' vertices, each brick's when they are first asked for.
    vertices: Vec<OnceLock<Vertices>>,
}

impl<K: Fn(&Vector3<f64>, &Vector3<f64>) -> bool> Extractor<'_, K> {
    fn vertices(&self, brick: usize) -> &Vertices {
        self.vertices[brick].get_or_init(|| vertices(self.field, brick))
    }

    /// The triangles of the edges that a brick's cells own.
    fn triangles(&self, brick: usize) -> Vec<[Vertex; 3]> {
        let mut triangles = Vec::new();
        let Some(of_cell) = &self.vertices(brick).of_cell else { return triangles };
        for number in (0..CELLS as u16).filter(|&number| of_cell[usize::from(number)] > 0) {
            let cell = cell_of(self.field, brick, number);
            for edge in 0..12 {
                self.add_edge(cell, edge, &mut triangles);
            }
        }
        triangles
    }

    /// Adds the polygon around one of a cell's edges, if the surface crosses it, it is not divided, and the cell owns it: of
    /// the smallest cells around it, it is the first.
    fn add_edge(&self, cell: Cell, edge: usize, triangles: &mut Vec<[Vertex; 3]>) {
        let brick = self.field.bricks.all[cell.brick];
        let [axis, first, second] = axes(edge / 4);
        let ends = [edge as i32 % 2, edge as i32 / 2 % 2];
        let mut begin = cell.low;
        begin[first] += ends[0] * brick.cell();
        begin[second] += ends[1] * brick.cell();
        let is_in_brick = |axis: usize| begin[axis] < brick.low[axis] + brick.width();
        // The first of the cells around is then another one of this brick.
        if ends != [0, 0] && is_in_brick(first) && is_in_brick(second) {
            return;
        }
        let mut end = begin;
        end[axis] += brick.cell();
        let values = [begin, end].map(|place| self.field.at(cell.brick, &place));
        let [Some(low), Some(high)] = values else { return };
        if (low < 0.0) == (high < 0.0) {
            return;
        }
        let mut corners = [(Vertex { brick: 0, number: 0 }, Vector3::zeros()); 4];
        let mut is_first = true;
        for (corner, offset) in corners.iter_mut().zip([[0, 0], [-1, 0], [-1, -1], [0, -1]]) {
            let mut inside = begin;
            inside[first] += offset[0];
            inside[second] += offset[1];
            let Some(other) = self.cell_at(cell, inside) else { return };
            let level = self.field.bricks.all[other.brick].level;
            if level < brick.level || (is_first && level == brick.level && other != cell) {
                return;
            }
            is_first &= level > brick.level;
            let Some(vertex) = self.vertex(other, begin, end) else { return };
            *corner = (vertex, self.vertices(other.brick).positions[usize::from(vertex.number)]);
        }
        if low >= 0.0 {
            corners.reverse();
        }
        let places = corners.map(|corner| corner.1);
        let middle = places.iter().sum::<Vector3<f64>>() / 4.0;
        let normal = (places[2] - places[0]).cross(&(places[3] - places[1]));
        if (self.is_kept)(&middle, &normal) {
            Self::add_polygon(corners, triangles);
        }
    }

    /// The cell that contains a finest cell, near another cell.
    fn cell_at(&self, near: Cell, inside: Place) -> Option<Cell> {
        let bricks = self.field.bricks;
        let own = bricks.all[near.brick];
        let is_own = (0..3).all(|axis| (0..own.width()).contains(&(inside[axis] - own.low[axis])));
        let brick = if is_own { near.brick } else { bricks.find(&inside)? };
        let level = bricks.all[brick].level;
        Some(Cell { brick, low: inside.map(|x| x >> level << level) })
    }

    /// The vertex of the patch of a cell that goes through an edge.
    fn vertex(&self, cell: Cell, begin: Place, end: Place) -> Option<Vertex> {
        let vertices = self.vertices(cell.brick);
        let number = number_of(self.field, cell);
        let first = vertices.of_cell.as_ref()?[usize::from(number)].checked_sub(1)?;
        let level = self.field.bricks.all[cell.brick].level;
        let point = |place: Place| {
            let [x, y, z]: [i32; 3] = (place - cell.low).map(|x| (2 * x) >> level).into();
            (x + 3 * y + 9 * z) as Point
        };
        let edge = [point(begin), point(end)];
        let patch = match vertices.irregular.get(&number) {
            Some(patches) => patches.at(edge)?,
            None => Patches::of_cube(mask(&corner_values(self.field, cell)?)).at(edge)?,
        };
        Some(Vertex { brick: cell.brick as u32, number: first + u16::from(patch) })
    }

    /// Adds a polygon of three or four corners, two of which may be the same, cut at its shorter diagonal.
    fn add_polygon(corners: [(Vertex, Vector3<f64>); 4], triangles: &mut Vec<[Vertex; 3]>) {
        let [a, b, c, d] = corners.map(|corner| corner.0);
        let length = |a: usize, b: usize| (corners[a].1 - corners[b].1).norm_squared();
        let cut = if length(0, 2) <= length(1, 3) { [[a, b, c], [a, c, d]] } else { [[a, b, d], [b, c, d]] };
        triangles.extend(cut.into_iter().filter(|[a, b, c]| a != b && b != c && a != c));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::assembly::{Assembly, BlockSurface};
    use crate::bricks::Bricks;
    use std::collections::BTreeMap;
    use vamvs_core::{Mesh, Part};

    /// How often each edge is in the triangles in its direction and against it.
    fn edges(triangles: &[[u32; 3]]) -> BTreeMap<(u32, u32), [u32; 2]> {
        let mut edges: BTreeMap<(u32, u32), [u32; 2]> = BTreeMap::new();
        for &[a, b, c] in triangles {
            for (from, to) in [(a, b), (b, c), (c, a)] {
                edges.entry((from.min(to), from.max(to))).or_default()[usize::from(from > to)] += 1;
            }
        }
        edges
    }

    fn euler(mesh: &Mesh) -> i64 {
        mesh.positions.len() as i64 - edges(&mesh.triangles).len() as i64 + mesh.triangles.len() as i64
    }

    /// The mesh of a field, made in blocks.
    fn mesh(field: &Field<'_>) -> Mesh {
        let bricks = field.bricks;
        let origin = bricks.x_in_world(&bricks.all[0].low.cast());
        let mut assembly = Assembly::default();
        for part in Part::all(5) {
            let Surface { counts, positions, triangles } =
                extract(field, part.range(bricks.all.len()), |_, _| true);
            let relative = |place: &Vector3<f64>| (bricks.x_in_world(place) - origin).cast::<f32>().into();
            let positions = positions.iter().map(relative).collect();
            assembly.push(BlockSurface { counts, positions, colours: Vec::new(), triangles });
        }
        assembly.finish(origin.into())
    }

    #[test]
    fn a_sphere_over_two_levels_is_closed_and_where_it_should_be() {
        let bricks = Bricks::cube(0.5, 3, 1, |middle| middle.x + 0.3 * middle.y > 2.0);
        assert!((0..bricks.all.len()).any(|brick| bricks.has_finer_beside(brick)));
        let centre = Vector3::new(0.3, 0.2, -0.4);
        let distance = |x: Vector3<f64>| (x - centre).norm() - 14.2;
        let field = Field::of_function(&bricks, |x| Some(distance(x)));
        let mesh = mesh(&field);
        assert!(mesh.triangles.len() > 5000, "{}", mesh.triangles.len());
        for (edge, uses) in edges(&mesh.triangles) {
            assert_eq!(uses, [1, 1], "{edge:?}");
        }
        assert_eq!(euler(&mesh), 2);
        for &triangle in &mesh.triangles {
            let [a, b, c] = triangle.map(|vertex| mesh.x_in_world(vertex));
            assert!(distance(a).abs() < 0.05, "{}", distance(a));
            let normal = (b - a).cross(&(c - a));
            assert!(normal.dot(&((a + b + c) / 3.0 - centre)) > 0.0);
        }
    }

    #[test]
    fn the_surface_ends_where_the_distance_is_unknown() {
        let bricks = Bricks::cube(1.0, 1, 0, |_| false);
        let field = Field::of_function(&bricks, |x| (x.x < 2.5).then_some(x.z - 0.3));
        let mesh = mesh(&field);
        assert!(!mesh.triangles.is_empty());
        assert!((0..mesh.positions.len()).all(|vertex| mesh.x_in_world(vertex as u32).x < 2.5));
        assert!(edges(&mesh.triangles).values().all(|uses| uses[0] + uses[1] <= 2));
    }

    #[test]
    fn noise_gives_a_surface_without_cracks() {
        let bricks = Bricks::cube(1.0, 2, 1, |middle| middle.z > 0.0 && middle.x < 4.0);
        let noise = |x: Vector3<f64>| {
            if x.amax() > 28.0 {
                return 1.0;
            }
            let mut bits = x.iter().fold(17_u64, |bits, x| {
                (bits ^ x.to_bits()).wrapping_mul(0x9E37_79B9_7F4A_7C15).rotate_left(23)
            });
            bits ^= bits >> 29;
            (bits.wrapping_mul(0xBF58_476D_1CE4_E5B9) >> 40) as f64 / f64::from(1 << 24) - 0.4
        };
        let field = Field::of_function(&bricks, |x| Some(noise(x)));
        let mut mesh = mesh(&field);
        assert!(mesh.triangles.len() > 10_000);
        let all = edges(&mesh.triangles);
        assert!(all.values().all(|uses| uses[0] == uses[1]));
        assert!(all.values().any(|uses| uses[0] > 1));
        crate::manifold::separate(&mut mesh);
        assert!(edges(&mesh.triangles).values().all(|uses| *uses == [1, 1]));
    }
}
