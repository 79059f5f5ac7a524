//! Clouds as PLY files, through ply-rs-bw.
//!
//! Written binary little-endian in COLMAP's order, `x y z nx ny nz red green blue`, then `confidence`
//! and `views`. Coordinates are `float`, or `double` where floats would round visibly because the
//! cloud lies far from the origin for its extent ([`Coordinates::for_points`]).
//!
//! Both ways a point takes some 0.1 µs (five million in 0.6 s on one core), as long as with a writer that
//! copies the fields into a buffer by itself; the library's look-up of properties by name does not show.

pub mod reader;
mod vertex;
pub mod writer;

pub use reader::{read, read_positions, read_some};
pub use writer::{Coordinates, PlyWriter, write};
