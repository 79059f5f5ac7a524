//! The program as a user runs it, on a small rendered scene.

#[cfg(feature = "net")]
mod bad_input;
mod fuse;
#[cfg(feature = "net")]
mod resume;
mod scene;
