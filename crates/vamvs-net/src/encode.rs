//! Encoding: the features of a photograph at the strides of the image pyramid.

use tch::{Kind, TchError, Tensor};
use vamvs_core::roi::PixelBox;
use vamvs_core::{Grid, Intrinsics, Photo, Pinhole, Pose, Rgb, Size};

use crate::manifest::{FLOW_SCALES, LARGEST_STRIDE};
use crate::native;
use crate::{Device, Iteration, Manifest, NetError, Network};

/// The features of a photograph, with its camera. The network may see the photograph enlarged (see
/// [`Network::enlarge`]); sizes, strides and the camera are then those of the enlarged photograph.
#[derive(Debug)]
pub struct EncodedView {
    /// The factor by which the photograph was enlarged.
    pub(crate) enlarge: usize,
    /// The camera of the enlarged photograph.
    pub camera: Pinhole,
    /// The camera's pose.
    pub cam_from_world: Pose,
    /// Width and height, W and H, after padding on the right and at the bottom (to a multiple of 8 pixels of the
    /// photograph) and enlarging.
    pub(crate) padded: Size,
    /// The stride of the coarse features, s: 8 or 4.
    pub stride: usize,
    /// The coarse features, (1, C, H/s, W/s). If the photograph was enlarged by 2, or the network is a cascade, a second
    /// entry holds the features of the photograph at half of that size, (1, C, H/2s, W/2s).
    pub(crate) coarse: Vec<Tensor>,
    /// The flow features, (1, C₁, H/2, W/2), (1, C₂, H/4, W/4), (1, C₃, H/8, W/8).
    pub(crate) flow: [Tensor; 3],
    /// The padded image reduced to the strides of the flow features.
    pub(crate) photographs: [Grid<Rgb>; 3],
}

impl Network {
    /// The factor by which photographs are enlarged before the network sees them: feature stride / coarse stride.
    #[must_use]
    pub fn enlarge(&self) -> usize {
        self.manifest().feature_stride / self.manifest().coarse_stride
    }

    /// The flow iterations of the manifest, without those at a coarser resolution than the coarse depth map.
    #[must_use]
    pub fn iterations(&self) -> Vec<Iteration> {
        let Manifest { coarse_stride, iterations, .. } = self.manifest();
        iterations.iter().filter(|iteration| iteration.scale <= *coarse_stride).copied().collect()
    }

    /// Encodes a photograph of at least 32×32 pixels.
    ///
    /// # Errors
    /// If the photograph is smaller, the module breaks its contract, or memory runs out.
    pub fn encode(&self, photo: &Photo) -> Result<EncodedView, NetError> {
        self.encode_for(photo, true)
    }

    /// As [`Network::encode`]; without the features that only the flow needs unless `flow`.
    pub(crate) fn encode_for(&self, photo: &Photo, flow: bool) -> Result<EncodedView, NetError> {
        let size = photo.camera.size;
        if size.width < 32 || size.height < 32 {
            return Err(NetError::Request(format!(
                "a photograph of {size} pixels is too small: expected at least 32×32"
            )));
        }
        let enlarge = self.enlarge();
        let image = image_tensor(photo)?.f_to_device(self.device())?;
        let large = enlarged(&image, enlarge)?;
        let mut levels = if flow { self.encode_flow(&large)? } else { self.without_flow(&large)? };
        let runs_layers = self.runs_layers(&levels);
        if runs_layers {
            for level in &mut levels {
                *level = native::channels_last(level)?;
            }
        }
        let mut coarse = vec![match self.shared_level() {
            Some(level) => levels[level].shallow_clone(),
            None => self.encode_coarse(&large)?,
        }];
        if enlarge > 1 {
            coarse.push(self.encode_coarse(&image)?);
        }
        if self.manifest().cascade.is_some() {
            coarse.push(self.encode_halved(&image)?);
        }
        if runs_layers && self.manifest().aggregation.relates_pairs() {
            for features in &mut coarse {
                *features = native::channels_last(features)?;
            }
        }
        let (_, _, height, width) = large.size4()?;
        Ok(EncodedView {
            enlarge,
            camera: photo.camera.resized(Size::new(size.width * enlarge, size.height * enlarge)),
            cam_from_world: photo.cam_from_world,
            padded: Size::new(width as usize, height as usize),
            stride: self.manifest().feature_stride,
            coarse,
            flow: levels,
            photographs: photographs(&large)?,
        })
    }

    /// The coarse features of the padded image (1, 3, H, W) at half its size: (1, C, H/2s, W/2s).
    fn encode_halved(&self, image: &Tensor) -> Result<Tensor, NetError> {
        let small = image.f_avg_pool2d([2, 2], [2, 2], [0, 0], false, true, None)?;
        let (_, _, height, width) = small.size4()?;
        let missing = |side: i64| (side as usize).next_multiple_of(LARGEST_STRIDE) as i64 - side;
        let padded = small.f_replication_pad2d([0, missing(width), 0, missing(height)])?;
        let stride = self.manifest().feature_stride as i64;
        let features = self.encode_coarse(&padded)?;
        Ok(features.f_narrow(2, 0, height / stride)?.f_narrow(3, 0, width / stride)?)
    }

    /// Levels of features as the coarse stage alone needs them: the one that serves both stages, if there is one. The
    /// others have no channels.
    fn without_flow(&self, image: &Tensor) -> Result<[Tensor; 3], NetError> {
        let (_, _, height, width) = image.size4()?;
        let none = |scale: usize| {
            let [height, width] = [height, width].map(|side| side / scale as i64);
            image.f_new_empty([1, 0, height, width], (image.kind(), image.device()))
        };
        let [half, quarter, eighth] = FLOW_SCALES;
        let mut levels = [none(half)?, none(quarter)?, none(eighth)?];
        if let Some(shared) = self.shared_level() {
            levels[shared] = match self.manifest().coarse_alone {
                true => self.encode_coarse(image)?,
                false => self.encode_flow(image)?[shared].shallow_clone(),
            };
        }
        Ok(levels)
    }
}

impl EncodedView {
    /// The part of the view inside `region`, extended outwards to multiples of 8 pixels, and the box of that part.
    /// Both boxes are in pixels of the photograph. The features are shared, not copied.
    ///
    /// # Errors
    /// If the region is empty or outside the image.
    pub fn cropped(&self, region: &PixelBox) -> Result<(Self, PixelBox), NetError> {
        let (view, outer) = self.part(&self.enlarged(region))?;
        let reduced = |at: usize| at / self.enlarge;
        let PixelBox { x0, y0, x1, y1 } = outer;
        Ok((view, PixelBox { x0: reduced(x0), y0: reduced(y0), x1: reduced(x1), y1: reduced(y1) }))
    }

    /// Pixels of the photograph, along a side, for one of the coarse maps.
    #[must_use]
    pub fn coarse_scale(&self) -> usize {
        (self.stride / self.enlarge).max(1)
    }

    /// Converts a region from pixels of the photograph to pixels of the enlarged photograph.
    pub(crate) fn enlarged(&self, region: &PixelBox) -> PixelBox {
        let enlarged = |at: usize| at * self.enlarge;
        let PixelBox { x0, y0, x1, y1 } = *region;
        PixelBox { x0: enlarged(x0), y0: enlarged(y0), x1: enlarged(x1), y1: enlarged(y1) }
    }

    /// As [`EncodedView::cropped`], with both boxes in pixels of the enlarged photograph.
    pub(crate) fn part(&self, region: &PixelBox) -> Result<(Self, PixelBox), NetError> {
        let scale = LARGEST_STRIDE * self.enlarge;
        let outer = PixelBox {
            x0: region.x0 / scale * scale,
            y0: region.y0 / scale * scale,
            x1: region.x1.next_multiple_of(scale).min(self.padded.width),
            y1: region.y1.next_multiple_of(scale).min(self.padded.height),
        };
        if outer.x0 >= outer.x1 || outer.y0 >= outer.y1 {
            return Err(NetError::Request(format!(
                "the region {region:?} is empty or outside the {} image",
                self.camera.size
            )));
        }
        let padded = Size::new(outer.x1 - outer.x0, outer.y1 - outer.y0);
        let part = |features: &Tensor, stride: usize| -> Result<Tensor, TchError> {
            let [x, y, width, height] =
                [outer.x0, outer.y0, padded.width, padded.height].map(|pixels| (pixels / stride) as i64);
            let inside = features.f_narrow(2, y, height)?.f_narrow(3, x, width)?;
            if native::is_channels_last(features)? { native::channels_last(&inside) } else { Ok(inside) }
        };
        let [half, quarter, eighth] = &self.flow;
        let Size { width, height } = self.camera.size;
        let camera =
            self.camera.cropped(PixelBox { x1: outer.x1.min(width), y1: outer.y1.min(height), ..outer });
        let view = Self {
            enlarge: self.enlarge,
            camera,
            cam_from_world: self.cam_from_world,
            padded,
            stride: self.stride,
            coarse: (0..self.coarse.len())
                .map(|level| part(&self.coarse[level], self.stride << level))
                .collect::<Result<_, _>>()?,
            flow: [part(half, 2)?, part(quarter, 4)?, part(eighth, 8)?],
            photographs: std::array::from_fn(|level| {
                self.photographs[level].cropped(outer.reduced(FLOW_SCALES[level]))
            }),
        };
        Ok((view, outer))
    }

    /// Memory of the features and of the reduced photographs, bytes.
    #[must_use]
    pub fn bytes(&self) -> usize {
        // A level of the pyramid that serves both stages is counted once.
        let own = |coarse: &&Tensor| self.flow.iter().all(|level| level.data_ptr() != coarse.data_ptr());
        let values: usize = self.flow.iter().chain(self.coarse.iter().filter(own)).map(Tensor::numel).sum();
        let pixels: usize = self.photographs.iter().map(|photograph| photograph.size().area()).sum();
        values * size_of::<f32>() + pixels * size_of::<Rgb>()
    }

    /// The photograph reduced by `stride`, if that is one of [`FLOW_SCALES`].
    pub(crate) fn photograph(&self, stride: usize) -> Option<&Grid<Rgb>> {
        let level = FLOW_SCALES.iter().position(|scale| *scale == stride)?;
        Some(&self.photographs[level])
    }

    /// Size of the feature map at a stride, padding included.
    pub fn size_at(&self, stride: usize) -> Size {
        Size::new(self.padded.width / stride, self.padded.height / stride)
    }

    /// Intrinsics of the enlarged photograph.
    pub(crate) fn intrinsics(&self) -> Intrinsics {
        self.camera.intrinsics
    }
}

/// The image (1, 3, H, W) in [0, 1] averaged down to 1/2, 1/4 and 1/8, as bytes.
fn photographs(image: &Tensor) -> Result<[Grid<Rgb>; 3], NetError> {
    let mut levels = Vec::new();
    for scale in FLOW_SCALES {
        let side = scale as i64;
        let small = image.f_avg_pool2d([side, side], [side, side], [0, 0], false, true, None)?;
        let (_, _, h, w) = small.size4()?;
        let bytes = small.f_mul_scalar(255.0)?.f_round()?.f_to_kind(Kind::Uint8)?;
        let bytes = bytes.f_squeeze_dim(0)?.f_permute([1, 2, 0])?.f_contiguous()?.f_to_device(Device::Cpu)?;
        let bytes = Vec::<u8>::try_from(bytes.f_flatten(0, -1)?)?;
        let (pixels, _) = bytes.as_chunks::<3>();
        levels.push(Grid::from_vec(Size::new(w as usize, h as usize), pixels.to_vec()));
    }
    Ok(levels.try_into().expect("there are three scales"))
}

/// The image as a tensor (1, 3, H, W) in [0, 1], padded to multiples of 8 by repeating the last column and row.
fn image_tensor(photo: &Photo) -> Result<Tensor, TchError> {
    let Size { width, height } = photo.image.size();
    let bytes = photo.image.data().as_flattened();
    let image = Tensor::f_from_data_size(bytes, &[height as i64, width as i64, 3], Kind::Uint8)?;
    let image = image.f_permute([2, 0, 1])?.f_unsqueeze(0)?.f_to_kind(Kind::Float)?.f_div_scalar(255.0)?;
    let right = width.next_multiple_of(LARGEST_STRIDE) - width;
    let bottom = height.next_multiple_of(LARGEST_STRIDE) - height;
    if right + bottom == 0 {
        return image.f_contiguous();
    }
    image.f_replication_pad2d([0, right as i64, 0, bottom as i64])
}

/// The image enlarged by the factor `times` with bicubic interpolation.
fn enlarged(image: &Tensor, times: usize) -> Result<Tensor, TchError> {
    if times == 1 {
        return Ok(image.shallow_clone());
    }
    let (_, _, height, width) = image.size4()?;
    let size = [height, width].map(|side| side * times as i64);
    image.f_upsample_bicubic2d(size, false, None, None)?.f_clamp(0.0, 1.0)
}
