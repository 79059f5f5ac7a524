//! Timing of the stages of a depth map.

use std::time::{Duration, Instant};

use crate::device::{Device, synchronize};

/// The stages of a depth map, in the order in which data flows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Image features.
    Encode,
    /// Warping and aggregation of the cost volume.
    Sweep,
    /// Cost-volume regularisation, coarse depth, and depth completion on textureless surfaces.
    Regularize,
    /// Fetching and aggregation of point features.
    Fetch,
    /// Search of the points' nearest neighbours.
    Neighbours,
    /// Edge convolutions and flow, and joint bilateral upsampling.
    Flow,
}

impl Stage {
    /// All stages in order.
    pub const ALL: [Self; 6] =
        [Self::Encode, Self::Sweep, Self::Regularize, Self::Fetch, Self::Neighbours, Self::Flow];
}

/// Wall-clock time by stage. A GPU works while the processor goes on: its stages end when it has done what they gave it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Profile {
    device: Device,
    spent: [Duration; Stage::ALL.len()],
}

impl Default for Profile {
    fn default() -> Self {
        Self::on(Device::Cpu)
    }
}

impl Profile {
    /// No time yet, of stages on a device.
    #[must_use]
    pub fn on(device: Device) -> Self {
        Self { device, spent: [Duration::ZERO; Stage::ALL.len()] }
    }

    /// Runs `work` and adds its time to `stage`.
    pub fn time<T>(&mut self, stage: Stage, work: impl FnOnce() -> T) -> T {
        let begin = Instant::now();
        let result = work();
        synchronize(self.device);
        self.spent[stage as usize] += begin.elapsed();
        result
    }

    /// Time spent in a stage.
    #[must_use]
    pub fn spent(&self, stage: Stage) -> Duration {
        self.spent[stage as usize]
    }

    /// Adds another profile's times.
    pub fn add(&mut self, other: &Self) {
        for (mine, theirs) in self.spent.iter_mut().zip(other.spent) {
            *mine += theirs;
        }
    }

    /// Time over all stages.
    #[must_use]
    pub fn total(&self) -> Duration {
        self.spent.iter().sum()
    }
}
