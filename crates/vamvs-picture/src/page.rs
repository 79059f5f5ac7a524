//! A page of HTML that needs no other file: pictures are in it.

use std::fmt::Display;
use std::path::Path;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use vamvs_core::{Grid, Rgb};
use vamvs_io::{IoError, atomic, image};

use crate::cloud_view::CloudView;
use crate::floor::floor_plan;
use crate::number::percent;
use crate::template::{escaped, fill};
use crate::{Chart, Scale};

/// The style sheet.
const STYLE: &str = include_str!("page.css");

/// What stands around a page's body.
const FRAME: &str = include_str!("page.html");

/// Quality of JPEGs, of 100.
const JPEG_QUALITY: u8 = 82;

/// A page that is being built.
#[derive(Clone, Debug)]
pub struct Page {
    title: String,
    body: String,
}

/// A picture to be put into a page.
#[derive(Clone, Debug)]
pub struct Picture {
    kind: &'static str,
    bytes: Vec<u8>,
}

/// A part of a whole, with its colour in bars.
#[derive(Clone, Debug, PartialEq)]
pub struct Share {
    /// What it is.
    pub what: &'static str,
    /// Its colour: a variable of the style sheet.
    pub colour: &'static str,
    /// How much it is, 0 to 1.
    pub share: f64,
}

/// A colour scale explained.
#[derive(Clone, Debug)]
pub struct Legend {
    /// What the colours mean.
    pub what: &'static str,
    /// The scale.
    pub scale: Scale,
    /// The label of its left end.
    pub low: String,
    /// The label of its right end.
    pub high: String,
}

impl Legend {
    /// A legend whose ends have these words.
    #[must_use]
    pub fn new(what: &'static str, scale: Scale, low: &str, high: &str) -> Self {
        Self { what, scale, low: low.to_owned(), high: high.to_owned() }
    }
}

impl Page {
    /// A page with a title and a sentence below it.
    #[must_use]
    pub fn new(title: &str, lead: &str) -> Self {
        let (title, lead) = (escaped(title), escaped(lead));
        let body = format!("<header><h1>{title}</h1><p>{lead}</p></header>\n");
        Self { title, body }
    }

    /// Begins a section.
    pub fn heading(&mut self, text: &str) {
        self.add(format_args!("<h2>{}</h2>", escaped(text)));
    }

    /// A paragraph.
    pub fn paragraph(&mut self, text: &str) {
        self.add(format_args!("<p>{}</p>", escaped(text)));
    }

    /// The most important numbers, each with its label.
    pub fn figures(&mut self, figures: &[(String, &str)]) {
        let cards = figures.iter().map(|(number, what)| {
            format!("<div><b>{}</b><span>{}</span></div>", escaped(number), escaped(what))
        });
        self.add(format_args!("<div class=\"cards\">{}</div>", cards.collect::<String>()));
    }

    /// A table.
    pub fn table(&mut self, head: &[&str], rows: &[Vec<String>]) {
        let line = |cells: &mut dyn Iterator<Item = &str>, tag: &str| {
            let cells = cells.map(|cell| format!("<{tag}>{}</{tag}>", escaped(cell)));
            format!("<tr>{}</tr>", cells.collect::<String>())
        };
        let head = line(&mut head.iter().copied(), "th");
        let rows = rows.iter().map(|row| line(&mut row.iter().map(String::as_str), "td"));
        let rows = rows.collect::<String>();
        self.add(format_args!("<div class=\"scroll\" tabindex=\"0\"><table>{head}{rows}</table></div>"));
    }

    /// The legends of the pictures.
    pub fn legends(&mut self, legends: &[Legend]) {
        let items = legends.iter().map(Legend::html).collect::<String>();
        self.add(format_args!("<div class=\"legends\">{items}</div>"));
    }

    /// A picture of several parts side by side, each with its caption above.
    pub fn strip(&mut self, picture: &Picture, captions: &[&str], below: &str) {
        let captions = captions.iter().map(|caption| format!("<span>{}</span>", escaped(caption)));
        let captions = captions.collect::<String>();
        self.add(format_args!(
            "<figure><div class=\"captions\">{captions}</div><img src=\"{}\" alt=\"\"><figcaption>{}</figcaption></figure>",
            picture.uri(),
            escaped(below)
        ));
    }

    /// Pictures in columns, each with its caption.
    pub fn gallery(&mut self, pictures: &[(&Picture, &str)]) {
        self.body.push_str("<div class=\"gallery\">");
        for (picture, caption) in pictures {
            let (uri, caption) = (picture.uri(), escaped(caption));
            self.add(format_args!(
                "<figure><img src=\"{uri}\" alt=\"\"><figcaption>{caption}</figcaption></figure>"
            ));
        }
        self.body.push_str("</div>\n");
    }

    /// A diagram.
    pub fn chart(&mut self, chart: &Chart) {
        let (title, svg) = (escaped(chart.title), chart.svg());
        self.add(format_args!("<figure class=\"chart\"><figcaption>{title}</figcaption>{svg}</figure>"));
    }

    /// Begins a place for panels side by side, which [`Page::end_panels`] ends.
    pub fn begin_panels(&mut self) {
        self.body.push_str("<div class=\"panels\">\n");
    }

    /// Ends the place for panels.
    pub fn end_panels(&mut self) {
        self.body.push_str("</div>\n");
    }

    /// A panel: what `fill` adds, below a title.
    pub fn panel(&mut self, title: &str, fill: impl FnOnce(&mut Self)) {
        self.add(format_args!("<section class=\"panel\"><h3>{}</h3>", escaped(title)));
        fill(self);
        self.body.push_str("</section>\n");
    }

    /// What `fill` adds, collapsed until it is opened.
    pub fn details(&mut self, summary: &str, fill: impl FnOnce(&mut Self)) {
        self.add(format_args!("<details><summary>{}</summary>", escaped(summary)));
        fill(self);
        self.body.push_str("</details>\n");
    }

    /// Pictures in one row, each with its caption; `of` begins their alternative texts.
    pub fn trio(&mut self, of: &str, pictures: &[(&Picture, &str)]) {
        self.body.push_str("<div class=\"trio\">");
        for (picture, caption) in pictures {
            let (uri, caption, of) = (picture.uri(), escaped(caption), escaped(of));
            self.add(format_args!(
                "<figure><img src=\"{uri}\" alt=\"{of}: {caption}\" loading=\"lazy\">\
                 <figcaption>{caption}</figcaption></figure>"
            ));
        }
        self.body.push_str("</div>\n");
    }

    /// A bar of shares.
    pub fn bar(&mut self, shares: &[Share]) {
        let shown = || shares.iter().filter(|share| share.share > 0.0);
        let words = shown().map(|part| format!("{} {}", percent(part.share, 1), part.what));
        let words = escaped(&words.collect::<Vec<_>>().join(", "));
        let parts = shown().map(|Share { colour, share, .. }| {
            format!("<i style=\"width:{:.2}%;background:var({colour})\"></i>", 100.0 * share)
        });
        let parts = parts.collect::<String>();
        self.add(format_args!("<div class=\"bar\" role=\"img\" aria-label=\"{words}\">{parts}</div>"));
    }

    /// The legend of bars, each colour with its share.
    pub fn key(&mut self, shares: &[Share]) {
        let items = shares.iter().map(|Share { what, colour, share }| {
            let (what, share) = (escaped(what), percent(*share, 1));
            format!("<li><i style=\"background:var({colour})\"></i>{what}: {share}</li>")
        });
        self.add(format_args!("<ul class=\"key\">{}</ul>", items.collect::<String>()));
    }

    /// An interactive view of a cloud.
    pub fn cloud(&mut self, view: &CloudView) {
        self.body.push_str(&view.html());
    }

    /// Where the cameras stand, seen from above.
    pub fn floor_plan(&mut self, view: &CloudView) {
        self.body.push_str(&floor_plan(view));
    }

    /// Text as it stands.
    pub fn verbatim(&mut self, text: &str) {
        self.add(format_args!("<pre>{}</pre>", escaped(text)));
    }

    /// Refuses to replace a file that is not such a page.
    ///
    /// # Errors
    /// If there is such a file.
    pub fn expect_replaceable(path: &Path) -> Result<(), IoError> {
        // Pages of earlier versions have only their style sheet to tell them.
        let is_page = |begin: &[u8]| {
            let text = String::from_utf8_lossy(begin);
            text.contains(r#"name="generator" content="vamvs""#) || text.contains("--lost-0")
        };
        atomic::expect_kind(path, is_page)
    }

    /// Writes the page.
    ///
    /// # Errors
    /// If the file cannot be written, or is there and no such page; then nothing has changed.
    pub fn save(&self, path: &Path) -> Result<(), IoError> {
        Self::expect_replaceable(path)?;
        atomic::write(path, |out| out.write_all(self.html().as_bytes()))
    }

    fn html(&self) -> String {
        fill(FRAME, &[("title", &self.title), ("style", STYLE), ("body", &self.body)])
    }

    fn add(&mut self, html: impl Display) {
        self.body.push_str(&format!("{html}\n"));
    }
}

impl Legend {
    fn html(&self) -> String {
        format!(
            "<div class=\"legend\">{}<small>{}</small><i style=\"background:{}\"></i><small>{}</small></div>",
            escaped(self.what),
            escaped(&self.low),
            self.scale.css(),
            escaped(&self.high)
        )
    }
}

impl Picture {
    /// A picture of exactly these pixels, as PNG.
    #[must_use]
    pub fn new(image: &Grid<Rgb>) -> Self {
        Self { kind: "png", bytes: image::png_rgb(image) }
    }

    /// A picture of about these pixels in much less space, as JPEG.
    #[must_use]
    pub fn small(image: &Grid<Rgb>) -> Self {
        Self { kind: "jpeg", bytes: image::jpeg_rgb(image, JPEG_QUALITY) }
    }

    /// Writes the picture as a file of its kind.
    ///
    /// # Errors
    /// If the file cannot be written; then nothing has changed.
    pub fn save(&self, path: &Path) -> Result<(), IoError> {
        atomic::write(path, |out| out.write_all(&self.bytes))
    }

    fn uri(&self) -> String {
        format!("data:image/{};base64,{}", self.kind, STANDARD.encode(&self.bytes))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vamvs_core::Size;

    #[test]
    fn pages_hold_their_pictures_and_no_foreign_markup() {
        let folder = tempfile::tempdir().unwrap();
        let (png, html) = (folder.path().join("a.png"), folder.path().join("a.html"));
        let pixels = Grid::from_fn(Size::new(3, 2), |x, y| [x as u8, y as u8, 7]);
        let picture = Picture::new(&pixels);
        picture.save(&png).unwrap();
        assert_eq!(image::load_rgb(&png).unwrap(), pixels);
        let mut page = Page::new("A & B", "<script>");
        page.gallery(&[(&picture, "1 < 2")]);
        page.trio("\"><script>", &[(&Picture::small(&pixels), "'<script>'")]);
        page.panel("<script>", |page| page.details("<script>", |page| page.verbatim("<script>")));
        page.save(&html).unwrap();
        let text = std::fs::read_to_string(html).unwrap();
        let bytes = STANDARD.encode(std::fs::read(png).unwrap());
        assert!(text.contains(&format!("src=\"data:image/png;base64,{bytes}\"")));
        assert!(text.contains("A &amp; B") && text.contains("1 &lt; 2") && !text.contains("<script"));
    }
}
