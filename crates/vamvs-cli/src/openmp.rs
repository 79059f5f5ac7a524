//! How libtorch's threads wait for each other.
//!
//! libgomp lets a thread that waits spin. Where another process has one of the cores, the others then spin for as long as
//! the one without a core waits for it, and a depth map takes several times as long. Asleep they take nothing. libgomp reads
//! its settings when it is loaded, before `main`, so the program starts itself once more with them.

/// Makes waiting threads sleep, unless the environment says how they shall wait.
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
    // It returns only if it fails; then threads wait as libgomp wants.
    let _ = again.args(arguments).env(SETTINGS[0], "passive").exec();
}

/// Elsewhere libtorch brings another OpenMP, whose threads sleep after a while.
#[cfg(not(target_os = "linux"))]
pub fn wait_asleep() {}
