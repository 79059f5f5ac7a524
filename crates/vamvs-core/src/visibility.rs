//! Whether another view sees what a pixel shows.

/// What becomes of the surface at a pixel's centre in another view.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Visibility {
    /// The pixel shows no surface.
    #[default]
    None,
    /// The surface projects beside the other view's image, or lies behind its camera.
    OutOfView,
    /// Something stands between the surface and the other camera.
    Occluded,
    /// The other view sees the surface.
    Visible,
}
