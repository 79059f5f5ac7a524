//! Pictures of depth maps and clouds, and pages of HTML that hold them.
//!
//! [`Scale`] turns numbers into colours, [`map`] depth maps and errors into values to paint, [`Surfels`]
//! a cloud into a picture as seen from a [`Viewpoint`], [`panel`] several pictures into one,
//! a [`Chart`] curves into a diagram. A [`Page`] needs no other file: its pictures are in it, and so is a
//! [`CloudView`].

pub mod chart;
pub mod cloud_view;
pub mod colour;
mod floor;
pub mod map;
pub mod number;
pub mod packed;
pub mod page;
pub mod panel;
pub mod splat;
mod template;
pub mod viewpoint;

pub use chart::{Chart, Curve};
pub use cloud_view::{CloudView, ShownCamera};
pub use colour::Scale;
pub use page::{Legend, Page, Picture, Share};
pub use splat::{Look, Surfels};
pub use viewpoint::Viewpoint;
