//! What a view tells of a place: how far before or behind the surface that it sees there.

use nalgebra::Vector3;
use rayon::prelude::*;
use vamvs_core::{Grid, Pinhole, Pose, Rgb, Size, depth_map};

use crate::pixel::PixelSurface;
use crate::rays::{Rays, derived_normal, given_normal};
use crate::{MeshError, MeshView, gaps};

/// A depth is averaged with others up to this distance from it, in sizes of a pixel on the surface...
const BAND_PIXELS: f32 = 2.5;

/// ... or up to so many standard deviations, if that is more, ...
const BAND_SIGMAS: f32 = 1.5;

/// ... but not farther than this, in sizes of a pixel.
const WIDEST_BAND: f32 = 6.0;

/// The error of a depth that its standard deviation does not know, in sizes of a pixel on the surface.
const LEAST_SIGMA: f32 = 0.3;

/// Behind a surface its weight is 1 up to this share of the band...
const SURE: f32 = 0.2;

/// ... and declines up to this share of it...
const HIDDEN: f32 = 0.7;

/// ... to this weight, which it has up to twice the band: there it is solid unless another view sees into it.
const HIDDEN_WEIGHT: f32 = 0.03;

/// It has that weight up to this multiple of what is near at least, so that all corners of a cell that the surface goes through
/// are known.
const CELL_BEHIND: f32 = 1.75;

/// How much longer a way to a surface may be along the ray than along the normal.
const MOST_OBLIQUE: f32 = 12.0;

/// The weight of pixels at a jump of depth.
const JUMP_WEIGHT: f32 = 0.2;

/// Neighbours that are farther than this from a pixel's tangent plane, in sizes of a pixel, are of another surface.
const JUMP: f32 = 4.0;

/// Pixels to each side of a tile, of which the largest depth is known.
const TILE: usize = 16;

/// What a view says of a place.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Opinion {
    /// The signed distance from the surface, scene units: positive towards the camera.
    pub distance: f32,
    /// How much it counts; 0: the view does not see the place.
    pub weight: f32,
    /// Whether the view sees a surface within about a cell of the place.
    pub is_near: bool,
}

/// A view as meshing uses it: eleven bytes a pixel.
pub(crate) struct SeenView {
    pub cam_from_world: Pose,
    camera: Pinhole,
    rays: Rays,
    surfaces: Grid<PixelSurface>,
    colours: Grid<Rgb>,
    /// The largest depth of each tile of 16×16 pixels, 0 where there is none.
    farthest: Grid<f32>,
}

impl SeenView {
    pub fn new(number: usize, view: MeshView) -> Result<Self, MeshError> {
        view.check(number)?;
        let MeshView { camera, cam_from_world, depth, confirmed, sigma, normals, colour } = view;
        let (rays, rotation) = (Rays::new(&camera), cam_from_world.rotation.cast::<f32>());
        let given = |place: (usize, usize)| given_normal(normals.as_ref()?, &rotation, place);
        let size = depth.size();
        let mut surfaces = Grid::filled(size, PixelSurface::default());
        surfaces.data_mut().par_chunks_mut(size.width.max(1)).enumerate().for_each(|(y, row)| {
            for (x, surface) in row.iter_mut().enumerate() {
                let z = depth[(x, y)];
                if !depth_map::is_valid(z) {
                    continue;
                }
                let normal = given((x, y)).or_else(|| derived_normal(&camera, &depth, (x, y)));
                let normal = normal.unwrap_or_else(|| -rays.of((x, y)).normalize());
                let sigma = sigma.as_ref().map_or(0.0, |sigma| sigma[(x, y)]);
                *surface = PixelSurface::new(z, normal, sigma.max(0.0) / rays.pixel_size(z));
            }
        });
        let farthest = Grid::filled(Size::new(0, 0), 0.0);
        let mut view = Self { cam_from_world, camera, rays, surfaces, colours: colour, farthest };
        if let Some(confirmed) = confirmed {
            gaps::fill(&rays, &mut view.surfaces, &confirmed);
        }
        view.mark_jumps();
        view.farthest = view.farthest();
        Ok(view)
    }

    pub fn size(&self) -> Size {
        self.surfaces.size()
    }

    /// Bytes that the view takes.
    pub fn bytes(&self) -> usize {
        self.size().area() * (size_of::<PixelSurface>() + size_of::<Rgb>())
    }

    /// The place in the world of what a pixel sees, and the pixel's size on it, scene units.
    pub fn point(&self, (x, y): (usize, usize)) -> Option<(Vector3<f64>, f64)> {
        let depth = self.surfaces[(x, y)].depth;
        let x_in_cam = self.rays.of((x, y)).cast::<f64>() * f64::from(depth);
        let x_in_world = self.cam_from_world.rotation.tr_mul(&(x_in_cam - self.cam_from_world.translation));
        (depth > 0.0).then(|| (x_in_world, f64::from(self.rays.pixel_size(depth))))
    }

    /// Whether the view may say something of places in a ball; `near` is what is near a surface, sizes of a pixel.
    pub fn may_see(&self, (centre, radius): (&Vector3<f64>, f64), near: f32) -> bool {
        let c = self.cam_from_world.transform(centre);
        let intrinsics = &self.camera.intrinsics;
        if c.z + radius <= 0.0 {
            return false;
        }
        if c.z <= 2.0 * radius {
            return true;
        }
        let (u, v) = (intrinsics.fx * c.x / c.z + intrinsics.cx, intrinsics.fy * c.y / c.z + intrinsics.cy);
        // How far a ray's place in the photograph moves with a step to the side and one along the axis.
        let longest = 1.0 + (c.x.abs() + c.y.abs()) / c.z;
        let reach = intrinsics.fx.max(intrinsics.fy) * radius * longest / (c.z - radius);
        let columns = tiles(u, reach, self.size().width);
        let rows = tiles(v, reach, self.size().height);
        let (Some(columns), Some(rows)) = (columns, rows) else { return false };
        let reaches = |depth: f32| depth > 0.0 && self.last_depth(depth, near) >= c.z - radius;
        rows.into_iter().any(|y| columns.clone().any(|x| reaches(self.farthest[(x, y)])))
    }

    /// The largest depth of places of which a view that sees a surface at a depth may say something: as far as the weight
    /// reaches behind the surface, seen at up to 85° from its normal.
    fn last_depth(&self, depth: f32, near: f32) -> f64 {
        let reach = (2.0 * WIDEST_BAND).max(CELL_BEHIND * near) * self.rays.pixel_size(depth);
        f64::from(depth + MOST_OBLIQUE * reach)
    }

    /// What the view says of a place in its own frame; `near` is what is near a surface, sizes of a pixel.
    #[inline]
    pub fn opinion(&self, x: &Vector3<f64>, near: f32) -> Opinion {
        let Some(place) = self.pixel(x) else { return Opinion::default() };
        let surface = self.surfaces[place];
        if surface.depth <= 0.0 || x.z > self.last_depth(surface.depth, near) {
            return Opinion::default();
        }
        let (distance, pixel, sigma) = self.distance(surface, place, x);
        let band = band(pixel, sigma);
        let doubt = LEAST_SIGMA * pixel;
        // Of two surfaces that meet in a corner, the nearer one tells.
        let (distance_in_band, pixels) = (distance.clamp(-band, band), pixel * pixel);
        let certainty =
            pixels / ((pixels + distance_in_band * distance_in_band) * (sigma * sigma + doubt * doubt));
        let jump = if surface.is_at_jump() { JUMP_WEIGHT } else { 1.0 };
        let weight = if distance >= band {
            // Seen through, unless another surface's pixel is beside this one.
            if surface.is_at_jump() { 0.0 } else { 1.0 }
        } else if distance >= -SURE * band {
            jump
        } else if distance >= -HIDDEN * band {
            let share = (distance / band + HIDDEN) / (HIDDEN - SURE);
            jump * (HIDDEN_WEIGHT + (1.0 - HIDDEN_WEIGHT) * share)
        } else if distance >= -(2.0 * band).max(CELL_BEHIND * near * pixel) {
            jump * HIDDEN_WEIGHT
        } else {
            0.0
        };
        Opinion {
            distance: distance_in_band,
            weight: weight * certainty,
            is_near: distance.abs() <= near * pixel,
        }
    }

    /// The colour that the view has for a place on the surface, in its own frame, and how much it counts.
    pub fn colour(&self, x: &Vector3<f64>) -> Option<(Vector3<f32>, f32)> {
        let place = self.pixel(x)?;
        let surface = self.surfaces[place];
        if surface.depth <= 0.0 {
            return None;
        }
        let (distance, pixel, sigma) = self.distance(surface, place, x);
        if distance.abs() > band(pixel, sigma) {
            return None;
        }
        let direction = self.rays.of(place).normalize();
        let cosine = -surface.normal().dot(&direction);
        let jump = if surface.is_at_jump() { 0.01 } else { 1.0 };
        let weight = jump * (cosine / pixel).powi(2);
        (cosine > 0.05).then(|| (Vector3::from(self.colours[place]).map(f32::from), weight))
    }

    /// The signed distance of a place from a pixel's tangent plane, the pixel's size on the surface, and the standard
    /// deviation of the depth, scene units.
    #[inline]
    fn distance(&self, surface: PixelSurface, place: (usize, usize), x: &Vector3<f64>) -> (f32, f32, f32) {
        let on_surface = self.rays.of(place) * surface.depth;
        let pixel = self.rays.pixel_size(surface.depth);
        (surface.normal().dot(&(x.cast::<f32>() - on_surface)), pixel, surface.sigma() * pixel)
    }

    #[inline]
    fn pixel(&self, x: &Vector3<f64>) -> Option<(usize, usize)> {
        let intrinsics = &self.camera.intrinsics;
        if x.z <= 0.0 {
            return None;
        }
        let w = 1.0 / x.z;
        let (u, v) = (intrinsics.fx * (x.x * w) + intrinsics.cx, intrinsics.fy * (x.y * w) + intrinsics.cy);
        let size = self.size();
        let is_inside = u >= 0.0 && v >= 0.0 && u < size.width as f64 && v < size.height as f64;
        is_inside.then_some((u as usize, v as usize))
    }

    /// The distance of what a pixel sees from the tangent plane of what another sees, sizes of a pixel.
    fn distance_between(&self, place: (usize, usize), other: (usize, usize)) -> f32 {
        let at = |place: (usize, usize)| self.rays.of(place) * self.surfaces[place].depth;
        let surface = self.surfaces[other];
        surface.normal().dot(&(at(place) - at(other))).abs() / self.rays.pixel_size(surface.depth)
    }

    /// Marks pixels beside which another surface is seen.
    fn mark_jumps(&mut self) {
        let size = self.size();
        let mut at_jump = Grid::filled(size, false);
        at_jump.data_mut().par_chunks_mut(size.width.max(1)).enumerate().for_each(|(y, row)| {
            for (x, at_jump) in row.iter_mut().enumerate() {
                *at_jump = self.is_at_jump((x, y));
            }
        });
        for (surface, at_jump) in self.surfaces.data_mut().iter_mut().zip(at_jump.data()) {
            if *at_jump {
                surface.mark_jump();
            }
        }
    }

    fn is_at_jump(&self, (x, y): (usize, usize)) -> bool {
        let surface = self.surfaces[(x, y)];
        if surface.depth <= 0.0 {
            return false;
        }
        let columns = x.saturating_sub(1)..(x + 2).min(self.size().width);
        (y.saturating_sub(1)..(y + 2).min(self.size().height)).any(|row| {
            columns.clone().any(|column| {
                self.surfaces[(column, row)].depth > 0.0
                    && self.distance_between((column, row), (x, y)) > JUMP
            })
        })
    }

    fn farthest(&self) -> Grid<f32> {
        let size = self.size();
        let mut farthest =
            Grid::filled(Size::new(size.width.div_ceil(TILE), size.height.div_ceil(TILE)), 0.0);
        for (y, row) in self.surfaces.data().chunks(size.width.max(1)).enumerate() {
            for (x, surface) in row.iter().enumerate() {
                let tile = &mut farthest[(x / TILE, y / TILE)];
                *tile = surface.depth.max(*tile);
            }
        }
        farthest
    }
}

/// How far from a depth others are averaged with it.
fn band(pixel: f32, sigma: f32) -> f32 {
    (BAND_SIGMAS * sigma).clamp(BAND_PIXELS * pixel, WIDEST_BAND * pixel)
}

/// The tiles along an axis that what is within `reach` of `centre` may fall into.
fn tiles(centre: f64, reach: f64, length: usize) -> Option<std::ops::Range<usize>> {
    let (first, last) = ((centre - reach - 1.0).max(0.0), (centre + reach + 1.0).min(length as f64 - 1.0));
    (first <= last).then(|| first as usize / TILE..last as usize / TILE + 1)
}
