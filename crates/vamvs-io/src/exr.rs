//! OpenEXR depth maps: one channel of 32-bit floats, losslessly compressed. It is named `Z`, as renderers name
//! depth.

use std::io::{self, Cursor};
use std::path::Path;

use exr::prelude::{
    AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer, LayerAttributes, WritableImage,
};
use vamvs_core::Grid;

use crate::{IoError, atomic};

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
    use exr::prelude::{ReadChannels, ReadLayers, read};
    use vamvs_core::Size;

    use super::*;

    #[test]
    fn a_map_comes_back_as_the_channel_z() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("depth.exr");
        let grid = Grid::from_fn(Size::new(37, 19), |x, y| (x as f32).sqrt() + 0.1 * y as f32);
        write(&path, &grid).unwrap();
        let image = read().no_deep_data().largest_resolution_level().all_channels().first_valid_layer();
        let image = image.all_attributes().from_file(&path).unwrap();
        let layer = image.layer_data;
        assert_eq!((layer.size.0, layer.size.1), (37, 19));
        let [channel] = &layer.channel_data.list[..] else { panic!("one channel") };
        assert_eq!(channel.name.to_string(), "Z");
        assert_eq!(channel.sample_data.values_as_f32().collect::<Vec<_>>(), grid.data());
    }
}
