//! Cameras that cannot be used among good ones: their views are left out.

use std::error::Error;

use crate::IoError;

/// What could be read, in its place, and what is wrong with the rest.
///
/// # Errors
/// The first error, if half of the cameras cannot be read: then something is wrong with all of them.
pub(crate) fn leave_out<T>(
    cameras: Vec<Result<T, IoError>>,
) -> Result<(Vec<Option<T>>, Vec<String>), IoError> {
    let broken = cameras.iter().filter(|camera| camera.is_err()).count();
    let are_all = 2 * broken >= cameras.len();
    let mut reasons = Vec::with_capacity(broken);
    let mut kept = Vec::with_capacity(cameras.len());
    for camera in cameras {
        match camera {
            Ok(camera) => kept.push(Some(camera)),
            Err(error) if are_all => return Err(error),
            Err(error) => {
                reasons.push(match error.source() {
                    Some(source) => format!("{error}: {source}"),
                    None => error.to_string(),
                });
                kept.push(None);
            }
        }
    }
    Ok((kept, reasons))
}

/// A warning that cameras of `all` were left out, if some were.
pub(crate) fn warning(broken: &[String], all: usize) -> Option<String> {
    let first = broken.first()?;
    let count = broken.len();
    Some(format!(
        "{count} of the scene's {all} cameras cannot be used, and their views are left out ({first})"
    ))
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::Place;

    fn read(good: &[bool]) -> Result<(Vec<Option<usize>>, Vec<String>), IoError> {
        let error = |number| IoError::malformed(Path::new("cams.txt"), Place::Line(number), "no pose");
        leave_out(
            good.iter().enumerate().map(|(at, good)| if *good { Ok(at) } else { Err(error(at)) }).collect(),
        )
    }

    #[test]
    fn few_broken_cameras_are_a_warning_and_half_of_them_an_error() {
        assert_eq!(read(&[true, true]).unwrap(), (vec![Some(0), Some(1)], Vec::new()));
        let (kept, broken) = read(&[true, false, true]).unwrap();
        assert_eq!(kept, [Some(0), None, Some(2)]);
        let warning = warning(&broken, 3).unwrap();
        assert!(
            warning.contains("1 of the scene's 3 cameras") && warning.contains("line 1: no pose"),
            "{warning}"
        );
        assert!(read(&[true, false]).unwrap_err().to_string().contains("line 1"));
    }
}
