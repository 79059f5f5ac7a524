//! Where the cameras stand, seen from above.

use std::fmt::Write;

use nalgebra::{Vector2, Vector3};
use vamvs_core::Pinhole;

use crate::cloud_view::{CloudView, ShownCamera};
use crate::template::escaped;
use crate::viewpoint::quantile;

/// Width of the figure, and the most height, in its own units.
const SIDE: f64 = 400.0;

/// Margin around it.
const MARGIN: f64 = 16.0;

/// Length of a camera's triangle.
const REACH: f64 = 16.0;

/// Largest number of points that are drawn.
const DOTS: usize = 4000;

/// The figure: points as dots, cameras as triangles that open in their viewing direction. The
/// direction of the camera from which the page looks first points upwards.
pub(crate) fn floor_plan(view: &CloudView) -> String {
    let axes = Axes::of(view);
    let points = &view.packed.points;
    let dots: Vec<_> = points
        .iter()
        .step_by(points.len().div_ceil(DOTS).max(1))
        .map(|point| axes.place(&point.x_in_world.into()))
        .collect();
    let cameras: Vec<_> =
        view.cameras.iter().map(|camera| axes.place(&camera.cam_from_world.centre())).collect();
    let sheet = Sheet::around(&dots, &cameras);
    let mut path = String::new();
    for dot in dots.iter().map(|dot| sheet.place(dot)).filter(|dot| sheet.holds(dot)) {
        write!(path, "M{:.0} {:.0}h0", dot.x, dot.y).expect("memory takes all that is written");
    }
    let triangles = view.cameras.iter().map(|camera| triangle(camera, &axes, &sheet));
    format!(
        "<figure class=\"floor\"><svg viewBox=\"0 0 {:.0} {:.0}\" role=\"img\" aria-label=\"{} cameras around the \
         cloud, seen from above\"><path class=\"surface\" d=\"{path}\"/>{}</svg><figcaption>Cameras and cloud, \
         seen from above</figcaption></figure>\n",
        sheet.size.x,
        sheet.size.y,
        view.cameras.len(),
        triangles.collect::<String>()
    )
}

fn triangle(shown: &ShownCamera, axes: &Axes, sheet: &Sheet) -> String {
    let Pinhole { size, intrinsics } = shown.camera;
    let tip = sheet.place(&axes.place(&shown.cam_from_world.centre()));
    let to_world = shown.cam_from_world.rotation.transpose();
    let end = |side: f64| {
        let ray = Vector3::new(side * 0.5 * size.width as f64 / intrinsics.fx, 0.0, 1.0);
        let on_floor = axes.place(&(to_world * ray));
        tip + REACH * Vector2::new(on_floor.x, -on_floor.y)
    };
    let (left, right) = (end(-1.0), end(1.0));
    format!(
        "<path class=\"camera\" d=\"M{:.1} {:.1}L{:.1} {:.1}L{:.1} {:.1}Z\"><title>{}</title></path>",
        tip.x,
        tip.y,
        left.x,
        left.y,
        right.x,
        right.y,
        escaped(&shown.name)
    )
}

/// Directions on the floor, world.
struct Axes {
    right: Vector3<f64>,
    forward: Vector3<f64>,
}

impl Axes {
    fn of(view: &CloudView) -> Self {
        let up = view.up;
        let looks =
            view.cameras.get(view.start).map_or(Vector3::z(), |camera| camera.cam_from_world.forward());
        let level = (looks - up * looks.dot(&up)).try_normalize(1e-3);
        let forward = level.unwrap_or_else(|| up.cross(&Vector3::ith(up.iamin(), 1.0)).normalize());
        Self { right: forward.cross(&up), forward }
    }

    fn place(&self, x_in_world: &Vector3<f64>) -> Vector2<f64> {
        Vector2::new(self.right.dot(x_in_world), self.forward.dot(x_in_world))
    }
}

/// The coordinates of the figure: y down.
struct Sheet {
    low: Vector2<f64>,
    scale: f64,
    size: Vector2<f64>,
}

impl Sheet {
    /// A sheet that holds all cameras and all but the outermost dots.
    fn around(dots: &[Vector2<f64>], cameras: &[Vector2<f64>]) -> Self {
        let ends = |axis: usize| {
            let mut values: Vec<f64> = dots.iter().map(|dot| dot[axis]).collect();
            let mut ends = vec![quantile(&mut values, 0.01), quantile(&mut values, 0.99)];
            ends.extend(cameras.iter().map(|camera| camera[axis]));
            let (low, high) = (quantile(&mut ends, 0.0), quantile(&mut ends, 1.0));
            (low, (high - low).max(f64::MIN_POSITIVE))
        };
        let ((x, width), (y, height)) = (ends(0), ends(1));
        let scale = (SIDE - 2.0 * MARGIN - 2.0 * REACH) / width.max(height);
        let room = 2.0 * (MARGIN + REACH);
        Self {
            low: Vector2::new(x, y),
            scale,
            size: Vector2::new(width, height) * scale + Vector2::repeat(room),
        }
    }

    fn place(&self, on_floor: &Vector2<f64>) -> Vector2<f64> {
        let place = (on_floor - self.low) * self.scale + Vector2::repeat(MARGIN + REACH);
        Vector2::new(place.x, self.size.y - place.y)
    }

    fn holds(&self, place: &Vector2<f64>) -> bool {
        (0.0..self.size.x).contains(&place.x) && (0.0..self.size.y).contains(&place.y)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vamvs_core::{CloudPoint, Intrinsics, Pose, Size};

    /// Two cameras at y = 0 and 4 that look along +y, z up; a wall at y = 10.
    fn view() -> CloudView {
        let camera = |name: &str, y: f64| {
            let eye = Vector3::new(0.0, y, 0.0);
            ShownCamera {
                name: name.to_owned(),
                camera: Pinhole {
                    size: Size::new(10, 10),
                    intrinsics: Intrinsics { fx: 10.0, fy: 10.0, cx: 5.0, cy: 5.0 },
                },
                cam_from_world: Pose::look_at(&eye, &(eye + Vector3::y()), &Vector3::z()),
            }
        };
        let point = |i: u32| CloudPoint {
            x_in_world: [f64::from(i) / 50.0 - 1.0, 10.0, 0.5],
            normal: [0.0, -1.0, 0.0],
            colour: [0; 3],
            confidence: 1.0,
            sigma: 0.0,
            views: 2,
        };
        CloudView::new(
            100,
            &(0..100).map(point).collect::<Vec<_>>(),
            vec![camera("back", 0.0), camera("<front>", 4.0)],
        )
    }

    #[test]
    fn what_is_ahead_is_above_and_cameras_open_towards_it() {
        let view = view();
        let (axes, figure) = (Axes::of(&view), floor_plan(&view));
        assert!((axes.forward - Vector3::y()).norm() < 1e-12 && (axes.right - Vector3::x()).norm() < 1e-12);
        let corners = |triangle: &str| -> Vec<(f64, f64)> {
            let path = triangle.split_once('"').unwrap().0.trim_end_matches('Z');
            let corner =
                |text: &str| text.split_once(' ').map(|(x, y)| (x.parse().unwrap(), y.parse().unwrap()));
            path.split(['M', 'L']).filter_map(corner).collect()
        };
        let triangles: Vec<_> = figure.split("class=\"camera\" d=\"").skip(1).map(corners).collect();
        let [back, front] = [&triangles[0], &triangles[1]];
        assert!(front[0].1 < back[0].1, "the one in front is above");
        for [tip, left, right] in [[back[0], back[1], back[2]], [front[0], front[1], front[2]]] {
            assert!(left.1 < tip.1 && right.1 < tip.1 && left.0 < tip.0 && right.0 > tip.0);
        }
        assert!(figure.contains("<title>&lt;front&gt;</title>"));
    }
}
