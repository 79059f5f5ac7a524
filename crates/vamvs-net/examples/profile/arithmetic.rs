//! The arithmetic of a depth map by stage, from the shapes of the network's layers and the sizes they work at.

use vamvs_core::Size;
use vamvs_net::tch::{TchError, Tensor};
use vamvs_net::{NetError, Network, Stage};

/// How often the layers of one depth map are applied.
struct Counts {
    /// Pixels of the photograph as the network sees it.
    pixels: f64,
    views: f64,
    sources: f64,
    flow_sources: f64,
    planes: f64,
    /// Pixels of the coarse depth map.
    cells: f64,
    /// Points of all flow iterations, the hypotheses of a pixel included, and pixels of these.
    points: f64,
    flow_pixels: f64,
}

/// Floating-point operations of each stage, two for a multiply-add of a convolution or a shared MLP. Warping,
/// correlation, normalisation, completion and the search for neighbours are not counted.
pub fn operations(
    network: &Network,
    size: Size,
    views: usize,
    planes: usize,
) -> Result<[f64; Stage::ALL.len()], NetError> {
    let manifest = network.manifest();
    let pixels = (size.width * size.height) as f64;
    let sources = views - 1;
    let hypotheses = 2 * manifest.hypotheses + 1;
    let flow_pixels = network.iterations().iter().map(|i| pixels / (i.scale * i.scale) as f64).sum::<f64>();
    let counts = Counts {
        pixels: pixels * (network.enlarge() * network.enlarge()) as f64,
        views: views as f64,
        sources: sources as f64,
        flow_sources: manifest.flow_sources.map_or(sources, |most| sources.min(most.get())) as f64,
        planes: planes as f64,
        cells: pixels / (manifest.coarse_stride * manifest.coarse_stride) as f64,
        points: flow_pixels * hypotheses as f64,
        flow_pixels,
    };
    let mut operations = [0.0; Stage::ALL.len()];
    for (name, weight) in network.parameters()? {
        if weight.dim() > 1 {
            let (stage, multiply_adds) = counts.layer(&name, &weight)?;
            operations[stage as usize] += 2.0 * multiply_adds;
        }
    }
    Ok(operations)
}

impl Counts {
    /// The stage that the layer with this weight belongs to, and its multiply-adds.
    fn layer(&self, name: &str, weight: &Tensor) -> Result<(Stage, f64), TchError> {
        let size = weight.numel() as f64;
        let (part, rest) = name.split_once('.').unwrap_or((name, ""));
        let swept = self.planes * self.cells;
        Ok(match part {
            "coarse_images" | "flow_images" | "pyramid" => {
                (Stage::Encode, size * self.views * self.pixels / 4_f64.powi(pyramid_level(rest)))
            }
            "pair_coarse" | "pair_visibility" => {
                (Stage::Sweep, pair(rest, weight, swept * self.sources, self.cells)?)
            }
            "visibility_head" => (Stage::Sweep, size * swept * self.sources),
            "seen" => (Stage::Sweep, size * self.cells * self.sources),
            "volume" => (Stage::Regularize, size * swept / 8_f64.powi(volume_level(rest))),
            "pair_flow" => {
                (Stage::Fetch, pair(rest, weight, self.points * self.flow_sources, self.flow_pixels)?)
            }
            "flow_net" => (Stage::Flow, size * self.points),
            // Parameters without a layer, such as a factor.
            _ => (Stage::Flow, 0.0),
        })
    }
}

/// The multiply-adds of a layer of a shared MLP on pairs. The half of the first layer that sees the reference's
/// features is applied once a pixel.
fn pair(layer: &str, weight: &Tensor, pairs: f64, pixels: f64) -> Result<f64, TchError> {
    let (outputs, inputs) = (weight.size()[0] as f64, weight.size()[1]);
    if !layer.starts_with("pair.") {
        return Ok(weight.numel() as f64 * pairs);
    }
    let of_reference = inputs / 2;
    Ok(outputs * (of_reference as f64 * pixels + (inputs - of_reference) as f64 * pairs))
}

/// The number of halvings at a layer's output, or before its enlargement, by its name: `level2.0`, `up3`, `last`.
fn pyramid_level(layer: &str) -> i32 {
    let name = layer.split('.').next().unwrap_or(layer);
    let level = name.trim_start_matches(char::is_alphabetic).parse().unwrap_or(3);
    if name.starts_with("up") { level + 1 } else { level }
}

/// The number of halvings of the volume at a layer's output, or at the input of a transposed convolution, by its
/// name: `scale4_same`, `up4`, `last`.
fn volume_level(layer: &str) -> i32 {
    let name = layer.split('.').next().unwrap_or(layer);
    let digits: String = name.chars().filter(char::is_ascii_digit).collect();
    let level = digits.parse::<u32>().map_or(0, u32::ilog2) as i32;
    if name.starts_with("up") { level + 1 } else { level }
}
