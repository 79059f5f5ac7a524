//! An even sample of a cloud, exported as sparse points.

use vamvs_core::CloudPoint;
use vamvs_io::openmvs::ObservedPoint;

/// Number of points kept at least, of a stream with that many.
const ENOUGH: usize = 25_000;

/// Every n-th point of a stream, with n such that 25 000 to 50 000 are kept of a longer one. The
/// result depends only on the stream.
#[derive(Debug)]
pub(super) struct Thinned {
    step: usize,
    seen: usize,
    kept: Vec<ObservedPoint>,
}

impl Default for Thinned {
    fn default() -> Self {
        Self { step: 1, seen: 0, kept: Vec::new() }
    }
}

impl Thinned {
    pub fn push(&mut self, point: &CloudPoint, views: &[u32]) {
        if self.seen.is_multiple_of(self.step) {
            self.kept.push((*point, views.to_vec()));
        }
        self.seen += 1;
        if self.kept.len() == 2 * ENOUGH {
            let mut place = 0;
            self.kept.retain(|_| {
                place += 1;
                place % 2 == 1
            });
            self.step *= 2;
        }
    }

    pub fn into_points(self) -> Vec<ObservedPoint> {
        self.kept
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_stream_leaves_evenly_spaced_points() {
        let mut thinned = Thinned::default();
        for number in 0..130_000 {
            let x_in_world = [f64::from(number), 0.0, 0.0];
            let (normal, colour) = ([0.0; 3], [0; 3]);
            thinned.push(
                &CloudPoint { x_in_world, normal, colour, confidence: 1.0, sigma: 0.0, views: 3 },
                &[1, 2],
            );
        }
        let points = thinned.into_points();
        assert_eq!(points.len(), 32_500);
        assert!(points.windows(2).all(|pair| pair[1].0.x_in_world[0] - pair[0].0.x_in_world[0] == 4.0));
        assert!(points.iter().all(|(_, views)| views == &[1, 2]));
    }
}
