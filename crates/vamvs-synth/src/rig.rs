//! Places cameras around a focus: rigs of random shape, with no camera inside, behind or right in front of an
//! object.

use std::f64::consts::{PI, TAU};

use nalgebra::{Vector2, Vector3};
use rand::RngExt;
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};
use vamvs_core::{Intrinsics, Pinhole, Pose, Size};

use crate::random::triangular;
use crate::{Focus, Tracer};

/// How cameras are arranged.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Rig {
    /// Spread over a cap of a dome.
    Dome,
    /// One after the other along an arc, as if hand-held.
    Arc,
    /// In rows and columns, parallel or converging on the focus.
    Grid,
    /// On a horizontal circle, all around if there are enough cameras.
    Ring,
}

impl Rig {
    /// All rigs.
    pub const ALL: [Self; 4] = [Self::Dome, Self::Arc, Self::Grid, Self::Ring];

    /// The name that users write.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Dome => "dome",
            Self::Arc => "arc",
            Self::Grid => "grid",
            Self::Ring => "ring",
        }
    }

    /// The smallest and the largest angle of the rig, as seen from the focus, degrees: for a dome from its middle to
    /// its border, else between neighbouring cameras.
    const fn angles(self) -> (f64, f64) {
        match self {
            Self::Dome => (14.0, 38.0),
            Self::Arc => (3.0, 9.0),
            Self::Grid => (3.5, 9.0),
            Self::Ring => (8.0, 24.0),
        }
    }

    /// Factor on the random displacement and rotation of cameras; 2 if they are hand-held.
    const fn unsteadiness(self) -> f64 {
        if matches!(self, Self::Arc) { 2.0 } else { 1.0 }
    }
}

/// Which rig is wanted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RigOptions {
    /// How the cameras are arranged.
    pub rig: Rig,
    /// Number of cameras.
    pub views: usize,
    /// Size of their images, pixels.
    pub size: Size,
}

/// A camera and its pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Station {
    /// The camera, the same for the whole rig.
    pub camera: Pinhole,
    /// The pose.
    pub cam_from_world: Pose,
}

/// Number of rigs that are tried before a stage is given up, each closer to the focus than the one before.
const RIGS: i32 = 24;
/// Number of random places that are tried for a camera, each with more jitter than the one before. Also the number
/// of directions tried for the middle of a rig.
const PLACES: usize = 8;
/// Factor on a rig's distance if the one before did not fit.
const CLOSER: f64 = 0.95;
/// Smallest and largest field of view across the longer side of the image, degrees.
const FIELD_OF_VIEW: (f64, f64) = (32.0, 62.0);
/// Smallest and largest radius of the focus in the image, as a share of half the image's shorter side.
const FILL: (f64, f64) = (0.85, 1.25);
/// Nothing in the image may be nearer than this share of the distance to the focus.
const NEAREST: f64 = 0.3;
/// Nothing in any direction may be nearer to a camera than this share of its distance to the focus.
const CLEARANCE: f64 = 0.08;
/// Number of rays along each side of the image that a view is checked with.
const GRID: usize = 9;

/// Places the cameras of a rig; `None` if none of the rigs that were tried has a place for every camera.
#[must_use]
pub fn place(
    options: &RigOptions,
    focus: &Focus,
    tracer: &Tracer,
    random: &mut Pcg64,
) -> Option<Vec<Station>> {
    (0..RIGS).find_map(|attempt| {
        let plan = Plan::draw(options, focus, CLOSER.powi(attempt), random);
        (0..options.views).map(|view| plan.station(view, tracer, random)).collect()
    })
}

/// The shape of a rig, before its cameras are jittered and checked.
struct Plan<'a> {
    rig: Rig,
    views: usize,
    focus: &'a Focus,
    camera: Pinhole,
    distance: f64,
    /// Orthonormal directions from the focus: to the middle of the rig, right and up in its cameras' images.
    frame: [Vector3<f64>; 3],
    /// As [`Rig::angles`], radians.
    angle: f64,
    /// A random angle, radians: where the spiral of a dome begins; its sine sets how steeply an arc climbs.
    phase: f64,
    /// How much the viewing directions of a grid converge: 0 is parallel, at 1 all meet at the focus.
    convergence: f64,
}

impl<'a> Plan<'a> {
    fn draw(options: &RigOptions, focus: &'a Focus, closer: f64, random: &mut Pcg64) -> Self {
        let &RigOptions { rig, views, size } = options;
        let (camera, half_field) = draw_camera(size, random);
        let (least, most) = rig.angles();
        let wanted = random.random_range(least..most).to_radians();
        let span = span(rig, views, wanted);
        let reach = span.min(0.9 * focus.spread);
        Self {
            rig,
            views,
            focus,
            camera,
            distance: closer * focus.radius / half_field.sin() / random.random_range(FILL.0..FILL.1),
            frame: frame(&middle(focus, reach, random)),
            angle: if span > 0.0 { wanted * reach / span } else { wanted },
            phase: random.random_range(0.0..TAU),
            convergence: random.random(),
        }
    }

    /// The camera of a view, at the first place tried from which it sees the focus; `None` if there is none.
    fn station(&self, view: usize, tracer: &Tracer, random: &mut Pcg64) -> Option<Station> {
        (0..PLACES).find_map(|place| {
            let station = self.candidate(view, 1.0 + place as f64, random);
            (self.is_admitted(&station) && sees(tracer, &station, &self.focus.centre)).then_some(station)
        })
    }

    fn candidate(&self, view: usize, jitter: f64, random: &mut Pcg64) -> Station {
        let mut about = |most: f64| jitter * most * triangular(random);
        let (mut eye, mut target) = self.ideal(view);
        let unsteady = self.rig.unsteadiness();
        eye += Vector3::from_fn(|_, _| about(0.04 * unsteady * self.distance));
        eye += (eye - self.focus.centre) * about(0.06);
        target += Vector3::from_fn(|_, _| about(0.06 * unsteady * self.focus.radius));
        let up = rolled(&self.up(), &(target - eye), about(0.04 * unsteady));
        Station { camera: self.camera, cam_from_world: Pose::look_at(&eye, &target, &up) }
    }

    /// The position of a view's camera before jitter, and the point that it looks at.
    fn ideal(&self, view: usize) -> (Vector3<f64>, Vector3<f64>) {
        let centre = self.focus.centre;
        let order = view as f64 - 0.5 * (self.views as f64 - 1.0);
        let on_sphere =
            |direction: Vector3<f64>| (centre + self.distance * raised(direction, self.focus), centre);
        match self.rig {
            Rig::Dome => {
                let radius = self.angle * ((view as f64 + 0.5) / self.views as f64).sqrt();
                let turn = self.phase + PI * (3.0 - 5_f64.sqrt()) * view as f64;
                on_sphere(self.direction(radius * turn.cos(), radius * turn.sin()))
            }
            Rig::Arc => {
                let climb = 0.3 * self.phase.sin();
                on_sphere(self.direction(order * self.angle, climb * order * self.angle))
            }
            Rig::Ring => on_sphere(turned(&self.frame[0], order * self.angle)),
            Rig::Grid => self.in_grid(view),
        }
    }

    fn in_grid(&self, view: usize) -> (Vector3<f64>, Vector3<f64>) {
        let columns = (self.views as f64).sqrt().ceil() as usize;
        let rows = self.views.div_ceil(columns);
        let place = |index: usize, count: usize| index as f64 - 0.5 * (count as f64 - 1.0);
        let [middle, right, up] = self.frame;
        let aside = right * place(view % columns, columns) + up * place(view / columns, rows);
        let offset = aside * (self.distance * self.angle.tan());
        let centre = self.focus.centre;
        (centre + self.distance * middle + offset, centre + (1.0 - self.convergence) * offset)
    }

    /// The direction from the focus at these angles (radians) to the right of the rig's middle and above it.
    fn direction(&self, right: f64, up: f64) -> Vector3<f64> {
        let angle = right.hypot(up);
        let aside = self.frame[1] * right + self.frame[2] * up;
        if angle > 0.0 { self.frame[0] * angle.cos() + aside * (angle.sin() / angle) } else { self.frame[0] }
    }

    /// The up direction of the images: the world's, or the rig's own if the rig looks down steeply.
    fn up(&self) -> Vector3<f64> {
        let steep = self.frame[0].z > 60_f64.to_radians().sin() && self.rig != Rig::Ring;
        if steep { self.frame[2] } else { Vector3::z() }
    }

    fn is_admitted(&self, station: &Station) -> bool {
        let to_eye = station.cam_from_world.centre() - self.focus.centre;
        self.focus.admits(&to_eye.normalize())
    }
}

/// The angle from the middle of a rig to its outermost camera (for a grid approximately), radians.
fn span(rig: Rig, views: usize, angle: f64) -> f64 {
    let steps = views.saturating_sub(1) as f64;
    match rig {
        Rig::Dome => angle,
        Rig::Arc => 0.5 * steps * angle,
        Rig::Ring => 0.5 * (steps * angle).min(TAU * steps / (steps + 1.0)),
        Rig::Grid => 0.7 * (steps + 1.0).sqrt().floor() * angle,
    }
}

/// A camera with a random field of view and a principal point near the image centre, and half its field of view
/// across the shorter side, radians.
fn draw_camera(size: Size, random: &mut Pcg64) -> (Pinhole, f64) {
    let (width, height) = (size.width as f64, size.height as f64);
    let field = random.random_range(FIELD_OF_VIEW.0..FIELD_OF_VIEW.1).to_radians();
    let focal = 0.5 * width.max(height) / (0.5 * field).tan();
    let mut centre = |side: f64| side * (0.5 + 0.015 * triangular(random));
    let intrinsics = Intrinsics { fx: focal, fy: focal, cx: centre(width), cy: centre(height) };
    (Pinhole { size, intrinsics }, (0.5 * width.min(height) / focal).atan())
}

/// A random direction from the focus to the middle of a rig that reaches `reach` (radians) to all sides.
fn middle(focus: &Focus, reach: f64, random: &mut Pcg64) -> Vector3<f64> {
    let room = (focus.spread - reach).max(0.0);
    let [axis, right, up] = frame(&focus.axis);
    let lowest = (focus.lowest + 0.5 * reach).sin();
    let mut draw = || {
        let cosine = random.random_range(room.cos()..=1.0);
        let (sine, turn) = ((1.0 - cosine * cosine).sqrt(), random.random_range(0.0..TAU));
        axis * cosine + (right * turn.cos() + up * turn.sin()) * sine
    };
    (0..PLACES).map(|_| draw()).find(|direction| direction.z >= lowest).unwrap_or(focus.axis)
}

/// Orthonormal vectors: `forward` (from the focus to a camera), and right and up as that camera sees them.
fn frame(forward: &Vector3<f64>) -> [Vector3<f64>; 3] {
    let beside = if forward.z.abs() < 0.999 { Vector3::z() } else { Vector3::y() };
    let right = beside.cross(forward).normalize();
    [*forward, right, forward.cross(&right)]
}

/// The direction, raised where needed to the lowest elevation that the focus admits.
fn raised(direction: Vector3<f64>, focus: &Focus) -> Vector3<f64> {
    let lowest = (focus.lowest + 0.02).sin();
    let across = direction.xy();
    if direction.z >= lowest || across.norm() == 0.0 {
        return direction;
    }
    (across.normalize() * (1.0 - lowest * lowest).sqrt()).push(lowest)
}

/// The vector turned about the world's z axis by `angle` (radians).
fn turned(vector: &Vector3<f64>, angle: f64) -> Vector3<f64> {
    let (sin, cos) = angle.sin_cos();
    Vector3::new(cos * vector.x - sin * vector.y, sin * vector.x + cos * vector.y, vector.z)
}

/// `up` rotated by `angle` (radians) around the viewing direction `ahead`; not of unit length.
fn rolled(up: &Vector3<f64>, ahead: &Vector3<f64>, angle: f64) -> Vector3<f64> {
    up + ahead.cross(up).normalize() * angle.tan()
}

/// Whether a camera is clear of all objects and its image shows surfaces at the distance of `centre`.
fn sees(tracer: &Tracer, station: &Station, centre: &Vector3<f64>) -> bool {
    let eye = station.cam_from_world.centre();
    let distance = (centre - eye).norm();
    is_clear(tracer, &eye, CLEARANCE * distance) && shows(tracer, station, distance)
}

/// Whether rays in 26 directions from `eye` meet nothing within `reach`.
fn is_clear(tracer: &Tracer, eye: &Vector3<f64>, reach: f64) -> bool {
    let sides = [-1.0, 0.0, 1.0];
    let all =
        sides.iter().flat_map(|&x| sides.iter().flat_map(move |&y| sides.map(|z| Vector3::new(x, y, z))));
    let mut directions = all.filter(|direction| direction.norm() > 0.0);
    directions.all(|direction| tracer.first_hit(eye, &direction).is_none_or(|hit| hit.distance > reach))
}

/// Whether at least 60 % of an image shows surfaces, all of them from outside and none of them close, and most of
/// its middle shows surfaces at 0.5 to 1.8 times `distance`.
fn shows(tracer: &Tracer, station: &Station, distance: f64) -> bool {
    let world_from_cam = station.cam_from_world.inverse();
    let Size { width, height } = station.camera.size;
    let share = |i: usize| (i as f64 + 0.5) / GRID as f64;
    let (mut seen, mut amid) = (0, 0);
    for (i, j) in (0..GRID).flat_map(|i| (0..GRID).map(move |j| (i, j))) {
        let pixel = Vector2::new(width as f64 * share(i), height as f64 * share(j));
        let direction = world_from_cam.rotation * station.camera.intrinsics.ray(&pixel);
        let Some(hit) = tracer.first_hit(&world_from_cam.translation, &direction) else { continue };
        if !hit.outside || hit.distance < NEAREST * distance {
            return false;
        }
        let middle = i.abs_diff(GRID / 2).max(j.abs_diff(GRID / 2)) <= 1;
        seen += 1;
        amid += usize::from(middle && (0.5..1.8).contains(&(hit.distance / distance)));
    }
    seen * 5 >= 3 * GRID * GRID && amid >= 6
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use nalgebra::Similarity3;
    use vamvs_core::Grid;

    use super::*;
    use crate::random::stream;
    use crate::{Environment, Material, Mesh, Object, World};

    const SIZE: Size = Size::new(160, 120);

    fn focus() -> Focus {
        Focus {
            centre: Vector3::new(0.5, -0.25, 0.1),
            radius: 0.4,
            axis: Vector3::z(),
            spread: 1.2,
            lowest: 0.3,
        }
    }

    /// A box between two corners, its outside outwards.
    fn cuboid(low: [f32; 3], high: [f32; 3]) -> Object {
        let corner =
            |i: usize| std::array::from_fn(|axis| if i >> axis & 1 == 0 { low[axis] } else { high[axis] });
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let halves = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]);
        let mesh = Mesh {
            positions: (0..8).map(corner).collect(),
            normals: vec![[0.0, 0.0, 1.0]; 8],
            uvs: vec![[0.0; 2]; 8],
            triangles: halves.collect(),
        };
        let albedo = Arc::new(Grid::filled(Size::new(1, 1), [128; 3]));
        let (tiling, tint) = ([1.0; 2], [1.0; 3]);
        let material = Material { albedo, tiling, tint, specular: 0.0, roughness: 1.0 };
        Object { mesh: Arc::new(mesh), material, world_from_object: Similarity3::identity() }
    }

    fn tracer(mut objects: Vec<Object>) -> Tracer {
        objects.push(cuboid([-20.0, -20.0, -1.0], [20.0, 20.0, 0.0]));
        let map = Arc::new(Grid::filled(Size::new(1, 1), [1.0; 3]));
        let environment = Environment { map, rotation: 0.0, strength: 1.0 };
        Tracer::new(&World { objects, environment, lamps: Vec::new() })
    }

    fn rig(rig: Rig, views: usize, tracer: &Tracer, seed: u64) -> Option<Vec<Station>> {
        place(&RigOptions { rig, views, size: SIZE }, &focus(), tracer, &mut stream(seed, 0, "rig"))
    }

    #[test]
    fn every_rig_stands_where_the_focus_admits_and_looks_at_it() {
        let tracer = tracer(Vec::new());
        for (seed, kind) in (0..5).flat_map(|seed| Rig::ALL.map(|kind| (seed, kind))) {
            let stations = rig(kind, 9, &tracer, seed).unwrap();
            assert_eq!(stations.len(), 9);
            for station in &stations {
                let to_eye = station.cam_from_world.centre() - focus().centre;
                assert!(focus().admits(&to_eye.normalize()), "{kind:?} {seed}");
                let seen = station.cam_from_world.transform(&focus().centre);
                assert!(station.camera.project_inside(&seen).is_some(), "{kind:?} {seed}");
                assert_eq!(station.camera, stations[0].camera);
            }
        }
    }

    #[test]
    fn rigs_depend_on_their_random_numbers_only() {
        let tracer = tracer(Vec::new());
        assert_eq!(rig(Rig::Dome, 9, &tracer, 1), rig(Rig::Dome, 9, &tracer, 1));
        assert_ne!(rig(Rig::Dome, 9, &tracer, 1), rig(Rig::Dome, 9, &tracer, 2));
    }

    #[test]
    fn fields_of_view_and_baselines_vary() {
        let tracer = tracer(Vec::new());
        let rigs: Vec<_> = (0..20).map(|seed| rig(Rig::Arc, 5, &tracer, seed).unwrap()).collect();
        let spread = |value: &dyn Fn(&Vec<Station>) -> f64| {
            let values: Vec<f64> = rigs.iter().map(value).collect();
            values.iter().copied().fold(0.0, f64::max) / values.iter().copied().fold(f64::MAX, f64::min)
        };
        assert!(spread(&|stations| stations[0].camera.intrinsics.fx) > 1.4);
        assert!(spread(&|s| (s[0].cam_from_world.centre() - s[4].cam_from_world.centre()).norm()) > 2.0);
    }

    #[test]
    fn no_camera_is_in_or_behind_an_object() {
        let (low, high) = ([0.7_f32, -1.5, 0.3], [2.5, 1.5, 2.0]);
        let tracer = tracer(vec![cuboid(low, high)]);
        for seed in 0..8 {
            for station in rig(Rig::Dome, 9, &tracer, seed).unwrap() {
                let eye = station.cam_from_world.centre();
                let inside = (0..3).all(|i| (f64::from(low[i])..f64::from(high[i])).contains(&eye[i]));
                assert!(!inside, "{eye}");
                let to_focus = focus().centre - eye;
                let hit = tracer.first_hit(&eye, &to_focus).unwrap();
                assert!(hit.distance > 0.5 * to_focus.norm(), "the box hides the focus from {eye}");
            }
        }
    }

    #[test]
    fn a_focus_in_a_closed_box_cannot_be_seen() {
        let tracer = tracer(vec![cuboid([-3.0, -3.0, 0.0], [3.0, 3.0, 3.0])]);
        assert_eq!(rig(Rig::Dome, 3, &tracer, 0), None);
    }

    #[test]
    fn a_narrow_focus_narrows_the_rig() {
        let tracer = tracer(Vec::new());
        let focus = Focus { spread: 0.2, ..focus() };
        let options = RigOptions { rig: Rig::Ring, views: 9, size: SIZE };
        let stations = place(&options, &focus, &tracer, &mut stream(0, 0, "rig")).unwrap();
        for station in stations {
            assert!(focus.admits(&(station.cam_from_world.centre() - focus.centre).normalize()));
        }
    }
}
