//! Refinement's matching of planes on a GPU.

use std::sync::Arc;

use vamvs_core::{Grid, Size};
use vamvs_refine::RefineOptions;
use vamvs_refine::matching::{
    Device, DeviceError, Guesses, Matched, Matching, Projection, SourceView, Start,
};
use wgpu::Buffer;

use crate::kernels::Kernel;
use crate::matching_kernels::MatchingKernels;
use crate::recorder::{MOST_OPERATIONS, Recorder, Words};
use crate::{Gpu, GpuError};

/// Words of a state, and of a source view.
const STATE: usize = 8;
const SOURCE: usize = 40;

/// The energy of an impossible plane in the kernels, which know no infinity.
pub const IMPOSSIBLE: f32 = 1e30;

/// About the operations of a plane in a source view at a pixel, and the planes that a pixel tries in a kernel, most of them in two
/// source views alone.
const OF_PLANE: u64 = 1500;
const PLANES: u64 = 2;

impl Device for Gpu {
    fn planes(&self, matching: &Matching<'_>) -> Result<Vec<Matched>, DeviceError> {
        Ok(self.checked(|| self.matched(matching))?)
    }
}

impl From<GpuError> for DeviceError {
    fn from(error: GpuError) -> Self {
        match error {
            GpuError::Memory { .. } => Self::Memory(error.to_string()),
            _ => Self::Failed(error.to_string()),
        }
    }
}

impl Gpu {
    fn matched(&self, matching: &Matching<'_>) -> Result<Vec<Matched>, GpuError> {
        let kernels = self.matching_kernels(matching.options().views.min(vamvs_refine::MOST_SOURCES));
        let start = matching.begin();
        let work = Work::new(self, matching, &start)?;
        let mut to = Recorder::new(self);
        match start {
            Start::Search { sweeps } => {
                work.run(&mut to, &kernels.search, None);
                for _ in 0..sweeps {
                    work.run(&mut to, &kernels.sweep, Some(0));
                    work.run(&mut to, &kernels.sweep, Some(1));
                }
            }
            Start::Planes { .. } => {
                work.run(&mut to, &kernels.begin_second, Some(1));
                work.run(&mut to, &kernels.begin_first, Some(0));
                work.run(&mut to, &kernels.begin_again, Some(1));
            }
        }
        to.submit();
        self.download_as(&work.field, |words| words.chunks_exact(STATE).map(matched).collect())
    }

    /// The kernels for a number of views, which are made once.
    fn matching_kernels(&self, views: usize) -> Arc<MatchingKernels> {
        let mut made = self.matching.lock().expect("no thread fails while it holds this lock");
        let make = || Arc::new(MatchingKernels::new(&self.device, views));
        Arc::clone(made.entry(views).or_insert_with(make))
    }
}

/// A pixel's state as the kernels write it.
fn matched(words: &[f32]) -> Matched {
    let energy = if words[3] < IMPOSSIBLE { words[3] } else { f32::INFINITY };
    Matched {
        plane: [words[0], words[1], words[2]],
        energy,
        correlation: words[4],
        variance: words[5],
        best: words[6].to_bits() as u16,
        settled: words[7].to_bits() != 0,
    }
}

/// All that the kernels read and write.
struct Work {
    parameters: Parameters,
    image: Buffer,
    sources: Buffer,
    quads: Buffer,
    visibilities: Buffer,
    depths: Buffer,
    guesses: Buffer,
    field: Buffer,
    /// The planes to begin with.
    planes: Option<Buffer>,
}

impl Work {
    fn new(gpu: &Gpu, matching: &Matching<'_>, start: &Start) -> Result<Self, GpuError> {
        let (mut sources, mut lists) = (Vec::new(), Lists::default());
        for source in matching.sources() {
            sources.extend(lists.words(&source));
        }
        let quads = gpu.buffer(4 * lists.quads)?;
        let mut first = 0;
        for source in matching.sources() {
            gpu.queue.write_buffer(&quads, first, bytemuck::cast_slice(source.quads));
            first += 4 * source.quads.len() as u64;
        }
        let guesses = matching.guesses();
        let mut parameters = Parameters {
            size: matching.size(),
            count: sources.len() / SOURCE,
            begin: Size::new(0, 0),
            options: *matching.options(),
            hopeless: matching.hopeless(),
            has_depths: matching.has_depths(),
            guesses: guesses
                .as_ref()
                .map(|Guesses { size, halvings, beyond, .. }| (*size, *halvings, *beyond)),
        };
        let planes = match start {
            Start::Search { .. } => None,
            Start::Planes { size, planes } => {
                parameters.begin = *size;
                let vectors: Vec<[f32; 4]> = planes.iter().map(|[w, gx, gy]| [*w, *gx, *gy, 0.0]).collect();
                Some(gpu.upload(&vectors)?)
            }
        };
        // A binding cannot be empty.
        let any = |list: Vec<f32>| if list.is_empty() { vec![0.0; 4] } else { list };
        Ok(Self {
            image: gpu.upload(matching.image())?,
            sources: gpu.upload(&sources)?,
            quads,
            visibilities: gpu.upload(&any(lists.visibilities))?,
            depths: gpu.upload(&any(lists.depths))?,
            guesses: gpu.upload(&any(guesses.map_or(Vec::new(), |guesses| guesses.values.concat())))?,
            field: gpu.buffer(4 * STATE * parameters.size.area())?,
            parameters,
            planes,
        })
    }

    /// A kernel over all pixels or those of one colour of the checkerboard, rows by rows.
    fn run(&self, to: &mut Recorder<'_>, kernel: &Kernel, colour: Option<usize>) {
        let Size { width, height } = self.parameters.size;
        let columns = if colour.is_some() { width.div_ceil(2) } else { width };
        let of_row = (columns * self.parameters.count) as u64 * OF_PLANE * PLANES;
        let rows = (MOST_OPERATIONS / of_row.max(1)).clamp(1, height as u64) as usize;
        let mut buffers = vec![
            &self.image,
            &self.sources,
            &self.quads,
            &self.visibilities,
            &self.depths,
            &self.guesses,
            &self.field,
        ];
        buffers.extend(&self.planes);
        for first in (0..height).step_by(rows) {
            let count = rows.min(height - first);
            to.run(kernel, self.parameters.words(colour.unwrap_or(0), first), &buffers, [columns, count, 1]);
            to.limit(of_row * count as u64);
        }
    }
}

/// The parameters of the kernels.
struct Parameters {
    size: Size,
    /// The number of source views.
    count: usize,
    /// The size of the image of the planes to begin with.
    begin: Size,
    options: RefineOptions,
    hopeless: f32,
    has_depths: bool,
    /// The size of the image of the guesses, how often it is half that of the matching, and how far beyond them planes are sought.
    guesses: Option<(Size, usize, f32)>,
}

impl Parameters {
    fn words(&self, colour: usize, first_row: usize) -> Words {
        let (guesses, halvings, beyond) = self.guesses.unwrap_or((Size::new(0, 0), 0, 0.0));
        let options = &self.options;
        let size = |words: Words, size: Size| words.counts(&[size.width, size.height]);
        let words =
            size(Words::new(), self.size).count(self.size.width + 2 * Matching::BORDER).count(self.count);
        let words = size(words, guesses).count(halvings).count(colour);
        size(words, self.begin)
            .counts(&[first_row, options.search as usize])
            .number(1.0 / (options.colour * options.colour))
            .number(options.noise * options.noise)
            .numbers(&[beyond.min(IMPOSSIBLE), self.hopeless, options.prior, options.prior_reach])
            .numbers(&[options.visibility, options.geometric, options.geometric_reach])
            .flag(self.has_depths)
    }
}

/// What the source views have for each pixel, one after the other.
#[derive(Default)]
struct Lists {
    /// The number of pixels, whose grey values are long lists and not copied.
    quads: usize,
    visibilities: Vec<f32>,
    depths: Vec<f32>,
}

impl Lists {
    /// Takes what a source view has, and gives the words that describe it.
    fn words(&mut self, source: &SourceView<'_>) -> [u32; SOURCE] {
        let first = [self.quads, self.visibilities.len(), self.depths.len()];
        let size = |grid: Option<&Grid<f32>>| grid.map_or(Size::new(0, 0), Grid::size);
        let (seen, map) =
            (size(source.visibility), size(source.depths.as_ref().map(|depths| depths.inverse)));
        let [to_x, to_y] = source.depths.as_ref().map_or([[0.0; 2]; 2], |depths| depths.to_map);
        let back = source.depths.as_ref().map(|depths| depths.back);
        self.quads += source.quads.len();
        self.visibilities.extend(source.visibility.into_iter().flat_map(Grid::data));
        self.depths.extend(source.depths.iter().flat_map(|depths| depths.inverse.data()));
        // A depth map has its last column and row once more.
        let map = [map.width, map.height].map(|side| side.saturating_sub(1) as f32);
        let words = rows(Words::new(), Some(source.projection))
            .numbers(&[source.size.width as f32, source.size.height as f32])
            .counts(&first[..2])
            .counts(&[seen.width, seen.height, first[2], 0])
            .numbers(&[to_x[0], to_x[1], to_y[0], to_y[1]])
            .numbers(&map)
            .counts(&[0, 0]);
        rows(words, back).all().try_into().expect("a source view has so many words")
    }
}

/// The rows of a projection with their offsets; zeros where there is none.
fn rows(words: Words, projection: Option<Projection>) -> Words {
    let Some(Projection { linear, offset }) = projection else { return words.numbers(&[0.0; 12]) };
    let row = |words: Words, row: usize| words.numbers(&linear[row]).number(offset[row]);
    (0..3).fold(words, row)
}
