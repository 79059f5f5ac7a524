//! Keeping a run beneath its ceiling of memory.

use crate::MemoryLimit;
use crate::memory::{format_bytes, resident_bytes};

/// Watches what the process holds between depth maps.
pub(crate) struct Ceiling {
    /// The most that the process may hold, bytes.
    limit: u64,
    /// Memory that the next depth map needs in addition, bytes.
    needed: u64,
    warned: bool,
}

impl Ceiling {
    /// The ceiling of a run whose depth maps take `needed` bytes each.
    pub fn new(limit: MemoryLimit, needed: u64) -> Self {
        Self { limit: limit.bytes(), needed, warned: false }
    }

    /// Whether the next depth map fits; true if the system does not report the memory in use.
    pub fn has_room(&self) -> bool {
        resident_bytes().is_none_or(|held| held.saturating_add(self.needed) <= self.limit)
    }

    /// A warning if there is no room even with empty caches; given only once.
    pub fn warning(&mut self) -> Option<String> {
        let tight = !self.has_room() && !std::mem::replace(&mut self.warned, true);
        tight.then(|| {
            format!(
                "memory is short: a depth map takes about {}, {} are in use already, and {} are allowed \
                 (--max-memory); features of photographs are not kept",
                format_bytes(self.needed),
                format_bytes(resident_bytes().unwrap_or(0)),
                format_bytes(self.limit)
            )
        })
    }
}
