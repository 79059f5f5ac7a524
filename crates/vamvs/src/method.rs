//! How the depth is estimated from which refinement starts: by a network, or by a plane sweep without one.

#[cfg(feature = "torch")]
mod network;
mod part;
mod plane_sweep;
mod vis_corr;

use std::fmt;
use std::path::Path;
use std::time::{Duration, Instant};

use vamvs_core::roi::PixelBox;
use vamvs_core::{DepthMap, Grid, MonotoneMap, Photo, Size};

#[cfg(feature = "torch")]
pub use network::NetworkMethod;
pub use vis_corr::VisCorr;

use crate::fit::MethodMemory;
use crate::memory::KeptMemory;
use crate::output::ConfidenceKind;
use crate::{DepthOptions, MemoryLimit, Quality, VamvsError, ViewPlan, weights};

/// How to get what this build is without.
#[cfg(not(feature = "torch"))]
pub const WITH_LIBTORCH: &str = "a build with libtorch (`cargo xtask setup`, then `cargo build --release -p vamvs-cli --features torch`; in \
                                Python `pip install \"vamvs[torch]\"`)";

/// The largest factor by which light networks see small photographs enlarged.
const ENLARGES_BY: f64 = 2.0;

/// How the first depth map of a view is made.
pub enum Method {
    /// By a TorchScript module, which libtorch runs.
    #[cfg(feature = "torch")]
    Network(Box<NetworkMethod>),
    /// By vis-corr, without libtorch.
    VisCorr(Box<VisCorr>),
    /// By a plane sweep over the photographs, with semi-global matching: `--weights none`. It needs no libtorch.
    PlaneSweep,
}

impl fmt::Debug for Method {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.name())
    }
}

/// What a method keeps of a photograph beside its pixels.
pub(crate) enum Features {
    /// Features of the network.
    #[cfg(feature = "torch")]
    Network(Box<vamvs_net::EncodedView>),
    /// Features of vis-corr.
    VisCorr(Box<vamvs_corr::EncodedView>),
    /// The same on a GPU.
    #[cfg(feature = "gpu")]
    Gpu(Box<vamvs_gpu::EncodedView>),
    /// Nothing.
    None,
}

/// A photograph and its features.
pub(crate) struct Encoded {
    pub photo: Photo,
    pub features: Features,
}

impl Encoded {
    /// Bytes that it takes.
    pub fn bytes(&self) -> usize {
        self.features.bytes() + 3 * self.photo.image.data().len()
    }
}

/// Where the time of a method went.
#[derive(Clone, Debug, Default)]
pub(crate) struct Clock {
    /// Stages of the network.
    #[cfg(feature = "torch")]
    pub profile: vamvs_net::Profile,
    /// Stages of other methods.
    stages: Vec<(&'static str, Duration)>,
}

impl Clock {
    /// Runs `work` and adds its time to a stage.
    pub fn time<T>(&mut self, stage: &'static str, work: impl FnOnce() -> T) -> T {
        let begin = Instant::now();
        let result = work();
        let spent = begin.elapsed();
        match self.stages.iter_mut().find(|(name, _)| *name == stage) {
            Some((_, time)) => *time += spent,
            None => self.stages.push((stage, spent)),
        }
        result
    }

    /// The time of each stage.
    pub fn stages(&self) -> Vec<(String, Duration)> {
        let own = self.stages.iter().map(|&(name, time)| (name.to_owned(), time));
        #[cfg(feature = "torch")]
        let own = own.chain(vamvs_net::Stage::ALL.iter().filter_map(|&stage| {
            let time = self.profile.spent(stage);
            (time > Duration::ZERO).then(|| (format!("{stage:?}").to_lowercase(), time))
        }));
        own.collect()
    }
}

/// A reference view, its source views, and what is wanted of them.
pub(crate) struct Task<'a> {
    pub reference: &'a Encoded,
    pub sources: &'a [&'a Encoded],
    pub plan: &'a ViewPlan,
    /// The part of the photograph in which depth is wanted; `None` for all of it.
    pub region: Option<PixelBox>,
}

/// Depth maps of a view, the coarsest first, and how likely each source view sees each pixel, as far as the method tells.
pub(crate) type Estimated = (Vec<DepthMap>, Vec<Grid<f32>>);

impl Method {
    /// The network named `weights` (see [`weights`]) on a device, or the plane sweep for `none`. On the device `auto` vis-corr runs on a
    /// GPU of any vendor, if there is one and the feature `gpu`.
    ///
    /// # Errors
    /// If the module is invalid, the device does not exist, or the method cannot do what the options ask for.
    pub fn new(
        weights: Option<&Path>,
        device: Option<&str>,
        options: &DepthOptions,
    ) -> Result<Self, VamvsError> {
        if weights.is_some_and(weights::is_none) {
            #[cfg(feature = "gpu")]
            if matches!(Device::named(device)?, Device::Gpu(_)) {
                return Err(VamvsError::Request(format!(
                    "--weights none has no network to run on --device {}: it works on the processor",
                    device.unwrap_or_default()
                )));
            }
            return plane_sweep::check(options).map(|()| Self::PlaneSweep);
        }
        let name = weights.unwrap_or(Path::new(Quality::default().weights()));
        let bytes = weights::without_libtorch(name)?;
        let network = |bytes: &[u8]| VisCorr::new(name, bytes, options);
        #[cfg(feature = "gpu")]
        if let (Some(bytes), Some("auto")) = (&bytes, device)
            && let Ok(gpu) = vamvs_gpu::Gpu::open(None)
        {
            return Ok(Self::VisCorr(Box::new(network(bytes)?.on_gpu(gpu)?)));
        }
        match (bytes, Device::named(device)?) {
            (Some(bytes), Device::Processor) => return Ok(Self::VisCorr(Box::new(network(&bytes)?))),
            #[cfg(feature = "gpu")]
            (Some(bytes), Device::Gpu(number)) => {
                return Ok(Self::VisCorr(Box::new(network(&bytes)?.on_gpu(vamvs_gpu::Gpu::open(number)?)?)));
            }
            #[cfg(feature = "gpu")]
            (None, Device::Gpu(_)) => {
                return Err(VamvsError::Request(format!(
                    "{} cannot run on --device {}: expected --weights vis-corr or a .safetensors file there; libtorch's GPUs are \
                     called cuda",
                    name.display(),
                    device.unwrap_or_default(),
                )));
            }
            _ => {}
        }
        #[cfg(feature = "torch")]
        return Ok(Self::Network(Box::new(NetworkMethod::new(weights, device, options)?)));
        #[cfg(not(feature = "torch"))]
        Err(VamvsError::Request(format!(
            "this vamvs was built without libtorch, which {}{} needs: expected --weights vis-corr, a .safetensors file or none, on \
             the processor, or {WITH_LIBTORCH}",
            name.display(),
            device.map_or(String::new(), |device| format!(" on {device}")),
        )))
    }

    /// What it is, to display: `network vis-max on cpu`.
    #[must_use]
    pub fn name(&self) -> String {
        match self {
            #[cfg(feature = "torch")]
            Self::Network(network) => network.name(),
            Self::VisCorr(network) => network.name(),
            Self::PlaneSweep => "plane sweep, without a network".to_owned(),
        }
    }

    /// Whether it runs on a GPU.
    #[must_use]
    pub fn is_on_gpu(&self) -> bool {
        match self {
            #[cfg(feature = "torch")]
            Self::Network(network) => network.device().is_cuda(),
            Self::VisCorr(network) => network.is_on_gpu(),
            Self::PlaneSweep => false,
        }
    }

    /// What matches planes in refinement in place of the processor.
    pub(crate) fn device(&self) -> Option<&dyn vamvs_refine::matching::Device> {
        match self {
            Self::VisCorr(network) => network.matching(),
            _ => None,
        }
    }

    /// Distance between neighbouring planes in the source views, pixels of the photographs.
    pub(crate) fn plane_step(&self) -> f64 {
        match self {
            #[cfg(feature = "torch")]
            Self::Network(network) => network.plane_step(),
            Self::VisCorr(network) => network.plane_step(),
            Self::PlaneSweep => plane_sweep::PLANE_STEP,
        }
    }

    /// The largest factor by which the method sees photographs enlarged that are smaller than the size it may see: a light
    /// network finds more in them.
    pub(crate) fn enlarges_by(&self) -> f64 {
        match self {
            #[cfg(feature = "torch")]
            Self::Network(network) if network.is_light() => ENLARGES_BY,
            Self::VisCorr(_) => ENLARGES_BY,
            _ => 1.0,
        }
    }

    /// Whether it sees a small photograph both enlarged and as it is, and is asked which of them it is surer of. A cascade sees each
    /// photograph at half its size too.
    pub(crate) fn compares_sizes(&self) -> bool {
        match self {
            #[cfg(feature = "torch")]
            Self::Network(network) => !network.is_cascade(),
            Self::VisCorr(_) => false,
            Self::PlaneSweep => true,
        }
    }

    /// Whether its depth maps have no depth where it sees no surface, and a depth everywhere else.
    pub(crate) fn knows_surfaces(&self) -> bool {
        matches!(self, Self::VisCorr(_))
    }

    /// How far beyond the surfaces of its depth maps refinement searches ([`vamvs_refine::RefineOptions::beyond`]).
    pub(crate) fn beyond(&self) -> f32 {
        match self {
            #[cfg(feature = "torch")]
            Self::Network(network) if !network.is_light() => f32::INFINITY,
            _ => 1.0,
        }
    }

    /// The strides of a foveated depth map, the coarsest first.
    pub(crate) fn scales(&self) -> Vec<usize> {
        match self {
            #[cfg(feature = "torch")]
            Self::Network(network) => network.estimator.scales(),
            Self::VisCorr(_) => unreachable!("vis-corr makes no foveated depth maps"),
            Self::PlaneSweep => vec![vamvs_refine::SWEEP_STRIDE],
        }
    }

    /// All that decides its depth maps beside plan and photographs.
    pub(crate) fn identity(&self) -> String {
        match self {
            #[cfg(feature = "torch")]
            Self::Network(network) => network.identity(),
            Self::VisCorr(network) => network.identity(),
            Self::PlaneSweep => "plane sweep 1".to_owned(),
        }
    }

    /// What its confidence is.
    pub(crate) fn confidence(&self) -> ConfidenceKind {
        match self {
            #[cfg(feature = "torch")]
            Self::Network(network) => network.confidence(),
            Self::VisCorr(network) => network.confidence(),
            Self::PlaneSweep => ConfidenceKind::Unknown,
        }
    }

    /// Maps the confidence of refined depth maps to the share of depths that are right, if that was measured.
    pub(crate) fn refined_calibration(&self) -> Option<&MonotoneMap> {
        match self {
            #[cfg(feature = "torch")]
            Self::Network(network) => network.refined_calibration(),
            Self::VisCorr(network) => network.refined_calibration(),
            Self::PlaneSweep => None,
        }
    }

    /// The memory that it works in.
    pub(crate) fn memory(&self, limit: MemoryLimit) -> MethodMemory {
        match self {
            #[cfg(feature = "torch")]
            Self::Network(network) => network.memory(limit),
            Self::VisCorr(network) => network.memory(limit),
            Self::PlaneSweep => MethodMemory::of_process(limit),
        }
    }

    /// What a depth map takes at its peak, bytes.
    pub(crate) fn peak_bytes(&self, photograph: Size, views: usize, planes: usize) -> u64 {
        match self {
            #[cfg(feature = "torch")]
            Self::Network(network) => network.estimator.peak_bytes(photograph, views, planes) as u64,
            Self::VisCorr(network) => network.peak_bytes(photograph, views, planes),
            Self::PlaneSweep => plane_sweep::peak_bytes(photograph, views, planes),
        }
    }

    /// Makes depth maps in pieces smaller by `factor`, so that they take less memory, if the method works in pieces; the result is the
    /// same.
    #[cfg_attr(not(feature = "torch"), expect(unused_variables, reason = "modules alone work in pieces"))]
    pub(crate) fn use_smaller_pieces(&mut self, factor: usize) -> bool {
        match self {
            #[cfg(feature = "torch")]
            Self::Network(network) => {
                network.use_smaller_pieces(factor);
                true
            }
            Self::VisCorr(_) | Self::PlaneSweep => false,
        }
    }

    /// Keeps freed memory while depth maps are made, if that pays: vis-corr needs blocks of the same sizes for each. libtorch's tensors have
    /// many sizes, with which peaks would grow by a fifth, and a plane sweep is not faster for it.
    pub(crate) fn keep_memory(&self) -> Option<KeptMemory> {
        matches!(self, Self::VisCorr(_)).then(KeptMemory::new)
    }

    /// A clock that measures this method.
    pub(crate) fn clock(&self) -> Clock {
        match self {
            #[cfg(feature = "torch")]
            Self::Network(network) => Clock { profile: network.profile(), ..Clock::default() },
            Self::VisCorr(_) | Self::PlaneSweep => Clock::default(),
        }
    }

    /// What the method keeps of a photograph.
    pub(crate) fn encode(&self, photo: &Photo, clock: &mut Clock) -> Result<Features, VamvsError> {
        match self {
            #[cfg(feature = "torch")]
            Self::Network(network) => network.encode(photo, clock),
            Self::VisCorr(network) => network.encode(photo, clock),
            Self::PlaneSweep => Ok(Features::None),
        }
    }

    /// The depth maps of a view.
    pub(crate) fn estimate(&self, task: &Task<'_>, clock: &mut Clock) -> Result<Estimated, VamvsError> {
        match self {
            #[cfg(feature = "torch")]
            Self::Network(network) => network.estimate(task, clock),
            Self::VisCorr(network) => network.estimate(task, clock),
            Self::PlaneSweep => plane_sweep::estimate(task, clock),
        }
    }
}

/// Where a network runs.
enum Device {
    /// On the processor.
    Processor,
    /// On the GPU of this number, or the first that is hardware.
    #[cfg(feature = "gpu")]
    Gpu(Option<usize>),
    /// On a device of libtorch.
    Libtorch,
}

impl Device {
    /// `auto` is here a GPU if libtorch has one. Others are tried as they come: gpu:N is one of wgpu's, cuda and what else libtorch knows
    /// is its.
    fn named(device: Option<&str>) -> Result<Self, VamvsError> {
        let Some(device) = device.filter(|device| *device != "auto") else {
            #[cfg(feature = "torch")]
            return Ok(match vamvs_net::open_device("auto")? {
                vamvs_net::Device::Cpu => Self::Processor,
                _ => Self::Libtorch,
            });
            #[cfg(not(feature = "torch"))]
            return Ok(Self::Processor);
        };
        match device {
            "cpu" => Ok(Self::Processor),
            #[cfg(feature = "gpu")]
            "gpu" => Ok(Self::Gpu(None)),
            _ => match device.strip_prefix("gpu").map(|rest| rest.strip_prefix(':')) {
                None => Ok(Self::Libtorch),
                #[cfg(feature = "gpu")]
                Some(number) => match number.map(str::parse) {
                    Some(Ok(number)) => Ok(Self::Gpu(Some(number))),
                    _ => Err(VamvsError::Request(format!(
                        "--device {device}: expected gpu, or gpu: and its number; `vamvs info device` lists them"
                    ))),
                },
                #[cfg(not(feature = "gpu"))]
                Some(_) => Err(VamvsError::Request(format!(
                    "--device {device}: this vamvs was built without the feature `gpu`, which GPUs of all vendors need"
                ))),
            },
        }
    }
}

/// The GPU with this name (`gpu`, `gpu:N`) for refinement, `None` for the processor (`cpu`, or none named); `auto` is a GPU that is
/// hardware, if there is one.
///
/// # Errors
/// If the GPU does not exist, or has another kind of name.
#[cfg(feature = "gpu")]
pub fn refining_device(name: Option<&str>) -> Result<Option<vamvs_gpu::Gpu>, VamvsError> {
    match name {
        None => Ok(None),
        Some("auto") => Ok(vamvs_gpu::Gpu::open(None).ok()),
        Some(name) => match Device::named(Some(name))? {
            Device::Processor => Ok(None),
            Device::Gpu(number) => Ok(Some(vamvs_gpu::Gpu::open(number)?)),
            Device::Libtorch => Err(VamvsError::Request(format!(
                "--device {name}: expected cpu, gpu, gpu:N or auto; refinement does not use libtorch"
            ))),
        },
    }
}

impl Features {
    /// The memory that they take, bytes.
    pub fn bytes(&self) -> usize {
        match self {
            #[cfg(feature = "torch")]
            Self::Network(features) => features.bytes(),
            Self::VisCorr(features) => features.bytes(),
            #[cfg(feature = "gpu")]
            Self::Gpu(features) => features.bytes(),
            Self::None => 0,
        }
    }
}
