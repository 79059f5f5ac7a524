//! Speckles: small connected pieces of surface.

use rayon::prelude::*;
use vamvs_core::{Grid, Size};

use crate::field::{Field, State};
use crate::plane::Plane;

/// Replaces connected pieces of fewer than `least` pixels by the planes of the seed, without a correlation. Two
/// neighbouring pixels are connected if their planes differ by less than a pixel of disparity, `steps`.
pub(crate) fn replace_speckles(
    field: &mut Field,
    steps: &Grid<f32>,
    least: usize,
    seed: impl Fn(usize, usize) -> Plane,
) {
    let size = field.size();
    let at = |place: usize| (place % size.width, place / size.width);
    let joined = |a: usize, b: usize| {
        let ((ax, ay), (bx, by)) = (at(a), at(b));
        let (first, second) = (&field.at(ax, ay).plane, &field.at(bx, by).plane);
        let (dx, dy) = (bx as f32 - ax as f32, by as f32 - ay as f32);
        let gap =
            (first.seen_from(dx, dy).w - second.w).abs().min((second.seen_from(-dx, -dy).w - first.w).abs());
        gap < steps[(ax, ay)]
    };
    let has_depth = |place: usize| field.at(at(place).0, at(place).1).plane.w > 0.0;
    for place in small_pieces(size, least, has_depth, joined) {
        let (x, y) = at(place);
        *field.at_mut(x, y) = State::unjudged(seed(x, y));
    }
}

/// The pixels of all connected pieces of fewer than `least` pixels, as indices into the row-major grid. Two
/// neighbouring pixels with depth are connected if `joined(a, b)` holds for their indices, a < b.
fn small_pieces(
    size: Size,
    least: usize,
    has_depth: impl Fn(usize) -> bool + Sync,
    joined: impl Fn(usize, usize) -> bool + Sync,
) -> Vec<usize> {
    let joints = joints(size, |a, b| has_depth(a) && has_depth(b) && joined(a, b));
    let mut seen = Grid::filled(size, false);
    let (mut small, mut piece, mut front) = (Vec::new(), Vec::new(), Vec::new());
    for start in 0..size.area() {
        if seen.data()[start] || !has_depth(start) {
            continue;
        }
        piece.clear();
        seen.data_mut()[start] = true;
        front.push(start);
        while let Some(pixel) = front.pop() {
            piece.push(pixel);
            for other in neighbours(&joints, pixel) {
                if !seen.data()[other] {
                    seen.data_mut()[other] = true;
                    front.push(other);
                }
            }
        }
        if piece.len() < least {
            small.extend_from_slice(&piece);
        }
    }
    small
}

/// Whether each pixel is connected with the one to its right and with the one below.
fn joints(size: Size, joined: impl Fn(usize, usize) -> bool + Sync) -> Grid<[bool; 2]> {
    let mut joints = Grid::filled(size, [false; 2]);
    joints.data_mut().par_chunks_exact_mut(size.width.max(1)).enumerate().for_each(|(y, row)| {
        for (x, joint) in row.iter_mut().enumerate() {
            let pixel = y * size.width + x;
            let right = x + 1 < size.width && joined(pixel, pixel + 1);
            *joint = [right, y + 1 < size.height && joined(pixel, pixel + size.width)];
        }
    });
    joints
}

/// The pixels that are connected with this one.
fn neighbours(joints: &Grid<[bool; 2]>, pixel: usize) -> impl Iterator<Item = usize> {
    let (joint, width) = (joints.data(), joints.width());
    let beside = [
        (pixel > 0 && joint[pixel - 1][0]).then(|| pixel - 1),
        joint[pixel][0].then(|| pixel + 1),
        (pixel >= width && joint[pixel - width][1]).then(|| pixel - width),
        joint[pixel][1].then(|| pixel + width),
    ];
    beside.into_iter().flatten()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn speckles_get_the_planes_of_the_seed() {
        let flat = |w: f32| Plane { w, gx: 0.0, gy: 0.0 };
        // A piece of 2 pixels and one of 6, on a surface that rises by less than a step from pixel to pixel.
        let inverse_depth = |x: usize, y: usize| match (x, y) {
            (2..=3, 2) => 9.0,
            (6..=8, 5..=6) => 5.0,
            (0, 0) => 0.0,
            _ => 1.0 + 0.05 * x as f32,
        };
        let state = |x, y| State { correlation: 0.9, ..State::unjudged(flat(inverse_depth(x, y))) };
        let size = Size::new(12, 9);
        let (mut field, steps) = (Field::new(size, state), Grid::filled(size, 0.1));
        replace_speckles(&mut field, &steps, 5, |x, _| if x == 2 { flat(3.0) } else { Plane::default() });
        for (x, y) in (0..9).flat_map(|y| (0..12).map(move |x| (x, y))) {
            let (plane, correlation) = (field.at(x, y).plane, field.at(x, y).correlation);
            match (x, y) {
                (2, 2) => assert_eq!((plane, correlation), (flat(3.0), 0.0)),
                (3, 2) => assert_eq!((plane, correlation), (Plane::default(), 0.0)),
                _ => assert_eq!((plane, correlation), (flat(inverse_depth(x, y)), 0.9)),
            }
        }
    }

    #[test]
    fn pieces_are_told_by_their_size() {
        // Two pieces, of 1 and 3 pixels, in a surface of 8.
        let values = [
            1, 1, 1, 1, //
            1, 5, 1, 9, //
            1, 1, 9, 9_u32,
        ];
        let find = |least| {
            let mut small = small_pieces(Size::new(4, 3), least, |_| true, |a, b| values[a] == values[b]);
            small.sort_unstable();
            small
        };
        assert_eq!(find(2), [5]);
        assert_eq!(find(4), [5, 7, 10, 11]);
        assert_eq!(find(1), Vec::<usize>::new());
    }
}
