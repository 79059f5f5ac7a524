//! Clouds as PLY files, through ply-rs-bw.
//!
//! Written binary little-endian in COLMAP's order, `x y z nx ny nz red green blue`, then `confidence`
//! and `views`. Coordinates are `float`, or `double` where floats would round visibly because the
//! cloud lies far from the origin for its extent ([`Coordinates::fitting`]).
//!
//! Five million points are written in 0.3 s and read in 0.5 s on one core, points streaming both ways;
//! a writer of our own that copied the fields into a buffer took as long.

pub mod reader;
mod vertex;
pub mod writer;

pub use reader::read;
pub use writer::{Coordinates, PlyWriter, write};
