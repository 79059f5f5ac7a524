//! The network: photographs in, a depth map out.

use rayon::prelude::*;
use vamvs_core::roi::PixelBox;
use vamvs_core::{DepthMap, Grid, MonotoneMap, Photo, Pinhole, Planes, Pose, Size};

use crate::CorrError;
use crate::convolution::{Convolution, ToOne};
use crate::map::{Map, Row};
use crate::plane_map::{PlaneMap, enlarged_depth, row_near};
use crate::pyramid::{self, BLOCK, CHANNELS, Pyramid, STRIDE, positive};
use crate::sweep::{GROUPS, Placed, PlaneDepth, Sweep};
use crate::volume_net::VolumeNet;
use crate::weights::{Cascade, Manifest, Shape, Weights};
use crate::wide::{add, exp, relu, sigmoid};

/// Least side of a photograph, pixels.
const LEAST_SIDE: usize = 32;

/// Pixels that are less likely than this to show a surface have no depth.
const LEAST_SURFACE: f32 = 0.5;

/// Planes between two depths beyond which they are just different.
const REACH: f32 = 4.0;

/// Channels of what the volumes tell of a surface.
const EVIDENCE: usize = 6;

/// The network.
#[derive(Debug)]
pub struct Network {
    manifest: Manifest,
    pyramid: Pyramid,
    seen: ([Convolution; 2], ToOne),
    coarse: VolumeNet,
    fine: VolumeNet,
    enlarge: Enlarge,
    surface: Surface,
}

/// Which of the nine coarse pixels around a pixel is of the same surface (as in RAFT, Teed and Deng, ECCV 2020).
#[derive(Debug)]
struct Enlarge {
    look: Convolution,
    weigh: Convolution,
    choose: Convolution,
}

/// How likely a pixel shows a surface inside the depth range, and not sky or what lies beyond.
#[derive(Debug)]
struct Surface {
    look: Convolution,
    weigh: Convolution,
    wide: Convolution,
    judge: ToOne,
}

/// A photograph with its features: as it is, and at half its size.
#[derive(Clone, Debug)]
pub struct EncodedView {
    camera: Pinhole,
    cam_from_world: Pose,
    /// The photograph's size with its padding.
    padded: Size,
    fine: Map,
    coarse: Map,
}

/// A depth map, and what else the network tells.
#[derive(Clone, Debug)]
pub struct Estimate {
    /// The depth map, its camera of its own size: a quarter of the photograph's. Where there is likely no surface, its depth is 0.
    pub map: DepthMap,
    /// The probability that a pixel shows a surface inside the depth range.
    pub surface: Grid<f32>,
    /// For each source view, how likely it sees each pixel.
    pub visibility: Vec<Grid<f32>>,
}

/// A stage of the network, for whom it tells where the time went.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Correlating the views.
    Sweep,
    /// Regularising the volumes, and what follows.
    Regularize,
}

impl Network {
    /// The network with the weights of a safetensors file.
    ///
    /// # Errors
    /// If the file is damaged, or of another network.
    pub fn new(bytes: &[u8]) -> Result<Self, CorrError> {
        let (weights, manifest) = Weights::read(bytes)?;
        let image = Shape::image;
        let seen = [
            weights.layer("seen.0", image(2 * GROUPS, 16, 3), 1)?,
            weights.layer("seen.1", image(16, 16, 3), 1)?,
        ];
        Ok(Self {
            pyramid: Pyramid::new(&weights)?,
            seen: (seen, weights.to_one("seen.2", image(16, 1, 1), true)?),
            coarse: VolumeNet::new(&weights, "volume")?,
            fine: VolumeNet::new(&weights, "fine")?,
            enlarge: Enlarge {
                look: weights.bare("enlarge_net.look", image(CHANNELS, 16, 3), true)?,
                weigh: weights.bare("enlarge_net.weigh", image(16 + 3 * 9, 32, 1), true)?,
                choose: weights.bare("enlarge_net.choose", image(32, 9, 1), true)?,
            },
            surface: Surface {
                look: weights.bare("surface_net.look", image(CHANNELS, 16, 3), true)?,
                weigh: weights.bare("surface_net.weigh", image(16 + EVIDENCE, 16, 3), true)?,
                wide: weights.dilated("surface_net.wide", image(16, 16, 3))?,
                judge: weights.to_one("surface_net.judge", image(16, 1, 1), true)?,
            },
            manifest,
        })
    }

    /// What the file says of the network.
    #[must_use]
    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// The calibration of the confidence, if there is one.
    #[must_use]
    pub fn calibration(&self) -> Option<&MonotoneMap> {
        self.manifest.calibration.as_ref()
    }

    /// The features of a photograph.
    ///
    /// # Errors
    /// If it is smaller than 32×32 pixels.
    pub fn encode(&self, photo: &Photo) -> Result<EncodedView, CorrError> {
        let size = photo.camera.size;
        if size.width < LEAST_SIDE || size.height < LEAST_SIDE {
            let problem = format!("a photograph of {size} pixels is too small: expected at least 32×32");
            return Err(CorrError::Request(problem));
        }
        let image = pyramid::image(&photo.image);
        let half = image.halved();
        let sides = [1, half.height / STRIDE, half.width / STRIDE];
        let coarse = self.pyramid.features(&half.padded([1, BLOCK, BLOCK])).sized(sides).into_owned();
        let padded = Size::new(image.width, image.height);
        let (camera, cam_from_world) = (photo.camera, photo.cam_from_world);
        Ok(EncodedView { camera, cam_from_world, padded, fine: self.pyramid.features(&image), coarse })
    }

    /// The depth map of a reference view from source views on planes. `time` runs what it is given and may measure it.
    ///
    /// # Errors
    /// If there are no sources, or fewer than two planes.
    pub fn estimate(
        &self,
        reference: &EncodedView,
        sources: &[&EncodedView],
        planes: &Planes,
        time: &mut dyn FnMut(Stage, &mut dyn FnMut()),
    ) -> Result<Estimate, CorrError> {
        if sources.is_empty() {
            return Err(CorrError::Request("a depth map needs at least one source view".to_owned()));
        }
        if planes.count < 2 {
            return Err(CorrError::Request(format!("a sweep needs at least 2 planes, got {}", planes.count)));
        }
        let (coarse, masks) = self.coarse(reference, sources, planes, time);
        let around = {
            let u = coarse.as_image(&coarse.u);
            enlarged_depth(&u, &self.enlarge.shares(&u, &reference.coarse, &reference.fine))
        };
        let [_, height, width] = reference.fine.sides();
        let enlarged = |values: &[f32]| coarse.as_image(values).enlarged([1, height, width]).values;
        let masks: Vec<Vec<f32>> = masks.iter().map(|mask| enlarged(mask)).collect();
        let Cascade { planes: count, step } = self.manifest.cascade;
        let sweep = Sweep::around(reference.at_full(), planes, (&around, count, step as f32));
        let mut volume = Map::new([0, 1, 1], 1);
        let of: Vec<Placed<'_>> = sources.iter().map(|source| source.at_full()).collect();
        time(Stage::Sweep, &mut || volume = sweep.volume(&of, &masks));
        let correlation = strongest(&volume);
        let mut fine = None;
        time(Stage::Regularize, &mut || {
            let costs = self.fine.costs(&volume, &reference.fine);
            fine = Some(PlaneMap::of(&costs, (width, height), self.manifest.window));
        });
        let mut fine = fine.expect("the closure has run");
        let middle = 0.5 * (count - 1) as f32;
        fine.u
            .iter_mut()
            .zip(&around)
            .for_each(|(u, around)| *u = (*u - middle).mul_add(step as f32, *around));
        let (coarse_confidence, spread) = (enlarged(&coarse.confidence), enlarged(&coarse.spread));
        let mean_mask = |at: usize| masks.iter().map(|mask| mask[at]).sum::<f32>() / masks.len() as f32;
        let last = (planes.count - 1) as f32;
        let evidence = |at: usize| {
            let confidence = fine.confidence[at];
            [coarse_confidence[at], spread[at], confidence, correlation[at], mean_mask(at), fine.u[at] / last]
        };
        let surface = self.surface.probability(evidence, &reference.fine);
        Ok(self.kept(reference, planes, &Stages { fine, coarse_confidence, surface, masks }))
    }

    /// The first stage: the map of all planes in the photograph at half its size, and what each source view sees of it.
    fn coarse(
        &self,
        reference: &EncodedView,
        sources: &[&EncodedView],
        planes: &Planes,
        time: &mut dyn FnMut(Stage, &mut dyn FnMut()),
    ) -> (PlaneMap, Vec<Vec<f32>>) {
        let sweep = Sweep::all(reference.at_half(), planes);
        let of: Vec<Placed<'_>> = sources.iter().map(|source| source.at_half()).collect();
        let (mut masks, mut volume) = (Vec::new(), Map::new([0, 1, 1], 1));
        time(Stage::Sweep, &mut || {
            masks = of.iter().map(|source| self.visibility(&sweep.pooled(source))).collect();
            volume = sweep.volume(&of, &masks);
        });
        let mut map = None;
        time(Stage::Regularize, &mut || {
            let size = (volume.width, volume.height);
            let costs = self.coarse.costs(&volume, &reference.coarse);
            map = Some(PlaneMap::of(&costs, size, self.manifest.window));
        });
        (map.expect("the closure has run"), masks)
    }

    /// What a source view sees, (h, w) in [0, 1], from its pooled correlations.
    fn visibility(&self, pooled: &Map) -> Vec<f32> {
        let ([first, second], last) = &self.seen;
        let looked = second.run(&first.run(pooled, positive), positive);
        last.run(&looked, |_, values| values.iter_mut().for_each(|value| *value = sigmoid(*value)))
    }

    /// The result without the padding: where there may be no surface, there is less confidence in a depth; where there likely is
    /// none, there is no depth.
    fn kept(&self, reference: &EncodedView, planes: &Planes, stages: &Stages) -> Estimate {
        let Stages { fine, coarse_confidence, surface, masks } = stages;
        let full = reference.camera.size;
        let size = Size::new(full.width / STRIDE, full.height / STRIDE);
        let grid = |values: &[f32]| Grid::from_fn(size, |x, y| values[y * fine.width + x]);
        let depth_of = PlaneDepth::new(planes);
        let (near, surface) = (planes.range.near as f32, grid(surface));
        let mut depth = grid(&fine.u).map(|&u| near * depth_of.of(u));
        let coarse_confidence = grid(coarse_confidence);
        let calibrated = |value: f32| match self.calibration() {
            Some(map) => map.at(f64::from(value)) as f32,
            None => value,
        };
        let mut confidence = Grid::from_fn(size, |x, y| {
            calibrated(fine.confidence[y * fine.width + x] * coarse_confidence[(x, y)])
        });
        let pixels = depth.data_mut().iter_mut().zip(confidence.data_mut()).zip(surface.data());
        for ((depth, confidence), surface) in pixels {
            *confidence *= surface;
            if *surface < LEAST_SURFACE {
                (*depth, *confidence) = (0.0, 0.0);
            }
        }
        let ratio = 1.0 / STRIDE as f64;
        Estimate {
            map: DepthMap {
                camera: Pinhole { size, intrinsics: reference.camera.intrinsics.scaled(ratio, ratio) },
                cam_from_world: reference.cam_from_world,
                depth,
                confidence,
                coarse_confidence: Some(coarse_confidence),
            },
            surface,
            visibility: masks.iter().map(|mask| grid(mask)).collect(),
        }
    }

    /// The peak memory of a depth map from `views` photographs of `size` pixels with `planes` planes, their features included,
    /// the network itself not, bytes.
    #[must_use]
    pub fn peak_bytes(&self, size: Size, views: usize, planes: usize) -> usize {
        let pixels = |stride: usize| {
            (size.width.div_ceil(BLOCK) * BLOCK / stride) * (size.height.div_ceil(BLOCK) * BLOCK / stride)
        };
        let value = size_of::<f32>();
        let features = views * (pixels(STRIDE) + pixels(2 * STRIDE)) * CHANNELS * value;
        // The image twice, and the first level of the pyramid twice.
        let encoding = (2 * 3 * pixels(1) + 2 * 16 * pixels(2)) * value;
        // The volume, its costs, two levels at half the resolution, and slabs at full resolution.
        let volume = |cells: usize, planes: usize| {
            cells * value * (planes * (GROUPS + 1) + planes * 3 * 16 / 8 + 3 * 18 * GROUPS)
        };
        let volumes =
            volume(pixels(2 * STRIDE), planes).max(volume(pixels(STRIDE), self.manifest.cascade.planes));
        features + encoding.max(volumes)
    }
}

/// What the stages tell, with the padding.
struct Stages {
    fine: PlaneMap,
    coarse_confidence: Vec<f32>,
    surface: Vec<f32>,
    masks: Vec<Vec<f32>>,
}

/// The largest mean correlation over the planes, (h, w).
fn strongest(volume: &Map) -> Vec<f32> {
    let area = volume.height * volume.width;
    (0..area)
        .into_par_iter()
        .map(|at| {
            let mean = |plane: usize| {
                let groups = &volume.values[(plane * area + at) * GROUPS..][..GROUPS];
                groups.iter().sum::<f32>() / GROUPS as f32
            };
            (0..volume.planes).fold(f32::NEG_INFINITY, |largest, plane| largest.max(mean(plane)))
        })
        .collect()
}

impl Enlarge {
    /// Shares of the 3×3 coarse pixels around each pixel, rows first, an image with nine channels: from the coarse depth in plane
    /// coordinates and the features of the reference view at both resolutions.
    fn shares(&self, u: &Map, coarse: &Map, fine: &Map) -> Map {
        const INPUTS: usize = 16 + 3 * 9;
        let looked = self.look.run(fine, positive);
        let (coarse_lengths, fine_lengths) = (lengths(coarse), lengths(fine));
        let bilinear = [0, 1].map(|y| [0, 1].map(|x| bilinear(x, y)));
        let inputs = Map::by_rows(fine.sides(), INPUTS, |Row { y, .. }, to| {
            let pixels = to.as_chunks_mut::<INPUTS>().0;
            for (x, to) in pixels.iter_mut().enumerate() {
                to[..16].copy_from_slice(&looked.line(y)[x * 16..][..16]);
                let own = &fine.line(y)[x * CHANNELS..][..CHANNELS];
                let middle = u.line(y / 2)[x / 2];
                for k in 0..9 {
                    let (row, column) = (row_near(y / 2, k / 3, u.height), row_near(x / 2, k % 3, u.width));
                    let other = &coarse.line(row)[column * CHANNELS..][..CHANNELS];
                    let product = dot(own, other);
                    let length =
                        fine_lengths[y * fine.width + x] * coarse_lengths[row * coarse.width + column];
                    to[16 + k] = (u.line(row)[column] - middle).clamp(-REACH, REACH) / REACH;
                    to[16 + 9 + k] = product / length;
                    to[16 + 18 + k] = bilinear[y % 2][x % 2][k];
                }
            }
        });
        let weighed = self.weigh.run(&inputs, positive);
        self.choose.run(&weighed, |Row { y, .. }, values| {
            for (x, shares) in values.as_chunks_mut::<9>().0.iter_mut().enumerate() {
                add(shares, &bilinear[y % 2][x % 2]);
                let largest = shares.iter().fold(f32::NEG_INFINITY, |largest, value| largest.max(*value));
                shares.iter_mut().for_each(|value| *value = exp(*value - largest));
                let sum: f32 = shares.iter().sum();
                shares.iter_mut().for_each(|value| *value /= sum);
            }
        })
    }
}

/// The logarithms of the shares of bilinear interpolation, plus a hundredth, of the pixel (x, y) of a block of two by two.
fn bilinear(x: usize, y: usize) -> [f32; 9] {
    const SIDES: [[f32; 3]; 2] = [[0.25, 0.75, 0.0], [0.0, 0.75, 0.25]];
    std::array::from_fn(|k| (SIDES[y][k / 3] * SIDES[x][k % 3] + 0.01).ln())
}

/// The length of each pixel's features, at least 1e-12.
fn lengths(map: &Map) -> Vec<f32> {
    let length = |pixel: &[f32]| dot(pixel, pixel).sqrt().max(1e-12);
    map.values.par_chunks(CHANNELS).map(length).collect()
}

/// The sum of the products of a pixel's features with another's.
#[inline(always)]
fn dot(a: &[f32], b: &[f32]) -> f32 {
    let mut sums = [0.0_f32; GROUPS];
    for (a, b) in a.as_chunks::<GROUPS>().0.iter().zip(b.as_chunks::<GROUPS>().0) {
        for lane in 0..GROUPS {
            sums[lane] += a[lane] * b[lane];
        }
    }
    sums.iter().sum()
}

impl Surface {
    /// The probability for each pixel, (h, w), from what the volumes tell of it and the features of the reference view.
    fn probability(&self, evidence: impl Fn(usize) -> [f32; EVIDENCE] + Sync, reference: &Map) -> Vec<f32> {
        const INPUTS: usize = 16 + EVIDENCE;
        let looked = self.look.run(reference, positive);
        let inputs = Map::by_rows(reference.sides(), INPUTS, |Row { y, .. }, to| {
            for (x, to) in to.as_chunks_mut::<INPUTS>().0.iter_mut().enumerate() {
                to[..16].copy_from_slice(&looked.line(y)[x * 16..][..16]);
                to[16..].copy_from_slice(&evidence(y * reference.width + x));
            }
        });
        let weighed = self.weigh.run(&inputs, positive);
        let judged = self.wide.run(&weighed, |row, values| {
            relu(values);
            add(values, weighed.row(row));
        });
        self.judge.run(&judged, |_, values| values.iter_mut().for_each(|value| *value = sigmoid(*value)))
    }
}

impl EncodedView {
    fn at_full(&self) -> Placed<'_> {
        self.placed(&self.fine)
    }

    fn at_half(&self) -> Placed<'_> {
        self.placed(&self.coarse)
    }

    fn placed<'a>(&'a self, features: &'a Map) -> Placed<'a> {
        let Self { camera, cam_from_world, padded, .. } = *self;
        Placed { features, camera, cam_from_world, padded }
    }

    /// The memory of the features, bytes.
    #[must_use]
    pub fn bytes(&self) -> usize {
        (self.fine.values.len() + self.coarse.values.len()) * size_of::<f32>()
    }

    /// The part of the view inside `region`, extended outwards to multiples of 8 pixels, and the box of that part, both in pixels of
    /// the photograph.
    ///
    /// # Errors
    /// If the region is empty or outside of the image.
    pub fn cropped(&self, region: &PixelBox) -> Result<(Self, PixelBox), CorrError> {
        let outer = PixelBox {
            x0: region.x0 / BLOCK * BLOCK,
            y0: region.y0 / BLOCK * BLOCK,
            x1: region.x1.next_multiple_of(BLOCK).min(self.padded.width),
            y1: region.y1.next_multiple_of(BLOCK).min(self.padded.height),
        };
        if outer.x0 >= outer.x1 || outer.y0 >= outer.y1 {
            let problem = format!("the region {region:?} is empty or outside the {} image", self.camera.size);
            return Err(CorrError::Request(problem));
        }
        let padded = Size::new(outer.x1 - outer.x0, outer.y1 - outer.y0);
        let part = |map: &Map, stride: usize| {
            map.part((outer.x0 / stride, outer.y0 / stride), (padded.width / stride, padded.height / stride))
        };
        let Size { width, height } = self.camera.size;
        let camera =
            self.camera.cropped(PixelBox { x1: outer.x1.min(width), y1: outer.y1.min(height), ..outer });
        let (fine, coarse) = (part(&self.fine, STRIDE), part(&self.coarse, 2 * STRIDE));
        Ok((Self { camera, cam_from_world: self.cam_from_world, padded, fine, coarse }, outer))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wide::{ALLOWED, Widest};
    use vamvs_core::{DepthRange, Intrinsics, Spacing};

    /// Photographs of a wall with blotches, from cameras side by side.
    fn photos(size: Size, count: usize) -> Vec<Photo> {
        let focal = size.width as f64;
        let intrinsics = Intrinsics { fx: focal, fy: focal, cx: 0.5 * focal, cy: 0.5 * size.height as f64 };
        let shade = |x: f64, y: f64, phase: f64| {
            (127.0 + 60.0 * (0.31 * x + phase).sin() + 60.0 * (0.23 * y - phase * x).cos()) as u8
        };
        let photo = |view: usize| {
            let mut cam_from_world = Pose::identity();
            cam_from_world.translation.x = -0.25 * view as f64;
            // The wall is five units away.
            let shift = 0.25 * view as f64 * focal / 5.0;
            let image = Grid::from_fn(size, |x, y| {
                [0.1, 0.5, 0.9].map(|phase| shade(x as f64 + shift, y as f64, phase))
            });
            Photo { camera: Pinhole { size, intrinsics }, cam_from_world, image, mask: None }
        };
        (0..count).map(photo).collect()
    }

    fn estimate(network: &Network, photos: &[Photo]) -> Estimate {
        let encoded: Vec<_> =
            photos.iter().map(|photo| network.encode(photo).expect("a photograph")).collect();
        let sources: Vec<_> = encoded[1..].iter().collect();
        let planes =
            Planes { range: DepthRange { near: 3.0, far: 12.0 }, count: 24, spacing: Spacing::InverseDepth };
        network.estimate(&encoded[0], &sources, &planes, &mut |_, run| run()).expect("a depth map")
    }

    fn network() -> Network {
        Network::new(vamvs_weights::VIS_CORR).expect("the built-in weights")
    }

    #[test]
    fn all_instruction_sets_give_the_same_bits() {
        let (network, photos) = (network(), photos(Size::new(104, 72), 3));
        let whole = estimate(&network, &photos);
        let sets = [
            Widest::Any,
            #[cfg(target_arch = "x86_64")]
            Widest::Avx2,
        ];
        for set in sets {
            *ALLOWED.write().expect("no test has failed while it wrote") = Some(set);
            let narrow = estimate(&network, &photos);
            assert_eq!(narrow.map.depth.data(), whole.map.depth.data(), "{set:?}");
            assert_eq!(narrow.map.confidence.data(), whole.map.confidence.data(), "{set:?}");
            assert_eq!(narrow.surface.data(), whole.surface.data(), "{set:?}");
        }
        *ALLOWED.write().expect("no test has failed while it wrote") = None;
    }

    #[test]
    fn a_wall_is_where_it_is() {
        let estimate = estimate(&network(), &photos(Size::new(256, 192), 4));
        assert_eq!(estimate.map.depth.size(), Size::new(64, 48));
        let close =
            estimate.map.depth.data().iter().filter(|depth| (*depth - 5.0).abs() < 0.05 * 5.0).count();
        assert!(close > 64 * 48 * 8 / 10, "{close} of {} pixels within 5 %", 64 * 48);
    }

    #[test]
    fn inputs_that_cannot_be_are_refused() {
        let (network, photos) = (network(), photos(Size::new(64, 48), 1));
        let small =
            Photo { camera: Pinhole { size: Size::new(64, 16), ..photos[0].camera }, ..photos[0].clone() };
        assert!(network.encode(&small).expect_err("a small one").to_string().contains("32×32"));
        let view = network.encode(&photos[0]).expect("a photograph");
        let range = DepthRange { near: 3.0, far: 12.0 };
        let planes = |count| Planes { range, count, spacing: Spacing::Depth };
        let mut run = |_, run: &mut dyn FnMut()| run();
        let said = network.estimate(&view, &[], &planes(8), &mut run).expect_err("no source").to_string();
        assert!(said.contains("source view"), "{said}");
        let said =
            network.estimate(&view, &[&view], &planes(1), &mut run).expect_err("one plane").to_string();
        assert!(said.contains("2 planes"), "{said}");
        assert!(view.cropped(&PixelBox { x0: 90, y0: 0, x1: 99, y1: 9 }).is_err());
    }
}
