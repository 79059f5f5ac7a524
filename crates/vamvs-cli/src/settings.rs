//! All settings of a run: defaults, then the configuration file, then flags. The result is written
//! beside the outputs, so that a run can be repeated.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use serde::{Deserialize, Serialize};
use vamvs::core::{DepthRange, Roi};
use vamvs::fusion::FuseOptions;
use vamvs::{DepthOptions, FusionOptions};

use crate::arguments::{CommonFlags, DepthLine, FusionFlags, PixelCentre, Preset};

/// All settings of a run.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct Settings {
    /// The network's file; the built-in one if not given.
    pub weights: Option<PathBuf>,
    /// auto, cpu, cuda or cuda:N.
    pub device: Option<String>,
    /// Number of threads; one a core if not given.
    pub threads: Option<usize>,
    /// Where the scene is.
    pub input: InputSettings,
    /// How depth is estimated.
    pub depth: DepthOptions,
    /// How depth maps become a cloud.
    pub fusion: FusionOptions,
}

/// Where the scene is.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct InputSettings {
    /// Folder of MVSNet cameras.
    pub cams: Option<PathBuf>,
    /// Folder of a COLMAP model.
    pub colmap: Option<PathBuf>,
    /// Folder of photographs.
    pub images: Option<PathBuf>,
    /// MVSNet's pair.txt.
    pub pairs: Option<PathBuf>,
    /// Folder of masks.
    pub masks: Option<PathBuf>,
    /// How depth lines are read.
    pub depth_line: DepthLine,
    /// Where pixel centres are.
    pub pixel_centre: PixelCentre,
}

impl Settings {
    /// The configuration file's settings, or the defaults.
    pub fn load(common: &CommonFlags) -> Result<Self> {
        let mut settings = match &common.config {
            None => Self::default(),
            Some(path) => {
                let text = std::fs::read_to_string(path)
                    .with_context(|| format!("cannot read {}", path.display()))?;
                toml::from_str(&text)
                    .with_context(|| format!("{} is not a settings file of vamvs", path.display()))?
            }
        };
        set(&mut settings.threads, common.threads.map(Some));
        Ok(settings)
    }

    /// The same settings with paths that hold from any folder.
    #[cfg(feature = "net")]
    pub fn absolute(&self) -> Result<Self> {
        let mut settings = self.clone();
        let InputSettings { cams, colmap, images, pairs, masks, .. } = &mut settings.input;
        for path in [&mut settings.weights, cams, colmap, images, pairs, masks].into_iter().flatten() {
            *path = std::path::absolute(&path).with_context(|| format!("{}", path.display()))?;
        }
        Ok(settings)
    }

    /// The settings as TOML.
    #[cfg(feature = "net")]
    pub fn save(&self, path: &Path) -> Result<()> {
        let text = toml::to_string_pretty(self).context("the settings cannot be written as TOML")?;
        Ok(vamvs::io::atomic::write(path, |out| out.write_all(text.as_bytes()))?)
    }

    /// Lets fusion flags win.
    pub fn apply_fusion(&mut self, flags: &FusionFlags) {
        let filter = &mut self.fusion.filter;
        match flags.preset {
            Some(Preset::Default) => *filter = FuseOptions::default(),
            Some(Preset::Dtu) => *filter = FuseOptions::dtu(),
            None => {}
        }
        set(&mut filter.min_views, flags.min_views);
        set(&mut filter.max_reprojection, flags.max_reprojection);
        set(&mut filter.max_relative_depth, flags.max_relative_depth);
        set(&mut filter.min_confidence, flags.confidence);
        set(&mut filter.min_coarse_confidence, flags.coarse_confidence);
        set(&mut self.fusion.neighbours, flags.neighbours);
    }

    /// Threads for rayon and libtorch.
    pub fn use_threads(&self) -> Result<()> {
        let Some(threads) = self.threads else { return Ok(()) };
        if !(1..=1024).contains(&threads) {
            bail!("threads must be from 1 to 1024, got {threads}");
        }
        rayon::ThreadPoolBuilder::new().num_threads(threads).build_global().context("cannot make threads")?;
        #[cfg(feature = "net")]
        vamvs::net::tch::set_num_threads(threads as i32);
        Ok(())
    }
}

/// Replaces a setting if there is a flag.
pub fn set<T>(setting: &mut T, flag: Option<T>) {
    if let Some(value) = flag {
        *setting = value;
    }
}

/// A box of the world from its six numbers.
pub fn roi(numbers: Option<&[f64]>) -> Result<Option<Roi>> {
    let Some(&[x0, y0, z0, x1, y1, z1]) = numbers else { return Ok(None) };
    Ok(Some(Roi::try_new([x0, y0, z0].into(), [x1, y1, z1].into()).context("--roi")?))
}

/// A depth range from its two numbers.
#[cfg(feature = "net")]
pub fn depth_range(numbers: Option<&[f64]>) -> Result<Option<DepthRange>> {
    let Some(&[near, far]) = numbers else { return Ok(None) };
    Ok(Some(DepthRange::try_new(near, far).context("--depth-range")?))
}

#[cfg(feature = "net")]
mod depth {
    use super::*;
    use crate::arguments::{DepthFlags, InputFlags, Spacing};
    use vamvs::Input;
    use vamvs::io::mvsnet;

    impl Settings {
        /// Lets input flags win. Giving one kind of scene drops the configuration's other kind.
        pub fn apply_input(&mut self, flags: &InputFlags) {
            let input = &mut self.input;
            if flags.cams.is_some() {
                (input.colmap, input.pairs) = (None, None);
            }
            if flags.colmap.is_some() {
                (input.cams, input.pairs) = (None, None);
            }
            set(&mut input.cams, flags.cams.clone().map(Some));
            set(&mut input.colmap, flags.colmap.clone().map(Some));
            set(&mut input.images, flags.images.clone().map(Some));
            set(&mut input.pairs, flags.pairs.clone().map(Some));
            set(&mut input.masks, flags.masks.clone().map(Some));
            set(&mut input.depth_line, flags.depth_line);
            set(&mut input.pixel_centre, flags.pixel_centre);
        }

        /// Lets depth flags win.
        pub fn apply_depth(&mut self, flags: &DepthFlags) -> Result<()> {
            set(&mut self.weights, flags.weights.clone().map(Some));
            set(&mut self.device, flags.device.clone().map(Some));
            let depth = &mut self.depth;
            set(&mut depth.max_size, flags.max_size);
            set(&mut depth.views, flags.views);
            set(&mut depth.planes, flags.planes.map(Some));
            set(&mut depth.max_planes, flags.max_planes);
            set(&mut depth.iterations, flags.iterations.map(Some));
            set(&mut depth.depth_range, depth_range(flags.depth_range.as_deref())?.map(Some));
            let spacing = flags.spacing.map(|spacing| match spacing {
                Spacing::Depth => vamvs::core::Spacing::Depth,
                Spacing::InverseDepth => vamvs::core::Spacing::InverseDepth,
            });
            set(&mut depth.spacing, spacing.map(Some));
            if let Some(roi) = roi(flags.roi.as_deref())? {
                depth.roi = Some(roi);
                self.fusion.roi = Some(roi);
            }
            Ok(())
        }
    }

    impl InputSettings {
        /// The scene's files.
        pub fn scene(&self) -> Result<Input> {
            let images = self.images.clone().context("no photographs: give their folder with --images")?;
            match (&self.cams, &self.colmap) {
                (Some(cams), None) => Ok(Input::Mvsnet {
                    cams: cams.clone(),
                    images,
                    pairs: self.pairs.clone(),
                    options: mvsnet::Options {
                        depth_line: self.depth_line(),
                        pixel_centre: self.pixel_centre(),
                    },
                }),
                (None, Some(model)) => Ok(Input::Colmap { model: model.clone(), images }),
                (None, None) => {
                    bail!("no cameras: give a COLMAP model with --colmap, or MVSNet cameras with --cams")
                }
                (Some(_), Some(_)) => bail!("both cams and colmap are given: expected one of them"),
            }
        }

        fn depth_line(&self) -> mvsnet::DepthLine {
            match self.depth_line {
                DepthLine::Auto => mvsnet::DepthLine::Auto,
                DepthLine::MinInterval => mvsnet::DepthLine::MinInterval,
                DepthLine::MinMax => mvsnet::DepthLine::MinMax,
            }
        }

        fn pixel_centre(&self) -> mvsnet::PixelCentre {
            match self.pixel_centre {
                PixelCentre::Half => mvsnet::PixelCentre::Half,
                PixelCentre::Integer => mvsnet::PixelCentre::Integer,
            }
        }
    }
}
