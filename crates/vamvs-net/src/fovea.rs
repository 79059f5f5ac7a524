//! Foveated depth (section 4.5): coarse depth for the whole image, finer iterations only in and around a region.
//!
//! The coarse map covers the whole image, the map at the finest scale covers the region alone, and the maps at
//! scales between cover the region grown by a fraction of its size. The result is a cloud of several densities
//! at about the cost of the region.

use tch::Tensor;
use vamvs_core::roi::PixelBox;
use vamvs_core::{DepthMap, Grid, Pinhole, Planes, Size};

use crate::coarse::PlaneMap;
use crate::point_flow::upsample_nearest;
use crate::profile::Profile;
use crate::project::depth_of;
use crate::tensor_grid::to_grid;
use crate::{Coarse, EncodedView, Estimator, NetError};

/// A map at `scale` covers the region grown on each side by GROWTH · (scale / finest scale − 1) of its size.
const GROWTH: f64 = 0.25;

/// The halo around a region that is computed too, so that points at its border have neighbours: pixels of the
/// enlarged photograph.
const MARGIN: usize = 32;

/// The depth map of a part of the image at one scale. Boxes are in pixels of the enlarged photograph.
struct Layer {
    scale: usize,
    /// The part that was computed, halo included; its sides are multiples of 8.
    computed: PixelBox,
    /// The part that is output.
    shown: PixelBox,
    map: PlaneMap,
}

impl Estimator {
    /// Estimates the depth of `reference` with all iterations inside `region` (pixels of the photograph) and
    /// fewer outside it. Returns one depth map for each resolution, the coarsest first; the last has the size
    /// that [`Estimator::estimate`] gives. Each map has depth only where no finer one has, so together they cover
    /// every part of the image once. Without a region there is one map, at the coarse resolution.
    ///
    /// # Errors
    /// As [`Estimator::estimate`], and if the region is outside the image.
    pub fn estimate_foveated(
        &self,
        reference: &EncodedView,
        sources: &[&EncodedView],
        planes: &Planes,
        region: Option<PixelBox>,
        profile: &mut Profile,
    ) -> Result<Vec<DepthMap>, NetError> {
        self.check(sources, planes)?;
        tch::no_grad(|| {
            let (layers, confidence) = self.layers(reference, sources, planes, region, profile)?;
            let finer = layers.iter().skip(1).map(|layer| Some(layer.shown)).chain([None]);
            let maps = layers.iter().zip(finer);
            maps.map(|(layer, finer)| self.layer_map(reference, planes, layer, finer, &confidence)).collect()
        })
    }

    /// The map of each resolution, the coarsest first, and the confidence of the coarse stage, (h, w).
    fn layers(
        &self,
        reference: &EncodedView,
        sources: &[&EncodedView],
        planes: &Planes,
        region: Option<PixelBox>,
        profile: &mut Profile,
    ) -> Result<(Vec<Layer>, Tensor), NetError> {
        let Coarse { map, visibility, .. } = self.coarse(reference, sources, planes, None, profile)?;
        let confidence = map.confidence.shallow_clone();
        let map = self.completed(map, reference, planes, profile)?;
        let image = reference.camera.size;
        let region = region.map(|region| reference.enlarged(&region));
        let whole = PixelBox { x0: 0, y0: 0, x1: image.width, y1: image.height };
        let (_, padded) = reference.part(&whole)?;
        let mut last = Layer { scale: reference.stride, computed: padded, shown: whole, map };
        let mut layers = Vec::new();
        let iterations = self.iterations();
        let finest = iterations.last().map_or(reference.stride, |last| last.scale);
        for &iteration in &iterations {
            let shown = match (iteration.scale, region) {
                (scale, _) if scale == reference.stride => whole,
                (scale, Some(region)) => grown(region, GROWTH * (scale / finest - 1) as f64, 0, image),
                (_, None) => break,
            };
            let (part, computed) = reference.part(&grown(shown, 0.0, MARGIN, image))?;
            let masks = visibility.iter().map(|mask| cut(mask, 2, computed, reference.stride));
            let masks = masks.collect::<Result<Vec<_>, NetError>>()?;
            let stage = self.flow_stage(&part, sources, planes, &masks, iteration);
            let map = self.iterate(&stage, &last.cut(computed)?, profile)?;
            let before = std::mem::replace(&mut last, Layer { scale: iteration.scale, computed, shown, map });
            if before.scale != iteration.scale {
                layers.push(before);
            }
        }
        layers.push(last);
        Ok((layers, confidence))
    }

    /// A layer as a depth map of the whole image, with depth where the layer is output and outside the `finer` one.
    fn layer_map(
        &self,
        reference: &EncodedView,
        planes: &Planes,
        layer: &Layer,
        finer: Option<PixelBox>,
        coarse_confidence: &Tensor,
    ) -> Result<DepthMap, NetError> {
        let Layer { scale, computed, shown, ref map } = *layer;
        let (image, ratio) = (reference.camera.size, 1.0 / scale as f64);
        let size = Size::new(image.width / scale, image.height / scale);
        let is_shown = |x: usize, y: usize| {
            let centre = (x * scale + scale / 2, y * scale + scale / 2);
            holds(&shown, centre) && !finer.is_some_and(|finer| holds(&finer, centre))
        };
        let placed = |values: &Grid<f32>| {
            let value = |x: usize, y: usize| values[(x - computed.x0 / scale, y - computed.y0 / scale)];
            Grid::from_fn(size, |x, y| if is_shown(x, y) { value(x, y) } else { 0.0 })
        };
        let depth = to_grid(&depth_of(planes, &map.u)?.f_mul_scalar(planes.range.near)?)?;
        let confidence = to_grid(&map.confidence)?;
        let is_last = self.iterations().last().is_none_or(|last| last.scale == scale);
        let confidence = if is_last { self.calibrated(confidence) } else { confidence };
        let coarse = to_grid(&upsample_nearest(coarse_confidence, reference.size_at(scale))?)?;
        Ok(DepthMap {
            camera: Pinhole { size, intrinsics: reference.intrinsics().scaled(ratio, ratio) },
            cam_from_world: reference.cam_from_world,
            depth: placed(&depth),
            confidence: placed(&confidence),
            coarse_confidence: Some(Grid::from_fn(size, |x, y| coarse[(x, y)])),
        })
    }
}

impl Layer {
    /// The plane coordinates of `part`, which lies inside the computed part.
    fn cut(&self, part: PixelBox) -> Result<Tensor, NetError> {
        let PixelBox { x0, y0, x1, y1 } = part;
        let inside = PixelBox {
            x0: x0 - self.computed.x0,
            y0: y0 - self.computed.y0,
            x1: x1 - self.computed.x0,
            y1: y1 - self.computed.y0,
        };
        cut(&self.map.u, 0, inside, self.scale)
    }
}

fn holds(region: &PixelBox, (x, y): (usize, usize)) -> bool {
    (region.x0..region.x1).contains(&x) && (region.y0..region.y1).contains(&y)
}

/// The region grown on each side by a fraction of its size plus a number of pixels, and clipped to the image.
fn grown(region: PixelBox, share: f64, pixels: usize, image: Size) -> PixelBox {
    let more = |side: usize| (share * side as f64).round() as usize + pixels;
    let (x, y) = (more(region.width()), more(region.height()));
    PixelBox {
        x0: region.x0.saturating_sub(x),
        y0: region.y0.saturating_sub(y),
        x1: (region.x1 + x).min(image.width),
        y1: (region.y1 + y).min(image.height),
    }
}

/// Cuts `part` (image pixels) from a map at 1/scale whose rows are dimension `rows` and columns the next one.
fn cut(map: &Tensor, rows: i64, part: PixelBox, scale: usize) -> Result<Tensor, NetError> {
    let of = |pixels: usize| (pixels / scale) as i64;
    let part_rows = map.f_narrow(rows, of(part.y0), of(part.height()))?;
    Ok(part_rows.f_narrow(rows + 1, of(part.x0), of(part.width()))?)
}
