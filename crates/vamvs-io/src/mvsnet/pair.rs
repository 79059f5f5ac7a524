//! `pair.txt`: the number of views, then for each reference view its number and a line `n id score id score …` of
//! its `n` source views, best first.

use std::collections::{BTreeSet, HashMap, HashSet};
use std::path::Path;

use vamvs_core::Source;

use crate::text::WordReader;
use crate::{IoError, atomic};

/// The content of a `pair.txt`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Pairs {
    /// For each view its source views by their indices, in the file's order (best first); none for a view that
    /// the file does not list.
    pub sources: Vec<Vec<Source>>,
    /// The numbers that no view has. Their entries are left out.
    pub unknown: BTreeSet<u32>,
}

/// Reads the source views of the views whose numbers in the file are `ids`. The file may name other views too, as that of
/// a whole scene does if only a part of its views is used.
///
/// # Errors
/// If the file cannot be read, names only other views, lists a reference view twice, lists a source
/// view twice or as its own source, or has fewer or more entries than it announces.
pub fn read_pairs(path: &Path, ids: &[u32]) -> Result<Pairs, IoError> {
    let index_of = ids.iter().enumerate().map(|(index, &id)| (id, index)).collect();
    let mut file = PairReader { words: WordReader::open(path)?, index_of, unknown: BTreeSet::new() };
    let mut sources = vec![Vec::new(); ids.len()];
    let mut listed = HashSet::new();
    let count: usize = file.words.number("number of views")?;
    for _ in 0..count {
        let reference: u32 = file.words.number("reference view")?;
        if !listed.insert(reference) {
            return Err(file.words.malformed(format!("view {reference} is listed twice")));
        }
        let found = file.sources(reference)?;
        if let Some(index) = file.index(reference) {
            sources[index] = found;
        }
    }
    if let Some(word) = file.words.next_word()?.map(str::to_owned) {
        return Err(file.words.malformed(format!("expected the end after {count} views, found {word:?}")));
    }
    if count > 0 && listed.is_subset(&file.unknown.iter().copied().collect()) {
        let problem = "expected numbers of views that have cameras, found only others".to_owned();
        return Err(file.words.malformed(problem));
    }
    Ok(Pairs { sources, unknown: file.unknown })
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
    unknown: BTreeSet<u32>,
}

impl PairReader {
    /// The index of the view with this number, if there is one.
    fn index(&mut self, id: u32) -> Option<usize> {
        let index = self.index_of.get(&id).copied();
        if index.is_none() {
            self.unknown.insert(id);
        }
        index
    }

    /// Reads the source views of the view with number `reference`.
    fn sources(&mut self, reference: u32) -> Result<Vec<Source>, IoError> {
        let count: usize = self.words.number("number of source views")?;
        let (mut sources, mut taken) = (Vec::new(), HashSet::from([reference]));
        for _ in 0..count {
            let id: u32 = self.words.number("source view")?;
            let score: f64 = self.words.number("score")?;
            if !(score.is_finite() && score >= 0.0) {
                return Err(self
                    .words
                    .malformed(format!("score: expected a number of at least 0, found {score}")));
            }
            if !taken.insert(id) {
                return Err(self.words.malformed("source view: expected other views, each once"));
            }
            sources.extend(self.index(id).map(|view| Source { view, score }));
        }
        Ok(sources)
    }
}
