//! Loops over many numbers at once, compiled for the processor's widest vectors.

/// Defines a function twice, for every processor of the target and for those with AVX2, and calls what this
/// processor can run. Both do the same operations in the same order (no fused multiply-add), so results are
/// the same bit for bit.
macro_rules! widened {
    ($(#[$doc:meta])* $visible:vis fn $name:ident($($argument:ident: $kind:ty),* $(,)?) = $body:path;) => {
        $(#[$doc])*
        $visible fn $name($($argument: $kind),*) {
            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx2")]
                fn widest($($argument: $kind),*) {
                    $body($($argument),*);
                }
                if std::arch::is_x86_feature_detected!("avx2") {
                    // SAFETY: the processor was just found to have AVX2, which is all that `widest` asks for.
                    return unsafe { widest($($argument),*) };
                }
            }
            $body($($argument),*);
        }
    };
}

pub(crate) use widened;
