//! Reads the marker structure of JPEG files: their size, without decoding, and whether they are complete; decodes them
//! at a reduced size.
//!
//! The check of completeness is needed because the decoder fills the missing part of a truncated file with grey and reports
//! no error; a depth map of such an image would be wrong. Damage within the pixels of a complete file cannot
//! be detected: the format has no checksum, and almost any bits decode to some image.

use std::io::{self, BufRead, Cursor, Read, Seek, SeekFrom};

use ::image::{DynamicImage, GrayImage, RgbImage};
use jpeg_decoder::{Decoder, PixelFormat};
use vamvs_core::Size;

const START_OF_IMAGE: u8 = 0xD8;
const END_OF_IMAGE: u8 = 0xD9;
const START_OF_SCAN: u8 = 0xDA;

/// The image's size in its frame header; `None` if there is no such header before the pixels.
pub(crate) fn size(file: &mut (impl BufRead + Seek)) -> io::Result<Option<Size>> {
    if next_marker(file)? != START_OF_IMAGE {
        return Ok(None);
    }
    loop {
        match next_marker(file)? {
            START_OF_SCAN | END_OF_IMAGE => return Ok(None),
            // Start of frame: C0 to CF, except DHT (C4), JPG (C8) and DAC (CC).
            0xC0..=0xC3 | 0xC5..=0xC7 | 0xC9..=0xCB | 0xCD..=0xCF => {
                let [_, _, _, h1, h0, w1, w0] = read(file)?;
                let side = |high, low| usize::from(u16::from_be_bytes([high, low]));
                return Ok(Some(Size::new(side(w1, w0), side(h1, h0))));
            }
            _ => skip_segment(file)?,
        }
    }
}

/// Whether the file's segments and scans are followed by an end-of-image marker.
pub(crate) fn is_complete(bytes: &[u8]) -> bool {
    let mut file = Cursor::new(bytes);
    let walk = |file: &mut Cursor<&[u8]>| -> io::Result<()> {
        next_marker(file)?;
        while next_marker(file)? != END_OF_IMAGE {
            skip_segment(file)?;
        }
        Ok(())
    };
    walk(&mut file).is_ok()
}

/// The image at 1/2, 1/4 or 1/8 of its size `stored`: the smallest that divides both sides and keeps at least
/// `longer_side` pixels of the longer one. `None` if there is none, or if the file is not 8-bit grey or colour of
/// three channels, which is for the decoder of whole images.
///
/// Each 8 × 8 block of the format is transformed to fewer pixels, from its low frequencies alone.
pub(crate) fn reduced(bytes: &[u8], stored: Size, longer_side: usize) -> Option<DynamicImage> {
    let fits = |reduction: &usize| {
        let divides = stored.width.is_multiple_of(*reduction) && stored.height.is_multiple_of(*reduction);
        divides && stored.longer_side() / reduction >= longer_side
    };
    let reduction = [8, 4, 2].into_iter().find(fits)?;
    let [width, height] = [stored.width, stored.height].map(|side| (side / reduction) as u32);
    let mut decoder = Decoder::new(bytes);
    let found = decoder.scale(width as u16, height as u16).ok()?;
    if found != (width as u16, height as u16) {
        return None;
    }
    let pixels = decoder.decode().ok()?;
    match decoder.info()?.pixel_format {
        PixelFormat::L8 => GrayImage::from_raw(width, height, pixels).map(DynamicImage::from),
        PixelFormat::RGB24 => RgbImage::from_raw(width, height, pixels).map(DynamicImage::from),
        PixelFormat::L16 | PixelFormat::CMYK32 => None,
    }
}

/// The next marker, skipping entropy-coded data with its stuffed zeros and restart markers.
fn next_marker(file: &mut impl BufRead) -> io::Result<u8> {
    loop {
        file.skip_until(0xFF)?;
        let mut marker = 0xFF;
        while marker == 0xFF {
            [marker] = read(file)?;
        }
        if !matches!(marker, 0x00 | 0x01 | 0xD0..=0xD7) {
            return Ok(marker);
        }
    }
}

/// Skips the segment of a marker, whose length comes first and includes itself.
fn skip_segment(file: &mut (impl Read + Seek)) -> io::Result<()> {
    let length = u16::from_be_bytes(read(file)?);
    file.seek(SeekFrom::Current(i64::from(length.saturating_sub(2)))).map(drop)
}

fn read<const N: usize>(file: &mut impl Read) -> io::Result<[u8; N]> {
    let mut bytes = [0; N];
    file.read_exact(&mut bytes)?;
    Ok(bytes)
}
