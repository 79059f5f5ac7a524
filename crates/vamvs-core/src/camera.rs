//! Calibrated cameras with a lens, and pinhole cameras without distortion.

use nalgebra::{Vector2, Vector3};
use serde::{Deserialize, Serialize};

use crate::face::Face;
use crate::roi::PixelBox;
use crate::{Intrinsics, Lens, Size};

/// A camera as calibrated: image size, intrinsics and lens.
///
/// [`crate::undistort`] turns a photograph and its camera into an undistorted image and a [`Pinhole`]. Depth
/// estimation and fusion take [`Pinhole`]s only, so that a distortion cannot be ignored by accident.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Camera {
    /// The size of the image in pixels.
    pub size: Size,
    /// Focal lengths and principal point.
    pub intrinsics: Intrinsics,
    /// The lens distortion.
    pub lens: Lens,
}

/// A camera without distortion.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Pinhole {
    /// The size of the image in pixels.
    pub size: Size,
    /// Focal lengths and principal point.
    pub intrinsics: Intrinsics,
}

impl Camera {
    /// The camera of the same image resized to `size`.
    #[must_use]
    pub fn resized(&self, size: Size) -> Self {
        Self { size, intrinsics: resized_intrinsics(&self.intrinsics, self.size, size), lens: self.lens }
    }

    /// The size of the photograph's file: that of the image, unless the image is cut out of a larger one.
    #[must_use]
    pub fn photograph_size(&self) -> Size {
        match self.lens {
            Lens::Face(face) => face.of.size(),
            _ => self.size,
        }
    }

    /// The camera of the same photograph resized to `size`.
    #[must_use]
    pub fn of_photograph(&self, size: Size) -> Self {
        let Lens::Face(face) = self.lens else { return self.resized(size) };
        let ratio = size.width as f64 / face.of.size().width as f64;
        let side = |side: usize| (side as f64 * ratio).round().max(1.0) as usize;
        let lens = Lens::Face(Face { of: face.of.resized(size), ..face });
        Self { lens, ..self.resized(Size::new(side(self.size.width), side(self.size.height))) }
    }

    /// Image coordinates of a point in the camera's frame, inside the image or not; `None` behind the camera and
    /// where the lens model folds over.
    #[must_use]
    pub fn project(&self, x_in_cam: &Vector3<f64>) -> Option<Vector2<f64>> {
        if x_in_cam.z <= 0.0 {
            return None;
        }
        let distorted = self.lens.distort(&Vector2::new(x_in_cam.x / x_in_cam.z, x_in_cam.y / x_in_cam.z))?;
        Some(self.intrinsics.project(&distorted.push(1.0)))
    }
}

impl Pinhole {
    /// The camera of the same image resized to `size`.
    #[must_use]
    pub fn resized(&self, size: Size) -> Self {
        Self { size, intrinsics: resized_intrinsics(&self.intrinsics, self.size, size) }
    }

    /// The camera of a part of the image.
    #[must_use]
    pub fn cropped(&self, part: PixelBox) -> Self {
        Self { size: part.size(), intrinsics: self.intrinsics.cropped(part.x0 as f64, part.y0 as f64) }
    }

    /// Image coordinates of a point in the camera's frame; `None` unless it is in front of the camera and inside
    /// the image.
    #[must_use]
    pub fn project_inside(&self, x_in_cam: &Vector3<f64>) -> Option<Vector2<f64>> {
        if x_in_cam.z <= 0.0 {
            return None;
        }
        let pixel = self.intrinsics.project(x_in_cam);
        self.contains(&pixel).then_some(pixel)
    }

    /// Whether image coordinates lie inside `[0, W) × [0, H)`.
    #[must_use]
    pub fn contains(&self, pixel: &Vector2<f64>) -> bool {
        pixel.x >= 0.0
            && pixel.y >= 0.0
            && pixel.x < self.size.width as f64
            && pixel.y < self.size.height as f64
    }
}

impl From<Pinhole> for Camera {
    fn from(pinhole: Pinhole) -> Self {
        Self { size: pinhole.size, intrinsics: pinhole.intrinsics, lens: Lens::None }
    }
}

fn resized_intrinsics(intrinsics: &Intrinsics, from: Size, to: Size) -> Intrinsics {
    intrinsics.scaled(to.width as f64 / from.width as f64, to.height as f64 / from.height as f64)
}
