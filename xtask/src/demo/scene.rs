//! The demo's scene: rendered photographs with exact truth, written in MVSNet's layout.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use vamvs_core::{DepthRange, Size};
use vamvs_io::{image, mvsnet};
use vamvs_tests::{Rendered, fixtures};

/// Size of the photographs.
const SIZE: Size = Size::new(640, 480);

/// Number of photographs.
const VIEWS: usize = 12;

/// How much wider than the truth the given depth ranges are, as a factor at either end.
const WIDER: f64 = 1.15;

/// A scene in a folder.
pub struct DemoScene {
    root: PathBuf,
    /// What the photographs show.
    pub views: Vec<Rendered>,
}

impl DemoScene {
    /// Renders the scene.
    pub fn render(root: &Path) -> Self {
        Self { root: root.to_owned(), views: fixtures::still_life(SIZE, VIEWS) }
    }

    /// Folder of photographs.
    pub fn images(&self) -> PathBuf {
        self.root.join("images")
    }

    /// Folder of cameras.
    pub fn cams(&self) -> PathBuf {
        self.root.join("cams")
    }

    /// The name of a view.
    pub fn name(view: usize) -> String {
        format!("view-{view:02}")
    }

    /// Writes photographs and cameras, without `pair.txt`: source views are to be found.
    pub fn write(&self) -> Result<()> {
        for folder in [self.images(), self.cams()] {
            std::fs::create_dir_all(&folder)
                .with_context(|| format!("{} could not be made", folder.display()))?;
        }
        for (index, view) in self.views.iter().enumerate() {
            let (name, photo) = (Self::name(index), &view.photo);
            image::save_png_rgb(&self.images().join(format!("{name}.png")), &photo.image)?;
            let cam = self.cams().join(format!("{name}_cam.txt"));
            mvsnet::write_cam(&cam, &photo.camera, &photo.cam_from_world, Some(range(view)?))?;
        }
        Ok(())
    }

    /// What the photographs would show at another size.
    pub fn views_at(&self, size: Size) -> Vec<Rendered> {
        if size == SIZE { self.views.clone() } else { fixtures::still_life(size, VIEWS) }
    }

    /// The median depth of all pixels.
    pub fn median_depth(&self) -> f64 {
        let mut depths: Vec<f32> = self.views.iter().flat_map(|view| view.depth.data()).copied().collect();
        let middle = depths.len() / 2;
        f64::from(*depths.select_nth_unstable_by(middle, f32::total_cmp).1)
    }
}

fn range(view: &Rendered) -> Result<DepthRange> {
    let near = view.depth.data().iter().copied().fold(f32::INFINITY, f32::min);
    let far = view.depth.data().iter().copied().fold(0.0, f32::max);
    Ok(DepthRange::try_new(f64::from(near) / WIDER, f64::from(far) * WIDER)?)
}
