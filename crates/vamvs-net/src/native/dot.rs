//! Bilinear sampling, and functions for the widest vectors of the processor.

use super::Level;

/// The four pixels around a position, as offsets into the values, and their bilinear weights. Pixels outside the image
/// have weight 0.
#[derive(Clone, Copy)]
pub(super) struct Corners {
    offsets: [usize; 4],
    weights: [f32; 4],
}

impl Corners {
    /// The corners around a position given as a fraction of the image's size; `None` if none of them is inside.
    #[inline(always)]
    pub fn around(level: &Level<'_>, [x, y]: [f32; 2]) -> Option<Self> {
        let (x, y) = (x * level.width as f32 - 0.5, y * level.height as f32 - 0.5);
        if !(x > -1.0 && y > -1.0 && x < level.width as f32 && y < level.height as f32) {
            return None;
        }
        // x + 1 and y + 1 are not negative, so truncation is their floor.
        let (x0, y0) = ((x + 1.0) as i32 - 1, (y + 1.0) as i32 - 1);
        let (right, below) = (x - x0 as f32, y - y0 as f32);
        let axis = |first: i32, share: f32, count: usize| {
            let last = count as i32 - 1;
            let low = if first >= 0 { 1.0 - share } else { 0.0 };
            let high = if first < last { share } else { 0.0 };
            ([first.max(0) as usize, (first + 1).min(last) as usize], [low, high])
        };
        let ([x0, x1], [left, right]) = axis(x0, right, level.width);
        let ([y0, y1], [above, below]) = axis(y0, below, level.height);
        let at = |x: usize, y: usize| (y * level.width + x) * level.channels;
        Some(Self {
            offsets: [at(x0, y0), at(x1, y0), at(x0, y1), at(x1, y1)],
            weights: [left * above, right * above, left * below, right * below],
        })
    }

    /// Writes the interpolated channels to `out`.
    #[inline(always)]
    pub fn sample(&self, level: &Level<'_>, out: &mut [f32]) {
        let corner = |index: usize| &level.values[self.offsets[index]..][..out.len()];
        let (a, b, c, d) = (corner(0), corner(1), corner(2), corner(3));
        let [wa, wb, wc, wd] = self.weights;
        for channel in 0..out.len() {
            out[channel] = wa * a[channel] + wb * b[channel] + wc * c[channel] + wd * d[channel];
        }
    }
}

/// Also compiles a function for processors with AVX2 and with AVX-512, and calls the best variant that the processor
/// supports. All variants give the same bits, because products and sums are not fused.
macro_rules! best_of {
    ($body:ident => $name:ident<const $g:ident>($($argument:ident: $kind:ty),* $(,)?)) => {
        pub(super) fn $name<const $g: usize>($($argument: $kind),*) {
            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx2")]
                unsafe fn avx2<const $g: usize>($($argument: $kind),*) {
                    $body::<$g>($($argument),*);
                }
                #[target_feature(enable = "avx512f,avx512vl")]
                unsafe fn avx512<const $g: usize>($($argument: $kind),*) {
                    $body::<$g>($($argument),*);
                }
                if std::is_x86_feature_detected!("avx512vl") {
                    // SAFETY: the processor has AVX-512VL, which includes AVX-512F.
                    return unsafe { avx512::<$g>($($argument),*) };
                }
                if std::is_x86_feature_detected!("avx2") {
                    // SAFETY: the processor has AVX2.
                    return unsafe { avx2::<$g>($($argument),*) };
                }
            }
            $body::<$g>($($argument),*);
        }
    };
}
pub(super) use best_of;
