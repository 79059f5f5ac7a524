//! The radiance of rendered views.

use std::f64::consts::PI;
use std::sync::Arc;

use nalgebra::Vector3;
use vamvs_core::{Grid, Pinhole, Pose, Size};
use vamvs_synth::{Environment, Material, Object, RenderOptions, Shot, Tracer, World, primitive};

use crate::worlds::{lamp, matt, object, pixels, still_life, uniform_sky, view, world};

const WHITE: [u8; 3] = [255; 3];

fn noisy(samples: usize, max_bounces: usize) -> RenderOptions {
    RenderOptions { samples, max_bounces, denoise: false }
}

fn shoot(world: &World, view: &(Pinhole, Pose), options: &RenderOptions, seed: u64) -> Shot {
    Tracer::new(world).shoot(&view.0, &view.1, options, seed)
}

/// Green radiance of the pixels that show a surface.
fn of_surfaces(shot: &Shot) -> impl Iterator<Item = f64> + '_ {
    let pixels = shot.radiance.data().iter().zip(shot.ground_truth.id.data());
    pixels.filter(|&(_, &id)| id > 0).map(|(light, _)| f64::from(light[1]))
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0), |(sum, count), value| (sum + value, count + 1));
    sum / f64::from(count)
}

fn coated(specular: f32, roughness: f32) -> Material {
    Material { specular, roughness, ..matt(WHITE) }
}

fn white_things(material: &Material) -> Vec<Object> {
    let mut things = still_life();
    things[1].mesh = Arc::new(primitive::sphere(0.5, 48));
    things[3].mesh = Arc::new(primitive::torus(0.4, 0.12, 96));
    things.iter_mut().for_each(|thing| thing.material = material.clone());
    things
}

/// White furnace test: white things in a white sky cannot be distinguished from it.
#[test]
fn white_things_vanish_in_a_white_sky() {
    let camera = view(Size::new(48, 36), [2.0, -2.5, 1.6], [0.0, 0.0, 0.3]);
    let shot =
        shoot(&world(white_things(&matt(WHITE)), uniform_sky(1.0), vec![]), &camera, &noisy(128, 200), 1);
    let light = mean(of_surfaces(&shot));
    assert!((light - 1.0).abs() < 3e-3, "{light}");
    // Means over groups of rows, so that noise is small.
    for rows in shot.radiance.data().chunks(48 * 4) {
        let light = mean(rows.iter().map(|light| f64::from(light[0])));
        assert!((light - 1.0).abs() < 0.02, "{light}");
    }
}

#[test]
fn coats_gain_no_energy() {
    let camera = view(Size::new(40, 30), [2.0, -2.5, 1.6], [0.0, 0.0, 0.3]);
    for (specular, roughness) in [(0.04, 0.15), (0.04, 0.6), (0.6, 0.4)] {
        let things = white_things(&coated(specular, roughness));
        let shot = shoot(&world(things, uniform_sky(1.0), vec![]), &camera, &noisy(64, 200), 1);
        let light = mean(of_surfaces(&shot));
        assert!(light < 1.005 && light > 0.97, "specular {specular}, roughness {roughness}: {light}");
    }
}

/// A world with interreflections, coats, a lamp, and a sky with a bright spot.
fn lively_world() -> World {
    let mut things = still_life();
    things[1].material = Material { specular: 0.5, roughness: 0.2, ..matt([200, 150, 60]) };
    things[3].material = Material { specular: 0.04, roughness: 0.4, ..matt([60, 90, 220]) };
    let map = Grid::from_fn(Size::new(32, 16), |x, y| if (x, y) == (9, 4) { [40.0; 3] } else { [0.3; 3] });
    let sky = Environment { map: Arc::new(map), rotation: 0.4, strength: 1.0 };
    world(things, sky, vec![lamp([0.0, 0.5, 2.0], 0.3, 6.0)])
}

/// A few paths per pixel are noisy, but on average give the same radiance as many.
#[test]
fn the_mean_of_noisy_renders_is_the_light_of_a_fine_one() {
    let camera = view(Size::new(32, 24), [2.0, -2.5, 1.6], [0.0, 0.0, 0.3]);
    let tracer = Tracer::new(&lively_world());
    let render = |samples, seed| tracer.shoot(&camera.0, &camera.1, &noisy(samples, 8), seed).radiance;
    let fine = render(2048, 1);
    let mut sum = Grid::filled(camera.0.size, [0.0_f64; 3]);
    let renders = 512;
    for seed in 0..renders {
        for (sum, light) in sum.data_mut().iter_mut().zip(render(2, 100 + seed).data()) {
            sum.iter_mut().zip(light).for_each(|(sum, &light)| *sum += f64::from(light) / renders as f64);
        }
    }
    for (coarse, fine) in sum.data().chunks(32 * 6).zip(fine.data().chunks(32 * 6)) {
        let coarse = mean(coarse.iter().map(|light| light[1]));
        let fine = mean(fine.iter().map(|light| f64::from(light[1])));
        assert!((coarse / fine - 1.0).abs() < 0.01, "{coarse} {fine}");
    }
}

#[test]
fn a_matt_sphere_under_a_lamp_and_a_sky_has_its_closed_form() {
    let (centre, at_lamp, half, albedo) = (Vector3::new(0.2, -0.1, 0.4), [6.0, -5.0, 8.0], 0.2, 0.502_886_5);
    let sphere = object(primitive::sphere(1.0, 96), matt([188; 3]), centre.into(), [0.0; 3], 1.0);
    let world = world(vec![sphere], uniform_sky(0.25), vec![lamp(at_lamp, half, 5000.0)]);
    let (camera, pose) = view(Size::new(60, 60), [4.0, -1.0, 2.0], centre.into());
    let shot = shoot(&world, &(camera, pose), &noisy(64, 1), 3);
    let mut compared = 0;
    for (x, y) in pixels(camera.size) {
        let depth = f64::from(shot.ground_truth.depth[(x, y)]);
        let in_cam = camera.intrinsics.ray(&nalgebra::Vector2::new(x as f64 + 0.5, y as f64 + 0.5)) * depth;
        let point = pose.inverse().transform(&in_cam);
        let (normal, to_lamp) = ((point - centre).normalize(), Vector3::from(at_lamp) - point);
        let (facing, square) = (normal.dot(&to_lamp.normalize()), to_lamp.norm_squared());
        // Away from the silhouette and from the shadow's border, light changes little within a pixel.
        if depth == 0.0 || normal.dot(&in_world(&pose, &in_cam)) > -0.3 || facing.abs() < 0.1 {
            continue;
        }
        let down = (to_lamp.z / square.sqrt()).max(0.0);
        let from_lamp = 5000.0 * 4.0 * half * half * down * facing.max(0.0) / square;
        let expected = albedo * (from_lamp / PI + 0.25);
        let error = f64::from(shot.radiance[(x, y)][1]) / expected - 1.0;
        assert!(error.abs() < 0.05, "({x}, {y}): {error}");
        compared += 1;
    }
    assert!(compared > 400, "{compared}");
}

fn in_world(pose: &Pose, in_cam: &Vector3<f64>) -> Vector3<f64> {
    (pose.inverse().rotation * in_cam).normalize()
}

#[test]
fn photographs_do_not_depend_on_the_number_of_threads() {
    let camera = view(Size::new(40, 30), [2.0, -2.5, 1.6], [0.0, 0.0, 0.3]);
    let tracer = Tracer::new(&lively_world());
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| tracer.shoot(&camera.0, &camera.1, &RenderOptions::default(), 5))
    };
    let (one, two) = (with(1), with(2));
    assert_eq!(one.ground_truth, two.ground_truth);
    assert_eq!(one.radiance, two.radiance);
    let other_seed = tracer.shoot(&camera.0, &camera.1, &RenderOptions::default(), 6);
    assert_ne!(one.radiance, other_seed.radiance);
}

/// Denoising removes noise, and keeps textures and brightness.
#[test]
fn denoising_comes_closer_to_a_fine_render() {
    let camera = view(Size::new(96, 72), [2.0, -2.5, 1.6], [0.0, 0.0, 0.3]);
    let mut lively = lively_world();
    let checks =
        Grid::from_fn(Size::new(256, 256), |x, y| if (x / 4 + y / 4) % 2 == 0 { [230; 3] } else { [90; 3] });
    lively.objects[0].material.albedo = Arc::new(checks);
    let tracer = Tracer::new(&lively);
    let render = |options, seed| tracer.shoot(&camera.0, &camera.1, &options, seed).radiance;
    let fine = render(noisy(512, 6), 1);
    // Clipped, as in a photograph: highlights are white.
    let error = |light: &Grid<[f32; 3]>| {
        let shown = light.data().iter().zip(fine.data()).map(|(a, b)| a[1].min(1.0) - b[1].min(1.0));
        mean(shown.map(|difference| f64::from(difference).powi(2))).sqrt()
    };
    let (raw, clean) = (error(&render(noisy(8, 6), 2)), error(&render(RenderOptions::default(), 2)));
    assert!(clean < 0.5 * raw, "noisy {raw}, denoised {clean}");
    let light = |image: &Grid<[f32; 3]>| mean(image.data().iter().map(|light| f64::from(light[1].min(1.0))));
    let kept = light(&render(RenderOptions::default(), 2)) / light(&fine);
    // Fireflies lose part of their light.
    assert!((kept - 1.0).abs() < 0.04, "{kept}");
}
