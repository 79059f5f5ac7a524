//! The allocator of the program: mimalloc, in place of the system's `malloc` for libtorch too.
//!
//! A network makes and drops tensors of many megabytes by the thousand. The heap of glibc either maps and unmaps memory
//! for each of them, which takes twice the time in the convolutions, or keeps freed blocks among which the next ones do
//! not fit, so that the process holds twice what is in use. mimalloc reuses them, and returns to the system what
//! nothing has used for a second.

use std::ffi::c_long;
use std::sync::OnceLock;

use mimalloc::MiMalloc;
use vamvs::memory::Allocator;

#[global_allocator]
static MIMALLOC: MiMalloc = MiMalloc;

/// `mi_option_purge_delay`, which the binding does not name: after how many milliseconds, times ten, freed memory is
/// returned to the system.
const PURGE_DELAY: libmimalloc_sys::mi_option_t = 15;

/// The delay while freed memory is kept: ten minutes. If freed memory were never returned, −1, [`give_back`] would
/// return none either.
const KEPT: c_long = 60_000;

/// The delay that the program began with.
static DELAY: OnceLock<c_long> = OnceLock::new();

/// Lets the library return free memory to the system, or keep it.
pub fn register() {
    // SAFETY: an option is read.
    let delay = unsafe { libmimalloc_sys::mi_option_get(PURGE_DELAY) };
    DELAY.get_or_init(|| delay);
    vamvs::memory::set_allocator(Allocator { give_back, keep_freed });
}

fn give_back() {
    // SAFETY: it touches no block that is in use.
    unsafe { libmimalloc_sys::mi_collect(true) }
}

fn keep_freed(keep: bool) {
    let delay = if keep { KEPT } else { *DELAY.get().expect("it was registered") };
    // SAFETY: mimalloc reads the option anew whenever memory is freed.
    unsafe { libmimalloc_sys::mi_option_set(PURGE_DELAY, delay) }
}
