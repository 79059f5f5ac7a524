//! Type-checks the build without libtorch for other platforms.

use std::process::Command;

use anyhow::Result;

use crate::cargo;
use crate::step::run;

/// Platforms, and what is checked for each.
const PLATFORMS: [(&str, &[&str]); 4] = [
    ("x86_64-pc-windows-gnu", &["vamvs-cli"]),
    ("aarch64-apple-darwin", &["vamvs-cli"]),
    ("aarch64-unknown-linux-gnu", &["vamvs-cli"]),
    (
        "wasm32-unknown-unknown",
        &["vamvs-core", "vamvs-io", "vamvs-refine", "vamvs-fusion", "vamvs-mesh", "vamvs-corr"],
    ),
];

/// Type-checks for all of them; warnings are errors. Platforms that rustup does not have and cannot install are left out, which is said.
pub fn check() -> Result<()> {
    for (platform, packages) in PLATFORMS {
        let install = Command::new("rustup").args(["target", "add", platform]).status();
        if !install.is_ok_and(|status| status.success()) {
            println!("{platform} cannot be installed by rustup: not checked");
            continue;
        }
        let mut check = cargo(&["check", "--target", platform]);
        packages.iter().for_each(|package| {
            check.args(["-p", package]);
        });
        if packages == ["vamvs-cli"] {
            check.args(["--features", "gpu"]);
        }
        run(&format!("check for {platform}"), check.env("RUSTFLAGS", "-D warnings"))?;
    }
    Ok(())
}
