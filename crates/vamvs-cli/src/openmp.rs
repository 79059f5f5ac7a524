//! How libtorch's threads wait for each other.
//!
//! Waiting threads of libgomp spin. If another process occupies a core, all other threads spin
//! until the thread without a core is done, and a depth map takes several times as long. Sleeping
//! threads cost nothing. libgomp reads its settings when it is loaded, before `main`, so the
//! program restarts itself with them.

/// Makes waiting threads sleep, unless the environment already sets how they wait.
#[cfg(target_os = "linux")]
pub fn wait_asleep() {
    use std::os::unix::process::CommandExt;

    const SETTINGS: [&str; 2] = ["OMP_WAIT_POLICY", "GOMP_SPINCOUNT"];
    if SETTINGS.iter().any(|name| std::env::var_os(name).is_some()) {
        return;
    }
    let Ok(program) = std::env::current_exe() else { return };
    let mut arguments = std::env::args_os();
    let mut again = std::process::Command::new(program);
    if let Some(name) = arguments.next() {
        again.arg0(name);
    }
    // `exec` returns only if it fails; then the default of libgomp stays.
    let _ = again.args(arguments).env(SETTINGS[0], "passive").exec();
}

/// Elsewhere libtorch brings another OpenMP, whose threads sleep after a while.
#[cfg(not(target_os = "linux"))]
pub fn wait_asleep() {}
