//! Photographs of more than half of all directions, and the views of pinhole cameras that are cut out of them.
//!
//! The views are the faces of a cube around the camera's centre, each a little wider than a quarter turn. Their pixels are as
//! fine as the photograph's.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use nalgebra::{Matrix3, Vector2, Vector3};
use serde::{Deserialize, Serialize};

use crate::lens::{fisheye_angle, fisheye_limit, last};
use crate::{Camera, Intrinsics, Lens, Pose, Size, View};

/// Tangent of half the angle that a face is wide and high: 100.4°, so that faces overlap by 10°.
const HALF_WIDTH: f64 = 1.2;

/// A fisheye whose photograph reaches farther than this from its axis, radians (70°), is cut into faces.
const WIDEST_FISHEYE: f64 = 70.0 / 180.0 * PI;

/// Faces of which the photograph shows less than this share are left out.
const LEAST_SHOWN: f64 = 0.05;

/// A photograph of more directions than one pinhole camera takes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Surroundings {
    /// All directions. Columns are longitudes, from −180° behind the camera over 0° before it, in the middle, to 180°.
    Panorama {
        /// The size of the photograph.
        size: Size,
        /// What rows are.
        rows: Rows,
    },
    /// A fisheye, [`Lens::Fisheye`], of which angles from the axis beyond 90° count as well.
    Fisheye {
        /// The size of the photograph.
        size: Size,
        /// Focal lengths and principal point.
        intrinsics: Intrinsics,
        /// k₁ … k₄.
        k: [f64; 4],
        /// The largest angle from the axis that the photograph shows, radians, at most 180°.
        widest: f64,
    },
}

/// What the rows of a panorama are, from straight up to straight down.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Rows {
    /// Even steps of latitude: equirectangular.
    Latitude,
    /// Even steps of the sine of latitude: Lambert's cylindrical projection, of equal area.
    SineOfLatitude,
}

/// A face of the cube around the camera's centre, named as seen by somebody who looks along the camera's axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Side {
    /// Along the camera's axis.
    Front,
    /// To the right of it.
    Right,
    /// Against it.
    Back,
    /// To the left.
    Left,
    /// Upwards; its lower border touches the front.
    Up,
    /// Downwards; its upper border touches the front.
    Down,
}

/// A view cut out of a photograph.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Face {
    /// The photograph.
    pub of: Surroundings,
    /// Where the view looks.
    pub side: Side,
}

impl Side {
    /// All faces of the cube.
    pub const ALL: [Self; 6] = [Self::Front, Self::Right, Self::Back, Self::Left, Self::Up, Self::Down];

    /// The name in the names of views.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Front => "front",
            Self::Right => "right",
            Self::Back => "back",
            Self::Left => "left",
            Self::Up => "up",
            Self::Down => "down",
        }
    }

    /// The rotation of directions from the camera's frame to the face's.
    #[must_use]
    pub fn face_from_camera(self) -> Matrix3<f64> {
        let (x, y, z) = (Vector3::x(), Vector3::y(), Vector3::z());
        let [right, down, forward] = match self {
            Self::Front => [x, y, z],
            Self::Right => [-z, y, x],
            Self::Back => [-x, y, -z],
            Self::Left => [z, y, -x],
            Self::Up => [x, z, -y],
            Self::Down => [x, -z, y],
        };
        Matrix3::from_rows(&[right.transpose(), down.transpose(), forward.transpose()])
    }
}

impl Surroundings {
    /// The size of the photograph.
    #[must_use]
    pub fn size(&self) -> Size {
        match self {
            Self::Panorama { size, .. } | Self::Fisheye { size, .. } => *size,
        }
    }

    /// The same photograph resized.
    #[must_use]
    pub fn resized(&self, to: Size) -> Self {
        match *self {
            Self::Panorama { rows, .. } => Self::Panorama { size: to, rows },
            Self::Fisheye { size, intrinsics, k, widest } => {
                let Camera { intrinsics, .. } = Camera { size, intrinsics, lens: Lens::None }.resized(to);
                Self::Fisheye { size: to, intrinsics, k, widest }
            }
        }
    }

    /// Whether it shows all directions; columns beyond the right border are those at the left one then.
    #[must_use]
    pub fn is_panorama(&self) -> bool {
        matches!(self, Self::Panorama { .. })
    }

    /// Image coordinates of a direction in the camera's frame, which need not have length 1; `None` where the photograph
    /// shows nothing.
    #[must_use]
    pub fn project(&self, direction: &Vector3<f64>) -> Option<Vector2<f64>> {
        let d = direction;
        match self {
            Self::Panorama { size, rows } => {
                let (level, longitude) = (d.x.hypot(d.z), d.x.atan2(d.z));
                let down = match rows {
                    Rows::Latitude => 0.5 + d.y.atan2(level) / PI,
                    Rows::SineOfLatitude => 0.5 + 0.5 * d.y / d.norm(),
                };
                let pixel = [(0.5 + longitude / TAU) * size.width as f64, down * size.height as f64];
                pixel.iter().all(|value| value.is_finite()).then(|| pixel.into())
            }
            Self::Fisheye { size, intrinsics, k, widest } => {
                let radius = d.x.hypot(d.y);
                let angle = radius.atan2(d.z);
                let bent = (angle <= *widest).then(|| fisheye_angle(k, angle))?;
                let scale = match radius > 0.0 {
                    true => bent / radius,
                    false => (d.z > 0.0).then_some(0.0)?,
                };
                let pixel = intrinsics.project(&Vector3::new(d.x * scale, d.y * scale, 1.0));
                let inside = |at: f64, side: usize| (0.0..=side as f64).contains(&at);
                (inside(pixel.x, size.width) && inside(pixel.y, size.height)).then_some(pixel)
            }
        }
    }

    /// Pixels a radian on the axis of a face: what the photograph has there.
    fn pixels_per_radian(&self) -> f64 {
        match self {
            Self::Panorama { size, .. } => size.width as f64 / TAU,
            Self::Fisheye { intrinsics, .. } => intrinsics.fx.max(intrinsics.fy),
        }
    }

    /// The camera of a face.
    #[must_use]
    pub fn face(&self, side: Side) -> Camera {
        let focal = self.pixels_per_radian();
        let width = (2.0 * HALF_WIDTH * focal).round().max(1.0);
        let intrinsics = Intrinsics { fx: focal, fy: focal, cx: 0.5 * width, cy: 0.5 * width };
        let lens = Lens::Face(Face { of: *self, side });
        Camera { size: Size::new(width as usize, width as usize), intrinsics, lens }
    }

    /// Whether the photograph shows enough of what a face looks at.
    fn shows(&self, side: Side) -> bool {
        const STEPS: usize = 32;
        let camera_from_face = side.face_from_camera().transpose();
        let at = |step: usize| HALF_WIDTH * ((step as f64 + 0.5) * 2.0 / STEPS as f64 - 1.0);
        let rays = (0..STEPS * STEPS).map(|i| Vector3::new(at(i % STEPS), at(i / STEPS), 1.0));
        let shown = rays.filter(|ray| self.project(&(camera_from_face * ray)).is_some()).count();
        shown as f64 > LEAST_SHOWN * (STEPS * STEPS) as f64
    }
}

/// The camera of the front face, if a camera is a fisheye whose photograph is too wide for one pinhole camera; else the camera
/// itself.
#[must_use]
pub fn of_wide_fisheye(camera: Camera) -> Camera {
    let Camera { size, intrinsics, lens: Lens::Fisheye { k } } = camera else { return camera };
    let reach = [
        intrinsics.cx.max(size.width as f64 - intrinsics.cx) / intrinsics.fx,
        intrinsics.cy.max(size.height as f64 - intrinsics.cy) / intrinsics.fy,
    ];
    let farthest = reach[0].max(reach[1]);
    let limit = fisheye_limit(&k, PI);
    let at_border = last(limit, |theta| fisheye_angle(&k, theta) <= farthest);
    if at_border <= WIDEST_FISHEYE {
        return camera;
    }
    // Such a lens draws a circle; what lies beyond the middles of the borders is black.
    let widest = if at_border < FRAC_PI_2 { limit } else { at_border };
    Surroundings::Fisheye { size, intrinsics, k, widest }.face(Side::Front)
}

impl View {
    /// The views that the photograph becomes: the view itself, or all faces of a photograph whose front face it is, named
    /// `NAME@front.EXT` and so on.
    #[must_use]
    pub fn faces(self) -> Vec<Self> {
        let Lens::Face(Face { of, side: Side::Front }) = self.camera.lens else { return vec![self] };
        let face = |side: Side| {
            let rotation = side.face_from_camera();
            let cam_from_world =
                Pose { rotation, translation: Vector3::zeros() }.compose(&self.cam_from_world);
            Self { name: face_name(&self.name, side), camera: of.face(side), cam_from_world, ..self.clone() }
        };
        Side::ALL.into_iter().filter(|side| of.shows(*side)).map(face).collect()
    }

    /// The path of the photograph's file relative to the image folder: the view's name, without the face.
    #[must_use]
    pub fn file(&self) -> String {
        let Lens::Face(face) = self.camera.lens else { return self.name.clone() };
        let mark = format!("@{}", face.side.name());
        let (before, after) = self.name.rsplit_once(&mark).unwrap_or((&self.name, ""));
        format!("{before}{after}")
    }
}

/// `NAME.EXT` as `NAME@SIDE.EXT`.
fn face_name(file: &str, side: Side) -> String {
    let start = file.rfind('/').map_or(0, |slash| slash + 1);
    let end = file[start..].rfind('.').map_or(file.len(), |dot| start + dot);
    format!("{}@{}{}", &file[..end], side.name(), &file[end..])
}

#[cfg(test)]
mod tests {
    use super::*;

    const EQUIRECTANGULAR: Surroundings =
        Surroundings::Panorama { size: Size::new(800, 400), rows: Rows::Latitude };

    fn fisheye(degrees: f64) -> Camera {
        let focal = 200.0 / (0.5 * degrees).to_radians();
        let intrinsics = Intrinsics { fx: focal, fy: focal, cx: 200.0, cy: 200.0 };
        Camera { size: Size::new(400, 400), intrinsics, lens: Lens::Fisheye { k: [0.0; 4] } }
    }

    fn view(name: &str, camera: Camera) -> View {
        View { id: 3, name: name.to_owned(), camera, cam_from_world: Pose::identity(), depth_range: None }
    }

    #[test]
    fn sides_are_rotations_that_look_where_their_names_say() {
        let looks = [[0, 0, 1], [1, 0, 0], [0, 0, -1], [-1, 0, 0], [0, -1, 0], [0, 1, 0]];
        for (side, look) in Side::ALL.into_iter().zip(looks) {
            let rotation = side.face_from_camera();
            assert!((rotation.determinant() - 1.0).abs() < 1e-15, "{side:?}");
            assert_eq!(rotation * rotation.transpose(), Matrix3::identity());
            assert_eq!(rotation.transpose() * Vector3::z(), Vector3::from(look.map(f64::from)), "{side:?}");
        }
    }

    /// COLMAP's EQUIRECTANGULAR: longitude atan2(x, z) and latitude downwards, image coordinates of corners.
    #[test]
    fn panoramas_have_the_axis_in_the_middle_right_to_the_right_and_up_above() {
        let at = |x, y, z| EQUIRECTANGULAR.project(&Vector3::new(x, y, z)).unwrap();
        let near = |found: Vector2<f64>, x: f64, y: f64| (found - Vector2::new(x, y)).norm() < 1e-9;
        assert!(near(at(0.0, 0.0, 2.0), 400.0, 200.0) && near(at(3.0, 0.0, 0.0), 600.0, 200.0));
        assert!(near(at(-1.0, 0.0, 0.0), 200.0, 200.0) && at(0.0, -1.0, 1e-9).y < 1e-3);
        assert!(near(at(0.0, 1.0, 1.0), 400.0, 300.0), "45° down");
        let cylinder = Surroundings::Panorama { size: Size::new(800, 400), rows: Rows::SineOfLatitude };
        let down = cylinder.project(&Vector3::new(0.0, 1.0, 1.0)).unwrap();
        assert!((down.y - (200.0 + 200.0 * 0.5_f64.sqrt())).abs() < 1e-9);
    }

    #[test]
    fn faces_share_a_centre_and_cover_every_direction() {
        let pose = Pose::try_new(Side::Right.face_from_camera(), Vector3::new(0.3, -2.0, 1.0)).unwrap();
        let whole = View { cam_from_world: pose, ..view("a/b.c.jpg", EQUIRECTANGULAR.face(Side::Front)) };
        let faces = whole.faces();
        let names: Vec<&str> = faces.iter().map(|face| face.name.as_str()).collect();
        assert_eq!(names[..2], ["a/b.c@front.jpg", "a/b.c@right.jpg"]);
        assert!(faces.len() == 6 && faces.iter().all(|face| face.file() == "a/b.c.jpg"));
        assert!(faces.iter().all(|face| (face.cam_from_world.centre() - pose.centre()).norm() < 1e-14));
        for (x, y, z) in
            (0..343).map(|i| (i % 7 - 3, i / 7 % 7 - 3, i / 49 - 3)).filter(|&at| at != (0, 0, 0))
        {
            let direction = Vector3::new(x, y, z).map(f64::from);
            let x_in_world = pose.centre() + direction;
            let pixel = |face: &View| {
                let x_in_cam = face.cam_from_world.transform(&x_in_world);
                let Size { width, height } = face.camera.size;
                let inside =
                    |p: &Vector2<f64>| p.x >= 0.0 && p.y >= 0.0 && p.x < width as f64 && p.y < height as f64;
                face.camera.project(&x_in_cam).filter(inside)
            };
            assert!(faces.iter().any(|face| pixel(face).is_some()), "{direction:?}");
        }
    }

    #[test]
    fn a_file_name_that_has_a_side_of_its_own_stays() {
        for file in ["x@front.jpg", "@front/b", "b@up@up.png", "none"] {
            let faces = view(file, EQUIRECTANGULAR.face(Side::Front)).faces();
            assert!(faces.iter().all(|face| face.file() == file), "{file}");
        }
        assert_eq!(view("x@front.jpg", fisheye(90.0)).file(), "x@front.jpg");
    }

    #[test]
    fn fisheyes_are_cut_where_they_are_too_wide_and_faces_that_show_nothing_left_out() {
        for (degrees, faces) in [(120.0, 1), (139.0, 1), (150.0, 5), (200.0, 5), (270.0, 6)] {
            let found = view("f.jpg", of_wide_fisheye(fisheye(degrees))).faces();
            assert_eq!(found.len(), faces, "{degrees}°");
        }
    }

    /// Before 90° it is the lens of that name.
    #[test]
    fn a_wide_fisheye_is_the_lens_of_its_parameters() {
        let k = [0.02, -0.01, 0.003, -0.0005];
        let camera = Camera { lens: Lens::Fisheye { k }, ..fisheye(190.0) };
        let whole =
            Surroundings::Fisheye { size: camera.size, intrinsics: camera.intrinsics, k, widest: 1.9 };
        for x in [[0.0, 0.0, 1.0], [0.4, -0.2, 1.0], [-3.0, 2.0, 1.0], [0.1, 5.0, 0.4]].map(Vector3::from) {
            let (found, expected) = (whole.project(&x).unwrap(), camera.project(&x).unwrap());
            assert!((found - expected).norm() < 1e-9, "{x:?}: {found:?}, expected {expected:?}");
        }
        let beyond = whole.project(&Vector3::new(0.0, 1.0, -0.02)).unwrap();
        assert!(beyond.y > camera.project(&Vector3::new(0.0, 1.0, 1e-3)).unwrap().y);
        assert!(whole.project(&Vector3::new(0.0, 1.0, -1.0)).is_none(), "outside of the photograph");
    }
}
