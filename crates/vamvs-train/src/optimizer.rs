//! RMSProp and AdamW. They are implemented here because libtorch's do not expose their state, which a resumed run
//! needs.

use tch::{Kind, TchError, Tensor};
use vamvs_net::Network;

use crate::TrainError;
use crate::options::{OptimizerOptions, Rule};

/// RMSProp's α: decay of the mean squared gradient.
const ALPHA: f64 = 0.9;
/// AdamW's β₁ and β₂: decay of the mean gradient and of the mean squared gradient.
const BETAS: [f64; 2] = [0.9, 0.999];
/// Added to the root of the mean squared gradient.
const EPSILON: f64 = 1e-8;

/// A parameter and the optimiser's state for it.
struct Weight {
    name: String,
    value: Tensor,
    /// Running mean of the gradient (AdamW).
    mean: Tensor,
    /// Running mean of the squared gradient.
    square: Tensor,
    /// Steps since the parameter first had a gradient, that one included.
    steps: Tensor,
}

/// The parameters of a network and the rule that updates them.
pub struct Optimizer {
    weights: Vec<Weight>,
    options: OptimizerOptions,
}

impl Optimizer {
    /// An optimiser in its initial state.
    ///
    /// # Errors
    /// If the module has no parameters.
    pub fn new(network: &Network, options: &OptimizerOptions) -> Result<Self, TrainError> {
        let mut weights = Vec::new();
        for (name, value) in network.parameters()? {
            let zeros = || tch::no_grad(|| value.f_zeros_like());
            let steps = Tensor::f_zeros([1], (Kind::Float, tch::Device::Cpu))?;
            weights.push(Weight { mean: zeros()?, square: zeros()?, steps, name, value });
        }
        if weights.is_empty() {
            return Err(TrainError::option("the network", "one with parameters to train", &"one with none"));
        }
        Ok(Self { weights, options: options.clone() })
    }

    /// Updates the weights by the accumulated gradients, then sets these to zero. Returns the norm of the gradients
    /// before clipping; if it is not finite, nothing is changed.
    ///
    /// # Errors
    /// If memory runs out.
    pub fn step(&mut self, learning_rate: f64) -> Result<f64, TchError> {
        tch::no_grad(|| {
            let norm = self.gradient_norm()?;
            if !norm.is_finite() {
                return Ok(norm);
            }
            let clip = self.options.clip;
            let factor = if clip > 0.0 && norm > clip { clip / norm } else { 1.0 };
            for weight in &mut self.weights {
                let mut gradient = weight.value.grad();
                if gradient.defined() {
                    weight.follow(&gradient.f_mul_scalar(factor)?, learning_rate, &self.options)?;
                    let _ = gradient.f_zero_()?;
                } else if weight.steps.double_value(&[0]) > 0.0 {
                    // In a resumed run the gradient is undefined where it was zero before the interruption.
                    weight.follow(&weight.value.f_zeros_like()?, learning_rate, &self.options)?;
                }
            }
            Ok(norm)
        })
    }

    fn gradient_norm(&self) -> Result<f64, TchError> {
        let mut sum = 0.0;
        for weight in &self.weights {
            let gradient = weight.value.grad();
            if gradient.defined() {
                sum += gradient.f_square()?.f_sum(Kind::Double)?.double_value(&[]);
            }
        }
        Ok(sum.sqrt())
    }

    /// The optimiser's state: tensors by name.
    #[must_use]
    pub fn state(&self) -> Vec<(String, Tensor)> {
        let of_weight = |weight: &Weight| {
            weight.memory().map(|(kind, tensor)| (format!("{}/{kind}", weight.name), tensor))
        };
        self.weights.iter().flat_map(of_weight).collect()
    }

    /// Restores a state.
    ///
    /// # Errors
    /// If a tensor is missing or has another shape, with its name: the state belongs to another network.
    pub fn set_state(&mut self, state: &[(String, Tensor)]) -> Result<(), String> {
        for weight in &self.weights {
            for (kind, mut tensor) in weight.memory() {
                let name = format!("{}/{kind}", weight.name);
                let found = state.iter().find(|(other, _)| *other == name);
                let (_, found) = found.ok_or_else(|| format!("{name} is missing"))?;
                if found.size() != tensor.size() {
                    return Err(format!("{name} is {:?}, expected {:?}", found.size(), tensor.size()));
                }
                tensor.f_copy_(found).map_err(|error| format!("{name} cannot be used: {error}"))?;
            }
        }
        Ok(())
    }
}

impl Weight {
    fn memory(&self) -> [(&'static str, Tensor); 3] {
        [
            ("mean", self.mean.shallow_clone()),
            ("square", self.square.shallow_clone()),
            ("steps", self.steps.shallow_clone()),
        ]
    }

    fn follow(
        &mut self,
        gradient: &Tensor,
        learning_rate: f64,
        options: &OptimizerOptions,
    ) -> Result<(), TchError> {
        let _ = self.steps.f_add_scalar_(1.0)?;
        match options.rule {
            Rule::RmsProp => {
                let gradient = gradient.f_add(&self.value.f_mul_scalar(options.weight_decay)?)?;
                let _ = self.square.f_mul_scalar_(ALPHA)?;
                let _ = self.square.f_addcmul_(&gradient, &gradient.f_mul_scalar(1.0 - ALPHA)?)?;
                let scale = self.square.f_sqrt()?.f_add_scalar(EPSILON)?;
                let _ = self.value.f_sub_(&gradient.f_div(&scale)?.f_mul_scalar(learning_rate)?)?;
            }
            Rule::AdamW => {
                let steps = self.steps.double_value(&[0]);
                let _ = self.mean.f_mul_scalar_(BETAS[0])?;
                let _ = self.mean.f_add_(&gradient.f_mul_scalar(1.0 - BETAS[0])?)?;
                let _ = self.square.f_mul_scalar_(BETAS[1])?;
                let _ = self.square.f_addcmul_(gradient, &gradient.f_mul_scalar(1.0 - BETAS[1])?)?;
                let unbiased = BETAS.map(|beta| 1.0 - beta.powf(steps));
                let scale = self.square.f_sqrt()?.f_div_scalar(unbiased[1].sqrt())?.f_add_scalar(EPSILON)?;
                let _ = self.value.f_mul_scalar_(1.0 - learning_rate * options.weight_decay)?;
                let rate = learning_rate / unbiased[0];
                let _ = self.value.f_sub_(&self.mean.f_div(&scale)?.f_mul_scalar(rate)?)?;
            }
        }
        Ok(())
    }
}
