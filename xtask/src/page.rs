//! A page of HTML that needs no other file: pictures are in it.

use std::fmt::Display;
use std::path::Path;

use anyhow::{Context, Result};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use vamvs_io::atomic;

use crate::colour::Scale;

/// How it all looks.
const STYLE: &str = include_str!("page.css");

/// A page in the making.
pub struct Page {
    title: String,
    body: String,
}

/// A colour scale explained.
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
    pub fn strip(&mut self, picture: &Path, captions: &[&str], below: &str) -> Result<()> {
        let captions = captions.iter().map(|caption| format!("<span>{}</span>", escaped(caption)));
        let captions = captions.collect::<String>();
        let uri = data_uri(picture)?;
        self.add(format_args!(
            "<figure><div class=\"captions\">{captions}</div><img src=\"{uri}\" alt=\"\"><figcaption>{}</figcaption></figure>",
            escaped(below)
        ));
        Ok(())
    }

    /// Pictures in columns, each with its caption.
    pub fn gallery(&mut self, pictures: &[(&Path, &str)]) -> Result<()> {
        self.body.push_str("<div class=\"gallery\">");
        for (picture, caption) in pictures {
            let (uri, caption) = (data_uri(picture)?, escaped(caption));
            self.add(format_args!(
                "<figure><img src=\"{uri}\" alt=\"\"><figcaption>{caption}</figcaption></figure>"
            ));
        }
        self.body.push_str("</div>\n");
        Ok(())
    }

    /// Text as it stands.
    pub fn verbatim(&mut self, text: &str) {
        self.add(format_args!("<pre>{}</pre>", escaped(text)));
    }

    /// Writes the page.
    pub fn save(&self, path: &Path) -> Result<()> {
        let Self { title, body } = self;
        Ok(atomic::write(path, |out| {
            write!(
                out,
                "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\
                 <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\
                 <title>{title}</title><style>{STYLE}</style></head>\n<body>\n{body}</body></html>\n"
            )
        })?)
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

fn data_uri(png: &Path) -> Result<String> {
    let bytes = std::fs::read(png).with_context(|| format!("{} could not be read", png.display()))?;
    Ok(format!("data:image/png;base64,{}", STANDARD.encode(bytes)))
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pages_hold_their_pictures_and_no_foreign_markup() {
        let folder = tempfile::tempdir().unwrap();
        let (png, html) = (folder.path().join("a.png"), folder.path().join("a.html"));
        atomic::write(&png, |out| out.write_all(b"abc")).unwrap();
        let mut page = Page::new("A & B", "<script>");
        page.gallery(&[(&png, "1 < 2")]).unwrap();
        page.save(&html).unwrap();
        let text = std::fs::read_to_string(html).unwrap();
        assert!(text.contains("src=\"data:image/png;base64,YWJj\""));
        assert!(text.contains("A &amp; B") && text.contains("1 &lt; 2") && !text.contains("<script"));
        assert!(page.gallery(&[(&folder.path().join("missing.png"), "")]).is_err());
    }
}
