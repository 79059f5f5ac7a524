//! `report.html`: a run on one page, made from its output folder alone.
//!
//! The page shows the cloud and the mesh `mesh.ply`, if there is one, in 3-D and, for each view, its photograph, depth, confidence and what
//! became of its pixels; of a large run, pictures of some views only. The same folder gives the same page, so it
//! holds no dates or times.

mod record;
mod view;

use std::path::{Path, PathBuf};

use vamvs_core::Mesh;
use vamvs_fusion::{MapSource, ViewReport};
use vamvs_io::{IoError, ply};
use vamvs_picture::number::{grouped, percent};
use vamvs_picture::{CloudView, Legend, Page, Scale, Share, ShownCamera};

use crate::event::{OnEvent, tell};
use crate::output::{LeftOut, folder_of, is_same};
use crate::{Event, Maps, MemoryLimit, OutputFolder, VamvsError};
pub use record::{FusedView, FusionRecord};
use view::ViewPanel;

/// The colours of [`ViewReport::outcomes`], variables of the page's style sheet.
const COLOURS: [&str; 7] =
    ["--lost-0", "--lost-1", "--lost-2", "--lost-3", "--lost-4", "--merged", "--points"];

/// The number of views of which the page shows pictures. More would make it too large for a browser, and take longer
/// than the fusion.
const MOST_PICTURED: usize = 60;

/// The mesh that the page shows.
const MESH: &str = "mesh.ply";

/// Memory for each pixel of a view whose pictures are made.
const BYTES_PER_PIXEL: u64 = 60;

/// Writes the page of depth maps, `report.html` in their folder; returns its path.
///
/// # Errors
/// If a file is missing or malformed, `report.html` is of another program, or the page cannot be written.
pub fn write(maps: &Maps, limit: MemoryLimit, on_event: &mut OnEvent<'_>) -> Result<PathBuf, VamvsError> {
    let path = page_file(maps);
    Page::expect_replaceable(&path)?;
    Report::open(maps, limit)?.page(on_event)?.save(&path)?;
    Ok(path)
}

/// Refuses to write the record of a fusion into `cloud` and, if it is `wanted`, the page over files that are not such.
///
/// # Errors
/// If there is such a file.
pub fn expect_replaceable(maps: &Maps, cloud: &Path, wanted: bool) -> Result<(), VamvsError> {
    if !is_same(folder_of(cloud), maps.root()) {
        return Ok(());
    }
    FusionRecord::expect_replaceable(maps.root())?;
    if wanted { Ok(Page::expect_replaceable(&page_file(maps))?) } else { Ok(()) }
}

/// Whether the page of depth maps is there and shows what is in this file.
#[must_use]
pub fn shows_mesh(maps: &Maps, file: &Path) -> bool {
    page_file(maps).is_file()
        && is_same(folder_of(file), maps.root())
        && file.file_name() == Some(MESH.as_ref())
}

/// Whether a file was changed after another.
fn is_newer(file: &Path, other: &Path) -> bool {
    let changed = |file: &Path| file.metadata().and_then(|data| data.modified()).ok();
    changed(file).zip(changed(other)).is_some_and(|(file, other)| file > other)
}

fn page_file(maps: &Maps) -> PathBuf {
    maps.root().join("report.html")
}

/// What the page is made of.
struct Report<'a> {
    maps: &'a Maps,
    /// How much memory the process may take.
    limit: MemoryLimit,
    fusion: Option<FusionRecord>,
    /// `run.toml`, if there is one.
    settings: Option<String>,
    /// Views that have no readable depth map, or no points.
    left_out: Vec<LeftOut>,
}

impl<'a> Report<'a> {
    fn open(maps: &'a Maps, limit: MemoryLimit) -> Result<Self, VamvsError> {
        let settings = maps.root().join("run.toml");
        let read = |source| IoError::System { action: "read", path: settings.clone(), source };
        let text = settings.is_file().then(|| std::fs::read_to_string(&settings).map_err(read));
        let fusion = FusionRecord::load(maps.root())?;
        let left_out = left_out(maps, fusion.as_ref())?;
        Ok(Self { maps, limit, fusion, settings: text.transpose()?, left_out })
    }

    fn page(&self, on_event: &mut OnEvent<'_>) -> Result<Page, VamvsError> {
        let mut page = Page::new(&self.title(), &self.lead());
        self.totals(&mut page);
        self.cloud(&mut page)?;
        self.views(&mut page, on_event)?;
        self.left_out(&mut page);
        self.outcomes(&mut page);
        self.settings(&mut page);
        Ok(page)
    }

    /// The folder's name.
    fn title(&self) -> String {
        let root = self.maps.root();
        let whole = root.canonicalize().unwrap_or_else(|_| root.to_owned());
        whole.file_name().map_or_else(|| "Depth maps".to_owned(), |name| name.to_string_lossy().into_owned())
    }

    fn lead(&self) -> String {
        let views = self.maps.len();
        let done = match &self.fusion {
            Some(fusion) => format!("{views} depth maps, fused into {}", fusion.cloud),
            None => format!("{views} depth maps, not fused yet"),
        };
        format!("{done}. vamvs {}", env!("CARGO_PKG_VERSION"))
    }

    fn totals(&self, page: &mut Page) {
        let mut figures = vec![(self.maps.len().to_string(), "depth maps")];
        if let Some(fusion) = &self.fusion {
            let total = fusion.total();
            figures.push((grouped(total.points), "points"));
            figures.push((grouped(total.pixels), "pixels"));
            figures.push((percent(total.kept(), 1), "of them passed all filters"));
        }
        page.figures(&figures);
        if let Some(fusion) = &self.fusion {
            let shares = shares(&fusion.total());
            page.bar(&shares);
            page.key(&shares);
        }
    }

    fn cloud(&self, page: &mut Page) -> Result<(), VamvsError> {
        page.heading(if self.fusion.is_some() { "The cloud" } else { "Cameras" });
        let file = self.fusion.as_ref().map(|fusion| fusion.cloud(self.maps.root()));
        let cloud = file.map(|file| ply::read_some(&file, &CloudView::sample_indices)).transpose()?;
        let camera = |view: usize| ShownCamera {
            name: self.maps.names()[view].clone(),
            camera: *self.maps.camera(view),
            cam_from_world: *self.maps.pose(view),
        };
        let cameras = (0..self.maps.len()).map(camera).collect();
        let there = cloud.is_some();
        let (total, taken) = cloud.unwrap_or_default();
        let view = self.with_mesh(page, CloudView::new(total, &taken, cameras))?;
        if there {
            page.cloud(&view);
        }
        page.floor_plan(&view);
        Ok(())
    }

    /// With the mesh that is beside the depth maps, if there is one that was made after them.
    fn with_mesh(&self, page: &mut Page, view: CloudView) -> Result<CloudView, VamvsError> {
        let file = self.maps.root().join(MESH);
        if !file.is_file() || !ply::is_mesh(&file)? {
            return Ok(view);
        }
        if (0..self.maps.len()).any(|view| is_newer(self.maps.depth_file(view), &file)) {
            page.paragraph(&format!(
                "{MESH} is older than the depth maps, and not shown: vamvs mesh makes it anew."
            ));
            return Ok(view);
        }
        let (vertices, triangles) = ply::read_mesh(&file)?;
        let mut mesh = Mesh::of(&vertices, triangles);
        drop(vertices);
        let total = mesh.triangles.len();
        vamvs_mesh::reduce_to_show(&mut mesh, CloudView::MOST_TRIANGLES);
        Ok(view.with_mesh(&mesh, total))
    }

    fn views(&self, page: &mut Page, on_event: &mut OnEvent<'_>) -> Result<(), VamvsError> {
        page.heading("Views");
        page.legends(&[
            Legend::new("depth, each view by itself", Scale::Turbo, "near", "far; grey: none"),
            Legend::new("confidence", Scale::Confidence, "0", "1"),
        ]);
        let pictured = pictured(self.maps.len());
        let total = pictured.len();
        if total < self.maps.len() {
            page.paragraph(&format!(
                "Pictures of {total} views, evenly spread over all {}; the table below counts the pixels of all.",
                self.maps.len()
            ));
        }
        page.begin_panels();
        let load = |index: usize| ViewPanel::load(self.maps, pictured[index]);
        let at_once = self.maps.at_once(self.limit, BYTES_PER_PIXEL);
        let panels = crate::export::for_all_views(total, at_once, load, &mut |done| {
            tell(on_event, Event::Report { done, total })
        })?;
        for panel in &panels {
            panel.add_to(page, self.fusion.as_ref().and_then(|fusion| fusion.pixels(panel.name())));
        }
        page.end_panels();
        Ok(())
    }

    fn left_out(&self, page: &mut Page) {
        if self.left_out.is_empty() {
            return;
        }
        page.heading("Views left out");
        let row = |view: &LeftOut| vec![view.view.clone(), view.reason.clone()];
        page.table(&["view", "why"], &self.left_out.iter().map(row).collect::<Vec<_>>());
    }

    fn outcomes(&self, page: &mut Page) {
        let Some(fusion) = &self.fusion else { return };
        page.heading("What became of the pixels");
        let outcomes = ViewReport::default().outcomes();
        let head: Vec<&str> =
            ["view", "pixels"].into_iter().chain(outcomes.iter().map(|outcome| outcome.0)).collect();
        let row = |name: &str, pixels: &ViewReport| {
            let counts = pixels.outcomes().map(|(_, count)| grouped(count));
            [vec![name.to_owned(), grouped(pixels.pixels)], counts.to_vec()].concat()
        };
        let mut rows = vec![row("all views", &fusion.total())];
        rows.extend(fusion.views.iter().map(|fused| row(&fused.view, &fused.pixels)));
        page.table(&head, &rows);
        page.paragraph("Each pixel is counted once, by the first filter that took it.");
    }

    fn settings(&self, page: &mut Page) {
        page.heading("Settings");
        if let Some(fusion) = &self.fusion {
            let options = serde_json::to_string_pretty(&fusion.options).expect("options are plain data");
            page.details("Fusion, as it was done last", |page| page.verbatim(&options));
        }
        match &self.settings {
            Some(text) => {
                page.details("The run that made the depth maps: run.toml", |page| page.verbatim(text));
            }
            None => page.paragraph("There is no run.toml with the settings of the depth maps."),
        }
    }
}

/// The views of which the page shows pictures, of `count`: all, or [`MOST_PICTURED`], evenly spread from the first to
/// the last.
fn pictured(count: usize) -> Vec<usize> {
    let shown = count.min(MOST_PICTURED);
    (0..shown).map(|index| index * (count - 1) / (shown - 1).max(1)).collect()
}

/// The views that were left out, each once per reason: by the run that made the depth maps, because
/// their files cannot be read, or by fusion.
fn left_out(maps: &Maps, fusion: Option<&FusionRecord>) -> Result<Vec<LeftOut>, VamvsError> {
    let mut all = OutputFolder::new(maps.root()).left_out()?;
    let later = maps.left_out().iter().chain(fusion.map_or(&[][..], |fusion| &fusion.left_out));
    for view in later {
        if !all.contains(view) {
            all.push(view.clone());
        }
    }
    Ok(all)
}

/// What became of pixels, as shares.
fn shares(pixels: &ViewReport) -> Vec<Share> {
    let share = |count: u64| count as f64 / pixels.pixels.max(1) as f64;
    let outcomes = pixels.outcomes().into_iter().zip(COLOURS);
    outcomes.map(|((what, count), colour)| Share { what, colour, share: share(count) }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_small_run_is_pictured_whole_and_a_large_one_from_its_first_to_its_last_view() {
        for count in [0, 1, 2, MOST_PICTURED] {
            assert_eq!(pictured(count), (0..count).collect::<Vec<_>>());
        }
        for count in [MOST_PICTURED + 1, 1000, 10_000] {
            let views = pictured(count);
            assert_eq!((views.len(), views[0], views[MOST_PICTURED - 1]), (MOST_PICTURED, 0, count - 1));
            assert!(views.is_sorted_by(|a, b| a < b), "no view twice");
        }
    }
}
