//! Surface normals of a depth map.

use nalgebra::Vector3;

use crate::photometric::FilteredView;

/// Pixels to each side that a normal is fitted to.
const RADIUS: usize = 2;

/// The unit normal at a pixel that has a depth, in the camera's frame and towards the camera.
///
/// On a plane the inverse depth is linear in the image, w = a·x + b·y + c, and the plane's normal is
/// Kᵀ (a, b, c). The slopes a and b are fitted by least squares to the 5×5 pixels around, without
/// those beyond an edge. Where too few are left, the normal is the direction to the camera.
pub(crate) fn normal_in_cam(view: &FilteredView, x: usize, y: usize) -> Vector3<f32> {
    let k = &view.camera.intrinsics;
    let w = view.inverse_depth[(x, y)];
    let [u, v] = [x as f32 + 0.5 - k.cx as f32, y as f32 + 0.5 - k.cy as f32];
    let (fx, fy) = (k.fx as f32, k.fy as f32);
    match slopes(view, x, y) {
        Some([a, b]) => -Vector3::new(a * fx, b * fy, w - a * u - b * v).normalize(),
        None => -Vector3::new(u / fx, v / fy, 1.0).normalize(),
    }
}

/// Sums over the pixels of one surface, relative to the middle pixel.
#[derive(Default)]
struct Moments {
    n: f32,
    x: f32,
    y: f32,
    xx: f32,
    xy: f32,
    yy: f32,
    w: f32,
    xw: f32,
    yw: f32,
}

impl Moments {
    /// Adds a pixel, or nothing if `counts` is 0: branches here would take most of the time.
    #[inline]
    fn add(&mut self, counts: f32, x: f32, y: f32, w: f32) {
        let (cx, cy) = (counts * x, counts * y);
        self.n += counts;
        self.x += cx;
        self.y += cy;
        self.xx += cx * x;
        self.xy += cx * y;
        self.yy += cy * y;
        self.w += counts * w;
        self.xw += cx * w;
        self.yw += cy * w;
    }

    /// The least-squares slopes along x and y; `None` if the pixels lie on a line.
    fn slopes(&self) -> Option<[f32; 2]> {
        let about_mean = |product: f32, a: f32, b: f32| product * self.n - a * b;
        let (xx, yy) = (about_mean(self.xx, self.x, self.x), about_mean(self.yy, self.y, self.y));
        let xy = about_mean(self.xy, self.x, self.y);
        let (xw, yw) = (about_mean(self.xw, self.x, self.w), about_mean(self.yw, self.y, self.w));
        // Of integers, hence exact: 0 if and only if the pixels lie on a line.
        let determinant = xx * yy - xy * xy;
        let solve = |p: f32| p / determinant;
        (determinant > 0.0).then(|| [solve(yy * xw - xy * yw), solve(xx * yw - xy * xw)])
    }
}

/// Slopes of the inverse depth, per pixel.
fn slopes(view: &FilteredView, x: usize, y: usize) -> Option<[f32; 2]> {
    let size = view.size();
    let middle = view.inverse_depth[(x, y)];
    let step = view.edge_step * middle;
    let mut moments = Moments::default();
    let (left, right) = (x.saturating_sub(RADIUS), (x + RADIUS).min(size.width - 1));
    for j in y.saturating_sub(RADIUS)..=(y + RADIUS).min(size.height - 1) {
        let row = &view.inverse_depth.row(j)[left..=right];
        for (i, &w) in (left..).zip(row) {
            let steps = i.abs_diff(x).max(j.abs_diff(y)) as f32;
            let same_surface = w > 0.0 && (w - middle).abs() <= steps * step;
            let counts = f32::from(u8::from(same_surface));
            moments.add(counts, i as f32 - x as f32, j as f32 - y as f32, w - middle);
        }
    }
    moments.slopes()
}
