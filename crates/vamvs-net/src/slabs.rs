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
    /// The planes that wait for the first layers, after the one plane before them: parts (D', h, w, C'). libtorch convolves
    /// volumes with few output channels two to four times as fast if the channels of a pixel are next to each other.
    waiting: Vec<Tensor>,
    /// Outputs at full resolution, (D', h', w', a), D' the padded number of planes.
    full: Option<Tensor>,
    /// Outputs at half resolution, (D'/2, h'/2, w'/2, b).
    half: Option<Tensor>,
    /// Planes for which there are outputs at full resolution.
    done: i64,
    /// The channels that are averaged over the views, (1, A, D', h, w), for all planes so far.
    averaged: Vec<Tensor>,
}

impl<'a> Slabs<'a> {
    /// Starts a volume of `planes` planes.
    pub fn new(network: &'a Network, planes: usize) -> Self {
        let (waiting, averaged) = Default::default();
        Self { network, planes, taken: 0, waiting, full: None, half: None, done: 0, averaged }
    }

    /// Adds the next planes, (1, C', D', h, w).
    pub fn add(&mut self, slab: &Tensor) -> Result<(), NetError> {
        let (_, channels, count, ..) = slab.size5()?;
        let averaged = self.network.manifest().averaged as i64;
        // Copied, because a view would keep the whole slab in memory.
        self.averaged.push(slab.f_narrow(1, channels - averaged, averaged)?.f_detach_copy()?);
        let slab = slab.f_squeeze_dim(0)?.f_permute([1, 2, 3, 0])?.f_contiguous()?;
        if self.waiting.is_empty() {
            self.waiting.push(slab.f_narrow(0, 0, 1)?.f_zeros_like()?);
        }
        self.waiting.push(slab);
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
        let (Some(full), Some(half)) = (&self.full, &self.half) else { panic!("no planes yet") };
        let channels = full.size()[3].max(1) as usize;
        (full.numel() + half.numel()) * channels / full.numel()
    }

    /// Pads the volume after its last plane: repeats that plane up to a multiple of `MULTIPLE`, then adds a zero plane.
    fn end(&mut self) -> Result<(), TchError> {
        let slab = &self.waiting[self.waiting.len() - 1];
        let last = slab.f_narrow(0, slab.size()[0] - 1, 1)?;
        let missing = (self.planes.next_multiple_of(MULTIPLE) - self.planes) as i64;
        let repeated = last.f_expand([missing, -1, -1, -1], false)?;
        let after = last.f_zeros_like()?;
        self.waiting.extend([repeated, after]);
        Ok(())
    }

    /// Puts the waiting planes through the first layers if there are at least `least` of them.
    fn process(&mut self, least: i64) -> Result<(), NetError> {
        let count = self.waiting.iter().map(|slab| slab.size()[0]).sum::<i64>();
        let inner = (count - 2) / 2 * 2;
        if inner < least {
            return Ok(());
        }
        let all = Tensor::f_cat(&self.waiting, 0)?;
        let planes = all.f_narrow(0, 0, inner + 2)?.f_unsqueeze(0)?.f_permute([0, 4, 1, 2, 3])?;
        let (full, half) = self.network.regularize_slab(&planes)?;
        let all_planes = self.planes.next_multiple_of(MULTIPLE) as i64;
        keep(&mut self.full, &full, self.done, all_planes)?;
        keep(&mut self.half, &half, self.done / 2, all_planes / 2)?;
        self.done += inner;
        self.waiting = vec![all.f_narrow(0, inner, count - inner)?.f_detach_copy()?];
        Ok(())
    }

    /// Runs the remaining layers. Returns the costs of all planes, (1, D, h, w).
    pub fn finish(mut self) -> Result<Tensor, NetError> {
        self.process(2)?;
        self.waiting.clear();
        let volume = |kept: Option<Tensor>| -> Result<Tensor, NetError> {
            let kept =
                kept.ok_or_else(|| NetError::Request("a sweep needs at least one plane".to_owned()))?;
            Ok(kept.f_unsqueeze(0)?.f_permute([0, 4, 1, 2, 3])?)
        };
        let averaged = Tensor::f_cat(&self.averaged, 2)?;
        self.network.regularize_slabs(&volume(self.full)?, &volume(self.half)?, &averaged)
    }
}

/// Copies outputs (1, C, n, h, w) to the planes from `first` on of all of them, (`planes`, h, w, C).
fn keep(all: &mut Option<Tensor>, outputs: &Tensor, first: i64, planes: i64) -> Result<(), TchError> {
    let outputs = outputs.f_squeeze_dim(0)?.f_permute([1, 2, 3, 0])?;
    let (count, h, w, channels) = outputs.size4()?;
    let all = match all {
        Some(all) => all,
        None => all.insert(Tensor::f_empty([planes, h, w, channels], (outputs.kind(), outputs.device()))?),
    };
    all.f_narrow(0, first, count)?.f_copy_(&outputs)
}
