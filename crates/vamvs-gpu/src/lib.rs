//! vis-corr, the network of vamvs, on any GPU: Vulkan, Metal or DirectX 12, by wgpu.
//!
//! [`Network`] is made from a [`vamvs_corr::Network`], whose layers and constants it uses, and gives the same depth maps up to the rounding
//! of the device: graphics processors may fuse or split operations, and divide inexactly, so the bits of the CPU are not to be had.
//! Features of photographs stay in the device's memory; of a depth map only the result leaves it.
//!
//! ```no_run
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let weights = std::fs::read("vis-corr.safetensors")?;
//! let gpu = vamvs_gpu::Gpu::open(None)?;
//! let network = vamvs_gpu::Network::new(gpu, &vamvs_corr::Network::new(&weights)?)?;
//! # Ok(()) }
//! ```

mod device;
mod error;
mod kernels;
mod layer;
mod map;
mod matching;
mod matching_kernels;
mod network;
mod photograph;
mod pyramid;
mod recorder;
mod sweep;
mod view;
mod volume_net;

pub use device::{Adapter, Gpu, adapters};
pub use error::GpuError;
pub use network::Network;
pub use view::EncodedView;
