//! Which network is used, if any.

#[cfg(feature = "net")]
mod networks;

use std::path::Path;

#[cfg(feature = "net")]
pub use networks::{bytes, load};

/// Stands for no network.
pub(crate) const NONE: &str = "none";

/// Whether this is the name of a built-in network, or `none`, rather than a file.
#[must_use]
pub fn is_built_in(weights: &Path) -> bool {
    #[cfg(feature = "net")]
    if networks::is_network(weights) {
        return true;
    }
    is_none(weights)
}

/// The name of the built-in network that aggregates views as the paper does; `none` in a build without libtorch.
#[must_use]
pub fn of_paper() -> &'static str {
    if cfg!(feature = "net") { "vis-max" } else { NONE }
}

/// Whether this is `none`: no network is wanted.
#[must_use]
pub fn is_none(weights: &Path) -> bool {
    weights == Path::new(NONE)
}
