//! Images: formats, orientation, cameras of another size, damaged and hostile files.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::io::Cursor;
use std::path::{Path, PathBuf};

use ::image::codecs::jpeg::JpegEncoder;
use ::image::codecs::png::PngEncoder;
use ::image::{DynamicImage, ExtendedColorType, GenericImageView, ImageEncoder, ImageFormat};
use proptest::prelude::*;
use tempfile::tempdir;
use vamvs_core::{Camera, Grid, Intrinsics, Lens, Rgb, Size};
use vamvs_io::{IoError, atomic, image};

fn save(folder: &Path, name: &str, bytes: &[u8]) -> PathBuf {
    let path = folder.join(name);
    atomic::write(&path, |out| out.write_all(bytes)).unwrap();
    path
}

fn encode(image: impl Into<DynamicImage>, format: ImageFormat) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    image.into().write_to(&mut bytes, format).unwrap();
    bytes.into_inner()
}

/// A textured photograph as JPEG.
fn jpeg() -> Vec<u8> {
    let value =
        |x: u32, y: u32| ::image::Rgb([(x * 37 % 251) as u8, (y * 59 % 241) as u8, (x * y % 239) as u8]);
    encode(::image::RgbImage::from_fn(64, 48, value), ImageFormat::Jpeg)
}

/// EXIF data with an orientation and nothing else.
fn exif(orientation: u8) -> Vec<u8> {
    let entry = [0x12, 0x01, 3, 0, 1, 0, 0, 0, orientation, 0, 0, 0];
    [&b"II*\0\x08\0\0\0\x01\0"[..], &entry, &[0; 4]].concat()
}

/// A 4×2 PNG in which all pixels differ, with an EXIF orientation.
fn oriented_png(orientation: u8) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = PngEncoder::new(&mut bytes);
    encoder.set_exif_metadata(exif(orientation)).unwrap();
    encoder.write_image(stored_pixels().data().as_flattened(), 4, 2, ExtendedColorType::Rgb8).unwrap();
    bytes
}

fn stored_pixels() -> Grid<Rgb> {
    Grid::from_fn(Size::new(4, 2), |x, y| [x as u8, y as u8, 7])
}

/// No image is reduced.
fn every_pixel(_: Size) -> usize {
    usize::MAX
}

fn camera(width: usize, height: usize) -> Camera {
    let intrinsics = Intrinsics { fx: 10.0, fy: 12.0, cx: 3.0, cy: 1.0 };
    Camera { size: Size::new(width, height), intrinsics, lens: Lens::Fisheye { k: [0.1; 4] } }
}

/// An 8×8 CMYK JPEG of one colour, as Adobe's programs write it. A channel is 255 (no ink) if `true`, else 0.
fn cmyk_jpeg(channels: [bool; 4]) -> Vec<u8> {
    // Huffman codes: a DC difference of 127 is category 7 (code 10), one of −128 category 8 (code 0). Code 0 ends
    // a block.
    let bits: String = channels.iter().map(|&on| if on { "1011111110" } else { "0011111110" }).collect();
    let bits = format!("{bits:1<40}");
    let scan =
        bits.as_bytes().chunks(8).map(|byte| byte.iter().fold(0u8, |value, bit| value << 1 | (bit - b'0')));
    let mut bytes = b"\xFF\xD8\xFF\xEE\0\x0EAdobe\0\x64\0\0\0\0\0\xFF\xDB\0\x43\0".to_vec();
    bytes.extend([8; 64]);
    bytes.extend(b"\xFF\xC0\0\x14\x08\0\x08\0\x08\x04\x01\x11\0\x02\x11\0\x03\x11\0\x04\x11\0");
    bytes.extend(b"\xFF\xC4\0\x15\0\x01\x01\0\0\0\0\0\0\0\0\0\0\0\0\0\0\x08\x07");
    bytes.extend(b"\xFF\xC4\0\x14\x10\x01\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0");
    bytes.extend(b"\xFF\xDA\0\x0E\x04\x01\0\x02\0\x03\0\x04\0\0\x3F\0");
    bytes.extend(scan);
    bytes.extend(b"\xFF\xD9");
    bytes
}

#[test]
fn grey_and_16_bit_pixels_become_8_bit_rgb() {
    let folder = tempdir().unwrap();
    let grey = ::image::GrayImage::from_raw(2, 1, vec![3, 200]).unwrap();
    let deep =
        ::image::ImageBuffer::<::image::Rgb<u16>, _>::from_raw(1, 1, vec![257u16 * 9, 65535, 0]).unwrap();
    for (format, extension) in [
        (ImageFormat::Png, "png"),
        (ImageFormat::Tiff, "tif"),
        (ImageFormat::Bmp, "bmp"),
        (ImageFormat::WebP, "webp"),
        (ImageFormat::Jpeg, "jpg"),
    ] {
        let path = save(folder.path(), &format!("grey é.{extension}"), &encode(grey.clone(), format));
        let rgb = image::load_rgb(&path).unwrap();
        let differences =
            rgb.data().as_flattened().iter().zip([3, 3, 3, 200, 200, 200]).map(|(a, b)| a.abs_diff(b));
        assert!(differences.max() <= Some(if extension == "jpg" { 3 } else { 0 }), "{extension}: {rgb:?}");
        assert_eq!(image::stored_size(&path).unwrap(), Size::new(2, 1), "{extension}");
    }
    for format in [ImageFormat::Png, ImageFormat::Tiff] {
        let path = save(folder.path(), "deep", &encode(deep.clone(), format));
        assert_eq!(image::load_rgb(&path).unwrap().data(), [[9, 255, 0]]);
    }
}

#[test]
fn alpha_becomes_a_mask_unless_all_is_opaque() {
    let folder = tempdir().unwrap();
    let rgba = |alpha: [u8; 2]| {
        let pixels = vec![10, 20, 30, alpha[0], 40, 50, 60, alpha[1]];
        encode(::image::RgbaImage::from_raw(2, 1, pixels).unwrap(), ImageFormat::Png)
    };
    let loaded = image::load(&save(folder.path(), "a.png", &rgba([127, 128]))).unwrap();
    assert_eq!(loaded.rgb.data(), [[10, 20, 30], [40, 50, 60]]);
    assert_eq!(loaded.alpha_mask.unwrap().data(), [false, true]);
    assert_eq!(image::load(&save(folder.path(), "b.png", &rgba([255, 255]))).unwrap().alpha_mask, None);
}

#[test]
fn orientation_is_applied_only_where_the_camera_asks_for_it() {
    let folder = tempdir().unwrap();
    let stored = stored_pixels();
    // Rotated clockwise: the left column is at the top, the first row at the right.
    let rotated = Grid::from_fn(Size::new(2, 4), |x, y| stored[(y, 1 - x)]);
    let path = save(folder.path(), "6.png", &oriented_png(6));
    for (camera_size, expected, turned, resized) in [
        ((4, 2), &stored, false, false),
        ((2, 4), &rotated, true, false),
        ((8, 4), &stored, false, true),
        ((4, 8), &rotated, true, true),
    ] {
        let given = camera(camera_size.0, camera_size.1);
        let (loaded, camera) = image::load_for_camera(&path, &given, &every_pixel, None).unwrap();
        assert_eq!(&loaded.rgb, expected, "{camera_size:?}");
        assert_eq!((loaded.exif_rotated, loaded.note.is_some()), (turned, resized), "{camera_size:?}");
        assert_eq!(camera, given.resized(expected.size()));
    }
    let upside_down = save(folder.path(), "3.png", &oriented_png(3));
    let (loaded, _) = image::load_for_camera(&upside_down, &camera(4, 2), &every_pixel, None).unwrap();
    assert_eq!((loaded.rgb, loaded.exif_rotated), (stored, false));
}

#[test]
fn a_jpeg_with_orientation_is_turned_and_its_stored_size_is_not() {
    let folder = tempdir().unwrap();
    let mut bytes = Vec::new();
    let mut encoder = JpegEncoder::new(&mut bytes);
    encoder.set_exif_metadata(exif(8)).unwrap();
    encoder.write_image(stored_pixels().data().as_flattened(), 4, 2, ExtendedColorType::Rgb8).unwrap();
    let path = save(folder.path(), "8.jpg", &bytes);
    assert_eq!(image::stored_size(&path).unwrap(), Size::new(4, 2));
    assert!(image::load_for_camera(&path, &camera(2, 4), &every_pixel, None).unwrap().0.exif_rotated);
}

/// Of a photograph of slow waves, the mean of each block of pixels; the camera stays that of the whole photograph.
#[test]
fn a_large_jpeg_is_decoded_at_a_reduced_size() {
    let folder = tempdir().unwrap();
    let wave = |x: u32, y: u32, length: f64| {
        (128.0 + 50.0 * (f64::from(x) / length).sin() + 50.0 * (f64::from(y) / length).cos()) as u8
    };
    let photograph = ::image::RgbImage::from_fn(192, 96, |x, y| {
        ::image::Rgb([wave(x, y, 20.0), wave(y, x, 31.0), wave(x + y, y, 25.0)])
    });
    let mut bytes = Vec::new();
    JpegEncoder::new_with_quality(&mut bytes, 95).encode_image(&photograph).unwrap();
    let path = save(folder.path(), "large.jpg", &bytes);
    for (longer_side, reduction) in [(193, 1), (192, 1), (97, 1), (96, 2), (49, 2), (48, 4), (24, 8), (1, 8)]
    {
        let (loaded, camera) =
            image::load_for_camera(&path, &camera(192, 96), &|_| longer_side, None).unwrap();
        assert_eq!((camera.size, loaded.note), (Size::new(192, 96), None));
        assert_eq!(loaded.rgb.size(), Size::new(192 / reduction, 96 / reduction), "{longer_side}");
        for y in 0..96 / reduction {
            for x in 0..192 / reduction {
                let block = photograph.view(
                    (x * reduction) as u32,
                    (y * reduction) as u32,
                    reduction as u32,
                    reduction as u32,
                );
                for channel in 0..3 {
                    let sum: f64 = block.pixels().map(|(_, _, pixel)| f64::from(pixel[channel])).sum();
                    let mean = sum / (reduction * reduction) as f64;
                    let found = f64::from(loaded.rgb[(x, y)][channel]);
                    assert!((found - mean).abs() < 6.0, "1/{reduction} at {x}, {y}: {found} for {mean}");
                }
            }
        }
    }
}

/// Where no reduction divides both sides, or the decoder of reduced sizes does not know the pixels' format.
#[test]
fn a_jpeg_that_cannot_be_reduced_is_decoded_whole() {
    let folder = tempdir().unwrap();
    let odd = encode(::image::RgbImage::new(63, 48), ImageFormat::Jpeg);
    for (bytes, width, height) in [(odd, 63, 48), (cmyk_jpeg([true; 4]), 8, 8)] {
        let path = save(folder.path(), "photo.jpg", &bytes);
        let (loaded, _) = image::load_for_camera(&path, &camera(width, height), &|_| 1, None).unwrap();
        assert_eq!(loaded.rgb.size(), Size::new(width, height));
    }
}

#[test]
fn an_image_of_another_shape_than_its_camera_is_refused_with_both_sizes() {
    let folder = tempdir().unwrap();
    let path = save(folder.path(), "a.png", &oriented_png(1));
    for (width, height) in [(2, 4), (4, 3), (100, 52)] {
        let error = image::load_for_camera(&path, &camera(width, height), &every_pixel, None)
            .unwrap_err()
            .to_string();
        assert!(error.contains("4×2") && error.contains(&format!("{width}×{height}")), "{error}");
    }
    assert!(image::load_for_camera(&path, &camera(201, 100), &every_pixel, None).is_ok());
}

#[test]
fn cmyk_jpegs_become_rgb() {
    let folder = tempdir().unwrap();
    for (channels, expected) in [
        ([true; 4], [255, 255, 255]),
        ([true, false, false, true], [255, 0, 0]),
        ([false, true, true, true], [0, 255, 255]),
        ([true, true, true, false], [0, 0, 0]),
    ] {
        let rgb = image::load_rgb(&save(folder.path(), "cmyk.jpg", &cmyk_jpeg(channels))).unwrap();
        assert_eq!(rgb.size(), Size::new(8, 8));
        let close = |pixel: &Rgb| pixel.iter().zip(expected).all(|(a, b)| a.abs_diff(b) <= 2);
        assert!(rgb.data().iter().all(close), "{channels:?}: {:?}", rgb[(0, 0)]);
    }
}

#[test]
fn jpegs_cut_anywhere_are_refused() {
    let folder = tempdir().unwrap();
    let whole = jpeg();
    // A thumbnail in the EXIF data has an end-of-image marker of its own.
    let thumbnail = [&whole[..2], b"\xFF\xE1\0\x08Ex\xFF\xD9if", &whole[2..]].concat();
    for (whole, step) in [(whole, 7), (thumbnail, 11)] {
        assert!(image::load(&save(folder.path(), "photo.jpg", &whole)).is_ok());
        for length in (0..whole.len()).step_by(step) {
            let path = save(folder.path(), "photo.jpg", &whole[..length]);
            let error = image::load(&path).unwrap_err().to_string();
            assert!(error.contains("photo.jpg"), "{error}");
        }
    }
}

#[test]
fn other_formats_cut_in_the_middle_are_refused() {
    let folder = tempdir().unwrap();
    let noise =
        ::image::RgbImage::from_fn(32, 32, |x, y| ::image::Rgb([(x * 97 + y * 31) as u8, x as u8, y as u8]));
    for format in [ImageFormat::Png, ImageFormat::Tiff, ImageFormat::Bmp, ImageFormat::WebP] {
        let whole = encode(noise.clone(), format);
        for part in [0, 10, whole.len() / 2, whole.len() * 9 / 10] {
            let path = save(folder.path(), "photo", &whole[..part]);
            assert!(image::load(&path).is_err(), "{format:?} cut to {part} of {}", whole.len());
        }
    }
}

#[test]
fn announced_sizes_of_gigabytes_are_refused() {
    let folder = tempdir().unwrap();
    let mut bmp = encode(::image::RgbImage::new(2, 2), ImageFormat::Bmp);
    bmp[18..26].copy_from_slice(&[0x40, 0x9C, 0, 0, 0x40, 0x9C, 0, 0]);
    let mut jpeg = jpeg();
    let frame = jpeg.windows(2).position(|marker| marker == [0xFF, 0xC0]).unwrap();
    jpeg[frame + 5..frame + 9].fill(0xFF);
    for (name, bytes) in [("huge.bmp", bmp), ("huge.jpg", jpeg)] {
        let path = save(folder.path(), name, &bytes);
        assert!(image::stored_size(&path).unwrap().area() > 1 << 30);
        let error = image::load(&path).unwrap_err();
        assert!(matches!(&error, IoError::Image { source: ::image::ImageError::Limits(_), .. }), "{error:?}");
    }
}

#[test]
fn images_without_pixels_are_refused() {
    let folder = tempdir().unwrap();
    let mut bytes = jpeg();
    let frame = bytes.windows(2).position(|marker| marker == [0xFF, 0xC0]).unwrap();
    bytes[frame + 5..frame + 7].fill(0);
    let path = save(folder.path(), "flat.jpg", &bytes);
    assert!(image::stored_size(&path).unwrap_err().to_string().contains("found 64×0"));
    assert!(image::load(&path).is_err());
}

#[test]
fn what_is_no_image_is_named() {
    let folder = tempdir().unwrap();
    let path = save(folder.path(), "notes ü.jpg", b"these are notes");
    assert!(image::load(&path).unwrap_err().to_string().contains("notes ü.jpg"));
    assert!(image::stored_size(&path).is_err());
    let error = image::load(&folder.path().join("absent.png")).unwrap_err();
    assert!(matches!(error, IoError::System { action: "open", .. }));
}

#[test]
fn reducing_keeps_positions_and_does_not_alias() {
    let ramp = Grid::from_fn(Size::new(24, 8), |x, _| [10 * x as u8; 3]);
    let half = image::resize(&ramp, Size::new(12, 4));
    // The centre of pixel j is at x = 2j + 1 in the large image, where the ramp's value is 10 (2j + 1/2).
    assert!((2..10).all(|j| half[(j, 2)][0].abs_diff((20 * j + 5) as u8) <= 1), "{:?}", half.row(2));
    let checkerboard = Grid::from_fn(Size::new(64, 64), |x, y| [if (x + y) % 2 == 0 { 0 } else { 254 }; 3]);
    let small = image::resize(&checkerboard, Size::new(24, 24));
    let mut middle = (4..20).flat_map(|y| (4..20).map(move |x| (x, y)));
    assert!(middle.all(|at| small[at][0].abs_diff(127) < 12), "{:?}", small.row(12));
    assert_eq!(image::resize(&ramp, ramp.size()), ramp);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(128))]

    #[test]
    fn mangled_images_never_panic(
        format in prop::sample::select(vec![ImageFormat::Png, ImageFormat::Tiff, ImageFormat::Bmp, ImageFormat::WebP, ImageFormat::Jpeg]),
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
    ) {
        let folder = tempdir().unwrap();
        let mut bytes = match format {
            ImageFormat::Jpeg => jpeg(),
            _ => encode(::image::RgbImage::from_fn(9, 7, |x, y| ::image::Rgb([x as u8, y as u8, 3])), format),
        };
        for (place, value) in changes {
            let place = place.index(bytes.len());
            bytes[place] = value;
        }
        let path = save(folder.path(), "mangled", &bytes);
        let _ = image::load(&path);
        let _ = image::stored_size(&path);
    }

    #[test]
    fn saved_pictures_are_loaded_as_they_were(pixels in prop::collection::vec(any::<[u8; 3]>(), 12)) {
        let folder = tempdir().unwrap();
        let path = folder.path().join("a b.png");
        let picture = Grid::from_vec(Size::new(4, 3), pixels);
        image::save_png_rgb(&path, &picture).unwrap();
        prop_assert_eq!(image::load_rgb(&path).unwrap(), picture);
    }
}

/// A thermal camera's 16 bits, a few hundred of which are used.
#[test]
fn values_of_16_bits_are_stretched() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("thermal.png");
    image::save_png_gray16(&path, &Grid::from_vec(Size::new(4, 1), vec![7000, 7300, 7425, 7550])).unwrap();
    let stretch = Some(image::Stretch { low: 7300, high: 7550 });
    let (loaded, _) = image::load_for_camera(&path, &camera(4, 1), &every_pixel, stretch).unwrap();
    assert_eq!(loaded.rgb.data(), [0, 0, 128, 255].map(|grey| [grey; 3]));
    let mut values = image::values_of_16_bits(&path, 1000).unwrap().unwrap();
    values.dedup();
    assert_eq!(values, [7000, 7300, 7425, 7550]);
    let eight = folder.path().join("eight.png");
    image::save_png_gray8(&eight, &Grid::from_vec(Size::new(2, 1), vec![3, 200])).unwrap();
    assert_eq!(image::values_of_16_bits(&eight, 1000).unwrap(), None);
    let (loaded, _) = image::load_for_camera(&eight, &camera(2, 1), &every_pixel, stretch).unwrap();
    assert_eq!(loaded.rgb.data(), [[3; 3], [200; 3]], "8 bits stay");
}

/// A TIFF of one band of four floats.
fn float_tiff() -> Vec<u8> {
    let entries: [(u16, u16, u32); 10] = [
        (256, 3, 2),  // width
        (257, 3, 2),  // height
        (258, 3, 32), // bits of a sample
        (259, 3, 1),  // not compressed
        (262, 3, 1),  // black is zero
        (273, 4, 8 + 2 + 10 * 12 + 4),
        (277, 3, 1),  // samples of a pixel
        (278, 3, 2),  // rows of a strip
        (279, 4, 16), // bytes of the strip
        (339, 3, 3),  // floating point
    ];
    let mut bytes = b"II*\0\x08\0\0\0\x0a\0".to_vec();
    for (tag, kind, value) in entries {
        bytes.extend([tag.to_le_bytes(), kind.to_le_bytes()].as_flattened());
        bytes.extend([1_u32.to_le_bytes(), value.to_le_bytes()].as_flattened());
    }
    bytes.extend([0; 4]);
    bytes.extend([0.5_f32, 1.5, 2.5, 3.5].map(f32::to_le_bytes).as_flattened());
    bytes
}

#[test]
fn formats_that_are_not_read_are_named_with_what_to_do() {
    let folder = tempdir().unwrap();
    let heic = b"\0\0\0\x18ftypheic\0\0\0\0mif1heic".to_vec();
    let raw = b"II*\0\x10\0\0\0CR\x02\0\0\0\0\0".to_vec();
    for (bytes, expected) in [
        (heic, "found HEIC"),
        (b"\0\0\0\x1cftypavif\0\0\0\0".to_vec(), "found AVIF"),
        (b"\0\0\0\x18ftypmp42\0\0\0\0".to_vec(), "found a video"),
        (b"\xff\x0a\x01\x02\x03\x04".to_vec(), "found JPEG XL"),
        (raw, "found a raw photograph (CR2)"),
        (float_tiff(), "a TIFF of other values than 8 or 16 bits"),
    ] {
        let path = save(folder.path(), "a.jpg", &bytes);
        let error = image::load(&path).unwrap_err().to_string();
        assert!(error.contains(expected) && error.contains("convert the photographs"), "{error}");
    }
    let path = save(folder.path(), "a.jpg", b"\0\0\0\x18ftypheic\0\0\0\0mif1heic");
    assert!(image::stored_size(&path).unwrap_err().to_string().contains("found HEIC"));
    let path = save(folder.path(), "a.jpg", b"no photograph");
    assert!(!image::load(&path).unwrap_err().to_string().contains("convert"));
}
