//! Random damage to a file's bytes.

use proptest::prelude::*;
use proptest::sample::{Index, select};

/// One change of a file's bytes.
#[derive(Clone, Debug)]
pub enum Damage {
    /// A byte is replaced by this one.
    Byte(Index, u8),
    /// Eight bytes (if `true`) or four are replaced by a number, little-endian.
    Number(Index, u64, bool),
    /// A run of digits is replaced by a word.
    Digits(Index, &'static str),
    /// A word is inserted.
    Inserted(Index, &'static str),
    /// So many bytes are removed.
    Cut(Index, usize),
    /// So many bytes are duplicated.
    Repeated(Index, usize),
    /// The file is truncated.
    Truncated(Index),
}

/// Numbers that overflow or otherwise break arithmetic.
const NUMBERS: [u64; 12] = [
    0,
    1,
    2,
    255,
    1 << 16,
    1 << 30,
    i32::MAX as u64,
    u32::MAX as u64,
    1 << 40,
    i64::MAX as u64,
    u64::MAX,
    // NaN as float64.
    0x7ff8_0000_0000_0000,
];

/// Words that break parsers.
const WORDS: [&str; 22] = [
    "-1",
    "0",
    "1e308",
    "nan",
    "inf",
    "4294967295",
    "18446744073709551615",
    "99999999999999999999999",
    "\n",
    "\r\n",
    " ",
    "#",
    "[",
    "{",
    "}",
    "\"",
    "/",
    "../",
    "&",
    "\0",
    "ü",
    "-",
];

/// Which file is damaged, and one to four damages to it.
pub fn some_damage() -> impl Strategy<Value = (Index, Vec<Damage>)> {
    let index = any::<Index>;
    let damage = prop_oneof![
        (index(), any::<u8>()).prop_map(|(at, byte)| Damage::Byte(at, byte)),
        (index(), select(&NUMBERS[..]), any::<bool>())
            .prop_map(|(at, number, long)| Damage::Number(at, number, long)),
        (index(), select(&WORDS[..])).prop_map(|(at, word)| Damage::Digits(at, word)),
        (index(), select(&WORDS[..])).prop_map(|(at, word)| Damage::Inserted(at, word)),
        (index(), 1_usize..40).prop_map(|(at, count)| Damage::Cut(at, count)),
        (index(), 1_usize..400).prop_map(|(at, count)| Damage::Repeated(at, count)),
        index().prop_map(Damage::Truncated),
    ];
    (index(), prop::collection::vec(damage, 1..5))
}

impl Damage {
    /// The file's bytes with this damage. An empty file stays empty.
    pub fn apply(&self, mut bytes: Vec<u8>) -> Vec<u8> {
        let length = bytes.len();
        if length == 0 {
            return bytes;
        }
        let up_to = |start: usize, count: usize| start..(start + count).min(length);
        match self {
            Self::Byte(at, byte) => bytes[at.index(length)] = *byte,
            Self::Number(at, number, long) => {
                let place = up_to(at.index(length), if *long { 8 } else { 4 });
                let count = place.len();
                bytes[place].copy_from_slice(&number.to_le_bytes()[..count]);
            }
            Self::Digits(at, word) => {
                let start = at.index(length);
                let digit = |&at: &usize| bytes[at].is_ascii_digit();
                let Some(first) = (start..length).find(digit) else { return bytes };
                let count = bytes[first..].iter().take_while(|byte| byte.is_ascii_digit()).count();
                bytes.splice(first..first + count, word.bytes());
            }
            Self::Inserted(at, word) => {
                let start = at.index(length);
                bytes.splice(start..start, word.bytes());
            }
            Self::Cut(at, count) => drop(bytes.drain(up_to(at.index(length), *count))),
            Self::Repeated(at, count) => {
                let piece = bytes[up_to(at.index(length), *count)].to_vec();
                let start = at.index(length);
                bytes.splice(start..start, piece);
            }
            Self::Truncated(at) => bytes.truncate(at.index(length)),
        }
        bytes
    }
}
