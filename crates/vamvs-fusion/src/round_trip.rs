//! Projects pixels of a reference view to the surface of a source view and back, many at once.
//!
//! A pixel with its depth is projected into the source view, and the depth there is projected back
//! to the reference view. If both see the same surface, it comes back near the pixel and near its
//! depth (section 4.2.2).

#![allow(
    clippy::needless_range_loop,
    reason = "one lane of many arrays at a time, as the compiler turns into vectors"
)]

use crate::lanes::{
    BLOCK, Block, LANES, Lanes, any_of_block, any_positive, bits, block, block_mut, fmax, fmin,
};
use crate::pair::Pair;
use crate::sample::{Sample, pairs};
use vamvs_core::widened;

/// Pixels of one row of the reference view.
#[derive(Clone, Debug)]
pub(crate) struct Strip {
    /// Image coordinate of the row's centres.
    pub y: f32,
    /// Image coordinates of the pixels' centres.
    pub x: Lanes,
    /// Inverse depths; 0 for lanes without a pixel, or anything where only some lanes are asked about.
    pub inverse_depth: Lanes,
}

/// The answers of a source view for the pixels of a strip.
#[derive(Clone, Debug)]
pub(crate) struct Answers {
    /// The reprojection error or the relative error of the depth, whichever is larger as a share of
    /// its threshold: below 1 the source agrees. Infinite where the source sees nothing.
    pub error: Lanes,
    /// The source's inverse depth.
    pub inverse_depth: Lanes,
    /// The index of the source's pixel in its rasters.
    pub pixel: Lanes<u32>,
    /// The square root of that pixel's confidence.
    pub sureness: Lanes,
    /// The source's surface point as a homogeneous pixel of the reference view, divided by the
    /// source depth.
    pub back: [Lanes; 3],
    /// The triangulation angle, radians, in small-angle approximation.
    pub parallax: Lanes,
    /// The point's own inverse depth in the source view, 0 outside of the image.
    pub expected: Lanes,
    /// The inverse of the nearest of the source's four depths around; infinite where one of them is missing. Where nothing is
    /// expected it has no meaning; in blocks that were not asked it is infinite.
    pub nearest_inverse_depth: Lanes,
}

impl Strip {
    /// A strip without pixels in the row whose centre is at `y`.
    pub fn empty(y: f32) -> Self {
        Self { y, x: [0.0; LANES], inverse_depth: [0.0; LANES] }
    }

    /// The pixels of row `y` from `first` on; `row` has their samples.
    pub fn of_row(y: usize, first: usize, row: &[Sample]) -> Self {
        let mut strip = Self::empty(y as f32 + 0.5);
        strip.inverse_depth.iter_mut().zip(row).for_each(|(to, sample)| *to = sample.inverse_depth());
        let centres = (first..).map(|x| x as f32 + 0.5);
        strip.x.iter_mut().zip(centres).for_each(|(to, x)| *to = x);
        strip
    }
}

impl Answers {
    /// Room for answers.
    pub fn new() -> Self {
        let none = [0.0; LANES];
        Self {
            error: [f32::INFINITY; LANES],
            inverse_depth: none,
            pixel: [0; LANES],
            sureness: none,
            back: [none; 3],
            parallax: none,
            expected: none,
            nearest_inverse_depth: [f32::INFINITY; LANES],
        }
    }

    /// The lanes in which the source agrees, one bit each.
    pub fn agreeing(&self) -> u64 {
        let mut agrees = [false; LANES];
        agrees.iter_mut().zip(&self.error).for_each(|(agrees, error)| *agrees = *error < 1.0);
        bits(&agrees)
    }
}

widened! {
    /// Computes the answers of the source view of a pair for the pixels of a strip that are `open`, one bit each, and for
    /// others in their [`BLOCK`]s. In blocks without an open pixel the source sees nothing.
    pub(crate) fn ask(pair: &Pair<'_>, strip: &Strip, open: u64, answers: &mut Answers) = ask_any;
}

/// Where the pixels of a block are seen in the source view.
struct Seen {
    /// Image coordinates.
    at: [Block; 2],
    /// The points' inverse depths there; 0 outside of the image.
    inverse_depth: Block,
    /// The upper left of the four pixels around, clamped to the image.
    corner: [Block; 2],
    /// Its index in the rasters.
    place: Block<u32>,
}

/// Four pixels each: upper left, upper right, lower left, lower right.
type Corners = [Block<Sample>; 4];

// No closures from here on: they would not be compiled for the widest vectors.
#[inline(always)]
fn ask_any(pair: &Pair<'_>, strip: &Strip, open: u64, answers: &mut Answers) {
    let size = pair.source.size();
    let has_surface = size.width >= 2 && size.height >= 2;
    for number in 0..LANES / BLOCK {
        if !(any_of_block(open, number) && has_surface && ask_block(pair, strip, number, answers)) {
            *block_mut(&mut answers.error, number) = [f32::INFINITY; BLOCK];
            *block_mut(&mut answers.nearest_inverse_depth, number) = [f32::INFINITY; BLOCK];
        }
    }
}

/// Computes the answers for a block; returns false, and leaves it as it is, if the source view sees none of its pixels.
#[inline(always)]
fn ask_block(pair: &Pair<'_>, strip: &Strip, number: usize, answers: &mut Answers) -> bool {
    let seen = project(pair, strip, number, answers);
    if !any_positive(&seen.inverse_depth) {
        return false;
    }
    let corners = gather(pair.source.samples.data(), pair.source.size().width, &seen.place);
    let at = sample(pair, &seen, &corners, number, answers);
    come_back(pair, strip, (&at, &seen.inverse_depth), number, answers);
    true
}

widened! {
    /// The inverse depths of a strip's points in the source view's camera; not positive behind it.
    pub(crate) fn inverse_depths_in_source(pair: &Pair<'_>, strip: &Strip, found: &mut Lanes) = inverse_depths_any;
}

#[inline(always)]
fn inverse_depths_any(pair: &Pair<'_>, strip: &Strip, found: &mut Lanes) {
    let (m, o) = (&pair.to_source.linear, &pair.to_source.offset);
    let row = m[(2, 1)] * strip.y + m[(2, 2)];
    for lane in 0..LANES {
        let w = strip.inverse_depth[lane];
        found[lane] = w / (m[(2, 0)] * strip.x[lane] + row + o.z * w);
    }
}

#[inline(always)]
fn project(pair: &Pair<'_>, strip: &Strip, number: usize, answers: &mut Answers) -> Seen {
    let size = pair.source.size();
    let (width, height) = (size.width as f32, size.height as f32);
    let (m, o) = (&pair.to_source.linear, &pair.to_source.offset);
    let row_x = m[(0, 1)] * strip.y + m[(0, 2)];
    let row_y = m[(1, 1)] * strip.y + m[(1, 2)];
    let row_z = m[(2, 1)] * strip.y + m[(2, 2)];
    let (columns, inverse_depths) = (block(&strip.x, number), block(&strip.inverse_depth, number));
    let parallax = block_mut(&mut answers.parallax, number);
    let none = [0.0; BLOCK];
    let mut seen = Seen { at: [none; 2], inverse_depth: none, corner: [none; 2], place: [0; BLOCK] };
    for lane in 0..BLOCK {
        let (x, w) = (columns[lane], inverse_depths[lane]);
        let z = m[(2, 0)] * x + row_z + o.z * w;
        let per_z = 1.0 / z;
        let u = (m[(0, 0)] * x + row_x + o.x * w) * per_z;
        let v = (m[(1, 0)] * x + row_y + o.y * w) * per_z;
        let inside = (w > 0.0) & (z > 0.0) & (u >= 0.0) & (v >= 0.0) & (u < width) & (v < height);
        // Lanes outside of the image use its first pixel.
        let (u, v) = if inside { (u, v) } else { (0.5, 0.5) };
        let (du, dv) = (o.x - o.z * u, o.y - o.z * v);
        parallax[lane] = (du * du + dv * dv).sqrt() * (w * per_z).abs() * pair.radians_per_pixel;
        let left = whole(fmin(fmax(u - 0.5, 0.0), width - 2.0));
        let top = whole(fmin(fmax(v - 0.5, 0.0), height - 2.0));
        seen.at[0][lane] = u;
        seen.at[1][lane] = v;
        seen.inverse_depth[lane] = if inside { w * per_z } else { 0.0 };
        seen.corner[0][lane] = left as f32;
        seen.corner[1][lane] = top as f32;
        seen.place[lane] = (top * size.width as i32 + left) as u32;
    }
    seen
}

/// The reference view's next row is likely seen in the source view's next row, which is brought
/// into the cache.
pub(crate) const PREFETCH_ROWS: usize = 2;

/// Lanes from one prefetch to the next: half of the samples in a cache line.
const PREFETCH_STEP: usize = 8;

/// Begins to bring the cache line of `values[at]` into the cache, if there is such a value.
#[inline(always)]
pub(crate) fn prefetch<T>(values: &[T], at: usize) {
    #[cfg(target_arch = "x86_64")]
    if at < values.len() {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        // SAFETY: the address is that of a value.
        unsafe { _mm_prefetch::<_MM_HINT_T0>(values.as_ptr().add(at).cast()) }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (values, at);
}

/// The four pixels each whose upper left one is at a place.
#[inline(always)]
fn gather(samples: &[Sample], width: usize, places: &Block<u32>) -> Corners {
    for lane in (0..BLOCK).step_by(PREFETCH_STEP) {
        prefetch(samples, places[lane] as usize + PREFETCH_ROWS * width);
    }
    let mut last = 0;
    for lane in 0..BLOCK {
        last = if places[lane] > last { places[lane] } else { last };
    }
    assert!(last as usize + width + 1 < samples.len(), "corners are clamped to the image");
    let mut corners = [[Sample::NONE; BLOCK]; 4];
    for first in (0..BLOCK).step_by(4) {
        let upper = [places[first], places[first + 1], places[first + 2], places[first + 3]];
        let below = width as u32;
        let lower = [upper[0] + below, upper[1] + below, upper[2] + below, upper[3] + below];
        // SAFETY: the last place was checked, and all others come before it.
        let ([a, b], [c, d]) = unsafe { (pairs(samples, upper), pairs(samples, lower)) };
        corners[0][first..first + 4].copy_from_slice(&a);
        corners[1][first..first + 4].copy_from_slice(&b);
        corners[2][first..first + 4].copy_from_slice(&c);
        corners[3][first..first + 4].copy_from_slice(&d);
    }
    corners
}

/// The source's inverse depth at the place: bilinear (linear beyond the outermost centres) where
/// the four pixels around agree, else that of the nearest pixel, at its centre. Returns the image
/// coordinates of the sample.
#[inline(always)]
fn sample(
    pair: &Pair<'_>,
    seen: &Seen,
    corners: &Corners,
    number: usize,
    answers: &mut Answers,
) -> [Block; 2] {
    let width = pair.source.size().width as u32;
    let max_spread = pair.max_relative_depth;
    let inverse_depth = block_mut(&mut answers.inverse_depth, number);
    let pixel = block_mut(&mut answers.pixel, number);
    let sureness = block_mut(&mut answers.sureness, number);
    let expected = block_mut(&mut answers.expected, number);
    let frontmost = block_mut(&mut answers.nearest_inverse_depth, number);
    let mut at = [[0.0; BLOCK]; 2];
    for lane in 0..BLOCK {
        let (a, b) = (corners[0][lane].inverse_depth(), corners[1][lane].inverse_depth());
        let (c, d) = (corners[2][lane].inverse_depth(), corners[3][lane].inverse_depth());
        let (lowest, highest) = (fmin(fmin(a, b), fmin(c, d)), fmax(fmax(a, b), fmax(c, d)));
        let (left, top) = (seen.corner[0][lane], seen.corner[1][lane]);
        let (s, t) = (seen.at[0][lane] - 0.5 - left, seen.at[1][lane] - 0.5 - top);
        let (upper, lower) = (a + s * (b - a), c + s * (d - c));
        let smooth = (lowest > 0.0) & (highest - lowest <= max_spread * lowest);
        let (is_right, is_lower) = (s >= 0.5, t >= 0.5);
        let (row_left, row_right) = if is_lower {
            (corners[2][lane], corners[3][lane])
        } else {
            (corners[0][lane], corners[1][lane])
        };
        let nearest = if is_right { row_right } else { row_left };
        inverse_depth[lane] = if smooth { upper + t * (lower - upper) } else { nearest.inverse_depth() };
        sureness[lane] = nearest.sureness();
        pixel[lane] = seen.place[lane] + u32::from(is_right) + if is_lower { width } else { 0 };
        expected[lane] = seen.inverse_depth[lane];
        frontmost[lane] = if lowest > 0.0 { highest } else { f32::INFINITY };
        let centre = (left + if is_right { 1.5 } else { 0.5 }, top + if is_lower { 1.5 } else { 0.5 });
        at[0][lane] = if smooth { seen.at[0][lane] } else { centre.0 };
        at[1][lane] = if smooth { seen.at[1][lane] } else { centre.1 };
    }
    at
}

#[inline(always)]
fn come_back(
    pair: &Pair<'_>,
    strip: &Strip,
    (at, expected): (&[Block; 2], &Block),
    number: usize,
    answers: &mut Answers,
) {
    let (m, o) = (&pair.to_reference.linear, &pair.to_reference.offset);
    let (columns, own) = (block(&strip.x, number), block(&strip.inverse_depth, number));
    let theirs = block(&answers.inverse_depth, number);
    let error = block_mut(&mut answers.error, number);
    let back = answers.back.each_mut().map(|lanes| block_mut(lanes, number));
    let per_max_relative_depth = pair.max_relative_depth.recip();
    let per_max_reprojection = pair.max_reprojection.recip();
    for lane in 0..BLOCK {
        let (u, v, w) = (at[0][lane], at[1][lane], theirs[lane]);
        let x = m[(0, 0)] * u + m[(0, 1)] * v + m[(0, 2)] + o.x * w;
        let y = m[(1, 0)] * u + m[(1, 1)] * v + m[(1, 2)] + o.y * w;
        let z = m[(2, 0)] * u + m[(2, 1)] * v + m[(2, 2)] + o.z * w;
        // The depth that comes back is z / w, with w the source's inverse depth.
        let per_both = 1.0 / (w * z);
        let depth_error = (z * own[lane] - w).abs() * (z * per_both) * per_max_relative_depth;
        let (dx, dy) = (x - columns[lane] * z, y - strip.y * z);
        let way = (dx * dx + dy * dy).sqrt() * (w * per_both) * per_max_reprojection;
        let sees = (expected[lane] > 0.0) & (w > 0.0) & (z > 0.0);
        error[lane] = if sees { fmax(depth_error, way) } else { f32::INFINITY };
        back[0][lane] = x;
        back[1][lane] = y;
        back[2][lane] = z;
    }
}

/// The integer part of an image coordinate. `as` would check the range of every lane.
#[inline(always)]
fn whole(coordinate: f32) -> i32 {
    // SAFETY: coordinates are clamped to 0 and a raster's size, which is far below 2³¹; they are never NaN because
    // `fmax` gives its second argument then.
    unsafe { coordinate.to_int_unchecked() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::photometric::FilteredView;
    use crate::{FuseOptions, MaskedMap};
    use nalgebra::Vector3;
    use vamvs_core::{DepthMap, Grid, Intrinsics, Pinhole, Pose, Size};

    const SIZE: Size = Size::new(80, 60);

    /// A camera at (x, 0, 0) that looks along z and sees these depths.
    fn view(x: f64, depth: Grid<f32>, options: &FuseOptions) -> FilteredView {
        let intrinsics = Intrinsics { fx: 100.0, fy: 100.0, cx: 40.0, cy: 30.0 };
        let map = DepthMap {
            camera: Pinhole { size: depth.size(), intrinsics },
            cam_from_world: Pose { translation: Vector3::new(-x, 0.0, 0.0), ..Pose::identity() },
            confidence: Grid::filled(depth.size(), 1.0),
            depth,
            coarse_confidence: None,
        };
        FilteredView::new(0, &MaskedMap { map, mask: None }, options).unwrap()
    }

    fn wall(x: f64, depth: f32, options: &FuseOptions) -> FilteredView {
        view(x, Grid::filled(SIZE, depth), options)
    }

    /// The answer of `source` for a wall at depth 4 seen from the origin at image coordinates (x,
    /// 30.5), in one lane of an otherwise empty strip.
    fn answer(source: &FilteredView, x: f32, inverse_depth: f32, options: &FuseOptions) -> Answers {
        let pair = Pair::new(&wall(0.0, 4.0, options), 1, source, options);
        let mut strip = Strip::empty(30.5);
        (strip.x[17], strip.inverse_depth[17]) = (x, inverse_depth);
        let mut answers = Answers::new();
        ask(&pair, &strip, 1 << 17, &mut answers);
        let mut plain = Answers::new();
        ask_any(&pair, &strip, 1 << 17, &mut plain);
        assert_eq!(format!("{answers:?}"), format!("{plain:?}"), "wide vectors change nothing");
        assert_eq!(answers.agreeing() & !(1 << 17), 0, "empty lanes agree with nothing");
        answers
    }

    /// Whether a camera one unit to the side agrees on a wall at depth 4 that it sees at 4 (1 +
    /// error).
    fn agrees(error: f32, max_reprojection: f32, max_relative_depth: f32) -> bool {
        let options = FuseOptions { max_reprojection, max_relative_depth, ..FuseOptions::default() };
        answer(&wall(1.0, 4.0 * (1.0 + error), &options), 50.5, 0.25, &options).agreeing() != 0
    }

    #[test]
    fn both_the_way_back_and_the_depth_are_bounded() {
        // The disparity is 25 pixels, so 3 % of depth are 0.75 · 1/1.03 = 0.728 pixels of the way.
        for (error, way) in [(0.03, 0.7281), (-0.03, 0.7732), (0.002, 0.0499)] {
            assert!(agrees(error, way + 1e-3, 0.05) && !agrees(error, way - 1e-3, 0.05), "{error}");
            let depth = error.abs();
            assert!(agrees(error, 2.0, depth + 1e-5) && !agrees(error, 2.0, depth - 1e-5), "{error}");
        }
    }

    #[test]
    fn what_the_source_does_not_see_gets_no_agreement() {
        let options = FuseOptions::default();
        let source = wall(1.0, 4.0, &options);
        let agrees = |x, w| answer(&source, x, w, &options).agreeing() != 0;
        assert!(agrees(25.5, 0.25));
        assert!(!agrees(24.5, 0.25), "25 pixels to the left is outside");
        assert!(!agrees(50.5, -0.25), "behind the camera");
        let line = view(1.0, Grid::filled(Size::new(80, 1), 4.0), &options);
        assert_eq!(answer(&line, 50.5, 0.25, &options).agreeing(), 0, "one row is no surface");
    }

    #[test]
    fn blocks_without_an_open_pixel_are_not_asked() {
        let options = FuseOptions::default();
        let (reference, source) = (wall(0.0, 4.0, &options), wall(1.0, 4.0, &options));
        let pair = Pair::new(&reference, 1, &source, &options);
        let strip = Strip::of_row(30, 16, &reference.samples.row(30)[16..]);
        let mut answers = Answers::new();
        let mut asked = |open| {
            ask(&pair, &strip, open, &mut answers);
            (answers.agreeing(), answers.nearest_inverse_depth.map(f32::is_finite))
        };
        // Pixels left of column 25 are outside of the source view.
        assert_eq!(asked(u64::MAX).0, u64::MAX << 9);
        let (agreeing, is_seen) = asked(1 << 20 | 1 << 63);
        assert_eq!(agreeing, 0xffff_0000_ffff_0000, "what was answered before is gone");
        assert_eq!(bits(&is_seen), agreeing);
    }

    #[test]
    fn an_answer_tells_where_the_surface_is_and_at_which_angle_it_is_seen() {
        let options = FuseOptions::default();
        let answers = answer(&wall(1.0, 4.02, &options), 50.5, 0.25, &options);
        assert_eq!(answers.pixel[17], 30 * 80 + 25);
        // Seen at x = 25.5, 0.145 left of the source's axis per unit of depth.
        let expected = [1.0 - 0.145 * 4.02, 0.005 * 4.02, 4.02].map(|c: f32| c / 4.02);
        let [x, y, z] = answers.back.map(|lanes| lanes[17]);
        let found = [(x / z - 40.0) / 100.0, (y / z - 30.0) / 100.0, 1.0];
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-5), "{found:?} {expected:?}");
        assert!((answers.inverse_depth[17] - 1.0 / 4.02).abs() < 1e-6);
        assert!((answers.parallax[17] - 0.25).abs() < 1e-3, "one unit beside at a distance of four");
    }

    #[test]
    fn a_surface_behind_the_point_is_told_from_one_before_it() {
        let options = FuseOptions::default();
        let found = |source: &FilteredView| {
            let answers = answer(source, 50.5, 0.25, &options);
            (answers.expected[17], answers.nearest_inverse_depth[17])
        };
        let (expected, nearest) = found(&wall(1.0, 5.0, &options));
        assert!((expected - 0.25).abs() < 1e-6 && (nearest - 0.2).abs() < 1e-6);
        let mut edge = Grid::filled(SIZE, 8.0);
        edge[(25, 30)] = 4.0;
        let source = view(1.0, edge, &options);
        assert!((found(&source).1 - 0.25).abs() < 1e-6, "one of the pixels around is near");
        assert_eq!(answer(&source, 24.5, 0.25, &options).nearest_inverse_depth[17], f32::INFINITY, "outside");
    }

    #[test]
    fn samples_interpolate_on_a_surface_and_not_across_an_edge() {
        let options = FuseOptions::default();
        let slope = |x: usize| if x < 2 { 1.0 / (1.0 + 0.008 * x as f32) } else { 5.0 };
        let source = view(0.0, Grid::from_fn(Size::new(4, 60), |x, _| slope(x)), &options);
        let at = |x| answer(&source, x, 1.0, &options);
        for (x, expected) in [(1.0, 1.004), (0.0, 0.996), (1.9, 1.008), (2.1, 0.2)] {
            let found = at(x).inverse_depth[17];
            assert!((found - expected).abs() < 4e-6 * expected, "{x}: {found}");
        }
        assert_eq!([at(0.0), at(1.9), at(3.9)].map(|answers| answers.pixel[17] % 4), [0, 1, 3]);
        for x in [-0.01, 4.0, f32::NAN] {
            assert_eq!(at(x).agreeing(), 0);
        }
    }
}
