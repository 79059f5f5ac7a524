//! Refines depth maps to the full size of their photographs by matching slanted planes, starting from a seed.
//!
//! [`refine`] solves one reference view. The seed is a depth map, which may be far smaller than the photograph. Near
//! its depth, each pixel gets the plane for which the window around the pixel correlates best with the source views.
//! [`refine_geometric`] refines the result with the depth maps that the source views have got in the same way. Where
//! there is no network to give a seed, [`plane_sweep`] does.
//!
//! A plane is stored as inverse depth, which is affine in image coordinates; steps are in pixels of disparity. So
//! nothing depends on the scale, the rotation or the position of the scene. Images are converted to 8-bit luminance;
//! windows are 11×11 pixels with bilateral weights, compared by zero-mean normalised cross-correlation. The result is
//! the same for any number of threads and, bit for bit, for all instruction sets of [`Isa`].
//!
//! The crate reads no files and holds no tensors.

mod above;
#[cfg(target_arch = "x86_64")]
mod avx2;
mod confidence;
mod correlation;
mod descent;
mod energy;
mod field;
mod geometry;
mod growing;
mod isa;
mod luminance;
mod matcher;
pub mod matching;
mod options;
mod planar_prior;
mod plane;
mod plane_fit;
mod plane_sweep;
mod refined;
mod sampling;
mod seed;
mod segments;
mod semi_global;
mod smooth;
mod solve;
mod source;
mod speckle;
mod sweep;
mod tiles;
mod transfer;
mod unseen;
mod window;

use rayon::prelude::*;
use vamvs_core::{DepthMap, Grid, Photo, Size};

pub use isa::Isa;
pub use options::RefineOptions;
pub use plane_sweep::{SWEEP_STRIDE, plane_sweep, sweep_bytes};
pub use refined::{Refined, Surface};
pub use source::MOST_SOURCES;

use field::{Field, State};
use geometry::Geometry;
use matcher::Matcher;
use matching::{Begin, Device};
use plane::Plane;

/// What refining takes for each pixel that is refined at once, bytes: planes, and images of the reference view and its
/// sources.
const BYTES_PER_PIXEL: u64 = 236;

/// What the result takes for each pixel, bytes: depth, confidence, standard deviation and normal.
const RESULT_BYTES: u64 = 24;

/// The correlation from which photographs alone tell a depth.
const FOUNDED: f32 = 0.5;

/// The confidence from which a seed tells a depth.
const LEAST_SEED: f32 = 0.05;

/// The inputs of a refinement.
#[derive(Clone, Copy)]
pub(crate) struct Problem<'a> {
    pub reference: &'a Photo,
    pub sources: &'a [&'a Photo],
    pub visibility: &'a [Grid<f32>],
    pub options: &'a RefineOptions,
    /// What matches planes in place of the processor.
    pub device: Option<&'a dyn matching::Device>,
}

/// Why a depth map cannot be refined.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum RefineError {
    /// There is no source view.
    #[error("expected at least one source view to refine a depth map with, got none")]
    NoSource,
    /// A photograph is smaller than 16×16 pixels.
    #[error("expected photographs of at least 16×16 pixels, got one of {0}")]
    TooSmall(Size),
    /// An option is out of its range.
    #[error("{name} must be {expected}, got {found}")]
    Option {
        /// The option.
        name: &'static str,
        /// What is allowed.
        expected: &'static str,
        /// Its value.
        found: String,
    },
    /// A depth map or a grid has no pixels.
    #[error("expected a depth map or grid with pixels, got one of {0}")]
    Empty(Size),
    /// There are fewer grids than source views.
    #[error("expected one {what} for each of the {expected} source views, got {found}")]
    Count {
        /// What there must be for each source view.
        what: &'static str,
        /// Number of source views.
        expected: usize,
        /// Number of grids.
        found: usize,
    },
    /// A camera, mask or grid does not have the size of the image that it belongs to.
    #[error("expected a size of {expected} for the {what}, got {found}")]
    Size {
        /// What has another size.
        what: &'static str,
        /// The size of the image that it belongs to.
        expected: Size,
        /// Its size.
        found: Size,
    },
    /// A device fails that matches planes.
    #[error(transparent)]
    Device(#[from] matching::DeviceError),
}

/// Refines a depth map to the size of the reference photograph, or to a half or a quarter of it
/// ([`RefineOptions::halvings`]).
///
/// `seed` is a depth map of the reference view at any scale; its holes are filled from the nearest depth before the
/// search. `visibility` holds a grid for each source: how likely the source sees what each reference pixel shows, in
/// [0, 1], at any size; it may be empty. Pixels outside of the reference's mask get no depth.
///
/// # Errors
/// If an option is out of its range, there is no source, or sizes or counts do not fit together.
pub fn refine(
    reference: &Photo,
    sources: &[&Photo],
    seed: &DepthMap,
    visibility: &[Grid<f32>],
    options: &RefineOptions,
) -> Result<Refined, RefineError> {
    refine_on(None, reference, sources, (seed, visibility), options)
}

/// As [`refine`], with planes matched by a device, if there is one.
///
/// # Errors
/// As [`refine`], and if the device fails.
pub fn refine_on(
    device: Option<&dyn Device>,
    reference: &Photo,
    sources: &[&Photo],
    (seed, visibility): (&DepthMap, &[Grid<f32>]),
    options: &RefineOptions,
) -> Result<Refined, RefineError> {
    let sources = &sources[..sources.len().min(MOST_SOURCES)];
    options.validate()?;
    check(reference, sources)?;
    check_map(["seed's camera", "seed's confidence"], seed)?;
    if !visibility.is_empty() && visibility.len() < sources.len() {
        let (expected, found) = (sources.len(), visibility.len());
        return Err(RefineError::Count { what: "visibility", expected, found });
    }
    visibility.iter().take(sources.len()).try_for_each(|grid| check_not_empty(grid.size()))?;
    if !tiles::are_needed(reference.image.size(), options) {
        return refined_whole(&Problem { reference, sources, visibility, options, device }, seed);
    }
    tiles::refined((reference, sources), seed, (options, solve::last_level(options)), |tile| {
        let visible = |grid| tile.part_of(grid, reference.image.size());
        let visibility: Vec<Grid<f32>> = visibility.iter().take(sources.len()).map(visible).collect();
        let sources: Vec<&Photo> = tile.sources.iter().collect();
        let (reference, visibility) = (&tile.reference, &visibility);
        refined_whole(&Problem { reference, sources: &sources, visibility, options, device }, seed)
    })
}

/// What refinement takes at its peak beside the photographs, bytes.
#[must_use]
pub fn peak_bytes(photograph: Size, options: &RefineOptions) -> u64 {
    BYTES_PER_PIXEL * tiles::most_pixels(photograph, options) as u64 + RESULT_BYTES * photograph.area() as u64
}

/// [`refine`] in one piece.
fn refined_whole(problem: &Problem<'_>, seed: &DepthMap) -> Result<Refined, RefineError> {
    let (reference, options) = (problem.reference, problem.options);
    let (mut field, guesses, matcher) = solve::solve(problem, seed)?;
    let ratio = (matcher.image.size.width / guesses.width().max(1)).max(1);
    let seed = |x: usize, y: usize| {
        let cell = ((x / ratio).min(guesses.width() - 1), (y / ratio).min(guesses.height() - 1));
        let guess = &guesses[cell];
        let plane = guess.trusted().enlarged(ratio as f32, cell, (x, y));
        (plane, confidence::UNMATCHED * guess.confidence.max(0.0))
    };
    finish(&mut field, &matcher, seed);
    let camera = source::reduced(&reference.camera, solve::last_level(options));
    Ok(refined::refined((camera, reference.cam_from_world), &field, &matcher, seed))
}

/// Refines a result of [`refine`] once more, to the size of the photograph, with depth maps of the source views
/// (`None` for a source that has none): the energy of a plane then also has a cost for missing the sources' own
/// surfaces. `first` must have the size of the photograph or half of it.
///
/// # Errors
/// If an option is out of its range, there is no source, or sizes or counts do not fit together.
pub fn refine_geometric(
    reference: &Photo,
    sources: &[&Photo],
    first: &Surface<'_>,
    depths: &[Option<&DepthMap>],
    options: &RefineOptions,
) -> Result<Refined, RefineError> {
    refine_geometric_on(None, reference, sources, (first, depths), options)
}

/// As [`refine_geometric`], with planes matched by a device, if there is one.
///
/// # Errors
/// As [`refine_geometric`], and if the device fails.
pub fn refine_geometric_on(
    device: Option<&dyn Device>,
    reference: &Photo,
    sources: &[&Photo],
    (first, depths): (&Surface<'_>, &[Option<&DepthMap>]),
    options: &RefineOptions,
) -> Result<Refined, RefineError> {
    let sources = &sources[..sources.len().min(MOST_SOURCES)];
    options.validate()?;
    check(reference, sources)?;
    check_map(["first camera", "first confidence"], first.map)?;
    let (whole, found) = (reference.camera.size, first.map.depth.size());
    let is_half = found == source::reduced(&reference.camera, 1).size;
    if !is_half {
        check_size("first depth map", whole, found)?;
    }
    check_size("first normals", found, first.normals.size())?;
    if depths.len() < sources.len() {
        let (expected, found) = (sources.len(), depths.len());
        return Err(RefineError::Count { what: "depth map or None", expected, found });
    }
    let of_sources = depths.iter().take(sources.len()).flatten();
    of_sources.into_iter().try_for_each(|map| check_map(["source's camera", "source's confidence"], map))?;
    let problem = Problem { reference, sources, visibility: &[], options, device };
    if !tiles::are_needed(whole, options) {
        return refined_again(&problem, first, depths);
    }
    tiles::refined((reference, sources), first.map, (options, 0), |tile| {
        let part = tile.outer.reduced(if is_half { 2 } else { 1 });
        let (map, normals) = (first.map.cropped(part), first.normals.cropped(part));
        let sources: Vec<&Photo> = tile.sources.iter().collect();
        let of_source = |(source, map): (usize, &Option<&DepthMap>)| map.map(|map| tile.map_of(source, map));
        let maps: Vec<Option<DepthMap>> = depths[..sources.len()].iter().enumerate().map(of_source).collect();
        let maps: Vec<Option<&DepthMap>> = maps.iter().map(Option::as_ref).collect();
        let problem =
            Problem { reference: &tile.reference, sources: &sources, visibility: &[], options, device };
        refined_again(&problem, &Surface { map: &map, normals: &normals }, &maps)
    })
}

/// [`refine_geometric`] in one piece.
fn refined_again(
    problem: &Problem<'_>,
    first: &Surface<'_>,
    depths: &[Option<&DepthMap>],
) -> Result<Refined, RefineError> {
    let (reference, found) = (problem.reference, first.map.depth.size());
    let is_half = found != reference.camera.size;
    let here = (&reference.camera, &reference.cam_from_world);
    let of_source = |(photo, depth): (&&Photo, &Option<&DepthMap>)| {
        depth.map(|depth| Geometry::new(depth, (&photo.camera, &photo.cam_from_world), here))
    };
    let matcher = solve::matcher(problem, 0).with_depths(problem.sources.iter().zip(depths).map(of_source));
    let planes = Field::new(found, |x, y| State::unjudged(first.plane(x, y)));
    let own = |x: usize, y: usize| {
        if is_half { solve::parent(&planes, x, y).0 } else { planes.at(x, y).plane }
    };
    let mut field = matching::planes(&matcher, Begin::Planes(&planes, None), problem.device)?;
    let ratio = if is_half { 2 } else { 1 };
    let inside = |at: usize, count: usize| (at / ratio).min(count - 1);
    let confidence =
        |x: usize, y: usize| first.map.confidence[(inside(x, found.width), inside(y, found.height))];
    let seed = |x: usize, y: usize| (own(x, y), confidence(x, y));
    finish(&mut field, &matcher, seed);
    Ok(refined::refined((reference.camera, reference.cam_from_world), &field, &matcher, seed))
}

fn check(reference: &Photo, sources: &[&Photo]) -> Result<(), RefineError> {
    if sources.is_empty() {
        return Err(RefineError::NoSource);
    }
    for photo in sources.iter().chain(&[reference]) {
        let size = photo.image.size();
        if size.width < 16 || size.height < 16 {
            return Err(RefineError::TooSmall(size));
        }
        check_size("camera", size, photo.camera.size)?;
        if let Some(mask) = &photo.mask {
            check_size("mask", size, mask.size())?;
        }
    }
    Ok(())
}

/// Checks that a depth map has pixels, and a camera and a confidence of its size; errors name these `parts`.
fn check_map(parts: [&'static str; 2], map: &DepthMap) -> Result<(), RefineError> {
    let size = map.depth.size();
    check_not_empty(size)?;
    check_size(parts[0], size, map.camera.size)?;
    check_size(parts[1], size, map.confidence.size())
}

fn check_not_empty(size: Size) -> Result<(), RefineError> {
    if size.area() == 0 { Err(RefineError::Empty(size)) } else { Ok(()) }
}

fn check_size(what: &'static str, expected: Size, found: Size) -> Result<(), RefineError> {
    if expected == found { Ok(()) } else { Err(RefineError::Size { what, expected, found }) }
}

/// Marks depths of which neither the seed nor the photographs tell anything, in regions of them that reach the photograph's upper
/// border, as the sky does.
fn mark_unfounded(field: &mut Field, seed_confidence: impl Fn(usize, usize) -> f32) {
    let is_unfounded = |x, y| field.at(x, y).correlation < FOUNDED && seed_confidence(x, y) < LEAST_SEED;
    let unfounded = Grid::from_fn(field.size(), is_unfounded);
    let above = above::reached(&unfounded);
    for colour in 0..2 {
        field.update(colour, |_, x, y, state| state.unfounded = above.contains(x, y) && unfounded[(x, y)]);
    }
}

/// Continues surfaces where no source view sees them, lets the planes of segments grow and draws pixels to them, smooths planes, and gives speckles, small isolated pieces of surface, the seed's planes back.
fn finish(field: &mut Field, matcher: &Matcher, seed: impl Fn(usize, usize) -> (Plane, f32)) {
    unseen::continue_surfaces(field, matcher);
    mark_unfounded(field, |x, y| seed(x, y).1);
    let mut steps = Grid::filled(field.size(), 0.0);
    steps.data_mut().par_chunks_exact_mut(field.size().width.max(1)).enumerate().for_each(|(y, row)| {
        for (x, step) in row.iter_mut().enumerate() {
            *step = matcher.step(x, y, field.at(x, y).plane.w);
        }
    });
    growing::grow(field, matcher, &steps);
    planar_prior::apply(field, &steps);
    smooth::smooth(field, &steps, matcher.isa);
    speckle::replace_speckles(field, &steps, matcher.options.speckle, |x, y| seed(x, y).0);
}
