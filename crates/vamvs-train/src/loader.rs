//! Reads samples ahead in a thread, in the order of their numbers.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, sync_channel};
use std::thread;

use crate::options::SampleOptions;
use crate::sample::{Sample, draw};
use crate::{Dataset, TrainError};

/// The most samples that wait to be used.
const AHEAD: usize = 4;

/// Samples `first, first + 1, …` of a run.
pub struct Loader {
    samples: Receiver<Result<Sample, TrainError>>,
}

impl Loader {
    /// Starts a thread that reads samples from number `first` on.
    #[must_use]
    pub fn new(
        dataset: Arc<Dataset>,
        (options, plane_step): (SampleOptions, f64),
        seed: u64,
        first: u64,
    ) -> Self {
        Self::of(first, move |number| draw(&dataset, (&options, plane_step), seed, number))
    }

    /// Starts a thread that draws samples by their numbers until `draw` panics; the panic becomes the last sample's
    /// error.
    fn of(first: u64, draw: impl Fn(u64) -> Result<Sample, TrainError> + Send + 'static) -> Self {
        let (sender, samples) = sync_channel(AHEAD);
        thread::spawn(move || {
            for number in first.. {
                let caught = catch_unwind(AssertUnwindSafe(|| draw(number)));
                let ends = caught.is_err();
                let sample = caught.unwrap_or_else(|panic| Err(panicked(number, panic.as_ref())));
                // Sending fails when training has ended and the receiver was dropped.
                if sender.send(sample).is_err() || ends {
                    return;
                }
            }
        });
        Self { samples }
    }

    /// The next sample.
    ///
    /// # Errors
    /// If the sample could not be read, or the thread that reads samples has panicked.
    pub fn next_sample(&self) -> Result<Sample, TrainError> {
        let ended = |_| Err(TrainError::Loader("the thread that reads samples has ended".to_owned()));
        self.samples.recv().unwrap_or_else(ended)
    }
}

fn panicked(number: u64, panic: &(dyn Any + Send)) -> TrainError {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    let text = text.or(panic.downcast_ref::<&str>().copied()).unwrap_or("no message");
    TrainError::Loader(format!("reading sample {number} panicked: {text}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_of_the_thread_is_an_error_with_the_sample_and_the_reason() {
        let option = || TrainError::option("views", "at least 2", &1);
        let loader = Loader::of(6, move |number| match number {
            6 => Err(option()),
            _ => panic!("index {number} out of range"),
        });
        let next = || loader.next_sample().map(drop).unwrap_err().to_string();
        assert!(next().contains("views must be at least 2"));
        let reason = next();
        assert!(reason.contains("sample 7 panicked: index 7 out of range"), "{reason}");
        assert!(next().contains("has ended"));
    }
}
