//! Fused points with the views that agree on them.

use serde::{Deserialize, Serialize};
use vamvs_core::CloudPoint;

/// Views that agree on a point, about: what is reserved for them.
pub(crate) const USUAL_VIEWS: usize = 8;

/// Points, each with the numbers of the views that agree on it; the view that made it comes first.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FusedPoints {
    points: Vec<CloudPoint>,
    /// The views of all points, one after the other.
    views: Vec<u32>,
    /// For each point where its views end.
    ends: Vec<usize>,
}

impl FusedPoints {
    /// The points.
    #[must_use]
    pub fn points(&self) -> &[CloudPoint] {
        &self.points
    }

    /// The points with the views that agree on each.
    pub fn iter(&self) -> impl Iterator<Item = (&CloudPoint, &[u32])> {
        let starts = std::iter::once(&0).chain(&self.ends);
        let views = starts.zip(&self.ends).map(|(&start, &end)| &self.views[start..end]);
        self.points.iter().zip(views)
    }

    pub(crate) fn push(&mut self, point: CloudPoint, views: impl Iterator<Item = u32>) {
        self.points.push(point);
        self.views.extend(views);
        self.ends.push(self.views.len());
    }

    /// No points yet, with room for so many.
    pub(crate) fn with_room(points: usize) -> Self {
        let views = Vec::with_capacity(USUAL_VIEWS * points);
        Self { points: Vec::with_capacity(points), views, ends: Vec::with_capacity(points) }
    }

    /// All points of `parts`, in this order.
    pub(crate) fn joined(parts: &[Self]) -> Self {
        let count = |of: fn(&Self) -> usize| parts.iter().map(of).sum();
        let mut all = Self {
            points: Vec::with_capacity(count(|part| part.points.len())),
            views: Vec::with_capacity(count(|part| part.views.len())),
            ends: Vec::with_capacity(count(|part| part.ends.len())),
        };
        parts.iter().for_each(|part| all.append(part));
        all
    }

    pub(crate) fn append(&mut self, other: &Self) {
        let offset = self.views.len();
        self.points.extend_from_slice(&other.points);
        self.views.extend_from_slice(&other.views);
        self.ends.extend(other.ends.iter().map(|end| end + offset));
    }
}
