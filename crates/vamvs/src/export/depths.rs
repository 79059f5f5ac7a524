//! Depth maps in other formats, `depths/NAME.EXT`.

use std::path::{Path, PathBuf};

use vamvs_fusion::MapSource;
use vamvs_io::{atomic, depth};

use super::{DepthFormat, ExportOptions, ExportedView, make_folder};
use crate::{Maps, VamvsError};

/// The folder of depth maps, if any are wanted.
pub(super) struct DepthFolder {
    root: PathBuf,
    formats: Vec<DepthFormat>,
    png_step: Option<f64>,
}

impl DepthFolder {
    pub fn new(root: &Path, options: &ExportOptions) -> Result<Self, VamvsError> {
        if let Some(step) = options.png_step.filter(|step| !(step.is_finite() && *step > 0.0)) {
            let problem = format!("png-step must be a depth above 0, got {step}");
            return Err(VamvsError::Request(problem));
        }
        let formats = options.depth_formats.clone();
        if !formats.is_empty() {
            make_folder(root)?;
        }
        Ok(Self { root: root.to_owned(), formats, png_step: options.png_step })
    }

    pub fn is_wanted(&self) -> bool {
        !self.formats.is_empty()
    }

    /// The depth of one grey level of PNGs, also written to `png-step.txt`; 1 if no PNGs are
    /// wanted.
    pub fn png_step(&self, maps: &Maps) -> Result<f64, VamvsError> {
        if !self.formats.contains(&DepthFormat::Png) {
            return Ok(1.0);
        }
        let step = match self.png_step {
            Some(step) => step,
            None => depth::fitting_png_step(farthest(maps)?),
        };
        atomic::write(&self.root.join("png-step.txt"), |out| writeln!(out, "{step}"))?;
        Ok(step)
    }

    /// Writes a view's unmasked depths; never overwrites the file that the depth map was read from.
    pub fn write_view(&self, view: &ExportedView, source: &Path, png_step: f64) -> Result<(), VamvsError> {
        for format in &self.formats {
            let extension = match format {
                DepthFormat::Pfm => "pfm",
                DepthFormat::Png => "png",
                DepthFormat::Exr => "exr",
                DepthFormat::Npy => "npy",
            };
            let path = self.root.join(format!("{}.{extension}", view.name));
            if path.canonicalize().ok() != source.canonicalize().ok() {
                depth::write(&path, &view.all.depth, png_step)?;
            }
        }
        Ok(())
    }
}

fn farthest(maps: &Maps) -> Result<f64, VamvsError> {
    let mut farthest = f32::MIN_POSITIVE;
    for view in 0..maps.len() {
        farthest = maps.load(view)?.map.depth.data().iter().copied().fold(farthest, f32::max);
    }
    Ok(f64::from(farthest))
}
