//! Presets that trade time for quality.

use crate::DepthOptions;

/// A preset: sizes of photographs, and passes of refinement.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[non_exhaustive]
pub enum Quality {
    /// A quick look at a capture: photographs of 800 pixels at most, vis-corr, one pass of refinement; a third of the time
    /// of normal.
    Draft,
    /// The defaults: vis-corr, both passes of refinement.
    #[default]
    Normal,
    /// As normal, but the network sees photographs of 2048 pixels: fewer outliers, for more time.
    Best,
}

impl Quality {
    /// The name of the network.
    #[must_use]
    pub fn weights(self) -> &'static str {
        match self {
            Self::Draft | Self::Normal | Self::Best => "vis-corr",
        }
    }

    /// The same options with those replaced that the quality decides: sizes, network stages and
    /// passes of refinement.
    #[must_use]
    pub fn applied(self, options: &DepthOptions) -> DepthOptions {
        let own = match self {
            Self::Draft => {
                DepthOptions { max_size: 800, network_size: 800, geometric: false, ..DepthOptions::default() }
            }
            Self::Normal => DepthOptions::default(),
            Self::Best => DepthOptions { network_size: 2048, ..DepthOptions::default() },
        };
        let DepthOptions { max_size, network_size, refine, geometric, coarse_stride, iterations, .. } = own;
        DepthOptions {
            max_size,
            network_size,
            refine,
            geometric,
            coarse_stride,
            iterations,
            ..options.clone()
        }
    }
}
