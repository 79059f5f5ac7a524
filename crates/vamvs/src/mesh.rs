//! From depth maps to a triangle mesh.

mod parts;

use std::borrow::Borrow;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use vamvs_core::{Grid, Mesh, Part};
use vamvs_fusion::{ConsistentViews, FuseError, FuseEvent, FuseJob, MapSource, Schedule};
use vamvs_io::atomic;
use vamvs_io::mesh::MeshFormat;
use vamvs_mesh::{Assembly, MeshOptions, MeshView, Mesher, Volume};

pub use parts::PartialMesh;

use crate::event::{OnEvent, tell};
use crate::fuse::{SPARE, lock, with_own_confidence, working_memory};
use crate::output::Lock;
use crate::view_map::InMemory;
use crate::{Event, FusionOptions, Maps, MemoryLimit, VamvsError, ViewMap};

/// The result of meshing.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct MeshSummary {
    /// The file.
    pub file: PathBuf,
    /// Vertices of the mesh.
    pub vertices: usize,
    /// Triangles of the mesh.
    pub triangles: usize,
    /// Time, with reading depth maps and writing the mesh.
    pub time: Duration,
}

/// Makes a mesh of depth maps and writes it to a file, of which the extension names the format: PLY, OBJ or GLB.
///
/// # Errors
/// As [`mesh_of`]; if the name has another extension, the file is there and not of the format, it cannot be written, or
/// no triangle is left: then nothing is written.
pub fn mesh(
    maps: &Maps,
    file: &Path,
    (options, fusion): (&MeshOptions, &FusionOptions),
    on_event: &mut OnEvent<'_>,
) -> Result<MeshSummary, VamvsError> {
    let begin = Instant::now();
    let _lock = prepare(maps, file)?;
    let mesh = mesh_of(maps, (options, fusion), on_event)?;
    write(maps, file, (&mesh, begin))
}

/// Checks that a mesh can go to a file, and keeps other runs from its folder.
fn prepare(maps: &Maps, file: &Path) -> Result<Option<Lock>, VamvsError> {
    let format = format_of(file)?;
    atomic::expect_kind(file, |begin| format.may_begin(begin))?;
    lock(maps, file)
}

fn format_of(file: &Path) -> Result<MeshFormat, VamvsError> {
    MeshFormat::of(file).ok_or_else(|| VamvsError::Folder {
        path: file.to_owned(),
        problem: "expected a name that ends in .ply, .obj or .glb, which are the formats of meshes"
            .to_owned(),
    })
}

/// Writes a mesh whose making began then.
fn write(maps: &Maps, file: &Path, (mesh, begin): (&Mesh, Instant)) -> Result<MeshSummary, VamvsError> {
    if mesh.triangles.is_empty() {
        let problem = "no triangle is left: no depth is confirmed by other views, or all pieces are smaller than \
                       --min-triangles; look at the depth maps, or at the cloud that `vamvs fuse` makes of them";
        return Err(VamvsError::Folder { path: maps.root().to_owned(), problem: problem.to_owned() });
    }
    vamvs_io::mesh::write(file, mesh, format_of(file)?)?;
    Ok(MeshSummary {
        file: file.to_owned(),
        vertices: mesh.positions.len(),
        triangles: mesh.triangles.len(),
        time: begin.elapsed(),
    })
}

/// Makes a mesh of depth maps: of the pixels that other views confirm, as in fusion.
///
/// # Errors
/// If an option is invalid, a depth map cannot be read, or `on_event` breaks.
pub fn mesh_of(
    maps: &Maps,
    (options, fusion): (&MeshOptions, &FusionOptions),
    on_event: &mut OnEvent<'_>,
) -> Result<Mesh, VamvsError> {
    fusion.validate()?;
    let fusion = with_own_confidence(maps, fusion)?;
    assemble(maps, &maps.neighbours(fusion.neighbours), (options, &fusion), on_event)
}

/// Makes a mesh of depth maps that are in memory, as [`mesh_of`].
///
/// # Errors
/// If an option is invalid or needs what maps in memory do not keep, a grid differs in size from its depth map, or `on_event` breaks.
pub fn mesh_in_memory<M: Borrow<ViewMap> + Sync>(
    maps: &[M],
    (options, fusion): (&MeshOptions, &FusionOptions),
    on_event: &mut OnEvent<'_>,
) -> Result<Mesh, VamvsError> {
    let maps = InMemory::new(maps, fusion)?;
    assemble(&maps, &maps.neighbours(fusion.neighbours), (options, fusion), on_event)
}

/// Makes a mesh of depth maps from anywhere.
fn assemble<S: MapSource + ?Sized>(
    source: &S,
    neighbours: &[Vec<usize>],
    (options, fusion): (&MeshOptions, &FusionOptions),
    on_event: &mut OnEvent<'_>,
) -> Result<Mesh, VamvsError> {
    let (filter, memory) = (&fusion.filter, working_memory(fusion.max_memory));
    let job = FuseJob { source, neighbours, options: filter, roi: fusion.roi, memory };
    let schedule = Schedule::new(neighbours, source.len())?;
    let (mut done, mut total) = (0, 2 * source.len() + 1);
    let mut progress = |_: FuseEvent| {
        done += 1;
        on_event(Event::Mesh { done, total })
    };
    let (pixels, _) = vamvs_fusion::confirm(&job, &schedule, Part::WHOLE, &mut progress)?;
    let load = |view| confirmed(source, view, &pixels);
    let mut mesher = Mesher::new(options.clone(), memory_for(fusion.max_memory), load)?;
    let mut outlines = Vec::with_capacity(source.len());
    for view in 0..source.len() {
        outlines.push(mesher.outline(view)?);
        done += 1;
        tell(on_event, Event::Mesh { done, total })?;
    }
    let volume = mesher.volume(outlines);
    warn_of_cells(&volume, options, fusion.max_memory, on_event)?;
    let blocks = volume.blocks(Part::WHOLE);
    total += blocks.len();
    let mut surfaces = Assembly::default();
    for block in blocks {
        surfaces.push(mesher.surface(&volume, &block)?);
        done += 1;
        tell(on_event, Event::Mesh { done, total })?;
    }
    let mesh = mesher.finish(&volume, surfaces)?;
    tell(on_event, Event::Mesh { done: total, total })?;
    Ok(mesh)
}

/// The memory for views and their mesh, bytes. It follows from the limit alone, so that all processes of a mesh agree on it.
fn memory_for(limit: MemoryLimit) -> u64 {
    let bytes = limit.bytes();
    bytes - bytes / SPARE
}

/// Says so if cells are larger than was asked for.
fn warn_of_cells(
    volume: &Volume,
    options: &MeshOptions,
    limit: MemoryLimit,
    on_event: &mut OnEvent<'_>,
) -> Result<(), VamvsError> {
    if volume.cell() <= options.cell {
        return Ok(());
    }
    let text = format!(
        "a mesh with cells of {} pixels (--cell) would take more memory than the limit of {limit}: it is made with cells of {:.1}",
        options.cell,
        volume.cell()
    );
    tell(on_event, Event::Warning(text))
}

/// A view with what other views confirm of it.
fn confirmed<S: MapSource + ?Sized>(
    source: &S,
    view: usize,
    pixels: &ConsistentViews,
) -> Result<MeshView, VamvsError> {
    let loaded = source.load(view).map_err(|error| FuseError::Load { view, source: error.into() })?;
    let map = loaded.map;
    let (camera, cam_from_world, mut depth) = (map.camera, map.cam_from_world, map.depth);
    if let Some(mask) = loaded.mask {
        let masked = depth.data_mut().iter_mut().zip(mask.data()).filter(|(_, counts)| !**counts);
        masked.for_each(|(depth, _)| *depth = 0.0);
    }
    let is_confirmed = |x, y| pixels.get(&view).is_some_and(|pixels| pixels.contains(x, y));
    let confirmed = Some(Grid::from_fn(depth.size(), is_confirmed));
    let (sigma, normals, colour) = (loaded.sigma, loaded.normals, loaded.colour);
    Ok(MeshView { camera, cam_from_world, depth, confirmed, sigma, normals, colour })
}
