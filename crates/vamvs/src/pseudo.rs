//! Training scenes from reconstructions of photographs: depths that several views verify are pseudo ground truth
//! (KD-MVS, Ding et al., ECCV 2022).

use std::fs;
use std::path::Path;

use vamvs_core::depth_map::is_valid;
use vamvs_core::{DepthRange, Grid, Part, Source};
use vamvs_fusion::{ConsistentPixels, FuseJob, FuseOptions, MapSource, Schedule};
use vamvs_io::{IoError, image, mvsnet, pfm};

use crate::event::OnEvent;
use crate::output::claim;
use crate::output::make_folder;
use crate::{Event, FusionOptions, Maps, VamvsError};

/// The least share of the pixels of a scene that must be verified; with fewer it teaches nothing.
const LEAST: f64 = 0.05;

/// What became of the pixels of a reconstruction.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PseudoSummary {
    /// Pixels of all depth maps.
    pub pixels: u64,
    /// Pixels whose depth other views verify.
    pub verified: u64,
}

impl PseudoSummary {
    /// Whether enough pixels are verified for a training scene.
    #[must_use]
    pub fn is_enough(&self) -> bool {
        self.verified as f64 >= LEAST * self.pixels as f64
    }
}

/// The filters that verify a depth: three views at least, their votes worth seven times what a point of a cloud needs (a vote counts
/// the triangulation angle), half a pixel and half a per cent.
#[must_use]
pub fn strict() -> FusionOptions {
    let mut filter = FuseOptions::default();
    (filter.min_views, filter.min_support, filter.contradiction) = (3, 3.0, 1.0);
    (filter.max_reprojection, filter.max_relative_depth) = (0.5, 0.005);
    filter.min_confidence = 0.4;
    FusionOptions { filter, ..FusionOptions::default() }
}

/// Writes the verified depths of `maps` as a training scene into the folder `out`: MVSNet's layout with `depths/`, 0 where a depth is not
/// verified. Nothing is written if too few are ([`PseudoSummary::is_enough`]).
///
/// # Errors
/// If files are missing or malformed, `out` holds files that are not vamvs's, or a file cannot be written.
pub fn write(
    maps: &Maps,
    out: &Path,
    options: &FusionOptions,
    on_event: &mut OnEvent<'_>,
) -> Result<PseudoSummary, VamvsError> {
    options.validate()?;
    let neighbours = maps.neighbours(options.neighbours);
    let schedule = Schedule::new(&neighbours, maps.len())?;
    let job = FuseJob {
        source: maps,
        neighbours: &neighbours,
        options: &options.filter,
        roi: options.roi,
        memory: usize::try_from(options.max_memory.remaining()).unwrap_or(usize::MAX) / 2,
    };
    let (mut done, total) = (0, maps.len());
    let mut progress = |_| {
        done += 1;
        on_event(Event::Fusion { done, total })
    };
    let (verified, _) = vamvs_fusion::confirm(&job, &schedule, Part::WHOLE, &mut progress)?;
    let mut summary = PseudoSummary::default();
    for (view, pixels) in &verified {
        summary.pixels += maps.camera(*view).size.area() as u64;
        summary.verified += pixels.counts.consistent;
    }
    if summary.is_enough() {
        let writer = Writer { maps, out };
        writer.begin()?;
        for (view, pixels) in &verified {
            writer.view(*view, pixels)?;
        }
        writer.pairs()?;
    }
    Ok(summary)
}

struct Writer<'a> {
    maps: &'a Maps,
    out: &'a Path,
}

impl Writer<'_> {
    fn begin(&self) -> Result<(), VamvsError> {
        let files = (0..self.maps.len()).flat_map(|view| {
            ["images", "cams", "depths"].map(|kind| self.out.join(kind).join(file_name(kind, view)))
        });
        claim(self.out, files)?;
        let make = |kind: &&str| make_folder(&self.out.join(kind));
        Ok(["images", "cams", "depths"].iter().try_for_each(make)?)
    }

    fn view(&self, view: usize, pixels: &ConsistentPixels) -> Result<(), VamvsError> {
        let map = self.maps.load_map(view)?.map;
        let size = map.depth.size();
        let depth = Grid::from_fn(size, |x, y| if pixels.contains(x, y) { map.depth[(x, y)] } else { 0.0 });
        let path = |kind: &str| self.out.join(kind).join(file_name(kind, view));
        image::save_png_rgb(&path("images"), &self.maps.load_colour(view, size)?)?;
        mvsnet::write_cam(&path("cams"), &map.camera, &map.cam_from_world, range(&depth))?;
        Ok(pfm::write(&path("depths"), &depth)?)
    }

    fn pairs(&self) -> Result<(), VamvsError> {
        let ids: Vec<u32> = (0..self.maps.len() as u32).collect();
        let ranked = |views: Vec<usize>| {
            let score = |rank: usize| 1.0 / (rank as f64 + 1.0);
            views.into_iter().enumerate().map(|(rank, view)| Source { view, score: score(rank) }).collect()
        };
        let neighbours = self.maps.neighbours(self.maps.len()).into_iter().map(ranked);
        let pairs: Vec<Vec<Source>> = match self.maps.pairs() {
            Some(pairs) => pairs.to_vec(),
            None => neighbours.collect(),
        };
        Ok(mvsnet::write_pairs(&self.out.join("pair.txt"), &ids, &pairs)?)
    }
}

/// The name of a view's file in one of the folders.
fn file_name(kind: &str, view: usize) -> String {
    match kind {
        "images" => format!("{view:08}.png"),
        "cams" => format!("{view:08}_cam.txt"),
        _ => format!("{view:08}.pfm"),
    }
}

/// The range of the known depths; `None` if there are fewer than two.
fn range(depth: &Grid<f32>) -> Option<DepthRange> {
    let known = depth.data().iter().copied().filter(|depth| is_valid(*depth)).map(f64::from);
    let (near, far) = known.fold((f64::INFINITY, 0.0_f64), |(near, far), z| (near.min(z), far.max(z)));
    DepthRange::try_new(near, far).ok()
}

/// The name of a scene made of a reconstruction in the folder `run`.
///
/// # Errors
/// If the folder has no name.
pub fn scene_name(run: &Path) -> Result<String, VamvsError> {
    let whole = fs::canonicalize(run);
    let whole = whole.map_err(|source| IoError::System { action: "open", path: run.to_owned(), source })?;
    let name = whole.file_name().map(|name| name.to_string_lossy().into_owned());
    name.ok_or_else(|| VamvsError::Request(format!("{}: expected a folder with a name", run.display())))
}
