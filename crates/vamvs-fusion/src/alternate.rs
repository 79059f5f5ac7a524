//! Questions about the pixels of a row, of which every other one is asked.
//!
//! On a smooth surface neighbouring pixels have the same answer. So the pixels of even columns are asked first. A pixel
//! between two of them takes their answer if both have the same and all three are on one surface; else it is asked too.

use crate::lanes::{LANES, set_bits};

/// How much the inverse depth of a pixel may differ from the mean of its neighbours' for all three to be on one surface, as a
/// share of the difference at which depths do not agree.
pub(crate) const FLAT: f32 = 0.25;

const EVEN: u64 = 0x5555_5555_5555_5555;

/// The pixels among `asked`, one bit each, whose answer is yes. `ask` gets columns, at most [`LANES`] and ascending, and
/// returns one bit for each. `samples` begin with the row's inverse depths. Three pixels are on one surface if the inverse
/// depth of the middle one differs from the mean of the others by less than the share `flat`; if that is 0, all pixels are
/// asked.
pub(crate) fn answers(
    asked: &[u64],
    samples: &[[f32; 2]],
    flat: f32,
    mut ask: impl FnMut(&[usize]) -> u64,
) -> Vec<u64> {
    let mut yes = vec![0; asked.len()];
    put(asked.iter().map(|asked| asked & EVEN), &mut ask, &mut yes);
    let mut left: Vec<u64> = asked.iter().map(|asked| asked & !EVEN).collect();
    for (word, left) in left.iter_mut().enumerate() {
        let (before, after) = beside(asked, word);
        let [yes_before, yes_after] = <[u64; 2]>::from(beside(&yes, word));
        let alike = *left & before & after & !(yes_before ^ yes_after);
        let taken = alike & on_one_surface(samples, word * LANES, alike, flat);
        yes[word] |= taken & yes_before;
        *left &= !taken;
    }
    put(left.into_iter(), &mut ask, &mut yes);
    yes
}

/// Asks the pixels whose bits are set, and sets the bits of those whose answer is yes.
fn put(asked: impl Iterator<Item = u64>, ask: &mut impl FnMut(&[usize]) -> u64, yes: &mut [u64]) {
    let mut pixels = [0; LANES];
    let mut count = 0;
    let mut flush = |pixels: &[usize]| {
        for lane in set_bits(ask(pixels)) {
            yes[pixels[lane] / LANES] |= 1 << (pixels[lane] % LANES);
        }
    };
    for (word, asked) in asked.enumerate() {
        for bit in set_bits(asked) {
            pixels[count] = word * LANES + bit;
            count += 1;
            if count == LANES {
                flush(&pixels);
                count = 0;
            }
        }
    }
    if count > 0 {
        flush(&pixels[..count]);
    }
}

/// For each pixel of a word, the bit of the pixel before it, and of the pixel after it.
fn beside(row: &[u64], word: usize) -> (u64, u64) {
    let before = if word > 0 { row[word - 1] >> (LANES - 1) } else { 0 };
    let after = row.get(word + 1).map_or(0, |next| next << (LANES - 1));
    (row[word] << 1 | before, row[word] >> 1 | after)
}

/// The pixels among `alike`, whose neighbours exist, that are on one surface with both.
fn on_one_surface(samples: &[[f32; 2]], first: usize, alike: u64, flat: f32) -> u64 {
    let mut found = 0;
    for bit in set_bits(alike) {
        let [[before, _], [own, _], [after, _]] = &samples[first + bit - 1..first + bit + 2] else { break };
        found |= u64::from((2.0 * own - before - after).abs() < 2.0 * flat * own) << bit;
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Asks all `count` pixels of a row but one, of which those from `first` on have the answer yes; returns the answers
    /// and who was asked.
    fn asked(count: usize, first: usize, missing: usize, flat: f32) -> (Vec<bool>, Vec<usize>) {
        let bits = |is: &dyn Fn(usize) -> bool| -> Vec<u64> {
            let word =
                |word| (0..LANES).filter(|bit| is(word * LANES + bit)).fold(0, |bits, bit| bits | 1 << bit);
            (0..count.div_ceil(LANES)).map(word).collect()
        };
        // A bend at pixel 21.
        let samples: Vec<[f32; 2]> = (0..count).map(|x| [1.0 + 0.01 * x.abs_diff(21) as f32, 1.0]).collect();
        let mut order = Vec::new();
        let yes = answers(&bits(&|x| x < count && x != missing), &samples, flat, |pixels| {
            order.extend_from_slice(pixels);
            pixels.iter().enumerate().fold(0, |bits, (lane, &x)| bits | u64::from(x >= first) << lane)
        });
        ((0..count).map(|x| yes[x / LANES] >> (x % LANES) & 1 == 1).collect(), order)
    }

    #[test]
    fn who_is_between_two_with_the_same_answer_on_one_surface_is_not_asked() {
        for count in [1, 2, 64, 65, 66, 200] {
            let (yes, order) = asked(count, 64, 30, 1e-3);
            let expected: Vec<bool> = (0..count).map(|x| x >= 64 && x != 30).collect();
            assert_eq!(yes, expected, "{count}");
            let odd: Vec<usize> = order.iter().copied().filter(|x| x % 2 == 1).collect();
            // At the bend, beside the missing one, where answers differ, and at the end.
            let wanted = [21, 29, 31, 63, count - 1].into_iter().filter(|x| x % 2 == 1 && *x < count);
            let mut wanted: Vec<usize> = wanted.collect();
            wanted.sort_unstable();
            wanted.dedup();
            assert_eq!(odd, wanted, "{count}");
            assert_eq!(order.len() - odd.len(), (0..count).filter(|x| x % 2 == 0 && *x != 30).count());
        }
    }

    #[test]
    fn all_are_asked_where_nothing_counts_as_flat() {
        let (yes, order) = asked(130, 7, 500, 0.0);
        assert_eq!(order.len(), 130);
        assert!(yes.iter().enumerate().all(|(x, yes)| *yes == (x >= 7)));
    }
}
