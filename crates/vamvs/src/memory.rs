//! How much memory a run may take.

use std::fmt;
use std::str::FromStr;

use bytesize::ByteSize;
use serde::{Deserialize, Serialize};
use sysinfo::{MemoryRefreshKind, ProcessRefreshKind, ProcessesToUpdate, System};

/// A limit of what the whole process holds in memory, written as `2GiB`, `500MB` or `70%` of the machine's.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum MemoryLimit {
    /// Bytes.
    Bytes(u64),
    /// Percent of the machine's memory, or of what a container leaves of it; 1 to 100.
    Percent(u8),
}

/// A text that is no limit of memory.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("expected an amount of memory such as 2GiB, 500MB or 70%, found {0:?}")]
pub struct MemoryLimitError(String);

impl MemoryLimit {
    /// The limit in bytes. A share of a memory that the system does not tell is no limit.
    #[must_use]
    pub fn bytes(self) -> u64 {
        match self {
            Self::Bytes(bytes) => bytes,
            Self::Percent(percent) => machine_bytes().unwrap_or(u64::MAX) / 100 * u64::from(percent),
        }
    }

    /// Bytes that the process may take beside what it holds now; 0 if it holds more.
    #[must_use]
    pub fn left(self) -> u64 {
        self.bytes().saturating_sub(process_bytes().unwrap_or(0))
    }
}

impl Default for MemoryLimit {
    fn default() -> Self {
        Self::Percent(70)
    }
}

impl FromStr for MemoryLimit {
    type Err = MemoryLimitError;

    fn from_str(text: &str) -> Result<Self, MemoryLimitError> {
        let limit = match text.strip_suffix('%') {
            Some(percent) => percent.parse().ok().filter(|p| (1..=100).contains(p)).map(Self::Percent),
            None => text.parse().ok().map(|ByteSize(bytes)| Self::Bytes(bytes)).filter(|l| l.bytes() > 0),
        };
        limit.ok_or_else(|| MemoryLimitError(text.to_owned()))
    }
}

impl TryFrom<String> for MemoryLimit {
    type Error = MemoryLimitError;

    fn try_from(text: String) -> Result<Self, MemoryLimitError> {
        text.parse()
    }
}

impl From<MemoryLimit> for String {
    fn from(limit: MemoryLimit) -> Self {
        limit.to_string()
    }
}

impl fmt::Display for MemoryLimit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Bytes(bytes) => write!(f, "{bytes}B"),
            Self::Percent(percent) => write!(f, "{percent}%"),
        }
    }
}

/// A number of bytes for people, such as `1.5 GiB`.
#[must_use]
pub fn spelled(bytes: u64) -> String {
    ByteSize(bytes).to_string()
}

/// The machine's memory, or the limit of the container the process is in; `None` if the system does not tell.
fn machine_bytes() -> Option<u64> {
    let mut system = System::new().ok()?;
    system.refresh_memory_specifics(MemoryRefreshKind::nothing().with_ram());
    let total = system.total_memory();
    Some(system.cgroup_limits().map_or(total, |limits| limits.total_memory.min(total)))
}

/// What the process holds in memory now; `None` if the system does not tell.
fn process_bytes() -> Option<u64> {
    let id = sysinfo::get_current_pid().ok()?;
    let mut system = System::new().ok()?;
    let what = ProcessRefreshKind::nothing().with_memory();
    system.refresh_processes_specifics(ProcessesToUpdate::Some(&[id]), false, what);
    system.process(id).map(sysinfo::Process::memory)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn amounts_are_read_and_written_and_nonsense_is_quoted() {
        for (text, bytes) in [("2GiB", 2 << 30), ("500MB", 500_000_000), ("1.5 GiB", 3 << 29), ("64", 64)] {
            let limit: MemoryLimit = text.parse().unwrap();
            assert_eq!(limit, MemoryLimit::Bytes(bytes));
            assert_eq!(limit.to_string().parse(), Ok(limit));
        }
        assert_eq!("70%".parse(), Ok(MemoryLimit::Percent(70)));
        assert_eq!(MemoryLimit::default().to_string(), "70%");
        for wrong in ["", "0", "0%", "101%", "-1GiB", "2 apples", "%"] {
            let error = MemoryLimit::from_str(wrong).unwrap_err();
            assert!(error.to_string().contains(&format!("{wrong:?}")), "{error}");
        }
    }

    #[test]
    fn a_share_is_of_the_machines_memory_and_what_is_held_is_taken_off() {
        let all = MemoryLimit::Percent(100).bytes();
        assert!(all > 1 << 28 && MemoryLimit::Percent(50).bytes() <= all / 2);
        let left = MemoryLimit::Percent(100).left();
        assert!(0 < left && left < all);
        assert_eq!(MemoryLimit::Bytes(1).left(), 0);
    }
}
