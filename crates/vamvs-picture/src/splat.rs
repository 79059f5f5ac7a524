//! Pictures of clouds: each point is a small disc perpendicular to its normal. Nearer discs hide
//! farther ones; overlapping discs of the same surface are blended.

use std::num::NonZero;

use kiddo::{ImmutableKdTree, SquaredEuclidean};
use nalgebra::Vector3;
use rayon::prelude::*;
use vamvs_core::{CloudPoint, Grid, Rgb, Size};
use vamvs_io::image;

use crate::Viewpoint;

/// The background colour.
const BACKGROUND: [f32; 3] = [222.0, 225.0, 229.0];

/// The colour of clay in white light.
const CLAY: [f32; 3] = [236.0, 229.0, 216.0];

/// Supersampling factor in each direction.
const SAMPLES: usize = 2;

/// A disc reaches the fifth neighbour of its point; the search also finds the point itself.
const NEIGHBOURS: NonZero<usize> = NonZero::new(6).unwrap();

/// Largest radius of a disc, as a multiple of the median radius.
const LARGEST: f32 = 2.0;

/// How the points look.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Look {
    /// In their own colours.
    Colours,
    /// As clay in the light of a lamp: this shows the normals.
    Clay,
}

/// A cloud whose points have a size.
#[derive(Clone, Debug)]
pub struct Surfels<'a> {
    points: &'a [CloudPoint],
    /// Radius of the disc of each point, scene units.
    radii: Vec<f32>,
}

/// A disc in a picture; lengths in pixels, depths in scene units.
struct Splat {
    x: f32,
    y: f32,
    radius: f32,
    /// Unit direction in which the disc is foreshortened.
    narrow: [f32; 2],
    /// Its extent in that direction, as a share of its radius.
    squeeze: f32,
    depth: f32,
    /// How far behind another disc it may be and still belong to the same surface.
    slack: f32,
    colour: [f32; 3],
}

impl<'a> Surfels<'a> {
    /// Sets the size of each point by the distance to its neighbours.
    #[must_use]
    pub fn new(points: &'a [CloudPoint]) -> Self {
        Self { points, radii: radii(points) }
    }

    /// The picture from a viewpoint.
    #[must_use]
    pub fn render(&self, view: &Viewpoint, look: Look) -> Grid<Rgb> {
        let size = view.camera.size;
        let fine_size = Size::new(SAMPLES * size.width, SAMPLES * size.height);
        let fine = Viewpoint { camera: view.camera.resized(fine_size), ..*view };
        let points = self.points.par_iter().zip(&self.radii);
        let splats: Vec<_> =
            points.filter_map(|(point, &radius)| splat(point, radius, &fine, look)).collect();
        image::resize(&blend(&splats, fine_size), size)
    }
}

/// The median radius of points.
pub(crate) fn typical_radius(points: &[CloudPoint]) -> f32 {
    let mut radii = radii(points);
    let middle = radii.len() / 2;
    if radii.is_empty() { 0.0 } else { *radii.select_nth_unstable_by(middle, f32::total_cmp).1 }
}

fn radii(points: &[CloudPoint]) -> Vec<f32> {
    let places: Vec<[f64; 3]> = points.iter().map(|point| point.x_in_world).collect();
    let Ok(tree) = ImmutableKdTree::<f64, 3>::new_from_slice(&places) else { return vec![0.0; places.len()] };
    let reach = |place: &[f64; 3]| {
        let found = tree.query(place).nearest_n::<SquaredEuclidean<f64>>(NEIGHBOURS).execute();
        found.iter().map(|neighbour| neighbour.distance).fold(0.0, f64::max).sqrt() as f32
    };
    let mut radii: Vec<f32> = places.par_iter().map(reach).collect();
    let mut sorted = radii.clone();
    let middle = sorted.len() / 2;
    if middle > 0 {
        let most = *sorted.select_nth_unstable_by(middle, f32::total_cmp).1;
        radii.iter_mut().for_each(|radius| *radius = radius.min(LARGEST * most));
    }
    radii
}

/// Direction to a lamp above the viewer's left shoulder, in the camera's frame.
const TO_LAMP: Vector3<f64> = Vector3::new(-0.38, -0.53, -0.757);

/// The light that clay of a unit normal (camera's frame) sends to the eye: some from everywhere, some
/// from the eye's own direction, most from the lamp.
fn light(normal_in_cam: &Vector3<f64>) -> f32 {
    let (lamp, eye) = (normal_in_cam.dot(&TO_LAMP).max(0.0), (-normal_in_cam.z).max(0.0));
    (0.15 + 0.3 * eye + 0.55 * lamp).min(1.0) as f32
}

fn splat(point: &CloudPoint, radius: f32, view: &Viewpoint, look: Look) -> Option<Splat> {
    let in_cam = view.cam_from_world.transform(&point.x_in_world.into());
    let at = view.camera.project_inside(&in_cam)?;
    let normal_in_cam = view.cam_from_world.rotation * Vector3::from(point.normal).cast::<f64>();
    let facing = normal_in_cam.dot(&in_cam.normalize()).abs();
    let tilt = normal_in_cam.xy().try_normalize(1e-6);
    Some(Splat {
        x: at.x as f32,
        y: at.y as f32,
        radius: (f64::from(radius) * view.camera.intrinsics.fx / in_cam.z).clamp(1.0, 40.0) as f32,
        narrow: tilt.map_or([1.0, 0.0], |tilt| [tilt.x as f32, tilt.y as f32]),
        squeeze: if tilt.is_some() { facing.max(0.3) as f32 } else { 1.0 },
        depth: in_cam.z as f32,
        slack: 2.0 * radius,
        colour: match look {
            Look::Colours => point.colour.map(f32::from),
            Look::Clay => CLAY.map(|channel| channel * light(&normal_in_cam)),
        },
    })
}

fn blend(splats: &[Splat], size: Size) -> Grid<Rgb> {
    let mut nearest = Grid::filled(size, f32::INFINITY);
    for splat in splats {
        splat.pixels(size, |x, y, _| nearest[(x, y)] = nearest[(x, y)].min(splat.depth));
    }
    let mut sums = Grid::filled(size, [0.0_f32; 4]);
    for splat in splats {
        splat.pixels(size, |x, y, weight| {
            if splat.depth <= nearest[(x, y)] + splat.slack {
                let [r, g, b] = splat.colour;
                let sum = &mut sums[(x, y)];
                sum.iter_mut().zip([r, g, b, 1.0]).for_each(|(sum, value)| *sum += weight * value);
            }
        });
    }
    sums.map(|&[r, g, b, weight]| {
        let colour = if weight > 0.0 { [r, g, b].map(|sum| sum / weight) } else { BACKGROUND };
        colour.map(|channel| channel.round() as u8)
    })
}

impl Splat {
    /// Calls `visit(x, y, weight)` for the pixels that the disc covers.
    fn pixels(&self, size: Size, mut visit: impl FnMut(usize, usize, f32)) {
        let span = |centre: f32, side: usize| {
            let first = (centre - self.radius).floor().max(0.0) as usize;
            first..((centre + self.radius).ceil() as usize).min(side)
        };
        for y in span(self.y, size.height) {
            for x in span(self.x, size.width) {
                let (dx, dy) = (x as f32 + 0.5 - self.x, y as f32 + 0.5 - self.y);
                let across = (dx * self.narrow[0] + dy * self.narrow[1]) / self.squeeze;
                let along = dy * self.narrow[0] - dx * self.narrow[1];
                let rest = 1.0 - (across * across + along * along) / (self.radius * self.radius);
                if rest > 0.0 {
                    visit(x, y, rest * rest);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RED: Rgb = [255, 0, 0];
    const BLUE: Rgb = [0, 0, 255];

    /// A square of side 2 at height z that faces along z.
    fn square(z: f64, colour: Rgb) -> Vec<CloudPoint> {
        let place = |i: usize| i as f64 / 20.0 - 1.0;
        let point = |i: usize| CloudPoint {
            x_in_world: [place(i % 41), place(i / 41), z],
            normal: [0.0, 0.0, 1.0],
            colour,
            confidence: 1.0,
            sigma: 0.0,
            views: 3,
        };
        (0..41 * 41).map(point).collect()
    }

    fn view(cloud: &[CloudPoint]) -> Viewpoint {
        Viewpoint::from_direction(cloud, &Vector3::z(), &Vector3::y(), Size::new(120, 120))
    }

    #[test]
    fn a_surface_is_whole_and_hides_what_is_behind_it() {
        let (near, far) = (square(0.0, RED), square(-0.4, BLUE));
        let cloud = [near, far].concat();
        let picture = Surfels::new(&cloud).render(&view(&cloud), Look::Colours);
        for y in 20..100 {
            for x in 20..100 {
                assert_eq!(picture[(x, y)], RED, "at ({x}, {y})");
            }
        }
    }

    #[test]
    fn nothing_is_shown_where_there_is_nothing() {
        let cloud = square(0.0, RED);
        let wide = Viewpoint::from_direction(&cloud, &Vector3::z(), &Vector3::y(), Size::new(300, 100));
        assert_eq!(Surfels::new(&cloud).render(&wide, Look::Colours)[(5, 50)], BACKGROUND.map(|v| v as u8));
        let nothing = Surfels::new(&[]).render(&wide, Look::Colours);
        assert!(nothing.data().iter().all(|pixel| *pixel == BACKGROUND.map(|v| v as u8)));
    }

    #[test]
    fn clay_is_brighter_the_more_it_faces_the_lamp() {
        let cloud = square(0.0, RED);
        let brightness = |normal: [f32; 3]| {
            let turned: Vec<_> = cloud.iter().map(|point| CloudPoint { normal, ..*point }).collect();
            Surfels::new(&turned).render(&view(&cloud), Look::Clay)[(60, 60)][0]
        };
        assert!(brightness([-0.38, 0.53, 0.757]) > brightness([0.0, 0.0, 1.0]));
        assert!(brightness([0.0, 0.0, 1.0]) > brightness([0.6, -0.5, 0.62]));
    }
}
