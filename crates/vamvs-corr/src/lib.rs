//! vis-corr, the light network of vamvs, in Rust alone: encoder, plane sweep, regularisation, depth.
//!
//! It is a cascade. A photograph is seen twice: at half its size, to sweep the whole depth range at a stride of 8 pixels, and as it is,
//! to sweep a few planes around that depth at a stride of 4. Views are compared by group-wise correlation and weighed by a
//! learned visibility, as in Chen et al. (TPAMI 2020). The network also tells for each pixel how likely there is a surface to be
//! measured at all. Its PyTorch source, from which the weights are exported, is `models/vis_corr.py`.
//!
//! Results are the same bit for bit for any number of threads and on any instruction set.

mod convolution;
mod enlarge;
pub mod error;
pub mod estimate;
mod lanes;
pub mod layers;
mod map;
pub mod network;
mod plane_map;
mod pyramid;
mod surface;
mod sweep;
mod to_one;
pub mod view;
mod volume_net;
pub mod weights;
mod wide;

pub use error::CorrError;
pub use estimate::{Estimate, Found};
pub use network::{Network, Stage};
pub use view::EncodedView;
pub use weights::Manifest;
