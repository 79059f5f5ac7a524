//! Which network is used, if any.

#[cfg(feature = "torch")]
mod networks;

use std::borrow::Cow;
use std::path::Path;

use vamvs_io::IoError;

use crate::VamvsError;

#[cfg(feature = "torch")]
pub use networks::{bytes, load};

/// The network that needs no libtorch.
const VIS_CORR: &str = "vis-corr";

/// The extension of files with its weights.
const SAFETENSORS: &str = "safetensors";

/// Stands for no network.
pub(crate) const NONE: &str = "none";

/// Whether this is the name of a built-in network, or `none`, rather than a file.
#[must_use]
pub fn is_built_in(weights: &Path) -> bool {
    #[cfg(feature = "torch")]
    if networks::is_network(weights) {
        return true;
    }
    is_none(weights) || weights == Path::new(VIS_CORR)
}

/// The name of the built-in network that is most like the paper's: vis-corr in a build without libtorch.
#[must_use]
pub fn of_paper() -> &'static str {
    if cfg!(feature = "torch") { "vis-max" } else { VIS_CORR }
}

/// The weights of a network that needs no libtorch: those of vis-corr, which are built in, or those in a .safetensors file;
/// `None` if these are others.
///
/// # Errors
/// If the file cannot be read.
pub fn without_libtorch(weights: &Path) -> Result<Option<Cow<'static, [u8]>>, VamvsError> {
    if weights == Path::new(VIS_CORR) {
        return Ok(Some(vamvs_weights::VIS_CORR.into()));
    }
    if weights.extension().is_none_or(|extension| extension != SAFETENSORS) {
        return Ok(None);
    }
    let failed = |source| IoError::System { action: "read the weights", path: weights.to_owned(), source };
    Ok(Some(std::fs::read(weights).map_err(failed)?.into()))
}

/// Whether this is `none`: no network is wanted.
#[must_use]
pub fn is_none(weights: &Path) -> bool {
    weights == Path::new(NONE)
}
