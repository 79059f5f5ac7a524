//! Rigid transforms from one frame to another.

use nalgebra::{Matrix3, Rotation3, Vector3};
use serde::{Deserialize, Serialize};

/// A rigid transform `dst_from_src`: `x_in_dst = R · x_in_src + t`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Pose {
    /// R, a proper rotation.
    pub rotation: Matrix3<f64>,
    /// t, in units of the destination frame.
    pub translation: Vector3<f64>,
}

/// Why a transform was refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PoseError {
    /// An entry is NaN or infinite.
    #[error("the pose has an entry that is not a finite number")]
    NotFinite,
    /// RᵀR differs from the identity, or R is a reflection.
    #[error(
        "the 3×3 part is not a rotation: RᵀR differs from the identity by {deviation:.3e}, determinant {determinant:.6}"
    )]
    NotARotation {
        /// Largest absolute entry of RᵀR − I.
        deviation: f64,
        /// det R, 1 for a rotation.
        determinant: f64,
    },
}

impl Pose {
    /// The identity transform.
    #[must_use]
    pub fn identity() -> Self {
        Self { rotation: Matrix3::identity(), translation: Vector3::zeros() }
    }

    /// Accepts a matrix that is a rotation to 1e-3 (files store few digits) and replaces it by the
    /// nearest exact rotation.
    ///
    /// # Errors
    /// If an entry is not finite, or the matrix is not a proper rotation.
    pub fn try_new(rotation: Matrix3<f64>, translation: Vector3<f64>) -> Result<Self, PoseError> {
        if !rotation.iter().chain(&translation).all(|v| v.is_finite()) {
            return Err(PoseError::NotFinite);
        }
        let deviation = (rotation.transpose() * rotation - Matrix3::identity()).amax();
        let determinant = rotation.determinant();
        if deviation > 1e-3 || determinant < 0.0 {
            return Err(PoseError::NotARotation { deviation, determinant });
        }
        let svd = rotation.svd(true, true);
        let exact = match (svd.u, svd.v_t) {
            (Some(u), Some(v_t)) => u * v_t,
            _ => rotation,
        };
        Ok(Self { rotation: exact, translation })
    }

    /// The pose `cam_from_world` of a camera at `eye` that looks at `target`; the image's y axis
    /// points away from `up`.
    #[must_use]
    pub fn look_at(eye: &Vector3<f64>, target: &Vector3<f64>, up: &Vector3<f64>) -> Self {
        let z = target - eye;
        let rotation = Rotation3::face_towards(&z, &-up).inverse().into_inner();
        Self { rotation, translation: -(rotation * eye) }
    }

    /// Transforms a point from the source frame to the destination frame.
    #[must_use]
    pub fn transform(&self, x_in_src: &Vector3<f64>) -> Vector3<f64> {
        self.rotation * x_in_src + self.translation
    }

    /// `src_from_dst`.
    #[must_use]
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.transpose();
        Self { rotation, translation: -(rotation * self.translation) }
    }

    /// `c_from_a`, the product of this `c_from_b` and `b_from_a`.
    #[must_use]
    pub fn compose(&self, b_from_a: &Self) -> Self {
        Self {
            rotation: self.rotation * b_from_a.rotation,
            translation: self.transform(&b_from_a.translation),
        }
    }

    /// The origin of the destination frame in the source frame. For a `cam_from_world` it is the
    /// camera's centre in the world.
    #[must_use]
    pub fn centre(&self) -> Vector3<f64> {
        -(self.rotation.transpose() * self.translation)
    }

    /// The destination frame's z axis, a unit vector in the source frame. For a `cam_from_world` it
    /// is the viewing direction.
    #[must_use]
    pub fn forward(&self) -> Vector3<f64> {
        self.rotation.row(2).transpose()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn some_pose() -> Pose {
        Pose::look_at(
            &Vector3::new(1.0, 2.0, -3.0),
            &Vector3::new(0.2, 0.1, 4.0),
            &Vector3::new(0.0, 0.0, 1.0),
        )
    }

    #[test]
    fn look_at_puts_the_target_on_the_axis_and_up_upwards() {
        let (eye, target, up) = (Vector3::new(1.0, 2.0, 3.0), Vector3::new(-1.0, 0.0, 0.5), Vector3::z());
        let cam_from_world = Pose::look_at(&eye, &target, &up);
        let seen = cam_from_world.transform(&target);
        assert!((seen - Vector3::new(0.0, 0.0, (target - eye).norm())).norm() < 1e-12);
        assert!(cam_from_world.transform(&(target + 0.1 * up)).y < 0.0);
        assert!((cam_from_world.centre() - eye).norm() < 1e-12);
        assert!((cam_from_world.rotation.determinant() - 1.0).abs() < 1e-12);
        assert!((cam_from_world.forward() - (target - eye).normalize()).norm() < 1e-12);
    }

    #[test]
    fn inverse_and_composition_agree() {
        let a = some_pose();
        let round = a.compose(&a.inverse());
        assert!((round.rotation - Matrix3::identity()).norm() < 1e-12);
        assert!(round.translation.norm() < 1e-12);
    }

    #[test]
    fn what_is_no_rotation_is_refused() {
        let t = Vector3::zeros();
        assert!(matches!(Pose::try_new(Matrix3::identity() * 2.0, t), Err(PoseError::NotARotation { .. })));
        let mirror = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, -1.0));
        assert!(matches!(Pose::try_new(mirror, t), Err(PoseError::NotARotation { .. })));
        assert_eq!(Pose::try_new(Matrix3::identity() * f64::NAN, t), Err(PoseError::NotFinite));
        assert_eq!(
            Pose::try_new(Matrix3::identity(), Vector3::repeat(f64::INFINITY)),
            Err(PoseError::NotFinite)
        );
        let rounded = some_pose().rotation.map(|v| (v * 1e5).round() / 1e5);
        let pose = Pose::try_new(rounded, t).unwrap();
        assert!((pose.rotation.transpose() * pose.rotation - Matrix3::identity()).amax() < 1e-12);
    }
}
