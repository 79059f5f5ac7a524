//! Surfaces with a smooth texture, rendered exactly.
#![allow(dead_code, reason = "not every test looks at everything")]

use nalgebra::{Rotation3, Vector2, Vector3};
use vamvs_core::{DepthMap, Grid, Intrinsics, Photo, Pinhole, Pose, Size};

/// The size of the photographs.
pub const SIZE: Size = Size::new(192, 144);

/// Rays per pixel along each axis.
const SAMPLES: usize = 3;

/// Intersects a ray `origin + t · direction` with a surface: t and the unit normal towards the ray's
/// origin.
pub type Surface = fn(&Vector3<f64>, &Vector3<f64>) -> Option<(f64, Vector3<f64>)>;

/// A similarity transform of the whole world.
#[derive(Clone, Copy)]
pub struct Placement {
    pub scale: f64,
    pub turn: Vector3<f64>,
    pub place: Vector3<f64>,
}

/// The world as it is: the identity.
pub const HERE: Placement =
    Placement { scale: 1.0, turn: Vector3::new(0.0, 0.0, 0.0), place: Vector3::new(0.0, 0.0, 0.0) };

/// A rendered set: the reference view first.
pub struct Set {
    pub photos: Vec<Photo>,
    pub depth: Grid<f32>,
    pub normals: Grid<Vector3<f64>>,
}

/// Five photographs of a surface; the reference view is at the origin and looks along z.
pub fn render(surface: Surface, placement: Placement) -> Set {
    enlarged(surface, placement, 1)
}

/// As [`render`], with `factor` times as many pixels along each axis, and a texture finer by that
/// factor.
pub fn enlarged(surface: Surface, placement: Placement, factor: usize) -> Set {
    let size = Size::new(factor * SIZE.width, factor * SIZE.height);
    let scale = factor as f64;
    let intrinsics = Intrinsics { fx: 240.0, fy: 243.0, cx: 97.3, cy: 71.6 }.scaled(scale, scale);
    let camera = Pinhole { size, intrinsics };
    let eyes =
        [[0.0, 0.0, 0.0], [0.45, 0.05, 0.1], [-0.4, 0.1, -0.05], [0.1, 0.42, 0.0], [-0.05, -0.38, 0.1]];
    let poses = eyes.map(|eye| {
        let aim = Vector3::new(0.1 * eye[0], 0.2 * eye[1], 4.0);
        if eye == [0.0; 3] {
            Pose::identity()
        } else {
            Pose::look_at(&Vector3::from(eye), &aim, &-Vector3::y())
        }
    });
    let world = (surface, scale);
    let photos = poses.iter().map(|pose| photo(world, camera, pose, placement)).collect();
    let hit = |x: usize, y: usize| meet(surface, &camera, &poses[0], x as f64 + 0.5, y as f64 + 0.5);
    let depth = |hit: Option<Hit>| hit.map_or(0.0, |hit| (hit.depth * placement.scale) as f32);
    Set {
        photos,
        depth: Grid::from_fn(size, |x, y| depth(hit(x, y))),
        normals: Grid::from_fn(size, |x, y| hit(x, y).map_or(Vector3::zeros(), |hit| hit.normal)),
    }
}

struct Hit {
    point: Vector3<f64>,
    depth: f64,
    normal: Vector3<f64>,
}

fn meet(surface: Surface, camera: &Pinhole, pose: &Pose, x: f64, y: f64) -> Option<Hit> {
    let ray = camera.intrinsics.ray(&Vector2::new(x, y));
    let (origin, direction) = (pose.centre(), pose.rotation.transpose() * ray);
    let (t, normal) = surface(&origin, &direction)?;
    Some(Hit { point: origin + t * direction, depth: t, normal })
}

fn photo((surface, detail): (Surface, f64), camera: Pinhole, pose: &Pose, placement: Placement) -> Photo {
    let image = Grid::from_fn(camera.size, |x, y| {
        let offset = |i: usize| (i as f64 + 0.5) / SAMPLES as f64;
        let places =
            (0..SAMPLES * SAMPLES).map(|i| (x as f64 + offset(i % SAMPLES), y as f64 + offset(i / SAMPLES)));
        let grey = places.map(|(x, y)| {
            meet(surface, &camera, pose, x, y).map_or(0.0, |hit| texture(&(hit.point * detail)))
        });
        [(grey.sum::<f64>() / (SAMPLES * SAMPLES) as f64).round() as u8; 3]
    });
    Photo { camera, cam_from_world: placed(pose, placement), image, mask: None }
}

/// The pose after the world has been rotated, scaled and moved.
fn placed(pose: &Pose, placement: Placement) -> Pose {
    let rotation = pose.rotation * Rotation3::new(placement.turn).matrix().transpose();
    Pose { rotation, translation: placement.scale * pose.translation - rotation * placement.place }
}

/// A solid texture without a preferred direction: waves of about 5 to 21 pixels at depth 4.
fn texture(point: &Vector3<f64>) -> f64 {
    let mut sum = 0.0;
    for wave in 0..9_u32 {
        let (a, b) = (f64::from(wave) * 2.399_963, f64::from(wave) * 0.83);
        let direction = Vector3::new(a.cos() * b.cos(), a.sin() * b.cos(), b.sin());
        let frequency = 18.0 + 8.0 * f64::from(wave);
        sum += (frequency * direction.dot(point) + 1.7 * f64::from(wave * wave)).sin();
    }
    (127.0 + 37.0 * sum).clamp(5.0, 250.0)
}

/// A tilted plane through (0, 0, 4).
pub fn plane(origin: &Vector3<f64>, direction: &Vector3<f64>) -> Option<(f64, Vector3<f64>)> {
    let normal = Vector3::new(0.35, -0.25, -1.0).normalize();
    let t = normal.dot(&(Vector3::new(0.0, 0.0, 4.0) - origin)) / normal.dot(direction);
    (t > 0.0).then_some((t, normal))
}

/// A sphere in front of a wall.
pub fn sphere(origin: &Vector3<f64>, direction: &Vector3<f64>) -> Option<(f64, Vector3<f64>)> {
    let (centre, radius) = (Vector3::new(0.1, 0.0, 4.0), 1.0);
    let from_centre = origin - centre;
    let (a, b) = (direction.norm_squared(), direction.dot(&from_centre));
    let root = b * b - a * (from_centre.norm_squared() - radius * radius);
    if root > 0.0 {
        let t = (-b - root.sqrt()) / a;
        return Some((t, (from_centre + t * direction) / radius));
    }
    let t = (5.0 - origin.z) / direction.z;
    Some((t, -Vector3::z()))
}

/// A near and a far wall with a depth step between them.
pub fn step(origin: &Vector3<f64>, direction: &Vector3<f64>) -> Option<(f64, Vector3<f64>)> {
    let at = |z: f64| (z - origin.z) / direction.z;
    let near = at(3.5);
    let t = if (origin + near * direction).x < 0.1 { near } else { at(4.5) };
    Some((t, -Vector3::z()))
}

/// A seed: the true depth at an eighth of the size, with noise of up to 0.5 %, some holes, and some
/// outliers with an error of 4 %.
pub fn seed(set: &Set) -> DepthMap {
    let size = Size::new(set.depth.width() / 8, set.depth.height() / 8);
    let mut state = 1_u32;
    let mut noise = move || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        f64::from(state >> 8) / f64::from(1 << 24) - 0.5
    };
    let depth = Grid::from_fn(size, |x, y| {
        let true_depth = f64::from(set.depth[(8 * x + 4, 8 * y + 4)]);
        match x * 7 + y * 13 {
            n if n % 37 == 0 => 0.0,
            n if n % 41 == 0 => (true_depth * 1.04) as f32,
            _ => (true_depth * (1.0 + 0.01 * noise())) as f32,
        }
    });
    let camera = set.photos[0].camera.resized(size);
    let confidence = Grid::filled(size, 0.8);
    DepthMap {
        camera,
        cam_from_world: set.photos[0].cam_from_world,
        depth,
        confidence,
        coarse_confidence: None,
    }
}

/// The true depth map of a view, with photographs of a set that is [`HERE`], at any size.
pub fn true_map(surface: Surface, photo: &Photo, size: Size) -> DepthMap {
    let camera = photo.camera.resized(size);
    let depth = Grid::from_fn(size, |x, y| {
        let hit = meet(surface, &camera, &photo.cam_from_world, x as f64 + 0.5, y as f64 + 0.5);
        hit.map_or(0.0, |hit| hit.depth as f32)
    });
    let confidence = Grid::filled(size, 1.0);
    DepthMap { camera, cam_from_world: photo.cam_from_world, depth, confidence, coarse_confidence: None }
}

/// The source views of a set.
pub fn sources(set: &Set) -> Vec<&Photo> {
    set.photos[1..].iter().collect()
}

/// The median; of an even number of values, the upper of the middle two.
pub fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// The difference of two depths in pixels of disparity, for a baseline of 0.42.
pub fn disparity(a: f32, b: f32) -> f64 {
    240.0 * 0.42 * (1.0 / f64::from(a) - 1.0 / f64::from(b)).abs()
}
