//! What a view tells of a place: how far before or behind the surface that it sees there.

use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;
use vamvs_core::{Grid, Intrinsics, Pinhole, Pose, Rgb, Size};

use crate::{MeshError, MeshView};

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

/// The weight of pixels at a jump of depth.
const JUMP_WEIGHT: f32 = 0.2;

/// Neighbours that are farther than this from a pixel's tangent plane, in sizes of a pixel, are of another surface.
const JUMP: f32 = 4.0;

/// Pixels to each side of a tile, of which the largest depth is known.
const TILE: usize = 16;

/// The surface that a pixel sees.
#[derive(Clone, Copy, Default)]
struct Surface {
    /// 0: none.
    depth: f32,
    /// Unit normal in the camera's frame, towards the camera, in 127ths.
    normal: [i8; 3],
    /// The standard deviation of the depth, as a multiple of the pixel's size: an exponent and two digits of a float; the
    /// highest bit says that the pixel is at a jump of depth.
    sigma: u8,
}

/// The number of a standard deviation of 1.
const ONE: u32 = 64;

/// Gaps in what other views confirm are filled from pixels in so many columns and rows to each side...
const REACH: usize = 5;

/// ... of which every so many are asked, first for small gaps, then for larger ones...
const STEPS: [usize; 2] = [1, 2];

/// ... in at least so many of the four quadrants around...
const QUADRANTS: usize = 3;

/// ... whose planes differ by no more than this standard deviation, sizes of a pixel...
const SPREAD: f32 = 1.5;

/// ... and get this standard deviation, sizes of a pixel.
const DOUBT: f32 = 2.0;

/// Planes are not seen more obliquely than this: the cosine of ray and normal.
const LEAST_FACING: f32 = -0.1;

/// The bit that marks pixels at a jump of depth.
const AT_JUMP: u8 = 128;

impl Surface {
    fn new(depth: f32, normal: Vector3<f32>, sigma: f32) -> Self {
        let number = ((sigma.to_bits() >> 21) + ONE).saturating_sub(1.0_f32.to_bits() >> 21).clamp(1, 127);
        let eighths = |x: f32| (127.0 * x).round() as i8;
        Self { depth, normal: [normal.x, normal.y, normal.z].map(eighths), sigma: number as u8 }
    }

    fn sigma(self) -> f32 {
        let number = u32::from(self.sigma & !AT_JUMP) + (1.0_f32.to_bits() >> 21) - ONE;
        f32::from_bits(number << 21 | 1 << 20)
    }

    fn normal(self) -> Vector3<f32> {
        let [x, y, z] = self.normal.map(|x| f32::from(x) * (1.0 / 127.0));
        Vector3::new(x, y, z)
    }

    fn is_at_jump(self) -> bool {
        self.sigma & AT_JUMP != 0
    }
}

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
    surfaces: Grid<Surface>,
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
        let mut surfaces = Grid::filled(size, Surface::default());
        surfaces.data_mut().par_chunks_mut(size.width.max(1)).enumerate().for_each(|(y, row)| {
            for (x, surface) in row.iter_mut().enumerate() {
                let z = depth[(x, y)];
                if !vamvs_core::depth_map::is_valid(z) {
                    continue;
                }
                let normal = given((x, y)).or_else(|| derived_normal(&camera, &depth, (x, y)));
                let normal = normal.unwrap_or_else(|| -rays.of((x, y)).normalize());
                let sigma = sigma.as_ref().map_or(0.0, |sigma| sigma[(x, y)]);
                *surface = Surface::new(z, normal, sigma.max(0.0) / rays.pixel_size(z));
            }
        });
        let farthest = Grid::filled(Size::new(0, 0), 0.0);
        let mut view = Self { cam_from_world, camera, rays, surfaces, colours: colour, farthest };
        if let Some(confirmed) = confirmed {
            view.fill_unconfirmed(&confirmed);
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
        self.size().area() * (size_of::<Surface>() + size_of::<Rgb>())
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
        // The ball's image is within this of its centre's, as rays to the border of the photograph are less than 80° off the axis.
        let longest = 1.0 + (c.x.abs() + c.y.abs()) / c.z;
        let reach = intrinsics.fx.max(intrinsics.fy) * radius * longest / (c.z - radius);
        let columns = tiles(u, reach, self.size().width);
        let rows = tiles(v, reach, self.size().height);
        let (Some(columns), Some(rows)) = (columns, rows) else { return false };
        let nearest = (c.z - radius) as f32;
        let reaches = |depth: f32| depth > 0.0 && depth * (1.0 + self.widest_share(near)) >= nearest;
        rows.into_iter().any(|y| columns.clone().any(|x| reaches(self.farthest[(x, y)])))
    }

    /// How far behind a surface a view may say something, as a share of the depth, seen obliquely.
    fn widest_share(&self, near: f32) -> f32 {
        (2.0 * WIDEST_BAND).max(CELL_BEHIND * near) * self.rays.pixel_size(1.0) * 12.0
    }

    /// What the view says of a place in its own frame; `near` is what is near a surface, sizes of a pixel.
    #[inline]
    pub fn opinion(&self, x: &Vector3<f64>, near: f32) -> Opinion {
        let Some(place) = self.pixel(x) else { return Opinion::default() };
        let surface = self.surfaces[place];
        if surface.depth <= 0.0 {
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
    fn distance(&self, surface: Surface, place: (usize, usize), x: &Vector3<f64>) -> (f32, f32, f32) {
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

    /// Drops pixels that are not confirmed, but fills small gaps between confirmed ones of one surface.
    fn fill_unconfirmed(&mut self, confirmed: &Grid<bool>) {
        let dropped = |(surface, is_confirmed): (&Surface, &bool)| {
            if *is_confirmed { *surface } else { Surface::default() }
        };
        let surfaces = self.surfaces.data().iter().zip(confirmed.data()).map(dropped).collect();
        self.surfaces = Grid::from_vec(self.size(), surfaces);
        for step in STEPS {
            let mut filled = self.surfaces.clone();
            filled.data_mut().par_chunks_mut(self.size().width.max(1)).enumerate().for_each(|(y, row)| {
                for (x, surface) in row.iter_mut().enumerate().filter(|(_, surface)| surface.depth <= 0.0) {
                    *surface = self.between((x, y), step).unwrap_or_default();
                }
            });
            self.surfaces = filled;
        }
    }

    /// The surface at a pixel between others, of which every `step`th is asked: the mean of their tangent planes, if there
    /// are some to all sides and they agree.
    fn between(&self, (x, y): (usize, usize), step: usize) -> Option<Surface> {
        let size = self.size();
        let (mut depths, mut normals, mut squares) = ([0.0_f32; 2], Vector3::zeros(), 0.0_f32);
        let mut quadrants = [false; 4];
        let direction = self.rays.of((x, y));
        let around = |at: usize, length: usize| {
            let first = at as isize - (step * REACH) as isize;
            let places = (0..=2 * REACH).map(move |number| first + (number * step) as isize);
            places.filter(move |place| (0..length as isize).contains(place)).map(|place| place as usize)
        };
        for row in around(y, size.height) {
            for column in around(x, size.width) {
                let surface = self.surfaces[(column, row)];
                let normal = surface.normal();
                let facing = normal.dot(&direction);
                if surface.depth <= 0.0 || facing > LEAST_FACING {
                    continue;
                }
                let depth = normal.dot(&self.rays.of((column, row))) * surface.depth / facing;
                let squared = (column.abs_diff(x).pow(2) + row.abs_diff(y).pow(2)) as f32;
                let weight = 1.0 / (((step * step) as f32 + squared) * (0.25 + surface.sigma().powi(2)));
                depths = [depths[0] + weight * depth, depths[1] + weight];
                squares += weight * depth * depth;
                normals += normal * weight;
                quadrants[usize::from(column > x) + 2 * usize::from(row > y)] = true;
            }
        }
        if quadrants.iter().filter(|is_there| **is_there).count() < QUADRANTS {
            return None;
        }
        let depth = depths[0] / depths[1];
        let spread = (squares / depths[1] - depth * depth).max(0.0).sqrt() / self.rays.pixel_size(depth);
        let normal = normals.try_normalize(0.0)?;
        (spread * -normal.dot(&direction) < SPREAD).then(|| Surface::new(depth, normal, DOUBT))
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
                surface.sigma |= AT_JUMP;
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

/// The rays through the centres of pixels.
#[derive(Clone, Copy)]
struct Rays {
    /// What a pixel to the right and one below add to a ray.
    step: [f32; 2],
    /// The ray of the first pixel.
    first: [f32; 2],
    /// The size of a pixel at depth 1.
    pixel: f32,
}

impl Rays {
    fn new(camera: &Pinhole) -> Self {
        let Intrinsics { fx, fy, cx, cy } = camera.intrinsics;
        let first = [((0.5 - cx) / fx) as f32, ((0.5 - cy) / fy) as f32];
        Self { step: [(1.0 / fx) as f32, (1.0 / fy) as f32], first, pixel: (2.0 / (fx + fy)) as f32 }
    }

    /// The ray of a pixel, at depth 1.
    #[inline]
    fn of(&self, (x, y): (usize, usize)) -> Vector3<f32> {
        let [right, down] = self.step;
        Vector3::new(self.first[0] + x as f32 * right, self.first[1] + y as f32 * down, 1.0)
    }

    /// The size of a pixel at a depth, scene units.
    #[inline]
    fn pixel_size(&self, depth: f32) -> f32 {
        self.pixel * depth
    }
}

/// The tiles along an axis that what is within `reach` of `centre` may fall into.
fn tiles(centre: f64, reach: f64, length: usize) -> Option<std::ops::Range<usize>> {
    let (first, last) = ((centre - reach - 1.0).max(0.0), (centre + reach + 1.0).min(length as f64 - 1.0));
    (first <= last).then(|| first as usize / TILE..last as usize / TILE + 1)
}

/// A normal of a map in the world's frame, in the camera's; `None` if there is none.
fn given_normal(
    normals: &Grid<[f32; 3]>,
    rotation: &Matrix3<f32>,
    place: (usize, usize),
) -> Option<Vector3<f32>> {
    (rotation * Vector3::from(normals[place])).try_normalize(0.5)
}

/// The normal of a pixel by the inverse depths beside it, along each axis of that which differs less.
fn derived_normal(camera: &Pinhole, depth: &Grid<f32>, (x, y): (usize, usize)) -> Option<Vector3<f32>> {
    let w = 1.0 / depth[(x, y)];
    let at = |x: usize, y: usize| {
        depth.get(x, y).copied().filter(|depth| vamvs_core::depth_map::is_valid(*depth)).map(f32::recip)
    };
    let slope = |before: Option<f32>, behind: Option<f32>| match (before, behind) {
        (Some(before), Some(behind)) if (w - before).abs() > (behind - w).abs() => Some(behind - w),
        (Some(before), _) => Some(w - before),
        (None, Some(behind)) => Some(behind - w),
        (None, None) => None,
    };
    let gx = slope(x.checked_sub(1).and_then(|x| at(x, y)), at(x + 1, y))?;
    let gy = slope(y.checked_sub(1).and_then(|y| at(x, y)), at(x, y + 1))?;
    let intrinsics = &camera.intrinsics;
    let [fx, fy, cx, cy] =
        [intrinsics.fx, intrinsics.fy, intrinsics.cx, intrinsics.cy].map(|value| value as f32);
    // 1/z is this direction times the ray; the plane is where it is 1 times the point.
    let inwards = Vector3::new(gx * fx, gy * fy, w - gx * (x as f32 + 0.5 - cx) - gy * (y as f32 + 0.5 - cy));
    Some(-inwards.normalize())
}
