//! Tests every reader on damaged files. It must return a result or an error, must not panic, and must not take
//! more memory than the file's size justifies.
//!
//! The default suite tries each reader on [`CASES`] damaged files. A campaign tries each for ten minutes, or for as
//! many as the variable `VAMVS_MANGLE_MINUTES` says:
//! `cargo test --release -p vamvs-io --test malformed -- --ignored`, optionally with the name of a reader.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

mod damage;
mod fixture;
#[path = "../mat_file/mod.rs"]
mod mat_file;
mod memory;
#[macro_use]
mod readers;

use std::fs;
use std::path::Path;
use std::time::{Duration, Instant};

use proptest::test_runner::{Config, TestCaseError, TestRunner};
use vamvs_io::{
    IoError, Loaded, atomic, bundler, colmap, depth, dtu, image, masks, mvsnet, nerfstudio, nvm, openmvs,
    pfm, ply, tnt, visibility,
};

use fixture::Fixture;
use readers::{BASE, COMPRESSED, PICTURE};

/// Number of damaged files for each reader in the default suite.
const CASES: u32 = 200;

/// Bytes of memory that a reader may take for each byte of its files. JSON needs a large factor: an empty list
/// takes two bytes in the file and about a hundred in memory.
const FACTOR: usize = 256;

/// A reader: its name, the function that writes its files into a folder, the function that reads them and
/// returns whether that succeeded, and the bytes of memory that it may take besides [`FACTOR`] times the files'
/// size.
struct Reader {
    name: &'static str,
    fixture: fn(&Path) -> Fixture,
    read: fn(&Path) -> bool,
    base: usize,
}

impl Reader {
    /// Tries the reader on `cases` damaged files.
    fn damage(&self, cases: u32) {
        let folder = tempfile::tempdir().unwrap();
        let files = (self.fixture)(folder.path());
        assert!((self.read)(folder.path()), "{}: the undamaged files are read", self.name);
        let config = Config { cases, failure_persistence: None, ..Config::default() };
        let outcome = TestRunner::new(config).run(&damage::some_damage(), |(which, damages)| {
            let name = which.get(&files.damaged);
            let path = folder.path().join(name);
            let good = fs::read(&path).unwrap();
            let bad = damages.iter().fold(good.clone(), |bytes, damage| damage.apply(bytes));
            write(&path, &bad);
            let taken = memory::peak_of(|| (self.read)(folder.path()));
            write(&path, &good);
            let limit = self.base + FACTOR * (files.bytes + bad.len());
            if taken > limit {
                let problem = format!("{name} of {} bytes took {taken} bytes of memory", bad.len());
                return Err(TestCaseError::fail(problem));
            }
            Ok(())
        });
        outcome.unwrap_or_else(|error| panic!("{}: {error}", self.name));
    }

    /// Tries damaged files for the duration of a campaign.
    fn campaign(&self) {
        let minutes = std::env::var("VAMVS_MANGLE_MINUTES").map_or(10.0, |text| text.parse().unwrap());
        let end = Instant::now() + Duration::from_secs_f64(60.0 * minutes);
        let mut rounds = 0_u32;
        while Instant::now() < end {
            self.damage(2000);
            rounds += 1;
        }
        println!("{}: {} damaged files", self.name, 2000 * rounds);
    }
}

fn write(path: &Path, bytes: &[u8]) {
    atomic::write(path, |out| out.write_all(bytes)).unwrap();
}

/// Defines a test for each reader and, in the module `campaign`, a campaign of the same name.
macro_rules! readers {
    ($($name:ident: $fixture:expr, $base:expr, $read:expr;)*) => {
        $(
            #[test]
            fn $name() {
                let read: fn(&Path) -> bool = $read;
                Reader { name: stringify!($name), fixture: $fixture, read, base: $base }.damage(CASES);
            }
        )*

        mod campaign {
            use super::*;
            $(
                #[test]
                #[ignore = "takes ten minutes"]
                fn $name() {
                    let read: fn(&Path) -> bool = $read;
                    Reader { name: stringify!($name), fixture: $fixture, read, base: $base }.campaign();
                }
            )*
        }
    };
}

with_readers!(readers);

/// In every layout, a photograph without a readable header does not prevent the scene from being read. The error is
/// reported when the photograph is decoded.
#[test]
fn a_photograph_without_header_does_not_end_a_scene() {
    type Write = fn(&Path) -> Fixture;
    type Read = fn(&Path) -> Result<Loaded, IoError>;
    let layouts: [(Write, Read); 6] = [
        (fixture::colmap_text, |f| colmap::read_scene(f, Some(f))),
        (fixture::mvsnet, |f| mvsnet::read_scene(f, f, None, &mvsnet::Options::default())),
        (fixture::nerfstudio, |f| nerfstudio::read_scene(f, None)),
        (fixture::bundler, |f| bundler::read_scene(&f.join("bundle.out"), None)),
        (fixture::nvm, |f| nvm::read_scene(&f.join("scene.nvm"), None)),
        (fixture::openmvs, |f| openmvs::read_scene(&f.join("scene.mvs"), None)),
    ];
    for (fixture, read) in layouts {
        let folder = tempfile::tempdir().unwrap();
        fixture(folder.path());
        let whole = read(folder.path()).unwrap();
        for damaged in [&b""[..], b"no image"] {
            write(&folder.path().join("b.png"), damaged);
            let loaded = read(folder.path()).unwrap();
            assert_eq!(loaded.scene, whole.scene);
            let [a, b] = &loaded.scene.views[..] else { panic!("two views") };
            assert!(image::load_for_camera(&loaded.images.join(&a.name), &a.camera, &|_| 1, None).is_ok());
            let error =
                image::load_for_camera(&loaded.images.join(&b.name), &b.camera, &|_| 1, None).unwrap_err();
            assert!(error.to_string().contains("b.png"), "{error}");
        }
    }
}
