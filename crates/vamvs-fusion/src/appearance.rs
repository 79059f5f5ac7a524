//! How a view shows its surfaces: colours, normals, and which pixels are at an edge.

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

/// The standard deviation begins at this bit, as a number of seven bits: the exponent of a float and the first three digits
/// of its mantissa, 127 for 1. 0: it is not known.
const SIGMA_BIT: u32 = 25;

/// The largest number for a standard deviation.
const LARGEST_SIGMA: u32 = 127;

/// The bits of a float behind those of the number.
const ROUNDED_BITS: u32 = 20;

/// These bits of what a number stands for: the ends of what becomes the number are equally far from it.
const MIDDLE: u32 = 493_447;

/// What is taken from the bits of a float to get the number.
const MOVED: u32 = (1.0_f32.to_bits() >> ROUNDED_BITS) - LARGEST_SIGMA;

impl Paint {
    /// The colour of a pixel at an edge.
    pub fn at_edge([red, green, blue]: Rgb) -> Self {
        Self(u32::from_le_bytes([red, green, blue, 0]))
    }

    /// The same away from edges.
    pub fn inner(self) -> Self {
        Self(self.0 | INNER)
    }

    /// The same with the standard deviation of the depth, as a share of it, from 2·10⁻⁵ to 1, to 6 %; 0 or less: not known.
    pub fn with_sigma(self, sigma: f32) -> Self {
        if sigma <= 0.0 || sigma.is_nan() {
            return self;
        }
        let bits = (sigma.to_bits() >> ROUNDED_BITS).clamp(MOVED + 1, MOVED + LARGEST_SIGMA);
        Self(self.0 | (bits - MOVED) << SIGMA_BIT)
    }

    /// The standard deviation of the depth, as a share of it; 0 if it is not known.
    #[inline(always)]
    pub fn sigma(self) -> f32 {
        let number = self.0 >> SIGMA_BIT;
        let sigma = f32::from_bits((number + MOVED) << ROUNDED_BITS | MIDDLE);
        if number == 0 { 0.0 } else { sigma }
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
        let filtered = FilteredView::load(view, source, options)?;
        let size = filtered.size();
        let colours = source.load_colour(view, size).map_err(FuseError::loading(view))?;
        let parts = [
            ("a map of normals", normals.as_ref().map(Grid::size)),
            ("a colour image", Some(colours.size())),
        ];
        expect_sizes(view, size, &parts)?;
        let normal = |pixel| normals.as_ref().map_or(PackedNormal::NONE, |normals| normals.data()[pixel]);
        let look = |(pixel, &colour)| Look { normal: normal(pixel), paint: Paint::at_edge(colour) };
        let look = Grid::from_vec(size, colours.data().iter().enumerate().map(look).collect());
        drop(colours);
        let mut seen = Self { filtered, look };
        if let Some(sigmas) = source.load_sigma(view).map_err(FuseError::loading(view))? {
            expect_sizes(view, size, &[("a map of standard deviations", Some(sigmas.size()))])?;
            seen.set_sigmas(&sigmas);
        }
        seen.complete();
        Ok(seen)
    }

    /// Bytes held in memory.
    pub fn bytes(&self) -> usize {
        self.filtered.bytes() + self.filtered.size().area() * size_of::<Look>()
    }

    /// Notes the standard deviations of the depths, scene units, as shares of them.
    fn set_sigmas(&mut self, sigmas: &Grid<f32>) {
        let samples = self.filtered.samples.data();
        for ((look, sigma), sample) in self.look.data_mut().iter_mut().zip(sigmas.data()).zip(samples) {
            look.paint = look.paint.with_sigma(sigma * sample.inverse_depth());
        }
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
        for sigma in [1.0, 0.99, 0.3, 0.01, 2.5e-4, 2e-5] {
            let paint = Paint::at_edge(colour).with_sigma(sigma).inner();
            assert!((paint.sigma() / sigma - 1.0).abs() < 0.06, "{sigma}: {}", paint.sigma());
            assert_eq!((paint.colour(), paint.is_inner()), ([200.0, 3.0, 255.0], true));
        }
        for unknown in [0.0, -1.0, f32::NAN] {
            assert_eq!(Paint::at_edge(colour).with_sigma(unknown).sigma(), 0.0);
        }
        let of = |sigma: f32| Paint::at_edge(colour).with_sigma(sigma).sigma();
        assert_eq!((of(7.0), of(1e-9)), (of(1.0), of(2e-5)));
    }
}
