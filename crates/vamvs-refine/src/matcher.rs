//! The photographs at one resolution, and a reference pixel to be matched.

use vamvs_core::{Grid, Size};

use crate::RefineOptions;
use crate::geometry::{Geometries, Geometry};
use crate::isa::Isa;
use crate::luminance::Padded;
use crate::plane::Plane;
use crate::seed::Bounds;
use crate::source::{MOST_SOURCES, Source};
use crate::transfer::{Four, TOGETHER, Transfers, lanes};
use crate::window::{Window, window};

/// By photographs alone, a plane that is worse by more than this in the views that have matched best so far is not tried in
/// the others, where it could match by chance. A plane that is better in the best views is accepted at once.
const HOPELESS: f32 = 0.01;

/// The same with the sources' own depth maps, where a match by chance is rare.
const HOPELESS_WITH_DEPTHS: f32 = 0.3;

/// A surface is in front of another if its inverse depth is so many times as large.
const IN_FRONT: f32 = 1.01;

/// Most groups of source views.
const MOST_GROUPS: usize = MOST_SOURCES / TOGETHER;

/// All photographs at one resolution.
pub(crate) struct Matcher<'a> {
    pub image: Padded,
    pub sources: Vec<Source<'a>>,
    /// The sources four by four, in their order.
    pub groups: Vec<Group>,
    pub options: &'a RefineOptions,
    pub isa: Isa,
    /// By how much a plane must be worse in the views that have matched best not to be tried in the others: [`HOPELESS`], or
    /// [`HOPELESS_WITH_DEPTHS`].
    pub hopeless: f32,
}

/// At most four source views, which are compared together.
pub(crate) struct Group {
    pub transfers: Transfers,
    /// Their own depth maps.
    pub geometries: Option<Geometries>,
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
    /// Where its surface is sought.
    pub bounds: Bounds,
    /// [`Transfers::rays`] of each group.
    pub rays: [[Four; 3]; MOST_GROUPS],
    /// What is added to each source's cost when the best sources are chosen.
    pub handicaps: [f32; MOST_SOURCES],
}

impl<'a> Matcher<'a> {
    /// The matcher of a reference image and its sources.
    pub fn new(image: Padded, sources: Vec<Source<'a>>, options: &'a RefineOptions) -> Self {
        let group = |sources: &[Source]| Group {
            transfers: Transfers::new(sources.iter().map(|source| (&source.transfer, source.quads.size()))),
            geometries: None,
        };
        let groups = sources.chunks(TOGETHER).map(group).collect();
        Self { image, sources, groups, options, isa: Isa::best(), hopeless: HOPELESS }
    }

    /// The same with the sources' own depth maps, `None` for those that have none.
    pub fn with_depths(mut self, depths: impl IntoIterator<Item = Option<Geometry>>) -> Self {
        let mut depths = depths.into_iter();
        for group in &mut self.groups {
            group.geometries = Some(Geometries::new(depths.by_ref().take(TOGETHER)));
        }
        self.hopeless = HOPELESS_WITH_DEPTHS;
        self
    }

    /// The number of sources whose own depth maps meet a pixel's plane to one pixel of reprojection error; `None` if no source has a
    /// depth map.
    pub fn confirming(&self, x: usize, y: usize, plane: &Plane) -> Option<usize> {
        let (x, y) = (x as f32 + 0.5, y as f32 + 0.5);
        let meeting = |group: &Group| {
            let geometries = group.geometries.as_ref()?;
            let warps = group.transfers.warps(&group.transfers.rays(x, y), plane);
            let way = geometries.seen(warps.inside, (warps.u, warps.v), (x, y)).way.to_array();
            Some(way.iter().filter(|way| **way < 1.0).count())
        };
        self.groups.iter().map(meeting).sum()
    }

    /// Whether a pixel's plane is inside of any source view, and not hidden there by what that view's own depth map has in front of it.
    pub fn sees(&self, x: usize, y: usize, plane: &Plane) -> bool {
        let (x, y) = (x as f32 + 0.5, y as f32 + 0.5);
        self.groups.iter().any(|group| {
            let rays = group.transfers.rays(x, y);
            let warps = group.transfers.warps(&rays, plane);
            let hidden = group.geometries.as_ref().map_or(0, |geometries| {
                let surface = geometries.at(warps.inside, (warps.u, warps.v));
                let own = Four::splat(plane.w) / group.transfers.seen(&rays, Four::splat(plane.w))[2];
                lanes(surface.simd_gt(own * Four::splat(IN_FRONT)))
            });
            warps.inside & !hidden != 0
        })
    }

    /// Whether a pixel's plane is inside of any source view.
    pub fn is_inside(&self, x: usize, y: usize, plane: &Plane) -> bool {
        let (x, y) = (x as f32 + 0.5, y as f32 + 0.5);
        let inside = |group: &Group| group.transfers.warps(&group.transfers.rays(x, y), plane).inside;
        self.groups.iter().any(|group| inside(group) != 0)
    }

    /// The change of inverse depth at `(x, y)`, near inverse depth `w`, that is one pixel of disparity, on average
    /// over the sources.
    pub fn step(&self, x: usize, y: usize, w: f32) -> f32 {
        let of = |group: &Group| {
            let rays = group.transfers.rays(x as f32 + 0.5, y as f32 + 0.5);
            group.transfers.disparity(&rays, w)
        };
        self.sources.len() as f32 / self.groups.iter().map(of).sum::<f32>()
    }

    /// The pixel `(x, y)`, near inverse depth `w`. `None` if it is masked, or if its projection moves with depth
    /// in no source view.
    #[inline]
    pub fn pixel(&'a self, x: usize, y: usize, w: f32, prior: f32) -> Option<Pixel<'a>> {
        if self.image.at(x, y) < 0.0 {
            return None;
        }
        let (px, py) = (x as f32 + 0.5, y as f32 + 0.5);
        let (mut rays, mut handicaps) = ([[Four::ZERO; 3]; MOST_GROUPS], [0.0; MOST_SOURCES]);
        let mut disparity = 0.0;
        for (group, rays) in self.groups.iter().zip(&mut rays) {
            *rays = group.transfers.rays(px, py);
            disparity += group.transfers.disparity(rays, w);
        }
        for (source, handicap) in self.sources.iter().zip(&mut handicaps) {
            let visible = source.visibility.map_or(1.0, |grid| nearest(grid, px, py, self.image.size));
            *handicap = self.options.visibility * (1.0 - visible);
        }
        let step = self.sources.len() as f32 / disparity;
        if !step.is_finite() {
            return None;
        }
        let window = window(&self.image, x, y, self.options.colour, self.isa);
        let bounds = Bounds::NONE;
        Some(Pixel { matcher: self, x: px, y: py, window, step, prior, bounds, rays, handicaps })
    }
}

fn nearest(grid: &Grid<f32>, x: f32, y: f32, size: Size) -> f32 {
    let column = (x / size.width as f32 * grid.width() as f32) as usize;
    let row = (y / size.height as f32 * grid.height() as f32) as usize;
    grid[(column.min(grid.width() - 1), row.min(grid.height() - 1))]
}
