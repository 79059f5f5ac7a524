//! Samples in their order, read ahead by a thread of its own.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, sync_channel};
use std::thread;

use crate::options::SampleOptions;
use crate::sample::{Sample, draw};
use crate::{Dataset, TrainError};

/// Samples that wait at most.
const AHEAD: usize = 4;

/// Samples `first, first + 1, …` of a run.
pub struct Loader {
    samples: Receiver<Result<Sample, TrainError>>,
}

impl Loader {
    /// Begins to read.
    #[must_use]
    pub fn new(dataset: Arc<Dataset>, options: SampleOptions, seed: u64, first: u64) -> Self {
        let (sender, samples) = sync_channel(AHEAD);
        thread::spawn(move || {
            for number in first.. {
                let sample = draw(&dataset, &options, seed, number);
                // The receiver is gone when training has ended.
                if sender.send(sample).is_err() {
                    return;
                }
            }
        });
        Self { samples }
    }

    /// The next sample.
    ///
    /// # Errors
    /// If it could not be read.
    pub fn next_sample(&self) -> Result<Sample, TrainError> {
        self.samples.recv().expect("the thread sends as long as someone listens")
    }
}
