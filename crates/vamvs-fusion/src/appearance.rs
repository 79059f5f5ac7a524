//! How a view shows its surfaces: colours, normals, and which pixels are at an edge.

use nalgebra::Matrix3;
use rayon::prelude::*;
use vamvs_core::{Grid, Rgb};

use crate::normals::{directions_of_row, fits_of_row};
use crate::packed_normal::{PackedNormal, pack};
use crate::photometric::FilteredView;
use crate::source::expect_sizes;
use crate::{FuseError, FuseOptions, MapSource};

/// A view as the second pass needs it.
pub(crate) struct SeenView {
    pub filtered: FilteredView,
    pub look: Grid<Look>,
}

/// What a pixel shows of a surface.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Look {
    /// Normal in the world's frame.
    pub normal: PackedNormal,
    pub colour: Rgb,
    /// Whether the whole 5×5 window lies on one surface. If not, the colour may be that of what is
    /// beside it.
    pub inner: bool,
}

impl SeenView {
    /// Loads view number `view` part by part, applies the photometric filter, and derives the normals unless it has some.
    pub fn load<S: MapSource + ?Sized>(
        view: usize,
        source: &S,
        options: &FuseOptions,
    ) -> Result<Self, FuseError> {
        let filtered = FilteredView::load(view, source, options)?;
        let size = filtered.size();
        let mut seen = Self { filtered, look: Grid::filled(size, Look::default()) };
        let normals = source.load_normals(view).map_err(FuseError::loading(view))?;
        expect_sizes(view, size, &[("a map of normals", normals.as_ref().map(Grid::size))])?;
        seen.find_normals(normals.as_ref());
        drop(normals);
        let colours = source.load_colour(view, size).map_err(FuseError::loading(view))?;
        expect_sizes(view, size, &[("a colour image", Some(colours.size()))])?;
        seen.look.data_mut().iter_mut().zip(colours.data()).for_each(|(look, colour)| look.colour = *colour);
        Ok(seen)
    }

    /// Bytes held in memory.
    pub fn bytes(&self) -> usize {
        self.filtered.bytes() + self.filtered.size().area() * size_of::<Look>()
    }

    /// Finds the normals, unless they are given, and the pixels that are not at an edge.
    fn find_normals(&mut self, given: Option<&Grid<[f32; 3]>>) {
        let world_from_cam = self.filtered.cam_from_world.rotation.transpose().cast::<f32>();
        let (view, width) = (&self.filtered, self.filtered.size().width.max(1));
        self.look.data_mut().par_chunks_mut(width).enumerate().for_each(|(y, looks)| {
            let given = given.map(|given| given.row(y));
            let directions = directions(view, y, (given, &world_from_cam), looks);
            let mut normals = vec![PackedNormal::default(); width];
            pack(&directions, &mut normals);
            looks.iter_mut().zip(normals).for_each(|(look, normal)| look.normal = normal);
        });
    }
}

/// Directions along the normals of a row's pixels in the world's frame, 0 where there is no depth. Says in `looks`
/// which pixels are not at an edge.
fn directions(
    view: &FilteredView,
    y: usize,
    (given, world_from_cam): (Option<&[[f32; 3]]>, &Matrix3<f32>),
    looks: &mut [Look],
) -> Vec<[f32; 3]> {
    let fits = fits_of_row(view, y);
    let mut directions = directions_of_row(view, y, &fits, world_from_cam);
    for (x, (direction, fit)) in directions.iter_mut().zip(&fits).enumerate() {
        if view.inverse_depth((x, y)) <= 0.0 {
            *direction = [0.0; 3];
            continue;
        }
        looks[x].inner = fit.inner;
        if let Some(given) = given.map(|given| given[x]).filter(|given| given != &[0.0; 3]) {
            *direction = given;
        }
    }
    directions
}
