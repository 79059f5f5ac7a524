//! The demo's scene: rendered photographs with exact ground truth, written in MVSNet's layout.

use std::path::{Path, PathBuf};

use anyhow::Result;
use vamvs_core::{Grid, Size};
use vamvs_synth::RenderOptions;
use vamvs_tests::{Rendered, fixtures, folder, render, rig};

/// Size of the photographs, pixels.
const SIZE: Size = Size::new(640, 480);

/// Number of photographs.
const VIEWS: usize = 12;

/// Light paths for each pixel; the renderer denoises the result.
const SAMPLES: usize = 4;

/// Factor by which the given depth ranges are wider than the true ones at each end.
const WIDER: f64 = 1.15;

/// The rendered scene and its folder.
pub struct DemoScene {
    root: PathBuf,
    /// The photographs with their cameras and ground truth.
    pub views: Vec<Rendered>,
}

impl DemoScene {
    /// Renders the scene.
    pub fn render(root: &Path) -> Self {
        let stations = rig::arc(VIEWS, SIZE);
        let options = RenderOptions { samples: SAMPLES, ..RenderOptions::default() };
        let views = render(fixtures::still_life_tracer(), &stations, &options);
        Self { root: root.to_owned(), views }
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

    /// Writes photographs and cameras. There is no `pair.txt`, so `vamvs` selects the source views.
    pub fn write(&self) -> Result<()> {
        Ok(folder::write_mvsnet(&self.root, &self.views, Self::name, WIDER)?)
    }

    /// The true depth of all views at another size.
    pub fn depth_at(&self, size: Size) -> Vec<Grid<f32>> {
        let depth = |view: &Rendered| {
            let camera = view.photo.camera.resized(size);
            fixtures::still_life_tracer().ground_truth(&camera, &view.photo.cam_from_world).depth
        };
        self.views.iter().map(depth).collect()
    }

    /// The median depth of all pixels.
    pub fn median_depth(&self) -> f64 {
        let mut depths: Vec<f32> = self.views.iter().flat_map(|view| view.depth.data()).copied().collect();
        let middle = depths.len() / 2;
        f64::from(*depths.select_nth_unstable_by(middle, f32::total_cmp).1)
    }
}
