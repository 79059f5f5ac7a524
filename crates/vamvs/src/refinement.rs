//! Depth maps refined to the full size of their photographs, between the network and the files.

use std::rc::Rc;
use std::time::{Duration, Instant};

use vamvs_core::roi::PixelBox;
use vamvs_core::{DepthMap, Grid, Photo, Scene};
use vamvs_refine::{RefineOptions, Refined, refine};

use crate::output::LoadedMap;
use crate::refine::PhotoCache;
use crate::{Photographs, VamvsError, geometric};

/// What refining a depth map takes for each pixel of the photograph, bytes: planes, features and the images of the
/// reference and its sources.
pub(crate) const BYTES_PER_PIXEL: u64 = 250;

/// Refines the depth maps of a run, one after the other.
pub(crate) struct Refinement<'a> {
    scene: &'a Scene,
    photographs: Photographs,
    options: RefineOptions,
    /// Whether depth maps will be refined once more.
    has_more: bool,
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
    /// What each source view sees, as far as the network tells it.
    pub visibility: &'a [Grid<f32>],
    /// The part of the image in which depth is wanted, as shares of its width and height; `None` for all of it.
    pub region: Option<[[f64; 2]; 2]>,
}

impl<'a> Refinement<'a> {
    /// Of photographs as large as `photographs` has them before the network's reduction.
    /// `has_more`: whether they will be refined once more.
    pub fn new(scene: &'a Scene, photographs: &Photographs, has_more: bool) -> Self {
        Self {
            scene,
            photographs: photographs.full(),
            options: RefineOptions::default(),
            has_more,
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
        let others: Vec<&Photo> = others.iter().map(Rc::as_ref).collect();
        let options = self.options;
        let options =
            if self.has_more { geometric::first_pass(&options, reference.image.size()) } else { options };
        let refined = refine(limited, &others, seed.map, seed.visibility, &options)?;
        self.refining += begin.elapsed();
        Ok((refined, reference))
    }

    /// The depth map that `first` has of `view`, refined once more with those of `sources`, and its photograph.
    pub fn refine_again(
        &mut self,
        view: usize,
        sources: &[usize],
        first: impl Fn(usize) -> Result<Rc<LoadedMap>, VamvsError>,
    ) -> Result<(Refined, Rc<Photo>), VamvsError> {
        let reference = self.photo(view)?;
        // That a source view cannot be read is told where its own turn comes.
        let with_photo = |&source: &usize| Some((source, self.photo(source).ok()?));
        let sources: Vec<(usize, Rc<Photo>)> = sources.iter().filter_map(with_photo).collect();
        let begin = Instant::now();
        let refined = geometric::refined(first, (view, &reference), &sources, &self.options)?;
        self.refining_again += begin.elapsed();
        Ok((refined, reference))
    }

    /// How depth maps are refined.
    pub fn options(&self) -> &RefineOptions {
        &self.options
    }

    /// Gives up all photographs.
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
fn limited(photo: &Photo, [[x0, y0], [x1, y1]]: [[f64; 2]; 2]) -> Photo {
    let size = photo.image.size();
    let inside = |at: usize, side: usize, first: f64, end: f64| {
        let centre = (at as f64 + 0.5) / side as f64;
        (first..end).contains(&centre)
    };
    let mask = Grid::from_fn(size, |x, y| {
        let counts = photo.mask.as_ref().is_none_or(|mask| mask[(x, y)]);
        counts && inside(x, size.width, x0, x1) && inside(y, size.height, y0, y1)
    });
    Photo { mask: Some(mask), ..photo.clone() }
}

/// A region of an image as shares of its width and height.
pub(crate) fn shares(region: PixelBox, size: vamvs_core::Size) -> [[f64; 2]; 2] {
    let share = |x: usize, y: usize| [x as f64 / size.width as f64, y as f64 / size.height as f64];
    [share(region.x0, region.y0), share(region.x1, region.y1)]
}
