//! A view on the page: photograph, depth, confidence, and what was chosen for it.

use vamvs_core::{Grid, Rgb};
use vamvs_core::{Planes, Size, Spacing};
use vamvs_fusion::{FusionView, MapSource, ViewReport};
use vamvs_io::image;
use vamvs_picture::map::{spread, valid};
use vamvs_picture::number::length;
use vamvs_picture::{Page, Picture, Scale, panel};

use super::shares;
use crate::output::Record;
use crate::{Maps, VamvsError};

/// Width of a picture, pixels.
const WIDTH: usize = 320;

/// A view ready to be shown.
pub(super) struct ViewPanel {
    name: String,
    size: Size,
    photograph: Picture,
    depth: Picture,
    /// The depths at the ends of the scale.
    depths: (f32, f32),
    confidence: Picture,
    /// The predicted visibility in each source view, if it was written, with the view's name.
    visibility: Vec<(Picture, String)>,
    record: Option<Record>,
}

impl ViewPanel {
    pub fn load(maps: &Maps, view: usize) -> Result<Self, VamvsError> {
        let FusionView { map, colour, .. } = maps.load(view)?;
        let depth = valid(&map.depth);
        let depths = spread(&depth);
        let confidence = map.confidence.map(|&confidence| Some(confidence));
        let record = maps.record(view);
        let visibility = maps.visibility(view, record.as_ref())?;
        let shown = |(seen, source): (Grid<f32>, String)| {
            let picture = Picture::small(&Scale::Confidence.paint(&seen.map(|&seen| Some(seen)), 0.0, 1.0));
            (picture, format!("visibility in {source}"))
        };
        Ok(Self {
            name: maps.names()[view].clone(),
            size: map.depth.size(),
            photograph: small(&colour),
            depth: small(&Scale::Turbo.paint(&depth, depths.0, depths.1)),
            depths,
            confidence: small(&Scale::Confidence.paint(&confidence, 0.0, 1.0)),
            visibility: visibility.into_iter().map(shown).collect(),
            record,
        })
    }

    pub fn name(&self) -> &str {
        &self.name
    }

    /// Adds the panel, with what became of its pixels if it was fused.
    pub fn add_to(&self, page: &mut Page, pixels: Option<&ViewReport>) {
        page.panel(&self.name, |page| {
            let (near, far) = (length(self.depths.0.into()), length(self.depths.1.into()));
            let depth = format!("depth {near} to {far}");
            page.trio(
                &self.name,
                &[(&self.photograph, "photograph"), (&self.depth, &depth), (&self.confidence, "confidence")],
            );
            if !self.visibility.is_empty() {
                let shown: Vec<(&Picture, &str)> =
                    self.visibility.iter().map(|(picture, caption)| (picture, caption.as_str())).collect();
                page.trio(&self.name, &shown);
            }
            if let Some(pixels) = pixels {
                let shares = shares(pixels);
                page.bar(&shares);
                page.key(&shares.into_iter().filter(|share| share.share > 0.0).collect::<Vec<_>>());
            }
            page.details("how it was made", |page| page.paragraph(&self.made()));
        });
    }

    /// What was chosen for the view, from its record.
    fn made(&self) -> String {
        let mut made = vec![format!("{} pixels", self.size)];
        if let Some(Record { planes, sources, .. }) = &self.record {
            made.extend(planes.as_ref().map(planes_in_words));
            if !sources.is_empty() {
                made.push(format!("compared with {}", sources.join(", ")));
            }
        }
        made.join("; ")
    }
}

fn planes_in_words(planes: &Planes) -> String {
    let spacing = match planes.spacing {
        Spacing::Depth => "depth",
        Spacing::InverseDepth => "inverse depth",
    };
    let (near, far) = (length(planes.range.near), length(planes.range.far));
    format!("{} planes from {near} to {far}, equal steps of {spacing}", planes.count)
}

/// A picture of at most [`WIDTH`] pixels; smaller ones keep their size.
fn small(pixels: &Grid<Rgb>) -> Picture {
    if pixels.width() <= WIDTH {
        return Picture::small(pixels);
    }
    Picture::small(&image::resize(pixels, panel::of_width(pixels.size(), WIDTH)))
}
