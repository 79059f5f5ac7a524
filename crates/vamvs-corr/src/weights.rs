//! The weights of a network: tensors with the names of the PyTorch module, in a safetensors file.

use std::collections::HashMap;

use half::f16;
use safetensors::{Dtype, SafeTensors};
use serde::{Deserialize, Serialize};
use vamvs_core::MonotoneMap;

use crate::CorrError;
use crate::convolution::{Convolution, Kernel, Moves};
use crate::to_one::ToOne;

/// The entry of the file's metadata that describes the network.
const MANIFEST: &str = "manifest";

/// PyTorch's default epsilon of a BatchNorm.
const EPSILON: f32 = 1e-5;

/// What a file says of its network, the part of the module's manifest that matters here.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
pub struct Manifest {
    /// The network's name.
    pub name: String,
    /// What it is: `vis-corr`.
    pub aggregation: String,
    /// Channels in a group of the correlation.
    pub group: usize,
    /// Stride of the depth map, pixels of the photograph.
    pub feature_stride: usize,
    /// The soft-argmin is taken over the planes within this many of the most probable one.
    pub window: usize,
    /// The planes of the second volume.
    pub cascade: Cascade,
    /// Distance between neighbouring planes in the source views, pixels of the photograph.
    pub plane_step: f64,
    /// What the weights were trained on.
    #[serde(default)]
    pub trained_on: String,
    /// Their licence.
    #[serde(default)]
    pub licence: String,
    /// Maps the confidence to the fraction of pixels with an error of at most 1 %.
    #[serde(default)]
    pub calibration: Option<MonotoneMap>,
    /// The same for refined depth maps.
    #[serde(default)]
    pub refined_calibration: Option<MonotoneMap>,
}

/// The planes of a cascade's second volume.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
pub struct Cascade {
    /// Their number.
    pub planes: usize,
    /// Their distance, in distances of the first volume's planes.
    pub step: f64,
}

/// Tensors by name.
#[derive(Debug)]
pub struct Weights {
    tensors: HashMap<String, Tensor>,
}

#[derive(Debug)]
struct Tensor {
    shape: Vec<usize>,
    values: Vec<f32>,
}

impl Weights {
    /// The tensors of a safetensors file, single or half precision, and its manifest.
    ///
    /// # Errors
    /// If the file is none, or has no manifest of a vis-corr.
    pub fn read(bytes: &[u8]) -> Result<(Self, Manifest), CorrError> {
        let wrong = |problem: String| CorrError::Weights { problem };
        let (_, header) = SafeTensors::read_metadata(bytes).map_err(|error| {
            wrong(format!("expected a safetensors file with the weights of a vis-corr: {error}"))
        })?;
        let manifest = header.metadata().as_ref().and_then(|entries| entries.get(MANIFEST));
        let manifest = manifest
            .ok_or_else(|| wrong(format!("expected the entry {MANIFEST} in the metadata, found none")))?;
        let manifest: Manifest = serde_json::from_str(manifest).map_err(|error| {
            wrong(format!("the manifest is not that of a vis-corr that is a cascade: {error}"))
        })?;
        manifest.check().map_err(|problem| wrong(format!("the manifest {problem}")))?;
        let file = SafeTensors::deserialize(bytes).map_err(|error| wrong(error.to_string()))?;
        let mut tensors = HashMap::new();
        for (name, view) in file.iter() {
            let values = values_of(view.dtype(), view.data()).ok_or_else(|| {
                wrong(format!("{name}: expected values of type F32 or F16, found {:?}", view.dtype()))
            })?;
            if let Some(at) = values.iter().position(|value| !value.is_finite()) {
                return Err(wrong(format!("{name}: value {at} is {}", values[at])));
            }
            tensors.insert(name.to_owned(), Tensor { shape: view.shape().to_vec(), values });
        }
        Ok((Self { tensors }, manifest))
    }

    /// A tensor of this shape.
    fn get(&self, name: &str, shape: &[usize]) -> Result<&[f32], CorrError> {
        let wrong = |found: String| CorrError::Weights {
            problem: format!("{name}: expected a tensor {shape:?}, found {found}"),
        };
        let tensor = self.tensors.get(name).ok_or_else(|| wrong("none".to_owned()))?;
        if tensor.shape != shape {
            return Err(wrong(format!("{:?}", tensor.shape)));
        }
        Ok(&tensor.values)
    }

    /// A convolution without normalisation, (outputs, inputs) over the last sides of the kernel; `dims` is 2 or 3.
    pub fn plain(&self, name: &str, layer: &Shape, has_bias: bool) -> Result<Kernel, CorrError> {
        let weights = self.get(&format!("{name}.weight"), &layer.shape())?.to_vec();
        let shift = match has_bias {
            true => self.get(&format!("{name}.bias"), &[layer.outputs])?.to_vec(),
            false => vec![0.0; layer.outputs],
        };
        let Shape { outputs, inputs, .. } = *layer;
        Ok(Kernel { outputs, inputs, sides: layer.sides(), weights, shift })
    }

    /// A convolution `conv` with the BatchNorm `norm` that follows, folded into its weights.
    pub fn normalised(&self, name: &str, layer: &Shape) -> Result<Kernel, CorrError> {
        let mut kernel = self.plain(&format!("{name}.conv"), layer, false)?;
        let of_norm = |part: &str| self.get(&format!("{name}.norm.{part}"), &[layer.outputs]);
        let (mean, variance) = (of_norm("running_mean")?, of_norm("running_var")?);
        let (weight, bias) = (of_norm("weight")?, of_norm("bias")?);
        let scale: Vec<f32> = weight.iter().zip(variance).map(|(w, v)| w / (v + EPSILON).sqrt()).collect();
        let places = kernel.sides.iter().product::<usize>();
        for (at, weights) in kernel.weights.chunks_exact_mut(places).enumerate() {
            let output = if layer.transposed { at % layer.outputs } else { at / layer.inputs };
            weights.iter_mut().for_each(|weight| *weight *= scale[output]);
        }
        for (output, shift) in kernel.shift.iter_mut().enumerate() {
            *shift = bias[output] - mean[output] * scale[output];
        }
        Ok(kernel)
    }
}

impl Manifest {
    /// Checks that the network is one that this crate runs.
    fn check(&self) -> Result<(), String> {
        let Self { aggregation, group, feature_stride, cascade, plane_step, .. } = self;
        if aggregation != "vis-corr" || *group != 4 || *feature_stride != 4 {
            return Err(format!(
                "is of a network {aggregation} with groups of {group} channels and a stride of {feature_stride}: expected vis-corr, 4, 4"
            ));
        }
        let Cascade { planes, step } = *cascade;
        if !(2..=64).contains(&planes) || !(0.01..=8.0).contains(&step) {
            return Err(format!(
                "has a cascade of {planes} planes (expected 2 to 64) with a step of {step} (expected 0.01 to 8)"
            ));
        }
        if !(0.5..=64.0).contains(plane_step) {
            return Err(format!("has planes {plane_step} pixels apart: expected 0.5 to 64"));
        }
        Ok(())
    }
}

fn values_of(kind: Dtype, bytes: &[u8]) -> Option<Vec<f32>> {
    match kind {
        Dtype::F32 => Some(bytes.as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect()),
        Dtype::F16 => {
            Some(bytes.as_chunks().0.iter().map(|bytes| f16::from_le_bytes(*bytes).to_f32()).collect())
        }
        _ => None,
    }
}

/// The channels and the sides of a layer's kernel.
#[derive(Clone, Copy, Debug)]
pub struct Shape {
    inputs: usize,
    outputs: usize,
    side: usize,
    dims: usize,
    transposed: bool,
}

impl Shape {
    /// Of a layer on images.
    pub const fn image(inputs: usize, outputs: usize, side: usize) -> Self {
        Self { inputs, outputs, side, dims: 2, transposed: false }
    }

    /// Of a layer on volumes.
    pub const fn volume(inputs: usize, outputs: usize, side: usize) -> Self {
        Self { dims: 3, ..Self::image(inputs, outputs, side) }
    }

    fn transposed(self) -> Self {
        Self { transposed: true, ..self }
    }

    fn sides(&self) -> [usize; 3] {
        if self.dims == 3 { [self.side; 3] } else { [1, self.side, self.side] }
    }

    fn shape(&self) -> Vec<usize> {
        let channels =
            if self.transposed { [self.inputs, self.outputs] } else { [self.outputs, self.inputs] };
        channels.into_iter().chain(std::iter::repeat_n(self.side, self.dims)).collect()
    }
}

/// Layers from weights, with the strides and paddings of this network: an even kernel halves.
impl Weights {
    /// A convolution with its normalisation; a side of 4 halves an image, `stride` a volume.
    pub fn layer(&self, name: &str, shape: Shape, stride: usize) -> Result<Convolution, CorrError> {
        Ok(Convolution::new(&self.normalised(name, &shape)?, moves(&shape, stride, 1)))
    }

    /// A convolution without normalisation.
    pub fn bare(&self, name: &str, shape: Shape, has_bias: bool) -> Result<Convolution, CorrError> {
        Ok(Convolution::new(&self.plain(name, &shape, has_bias)?, moves(&shape, 1, 1)))
    }

    /// A convolution without normalisation whose places are 2 apart.
    pub fn dilated(&self, name: &str, shape: Shape) -> Result<Convolution, CorrError> {
        Ok(Convolution::new(&self.plain(name, &shape, true)?, moves(&shape, 1, 2)))
    }

    /// A transposed convolution with its normalisation.
    pub fn doubling(&self, name: &str, inputs: usize, outputs: usize) -> Result<Convolution, CorrError> {
        Ok(Convolution::doubling(&self.normalised(name, &Shape::volume(inputs, outputs, 3).transposed())?))
    }

    /// A convolution to one channel, without normalisation.
    pub fn to_one(&self, name: &str, shape: Shape, has_bias: bool) -> Result<ToOne, CorrError> {
        Ok(ToOne::new(&self.plain(name, &shape, has_bias)?, moves(&shape, 1, 1).padding))
    }
}

fn moves(shape: &Shape, stride: usize, dilation: usize) -> Moves {
    let padding = shape.sides().map(|side| dilation * ((side - 1) / 2));
    Moves { stride, padding, dilation }
}

#[cfg(test)]
mod tests {
    use safetensors::tensor::TensorView;

    use super::*;

    /// The built-in weights with one change to the values of a tensor and to the manifest.
    fn changed(name: &str, change: impl Fn(&mut Vec<u8>), manifest: impl Fn(&str) -> String) -> Vec<u8> {
        let bytes = vamvs_weights::VIS_CORR;
        let (_, header) = SafeTensors::read_metadata(bytes).expect("the built-in weights");
        let mut entries = header.metadata().clone().expect("metadata");
        let text = manifest(&entries[MANIFEST]);
        entries.insert(MANIFEST.to_owned(), text);
        let file = SafeTensors::deserialize(bytes).expect("the built-in weights");
        let tensors: Vec<(String, Dtype, Vec<usize>, Vec<u8>)> = file
            .iter()
            .map(|(own, view)| {
                let mut data = view.data().to_vec();
                if own == name {
                    change(&mut data);
                }
                (own.to_owned(), view.dtype(), view.shape().to_vec(), data)
            })
            .collect();
        let views = tensors.iter().map(|(name, kind, shape, data)| {
            (name.clone(), TensorView::new(*kind, shape.clone(), data).expect("a tensor"))
        });
        safetensors::serialize(views, Some(entries)).expect("tensors")
    }

    fn problem(bytes: &[u8]) -> String {
        crate::Network::new(bytes).expect_err("damaged weights").to_string()
    }

    #[test]
    fn damaged_weights_and_those_of_other_networks_are_named() {
        let whole = vamvs_weights::VIS_CORR;
        assert!(crate::Network::new(whole).is_ok());
        for length in [0, 7, 100, whole.len() - 1] {
            assert!(problem(&whole[..length]).contains("safetensors"), "cut to {length} bytes");
        }
        assert!(problem(b"not weights at all, but a text").contains("safetensors"));
        let same = |text: &str| text.to_owned();
        let name = "seen.2.bias";
        let said = problem(&changed(name, |data| data.copy_from_slice(&f32::NAN.to_le_bytes()), same));
        assert!(said.contains(name) && said.contains("NaN"), "{said}");
        let other =
            |text: &str| text.replace("\"aggregation\": \"vis-corr\"", "\"aggregation\": \"vis-max\"");
        let said = problem(&changed("", |_| (), other));
        assert!(said.contains("vis-max") && said.contains("expected vis-corr"), "{said}");
        let single = |text: &str| text.replace("\"cascade\"", "\"other\"");
        let said = problem(&changed("", |_| (), single));
        assert!(said.contains("cascade"), "{said}");
    }
}
