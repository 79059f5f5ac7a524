//! Loops over many numbers at once, compiled for the processor's widest vectors, and what they share.

/// The widest vectors of a processor; others than x86-64 have one kind each.
#[cfg(target_arch = "x86_64")]
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Widest {
    /// Those that every processor of the target has.
    Any,
    /// 256 bits, and fused multiply-add.
    Avx2,
    /// 512 bits.
    Avx512,
}

/// The widest vectors that tests allow; all give the same bits, so tests that run side by side do not disturb each other.
#[cfg(all(test, target_arch = "x86_64"))]
pub static ALLOWED: std::sync::RwLock<Option<Widest>> = std::sync::RwLock::new(None);

/// The widest vectors of this processor.
#[cfg(target_arch = "x86_64")]
pub fn widest() -> Widest {
    let found = of_processor();
    #[cfg(test)]
    let found = found.min(ALLOWED.read().expect("no test has failed while it wrote").unwrap_or(found));
    found
}

#[cfg(target_arch = "x86_64")]
fn of_processor() -> Widest {
    if std::is_x86_feature_detected!("avx2") && std::is_x86_feature_detected!("fma") {
        let has_avx512 =
            std::is_x86_feature_detected!("avx512f") && std::is_x86_feature_detected!("avx512vl");
        return if has_avx512 { Widest::Avx512 } else { Widest::Avx2 };
    }
    Widest::Any
}

/// Compiles a function for the processors of each [`Widest`], and calls the one for this processor. Every result is a chain of the same
/// operations in one order, so all variants give the same bits.
macro_rules! widened {
    ($body:ident => $visible:vis $name:ident($($argument:ident: $kind:ty),* $(,)?)) => {
        $visible fn $name($($argument: $kind),*) {
            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx2,fma")]
                fn avx2($($argument: $kind),*) {
                    $body($($argument),*);
                }
                #[target_feature(enable = "avx512f,avx512vl,avx2,fma")]
                fn avx512($($argument: $kind),*) {
                    $body($($argument),*);
                }
                match $crate::wide::widest() {
                    // SAFETY: the processor has what the functions are compiled for.
                    $crate::wide::Widest::Avx512 => return unsafe { avx512($($argument),*) },
                    // SAFETY: as above.
                    $crate::wide::Widest::Avx2 => return unsafe { avx2($($argument),*) },
                    $crate::wide::Widest::Any => {}
                }
            }
            $body($($argument),*);
        }
    };
}
pub(crate) use widened;

/// eˣ with a relative error below 3e-7, by the same operations on every processor; that of the standard library is the platform's.
#[inline(always)]
pub fn exp(x: f32) -> f32 {
    const LARGEST: f32 = 88.0;
    let x = x.clamp(-LARGEST, LARGEST);
    let n = (x * std::f32::consts::LOG2_E).round_ties_even();
    // ln 2 in two parts, the first with so few digits that its product is exact.
    let r = (x - n * 0.693_145_75) - n * 1.428_606_8e-6;
    let tail = [1.0 / 720.0, 1.0 / 120.0, 1.0 / 24.0, 1.0 / 6.0, 0.5, 1.0, 1.0];
    let power = tail.into_iter().reduce(|sum: f32, factor| sum * r + factor).expect("seven factors");
    power * f32::from_bits(((n as i32 + 127) as u32) << 23)
}

/// 1 / (1 + e⁻ˣ).
#[inline(always)]
fn sigmoid(x: f32) -> f32 {
    1.0 / (1.0 + exp(-x))
}

/// `factor` / (1 + e⁻ˣ) of each value.
#[inline(always)]
fn sigmoids_of(values: &mut [f32], factor: f32) {
    values.iter_mut().for_each(|value| *value = factor * sigmoid(*value));
}
widened!(sigmoids_of => pub sigmoids(values: &mut [f32], factor: f32));

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
