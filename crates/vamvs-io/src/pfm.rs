//! Portable float maps (PFM): `Pf` (one channel) or `PF` (three), `W H`, a scale, then float32 rows from
//! bottom to top. The sign of the scale gives the byte order (negative: little-endian); its magnitude is ignored.

use std::fs::File;
use std::io::{self, BufReader, Read};
use std::path::Path;

use vamvs_core::{Grid, Size, depth_map};

use crate::{IoError, Place, atomic};

/// Longest accepted word of a header, in bytes.
const LONGEST_WORD: usize = 64;

/// Reads a `Pf` map; its values are not changed.
///
/// # Errors
/// If the file cannot be read, has three channels, or its length is not what its header announces.
pub fn read(path: &Path) -> Result<Grid<f32>, IoError> {
    let grid = read_channels::<1>(path)?;
    Ok(Grid::from_vec(grid.size(), grid.into_vec().into_flattened()))
}

/// Reads a three-channel `PF` map; its values are not changed.
///
/// # Errors
/// If the file cannot be read, has one channel, or its length is not what its header announces.
pub fn read_rgb(path: &Path) -> Result<Grid<[f32; 3]>, IoError> {
    read_channels::<3>(path)
}

/// The size of a map of `channels` (1 or 3), from its header; its pixels are not read.
///
/// # Errors
/// As [`read`]: a map whose size can be told can be read.
pub fn stored_size(path: &Path, channels: usize) -> Result<Size, IoError> {
    Ok(Header::open(path)?.read(channels)?.0)
}

/// Reads a depth map; values that are not finite and positive become 0.
///
/// # Errors
/// As [`read`].
pub fn read_depth(path: &Path) -> Result<Grid<f32>, IoError> {
    let mut grid = read(path)?;
    for depth in grid.data_mut() {
        *depth = if depth_map::is_valid(*depth) { *depth } else { 0.0 };
    }
    Ok(grid)
}

/// Writes a `Pf` map, little-endian.
///
/// # Errors
/// If the file cannot be written; then nothing has changed.
pub fn write(path: &Path, grid: &Grid<f32>) -> Result<(), IoError> {
    write_rows(path, "Pf", grid.size(), |y| grid.row(y))
}

/// Writes a three-channel `PF` map, little-endian.
///
/// # Errors
/// If the file cannot be written; then nothing has changed.
pub fn write_rgb(path: &Path, grid: &Grid<[f32; 3]>) -> Result<(), IoError> {
    write_rows(path, "PF", grid.size(), |y| grid.row(y).as_flattened())
}

fn write_rows<'a>(
    path: &Path,
    kind: &str,
    size: Size,
    row: impl Fn(usize) -> &'a [f32],
) -> Result<(), IoError> {
    atomic::write(path, |out| {
        write!(out, "{kind}\n{} {}\n-1.0\n", size.width, size.height)?;
        for y in (0..size.height).rev() {
            let bytes: Vec<u8> = row(y).iter().flat_map(|value| value.to_le_bytes()).collect();
            out.write_all(&bytes)?;
        }
        Ok(())
    })
}

fn read_channels<const C: usize>(path: &Path) -> Result<Grid<[f32; C]>, IoError> {
    let mut header = Header::open(path)?;
    let (size, little_endian) = header.read(C)?;
    let mut grid = Grid::filled(size, [0.0; C]);
    read_rows(&mut header.file, &mut grid, little_endian).map_err(IoError::system("read", path))?;
    Ok(grid)
}

fn read_rows<const C: usize>(
    file: &mut impl Read,
    grid: &mut Grid<[f32; C]>,
    little_endian: bool,
) -> io::Result<()> {
    let mut bytes = vec![0; 4 * C * grid.width()];
    for y in (0..grid.height()).rev() {
        file.read_exact(&mut bytes)?;
        let values = grid.row_mut(y).as_flattened_mut();
        for (to, &from) in values.iter_mut().zip(bytes.as_chunks::<4>().0) {
            let bits = u32::from_le_bytes(from);
            *to = f32::from_bits(if little_endian { bits } else { bits.swap_bytes() });
        }
    }
    Ok(())
}

/// A reader of a map's header: words separated by whitespace or comments, and one whitespace byte before the
/// pixels.
struct Header<'a> {
    path: &'a Path,
    file: BufReader<File>,
    /// Bytes of the file that have not been read yet.
    remaining: u64,
    length: u64,
}

impl<'a> Header<'a> {
    fn open(path: &'a Path) -> Result<Self, IoError> {
        let file = File::open(path).map_err(IoError::system("open", path))?;
        let length = file.metadata().map_err(IoError::system("inspect", path))?.len();
        Ok(Self { path, file: BufReader::with_capacity(1 << 16, file), remaining: length, length })
    }

    /// The size of a map of `channels`, and whether it is little-endian. Fails unless exactly the bytes of its
    /// pixels follow.
    fn read(&mut self, channels: usize) -> Result<(Size, bool), IoError> {
        let expected = if channels == 1 { "Pf" } else { "PF" };
        let kind = self.word("kind")?;
        if kind != expected {
            return Err(
                self.malformed(format!("expected {expected:?} ({channels} channels), found {kind:?}"))
            );
        }
        let size = Size::new(self.side("width")?, self.side("height")?);
        let scale = self.scale()?;
        self.expect_pixels(size, channels)?;
        Ok((size, scale < 0.0))
    }

    fn side(&mut self, what: &str) -> Result<usize, IoError> {
        let word = self.word(what)?;
        word.parse().ok().filter(|&side| side > 0).ok_or_else(|| {
            self.malformed(format!("{what}: expected a positive whole number, found {word:?}"))
        })
    }

    fn scale(&mut self) -> Result<f64, IoError> {
        let word = self.word("scale")?;
        let valid = |scale: &f64| scale.is_finite() && *scale != 0.0;
        word.parse()
            .ok()
            .filter(valid)
            .ok_or_else(|| self.malformed(format!("scale: expected a number other than 0, found {word:?}")))
    }

    /// Checks that the pixels are all that remains. If the header ends with carriage return and line feed, the
    /// line feed is skipped first.
    fn expect_pixels(&mut self, size: Size, channels: usize) -> Result<(), IoError> {
        let bytes = |size: Size| size.width.checked_mul(size.height)?.checked_mul(4 * channels);
        let expected = bytes(size).map(|bytes| bytes as u64);
        let surplus = expected.and_then(|expected| self.remaining.checked_sub(expected));
        if surplus == Some(0) || surplus == Some(1) && self.byte()? == Some(b'\n') {
            return Ok(());
        }
        let expected = expected.map_or("more than any file holds".to_owned(), |bytes| bytes.to_string());
        let found = self.remaining;
        let (width, height) = (size.width, size.height);
        Err(self.malformed(format!("pixels: {width}×{height} take {expected} bytes, found {found}")))
    }

    /// The next word. The whitespace byte that ends it is read too.
    fn word(&mut self, what: &str) -> Result<String, IoError> {
        let mut word = String::new();
        while let Some(byte) = self.byte()? {
            match byte {
                b'#' if word.is_empty() => self.skip_comment()?,
                _ if !byte.is_ascii_whitespace() => word.push(char::from(byte)),
                _ if !word.is_empty() => return Ok(word),
                _ => {}
            }
            if word.len() > LONGEST_WORD {
                return Err(
                    self.malformed(format!("{what}: expected a word of a PFM header, found other data"))
                );
            }
        }
        Err(self.malformed(format!("{what}: expected a word of the header, found the end of the file")))
    }

    fn skip_comment(&mut self) -> Result<(), IoError> {
        while self.byte()?.is_some_and(|byte| byte != b'\n') {}
        Ok(())
    }

    fn byte(&mut self) -> Result<Option<u8>, IoError> {
        let next = self.file.by_ref().bytes().next().transpose();
        let byte = next.map_err(IoError::system("read", self.path))?;
        self.remaining = self.remaining.saturating_sub(u64::from(byte.is_some()));
        Ok(byte)
    }

    fn malformed(&self, problem: String) -> IoError {
        IoError::malformed(self.path, Place::Byte(self.length - self.remaining), problem)
    }
}
