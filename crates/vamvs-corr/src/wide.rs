//! Loops over many numbers at once, compiled for the processor's widest vectors, and what they share.

/// Compiles a generic function for processors with AVX2 and FMA and for those with AVX-512, and calls the best variant that
/// the processor supports. `$tiles` are the values of its parameter `P`, the pixels of a tile, for AVX-512 and for all others:
/// as many as registers hold. Every result is one chain of fused operations in one order, so all variants give the same bits.
macro_rules! widest {
    ($body:ident<P $(, $lanes:ident)?> => $name:ident($($argument:ident: $kind:ty),* $(,)?); $tiles:expr) => {
        fn $name$(<const $lanes: usize>)?($($argument: $kind),*) {
            const TILES: [usize; 2] = $tiles;
            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx2,fma")]
                fn avx2$(<const $lanes: usize>)?($($argument: $kind),*) {
                    $body::<{ TILES[1] } $(, $lanes)?>($($argument),*);
                }
                #[target_feature(enable = "avx512f,avx512vl,fma")]
                fn avx512$(<const $lanes: usize>)?($($argument: $kind),*) {
                    $body::<{ TILES[0] } $(, $lanes)?>($($argument),*);
                }
                if std::is_x86_feature_detected!("avx512vl") && std::is_x86_feature_detected!("fma") {
                    // SAFETY: the processor has AVX-512VL, which includes AVX-512F, and FMA.
                    return unsafe { avx512$(::<$lanes>)?($($argument),*) };
                }
                if std::is_x86_feature_detected!("avx2") && std::is_x86_feature_detected!("fma") {
                    // SAFETY: the processor has AVX2 and FMA.
                    return unsafe { avx2$(::<$lanes>)?($($argument),*) };
                }
            }
            $body::<{ TILES[1] } $(, $lanes)?>($($argument),*);
        }
    };
}
pub(crate) use widest;

/// eˣ with a relative error below 3e-7, by the same operations on every processor; that of the standard library is the platform's.
#[inline(always)]
pub fn exp(x: f32) -> f32 {
    const LARGEST: f32 = 88.0;
    let x = x.clamp(-LARGEST, LARGEST);
    let n = (x * std::f32::consts::LOG2_E).round_ties_even();
    // ln 2 in two parts, so that the remainder is exact.
    let r = n.mul_add(-1.428_606_8e-6, n.mul_add(-0.693_145_75, x));
    let tail = [1.0 / 720.0, 1.0 / 120.0, 1.0 / 24.0, 1.0 / 6.0, 0.5, 1.0, 1.0];
    let power = tail.into_iter().reduce(|sum: f32, factor| sum.mul_add(r, factor)).expect("seven factors");
    power * f32::from_bits(((n as i32 + 127) as u32) << 23)
}

/// 1 / (1 + e⁻ˣ).
#[inline(always)]
pub fn sigmoid(x: f32) -> f32 {
    1.0 / (1.0 + exp(-x))
}

/// Sets negative values to zero.
#[inline(always)]
pub fn relu(values: &mut [f32]) {
    values.iter_mut().for_each(|value| *value = value.max(0.0));
}

/// Adds values one by one.
#[inline(always)]
pub fn add(to: &mut [f32], values: &[f32]) {
    to.iter_mut().zip(values).for_each(|(to, value)| *to += value);
}

/// Multiplies by values one by one.
#[inline(always)]
pub fn multiply(to: &mut [f32], values: &[f32]) {
    to.iter_mut().zip(values).for_each(|(to, value)| *to *= value);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_exponential_is_exact_to_float_precision() {
        for i in -8700..8700_i16 {
            let x = f32::from(i) * 0.01;
            let expected = f64::from(x).exp();
            assert!((f64::from(exp(x)) / expected - 1.0).abs() < 3e-7, "{x}");
        }
        assert!(exp(f32::NEG_INFINITY) < 1e-37 && exp(0.0) == 1.0);
        assert!((sigmoid(2.0) + sigmoid(-2.0) - 1.0).abs() < 1e-6);
    }
}
