//! Refines the depth maps of the network to the full size of their photographs.

use std::rc::Rc;
use std::time::{Duration, Instant};

use vamvs_core::{DepthMap, Grid, Photo, Scene};
use vamvs_refine::{RefineOptions, Refined, refine_on};

use crate::geometric::Needed;
use crate::output::LoadedMap;
use crate::place::Place;
use crate::refine::PhotoCache;
use crate::surfaces::surfaces;
use crate::{Method, Photographs, VamvsError, geometric, region};

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
            place: Place::new(method.device()),
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
        self.place.warning()
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
