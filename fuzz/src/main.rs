//! Runs libFuzzer on one reader of `vamvs_io`, the one that the variable `VAMVS_READER` names.
//!
//! The reader reads a folder of valid files, one of which is replaced by the input. The input's first byte
//! selects the file, the rest is its content. If `VAMVS_SEEDS` names a folder, the valid files are first written
//! there as initial inputs.

#![no_main]
#![allow(clippy::unwrap_used, reason = "a fuzzer that cannot begin has failed")]

#[path = "../../crates/vamvs-io/tests/malformed/fixture.rs"]
mod fixture;
#[path = "../../crates/vamvs-io/tests/mat_file/mod.rs"]
mod mat_file;
#[macro_use]
#[path = "../../crates/vamvs-io/tests/malformed/readers.rs"]
#[allow(dead_code, reason = "memory is limited by libFuzzer")]
mod readers;

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use libfuzzer_sys::fuzz_target;
use vamvs_io::{
    atomic, bundler, colmap, depth, dtu, masks, mvsnet, nerfstudio, nvm, openmvs, pfm, ply, tnt, visibility,
};

/// The reader that is fuzzed, and its files.
struct Target {
    folder: tempfile::TempDir,
    /// The files that inputs replace, with their valid content.
    files: Vec<(PathBuf, Vec<u8>)>,
    read: fn(&Path) -> bool,
}

static TARGET: LazyLock<Target> = LazyLock::new(Target::chosen);

impl Target {
    fn chosen() -> Self {
        let name = std::env::var("VAMVS_READER").expect("VAMVS_READER names a reader");
        let (fixture, read) = reader(&name).unwrap_or_else(|| panic!("there is no reader {name:?}"));
        let folder = tempfile::tempdir().unwrap();
        let files = fixture(folder.path()).damaged.into_iter().map(|file| folder.path().join(file));
        let files: Vec<_> = files.map(|path| (path.clone(), fs::read(path).unwrap())).collect();
        if let Some(seeds) = std::env::var_os("VAMVS_SEEDS") {
            for (number, (_, content)) in (0_u8..).zip(&files) {
                let seed = [&[number][..], content].concat();
                write(&Path::new(&seeds).join(format!("whole-{number}")), &seed);
            }
        }
        Self { folder, files, read }
    }

    fn read(&self, input: &[u8]) {
        let Some((number, content)) = input.split_first() else { return };
        let (path, whole) = &self.files[usize::from(*number) % self.files.len()];
        fs::File::options()
            .write(true)
            .truncate(true)
            .open(path)
            .and_then(|mut file| std::io::Write::write_all(&mut file, content))
            .unwrap();
        (self.read)(self.folder.path());
        if self.files.len() > 1 {
            write(path, whole);
        }
    }
}

fn write(path: &Path, bytes: &[u8]) {
    atomic::write(path, |out| out.write_all(bytes)).unwrap();
}

type Fixture = fn(&Path) -> fixture::Fixture;

macro_rules! table {
    ($($name:ident: $fixture:expr, $base:expr, $read:expr;)*) => {
        /// The function that writes the valid files of the reader `name`, and the one that reads them.
        fn reader(name: &str) -> Option<(Fixture, fn(&Path) -> bool)> {
            match name {
                $(stringify!($name) => Some(($fixture, $read)),)*
                _ => None,
            }
        }
    };
}

with_readers!(table);

fuzz_target!(
    init: {
        LazyLock::force(&TARGET);
    },
    |input: &[u8]| TARGET.read(input)
);
