//! The environment map that lights the test scenes.

use std::sync::Arc;

use vamvs_core::{Grid, Size};
use vamvs_synth::Environment;

/// A cloudy sky: bluish above, brighter towards the horizon, brown below.
#[must_use]
pub fn dim() -> Environment {
    let size = Size::new(16, 32);
    let colour = |_, y: usize| {
        let height = 1.0 - 2.0 * (y as f32 + 0.5) / size.height as f32;
        if height > 0.0 { [0.62 - 0.2 * height, 0.66 - 0.12 * height, 0.72] } else { [0.22, 0.19, 0.16] }
    };
    Environment { map: Arc::new(Grid::from_fn(size, colour)), rotation: 0.0, strength: 0.9 }
}
