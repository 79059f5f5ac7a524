//! The depth maps of an output folder.

use std::path::Path;

use anyhow::Result;
use vamvs_core::depth_map::is_valid;
use vamvs_core::{Grid, Size};
use vamvs_fusion::FuseOptions;
use vamvs_io::pfm;

/// What `vamvs` estimated for a view.
pub struct Map {
    /// Depth; 0 where there is none.
    pub depth: Grid<f32>,
    /// Confidence of the depth, 0 to 1.
    pub confidence: Grid<f32>,
    /// Confidence of the coarse stage, 0 to 1.
    coarse_confidence: Grid<f32>,
}

impl Map {
    /// Reads the maps of the view `name` from the output folder `out`.
    pub fn read(out: &Path, name: &str) -> Result<Self> {
        let confidence = out.join("confidence");
        Ok(Self {
            depth: pfm::read_depth(&out.join("depths").join(format!("{name}.pfm")))?,
            confidence: pfm::read(&confidence.join(format!("{name}.pfm")))?,
            coarse_confidence: pfm::read(&confidence.join(format!("{name}.coarse.pfm")))?,
        })
    }

    /// The depths that the default thresholds of fusion call confident.
    pub fn confident(&self) -> Grid<f32> {
        let limits = FuseOptions::default();
        let mut depth = self.depth.clone();
        let confidences = self.confidence.data().iter().zip(self.coarse_confidence.data());
        for (depth, (fine, coarse)) in depth.data_mut().iter_mut().zip(confidences) {
            if *fine < limits.min_confidence || *coarse < limits.min_coarse_confidence {
                *depth = 0.0;
            }
        }
        depth
    }
}

/// Maps of the same width under each other, to be judged as one.
pub fn stacked<'a>(maps: impl IntoIterator<Item = &'a Grid<f32>>) -> Grid<f32> {
    let maps: Vec<_> = maps.into_iter().collect();
    let width = maps.first().map_or(0, |map| map.width());
    let height = maps.iter().map(|map| map.height()).sum();
    let values = maps.iter().flat_map(|map| map.data()).copied().collect();
    Grid::from_vec(Size::new(width, height), values)
}

/// The depths that there are.
pub fn valid(depth: &Grid<f32>) -> Grid<Option<f32>> {
    depth.map(|&depth| is_valid(depth).then_some(depth))
}

/// |depth − true| / true where there are both.
pub fn relative_errors(depth: &Grid<f32>, truth: &Grid<f32>) -> Grid<Option<f32>> {
    let mut truth = truth.data().iter();
    depth.map(|&depth| {
        let truth = *truth.next()?;
        (is_valid(depth) && is_valid(truth)).then(|| (depth - truth).abs() / truth)
    })
}

/// The values between which all but one percent at either side are, `(low, high)`.
pub fn spread(values: &Grid<Option<f32>>) -> (f32, f32) {
    let mut values: Vec<f32> = values.data().iter().copied().flatten().collect();
    values.sort_unstable_by(f32::total_cmp);
    let at = |share: f64| values.get((share * values.len().saturating_sub(1) as f64) as usize).copied();
    match (at(0.01), at(0.99)) {
        (Some(low), Some(high)) if low < high => (low, high),
        (Some(low), _) => (low, low + 1.0),
        _ => (0.0, 1.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_where_both_depths_are() {
        let grid = |values: &[f32]| Grid::from_vec(Size::new(values.len(), 1), values.to_vec());
        let errors = relative_errors(&grid(&[1.5, 0.0, 2.0, 2.0]), &grid(&[2.0, 2.0, 0.0, 2.0]));
        assert_eq!(errors.data(), [Some(0.25), None, None, Some(0.0)]);
    }

    #[test]
    fn spread_leaves_out_the_extremes() {
        let values = Grid::from_fn(Size::new(1001, 1), |x, _| (x != 500).then_some(x as f32));
        assert_eq!(spread(&values), (9.0, 990.0));
        assert_eq!(spread(&Grid::filled(Size::new(2, 2), None)), (0.0, 1.0));
    }
}
