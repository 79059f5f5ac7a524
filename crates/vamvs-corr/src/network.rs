//! The network: photographs in, a depth map out.

use rayon::prelude::*;
use vamvs_core::{MonotoneMap, Photo, Planes, Size};

use crate::CorrError;
use crate::estimate::{Estimate, Found};
use crate::layers::Layers;
use crate::map::Map;
use crate::plane_map::{PlaneMap, enlarged_depth};
use crate::pyramid::{BLOCK, CHANNELS, STRIDE, positive};
use crate::sweep::{GROUPS, Placed, Sweep};
use crate::view::EncodedView;
use crate::weights::{Cascade, Manifest, Weights};
use crate::wide::sigmoids;

/// The network.
#[derive(Debug)]
pub struct Network {
    manifest: Manifest,
    layers: Layers,
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
        Ok(Self { layers: Layers::new(&weights)?, manifest })
    }

    /// Its layers.
    #[must_use]
    pub fn layers(&self) -> &Layers {
        &self.layers
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
        EncodedView::new(&self.layers.pyramid, photo)
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
        check_request(sources.len(), planes)?;
        let (coarse, masks) = self.coarse(reference, sources, planes, time);
        let around = {
            let u = coarse.as_image(&coarse.u);
            enlarged_depth(&u, &self.layers.enlarge.shares(&u, reference.coarse(), reference.fine()))
        };
        let [_, height, width] = reference.fine().sides();
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
            let costs = self.layers.fine.costs(&volume, reference.fine());
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
        let surface = self.layers.surface.probability(evidence, reference.fine());
        let PlaneMap { width, height, u, confidence, .. } = fine;
        let found =
            Found { padded: Size::new(width, height), u, confidence, coarse_confidence, surface, masks };
        Ok(found.estimate(&self.manifest, (reference.camera(), reference.cam_from_world()), planes))
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
            let costs = self.layers.coarse.costs(&volume, reference.coarse());
            map = Some(PlaneMap::of(&costs, size, self.manifest.window));
        });
        (map.expect("the closure has run"), masks)
    }

    /// What a source view sees, (h, w) in [0, 1], from its pooled correlations.
    fn visibility(&self, pooled: &Map) -> Vec<f32> {
        let ([first, second], last) = &self.layers.seen;
        let looked = second.run(&first.run(pooled, positive), positive);
        last.run(&looked, |_, values| sigmoids(values, 1.0))
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

/// Checks that a depth map can be made from so many source views on planes.
///
/// # Errors
/// If there are no source views, or fewer than two planes.
pub fn check_request(sources: usize, planes: &Planes) -> Result<(), CorrError> {
    if sources == 0 {
        return Err(CorrError::Request("a depth map needs at least one source view".to_owned()));
    }
    if planes.count < 2 {
        return Err(CorrError::Request(format!("a sweep needs at least 2 planes, got {}", planes.count)));
    }
    Ok(())
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

#[cfg(test)]
mod tests {
    use vamvs_core::roi::PixelBox;
    use vamvs_core::{DepthRange, Grid, Intrinsics, Pinhole, Pose, Spacing};

    use super::*;
    #[cfg(target_arch = "x86_64")]
    use crate::wide::{ALLOWED, Widest};

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

    #[cfg(target_arch = "x86_64")]
    #[test]
    fn all_instruction_sets_give_the_same_bits() {
        let (network, photos) = (network(), photos(Size::new(104, 72), 3));
        let whole = estimate(&network, &photos);
        let sets = [Widest::Any, Widest::Avx2];
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
