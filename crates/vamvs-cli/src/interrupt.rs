//! Ctrl-C: removes unfinished files and prints how to go on.

use anyhow::Result;

/// Exit code of a process that a signal ended, minus the number of the signal.
#[cfg(unix)]
const SIGNALLED: i32 = 128;

/// From now on Ctrl-C, or a request to terminate, removes unfinished files, prints `farewell` and
/// ends the process; a second one ends it at once.
#[cfg(unix)]
pub fn watch(farewell: &'static str) -> Result<()> {
    use std::sync::Arc;
    use std::sync::atomic::{AtomicBool, Ordering};

    use anyhow::Context;
    use signal_hook::consts::{SIGINT, SIGTERM};
    use signal_hook::{flag, iterator::Signals, low_level};

    let stopping = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM] {
        flag::register_conditional_shutdown(signal, SIGNALLED + signal, Arc::clone(&stopping))
            .context("cannot watch for Ctrl-C")?;
    }
    let mut signals = Signals::new([SIGINT, SIGTERM]).context("cannot watch for Ctrl-C")?;
    std::thread::spawn(move || {
        let Some(signal) = signals.forever().next() else { return };
        stopping.store(true, Ordering::SeqCst);
        vamvs::io::atomic::end();
        warn!("\n{farewell}");
        // Not `process::exit`: destructors of libtorch would run while its threads still work.
        low_level::exit(SIGNALLED + signal);
    });
    Ok(())
}

/// Elsewhere the system ends the process; files are written whole or not at all.
#[cfg(not(unix))]
pub fn watch(_farewell: &'static str) -> Result<()> {
    Ok(())
}
