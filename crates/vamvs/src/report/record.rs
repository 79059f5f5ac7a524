//! The record of a fusion in the output folder: `fusion.json`.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use vamvs_fusion::ViewReport;
use vamvs_io::atomic;

use crate::output::{LeftOut, OutputFolder, folder_of, is_same, read_json, write_json};
use crate::{FuseSummary, FusionOptions, Maps, VamvsError};

/// What the last fusion into the folder did.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FusionRecord {
    /// The cloud's file name in the folder.
    pub cloud: String,
    /// How it was made.
    pub options: FusionOptions,
    /// What became of the pixels of each view.
    pub views: Vec<FusedView>,
    /// The views that were left out.
    #[serde(default)]
    pub left_out: Vec<LeftOut>,
}

/// What became of a view's pixels.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FusedView {
    /// The view's name.
    pub view: String,
    /// Its pixels.
    pub pixels: ViewReport,
}

impl FusionRecord {
    /// The record of a fusion into `cloud`; `None` if that is not in the folder of the depth maps,
    /// whose record then stays as it is.
    #[must_use]
    pub fn of(maps: &Maps, cloud: &Path, options: &FusionOptions, fused: &FuseSummary) -> Option<Self> {
        let view = |(view, pixels): &(String, ViewReport)| FusedView { view: view.clone(), pixels: *pixels };
        is_same(folder_of(cloud), maps.root()).then(|| Self {
            cloud: cloud.file_name().unwrap_or_default().to_string_lossy().into_owned(),
            options: options.clone(),
            views: fused.views.iter().map(view).collect(),
            left_out: fused.skipped.clone(),
        })
    }

    /// Refuses to replace a file that is not such a record.
    pub(super) fn expect_replaceable(folder: &Path) -> Result<(), VamvsError> {
        let is_record =
            |begin: &[u8]| begin.starts_with(b"{") && String::from_utf8_lossy(begin).contains(r#""cloud""#);
        Ok(atomic::expect_kind(&OutputFolder::new(folder).fusion(), is_record)?)
    }

    /// Writes it into a folder.
    ///
    /// # Errors
    /// If the file cannot be written, or is there and no such record.
    pub fn save(&self, folder: &Path) -> Result<(), VamvsError> {
        Self::expect_replaceable(folder)?;
        write_json(&OutputFolder::new(folder).fusion(), self)
    }

    /// Reads it from a folder; `None` if nothing was fused there.
    ///
    /// # Errors
    /// If the file cannot be read or is malformed.
    pub fn load(folder: &Path) -> Result<Option<Self>, VamvsError> {
        let path = OutputFolder::new(folder).fusion();
        if path.is_file() { read_json(&path).map(Some) } else { Ok(None) }
    }

    /// What became of all pixels.
    #[must_use]
    pub fn total(&self) -> ViewReport {
        self.views.iter().map(|view| view.pixels).sum()
    }

    /// What became of a view's pixels, if it took part.
    #[must_use]
    pub fn pixels(&self, view: &str) -> Option<&ViewReport> {
        self.views.iter().find(|fused| fused.view == view).map(|fused| &fused.pixels)
    }

    /// The cloud's file.
    #[must_use]
    pub fn cloud(&self, folder: &Path) -> PathBuf {
        folder.join(&self.cloud)
    }
}
