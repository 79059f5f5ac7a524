//! Selection of source views for each reference view.
//!
//! A good source view shows the same surfaces from a moderate baseline: a small triangulation angle makes depth
//! uncertain, a large one makes surfaces look different. MVSNet (Yao et al. 2018, section 4.1) scores a pair of views
//! by the sum, over the points both saw, of a piecewise Gaussian of that angle. If there are no tracks to tell what
//! the views saw, a grid of virtual points in the view's frustum is used instead.
//!
//! Sources are chosen as a set: what a view adds is less at a point that those before it have seen, least if from the same
//! direction. So surfaces that only few views see, at the border of a photograph or near a camera that drives past them, get
//! views of their own.

mod cover;

use nalgebra::{Vector2, Vector3};
use rayon::prelude::*;

use cover::Cover;

use crate::{DepthRange, Pinhole, Scene, SeenPoints, Source, View, depth_range, lift::lift};

/// The best triangulation angle, degrees: θ₀ of MVSNet.
const BEST_ANGLE: f64 = 5.0;

/// Standard deviation of the Gaussian below the best angle, degrees: σ₁ of MVSNet.
const NARROWER: f64 = 1.0;

/// Standard deviation of the Gaussian above the best angle, degrees: σ₂ of MVSNet.
const WIDER: f64 = 10.0;

/// A source view may show surfaces so many times as large as the reference view.
const LARGER: f64 = 1.6;

/// Views are not selected if the mean score of the common points is at most this: that of angles of 0.2° and of 53°.
const NEGLIGIBLE: f64 = 1e-5;

/// This many of the best sources are compared, whatever their scores.
const FEWEST_COMPARED: usize = 4;

/// Further sources are compared if their score is at least this share of the best one's. The others share next to nothing of
/// the surfaces, or see them from an angle of more than 30°.
const WORTH: f64 = 0.02;

/// Views that see a point from directions that differ by much less than this, degrees, see the same of it.
const SAME_DIRECTION: f64 = 5.0;

/// How much a view that sees a point from another direction takes from the worth of the next ones there; one from the same
/// direction takes 1.
const OTHER_DIRECTION: f64 = 0.5;

/// Views among which the sources are chosen, for each source that is wanted: those with the highest scores.
const CANDIDATES: usize = 4;

/// Source views are scored by camera geometry if the view shares fewer points than this with other views.
const FEWEST_POINTS: usize = 10;

/// Number of nearest views from which the depth range of the virtual points is estimated.
const NEAR_VIEWS: usize = 10;

/// Columns and rows of the grid of virtual points.
const GRID: usize = 5;

/// Layers of the grid, evenly spaced in inverse depth.
const LAYERS: usize = 3;

/// For each view, at most `count` source views, in the order in which they are worth being added. `pinholes` are the undistorted cameras of the scene's
/// views.
///
/// If the scene has [`Scene::pairs`], they are used. Otherwise sources are scored by MVSNet's score over the tracks, less where they
/// show a surface at another size than the view does. A track counts for the part of the image that it is alone in, one of 8×8 cells at
/// most; where a cell has none, its surface is taken to be as far as in the nearest cell that has some. A view that shares fewer than
/// ten points with others is scored by virtual points instead: a grid of pixels,
/// back-projected to three depths of the view's [`depth_range::for_view`]. Those that project into the other view's
/// image count, weighted by the cosine of the angle between the optical axes, because surfaces are seen from one side
/// only. A view that shares nothing, or is at the same place, is not selected, so lists may be shorter than `count`,
/// and empty. The first source has the highest score; each further one has the highest sum, over the points, of its
/// score divided by (1 + s)², where s is what those before it have seen there.
#[must_use]
pub fn select(scene: &Scene, pinholes: &[Pinhole], count: usize) -> Vec<Vec<Source>> {
    if let Some(pairs) = &scene.pairs {
        return pairs.iter().map(|sources| sources.iter().copied().take(count).collect()).collect();
    }
    let centres: Vec<_> = scene.views.iter().map(|view| view.cam_from_world.centre()).collect();
    let (seen, by_view) = (shared_points(scene), SeenPoints::of(scene));
    (0..scene.views.len())
        .into_par_iter()
        .map(|view| {
            let candidates = if seen[view].len() >= FEWEST_POINTS {
                by_tracks(scene, (&centres, pinholes), view, &seen[view])
            } else {
                by_geometry(scene, (&centres, &by_view), pinholes, view)
            };
            chosen(candidates, count)
        })
        .collect()
}

/// The views, at most `most`, that a reference view is compared with, out of its `sources`, in their order: the first
/// four, and of the others those with at least 0.02 of the best score.
pub fn compared(sources: &[Source], most: usize) -> impl Iterator<Item = usize> {
    let enough = WORTH * sources.iter().fold(0.0, |best, source| source.score.max(best));
    let is_worth = move |&(rank, source): &(usize, &Source)| rank < FEWEST_COMPARED || source.score >= enough;
    sources.iter().enumerate().filter(is_worth).map(|(_, source)| source.view).take(most)
}

/// For each view, the indices of the points that it and at least one other view saw.
fn shared_points(scene: &Scene) -> Vec<Vec<usize>> {
    let mut seen = vec![Vec::new(); scene.views.len()];
    for (index, point) in scene.points.iter().enumerate().filter(|(_, point)| point.views.len() > 1) {
        for &view in &point.views {
            seen[view].push(index);
        }
    }
    seen
}

/// A view that may become a source.
struct Candidate {
    view: usize,
    looks: Vec<Look>,
}

/// A candidate's look at a point that the reference view saw.
struct Look {
    point: usize,
    /// What the point counts for.
    weight: f64,
    /// The weighted score of the triangulation angle and of the sizes at which the views show the point, 0 to the weight.
    score: f64,
    /// Unit vector from the point to the candidate's camera.
    direction: Vector3<f64>,
    /// What the sources chosen so far have seen of the point that this look would show again.
    seen: f64,
}

impl Look {
    fn new(point: usize, (weight, score): (f64, f64), to_camera: Vector3<f64>) -> Self {
        Self { point, weight, score: weight * score, direction: to_camera.normalize(), seen: 0.0 }
    }
}

impl Candidate {
    /// What its points count for.
    fn weight(&self) -> f64 {
        self.looks.iter().map(|look| look.weight).sum()
    }

    /// MVSNet's score, weighted.
    fn score(&self) -> f64 {
        self.looks.iter().map(|look| look.score).sum()
    }

    /// What the view adds to the sources chosen so far.
    fn gain(&self) -> f64 {
        self.looks.iter().map(|look| look.score / (1.0 + look.seen).powi(2)).sum()
    }
}

/// The candidates that saw some of the reference view's points, with the number of each point in `seen`.
fn by_tracks(
    scene: &Scene,
    (centres, pinholes): (&[Vector3<f64>], &[Pinhole]),
    view: usize,
    seen: &[usize],
) -> Vec<Candidate> {
    let mut looks: Vec<Vec<Look>> = centres.iter().map(|_| Vec::new()).collect();
    let pose = &scene.views[view].cam_from_world;
    let in_cam: Vec<_> = seen.iter().map(|&index| pose.transform(&scene.points[index].x_in_world)).collect();
    let cover = Cover::new(&in_cam, &pinholes[view]);
    let fills: Vec<_> = cover.fills.iter().map(|fill| pose.inverse().transform(fill)).collect();
    for (number, point) in seen.iter().map(|&index| &scene.points[index]).enumerate() {
        let ray = centres[view] - point.x_in_world;
        for &other in point.views.iter().filter(|&&other| other != view) {
            let to_other = centres[other] - point.x_in_world;
            let likeness = size_score((&pinholes[view], &ray), (&pinholes[other], &to_other));
            let score = likeness * angle_score(&ray, &to_other);
            looks[other].push(Look::new(number, (cover.weights[number], score), to_other));
        }
    }
    let between = Between { scene, centres, pinholes, view };
    for (other, looks) in looks.iter_mut().enumerate().filter(|(_, looks)| !looks.is_empty()) {
        let fills = (seen.len()..).zip(&fills);
        looks.extend(fills.filter_map(|(number, point)| between.look(other, number, point, cover.fill)));
    }
    looks.into_iter().enumerate().map(|(view, looks)| Candidate { view, looks }).collect()
}

/// The candidates that have some of the virtual points of the reference view in their images.
fn by_geometry(
    scene: &Scene,
    (centres, seen): (&[Vector3<f64>], &SeenPoints),
    pinholes: &[Pinhole],
    view: usize,
) -> Vec<Candidate> {
    let near = nearest_views(centres, view);
    let Some((range, _)) = depth_range::for_view(scene, seen, view, &near) else { return Vec::new() };
    let points = virtual_points(&scene.views[view], &pinholes[view], &range);
    let between = Between { scene, centres, pinholes, view };
    let candidate = |other: usize| {
        let look = |(number, point)| between.look(other, number, point, 1.0);
        Candidate { view: other, looks: points.iter().enumerate().filter_map(look).collect() }
    };
    (0..centres.len()).filter(|&other| other != view).map(candidate).collect()
}

/// A view and its candidates, for points that are not known to be seen.
struct Between<'a> {
    scene: &'a Scene,
    centres: &'a [Vector3<f64>],
    pinholes: &'a [Pinhole],
    view: usize,
}

impl Between<'_> {
    /// The look of `other` at a virtual point, if it lies in its image.
    fn look(&self, other: usize, number: usize, point: &Vector3<f64>, weight: f64) -> Option<Look> {
        let pose = |view: usize| &self.scene.views[view].cam_from_world;
        let facing = pose(self.view).forward().dot(&pose(other).forward());
        let is_inside =
            facing > 0.0 && self.pinholes[other].project_inside(&pose(other).transform(point)).is_some();
        let (ray, to_other) = (self.centres[self.view] - point, self.centres[other] - point);
        let likeness = size_score((&self.pinholes[self.view], &ray), (&self.pinholes[other], &to_other));
        let score = facing * likeness * angle_score(&ray, &to_other);
        is_inside.then(|| Look::new(number, (weight, score), to_other))
    }
}

/// The [`NEAR_VIEWS`] other views whose camera centres are nearest to a view's.
fn nearest_views(centres: &[Vector3<f64>], view: usize) -> Vec<usize> {
    let distance = |&other: &usize| (centres[other] - centres[view]).norm_squared();
    let mut others: Vec<usize> = (0..centres.len()).filter(|&other| other != view).collect();
    others.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
    others.truncate(NEAR_VIEWS);
    others
}

/// The grid of virtual points, in the world, that replaces the points that a view saw.
fn virtual_points(view: &View, pinhole: &Pinhole, range: &DepthRange) -> Vec<Vector3<f64>> {
    let world_from_cam = view.cam_from_world.inverse();
    let share = |i: usize, count: usize| (i as f64 + 0.5) / count as f64;
    let (width, height) = (pinhole.size.width as f64, pinhole.size.height as f64);
    let mut points = Vec::with_capacity(GRID * GRID * LAYERS);
    for layer in 0..LAYERS {
        let t = share(layer, LAYERS);
        let depth = 1.0 / ((1.0 - t) / range.near + t / range.far);
        for (i, j) in (0..GRID).flat_map(|i| (0..GRID).map(move |j| (i, j))) {
            let pixel = Vector2::new(width * share(i, GRID), height * share(j, GRID));
            points.push(world_from_cam.transform(&lift(pinhole, &pixel, depth)));
        }
    }
    points
}

/// MVSNet's piecewise Gaussian of the triangulation angle, the angle between the rays `a` and `b` from a point to the
/// two cameras: 1 at the best angle, smaller for narrower and wider ones.
#[must_use]
pub fn angle_score(a: &Vector3<f64>, b: &Vector3<f64>) -> f64 {
    let angle = a.cross(b).norm().atan2(a.dot(b)).to_degrees();
    let deviation = if angle <= BEST_ANGLE { NARROWER } else { WIDER };
    (-0.5 * ((angle - BEST_ANGLE) / deviation).powi(2)).exp()
}

/// How well a point is seen by a source view that shows it smaller or larger than the reference view does: 1 if as large or up
/// to 1.6 times as large, else the share of the area. Each view comes with the ray between the point and its camera.
fn size_score(reference: (&Pinhole, &Vector3<f64>), source: (&Pinhole, &Vector3<f64>)) -> f64 {
    let size = |(camera, ray): (&Pinhole, &Vector3<f64>)| camera.intrinsics.fx / ray.norm();
    let ratio = size(source) / size(reference);
    (ratio.min(1.0) * (LARGER / ratio).min(1.0)).powi(2)
}

/// At most `count` of the candidates, each the one that adds most to those before it; of equal ones the lower index comes first.
fn chosen(candidates: Vec<Candidate>, count: usize) -> Vec<Source> {
    let mut left: Vec<(f64, Candidate)> = candidates.into_iter().map(|c| (c.score(), c)).collect();
    left.retain(|(score, candidate)| *score > NEGLIGIBLE * candidate.weight());
    left.sort_by(|(a, _), (b, _)| b.total_cmp(a));
    left.truncate(CANDIDATES * count);
    let points = left.iter().flat_map(|(_, c)| &c.looks).map(|look| look.point + 1).max().unwrap_or(0);
    let mut sources = Vec::with_capacity(count.min(left.len()));
    while sources.len() < count && !left.is_empty() {
        let gains: Vec<f64> = left.iter().map(|(_, candidate)| candidate.gain()).collect();
        let best = (1..gains.len()).fold(0, |best, at| if gains[at] > gains[best] { at } else { best });
        let (score, next) = left.remove(best);
        sources.push(Source { view: next.view, score });
        let mut look_at: Vec<Option<&Look>> = vec![None; points];
        next.looks.iter().for_each(|look| look_at[look.point] = Some(look));
        for look in left.iter_mut().flat_map(|(_, candidate)| &mut candidate.looks) {
            if let Some(before) = look_at[look.point] {
                look.seen += before.score / before.weight * likeness(&before.direction, &look.direction);
            }
        }
    }
    sources
}

/// How far a look along one direction shows the same as one along another: from 0.5 to 1.
fn likeness(a: &Vector3<f64>, b: &Vector3<f64>) -> f64 {
    let deviations = (a - b).norm() / SAME_DIRECTION.to_radians();
    OTHER_DIRECTION + (1.0 - OTHER_DIRECTION) * (-0.5 * deviations * deviations).exp()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Camera, Intrinsics, Lens, Pose, Size, SparsePoint};

    const PINHOLE: Pinhole = Pinhole {
        size: Size::new(640, 480),
        intrinsics: Intrinsics { fx: 600.0, fy: 600.0, cx: 320.0, cy: 240.0 },
    };

    fn view(id: usize, eye: Vector3<f64>, target: Vector3<f64>) -> View {
        View {
            id: id as u32,
            name: format!("{id}.png"),
            camera: PINHOLE.into(),
            cam_from_world: Pose::look_at(&eye, &target, &Vector3::new(0.0, -1.0, 0.0)),
            depth_range: None,
        }
    }

    /// Cameras at these angles, degrees, on a circle of radius 10 around the origin, looking at its centre.
    fn ring(degrees: &[f64]) -> Scene {
        let eye = |d: f64| 10.0 * Vector3::new(d.to_radians().sin(), 0.0, -d.to_radians().cos());
        let views = degrees.iter().enumerate().map(|(id, &d)| view(id, eye(d), Vector3::zeros())).collect();
        Scene { views, ..Scene::default() }
    }

    fn select_in(scene: &Scene, count: usize) -> Vec<Vec<usize>> {
        let views = |sources: Vec<Source>| sources.iter().map(|source| source.view).collect();
        select(scene, &vec![PINHOLE; scene.views.len()], count).into_iter().map(views).collect()
    }

    fn sources(scores: &[f64]) -> Vec<Source> {
        scores.iter().enumerate().map(|(view, &score)| Source { view: 10 + view, score }).collect()
    }

    #[test]
    fn the_score_is_mvsnets() {
        let ray = |d: f64| Vector3::new(d.to_radians().sin(), 0.0, d.to_radians().cos());
        for (angle, expected) in [(5.0, 1.0), (3.0, (-2.0_f64).exp()), (15.0, (-0.5_f64).exp())] {
            assert!((angle_score(&ray(0.0), &(ray(angle) * 7.0)) - expected).abs() < 1e-12);
        }
    }

    #[test]
    fn pairs_of_the_scene_are_obeyed() {
        let mut scene = ring(&[0.0, 5.0, 10.0]);
        let source = |view| Source { view, score: 1.0 };
        scene.pairs = Some(vec![vec![source(2), source(1)], vec![], vec![source(0)]]);
        assert_eq!(select_in(&scene, 1), [vec![2], vec![], vec![0]]);
    }

    /// The cameras of a rig with one centre, as the faces of a panorama have it, whatever they both see.
    #[test]
    fn views_with_one_centre_are_never_sources_of_each_other() {
        let ring = ring(&[0.0, 8.0]);
        let turned = view(2, ring.views[0].cam_from_world.centre(), Vector3::new(1.0, 0.0, 0.0));
        let mut scene = Scene { views: [ring.views, vec![turned]].concat(), ..Scene::default() };
        for with_points in [false, true] {
            if with_points {
                let at = |i: usize| Vector3::new(0.1 * (i % 5) as f64, 0.1 * (i / 5) as f64, 0.3);
                let point = |i| SparsePoint { x_in_world: at(i), views: vec![0, 1, 2] };
                scene.points = (0..25).map(point).collect();
            }
            let selected = select_in(&scene, 5);
            assert_eq!((&selected[0], &selected[2]), (&vec![1], &vec![1]), "points: {with_points}");
            assert_eq!(selected[1].len(), 2);
        }
    }

    #[test]
    fn as_many_sources_are_compared_as_are_wanted_unless_they_share_next_to_nothing() {
        let compare = |scores: &[f64], most| compared(&sources(scores), most).collect::<Vec<_>>();
        assert_eq!(compare(&[100.0, 1.9, 1.8, 1.7, 1.6], 8), [10, 11, 12, 13], "four at least");
        assert_eq!(compare(&[100.0, 90.0, 80.0, 70.0, 2.1, 1.9, 3.0], 8), [10, 11, 12, 13, 14, 16]);
        assert_eq!(compare(&[1.0; 9], 7).len(), 7, "as many as are wanted");
        assert_eq!(compare(&[100.0, 9.0, 8.0], 2), [10, 11]);
        assert_eq!(compare(&[0.0; 6], 8).len(), 6, "a file without scores");
        assert!(compare(&[], 8).is_empty());
    }

    #[test]
    fn tracks_are_scored_by_their_angle_and_number() {
        let mut scene = ring(&[0.0, 1.0, 5.0, 20.0, 180.0]);
        scene.points = (0..64).map(|cell| saw(cell, &[0, 1, 2, 3])).collect();
        assert_eq!(select_in(&scene, 9)[0], [2, 3, 1], "5° before 20° before 1°");
        assert_eq!(select_in(&scene, 2)[0], [2, 3]);
        // However many points there are in a few cells.
        let few = (0..8).flat_map(|cell| vec![saw(cell, &[0, 1, 2, 3]); 30]);
        scene.points = few.chain((8..64).map(|cell| saw(cell, &[0, 3]))).collect();
        assert_eq!(select_in(&scene, 9)[0], [3, 2, 1], "more of the image from a wider angle");
    }

    /// A point in the plane through the origin, in one of the 8×8 cells of the image of the first view of [`ring`].
    fn saw(cell: usize, views: &[usize]) -> SparsePoint {
        let at = |index: usize, side: f64| (index as f64 - 3.5) / 8.0 * side / 60.0;
        let x_in_world = Vector3::new(at(cell % 8, 640.0), at(cell / 8, 480.0), 0.0);
        SparsePoint { x_in_world, views: views.to_vec() }
    }

    #[test]
    fn sources_that_show_surfaces_smaller_are_worth_less() {
        let eye = |z: f64| view(0, Vector3::new(0.7, 0.0, z), Vector3::zeros());
        let mut scene = ring(&[0.0]);
        scene.views.extend([eye(-26.0), eye(-12.0), eye(-8.0), eye(-3.0)]);
        scene.points = (0..64).map(|cell| saw(cell, &[0, 1, 2, 3, 4])).collect();
        let selected = &select(&scene, &[PINHOLE; 5], 4)[0];
        let score = |view: usize| selected.iter().find(|source| source.view == view).unwrap().score;
        assert!(
            score(3) > score(2) && score(2) > 2.0 * score(4) && score(2) > 3.0 * score(1),
            "{selected:?}"
        );
    }

    /// Views behind see the near surfaces at the border, those ahead do not; there no point was found.
    #[test]
    fn parts_of_the_image_without_points_want_sources_too() {
        let at = |z: f64| view(0, Vector3::new(0.0, 0.0, z), Vector3::new(0.0, 0.0, 100.0));
        let views = vec![at(-10.0), at(-6.0), at(-7.0), at(-14.0)];
        let is_inside = |cell: usize| (3..5).contains(&(cell % 8)) && (3..5).contains(&(cell / 8));
        let points = (0..64).filter(|&cell| is_inside(cell)).map(|cell| saw(cell, &[0, 1, 2, 3]));
        let scene = Scene { views, points: points.flat_map(|point| vec![point; 5]).collect(), pairs: None };
        assert!(select_in(&scene, 2)[0].contains(&3));
    }

    /// Cameras that drive along their axis: the views behind see all that the reference sees, but only those ahead and beside it
    /// see the near surfaces at its border.
    #[test]
    fn sources_together_cover_the_reference_view() {
        let mut scene = ring(&[0.0, 4.0, 5.0, 8.0, -5.0, 14.0]);
        scene.points = (0..44).map(|cell| saw(cell, &[0, 1, 2, 3, 4])).collect();
        scene.points.extend((44..64).map(|cell| saw(cell, &[0, 5])));
        let three = select_in(&scene, 3)[0].clone();
        assert!(three.contains(&5), "the only one that sees the border: {three:?}");
        assert!(three.contains(&4), "the one from another side, not one more from the same: {three:?}");
        let scores: Vec<f64> =
            select(&scene, &[PINHOLE; 6], 9)[0].iter().map(|source| source.score).collect();
        assert!(scores[0] >= scores[1] && scores.len() == 5, "{scores:?}");
    }

    #[test]
    fn views_that_share_nothing_are_left_out() {
        let mut scene = ring(&[0.0, 6.0, 12.0, 18.0]);
        let saw = |views: [usize; 2]| SparsePoint { x_in_world: Vector3::zeros(), views: views.to_vec() };
        scene.points = [saw([0, 1]), saw([2, 3])].iter().cycle().take(40).cloned().collect();
        assert_eq!(select_in(&scene, 9), [[1], [0], [3], [2]]);
    }

    #[test]
    fn without_tracks_neighbours_on_a_ring_come_first_and_the_far_side_never() {
        let degrees: Vec<f64> = (0..24).map(|i| 15.0 * f64::from(i)).collect();
        let selected = select_in(&ring(&degrees), 4);
        for (view, sources) in selected.iter().enumerate() {
            let mut steps: Vec<_> = sources.iter().map(|s| (s + 36 - view) % 24).collect();
            steps.sort_unstable();
            assert_eq!(steps, [10, 11, 13, 14], "two neighbours to each side of view {view}");
        }
        assert!(select_in(&ring(&degrees), 24)[0].iter().all(|&s| !(6..=18).contains(&s)));
    }

    #[test]
    fn without_tracks_a_camera_at_the_same_place_or_looking_away_is_not_selected() {
        let (eye, ahead) = (Vector3::zeros(), Vector3::new(0.0, 0.0, 10.0));
        let aside = Vector3::new(1.0, 0.0, 0.0);
        let views =
            vec![view(0, eye, ahead), view(1, eye, ahead), view(2, aside, ahead), view(3, aside, -ahead)];
        assert_eq!(select_in(&Scene { views, ..Scene::default() }, 9)[0], [2]);
    }

    #[test]
    fn one_view_alone_has_no_sources() {
        assert_eq!(select_in(&ring(&[0.0]), 4), [Vec::<usize>::new()]);
        assert!(select_in(&Scene::default(), 4).is_empty());
    }

    #[test]
    fn scores_do_not_depend_on_the_scale() {
        let small = ring(&[0.0, 3.0, 9.0, 20.0]);
        let mut large = small.clone();
        large.views.iter_mut().for_each(|view| view.cam_from_world.translation *= 1000.0);
        assert_eq!(select_in(&small, 3), select_in(&large, 3));
    }

    #[test]
    fn the_lens_of_a_view_does_not_matter_to_selection() {
        let mut scene = ring(&[0.0, 5.0, 12.0]);
        let expected = select_in(&scene, 2);
        let lens = Lens::Rational { k: [-0.1, 0.0, 0.0, 0.0, 0.0, 0.0], p: [0.0; 2] };
        scene.views.iter_mut().for_each(|view| view.camera = Camera { lens, ..view.camera });
        assert_eq!(select_in(&scene, 2), expected);
    }
}
