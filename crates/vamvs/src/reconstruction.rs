//! The entry point for programs: from a scene to its depth maps and its cloud.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use vamvs_core::Scene;
use vamvs_core::depth_range::RangeOrigin;
use vamvs_io::Loaded;
use vamvs_io::masks::Masks;

use crate::depth::draft::{Drafted, draft};
use crate::depth::{DepthJob, DepthSummary};
use crate::event::{OnEvent, warn};
use crate::lenses::warn_of_lenses;
use crate::photographs::Origin;
use crate::{
    DepthOptions, ExportOptions, FuseSummary, FusionOptions, Maps, Method, OutputFolder, PhotoSource,
    Photographs, Plan, Prepared, Quality, VamvsError, ViewPlan, fit,
};

/// A scene and the options of its reconstruction. Defaults are those of the `vamvs` command.
///
/// ```no_run,standalone_crate
/// use std::ops::ControlFlow;
/// use vamvs::{Input, Reconstruction};
///
/// # fn main() -> Result<(), vamvs::VamvsError> {
/// let scene = Input::Colmap { model: "sparse/0".into(), images: Some("images".into()) }.load()?;
/// let done = Reconstruction::new(scene).run("out".as_ref(), &mut |event| {
///     eprintln!("{event:?}");
///     ControlFlow::Continue(())
/// })?;
/// println!("{} points", done.fusion.points);
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Debug)]
#[must_use]
pub struct Reconstruction {
    scene: Scene,
    origin: Origin,
    warnings: Vec<String>,
    weights: Option<PathBuf>,
    device: Option<String>,
    depth: DepthOptions,
    fusion: FusionOptions,
    exports: ExportOptions,
    force: bool,
}

/// What [`Reconstruction::run`] did.
#[derive(Clone, Debug)]
pub struct Reconstructed {
    /// The depth maps.
    pub depth: DepthSummary,
    /// The cloud.
    pub fusion: FuseSummary,
    /// The cloud's file; no new one is written if no point passes the filters.
    pub cloud: PathBuf,
}

impl Reconstruction {
    /// A scene as [`crate::Input::load`] read it, with its photographs and masks.
    pub fn new(loaded: Loaded) -> Self {
        let Loaded { scene, images, masks, warnings, .. } = loaded;
        Self { warnings, ..Self::of(scene, Origin::Files { images, masks }) }
    }

    /// A scene with photographs that the program provides.
    pub fn with_photographs(scene: Scene, photographs: impl PhotoSource + 'static) -> Self {
        Self::of(scene, Origin::Program(Arc::new(photographs)))
    }

    fn of(scene: Scene, origin: Origin) -> Self {
        Self {
            scene,
            origin,
            warnings: Vec::new(),
            weights: None,
            device: None,
            depth: DepthOptions::default(),
            fusion: FusionOptions::default(),
            exports: ExportOptions::default(),
            force: false,
        }
    }

    /// The network: the name of one that is built in, a module's file, or `none` for a plane sweep without one.
    pub fn weights(self, weights: impl Into<PathBuf>) -> Self {
        Self { weights: Some(weights.into()), ..self }
    }

    /// The network and options of a quality; later calls override them.
    pub fn quality(self, quality: Quality) -> Self {
        Self { weights: Some(quality.weights().into()), depth: quality.applied(&self.depth), ..self }
    }

    /// Where the network runs: `auto`, `cpu`, `cuda` or `cuda:N`.
    pub fn device(self, device: impl Into<String>) -> Self {
        Self { device: Some(device.into()), ..self }
    }

    /// How depth maps are made.
    pub fn depth(self, depth: DepthOptions) -> Self {
        Self { depth, ..self }
    }

    /// How depth maps become a cloud.
    pub fn fusion(self, fusion: FusionOptions) -> Self {
        Self { fusion, ..self }
    }

    /// Exports for other programs next to the cloud.
    pub fn exports(self, exports: ExportOptions) -> Self {
        Self { exports, ..self }
    }

    /// Replaces the masks found with the scene, if photographs are files.
    pub fn masks(mut self, wanted: Masks) -> Self {
        if let Origin::Files { masks, .. } = &mut self.origin {
            *masks = wanted;
        }
        self
    }

    /// Whether to make depth maps again that exist already.
    pub fn force(self, force: bool) -> Self {
        Self { force, ..self }
    }

    /// Loads the network and decides what will be done for each view, so that depth maps fit into the memory. Where nothing tells the
    /// depth range of a view but the cameras, a draft of depth maps is made for it.
    ///
    /// # Errors
    /// If the module is invalid, the device does not exist, an option is invalid, no view has
    /// another one that sees the same surfaces, or `on_event` breaks.
    pub fn prepare(self, on_event: &mut OnEvent<'_>) -> Result<Prepared, VamvsError> {
        warn(on_event, self.warnings)?;
        warn(on_event, warn_of_lenses(&self.scene.views))?;
        let method = Method::new(self.weights.as_deref(), self.device.as_deref(), &self.depth)?;
        let photographs = Photographs::of(self.origin, &self.depth);
        let (photographs, note) = photographs.stretched(&self.scene.views, &self.depth);
        warn(on_event, note)?;
        let Drafted { scene, mut method, views: drafted } =
            draft(self.scene, &photographs, method, &self.depth, on_event)?;
        let one_size = self.depth.fovea || !self.depth.refine;
        let photographs = photographs.enlarged_for_network(if one_size { 1.0 } else { method.enlarges_by() });
        let memory = method.memory(self.depth.max_memory);
        let fitted = (&mut method, memory);
        let (photographs, mut plan) =
            fit::fit_to_memory(&scene, &photographs, &self.depth, fitted, on_event)?;
        for view in drafted {
            plan.views[view].iter_mut().for_each(|plan| plan.origin = Some(RangeOrigin::Draft));
        }
        warn(on_event, warning_of_guesses(&plan))?;
        Ok(Prepared { scene, photographs, plan, method, options: self.depth })
    }

    /// Makes the depth maps of all views and fuses them into `fused.ply`, both in the folder `out`. A run that was
    /// interrupted goes on where it was.
    ///
    /// # Errors
    /// As [`Reconstruction::prepare`], [`crate::estimate`] and [`crate::fuse()`].
    pub fn run(self, out: &Path, on_event: &mut OnEvent<'_>) -> Result<Reconstructed, VamvsError> {
        let output = OutputFolder::new(out);
        let (fusion, exports, force) = (self.fusion.clone(), self.exports.clone(), self.force);
        let work = self.prepare(on_event)?;
        exports.expect_apart(out, work.photographs.folder())?;
        let depth = crate::estimate(&DepthJob { work: &work, output: &output, force }, on_event)?;
        // Masked pixels already have no depth.
        let maps = Maps::open(out, Masks::None, on_event)?;
        let cloud = output.cloud();
        let fusion = crate::fuse(&maps, &cloud, &fusion, &exports, on_event)?;
        Ok(Reconstructed { depth, fusion, cloud })
    }
}

/// A warning if depth ranges are known from the cameras alone.
fn warning_of_guesses(plan: &Plan) -> Option<String> {
    let is_guess = |view: &&ViewPlan| view.origin == Some(RangeOrigin::Geometry);
    let guesses = plan.views.iter().flatten().filter(is_guess).count();
    (guesses > 0).then(|| {
        format!(
            "the depth ranges of {guesses} view(s) are guesses from the cameras alone, as there are no sparse points: if depth \
             maps are wrong, give --depth-range NEAR FAR"
        )
    })
}
