//! Random numbers for light paths, stratified over the paths of a pixel.

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// How many of a path's pairs of numbers are stratified; later ones are independent.
const PAIRS: usize = 8;

/// The random numbers of a pixel. For each of the first [`PAIRS`] pairs along its paths they are the Sobol
/// (0, 2)-sequence, Owen-scrambled and shuffled (Burley, "Practical hash-based Owen scrambling", 2020).
pub(crate) struct Pattern {
    /// For each pair: the seeds that scramble its two numbers, and the seed that shuffles the paths.
    seeds: [[u32; 3]; PAIRS],
    random: Pcg64,
}

/// The random numbers of one path.
pub(crate) struct Sampler<'a> {
    pattern: &'a mut Pattern,
    path: u32,
    pair: usize,
}

impl Pattern {
    /// The numbers of the pixel with index `pixel`.
    pub fn new(seed: u64, pixel: u64) -> Self {
        let mut random =
            Pcg64::seed_from_u64(seed ^ pixel.wrapping_add(1).wrapping_mul(0x9E37_79B9_7F4A_7C15));
        Self { seeds: random.random(), random }
    }

    /// The numbers of the path with index `path`.
    pub fn path(&mut self, path: usize) -> Sampler<'_> {
        Sampler { pattern: self, path: path as u32, pair: 0 }
    }
}

impl Sampler<'_> {
    /// The next pair of numbers in [0, 1).
    pub fn pair(&mut self) -> [f32; 2] {
        let Some(&[x, y, order]) = self.pattern.seeds.get(self.pair) else {
            return [self.single(), self.single()];
        };
        self.pair += 1;
        let index = scrambled(self.path, order);
        [unit(scrambled(index.reverse_bits(), x)), unit(scrambled(second_digits(index), y))]
    }

    /// A single number in [0, 1), not stratified.
    pub fn single(&mut self) -> f32 {
        unit(self.pattern.random.random())
    }
}

/// The second Sobol coordinate of point `index`, as a binary fraction of 32 bits.
fn second_digits(mut index: u32) -> u32 {
    let (mut digits, mut column) = (0, 1 << 31);
    while index != 0 {
        if index & 1 != 0 {
            digits ^= column;
        }
        index >>= 1;
        column ^= column >> 1;
    }
    digits
}

/// Owen scrambling: flips each binary digit at random, depending on the digits before it, so that numbers in
/// one dyadic interval stay together (the hash of Laine and Karras, 2011).
fn scrambled(digits: u32, seed: u32) -> u32 {
    let mut bits = digits.reverse_bits().wrapping_add(seed);
    for factor in [0x6c50_b47c, 0xb82f_1e52, 0xc7af_e638, 0x8d22_f6e6] {
        bits ^= bits.wrapping_mul(factor);
    }
    bits.reverse_bits()
}

fn unit(bits: u32) -> f32 {
    (bits >> 8) as f32 / (1 << 24) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of 16 paths, exactly one falls into each of 16 boxes of equal area, whatever the boxes' shape.
    #[test]
    fn pairs_of_a_pixel_are_spread_evenly() {
        for (columns, rows) in [(16, 1), (8, 2), (4, 4), (2, 8), (1, 16)] {
            let mut pattern = Pattern::new(7, 123);
            let mut counts = [[0; 16]; PAIRS];
            for path in 0..16 {
                let mut sampler = pattern.path(path);
                for count in &mut counts {
                    let [x, y] = sampler.pair();
                    count[(x * columns as f32) as usize * rows + (y * rows as f32) as usize] += 1;
                }
            }
            assert_eq!(counts, [[1; 16]; PAIRS], "{columns} × {rows} boxes");
        }
    }

    /// Over the paths of one pixel, the first pair says nothing about the later ones.
    #[test]
    fn numbers_of_different_pairs_are_independent() {
        for pixel in 0..100 {
            let mut pattern = Pattern::new(3, pixel);
            let mut both_low = [0; PAIRS];
            for path in 0..64 {
                let mut sampler = pattern.path(path);
                let first = sampler.pair()[0];
                for count in &mut both_low[1..] {
                    *count += i32::from(first < 0.5 && sampler.pair()[0] < 0.5);
                }
            }
            assert!(both_low[1..].iter().all(|count| (4..=28).contains(count)), "{both_low:?}");
        }
    }

    #[test]
    fn pixels_and_pairs_have_numbers_of_their_own() {
        let first = |pixel| Pattern::new(7, pixel).path(0).pair();
        assert_ne!(first(0), first(1));
        let mut pattern = Pattern::new(7, 0);
        let mut path = pattern.path(0);
        let pairs: Vec<[f32; 2]> = (0..2 * PAIRS).map(|_| path.pair()).collect();
        assert!((1..pairs.len()).all(|i| pairs[i] != pairs[i - 1]));
    }
}
