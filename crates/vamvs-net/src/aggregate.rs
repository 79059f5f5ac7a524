//! Multi-view feature aggregation (section 3.1, figure 3): reduces the features of any number of views to one.
//!
//! Views are added one after the other, so memory does not grow with their number.

use serde::{Deserialize, Serialize};
use tch::{TchError, Tensor};

/// The six aggregations of figure 3, and group-wise correlation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Aggregation {
    /// Mean over all views.
    Avg,
    /// Maximum over all views, channel by channel.
    Max,
    /// Variance over all views.
    Var,
    /// Mean over the source views of learned features of the pair (reference, source).
    VisAvg,
    /// Maximum over the source views of learned features of the pair (reference, source).
    VisMax,
    /// Variance over all views, each source view weighted by its learned visibility.
    VisVar,
    /// Mean over the source views of their group-wise correlation with the reference view, each weighted by its
    /// learned visibility; not in the paper.
    VisCorr,
}

impl Aggregation {
    /// Whether learned features of the pair (reference, source) are aggregated instead of the views' own. Excludes
    /// [`Aggregation::weighs_views`]: these features are reduced without masks.
    #[must_use]
    pub fn relates_pairs(self) -> bool {
        matches!(self, Self::VisAvg | Self::VisMax)
    }

    /// Whether source views are weighted by learned visibility masks.
    #[must_use]
    pub fn weighs_views(self) -> bool {
        matches!(self, Self::VisVar | Self::VisCorr)
    }

    /// Whether source views are compared with the reference view by correlation. Photographs are then never enlarged. Needs
    /// [`Aggregation::weighs_views`]: the masks are made of the correlations.
    #[must_use]
    pub fn correlates(self) -> bool {
        matches!(self, Self::VisCorr)
    }

    /// Whether depth maps are refined by flow iterations.
    #[must_use]
    pub fn has_flow(self) -> bool {
        !self.correlates()
    }

    /// An empty reducer for this aggregation.
    #[must_use]
    pub fn reducer(self) -> Reducer {
        match self {
            Self::Avg | Self::VisAvg => Reducer::Mean { sum: None, count: 0 },
            Self::Max | Self::VisMax => Reducer::Max(None),
            Self::Var => Reducer::Variance { moments: None, weight: Weight::Count(0) },
            Self::VisVar => Reducer::Variance { moments: None, weight: Weight::Mask(None) },
            Self::VisCorr => Reducer::WeightedMean { sum: None, weight: None },
        }
    }
}

/// ε, which keeps the weighted mean finite where the visibility is 0 in all views.
pub(crate) const UNSEEN: f64 = 1e-3;

/// A running reduction over views: of features F with visibility V, for n views.
#[derive(Debug)]
pub enum Reducer {
    /// Σ F / n.
    Mean {
        /// Σ F.
        sum: Option<Tensor>,
        /// n.
        count: usize,
    },
    /// Σ V F / (Σ V + ε).
    WeightedMean {
        /// Σ V F.
        sum: Option<Tensor>,
        /// Σ V.
        weight: Option<Tensor>,
    },
    /// max F.
    Max(Option<Tensor>),
    /// Σ V F² / Σ V − (Σ V F / Σ V)².
    Variance {
        /// Σ V F and Σ V F².
        moments: Option<(Tensor, Tensor)>,
        /// Σ V.
        weight: Weight,
    },
}

/// The sum of the views' weights, Σ V.
#[derive(Debug)]
pub enum Weight {
    /// All weights are 1.
    Count(usize),
    /// The sum of the views' visibility masks.
    Mask(Option<Tensor>),
}

impl Reducer {
    /// Adds a view's features. `visibility` is broadcast over channels and planes. Only the weighted mean and the
    /// weighted variance use it; `None` stands for 1.
    ///
    /// # Errors
    /// If shapes differ from those of the views before, or memory runs out.
    pub fn add(&mut self, features: &Tensor, visibility: Option<&Tensor>) -> Result<(), TchError> {
        match self {
            Self::Mean { sum, count } => {
                *count += 1;
                accumulate(sum, features)
            }
            Self::WeightedMean { sum, weight } => {
                let one =
                    || features.f_new_ones(vec![1; features.dim()], (features.kind(), features.device()));
                let visibility = visibility.map_or_else(one, |seen| Ok(seen.shallow_clone()))?;
                accumulate(weight, &visibility)?;
                accumulate(sum, &features.f_mul(&visibility)?)
            }
            Self::Max(largest) => {
                *largest = Some(match largest {
                    Some(largest) => largest.f_maximum(features)?,
                    None => features.shallow_clone(),
                });
                Ok(())
            }
            Self::Variance { moments, weight } => {
                let weighted = match (&mut *weight, visibility) {
                    (Weight::Count(count), _) => {
                        *count += 1;
                        features.shallow_clone()
                    }
                    (Weight::Mask(total), Some(visibility)) => {
                        accumulate(total, visibility)?;
                        features.f_mul(visibility)?
                    }
                    (Weight::Mask(total), None) => {
                        let one = features
                            .f_new_ones(vec![1; features.dim()], (features.kind(), features.device()))?;
                        accumulate(total, &one)?;
                        features.shallow_clone()
                    }
                };
                *moments = Some(match moments.take() {
                    Some((sum, mut squares)) => {
                        (sum.f_add(&weighted)?, squares.f_addcmul_(&weighted, features)?)
                    }
                    None => (weighted.shallow_clone(), weighted.f_mul(features)?),
                });
                Ok(())
            }
        }
    }

    /// The aggregated features, or `None` if no view was added.
    ///
    /// # Errors
    /// If memory runs out.
    pub fn finish(self) -> Result<Option<Tensor>, TchError> {
        match self {
            Self::Mean { sum, count } => sum.map(|sum| sum.f_div_scalar(count as f64)).transpose(),
            Self::WeightedMean { sum, weight } => {
                let mean = sum.zip(weight).map(|(sum, weight)| sum.f_div(&weight.f_add_scalar(UNSEEN)?));
                mean.transpose()
            }
            Self::Max(largest) => Ok(largest),
            Self::Variance { moments: None, .. } => Ok(None),
            Self::Variance { moments: Some((sum, squares)), weight } => {
                let (mean, mean_square) = match weight {
                    Weight::Mask(Some(total)) => (sum.f_div(&total)?, squares.f_div(&total)?),
                    Weight::Mask(None) => (sum, squares),
                    Weight::Count(count) => {
                        (sum.f_div_scalar(count as f64)?, squares.f_div_scalar(count as f64)?)
                    }
                };
                Ok(Some(mean_square.f_sub(&mean.f_square()?)?))
            }
        }
    }
}

/// Adds a term to a running sum that begins empty.
fn accumulate(sum: &mut Option<Tensor>, term: &Tensor) -> Result<(), TchError> {
    *sum = Some(match sum.take() {
        Some(sum) => sum.f_add(term)?,
        None => term.shallow_clone(),
    });
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use tch::{Device, Kind};

    fn views(count: usize) -> Vec<Tensor> {
        tch::manual_seed(3);
        (0..count).map(|_| Tensor::randn([2, 3, 4, 5], (Kind::Double, Device::Cpu))).collect()
    }

    fn reduce(aggregation: Aggregation, views: &[Tensor], masks: Option<&[Tensor]>) -> Tensor {
        let mut reducer = aggregation.reducer();
        for (i, view) in views.iter().enumerate() {
            let mask = masks.and_then(|masks| (i > 0).then(|| &masks[i - 1]));
            reducer.add(view, mask).unwrap();
        }
        reducer.finish().unwrap().unwrap()
    }

    #[test]
    fn pair_features_have_no_masks_and_correlations_do() {
        use Aggregation::{Avg, Max, Var, VisAvg, VisCorr, VisMax, VisVar};
        for aggregation in [Avg, Max, Var, VisAvg, VisMax, VisVar, VisCorr] {
            assert!(!(aggregation.relates_pairs() && aggregation.weighs_views()), "{aggregation:?}");
            assert!(!aggregation.correlates() || aggregation.weighs_views(), "{aggregation:?}");
        }
    }

    fn assert_close(a: &Tensor, b: &Tensor) {
        assert!(a.allclose(b, 1e-12, 1e-12, false), "{} apart", f64::try_from((a - b).abs().max()).unwrap());
    }

    #[test]
    fn streams_equal_the_closed_forms() {
        let views = views(5);
        let stack = Tensor::stack(&views, 0);
        assert_close(&reduce(Aggregation::Avg, &views, None), &stack.mean_dim(0, false, Kind::Double));
        assert_close(&reduce(Aggregation::VisMax, &views, None), &stack.amax(0, false));
        assert_close(&reduce(Aggregation::Var, &views, None), &stack.var_dim(0, false, false));
    }

    #[test]
    fn weights_of_one_make_the_weighted_variance_the_plain_one_and_zero_drops_a_view() {
        let views = views(4);
        let ones: Vec<_> = (0..3).map(|_| Tensor::ones([1, 1, 4, 5], (Kind::Double, Device::Cpu))).collect();
        let plain = reduce(Aggregation::Var, &views, None);
        assert_close(&reduce(Aggregation::VisVar, &views, Some(&ones)), &plain);
        let masks = [ones[0].shallow_clone(), ones[1].shallow_clone(), ones[2].zeros_like()];
        let without_last = reduce(Aggregation::Var, &views[..3], None);
        assert_close(&reduce(Aggregation::VisVar, &views, Some(&masks)), &without_last);
    }

    #[test]
    fn the_order_of_views_does_not_matter() {
        let views = views(5);
        let reversed: Vec<_> = views.iter().rev().map(Tensor::shallow_clone).collect();
        for aggregation in [Aggregation::Avg, Aggregation::Max, Aggregation::Var] {
            assert_close(&reduce(aggregation, &views, None), &reduce(aggregation, &reversed, None));
        }
    }
}
