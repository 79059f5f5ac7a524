//! How the heap of glibc treats the large blocks of tensors.
//!
//! A network makes and drops tensors of many megabytes by the thousand. By default glibc maps and
//! unmaps memory for each of them, and the kernel clears all pages each time: about a tenth of the
//! time of a depth map. Without glibc nothing is changed.

/// While this exists, freed blocks of any size stay in the process for reuse. Dropping it returns
/// free memory to the system.
pub struct KeptBlocks(());

impl KeptBlocks {
    /// Keeps freed blocks from now on.
    pub fn begin() -> Self {
        set_thresholds(i32::MAX, i32::MAX);
        Self(())
    }
}

impl Drop for KeptBlocks {
    fn drop(&mut self) {
        const MIB: i32 = 1 << 20;
        set_thresholds(4 * MIB, 8 * MIB);
        vamvs::memory::give_back();
    }
}

/// Blocks of at least `mapped` bytes get a mapping of their own; more than `top` free bytes at the
/// end of the heap are returned to the system.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
fn set_thresholds(mapped: i32, top: i32) {
    // SAFETY: mallopt takes any two numbers at any time; what it refuses it leaves as it was.
    unsafe {
        libc::mallopt(libc::M_MMAP_THRESHOLD, mapped);
        libc::mallopt(libc::M_TRIM_THRESHOLD, top);
    }
}

#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
fn set_thresholds(_mapped: i32, _top: i32) {}
