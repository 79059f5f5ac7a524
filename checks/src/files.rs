//! Writing files whole or not at all.

use std::path::Path;

use anyhow::Result;

/// Writes a file.
pub fn save(path: &Path, content: impl AsRef<[u8]>) -> Result<()> {
    Ok(vamvs_io::atomic::write(path, |out| out.write_all(content.as_ref()))?)
}
