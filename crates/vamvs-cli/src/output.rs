//! Lines on standard output and standard error.

use std::fmt::Arguments;
use std::io::{ErrorKind, Write};

/// Prints a line on standard output, as `println!` does. A reader that is gone, such as `head`, is no failure: the
/// run goes on.
macro_rules! say {
    ($($text:tt)*) => { $crate::output::line(format_args!($($text)*)) };
}

/// Prints a line on standard error, if anyone reads it.
macro_rules! warn {
    ($($text:tt)*) => { $crate::output::message(format_args!($($text)*)) };
}

/// Prints a line on standard output. Ends the process with code 1 if that fails, as on a full disk, unless nobody
/// reads it any more.
pub fn line(text: Arguments) {
    match writeln!(std::io::stdout().lock(), "{text}") {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            message(format_args!("error: cannot write to standard output: {error}"));
            std::process::exit(1);
        }
        _ => {}
    }
}

/// Prints a line on standard error. There is nowhere to report a failure of that to.
pub fn message(text: Arguments) {
    let _ = writeln!(std::io::stderr().lock(), "{text}");
}
