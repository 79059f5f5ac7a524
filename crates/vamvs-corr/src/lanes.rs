//! Vectors of floats in registers, for processors with AVX2 and FMA, with AVX-512, with NEON, and for all others.
//!
//! Compilers do not keep a tile of sums in registers by themselves once it is an array of arrays; a vector type for each
//! instruction set makes them. All do the same fused operations, so results are the same bit for bit.

/// A vector of floats.
pub trait Lanes: Copy {
    /// Their number.
    const COUNT: usize;

    /// The first values of a slice that has at least so many.
    fn load(values: &[f32]) -> Self;

    /// Writes them to the beginning of a slice that has room for them.
    fn store(self, to: &mut [f32]);

    /// The same value in all lanes.
    fn all(value: f32) -> Self;

    /// self + a · b, rounded once.
    fn plus(self, a: Self, b: Self) -> Self;
}

impl<const N: usize> Lanes for [f32; N] {
    const COUNT: usize = N;

    #[inline(always)]
    fn load(values: &[f32]) -> Self {
        std::array::from_fn(|lane| values[lane])
    }

    #[inline(always)]
    fn store(self, to: &mut [f32]) {
        to[..N].copy_from_slice(&self);
    }

    #[inline(always)]
    fn all(value: f32) -> Self {
        [value; N]
    }

    #[inline(always)]
    fn plus(mut self, a: Self, b: Self) -> Self {
        for lane in 0..N {
            self[lane] = a[lane].mul_add(b[lane], self[lane]);
        }
        self
    }
}

/// Vectors of x86-64. They may only be used in functions that are compiled for processors that have them.
#[cfg(target_arch = "x86_64")]
pub mod x86 {
    use std::arch::x86_64::{
        __m256, __m512, _mm256_fmadd_ps, _mm256_loadu_ps, _mm256_set1_ps, _mm256_storeu_ps, _mm512_fmadd_ps,
        _mm512_loadu_ps, _mm512_set1_ps, _mm512_storeu_ps,
    };

    use super::Lanes;

    /// Vectors of 256 bits, of processors with AVX2 and FMA.
    #[derive(Clone, Copy)]
    pub struct Avx<const VECTORS: usize>([__m256; VECTORS]);

    /// A vector of 512 bits, of processors with AVX-512F.
    #[derive(Clone, Copy)]
    pub struct Avx512(__m512);

    impl<const VECTORS: usize> Lanes for Avx<VECTORS> {
        const COUNT: usize = 8 * VECTORS;

        #[inline(always)]
        fn load(values: &[f32]) -> Self {
            let values = &values[..Self::COUNT];
            // SAFETY: the slice has 8 values from each of these places on, and the processor has AVX.
            Self(std::array::from_fn(|at| unsafe { _mm256_loadu_ps(values.as_ptr().add(8 * at)) }))
        }

        #[inline(always)]
        fn store(self, to: &mut [f32]) {
            let to = &mut to[..Self::COUNT];
            for (at, vector) in self.0.into_iter().enumerate() {
                // SAFETY: the slice has room for 8 values from this place on, and the processor has AVX.
                unsafe { _mm256_storeu_ps(to.as_mut_ptr().add(8 * at), vector) };
            }
        }

        #[inline(always)]
        fn all(value: f32) -> Self {
            // SAFETY: the processor has AVX.
            Self([unsafe { _mm256_set1_ps(value) }; VECTORS])
        }

        #[inline(always)]
        fn plus(self, a: Self, b: Self) -> Self {
            // SAFETY: the processor has FMA.
            Self(std::array::from_fn(|at| unsafe { _mm256_fmadd_ps(a.0[at], b.0[at], self.0[at]) }))
        }
    }

    impl Lanes for Avx512 {
        const COUNT: usize = 16;

        #[inline(always)]
        fn load(values: &[f32]) -> Self {
            let values = &values[..Self::COUNT];
            // SAFETY: the slice has 16 values, and the processor has AVX-512F.
            Self(unsafe { _mm512_loadu_ps(values.as_ptr()) })
        }

        #[inline(always)]
        fn store(self, to: &mut [f32]) {
            let to = &mut to[..Self::COUNT];
            // SAFETY: the slice has room for 16 values, and the processor has AVX-512F.
            unsafe { _mm512_storeu_ps(to.as_mut_ptr(), self.0) };
        }

        #[inline(always)]
        fn all(value: f32) -> Self {
            // SAFETY: the processor has AVX-512F.
            Self(unsafe { _mm512_set1_ps(value) })
        }

        #[inline(always)]
        fn plus(self, a: Self, b: Self) -> Self {
            // SAFETY: the processor has AVX-512F.
            Self(unsafe { _mm512_fmadd_ps(a.0, b.0, self.0) })
        }
    }
}

/// Vectors of 64-bit ARM.
#[cfg(target_arch = "aarch64")]
pub mod arm {
    use std::arch::aarch64::{float32x4_t, vdupq_n_f32, vfmaq_f32, vld1q_f32, vst1q_f32};

    use super::Lanes;

    /// Vectors of 128 bits, which every such processor has.
    #[derive(Clone, Copy)]
    pub struct Neon<const VECTORS: usize>([float32x4_t; VECTORS]);

    impl<const VECTORS: usize> Lanes for Neon<VECTORS> {
        const COUNT: usize = 4 * VECTORS;

        #[inline(always)]
        fn load(values: &[f32]) -> Self {
            let values = &values[..Self::COUNT];
            // SAFETY: the slice has 4 values from each of these places on.
            Self(std::array::from_fn(|at| unsafe { vld1q_f32(values.as_ptr().add(4 * at)) }))
        }

        #[inline(always)]
        fn store(self, to: &mut [f32]) {
            let to = &mut to[..Self::COUNT];
            for (at, vector) in self.0.into_iter().enumerate() {
                // SAFETY: the slice has room for 4 values from this place on.
                unsafe { vst1q_f32(to.as_mut_ptr().add(4 * at), vector) };
            }
        }

        #[inline(always)]
        fn all(value: f32) -> Self {
            // SAFETY: every 64-bit ARM processor that this is compiled for has NEON.
            Self([unsafe { vdupq_n_f32(value) }; VECTORS])
        }

        #[inline(always)]
        fn plus(self, a: Self, b: Self) -> Self {
            // SAFETY: as above.
            Self(std::array::from_fn(|at| unsafe { vfmaq_f32(self.0[at], a.0[at], b.0[at]) }))
        }
    }
}
