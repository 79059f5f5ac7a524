//! Refinement on a GPU beside the same on the processor. Where there is no GPU, not even a software one, nothing is tested, which is
//! said.

#[path = "../../vamvs-refine/tests/common/mod.rs"]
mod common;

use std::sync::Mutex;

use common::{HERE, Set, disparity, render, seed, sources};
use vamvs_core::{DepthMap, Grid, Size};
use vamvs_gpu::{Gpu, adapters};
use vamvs_refine::matching::{Device, DeviceError, Matched, Matching};
use vamvs_refine::{RefineError, RefineOptions, Refined, refine_geometric_on, refine_on};

/// A GPU whose planes are compared with the processor's wherever it is asked for some.
#[derive(Debug)]
struct Compared {
    gpu: Gpu,
    /// For each time: pixels, those whose planes differ by more than 10⁻⁴, and of all others the largest difference of correlations.
    found: Mutex<Vec<(usize, usize, f32)>>,
}

impl Device for Compared {
    fn planes(&self, matching: &Matching<'_>) -> Result<Vec<Matched>, DeviceError> {
        let (found, expected) = (self.gpu.planes(matching)?, matching.on_processor());
        assert_eq!(found.len(), expected.len());
        let (mut differ, mut most) = (0, 0.0_f32);
        for (a, b) in found.iter().zip(&expected) {
            let same =
                a.plane[0] > 0.0 && (a.plane[0] - b.plane[0]).abs() < 1e-4 * b.plane[0] || a.plane == b.plane;
            differ += usize::from(!same);
            if same && a.best == b.best {
                most = most.max((a.correlation - b.correlation).abs());
            }
        }
        println!(
            "{} pixels, {:.3} % differ, correlations {most}",
            found.len(),
            100.0 * differ as f64 / found.len() as f64
        );
        self.found.lock().expect("no thread fails").push((found.len(), differ, most));
        Ok(found)
    }
}

/// The first adapter, whatever it is, or a line that says that nothing is tested.
fn gpu(largest_buffer: u64) -> Option<Gpu> {
    if adapters().is_empty() {
        println!("no GPU, not even a software one: nothing is tested");
        return None;
    }
    Some(Gpu::open_within(Some(0), largest_buffer).expect("the first GPU"))
}

/// Both passes over a set whose seed is half a pixel off, with masks and visibility.
fn refined(set: &Set, device: Option<&dyn Device>, halvings: usize) -> [Refined; 2] {
    let mut options = RefineOptions::default();
    options.halvings = halvings;
    options.beyond = 6.0;
    let visibility: Vec<Grid<f32>> = (1..set.photos.len())
        .map(|view| Grid::from_fn(Size::new(7, 5), |x, y| ((x + y * view) % 3) as f32 / 2.0))
        .collect();
    let first = refine_on(device, &set.photos[0], &sources(set), (&seed(set), &visibility), &options)
        .expect("the set fits together");
    let maps: Vec<DepthMap> = set.photos[1..]
        .iter()
        .map(|photo| common::true_map(common::sphere, photo, photo.camera.size))
        .collect();
    let maps: Vec<Option<&DepthMap>> =
        maps.iter().enumerate().map(|(view, map)| (view != 1).then_some(map)).collect();
    let second =
        refine_geometric_on(device, &set.photos[0], &sources(set), (&first.surface(), &maps), &options)
            .expect("the set fits together");
    [first, second]
}

/// The sphere before a wall, of which a part of the reference photograph is masked.
fn set() -> Set {
    let mut set = render(common::sphere, HERE);
    let size = set.photos[0].image.size();
    set.photos[0].mask = Some(Grid::from_fn(size, |x, y| x > 9 || y > 11));
    set
}

/// The share of pixels whose disparity differs by more than this.
fn apart(a: &Refined, b: &Refined, tolerance: f64) -> f64 {
    let depths = a.map.depth.data().iter().zip(b.map.depth.data());
    let differ =
        depths.filter(|(a, b)| **a != **b && (**a <= 0.0 || **b <= 0.0 || disparity(**a, **b) > tolerance));
    differ.count() as f64 / a.map.depth.data().len() as f64
}

#[test]
fn planes_and_their_correlations_are_those_of_the_processor() {
    let Some(gpu) = gpu(u64::MAX) else { return };
    let compared = Compared { gpu, found: Mutex::default() };
    let set = set();
    for halvings in [0, 1] {
        let on_gpu = refined(&set, Some(&compared), halvings);
        let on_processor = refined(&set, None, halvings);
        for (a, b) in on_gpu.iter().zip(&on_processor) {
            println!("differ by more than 0.02 and 0.5 pixels: {} {}", apart(a, b, 0.02), apart(a, b, 0.5));
            assert!(apart(a, b, 0.02) < 0.02 && apart(a, b, 0.5) < 0.005);
        }
    }
    let found = compared.found.into_inner().unwrap();
    // A seed at a quarter is searched at half, then once enlarged; and then comes the geometric pass.
    assert!(found.len() >= 5, "{found:?}");
    for (pixels, differ, correlation) in found {
        assert!(differ * 50 < pixels && correlation < 2e-3, "{differ} of {pixels}, {correlation}");
    }
}

#[test]
fn memory_that_does_not_suffice_is_told() {
    let Some(gpu) = gpu(1 << 14) else { return };
    let set = set();
    let refused =
        refine_on(Some(&gpu), &set.photos[0], &sources(&set), (&seed(&set), &[]), &RefineOptions::default());
    assert!(matches!(refused, Err(RefineError::Device(DeviceError::Memory(_)))), "{refused:?}");
}
