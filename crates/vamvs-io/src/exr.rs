//! OpenEXR depth maps: one channel of 32-bit floats, losslessly compressed. It is named `Z`, as renderers name
//! depth. Of files of others, the channel `Z`, `depth.V` or `Y` is read, or the only one, or `R`.

use std::io::{self, Cursor};
use std::path::Path;

use exr::prelude::{
    AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer, LayerAttributes, ReadChannels, ReadLayers,
    WritableImage,
};
use vamvs_core::{Grid, Size};

use crate::{IoError, Place, atomic};

/// The names of channels that may hold depth, the likeliest first.
const DEPTH_CHANNELS: [&str; 5] = ["Z", "depth.V", "depth.Z", "Y", "R"];

/// Reads the channel of a file that holds depth; its numbers are not changed.
///
/// # Errors
/// If the file cannot be read, or has several channels of other names.
pub(crate) fn read(path: &Path) -> Result<Grid<f32>, IoError> {
    let file = std::fs::File::open(path).map_err(IoError::system("open", path))?;
    let reader = exr::prelude::read().no_deep_data().largest_resolution_level().all_channels();
    let image = reader.first_valid_layer().all_attributes().non_parallel();
    let image = image.from_buffered(io::BufReader::new(file)).map_err(|error| {
        IoError::malformed(path, Place::Whole, format!("expected an OpenEXR image: {error}"))
    })?;
    let layer = image.layer_data;
    let channels = &layer.channel_data.list;
    let name = |channel: &AnyChannel<FlatSamples>| channel.name.to_string();
    let of_depth = DEPTH_CHANNELS
        .iter()
        .find_map(|wanted| channels.iter().find(|channel| name(channel).eq_ignore_ascii_case(wanted)));
    let Some(channel) = of_depth.or_else(|| channels.first().filter(|_| channels.len() == 1)) else {
        let found: Vec<String> = channels.iter().map(name).collect();
        let problem = format!("expected a channel of depth, called Z, found {}", found.join(", "));
        return Err(IoError::unsupported(path, Place::Whole, problem));
    };
    let size = Size::new(layer.size.0, layer.size.1);
    Ok(Grid::from_vec(size, channel.sample_data.values_as_f32().collect()))
}

/// Writes a map as the channel `Z`.
///
/// # Errors
/// If the map cannot be encoded or the file cannot be written; then nothing has changed.
pub(crate) fn write(path: &Path, grid: &Grid<f32>) -> Result<(), IoError> {
    let samples = FlatSamples::F32(grid.data().to_vec());
    let channels = AnyChannels::sort([AnyChannel::new("Z", samples)].into_iter().collect());
    let size = (grid.width(), grid.height());
    let layer = Layer::new(size, LayerAttributes::default(), Encoding::SMALL_LOSSLESS, channels);
    let mut bytes = Cursor::new(Vec::new());
    let encoded = Image::from_layer(layer).write().non_parallel().to_buffered(&mut bytes);
    atomic::write(path, |out| {
        encoded.map_err(io::Error::other)?;
        out.write_all(bytes.get_ref())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn written(channels: &[&str], grid: &Grid<f32>) -> (tempfile::TempDir, std::path::PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("depth.exr");
        let channel = |name: &&str| AnyChannel::new(*name, FlatSamples::F32(grid.data().to_vec()));
        let channels = AnyChannels::sort(channels.iter().map(channel).collect());
        let size = (grid.width(), grid.height());
        let layer = Layer::new(size, LayerAttributes::default(), Encoding::SMALL_LOSSLESS, channels);
        let mut bytes = Cursor::new(Vec::new());
        Image::from_layer(layer).write().non_parallel().to_buffered(&mut bytes).unwrap();
        atomic::write(&path, |out| out.write_all(bytes.get_ref())).unwrap();
        (folder, path)
    }

    #[test]
    fn a_map_comes_back_from_the_channel_z_or_the_only_one() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("depth.exr");
        let grid = Grid::from_fn(Size::new(37, 19), |x, y| (x as f32).sqrt() + 0.1 * y as f32);
        write(&path, &grid).unwrap();
        assert_eq!(read(&path).unwrap(), grid);
        for channels in [&["B", "G", "R"][..], &["depth"], &["A", "Z"]] {
            let (_folder, path) = written(channels, &grid);
            assert_eq!(read(&path).unwrap(), grid, "{channels:?}");
        }
    }

    #[test]
    fn what_holds_no_depth_is_told() {
        let grid = Grid::filled(Size::new(4, 4), 1.0);
        let (_folder, path) = written(&["N.X", "N.Y"], &grid);
        let error = read(&path).unwrap_err().to_string();
        assert!(error.contains("called Z, found N.X, N.Y"), "{error}");
        let whole = std::fs::read(&path).unwrap();
        atomic::write(&path, |out| out.write_all(&whole[..whole.len() / 2])).unwrap();
        assert!(read(&path).unwrap_err().to_string().contains("OpenEXR"));
    }
}
