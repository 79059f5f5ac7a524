//! The program as a user runs it, on a small rendered scene.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

#[cfg(feature = "net")]
mod bad_input;
#[cfg(feature = "net")]
mod calibrate;
#[cfg(all(unix, feature = "net"))]
mod documents;
mod eval;
mod exchange;
#[cfg(feature = "net")]
mod fovea;
mod fuse;
mod info;
mod pseudo;
mod refine;
mod report;
#[cfg(feature = "net")]
mod resume;
mod scene;
mod synth;
mod tasks;
mod terminal;
#[cfg(feature = "net")]
mod visibility;
mod without_network;
