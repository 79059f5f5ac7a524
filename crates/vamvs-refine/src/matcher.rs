//! The photographs at one resolution, and a reference pixel to be matched.

use vamvs_core::{Grid, Size};

use crate::RefineOptions;
use crate::isa::Isa;
use crate::luminance::Padded;
use crate::source::{MOST_SOURCES, Source};
use crate::window::{Window, window};

/// All photographs at one resolution.
pub(crate) struct Matcher<'a> {
    pub image: Padded,
    pub sources: Vec<Source<'a>>,
    pub options: &'a RefineOptions,
    pub isa: Isa,
}

/// A reference pixel with all quantities that do not depend on the plane.
pub(crate) struct Pixel<'a> {
    pub matcher: &'a Matcher<'a>,
    /// Its centre, pixels.
    pub x: f32,
    pub y: f32,
    /// Its window.
    pub window: Window,
    /// The change of inverse depth that is one pixel of disparity, on average over the sources.
    pub step: f32,
    /// The prior inverse depth; 0 if there is none.
    pub prior: f32,
    /// [`crate::transfer::Transfer::ray`] for each source.
    pub rays: [[f32; 3]; MOST_SOURCES],
    /// What is added to each source's cost when the best sources are chosen.
    pub handicaps: [f32; MOST_SOURCES],
}

impl<'a> Matcher<'a> {
    /// The change of inverse depth at `(x, y)`, near inverse depth `w`, that is one pixel of disparity, on average
    /// over the sources.
    pub fn step(&self, x: usize, y: usize, w: f32) -> f32 {
        let of = |source: &Source| {
            let ray = source.transfer.ray(x as f32 + 0.5, y as f32 + 0.5);
            source.transfer.disparity(ray, w)
        };
        self.sources.len() as f32 / self.sources.iter().map(of).sum::<f32>()
    }

    /// The pixel `(x, y)`, near inverse depth `w`. `None` if it is masked, or if its projection moves with depth
    /// in no source view.
    #[inline]
    pub fn pixel(&'a self, x: usize, y: usize, w: f32, prior: f32) -> Option<Pixel<'a>> {
        if self.image.at(x, y) < 0.0 {
            return None;
        }
        let (px, py) = (x as f32 + 0.5, y as f32 + 0.5);
        let (mut rays, mut handicaps) = ([[0.0; 3]; MOST_SOURCES], [0.0; MOST_SOURCES]);
        let mut disparity = 0.0;
        for (source, (ray, handicap)) in self.sources.iter().zip(rays.iter_mut().zip(&mut handicaps)) {
            *ray = source.transfer.ray(px, py);
            disparity += source.transfer.disparity(*ray, w);
            let visible = source.visibility.map_or(1.0, |grid| nearest(grid, px, py, self.image.size));
            *handicap = self.options.visibility * (1.0 - visible);
        }
        let step = self.sources.len() as f32 / disparity;
        let window = window(&self.image, x, y, self.options.colour, self.isa);
        let pixel = Pixel { matcher: self, x: px, y: py, window, step, prior, rays, handicaps };
        step.is_finite().then_some(pixel)
    }
}

fn nearest(grid: &Grid<f32>, x: f32, y: f32, size: Size) -> f32 {
    let column = (x / size.width as f32 * grid.width() as f32) as usize;
    let row = (y / size.height as f32 * grid.height() as f32) as usize;
    grid[(column.min(grid.width() - 1), row.min(grid.height() - 1))]
}
