//! Which network is used.

use std::path::Path;

use vamvs_net::{Device, Network};

use crate::VamvsError;

/// The network that is built in, until a trained one is better.
const BUILT_IN: &[u8] = include_bytes!("../../../weights/photometric.pt");

/// Loads the module in `path`, or the built-in one.
///
/// # Errors
/// If the file is no module of the contract.
pub fn load(path: Option<&Path>, device: Device) -> Result<Network, VamvsError> {
    Ok(match path {
        Some(path) => Network::load(path, device)?,
        None => Network::from_reader(BUILT_IN, device, "the built-in network")?,
    })
}

/// The bytes of the module in `path`, or of the built-in one: what a depth map's identity depends on.
///
/// # Errors
/// If the file cannot be read.
pub fn bytes(path: Option<&Path>) -> Result<Vec<u8>, VamvsError> {
    match path {
        None => Ok(BUILT_IN.to_vec()),
        Some(path) => std::fs::read(path).map_err(|source| {
            vamvs_io::IoError::System { action: "read the weights", path: path.to_owned(), source }.into()
        }),
    }
}
