//! How a view shows its surfaces: colours, normals, and which pixels are at an edge.

use rayon::prelude::*;
use vamvs_core::{Grid, Rgb};

use crate::bits::{self, BitGrid};
use crate::normals::{fits_of_row, normal_in_cam};
use crate::packed_normal::PackedNormal;
use crate::photometric::FilteredView;
use crate::{FuseError, FuseOptions, FusionView, MaskedMap};

/// A view as the second pass needs it.
pub(crate) struct SeenView {
    pub filtered: FilteredView,
    pub colour: Grid<Rgb>,
    /// Normals in the world's frame.
    pub normal: Grid<PackedNormal>,
    /// Pixels whose whole 5×5 window lies on one surface. Others may show the colour of what is
    /// beside it.
    pub inner: BitGrid,
}

impl SeenView {
    /// Applies the photometric filter to view number `view`, and derives the normals unless it has some.
    pub fn new(view: usize, loaded: FusionView, options: &FuseOptions) -> Result<Self, FuseError> {
        loaded.check(view)?;
        let FusionView { map, mask, colour, normals } = loaded;
        let filtered = FilteredView::new(view, MaskedMap { map, mask }, options)?;
        let (normal, inner) = normals_in_world(&filtered, normals.as_ref());
        Ok(Self { filtered, colour, normal, inner })
    }

    /// Bytes held in memory.
    pub fn bytes(&self) -> usize {
        let rasters = self.filtered.size().area() * (size_of::<Rgb>() + size_of::<PackedNormal>());
        self.filtered.bytes() + rasters + self.inner.bytes()
    }
}

/// The normals of a view, and its pixels that are not at an edge.
fn normals_in_world(view: &FilteredView, given: Option<&Grid<[f32; 3]>>) -> (Grid<PackedNormal>, BitGrid) {
    let (size, world_from_cam) = (view.size(), view.cam_from_world.rotation.transpose().cast::<f32>());
    let (mut normals, mut inner) = (Grid::filled(size, PackedNormal::default()), BitGrid::zeros(size));
    let rows = normals.data_mut().par_chunks_mut(size.width.max(1)).zip(inner.rows_mut()).enumerate();
    rows.for_each(|(y, (normals, inner))| {
        for (x, (normal, fit)) in normals.iter_mut().zip(fits_of_row(view, y)).enumerate() {
            if view.inverse_depth[(x, y)] <= 0.0 {
                *normal = PackedNormal::new([0.0; 3]);
                continue;
            }
            if fit.inner {
                bits::set(inner, x);
            }
            let given = given.map(|given| given[(x, y)]).filter(|given| given != &[0.0; 3]);
            let fitted =
                || PackedNormal::new((world_from_cam * normal_in_cam(view, (x, y), fit.slopes)).into());
            *normal = given.map_or_else(fitted, PackedNormal::new);
        }
    });
    (normals, inner)
}
