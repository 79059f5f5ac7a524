//! How a view shows its surfaces: colours, normals, and which pixels are at an edge.

use std::sync::LazyLock;

use rayon::prelude::*;
use vamvs_core::{Grid, Rgb};

use crate::normals::{directions_of_row, fits_of_row};
use crate::packed_normal::{PackedNormal, pack};
use crate::photometric::FilteredView;
use crate::source::expect_sizes;
use crate::{FuseError, FuseOptions, MapSource};

/// A view as the second pass needs it.
pub(crate) struct SeenView {
    pub filtered: FilteredView,
    pub look: Grid<Look>,
}

/// What a pixel shows of a surface.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Look {
    /// Normal in the world's frame; none where there is no depth.
    pub normal: PackedNormal,
    pub paint: Paint,
}

/// A colour; whether the whole 5×5 window around the pixel lies on one surface, else the colour may be that of what is beside
/// it; and the standard deviation of the depth, as a share of it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Paint(u32);

/// The bit of pixels that are not at an edge.
const INNER: u32 = 1 << 24;

/// The standard deviation begins at this bit. 0: it is not known.
const SIGMA_BIT: u32 = 25;

/// The largest number for a standard deviation, which is 1; each smaller number is a sixth of an octave less.
const LARGEST_SIGMA: u32 = 127;

/// Numbers in an octave.
const PER_OCTAVE: f32 = 6.0;

/// The standard deviations of all numbers, as shares of the depth.
static SIGMAS: LazyLock<[f32; LARGEST_SIGMA as usize + 1]> = LazyLock::new(|| {
    let sigma = |number: usize| ((number as f32 - LARGEST_SIGMA as f32) / PER_OCTAVE).exp2();
    std::array::from_fn(|number| if number == 0 { 0.0 } else { sigma(number) })
});

impl Paint {
    /// The colour of a pixel at an edge.
    pub fn at_edge([red, green, blue]: Rgb) -> Self {
        Self(u32::from_le_bytes([red, green, blue, 0]))
    }

    /// The same away from edges.
    pub fn inner(self) -> Self {
        Self(self.0 | INNER)
    }

    /// The same with the standard deviation of the depth, as a share of it, to 6 %; 0 or less: not known.
    pub fn with_sigma(self, sigma: f32) -> Self {
        if sigma <= 0.0 || sigma.is_nan() {
            return self;
        }
        let number = sigma.log2() * PER_OCTAVE + LARGEST_SIGMA as f32 + 0.5;
        Self(self.0 | (number.max(1.0) as u32).min(LARGEST_SIGMA) << SIGMA_BIT)
    }

    /// The standard deviation of the depth, as a share of it; 0 if it is not known.
    #[inline]
    pub fn sigma(self) -> f32 {
        SIGMAS[(self.0 >> SIGMA_BIT) as usize]
    }

    /// Red, green and blue.
    #[inline(always)]
    pub fn colour(self) -> [f32; 3] {
        let of = self.0 as i32;
        [(of & 255) as f32, (of >> 8 & 255) as f32, (of >> 16 & 255) as f32]
    }

    #[inline(always)]
    pub fn is_inner(self) -> bool {
        self.0 & INNER != 0
    }
}

impl SeenView {
    /// Loads view number `view` part by part, applies the photometric filter, and derives the normals unless it has some.
    pub fn load<S: MapSource + ?Sized>(
        view: usize,
        source: &S,
        options: &FuseOptions,
    ) -> Result<Self, FuseError> {
        // First the normals, which take the most room until they are packed, and go then.
        let normals = source.load_normals(view).map_err(FuseError::loading(view))?;
        let normals = normals.map(|normals| packed(&normals));
        let sigmas = source.load_sigma(view).map_err(FuseError::loading(view))?;
        let filtered = FilteredView::load(view, source, options)?;
        let size = filtered.size();
        let colours = source.load_colour(view, size).map_err(FuseError::loading(view))?;
        let parts = [
            ("a map of normals", normals.as_ref().map(Grid::size)),
            ("a map of standard deviations", sigmas.as_ref().map(Grid::size)),
            ("a colour image", Some(colours.size())),
        ];
        expect_sizes(view, size, &parts)?;
        let sigma = |pixel: usize| {
            sigmas
                .as_ref()
                .map_or(0.0, |sigmas| sigmas.data()[pixel] * filtered.samples.data()[pixel].inverse_depth())
        };
        let normal = |pixel| normals.as_ref().map_or(PackedNormal::NONE, |normals| normals.data()[pixel]);
        let look = |(pixel, &colour)| {
            let paint = Paint::at_edge(colour).with_sigma(sigma(pixel));
            Look { normal: normal(pixel), paint }
        };
        let look = Grid::from_vec(size, colours.data().iter().enumerate().map(look).collect());
        let mut seen = Self { filtered, look };
        seen.complete();
        Ok(seen)
    }

    /// Bytes held in memory.
    pub fn bytes(&self) -> usize {
        self.filtered.bytes() + self.filtered.size().area() * size_of::<Look>()
    }

    /// Finds the normals that are not given, and the pixels that are not at an edge.
    fn complete(&mut self) {
        let world_from_cam = self.filtered.cam_from_world.rotation.transpose().cast::<f32>();
        let (view, width) = (&self.filtered, self.filtered.size().width.max(1));
        self.look.data_mut().par_chunks_mut(width).enumerate().for_each(|(y, looks)| {
            let fits = fits_of_row(view, y);
            let mut derived = vec![PackedNormal::NONE; width];
            pack(&directions_of_row(view, y, &fits, &world_from_cam), &mut derived);
            for (x, (look, (fit, derived))) in looks.iter_mut().zip(fits.iter().zip(derived)).enumerate() {
                if view.inverse_depth((x, y)) <= 0.0 {
                    look.normal = PackedNormal::NONE;
                    continue;
                }
                if fit.inner {
                    look.paint = look.paint.inner();
                }
                if look.normal == PackedNormal::NONE {
                    look.normal = derived;
                }
            }
        });
    }
}

fn packed(normals: &Grid<[f32; 3]>) -> Grid<PackedNormal> {
    let mut packed = Grid::filled(normals.size(), PackedNormal::NONE);
    let width = normals.size().width.max(1);
    let rows = packed.data_mut().par_chunks_mut(width).zip(normals.data().par_chunks(width));
    rows.for_each(|(packed, normals)| pack(normals, packed));
    packed
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_standard_deviation_is_kept_to_six_per_cent_beside_the_colour() {
        let colour = [200, 3, 255];
        for sigma in [1.0, 0.3, 0.01, 2.5e-4, 1e-6] {
            let paint = Paint::at_edge(colour).with_sigma(sigma).inner();
            assert!((paint.sigma() / sigma - 1.0).abs() < 0.06, "{sigma}: {}", paint.sigma());
            assert_eq!((paint.colour(), paint.is_inner()), ([200.0, 3.0, 255.0], true));
        }
        for unknown in [0.0, -1.0, f32::NAN] {
            assert_eq!(Paint::at_edge(colour).with_sigma(unknown).sigma(), 0.0);
        }
        assert_eq!(Paint::at_edge(colour).with_sigma(7.0).sigma(), 1.0);
    }
}
