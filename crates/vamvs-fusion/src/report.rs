//! What became of each pixel.

use std::fmt;
use std::iter::Sum;
use std::ops::AddAssign;

use serde::{Deserialize, Serialize};

/// What became of the pixels of a view, or of several. Each pixel is counted in exactly one field
/// beside `pixels`, the first that fits in the order here.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ViewReport {
    /// All pixels.
    pub pixels: u64,
    /// Had no valid depth, as pixels that were masked when the depth map was made.
    pub without_depth: u64,
    /// Were masked out in fusion.
    pub masked: u64,
    /// Were not confident enough (photometric filter).
    pub unconfident: u64,
    /// Lay outside of the region of interest.
    pub outside_roi: u64,
    /// Found too few views that agree (geometric filter).
    pub inconsistent: u64,
    /// Were merged into the point of another view.
    pub merged: u64,
    /// Became a point.
    pub points: u64,
}

/// What became of all pixels.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct FuseReport {
    /// For each view.
    pub views: Vec<ViewReport>,
    /// The most memory that depth maps and bits took at any time, bytes.
    pub memory: u64,
}

impl FuseReport {
    /// The sum over all views.
    #[must_use]
    pub fn total(&self) -> ViewReport {
        self.views.iter().copied().sum()
    }
}

impl Sum for ViewReport {
    fn sum<I: Iterator<Item = Self>>(reports: I) -> Self {
        reports.fold(Self::default(), |mut total, report| {
            total += report;
            total
        })
    }
}

impl ViewReport {
    /// The outcomes in words with their counts, in the order of the filters.
    #[must_use]
    pub fn outcomes(&self) -> [(&'static str, u64); 7] {
        [
            ("without depth, as where it was masked before", self.without_depth),
            ("masked in fusion", self.masked),
            ("not confident", self.unconfident),
            ("outside of the region of interest", self.outside_roi),
            ("inconsistent with other views", self.inconsistent),
            ("merged into another view's point", self.merged),
            ("became a point", self.points),
        ]
    }

    /// The share of pixels that passed all filters, 0 to 1.
    #[must_use]
    pub fn kept(&self) -> f64 {
        (self.merged + self.points) as f64 / self.pixels.max(1) as f64
    }
}

impl AddAssign for ViewReport {
    fn add_assign(&mut self, other: Self) {
        self.pixels += other.pixels;
        self.without_depth += other.without_depth;
        self.masked += other.masked;
        self.unconfident += other.unconfident;
        self.outside_roi += other.outside_roi;
        self.inconsistent += other.inconsistent;
        self.merged += other.merged;
        self.points += other.points;
    }
}

impl fmt::Display for ViewReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} points from {} pixels ({} without depth or masked, {} not confident, {} outside of the \
             region, {} inconsistent with other views, {} merged)",
            self.points,
            self.pixels,
            self.without_depth + self.masked,
            self.unconfident,
            self.outside_roi,
            self.inconsistent,
            self.merged
        )
    }
}
