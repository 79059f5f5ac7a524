//! Points with their views, in the notation that Bundler and NVM files share.

use vamvs_core::SparsePoint;

use crate::IoError;
use crate::text::WordReader;

/// Reads a point: position, colour, number of views, and for each view the index of its camera in the file and three
/// numbers of the keypoint. Its `views` are these indices, below `cameras`. Messages call the list of views `list`.
pub(crate) fn read_point(words: &mut WordReader, cameras: usize, list: &str) -> Result<SparsePoint, IoError> {
    let position: [f64; 3] = words.numbers("position")?;
    words.numbers::<3>("colour")?;
    let mut views = Vec::new();
    for _ in 0..words.number::<usize>("number of the point's views")? {
        let camera: usize = words.number("camera of the point's view")?;
        if camera >= cameras {
            return Err(words.malformed(format!("{list}: expected a camera below {cameras}, found {camera}")));
        }
        views.push(camera);
        words.numbers::<3>("keypoint")?;
    }
    Ok(SparsePoint { x_in_world: position.into(), views })
}
