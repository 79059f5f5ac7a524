//! How far before and behind a surface a view tells something of it.

/// A depth is averaged with others up to this distance from it, in sizes of a pixel on the surface...
const BAND_PIXELS: f32 = 2.5;

/// ... or up to so many standard deviations, if that is more, ...
const BAND_SIGMAS: f32 = 1.5;

/// ... but not farther than this, in sizes of a pixel.
const WIDEST_BAND: f32 = 6.0;

/// Behind a surface something is told up to this multiple of what is near at least, so that all corners of a cell that the surface
/// goes through are known.
const CELL_BEHIND: f32 = 1.75;

/// How far from a depth others are averaged with it.
pub(crate) fn band(pixel: f32, sigma: f32) -> f32 {
    (BAND_SIGMAS * sigma).max(BAND_PIXELS * pixel).min(WIDEST_BAND * pixel)
}

/// The distance behind a surface up to which something is told.
pub(crate) fn known_behind(band: f32, near: f32) -> f32 {
    (2.0 * band).max(CELL_BEHIND * near)
}

/// The largest of these distances, sizes of a pixel.
pub(crate) fn deepest_behind(near: f32) -> f32 {
    known_behind(WIDEST_BAND, near)
}
