//! The allocator of the program: mimalloc, in place of the system's `malloc` for libtorch too.
//!
//! A network makes and drops tensors of many megabytes by the thousand. The heap of glibc either maps and unmaps memory
//! for each of them, which takes twice the time in the convolutions, or keeps freed blocks among which the next ones do
//! not fit, so that the process holds twice what is in use. mimalloc reuses them, and returns to the system what
//! nothing has used for a second.

use mimalloc::MiMalloc;

#[global_allocator]
static MIMALLOC: MiMalloc = MiMalloc;

/// Lets the library return free memory to the system at once when it becomes scarce.
pub fn register() {
    vamvs::memory::set_give_back(|| {
        // SAFETY: it touches no block that is in use.
        unsafe { libmimalloc_sys::mi_collect(true) }
    });
}
