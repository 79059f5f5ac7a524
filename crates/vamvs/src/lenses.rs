//! Lens models that cannot be right.

use vamvs_core::undistort::Undistortion;
use vamvs_core::{Camera, Lens, Size, View};

/// Longer side of the image that tells how much of an undistorted photograph is empty, pixels.
const LENS_SAMPLES: usize = 32;

/// A lens model that fills less of the undistorted photograph is warned of.
const LEAST_FILLED: f64 = 0.7;

/// A warning if the lens model of a camera leaves much of its undistorted photograph empty: it folds back inside the photograph, which
/// real lenses do not.
#[must_use]
pub fn warn_of_lenses(views: &[View]) -> Option<String> {
    let mut cameras: Vec<Camera> = Vec::new();
    for view in views {
        if view.camera.lens.distorts() && !cameras.contains(&view.camera) {
            cameras.push(view.camera);
        }
    }
    let filled = |camera: &Camera| {
        let Size { width, height } = camera.size;
        let ratio = LENS_SAMPLES as f64 / camera.size.longer_side() as f64;
        let side = |side: usize| ((side as f64 * ratio) as usize).max(1);
        let small = Size::new(side(width), side(height));
        let mask = Undistortion::new(camera).resized(camera.photograph_size(), small).mask(None);
        mask.map_or(1.0, |mask| {
            mask.data().iter().filter(|filled| **filled).count() as f64 / small.area() as f64
        })
    };
    let (filled, camera) = cameras
        .iter()
        .filter(|camera| !matches!(camera.lens, Lens::Face(_)))
        .map(|camera| (filled(camera), camera))
        .min_by(|(a, _), (b, _)| a.total_cmp(b))?;
    let count = views.iter().filter(|view| view.camera == *camera).count();
    (filled < LEAST_FILLED).then(|| {
        format!(
            "the lens of {count} photograph(s) ({}) folds back inside the photograph: only {:.0} % of the undistorted pixels show anything; \
             check its distortion parameters, calibrate with fewer of them, or undistort the photographs beforehand",
            camera.lens,
            100.0 * filled
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use vamvs_core::{Intrinsics, Pose};

    #[test]
    fn lenses_that_fold_back_inside_the_photograph_are_told() {
        let intrinsics = Intrinsics { fx: 500.0, fy: 500.0, cx: 320.0, cy: 240.0 };
        let view = |lens| View {
            id: 0,
            name: "a.png".to_owned(),
            camera: Camera { size: Size::new(640, 480), intrinsics, lens },
            cam_from_world: Pose::identity(),
            depth_range: None,
        };
        let radial = |k1| Lens::Rational { k: [k1, 0.0, 0.0, 0.0, 0.0, 0.0], p: [0.0; 2] };
        let good = [Lens::None, radial(-0.1), radial(0.2), Lens::Fisheye { k: [0.01, 0.0, 0.0, 0.0] }];
        assert_eq!(warn_of_lenses(&good.map(view)), None);
        let warning = warn_of_lenses(&[view(Lens::None), view(radial(-3.0)), view(radial(-3.0))]).unwrap();
        assert!(warning.contains("the lens of 2 photograph(s)") && warning.contains("-3.0"), "{warning}");
    }
}
