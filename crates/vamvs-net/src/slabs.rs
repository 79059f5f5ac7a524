//! Regularisation of a cost volume that is never held as a whole.
//!
//! The volume of vis-max has 65 channels; the first layers of its regularisation have 8 at full and 16 at half
//! resolution. Planes go through these layers a few at a time, as the sweep computes them, and only the outputs are
//! kept, which are a sixth of the volume.

use tch::{TchError, Tensor};

use crate::{NetError, Network};

/// The fewest planes that go through the first layers at once, an even number.
const AT_ONCE: i64 = 8;

/// The networks halve volumes three times, so they pad the number of planes to a multiple of this.
const MULTIPLE: usize = 8;

/// The outputs of the first layers for the planes added so far.
pub(crate) struct Slabs<'a> {
    network: &'a Network,
    /// Planes of the whole volume.
    planes: usize,
    /// Planes added so far.
    taken: usize,
    /// The planes that wait for the first layers, after the one plane before them: parts (1, C', D', h, w).
    waiting: Vec<Tensor>,
    /// Outputs at full resolution, (1, a, D', h', w').
    full: Vec<Tensor>,
    /// Outputs at half resolution, (1, b, D'/2, h'/2, w'/2).
    half: Vec<Tensor>,
    /// The channels that are averaged over the views, (1, A, D', h, w), for all planes so far.
    averaged: Vec<Tensor>,
}

impl<'a> Slabs<'a> {
    /// Starts a volume of `planes` planes.
    pub fn new(network: &'a Network, planes: usize) -> Self {
        let (waiting, full, half, averaged) = Default::default();
        Self { network, planes, taken: 0, waiting, full, half, averaged }
    }

    /// Adds the next planes, (1, C', D', h, w).
    pub fn add(&mut self, slab: &Tensor) -> Result<(), NetError> {
        let (_, channels, count, ..) = slab.size5()?;
        let averaged = self.network.manifest().averaged as i64;
        // Copied, because a view would keep the whole slab in memory.
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

    /// Values that the first layers output for each pixel and plane.
    ///
    /// # Panics
    /// If no planes have gone through these layers yet.
    pub fn values(&self) -> usize {
        let places = |full: &Tensor| full.numel() / (full.size()[1] as usize).max(1);
        let (full, half) = (&self.full[0], &self.half[0]);
        (full.numel() + half.numel()) / places(full).max(1)
    }

    /// Pads the volume after its last plane: repeats that plane up to a multiple of `MULTIPLE`, then adds a zero plane.
    fn end(&mut self) -> Result<(), TchError> {
        let slab = &self.waiting[self.waiting.len() - 1];
        let last = slab.f_narrow(2, slab.size()[2] - 1, 1)?;
        let missing = (self.planes.next_multiple_of(MULTIPLE) - self.planes) as i64;
        let repeated = last.f_expand([-1, -1, missing, -1, -1], false)?;
        let after = last.f_zeros_like()?;
        self.waiting.extend([repeated, after]);
        Ok(())
    }

    /// Puts the waiting planes through the first layers if there are at least `least` of them.
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

    /// Runs the remaining layers. Returns the costs of all planes, (1, D, h, w).
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
