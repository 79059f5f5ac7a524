//! Refines the depth maps of the network to the full size of their photographs.

use std::rc::Rc;
use std::time::{Duration, Instant};

use vamvs_core::{DepthMap, Grid, Photo, Scene};
use vamvs_refine::matching::{Device, DeviceError};
use vamvs_refine::{RefineError, RefineOptions, Refined, refine_on};

use crate::geometric::Needed;
use crate::output::LoadedMap;
use crate::refine::PhotoCache;
use crate::surfaces::surfaces;
use crate::{Method, Photographs, VamvsError, geometric, region};

/// The smallest tiles that are tried on a device, pixels.
const LEAST_TILE: usize = 256;

/// Refines the depth maps of a run, one after the other.
pub(crate) struct Refinement<'a> {
    scene: &'a Scene,
    photographs: Photographs,
    options: RefineOptions,
    place: Place<'a>,
    /// Whether a second pass follows.
    geometric_follows: bool,
    kept: PhotoCache,
    /// Time that reading photographs took.
    pub reading: Duration,
    /// Time that refining by the photographs alone took.
    pub refining: Duration,
    /// Time that refining with the source views' depth maps took.
    pub refining_again: Duration,
}

/// Where planes are matched.
struct Place<'a> {
    /// What matches them in place of the processor, as long as its memory suffices.
    device: Option<&'a dyn Device>,
    /// The largest tiles for which it suffices, as far as is known, pixels.
    tile: usize,
    /// What its memory did not suffice for, until it is told.
    warning: Option<String>,
}

impl Place<'_> {
    /// Refines on the device, if there is one: where its memory does not suffice, in smaller tiles, and at last on the processor.
    fn refined(
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

/// What the network gives for one view.
pub(crate) struct Seed<'a> {
    /// Its depth map.
    pub map: &'a DepthMap,
    /// The visibility maps of the source views, as far as the network gives them.
    pub visibility: &'a [Grid<f32>],
    /// The part of the image in which depth is wanted, as shares of its width and height; `None` for all of it.
    pub region: Option<[[f64; 2]; 2]>,
    /// The part of the image, as above, in which it has a depth wherever there is a surface; `None` if nowhere.
    pub knows_surfaces: Option<[[f64; 2]; 2]>,
}

impl<'a> Refinement<'a> {
    /// Uses `photographs` at full size, before the reduction for the network, and the device of the `method`;
    /// `geometric_follows`: whether a second pass follows.
    pub fn new(
        scene: &'a Scene,
        photographs: &Photographs,
        method: &'a Method,
        geometric_follows: bool,
    ) -> Self {
        let mut options = RefineOptions::default();
        options.beyond = method.beyond();
        Self {
            scene,
            photographs: photographs.full(),
            options,
            place: Place { device: method.device(), tile: usize::MAX, warning: None },
            geometric_follows,
            kept: PhotoCache::default(),
            reading: Duration::ZERO,
            refining: Duration::ZERO,
            refining_again: Duration::ZERO,
        }
    }

    /// The refined depth map of `view`, compared with `sources`, and its photograph.
    pub fn refine(
        &mut self,
        view: usize,
        sources: &[usize],
        seed: &Seed<'_>,
    ) -> Result<(Refined, Rc<Photo>), VamvsError> {
        let reference = self.photo(view)?;
        let others: Vec<Rc<Photo>> =
            sources.iter().map(|&source| self.photo(source)).collect::<Result<_, _>>()?;
        let begin = Instant::now();
        let limited = seed.region.map(|region| limited(&reference, region));
        let limited = limited.as_ref().unwrap_or(&reference);
        let shown = seed.knows_surfaces.and_then(|part| surfaces((seed.map, part), &limited.image));
        let shown = shown.map(|shown| masked(limited, &shown));
        let limited = shown.as_ref().unwrap_or(limited);
        let others: Vec<&Photo> = others.iter().map(Rc::as_ref).collect();
        let options = self.options;
        let options = if self.geometric_follows {
            geometric::first_pass(&options, reference.image.size())
        } else {
            options
        };
        let refined = self.place.refined(&options, |device, options| {
            Ok(refine_on(device, limited, &others, (seed.map, seed.visibility), options)?)
        })?;
        self.refining += begin.elapsed();
        Ok((refined, reference))
    }

    /// The geometric pass: the first-pass map of `view`, refined with those of `sources`, and its
    /// photograph. `first` gives the maps.
    pub fn refine_again(
        &mut self,
        view: usize,
        sources: &[usize],
        first: impl Fn(usize, Needed) -> Result<Option<Rc<LoadedMap>>, VamvsError>,
    ) -> Result<(Refined, Rc<Photo>), VamvsError> {
        let reference = self.photo(view)?;
        // A source view that cannot be read is reported when it is processed itself.
        let with_photo = |&source: &usize| Some((source, self.photo(source).ok()?));
        let sources: Vec<(usize, Rc<Photo>)> = sources.iter().filter_map(with_photo).collect();
        let begin = Instant::now();
        let refined = self.place.refined(&self.options, |device, options| {
            geometric::refined(&first, (view, &reference), &sources, (options, device))
        })?;
        self.refining_again += begin.elapsed();
        Ok((refined, reference))
    }

    /// A warning of what the device's memory did not suffice for, once.
    pub fn warning(&mut self) -> Option<String> {
        self.place.warning.take()
    }

    /// How depth maps are refined.
    pub fn options(&self) -> &RefineOptions {
        &self.options
    }

    /// Drops all photographs.
    pub fn clear(&mut self) {
        self.kept = PhotoCache::default();
    }

    /// A photograph at full size.
    fn photo(&mut self, view: usize) -> Result<Rc<Photo>, VamvsError> {
        let (scene_view, photographs, reading) =
            (&self.scene.views[view], &self.photographs, &mut self.reading);
        self.kept.get(view, || {
            let begin = Instant::now();
            let (photo, _) = photographs.load(scene_view).map_err(|error| error.of_view(&scene_view.name))?;
            *reading += begin.elapsed();
            Ok(photo)
        })
    }
}

/// The photograph with everything outside of a region masked.
pub(crate) fn limited(photo: &Photo, region: [[f64; 2]; 2]) -> Photo {
    let size = photo.image.size();
    masked(photo, &Grid::from_fn(size, |x, y| region::contains(region, (x, y), size)))
}

/// The photograph without the pixels that do not count.
fn masked(photo: &Photo, counts: &Grid<bool>) -> Photo {
    let both = |x: usize, y: usize| counts[(x, y)] && photo.mask.as_ref().is_none_or(|mask| mask[(x, y)]);
    Photo { mask: Some(Grid::from_fn(photo.image.size(), both)), ..photo.clone() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::RefCell;
    use vamvs_refine::matching::{Matched, Matching};

    struct Small;

    impl Device for Small {
        fn planes(&self, _: &Matching<'_>) -> Result<Vec<Matched>, DeviceError> {
            unreachable!("nothing is refined")
        }
    }

    /// Where refinement was tried twice when a device has memory for tiles of `most` pixels: tiles on the device, or 0 for the
    /// processor; and the warnings.
    fn tried(most: usize) -> (Vec<usize>, Vec<Option<String>>) {
        let mut place = Place { device: Some(&Small), tile: usize::MAX, warning: None };
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
            warnings.push(place.warning.take());
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
