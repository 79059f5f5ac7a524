//! Cameras and points that cannot be used among good ones: they are left out.

use std::error::Error;
use std::path::Path;

use nalgebra::Vector3;

use crate::{IoError, Place};

/// What could be read, in its place, and what is wrong with the rest.
///
/// # Errors
/// If half of the cameras cannot be read: then something is wrong with all of them. It is the first of their errors, and how many there are.
pub(crate) fn leave_out<T>(
    cameras: Vec<Result<T, IoError>>,
) -> Result<(Vec<Option<T>>, Vec<String>), IoError> {
    let broken = cameras.iter().filter(|camera| camera.is_err()).count();
    let all = cameras.len();
    let are_all = 2 * broken >= all;
    let mut reasons = Vec::with_capacity(broken);
    let mut kept = Vec::with_capacity(cameras.len());
    for camera in cameras {
        match camera {
            Ok(camera) => kept.push(Some(camera)),
            Err(error) if are_all => return Err(error.of_several(broken, all)),
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

/// The points whose positions are finite, and a warning if some are not.
///
/// # Errors
/// If half of them are not: then something is wrong with all of them.
pub(crate) fn finite_points<P>(
    points: Vec<P>,
    position: impl Fn(&P) -> &Vector3<f64>,
    file: &Path,
) -> Result<(Vec<P>, Option<String>), IoError> {
    let is_finite = |point: &P| position(point).iter().all(|value| value.is_finite());
    let all = points.len();
    let Some(first) = points.iter().find(|point| !is_finite(point)) else { return Ok((points, None)) };
    let first: [f64; 3] = (*position(first)).into();
    let kept: Vec<P> = points.into_iter().filter(is_finite).collect();
    let broken = all - kept.len();
    let problem = format!("{broken} of {all} points have a position that is not finite, such as {first:?}");
    if 2 * broken >= all {
        let problem = format!("{problem}: expected three numbers for each; write the file anew");
        return Err(IoError::malformed(file, Place::Whole, problem));
    }
    Ok((kept, Some(format!("{}: {problem}; they are left out", file.display()))))
}

#[cfg(test)]
mod tests {
    use super::*;

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
        let error = read(&[true, false]).unwrap_err().to_string();
        assert!(error.contains("line 1: no pose") && !error.contains("more"), "{error}");
        let error = read(&[true, false, false, false]).unwrap_err().to_string();
        assert!(error.contains("line 1") && error.contains("of the 4, 2 more cannot be used"), "{error}");
    }

    #[test]
    fn points_that_are_nowhere_are_left_out() {
        let point = |x: f64| Vector3::new(x, 0.0, 1.0);
        let read = |x: &[f64]| {
            finite_points(x.iter().map(|x| point(*x)).collect(), |point| point, Path::new("points.txt"))
        };
        assert_eq!(read(&[1.0, 2.0]).unwrap(), (vec![point(1.0), point(2.0)], None));
        let (kept, warning) = read(&[1.0, f64::NAN, 2.0]).unwrap();
        assert_eq!(kept, [point(1.0), point(2.0)]);
        let warning = warning.unwrap();
        assert!(warning.contains("points.txt: 1 of 3 points") && warning.contains("NaN"), "{warning}");
        assert!(read(&[f64::INFINITY, 1.0]).unwrap_err().to_string().contains("1 of 2 points"));
    }
}
