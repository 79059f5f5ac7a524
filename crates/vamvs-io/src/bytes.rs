//! A reader of little-endian binary files. It checks every read against the file's length and knows its
//! position, for error messages.

use std::fmt::Display;
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};

use crate::{IoError, Place};

/// Longest accepted name, in bytes, with the zero byte that ends it.
const LONGEST_NAME: u64 = 4096;

/// A buffered binary file.
pub(crate) struct ByteReader {
    path: PathBuf,
    inner: BufReader<File>,
    position: u64,
    length: u64,
}

impl ByteReader {
    pub(crate) fn open(path: &Path) -> Result<Self, IoError> {
        let file = File::open(path).map_err(IoError::system("open", path))?;
        let length = file.metadata().map_err(IoError::system("inspect", path))?.len();
        Ok(Self {
            path: path.to_owned(),
            inner: BufReader::with_capacity(1 << 16, file),
            position: 0,
            length,
        })
    }

    /// Bytes read so far.
    pub(crate) fn position(&self) -> u64 {
        self.position
    }

    /// An error about the bytes at `position`.
    pub(crate) fn malformed(&self, position: u64, problem: impl Display) -> IoError {
        IoError::malformed(&self.path, Place::Byte(position), problem)
    }

    /// An error about valid bytes at `position` that are not supported.
    pub(crate) fn unsupported(&self, position: u64, problem: impl Display) -> IoError {
        IoError::unsupported(&self.path, Place::Byte(position), problem)
    }

    /// The next `N` bytes, which hold `what`.
    pub(crate) fn take<const N: usize>(&mut self, what: &str) -> Result<[u8; N], IoError> {
        self.expect_remaining(N as u64, what)?;
        let mut bytes = [0; N];
        self.inner.read_exact(&mut bytes).map_err(IoError::system("read", &self.path))?;
        self.position += N as u64;
        Ok(bytes)
    }

    /// Skips the next `count` bytes, which hold `what`.
    pub(crate) fn skip(&mut self, count: u64, what: &str) -> Result<(), IoError> {
        self.expect_remaining(count, what)?;
        self.inner.seek_relative(count as i64).map_err(IoError::system("read", &self.path))?;
        self.position += count;
        Ok(())
    }

    pub(crate) fn u32(&mut self, what: &str) -> Result<u32, IoError> {
        self.take(what).map(u32::from_le_bytes)
    }

    pub(crate) fn u64(&mut self, what: &str) -> Result<u64, IoError> {
        self.take(what).map(u64::from_le_bytes)
    }

    pub(crate) fn i32(&mut self, what: &str) -> Result<i32, IoError> {
        self.take(what).map(i32::from_le_bytes)
    }

    pub(crate) fn f64(&mut self, what: &str) -> Result<f64, IoError> {
        self.take(what).map(f64::from_le_bytes)
    }

    pub(crate) fn f64s<const N: usize>(&mut self, what: &str) -> Result<[f64; N], IoError> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = self.f64(what)?;
        }
        Ok(values)
    }

    /// The rest of the file, which must be exactly `count` float32 numbers.
    pub(crate) fn rest_as_f32s(&mut self, count: usize, what: &str) -> Result<Vec<f32>, IoError> {
        let found = self.length - self.position;
        if (count as u64).checked_mul(4) != Some(found) {
            let problem = format!("{what}: expected {count} numbers of 4 bytes, found {found} bytes");
            return Err(self.malformed(self.position, problem));
        }
        let mut bytes = vec![0; 4 * count];
        self.inner.read_exact(&mut bytes).map_err(IoError::system("read", &self.path))?;
        self.position = self.length;
        Ok(bytes.as_chunks::<4>().0.iter().map(|&bytes| f32::from_le_bytes(bytes)).collect())
    }

    /// Reads the number (u64) of entries that follow. Fails if that many entries of at least `entry_bytes` bytes
    /// each do not fit in the rest of the file.
    pub(crate) fn count(&mut self, entry_bytes: u64, what: &str) -> Result<usize, IoError> {
        let position = self.position;
        let count = self.u64(what)?;
        let most = (self.length - self.position) / entry_bytes;
        match usize::try_from(count) {
            Ok(entries) if count <= most => Ok(entries),
            _ => Err(self.malformed(
                position,
                format!("{what}: {count} are announced, but the rest of the file holds at most {most}"),
            )),
        }
    }

    /// A name that ends with a zero byte.
    pub(crate) fn name(&mut self, what: &str) -> Result<String, IoError> {
        let position = self.position;
        let mut bytes = Vec::new();
        let limited = &mut (&mut self.inner).take(LONGEST_NAME);
        limited.read_until(0, &mut bytes).map_err(IoError::system("read", &self.path))?;
        self.position += bytes.len() as u64;
        if bytes.pop() != Some(0) {
            return Err(self.malformed(position, format!("{what}: found no zero byte at its end")));
        }
        String::from_utf8(bytes).map_err(|error| {
            let found = String::from_utf8_lossy(error.as_bytes()).into_owned();
            self.malformed(position, format!("{what}: expected UTF-8, found {found:?}"))
        })
    }

    fn expect_remaining(&self, count: u64, what: &str) -> Result<(), IoError> {
        let remaining = self.length - self.position;
        if count <= remaining {
            return Ok(());
        }
        let problem =
            format!("{what}: expected {count} more bytes, found {remaining}; the file is truncated");
        Err(self.malformed(self.position, problem))
    }
}
