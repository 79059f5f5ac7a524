//! Pictures of depth maps and clouds, and pages of HTML that hold them.
//!
//! [`Scale`] turns numbers into colours, [`map`] depth maps and errors into values to paint, [`Surfels`]
//! a cloud into a picture as seen from a [`Viewpoint`], [`panel`] several pictures into one. A [`Page`]
//! needs no other file: its pictures are in it.

pub mod colour;
pub mod map;
pub mod page;
pub mod panel;
pub mod splat;
pub mod viewpoint;

pub use colour::Scale;
pub use page::{Legend, Page, Picture};
pub use splat::{Look, Surfels};
pub use viewpoint::Viewpoint;
