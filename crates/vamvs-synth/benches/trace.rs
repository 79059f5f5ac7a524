//! Measures, on a scene of about 300,000 triangles, camera rays, rays bounced in random directions off the
//! surfaces that the camera sees, and light paths; each per second.

use std::f64::consts::TAU;
use std::hint::black_box;
use std::sync::Arc;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use nalgebra::{Similarity3, UnitQuaternion, Vector3};
use vamvs_core::{Grid, Intrinsics, Pinhole, Pose, Size};
use vamvs_synth::{Environment, Material, Mesh, Object, RenderOptions, Tracer, World, primitive};

const SIZE: Size = Size::new(128, 128);

fn tracing(criterion: &mut Criterion) {
    let tracer = Tracer::new(&heap());
    let pose = Pose::look_at(&Vector3::new(1.5, -1.5, 1.5), &Vector3::zeros(), &Vector3::z());
    let intrinsics = Intrinsics { fx: 140.0, fy: 140.0, cx: 64.0, cy: 64.0 };
    let camera = Pinhole { size: SIZE, intrinsics };
    let bounces = bounces(&tracer, &camera, &pose);
    let mut group = criterion.benchmark_group("trace");
    group.sample_size(10).throughput(Throughput::Elements(SIZE.area() as u64));
    group.bench_function("rays of a camera", |b| b.iter(|| tracer.ground_truth(&camera, &pose)));
    group.throughput(Throughput::Elements(bounces.len() as u64));
    group.bench_function("bounced rays, one thread", |b| {
        b.iter(|| {
            for (from, to) in &bounces {
                black_box(tracer.first_hit(from, to));
            }
        });
    });
    let options = RenderOptions { denoise: false, ..RenderOptions::default() };
    group.throughput(Throughput::Elements((SIZE.area() * options.samples) as u64));
    group.bench_function("paths", |b| b.iter(|| tracer.shoot(&camera, &pose, &options, 1)));
    group.finish();
}

/// A heap of balls and boxes over a floor.
fn heap() -> World {
    let (ball, block) =
        (Arc::new(primitive::sphere(0.16, 32)), Arc::new(primitive::cuboid([0.3, 0.2, 0.15])));
    let floor = Arc::new(primitive::rectangle([6.0, 6.0]));
    let mut objects = vec![object(&floor, Vector3::zeros(), 0.0)];
    for index in 0..24 {
        let angle = f64::from(index) * 2.4;
        let radius = 0.16 * f64::from(index).sqrt();
        let place = Vector3::new(radius * angle.cos(), radius * angle.sin(), 0.5 - 0.4 * radius);
        objects.push(object(&ball, place, angle));
        objects.push(object(&block, place + Vector3::z() * 0.25, 1.7 * angle));
    }
    let map = Arc::new(Grid::from_fn(Size::new(64, 32), |x, y| [0.2 + 0.01 * (x + y) as f32; 3]));
    World { objects, environment: Environment { map, rotation: 0.0, strength: 1.0 }, lamps: vec![] }
}

fn object(mesh: &Arc<Mesh>, place: Vector3<f64>, turn: f64) -> Object {
    let rotation = UnitQuaternion::from_euler_angles(turn, 2.0 * turn, 0.0);
    let rotation = if place == Vector3::zeros() { UnitQuaternion::identity() } else { rotation };
    let albedo = Arc::new(Grid::filled(Size::new(1, 1), [160, 140, 120]));
    let material = Material { albedo, tiling: [1.0; 2], tint: [1.0; 3], specular: 0.04, roughness: 0.4 };
    Object {
        mesh: mesh.clone(),
        material,
        world_from_object: Similarity3::from_parts(place.into(), rotation, 1.0),
    }
}

/// For each pixel that shows a surface, a ray from that surface into the hemisphere above it, as (origin,
/// direction) in the world.
fn bounces(tracer: &Tracer, camera: &Pinhole, pose: &Pose) -> Vec<(Vector3<f64>, Vector3<f64>)> {
    let ground_truth = tracer.ground_truth(camera, pose);
    let world_from_cam = pose.inverse();
    let bounce = |index: usize| {
        let centre =
            nalgebra::Vector2::new((index % SIZE.width) as f64 + 0.5, (index / SIZE.width) as f64 + 0.5);
        let depth = f64::from(ground_truth.depth.data()[index]);
        let normal = Vector3::from(ground_truth.normal.data()[index]).cast::<f64>();
        let place = world_from_cam.transform(&(camera.intrinsics.ray(&centre) * depth)) + normal * 1e-5;
        let (height, turn) =
            ((index as f64 * 0.618_034).fract() * 2.0 - 1.0, TAU * (index as f64 * 0.754_878).fract());
        let around = (1.0 - height * height).sqrt();
        (place, normal * 1.001 + Vector3::new(around * turn.cos(), around * turn.sin(), height))
    };
    (0..SIZE.area()).filter(|&index| ground_truth.id.data()[index] > 0).map(bounce).collect()
}

criterion_group!(benches, tracing);
criterion_main!(benches);
