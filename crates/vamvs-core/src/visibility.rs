//! Whether another view sees what a pixel shows.

/// How another view sees the surface at a pixel's centre.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Visibility {
    /// The pixel shows no surface.
    #[default]
    None,
    /// The surface projects outside of the other view's image, or lies behind its camera.
    OutOfView,
    /// Another surface hides it from the other camera.
    Occluded,
    /// The other view sees the surface.
    Visible,
}
