//! The part of the world that a reference scan could observe: DTU's observability mask.

/// A grid of voxels in a bounding box, each in the mask or not.
#[derive(Clone, Debug, PartialEq)]
pub struct VoxelMask {
    /// The bounding box's lower corner; the centre of voxel (0, 0, 0).
    pub low: [f64; 3],
    /// The bounding box's upper corner.
    pub high: [f64; 3],
    /// Side of a voxel, scene units.
    pub side: f64,
    /// Number of voxels along x, y, z.
    pub size: [usize; 3],
    /// Whether voxel (i, j, k) is in the mask, at index `i + size[0] · (j + size[1] · k)`: MATLAB's
    /// column-major order.
    pub inside: Vec<bool>,
}

impl VoxelMask {
    /// Whether the voxel nearest to a point is in the mask (`PointCompareMain.m`:
    /// `round((x − low) / side + 1)` as an index that counts from 1). Points outside of the grid are not.
    #[must_use]
    pub fn contains(&self, x_in_world: &[f64; 3]) -> bool {
        let voxel = |axis: usize| {
            let place = ((x_in_world[axis] - self.low[axis]) / self.side + 1.0).round();
            (place >= 1.0 && place <= self.size[axis] as f64).then(|| place as usize - 1)
        };
        let index = || Some(voxel(0)? + self.size[0] * (voxel(1)? + self.size[1] * voxel(2)?));
        index().is_some_and(|index| self.inside[index])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn voxels_are_around_their_centres_in_the_order_of_matlab() {
        let mut inside = vec![false; 24];
        inside[1 + 2 * (2 + 3 * 3)] = true;
        let mask = VoxelMask {
            low: [10.0, 20.0, 30.0],
            high: [11.0, 22.0, 33.0],
            side: 1.0,
            size: [2, 3, 4],
            inside,
        };
        assert!(mask.contains(&[11.0, 22.0, 33.0]));
        assert!(mask.contains(&[10.5, 21.5, 33.49]), "halves are rounded up");
        for outside in [[10.49, 22.0, 33.0], [11.5, 22.0, 33.0], [11.0, 22.0, 33.5], [11.0, 22.0, 32.4]] {
            assert!(!mask.contains(&outside), "{outside:?}");
        }
        assert!(!mask.contains(&[f64::NAN, 22.0, 33.0]));
        assert!(!mask.contains(&[-1e300, 22.0, 33.0]));
    }
}
