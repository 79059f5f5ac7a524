//! The depth range in which a view's surface is searched.

use serde::{Deserialize, Serialize};

use crate::{Pose, Scene, SeenPoints, Size, SparsePoint, View};

/// The nearest and the farthest depth, scene units.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Ends")]
pub struct DepthRange {
    /// Nearest depth, positive.
    pub near: f64,
    /// Farthest depth, beyond `near`.
    pub far: f64,
}

/// The two depths do not form a depth range.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("a depth range needs 0 < near < far, both finite; got near {near}, far {far}")]
pub struct DepthRangeError {
    /// As given.
    pub near: f64,
    /// As given.
    pub far: f64,
}

/// A depth range as read from a file, not checked yet.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Ends {
    near: f64,
    far: f64,
}

impl TryFrom<Ends> for DepthRange {
    type Error = DepthRangeError;

    fn try_from(Ends { near, far }: Ends) -> Result<Self, DepthRangeError> {
        Self::try_new(near, far)
    }
}

impl DepthRange {
    /// The range with half of its length in inverse depth added at these ends, near and far; the far end is at most four times as far as
    /// before.
    #[must_use]
    pub fn widened(self, ends: [bool; 2]) -> Self {
        let margins = ends.map(|end| if end { 0.5 } else { 0.0 });
        widened(self.near, self.far, margins, 0.0).unwrap_or(self)
    }

    /// Checks that 0 < near < far, both finite.
    ///
    /// # Errors
    /// If not.
    pub fn try_new(near: f64, far: f64) -> Result<Self, DepthRangeError> {
        if near.is_finite() && far.is_finite() && near > 0.0 && near < far {
            Ok(Self { near, far })
        } else {
            Err(DepthRangeError { near, far })
        }
    }
}

/// Where a depth range comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RangeOrigin {
    /// The scene's files.
    File,
    /// The depths of triangulated points.
    Points,
    /// The cameras' viewing directions and baselines.
    Geometry,
    /// Points of a draft of the depth maps, which replace those that the scene's files do not have.
    Draft,
}

impl std::fmt::Display for RangeOrigin {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::File => "the scene's files",
            Self::Points => "sparse points",
            Self::Geometry => "camera geometry",
            Self::Draft => "a draft",
        })
    }
}

/// Fewest points from which a range is estimated.
const FEWEST_POINTS: usize = 10;

/// Most points that are projected into a view whose tracks name too few.
const MOST_PROJECTED: usize = 100_000;

/// The share of the points' depths that is left out at each end, and up to which outliers are.
const LEFT_OUT: [f64; 2] = [0.0025, 0.05];

/// The margins before and behind the points' depths, as shares of their range in inverse depth.
const MARGINS: [f64; 2] = [0.25, 0.4];

/// The least margin, in inverse depth, as a share of the inverse of the median depth.
const MARGIN_OF_MEDIAN: f64 = 0.02;

/// How many times as far the far end becomes at most by a margin.
const FARTHEST: f64 = 4.0;

/// The factor by which the range from camera geometry extends in front of and behind the point at which the cameras
/// look.
const FOCUS_MARGIN: f64 = 2.5;

/// The largest and the smallest triangulation angle, degrees, of the range for cameras whose optical axes do not
/// converge.
const BASELINE_ANGLES: (f64, f64) = (20.0, 2.0);

/// Optical axes count as parallel if the sine of the angle between them is smaller (1.8°).
const PARALLEL: f64 = 0.0316;

/// The depth range of a view, with its origin: that of the scene's files, else [`from_points`], else
/// [`from_geometry`]. `seen` lists the points that each view saw; `sources` are the source views.
#[must_use]
pub fn for_view(
    scene: &Scene,
    seen: &SeenPoints,
    view: usize,
    sources: &[usize],
) -> Option<(DepthRange, RangeOrigin)> {
    let from_file = || Some((scene.views[view].depth_range?, RangeOrigin::File));
    let from_points = || Some((from_points(scene, seen, view)?, RangeOrigin::Points));
    let from_geometry = || Some((from_geometry(scene, view, sources)?, RangeOrigin::Geometry));
    from_file().or_else(from_points).or_else(from_geometry)
}

/// The depth range of the triangulated points that a view saw. If tracks name fewer than ten of them, all points
/// count that project into its image (an even subsample, if there are more than 100,000). `None` if these are fewer
/// than ten, too.
///
/// At both ends a quarter of a percent of the depths, but at least one of more than one, are left out, and up to 5 % as long as they are outliers: nearer or farther than
/// their quartile by more than the factor r³, where r is the ratio of the quartiles, at least 1.5. Surfaces with little texture,
/// far walls above all, have few points or none: the margins are a quarter of the remaining range in inverse depth at the near end, and
/// two fifths at the far end, but at least 2 % of the median depth; the far end is at most four times as far by it.
#[must_use]
pub fn from_points(scene: &Scene, seen: &SeenPoints, view: usize) -> Option<DepthRange> {
    let seen = seen.by(view).iter().map(|&point| &scene.points[point]);
    let depths = depths_in(&scene.views[view], seen);
    if depths.len() >= FEWEST_POINTS {
        return robust_range(depths);
    }
    let step = scene.points.len().div_ceil(MOST_PROJECTED).max(1);
    let inside = scene.points.iter().step_by(step).filter(|point| is_inside(&scene.views[view], point));
    let depths = depths_in(&scene.views[view], inside);
    (depths.len() >= FEWEST_POINTS).then(|| robust_range(depths))?
}

/// The depth range that the cameras alone suggest.
///
/// If the optical axes of at least half of the sources converge with the view's own, the cameras look at a common
/// subject: the range is that of the quartiles of the depths at which the axes come closest, widened by a factor of
/// 2.5 at both ends. Otherwise, as on a walk along a façade, it reaches from the depth at which the median baseline
/// gives a triangulation angle of 20° to that of 2°: nearer surfaces look too different in the source views, and
/// farther ones have too little parallax. `None` without sources, or if all cameras are at the same place.
#[must_use]
pub fn from_geometry(scene: &Scene, view: usize, sources: &[usize]) -> Option<DepthRange> {
    let reference = &scene.views[view].cam_from_world;
    let poses = || sources.iter().map(|&source| &scene.views[source].cam_from_world);
    let mut focus: Vec<f64> = poses().filter_map(|source| depth_of_approach(reference, source)).collect();
    if !focus.is_empty() && 2 * focus.len() >= sources.len() {
        let (near, far) = (quantile(&mut focus, 0.25)?, quantile(&mut focus, 0.75)?);
        return DepthRange::try_new(near / FOCUS_MARGIN, far * FOCUS_MARGIN).ok();
    }
    let mut baselines: Vec<f64> =
        poses().map(|source| (source.centre() - reference.centre()).norm()).collect();
    let baseline = quantile(&mut baselines, 0.5)?;
    let depth = |degrees: f64| 0.5 * baseline / (0.5 * degrees).to_radians().tan();
    DepthRange::try_new(depth(BASELINE_ANGLES.0), depth(BASELINE_ANGLES.1)).ok()
}

/// The range of a view together with those of views beside it: from the lower quartile of the near ends to the upper quartile
/// of the far ends. What cameras suggest for a single view may be far off, for most views it is not.
#[must_use]
pub fn with_neighbours(own: DepthRange, beside: impl Iterator<Item = DepthRange>) -> DepthRange {
    let ranges: Vec<DepthRange> = std::iter::once(own).chain(beside).collect();
    let end =
        |of: fn(&DepthRange) -> f64, share| quantile(&mut ranges.iter().map(of).collect::<Vec<_>>(), share);
    let ends = end(|range| range.near, 0.25).zip(end(|range| range.far, 0.75));
    ends.and_then(|(near, far)| DepthRange::try_new(near, far).ok()).unwrap_or(own)
}

/// The depths of the points that are in front of a view's camera.
fn depths_in<'a>(view: &View, points: impl Iterator<Item = &'a SparsePoint>) -> Vec<f64> {
    let depths = points.map(|point| view.cam_from_world.transform(&point.x_in_world).z);
    depths.filter(|z| z.is_finite() && *z > 0.0).collect()
}

/// Whether a point projects into a view's image.
fn is_inside(view: &View, point: &SparsePoint) -> bool {
    let Size { width, height } = view.camera.size;
    let pixel = view.camera.project(&view.cam_from_world.transform(&point.x_in_world));
    pixel.is_some_and(|p| p.x >= 0.0 && p.y >= 0.0 && p.x < width as f64 && p.y < height as f64)
}

/// The range of most of the depths plus a margin, as [`from_points`] describes.
fn robust_range(mut depths: Vec<f64>) -> Option<DepthRange> {
    depths.sort_by(f64::total_cmp);
    let last = depths.len() - 1;
    let rank = |share: f64| (share * last as f64).ceil() as usize;
    let (nearer, farther) = (depths[rank(0.25)], depths[last - rank(0.25)]);
    let reach = (farther / nearer).max(1.5).powi(3);
    // The first depth that is no outlier, among those that may be left out.
    let end = |from_end: &dyn Fn(usize) -> f64, far_out: &dyn Fn(f64) -> bool| {
        let [first, last] = LEFT_OUT.map(rank);
        (first..last).map(from_end).find(|&depth| !far_out(depth)).unwrap_or_else(|| from_end(last))
    };
    let near = end(&|rank| depths[rank], &|depth| depth < nearer / reach);
    let far = end(&|rank| depths[last - rank], &|depth| depth > farther * reach);
    widened(near, far, MARGINS, MARGIN_OF_MEDIAN / depths[last / 2])
}

/// The range from `near` to `far` with margins of these shares of it in inverse depth, each at least `least`. The far end is at most
/// `FARTHEST` times as far as before.
fn widened(near: f64, far: f64, [before, behind]: [f64; 2], least: f64) -> Option<DepthRange> {
    let length = 1.0 / near - 1.0 / far;
    let [before, behind] = [before, behind].map(|share| (share * length).max(least));
    let inverse_far = (1.0 / far - behind).max(1.0 / (FARTHEST * far));
    DepthRange::try_new(1.0 / (1.0 / near + before), 1.0 / inverse_far).ok()
}

/// The depth in view `a` at which its optical axis comes closest to that of `b`; `None` if the closest point is
/// behind either camera, or if the axes are nearly parallel.
fn depth_of_approach(a: &Pose, b: &Pose) -> Option<f64> {
    let (axis_a, axis_b) = (a.forward(), b.forward());
    let a_to_b = b.centre() - a.centre();
    let cosine = axis_a.dot(&axis_b);
    let squared_sine = axis_a.cross(&axis_b).norm_squared();
    let along_a = (a_to_b.dot(&axis_a) - cosine * a_to_b.dot(&axis_b)) / squared_sine;
    let along_b = (cosine * a_to_b.dot(&axis_a) - a_to_b.dot(&axis_b)) / squared_sine;
    (squared_sine > PARALLEL * PARALLEL && along_a > 0.0 && along_b > 0.0).then_some(along_a)
}

/// The quantile `share`, 0 to 1, as the value of the nearest rank; `None` if there are no values. Sorts the values.
fn quantile(values: &mut [f64], share: f64) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get((share * values.len().saturating_sub(1) as f64).round() as usize).copied()
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;
    use crate::{Intrinsics, Pinhole};

    fn view(cam_from_world: Pose) -> View {
        let intrinsics = Intrinsics { fx: 500.0, fy: 500.0, cx: 320.0, cy: 240.0 };
        let camera = Pinhole { size: Size::new(640, 480), intrinsics }.into();
        View { id: 0, name: "a.png".into(), camera, cam_from_world, depth_range: None }
    }

    /// A view at the origin that looks along z, and points at these depths whose tracks name `views`.
    fn scene(depths: impl IntoIterator<Item = f64>, views: &[usize]) -> Scene {
        let point = |z: f64| SparsePoint { x_in_world: Vector3::new(0.1 * z, 0.0, z), views: views.to_vec() };
        let points = depths.into_iter().map(point).collect();
        Scene { views: vec![view(Pose::identity())], points, pairs: None }
    }

    fn ranged(scene: &Scene, view: usize) -> Option<DepthRange> {
        from_points(scene, &SeenPoints::of(scene), view)
    }

    /// `count` depths, evenly spaced from 4 to 6.
    fn even(count: usize) -> impl Iterator<Item = f64> {
        (0..count).map(move |i| 4.0 + 2.0 * i as f64 / (count - 1) as f64)
    }

    #[test]
    fn a_view_that_is_far_from_its_neighbours_takes_their_range() {
        let range = |near, far| DepthRange { near, far };
        let beside = [range(1.0, 15.0), range(1.2, 14.0), range(0.9, 16.0), range(1.1, 13.0)];
        assert_eq!(with_neighbours(range(5.3, 53.7), beside.into_iter()), range(1.0, 16.0));
        assert_eq!(with_neighbours(range(1.0, 14.0), beside.into_iter()), range(1.0, 15.0));
        assert_eq!(with_neighbours(range(1.0, 14.0), std::iter::empty()), range(1.0, 14.0));
    }

    #[test]
    fn points_give_their_range_and_a_margin() {
        let range = ranged(&scene(even(1001), &[0]), 0).unwrap();
        // At each end three of the 1001 depths are left out; then the margins are added.
        let length = 1.0 / 4.006 - 1.0 / 5.994;
        assert!((1.0 / range.near - (1.0 / 4.006 + 0.25 * length)).abs() < 1e-9, "{range:?}");
        assert!((1.0 / range.far - (1.0 / 5.994 - 0.4 * length)).abs() < 1e-9, "{range:?}");
    }

    #[test]
    fn outliers_do_not_widen_the_range() {
        let outliers = (0..40).map(|i| if i % 2 == 0 { 1e4 + f64::from(i) } else { 1e-4 });
        let range = ranged(&scene(even(960).chain(outliers), &[0]), 0).unwrap();
        assert!(range.near > 3.5 && range.near < 4.0 && range.far > 6.0 && range.far < 7.6, "{range:?}");
        let few = ranged(&scene(even(11).chain([1e6]), &[0]), 0).unwrap();
        assert!(few.near < 4.3 && few.far > 5.8 && few.far < 7.6, "{few:?}");
    }

    #[test]
    fn a_background_of_a_tenth_of_the_points_is_kept() {
        let range = ranged(&scene(even(900).chain((0..100).map(|_| 50.0)), &[0]), 0).unwrap();
        assert!(range.far > 50.0);
    }

    #[test]
    fn a_few_points_three_times_as_far_are_no_outliers() {
        let range = ranged(&scene([5.0; 960].into_iter().chain([15.0; 40]), &[0]), 0).unwrap();
        assert!(range.far > 15.0);
    }

    #[test]
    fn a_range_is_widened_at_the_ends_that_are_asked_for() {
        let range = DepthRange { near: 2.0, far: 4.0 };
        assert_eq!(range.widened([true, false]), DepthRange { near: 1.6, far: 4.0 });
        assert_eq!(range.widened([false, true]), DepthRange { near: 2.0, far: 8.0 });
        let wide = DepthRange { near: 1.0, far: 10.0 };
        assert_eq!(wide.widened([false, true]).far, 40.0, "four times at most");
    }

    #[test]
    fn points_on_a_plane_still_give_a_range() {
        let range = ranged(&scene([5.0; 20], &[0]), 0).unwrap();
        assert!((range.near - 5.0 / 1.02).abs() < 1e-9 && (range.far - 5.0 / 0.98).abs() < 1e-9);
    }

    #[test]
    fn without_tracks_points_inside_of_the_image_count() {
        let mut scene = scene(even(100), &[]);
        let aside = |z: f64| SparsePoint { x_in_world: Vector3::new(z, 0.0, z), views: vec![] };
        scene.points.extend([-5.0, -6.0, 100.0].map(aside).into_iter().cycle().take(90));
        let range = ranged(&scene, 0).unwrap();
        assert!(range.near > 3.6 && range.far < 7.6, "{range:?}");
    }

    #[test]
    fn fewer_than_ten_points_are_too_few() {
        assert_eq!(ranged(&scene(even(9), &[0]), 0), None);
        assert_eq!(ranged(&scene((0..50).map(|_| -3.0), &[0]), 0), None);
    }

    fn looking(from: [f64; 3], to: [f64; 3]) -> View {
        view(Pose::look_at(&Vector3::from(from), &Vector3::from(to), &Vector3::new(0.0, -1.0, 0.0)))
    }

    #[test]
    fn converging_cameras_look_around_their_focus() {
        let eyes = [[0.0, 0.0, -8.0], [2.0, 0.0, -7.0], [-3.0, 1.0, -7.5], [0.0, 2.0, -6.0]];
        let views = eyes.map(|eye| looking(eye, [0.0; 3])).to_vec();
        let range = from_geometry(&Scene { views, ..Scene::default() }, 0, &[1, 2, 3]).unwrap();
        assert!((range.near - 8.0 / 2.5).abs() < 1e-9 && (range.far - 8.0 * 2.5).abs() < 1e-9);
    }

    #[test]
    fn parallel_cameras_look_where_their_baseline_is_seen_under_2_to_20_degrees() {
        let views = [0.0, 0.5, -0.5].map(|x| looking([x, 0.0, 0.0], [x, 0.0, 1.0])).to_vec();
        let range = from_geometry(&Scene { views, ..Scene::default() }, 0, &[1, 2]).unwrap();
        let angle = |depth: f64| 2.0 * (0.25 / depth).atan().to_degrees();
        assert!((angle(range.near) - 20.0).abs() < 1e-9 && (angle(range.far) - 2.0).abs() < 1e-9);
    }

    #[test]
    fn geometry_needs_a_source_at_another_place() {
        let views = vec![looking([0.0; 3], [0.0, 0.0, 1.0]), looking([0.0; 3], [0.1, 0.0, 1.0])];
        let scene = Scene { views, ..Scene::default() };
        assert_eq!(from_geometry(&scene, 0, &[]), None);
        assert_eq!(from_geometry(&scene, 0, &[1]), None);
    }

    #[test]
    fn files_come_before_points_and_points_before_geometry() {
        let mut scene = scene(even(50), &[0]);
        scene.views.push(looking([1.0, 0.0, 0.0], [0.0, 0.0, 5.0]));
        let given = DepthRange { near: 1.0, far: 2.0 };
        scene.views[0].depth_range = Some(given);
        assert_eq!(for_view(&scene, &SeenPoints::of(&scene), 0, &[1]), Some((given, RangeOrigin::File)));
        scene.views[0].depth_range = None;
        assert_eq!(for_view(&scene, &SeenPoints::of(&scene), 0, &[1]).unwrap().1, RangeOrigin::Points);
        scene.points.clear();
        assert_eq!(for_view(&scene, &SeenPoints::of(&scene), 0, &[1]).unwrap().1, RangeOrigin::Geometry);
        assert_eq!(for_view(&scene, &SeenPoints::of(&scene), 0, &[]), None);
    }

    #[test]
    fn ranges_that_are_none_are_refused() {
        for (near, far) in
            [(0.0, 1.0), (-1.0, 1.0), (2.0, 2.0), (3.0, 2.0), (f64::NAN, 1.0), (1.0, f64::INFINITY)]
        {
            assert!(DepthRange::try_new(near, far).is_err());
        }
    }
}
