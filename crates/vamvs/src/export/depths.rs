//! Depth maps in other formats, `depths/NAME.EXT`.

use std::path::{Path, PathBuf};

use vamvs_core::depth_map::is_valid;
use vamvs_fusion::{MapSource, MaskedMap};
use vamvs_io::{atomic, depth};

use super::{DepthFormat, ExportOptions, ExportedView};
use crate::output::claim;
use crate::output::{is_same, make_folder, remove};
use crate::{Maps, OutputFolder, VamvsError};

/// How many times the median depth PNGs hold, so that a step is at most a fraction of a percent of it.
const MOST_TIMES_MEDIAN: f32 = 50.0;

/// The folder of depth maps, if any are wanted.
pub(super) struct DepthFolder {
    root: PathBuf,
    /// Whether it is that of the run that made the depth maps.
    is_of_run: bool,
    formats: Vec<DepthFormat>,
    png_step: Option<f64>,
}

impl DepthFolder {
    /// `depths/` in the folder of the cloud. Depth maps there that vamvs has not written, or that are those of another run,
    /// are not overwritten.
    pub fn new(maps: &Maps, beside: &Path, options: &ExportOptions) -> Result<Self, VamvsError> {
        options.validate()?;
        let root = beside.join("depths");
        let is_of_run = is_same(beside, maps.root()) && OutputFolder::new(beside).is_own();
        let formats = options.depth_formats.clone();
        let folder = Self { root, is_of_run, formats, png_step: options.png_step };
        if let Some(step) = folder.png_step.filter(|_| folder.has_pngs()) {
            expect_fitting(maps, step)?;
        }
        if folder.is_wanted() && is_of_run {
            make_folder(&folder.root)?;
        } else if folder.is_wanted() {
            let views =
                (0..maps.len()).flat_map(|view| folder.files(&maps.names()[view], maps.depth_file(view)));
            claim(&folder.root, views.chain([folder.png_step_file()]))?;
        }
        Ok(folder)
    }

    pub fn is_wanted(&self) -> bool {
        !self.formats.is_empty()
    }

    fn has_pngs(&self) -> bool {
        self.formats.contains(&DepthFormat::Png)
    }

    /// The depth of one grey level of PNGs, also written to `png-step.txt`; 1 if no PNGs are
    /// wanted. PNGs of another step go.
    pub fn png_step(&self, maps: &Maps) -> Result<f64, VamvsError> {
        if !self.has_pngs() {
            return Ok(1.0);
        }
        let step = match self.png_step {
            Some(step) => step,
            None => depth::fitting_png_step(farthest_for_png(maps)?),
        };
        let text = format!("{step}\n");
        if std::fs::read_to_string(self.png_step_file()).is_ok_and(|before| before != text) {
            self.remove_pngs(maps)?;
        }
        atomic::write(&self.png_step_file(), |out| out.write_all(text.as_bytes()))?;
        Ok(step)
    }

    /// Removes the PNGs of all views, also of those that cannot be read now, but no file that a depth map was read from.
    fn remove_pngs(&self, maps: &Maps) -> Result<(), VamvsError> {
        let of_readable =
            maps.names().iter().enumerate().map(|(view, name)| (name, Some(maps.depth_file(view))));
        let of_others = maps.left_out().iter().filter(|_| self.is_of_run).map(|view| (&view.view, None));
        for (name, source) in of_readable.chain(of_others) {
            let png = self.root.join(format!("{name}.png"));
            if !source.is_some_and(|source| is_same(&png, source)) {
                remove(&png)?;
            }
        }
        Ok(())
    }

    /// Writes a view's unmasked depths; never overwrites the file that the depth map was read from. Returns the number of
    /// depths that PNGs do not have, because they do not fit a step that nobody asked for.
    pub fn write_view(&self, view: &ExportedView, source: &Path, png_step: f64) -> Result<usize, VamvsError> {
        let mut left_out = 0;
        for path in self.files(view.name, source) {
            let all = &view.all.depth;
            if self.png_step.is_none() && path.extension().is_some_and(|end| end == "png") {
                let fits = |depth: &f32| depth::fits_png(*depth, png_step);
                left_out += all.data().iter().filter(|depth| !fits(depth)).count();
                depth::write(&path, &all.map(|depth| if fits(depth) { *depth } else { 0.0 }), png_step)?;
            } else {
                depth::write(&path, all, png_step)?;
            }
        }
        Ok(left_out)
    }

    /// The files of a view, without the one that its depth map was read from.
    fn files(&self, name: &str, source: &Path) -> impl Iterator<Item = PathBuf> {
        let file = move |format: &DepthFormat| {
            let extension = match format {
                DepthFormat::Pfm => "pfm",
                DepthFormat::Png => "png",
                DepthFormat::Exr => "exr",
                DepthFormat::Npy => "npy",
            };
            self.root.join(format!("{name}.{extension}"))
        };
        self.formats.iter().map(file).filter(move |path| !is_same(path, source))
    }

    fn png_step_file(&self) -> PathBuf {
        self.root.join(depth::PNG_STEP_FILE)
    }
}

/// Refuses a step of PNGs that some depth does not fit. Views that cannot be read are left out later.
fn expect_fitting(maps: &Maps, step: f64) -> Result<(), VamvsError> {
    for view in 0..maps.len() {
        let Ok(MaskedMap { map, mask }) = maps.load_map(view) else { continue };
        let counts = |pixel: usize| mask.as_ref().is_none_or(|mask| mask.data()[pixel]);
        let depths = map.depth.data().iter().enumerate().filter(|(pixel, _)| counts(*pixel));
        if let Some((_, depth)) = depths.into_iter().find(|(_, depth)| !depth::fits_png(**depth, step)) {
            let problem = format!(
                "a depth of {depth} does not fit steps of {step}: expected 1 to 65534 steps (--png-step)"
            );
            return Err(VamvsError::Folder { path: maps.depth_file(view).to_owned(), problem });
        }
    }
    Ok(())
}

/// The farthest depth that PNGs are to hold: the farthest of all, but at most [`MOST_TIMES_MEDIAN`] times the median over the
/// views of their median depths. So one wrong depth does not make all others coarse.
fn farthest_for_png(maps: &Maps) -> Result<f64, VamvsError> {
    let (mut farthest, mut medians) = (0.0_f32, Vec::with_capacity(maps.len()));
    for view in 0..maps.len() {
        let map = maps.load_map(view)?.map;
        let mut depths: Vec<f32> =
            map.depth.data().iter().copied().filter(|&depth| is_valid(depth)).collect();
        farthest = depths.iter().copied().fold(farthest, f32::max);
        medians.extend(median(&mut depths));
    }
    let most = median(&mut medians).map_or(0.0, |median| MOST_TIMES_MEDIAN * median);
    Ok(f64::from(farthest.min(most)))
}

fn median(values: &mut [f32]) -> Option<f32> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f32::total_cmp).1)
}
