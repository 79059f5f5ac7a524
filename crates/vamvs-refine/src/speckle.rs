//! Speckles: small connected pieces of a depth map.

use vamvs_core::{Grid, Size};

/// The pixels of all connected pieces of fewer than `least` pixels, as indices into the row-major grid. Two
/// neighbouring pixels with depth are connected if `joined(a, b)` holds for their indices.
pub(crate) fn small_pieces(
    size: Size,
    least: usize,
    has_depth: impl Fn(usize) -> bool,
    joined: impl Fn(usize, usize) -> bool,
) -> Vec<usize> {
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
            for other in neighbours(size, pixel) {
                if !seen.data()[other] && has_depth(other) && joined(pixel, other) {
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

fn neighbours(size: Size, pixel: usize) -> impl Iterator<Item = usize> {
    let (x, y) = (pixel % size.width, pixel / size.width);
    let beside = [
        (x > 0).then(|| pixel - 1),
        (x + 1 < size.width).then(|| pixel + 1),
        (y > 0).then(|| pixel - size.width),
        (y + 1 < size.height).then(|| pixel + size.width),
    ];
    beside.into_iter().flatten()
}

#[cfg(test)]
mod tests {
    use super::*;

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
