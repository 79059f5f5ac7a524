//! A reference view and a source view: pixels are projected from one to the other and back.

use nalgebra::{Matrix3, Vector3};
use vamvs_core::homography::PixelTransfer;

use crate::FuseOptions;
use crate::photometric::{FilteredView, focal};

/// A reference view and a source view.
///
/// The transfers hold no world coordinates, so single precision is enough wherever the scene lies.
pub(crate) struct Pair<'a> {
    /// The source view's number.
    pub source_view: usize,
    pub source: &'a FilteredView,
    /// The source camera's centre in the reference camera's frame.
    pub source_centre: Vector3<f32>,
    pub to_source: Transfer,
    pub to_reference: Transfer,
    /// Largest reprojection error, pixels.
    pub max_reprojection: f32,
    /// Largest relative difference of the depth that is projected back.
    pub max_relative_depth: f32,
    /// 1 over the source's focal length in pixels.
    pub radians_per_pixel: f32,
}

/// [`PixelTransfer`] in single precision and for inverse depths: the homogeneous pixel in the other view,
/// divided by the depth in this one, is `linear · pixel + offset · inverse depth`.
pub(crate) struct Transfer {
    pub linear: Matrix3<f32>,
    pub offset: Vector3<f32>,
}

impl From<PixelTransfer> for Transfer {
    fn from(transfer: PixelTransfer) -> Self {
        Self { linear: transfer.linear.cast(), offset: transfer.offset.cast() }
    }
}

impl<'a> Pair<'a> {
    pub fn new(
        reference: &FilteredView,
        source_view: usize,
        source: &'a FilteredView,
        options: &FuseOptions,
    ) -> Self {
        let reference_from_source = reference.cam_from_world.compose(&source.cam_from_world.inverse());
        let source_from_reference = reference_from_source.inverse();
        let (own, other) = (&reference.camera, &source.camera);
        Self {
            source_view,
            source,
            to_source: PixelTransfer::new(own, other, &source_from_reference).into(),
            to_reference: PixelTransfer::new(other, own, &reference_from_source).into(),
            source_centre: reference_from_source.translation.cast(),
            max_reprojection: options.max_reprojection,
            max_relative_depth: options.max_relative_depth,
            radians_per_pixel: focal(&source.camera).recip() as f32,
        }
    }
}
