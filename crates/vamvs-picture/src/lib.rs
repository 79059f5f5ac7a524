//! Pictures of depth maps and clouds, and pages of HTML that hold them.
//!
//! [`Scale`] turns numbers into colours, [`map`] depth maps and errors into values to paint, [`Surfels`]
//! a cloud into a picture as seen from a [`Viewpoint`], [`panel`] several pictures into one,
//! a [`Chart`] curves into a diagram. A [`Page`]
//! needs no other file: its pictures are in it.

pub mod chart;
pub mod colour;
pub mod map;
pub mod page;
pub mod panel;
pub mod splat;
pub mod viewpoint;

pub use chart::{Chart, Curve};
pub use colour::Scale;
pub use page::{Legend, Page, Picture};
pub use splat::{Look, Surfels};
pub use viewpoint::Viewpoint;
