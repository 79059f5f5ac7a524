//! How the surface goes through a cell: which of its edges that the surface crosses belong to one patch of it.
//!
//! Each patch becomes a vertex of the mesh (dual contouring). Patches are found on the cell's boundary, a complex of
//! polygons: in each polygon, the two edges through which the surface leaves a run of inner corners belong together. Both
//! cells that share a polygon see it alike, so their patches fit together whatever the sizes of the cells.

use std::sync::LazyLock;

/// A point of a cell's boundary, in steps of half a cell: x + 3 y + 9 z.
pub(crate) type Point = u8;

/// Corners of a cell, x first.
pub(crate) const CORNERS: [Point; 8] = [0, 2, 6, 8, 18, 20, 24, 26];

/// A crossed edge of a cell's boundary, lower point first, and the patch that it belongs to.
pub(crate) type Crossing = ([Point; 2], u8);

/// The patches of a cell.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Patches {
    /// The crossed edges.
    pub crossings: Vec<Crossing>,
    /// The number of patches.
    pub count: u8,
}

impl Patches {
    /// The patches on a boundary of these polygons; `is_inner` tells on which side of the surface a point is.
    pub fn of(polygons: &[Vec<Point>], is_inner: impl Fn(Point) -> bool) -> Self {
        let mut edges: Vec<[Point; 2]> = Vec::new();
        let mut groups: Vec<usize> = Vec::new();
        for polygon in polygons {
            join_crossings(polygon, &is_inner, &mut edges, &mut groups);
        }
        let mut names: Vec<usize> = Vec::new();
        let crossings = edges.iter().zip(&groups).map(|(&edge, group)| {
            let name = names.iter().position(|name| name == group).unwrap_or_else(|| {
                names.push(*group);
                names.len() - 1
            });
            (edge, name as u8)
        });
        let crossings = crossings.collect();
        Self { crossings, count: names.len() as u8 }
    }

    /// The patches of a cell without finer ones beside it; bit i of `inner` tells whether corner i is.
    pub fn of_cube(inner: u8) -> &'static Self {
        &CUBES[usize::from(inner)]
    }

    /// The patch of an edge, if the surface crosses it.
    pub fn at(&self, edge: [Point; 2]) -> Option<u8> {
        self.crossings.iter().find(|crossing| crossing.0 == edge).map(|crossing| crossing.1)
    }
}

/// The patches of all cells without finer ones beside them.
static CUBES: LazyLock<Vec<Patches>> = LazyLock::new(|| {
    let polygons: Vec<Vec<Point>> = (0..6).map(|face| face_polygon(face).to_vec()).collect();
    let cube = |inner: u8| {
        let is_inner =
            |point| CORNERS.iter().position(|&corner| corner == point).is_some_and(|i| inner >> i & 1 == 1);
        Patches::of(&polygons, is_inner)
    };
    (0..=255).map(cube).collect()
});

/// The corners of face `face` in order around it: 0 and 1 are those at the low and high end of x, then y, then z.
pub(crate) fn face_polygon(face: usize) -> [Point; 4] {
    let [axis, first, second] = axes(face / 2);
    let base = if face % 2 == 1 { 2 * STEP[axis] } else { 0 };
    [[0, 0], [2, 0], [2, 2], [0, 2]].map(|[a, b]| base + a * STEP[first] + b * STEP[second])
}

/// What one half of a cell along an axis adds to the number of a point.
pub(crate) const STEP: [Point; 3] = [1, 3, 9];

/// An axis and the two behind it, cyclically.
pub(crate) fn axes(axis: usize) -> [usize; 3] {
    [axis, (axis + 1) % 3, (axis + 2) % 3]
}

/// Notes the crossed edges of a polygon, and that those around a run of inner points belong together.
fn join_crossings(
    polygon: &[Point],
    is_inner: &impl Fn(Point) -> bool,
    edges: &mut Vec<[Point; 2]>,
    groups: &mut Vec<usize>,
) {
    let count = polygon.len();
    let mut number = |from: usize| {
        let [a, b] = [polygon[from % count], polygon[(from + 1) % count]];
        let edge = [a.min(b), a.max(b)];
        edges.iter().position(|other| *other == edge).unwrap_or_else(|| {
            edges.push(edge);
            groups.push(groups.len());
            groups.len() - 1
        })
    };
    let mut joined: Vec<[usize; 2]> = Vec::new();
    for start in 0..count {
        // The surface is crossed inwards behind this point: the run of inner points ends where it is crossed outwards.
        if is_inner(polygon[start]) || !is_inner(polygon[(start + 1) % count]) {
            continue;
        }
        let last =
            (start + 1..start + count).find(|&at| !is_inner(polygon[(at + 1) % count])).unwrap_or(start);
        joined.push([number(start), number(last)]);
    }
    for [a, b] in joined {
        let (kept, gone) = (groups[a].min(groups[b]), groups[a].max(groups[b]));
        groups.iter_mut().filter(|group| **group == gone).for_each(|group| *group = kept);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cubes_have_the_patches_that_one_expects() {
        let count = |inner: u8| (Patches::of_cube(inner).count, Patches::of_cube(inner).crossings.len());
        assert_eq!(count(0), (0, 0));
        assert_eq!(count(255), (0, 0));
        assert_eq!(count(1), (1, 3));
        assert_eq!(count(0b0000_1111), (1, 4));
        // Two corners across a face, and across the cube: a patch each.
        assert_eq!(count(0b0000_1001), (2, 6));
        assert_eq!(count(0b1000_0001), (2, 6));
        // All but two across a face: the inner ones are kept apart in that face, and joined around it.
        assert_eq!(count(!0b0000_1001).0, 1);
        assert_eq!(count(!0b1000_0001), (2, 6));
        assert_eq!(count(0b0110_1001), (4, 12));
    }

    #[test]
    fn every_crossed_edge_has_one_patch_and_each_patch_is_a_loop() {
        for inner in 0..=255_u8 {
            let patches = Patches::of_cube(inner);
            for patch in 0..patches.count {
                assert!(patches.crossings.iter().filter(|crossing| crossing.1 == patch).count() >= 3);
            }
        }
    }
}
