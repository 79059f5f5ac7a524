//! Random numbers that depend only on a seed, a scene and a purpose, never on the order of work.

use std::f64::consts::TAU;

use rand::RngExt;
#[cfg(any(feature = "scenes", test))]
use rand::SeedableRng;
use rand_pcg::Pcg64;

/// The random numbers of `scene` for a `purpose`. Each scene and each purpose has its own stream, so that drawing
/// one number more for one purpose does not change the others.
#[cfg(any(feature = "scenes", test))]
pub(crate) fn stream(seed: u64, scene: u64, purpose: &str) -> Pcg64 {
    let mut hasher = blake3::Hasher::new();
    hasher.update(&seed.to_le_bytes()).update(&scene.to_le_bytes()).update(purpose.as_bytes());
    Pcg64::from_seed(hasher.finalize().into())
}

/// A normally distributed number with mean 0 and standard deviation 1 (Box–Muller).
pub(crate) fn normal(random: &mut Pcg64) -> f64 {
    let radius = (-2.0 * (1.0 - random.random::<f64>()).ln()).sqrt();
    radius * (TAU * random.random::<f64>()).cos()
}

/// A number from −1 to 1, triangularly distributed with its peak at 0.
pub(crate) fn triangular(random: &mut Pcg64) -> f64 {
    random.random::<f64>() - random.random::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn streams_depend_on_seed_scene_and_purpose_only() {
        let first = |seed, scene, purpose| stream(seed, scene, purpose).random::<u64>();
        assert_eq!(first(1, 2, "rig"), first(1, 2, "rig"));
        let others = [first(1, 2, "rig"), first(2, 1, "rig"), first(1, 3, "rig"), first(1, 2, "stage")];
        for (i, a) in others.iter().enumerate() {
            assert!(others[i + 1..].iter().all(|b| a != b));
        }
    }

    #[test]
    fn normal_numbers_have_their_moments() {
        let mut random = stream(0, 0, "test");
        let numbers: Vec<f64> = (0..100_000).map(|_| normal(&mut random)).collect();
        let moment = |power| numbers.iter().map(|x| x.powi(power)).sum::<f64>() / numbers.len() as f64;
        assert!(moment(1).abs() < 0.015 && (moment(2) - 1.0).abs() < 0.02 && (moment(4) - 3.0).abs() < 0.15);
    }
}
