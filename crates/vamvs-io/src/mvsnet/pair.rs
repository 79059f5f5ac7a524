//! `pair.txt`: the number of views, then for each its id and `n id score id score …`, best first.

use std::collections::{HashMap, HashSet};
use std::path::Path;

use vamvs_core::Source;

use crate::text::WordReader;
use crate::{IoError, atomic};

/// Reads the source views of each view, indices into `ids`, best first.
///
/// `ids` are the views' numbers. A view that the file does not list has no source views.
///
/// # Errors
/// If the file cannot be read, names a number that is not in `ids`, lists a view twice or as its own
/// source, or has fewer or more entries than it announces.
pub fn read_pairs(path: &Path, ids: &[u32]) -> Result<Vec<Vec<Source>>, IoError> {
    let index_of = ids.iter().enumerate().map(|(index, &id)| (id, index)).collect();
    let mut file = PairReader { words: WordReader::open(path)?, index_of };
    let mut sources = vec![Vec::new(); ids.len()];
    let mut listed = HashSet::new();
    let count: usize = file.words.number("number of views")?;
    for _ in 0..count {
        let reference = file.view("reference view")?;
        if !listed.insert(reference) {
            return Err(file.words.malformed(format!("view {} is listed twice", ids[reference])));
        }
        sources[reference] = file.sources(reference)?;
    }
    match file.words.next_word()?.map(str::to_owned) {
        None => Ok(sources),
        Some(word) => {
            Err(file.words.malformed(format!("expected the end after {count} views, found {word:?}")))
        }
    }
}

/// Writes the source views of each view.
///
/// `ids` are the views' numbers, `sources` holds for each view indices into `ids`, best first.
///
/// # Errors
/// If the file cannot be written; then nothing has changed.
pub fn write_pairs(path: &Path, ids: &[u32], sources: &[Vec<Source>]) -> Result<(), IoError> {
    atomic::write(path, |out| {
        writeln!(out, "{}", ids.len())?;
        for (id, sources) in ids.iter().zip(sources) {
            write!(out, "{id}\n{}", sources.len())?;
            for &Source { view, score } in sources {
                write!(out, " {} {score}", ids[view])?;
            }
            writeln!(out)?;
        }
        Ok(())
    })
}

struct PairReader {
    words: WordReader,
    index_of: HashMap<u32, usize>,
}

impl PairReader {
    /// The next word as a view's number; returns its index.
    fn view(&mut self, what: &str) -> Result<usize, IoError> {
        let id: u32 = self.words.number(what)?;
        self.index_of.get(&id).copied().ok_or_else(|| {
            self.words
                .malformed(format!("{what}: expected the number of a view that has a camera, found {id}"))
        })
    }

    /// The source views of `reference`.
    fn sources(&mut self, reference: usize) -> Result<Vec<Source>, IoError> {
        let count: usize = self.words.number("number of source views")?;
        let mut sources: Vec<Source> = Vec::new();
        for _ in 0..count {
            let view = self.view("source view")?;
            let score = self.words.number("score")?;
            if view == reference || sources.iter().any(|source| source.view == view) {
                return Err(self.words.malformed("source view: expected other views, each once"));
            }
            sources.push(Source { view, score });
        }
        Ok(sources)
    }
}
