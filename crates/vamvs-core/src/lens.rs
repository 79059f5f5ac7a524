//! Lens distortion of normalised image coordinates.
//!
//! Each model maps the plane of normalised coordinates to itself. Around the axis the map is one-to-one. For most
//! calibrations it ceases to be so at some radius, where the distorted radius stops growing; points farther out would
//! fold back into the image. The domain of a lens is the disc up to that radius, and distortion is undefined beyond
//! it. Tangential terms are small; they are only required not to mirror the image locally (the Jacobian's determinant
//! is positive).

use std::fmt;

use nalgebra::{Matrix2, Vector2};
use serde::{Deserialize, Serialize};

use crate::face::Face;

/// A lens, which distorts normalised image coordinates (x/z, y/z).
///
/// The distorting variants cover COLMAP's SIMPLE_RADIAL, RADIAL, OPENCV and FULL_OPENCV (all special cases of [`Lens::Rational`]),
/// SIMPLE_FISHEYE, FISHEYE, SIMPLE_RADIAL_FISHEYE, RADIAL_FISHEYE and OPENCV_FISHEYE ([`Lens::Fisheye`]), SIMPLE_DIVISION and DIVISION
/// ([`Lens::Division`]), and EUCM ([`Lens::Eucm`]).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Lens {
    /// No distortion.
    None,
    /// OpenCV's rational model: radial `(1 + k₁r² + k₂r⁴ + k₃r⁶) / (1 + k₄r² + k₅r⁴ + k₆r⁶)` and
    /// tangential `p`.
    Rational {
        /// k₁ … k₆.
        k: [f64; 6],
        /// p₁, p₂.
        p: [f64; 2],
    },
    /// OpenCV's equidistant fisheye: `θ (1 + k₁θ² + k₂θ⁴ + k₃θ⁶ + k₄θ⁸)`.
    Fisheye {
        /// k₁ … k₄.
        k: [f64; 4],
    },
    /// The division model (Fitzgibbon, CVPR 2001): a point at the distorted radius r is undistorted by the factor 1 / (1 + k r²).
    Division {
        /// k.
        k: f64,
    },
    /// The enhanced unified camera model (Khomutenko et al., RA-L 2016): x / (α ρ + 1 − α) with ρ² = β r² + 1.
    Eucm {
        /// α, from 0 to 1; 0 is no distortion.
        alpha: f64,
        /// β, greater than 0.
        beta: f64,
    },
    /// No distortion: the view is cut out of a photograph of more directions than a pinhole camera takes.
    Face(Face),
}

impl fmt::Display for Lens {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::None => write!(f, "no distortion"),
            Self::Rational { k, p } => write!(f, "k1 … k6 = {k:?}, p1, p2 = {p:?}"),
            Self::Fisheye { k } => write!(f, "a fisheye, k1 … k4 = {k:?}"),
            Self::Division { k } => write!(f, "a division model, k = {k:?}"),
            Self::Eucm { alpha, beta } => {
                write!(f, "an enhanced unified camera, alpha = {alpha:?}, beta = {beta:?}")
            }
            Self::Face(_) => write!(f, "a view of all directions"),
        }
    }
}

/// Largest residual of [`Lens::undistort`]: the distance between the given point and the result distorted again, in
/// normalised coordinates.
const RESIDUAL: f64 = 1e-10;

/// Most iterations of each numerical search. Newton's method needs about ten, except near the fold.
const STEPS: usize = 100;

impl Lens {
    /// Whether the photograph must be resampled: whether the lens distorts at all. A fisheye always does.
    #[must_use]
    pub fn distorts(&self) -> bool {
        match self {
            Self::None => false,
            Self::Rational { k, p } => k.iter().chain(p).any(|&v| v != 0.0),
            Self::Fisheye { .. } | Self::Face(_) => true,
            Self::Division { k } => *k != 0.0,
            Self::Eucm { alpha, .. } => *alpha != 0.0,
        }
    }

    /// The distorted position of the normalised point `x`; `None` beyond the radius at which the model folds over.
    #[must_use]
    pub fn distort(&self, x: &Vector2<f64>) -> Option<Vector2<f64>> {
        self.distort_with_jacobian(x).map(|(distorted, _)| distorted)
    }

    /// The largest squared radius of normalised points, at most `limit`, up to which the model is one-to-one. It is
    /// found by bisection. To distort many points, call this once and then [`Lens::distort_within`].
    #[must_use]
    pub fn max_squared_radius(&self, limit: f64) -> f64 {
        last(limit, |squared| self.is_one_to_one_within(squared))
    }

    /// [`Lens::distort`] with the squared radius `valid` up to which the model is known to be one-to-one; `None`
    /// beyond it.
    #[must_use]
    pub fn distort_within(&self, x: &Vector2<f64>, valid: f64) -> Option<Vector2<f64>> {
        (x.norm_squared() <= valid).then(|| self.distort_inside(x))?.map(|(distorted, _)| distorted)
    }

    /// The normalised point that the lens distorts to `distorted`: the inverse of [`Lens::distort`], to 1e-10, or
    /// that share of its distance from the centre, if that is above 1.
    ///
    /// `None` if there is no such point, for example outside of the image circle of a strongly curved lens, or if the
    /// search does not converge.
    #[must_use]
    pub fn undistort(&self, distorted: &Vector2<f64>) -> Option<Vector2<f64>> {
        let mut x = self.start(distorted)?;
        let (mut image, mut jacobian) = self.distort_with_jacobian(&x)?;
        for _ in 0..STEPS {
            let Some(step) = jacobian.try_inverse().map(|inverse| inverse * (distorted - image)) else {
                break;
            };
            let Some((next, at_next)) = self.descend(&x, &step, distorted, (distorted - image).norm()) else {
                break;
            };
            (x, (image, jacobian)) = (next, at_next);
        }
        // Far from the centre rounding leaves more: near a pole of the rational model points are far out.
        ((distorted - image).norm() <= RESIDUAL * distorted.norm().max(1.0)).then_some(x)
    }

    /// The start of Newton's method: the first of `distorted`, `distorted / 2`, `distorted / 4`, … that lies in the
    /// lens's domain.
    fn start(&self, distorted: &Vector2<f64>) -> Option<Vector2<f64>> {
        let halvings = std::iter::successors(Some(*distorted), |x| Some(x * 0.5));
        halvings.take(STEPS).find(|x| self.distort_with_jacobian(x).is_some())
    }

    /// A Newton step with backtracking: the longest of the steps `step`, `step / 2`, … that stays in the domain and
    /// reduces the residual, with the point it leads to; `None` if rounding allows no further reduction.
    fn descend(
        &self,
        x: &Vector2<f64>,
        step: &Vector2<f64>,
        distorted: &Vector2<f64>,
        residual: f64,
    ) -> Option<(Vector2<f64>, Distorted)> {
        let steps = std::iter::successors(Some(*step), |step| Some(step * 0.5)).take(40);
        steps.map(|step| x + step).find_map(|next| {
            let at_next = self.distort_with_jacobian(&next)?;
            ((distorted - at_next.0).norm() < residual).then_some((next, at_next))
        })
    }

    /// The distorted point and the Jacobian of the distortion; `None` outside of the domain.
    fn distort_with_jacobian(&self, x: &Vector2<f64>) -> Option<Distorted> {
        let s = x.norm_squared();
        (s.is_finite() && self.is_one_to_one_within(s)).then(|| self.distort_inside(x))?
    }

    /// Whether the radial part is one-to-one up to the squared radius `s`.
    fn is_one_to_one_within(&self, s: f64) -> bool {
        match self {
            Self::None | Self::Face(_) => true,
            Self::Rational { k, .. } => {
                let (numerator, denominator) = rational(k);
                is_positive_up_to(&denominator, s)
                    && is_positive_up_to(&radial_slope(&numerator, &denominator), s)
            }
            Self::Fisheye { k } => is_positive_up_to(&angle_slope(k), s.sqrt().atan().powi(2)),
            Self::Division { k } => 1.0 - 4.0 * k * s > 0.0,
            // The slope of the distorted radius has the sign of α + (1 − α) ρ.
            Self::Eucm { alpha, beta } => {
                let rho = (beta * s + 1.0).sqrt();
                rho.is_finite() && alpha + (1.0 - alpha) * rho > 0.0
            }
        }
    }

    /// [`Lens::distort_with_jacobian`] for a point at which the radial part is known to be one-to-one.
    fn distort_inside(&self, x: &Vector2<f64>) -> Option<Distorted> {
        match self {
            Self::None | Self::Face(_) => Some((*x, Matrix2::identity())),
            Self::Rational { k, p } => distort_rational(k, p, x),
            Self::Fisheye { k } => distort_fisheye(k, x),
            Self::Division { k } => {
                let root = (1.0 - 4.0 * k * x.norm_squared()).sqrt();
                Some(radial(x, 2.0 / (1.0 + root), 4.0 * k / (root * (1.0 + root).powi(2))))
            }
            Self::Eucm { alpha, beta } => {
                let rho = (beta * x.norm_squared() + 1.0).sqrt();
                let factor = 1.0 / (alpha * rho + 1.0 - alpha);
                Some(radial(x, factor, -0.5 * factor * factor * alpha * beta / rho))
            }
        }
    }
}

/// A distorted point and its Jacobian with respect to the undistorted point.
type Distorted = (Vector2<f64>, Matrix2<f64>);

/// The numerator and the denominator of the rational model, as polynomials in r².
fn rational(k: &[f64; 6]) -> ([f64; 4], [f64; 4]) {
    ([1.0, k[0], k[1], k[2]], [1.0, k[3], k[4], k[5]])
}

/// The derivative of the distorted angle with respect to the angle, as a polynomial in θ².
fn angle_slope(k: &[f64; 4]) -> [f64; 5] {
    [1.0, 3.0 * k[0], 5.0 * k[1], 7.0 * k[2], 9.0 * k[3]]
}

/// The distorted angle of a fisheye at an angle from its axis, radians.
pub(crate) fn fisheye_angle(k: &[f64; 4], theta: f64) -> f64 {
    theta * value_and_derivative(&[1.0, k[0], k[1], k[2], k[3]], theta * theta).0
}

/// The largest angle from the axis, at most `most`, radians, up to which the distorted angle of a fisheye grows.
pub(crate) fn fisheye_limit(k: &[f64; 4], most: f64) -> f64 {
    last(most, |theta| is_positive_up_to(&angle_slope(k), theta * theta))
}

/// The largest value from 0 to `limit` up to which something holds that does not hold again beyond, by bisection.
pub(crate) fn last(limit: f64, holds: impl Fn(f64) -> bool) -> f64 {
    if holds(limit) {
        return limit;
    }
    let (mut within, mut beyond) = (0.0, limit);
    for _ in 0..STEPS {
        let middle = 0.5 * (within + beyond);
        *(if holds(middle) { &mut within } else { &mut beyond }) = middle;
    }
    within
}

fn distort_rational(k: &[f64; 6], &[p1, p2]: &[f64; 2], x: &Vector2<f64>) -> Option<Distorted> {
    let (numerator, denominator) = rational(k);
    let s = x.norm_squared();
    let (n, dn) = value_and_derivative(&numerator, s);
    let (d, dd) = value_and_derivative(&denominator, s);
    let (factor, slope) = (n / d, (dn * d - n * dd) / (d * d));
    let cross = 2.0 * x.x * x.y;
    let tangential =
        Vector2::new(p1 * cross + p2 * (s + 2.0 * x.x * x.x), p1 * (s + 2.0 * x.y * x.y) + p2 * cross);
    let mixed = 2.0 * (p1 * x.x + p2 * x.y);
    let tangential_jacobian =
        Matrix2::new(2.0 * p1 * x.y + 6.0 * p2 * x.x, mixed, mixed, 6.0 * p1 * x.y + 2.0 * p2 * x.x);
    let jacobian = radial_jacobian(x, factor, slope) + tangential_jacobian;
    (jacobian.determinant() > 0.0).then(|| (x * factor + tangential, jacobian))
}

fn distort_fisheye(k: &[f64; 4], x: &Vector2<f64>) -> Option<Distorted> {
    let r = x.norm();
    if r < 1e-8 {
        return Some((*x, Matrix2::identity()));
    }
    let theta = r.atan();
    let (dtheta_distorted, _) = value_and_derivative(&angle_slope(k), theta * theta);
    let factor = fisheye_angle(k, theta) / r;
    // The factor's derivative with respect to r², from that of the distorted angle with respect to r.
    let factor_slope = (dtheta_distorted / (1.0 + r * r) - factor) / (2.0 * r * r);
    Some(radial(x, factor, factor_slope))
}

/// `x · f(|x|²)` with its Jacobian, from f (`factor`) and its derivative f′ (`slope`) at |x|².
fn radial(x: &Vector2<f64>, factor: f64, slope: f64) -> Distorted {
    (x * factor, radial_jacobian(x, factor, slope))
}

/// The Jacobian of `x · f(|x|²)`, from f (`factor`) and its derivative f′ (`slope`) at |x|².
fn radial_jacobian(x: &Vector2<f64>, factor: f64, slope: f64) -> Matrix2<f64> {
    Matrix2::identity() * factor + x * x.transpose() * (2.0 * slope)
}

/// A polynomial in s = r² with the sign of d(r · n/d)/dr: `n d + 2 s (n' d − n d')`.
fn radial_slope(n: &[f64; 4], d: &[f64; 4]) -> [f64; 7] {
    let mut slope = [0.0; 7];
    for (i, n) in n.iter().enumerate() {
        for (j, d) in d.iter().enumerate() {
            slope[i + j] += n * d * (1.0 + 2.0 * (i as f64 - j as f64));
        }
    }
    slope
}

/// The value and derivative of a polynomial, constant term first.
fn value_and_derivative<const N: usize>(coefficients: &[f64; N], s: f64) -> (f64, f64) {
    coefficients.iter().rev().fold((0.0, 0.0), |(value, slope), c| (value * s + c, slope * s + value))
}

/// Whether a polynomial, constant term first, is positive on all of `[0, s]`.
///
/// Exact up to rounding. On an interval, a polynomial lies between its smallest and its largest Bernstein
/// coefficient, and at the ends it equals the first and the last one. If that does not decide, the two halves of the
/// interval are tested. After 40 halvings the answer is `false`.
fn is_positive_up_to<const N: usize>(coefficients: &[f64; N], s: f64) -> bool {
    // Scale to b_i = c_i sⁱ / C(N − 1, i); then b_j = Σ_i C(j, i) b_i, by Pascal's rule.
    let mut bernstein = *coefficients;
    let (mut power, mut binomial) = (1.0, 1.0);
    for (i, b) in bernstein.iter_mut().enumerate() {
        *b *= power / binomial;
        power *= s;
        binomial *= (N - 1 - i) as f64 / (i + 1) as f64;
    }
    for first in 1..N {
        for j in (first..N).rev() {
            bernstein[j] += bernstein[j - 1];
        }
    }
    bernstein_is_positive(&bernstein, 40)
}

fn bernstein_is_positive<const N: usize>(b: &[f64; N], halvings: u32) -> bool {
    if b.iter().all(|&b| b > 0.0) {
        return true;
    }
    if halvings == 0 || !(b[0] > 0.0 && b[N - 1] > 0.0) {
        return false;
    }
    // De Casteljau's algorithm: the two sides of the triangle are the coefficients of the two halves.
    let (mut left, mut right) = (*b, *b);
    for (level, side) in left.iter_mut().enumerate() {
        *side = right[0];
        for i in 0..N - 1 - level {
            right[i] = 0.5 * (right[i] + right[i + 1]);
        }
    }
    bernstein_is_positive(&left, halvings - 1) && bernstein_is_positive(&right, halvings - 1)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const POINTS: [[f64; 2]; 3] = [[0.3, -0.2], [-0.55, 0.4], [0.0, 0.7]];

    fn of_radius(k: [f64; 6]) -> Lens {
        Lens::Rational { k, p: [0.0; 2] }
    }

    fn assert_distorts(lens: Lens, expected: [[f64; 2]; 3]) {
        for (x, expected) in POINTS.into_iter().zip(expected) {
            let distorted = lens.distort(&Vector2::from(x)).unwrap();
            assert!(
                (distorted - Vector2::from(expected)).norm() < 1e-14,
                "{x:?} to {distorted:?}, OpenCV {expected:?}"
            );
            assert!((lens.undistort(&distorted).unwrap() - Vector2::from(x)).norm() < 1e-12);
        }
    }

    #[test]
    fn the_division_model_undoes_itself_by_its_definition() {
        for k in [-0.3, -0.05, 0.04, 0.15] {
            let lens = Lens::Division { k };
            for x in POINTS.map(Vector2::from) {
                let bent = lens.distort(&x).unwrap();
                assert!((bent / (1.0 + k * bent.norm_squared()) - x).norm() < 1e-14, "k {k}");
                assert!((lens.undistort(&bent).unwrap() - x).norm() < 1e-12, "k {k}");
            }
        }
        // With k > 0 no distorted radius is larger than 1/√k, at the undistorted radius 1/(2 √k).
        assert_eq!(Lens::Division { k: 0.25 }.distort(&Vector2::new(1.01, 0.0)), None);
        assert!(Lens::Division { k: 0.25 }.distort(&Vector2::new(0.99, 0.0)).is_some());
    }

    #[test]
    fn the_unified_model_bends_as_its_formula_says_and_its_jacobian_is_its_slope() {
        let lens = Lens::Eucm { alpha: 0.6, beta: 1.1 };
        for x in POINTS.map(Vector2::from) {
            let rho = (1.1 * x.norm_squared() + 1.0).sqrt();
            let (bent, jacobian) = lens.distort_with_jacobian(&x).unwrap();
            assert!((bent - x / (0.6 * rho + 0.4)).norm() < 1e-15);
            assert!((lens.undistort(&bent).unwrap() - x).norm() < 1e-12);
            let step = 1e-6;
            for (axis, way) in [Vector2::x(), Vector2::y()].into_iter().enumerate() {
                let at = |sign: f64| lens.distort(&(x + way * (sign * step))).unwrap();
                let slope = (at(1.0) - at(-1.0)) / (2.0 * step);
                assert!((slope - jacobian.column(axis)).norm() < 1e-8);
            }
        }
        assert!(!Lens::Eucm { alpha: 0.0, beta: 1.0 }.distorts());
    }

    // Expected values of the next three tests: OpenCV 5.0, projectPoints and fisheye.projectPoints.

    #[test]
    fn radial_and_tangential_distortion_is_opencvs() {
        let lens = Lens::Rational { k: [-0.28, 0.07, 0.0, 0.0, 0.0, 0.0], p: [0.0012, -0.0007] };
        let expected = [
            [0.2890739, -0.19262060000000003],
            [-0.48828564062499996, 0.355436375],
            [-0.00034299999999999993, 0.6174889],
        ];
        assert_distorts(lens, expected);
    }

    #[test]
    fn rational_distortion_is_opencvs() {
        let lens = Lens::Rational { k: [0.12, -0.05, 0.01, 0.3, -0.02, 0.004], p: [0.0012, -0.0007] };
        let expected = [
            [0.29273773206908754, -0.19506315471272503],
            [-0.5081067970073453, 0.3698517614598876],
            [-0.00034299999999999993, 0.6437524519168144],
        ];
        assert_distorts(lens, expected);
    }

    #[test]
    fn fisheye_distortion_is_opencvs() {
        let expected = [
            [0.2889234745961259, -0.19261564973075063],
            [-0.4876357575997951, 0.3546441873453055],
            [0.0, 0.6168297697993387],
        ];
        assert_distorts(Lens::Fisheye { k: [0.03, -0.01, 0.004, -0.0006] }, expected);
    }

    #[test]
    fn a_lens_ends_where_it_folds_over() {
        // d(r − 0.3 r³)/dr = 0 at r = 1.0541, where the distorted radius is 0.7027.
        let barrel = of_radius([-0.3, 0.0, 0.0, 0.0, 0.0, 0.0]);
        assert!(barrel.distort(&Vector2::new(1.054, 0.0)).is_some());
        assert!(barrel.distort(&Vector2::new(0.0, -1.055)).is_none());
        assert!(barrel.distort(&Vector2::new(5.0, 5.0)).is_none());
        assert!(barrel.undistort(&Vector2::new(0.7, 0.0)).is_some());
        assert!(barrel.undistort(&Vector2::new(0.71, 0.0)).is_none());
    }

    #[test]
    fn the_branch_behind_a_fold_is_not_the_lens() {
        // The distorted radius decreases for r² from 1/2 to 1 and increases again beyond.
        let folding = of_radius([-1.0, 0.4, 0.0, 0.0, 0.0, 0.0]);
        assert!(folding.distort(&Vector2::new(0.7, 0.0)).is_some());
        assert!(folding.distort(&Vector2::new(0.8, 0.0)).is_none());
        assert!(folding.distort(&Vector2::new(2.0, 0.0)).is_none());
        assert!(folding.undistort(&Vector2::new(2.0, 0.0)).is_none());
    }

    #[test]
    fn a_lens_ends_at_a_pole() {
        let pole = of_radius([0.0, 0.0, 0.0, -1.0, 0.0, 0.0]);
        assert!(pole.distort(&Vector2::new(0.99, 0.0)).is_some());
        assert!(pole.distort(&Vector2::new(1.01, 0.0)).is_none());
    }

    #[test]
    fn a_fisheye_sees_up_to_a_right_angle() {
        let equidistant = Lens::Fisheye { k: [0.0; 4] };
        let nearly = 1.56_f64;
        let x = equidistant.undistort(&Vector2::new(0.0, nearly)).unwrap();
        assert!((x.y / nearly.tan() - 1.0).abs() < 1e-7);
        assert!(equidistant.undistort(&Vector2::new(1.6, 0.0)).is_none());
    }

    #[test]
    fn what_is_not_a_number_is_nowhere() {
        for lens in [of_radius([-0.1, 0.0, 0.0, 0.0, 0.0, 0.0]), Lens::Fisheye { k: [0.1; 4] }] {
            for x in [[f64::NAN, 0.0], [f64::INFINITY, 0.0]].map(Vector2::from) {
                assert_eq!(lens.undistort(&x), None);
                assert!(lens.distort(&x).is_none_or(|distorted| distorted.iter().all(|v| v.is_finite())));
            }
        }
    }

    fn any_radial_lens() -> impl Strategy<Value = Lens> {
        prop_oneof![
            proptest::array::uniform6(-0.4..0.4).prop_map(of_radius),
            proptest::array::uniform4(-0.1..0.1).prop_map(|k| Lens::Fisheye { k })
        ]
    }

    fn any_lens_with_tangential_terms() -> impl Strategy<Value = Lens> {
        (proptest::array::uniform6(-0.1..0.1), proptest::array::uniform2(-0.01..0.01))
            .prop_map(|(k, p)| Lens::Rational { k, p })
    }

    fn assert_inverts(lens: Lens, x: &Vector2<f64>) -> Result<(), TestCaseError> {
        let Some((distorted, jacobian)) = lens.distort_with_jacobian(x) else { return Ok(()) };
        let back = lens.undistort(&distorted);
        prop_assert!(back.is_some(), "{distorted:?} has an undistorted point");
        let least_stretch = jacobian.singular_values().min();
        prop_assume!(least_stretch > 1e-2);
        prop_assert!((back.unwrap() - x).norm() < 1e-9 / least_stretch, "{x:?} became {back:?}");
        Ok(())
    }

    #[test]
    fn undistortion_inverts_beside_a_pole() {
        let k = [
            0.0,
            0.188_828_491_928_620_33,
            0.229_279_826_400_633_74,
            0.323_882_686_882_979_44,
            -0.193_407_714_584_085_62,
            -0.027_574_733_029_261_29,
        ];
        let lens = Lens::Rational { k, p: [0.0; 2] };
        let x = Vector2::new(-0.961_230_840_911_827_5, 1.308_112_646_785_850_6);
        assert!(lens.distort(&x).unwrap().norm() > 1000.0);
        assert_inverts(lens, &x).unwrap();
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 2000, failure_persistence: None, ..Default::default() })]

        #[test]
        fn undistortion_inverts_radial_distortion(lens in any_radial_lens(), x in -1.5..1.5, y in -1.5..1.5) {
            assert_inverts(lens, &Vector2::new(x, y))?;
        }

        #[test]
        fn undistortion_inverts_tangential_distortion(
            lens in any_lens_with_tangential_terms(), x in -0.9..0.9, y in -0.9..0.9
        ) {
            assert_inverts(lens, &Vector2::new(x, y))?;
        }

        #[test]
        fn the_jacobian_is_the_derivative(
            lens in prop_oneof![any_radial_lens(), any_lens_with_tangential_terms()], x in -0.5..0.5, y in -0.5..0.5
        ) {
            let (x, h) = (Vector2::new(x, y), 1e-6);
            let Some((_, jacobian)) = lens.distort_with_jacobian(&x) else { return Ok(()) };
            for axis in 0..2 {
                let step = Vector2::ith(axis, h);
                let ends = lens.distort(&(x + step)).zip(lens.distort(&(x - step)));
                let Some((after, before)) = ends else { return Ok(()) };
                let difference = (after - before) / (2.0 * h);
                prop_assert!((jacobian.column(axis) - difference).norm() < 1e-7 * jacobian.norm().max(1.0));
            }
        }

        #[test]
        fn positivity_is_that_of_dense_samples(c in proptest::array::uniform6(-2.0..2.0), s in 0.1..2.0) {
            let polynomial = [1.0, c[0], c[1], c[2], c[3], c[4], c[5]];
            let least = (0..=2000)
                .map(|i| value_and_derivative(&polynomial, s * f64::from(i) / 2000.0).0)
                .fold(f64::INFINITY, f64::min);
            prop_assume!(least.abs() > 1e-3);
            prop_assert_eq!(is_positive_up_to(&polynomial, s), least > 0.0);
        }
    }

    #[test]
    fn a_radius_asked_for_once_answers_as_each_point_does() {
        let barrel = Lens::Rational { k: [-0.4, 0.05, 0.0, 0.0, 0.0, 0.0], p: [0.001, 0.0] };
        let wild = Lens::Rational { k: [0.3, -1.2, 0.4, 0.2, -0.6, 0.0], p: [0.0; 2] };
        for lens in [Lens::None, barrel, wild, Lens::Fisheye { k: [-0.3, 0.02, 0.0, 0.0] }] {
            let valid = lens.max_squared_radius(16.0);
            for i in 0..4000 {
                let x = Vector2::new(0.8, -0.6) * (f64::from(i) / 1000.0);
                assert_eq!(lens.distort_within(&x, valid), lens.distort(&x), "{lens:?} at {x}, {valid}");
            }
        }
        assert!(barrel.max_squared_radius(16.0) < 2.0, "the barrel folds over at r = 1.1");
    }
}
