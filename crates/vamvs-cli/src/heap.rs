//! How the heap of glibc treats the large blocks of tensors.
//!
//! A network makes and drops tensors of many megabytes by the thousand. By default glibc asks the kernel for each of
//! them, which clears all their pages, and gives them back: about a tenth of the time of a depth map. Elsewhere than with
//! glibc nothing is changed.

/// While this lives, freed blocks of any size stay with the process, for the next that want them; at its end what is
/// free goes back to the system.
pub struct KeptBlocks(());

impl KeptBlocks {
    /// Keeps them from now on.
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

/// Blocks from `mapped` bytes on have a mapping of their own, and more than `top` free bytes at the heap's end go back.
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
