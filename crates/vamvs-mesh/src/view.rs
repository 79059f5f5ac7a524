//! A view as meshing uses it: the surfaces that its pixels see.

use nalgebra::Vector3;
use rayon::prelude::*;
use vamvs_core::{Grid, Rgb, Size, depth_map};

use crate::band::band;
use crate::pixel::PixelSurface;
use crate::rays::{Rays, derived_normal, given_normal};
use crate::sight::Sight;
use crate::{MeshError, MeshView, gaps};

/// The error of a depth that its standard deviation does not know, in sizes of a pixel on the surface.
pub(crate) const LEAST_SIGMA: f32 = 0.3;

/// The cosine of normal and ray of a surface that is seen from behind: noise turns surfaces that are seen at a grazing angle.
const MOST_AWAY: f64 = 0.1;

/// Neighbours that are farther than this from a pixel's tangent plane, in sizes of a pixel, are of another surface.
const JUMP: f32 = 4.0;

/// A view as meshing uses it: eleven bytes a pixel.
pub(crate) struct SeenView {
    pub sight: Sight,
    surfaces: Grid<PixelSurface>,
    colours: Grid<Rgb>,
}

impl SeenView {
    /// What is needed of the view with this number; an error if a raster has another size than the camera.
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
        if let Some(confirmed) = confirmed {
            gaps::fill(&rays, &mut surfaces, &confirmed);
        }
        let depths = surfaces.data().iter().map(|surface| surface.depth);
        let sight = Sight::new(camera, cam_from_world, depths);
        let mut view = Self { sight, surfaces, colours: colour };
        view.mark_jumps();
        Ok(view)
    }

    /// Bytes that the view takes.
    pub fn bytes(&self) -> u64 {
        Self::bytes_of(self.surfaces.size())
    }

    /// Bytes that a view of this size takes.
    pub fn bytes_of(size: Size) -> u64 {
        (size.area() * (size_of::<PixelSurface>() + size_of::<Rgb>())) as u64
    }

    /// The depth of a pixel, not positive where there is none.
    pub fn depth(&self, place: (usize, usize)) -> f32 {
        self.surfaces[place].depth
    }

    /// What a pixel sees.
    #[inline]
    pub fn surface(&self, place: (usize, usize)) -> PixelSurface {
        self.surfaces[place]
    }

    /// Whether the view sees past a place in its own frame: what it sees there is farther, or there is no surface around.
    pub fn sees_past(&self, x: &Vector3<f64>) -> bool {
        let Some((column, row)) = self.sight.pixel(x) else { return false };
        let surface = self.surfaces[(column, row)];
        if surface.depth <= 0.0 {
            let mut around = self.around((column, row));
            return around.all(|place| self.surfaces[place].depth == 0.0);
        }
        let (distance, pixel, sigma) = self.distance(surface, (column, row), x);
        distance >= band(pixel, sigma) && !surface.is_at_jump()
    }

    /// A pixel and those beside it.
    fn around(&self, (x, y): (usize, usize)) -> impl Iterator<Item = (usize, usize)> {
        let size = self.surfaces.size();
        let columns = x.saturating_sub(1)..(x + 2).min(size.width);
        let rows = y.saturating_sub(1)..(y + 2).min(size.height);
        rows.flat_map(move |row| columns.clone().map(move |column| (column, row)))
    }

    /// Whether the view sees a surface near a place in the world, and not from behind: the side to which a normal points.
    pub fn faces(&self, place: &Vector3<f64>, normal: &Vector3<f64>, near: f32) -> bool {
        let pose = &self.sight.cam_from_world;
        let x = pose.transform(place);
        let Some(pixel) = self.sight.pixel(&x) else { return false };
        let (surface, away) = (self.surfaces[pixel], (pose.rotation * normal).dot(&x));
        if surface.depth <= 0.0 || away > MOST_AWAY * normal.norm() * x.norm() {
            return false;
        }
        let (distance, size, sigma) = self.distance(surface, pixel, &x);
        distance.abs() <= band(size, sigma).max(near * size)
    }

    /// The colour that the view has for a place on the surface, in its own frame, and how much it counts.
    pub fn colour(&self, x: &Vector3<f64>) -> Option<(Vector3<f32>, f32)> {
        let place = self.sight.pixel(x)?;
        let surface = self.surfaces[place];
        if surface.depth <= 0.0 {
            return None;
        }
        let (distance, pixel, sigma) = self.distance(surface, place, x);
        if distance.abs() > band(pixel, sigma) {
            return None;
        }
        let direction = self.sight.rays.of(place).normalize();
        let cosine = -surface.normal().dot(&direction);
        let jump = if surface.is_at_jump() { 0.01 } else { 1.0 };
        let weight = jump * (cosine / pixel).powi(2);
        (cosine > 0.05).then(|| (Vector3::from(self.colours[place]).map(f32::from), weight))
    }

    /// The signed distance of a place from a pixel's tangent plane, the pixel's size on the surface, and the standard
    /// deviation of the depth, scene units.
    #[inline]
    fn distance(&self, surface: PixelSurface, place: (usize, usize), x: &Vector3<f64>) -> (f32, f32, f32) {
        let on_surface = self.sight.rays.of(place) * surface.depth;
        let pixel = self.sight.rays.pixel_size(surface.depth);
        (surface.normal().dot(&(x.cast::<f32>() - on_surface)), pixel, surface.sigma() * pixel)
    }

    /// The distance of what a pixel sees from the tangent plane of what another sees, sizes of a pixel.
    fn distance_between(&self, place: (usize, usize), other: (usize, usize)) -> f32 {
        let at = |place: (usize, usize)| self.sight.rays.of(place) * self.surfaces[place].depth;
        let surface = self.surfaces[other];
        surface.normal().dot(&(at(place) - at(other))).abs() / self.sight.rays.pixel_size(surface.depth)
    }

    /// Marks pixels beside which another surface is seen.
    fn mark_jumps(&mut self) {
        let size = self.surfaces.size();
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
        let mut around = self.around((x, y));
        around.any(|other| self.surfaces[other].depth > 0.0 && self.distance_between(other, (x, y)) > JUMP)
    }
}
