//! sRGB and linear light.

use std::sync::LazyLock;

use vamvs_core::Rgb;

static LINEAR: LazyLock<[f32; 256]> =
    LazyLock::new(|| std::array::from_fn(|value| decode(value as f32 / 255.0)));

/// Linear light, 0 to 1, of an 8-bit sRGB colour.
pub(crate) fn linear(rgb: Rgb) -> [f32; 3] {
    rgb.map(|value| LINEAR[usize::from(value)])
}

/// The 8-bit sRGB value of linear light, which is clipped to 0 to 1.
pub(crate) fn srgb(linear: f32) -> u8 {
    let light = linear.clamp(0.0, 1.0);
    let value = if light <= 0.003_130_8 { 12.92 * light } else { 1.055 * light.powf(1.0 / 2.4) - 0.055 };
    (255.0 * value).round() as u8
}

/// The luminance of linear light, by the weights of sRGB's primaries.
pub(crate) fn luminance([red, green, blue]: [f32; 3]) -> f32 {
    0.2126 * red + 0.7152 * green + 0.0722 * blue
}

fn decode(value: f32) -> f32 {
    if value <= 0.040_45 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decoding_undoes_encoding() {
        for value in 0..=255 {
            assert_eq!(srgb(linear([value; 3])[0]), value);
        }
        assert!((linear([188; 3])[1] - 0.5029).abs() < 1e-4);
    }
}
