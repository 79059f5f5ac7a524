//! Thinning a cloud to one point per voxel, as Open3D does for Tanks and Temples.

use rayon::prelude::*;

use crate::cells::{self, Entry, TooFine};

/// The mean of the points in each occupied voxel of `side`, ordered by voxel (z, then y, then x).
/// As in Open3D's `PointCloud::VoxelDownSample`, the voxel grid begins half a side before the
/// cloud's lower corner.
///
/// # Errors
/// If the voxels are too small for the cloud's extent.
pub fn voxel_means(points: &[[f64; 3]], side: f64) -> Result<Vec<[f64; 3]>, TooFine> {
    let entries = cells::sorted(points, side, 0.5 * side)?;
    let mean = |run: &[Entry]| {
        let sum = |axis: usize| run.iter().map(|entry| points[entry.point as usize][axis]).sum::<f64>();
        [0, 1, 2].map(|axis| sum(axis) / run.len() as f64)
    };
    Ok(entries.par_chunk_by(|a, b| a.cell == b.cell).map(mean).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_voxel_becomes_the_mean_of_its_points() {
        // Voxels of side 1 begin at −0.5.
        let points = [[0.0, 0.0, 0.0], [0.4, 0.2, -0.4], [0.6, 0.0, 0.0], [1.4, 0.0, 0.0], [0.0, 0.0, 5.0]];
        let means = voxel_means(&[&points[..], &[[0.0, 0.0, -0.4]]].concat(), 1.0).unwrap();
        let expected = [[0.4 / 3.0, 0.2 / 3.0, -0.8 / 3.0], [1.0, 0.0, 0.0], [0.0, 0.0, 5.0]];
        assert_eq!(means.len(), 3);
        for (mean, expected) in means.iter().zip(expected) {
            assert!((0..3).all(|i| (mean[i] - expected[i]).abs() < 1e-12), "{mean:?}");
        }
    }
}
