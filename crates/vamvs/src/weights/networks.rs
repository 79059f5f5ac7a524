//! The networks that are built in, and modules in files.

use std::borrow::Cow;
use std::path::Path;

use vamvs_io::IoError;
use vamvs_net::{Device, Network};

use super::NONE;
use crate::{Quality, VamvsError};

/// The networks that are built in, by name.
const BUILT_IN: [(&str, &[u8]); 3] = [
    ("vis-corr", vamvs_weights::VIS_CORR_MODULE),
    ("vis-max", vamvs_weights::VIS_MAX),
    ("photometric", vamvs_weights::PHOTOMETRIC),
];

/// Where a network is.
enum Source<'a> {
    BuiltIn(&'static str, &'static [u8]),
    File(&'a Path),
}

/// Loads the built-in network named `weights`, or the module in the file `weights`; by default the
/// network of [`Quality::Normal`].
///
/// # Errors
/// If the file is not a module of the contract.
pub fn load(weights: Option<&Path>, device: Device) -> Result<Network, VamvsError> {
    Ok(match source(weights) {
        Source::BuiltIn(name, bytes) => Network::from_reader(bytes, device, name)?,
        Source::File(path) if !path.exists() => return Err(not_there(path)),
        Source::File(path) => Network::load(path, device)?,
    })
}

/// The bytes of the module that [`load`] loads, a part of the identity of depth maps.
///
/// # Errors
/// If the file cannot be read.
pub fn bytes(weights: Option<&Path>) -> Result<Cow<'static, [u8]>, VamvsError> {
    match source(weights) {
        Source::BuiltIn(_, bytes) => Ok(bytes.into()),
        Source::File(path) => {
            let failed =
                |source| IoError::System { action: "read the weights", path: path.to_owned(), source };
            Ok(std::fs::read(path).map_err(failed)?.into())
        }
    }
}

fn not_there(path: &Path) -> VamvsError {
    if path == Path::new(NONE) {
        return VamvsError::Request(format!(
            "{NONE} is the plane sweep, which is no network: expected a module"
        ));
    }
    let names = BUILT_IN.map(|(name, _)| name).join(", ");
    VamvsError::Request(format!(
        "{}: no such file, and no built-in network: expected a module, {names} or {NONE}",
        path.display()
    ))
}

/// Whether this is the name of a built-in network rather than a file.
pub(super) fn is_network(weights: &Path) -> bool {
    matches!(source(Some(weights)), Source::BuiltIn(..))
}

fn source(weights: Option<&Path>) -> Source<'_> {
    let path = weights.unwrap_or(Path::new(Quality::default().weights()));
    let named = BUILT_IN.into_iter().find(|(name, _)| path == Path::new(name));
    named.map_or(Source::File(path), |(name, bytes)| Source::BuiltIn(name, bytes))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::weights::is_built_in;

    #[test]
    fn names_are_built_in_and_paths_are_files() {
        assert!(is_built_in(Path::new("vis-max")) && is_built_in(Path::new("none")));
        assert!(!is_built_in(Path::new("./vis-max")) && !is_built_in(Path::new("vis-max.pt")));
        let normal = Quality::Normal.weights();
        assert_eq!(bytes(None).unwrap(), bytes(Some(Path::new(normal))).unwrap());
        let error = bytes(Some(Path::new("absent/net.pt"))).unwrap_err().with_causes();
        assert!(error.contains("net.pt"), "{error}");
    }

    #[test]
    fn the_built_in_networks_are_modules_of_the_contract() {
        for (name, _) in BUILT_IN {
            load(Some(Path::new(name)), Device::Cpu).unwrap();
        }
        for quality in [Quality::Draft, Quality::Normal, Quality::Best] {
            assert!(is_built_in(Path::new(quality.weights())));
        }
    }
}
