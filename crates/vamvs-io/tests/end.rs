//! Tests `atomic::end`, in a process of its own because it ends all writing.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::io::Write;
use std::sync::mpsc;
use std::time::Duration;

use vamvs_io::atomic::{self, AtomicFile};

#[test]
fn after_the_end_nothing_unfinished_is_there_and_nothing_is_begun_or_completed() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    atomic::write(&path("whole"), |out| out.write_all(b"whole")).unwrap();
    let mut dropped = AtomicFile::create(&path("dropped")).unwrap();
    dropped.write_all(b"half").unwrap();
    drop(dropped);
    let [completed, abandoned] =
        ["completed", "abandoned"].map(|name| AtomicFile::create(&path(name)).unwrap());
    atomic::end();
    let names =
        || -> Vec<_> { std::fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().file_name()).collect() };
    assert_eq!(names(), ["whole"]);
    // Threads that write now block for ever, so they are not joined; only the files are checked.
    let (done, waited) = mpsc::channel();
    let (begun, late) = (done.clone(), path("late"));
    std::thread::spawn(move || begun.send(atomic::write(&late, |out| out.write_all(b"late")).is_ok()));
    std::thread::spawn(move || done.send(completed.commit().is_ok()));
    assert!(waited.recv_timeout(Duration::from_millis(200)).is_err());
    assert_eq!(names(), ["whole"]);
    std::mem::forget(abandoned);
}
