//! Similarity transforms (rotation, scale and translation), by which two reconstructions of a scene may
//! differ.

use nalgebra::{Matrix3, Matrix4, Vector3};
use serde::{Deserialize, Serialize};

use crate::Pose;
use crate::pose::PoseError;

/// A similarity transform `dst_from_src`: `x_in_dst = s · R · x_in_src + t`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Similarity {
    /// s, positive.
    pub scale: f64,
    /// R, a proper rotation.
    pub rotation: Matrix3<f64>,
    /// t, in units of the destination frame.
    pub translation: Vector3<f64>,
}

impl Similarity {
    /// The identity transform.
    #[must_use]
    pub fn identity() -> Self {
        Self { scale: 1.0, rotation: Matrix3::identity(), translation: Vector3::zeros() }
    }

    /// The transform of a homogeneous 4×4 matrix: `s · R` and `t` in its first three rows.
    ///
    /// # Errors
    /// If an entry is not finite, or the 3×3 part is not a scaled rotation (to 1e-3, as for poses).
    pub fn try_from_matrix(matrix: &Matrix4<f64>) -> Result<Self, PoseError> {
        let scaled: Matrix3<f64> = matrix.fixed_view::<3, 3>(0, 0).into();
        let translation: Vector3<f64> = matrix.fixed_view::<3, 1>(0, 3).into();
        let scale = scaled.determinant().abs().cbrt();
        let Pose { rotation, translation } = Pose::try_new(scaled / scale, translation)?;
        Ok(Self { scale, rotation, translation })
    }

    /// Transforms a point from the source frame to the destination frame.
    #[must_use]
    pub fn transform(&self, x_in_src: &Vector3<f64>) -> Vector3<f64> {
        self.scale * (self.rotation * x_in_src) + self.translation
    }

    /// `dst_from_start`, the product of this `dst_from_src` and `src_from_start`.
    #[must_use]
    pub fn compose(&self, src_from_start: &Self) -> Self {
        Self {
            scale: self.scale * src_from_start.scale,
            rotation: self.rotation * src_from_start.rotation,
            translation: self.transform(&src_from_start.translation),
        }
    }

    /// The least-squares transform from the first to the second points of pairs (Umeyama 1991, eq. 40
    /// to 43); `None` if the first or the second points all coincide.
    #[must_use]
    pub fn fit(pairs: &[(Vector3<f64>, Vector3<f64>)]) -> Option<Self> {
        let count = pairs.len() as f64;
        let (mean_src, mean_dst) = (mean(pairs.iter().map(|p| p.0)), mean(pairs.iter().map(|p| p.1)));
        let (mut covariance, mut variance) = (Matrix3::zeros(), 0.0);
        for (src, dst) in pairs {
            let centred = src - mean_src;
            covariance += (dst - mean_dst) * centred.transpose() / count;
            variance += centred.norm_squared() / count;
        }
        let svd = covariance.svd(true, true);
        let (u, v_t) = (svd.u?, svd.v_t?);
        let mirrored = (u.determinant() * v_t.determinant()).signum();
        let proper = Vector3::new(1.0, 1.0, mirrored);
        let rotation = u * Matrix3::from_diagonal(&proper) * v_t;
        let scale = svd.singular_values.dot(&proper) / variance;
        let translation = mean_dst - scale * (rotation * mean_src);
        (scale.is_finite() && scale > 0.0).then_some(Self { scale, rotation, translation })
    }
}

fn mean(points: impl ExactSizeIterator<Item = Vector3<f64>>) -> Vector3<f64> {
    let count = points.len() as f64;
    points.sum::<Vector3<f64>>() / count
}

#[cfg(test)]
mod tests {
    use super::*;

    fn some() -> Similarity {
        let eye = Vector3::new(1.0, 2.0, -3.0);
        let pose = Pose::look_at(&eye, &Vector3::new(0.2, 0.1, 4.0), &Vector3::z());
        Similarity { scale: 2.5, rotation: pose.rotation, translation: Vector3::new(-40.0, 3.0, 0.5) }
    }

    fn points() -> Vec<Vector3<f64>> {
        (0..20).map(f64::from).map(|i| Vector3::new((1.7 * i).sin(), (0.9 * i).cos(), 0.1 * i)).collect()
    }

    #[test]
    fn fitting_recovers_the_transform_even_of_a_flat_set() {
        let flat: Vec<_> = points().iter().map(|x| Vector3::new(x.x, x.y, 7.0)).collect();
        for set in [points(), flat] {
            let pairs: Vec<_> = set.iter().map(|x| (*x, some().transform(x))).collect();
            let found = Similarity::fit(&pairs).unwrap();
            assert!((found.scale - 2.5).abs() < 1e-12 && (found.rotation - some().rotation).norm() < 1e-12);
            assert!((found.translation - some().translation).norm() < 1e-11);
        }
    }

    #[test]
    fn fitting_never_mirrors_and_needs_points_that_spread() {
        let mirror = |x: &Vector3<f64>| Vector3::new(-x.x, x.y, x.z);
        let pairs: Vec<_> = points().iter().map(|x| (*x, mirror(x))).collect();
        assert!((Similarity::fit(&pairs).unwrap().rotation.determinant() - 1.0).abs() < 1e-12);
        assert_eq!(Similarity::fit(&[(Vector3::zeros(), Vector3::x()); 4]), None);
        assert_eq!(Similarity::fit(&[]), None);
    }

    #[test]
    fn composition_is_one_after_the_other_and_matrices_are_read() {
        let x = Vector3::new(0.3, -0.2, 1.5);
        let twice = some().transform(&some().transform(&x));
        assert!((some().compose(&some()).transform(&x) - twice).norm() < 1e-12);
        let mut matrix = Matrix4::identity();
        matrix.fixed_view_mut::<3, 3>(0, 0).copy_from(&(2.5 * some().rotation));
        matrix.fixed_view_mut::<3, 1>(0, 3).copy_from(&some().translation);
        let read = Similarity::try_from_matrix(&matrix).unwrap();
        assert!((read.transform(&x) - some().transform(&x)).norm() < 1e-12);
        matrix[(0, 0)] += 0.5;
        assert!(matches!(Similarity::try_from_matrix(&matrix), Err(PoseError::NotARotation { .. })));
        assert!(Similarity::try_from_matrix(&Matrix4::zeros()).is_err());
        assert!(Similarity::try_from_matrix(&-Matrix4::identity()).is_err(), "a mirror");
    }
}
