//! A cost volume that is regularised without ever being whole.
//!
//! The volume of vis-max has 65 channels, the first layers of what regularises it have 8 and 16. Planes therefore go
//! through these layers a few at a time, as the sweep makes them; what is kept is a sixth of the volume.

use tch::{TchError, Tensor};

use crate::{NetError, Network};

/// Planes that go through the first layers at once, an even number.
const AT_ONCE: i64 = 8;

/// Planes to a multiple of which volumes are padded by the networks, for three halvings.
const MULTIPLE: usize = 8;

/// The first layers on the planes so far.
pub(crate) struct Slabs<'a> {
    network: &'a Network,
    planes: usize,
    /// Planes that came.
    taken: usize,
    /// Planes that were not yet in the middle of a slab, and the one before them: each (1, C', D, h, w).
    waiting: Vec<Tensor>,
    full: Vec<Tensor>,
    half: Vec<Tensor>,
    /// The channels that are averaged over the views, of all planes.
    averaged: Vec<Tensor>,
}

impl<'a> Slabs<'a> {
    /// No planes yet of a volume of `planes`.
    pub fn new(network: &'a Network, planes: usize) -> Self {
        let (waiting, full, half, averaged) = Default::default();
        Self { network, planes, taken: 0, waiting, full, half, averaged }
    }

    /// The next planes, (1, C', D', h, w).
    pub fn add(&mut self, slab: &Tensor) -> Result<(), NetError> {
        let (_, channels, count, ..) = slab.size5()?;
        let averaged = self.network.manifest().averaged as i64;
        // A copy: a part would keep all of the slab in memory.
        self.averaged.push(slab.f_narrow(1, channels - averaged, averaged)?.f_detach_copy()?);
        if self.waiting.is_empty() {
            self.waiting.push(slab.f_narrow(2, 0, 1)?.f_zeros_like()?);
        }
        self.waiting.push(slab.f_contiguous()?);
        self.taken += count as usize;
        if self.taken == self.planes {
            self.end()?;
        }
        self.process(AT_ONCE)
    }

    /// Values that the first layers give of a pixel and plane, once they have given any.
    pub fn values(&self) -> usize {
        let places = |full: &Tensor| full.numel() / (full.size()[1] as usize).max(1);
        let (full, half) = (&self.full[0], &self.half[0]);
        (full.numel() + half.numel()) / places(full).max(1)
    }

    /// The planes beyond the last: it is repeated up to the multiple, and what follows is zero.
    fn end(&mut self) -> Result<(), TchError> {
        let slab = &self.waiting[self.waiting.len() - 1];
        let last = slab.f_narrow(2, slab.size()[2] - 1, 1)?;
        let missing = (self.planes.next_multiple_of(MULTIPLE) - self.planes) as i64;
        let repeated = last.f_expand([-1, -1, missing, -1, -1], false)?;
        let after = last.f_zeros_like()?;
        self.waiting.extend([repeated, after]);
        Ok(())
    }

    /// Puts waiting planes through the first layers, `least` or more at once.
    fn process(&mut self, least: i64) -> Result<(), NetError> {
        let count = self.waiting.iter().map(|slab| slab.size()[2]).sum::<i64>();
        let inner = (count - 2) / 2 * 2;
        if inner < least {
            return Ok(());
        }
        let all = Tensor::f_cat(&self.waiting, 2)?;
        let (full, half) = self.network.regularize_slab(&all.f_narrow(2, 0, inner + 2)?)?;
        self.full.push(full);
        self.half.push(half);
        self.waiting = vec![all.f_narrow(2, inner, count - inner)?.f_detach_copy()?];
        Ok(())
    }

    /// The costs (1, D, h, w) of all planes.
    pub fn finish(mut self) -> Result<Tensor, NetError> {
        self.process(2)?;
        self.waiting.clear();
        let joined = |parts: &mut Vec<Tensor>| -> Result<Tensor, TchError> {
            let whole = Tensor::f_cat(parts, 2)?;
            parts.clear();
            Ok(whole)
        };
        let (full, half) = (joined(&mut self.full)?, joined(&mut self.half)?);
        self.network.regularize_slabs(&full, &half, &joined(&mut self.averaged)?)
    }
}
