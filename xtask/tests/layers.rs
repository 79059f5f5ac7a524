//! Checks the layers of the workspace: a crate depends only on crates of lower layers, not on those of its own.

use std::process::Command;

use serde_json::Value;

/// The layers, lowest first. A crate may use crates of lower layers, and none of its own or a higher one.
const LAYERS: [&[&str]; 7] = [
    &["vamvs-core", "vamvs-weights"],
    &["vamvs-io", "vamvs-fusion", "vamvs-eval", "vamvs-corr", "vamvs-mesh", "vamvs-net", "vamvs-refine"],
    &["vamvs-gpu", "vamvs-picture"],
    &["vamvs-synth", "vamvs-train"],
    &["vamvs"],
    &["vamvs-cli", "vamvs-tests"],
    &["vamvs-checks", "vamvs-python", "xtask"],
];

/// The crates that may use tch, and with it libtorch.
const USE_TCH: [&str; 2] = ["vamvs-net", "vamvs-train"];

fn layer(name: &str) -> usize {
    let layer = LAYERS.iter().position(|layer| layer.contains(&name));
    layer.unwrap_or_else(|| panic!("{name} has no layer: add it to LAYERS"))
}

/// The packages of the workspace, as `cargo metadata` describes them.
fn packages() -> Vec<Value> {
    let mut cargo = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    cargo.args(["metadata", "--no-deps", "--offline", "--format-version", "1"]);
    let output = cargo.current_dir(env!("CARGO_MANIFEST_DIR")).output().expect("cargo starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let metadata: Value = serde_json::from_slice(&output.stdout).expect("cargo metadata is JSON");
    metadata["packages"].as_array().expect("cargo metadata lists packages").clone()
}

/// Names and kinds (`None`, `"dev"`, `"build"`) of a package's dependencies.
fn dependencies(package: &Value) -> impl Iterator<Item = (&str, Option<&str>)> {
    let dependencies = package["dependencies"].as_array().into_iter().flatten();
    dependencies.map(|d| (name(d), d["kind"].as_str()))
}

fn name(item: &Value) -> &str {
    item["name"].as_str().expect("packages and dependencies have names")
}

#[test]
fn crates_use_lower_layers_only() {
    let packages = packages();
    assert_eq!(packages.len(), LAYERS.concat().len(), "each crate is in LAYERS, each name there is a crate");
    for package in &packages {
        let name = name(package);
        let used = dependencies(package).filter(|(used, kind)| {
            *kind != Some("dev") && packages.iter().any(|package| package["name"] == *used)
        });
        for (used, _) in used {
            assert!(layer(used) < layer(name), "{name} must not use {used}: see ARCHITECTURE.md");
        }
    }
}

#[test]
fn libtorch_is_used_by_the_network_only() {
    for package in &packages() {
        let name = name(package);
        let uses_tch = dependencies(package).any(|(used, _)| ["tch", "torch-sys"].contains(&used));
        assert!(!uses_tch || USE_TCH.contains(&name), "{name} must not use tch: geometry needs no libtorch");
    }
}

#[test]
fn only_the_command_line_parses_arguments() {
    for package in &packages() {
        let crate_name = name(package);
        let mut dependencies = package["dependencies"].as_array().into_iter().flatten();
        // As an optional dependency, clap only gives enum values their names on the command line.
        let parses = |d: &Value| name(d) == "clap" && d["kind"].is_null() && d["optional"] == false;
        let uses_clap = dependencies.any(parses);
        assert!(
            !uses_clap || ["vamvs-cli", "vamvs-checks", "xtask"].contains(&crate_name),
            "{crate_name} must not use clap"
        );
    }
}
