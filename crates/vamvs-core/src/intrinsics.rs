//! The intrinsics of a camera: focal lengths and principal point.

use nalgebra::{Matrix3, Vector2, Vector3};
use serde::{Deserialize, Serialize};

/// Focal lengths and principal point in pixels, in the pixel-centre convention of the crate.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Intrinsics {
    /// Focal length along x, pixels.
    pub fx: f64,
    /// Focal length along y, pixels.
    pub fy: f64,
    /// Principal point x, pixels from the image's left border.
    pub cx: f64,
    /// Principal point y, pixels from the image's top border.
    pub cy: f64,
}

/// Why a calibration matrix was refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum IntrinsicsError {
    /// A focal length is zero, negative or not finite, or the principal point is not finite.
    #[error(
        "focal lengths must be positive and finite and the principal point finite, got fx {fx}, fy {fy}, cx {cx}, cy {cy}"
    )]
    NotACamera {
        /// As given.
        fx: f64,
        /// As given.
        fy: f64,
        /// As given.
        cx: f64,
        /// As given.
        cy: f64,
    },
    /// The matrix has skew or entries below the diagonal.
    #[error("expected a calibration matrix [fx 0 cx; 0 fy cy; 0 0 1], got [{}]: write it row by row, without skew", rows(.0))]
    NotUpperTriangular(Matrix3<f64>),
}

/// The rows of a matrix on one line.
fn rows(matrix: &Matrix3<f64>) -> String {
    let row = |row: usize| format!("{} {} {}", matrix[(row, 0)], matrix[(row, 1)], matrix[(row, 2)]);
    (0..3).map(row).collect::<Vec<_>>().join("; ")
}

impl Intrinsics {
    /// Checks that the focal lengths are positive and all four numbers finite.
    ///
    /// # Errors
    /// If a focal length is not positive and finite, or the principal point is not finite.
    pub fn try_new(fx: f64, fy: f64, cx: f64, cy: f64) -> Result<Self, IntrinsicsError> {
        let positive = |f: f64| f.is_finite() && f > 0.0;
        if positive(fx) && positive(fy) && cx.is_finite() && cy.is_finite() {
            Ok(Self { fx, fy, cx, cy })
        } else {
            Err(IntrinsicsError::NotACamera { fx, fy, cx, cy })
        }
    }

    /// Intrinsics of a calibration matrix, which is divided by its last entry first. Skew and lower
    /// entries must be negligible (at most 1e-3 of the focal length).
    ///
    /// # Errors
    /// If the matrix is singular, not finite or not of the form `[fx 0 cx; 0 fy cy; 0 0 1]`.
    pub fn try_from_matrix(k: &Matrix3<f64>) -> Result<Self, IntrinsicsError> {
        let given = *k;
        let k = k / k[(2, 2)];
        let negligible = 1e-3 * k[(0, 0)].abs();
        let lower = [k[(0, 1)], k[(1, 0)], k[(2, 0)], k[(2, 1)]];
        if lower.iter().any(|v| v.is_nan() || v.abs() > negligible) {
            return Err(IntrinsicsError::NotUpperTriangular(given));
        }
        Self::try_new(k[(0, 0)], k[(1, 1)], k[(0, 2)], k[(1, 2)])
    }

    /// The calibration matrix K.
    #[must_use]
    pub fn matrix(&self) -> Matrix3<f64> {
        Matrix3::new(self.fx, 0.0, self.cx, 0.0, self.fy, self.cy, 0.0, 0.0, 1.0)
    }

    /// The intrinsics of the image resized by the factors `sx` and `sy`.
    #[must_use]
    pub fn scaled(&self, sx: f64, sy: f64) -> Self {
        Self { fx: self.fx * sx, fy: self.fy * sy, cx: self.cx * sx, cy: self.cy * sy }
    }

    /// The intrinsics of the part of the image that begins at `(x0, y0)`.
    #[must_use]
    pub fn cropped(&self, x0: f64, y0: f64) -> Self {
        Self { cx: self.cx - x0, cy: self.cy - y0, ..*self }
    }

    /// Image coordinates of a point in the camera's frame (z must not be 0).
    #[must_use]
    pub fn project(&self, x_in_cam: &Vector3<f64>) -> Vector2<f64> {
        let inverse_z = 1.0 / x_in_cam.z;
        Vector2::new(self.fx * x_in_cam.x * inverse_z + self.cx, self.fy * x_in_cam.y * inverse_z + self.cy)
    }

    /// The point at depth 1 on the ray through image coordinates `pixel`.
    #[must_use]
    pub fn ray(&self, pixel: &Vector2<f64>) -> Vector3<f64> {
        Vector3::new((pixel.x - self.cx) / self.fx, (pixel.y - self.cy) / self.fy, 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const K: Intrinsics = Intrinsics { fx: 500.0, fy: 510.0, cx: 320.5, cy: 241.0 };

    #[test]
    fn projection_undoes_the_ray() {
        let pixel = Vector2::new(12.5, 400.25);
        let back = K.project(&(K.ray(&pixel) * 7.0));
        assert!((back - pixel).norm() < 1e-12);
    }

    #[test]
    fn scaling_and_cropping_move_projections_like_the_image() {
        let point = Vector3::new(0.3, -0.2, 2.0);
        let pixel = K.project(&point);
        let scaled = K.scaled(0.5, 0.25).project(&point);
        assert!((scaled - Vector2::new(pixel.x * 0.5, pixel.y * 0.25)).norm() < 1e-12);
        let cropped = K.cropped(10.0, 20.0).project(&point);
        assert!((cropped - (pixel - Vector2::new(10.0, 20.0))).norm() < 1e-12);
    }

    #[test]
    fn singular_and_skewed_matrices_are_refused() {
        assert!(Intrinsics::try_from_matrix(&Matrix3::zeros()).is_err());
        let mut skewed = K.matrix();
        skewed[(0, 1)] = 5.0;
        assert!(Intrinsics::try_from_matrix(&skewed).is_err());
        assert_eq!(Intrinsics::try_from_matrix(&(K.matrix() * 2.0)), Ok(K));
        assert!(Intrinsics::try_new(f64::NAN, 1.0, 0.0, 0.0).is_err());
        assert!(Intrinsics::try_new(0.0, 1.0, 0.0, 0.0).is_err());
    }
}
