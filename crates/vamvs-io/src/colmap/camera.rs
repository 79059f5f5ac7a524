//! Converts COLMAP's camera models to [`Camera`] and back.

use vamvs_core::face::{Rows, Side, Surroundings};
use vamvs_core::{Camera, Intrinsics, Lens, Size};

/// A camera model of COLMAP. Its parameters are one or two focal lengths, the principal point, and the lens's.
pub(super) struct CameraModel {
    /// Its name in text files.
    pub(super) name: &'static str,
    /// Its number in binary files.
    pub(super) id: i32,
    /// Number of parameters.
    pub(super) parameters: usize,
    focal_lengths: usize,
    lens: LensKind,
}

/// The meaning of the parameters after the principal point; parameters that a model lacks are 0.
enum LensKind {
    /// k₁ k₂ p₁ p₂ k₃ … k₆.
    Rational,
    /// k₁ … k₄.
    Fisheye,
    /// k.
    Division,
    /// α β.
    Eucm,
    /// A photograph of all directions; the parameters are its width and height.
    Panorama,
    /// A distortion that [`Lens`] cannot express.
    Unsupported,
}

const fn model(
    name: &'static str,
    id: i32,
    parameters: usize,
    focal_lengths: usize,
    lens: LensKind,
) -> CameraModel {
    CameraModel { name, id, parameters, focal_lengths, lens }
}

static MODELS: [CameraModel; 18] = [
    model("SIMPLE_PINHOLE", 0, 3, 1, LensKind::Rational),
    model("PINHOLE", 1, 4, 2, LensKind::Rational),
    model("SIMPLE_RADIAL", 2, 4, 1, LensKind::Rational),
    model("RADIAL", 3, 5, 1, LensKind::Rational),
    model("OPENCV", 4, 8, 2, LensKind::Rational),
    model("OPENCV_FISHEYE", 5, 8, 2, LensKind::Fisheye),
    model("FULL_OPENCV", 6, 12, 2, LensKind::Rational),
    model("FOV", 7, 5, 2, LensKind::Unsupported),
    model("SIMPLE_RADIAL_FISHEYE", 8, 4, 1, LensKind::Fisheye),
    model("RADIAL_FISHEYE", 9, 5, 1, LensKind::Fisheye),
    model("THIN_PRISM_FISHEYE", 10, 12, 2, LensKind::Unsupported),
    model("RAD_TAN_THIN_PRISM_FISHEYE", 11, 16, 2, LensKind::Unsupported),
    model("SIMPLE_DIVISION", 12, 4, 1, LensKind::Division),
    model("DIVISION", 13, 5, 2, LensKind::Division),
    model("SIMPLE_FISHEYE", 14, 3, 1, LensKind::Fisheye),
    model("FISHEYE", 15, 4, 2, LensKind::Fisheye),
    model("EUCM", 16, 6, 2, LensKind::Eucm),
    model("EQUIRECTANGULAR", 17, 2, 0, LensKind::Panorama),
];

/// Longest accepted side of an image, in pixels.
const LONGEST_SIDE: u64 = 1 << 20;

/// The supported model with this name.
pub(super) fn by_name(name: &str) -> Result<&'static CameraModel, String> {
    supported(name, MODELS.iter().find(|model| model.name == name))
}

/// The supported model with this number.
pub(super) fn by_id(id: i32) -> Result<&'static CameraModel, String> {
    let model = MODELS.iter().find(|model| model.id == id);
    supported(&model.map_or_else(|| format!("number {id}"), |model| model.name.to_owned()), model)
}

fn supported(name: &str, model: Option<&'static CameraModel>) -> Result<&'static CameraModel, String> {
    let is_supported = |model: &&CameraModel| !matches!(model.lens, LensKind::Unsupported);
    model.filter(is_supported).ok_or_else(|| {
        let names: Vec<&str> = MODELS.iter().filter(is_supported).map(|model| model.name).collect();
        let names = names.join(", ");
        format!("expected one of the camera models {names}, found {name}; undistort the images, or reconstruct with one of these")
    })
}

/// The image size of a camera, if both sides are in the accepted range.
pub(super) fn size(width: u64, height: u64) -> Result<Size, String> {
    let valid = 1..=LONGEST_SIDE;
    if valid.contains(&width) && valid.contains(&height) {
        Ok(Size::new(width as usize, height as usize))
    } else {
        Err(format!("expected an image size of 1 to {LONGEST_SIDE} pixels a side, found {width}×{height}"))
    }
}

/// The camera with these parameters of `model`; there must be `model.parameters` of them. That of a panorama is that of its front
/// face.
pub(super) fn camera(model: &CameraModel, size: Size, parameters: &[f64]) -> Result<Camera, String> {
    if !parameters.iter().all(|value| value.is_finite()) {
        return Err(format!("expected finite parameters, found {parameters:?}"));
    }
    if matches!(model.lens, LensKind::Panorama) {
        return Ok(Surroundings::Panorama { size, rows: Rows::Latitude }.face(Side::Front));
    }
    let (focal_lengths, rest) = parameters.split_at(model.focal_lengths);
    let (fx, fy) = (focal_lengths[0], focal_lengths[model.focal_lengths - 1]);
    let intrinsics = Intrinsics::try_new(fx, fy, rest[0], rest[1]).map_err(|error| error.to_string())?;
    if let (LensKind::Eucm, [alpha, beta]) = (&model.lens, &rest[2..])
        && !((0.0..=1.0).contains(alpha) && *beta > 0.0)
    {
        return Err(format!("expected α from 0 to 1 and β greater than 0, found {alpha} and {beta}"));
    }
    Ok(Camera { size, intrinsics, lens: lens(&model.lens, &rest[2..]) })
}

fn lens(kind: &LensKind, given: &[f64]) -> Lens {
    let value = |i: usize| given.get(i).copied().unwrap_or(0.0);
    let lens = match kind {
        LensKind::Rational => Lens::Rational {
            k: [value(0), value(1), value(4), value(5), value(6), value(7)],
            p: [value(2), value(3)],
        },
        LensKind::Fisheye => Lens::Fisheye { k: [value(0), value(1), value(2), value(3)] },
        LensKind::Division => Lens::Division { k: value(0) },
        LensKind::Eucm => Lens::Eucm { alpha: value(0), beta: value(1) },
        LensKind::Unsupported | LensKind::Panorama => {
            unreachable!("panoramas have no lens, and `supported` refuses the others")
        }
    };
    if lens.distorts() { lens } else { Lens::None }
}

/// The simplest of the models PINHOLE, OPENCV, FULL_OPENCV, OPENCV_FISHEYE, DIVISION and EUCM that can express `camera`, and
/// the camera's parameters in it.
pub(super) fn parameters(camera: &Camera) -> (&'static CameraModel, Vec<f64>) {
    let Intrinsics { fx, fy, cx, cy } = camera.intrinsics;
    let (id, lens) = match camera.lens {
        Lens::None | Lens::Face(_) => (1, vec![]),
        Lens::Rational { k: [k1, k2, 0.0, 0.0, 0.0, 0.0], p: [p1, p2] } => (4, vec![k1, k2, p1, p2]),
        Lens::Rational { k, p } => (6, vec![k[0], k[1], p[0], p[1], k[2], k[3], k[4], k[5]]),
        Lens::Fisheye { k } => (5, k.to_vec()),
        Lens::Division { k } => (13, vec![k]),
        Lens::Eucm { alpha, beta } => (16, vec![alpha, beta]),
    };
    (&MODELS[id], [vec![fx, fy, cx, cy], lens].concat())
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: Size = Size::new(640, 480);

    fn read(name: &str, parameters: &[f64]) -> Camera {
        let model = by_name(name).unwrap();
        assert_eq!(model.parameters, parameters.len());
        camera(model, SIZE, parameters).unwrap()
    }

    #[test]
    fn numbers_are_the_places_in_the_table() {
        assert!((0..).zip(&MODELS).all(|(place, model)| place == model.id));
    }

    #[test]
    fn parameters_go_where_opencv_has_them() {
        let rational = |k, p| Lens::Rational { k, p };
        let square = Intrinsics { fx: 500.0, fy: 500.0, cx: 320.0, cy: 240.0 };
        let other = Intrinsics { fy: 510.0, ..square };
        let cases: [(&str, &[f64], Intrinsics, Lens); 14] = [
            ("SIMPLE_PINHOLE", &[500.0, 320.0, 240.0], square, Lens::None),
            ("PINHOLE", &[500.0, 510.0, 320.0, 240.0], other, Lens::None),
            (
                "SIMPLE_RADIAL",
                &[500.0, 320.0, 240.0, 0.1],
                square,
                rational([0.1, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0; 2]),
            ),
            (
                "RADIAL",
                &[500.0, 320.0, 240.0, 0.1, 0.2],
                square,
                rational([0.1, 0.2, 0.0, 0.0, 0.0, 0.0], [0.0; 2]),
            ),
            (
                "OPENCV",
                &[500.0, 510.0, 320.0, 240.0, 0.1, 0.2, 0.3, 0.4],
                other,
                rational([0.1, 0.2, 0.0, 0.0, 0.0, 0.0], [0.3, 0.4]),
            ),
            (
                "FULL_OPENCV",
                &[500.0, 510.0, 320.0, 240.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8],
                other,
                rational([0.1, 0.2, 0.5, 0.6, 0.7, 0.8], [0.3, 0.4]),
            ),
            (
                "OPENCV_FISHEYE",
                &[500.0, 510.0, 320.0, 240.0, 0.1, 0.2, 0.3, 0.4],
                other,
                Lens::Fisheye { k: [0.1, 0.2, 0.3, 0.4] },
            ),
            (
                "SIMPLE_RADIAL_FISHEYE",
                &[500.0, 320.0, 240.0, 0.1],
                square,
                Lens::Fisheye { k: [0.1, 0.0, 0.0, 0.0] },
            ),
            (
                "RADIAL_FISHEYE",
                &[500.0, 320.0, 240.0, 0.1, 0.2],
                square,
                Lens::Fisheye { k: [0.1, 0.2, 0.0, 0.0] },
            ),
            ("SIMPLE_FISHEYE", &[500.0, 320.0, 240.0], square, Lens::Fisheye { k: [0.0; 4] }),
            ("FISHEYE", &[500.0, 510.0, 320.0, 240.0], other, Lens::Fisheye { k: [0.0; 4] }),
            ("SIMPLE_DIVISION", &[500.0, 320.0, 240.0, -0.05], square, Lens::Division { k: -0.05 }),
            ("DIVISION", &[500.0, 510.0, 320.0, 240.0, 0.05], other, Lens::Division { k: 0.05 }),
            ("EUCM", &[500.0, 510.0, 320.0, 240.0, 0.6, 1.0], other, Lens::Eucm { alpha: 0.6, beta: 1.0 }),
        ];
        for (name, values, intrinsics, lens) in cases {
            let expected = Camera { size: SIZE, intrinsics, lens };
            let found = read(name, values);
            assert_eq!(found, expected, "{name}");
            let (model, again) = parameters(&found);
            assert_eq!(camera(model, SIZE, &again), Ok(expected), "{name} written as {}", model.name);
        }
    }

    #[test]
    fn a_panorama_is_its_front_face() {
        let camera = read("EQUIRECTANGULAR", &[640.0, 480.0]);
        assert_eq!(camera.photograph_size(), SIZE);
        assert!(matches!(camera.lens, Lens::Face(face) if face.side == Side::Front));
        assert_eq!(parameters(&camera).0.name, "PINHOLE");
    }

    #[test]
    fn distortion_of_zero_is_none_but_a_fisheye_always_bends() {
        assert_eq!(read("SIMPLE_RADIAL", &[500.0, 320.0, 240.0, 0.0]).lens, Lens::None);
        let fisheye = read("SIMPLE_RADIAL_FISHEYE", &[500.0, 320.0, 240.0, 0.0]);
        assert_eq!(fisheye.lens, Lens::Fisheye { k: [0.0; 4] });
    }

    #[test]
    fn what_is_no_camera_is_refused() {
        let pinhole = by_id(1).unwrap();
        for parameters in [[0.0, 1.0, 0.0, 0.0], [1.0, f64::NAN, 0.0, 0.0]] {
            assert!(camera(pinhole, SIZE, &parameters).is_err());
        }
        let eucm = by_name("EUCM").unwrap();
        for [alpha, beta] in [[1.5, 1.0], [-0.1, 1.0], [0.5, 0.0]] {
            let message = camera(eucm, SIZE, &[500.0, 500.0, 320.0, 240.0, alpha, beta]).unwrap_err();
            assert!(message.contains("α from 0 to 1"), "{message}");
        }
        for refused in [by_name("FOV"), by_id(7), by_id(-1), by_name("pinhole")] {
            let message = refused.err().unwrap();
            assert!(message.contains("undistort") && message.contains("FULL_OPENCV"), "{message}");
        }
        assert!(size(0, 480).is_err() && size(u64::MAX, 480).is_err() && size(640, 480) == Ok(SIZE));
    }
}
