//! Where a source view sees a pixel of the reference view, for a given depth.
//!
//! Section 3.1 warps source features onto the fronto-parallel planes of the reference camera by
//! plane-induced homographies. They differ only in the depth, so a pair of views needs one matrix and
//! one vector for all planes.

use nalgebra::{Matrix3, Vector2, Vector3};

use crate::{Pinhole, Pose};

/// The transfer of pixels from a reference view to a source view, for any depth.
///
/// The reference pixel p = (x, y, 1) at depth d projects to the homogeneous source pixel
/// `d · linear · p + offset`, whose third entry is the depth in the source camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PixelTransfer {
    /// `K_source · R · K_reference⁻¹`.
    pub linear: Matrix3<f64>,
    /// `K_source · t`: the epipole, scaled by the depth of the reference camera's centre in the source
    /// camera.
    pub offset: Vector3<f64>,
}

impl PixelTransfer {
    /// The transfer between two cameras.
    #[must_use]
    pub fn new(reference: &Pinhole, source: &Pinhole, source_from_reference: &Pose) -> Self {
        let k_source = source.intrinsics.matrix();
        let rays = inverse_calibration(reference);
        Self {
            linear: k_source * source_from_reference.rotation * rays,
            offset: k_source * source_from_reference.translation,
        }
    }

    /// The source pixel and source depth of a reference pixel at `depth`; `None` if the point is not
    /// in front of the source camera.
    #[must_use]
    pub fn project(&self, pixel: &Vector2<f64>, depth: f64) -> Option<(Vector2<f64>, f64)> {
        let seen = self.linear * pixel.push(1.0) * depth + self.offset;
        (seen.z > 0.0).then(|| (seen.xy() / seen.z, seen.z))
    }

    /// The homography from reference to source pixels that the reference camera's fronto-parallel
    /// plane at `depth` induces.
    ///
    /// This is the H(d) of section 3.1 (MVSNet, Yao et al. 2018, equation 1), written in the reference
    /// camera's frame: `K_s (R + t nᵀ / d) K_r⁻¹` with n the viewing direction, so that `nᵀ K_r⁻¹` is
    /// (0, 0, 1).
    #[must_use]
    pub fn homography(&self, depth: f64) -> Matrix3<f64> {
        let mut homography = self.linear;
        homography.column_mut(2).axpy(1.0 / depth, &self.offset, 1.0);
        homography
    }
}

fn inverse_calibration(camera: &Pinhole) -> Matrix3<f64> {
    let k = camera.intrinsics;
    Matrix3::new(1.0 / k.fx, 0.0, -k.cx / k.fx, 0.0, 1.0 / k.fy, -k.cy / k.fy, 0.0, 0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Intrinsics, Size, lift::lift};

    fn camera(fx: f64) -> Pinhole {
        Pinhole {
            size: Size::new(640, 480),
            intrinsics: Intrinsics { fx, fy: 1.1 * fx, cx: 310.0, cy: 251.5 },
        }
    }

    fn pose(eye: [f64; 3]) -> Pose {
        Pose::look_at(&Vector3::from(eye), &Vector3::new(0.1, 0.2, 5.0), &Vector3::new(0.1, -1.0, 0.0))
    }

    #[test]
    fn warping_a_plane_equals_lifting_moving_and_projecting() {
        let (reference, source) = (camera(520.0), camera(480.0));
        let source_from_reference = pose([1.5, -0.4, 0.3]).compose(&pose([-0.5, 0.1, -0.2]).inverse());
        let transfer = PixelTransfer::new(&reference, &source, &source_from_reference);
        for depth in [0.8, 4.0, 300.0] {
            for pixel in [[0.5, 0.5], [320.0, 240.0], [639.5, 13.25]].map(Vector2::from) {
                let x_in_source = source_from_reference.transform(&lift(&reference, &pixel, depth));
                let expected = source.intrinsics.project(&x_in_source);
                let warped = transfer.homography(depth) * pixel.push(1.0);
                assert!((warped.xy() / warped.z - expected).norm() < 1e-9);
                let (seen, source_depth) = transfer.project(&pixel, depth).unwrap();
                assert!((seen - expected).norm() < 1e-9);
                assert!((source_depth - x_in_source.z).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn what_is_behind_the_source_camera_is_not_seen() {
        let camera = camera(500.0);
        let source_is_ahead =
            Pose { rotation: Matrix3::identity(), translation: Vector3::new(0.0, 0.0, -3.0) };
        let transfer = PixelTransfer::new(&camera, &camera, &source_is_ahead);
        let pixel = Vector2::new(300.0, 200.0);
        assert!(transfer.project(&pixel, 2.0).is_none());
        assert!(transfer.project(&pixel, 3.0).is_none());
        assert!(transfer.project(&pixel, 4.0).is_some());
    }
}
