//! The network: photographs in, a depth map out.

use vamvs_core::{Photo, Planes, Size};
use vamvs_corr::layers::{self, STRIDE, bilinear};
use vamvs_corr::{Estimate, Found, Manifest, Stage};
use wgpu::Buffer;

use crate::layer::{Convolution, Finish, Place, ToOne, enlarged, enlarged_ones, part};
use crate::map::Map;
use crate::photograph::Photograph;
use crate::pyramid::Pyramid;
use crate::recorder::{Recorder, Words};
use crate::sweep::{Placed, Sweep};
use crate::volume_net::VolumeNet;
use crate::{EncodedView, Gpu, GpuError};

/// Vectors of four values of a candidate's description, of its scores, and of what tells of a surface.
const CANDIDATE: usize = 11;
const EVIDENCE: usize = 6;

/// The network on a GPU.
pub struct Network {
    gpu: Gpu,
    manifest: Manifest,
    layers: Layers,
}

/// All layers, in the device's memory.
struct Layers {
    pyramid: Pyramid,
    seen: ([Convolution; 2], ToOne),
    coarse: VolumeNet,
    fine: VolumeNet,
    /// What is seen around a pixel, what candidates are like, and their scores.
    enlarge: [Convolution; 3],
    /// What is seen around a pixel, what is found there, and around it.
    surface: [Convolution; 3],
    judge: ToOne,
}

impl Layers {
    fn new(gpu: &Gpu, from: &layers::Layers) -> Result<Self, GpuError> {
        let one = |layer: &layers::Convolution| Convolution::new(gpu, layer);
        let layers::Layers { pyramid, seen: ([first, second], last), coarse, fine, enlarge, surface } = from;
        Ok(Self {
            pyramid: Pyramid::new(gpu, pyramid)?,
            seen: ([one(first)?, one(second)?], ToOne::new(gpu, last, true)?),
            coarse: VolumeNet::new(gpu, coarse)?,
            fine: VolumeNet::new(gpu, fine)?,
            enlarge: [one(&enlarge.look)?, one(&enlarge.weigh)?, one(&enlarge.choose)?],
            surface: [one(&surface.look)?, one(&surface.weigh)?, one(&surface.wide)?],
            judge: ToOne::new(gpu, &surface.judge, true)?,
        })
    }
}

/// What the first stage found.
struct Coarse {
    /// Depth in planes, confidence and spread of each pixel.
    found: Map,
    /// What each source view sees, one after the other.
    masks: Buffer,
}

impl Network {
    /// The network with its weights in the device's memory.
    ///
    /// # Errors
    /// If the device fails.
    pub fn new(gpu: Gpu, network: &vamvs_corr::Network) -> Result<Self, GpuError> {
        let layers = gpu.checked(|| Layers::new(&gpu, network.layers()))?;
        Ok(Self { gpu, manifest: network.manifest().clone(), layers })
    }

    /// The GPU.
    #[must_use]
    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// What is said of the network.
    #[must_use]
    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// The features of a photograph.
    ///
    /// # Errors
    /// If it is smaller than 32×32 pixels, or the device fails.
    pub fn encode(&self, photo: &Photo) -> Result<EncodedView, GpuError> {
        vamvs_corr::view::check_size(photo.camera.size)?;
        self.gpu.checked(|| {
            let photograph = Photograph::new(&self.gpu, &photo.image)?;
            let mut to = Recorder::new(&self.gpu);
            let image = photograph.seen(&mut to, false)?;
            let fine = self.layers.pyramid.features(&mut to, &image)?;
            let image = photograph.seen(&mut to, true)?;
            let whole = self.layers.pyramid.features(&mut to, &image)?;
            let Size { width, height } = photograph.padded;
            let coarse = part(&mut to, &whole, (0, 0), [1, height / (2 * STRIDE), width / (2 * STRIDE)])?;
            to.submit();
            Ok(EncodedView::new(photo, photograph.padded, [fine, coarse]))
        })
    }

    /// The depth map of a reference view from source views on planes. `time` runs what it is given and may measure it.
    ///
    /// # Errors
    /// If there are no sources, or fewer than two planes, or the device fails.
    pub fn estimate(
        &self,
        reference: &EncodedView,
        sources: &[&EncodedView],
        planes: &Planes,
        time: &mut dyn FnMut(Stage, &mut dyn FnMut()),
    ) -> Result<Estimate, GpuError> {
        vamvs_corr::network::check_request(sources.len(), planes)?;
        let mut timed = Timed { gpu: &self.gpu, time };
        let coarse = self.coarse(&mut timed, reference, sources, planes)?;
        let found = self.fine(&mut timed, (reference, sources, planes), &coarse)?;
        Ok(found.estimate(&self.manifest, (&reference.camera, reference.cam_from_world), planes))
    }

    /// The first stage: the map of all planes in the photograph at half its size, and what each source view sees of it.
    fn coarse(
        &self,
        timed: &mut Timed<'_>,
        reference: &EncodedView,
        sources: &[&EncodedView],
        planes: &Planes,
    ) -> Result<Coarse, GpuError> {
        let sides @ [_, height, width] = reference.coarse.sides;
        let sweep = Sweep::all(reference.at_half(), planes);
        let of: Vec<Placed<'_>> = sources.iter().map(|source| source.at_half()).collect();
        let (masks, volume) = timed.run(Stage::Sweep, |to| {
            let masks = to.gpu.buffer(4 * of.len() * height * width)?;
            for (number, source) in of.iter().enumerate() {
                let pooled = sweep.pooled(to, *source)?;
                let place = Place { buffer: &masks, first: number * height * width, sides };
                self.look(to, &pooled, place)?;
            }
            let volume = sweep.volume(to, &of, &masks)?;
            Ok((masks, volume))
        })?;
        timed.run(Stage::Regularize, |to| {
            let costs = self.layers.coarse.costs(to, &volume, &reference.coarse)?;
            Ok(Coarse { found: self.soft_argmin(to, &costs, volume.sides)?, masks })
        })
    }

    /// What a source view sees, in [0, 1], from its pooled correlations.
    fn look(&self, to: &mut Recorder<'_>, pooled: &Map, place: Place<'_>) -> Result<(), GpuError> {
        let ([first, second], last) = &self.layers.seen;
        let looked = first.run(to, pooled, Finish::RELU)?;
        let looked = second.run(to, &looked, Finish::RELU)?;
        last.run(to, &looked, place);
        Ok(())
    }

    /// Depth in planes, confidence and spread of each pixel, from costs (D, h, w).
    fn soft_argmin(&self, to: &mut Recorder<'_>, costs: &Buffer, sides: [usize; 3]) -> Result<Map, GpuError> {
        let [planes, height, width] = sides;
        let found = Map::new(to.gpu, [1, height, width], 1)?;
        let words = Words::new().counts(&[height * width, planes, self.manifest.window]);
        to.run(&to.gpu.kernels.planes, words, &[costs, &found.buffer], [height * width, 1, 1]);
        Ok(found)
    }

    /// The second stage: planes around the first map, in the photograph as it is.
    fn fine(
        &self,
        timed: &mut Timed<'_>,
        (reference, sources, planes): (&EncodedView, &[&EncodedView], &Planes),
        coarse: &Coarse,
    ) -> Result<Found, GpuError> {
        let sides @ [_, height, width] = reference.fine.sides;
        let [_, coarse_height, coarse_width] = reference.coarse.sides;
        let views = sources.len();
        let cascade = self.manifest.cascade;
        let (around, masks, volume) = timed.run(Stage::Sweep, |to| {
            let around = self.enlarged_depth(to, reference, &coarse.found)?;
            let from = [views, coarse_height, coarse_width];
            let masks = enlarged_ones(to, &coarse.masks, from, [views, height, width])?;
            let around_it = (&around, cascade.planes, cascade.step as f32);
            let sweep = Sweep::around(reference.at_full(), planes, around_it);
            let of: Vec<Placed<'_>> = sources.iter().map(|source| source.at_full()).collect();
            let volume = sweep.volume(to, &of, &masks)?;
            Ok((around, masks, volume))
        })?;
        let (found, surface) = timed.run(Stage::Regularize, |to| {
            let costs = self.layers.fine.costs(to, &volume, &reference.fine)?;
            let fine = self.soft_argmin(to, &costs, volume.sides)?;
            let [look, weigh, wide] = &self.layers.surface;
            let looked = look.run(to, &reference.fine, Finish::RELU)?;
            let evidence = Map::new(to.gpu, sides, EVIDENCE)?;
            let found = Map::new(to.gpu, sides, 1)?;
            let words = Words::new()
                .counts(&[height * width, views, cascade.planes])
                .numbers(&[cascade.step as f32, (planes.count - 1) as f32]);
            let whole = enlarged(to, &coarse.found, sides)?;
            let maps = [&looked, &whole, &fine].map(|map| &map.buffer);
            let [looked, whole, fine] = maps;
            let buffers =
                [looked, whole, fine, &around, &masks, &volume.buffer, &evidence.buffer, &found.buffer];
            to.run(&to.gpu.kernels.evidence, words, &buffers, [height * width, 1, 1]);
            let weighed = weigh.run(to, &evidence, Finish::RELU)?;
            let judged = wide.run(to, &weighed, Finish { beside: Some(&weighed), ..Finish::RELU })?;
            let surface = to.gpu.buffer(4 * height * width)?;
            self.layers.judge.run(to, &judged, Place { buffer: &surface, first: 0, sides });
            Ok((found, surface))
        })?;
        let (found, surface, masks) = self.gpu.checked(|| {
            let download = |buffer| self.gpu.download(buffer);
            Ok((download(&found.buffer)?, download(&surface)?, download(&masks)?))
        })?;
        let of = |channel: usize| found.chunks_exact(4).map(|pixel| pixel[channel]).collect::<Vec<f32>>();
        Ok(Found {
            padded: Size::new(width, height),
            u: of(0),
            confidence: of(1),
            coarse_confidence: of(2),
            surface,
            masks: masks.chunks_exact(height * width).map(<[f32]>::to_vec).collect(),
        })
    }

    /// The first map at twice its resolution, depth in planes.
    fn enlarged_depth(
        &self,
        to: &mut Recorder<'_>,
        reference: &EncodedView,
        coarse: &Map,
    ) -> Result<Buffer, GpuError> {
        let sides @ [_, height, width] = reference.fine.sides;
        let [look, weigh, choose] = &self.layers.enlarge;
        let looked = look.run(to, &reference.fine, Finish::RELU)?;
        let candidates = Map::new(to.gpu, sides, CANDIDATE)?;
        let words = || {
            let of_block = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(x, y)| bilinear(x, y));
            let sides = Words::new().counts(&[height, width]).counts(&coarse.sides[1..]);
            (0..9).fold(sides, |words, k| words.numbers(&of_block.map(|shares| shares[k])))
        };
        let maps = [&looked, coarse, &reference.coarse, &reference.fine, &candidates];
        to.run(&to.gpu.kernels.candidates, words(), &maps.map(|map| &map.buffer), [width, height, 1]);
        let weighed = weigh.run(to, &candidates, Finish::RELU)?;
        let scores = choose.run(to, &weighed, Finish::default())?;
        let depths = to.gpu.buffer(4 * height * width)?;
        let buffers = [&scores.buffer, &coarse.buffer, &depths];
        to.run(&to.gpu.kernels.choose, words(), &buffers, [width, height, 1]);
        Ok(depths)
    }

    /// The largest piece of the device's memory that a depth map takes, bytes: a volume with its channels.
    #[must_use]
    pub fn largest_piece(&self, photograph: Size, planes: usize) -> usize {
        let cells = |stride: usize, planes: usize| {
            let side = |pixels: usize| pixels.div_ceil(8 * stride) * 8;
            side(photograph.width) * side(photograph.height) * planes.next_multiple_of(8)
        };
        let cells = cells(2 * STRIDE, planes).max(cells(STRIDE, self.manifest.cascade.planes));
        4 * cells * layers::GROUPS
    }
}

/// Runs kernels of a stage and measures their time.
struct Timed<'a> {
    gpu: &'a Gpu,
    time: &'a mut dyn FnMut(Stage, &mut dyn FnMut()),
}

impl Timed<'_> {
    fn run<T>(
        &mut self,
        stage: Stage,
        work: impl FnOnce(&mut Recorder<'_>) -> Result<T, GpuError>,
    ) -> Result<T, GpuError> {
        let (mut work, mut result) = (Some(work), None);
        (self.time)(stage, &mut || {
            let work = work.take().expect("a stage is run once");
            result = Some(self.gpu.checked(|| {
                let mut recorder = Recorder::new(self.gpu);
                let result = work(&mut recorder)?;
                recorder.submit();
                Ok(result)
            }));
        });
        result.expect("the stage has run")
    }
}
