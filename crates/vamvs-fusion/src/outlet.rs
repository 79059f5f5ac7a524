//! Where points go while the next ones are made.

use crate::FuseError;
use crate::collector::Batch;

/// Takes the points of views, in the order in which they are made.
pub(crate) type Take<'a> = dyn FnMut(Batch) -> Result<(), FuseError> + 'a;

/// Holds one batch of points back, so that it is handed on while the next one is made.
pub(crate) struct Outlet<'a, 's> {
    take: &'a mut Take<'s>,
    pending: Option<Batch>,
}

impl<'a, 's> Outlet<'a, 's> {
    pub fn new(take: &'a mut Take<'s>) -> Self {
        Self { take, pending: None }
    }

    /// Holds a batch, which the next [`Outlet::flush`] hands on.
    pub fn hold(&mut self, batch: Batch) {
        self.pending = Some(batch);
    }

    /// Hands on what is held.
    pub fn flush(&mut self) -> Result<(), FuseError> {
        self.pending.take().map_or(Ok(()), &mut *self.take)
    }
}
