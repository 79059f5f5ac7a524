//! Analytic shapes in their own frame and where rays meet them.

use nalgebra::Vector3;

/// A shape centred at the origin of its own frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    /// The rectangle |x| ≤ half width, |y| ≤ half height at z = 0, seen from both sides.
    Rectangle {
        /// Half extents along x and y.
        half: [f64; 2],
    },
    /// A sphere.
    Sphere {
        /// Radius.
        radius: f64,
    },
    /// A box with faces across the axes.
    Cuboid {
        /// Half extents.
        half: Vector3<f64>,
    },
    /// A closed cylinder around z.
    Cylinder {
        /// Radius.
        radius: f64,
        /// Half of the length along z.
        half_height: f64,
    },
}

/// The ray `origin + t · direction`; the direction need not be of unit length.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Where t = 0.
    pub origin: Vector3<f64>,
    /// One unit of t.
    pub direction: Vector3<f64>,
}

/// Where a ray meets a shape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// The ray's parameter.
    pub t: f64,
    /// Unit normal, outwards (for a rectangle +z).
    pub normal: Vector3<f64>,
    /// Coordinates along the surface, in units of length.
    pub uv: [f64; 2],
}

impl Ray {
    /// The point at parameter `t`.
    #[must_use]
    pub fn at(&self, t: f64) -> Vector3<f64> {
        self.origin + self.direction * t
    }
}

impl Shape {
    /// The first hit with t > `t_min`.
    #[must_use]
    pub fn intersect(&self, ray: &Ray, t_min: f64) -> Option<Hit> {
        match *self {
            Self::Rectangle { half } => rectangle(half, ray, t_min),
            Self::Sphere { radius } => sphere(radius, ray, t_min),
            Self::Cuboid { half } => cuboid(&half, ray, t_min),
            Self::Cylinder { radius, half_height } => cylinder(radius, half_height, ray, t_min),
        }
    }
}

fn rectangle(half: [f64; 2], ray: &Ray, t_min: f64) -> Option<Hit> {
    let t = -ray.origin.z / ray.direction.z;
    let x = ray.at(t);
    let inside = t > t_min && x.x.abs() <= half[0] && x.y.abs() <= half[1];
    inside.then_some(Hit { t, normal: Vector3::z(), uv: [x.x, x.y] })
}

fn sphere(radius: f64, ray: &Ray, t_min: f64) -> Option<Hit> {
    let (d, o) = (ray.direction, ray.origin);
    let t = first_root(d.dot(&d), o.dot(&d), o.dot(&o) - radius * radius, t_min)?;
    let normal = ray.at(t) / radius;
    let uv = [radius * normal.y.atan2(normal.x), radius * normal.z.clamp(-1.0, 1.0).asin()];
    Some(Hit { t, normal, uv })
}

/// By slabs: the ray is inside the box while it is between all three pairs of faces.
fn cuboid(half: &Vector3<f64>, ray: &Ray, t_min: f64) -> Option<Hit> {
    let (mut enter, mut leave, mut axis) = (f64::NEG_INFINITY, f64::INFINITY, 0);
    for i in 0..3 {
        let side = half[i] * ray.direction[i].signum();
        let near = (-side - ray.origin[i]) / ray.direction[i];
        if near > enter {
            (enter, axis) = (near, i);
        }
        leave = leave.min((side - ray.origin[i]) / ray.direction[i]);
    }
    if enter > leave || enter <= t_min {
        return None;
    }
    let x = ray.at(enter);
    let mut normal = Vector3::zeros();
    normal[axis] = -ray.direction[axis].signum();
    // Faces get different parts of the texture plane: each is moved by its own offset.
    let shift = 7.3 * (axis as f64 + 1.0) * normal[axis];
    let uv = if axis == 2 { [x.x + shift, x.y] } else { [x[1 - axis] + shift, x.z] };
    Some(Hit { t: enter, normal, uv })
}

fn cylinder(radius: f64, half_height: f64, ray: &Ray, t_min: f64) -> Option<Hit> {
    let wall = cylinder_wall(radius, half_height, ray, t_min);
    let cap_z = half_height * -ray.direction.z.signum();
    let t = (cap_z - ray.origin.z) / ray.direction.z;
    let x = ray.at(t);
    if t > t_min && x.xy().norm() <= radius && wall.is_none_or(|hit| t < hit.t) {
        return Some(Hit { t, normal: Vector3::z() * cap_z.signum(), uv: [x.x, x.y] });
    }
    wall
}

fn cylinder_wall(radius: f64, half_height: f64, ray: &Ray, t_min: f64) -> Option<Hit> {
    let (d, o) = (ray.direction.xy(), ray.origin.xy());
    let t = first_root(d.dot(&d), o.dot(&d), o.dot(&o) - radius * radius, t_min)?;
    let x = ray.at(t);
    let normal = Vector3::new(x.x, x.y, 0.0) / radius;
    let uv = [radius * x.y.atan2(x.x), x.z];
    (x.z.abs() <= half_height).then_some(Hit { t, normal, uv })
}

/// The smaller root of a t² + 2 b t + c beyond `t_min`: shapes are seen from outside.
fn first_root(a: f64, b: f64, c: f64, t_min: f64) -> Option<f64> {
    let discriminant = b * b - a * c;
    if discriminant < 0.0 {
        return None;
    }
    let t = (-b - discriminant.sqrt()) / a;
    (t > t_min).then_some(t)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn from_above(x: f64, y: f64) -> Ray {
        Ray { origin: Vector3::new(x, y, 10.0), direction: Vector3::new(0.0, 0.0, -1.0) }
    }

    #[test]
    fn shapes_are_met_where_geometry_says() {
        let sphere = Shape::Sphere { radius: 5.0 }.intersect(&from_above(3.0, 0.0), 0.0).unwrap();
        assert!((sphere.t - 6.0).abs() < 1e-12);
        assert!((sphere.normal - Vector3::new(0.6, 0.0, 0.8)).norm() < 1e-12);
        let cuboid = Shape::Cuboid { half: Vector3::new(1.0, 2.0, 3.0) };
        let top = cuboid.intersect(&from_above(0.5, -1.5), 0.0).unwrap();
        assert!((top.t - 7.0).abs() < 1e-12 && top.normal == Vector3::z());
        let cylinder = Shape::Cylinder { radius: 2.0, half_height: 1.0 };
        assert!((cylinder.intersect(&from_above(1.0, 1.0), 0.0).unwrap().t - 9.0).abs() < 1e-12);
        let side = Ray { origin: Vector3::new(-5.0, 0.0, 0.5), direction: Vector3::new(2.0, 0.0, 0.0) };
        let wall = cylinder.intersect(&side, 0.0).unwrap();
        assert!((wall.t - 1.5).abs() < 1e-12 && (wall.normal + Vector3::x()).norm() < 1e-12);
    }

    #[test]
    fn rays_beside_a_shape_miss_it() {
        let shapes = [
            Shape::Rectangle { half: [1.0, 1.0] },
            Shape::Sphere { radius: 1.0 },
            Shape::Cuboid { half: Vector3::repeat(1.0) },
            Shape::Cylinder { radius: 1.0, half_height: 1.0 },
        ];
        for shape in shapes {
            assert!(shape.intersect(&from_above(0.9, 0.0), 0.0).is_some());
            assert!(shape.intersect(&from_above(1.1, 0.0), 0.0).is_none());
            assert!(shape.intersect(&from_above(0.9, 0.0), 12.0).is_none(), "behind the start");
        }
    }
}
