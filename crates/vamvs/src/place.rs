//! Where refinement matches planes: on a device as long as its memory suffices, else on the processor.

use vamvs_core::Size;
use vamvs_refine::matching::{self, Device, DeviceError};
use vamvs_refine::{RefineError, RefineOptions, Refined};

use crate::VamvsError;

/// The smallest tiles that are tried on a device, pixels.
const LEAST_TILE: usize = 256;

/// What refining a photograph takes of the process's memory, bytes.
pub(crate) fn peak_bytes(photograph: Size, options: &RefineOptions, device: Option<&dyn Device>) -> u64 {
    let for_device = device.map_or(0, |_| matching::peak_bytes(photograph, options));
    vamvs_refine::peak_bytes(photograph, options) + for_device
}

/// Where planes are matched.
pub(crate) struct Place<'a> {
    /// What matches them in place of the processor, as long as its memory suffices.
    device: Option<&'a dyn Device>,
    /// The largest tiles for which it suffices, as far as is known, pixels.
    tile: usize,
    /// What its memory did not suffice for, until it is told.
    warning: Option<String>,
}

impl<'a> Place<'a> {
    /// On a device, if there is one.
    pub fn new(device: Option<&'a dyn Device>) -> Self {
        Self { device, tile: usize::MAX, warning: None }
    }

    /// What the device's memory did not suffice for, once.
    pub fn warning(&mut self) -> Option<String> {
        self.warning.take()
    }

    /// Refines on the device, if there is one: where its memory does not suffice, in smaller tiles, and at last on the processor.
    pub fn refined(
        &mut self,
        options: &RefineOptions,
        refine: impl Fn(Option<&dyn Device>, &RefineOptions) -> Result<Refined, VamvsError>,
    ) -> Result<Refined, VamvsError> {
        while self.device.is_some() {
            let mut smaller = *options;
            smaller.tile = options.tile.min(self.tile);
            let problem = match refine(self.device, &smaller) {
                Err(VamvsError::Refine(RefineError::Device(DeviceError::Memory(problem)))) => problem,
                refined => return refined,
            };
            self.tile = smaller.tile / 2;
            let then = if self.tile >= LEAST_TILE {
                format!("depth maps are refined in tiles of {} pixels", self.tile)
            } else {
                self.device = None;
                "depth maps are refined on the processor".to_owned()
            };
            self.warning = Some(format!("{problem}; from now on {then}"));
        }
        refine(None, options)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::RefCell;
    use vamvs_refine::matching::{Matched, Matching};

    #[derive(Debug)]
    struct Small;

    impl Device for Small {
        fn planes(&self, _: &Matching<'_>) -> Result<Vec<Matched>, DeviceError> {
            unreachable!("nothing is refined")
        }
    }

    /// Where refinement was tried twice when a device has memory for tiles of `most` pixels: tiles on the device, or 0 for the
    /// processor; and the warnings.
    fn tried(most: usize) -> (Vec<usize>, Vec<Option<String>>) {
        let mut place = Place::new(Some(&Small));
        let (tried, mut warnings) = (RefCell::new(Vec::new()), Vec::new());
        for _ in 0..2 {
            let done = place.refined(&RefineOptions::default(), |device, options| {
                tried.borrow_mut().push(if device.is_some() { options.tile } else { 0 });
                let error = if device.is_some() && options.tile > most {
                    RefineError::Device(DeviceError::Memory("too little".to_owned()))
                } else {
                    RefineError::NoSource
                };
                Err(error.into())
            });
            assert!(matches!(done, Err(VamvsError::Refine(RefineError::NoSource))));
            warnings.push(place.warning());
        }
        (tried.into_inner(), warnings)
    }

    #[test]
    fn a_device_with_little_memory_gets_tiles_and_then_nothing() {
        assert_eq!(tried(4096), (vec![1024, 1024], vec![None, None]));
        let (places, warnings) = tried(600);
        assert_eq!(places, [1024, 512, 512]);
        let told = warnings[0].as_deref();
        assert_eq!(told, Some("too little; from now on depth maps are refined in tiles of 512 pixels"));
        assert_eq!(warnings[1], None, "once");
        let (places, warnings) = tried(10);
        assert_eq!(places, [1024, 512, 256, 0, 0]);
        assert!(warnings[0].as_ref().is_some_and(|told| told.ends_with("refined on the processor")));
    }
}
