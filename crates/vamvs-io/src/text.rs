//! Readers of text files by lines or by words. They know the line number, for error messages.

use std::fmt::Display;
use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::str::FromStr;

use crate::{IoError, Place};

/// What some editors put before a text in UTF-8.
pub(crate) const BYTE_ORDER_MARK: &[u8] = "\u{feff}".as_bytes();

/// A buffered text file.
pub(crate) struct TextReader {
    path: PathBuf,
    inner: BufReader<File>,
    line: String,
    number: usize,
}

impl TextReader {
    pub(crate) fn open(path: &Path) -> Result<Self, IoError> {
        let file = File::open(path).map_err(IoError::system("open", path))?;
        let mut inner = BufReader::new(file);
        if inner.fill_buf().map_err(IoError::system("read", path))?.starts_with(BYTE_ORDER_MARK) {
            inner.consume(BYTE_ORDER_MARK.len());
        }
        Ok(Self { path: path.to_owned(), inner, line: String::new(), number: 0 })
    }

    /// The next line without its line end; `None` at the end of the file.
    pub(crate) fn next_line(&mut self) -> Result<Option<Line<'_>>, IoError> {
        let mut bytes = std::mem::take(&mut self.line).into_bytes();
        bytes.clear();
        let read = self.inner.read_until(b'\n', &mut bytes).map_err(IoError::system("read", &self.path))?;
        self.number += usize::from(read > 0);
        self.line = String::from_utf8(bytes).map_err(|error| {
            let found = shortened(String::from_utf8_lossy(error.as_bytes()).trim_end());
            let problem = format!("expected text in UTF-8, found {found:?}; save the file as UTF-8");
            IoError::malformed(&self.path, Place::Line(self.number), problem)
        })?;
        let text = self.line.trim_end_matches(['\n', '\r']);
        Ok((read > 0).then_some(Line { path: &self.path, number: self.number, text }))
    }

    /// The next line that is neither empty nor a `#` comment; `None` at the end of the file.
    pub(crate) fn next_entry(&mut self) -> Result<Option<Line<'_>>, IoError> {
        loop {
            let Some(line) = self.next_line()? else { return Ok(None) };
            if !is_comment(line.text) {
                break;
            }
        }
        let text = self.line.trim_end_matches(['\n', '\r']);
        Ok(Some(Line { path: &self.path, number: self.number, text }))
    }
}

fn is_comment(text: &str) -> bool {
    let text = text.trim_start();
    text.is_empty() || text.starts_with('#')
}

/// A line of a text file.
#[derive(Clone, Copy)]
pub(crate) struct Line<'a> {
    path: &'a Path,
    number: usize,
    /// The line without its line end.
    pub(crate) text: &'a str,
}

impl<'a> Line<'a> {
    /// Whether it is empty or a `#` comment.
    pub(crate) fn is_comment(self) -> bool {
        is_comment(self.text)
    }

    pub(crate) fn words(self) -> Words<'a> {
        Words { line: self, rest: self.text }
    }

    /// An error about this line.
    pub(crate) fn malformed(&self, problem: impl Display) -> IoError {
        IoError::malformed(self.path, Place::Line(self.number), problem)
    }

    /// An error about this line, whose content is valid but not supported.
    pub(crate) fn unsupported(&self, problem: impl Display) -> IoError {
        IoError::unsupported(self.path, Place::Line(self.number), problem)
    }
}

/// An iterator over the remaining words of a line.
pub(crate) struct Words<'a> {
    pub(crate) line: Line<'a>,
    rest: &'a str,
}

impl<'a> Words<'a> {
    /// The next word, which holds `what`.
    pub(crate) fn word(&mut self, what: &str) -> Result<&'a str, IoError> {
        self.next().ok_or_else(|| self.line.malformed(format!("{what}: missing, the line ends here")))
    }

    /// The next word as a number, which holds `what`.
    pub(crate) fn number<T: FromStr>(&mut self, what: &str) -> Result<T, IoError> {
        parse(self.word(what)?, what).map_err(|problem| self.line.malformed(problem))
    }

    /// The next words as numbers, which hold `what`.
    pub(crate) fn numbers<const N: usize>(&mut self, what: &str) -> Result<[f64; N], IoError> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = self.number(what)?;
        }
        Ok(values)
    }

    /// The rest of the line, without surrounding whitespace.
    pub(crate) fn rest(&self) -> &'a str {
        self.rest.trim()
    }
}

impl<'a> Iterator for Words<'a> {
    type Item = &'a str;

    fn next(&mut self) -> Option<&'a str> {
        let text = self.rest.trim_start();
        let end = text.find(char::is_whitespace).unwrap_or(text.len());
        self.rest = &text[end..];
        (end > 0).then(|| &text[..end])
    }
}

/// A text file read word by word, across line ends.
pub(crate) struct WordReader {
    reader: TextReader,
    consumed: usize,
}

impl WordReader {
    pub(crate) fn open(path: &Path) -> Result<Self, IoError> {
        Ok(Self::new(TextReader::open(path)?))
    }

    /// Reads the words after the line that `reader` read last.
    pub(crate) fn new(reader: TextReader) -> Self {
        let consumed = reader.line.len();
        Self { reader, consumed }
    }

    /// The next word; `None` at the end of the file.
    pub(crate) fn next_word(&mut self) -> Result<Option<&str>, IoError> {
        loop {
            let rest = &self.reader.line[self.consumed..];
            let start = self.reader.line.len() - rest.trim_start().len();
            if start < self.reader.line.len() {
                let text = &self.reader.line[start..];
                self.consumed = start + text.find(char::is_whitespace).unwrap_or(text.len());
                return Ok(Some(&self.reader.line[start..self.consumed]));
            }
            self.consumed = 0;
            if self.reader.next_line()?.is_none() {
                return Ok(None);
            }
        }
    }

    /// The next word as a number, which holds `what`; `None` at the end of the file.
    pub(crate) fn optional_number<T: FromStr>(&mut self, what: &str) -> Result<Option<T>, IoError> {
        let parsed = self.next_word()?.map(|word| parse(word, what)).transpose();
        parsed.map_err(|problem| self.malformed(problem))
    }

    /// The next word as a number, which holds `what`.
    pub(crate) fn number<T: FromStr>(&mut self, what: &str) -> Result<T, IoError> {
        let number = self.optional_number(what)?;
        number.ok_or_else(|| self.malformed(format!("{what}: missing, the file ends here")))
    }

    /// The next words as numbers, which hold `what`.
    pub(crate) fn numbers<const N: usize>(&mut self, what: &str) -> Result<[f64; N], IoError> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = self.number(what)?;
        }
        Ok(values)
    }

    /// Reads the next word, which must be `expected`.
    pub(crate) fn keyword(&mut self, expected: &str) -> Result<(), IoError> {
        let found = self.next_word()?.map(str::to_owned);
        if found.as_deref() == Some(expected) {
            return Ok(());
        }
        let found = found.map_or_else(|| "the end of the file".to_owned(), |found| format!("{found:?}"));
        Err(self.malformed(format!("expected {expected:?}, found {found}")))
    }

    /// An error about the line of the last word that was read.
    pub(crate) fn malformed(&self, problem: impl Display) -> IoError {
        let place = if self.reader.number == 0 { Place::Whole } else { Place::Line(self.reader.number) };
        IoError::malformed(&self.reader.path, place, problem)
    }
}

fn parse<T: FromStr>(word: &str, what: &str) -> Result<T, String> {
    let is_float = T::from_str("0.5").is_ok();
    let kind = if is_float { "a number" } else { "a whole number" };
    // No number, as programs built by Microsoft's compilers write it.
    let word = if is_float
        && ["nan(ind)", "nan(snan)", "1.#IND", "1.#QNAN"].contains(&word.trim_start_matches('-'))
    {
        "nan"
    } else {
        word
    };
    word.parse().map_err(|_| format!("{what}: expected {kind}, found {:?}", shortened(word)))
}

/// The first characters of a word, for messages.
fn shortened(word: &str) -> String {
    word.chars().take(40).collect()
}
