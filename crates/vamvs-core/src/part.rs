//! One of several parts of a list, for work that is spread over processes.

use std::fmt;
use std::ops::Range;
use std::str::FromStr;

/// Part `index` of `count` parts of about the same size. Spelled `1/4` to `4/4`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Part {
    /// Counts from 0.
    index: usize,
    count: usize,
}

impl Part {
    /// The only part: everything.
    pub const WHOLE: Self = Self { index: 0, count: 1 };

    /// Part `index`, counted from 0, of `count`; `None` if `index` is not below `count`.
    #[must_use]
    pub fn new(index: usize, count: usize) -> Option<Self> {
        (index < count).then_some(Self { index, count })
    }

    /// All parts, the first one first.
    pub fn all(count: usize) -> impl Iterator<Item = Self> {
        (0..count).map(move |index| Self { index, count })
    }

    /// The number of parts.
    #[must_use]
    pub fn count(self) -> usize {
        self.count
    }

    /// The part's range of items in a list of `len` items. The ranges of consecutive parts are
    /// adjacent.
    #[must_use]
    pub fn range(self, len: usize) -> Range<usize> {
        let end = |parts: usize| (len as u128 * parts as u128 / self.count as u128) as usize;
        end(self.index)..end(self.index + 1)
    }
}

impl fmt::Display for Part {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.index + 1, self.count)
    }
}

impl FromStr for Part {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers = text.split_once('/').and_then(|(part, count)| {
            let part: usize = part.trim().parse().ok()?;
            Self::new(part.checked_sub(1)?, count.trim().parse().ok()?)
        });
        numbers.ok_or_else(|| format!("expected a part such as 1/4, 2/4, 3/4 or 4/4, found {text:?}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_follow_each_other_and_differ_by_one_item_at_most() {
        for (len, count) in [(10, 3), (3, 7), (0, 2), (12, 12), (100, 1)] {
            let ranges: Vec<_> = Part::all(count).map(|part| part.range(len)).collect();
            let items: Vec<usize> = ranges.iter().cloned().flatten().collect();
            assert!(items.into_iter().eq(0..len));
            let lens = || ranges.iter().map(ExactSizeIterator::len);
            assert!(lens().max().unwrap_or(0) - lens().min().unwrap_or(0) <= 1);
        }
    }

    #[test]
    fn parts_are_spelled_from_one() {
        for part in Part::all(3) {
            assert_eq!(part.to_string().parse(), Ok(part));
        }
        assert_eq!("1/1".parse(), Ok(Part::WHOLE));
        for wrong in ["0/4", "5/4", "1/0", "1", "a/4", "-1/4", ""] {
            assert!(wrong.parse::<Part>().is_err(), "{wrong}");
        }
    }
}
