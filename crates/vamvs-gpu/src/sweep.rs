//! The plane sweep.

use vamvs_core::homography::PixelTransfer;
use vamvs_core::{Pinhole, Planes, Pose, Size};
use vamvs_corr::layers::{GROUPS, PlaneDepth};
use wgpu::Buffer;

use crate::map::Map;
use crate::recorder::{Recorder, Words};
use crate::{EncodedView, GpuError};

/// Vectors of four channels of a cell of a volume.
const CELL: usize = GROUPS / 4;

/// A camera whose photograph has features.
#[derive(Clone, Copy)]
pub struct Placed<'a> {
    pub features: &'a Map,
    camera: &'a Pinhole,
    cam_from_world: Pose,
    padded: Size,
}

impl EncodedView {
    pub(crate) fn at_full(&self) -> Placed<'_> {
        self.placed(&self.fine)
    }

    pub(crate) fn at_half(&self) -> Placed<'_> {
        self.placed(&self.coarse)
    }

    fn placed<'a>(&'a self, features: &'a Map) -> Placed<'a> {
        let Self { camera, cam_from_world, padded, .. } = self;
        Placed { features, camera, cam_from_world: *cam_from_world, padded: *padded }
    }
}

/// A sweep of one reference view.
pub struct Sweep<'a> {
    reference: Placed<'a>,
    planes: &'a Planes,
    /// Depths in planes, planes around each of them, and how far apart; `None`: all planes.
    around: Option<(&'a Buffer, usize, f32)>,
}

impl<'a> Sweep<'a> {
    /// All planes.
    pub fn all(reference: Placed<'a>, planes: &'a Planes) -> Self {
        Self { reference, planes, around: None }
    }

    /// So many planes, so many plane distances apart, around depths in planes, (h, w).
    pub fn around(reference: Placed<'a>, planes: &'a Planes, around: (&'a Buffer, usize, f32)) -> Self {
        Self { reference, planes, around: Some(around) }
    }

    fn count(&self) -> usize {
        self.around.map_or(self.planes.count, |(_, count, _)| count)
    }

    /// The parameters of a source view, whose shares begin at `first`; it is the first to be written, or added.
    fn words(&self, source: Placed<'_>, (first, adds): (usize, bool)) -> Words {
        let between = source.cam_from_world.compose(&self.reference.cam_from_world.inverse());
        let PixelTransfer { linear, offset, .. } =
            PixelTransfer::new(self.reference.camera, source.camera, &between);
        let [_, height, width] = self.reference.features.sides;
        let [_, source_height, source_width] = source.features.sides;
        let depth = PlaneDepth::new(self.planes);
        let near = self.planes.range.near;
        let column = |words: Words, column: usize| {
            words.numbers(&[0, 1, 2].map(|row| linear[(row, column)] as f32)).number(0.0)
        };
        (0..3)
            .fold(Words::new(), column)
            .numbers(&[0, 1, 2].map(|row| (offset[row] / near) as f32))
            .number((self.reference.padded.width / width) as f32)
            .number(source_width as f32 / source.padded.width as f32)
            .number(source_height as f32 / source.padded.height as f32)
            .counts(&[height, width, source_height, source_width, self.count()])
            .flag(depth.is_inverse)
            .numbers(&[depth.slope, depth.least, self.around.map_or(1.0, |(_, _, step)| step)])
            .count(first)
            .flag(adds)
            .flag(self.around.is_some())
    }

    /// A source view's largest and mean correlation of each group over all planes.
    pub fn pooled(&self, to: &mut Recorder<'_>, source: Placed<'_>) -> Result<Map, GpuError> {
        let [_, height, width] = self.reference.features.sides;
        let pooled = Map::new(to.gpu, [1, height, width], 2 * CELL)?;
        let words = self.words(source, (0, false));
        let buffers = [&self.reference.features.buffer, &source.features.buffer, &pooled.buffer];
        to.run(&to.gpu.kernels.pool, words, &buffers, [width, height, 1]);
        Ok(pooled)
    }

    /// The mean over the source views of their correlations, each weighed by its mask; these are one after the other.
    pub fn volume(
        &self,
        to: &mut Recorder<'_>,
        sources: &[Placed<'_>],
        masks: &Buffer,
    ) -> Result<Map, GpuError> {
        let [_, height, width] = self.reference.features.sides;
        let area = height * width;
        let volume = Map::new(to.gpu, [self.count(), height, width], CELL)?;
        let shares = to.gpu.buffer(4 * area * sources.len())?;
        let words = Words::new().counts(&[area, sources.len()]);
        to.run(&to.gpu.kernels.shares, words, &[masks, &shares], [area, 1, 1]);
        let around = self.around.map_or(&shares, |(depths, ..)| depths);
        for (number, source) in sources.iter().enumerate() {
            let words = self.words(*source, (number * area, number > 0));
            let [reference, source] = [self.reference.features, source.features].map(|map| &map.buffer);
            let buffers = [reference, source, &shares, around, &volume.buffer];
            to.run(&to.gpu.kernels.weigh, words, &buffers, [width, height, self.count()]);
        }
        Ok(volume)
    }
}
