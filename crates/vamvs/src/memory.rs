//! How much memory a run may take.

use std::fmt;
use std::str::FromStr;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicUsize, Ordering};

use bytesize::ByteSize;
use serde::{Deserialize, Serialize};
use sysinfo::{MemoryRefreshKind, ProcessRefreshKind, ProcessesToUpdate, System};

/// A limit of the process's resident memory, written as `2GiB`, `500MB` or `70%` of what is
/// available.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum MemoryLimit {
    /// Bytes.
    Bytes(u64),
    /// Percent, 1 to 100, of the memory that is available when it is first asked for, including
    /// what the process then holds: that of the machine, or of its container if that allows less.
    Percent(u8),
}

/// A text that is not a memory limit.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("expected an amount of memory with its unit, such as 2GiB, 500MB or 70%, found {0:?}")]
pub struct MemoryLimitError(String);

impl MemoryLimit {
    /// The limit in bytes. A percentage is no limit if the system does not report its memory.
    #[must_use]
    pub fn bytes(self) -> u64 {
        match self {
            Self::Bytes(bytes) => bytes,
            Self::Percent(percent) => available_at_first().unwrap_or(u64::MAX) / 100 * u64::from(percent),
        }
    }

    /// Bytes that the process may take in addition to what it holds now; 0 if it holds more.
    #[must_use]
    pub fn remaining(self) -> u64 {
        self.bytes().saturating_sub(resident_bytes().unwrap_or(0))
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
            // Whoever writes 8 does not mean bytes.
            None if text.trim().bytes().all(|byte| byte.is_ascii_digit() || byte == b'.') => None,
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
            Self::Bytes(bytes) => match EXACT.iter().find(|(unit, _)| bytes % unit == 0) {
                Some((unit, name)) => write!(f, "{} {name}", bytes / unit),
                None => write!(f, "{bytes} B"),
            },
            Self::Percent(percent) => write!(f, "{percent}%"),
        }
    }
}

/// A number of bytes for people, such as `1.5 GiB`.
#[must_use]
pub fn format_bytes(bytes: u64) -> String {
    ByteSize(bytes).to_string()
}

/// Units for printing amounts that are a whole number of them.
const EXACT: [(u64, &str); 4] = [(1 << 30, "GiB"), (1 << 20, "MiB"), (1 << 10, "KiB"), (1_000_000, "MB")];

/// Memory that was available at the first call, including what the process then held; the limit
/// does not move during a run. `None` if the system does not report it.
fn available_at_first() -> Option<u64> {
    static AVAILABLE: OnceLock<Option<u64>> = OnceLock::new();
    *AVAILABLE.get_or_init(|| {
        let mut system = System::new();
        system.refresh_memory_specifics(MemoryRefreshKind::nothing().with_ram());
        let held = resident_bytes().unwrap_or(0);
        let machine = system.available_memory().saturating_add(held);
        // The file cache of a container is freed when needed, so the limit counts, not what is
        // free.
        let container = system.cgroup_limits().map(|limits| limits.total_memory);
        Some(container.filter(|limit| *limit > 0).map_or(machine, |limit| limit.min(machine)))
    })
}

/// The resident memory of the process; `None` if the system does not report it.
#[must_use]
pub fn resident_bytes() -> Option<u64> {
    let id = sysinfo::get_current_pid().ok()?;
    let mut system = System::new();
    let what = ProcessRefreshKind::nothing().with_memory();
    system.refresh_processes_specifics(ProcessesToUpdate::Some(&[id]), false, what);
    system.process(id).map(sysinfo::Process::memory)
}

/// What the library asks of the program's allocator.
#[derive(Clone, Copy, Debug)]
pub struct Allocator {
    /// Returns free memory to the system at once.
    pub give_back: fn(),
    /// Whether memory that is freed from now on stays with the process.
    pub keep_freed: fn(bool),
}

/// The program's allocator; of several calls the first counts.
static ALLOCATOR: OnceLock<Allocator> = OnceLock::new();

/// Tells the library about the program's allocator, which it asks to return free memory when memory becomes scarce, and to
/// keep it where large blocks come and go. Without it, glibc's heap is asked, and with another allocator nothing happens. The
/// first call counts.
pub fn set_allocator(allocator: Allocator) {
    ALLOCATOR.get_or_init(|| allocator);
}

fn allocator() -> &'static Allocator {
    ALLOCATOR.get_or_init(|| Allocator { give_back: trim, keep_freed: keep_in_heap })
}

/// Returns the heap's free memory to the system (see [`set_allocator`]).
pub(crate) fn give_back() {
    (allocator().give_back)();
}

/// While it lives, memory that is freed stays with the process: for work that frees large blocks and asks for others of the same size
/// all the time, for which the system would clear its pages each time.
pub(crate) struct KeptMemory(());

/// How many [`KeptMemory`] there are.
static KEEPING: AtomicUsize = AtomicUsize::new(0);

impl KeptMemory {
    pub(crate) fn new() -> Self {
        if KEEPING.fetch_add(1, Ordering::Relaxed) == 0 {
            (allocator().keep_freed)(true);
        }
        Self(())
    }
}

impl Drop for KeptMemory {
    fn drop(&mut self) {
        if KEEPING.fetch_sub(1, Ordering::Relaxed) == 1 {
            (allocator().keep_freed)(false);
        }
    }
}

/// Returns the free memory of glibc's heap.
fn trim() {
    // SAFETY: malloc_trim touches no block that is in use.
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    unsafe {
        libc::malloc_trim(0);
    }
}

/// Whether glibc's heap keeps blocks of up to 32 MiB, the most that it can, instead of mapping each anew.
fn keep_in_heap(keep: bool) {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    {
        // The defaults of glibc are the smaller ones.
        let (map_above, trim_above) = if keep { (32 << 20, 1 << 30) } else { (128 << 10, 128 << 10) };
        // SAFETY: parameters of the heap are set, no block is touched.
        unsafe {
            libc::mallopt(libc::M_MMAP_THRESHOLD, map_above);
            libc::mallopt(libc::M_TRIM_THRESHOLD, trim_above);
        }
    }
    #[cfg(not(all(target_os = "linux", target_env = "gnu")))]
    let _ = keep;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn amounts_are_read_and_written_and_nonsense_is_quoted() {
        for (text, bytes) in [("2GiB", 2 << 30), ("500MB", 500_000_000), ("1.5 GiB", 3 << 29), ("64 B", 64)] {
            let limit: MemoryLimit = text.parse().unwrap();
            assert_eq!(limit, MemoryLimit::Bytes(bytes));
            assert_eq!(limit.to_string().parse(), Ok(limit));
        }
        assert_eq!("70%".parse(), Ok(MemoryLimit::Percent(70)));
        assert_eq!(MemoryLimit::default().to_string(), "70%");
        for wrong in ["", "0", "8", "0B", "0%", "101%", "-1GiB", "2 apples", "%"] {
            let error = MemoryLimit::from_str(wrong).unwrap_err();
            assert!(error.to_string().contains(&format!("{wrong:?}")), "{error}");
        }
    }

    #[test]
    fn a_share_is_of_the_machines_memory_and_what_is_held_is_taken_off() {
        let all = MemoryLimit::Percent(100).bytes();
        assert!(all > 1 << 28 && MemoryLimit::Percent(50).bytes() <= all / 2);
        let remaining = MemoryLimit::Percent(100).remaining();
        assert!(0 < remaining && remaining < all);
        assert_eq!(MemoryLimit::Bytes(1).remaining(), 0);
    }
}
