//! Textures for surfaces that are to be reconstructed: they have detail at every scale, so that views can be
//! matched from any distance.

use std::sync::Arc;

use vamvs_core::{Grid, Rgb, Size};
use vamvs_synth::Material;
use vamvs_synth::pattern::{Motif, Pattern};

/// Side of a texture image, pixels.
const SIDE: usize = 512;

/// What a surface is made of.
#[derive(Clone, Copy, Debug)]
pub struct Look {
    /// The pattern's motif.
    pub motif: Motif,
    /// How many of the motif's units (bricks, tiles, …) fit across the texture image.
    pub count: u16,
    /// The motif's colours, from its low to its high values, sRGB 0 to 255.
    pub colours: [[f32; 3]; 3],
    /// Side of one repetition of the texture image on the surface, metres.
    pub metres: f32,
    /// The specular coat: reflectance at normal incidence and roughness, each 0 to 1.
    pub coat: [f32; 2],
}

impl Look {
    /// A material of this look, darkened unevenly by wear. Different seeds give different textures of the same
    /// look.
    #[must_use]
    pub fn material(&self, seed: u32) -> Material {
        let Self { motif, count, colours, metres, coat } = *self;
        let picture = Pattern { motif, count, colours, grain: 0.25, seed }.draw(SIDE);
        Material {
            albedo: Arc::new(worn(&picture, seed)),
            tiling: [1.0 / metres; 2],
            tint: [1.0; 3],
            specular: coat[0],
            roughness: coat[1],
        }
    }
}

/// Darkens a texture image by noise of all scales, from large spots down to single pixels.
fn worn(picture: &Grid<Rgb>, seed: u32) -> Grid<Rgb> {
    let colours = [110.0, 190.0, 255.0].map(|grey| [grey; 3]);
    let wear = Pattern { motif: Motif::Clouds, count: 1, colours, grain: 0.4, seed: !seed }.draw(SIDE);
    let factor = |i: usize| f32::from(wear.data()[i][0]) / 255.0;
    let shade = |(i, colour): (usize, &Rgb)| colour.map(|c| (f32::from(c) * factor(i)) as u8);
    Grid::from_vec(Size::new(SIDE, SIDE), picture.data().iter().enumerate().map(shade).collect())
}
