//! The benchmarks' protocols on synthetic clouds whose scores are known.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use nalgebra::{Rotation3, Vector3};
use vamvs_core::Similarity;
use vamvs_eval::dtu::DtuProtocol;
use vamvs_eval::icp::transformed;
use vamvs_eval::tnt::TntProtocol;
use vamvs_eval::{CropVolume, VoxelMask};

/// A horizontal square of `side` × `side` points, `step` apart, that begins at the origin.
fn square(side: u32, step: f64, z: f64) -> Vec<[f64; 3]> {
    (0..side * side).map(|i| [f64::from(i % side) * step, f64::from(i / side) * step, z]).collect()
}

/// A mask of voxels of 1 mm that holds everything from (−1, −1, −50) to (`side`, `side`, 50).
fn whole(side: usize) -> VoxelMask {
    let size = [side + 2, side + 2, 101];
    VoxelMask {
        low: [-1.0, -1.0, -50.0],
        high: [side as f64, side as f64, 50.0],
        side: 1.0,
        size,
        inside: vec![true; size.iter().product()],
    }
}

/// Everything is above this ground.
const NO_GROUND: [f64; 4] = [0.0, 0.0, 0.0, 1.0];

#[test]
fn dtu_a_shifted_cloud_is_off_by_the_shift_however_densely_it_is_sampled() {
    let scan = square(21, 1.0, 0.0);
    let protocol = DtuProtocol::new(whole(21), NO_GROUND);
    // Ten copies of each point, at heights from 0.50 to 0.59 mm: thinning leaves one of ten.
    let cloud: Vec<_> = (0..10).flat_map(|copy| square(21, 1.0, 0.5 + 0.01 * f64::from(copy))).collect();
    let scores = protocol.scores(&cloud, &scan).unwrap();
    assert_eq!((scores.thinned, scores.accuracy.count, scores.completeness.count), (441, 441, 441));
    for mean in [scores.accuracy.mean, scores.completeness.mean, scores.overall, scores.overall_median] {
        assert!((0.5..=0.59).contains(&mean), "{mean}");
    }
    assert!((scores.accuracy.mean - scores.completeness.mean).abs() < 1e-12);
    let unthinned = DtuProtocol { spacing: 0.0, ..protocol }.scores(&cloud, &scan).unwrap();
    assert!(
        (unthinned.accuracy.mean - 0.545).abs() < 1e-12 && (unthinned.completeness.mean - 0.5).abs() < 1e-12
    );
}

#[test]
fn dtu_distances_of_twenty_and_more_do_not_count() {
    let scan = square(21, 1.0, 0.0);
    let mut cloud = square(21, 1.0, 0.25);
    cloud.extend([[10.0, 10.0, 19.75], [10.0, 10.0, 20.0], [10.0, 10.0, 30.0]]);
    let scores = DtuProtocol::new(whole(21), NO_GROUND).scores(&cloud, &scan).unwrap();
    assert_eq!(scores.accuracy.count, 442);
    assert!((scores.accuracy.mean - (441.0 * 0.25 + 19.75) / 442.0).abs() < 1e-12);
    assert_eq!((scores.accuracy.median, scores.completeness.mean), (0.25, 0.25));
}

#[test]
fn dtu_the_mask_limits_accuracy_only_and_the_ground_completeness_only() {
    let scan = [square(21, 1.0, 0.0), square(21, 1.0, -5.0)].concat();
    let mut mask = whole(21);
    // Voxels with x ≥ 10 are not in the mask.
    let rows = mask.size[0];
    mask.inside.iter_mut().enumerate().for_each(|(index, inside)| *inside = index % rows < 11);
    let cloud: Vec<_> =
        square(21, 1.0, 0.0).iter().map(|x| if x[0] < 9.5 { *x } else { [x[0], x[1], 1.0] }).collect();
    let ground = [0.0, 0.0, 1.0, 2.5];
    let scores = DtuProtocol::new(mask.clone(), ground).scores(&cloud, &scan).unwrap();
    // Ten of 21 columns are in the mask, all of them exact.
    assert_eq!((scores.accuracy.count, scores.accuracy.mean), (210, 0.0));
    // Only the upper square is above the ground; points outside of the mask still serve as
    // neighbours.
    assert_eq!(scores.completeness.count, 441);
    assert!((scores.completeness.mean - 11.0 / 21.0).abs() < 1e-12);
    let on_the_ground = DtuProtocol::new(mask, [0.0, 0.0, 1.0, 0.0]).scores(&cloud, &scan).unwrap();
    assert_eq!(on_the_ground.completeness.count, 0, "points in the plane are not above it");
}

#[test]
fn dtu_points_beyond_the_blocks_of_the_box_have_no_distance() {
    // The box is 22 mm long, so one block of 60 mm, from −1 to 59, covers it.
    let scan = [vec![[58.9, 0.0, 0.0], [59.0, 0.0, 0.0], [-1.1, 0.0, 0.0]], square(21, 1.0, 0.0)].concat();
    let cloud = [vec![[59.0, 0.0, 0.0], [-1.1, 0.0, 0.0]], square(21, 1.0, 0.0)].concat();
    let scores = DtuProtocol::new(whole(21), NO_GROUND).scores(&cloud, &scan).unwrap();
    assert_eq!(scores.completeness.count, 442);
}

/// A bumpy surface, 6 by 6, with points 0.02 apart.
fn surface() -> Vec<[f64; 3]> {
    let point = |i: u32| {
        let (x, y) = (f64::from(i % 300) / 50.0, f64::from(i / 300) / 50.0);
        [x, y, (1.3 * x).sin() * (0.9 * y).cos() + 0.05 * x * y]
    };
    (0..90_000).map(point).collect()
}

fn tnt(tau: f64) -> TntProtocol {
    TntProtocol { tau, crop: None, ground_truth_from_cloud: Similarity::identity() }
}

#[test]
fn tnt_precision_and_recall_count_voxels_in_the_volume() {
    // Points are 1 apart and voxels 0.25 wide, so each point has a voxel of its own.
    let ground_truth = square(20, 1.0, 0.0);
    // A quarter of the surface is missing. As many outliers are added above it, half of them
    // outside of the volume.
    let mut cloud: Vec<_> = ground_truth.iter().copied().filter(|x| x[1] < 14.5).collect();
    cloud.extend(square(10, 1.0, 3.0).iter().map(|x| [x[0], x[1], if x[1] < 4.5 { 3.0 } else { 9.0 }]));
    let outline = vec![[-0.5, -0.5], [19.5, -0.5], [19.5, 19.5], [-0.5, 19.5]];
    let crop = Some(CropVolume { axis: 2, span: [-1.0, 5.0], outline });
    let scores = TntProtocol { crop, ..tnt(0.5) }.scores(&cloud, &ground_truth).unwrap();
    assert_eq!((scores.cloud_points, scores.ground_truth_points), (350, 400));
    let agreement = scores.agreement;
    assert_eq!((agreement.precision, agreement.recall), (300.0 / 350.0, 0.75));
    let f_score = 2.0 * agreement.precision * 0.75 / (agreement.precision + 0.75);
    assert!((agreement.f_score - f_score).abs() < 1e-12);
}

#[test]
fn tnt_a_distance_of_exactly_tau_is_not_near() {
    let (cloud, ground_truth) = (square(20, 1.0, 0.5), square(20, 1.0, 0.0));
    assert_eq!(tnt(0.5).scores(&cloud, &ground_truth).unwrap().agreement.f_score, 0.0);
    assert_eq!(tnt(0.51).scores(&cloud, &ground_truth).unwrap().agreement.f_score, 1.0);
}

#[test]
fn tnt_a_given_alignment_is_used_and_a_rough_one_is_refined() {
    let ground_truth = surface();
    let ground_truth_from_cloud = Similarity {
        scale: 0.2,
        rotation: Rotation3::from_euler_angles(0.4, 1.1, -2.0).into_inner(),
        translation: Vector3::new(5.0, -3.0, 2.0),
    };
    let cloud: Vec<[f64; 3]> = ground_truth
        .iter()
        .map(|x| {
            (ground_truth_from_cloud.rotation.transpose()
                * (Vector3::from(*x) - ground_truth_from_cloud.translation)
                / 0.2)
                .into()
        })
        .collect();
    let exact = TntProtocol { ground_truth_from_cloud, ..tnt(0.01) };
    assert_eq!(exact.scores(&cloud, &ground_truth).unwrap().agreement.f_score, 1.0);
    let off = Similarity {
        scale: 1.002,
        rotation: Rotation3::from_euler_angles(0.003, -0.002, 0.004).into_inner(),
        translation: Vector3::new(0.03, -0.02, 0.025),
    };
    let rough = TntProtocol { ground_truth_from_cloud: off.compose(&ground_truth_from_cloud), ..exact };
    assert!(rough.scores(&cloud, &ground_truth).unwrap().agreement.f_score < 0.5);
    let refined = rough.refined(&cloud, &ground_truth).unwrap();
    assert!(refined.scores(&cloud, &ground_truth).unwrap().agreement.f_score > 0.999);
    let aligned = transformed(&cloud, &refined.ground_truth_from_cloud);
    let off = |(a, b): (&[f64; 3], &[f64; 3])| (Vector3::from(*a) - Vector3::from(*b)).norm();
    let worst = aligned.iter().zip(&ground_truth).map(off).fold(0.0, f64::max);
    assert!(worst < 2e-3, "{worst}");
}
