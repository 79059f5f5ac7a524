//! Weighted least-squares fits of planes to inverse depths, from sums that can be added up.

/// Weighted sums over pixels at (x, y) with inverse depth w.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Sums {
    /// Number of pixels.
    pub count: f64,
    /// Sum of the weights, 1 over the variances.
    pub weight: f64,
    x: f64,
    y: f64,
    w: f64,
    xx: f64,
    xy: f64,
    yy: f64,
    xw: f64,
    yw: f64,
    ww: f64,
    step: f64,
}

/// A plane fitted to pixels.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PlaneFit {
    /// Weighted means of x, y and w.
    mean: [f64; 3],
    /// Change of inverse depth per pixel.
    pub gx: f64,
    pub gy: f64,
    /// Weighted covariance of the places: xx, xy, yy.
    covariance: [f64; 3],
    determinant: f64,
}

impl Sums {
    /// Adds a pixel; `step` is the change of inverse depth that is one pixel of disparity.
    pub fn add(&mut self, [x, y]: [f64; 2], w: f64, weight: f64, step: f64) {
        *self = self.plus(&Self {
            count: 1.0,
            weight,
            x: weight * x,
            y: weight * y,
            w: weight * w,
            xx: weight * x * x,
            xy: weight * x * y,
            yy: weight * y * y,
            xw: weight * x * w,
            yw: weight * y * w,
            ww: weight * w * w,
            step: weight * step,
        });
    }

    /// The sums over the pixels of both.
    pub fn plus(&self, other: &Self) -> Self {
        Self {
            count: self.count + other.count,
            weight: self.weight + other.weight,
            x: self.x + other.x,
            y: self.y + other.y,
            w: self.w + other.w,
            xx: self.xx + other.xx,
            xy: self.xy + other.xy,
            yy: self.yy + other.yy,
            xw: self.xw + other.xw,
            yw: self.yw + other.yw,
            ww: self.ww + other.ww,
            step: self.step + other.step,
        }
    }

    /// The weighted mean of the steps.
    pub fn step(&self) -> f64 {
        self.step / self.weight
    }

    /// The plane with the smallest weighted squares of residuals.
    pub fn fit(&self) -> PlaneFit {
        let per = 1.0 / self.weight;
        let mean @ [x, y, w] = [self.x * per, self.y * per, self.w * per];
        // A pixel is an area, whose own variance keeps the matrix regular.
        let covariance @ [xx, xy, yy] =
            [self.xx * per - x * x + 1.0, self.xy * per - x * y, self.yy * per - y * y + 1.0];
        let (xw, yw) = (self.xw * per - x * w, self.yw * per - y * w);
        let determinant = xx * yy - xy * xy;
        let (gx, gy) = ((yy * xw - xy * yw) / determinant, (xx * yw - xy * xw) / determinant);
        PlaneFit { mean, gx, gy, covariance, determinant }
    }

    /// The weighted sum of the squared residuals of a plane.
    pub fn residual(&self, plane: &PlaneFit) -> f64 {
        let PlaneFit { gx, gy, .. } = *plane;
        let at_origin = plane.at([0.0, 0.0]);
        let squares = self.ww + gx * gx * self.xx + gy * gy * self.yy + at_origin * at_origin * self.weight;
        let with_w = gx * self.xw + gy * self.yw + at_origin * self.w;
        let mixed = gx * gy * self.xy + at_origin * (gx * self.x + gy * self.y);
        (squares + 2.0 * (mixed - with_w)).max(0.0)
    }
}

impl PlaneFit {
    /// The inverse depth at a pixel.
    pub fn at(&self, [x, y]: [f64; 2]) -> f64 {
        self.mean[2] + self.gx * (x - self.mean[0]) + self.gy * (y - self.mean[1])
    }

    /// By how much the fit is less certain at a pixel than at the pixels' mean: the ratio of the variances.
    pub fn spread(&self, [x, y]: [f64; 2]) -> f64 {
        let [xx, xy, yy] = self.covariance;
        let (dx, dy) = (x - self.mean[0], y - self.mean[1]);
        1.0 + (yy * dx * dx - 2.0 * xy * dx * dy + xx * dy * dy) / self.determinant
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(pixels: &[([f64; 2], f64, f64)]) -> Sums {
        let mut sums = Sums::default();
        pixels.iter().for_each(|&(place, w, weight)| sums.add(place, w, weight, 0.01));
        sums
    }

    /// A plane with an error of `noise` in turn up and down.
    fn pixels(noise: f64) -> Vec<([f64; 2], f64, f64)> {
        let pixel = |at: usize| {
            let (x, y) = ((300 + at % 40) as f64, (200 + at / 40) as f64);
            let sign = if (at % 40 + at / 40).is_multiple_of(2) { 1.0 } else { -1.0 };
            ([x, y], 0.5 + 2e-3 * x - 1e-3 * y + sign * noise, 1.0 + (at % 3) as f64)
        };
        (0..1600).map(pixel).collect()
    }

    #[test]
    fn a_plane_is_found_and_its_residuals_are_those_of_its_pixels() {
        let (exact, noisy) = (of(&pixels(0.0)), of(&pixels(0.01)));
        let plane = exact.fit();
        assert!((plane.gx / 2e-3 - 1.0).abs() < 0.01 && (plane.gy / -1e-3 - 1.0).abs() < 0.01);
        assert!((plane.at([310.0, 230.0]) - (0.5 + 0.62 - 0.23)).abs() < 1e-3);
        let fit = noisy.fit();
        let direct: f64 =
            pixels(0.01).iter().map(|(place, w, weight)| weight * (w - fit.at(*place)).powi(2)).sum();
        assert!((noisy.residual(&fit) / direct - 1.0).abs() < 1e-6);
        assert!((noisy.step() - 0.01).abs() < 1e-12);
    }

    #[test]
    fn sums_of_parts_are_the_sums_of_the_whole() {
        let all = pixels(0.01);
        let (whole, parts) = (of(&all), of(&all[..700]).plus(&of(&all[700..])));
        assert!((whole.fit().at([0.0, 0.0]) - parts.fit().at([0.0, 0.0])).abs() < 1e-9);
        assert_eq!((whole.count, parts.count), (1600.0, 1600.0));
    }

    #[test]
    fn a_fit_is_less_certain_away_from_its_pixels() {
        let fit = of(&pixels(0.0)).fit();
        assert!(fit.spread([319.5, 219.5]) < 1.01);
        assert!(fit.spread([339.0, 219.5]) > 3.0 && fit.spread([500.0, 219.5]) > 100.0);
    }
}
