//! Group-wise correlation (Guo et al., CVPR 2019): the similarity of a pair of views, one channel for each group of
//! feature channels.

use tch::{Kind, TchError, Tensor};

/// The mean product of the channels in each of G = C / `group` groups: reference (1, C, …), source (D, C, …) →
/// (D, G, …). Groups are interleaved: channel c belongs to group c mod G.
///
/// # Errors
/// If C is not a multiple of `group`, or memory runs out.
pub fn correlation(reference: &Tensor, source: &Tensor, group: usize) -> Result<Tensor, TchError> {
    let mut shape = source.size();
    shape[1] /= group as i64;
    shape.insert(1, group as i64);
    let product = reference.f_mul(source)?.f_reshape(shape.as_slice())?;
    product.f_mean_dim([1].as_slice(), false, Kind::Float)
}

/// The maximum and the mean correlation over all planes, (D, G, h, w) → (1, 2 G, h, w), from which a source view's
/// visibility is predicted. A view that sees a surface resembles the reference view at one plane and not at the others.
///
/// # Errors
/// If memory runs out.
pub fn pooled(correlation: &Tensor) -> Result<Tensor, TchError> {
    let mean = correlation.f_mean_dim([0].as_slice(), true, Kind::Float)?;
    Tensor::f_cat(&[correlation.f_amax([0], true)?, mean], 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use tch::Device;

    #[test]
    fn groups_are_mean_products_of_interleaved_channels() {
        let reference = Tensor::from_slice(&[1.0_f32, 2.0, 3.0, 4.0]).view([1, 4, 1]);
        let source = Tensor::from_slice(&[1.0_f32, 0.0, 1.0, 1.0, 2.0, 2.0, 0.0, -1.0]).view([2, 4, 1]);
        let found = correlation(&reference, &source, 2).unwrap();
        assert_eq!(found.size(), [2, 2, 1]);
        assert!(found.flatten(0, -1).equal(&Tensor::from_slice(&[2.0_f32, 2.0, 1.0, 0.0])));
        assert!(correlation(&reference, &source, 3).is_err());
    }

    #[test]
    fn pooling_keeps_the_largest_and_the_mean_over_planes() {
        let volume = Tensor::arange(2 * 3 * 4, (Kind::Float, Device::Cpu)).view([2, 3, 2, 2]);
        let found = pooled(&volume).unwrap();
        assert_eq!(found.size(), [1, 6, 2, 2]);
        assert_eq!(found.double_value(&[0, 1, 1, 0]), 18.0);
        assert_eq!(found.double_value(&[0, 4, 1, 0]), 12.0);
    }
}
