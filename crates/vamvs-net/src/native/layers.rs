//! The folded layers of a module, which the kernels run themselves instead of calling the module.

use gemm::{Parallelism, gemm};
use tch::{Device, IValue, Kind, Tensor};

use super::dot::best_of;
use super::in_memory;
use crate::Manifest;

/// A layer of a shared MLP: y = W x + b, and then usually a ReLU.
#[derive(Debug)]
pub(crate) struct Layer {
    /// W, (outputs, inputs).
    weight: Vec<f32>,
    /// b.
    shift: Vec<f32>,
    inputs: usize,
}

/// A shared MLP on pairs of features of the reference view and a source view, with a ReLU after each layer.
#[derive(Debug)]
pub(crate) struct PairMlp {
    /// The part of the first layer that depends on the reference view, and the layer's shift.
    pub of_reference: Layer,
    /// The part of the first layer that depends on the source view, without a shift.
    pub of_source: Layer,
    /// The other layers.
    pub rest: Vec<Layer>,
}

/// An edge convolution: of point p with neighbours q it gives ReLU(own F_p), and then the mean over q of
/// ReLU(near F_q − centre F_p) (section 3.4).
#[derive(Debug)]
pub(crate) struct EdgeConv {
    pub own: Layer,
    pub centre: Layer,
    pub near: Layer,
}

/// Normalised cross-correlation of the channels that [`PairMlp`] leaves aside, over windows of 3×3 pixels, as the
/// similarity exp(sharpness · (NCC − 1)).
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ncc {
    pub sharpness: f32,
    /// Added to both variances.
    pub noise: f32,
}

/// All layers that kernels run.
#[derive(Debug)]
pub(crate) struct Layers {
    /// `relate`, for pairs of coarse features.
    pub relate: Option<PairMlp>,
    /// The averaged channel of `relate`, if there is one.
    pub ncc: Option<Ncc>,
    /// `relate_flow`, for pairs of fetched features.
    pub relate_flow: Option<PairMlp>,
    /// The edge convolutions of `flow`; each gets the outputs of the one before.
    pub edges: Vec<EdgeConv>,
    /// The MLP on the outputs of all edge convolutions, which ends `flow`; the last layer has no ReLU.
    pub scores: Vec<Layer>,
}

impl Layers {
    /// Takes the layers from what a module's method `layers` gave.
    ///
    /// # Errors
    /// What does not fit, as a part of a sentence.
    pub fn of(answer: IValue, manifest: &Manifest) -> Result<Self, String> {
        let mut lists = Lists::of(answer)?;
        let pairs = manifest.aggregation.relates_pairs();
        let mut pair_mlp = |name: &str| pairs.then(|| PairMlp::of(name, &lists.take(name)?)).transpose();
        let (relate, relate_flow) = (pair_mlp("relate")?, pair_mlp("relate_flow")?);
        let ncc = (manifest.averaged > 0).then(|| Ncc::of(&lists.take("relate_ncc")?, manifest.averaged));
        let ncc = ncc.transpose()?;
        let edges = edge_convs("flow_edges", &lists.take("flow_edges")?)?;
        if edges.len() != manifest.flow_layers {
            let (found, expected) = (edges.len(), manifest.flow_layers);
            return Err(format!(
                "flow_edges has {found} edge convolutions: expected flow_layers, {expected}"
            ));
        }
        let scores = chain("flow_scores", &lists.take("flow_scores")?)?;
        let joined: usize = edges.iter().map(EdgeConv::outputs).sum();
        expect("flow_scores", "inputs", scores[0].inputs, joined)?;
        expect("flow_scores", "outputs", scores[scores.len() - 1].outputs(), 1)?;
        Ok(Self { relate, ncc, relate_flow, edges, scores })
    }

    /// Checks the layers against the numbers of channels that the module's other methods use: of the coarse features
    /// and of all flow features of a view, and of a point's features.
    ///
    /// # Errors
    /// As [`Layers::of`].
    pub fn check(&self, coarse: usize, flow: usize, point: usize) -> Result<(), String> {
        expect("flow_edges", "inputs", self.edges[0].near.inputs, point)?;
        if let Some(relate) = self.relate.as_ref().filter(|relate| relate.of_source.inputs > coarse) {
            let found = relate.of_source.inputs;
            return Err(format!("relate takes {found} channels of a view: expected at most {coarse}"));
        }
        match &self.relate_flow {
            Some(relate) => expect("relate_flow", "inputs of a view", relate.of_source.inputs, flow),
            None => Ok(()),
        }
    }
}

/// The lists of tensors that a module gave, by name.
struct Lists(Vec<(String, Vec<Tensor>)>);

impl Lists {
    fn of(answer: IValue) -> Result<Self, String> {
        let IValue::GenericDict(entries) = answer else {
            return Err("layers() gave no dictionary of lists of tensors".to_owned());
        };
        let list = |entry| match entry {
            (IValue::String(name), IValue::TensorList(list)) => Ok((name, list)),
            (name, _) => Err(format!("the entry {name:?} of layers() is no list of tensors under a name")),
        };
        Ok(Self(entries.into_iter().map(list).collect::<Result<_, _>>()?))
    }

    fn take(&mut self, name: &str) -> Result<Vec<Tensor>, String> {
        let missing = || format!("layers() gave no {name}");
        let index = self.0.iter().position(|(found, _)| found == name).ok_or_else(missing)?;
        Ok(self.0.swap_remove(index).1)
    }
}

/// Layers after each other, from weights and shifts in turn.
fn chain(name: &str, tensors: &[Tensor]) -> Result<Vec<Layer>, String> {
    let (pairs, rest) = tensors.as_chunks::<2>();
    if pairs.is_empty() || !rest.is_empty() {
        return Err(format!(
            "{name} has {} tensors: expected a weight and a shift for each layer",
            tensors.len()
        ));
    }
    let layers = pairs.iter().map(|[weight, shift]| Layer::of(name, weight, shift));
    let layers: Vec<Layer> = layers.collect::<Result<_, _>>()?;
    for two in layers.windows(2) {
        expect(name, "inputs of a layer", two[1].inputs, two[0].outputs())?;
    }
    Ok(layers)
}

/// Edge convolutions after each other, from five tensors each.
fn edge_convs(name: &str, tensors: &[Tensor]) -> Result<Vec<EdgeConv>, String> {
    let (fives, rest) = tensors.as_chunks::<5>();
    if fives.is_empty() || !rest.is_empty() {
        return Err(format!("{name} has {} tensors: expected five for each edge convolution", tensors.len()));
    }
    let edge_conv = |[own, own_shift, centre, centre_shift, near]: &[Tensor; 5]| {
        let none = Tensor::zeros(&near.size()[..1.min(near.dim())], (Kind::Float, Device::Cpu));
        Ok::<_, String>(EdgeConv {
            own: Layer::of(name, own, own_shift)?,
            centre: Layer::of(name, centre, centre_shift)?,
            near: Layer::of(name, near, &none)?,
        })
    };
    let edges: Vec<EdgeConv> = fives.iter().map(edge_conv).collect::<Result<_, _>>()?;
    for (index, edge) in edges.iter().enumerate() {
        let inputs = if index == 0 { edge.near.inputs } else { edges[index - 1].outputs() };
        for layer in [&edge.own, &edge.centre, &edge.near] {
            expect(name, "inputs of a layer", layer.inputs, inputs)?;
        }
        expect(name, "outputs of a centre's layer", edge.centre.outputs(), edge.near.outputs())?;
    }
    Ok(edges)
}

fn expect(name: &str, what: &str, found: usize, expected: usize) -> Result<(), String> {
    if found == expected {
        return Ok(());
    }
    Err(format!("{name} has {found} {what}: expected {expected}"))
}

impl Ncc {
    fn of(tensors: &[Tensor], averaged: usize) -> Result<Self, String> {
        let values = |tensor: &Tensor| Vec::<f32>::try_from(tensor).map_err(|error| error.to_string());
        match (tensors, averaged) {
            ([tensor], 1) => match values(tensor)?.as_slice() {
                &[sharpness, noise] => Ok(Self { sharpness, noise }),
                values => {
                    Err(format!("relate_ncc has {} values: expected a sharpness and a noise", values.len()))
                }
            },
            ([_], _) => {
                Err(format!("relate_ncc gives one channel: expected that averaged is 1, not {averaged}"))
            }
            _ => Err(format!("relate_ncc has {} tensors: expected one", tensors.len())),
        }
    }
}

impl PairMlp {
    fn of(name: &str, tensors: &[Tensor]) -> Result<Self, String> {
        let mut layers = chain(name, tensors)?;
        let first = layers.remove(0);
        if first.inputs % 2 == 1 {
            return Err(format!("{name} has {} inputs: expected the same of both views", first.inputs));
        }
        let inputs = first.inputs / 2;
        let half = |of_source: bool| -> Vec<f32> {
            let rows = first.weight.chunks_exact(first.inputs);
            rows.flat_map(|row| &row[if of_source { inputs } else { 0 }..][..inputs]).copied().collect()
        };
        let none = vec![0.0; first.outputs()];
        let of_source = Layer { weight: half(true), shift: none, inputs };
        let of_reference = Layer { weight: half(false), shift: first.shift, inputs };
        Ok(Self { of_reference, of_source, rest: layers })
    }

    /// The number of channels of a pair.
    pub fn outputs(&self) -> usize {
        self.rest.last().unwrap_or(&self.of_source).outputs()
    }
}

impl EdgeConv {
    /// The number of channels of a point afterwards.
    pub fn outputs(&self) -> usize {
        self.own.outputs() + self.near.outputs()
    }
}

impl Layer {
    fn of(name: &str, weight: &Tensor, shift: &Tensor) -> Result<Self, String> {
        let (shape, shifts) = (weight.size(), shift.size());
        let &[outputs, inputs] = shape.as_slice() else {
            return Err(format!("{name} has a weight of shape {shape:?}: expected (outputs, inputs)"));
        };
        if shifts != [outputs] {
            return Err(format!("{name} has a shift of shape {shifts:?} after a weight of shape {shape:?}"));
        }
        let values = |tensor: &Tensor| -> Result<Vec<f32>, String> {
            let tensor = tensor.f_detach().and_then(|tensor| tensor.f_to_device(Device::Cpu));
            let tensor =
                tensor.and_then(|tensor| tensor.f_contiguous()).map_err(|error| error.to_string())?;
            Ok(in_memory(&tensor).map_err(|error| format!("{name}: {error}"))?.to_vec())
        };
        Ok(Self { weight: values(weight)?, shift: values(shift)?, inputs: inputs as usize })
    }

    pub fn inputs(&self) -> usize {
        self.inputs
    }

    pub fn outputs(&self) -> usize {
        self.shift.len()
    }

    /// y = W x + b for each row of `rows`.
    pub fn apply(&self, rows: Rows<'_>, out: &mut [f32]) {
        if self.shift.is_empty() {
            return;
        }
        out.chunks_exact_mut(self.outputs()).for_each(|out| out.copy_from_slice(&self.shift));
        self.add(rows, out);
    }

    /// Adds W x to each row of `out`, (rows, outputs).
    ///
    /// # Panics
    /// If the rows do not fit the layer.
    pub fn add(&self, rows: Rows<'_>, out: &mut [f32]) {
        let Rows { values, width, count } = rows;
        let (inputs, outputs) = (self.inputs, self.outputs());
        assert!(inputs <= width && values.len() + width >= count * width + inputs, "rows of inputs");
        assert_eq!(out.len(), count * outputs, "rows of outputs");
        // SAFETY: the strides stay within the slices, as asserted, and the weight is (outputs, inputs).
        unsafe {
            gemm(
                count,
                outputs,
                inputs,
                out.as_mut_ptr(),
                1,
                outputs as isize,
                true,
                values.as_ptr(),
                1,
                width as isize,
                self.weight.as_ptr(),
                inputs as isize,
                1,
                1.0,
                1.0,
                false,
                false,
                false,
                Parallelism::None,
            );
        }
    }
}

/// Rows of values, of which the first columns are used.
#[derive(Clone, Copy)]
pub(crate) struct Rows<'a> {
    pub values: &'a [f32],
    /// Distance between the beginnings of two rows.
    pub width: usize,
    pub count: usize,
}

#[inline(always)]
fn cut<const ONE: usize>(values: &mut [f32]) {
    values.iter_mut().for_each(|value| *value = value.max(0.0));
}
best_of!(cut => relu_of<const ONE>(values: &mut [f32]));

/// ReLU.
pub(crate) fn relu(values: &mut [f32]) {
    relu_of::<1>(values);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tensors(shapes: &[&[i64]]) -> IValue {
        IValue::TensorList(
            shapes.iter().map(|shape| Tensor::rand(*shape, (Kind::Float, Device::Cpu))).collect(),
        )
    }

    /// Layers of a vis-max with 6 channels of both features and 2 edge convolutions, with the entries `other` in place
    /// of those of their names.
    fn layers(other: &[(&str, &[&[i64]])]) -> Result<Layers, String> {
        let manifest = r#"{"contract": 1, "name": "", "aggregation": "vis-max", "neighbours": 4, "hypotheses": 2,
            "flow_layers": 2, "planes": 8, "iterations": [], "licence": "", "trained_on": "", "scores": {},
            "layers": true, "averaged": 1}"#;
        let manifest = Manifest::parse(manifest, "test").expect("a manifest");
        let pair: &[&[i64]] = &[&[8, 12], &[8], &[5, 8], &[5]];
        let mut entries: Vec<(&str, &[&[i64]])> = vec![
            ("relate", pair),
            ("relate_flow", pair),
            ("relate_ncc", &[&[2]]),
            (
                "flow_edges",
                &[&[0, 29], &[0], &[4, 29], &[4], &[4, 29], &[3, 4], &[3], &[2, 4], &[2], &[2, 4]],
            ),
            ("flow_scores", &[&[1, 9], &[1]]),
        ];
        entries.retain(|(name, _)| other.iter().all(|(new, _)| new != name));
        entries.extend(other.iter().filter(|(_, shapes)| !shapes.is_empty()));
        let entries =
            entries.into_iter().map(|(name, shapes)| (IValue::String(name.to_owned()), tensors(shapes)));
        let layers = Layers::of(IValue::GenericDict(entries.collect()), &manifest)?;
        layers.check(6, 6, 29).map(|()| layers)
    }

    #[test]
    fn layers_that_fit_are_taken_and_others_told_by_name() {
        layers(&[]).expect("layers that fit");
        let wrong: [(&str, &[&[i64]], &str); 9] = [
            ("relate", &[], "layers() gave no relate"),
            ("relate", &[&[8, 14], &[8]], "relate takes 7 channels of a view: expected at most 6"),
            ("relate_flow", &[&[8, 10], &[8]], "relate_flow has 5 inputs of a view: expected 6"),
            ("relate", &[&[8, 12], &[8], &[5, 7], &[5]], "relate has 7 inputs of a layer: expected 8"),
            ("relate", &[&[8, 12], &[7]], "relate has a shift of shape [7] after a weight of shape [8, 12]"),
            ("relate_ncc", &[&[3]], "relate_ncc has 3 values: expected a sharpness and a noise"),
            ("flow_edges", &[&[0, 29], &[0], &[4, 29], &[4], &[4, 29]], "flow_edges has 1 edge convolutions"),
            ("flow_scores", &[&[1, 8], &[1]], "flow_scores has 8 inputs: expected 9"),
            ("flow_scores", &[&[2, 9], &[2]], "flow_scores has 2 outputs: expected 1"),
        ];
        for (name, shapes, told) in wrong {
            let problem = layers(&[(name, shapes)]).expect_err(told);
            assert!(problem.contains(told), "{problem}: expected {told}");
        }
    }

    #[test]
    fn a_layer_gives_products_of_its_rows_and_leaves_other_columns_aside() {
        let (weight, shift) = (
            Tensor::randn([5, 3], (Kind::Float, Device::Cpu)),
            Tensor::randn([5], (Kind::Float, Device::Cpu)),
        );
        let layer = Layer::of("test", &weight, &shift).expect("a layer");
        let rows = Tensor::randn([300, 4], (Kind::Float, Device::Cpu));
        let expected = rows.narrow(1, 0, 3).matmul(&weight.tr()) + &shift;
        let mut out = vec![0.0; 300 * 5];
        layer.apply(Rows { values: in_memory(&rows).expect("values"), width: 4, count: 300 }, &mut out);
        assert!(Tensor::from_slice(&out).view([300, 5]).allclose(&expected, 1e-5, 1e-5, false));
        relu(&mut out);
        assert!(Tensor::from_slice(&out).view([300, 5]).allclose(&expected.relu(), 1e-5, 1e-5, false));
    }
}
