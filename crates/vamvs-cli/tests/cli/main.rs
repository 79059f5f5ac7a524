//! The program as a user runs it, on a small rendered scene.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

#[cfg(feature = "torch")]
mod bad_input;
#[cfg(feature = "torch")]
mod calibrate;
#[cfg(all(unix, feature = "torch"))]
mod documents;
mod eval;
mod exchange;
#[cfg(feature = "torch")]
mod fovea;
mod fuse;
mod gauntlet;
#[cfg(feature = "gpu")]
mod gpu;
mod info;
mod mesh;
mod outside;
mod panorama;
mod pseudo;
mod refine;
mod report;
#[cfg(feature = "torch")]
mod resume;
mod scene;
#[cfg(feature = "synth")]
mod synth;
mod tasks;
mod terminal;
mod visibility;
mod without_network;
