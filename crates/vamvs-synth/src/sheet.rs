//! The contact sheet of a scene: its photographs, depth and visibility at a glance.

use vamvs_core::{Grid, Rgb, Size, Visibility};
use vamvs_picture::{Scale, map, panel};

/// Largest number of views on a sheet.
const VIEWS: usize = 9;

/// Width of a picture, pixels.
const WIDTH: usize = 192;

/// Rows of pictures, one column per view.
#[derive(Clone, Debug, Default)]
pub(crate) struct Sheet {
    photographs: Vec<Grid<Rgb>>,
    depths: Vec<Grid<Rgb>>,
    /// The share of the other views that see each pixel.
    seen: Vec<Grid<Rgb>>,
    /// Visibility of the first view's pixels in each view.
    first: Vec<Grid<Rgb>>,
}

impl Sheet {
    /// Adds a view, unless the sheet is full.
    pub fn add(&mut self, photograph: &Grid<Rgb>, depth: &Grid<f32>, visibility: &[Grid<Visibility>]) {
        if self.photographs.len() == VIEWS {
            return;
        }
        if self.photographs.is_empty() {
            self.first = visibility.iter().take(VIEWS).map(|tile| tile.map(|&v| colour(v))).collect();
        }
        let depth = map::valid(depth);
        let (near, far) = map::spread(&depth);
        self.photographs.push(photograph.clone());
        self.depths.push(Scale::Turbo.paint(&depth, near, far));
        let own = self.seen.len();
        self.seen.push(Scale::Confidence.paint(&share_of_views(own, visibility), 0.0, 1.0));
    }

    /// The sheet. Its rows, from the top: photographs; depth (blue is near); the share of the other views that
    /// see a pixel (yellow is all); visibility of the first view's pixels in each view (green visible, red
    /// occluded, blue out of view).
    pub fn paint(&self) -> Grid<Rgb> {
        let size = self.photographs.first().map_or(Size::new(0, 0), Grid::size);
        let size = panel::of_width(size, WIDTH.min(size.width));
        let rows = [&self.photographs, &self.depths, &self.seen, &self.first];
        panel::column(&rows.map(|row| panel::row(row, size)))
    }
}

/// The share of the views other than `own` that see each pixel's surface.
fn share_of_views(own: usize, visibility: &[Grid<Visibility>]) -> Grid<Option<f32>> {
    let others = visibility.len().saturating_sub(1).max(1) as f32;
    let share = |x, y| {
        let seen = |tile: &Grid<Visibility>| tile[(x, y)] == Visibility::Visible;
        let count = visibility.iter().enumerate().filter(|(view, tile)| *view != own && seen(tile)).count();
        (visibility[own][(x, y)] != Visibility::None).then_some(count as f32 / others)
    };
    Grid::from_fn(visibility[own].size(), share)
}

fn colour(visibility: Visibility) -> Rgb {
    match visibility {
        Visibility::None => [150, 150, 155],
        Visibility::OutOfView => [86, 110, 180],
        Visibility::Occluded => [205, 70, 50],
        Visibility::Visible => [120, 190, 110],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_count_the_other_views_only() {
        let tile = |visibility| Grid::filled(Size::new(1, 1), visibility);
        use Visibility::{None, Occluded, Visible};
        let tiles = [Visible, Visible, Occluded].map(tile);
        assert_eq!(share_of_views(0, &tiles).data(), [Some(0.5)]);
        assert_eq!(share_of_views(2, &tiles).data(), [Some(1.0)]);
        assert_eq!(share_of_views(0, &[None, None].map(tile)).data(), [Option::None]);
    }

    #[test]
    fn a_sheet_has_four_rows_and_at_most_nine_columns() {
        let size = Size::new(8, 6);
        let visibility = vec![Grid::filled(size, Visibility::Visible); 12];
        let mut sheet = Sheet::default();
        for _ in 0..12 {
            sheet.add(&Grid::filled(size, [7; 3]), &Grid::filled(size, 1.0), &visibility);
        }
        let row = panel::row(&sheet.photographs, size);
        assert_eq!(sheet.photographs.len(), VIEWS);
        assert_eq!(sheet.paint().width(), row.width());
        assert!(sheet.paint().height() >= 4 * size.height);
    }
}
