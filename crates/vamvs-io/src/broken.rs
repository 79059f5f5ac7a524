//! Cameras that cannot be used among good ones: their views are left out.

use crate::IoError;

/// What could be read, in its place, and a warning about what could not.
///
/// # Errors
/// The first error, if half of the cameras cannot be read: then something is wrong with all of them.
pub(crate) fn leave_out<T>(
    cameras: Vec<Result<T, IoError>>,
) -> Result<(Vec<Option<T>>, Option<String>), IoError> {
    let (all, broken) = (cameras.len(), cameras.iter().filter(|camera| camera.is_err()).count());
    let mut first = None;
    let mut kept = Vec::with_capacity(all);
    for camera in cameras {
        match camera {
            Ok(camera) => kept.push(Some(camera)),
            Err(error) if 2 * broken >= all => return Err(error),
            Err(error) => {
                first.get_or_insert(error);
                kept.push(None);
            }
        }
    }
    let warning = first.map(|error| {
        format!(
            "{broken} of the scene's {all} cameras cannot be used, and their views are left out ({error})"
        )
    });
    Ok((kept, warning))
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::Place;

    fn read(good: &[bool]) -> Result<(Vec<Option<usize>>, Option<String>), IoError> {
        let error = |number| IoError::malformed(Path::new("cams.txt"), Place::Line(number), "no pose");
        leave_out(
            good.iter().enumerate().map(|(at, good)| if *good { Ok(at) } else { Err(error(at)) }).collect(),
        )
    }

    #[test]
    fn few_broken_cameras_are_a_warning_and_half_of_them_an_error() {
        assert_eq!(read(&[true, true]).unwrap(), (vec![Some(0), Some(1)], None));
        let (kept, warning) = read(&[true, false, true]).unwrap();
        assert_eq!(kept, [Some(0), None, Some(2)]);
        let warning = warning.unwrap();
        assert!(
            warning.contains("1 of the scene's 3 cameras") && warning.contains("line 1: no pose"),
            "{warning}"
        );
        assert!(read(&[true, false]).unwrap_err().to_string().contains("line 1"));
    }
}
