//! Projection of reference pixels at given depths into the feature maps of a source view.

use tch::{TchError, Tensor};
use vamvs_core::homography::PixelTransfer;
use vamvs_core::{Pinhole, Size};

use crate::{Device, EncodedView};

/// A grid coordinate far outside [-1, 1], where zero padding is sampled only.
const OUTSIDE: f64 = -10.0;

/// A point whose depth in a camera is below this counts as behind it; in units of the nearest depth searched.
pub(crate) const BEHIND: f64 = 1e-3;

/// A regular grid of pixels of the reference view, in coordinates of the image that the network sees.
#[derive(Clone, Debug)]
pub struct PixelGrid {
    /// Image x of each column's pixel centre.
    pub x: Vec<f64>,
    /// Image y of each row's pixel centre.
    pub y: Vec<f64>,
}

impl PixelGrid {
    /// The pixels `x0, x0 + step, …` and `y0, y0 + step, …` below `end` of the image reduced by `scale`.
    #[must_use]
    pub fn new(scale: usize, (x0, y0): (usize, usize), step: usize, end: Size) -> Self {
        let centres = |first: usize, end: usize| {
            (first..end).step_by(step).map(|i| (i as f64 + 0.5) * scale as f64).collect()
        };
        Self { x: centres(x0, end.width), y: centres(y0, end.height) }
    }

    /// Columns and rows.
    #[must_use]
    pub fn size(&self) -> Size {
        Size::new(self.x.len(), self.y.len())
    }

    /// The grid moved by so many pixels to the left and to the top.
    #[must_use]
    pub(crate) fn moved(mut self, offset: f64) -> Self {
        self.x.iter_mut().chain(&mut self.y).for_each(|centre| *centre -= offset);
        self
    }

    /// The rows `first..end`.
    #[must_use]
    pub fn rows(&self, first: usize, end: usize) -> Self {
        Self { x: self.x.clone(), y: self.y[first..end].to_vec() }
    }

    /// `matrix · (x, y, 1)` for each pixel: (1, 3, h·w), row by row.
    fn mapped(&self, matrix: &nalgebra::Matrix3<f64>, device: Device) -> Result<Tensor, TchError> {
        let mut values = Vec::with_capacity(3 * self.x.len() * self.y.len());
        for row in matrix.row_iter() {
            for y in &self.y {
                values.extend(self.x.iter().map(|x| (row[0] * x + row[1] * y + row[2]) as f32));
            }
        }
        Tensor::f_from_slice(&values)?.f_view([1, 3, -1])?.f_to_device(device)
    }

    /// The points at depth 1 on the pixels' rays, in the camera's frame: (1, 3, h·w).
    ///
    /// # Errors
    /// If memory runs out.
    pub fn rays(&self, camera: &Pinhole, device: Device) -> Result<Tensor, TchError> {
        let k = camera.intrinsics;
        let inverse = nalgebra::Matrix3::new(
            1.0 / k.fx,
            0.0,
            -k.cx / k.fx, //
            0.0,
            1.0 / k.fy,
            -k.cy / k.fy, //
            0.0,
            0.0,
            1.0,
        );
        self.mapped(&inverse, device)
    }

    /// The grid at which the reference view's own feature maps are sampled at these pixels: (1, h, w, 2) in [-1, 1].
    ///
    /// # Errors
    /// If memory runs out.
    pub fn grid(&self, view: &EncodedView, device: Device) -> Result<Tensor, TchError> {
        let Size { width, height } = self.size();
        let mut values = Vec::with_capacity(2 * width * height);
        for y in &self.y {
            for x in &self.x {
                values.push((2.0 * x / view.padded.width as f64 - 1.0) as f32);
                values.push((2.0 * y / view.padded.height as f64 - 1.0) as f32);
            }
        }
        Tensor::f_from_slice(&values)?.f_view([1, height as i64, width as i64, 2])?.f_to_device(device)
    }
}

/// The projection of a grid's pixels into one source view, for any depths: a pixel at depth d is at the homogeneous
/// source pixel d · linear + offset.
#[derive(Debug)]
pub struct Projection {
    /// (1, 3, h·w)
    linear: Tensor,
    /// (1, 3, 1), in units of the nearest depth searched.
    offset: Tensor,
    pixel_grid: Size,
    /// Size of the padded source image.
    source: Size,
    /// See [`BEHIND`].
    epsilon: f64,
}

impl Projection {
    /// The projection from `reference` into `source`; `near` is the nearest depth searched.
    ///
    /// # Errors
    /// If memory runs out.
    pub fn new(
        pixel_grid: &PixelGrid,
        reference: &EncodedView,
        source: &EncodedView,
        near: f64,
    ) -> Result<Self, TchError> {
        let device = source.flow[0].device();
        let source_from_reference = source.cam_from_world.compose(&reference.cam_from_world.inverse());
        let transfer = PixelTransfer::new(&reference.camera, &source.camera, &source_from_reference);
        // Depths are in units of `near`, so that single precision suffices for scenes of any scale.
        let offset = (transfer.offset / near).map(|value| value as f32);
        Ok(Self {
            linear: pixel_grid.mapped(&transfer.linear, device)?,
            offset: Tensor::f_from_slice(offset.as_slice())?.f_view([1, 3, 1])?.f_to_device(device)?,
            pixel_grid: pixel_grid.size(),
            source: source.padded,
            epsilon: BEHIND,
        })
    }

    /// The grid (B, h, w, 2) at which the source view's feature maps, of any stride, are sampled for depths (B, 1)
    /// or (B, h·w) in units of `near`.
    ///
    /// # Errors
    /// If memory runs out.
    pub fn grid(&self, depth: &Tensor) -> Result<Tensor, TchError> {
        let seen = depth.f_unsqueeze(1)?.f_mul(&self.linear)?.f_add(&self.offset)?; // (B, 3, h·w)
        let z = seen.f_select(1, 2)?;
        let inverse_z = z.f_clamp_min(self.epsilon)?.f_reciprocal()?;
        let behind = z.f_le(self.epsilon)?;
        let axis = |index: i64, length: usize| -> Result<Tensor, TchError> {
            let pixel = seen.f_select(1, index)?.f_mul(&inverse_z)?;
            let unit = pixel.f_mul_scalar(2.0 / length as f64)?.f_sub_scalar(1.0)?;
            unit.f_masked_fill(&behind, OUTSIDE)
        };
        let grid = Tensor::f_stack(&[axis(0, self.source.width)?, axis(1, self.source.height)?], -1)?;
        grid.f_view([-1, self.pixel_grid.height as i64, self.pixel_grid.width as i64, 2])
    }
}

/// The values outside a feature map; the discriminants are those of libtorch's `grid_sampler`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outside {
    /// Zero: for a source view, which does not see what is outside.
    Zero = 0,
    /// The border value: for the reference view's own pixels near its border.
    Border = 1,
}

/// Samples features (1, C, H, W) bilinearly at a grid (B, h, w, 2) in [-1, 1] → (B, C, h, w).
///
/// # Errors
/// If memory runs out.
pub fn sample(features: &Tensor, grid: &Tensor, outside: Outside) -> Result<Tensor, TchError> {
    const BILINEAR: i64 = 0;
    let batch = grid.size()[0];
    features.f_expand([batch, -1, -1, -1], false)?.f_grid_sampler_2d(grid, BILINEAR, outside as i64, false)
}

/// A sampling grid (B, h, w, 2) for features of an image of `padded` pixels that lie `offset` pixels to the left and to the
/// top of the centres of the pixels that they cover.
pub(crate) fn for_offset(grid: &Tensor, offset: f64, padded: Size) -> Result<Tensor, TchError> {
    if offset == 0.0 {
        return Ok(grid.shallow_clone());
    }
    let shift = [padded.width, padded.height].map(|side| (2.0 * offset / side as f64) as f32);
    grid.f_add(&Tensor::f_from_slice(&shift)?.f_to_device(grid.device())?)
}

/// A map (1, C, h, w) whose entries lie `cells` of their distances, less than 1, to the left and to the top of the
/// centres of their cells, interpolated at these centres.
pub(crate) fn centred(map: Tensor, cells: f64) -> Result<Tensor, TchError> {
    if cells == 0.0 {
        return Ok(map);
    }
    let between = |map: &Tensor, axis: i64| {
        let length = map.size()[axis as usize];
        let last = map.f_narrow(axis, length - 1, 1)?;
        let next = Tensor::f_cat(&[&map.f_narrow(axis, 1, length - 1)?, &last], axis)?;
        map.f_lerp(&next, cells)
    };
    between(&between(&map, 2)?, 3)
}

/// The depths of plane coordinates `u`, in units of the range's near end. Outside the range they are clamped, so that
/// they stay positive and finite.
///
/// # Errors
/// If memory runs out.
pub fn depth_of(planes: &vamvs_core::Planes, u: &Tensor) -> Result<Tensor, TchError> {
    use vamvs_core::Spacing;
    let last = (planes.count - 1) as f64;
    let ratio = planes.range.far / planes.range.near;
    match planes.spacing {
        Spacing::Depth => u.f_mul_scalar((ratio - 1.0) / last)?.f_add_scalar(1.0)?.f_clamp_min(0.25),
        Spacing::InverseDepth => {
            let inverse = u.f_mul_scalar((1.0 / ratio - 1.0) / last)?.f_add_scalar(1.0)?;
            inverse.f_clamp_min(0.25 / ratio)?.f_reciprocal()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Vector2, Vector3};
    use tch::Kind;
    use vamvs_core::{DepthRange, Grid, Intrinsics, Planes, Pose, Spacing};

    const CPU: (Kind, Device) = (Kind::Float, Device::Cpu);

    fn view(eye: Vector3<f64>) -> EncodedView {
        let size = Size::new(317, 236);
        let feature = || Tensor::zeros([1, 1, 30, 40], CPU);
        EncodedView {
            enlarge: 1,
            camera: Pinhole { size, intrinsics: Intrinsics { fx: 300.0, fy: 310.0, cx: 160.2, cy: 117.9 } },
            cam_from_world: Pose::look_at(&eye, &Vector3::new(0.1, 0.0, 5.0), &Vector3::new(0.0, -1.0, 0.2)),
            padded: Size::new(320, 240),
            stride: 8,
            coarse: vec![feature()],
            flow: [feature(), feature(), feature()],
            photographs: [2, 4, 8].map(|scale| Grid::filled(Size::new(320 / scale, 240 / scale), [0; 3])),
        }
    }

    #[test]
    fn a_warped_plane_is_where_the_homography_puts_it() {
        let (reference, source) = (view(Vector3::zeros()), view(Vector3::new(0.7, -0.2, 0.1)));
        let source_from_reference = source.cam_from_world.compose(&reference.cam_from_world.inverse());
        let transfer = PixelTransfer::new(&reference.camera, &source.camera, &source_from_reference);
        let pixel_grid = PixelGrid::new(8, (0, 0), 1, Size::new(40, 30));
        let projection = Projection::new(&pixel_grid, &reference, &source, 2.0).unwrap();
        for depth in [2.0, 3.7, 11.0] {
            let grid = projection.grid(&Tensor::from_slice(&[(depth / 2.0) as f32]).view([1, 1])).unwrap();
            for (row, column) in [(0, 0), (29, 39), (13, 21)] {
                let pixel = Vector2::new(pixel_grid.x[column], pixel_grid.y[row]);
                let (expected, _) = transfer.project(&pixel, depth).unwrap();
                let at = |axis: i64, side: f64| {
                    0.5 * side * (grid.double_value(&[0, row as i64, column as i64, axis]) + 1.0)
                };
                let error = (Vector2::new(at(0, 320.0), at(1, 240.0)) - expected).amax();
                assert!(error < 1e-4, "{error} pixels off at depth {depth}");
            }
        }
    }

    #[test]
    fn sampling_at_the_own_pixels_gives_the_features_at_every_stride() {
        let mut reference = view(Vector3::zeros());
        reference.coarse = vec![Tensor::randn([1, 2, 30, 40], CPU)];
        let grid = PixelGrid::new(8, (0, 0), 1, Size::new(40, 30)).grid(&reference, Device::Cpu).unwrap();
        assert!(sample(&reference.coarse[0], &grid, Outside::Zero).unwrap().allclose(
            &reference.coarse[0],
            1e-4,
            1e-4,
            false
        ));
        // A linear ramp sampled at another stride's pixel centres gives those centres.
        let ramp = (Tensor::arange(160, CPU) + 0.5) * 2.0;
        let ramp = ramp.view([1, 1, 1, 160]).expand([1, 1, 120, 160], false);
        let sampled = sample(&ramp, &grid, Outside::Zero).unwrap();
        assert!((sampled.double_value(&[0, 0, 4, 7]) - 60.0).abs() < 1e-3);
    }

    #[test]
    fn features_beside_the_centres_of_their_cells_are_found_where_they_are() {
        let (reference, source) = (view(Vector3::zeros()), view(Vector3::new(0.7, -0.2, 0.1)));
        // Features at 8 i + 0.5 that tell their x and y.
        let at = |count: i64| Tensor::arange(count, CPU) * 8.0 + 0.5;
        let x = at(40).view([1, 1, 1, 40]).expand([1, 1, 30, 40], false);
        let y = at(30).view([1, 1, 30, 1]).expand([1, 1, 30, 40], false);
        let features = Tensor::cat(&[x, y], 1);
        let pixel_grid = PixelGrid::new(8, (0, 0), 1, Size::new(40, 30)).moved(3.5);
        assert!((pixel_grid.x[2] - 16.5).abs() < 1e-12 && (pixel_grid.y[0] - 0.5).abs() < 1e-12);
        let transfer = PixelTransfer::new(
            &reference.camera,
            &source.camera,
            &source.cam_from_world.compose(&reference.cam_from_world.inverse()),
        );
        let projection = Projection::new(&pixel_grid, &reference, &source, 2.0).unwrap();
        let grid = projection.grid(&Tensor::from_slice(&[2.5_f32]).view([1, 1])).unwrap();
        let grid = for_offset(&grid, 3.5, source.padded).unwrap();
        let found = sample(&features, &grid, Outside::Border).unwrap();
        let pixel = Vector2::new(pixel_grid.x[21], pixel_grid.y[13]);
        let (expected, _) = transfer.project(&pixel, 5.0).unwrap();
        for axis in 0..2 {
            let error = found.double_value(&[0, axis, 13, 21]) - expected[axis as usize];
            assert!(error.abs() < 1e-3, "{error} pixels off");
        }
        let centres = centred(features, 3.5 / 8.0).unwrap();
        assert!((centres.double_value(&[0, 0, 4, 7]) - 60.0).abs() < 1e-4);
        assert!((centres.double_value(&[0, 1, 4, 7]) - 36.0).abs() < 1e-4);
    }

    #[test]
    fn points_behind_the_source_are_outside() {
        let (reference, source) = (view(Vector3::zeros()), view(Vector3::new(0.0, 0.0, 4.0)));
        let pixel_grid = PixelGrid::new(8, (0, 0), 1, Size::new(40, 30));
        let projection = Projection::new(&pixel_grid, &reference, &source, 1.0).unwrap();
        let grid = projection.grid(&Tensor::from_slice(&[2.0_f32]).view([1, 1])).unwrap();
        assert!(grid.max().double_value(&[]) < -5.0);
        let ones = Tensor::ones([1, 1, 30, 40], CPU);
        assert!(sample(&ones, &grid, Outside::Zero).unwrap().abs().max().double_value(&[]) == 0.0);
    }

    #[test]
    fn depths_of_plane_coordinates_are_those_of_core() {
        for spacing in [Spacing::Depth, Spacing::InverseDepth] {
            let planes = Planes { range: DepthRange { near: 3.0, far: 17.0 }, count: 33, spacing };
            let u = [0.0_f32, 1.5, 20.25, 32.0];
            let depth = depth_of(&planes, &Tensor::from_slice(&u)).unwrap() * planes.range.near;
            for (index, u) in u.iter().enumerate() {
                let expected = planes.depth(f64::from(*u));
                assert!((depth.double_value(&[index as i64]) - expected).abs() < 1e-5 * expected);
            }
            // Far outside the range depths stay positive and finite.
            let wild = depth_of(&planes, &Tensor::from_slice(&[-500.0_f32, 500.0])).unwrap();
            assert!(wild.min().double_value(&[]) > 0.0 && wild.max().double_value(&[]).is_finite());
        }
    }
}
