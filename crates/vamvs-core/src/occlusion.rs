//! Decides which views see the points of a cloud that has no tracks.
//!
//! Each view's image is divided into square cells. A view sees a point if it lies in the image and no point of its
//! cell or of the eight neighbouring cells occludes it. Points are sparse, so occlusion is found only where there
//! are points on the occluding surface.

use nalgebra::Vector3;

use crate::{Grid, Size, SparsePoint, View};

/// Number of cells along the longer side of an image.
const CELLS: f64 = 64.0;

/// A point occludes another one if its depth is less than this share of the other's.
const BEFORE: f64 = 0.9;

/// A point in a view: the cell (x, y) that it lies in, and its depth z in scene units.
type Seen = ((usize, usize), f64);

/// The points, each with the indices of the views that see it; some may be seen by none.
#[must_use]
pub fn points_with_views(points: Vec<Vector3<f64>>, views: &[View]) -> Vec<SparsePoint> {
    let unseen = |x_in_world| SparsePoint { x_in_world, views: Vec::new() };
    let mut points: Vec<SparsePoint> = points.into_iter().map(unseen).collect();
    for (number, view) in views.iter().enumerate() {
        let places: Vec<Option<Seen>> = points.iter().map(|point| place(view, &point.x_in_world)).collect();
        let nearest = nearest_around(&nearest(view, places.iter().flatten()));
        let is_seen = |&(cell, depth): &Seen| nearest[cell] >= BEFORE * depth;
        let seen = points.iter_mut().zip(&places).filter(|(_, place)| place.as_ref().is_some_and(is_seen));
        seen.for_each(|(point, _)| point.views.push(number));
    }
    points
}

/// The cell and depth of a point in a view; `None` if it is not in the image.
fn place(view: &View, x_in_world: &Vector3<f64>) -> Option<Seen> {
    let x_in_cam = view.cam_from_world.transform(x_in_world);
    let pixel = view.camera.project(&x_in_cam)?;
    let Size { width, height } = view.camera.size;
    let inside = (0.0..width as f64).contains(&pixel.x) && (0.0..height as f64).contains(&pixel.y);
    let cell = cell_side(view.camera.size);
    inside.then(|| (((pixel.x / cell) as usize, (pixel.y / cell) as usize), x_in_cam.z))
}

/// Side of a cell in pixels, at least 1.
fn cell_side(size: Size) -> f64 {
    (size.longer_side() as f64 / CELLS).max(1.0)
}

/// The least depth in each cell; infinity where there is no point.
fn nearest<'a>(view: &View, places: impl Iterator<Item = &'a Seen>) -> Grid<f64> {
    let cells = |side: usize| (side as f64 / cell_side(view.camera.size)).ceil() as usize;
    let Size { width, height } = view.camera.size;
    let mut nearest = Grid::filled(Size::new(cells(width), cells(height)), f64::INFINITY);
    places.for_each(|&(cell, depth)| nearest[cell] = nearest[cell].min(depth));
    nearest
}

/// The least depth in each cell and its eight neighbours.
fn nearest_around(nearest: &Grid<f64>) -> Grid<f64> {
    let around = |at: usize| at.saturating_sub(1)..=at + 1;
    Grid::from_fn(nearest.size(), |x, y| {
        let cells = around(y).flat_map(|y| around(x).map(move |x| (x, y)));
        cells.filter_map(|(x, y)| nearest.get(x, y)).fold(f64::INFINITY, |least, &depth| least.min(depth))
    })
}

#[cfg(test)]
mod tests {
    use crate::{Intrinsics, Pinhole, Pose};

    use super::*;

    fn view(eye: [f64; 3]) -> View {
        let intrinsics = Intrinsics { fx: 300.0, fy: 300.0, cx: 160.0, cy: 120.0 };
        let camera = Pinhole { size: Size::new(320, 240), intrinsics }.into();
        let cam_from_world = Pose::look_at(&Vector3::from(eye), &Vector3::zeros(), &Vector3::y());
        View { id: 0, name: "a.png".to_owned(), camera, cam_from_world, depth_range: None }
    }

    /// A wall of 41×41 points at `z`, with x and y from −1 to 1.
    fn wall(z: f64) -> impl Iterator<Item = Vector3<f64>> {
        let at = |i: usize| -1.0 + i as f64 / 20.0;
        (0..41 * 41).map(move |i| Vector3::new(at(i % 41), at(i / 41), z))
    }

    #[test]
    fn each_of_two_walls_hides_the_other_from_its_own_side() {
        let points: Vec<_> = wall(-0.5).chain(wall(0.5)).collect();
        let seen = points_with_views(points, &[view([0.0, 0.0, -4.0]), view([0.1, 0.0, 4.0])]);
        // Both views see the margin of the farther wall, which the nearer wall does not cover.
        let inner = |point: &&SparsePoint| point.x_in_world.xy().amax() < 0.875;
        let [mut front, mut back] = [0, 0];
        for point in seen.iter().filter(inner) {
            let expected = usize::from(point.x_in_world.z > 0.0);
            assert_eq!(point.views, [expected], "{}", point.x_in_world);
            if expected == 0 { front += 1 } else { back += 1 }
        }
        assert_eq!((front, back), (35 * 35, 35 * 35));
    }

    #[test]
    fn a_slanted_surface_does_not_hide_itself_and_what_is_beside_or_behind_is_not_seen() {
        let slanted = |i: usize| {
            let (x, y) = ((i % 41) as f64 / 20.0 - 1.0, (i / 41) as f64 / 20.0 - 1.0);
            Vector3::new(x, y, 0.7 * x)
        };
        let mut points: Vec<_> = (0..41 * 41).map(slanted).collect();
        points.extend([Vector3::new(9.0, 0.0, 0.0), Vector3::new(0.0, 0.0, -5.0)]);
        let seen = points_with_views(points, &[view([0.0, 0.0, -4.0])]);
        let (surface, others) = seen.split_at(41 * 41);
        assert!(surface.iter().all(|point| point.views == [0]));
        assert!(others.iter().all(|point| point.views.is_empty()));
    }
}
