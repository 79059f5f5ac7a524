//! Foveated depth (section 4.5): the whole image coarsely, finer iterations only around and inside a region.
//!
//! The map at 1/8 is of the whole image, the one at the last scale of the region alone, and those between
//! of the region grown by a share of its size: a cloud of several densities, at the cost of the region.

use tch::Tensor;
use vamvs_core::roi::PixelBox;
use vamvs_core::{DepthMap, Grid, Pinhole, Planes, Size};

use crate::coarse::PlaneMap;
use crate::encode::COARSE_SCALE;
use crate::estimator::to_grid;
use crate::point_flow::enlarge;
use crate::profile::Profile;
use crate::project::depth_of;
use crate::{EncodedView, Estimator, NetError};

/// What a region grows by, to each side, for every scale above the last: a share of its size.
const GROWTH: f64 = 0.25;

/// Image pixels around a region that are computed too, so that its border has neighbours.
const MARGIN: usize = 32;

/// The map of a part of the image at one scale.
struct Layer {
    scale: usize,
    /// The part that was computed: image pixels, multiples of 8.
    computed: PixelBox,
    /// The part that is shown: image pixels.
    shown: PixelBox,
    map: PlaneMap,
}

impl Estimator {
    /// The depth map of `reference` with all iterations inside `region` (image pixels), and fewer outside:
    /// there only every second, fourth … pixel of the map has a depth, as many as the iterations that
    /// reached it resolve. Its size is that of [`Estimator::estimate`].
    ///
    /// # Errors
    /// As [`Estimator::estimate`], and if the region is outside of the image.
    pub fn estimate_foveated(
        &self,
        reference: &EncodedView,
        sources: &[&EncodedView],
        planes: &Planes,
        region: PixelBox,
        profile: &mut Profile,
    ) -> Result<DepthMap, NetError> {
        self.check(sources, planes)?;
        tch::no_grad(|| {
            let layers = self.layers(reference, sources, planes, region, profile)?;
            self.foveated_map(reference, planes, &layers)
        })
    }

    /// The map of each iteration, the coarsest first.
    fn layers(
        &self,
        reference: &EncodedView,
        sources: &[&EncodedView],
        planes: &Planes,
        region: PixelBox,
        profile: &mut Profile,
    ) -> Result<Vec<Layer>, NetError> {
        let coarse = self.coarse(reference, sources, planes, None, profile)?;
        let image = reference.camera.size;
        let whole = PixelBox { x0: 0, y0: 0, x1: image.width, y1: image.height };
        let (_, padded) = reference.cropped(&whole)?;
        let first = Layer { scale: COARSE_SCALE, computed: padded, shown: whole, map: coarse.map };
        let mut layers = vec![first];
        let finest = self.options().iterations.last().map_or(COARSE_SCALE, |last| last.scale);
        for &iteration in &self.options().iterations {
            let shown = match iteration.scale {
                COARSE_SCALE => whole,
                scale => grown(region, GROWTH * (scale / finest - 1) as f64, 0, image),
            };
            let (part, computed) = reference.cropped(&grown(shown, 0.0, MARGIN, image))?;
            let before = &layers[layers.len() - 1];
            let u = before.cut(computed)?;
            let visibility = coarse.visibility.iter().map(|mask| cut(mask, 2, computed, COARSE_SCALE));
            let visibility = visibility.collect::<Result<Vec<_>, NetError>>()?;
            let stage = self.flow_stage(&part, sources, planes, &visibility, iteration);
            let map = stage.refine(&u, profile)?;
            layers.push(Layer { scale: iteration.scale, computed, shown, map });
        }
        Ok(layers)
    }

    fn foveated_map(
        &self,
        reference: &EncodedView,
        planes: &Planes,
        layers: &[Layer],
    ) -> Result<DepthMap, NetError> {
        let (first, last) = (&layers[0], &layers[layers.len() - 1]);
        let (image, scale) = (reference.camera.size, last.scale);
        let size = Size::new(image.width / scale, image.height / scale);
        let mut depth = Grid::filled(size, 0.0);
        let mut confidence = Grid::filled(size, 0.0);
        for (index, layer) in layers.iter().enumerate() {
            let of_layer = depth_of(planes, &layer.map.u)?.f_mul_scalar(planes.range.near)?;
            let depths = to_grid(&of_layer)?;
            let confidences = to_grid(&layer.map.confidence)?;
            let confidences =
                if index + 1 == layers.len() { self.calibrated(confidences) } else { confidences };
            let inner = layers.get(index + 1).map(|next| next.shown);
            for (place, from) in layer.places(scale, size, inner) {
                (depth[place], confidence[place]) = (depths[from], confidences[from]);
            }
        }
        let coarse = to_grid(&enlarge(&first.map.confidence, reference.size_at(scale))?)?;
        let ratio = 1.0 / scale as f64;
        Ok(DepthMap {
            camera: Pinhole { size, intrinsics: reference.intrinsics().scaled(ratio, ratio) },
            cam_from_world: reference.cam_from_world,
            depth,
            confidence,
            coarse_confidence: Some(Grid::from_fn(size, |x, y| coarse[(x, y)])),
        })
    }
}

impl Layer {
    /// The map of `part`, which was computed.
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

    /// For each pixel of the layer that is shown and not `inner`: the pixel nearest to its centre in a map
    /// of `size` at the scale `finest`, and the pixel itself in the layer's map.
    fn places(
        &self,
        finest: usize,
        size: Size,
        inner: Option<PixelBox>,
    ) -> impl Iterator<Item = ((usize, usize), (usize, usize))> {
        let Self { scale, computed, shown, .. } = *self;
        let side = move |first: usize, end: usize| (first..end).step_by(scale);
        let cells = side(computed.y0, computed.y1)
            .flat_map(move |y| side(computed.x0, computed.x1).map(move |x| (x, y)));
        let wanted = move |&(x, y): &(usize, usize)| {
            let centre = (x + scale / 2, y + scale / 2);
            holds(&shown, centre) && !inner.is_some_and(|inner| holds(&inner, centre))
        };
        let place = move |(x, y): (usize, usize)| {
            let at = ((x + scale / 2) / finest, (y + scale / 2) / finest);
            let at = if scale == finest { (x / finest, y / finest) } else { at };
            let inside = at.0 < size.width && at.1 < size.height;
            inside.then_some((at, ((x - computed.x0) / scale, (y - computed.y0) / scale)))
        };
        cells.filter(wanted).filter_map(place)
    }
}

fn holds(region: &PixelBox, (x, y): (usize, usize)) -> bool {
    (region.x0..region.x1).contains(&x) && (region.y0..region.y1).contains(&y)
}

/// The region grown by a share of its size and by pixels to each side, inside the image.
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

/// The part of a map at 1/scale, whose rows are dimension `rows` and whose columns are the next.
fn cut(map: &Tensor, rows: i64, part: PixelBox, scale: usize) -> Result<Tensor, NetError> {
    let of = |pixels: usize| (pixels / scale) as i64;
    let part_rows = map.f_narrow(rows, of(part.y0), of(part.height()))?;
    Ok(part_rows.f_narrow(rows + 1, of(part.x0), of(part.width()))?)
}
