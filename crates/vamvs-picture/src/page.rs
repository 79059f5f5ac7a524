//! A page of HTML that needs no other file: pictures are in it.

use std::fmt::Display;
use std::path::Path;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use vamvs_core::{Grid, Rgb};
use vamvs_io::{IoError, atomic, image};

use crate::{Chart, Scale};

/// How it all looks.
const STYLE: &str = include_str!("page.css");

/// A page in the making.
#[derive(Clone, Debug)]
pub struct Page {
    title: String,
    body: String,
}

/// A picture to be put into a page.
#[derive(Clone, Debug)]
pub struct Picture {
    png: Vec<u8>,
}

/// A colour scale explained.
#[derive(Clone, Debug)]
pub struct Legend {
    /// What the colours tell.
    pub what: &'static str,
    /// The scale.
    pub scale: Scale,
    /// What its left end is.
    pub low: String,
    /// What its right end is.
    pub high: String,
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

    /// The few numbers that matter most, each with a word about it.
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
        self.add(format_args!("<table>{head}{}</table>", rows.collect::<String>()));
    }

    /// What the colours of the pictures tell.
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

    /// Text as it stands.
    pub fn verbatim(&mut self, text: &str) {
        self.add(format_args!("<pre>{}</pre>", escaped(text)));
    }

    /// Writes the page.
    ///
    /// # Errors
    /// If the file cannot be written; then nothing has changed.
    pub fn save(&self, path: &Path) -> Result<(), IoError> {
        let Self { title, body } = self;
        atomic::write(path, |out| {
            write!(
                out,
                "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\
                 <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\
                 <title>{title}</title><style>{STYLE}</style></head>\n<body>\n{body}</body></html>\n"
            )
        })
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
    /// A picture of these pixels.
    #[must_use]
    pub fn new(image: &Grid<Rgb>) -> Self {
        Self { png: image::png_rgb(image) }
    }

    /// Writes the picture as a PNG file.
    ///
    /// # Errors
    /// If the file cannot be written; then nothing has changed.
    pub fn save(&self, path: &Path) -> Result<(), IoError> {
        atomic::write(path, |out| out.write_all(&self.png))
    }

    fn uri(&self) -> String {
        format!("data:image/png;base64,{}", STANDARD.encode(&self.png))
    }
}

/// Text that is no markup.
pub(crate) fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
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
        page.save(&html).unwrap();
        let text = std::fs::read_to_string(html).unwrap();
        let bytes = STANDARD.encode(std::fs::read(png).unwrap());
        assert!(text.contains(&format!("src=\"data:image/png;base64,{bytes}\"")));
        assert!(text.contains("A &amp; B") && text.contains("1 &lt; 2") && !text.contains("<script"));
    }
}
