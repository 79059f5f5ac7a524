//! `cargo xtask picture`: renders a PLY cloud to an image file.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use clap::{Args, ValueEnum};
use nalgebra::Vector3;
use vamvs_core::Size;
use vamvs_io::{image, ply};
use vamvs_picture::viewpoint::{best_direction, up_of_cameras};
use vamvs_picture::{Look, Surfels, Viewpoint};

/// Render a PLY cloud to a PNG, from a viewpoint that sees most of its surface.
#[derive(Args)]
pub struct Picture {
    /// The cloud.
    #[arg(value_name = "FILE.ply")]
    cloud: PathBuf,
    /// The picture to write.
    #[arg(value_name = "OUT.png")]
    out: PathBuf,
    /// Size of the picture, pixels.
    #[arg(long, value_name = "WxH", default_value = "1280x960", value_parser = parse_size)]
    size: Size,
    /// World axis that points up in the picture [default: up by the cameras in `cams/` next to the cloud; -y if there
    /// are none].
    #[arg(long, value_enum, allow_hyphen_values = true)]
    up: Option<Axis>,
    /// Show the shape, shaded by the normals, instead of the colours.
    #[arg(long)]
    clay: bool,
}

/// An axis of the world.
#[derive(Clone, Copy, ValueEnum)]
enum Axis {
    X,
    Y,
    Z,
    #[value(name = "-x")]
    MinusX,
    #[value(name = "-y")]
    MinusY,
    #[value(name = "-z")]
    MinusZ,
}

impl Picture {
    pub fn run(&self) -> Result<()> {
        let cloud = ply::read(&self.cloud)?;
        ensure!(!cloud.is_empty(), "{} has no points", self.cloud.display());
        let up = self.up()?;
        let view = Viewpoint::from_direction(&cloud, &best_direction(&cloud, &up), &up, self.size);
        let look = if self.clay { Look::Clay } else { Look::Colours };
        image::save_png_rgb(&self.out, &Surfels::new(&cloud).render(&view, look))?;
        println!("{}: {} points", self.out.display(), cloud.len());
        Ok(())
    }

    fn up(&self) -> Result<Vector3<f64>> {
        match self.up {
            Some(axis) => Ok(axis.direction()),
            None => up_beside(&self.cloud),
        }
    }
}

/// The up direction in the world by the cameras in `cams/` next to a cloud. Without cameras it is −y, which is up in a
/// camera's own frame.
pub fn up_beside(cloud: &Path) -> Result<Vector3<f64>> {
    let cams = cloud.with_file_name("cams");
    Ok(up_of_cameras(&cams)?.unwrap_or(-Vector3::y()))
}

impl Axis {
    fn direction(self) -> Vector3<f64> {
        match self {
            Self::X => Vector3::x(),
            Self::Y => Vector3::y(),
            Self::Z => Vector3::z(),
            Self::MinusX => -Vector3::x(),
            Self::MinusY => -Vector3::y(),
            Self::MinusZ => -Vector3::z(),
        }
    }
}

/// Parses `WIDTHxHEIGHT`, each 16 to 8192 pixels.
pub fn parse_size(text: &str) -> Result<Size> {
    let (width, height) = text.split_once('x').context("expected WIDTHxHEIGHT, such as 1280x960")?;
    let side = |text: &str| match text.parse() {
        Ok(side @ 16..=8192) => Ok(side),
        _ => bail!("expected a width and a height from 16 to 8192 pixels, found {text:?}"),
    };
    Ok(Size::new(side(width)?, side(height)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_read_and_nonsense_is_refused() {
        assert_eq!(parse_size("640x480").unwrap(), Size::new(640, 480));
        for wrong in ["640", "640x", "axb", "8x8", "100000x100000", "-640x480"] {
            assert!(parse_size(wrong).is_err(), "{wrong}");
        }
    }
}
