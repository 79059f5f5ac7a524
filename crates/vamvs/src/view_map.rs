//! Depth maps in memory.

use std::borrow::Borrow;
use std::collections::HashMap;
use std::convert::Infallible;

use vamvs_core::{Cloud, DepthMap, Grid, Pinhole, Rgb, Scene, Size, Source, View, view_selection};
use vamvs_fusion::{FusedPoints, FusionView, MapSource, MaskedMap};

use crate::event::OnEvent;
use crate::fuse::merge;
use crate::{FusionOptions, VamvsError};

/// A depth map with all that fusion needs of its view.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewMap {
    /// The name: that of the photograph without extension, with `@8` or `@4` added for the coarse
    /// maps of a fovea.
    pub name: String,
    /// The view, an index into the scene's.
    pub view: usize,
    /// Depth and confidence, with their camera and pose.
    pub map: DepthMap,
    /// Unit normals in the world's frame, towards the camera, 0 where there is no depth; `None` without refinement.
    pub normals: Option<Grid<[f32; 3]>>,
    /// Standard deviations of the depths, scene units, 0 where there is none; `None` without refinement.
    pub sigma: Option<Grid<f32>>,
    /// The undistorted photograph at the depth map's size.
    pub colour: Grid<Rgb>,
    /// Other views of the scene that may see the same surfaces, best first. If a map has
    /// none, such as one of the program's own, fusion chooses those of all maps from the cameras.
    pub neighbours: Vec<Source>,
}

/// Fuses depth maps that are in memory into a cloud in memory.
///
/// # Errors
/// If an option is invalid or needs what maps in memory do not keep, a grid differs in size from its depth map, or `on_event` breaks.
pub fn fuse_in_memory<M: Borrow<ViewMap> + Sync>(
    maps: &[M],
    options: &FusionOptions,
    on_event: &mut OnEvent<'_>,
) -> Result<Cloud, VamvsError> {
    let maps = InMemory::new(maps, options)?;
    let mut cloud = Cloud::new();
    let mut sink = |fused: &FusedPoints| {
        cloud.extend_from_slice(fused.points());
        Ok(())
    };
    merge(&maps, &maps.neighbours(options.neighbours), options, &mut sink, on_event)?;
    Ok(cloud)
}

/// Depth maps in memory, as fusion and meshing take them.
pub(crate) struct InMemory<'a>(Vec<&'a ViewMap>);

impl<'a> InMemory<'a> {
    /// Checks the options, which must not need what maps in memory do not keep.
    pub fn new<M: Borrow<ViewMap>>(maps: &'a [M], options: &FusionOptions) -> Result<Self, VamvsError> {
        options.validate()?;
        if options.network_confidence {
            let problem = "the least confidence is given as the network's probability (network-confidence), which depth maps in memory do not keep: give it as their confidence";
            return Err(VamvsError::Request(problem.to_owned()));
        }
        Ok(Self(maps.iter().map(Borrow::borrow).collect()))
    }

    /// For each map, the maps of at most `count` other views that see the same surfaces.
    pub fn neighbours(&self, count: usize) -> Vec<Vec<usize>> {
        let maps = &self.0;
        if maps.iter().any(|map| map.neighbours.is_empty()) {
            return by_cameras(maps, count);
        }
        let mut of_view: HashMap<usize, Vec<usize>> = HashMap::new();
        for (number, map) in maps.iter().enumerate() {
            of_view.entry(map.view).or_default().push(number);
        }
        let maps_of = |source: &Source| of_view.get(&source.view).cloned().unwrap_or_default();
        let there = |source: &&Source| of_view.contains_key(&source.view);
        let others =
            |map: &&ViewMap| map.neighbours.iter().filter(there).take(count).flat_map(maps_of).collect();
        maps.iter().map(others).collect()
    }
}

impl MapSource for InMemory<'_> {
    type Error = Infallible;

    fn len(&self) -> usize {
        self.0.len()
    }

    fn load(&self, view: usize) -> Result<FusionView, Infallible> {
        let ViewMap { map, normals, sigma, colour, .. } = self.0[view].to_owned();
        Ok(FusionView { map, mask: None, colour, normals, sigma })
    }

    fn load_map(&self, view: usize) -> Result<MaskedMap, Infallible> {
        Ok(MaskedMap { map: self.0[view].map.clone(), mask: None })
    }

    fn load_colour(&self, view: usize, _size: Size) -> Result<Grid<Rgb>, Infallible> {
        Ok(self.0[view].colour.clone())
    }

    fn load_normals(&self, view: usize) -> Result<Option<Grid<[f32; 3]>>, Infallible> {
        Ok(self.0[view].normals.clone())
    }

    fn load_sigma(&self, view: usize) -> Result<Option<Grid<f32>>, Infallible> {
        Ok(self.0[view].sigma.clone())
    }
}

fn by_cameras(maps: &[&ViewMap], count: usize) -> Vec<Vec<usize>> {
    let view = |(id, map): (usize, &&ViewMap)| View {
        id: id as u32,
        name: map.name.clone(),
        camera: map.map.camera.into(),
        cam_from_world: map.map.cam_from_world,
        depth_range: None,
    };
    let views = maps.iter().enumerate().map(view).collect();
    let scene = Scene { views, points: Vec::new(), pairs: None };
    let cameras: Vec<Pinhole> = maps.iter().map(|map| map.map.camera).collect();
    let selected = view_selection::select(&scene, &cameras, count);
    selected.iter().map(|sources| sources.iter().map(|source| source.view).collect()).collect()
}
