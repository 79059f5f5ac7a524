//! `pair.txt`: the number of views, then for each reference view its number and a line `n id score id score …` of
//! its `n` source views, best first.

use std::collections::{HashMap, HashSet};
use std::path::Path;

use vamvs_core::Source;

use crate::text::WordReader;
use crate::{IoError, atomic};

/// Reads the source views of each view, as indices into `ids`, in the file's order (best first).
///
/// `ids` are the views' numbers in the file. A view that the file does not list has no source views.
///
/// # Errors
/// If the file cannot be read, has a number that is not in `ids`, lists a reference view twice, lists a source
/// view twice or as its own source, or has fewer or more entries than it announces.
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
/// `ids` are the views' numbers in the file. `sources` has for each view its source views as indices into
/// `ids`, best first.
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
    /// Reads a view's number and returns its index in `ids`.
    fn view(&mut self, what: &str) -> Result<usize, IoError> {
        let id: u32 = self.words.number(what)?;
        self.index_of.get(&id).copied().ok_or_else(|| {
            self.words
                .malformed(format!("{what}: expected the number of a view that has a camera, found {id}"))
        })
    }

    /// Reads the source views of the view with index `reference`.
    fn sources(&mut self, reference: usize) -> Result<Vec<Source>, IoError> {
        let count: usize = self.words.number("number of source views")?;
        let (mut sources, mut taken) = (Vec::new(), HashSet::from([reference]));
        for _ in 0..count {
            let view = self.view("source view")?;
            let score: f64 = self.words.number("score")?;
            if !(score.is_finite() && score >= 0.0) {
                return Err(self
                    .words
                    .malformed(format!("score: expected a number of at least 0, found {score}")));
            }
            if !taken.insert(view) {
                return Err(self.words.malformed("source view: expected other views, each once"));
            }
            sources.push(Source { view, score });
        }
        Ok(sources)
    }
}
