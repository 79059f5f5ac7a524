//! Ready-made rendered scenes.

use std::sync::{Arc, LazyLock};

use nalgebra::{Similarity3, UnitQuaternion, Vector3};
use vamvs_core::Size;
use vamvs_synth::pattern::Motif;
use vamvs_synth::{Object, RenderOptions, Tracer, World, primitive};

use crate::render::{Rendered, render};
use crate::rig::{self, TARGET};
use crate::texture::Look;
use crate::{sky, still_life};

/// Fast rendering with enough texture for matching: 4 samples a pixel, one bounce, denoised.
const QUICK: RenderOptions = RenderOptions { samples: 4, max_bounces: 1, denoise: true };

static STILL_LIFE: LazyLock<Tracer> = LazyLock::new(|| Tracer::new(&still_life::world()));
static PLANE: LazyLock<Tracer> = LazyLock::new(|| Tracer::new(&plane_world()));

/// A textured plane through the cameras' target. It is fronto-parallel to no camera and fills every view.
#[must_use]
pub fn tilted_plane(size: Size, views: usize) -> Vec<Rendered> {
    render(&PLANE, &rig::arc(views, size), &QUICK)
}

/// Objects on a tiled floor in front of a brick wall, photographed along an arc; every pixel shows a
/// surface.
#[must_use]
pub fn still_life(size: Size, views: usize) -> Vec<Rendered> {
    render(still_life_tracer(), &rig::arc(views, size), &QUICK)
}

/// The ray tracer of [`still_life`]'s world, built once.
#[must_use]
pub fn still_life_tracer() -> &'static Tracer {
    &STILL_LIFE
}

fn plane_world() -> World {
    let marble = Look {
        motif: Motif::Marble,
        count: 4,
        colours: [[70.0, 100.0, 130.0], [150.0, 150.0, 140.0], [225.0, 205.0, 165.0]],
        metres: 1.5,
        coat: [0.0, 0.5],
    };
    let rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.15)
        * UnitQuaternion::from_axis_angle(&Vector3::x_axis(), 0.75);
    let plane = Object {
        mesh: Arc::new(primitive::rectangle([100.0, 100.0])),
        material: marble.material(1),
        world_from_object: Similarity3::from_parts(TARGET.into(), rotation, 1.0),
    };
    World { objects: vec![plane], environment: sky::dim(), lamps: vec![] }
}
