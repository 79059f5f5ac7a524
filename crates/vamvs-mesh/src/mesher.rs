//! From views to a mesh, block by block.

use std::sync::Arc;

use vamvs_core::{Mesh, Part};

use crate::assembly::{Assembly, BlockSurface};
use crate::holes::Holes;
use crate::outline::Outline;
use crate::stock::Stock;
use crate::view::SeenView;
use crate::volume::{Block, Volume};
use crate::{MeshError, MeshOptions, MeshView, components, manifold, simplify};

/// Makes a mesh of views, which `load` gives by number, more than once if they do not all have room.
pub struct Mesher<L> {
    options: MeshOptions,
    load: L,
    memory: u64,
    stock: Stock,
}

impl<L, E> Mesher<L>
where
    L: FnMut(usize) -> Result<MeshView, E>,
    E: From<MeshError>,
{
    /// A mesher that keeps views and their mesh below `memory` bytes where it can: the views of a block must be there at the same
    /// time.
    ///
    /// # Errors
    /// If an option is out of its range.
    pub fn new(options: MeshOptions, memory: u64, load: L) -> Result<Self, MeshError> {
        options.validate()?;
        Ok(Self { options, load, memory, stock: Stock::new(memory) })
    }

    /// A view in short.
    ///
    /// # Errors
    /// If it cannot be loaded, or a raster has another size than the camera.
    pub fn outline(&mut self, view: usize) -> Result<Outline, E> {
        Ok(Outline::of(&self.views(&[view])?[0], &self.options))
    }

    /// The volume around all that the views see, in their order.
    pub fn volume(&mut self, outlines: Vec<Outline>) -> Volume {
        let views: u64 = outlines.iter().map(Outline::view_bytes).sum();
        let volume = Volume::around(outlines, self.options.cell, self.memory - views.min(self.memory / 2));
        self.stock.room = self.memory.saturating_sub(volume.bytes());
        volume
    }

    /// The surface in a block of the volume.
    ///
    /// # Errors
    /// As [`Mesher::outline`].
    pub fn surface(&mut self, volume: &Volume, block: &Block) -> Result<BlockSurface, E> {
        Ok(volume.surface(block, &self.views(&block.views)?))
    }

    /// The mesh of the surfaces in all blocks of the volume. It has no triangles if no view sees anything.
    ///
    /// # Errors
    /// As [`Mesher::outline`].
    pub fn finish(&mut self, volume: &Volume, surfaces: Assembly) -> Result<Mesh, E> {
        let mut mesh = surfaces.finish(volume.origin().into());
        manifold::separate(&mut mesh);
        components::remove_small(&mut mesh, self.options.min_triangles);
        self.close_holes(volume, &mut mesh)?;
        if let Some(triangles) = self.options.triangles {
            let all = mesh.triangles.len();
            let wanted = if triangles < 1.0 { triangles * all as f64 } else { triangles };
            simplify::reduce(&mut mesh, wanted as usize);
            manifold::separate(&mut mesh);
        }
        mesh.set_normals();
        Ok(mesh)
    }

    fn close_holes(&mut self, volume: &Volume, mesh: &mut Mesh) -> Result<(), E> {
        if self.options.close_holes == 0 {
            return Ok(());
        }
        let mut holes = Holes::of(mesh, self.options.close_holes);
        for view in 0..volume.views() {
            if holes.places().any(|place| volume.may_see(view, place)) {
                self.views(&[view])?.iter().for_each(|view| holes.look(view));
            }
        }
        holes.close(mesh);
        Ok(())
    }

    fn views(&mut self, wanted: &[usize]) -> Result<Vec<Arc<SeenView>>, E> {
        let load = &mut self.load;
        self.stock.get(wanted, |view| Ok(SeenView::new(view, load(view)?)?))
    }

    /// The mesh of so many views.
    ///
    /// # Errors
    /// As [`Mesher::outline`].
    pub fn mesh(&mut self, views: usize) -> Result<Mesh, E> {
        let outlines = (0..views).map(|view| self.outline(view)).collect::<Result<_, E>>()?;
        let volume = self.volume(outlines);
        let mut surfaces = Assembly::default();
        for block in volume.blocks(Part::WHOLE) {
            surfaces.push(self.surface(&volume, &block)?);
        }
        self.finish(&volume, surfaces)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;
    use vamvs_core::{Grid, Intrinsics, Pinhole, Pose, Size};

    /// A view of the plane at depth 64 from another place along x.
    fn view(number: usize) -> MeshView {
        let size = Size::new(60, 40);
        let intrinsics = Intrinsics { fx: 800.0, fy: 800.0, cx: 30.0, cy: 20.0 };
        MeshView {
            camera: Pinhole { size, intrinsics },
            cam_from_world: Pose {
                translation: Vector3::new(-3.5 * number as f64, 0.0, 0.0),
                ..Pose::identity()
            },
            depth: Grid::filled(size, 64.0),
            confirmed: None,
            sigma: None,
            normals: None,
            colour: Grid::filled(size, [20 * number as u8, 100, 200]),
        }
    }

    #[test]
    fn blocks_with_few_views_at_a_time_make_the_same_mesh() {
        const VIEWS: usize = 12;
        let mut loaded = 0;
        let load = |number: usize| {
            loaded += 1;
            Ok::<_, MeshError>(view(number))
        };
        let options = MeshOptions::default();
        let whole = Mesher::new(options.clone(), u64::MAX, |number| Ok::<_, MeshError>(view(number)));
        let whole = whole.expect("valid options").mesh(VIEWS).expect("a mesh");
        assert!(whole.triangles.len() > 4000, "{}", whole.triangles.len());

        let mut mesher = Mesher::new(options, u64::MAX, load).expect("valid options");
        mesher.stock.room = 0;
        let outlines = (0..VIEWS).map(|view| mesher.outline(view)).collect::<Result<_, _>>();
        let volume = mesher.volume(outlines.expect("outlines"));
        let mut surfaces = Assembly::default();
        let blocks: Vec<Block> = Part::all(2).flat_map(|part| volume.blocks_of(part, 9)).collect();
        assert!(blocks.len() > 8, "{}", blocks.len());
        assert!(blocks.iter().any(|block| block.views.len() < VIEWS / 2), "a block is seen by few views");
        for block in &blocks {
            mesher.stock.room = 2 * SeenView::bytes_of(Size::new(60, 40));
            surfaces.push(mesher.surface(&volume, block).expect("a surface"));
        }
        assert!(mesher.finish(&volume, surfaces).expect("a mesh") == whole);
        assert!(loaded > 2 * VIEWS, "views are loaded again: {loaded}");
    }
}
