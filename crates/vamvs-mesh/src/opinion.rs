//! What a view says of places: how far before or behind the surface that it sees there.
//!
//! Places are asked many at a time, in loops over arrays that the compiler turns into vector instructions.

use vamvs_core::widened;

use crate::band::{band, known_behind};
use crate::pixel::{normal_of, sigma_of};
use crate::view::{LEAST_SIGMA, SeenView};

/// Behind a surface its weight is 1 up to this share of the band...
const SURE: f32 = 0.2;

/// ... and declines up to this share of it...
const HIDDEN: f32 = 0.7;

/// ... to this weight, which it has up to twice the band: there it is solid unless another view sees into it.
const HIDDEN_WEIGHT: f32 = 0.03;

/// The weight of pixels at a jump of depth.
const JUMP_WEIGHT: f32 = 0.2;

/// The number of places that are asked together.
pub(crate) const PLACES: usize = 81;

/// Places in a view's frame: their x, y and z.
pub(crate) type Places = [[f32; PLACES]; 3];

/// What views say of places, all together.
#[derive(Clone, Copy)]
pub(crate) struct Opinions {
    /// Sums of weights times signed distances from the surface, scene units: positive towards the camera.
    pub distances: [f32; PLACES],
    /// Sums of weights; 0: no view sees the place.
    pub weights: [f32; PLACES],
    /// 1 where a view sees a surface near the place, else 0.
    pub are_near: [f32; PLACES],
}

impl Default for Opinions {
    fn default() -> Self {
        Self { distances: [0.0; PLACES], weights: [0.0; PLACES], are_near: [0.0; PLACES] }
    }
}

/// What pixels see.
struct Seen {
    /// Not positive: nothing.
    depths: [f32; PLACES],
    normals: [[f32; PLACES]; 3],
    sigmas: [f32; PLACES],
    /// 1 for pixels at a jump of depth, else 0.
    at_jump: [f32; PLACES],
    rays: [[f32; PLACES]; 2],
}

/// What is the same for all places that a view is asked for.
struct Scale {
    /// The size of a pixel at depth 1.
    pixel: f32,
    /// What is near a surface, sizes of a pixel.
    near: f32,
    /// The largest depth of places of which something may be said where the surface is at depth 1.
    farthest: f32,
}

widened! {
    /// Adds what is said of places.
    fn weigh(seen: &Seen, places: &Places, scale: &Scale, opinions: &mut Opinions) = weigh_all;
}

#[inline(always)]
fn weigh_all(seen: &Seen, [x, y, z]: &Places, scale: &Scale, opinions: &mut Opinions) {
    for i in 0..PLACES {
        let depth = seen.depths[i];
        let pixel = scale.pixel * depth;
        let near = scale.near * pixel;
        let sigma = seen.sigmas[i] * pixel;
        let distance = seen.normals[0][i] * (x[i] - seen.rays[0][i] * depth)
            + seen.normals[1][i] * (y[i] - seen.rays[1][i] * depth)
            + seen.normals[2][i] * (z[i] - depth);
        let band = band(pixel, sigma);
        let doubt = LEAST_SIGMA * pixel;
        // Of two surfaces that meet in a corner, the nearer one tells.
        let (distance_in_band, pixels) = (distance.max(-band).min(band), pixel * pixel);
        let certainty =
            pixels / ((pixels + distance_in_band * distance_in_band) * (sigma * sigma + doubt * doubt));
        let share = ((distance / band + HIDDEN) * (1.0 / (HIDDEN - SURE))).clamp(0.0, 1.0);
        let declining = HIDDEN_WEIGHT + (1.0 - HIDDEN_WEIGHT) * share;
        let is_known = distance >= -known_behind(band, near);
        let behind = if is_known { declining * (1.0 - (1.0 - JUMP_WEIGHT) * seen.at_jump[i]) } else { 0.0 };
        // Seen through, unless another surface's pixel is beside this one.
        let beyond = 1.0 - seen.at_jump[i];
        let weight = certainty * if distance >= band { beyond } else { behind };
        let is_seen = (depth > 0.0) & (z[i] <= depth * scale.farthest);
        let weight = if is_seen { weight } else { 0.0 };
        let is_near = is_seen & (distance.abs() <= near);
        opinions.distances[i] += if is_seen { weight * distance_in_band } else { 0.0 };
        opinions.weights[i] += weight;
        opinions.are_near[i] = opinions.are_near[i].max(if is_near { 1.0 } else { 0.0 });
    }
}

impl SeenView {
    /// Adds what the view says of places in its own frame; `near` is what is near a surface, sizes of a pixel.
    pub fn add(&self, places: &Places, near: f32, opinions: &mut Opinions) {
        let (pixel, farthest) = (self.sight.rays.pixel_size(1.0), self.sight.last_depth(1.0, near));
        weigh(&self.seen(places), places, &Scale { pixel, near, farthest }, opinions);
    }

    /// What the pixels see in which places are.
    fn seen(&self, [x, y, z]: &Places) -> Seen {
        let camera = &self.sight.camera;
        let of = |value: f64| value as f32;
        let k = &camera.intrinsics;
        let ([fx, fy], [cx, cy]) = ([k.fx, k.fy].map(of), [k.cx, k.cy].map(of));
        let (width, height) = (camera.size.width as f32, camera.size.height as f32);
        let (mut u, mut v) = ([0.0_f32; PLACES], [0.0_f32; PLACES]);
        for i in 0..PLACES {
            let w = 1.0 / z[i];
            (u[i], v[i]) = (fx * (x[i] * w) + cx, fy * (y[i] * w) + cy);
        }
        let (mut depths, mut packed, mut rays) = ([0.0_f32; PLACES], [0_u32; PLACES], [[0.0_f32; PLACES]; 2]);
        for i in 0..PLACES {
            if z[i] > 0.0 && u[i] >= 0.0 && v[i] >= 0.0 && u[i] < width && v[i] < height {
                let pixel = (u[i] as usize, v[i] as usize);
                (depths[i], packed[i]) = self.surface(pixel).parts();
                let ray = self.sight.rays.of(pixel);
                (rays[0][i], rays[1][i]) = (ray.x, ray.y);
            }
        }
        let mut seen =
            Seen { depths, normals: [[0.0; PLACES]; 3], sigmas: [0.0; PLACES], at_jump: [0.0; PLACES], rays };
        for (i, packed) in packed.into_iter().enumerate() {
            for axis in 0..3 {
                seen.normals[axis][i] = normal_of(packed, axis);
            }
            seen.sigmas[i] = sigma_of(packed);
            seen.at_jump[i] = (packed >> 31) as f32;
        }
        seen
    }
}
