//! A part of the world between two planes and inside a polygon: Open3D's `SelectionPolygonVolume`, to
//! which Tanks and Temples crops clouds.

/// A prism along an axis of the world.
#[derive(Clone, Debug, PartialEq)]
pub struct CropVolume {
    /// The prism's axis: 0 for x, 1 for y, 2 for z.
    pub axis: usize,
    /// Where the prism begins and ends along its axis, both included.
    pub span: [f64; 2],
    /// The polygon's corners in the other two axes, which keep their order.
    pub outline: Vec<[f64; 2]>,
}

impl CropVolume {
    /// Whether a point is inside: between the planes, and with an odd number of polygon edges in the
    /// direction of smaller coordinates along the first of the other axes (as
    /// `SelectionPolygonVolume::CropInPolygon` decides, borderline cases included).
    #[must_use]
    pub fn contains(&self, x_in_world: &[f64; 3]) -> bool {
        let along = x_in_world[self.axis];
        let (u, v) = match self.axis {
            0 => (x_in_world[1], x_in_world[2]),
            1 => (x_in_world[0], x_in_world[2]),
            _ => (x_in_world[0], x_in_world[1]),
        };
        (self.span[0]..=self.span[1]).contains(&along) && self.edges_beside(u, v) % 2 == 1
    }

    fn edges_beside(&self, u: f64, v: f64) -> usize {
        let next = self.outline.iter().cycle().skip(1);
        let crossing = |(a, b): (&[f64; 2], &[f64; 2])| {
            let crosses = (a[1] < v && b[1] >= v) || (b[1] < v && a[1] >= v);
            crosses.then(|| a[0] + (v - a[1]) / (b[1] - a[1]) * (b[0] - a[0]))
        };
        self.outline.iter().zip(next).filter_map(crossing).filter(|&place| place < u).count()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An L without its upper right quarter.
    fn corner(axis: usize) -> CropVolume {
        let outline = vec![[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 1.0], [1.0, 2.0], [0.0, 2.0]];
        CropVolume { axis, span: [-1.0, 3.0], outline }
    }

    #[test]
    fn a_bent_outline_holds_what_is_inside_along_every_axis() {
        let inside = [[0.5, 0.5], [1.5, 0.5], [0.5, 1.5]];
        let outside = [[1.5, 1.5], [-0.5, 0.5], [2.5, 0.5], [0.5, 2.5], [0.5, -0.5]];
        for axis in 0..3 {
            let place = |[u, v]: [f64; 2], along: f64| {
                let mut x = vec![u, v];
                x.insert(axis, along);
                [x[0], x[1], x[2]]
            };
            let volume = corner(axis);
            for along in [-1.0, 0.0, 3.0] {
                assert!(inside.iter().all(|&x| volume.contains(&place(x, along))), "axis {axis}");
                assert!(!outside.iter().any(|&x| volume.contains(&place(x, along))), "axis {axis}");
            }
            assert!(!inside.iter().any(|&x| volume.contains(&place(x, 3.01))));
            assert!(!inside.iter().any(|&x| volume.contains(&place(x, -1.01))));
        }
    }
}
