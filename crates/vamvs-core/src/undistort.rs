//! Undistortion: resamples a photograph taken through a lens to that of a pinhole camera.

use nalgebra::Vector2;
use rayon::prelude::*;

use crate::{Camera, Grid, Intrinsics, Lens, Pinhole, Rgb, Size};

/// The pinhole camera of an undistorted photograph, and the resampling that makes the undistorted image.
///
/// The undistorted image has the photograph's size, and the pinhole the ratio fx : fy of the photograph's camera. The
/// field of view keeps most of the photograph and leaves few pixels empty: each of the photograph's four borders is
/// undistorted, the medians of their positions bound a rectangle of at most 120° in width and height, and the view is
/// the largest one inside that rectangle, about its centre. A face ([`crate::face`]) has its own pinhole.
#[derive(Clone, Debug)]
pub struct Undistortion {
    camera: Camera,
    pinhole: Pinhole,
    /// The squared radius of normalised points up to which the lens is one-to-one, at most that of the pinhole's
    /// corners.
    valid: f64,
}

/// tan 60°, half of the largest field of view.
const LARGEST_TANGENT: f64 = 1.732_050_807_568_877_2;

/// Points that are undistorted along each border.
const BORDER_SAMPLES: usize = 101;

impl Undistortion {
    /// Chooses the pinhole camera. Without distortion the intrinsics stay as they are.
    #[must_use]
    pub fn new(camera: &Camera) -> Self {
        let has_own = matches!(camera.lens, Lens::Face(_)) || !camera.lens.distorts();
        let intrinsics = if has_own { camera.intrinsics } else { chosen_intrinsics(camera) };
        let pinhole = Pinhole { size: camera.size, intrinsics };
        Self {
            camera: *camera,
            pinhole,
            valid: camera.lens.max_squared_radius(largest_squared_radius(&pinhole)),
        }
    }

    /// The same resampling for a photograph of `from` pixels and an undistorted image of `to` pixels; lens and field
    /// of view stay as they are.
    #[must_use]
    pub fn resized(&self, from: Size, to: Size) -> Self {
        Self { camera: self.camera.of_photograph(from), pinhole: self.pinhole.resized(to), valid: self.valid }
    }

    /// Whether undistortion changes the photograph, at the same size: whether the lens distorts.
    #[must_use]
    pub fn changes(&self) -> bool {
        self.camera.lens.distorts()
    }

    /// The camera of the undistorted image.
    #[must_use]
    pub fn pinhole(&self) -> Pinhole {
        self.pinhole
    }

    /// The undistorted photograph, bilinearly sampled; black where the photograph shows nothing.
    ///
    /// # Panics
    /// If the image does not have the size of the camera's photograph (see [`Camera::of_photograph`]).
    #[must_use]
    pub fn image(&self, image: &Grid<Rgb>) -> Grid<Rgb> {
        self.resample(image, [0; 3], |image, pixel| bilinear(image, pixel, self.is_of_panorama()))
    }

    fn is_of_panorama(&self) -> bool {
        matches!(self.camera.lens, Lens::Face(face) if face.of.is_panorama())
    }

    /// The undistorted mask. Pixels that lie outside of the photograph are `false`. `None` if there is neither a mask
    /// nor a distortion, or the photograph shows all directions.
    ///
    /// # Panics
    /// If the lens distorts and the mask does not have the size of the camera's photograph.
    #[must_use]
    pub fn mask(&self, mask: Option<&Grid<bool>>) -> Option<Grid<bool>> {
        match mask {
            None if !self.camera.lens.distorts() || self.is_of_panorama() => None,
            None => Some(self.gather(false, |_| true)),
            Some(mask) if !self.camera.lens.distorts() => Some(mask.resized_nearest(self.pinhole.size)),
            Some(mask) => Some(self.resample(mask, false, nearest)),
        }
    }

    /// The image coordinates in the photograph of a point of the undistorted image; `None` outside of the photograph.
    fn photograph_from_pinhole(&self, pixel: &Vector2<f64>) -> Option<Vector2<f64>> {
        let ray = self.pinhole.intrinsics.ray(pixel);
        if let Lens::Face(face) = self.camera.lens {
            return face.of.project(&face.side.face_from_camera().tr_mul(&ray));
        }
        let distorted = self.camera.lens.distort_within(&ray.xy(), self.valid)?;
        let source = self.camera.intrinsics.project(&distorted.push(1.0));
        let Size { width, height } = self.camera.size;
        let inside = |v: f64, count: usize| v >= 0.0 && v <= count as f64;
        (inside(source.x, width) && inside(source.y, height)).then_some(source)
    }

    fn resample<T: Clone + Send + Sync>(
        &self,
        source: &Grid<T>,
        fill: T,
        sample: impl Fn(&Grid<T>, &Vector2<f64>) -> T + Sync,
    ) -> Grid<T> {
        let expected = self.camera.photograph_size();
        assert_eq!(source.size(), expected, "the image must have the size of its camera's photograph");
        if !self.camera.lens.distorts() && source.size() == self.pinhole.size {
            return source.clone();
        }
        self.gather(fill, |pixel| sample(source, pixel))
    }

    /// Fills the undistorted image: `sample` gets the photograph's image coordinates of each pixel that lies in the
    /// photograph; the other pixels are `fill`.
    fn gather<T: Clone + Send + Sync>(&self, fill: T, sample: impl Fn(&Vector2<f64>) -> T + Sync) -> Grid<T> {
        let mut out = Grid::filled(self.pinhole.size, fill);
        let width = out.width().max(1);
        out.data_mut().par_chunks_mut(width).enumerate().for_each(|(y, row)| {
            for (x, value) in row.iter_mut().enumerate() {
                let centre = Vector2::new(x as f64 + 0.5, y as f64 + 0.5);
                if let Some(pixel) = self.photograph_from_pinhole(&centre) {
                    *value = sample(&pixel);
                }
            }
        });
        out
    }
}

/// The largest squared radius of normalised points in the image, that of a corner, plus 0.1 %.
fn largest_squared_radius(pinhole: &Pinhole) -> f64 {
    let (width, height) = (pinhole.size.width as f64, pinhole.size.height as f64);
    let corners = [(0.0, 0.0), (width, 0.0), (0.0, height), (width, height)];
    let squares = corners.map(|(x, y)| pinhole.intrinsics.ray(&Vector2::new(x, y)).xy().norm_squared());
    1.001 * squares.into_iter().fold(0.0, f64::max)
}

/// The colour at image coordinates inside the image, bilinear between the four nearest pixel centres. Outside of the
/// outermost centres, the border pixels are repeated, or, if the image wraps, those of the other border follow.
fn bilinear(image: &Grid<Rgb>, pixel: &Vector2<f64>, wraps: bool) -> Rgb {
    let (x0, x1, u) =
        if wraps { neighbours_around(pixel.x, image.width()) } else { neighbours(pixel.x, image.width()) };
    let (y0, y1, v) = neighbours(pixel.y, image.height());
    let (top, bottom) = (image.row(y0), image.row(y1));
    std::array::from_fn(|c| {
        let mix = |row: &[Rgb]| f32::from(row[x0][c]) * (1.0 - u) + f32::from(row[x1][c]) * u;
        (mix(top) * (1.0 - v) + mix(bottom) * v).round() as u8
    })
}

/// The pixels whose centres lie on both sides of a coordinate, and the weight of the second one, 0 to 1.
fn neighbours(coordinate: f64, count: usize) -> (usize, usize, f32) {
    let from_first_centre = (coordinate - 0.5).clamp(0.0, (count - 1) as f64);
    let before = from_first_centre as usize;
    (before, (before + 1).min(count - 1), (from_first_centre - before as f64) as f32)
}

/// [`neighbours`] where the last pixel is followed by the first one.
fn neighbours_around(coordinate: f64, count: usize) -> (usize, usize, f32) {
    let from_first_centre = (coordinate - 0.5).rem_euclid(count as f64);
    let before = (from_first_centre as usize).min(count - 1);
    (before, (before + 1) % count, (from_first_centre - before as f64) as f32)
}

/// The value of the pixel that contains image coordinates.
fn nearest(mask: &Grid<bool>, pixel: &Vector2<f64>) -> bool {
    let x = (pixel.x as usize).min(mask.width() - 1);
    let y = (pixel.y as usize).min(mask.height() - 1);
    mask[(x, y)]
}

/// The intrinsics of the undistorted camera, as [`Undistortion`] describes them.
fn chosen_intrinsics(camera: &Camera) -> Intrinsics {
    let Size { width, height } = camera.size;
    let (w, h) = (width as f64, height as f64);
    let along = |end: f64| (0..BORDER_SAMPLES).map(move |i| end * i as f64 / (BORDER_SAMPLES - 1) as f64);
    let x_of = |x: f64| median_coordinate(camera, 0, along(h).map(|y| Vector2::new(x, y)));
    let y_of = |y: f64| median_coordinate(camera, 1, along(w).map(|x| Vector2::new(x, y)));
    let ([left, right], [top, bottom]) = ([0.0, w].map(x_of), [0.0, h].map(y_of));
    let k = camera.intrinsics;
    let scale = (w / (right - left) / k.fx).max(h / (bottom - top) / k.fy);
    let (fx, fy) = (k.fx * scale, k.fy * scale);
    let (cx, cy) = (0.5 * (w - fx * (left + right)), 0.5 * (h - fy * (top + bottom)));
    // If the whole photograph lies beyond the lens model, there is no field of view to choose from.
    Intrinsics::try_new(fx, fy, cx, cy).unwrap_or(k)
}

/// The median of one normalised coordinate (`axis` 0 for x, 1 for y) of undistorted border pixels.
///
/// Coordinates are clamped to the largest field of view. A pixel beyond the lens model counts as infinitely far out.
fn median_coordinate(camera: &Camera, axis: usize, border: impl Iterator<Item = Vector2<f64>>) -> f64 {
    let mut coordinates: Vec<f64> = border
        .map(|pixel| {
            let distorted = camera.intrinsics.ray(&pixel).xy();
            let undistorted =
                camera.lens.undistort(&distorted).unwrap_or_else(|| distorted.map(|v| v.signum() * f64::MAX));
            undistorted[axis].clamp(-LARGEST_TANGENT, LARGEST_TANGENT)
        })
        .collect();
    coordinates.sort_by(f64::total_cmp);
    coordinates[coordinates.len() / 2]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::face::{Rows, Side, Surroundings};

    const SIZE: Size = Size::new(320, 240);
    const K: Intrinsics = Intrinsics { fx: 260.0, fy: 250.0, cx: 155.0, cy: 126.0 };

    fn camera(lens: Lens) -> Camera {
        Camera { size: SIZE, intrinsics: K, lens }
    }

    fn barrel() -> Camera {
        camera(Lens::Rational { k: [-0.2, 0.03, 0.0, 0.0, 0.0, 0.0], p: [0.002, -0.001] })
    }

    fn fisheye() -> Camera {
        camera(Lens::Fisheye { k: [0.02, -0.01, 0.0, 0.0] })
    }

    /// The colour seen in a direction (x/z, y/z): waves of about 20 pixels, so that a shift by half a pixel changes
    /// it by up to 15 levels.
    fn world(x: &Vector2<f64>) -> Rgb {
        [x.x, x.y, x.x + x.y].map(|v| (127.0 + 100.0 * (80.0 * v).sin()).round() as u8)
    }

    fn photograph(camera: &Camera) -> Grid<Rgb> {
        Grid::from_fn(camera.size, |x, y| {
            let distorted = camera.intrinsics.ray(&Vector2::new(x as f64 + 0.5, y as f64 + 0.5)).xy();
            camera.lens.undistort(&distorted).map_or([0; 3], |x| world(&x))
        })
    }

    #[test]
    fn an_undistorted_photograph_is_that_of_the_pinhole() {
        for camera in [barrel(), fisheye()] {
            let undistortion = Undistortion::new(&camera);
            let image = undistortion.image(&photograph(&camera));
            let expected = photograph(&undistortion.pinhole().into());
            let mask = undistortion.mask(None).unwrap();
            let mut error = 0.0;
            let mut count = 0;
            for index in (0..SIZE.area()).filter(|&index| mask.data()[index]) {
                let pair = image.data()[index].into_iter().zip(expected.data()[index]);
                error += pair.map(|(a, b)| f64::from(a.abs_diff(b))).sum::<f64>() / 3.0;
                count += 1;
            }
            assert!(count > SIZE.area() * 9 / 10);
            assert!(error / f64::from(count as u32) < 1.5, "mean error {}", error / f64::from(count as u32));
        }
    }

    #[test]
    fn no_distortion_changes_nothing() {
        let zeros = Lens::Rational { k: [0.0; 6], p: [0.0; 2] };
        for camera in [Lens::None, zeros].map(camera) {
            let undistortion = Undistortion::new(&camera);
            let image = photograph(&camera);
            assert_eq!(undistortion.pinhole().intrinsics, K);
            assert_eq!(undistortion.image(&image), image);
            assert_eq!(undistortion.mask(None), None);
            let mask = Grid::from_fn(SIZE, |x, y| (x + y) % 3 == 0);
            assert_eq!(undistortion.mask(Some(&mask)), Some(mask));
        }
    }

    /// A photograph of half the size, or a mask of the full size, gives the same image of half the size.
    #[test]
    fn a_smaller_image_is_that_of_the_same_field_of_view() {
        let half = Size::new(SIZE.width / 2, SIZE.height / 2);
        for camera in [barrel(), fisheye()] {
            let whole = Undistortion::new(&camera);
            let smaller = whole.resized(half, half);
            assert_eq!(smaller.pinhole(), whole.pinhole().resized(half));
            let image = smaller.image(&photograph(&camera.resized(half)));
            let expected = photograph(&smaller.pinhole().into());
            let mask = whole.resized(SIZE, half).mask(Some(&Grid::filled(SIZE, true))).unwrap();
            assert_eq!(mask, smaller.mask(None).unwrap());
            let differences = image.data().iter().zip(expected.data()).zip(mask.data());
            let inside: Vec<f64> = differences
                .filter(|(_, counts)| **counts)
                .map(|((a, b), _)| f64::from(a[0].abs_diff(b[0])))
                .collect();
            let mean = inside.iter().sum::<f64>() / inside.len() as f64;
            assert!(inside.len() > half.area() * 9 / 10 && mean < 3.0, "mean error {mean}");
        }
    }

    #[test]
    fn sampling_is_exact_at_centres_and_halfway_between() {
        let image = Grid::from_fn(Size::new(4, 3), |x, y| [(40 * x + 10 * y) as u8; 3]);
        let at = |x, y| bilinear(&image, &Vector2::new(x, y), false)[0];
        assert_eq!((at(2.5, 1.5), at(3.0, 1.5), at(2.5, 2.0)), (90, 110, 95));
        assert_eq!((at(0.0, 0.0), at(0.3, 0.5), at(4.0, 3.0)), (0, 0, 140));
    }

    #[test]
    fn the_mask_leaves_out_exactly_the_empty_pixels() {
        let wide = camera(Lens::Rational { k: [0.3, 0.0, 0.0, 0.0, 0.0, 0.0], p: [0.0; 2] });
        for camera in [barrel(), wide] {
            let undistortion = Undistortion::new(&camera);
            let white = undistortion.image(&Grid::filled(SIZE, [255; 3]));
            let mask = undistortion.mask(None).unwrap();
            assert!(mask.data().contains(&false) && mask.data().contains(&true));
            assert_eq!(mask, white.map(|&colour| colour == [255; 3]));
            assert_eq!(undistortion.mask(Some(&Grid::filled(SIZE, true))).as_ref(), Some(&mask));
            let expected = Grid::from_fn(SIZE, |x, y| {
                let centre = Vector2::new(x as f64 + 0.5, y as f64 + 0.5);
                let seen = camera.project(&undistortion.pinhole().intrinsics.ray(&centre));
                seen.is_some_and(|p| (0.0..=320.0).contains(&p.x) && (0.0..=240.0).contains(&p.y))
            });
            assert_eq!(mask, expected);
        }
    }

    #[test]
    fn a_mask_moves_with_its_photograph() {
        let undistortion = Undistortion::new(&barrel());
        let left = Grid::from_fn(SIZE, |x, _| x < 100);
        let mask = undistortion.mask(Some(&left)).unwrap();
        for y in (5..235).step_by(23) {
            for x in 5..315 {
                let pixel = Vector2::new(x as f64 + 0.5, y as f64 + 0.5);
                let expected = undistortion.photograph_from_pinhole(&pixel).is_some_and(|p| p.x < 100.0);
                assert_eq!(mask[(x, y)], expected);
            }
        }
    }

    /// What a face shows is what a pinhole camera that looks there would.
    #[test]
    fn faces_of_a_panorama_are_photographs_of_pinholes() {
        // Smooth waves of any direction, so that a shift of a pixel changes a colour by up to 8 levels.
        let world = |d: &nalgebra::Vector3<f64>| {
            let d = d.normalize();
            [d.x, d.y, d.z].map(|v| (127.0 + 100.0 * (12.0 * v + d.x - d.y).sin()).round() as u8)
        };
        let size = Size::new(800, 400);
        for rows in [Rows::Latitude, Rows::SineOfLatitude] {
            let panorama = Grid::from_fn(size, |x, y| {
                let longitude = ((x as f64 + 0.5) / 800.0 - 0.5) * std::f64::consts::TAU;
                let down = (y as f64 + 0.5) / 400.0 - 0.5;
                let latitude = match rows {
                    Rows::Latitude => down * std::f64::consts::PI,
                    Rows::SineOfLatitude => (2.0 * down).asin(),
                };
                let (level, depth) = (latitude.cos(), longitude.cos());
                world(&nalgebra::Vector3::new(level * longitude.sin(), latitude.sin(), level * depth))
            });
            for side in Side::ALL {
                let undistortion = Undistortion::new(&Surroundings::Panorama { size, rows }.face(side));
                let pinhole = undistortion.pinhole();
                let found = undistortion.image(&panorama);
                assert_eq!((found.size(), found.width()), (pinhole.size, 306));
                let expected = Grid::from_fn(pinhole.size, |x, y| {
                    let ray = pinhole.intrinsics.ray(&Vector2::new(x as f64 + 0.5, y as f64 + 0.5));
                    world(&side.face_from_camera().tr_mul(&ray))
                });
                let pairs = found.data().as_flattened().iter().zip(expected.data().as_flattened());
                let (sum, most) = pairs.fold((0, 0), |(sum, most), (a, b)| {
                    let off = u32::from(a.abs_diff(*b));
                    (sum + off, most.max(off))
                });
                let mean = f64::from(sum) / (3 * found.size().area()) as f64;
                // Rows of even steps of the sine are far apart at the poles.
                let is_fine = most <= 3 || rows == Rows::SineOfLatitude;
                assert!(mean < 0.5 && is_fine, "{side:?} of {rows:?}: mean {mean}, most {most}");
                assert_eq!(undistortion.mask(None), None);
            }
        }
    }

    /// The share of the photograph's pixels that the pinhole sees.
    fn kept(camera: &Camera, pinhole: &Pinhole) -> f64 {
        let seen = Grid::from_fn(SIZE, |x, y| {
            let distorted = camera.intrinsics.ray(&Vector2::new(x as f64 + 0.5, y as f64 + 0.5)).xy();
            let undistorted = camera.lens.undistort(&distorted);
            undistorted.is_some_and(|x| pinhole.contains(&pinhole.intrinsics.project(&x.push(1.0))))
        });
        share(&seen)
    }

    fn share(seen: &Grid<bool>) -> f64 {
        seen.data().iter().filter(|&&seen| seen).count() as f64 / seen.size().area() as f64
    }

    #[test]
    fn the_field_of_view_keeps_most_and_leaves_little_empty() {
        for camera in [barrel(), fisheye()] {
            let undistortion = Undistortion::new(&camera);
            let pinhole = undistortion.pinhole();
            assert!((pinhole.intrinsics.fx / pinhole.intrinsics.fy - K.fx / K.fy).abs() < 1e-12);
            let (kept, filled) = (kept(&camera, &pinhole), share(&undistortion.mask(None).unwrap()));
            assert!(kept > 0.94 && filled > 0.98, "{kept} of the photograph in {filled} of the image");
        }
    }

    #[test]
    fn a_fisheye_of_180_degrees_becomes_a_pinhole_of_at_most_120() {
        let intrinsics = Intrinsics { fx: 100.0, fy: 100.0, cx: 160.0, cy: 120.0 };
        let camera = Camera { size: SIZE, intrinsics, lens: Lens::Fisheye { k: [0.0; 4] } };
        let k = Undistortion::new(&camera).pinhole().intrinsics;
        let field = |pixel: f64| k.ray(&Vector2::new(pixel, 0.0)).x.atan().to_degrees();
        assert!((field(0.0) + 60.0).abs() < 1e-9 && (field(320.0) - 60.0).abs() < 1e-9);
    }

    #[test]
    fn a_photograph_beyond_the_lens_model_is_masked_out() {
        let lens = Lens::Rational { k: [-5.0, 0.0, 0.0, 0.0, 0.0, 0.0], p: [0.0; 2] };
        let aside = Camera { intrinsics: Intrinsics { cx: -2000.0, ..K }, ..camera(lens) };
        let mask = Undistortion::new(&aside).mask(None).unwrap();
        assert!(!mask.data().contains(&true));
    }
}
