//! Non-decreasing functions, which calibrate a network's confidence to a probability.

use serde::{Deserialize, Serialize};

/// A non-decreasing function: linear between knots `[x, y]`, constant before the first and after the last.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Vec<[f64; 2]>", into = "Vec<[f64; 2]>")]
pub struct MonotoneMap {
    knots: Vec<[f64; 2]>,
}

/// Why knots do not make a non-decreasing function.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum KnotsError {
    /// There are no knots.
    #[error("expected at least one knot [x, y], found none")]
    None,
    /// A number is not finite.
    #[error("expected finite numbers, found the knot [{}, {}]", .0[0], .0[1])]
    NotFinite([f64; 2]),
    /// x does not increase, or y decreases.
    #[error("expected x to grow and y not to fall, found [{}, {}] after [{}, {}]", .after[0], .after[1], .before[0], .before[1])]
    Falling {
        /// A knot.
        before: [f64; 2],
        /// The next one.
        after: [f64; 2],
    },
}

impl MonotoneMap {
    /// The function with these knots.
    ///
    /// # Errors
    /// If there are no knots, or they are not finite or not in order.
    pub fn try_new(knots: Vec<[f64; 2]>) -> Result<Self, KnotsError> {
        if knots.is_empty() {
            return Err(KnotsError::None);
        }
        if let Some(knot) = knots.iter().find(|knot| !knot.iter().all(|value| value.is_finite())) {
            return Err(KnotsError::NotFinite(*knot));
        }
        let falling = knots.windows(2).find(|pair| pair[1][0] <= pair[0][0] || pair[1][1] < pair[0][1]);
        match falling {
            Some(pair) => Err(KnotsError::Falling { before: pair[0], after: pair[1] }),
            None => Ok(Self { knots }),
        }
    }

    /// Fits outcomes `(x, true or false)` by isotonic regression: the value at `x` is the fraction of true outcomes
    /// there, in the least-squares sense among all non-decreasing functions (pool adjacent violators). Outcomes are
    /// first averaged in at most `groups` groups of neighbouring x and equal size. Outcomes whose x is not finite are
    /// ignored; `None` if none is left.
    #[must_use]
    pub fn fit(mut outcomes: Vec<(f32, bool)>, groups: usize) -> Option<Self> {
        outcomes.retain(|(x, _)| x.is_finite());
        outcomes.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        let mut pools: Vec<Pool> = Vec::new();
        for group in outcomes.chunks(outcomes.len().div_ceil(groups.max(1)).max(1)) {
            let mut pool = Pool::of(group);
            while let Some(before) = pools.pop_if(|before| !before.is_below(&pool)) {
                pool = pool.joined(&before);
            }
            pools.push(pool);
        }
        (!pools.is_empty()).then(|| Self { knots: pools.iter().map(Pool::knot).collect() })
    }

    /// The value at `x`; NaN at NaN.
    #[must_use]
    pub fn at(&self, x: f64) -> f64 {
        let next = self.knots.partition_point(|knot| knot[0] < x);
        match (next.checked_sub(1).map(|last| self.knots[last]), self.knots.get(next)) {
            _ if x.is_nan() => x,
            (Some([x0, y0]), Some([x1, y1])) => y0 + (y1 - y0) * (x - x0) / (x1 - x0),
            (Some([_, y]), None) => y,
            (None, _) => self.knots[0][1],
        }
    }
}

/// Neighbouring outcomes that share one fitted value: the sum of their x, and the counts of true ones and of all.
struct Pool {
    x: f64,
    right: f64,
    count: f64,
}

impl Pool {
    fn of(outcomes: &[(f32, bool)]) -> Self {
        Self {
            x: outcomes.iter().map(|(x, _)| f64::from(*x)).sum(),
            right: outcomes.iter().filter(|(_, right)| *right).count() as f64,
            count: outcomes.len() as f64,
        }
    }

    /// Whether it is before `other` and has a smaller value.
    fn is_below(&self, other: &Self) -> bool {
        let ([x0, y0], [x1, y1]) = (self.knot(), other.knot());
        x0 < x1 && y0 < y1
    }

    fn joined(&self, other: &Self) -> Self {
        Self { x: self.x + other.x, right: self.right + other.right, count: self.count + other.count }
    }

    fn knot(&self) -> [f64; 2] {
        [self.x / self.count, self.right / self.count]
    }
}

impl TryFrom<Vec<[f64; 2]>> for MonotoneMap {
    type Error = KnotsError;

    fn try_from(knots: Vec<[f64; 2]>) -> Result<Self, KnotsError> {
        Self::try_new(knots)
    }
}

impl From<MonotoneMap> for Vec<[f64; 2]> {
    fn from(map: MonotoneMap) -> Self {
        map.knots
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_linear_between_knots_and_constant_beyond() {
        let map = MonotoneMap::try_new(vec![[0.2, 0.1], [0.4, 0.5], [0.8, 0.5]]).unwrap();
        let values = [0.0, 0.2, 0.3, 0.4, 0.6, 0.8, 1.0].map(|x| map.at(x));
        for (value, expected) in values.into_iter().zip([0.1, 0.1, 0.3, 0.5, 0.5, 0.5, 0.5]) {
            assert!((value - expected).abs() < 1e-12, "{values:?}");
        }
        assert!(map.at(f64::NAN).is_nan());
    }

    #[test]
    fn knots_out_of_order_are_refused() {
        assert_eq!(MonotoneMap::try_new(vec![]), Err(KnotsError::None));
        for knots in [vec![[0.0, 1.0], [1.0, 0.5]], vec![[0.5, 0.0], [0.5, 1.0]], vec![[0.0, f64::NAN]]] {
            let json = serde_json::to_string(&knots).unwrap();
            assert!(MonotoneMap::try_new(knots).is_err());
            assert!(serde_json::from_str::<MonotoneMap>(&json).is_err());
        }
    }

    /// The least squared error of any non-decreasing function on a fine grid of values, by dynamic programming.
    fn brute_force(shares: &[f64]) -> f64 {
        const STEPS: usize = 60;
        let mut best = vec![0.0; STEPS + 1];
        for share in shares {
            let mut least = f64::INFINITY;
            for (step, sum) in best.iter_mut().enumerate() {
                least = least.min(*sum);
                *sum = least + (step as f64 / STEPS as f64 - share).powi(2);
            }
        }
        best.into_iter().fold(f64::INFINITY, f64::min)
    }

    #[test]
    fn no_function_that_never_falls_fits_better() {
        // Five groups of four outcomes with shares 1/4, 3/4, 2/4, 1/4, 1: the middle three are pooled.
        let shares: [f64; 5] = [0.25, 0.75, 0.5, 0.25, 1.0];
        let outcomes = (0..20).map(|i| (i as f32, i % 4 < (4.0 * shares[i / 4]) as usize)).collect();
        let map = MonotoneMap::fit(outcomes, 5).unwrap();
        assert_eq!(Vec::from(map), [[1.5, 0.25], [9.5, 0.5], [17.5, 1.0]]);
        let fitted: [f64; 5] = [0.25, 0.5, 0.5, 0.5, 1.0];
        let error: f64 = shares.iter().zip(fitted).map(|(share, value)| (share - value).powi(2)).sum();
        assert!(error <= brute_force(&shares) + 1e-12);
        assert_eq!(MonotoneMap::fit(vec![(f32::NAN, true)], 5), None);
    }

    #[test]
    fn outcomes_of_a_known_probability_give_it_back() {
        // True with probability x²: of the 100 outcomes at each x, those with k + 0.5 < 100 x² are true.
        let outcomes = (0..=1000).flat_map(|i| {
            let x = i as f32 / 1000.0;
            (0..100).map(move |k| (x, (k as f32 + 0.5) < 100.0 * x * x))
        });
        let map = MonotoneMap::fit(outcomes.collect(), 64).unwrap();
        for x in [0.1, 0.35, 0.6, 0.9] {
            assert!((map.at(x) - x * x).abs() < 0.01, "{x}: {}", map.at(x));
        }
    }
}
