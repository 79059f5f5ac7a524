//! Files that the parts of a fusion or a mesh exchange: a sequence of frames, each with its length and hash.

use std::fs::File;
use std::io::{self, BufReader, Read, Write};
use std::path::{Path, PathBuf};

use serde::Serialize;
use serde::de::DeserializeOwned;
use vamvs_core::Part;
use vamvs_io::atomic::AtomicFile;
use vamvs_io::{IoError, Place};

use crate::VamvsError;
use crate::output::make_folder;

/// Largest size of a frame, bytes; a larger length is damaged.
const LARGEST: u64 = 1 << 34;

/// The folder of the files.
const FOLDER: &str = "parts";

/// The files of one fusion or mesh, in the folder `parts/` beside the depth maps.
pub(crate) struct PartFiles {
    root: PathBuf,
    /// The hash of all inputs, the first frame of each file.
    pub made_of: String,
}

/// A kind of file.
#[derive(Clone, Copy)]
pub(crate) enum Kind {
    /// Counts of the first pass, one frame for all views of a part.
    Counts,
    /// The consistent pixels, one frame for each view of a part.
    Pixels,
    /// Points of the second pass, one frame for each batch.
    Points,
    /// What the volume of a mesh is laid out around, one frame for each view of a part.
    Outlines,
    /// The surface in a part of the volume, one frame for each block.
    Surfaces,
}

impl Kind {
    fn name(self) -> &'static str {
        match self {
            Self::Counts => "counts",
            Self::Pixels => "pixels",
            Self::Points => "points",
            Self::Outlines => "outlines",
            Self::Surfaces => "surfaces",
        }
    }

    /// The command that makes such files.
    fn command(self) -> &'static str {
        match self {
            Self::Counts | Self::Pixels => "vamvs fuse --step confirm",
            Self::Points => "vamvs fuse --step merge",
            Self::Outlines => "vamvs mesh --step outline",
            Self::Surfaces => "vamvs mesh --step surface",
        }
    }
}

/// The file of a part, of the depth maps in `root`.
pub(crate) fn path(root: &Path, kind: Kind, part: Part) -> PathBuf {
    root.join(FOLDER).join(format!("{}-{}", kind.name(), part.to_string().replace('/', "-of-")))
}

impl PartFiles {
    pub fn new(root: &Path, made_of: String) -> Self {
        Self { root: root.to_owned(), made_of }
    }

    pub fn folder(&self) -> PathBuf {
        self.root.join(FOLDER)
    }

    pub fn path(&self, kind: Kind, part: Part) -> PathBuf {
        path(&self.root, kind, part)
    }

    /// Begins a file, which appears under its name when it is finished.
    pub fn create(&self, kind: Kind, part: Part) -> Result<FrameWriter, VamvsError> {
        make_folder(&self.folder())?;
        let mut frames = FrameWriter { file: AtomicFile::create(&self.path(kind, part))? };
        frames.push(&self.made_of)?;
        Ok(frames)
    }

    /// Opens a file; an error if it was made of something else.
    pub fn open(&self, kind: Kind, part: Part) -> Result<FrameReader, VamvsError> {
        let path = self.path(kind, part);
        if !path.is_file() {
            let problem = format!("is missing: run `{}` for its part first", kind.command());
            return Err(VamvsError::Folder { path, problem });
        }
        let file = File::open(&path).map_err(|source| IoError::System {
            action: "read",
            path: path.clone(),
            source,
        })?;
        let mut frames = FrameReader { path, file: BufReader::new(file) };
        let made_of: Option<String> = frames.next()?;
        if made_of.as_ref() != Some(&self.made_of) {
            return Err(frames.malformed("it was made from other depth maps or settings: run its task again"));
        }
        Ok(frames)
    }

    /// Removes the files of these kinds of all parts, and their folder if no other file is in it.
    pub fn remove(&self, kinds: &[Kind], parts: usize) {
        for part in Part::all(parts) {
            kinds.iter().for_each(|&kind| _ = std::fs::remove_file(self.path(kind, part)));
        }
        std::fs::remove_dir(self.folder()).ok();
    }

    /// Whether there is a complete, undamaged file that was made of the same.
    pub fn is_there(&self, kind: Kind, part: Part) -> bool {
        self.open(kind, part).and_then(FrameReader::check).is_ok()
    }
}

pub(crate) struct FrameWriter {
    file: AtomicFile,
}

impl FrameWriter {
    pub fn push(&mut self, value: &impl Serialize) -> Result<(), VamvsError> {
        let bytes = postcard::to_stdvec(value).map_err(io::Error::other);
        let written = bytes.and_then(|bytes| self.push_bytes(&bytes));
        let failed = |source| IoError::System { action: "write", path: self.file.path().to_owned(), source };
        Ok(written.map_err(failed)?)
    }

    fn push_bytes(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.file.write_all(&(bytes.len() as u64).to_le_bytes())?;
        self.file.write_all(blake3::hash(bytes).as_bytes())?;
        self.file.write_all(bytes)
    }

    pub fn finish(self) -> Result<(), VamvsError> {
        Ok(self.file.commit()?)
    }
}

pub(crate) struct FrameReader {
    path: PathBuf,
    file: BufReader<File>,
}

impl FrameReader {
    /// The next frame; `None` at the end.
    pub fn next<T: DeserializeOwned>(&mut self) -> Result<Option<T>, VamvsError> {
        let Some(bytes) = self.next_bytes()? else { return Ok(None) };
        postcard::from_bytes(&bytes).map(Some).map_err(|error| self.malformed(&error.to_string()))
    }

    /// Reads to the end.
    fn check(mut self) -> Result<(), VamvsError> {
        while self.next_bytes()?.is_some() {}
        Ok(())
    }

    fn next_bytes(&mut self) -> Result<Option<Vec<u8>>, VamvsError> {
        let mut length = [0; 8];
        match self.file.read(&mut length[..1]) {
            Ok(0) => return Ok(None),
            Ok(_) => {}
            Err(error) => return Err(self.failed(error)),
        }
        let mut hash = [0; blake3::OUT_LEN];
        let rest = self.file.read_exact(&mut length[1..]).and_then(|()| self.file.read_exact(&mut hash));
        rest.map_err(|error| self.failed(error))?;
        let length = u64::from_le_bytes(length);
        let mut bytes = Vec::new();
        let read = (&mut self.file).take(length.min(LARGEST)).read_to_end(&mut bytes);
        read.map_err(|error| self.failed(error))?;
        if bytes.len() as u64 != length || blake3::hash(&bytes) != blake3::Hash::from_bytes(hash) {
            return Err(self.malformed("it is damaged: run its task again"));
        }
        Ok(Some(bytes))
    }

    fn failed(&self, source: io::Error) -> VamvsError {
        IoError::System { action: "read", path: self.path.clone(), source }.into()
    }

    fn malformed(&self, problem: &str) -> VamvsError {
        let (path, problem) = (self.path.clone(), problem.to_owned());
        IoError::Malformed { path, place: Place::Whole, problem }.into()
    }
}
