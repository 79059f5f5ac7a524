//! All settings of a run: defaults, then the configuration file, then flags. The result is written
//! next to the outputs, so that a run can be repeated.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use serde::{Deserialize, Serialize};
use vamvs::core::Roi;
use vamvs::fusion::{Consistency, FuseOptions};
use vamvs::io::mvsnet::{DepthLine, PixelCentre};
use vamvs::meshing::MeshOptions;
use vamvs::{DepthOptions, ExportOptions, FusionOptions, Quality, Stretching};

use crate::arguments::{CommonFlags, ExportFlags, FusionFlags, MeshFlags, Preset};

/// All settings of a run.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct Settings {
    /// The network: the name of a built-in one, a file, or none; vis-corr if not given.
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
    /// How depth maps become a mesh.
    pub mesh: MeshOptions,
    /// Exports for other programs.
    pub export: ExportOptions,
}

/// Where the scene is.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct InputSettings {
    /// Folder of MVSNet cameras.
    pub cams: Option<PathBuf>,
    /// Folder of a COLMAP model.
    pub colmap: Option<PathBuf>,
    /// nerfstudio's transforms.json.
    pub nerfstudio: Option<PathBuf>,
    /// Bundler's bundle.out.
    pub bundler: Option<PathBuf>,
    /// VisualSFM's .nvm.
    pub nvm: Option<PathBuf>,
    /// OpenMVS's .mvs.
    pub openmvs: Option<PathBuf>,
    /// Folder of photographs.
    pub images: Option<PathBuf>,
    /// MVSNet's pair.txt.
    pub pairs: Option<PathBuf>,
    /// Folder of masks.
    pub masks: Option<PathBuf>,
    /// Whether masks in files are left out.
    pub no_masks: bool,
    /// How depth lines are read.
    pub depth_line: DepthLine,
    /// Where pixel centres are.
    pub pixel_centre: PixelCentre,
}

impl Settings {
    /// The configuration file's settings, or the defaults.
    pub fn load(common: &CommonFlags) -> Result<Self> {
        let mut settings = common.config.as_deref().map_or_else(|| Ok(Self::default()), Self::read)?;
        set(&mut settings.threads, common.threads.map(Some));
        set(&mut settings.depth.max_memory, common.max_memory);
        set(&mut settings.fusion.max_memory, common.max_memory);
        Ok(settings)
    }

    fn read(path: &Path) -> Result<Self> {
        let text =
            std::fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
        toml::from_str(&text).with_context(|| format!("{} is not a settings file of vamvs", path.display()))
    }

    /// Takes over the scene of the run whose depth maps are in `folder`, if its settings are there.
    pub fn apply_run(&mut self, folder: &Path) -> Result<()> {
        let run = folder.join("run.toml");
        if run.is_file() {
            self.input = Self::read(&run)?.input;
        }
        Ok(())
    }

    /// The same settings with absolute paths.
    pub fn absolute(&self) -> Result<Self> {
        let mut settings = self.clone();
        let absolute = |path: &mut Option<PathBuf>| -> Result<()> {
            let Some(path) = path else { return Ok(()) };
            *path = std::path::absolute(&path).with_context(|| format!("{}", path.display()))?;
            Ok(())
        };
        settings.input.kinds().into_iter().try_for_each(absolute)?;
        let InputSettings { images, pairs, masks, .. } = &mut settings.input;
        [images, pairs, masks].into_iter().try_for_each(absolute)?;
        if !settings.weights.as_deref().is_some_and(vamvs::weights::is_built_in) {
            absolute(&mut settings.weights)?;
        }
        Ok(settings)
    }

    /// The settings as TOML.
    pub fn save(&self, path: &Path) -> Result<()> {
        let text = toml::to_string_pretty(self).context("the settings cannot be written as TOML")?;
        Ok(vamvs::io::atomic::write(path, |out| out.write_all(text.as_bytes()))?)
    }

    /// Lets flags of meshing win.
    pub fn apply_mesh(&mut self, flags: &MeshFlags) {
        set(&mut self.mesh.cell, flags.cell);
        set(&mut self.mesh.min_triangles, flags.min_triangles);
        set(&mut self.mesh.close_holes, flags.close_holes);
        set(&mut self.mesh.triangles, flags.triangles.map(Some));
    }

    /// Lets fusion flags win.
    pub fn apply_fusion(&mut self, flags: &FusionFlags) {
        let filter = &mut self.fusion.filter;
        if let Some(preset) = flags.preset {
            *filter = if preset == Preset::Dtu { FuseOptions::dtu() } else { FuseOptions::default() };
            self.fusion.network_confidence = preset == Preset::Dtu;
            self.depth.refine &= preset != Preset::Dtu;
            if preset == Preset::Dtu {
                // Its own depth maps are finer than those of the default.
                self.weights.get_or_insert_with(|| vamvs::weights::of_paper().into());
            }
        }
        if let Some(rule) = flags.consistency {
            let rule = match rule {
                Consistency::Dynamic => FuseOptions::default(),
                Consistency::Classic => FuseOptions::classic(),
            };
            (filter.consistency, filter.min_views) = (rule.consistency, rule.min_views);
        }
        set(&mut filter.min_views, flags.min_views);
        set(&mut filter.min_support, flags.min_support);
        set(&mut filter.contradiction, flags.contradiction);
        set(&mut filter.max_sigma, flags.max_sigma.map(Some));
        set(&mut filter.point_spacing, flags.point_spacing.map(Some));
        set(&mut filter.max_reprojection, flags.max_reprojection);
        set(&mut filter.max_relative_depth, flags.max_relative_depth);
        set(&mut filter.min_confidence, flags.confidence);
        set(&mut filter.min_coarse_confidence, flags.coarse_confidence);
        set(&mut self.fusion.neighbours, flags.neighbours);
    }

    /// Lets export flags win.
    pub fn apply_export(&mut self, flags: &ExportFlags) {
        set(&mut self.export.programs, flags.export.clone());
        set(&mut self.export.depth_formats, flags.depth_format.clone());
        set(&mut self.export.png_step, flags.png_step.map(Some));
    }

    /// Threads for rayon and libtorch.
    pub fn use_threads(&self) -> Result<()> {
        let Some(threads) = self.threads else { return Ok(()) };
        if !(1..=1024).contains(&threads) {
            bail!("threads must be from 1 to 1024, got {threads}");
        }
        rayon::ThreadPoolBuilder::new().num_threads(threads).build_global().context("cannot make threads")?;
        #[cfg(feature = "torch")]
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

/// How photographs of 16 bits are stretched, from two numbers, `none` or `auto`.
pub fn stretching(words: Option<&[String]>) -> Result<Option<Stretching>> {
    let Some(words) = words else { return Ok(None) };
    let value = |word: &String| word.parse::<u16>();
    Ok(Some(match words {
        [word] if word == "none" => Stretching::None,
        [word] if word == "auto" => Stretching::Auto,
        [low, high] if value(low).is_ok() && value(high).is_ok() => {
            Stretching::Between { low: value(low)?, high: value(high)? }
        }
        _ => bail!(
            "--stretch: expected LOW HIGH, two values from 0 to 65535, or none, found {}",
            words.join(" ")
        ),
    }))
}

/// A depth range from its two numbers.
pub fn depth_range(numbers: Option<&[f64]>) -> Result<Option<vamvs::core::DepthRange>> {
    let Some(&[near, far]) = numbers else { return Ok(None) };
    Ok(Some(vamvs::core::DepthRange::try_new(near, far).context("--depth-range")?))
}

pub use input::{given_scene, masks_of};

mod input {
    use super::*;
    use crate::arguments::InputFlags;
    use std::path::Path;
    use vamvs::Input;
    use vamvs::io::masks::Masks;
    use vamvs::io::mvsnet::{self, DepthLine, PixelCentre};

    impl Settings {
        /// Lets input flags win. A scene given by a flag replaces that of the configuration, with
        /// all settings of its input.
        pub fn apply_input(&mut self, flags: &InputFlags) {
            let InputFlags { cams, colmap, nerfstudio, bundler, nvm, openmvs, .. } = flags;
            let input = &mut self.input;
            let given = [cams, colmap, nerfstudio, bundler, nvm, openmvs];
            if given.iter().any(|kind| kind.is_some()) {
                if input.given().next().is_some() {
                    *input = InputSettings::default();
                }
                input.kinds().into_iter().zip(given).for_each(|(kind, flag)| kind.clone_from(flag));
            }
            set(&mut input.images, flags.images.clone().map(Some));
            set(&mut input.pairs, flags.pairs.clone().map(Some));
            if flags.masks.is_some() || flags.no_masks {
                (input.masks, input.no_masks) = (flags.masks.clone(), flags.no_masks);
            }
            set(&mut input.depth_line, flags.depth_line);
            set(&mut input.pixel_centre, flags.pixel_centre);
        }
    }

    /// The scene that flags give by themselves, if they give one.
    pub fn given_scene(flags: &InputFlags) -> Result<Option<Input>> {
        let mut settings = Settings::default();
        settings.apply_input(flags);
        let is_given = settings.input.given().next().is_some();
        is_given.then(|| settings.input.scene()).transpose()
    }

    /// The masks that flags give by themselves.
    pub fn masks_of(flags: &InputFlags) -> Result<Masks> {
        let mut settings = Settings::default();
        settings.apply_input(flags);
        settings.input.masks(&Masks::None)
    }

    impl InputSettings {
        /// The paths of the scenes that are given.
        pub fn given(&self) -> impl Iterator<Item = &Path> {
            let Self { cams, colmap, nerfstudio, bundler, nvm, openmvs, .. } = self;
            [cams, colmap, nerfstudio, bundler, nvm, openmvs].into_iter().filter_map(|kind| kind.as_deref())
        }

        /// The paths of all kinds of scenes; exactly one is expected to be given.
        pub fn kinds(&mut self) -> [&mut Option<PathBuf>; 6] {
            let Self { cams, colmap, nerfstudio, bundler, nvm, openmvs, .. } = self;
            [cams, colmap, nerfstudio, bundler, nvm, openmvs]
        }

        /// The scene's files.
        pub fn scene(&self) -> Result<Input> {
            let Self { cams, colmap, nerfstudio, bundler, nvm, openmvs, images, .. } = self.clone();
            let has_mvsnet_settings = self.pairs.is_some()
                || self.depth_line != DepthLine::default()
                || self.pixel_centre != PixelCentre::default();
            if cams.is_none() && has_mvsnet_settings {
                bail!(
                    "--pairs, --depth-line and --pixel-centre are of MVSNet's layout, whose cameras --cams gives"
                );
            }
            match (cams, colmap, nerfstudio, bundler, nvm, openmvs) {
                (Some(cams), None, None, None, None, None) => {
                    let images = images.context("no photographs: give their folder with --images")?;
                    self.mvsnet(cams, images)
                }
                (None, Some(model), None, None, None, None) => Ok(Input::Colmap { model, images }),
                (None, None, Some(transforms), None, None, None) => {
                    Ok(Input::Nerfstudio { transforms, images })
                }
                (None, None, None, Some(bundle), None, None) => Ok(Input::Bundler { bundle, images }),
                (None, None, None, None, Some(nvm), None) => Ok(Input::Nvm { nvm, images }),
                (None, None, None, None, None, Some(mvs)) => Ok(Input::Openmvs { mvs, images }),
                (None, None, None, None, None, None) => bail!(
                    "no cameras: give a COLMAP model with --colmap, MVSNet cameras with --cams, or --nerfstudio, --bundler, --nvm, --openmvs"
                ),
                _ => bail!(
                    "several kinds of scenes are given: expected one of cams, colmap, nerfstudio, bundler, nvm, openmvs"
                ),
            }
        }

        fn mvsnet(&self, cams: PathBuf, images: PathBuf) -> Result<Input> {
            let options = mvsnet::Options { depth_line: self.depth_line, pixel_centre: self.pixel_centre };
            Ok(Input::Mvsnet { cams, images, pairs: self.pairs.clone(), options })
        }

        /// The masks to use for a scene with the masks `found`.
        pub fn masks(&self, found: &Masks) -> Result<Masks> {
            match &self.masks {
                _ if self.no_masks => Ok(Masks::None),
                None => Ok(found.clone()),
                Some(folder) if folder.is_dir() => Ok(Masks::Folder(folder.clone())),
                Some(missing) => bail!("--masks {}: expected a folder of masks", missing.display()),
            }
        }
    }
}

mod depth {
    use super::*;
    use crate::arguments::DepthFlags;
    use vamvs::Reconstruction;
    use vamvs::io::Loaded;

    impl Settings {
        /// Lets depth flags win.
        pub fn apply_depth(&mut self, flags: &DepthFlags) -> Result<()> {
            if let Some(quality) = quality(flags) {
                self.weights = Some(quality.weights().into());
                self.depth = quality.applied(&self.depth);
            }
            set(&mut self.weights, flags.weights.clone().map(Some));
            let depth = &mut self.depth;
            set(&mut depth.max_size, flags.max_size);
            set(&mut depth.network_size, flags.network_size);
            depth.refine &= !flags.no_refine;
            depth.geometric &= !flags.no_geometric;
            set(&mut depth.enlarge, flags.enlarge);
            set(&mut depth.min_brightness, flags.min_brightness);
            set(&mut depth.max_brightness, flags.max_brightness);
            set(&mut depth.stretch, stretching(flags.stretch.as_deref())?);
            set(&mut depth.views, flags.views);
            set(&mut depth.planes, flags.planes.map(Some));
            set(&mut depth.max_planes, flags.max_planes);
            set(&mut depth.depth_range, depth_range(flags.depth_range.as_deref())?.map(Some));
            set(&mut depth.spacing, flags.spacing.map(Some));
            if let Some(roi) = roi(flags.roi.as_deref())? {
                depth.roi = Some(roi);
                self.fusion.roi = Some(roi);
            }
            self.depth.visibility |= flags.visibility;
            #[cfg(any(feature = "torch", feature = "gpu"))]
            set(&mut self.device, flags.device.device.clone().map(Some));
            #[cfg(feature = "torch")]
            self.apply_network(&flags.network);
            if self.depth.fovea {
                self.fusion.roi = None;
            }
            Ok(())
        }

        #[cfg(feature = "torch")]
        fn apply_network(&mut self, flags: &crate::arguments::NetworkFlags) {
            set(&mut self.depth.coarse_stride, flags.coarse_stride.map(Some));
            set(&mut self.depth.iterations, flags.iterations.map(Some));
            self.depth.fovea |= flags.fovea;
        }

        /// The reconstruction of a scene with these settings; `loaded.masks` are those found with
        /// it.
        pub fn reconstruction(&self, loaded: Loaded) -> Result<Reconstruction> {
            let masks = self.input.masks(&loaded.masks)?;
            let mut reconstruction = Reconstruction::new(loaded).masks(masks).depth(self.depth.clone());
            if let Some(weights) = &self.weights {
                reconstruction = reconstruction.weights(weights);
            }
            if let Some(device) = &self.device {
                reconstruction = reconstruction.device(device);
            }
            Ok(reconstruction)
        }
    }
    /// The quality that is asked for.
    fn quality(flags: &DepthFlags) -> Option<Quality> {
        flags.quality.or(flags.preview.then_some(Quality::Draft))
    }
}
