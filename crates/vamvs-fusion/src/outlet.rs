//! Where points go while the next ones are made.

use crate::collector::Batch;
use crate::{FuseError, FusedPoints};

/// Takes the points of views, in the order in which they are made.
pub(crate) type Take<'a> = dyn FnMut(Batch) -> Result<(), FuseError> + 'a;

/// Holds one batch of points back, so that it is handed on while the next one is made.
pub(crate) struct Outlet<'a, 's> {
    take: &'a mut Take<'s>,
    pending: Option<Pending>,
}

/// A batch whose rows are not joined yet.
pub(crate) struct Pending {
    pub view: usize,
    /// The points of each row of pixels.
    pub rows: Vec<FusedPoints>,
    pub is_last: bool,
}

impl<'a, 's> Outlet<'a, 's> {
    pub fn new(take: &'a mut Take<'s>) -> Self {
        Self { take, pending: None }
    }

    /// Holds a batch, which the next [`Outlet::flush`] hands on.
    pub fn hold(&mut self, batch: Pending) {
        self.pending = Some(batch);
    }

    /// Hands on what is held.
    pub fn flush(&mut self) -> Result<(), FuseError> {
        let Some(Pending { view, rows, is_last }) = self.pending.take() else { return Ok(()) };
        (self.take)(Batch { view, points: FusedPoints::joined(&rows), is_last })
    }
}
