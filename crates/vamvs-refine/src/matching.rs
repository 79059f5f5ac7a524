//! Where planes are matched with the photographs: on the processor, or on a device that another crate drives.
//!
//! Nearly all of refinement's time is in the matching of planes. [`Matching`] is that work at one resolution: images, how pixels
//! project, and the planes to begin with. A [`Device`] gives back the planes of all pixels ([`Matched`]).

use std::fmt;

use vamvs_core::{Grid, Size};

use crate::field::{Field, State};
use crate::luminance::BORDER;
use crate::matcher::Matcher;
use crate::plane::Plane;
use crate::seed::Guess;
use crate::transfer::{TOGETHER, Views};
use crate::window::{OFFSETS, nearness};
use crate::{RefineError, RefineOptions, energy, field, geometry, sweep};
use crate::{solve, tiles};

/// What matches planes in place of the processor. It makes the same decisions, up to its rounding.
pub trait Device: Sync + fmt::Debug {
    /// The planes of all pixels of [`Matching::size`], row by row.
    ///
    /// # Errors
    /// If the device fails or its memory does not suffice.
    fn planes(&self, matching: &Matching<'_>) -> Result<Vec<Matched>, DeviceError>;
}

/// Why a device gives no planes.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum DeviceError {
    /// Its memory does not suffice.
    #[error("{0}")]
    Memory(String),
    /// It is lost, or refuses the work.
    #[error("{0}")]
    Failed(String),
}

/// The matching of all pixels of a reference view at one resolution.
pub struct Matching<'a> {
    matcher: &'a Matcher<'a>,
    begin: Begin<'a>,
}

/// The planes that matching begins with.
#[derive(Clone, Copy)]
pub(crate) enum Begin<'a> {
    /// Those of a seed, searched around, and then swept so often.
    Seed(Near<'a>, usize),
    /// Planes of the same or half the resolution, swept once.
    Planes(&'a Field, Option<Near<'a>>),
}

/// The surfaces near which a pixel's own is sought.
#[derive(Clone, Copy)]
pub(crate) struct Near<'a> {
    /// For each pixel at some resolution.
    pub guesses: &'a Grid<Guess>,
    /// How often that resolution is half that of the matching.
    pub halvings: usize,
    /// How far beyond the surfaces, pixels of disparity.
    pub beyond: f32,
}

/// What [`Matching::begin`] begins with.
pub enum Start {
    /// Steps in depth around the planes of the guesses, and then so many sweeps.
    Search {
        /// The number of sweeps.
        sweeps: usize,
    },
    /// These planes, and one sweep.
    Planes {
        /// The size of their image: that of the matching or half of it.
        size: Size,
        /// Inverse depth at the pixel's centre and its slopes, per pixel of their image; all 0 where there is none.
        planes: Vec<[f32; 3]>,
    },
}

/// What a seed says around each pixel.
pub struct Guesses {
    /// The size of their image.
    pub size: Size,
    /// Inverse depth and its slopes, the inverse depths of the nearest and the farthest surface, and the confidence; −1 where the seed
    /// was filled in.
    pub values: Vec<[f32; 6]>,
    /// How often their resolution is half that of the matching.
    pub halvings: usize,
    /// How far beyond these surfaces a pixel's own is sought, pixels of disparity; may be infinite.
    pub beyond: f32,
}

/// From image coordinates p of one view and the inverse depth w there to the homogeneous pixel `linear · p + w · offset` of another.
#[derive(Clone, Copy, Debug)]
pub struct Projection {
    /// Row by row.
    pub linear: [[f32; 3]; 3],
    /// Per unit of inverse depth.
    pub offset: [f32; 3],
}

/// A source view.
pub struct SourceView<'a> {
    /// The size of its image.
    pub size: Size,
    /// For each pixel the grey values of it and of those to its right, below it, and below that, from the lowest byte on.
    pub quads: &'a [u32],
    /// From the reference view into it.
    pub projection: Projection,
    /// How likely it sees what a reference pixel shows, at any size.
    pub visibility: Option<&'a Grid<f32>>,
    /// Its own depth map.
    pub depths: Option<SourceDepths<'a>>,
}

/// A source view's own depth map.
pub struct SourceDepths<'a> {
    /// Inverse depths, 0 where there is none, with the last column and row once more.
    pub inverse: &'a Grid<f32>,
    /// Factor and offset, for x and for y, from image coordinates of the source's photograph to those of the map.
    pub to_map: [[f32; 2]; 2],
    /// Back into the reference view.
    pub back: Projection,
}

/// The plane of a pixel, and how well it matches.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Matched {
    /// Inverse depth at the pixel's centre and its slopes; w = 0 where there is none.
    pub plane: [f32; 3],
    /// Its energy; infinite if it is impossible.
    pub energy: f32,
    /// The mean correlation of the source views that match best.
    pub correlation: f32,
    /// The variance of the inverse depth, pixels of disparity squared.
    pub variance: f32,
    /// These views, one bit each.
    pub best: u16,
    /// Whether no Gauss–Newton step is due.
    pub settled: bool,
}

/// The planes of all pixels, from the processor, or from a device if there is one.
pub(crate) fn planes(
    matcher: &Matcher<'_>,
    begin: Begin<'_>,
    device: Option<&dyn Device>,
) -> Result<Field, RefineError> {
    let Some(device) = device else { return Ok(solve::planes(matcher, begin)) };
    let matched = device.planes(&Matching { matcher, begin })?;
    let Size { width, height } = matcher.image.size;
    assert_eq!(matched.len(), width * height, "a device gives a plane for each pixel");
    Ok(Field::new(matcher.image.size, |x, y| State::from(&matched[y * width + x])))
}

impl From<&Matched> for State {
    fn from(matched: &Matched) -> Self {
        let Matched { plane: [w, gx, gy], energy, correlation, variance, best, settled } = *matched;
        let best: Views = best;
        Self { plane: Plane { w, gx, gy }, energy, correlation, variance, best, settled, ..Self::default() }
    }
}

impl From<&State> for Matched {
    fn from(state: &State) -> Self {
        let State { plane: Plane { w, gx, gy }, energy, correlation, variance, best, settled, .. } = *state;
        Self { plane: [w, gx, gy], energy, correlation, variance, best, settled }
    }
}

impl Matching<'_> {
    /// The planes of all pixels as the processor finds them.
    #[must_use]
    pub fn on_processor(&self) -> Vec<Matched> {
        let field = solve::planes(self.matcher, self.begin);
        Grid::from_fn(field.size(), |x, y| Matched::from(field.at(x, y))).data().to_vec()
    }

    /// Pixels around [`Matching::image`].
    pub const BORDER: usize = BORDER;

    /// The size of the reference image.
    #[must_use]
    pub fn size(&self) -> Size {
        self.matcher.image.size
    }

    /// The grey values of the reference image with a border, row by row; negative outside of it and of its mask.
    #[must_use]
    pub fn image(&self) -> &[f32] {
        self.matcher.image.around(0, 0).0
    }

    /// How planes are matched.
    #[must_use]
    pub fn options(&self) -> &RefineOptions {
        self.matcher.options
    }

    /// By how much a plane must be worse in the views that have matched best not to be tried in the others.
    #[must_use]
    pub fn hopeless(&self) -> f32 {
        self.matcher.hopeless
    }

    /// The source views.
    pub fn sources(&self) -> impl Iterator<Item = SourceView<'_>> {
        self.matcher.sources.iter().enumerate().map(|(number, source)| {
            let group = &self.matcher.groups[number / TOGETHER];
            let geometries = group.geometries.as_ref();
            SourceView {
                size: source.quads.size(),
                quads: source.quads.words(),
                projection: source.transfer.projection(),
                visibility: source.visibility,
                depths: geometries.and_then(|all| all.of(number % TOGETHER)),
            }
        })
    }

    /// Whether source views may have depth maps, so that these are tried.
    #[must_use]
    pub fn has_depths(&self) -> bool {
        self.matcher.groups.iter().any(|group| group.geometries.is_some())
    }

    /// What a seed says; `None` where planes are sought everywhere.
    #[must_use]
    pub fn guesses(&self) -> Option<Guesses> {
        let near = match self.begin {
            Begin::Seed(near, _) => Some(near),
            Begin::Planes(_, near) => near,
        };
        let Near { guesses, halvings, beyond } = near?;
        let number = |guess: &Guess| {
            let Guess { plane: Plane { w, gx, gy }, ends: [nearest, farthest], confidence } = *guess;
            [w, gx, gy, nearest, farthest, confidence]
        };
        let values = guesses.data().iter().map(number).collect();
        Some(Guesses { size: guesses.size(), values, halvings, beyond })
    }

    /// What to begin with.
    #[must_use]
    pub fn begin(&self) -> Start {
        match self.begin {
            Begin::Seed(_, sweeps) => Start::Search { sweeps },
            Begin::Planes(field, _) => {
                let plane = |x, y| {
                    let Plane { w, gx, gy } = field.at(x, y).plane;
                    [w, gx, gy]
                };
                let planes = Grid::from_fn(field.size(), plane);
                Start::Planes { size: field.size(), planes: planes.data().to_vec() }
            }
        }
    }
}

/// Offsets (x, y) of the texels of a window from its centre, pixels, and the inverse of their weights by distance.
#[must_use]
pub fn texels() -> Vec<[f32; 3]> {
    let of = |(dx, dy): (&f32, &f32)| [*dx, *dy, 1.0 / nearness(*dx, *dy)];
    OFFSETS.0.iter().zip(&OFFSETS.1).map(of).collect()
}

/// The adjacent pixels, and the neighbours that propose their planes, by direction.
pub use sweep::{ADJACENT, DIRECTIONS};

/// What a device takes of the process's memory beside [`crate::peak_bytes`], bytes: planes as they come from it, and its result.
#[must_use]
pub fn peak_bytes(photograph: Size, options: &RefineOptions) -> u64 {
    let of_pixel = 3 * size_of::<Matched>();
    (of_pixel * tiles::most_pixels(photograph, options)) as u64
}

/// The names and values of the constants that decide which plane is taken.
#[must_use]
pub fn constants() -> Vec<(&'static str, f32)> {
    vec![
        ("STEEPEST", energy::STEEPEST),
        ("MATCHING", energy::MATCHING),
        ("AGREE", sweep::AGREE),
        ("NEAR", sweep::NEAR),
        ("OTHER", sweep::OTHER),
        ("DISTINCT", sweep::DISTINCT),
        ("RADIUS", sweep::RADIUS),
        ("SHORT", sweep::SHORT),
        ("LONGEST_DEPTH", sweep::LONGEST[0]),
        ("LONGEST_SLOPE", sweep::LONGEST[1]),
        ("INDEPENDENT", sweep::INDEPENDENT),
        ("DAMPING_DEPTH", sweep::DAMPING[0]),
        ("DAMPING_SLOPE", sweep::DAMPING[1]),
        ("APART", solve::APART),
        ("JUMP", geometry::JUMP),
        ("UNKNOWN", field::UNKNOWN),
    ]
}
