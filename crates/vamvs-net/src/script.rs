//! A TorchScript module that follows the contract of `models/README.md`. The shapes of all outputs are checked.

use std::io::Read;
use std::path::Path;

use tch::{CModule, IValue, Kind, TchError, Tensor};

use crate::correlate::{correlation, pooled};
use crate::error::Libtorch;
use crate::manifest::LARGEST_STRIDE;
use crate::native::layers::{Layers, PairMlp};
use crate::native::readable;
use crate::slabs::Slabs;
use crate::{Device, Manifest, NetError};

/// Which statistics the normalisation layers use.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// The statistics of the current data; the running statistics are updated.
    Training,
    /// The running statistics, which stay as they are.
    Evaluation,
}

/// A network: the learned module and its manifest.
#[derive(Debug)]
pub struct Network {
    module: CModule,
    manifest: Manifest,
    mode: Mode,
    device: Device,
    name: String,
    channel_counts: ChannelCounts,
}

/// The channel counts of a module's outputs, measured when it was loaded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct ChannelCounts {
    /// Values of all features for a block of 8×8 pixels of a photograph.
    pub features: usize,
    /// Channels of the coarse features.
    pub coarse: usize,
    /// Channels of the cost volume.
    pub volume: usize,
    /// Values for each pixel and plane that the first layers output, for a volume that is regularised slab by slab.
    pub first_layers: usize,
    /// Channels after the first layer of `relate`, if kernels run it.
    pub hidden: usize,
    /// Channels of a point: fetched features, pair features, and position.
    pub point: usize,
}

impl Network {
    /// Loads a `.pt` file.
    ///
    /// # Errors
    /// If there is no such file, it holds no TorchScript module, its manifest does not follow the contract, or a method is missing
    /// or returns other shapes than the contract says.
    pub fn load(path: &Path, device: Device) -> Result<Self, NetError> {
        if !path.exists() {
            let text = format!("{}: no such file, expected that of a TorchScript module", path.display());
            return Err(NetError::Request(text));
        }
        let module = CModule::load_on_device(path, device)
            .map_err(|source| NetError::NotAModule { path: path.to_owned(), source: Libtorch(source) })?;
        Self::new(module, device, path.display().to_string())
    }

    /// Loads a module from memory; `name` stands for it in messages.
    ///
    /// # Errors
    /// As [`Network::load`].
    pub fn from_reader(mut reader: impl Read, device: Device, name: &str) -> Result<Self, NetError> {
        let module = CModule::load_data_on_device(&mut reader, device)
            .map_err(|source| NetError::NotAModule { path: name.into(), source: Libtorch(source) })?;
        Self::new(module, device, name.to_owned())
    }

    fn new(mut module: CModule, device: Device, name: String) -> Result<Self, NetError> {
        // Sizes change from call to call, so specialising the graph to them costs more than it saves.
        tch::jit::f_set_graph_executor_optimize(false)?;
        module.f_set_eval()?;
        let answer = module.method_is::<IValue>("manifest", &[]);
        let text = answer.and_then(|answer| match answer {
            IValue::String(text) => Ok(text),
            other => Err(TchError::Kind(format!("manifest() gave {other:?}"))),
        });
        let text = text.map_err(|source| NetError::Method {
            module: name.clone(),
            method: "manifest",
            expected: "() → JSON string",
            source: Libtorch(source),
        })?;
        let manifest = Manifest::parse(&text, &name)?;
        let mut network = Self {
            module,
            manifest,
            mode: Mode::Evaluation,
            device,
            name,
            channel_counts: ChannelCounts::default(),
        };
        network.channel_counts = tch::no_grad(|| network.probe())?;
        Ok(network)
    }

    /// The module's manifest.
    #[must_use]
    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// The trainable parameters by name; they share memory with the module's.
    ///
    /// # Errors
    /// If the module does not list them.
    pub fn parameters(&self) -> Result<Vec<(String, Tensor)>, NetError> {
        let mut parameters = self.module.named_parameters()?;
        parameters.retain(|(_, parameter)| parameter.requires_grad());
        Ok(parameters)
    }

    /// Sets the mode of the normalisation layers; a network is loaded in [`Mode::Evaluation`].
    ///
    /// # Errors
    /// If the module cannot change its mode.
    pub fn set_mode(&mut self, mode: Mode) -> Result<(), NetError> {
        match mode {
            Mode::Training => self.module.f_set_train()?,
            Mode::Evaluation => self.module.f_set_eval()?,
        }
        self.mode = mode;
        Ok(())
    }

    /// Whether kernels run the network's layers: the module gives them, its normalisation uses the running statistics, and
    /// the features (1, C, h, w) are readable.
    pub(crate) fn runs_layers(&self, features: &[Tensor]) -> bool {
        self.manifest.layers && self.mode == Mode::Evaluation && readable(features)
    }

    /// The layers, with the weights of now, if kernels run them.
    pub(crate) fn kernel_layers(&self, features: &[Tensor]) -> Result<Option<Layers>, NetError> {
        self.runs_layers(features).then(|| self.layers()).transpose()
    }

    fn layers(&self) -> Result<Layers, NetError> {
        let answer = tch::no_grad(|| self.module.method_is::<IValue>("layers", &[]));
        let expected = "() → dictionary of lists of tensors";
        let answer = answer.map_err(|source| self.failed("layers", expected, source))?;
        Layers::of(answer, &self.manifest).map_err(|problem| self.layers_differ(&problem))
    }

    fn layers_differ(&self, problem: &str) -> NetError {
        NetError::Manifest {
            module: self.name.clone(),
            problem: format!(
                "says that it has layers for the kernels of this program, which do not fit: {problem}"
            ),
        }
    }

    /// The current mode of the normalisation layers.
    #[must_use]
    pub fn mode(&self) -> Mode {
        self.mode
    }

    /// Replaces the module's manifest, for example after training.
    ///
    /// # Errors
    /// If the module has no method `set_manifest`.
    pub fn set_manifest(&mut self, manifest: Manifest) -> Result<(), NetError> {
        let text = serde_json::to_string(&manifest).expect("a manifest is plain data");
        let answer = self.module.method_is("set_manifest", &[IValue::String(text)]);
        answer.map_err(|source| self.failed("set_manifest", "(JSON string) → nothing", source))?;
        self.manifest = manifest;
        Ok(())
    }

    /// Sets the coarse stride, 8 or 4 pixels of the photograph; the module stays as it is. If the stride changes, the
    /// calibrations of the confidence are dropped.
    ///
    /// # Errors
    /// If the stride is neither the stride of the network's features nor half of a feature stride of 8.
    pub fn set_coarse_stride(&mut self, coarse_stride: usize) -> Result<(), NetError> {
        self.manifest.check_strides(coarse_stride).map_err(NetError::Request)?;
        if coarse_stride != self.manifest.coarse_stride {
            self.manifest.coarse_stride = coarse_stride;
            self.manifest.calibration = None;
            self.manifest.refined_calibration = None;
        }
        Ok(())
    }

    /// Writes the module with its parameters, statistics and manifest to a `.pt` file.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn save(&self, path: &Path) -> Result<(), NetError> {
        Ok(self.module.save(path)?)
    }

    /// The device of the module.
    #[must_use]
    pub fn device(&self) -> Device {
        self.device
    }

    /// The channel counts of the module's outputs.
    pub(crate) fn channel_counts(&self) -> ChannelCounts {
        self.channel_counts
    }

    /// Calls every method that the aggregation uses once on tiny inputs, so that a wrong module is refused when it is
    /// loaded. Returns the channel counts of the outputs.
    fn probe(&self) -> Result<ChannelCounts, NetError> {
        let image = Tensor::f_rand([1, 3, 8 * SIDE, 8 * SIDE], (Kind::Float, self.device))?;
        let levels = self.encode_flow(&image)?;
        let coarse = match self.shared_level() {
            Some(level) => levels[level].shallow_clone(),
            None => self.encode_coarse(&image)?,
        };
        if self.manifest.coarse_alone {
            let shape: Vec<_> = coarse.size().into_iter().map(Some).collect();
            self.check("encode_coarse", &self.encode_coarse(&image)?, &shape)?;
        }
        let (volume, first_layers) = self.probe_volume(&coarse)?;
        let point = self.probe_flow(&levels)?;
        let hidden = match self.manifest.layers {
            true => self.probe_layers(&coarse, &levels, volume)?,
            false => 0,
        };
        // If one pyramid serves both stages, its features are counted once.
        let own = self.shared_level().is_none().then_some(&coarse);
        let features = levels.iter().chain(own).map(Tensor::numel).sum::<usize>() / (SIDE * SIDE) as usize;
        Ok(ChannelCounts { features, coarse: coarse.size()[1] as usize, volume, first_layers, hidden, point })
    }

    /// The level of `encode_flow` that is also used as coarse features, if one pyramid serves both stages.
    pub(crate) fn shared_level(&self) -> Option<usize> {
        let Manifest { aggregation, feature_stride, .. } = self.manifest;
        aggregation.correlates().then(|| usize::from(feature_stride == LARGEST_STRIDE) + 1)
    }

    /// Runs the coarse stage on tiny features (1, C, h, w). Returns [`ChannelCounts::volume`] and
    /// [`ChannelCounts::first_layers`].
    fn probe_volume(&self, coarse: &Tensor) -> Result<(usize, usize), NetError> {
        let aggregation = self.manifest.aggregation;
        let (_, channels, h, w) = coarse.size4()?;
        let planes = 8;
        let slab = coarse.f_expand([planes, channels, h, w], false)?;
        let depth = Tensor::f_rand([planes], (Kind::Float, self.device))?;
        let related = if aggregation.correlates() {
            self.check_groups("encode_flow", channels)?;
            correlation(coarse, &slab, self.manifest.group)?
        } else if aggregation.relates_pairs() || aggregation.weighs_views() {
            self.relate(coarse, &slab, &depth)?
        } else {
            slab
        };
        let pooled = if aggregation.correlates() { pooled(&related)? } else { related.f_amax([0], true)? };
        let volume_channels = if aggregation.weighs_views() {
            let _mask = self.visibility(&pooled)?;
            if aggregation.correlates() { related.size()[1] } else { channels }
        } else {
            related.size()[1]
        };
        self.check_averaged(volume_channels)?;
        let volume = Tensor::f_rand([1, volume_channels, planes, h, w], (Kind::Float, self.device))?;
        let _costs = self.regularize(&volume, coarse)?;
        if self.manifest.cascade.is_some() {
            let _costs = self.regularize_fine(&volume, coarse)?;
            let evidence = Tensor::f_rand([1, EVIDENCE, h, w], (Kind::Float, self.device))?;
            let _surface = self.surface(&evidence, coarse)?;
            let small = coarse.f_narrow(2, 0, h / 2)?.f_narrow(3, 0, w / 2)?;
            let depth = Tensor::f_rand([h / 2, w / 2], (Kind::Float, self.device))?;
            let _shares = self.enlarge_depth(&depth, &small, coarse)?;
        }
        let mut first_layers = 0;
        if self.manifest.slabs {
            let mut slabs = Slabs::new(self, planes as usize);
            slabs.add(&volume)?;
            first_layers = slabs.values();
            let _costs = slabs.finish()?;
        }
        Ok((volume_channels as usize, first_layers))
    }

    /// Runs the flow on a few points. Returns [`ChannelCounts::point`]; 0 of a network without a flow.
    fn probe_flow(&self, levels: &[Tensor; 3]) -> Result<usize, NetError> {
        let (aggregation, f32) = (self.manifest.aggregation, (Kind::Float, self.device));
        if !aggregation.has_flow() {
            return Ok(0);
        }
        let points = 8 * (2 * self.manifest.hypotheses as i64 + 1);
        let channels: i64 = levels.iter().map(|level| level.size()[1]).sum();
        let fetched = Tensor::f_rand([1, channels, points], f32)?;
        let related =
            if aggregation.relates_pairs() { self.relate_flow(&fetched, &fetched)? } else { fetched };
        let point = channels + related.size()[1] + POSITION_CHANNELS;
        let inputs = Tensor::f_cat(&[related, Tensor::f_rand([1, POSITION_CHANNELS, points], f32)?], 1)?;
        let neighbours =
            Tensor::f_zeros([1, points, self.manifest.neighbours as i64], (Kind::Int64, self.device))?;
        let _scores = self.flow(&inputs, &neighbours)?;
        Ok(point as usize)
    }

    /// Checks the layers that kernels run against the channels that the methods take and give; `volume` is
    /// [`ChannelCounts::volume`]. Returns [`ChannelCounts::hidden`].
    fn probe_layers(&self, coarse: &Tensor, levels: &[Tensor; 3], volume: usize) -> Result<usize, NetError> {
        let layers = self.layers()?;
        let channels = |features: &Tensor| features.size()[1] as usize;
        let flow = levels.iter().map(channels).sum();
        let related = layers.relate_flow.as_ref().map_or(flow, PairMlp::outputs);
        let differ = |problem: String| self.layers_differ(&problem);
        let Manifest { averaged, .. } = self.manifest;
        layers.check(channels(coarse), flow, related + POSITION_CHANNELS as usize).map_err(differ)?;
        let Some(relate) = &layers.relate else { return Ok(0) };
        if relate.outputs() + averaged != volume {
            let found = relate.outputs();
            return Err(self.layers_differ(&format!(
                "relate gives {found} channels: expected those of the method relate without the averaged ones, {}",
                volume - averaged
            )));
        }
        Ok(relate.of_reference.outputs())
    }

    /// Checks that a number of channels is a multiple of the group size.
    fn check_groups(&self, method: &'static str, channels: i64) -> Result<(), NetError> {
        let group = self.manifest.group;
        if channels % group as i64 == 0 {
            return Ok(());
        }
        let problem =
            format!("says that groups have {group} channels, but {method} gives {channels}, not a multiple");
        Err(NetError::Manifest { module: self.name.clone(), problem })
    }

    /// Checks that the averaged channels are some, but not all, of those that `relate` gives.
    fn check_averaged(&self, channels: i64) -> Result<(), NetError> {
        let Manifest { averaged, aggregation, .. } = self.manifest;
        if averaged == 0 || (aggregation.relates_pairs() && (averaged as i64) < channels) {
            return Ok(());
        }
        let problem = format!(
            "says that {averaged} channels are averaged: expected fewer than the {channels} that relate gives, and \
             an aggregation of pairs of views"
        );
        Err(NetError::Manifest { module: self.name.clone(), problem })
    }

    /// (N, 3, H, W) in [0, 1] → (N, C, H/s, W/s) at the stride s of the coarse features, 8 or, for vis-corr, also 4.
    pub(crate) fn encode_coarse(&self, images: &Tensor) -> Result<Tensor, NetError> {
        let (n, _, h, w) = images.size4()?;
        let expected = "(images (N, 3, H, W)) → (N, C, H/s, W/s)";
        let features = self.call("encode_coarse", expected, &[images])?;
        let scale = self.manifest.feature_stride as i64;
        self.check("encode_coarse", &features, &[Some(n), None, Some(h / scale), Some(w / scale)])?;
        Ok(features)
    }

    /// (N, 3, H, W) in [0, 1] → (N, C₁, H/2, W/2), (N, C₂, H/4, W/4), (N, C₃, H/8, W/8).
    pub(crate) fn encode_flow(&self, images: &Tensor) -> Result<[Tensor; 3], NetError> {
        let (n, _, h, w) = images.size4()?;
        let method = "encode_flow";
        let expected = "(images (N, 3, H, W)) → three tensors at H/2, H/4, H/8";
        let answer = self.module.method_is(method, &[&IValue::Tensor(images.shallow_clone())]);
        let levels = answer.and_then(<(Tensor, Tensor, Tensor)>::try_from);
        let (half, quarter, eighth) = levels.map_err(|source| self.failed(method, expected, source))?;
        for (level, scale) in [(&half, 2), (&quarter, 4), (&eighth, 8)] {
            self.check(method, level, &[Some(n), None, Some(h / scale), Some(w / scale)])?;
        }
        Ok([half, quarter, eighth])
    }

    /// Reference features (1, C, h, w), warped source features (D, C, h, w), plane coordinates scaled to [0, 1] (D) →
    /// pair features (D, C', h, w).
    pub(crate) fn relate(
        &self,
        reference: &Tensor,
        source: &Tensor,
        depth: &Tensor,
    ) -> Result<Tensor, NetError> {
        let (d, _, h, w) = source.size4()?;
        let expected = "(ref (1, C, h, w), src (D, C, h, w), depth (D)) → (D, C', h, w)";
        let related = self.call("relate", expected, &[reference, source, depth])?;
        self.check("relate", &related, &[Some(d), None, Some(h), Some(w)])?;
        Ok(related)
    }

    /// Pair features, or correlations, pooled over the planes (1, C', h, w) → visibility in [0, 1] (1, 1, h, w).
    pub(crate) fn visibility(&self, pooled: &Tensor) -> Result<Tensor, NetError> {
        let (n, _, h, w) = pooled.size4()?;
        let mask = self.call("visibility", "(pooled (N, C', h, w)) → (N, 1, h, w)", &[pooled])?;
        self.check("visibility", &mask, &[Some(n), Some(1), Some(h), Some(w)])?;
        Ok(mask)
    }

    /// Aggregated volume (1, C', D, h, w) and coarse features of the reference view (1, C, h, w), which are used if the
    /// manifest has `context` → costs (1, D, h, w); a low cost is likely.
    pub(crate) fn regularize(&self, volume: &Tensor, reference: &Tensor) -> Result<Tensor, NetError> {
        let (n, _, d, h, w) = volume.size5()?;
        let (method, expected, inputs): (_, _, &[&Tensor]) = match self.manifest.context {
            true => (
                "regularize_in_context",
                "(volume (B, C', D, h, w), ref (B, C, h, w)) → (B, D, h, w)",
                &[volume, reference],
            ),
            false => ("regularize", "(volume (B, C', D, h, w)) → (B, D, h, w)", &[volume]),
        };
        let costs = self.call(method, expected, inputs)?;
        self.check(method, &costs, &[Some(n), Some(d), Some(h), Some(w)])?;
        Ok(costs)
    }

    /// A cascade's second volume (1, C', K, h, w) and the coarse features of the reference view (1, C, h, w) → costs
    /// (1, K, h, w); a low cost is likely.
    pub(crate) fn regularize_fine(&self, volume: &Tensor, reference: &Tensor) -> Result<Tensor, NetError> {
        let (n, _, d, h, w) = volume.size5()?;
        let expected = "(volume (B, C', K, h, w), ref (B, C, h, w)) → (B, K, h, w)";
        let costs = self.call("regularize_fine", expected, &[volume, reference])?;
        self.check("regularize_fine", &costs, &[Some(n), Some(d), Some(h), Some(w)])?;
        Ok(costs)
    }

    /// A cascade's first depth map (h, w) in plane coordinates, and the coarse features of the reference view in the photograph
    /// at half its size (1, C, h, w) and as it is (1, C, 2h, 2w) → shares of the 3×3 pixels around each (1, 9, 2h, 2w).
    pub(crate) fn enlarge_depth(
        &self,
        depth: &Tensor,
        coarse: &Tensor,
        reference: &Tensor,
    ) -> Result<Tensor, NetError> {
        let (n, _, h, w) = reference.size4()?;
        let expected = "(depth (1, 1, h, w), coarse (1, C, h, w), ref (1, C, 2h, 2w)) → (1, 9, 2h, 2w)";
        let depth = depth.f_unsqueeze(0)?.f_unsqueeze(0)?;
        let shares = self.call("enlarge", expected, &[&depth, coarse, reference])?;
        self.check("enlarge", &shares, &[Some(n), Some(9), Some(h), Some(w)])?;
        Ok(shares)
    }

    /// What a cascade's volumes tell of surfaces (1, 6, h, w; see [`crate::cascade::Fine`]) and the coarse features of the
    /// reference view (1, C, h, w) → probability of a surface (1, 1, h, w).
    pub(crate) fn surface(&self, evidence: &Tensor, reference: &Tensor) -> Result<Tensor, NetError> {
        let (n, _, h, w) = evidence.size4()?;
        let expected = "(evidence (B, 6, h, w), ref (B, C, h, w)) → (B, 1, h, w)";
        let surface = self.call("surface", expected, &[evidence, reference])?;
        self.check("surface", &surface, &[Some(n), Some(1), Some(h), Some(w)])?;
        Ok(surface)
    }

    /// D planes of the volume with one more before and after them, (1, C', D + 2, h, w) → the outputs of the first
    /// layers at full and at half resolution, (1, a, D, h', w') and (1, b, D/2, h'/2, w'/2).
    pub(crate) fn regularize_slab(&self, planes: &Tensor) -> Result<(Tensor, Tensor), NetError> {
        let (n, _, d, ..) = planes.size5()?;
        let method = "regularize_slab";
        let expected = "(planes (1, C', D + 2, h, w)) → (1, a, D, h', w'), (1, b, D/2, h'/2, w'/2)";
        let answer = self.module.method_is(method, &[&IValue::Tensor(planes.shallow_clone())]);
        let answer = answer.and_then(<(Tensor, Tensor)>::try_from);
        let (full, half) = answer.map_err(|source| self.failed(method, expected, source))?;
        self.check(method, &full, &[Some(n), None, Some(d - 2), None, None])?;
        self.check(method, &half, &[Some(n), None, Some((d - 2) / 2), None, None])?;
        Ok((full, half))
    }

    /// The outputs of `regularize_slab` for all planes, and the averaged channels of the volume (1, A, D, h, w) → costs
    /// (1, D, h, w). Overwrites `full` and `half`.
    pub(crate) fn regularize_slabs(
        &self,
        full: &Tensor,
        half: &Tensor,
        averaged: &Tensor,
    ) -> Result<Tensor, NetError> {
        let (n, _, d, h, w) = averaged.size5()?;
        let expected = "(full (1, a, D', h', w'), half (1, b, D'/2, h'/2, w'/2), averaged (1, A, D, h, w)) → (1, D, h, w)";
        let costs = self.call("regularize_slabs", expected, &[full, half, averaged])?;
        self.check("regularize_slabs", &costs, &[Some(n), Some(d), Some(h), Some(w)])?;
        Ok(costs)
    }

    /// Fetched features of the reference (1, C, P) and of a source view (B, C, P) → pair features (B, C'', P).
    pub(crate) fn relate_flow(&self, reference: &Tensor, source: &Tensor) -> Result<Tensor, NetError> {
        let (b, _, p) = source.size3()?;
        let expected = "(ref (1, C, P), src (B, C, P)) → (B, C'', P)";
        let related = self.call("relate_flow", expected, &[reference, source])?;
        self.check("relate_flow", &related, &[Some(b), None, Some(p)])?;
        Ok(related)
    }

    /// Features (B, C'' + 24, P) and neighbours' indices (B, P, k) → scores (B, P); a low score is likely.
    pub(crate) fn flow(&self, features: &Tensor, neighbours: &Tensor) -> Result<Tensor, NetError> {
        let (b, _, p) = features.size3()?;
        let expected = "(features (B, C'' + 24, P), neighbours (B, P, k)) → (B, P)";
        let scores = self.call("flow", expected, &[features, neighbours])?;
        self.check("flow", &scores, &[Some(b), Some(p)])?;
        Ok(scores)
    }

    fn call(
        &self,
        method: &'static str,
        expected: &'static str,
        inputs: &[&Tensor],
    ) -> Result<Tensor, NetError> {
        self.module.method_ts(method, inputs).map_err(|source| self.failed(method, expected, source))
    }

    fn failed(&self, method: &'static str, expected: &'static str, source: TchError) -> NetError {
        NetError::Method { module: self.name.clone(), method, expected, source: Libtorch(source) }
    }

    /// Checks the shape of an output; `None` stands for any size.
    fn check(&self, method: &'static str, tensor: &Tensor, expected: &[Option<i64>]) -> Result<(), NetError> {
        let found = tensor.size();
        let fits = found.len() == expected.len()
            && found.iter().zip(expected).all(|(found, expected)| expected.is_none_or(|e| e == *found));
        if fits {
            return Ok(());
        }
        let names: Vec<_> =
            expected.iter().map(|side| side.map_or("C".to_owned(), |side| side.to_string())).collect();
        Err(NetError::Shape {
            module: self.name.clone(),
            method,
            expected: format!("({})", names.join(", ")),
            found,
        })
    }
}

/// Channels of what a cascade's volumes tell of surfaces.
pub(crate) const EVIDENCE: i64 = 6;

/// The side of the probe's image, in blocks of 8 pixels.
const SIDE: i64 = 4;

/// Channels of a point's normalised position: x, y, z, repeated 8 times (section 3.3).
pub(crate) const POSITION_CHANNELS: i64 = 24;
