//! Meshes of exact depth maps of bodies whose surface is known.

use std::collections::HashMap;

use nalgebra::Vector3;
use vamvs_core::{Grid, Intrinsics, Mesh, Pinhole, Pose, Size};
use vamvs_mesh::{MeshError, MeshOptions, MeshView, Mesher};

/// The distance of the cameras from the middle, and their focal length: a pixel is 0.02 wide on the surface.
const DISTANCE: f64 = 4.0;
const FOCAL: f64 = 200.0;
const PIXEL: f64 = DISTANCE / FOCAL;

/// A box from a low to a high corner.
type Cuboid = [Vector3<f64>; 2];

/// A body: where a ray from outside meets it first, and the distance of a point from its surface.
trait Body {
    fn hit(&self, from: &Vector3<f64>, direction: &Vector3<f64>) -> Option<f64>;
    fn distance(&self, x: &Vector3<f64>) -> f64;
}

struct Sphere;

impl Body for Sphere {
    fn hit(&self, from: &Vector3<f64>, direction: &Vector3<f64>) -> Option<f64> {
        let (a, b, c) = (direction.norm_squared(), from.dot(direction), from.norm_squared() - 1.0);
        let root = (b * b - a * c).sqrt();
        (root >= 0.0).then(|| (-b - root) / a)
    }

    fn distance(&self, x: &Vector3<f64>) -> f64 {
        (x.norm() - 1.0).abs()
    }
}

struct Cuboids(Vec<Cuboid>);

impl Body for Cuboids {
    fn hit(&self, from: &Vector3<f64>, direction: &Vector3<f64>) -> Option<f64> {
        let hit = |[low, high]: &Cuboid| {
            let (mut enter, mut leave) = (0.0_f64, f64::INFINITY);
            for axis in 0..3 {
                let [a, b] = [low, high].map(|corner| (corner[axis] - from[axis]) / direction[axis]);
                (enter, leave) = (enter.max(a.min(b)), leave.min(a.max(b)));
            }
            (enter < leave).then_some(enter)
        };
        self.0.iter().filter_map(hit).min_by(f64::total_cmp)
    }

    fn distance(&self, x: &Vector3<f64>) -> f64 {
        let of = |[low, high]: &Cuboid| {
            let beyond = (low - x).sup(&(x - high));
            if beyond.max() > 0.0 { beyond.sup(&Vector3::zeros()).norm() } else { beyond.max() }
        };
        self.0.iter().map(of).min_by(f64::total_cmp).expect("a cuboid").abs()
    }
}

/// Exact depth maps from all sides, from `near` times the distance in every third view.
fn views(body: &dyn Body, count: usize, near: f64) -> Vec<MeshView> {
    let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    let eye = |number: usize| {
        let z = 1.0 - 2.0 * (number as f64 + 0.5) / count as f64;
        let (sin, cos) = (golden * number as f64).sin_cos();
        let distance = if number.is_multiple_of(3) { near * DISTANCE } else { DISTANCE };
        Vector3::new((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z) * distance
    };
    (0..count).map(|number| view(body, &eye(number))).collect()
}

fn view(body: &dyn Body, eye: &Vector3<f64>) -> MeshView {
    let size = Size::new(240, 240);
    let intrinsics = Intrinsics { fx: FOCAL, fy: FOCAL, cx: 120.0, cy: 120.0 };
    let pose = Pose::look_at(eye, &Vector3::zeros(), &Vector3::new(0.31, 0.2, 0.93));
    let depth = |x: usize, y: usize| {
        let in_cam = Vector3::new((x as f64 + 0.5 - 120.0) / FOCAL, (y as f64 + 0.5 - 120.0) / FOCAL, 1.0);
        body.hit(eye, &pose.rotation.tr_mul(&in_cam)).unwrap_or(0.0) as f32
    };
    MeshView {
        camera: Pinhole { size, intrinsics },
        cam_from_world: pose,
        depth: Grid::from_fn(size, depth),
        confirmed: None,
        sigma: None,
        normals: None,
        colour: Grid::filled(size, [10, 120, 250]),
    }
}

fn mesh(views: &[MeshView], cell: f64) -> Mesh {
    let mut options = MeshOptions::default();
    options.cell = cell;
    mesh_within(views, options, u64::MAX)
}

fn mesh_within(views: &[MeshView], options: MeshOptions, memory: u64) -> Mesh {
    let mesher = Mesher::new(options, memory, |view| Ok::<_, MeshError>(views[view].clone()));
    mesher.expect("valid options").mesh(views.len()).expect("rasters of one size")
}

/// The number of edges with one triangle; panics if one has more than two, or two that run the same way.
fn open_edges(mesh: &Mesh) -> usize {
    let mut edges: HashMap<(u32, u32), [u32; 2]> = HashMap::new();
    for &[a, b, c] in &mesh.triangles {
        for (from, to) in [(a, b), (b, c), (c, a)] {
            edges.entry((from.min(to), from.max(to))).or_default()[usize::from(from > to)] += 1;
        }
    }
    assert!(edges.values().all(|uses| uses[0] <= 1 && uses[1] <= 1), "the mesh is no manifold");
    edges.values().filter(|uses| uses[0] + uses[1] == 1).count()
}

/// Distances of the vertices and of the triangles' middles from the surface, pixels, ascending.
fn errors(mesh: &Mesh, body: &dyn Body) -> Vec<f64> {
    let vertices = (0..mesh.positions.len() as u32).map(|vertex| mesh.x_in_world(vertex));
    let middles = mesh
        .triangles
        .iter()
        .map(|&triangle| triangle.map(|v| mesh.x_in_world(v)).iter().sum::<Vector3<f64>>() / 3.0);
    let mut errors: Vec<f64> = vertices.chain(middles).map(|x| body.distance(&x) / PIXEL).collect();
    errors.sort_by(f64::total_cmp);
    errors
}

fn quantile(sorted: &[f64], share: f64) -> f64 {
    sorted[((sorted.len() - 1) as f64 * share) as usize]
}

/// The largest distance of points that views see from the mesh's vertices, pixels; a vertex is in each cell on the surface.
fn farthest_seen(mesh: &Mesh, views: &[MeshView]) -> f64 {
    let cell = 2.0 * PIXEL;
    let of = |x: &Vector3<f64>| -> [i32; 3] { x.map(|x| (x / cell).floor() as i32).into() };
    let mut cells: HashMap<[i32; 3], Vec<Vector3<f64>>> = HashMap::new();
    for vertex in 0..mesh.positions.len() as u32 {
        let x = mesh.x_in_world(vertex);
        cells.entry(of(&x)).or_default().push(x);
    }
    let nearest = |x: &Vector3<f64>| {
        let [i, j, k] = of(x);
        let around = (0..27).filter_map(|n| cells.get(&[i + n % 3 - 1, j + n / 3 % 3 - 1, k + n / 9 - 1]));
        around.flatten().map(|other| (x - other).norm()).min_by(f64::total_cmp).unwrap_or(f64::INFINITY)
    };
    let mut farthest = 0.0_f64;
    for view in views {
        let world_from_cam = view.cam_from_world.inverse();
        for y in (0..240).step_by(3) {
            for x in (0..240).step_by(3) {
                let depth = f64::from(view.depth[(x, y)]);
                let ray =
                    Vector3::new((x as f64 + 0.5 - 120.0) / FOCAL, (y as f64 + 0.5 - 120.0) / FOCAL, 1.0);
                if depth > 0.0 {
                    farthest = farthest.max(nearest(&world_from_cam.transform(&(ray * depth))) / PIXEL);
                }
            }
        }
    }
    farthest
}

#[test]
fn a_sphere_seen_from_all_sides_is_closed_and_exact() {
    let mesh = mesh(&views(&Sphere, 24, 1.0), 1.5);
    assert_eq!(open_edges(&mesh), 0);
    let errors = errors(&mesh, &Sphere);
    assert!(
        quantile(&errors, 1.0) < 0.5 && quantile(&errors, 0.99) < 0.25,
        "{:?}",
        [0.5, 0.99, 1.0].map(|q| quantile(&errors, q))
    );
    for (vertex, normal) in mesh.normals.iter().enumerate() {
        assert!(Vector3::from(*normal).cast::<f64>().dot(&mesh.x_in_world(vertex as u32)) > 0.8);
    }
    assert!(mesh.colours.iter().all(|colour| *colour == [10, 120, 250]));
}

#[test]
fn nearer_views_make_finer_cells_without_cracks() {
    let far = mesh(&views(&Sphere, 24, 1.0), 1.5);
    let mixed = mesh(&views(&Sphere, 24, 0.5), 1.5);
    assert_eq!(open_edges(&mixed), 0);
    assert!(
        mixed.triangles.len() > 2 * far.triangles.len(),
        "{} and {}",
        mixed.triangles.len(),
        far.triangles.len()
    );
    let errors = errors(&mixed, &Sphere);
    assert!(
        quantile(&errors, 1.0) < 1.0 && quantile(&errors, 0.99) < 0.25,
        "{:?}",
        [0.5, 0.99, 1.0].map(|q| quantile(&errors, q))
    );
}

/// Expects the mesh of `count` views to be within a pixel of a body, nearly everywhere within half of one, and to have a vertex within
/// `farthest` pixels of all that is seen.
fn expect_as_seen(body: &dyn Body, count: usize, cell: f64, farthest: f64) {
    let views = views(body, count, 1.0);
    let mesh = mesh(&views, cell);
    open_edges(&mesh);
    let errors = errors(&mesh, body);
    assert!(
        quantile(&errors, 1.0) < 1.0 && quantile(&errors, 0.99) < 0.5,
        "{:?}",
        [0.5, 0.99, 1.0].map(|q| quantile(&errors, q))
    );
    let found = farthest_seen(&mesh, &views);
    assert!(found < farthest, "{found}");
}

#[test]
fn walls_of_two_pixels_have_both_sides() {
    let wall = 2.0 * PIXEL;
    let slab = |low: [f64; 3], high: [f64; 3]| [low.into(), high.into()];
    let body = Cuboids(vec![
        slab([-0.7, -0.7, -0.4], [0.7, 0.7, -0.4 + wall]),
        slab([-0.7, -0.7, -0.4], [-0.7 + wall, 0.7, 0.4]),
        slab([0.7 - wall, -0.7, -0.4], [0.7, 0.7, 0.4]),
        slab([-0.7, -0.7, -0.4], [0.7, -0.7 + wall, 0.4]),
        slab([-0.7, 0.7 - wall, -0.4], [0.7, 0.7, 0.4]),
    ]);
    expect_as_seen(&body, 60, 1.0, 1.5);
}

#[test]
fn a_stair_is_as_seen() {
    let step = |i: u8| {
        let x = -0.8 + 0.4 * f64::from(i);
        [Vector3::new(x, -0.6, -0.5), Vector3::new(0.8, 0.6, -0.3 + 0.2 * f64::from(i))]
    };
    let body = Cuboids((0..4).map(step).collect());
    expect_as_seen(&body, 40, 1.5, 2.0);
}

#[test]
fn any_number_of_threads_makes_the_same_mesh() {
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| mesh(&views(&Sphere, 8, 0.7), 2.0))
    };
    assert_eq!(with(1), with(3));
}

#[test]
fn views_that_see_nothing_make_no_mesh_and_wrong_rasters_are_refused() {
    struct Nothing;
    impl Body for Nothing {
        fn hit(&self, _: &Vector3<f64>, _: &Vector3<f64>) -> Option<f64> {
            None
        }
        fn distance(&self, _: &Vector3<f64>) -> f64 {
            0.0
        }
    }
    let views = views(&Nothing, 3, 1.0);
    assert!(mesh(&views, 1.5).triangles.is_empty());
    assert!(mesh(&[], 1.5).triangles.is_empty());
    let wrong = MeshView { sigma: Some(Grid::filled(Size::new(3, 4), 1.0)), ..views[0].clone() };
    let mesher = Mesher::new(MeshOptions::default(), u64::MAX, |_| Ok::<_, MeshError>(wrong.clone()));
    let error = mesher.expect("valid options").mesh(1).expect_err("another size").to_string();
    assert_eq!(error, "view 0: expected a map of standard deviations of 240×240 pixels, found 3×4");
}

#[test]
fn a_reduced_mesh_is_a_manifold_on_the_surface() {
    let mut options = MeshOptions::default();
    options.triangles = Some(0.2);
    let reduced = mesh_within(&views(&Sphere, 24, 1.0), options, u64::MAX);
    let whole = mesh(&views(&Sphere, 24, 1.0), 1.5);
    assert!(
        5 * reduced.triangles.len() <= whole.triangles.len() + 50,
        "{} of {}",
        reduced.triangles.len(),
        whole.triangles.len()
    );
    assert_eq!(open_edges(&reduced), 0);
    let errors = errors(&reduced, &Sphere);
    assert!(quantile(&errors, 1.0) < 0.5, "{}", quantile(&errors, 1.0));
    assert!(reduced.colours.iter().all(|colour| *colour == [10, 120, 250]));
}

#[test]
fn little_memory_makes_larger_cells() {
    let views = views(&Sphere, 24, 1.0);
    let within = |memory: u64| {
        let mut mesher =
            Mesher::new(MeshOptions::default(), memory, |view| Ok::<_, MeshError>(views[view].clone()))
                .expect("valid options");
        let outlines = (0..views.len()).map(|view| mesher.outline(view)).collect::<Result<_, _>>();
        mesher.volume(outlines.expect("rasters of one size")).cell()
    };
    assert_eq!(within(u64::MAX), 1.5);
    let cell = within(2_600_000);
    assert!(cell > 1.5 && cell < 6.0, "{cell}");
    let whole = mesh_within(&views, MeshOptions::default(), u64::MAX);
    let small = mesh_within(&views, MeshOptions::default(), 2_600_000);
    assert!(2 * small.triangles.len() < whole.triangles.len());
    assert_eq!(open_edges(&small), 0);
}

#[test]
fn cells_of_any_size_close_a_sphere() {
    for cell in [0.4, 1.0, 2.5, 3.0, 4.0, 5.0, 6.0] {
        let mesh = mesh(&views(&Sphere, 24, 1.0), cell);
        assert_eq!(open_edges(&mesh), 0, "cells of {cell} pixels");
        assert!(quantile(&errors(&mesh, &Sphere), 1.0) < 0.2 * cell.max(2.0), "cells of {cell} pixels");
    }
}

#[test]
fn small_gaps_in_what_is_confirmed_are_filled_and_places_without_depth_stay_open() {
    let body = Cuboids(vec![[Vector3::new(-0.8, -0.8, -0.8), Vector3::new(0.8, 0.8, -0.5)]]);
    let gap = |x: usize, y: usize| (100..106).contains(&x) && (110..116).contains(&y);
    let seen = |confirmed: bool, depth: bool| {
        let mut view = view(&body, &Vector3::new(0.1, 0.0, DISTANCE));
        for y in 0..240 {
            for x in 0..240 {
                let wrong = gap(x, y) && view.depth[(x, y)] > 0.0;
                if wrong {
                    // Noise, or nothing.
                    view.depth[(x, y)] = if depth { 3.0 + 0.1 * (x % 3) as f32 } else { 0.0 };
                }
            }
        }
        view.confirmed = Some(Grid::from_fn(view.camera.size, |x, y| confirmed || !gap(x, y)));
        mesh(&[view], 1.5)
    };
    let exact = |mesh: &Mesh| quantile(&errors(mesh, &body), 1.0) < 0.5;
    let (filled, open) = (seen(false, true), seen(true, false));
    assert!(exact(&filled) && exact(&open) && !exact(&seen(true, true)));
    assert!(open_edges(&open) > open_edges(&filled) + 8);
}
