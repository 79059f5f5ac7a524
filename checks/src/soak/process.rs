//! Runs the program, sends it signals, and watches its memory.

use std::fmt;
use std::fs::{self, OpenOptions};
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, ensure};

/// Interval at which the program's memory is read and due signals are sent.
const TICK: Duration = Duration::from_millis(10);

/// A signal and the time after the start at which it is sent.
#[derive(Clone, Copy, Debug)]
pub struct Timed {
    pub at: Duration,
    pub signal: Signal,
}

/// A signal that the program is sent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Signal {
    Kill,
    Terminate,
    Stop,
    Continue,
}

/// How a run ended.
#[derive(Clone, Debug)]
pub struct Ended {
    pub code: Option<i32>,
    pub signal: Option<i32>,
    pub seconds: f64,
    /// Peak of resident memory, bytes.
    pub peak_bytes: u64,
    /// Everything written to standard error.
    pub messages: String,
}

/// The `vamvs` program.
pub struct Program(PathBuf);

impl Program {
    /// The program at `path`, which must exist.
    pub fn new(path: PathBuf) -> Result<Self> {
        ensure!(path.is_file(), "{} is no file: build it with `cargo build --release`", path.display());
        Ok(Self(path))
    }

    /// Runs the program until it ends. Its messages go to the file `messages.txt` in `folder`.
    pub fn run(&self, arguments: &[String], folder: &Path, signals: &[Timed]) -> Result<Ended> {
        let log = folder.join("messages.txt");
        let messages = OpenOptions::new().create(true).write(true).truncate(true).open(&log)?;
        let mut command = Command::new(&self.0);
        // Waiting OpenMP threads must not spin: they would take the processor from threads that work.
        command.env("OMP_WAIT_POLICY", "passive").args(arguments).stdout(Stdio::null()).stderr(messages);
        let begin = Instant::now();
        let mut child =
            command.spawn().with_context(|| format!("{} could not be started", self.0.display()))?;
        let (mut peak_bytes, mut waiting) = (0, signals.to_vec());
        let status = loop {
            peak_bytes = peak_bytes.max(peak_of(&child));
            waiting = send_due(&child, waiting, begin)?;
            match child.try_wait()? {
                Some(status) => break status,
                None => thread::sleep(TICK),
            }
        };
        let seconds = begin.elapsed().as_secs_f64();
        let messages = String::from_utf8_lossy(&fs::read(&log)?).into_owned();
        Ok(Ended { code: status.code(), signal: status.signal(), seconds, peak_bytes, messages })
    }
}

/// Sends the signals that are due, and returns the others.
fn send_due(child: &Child, signals: Vec<Timed>, begin: Instant) -> Result<Vec<Timed>> {
    let (due, later): (Vec<Timed>, Vec<Timed>) = signals.into_iter().partition(|s| s.at <= begin.elapsed());
    for Timed { signal, .. } in due {
        let name = match signal {
            Signal::Kill => "-KILL",
            Signal::Terminate => "-TERM",
            Signal::Stop => "-STOP",
            Signal::Continue => "-CONT",
        };
        Command::new("kill").args([name, &child.id().to_string()]).stderr(Stdio::null()).status()?;
    }
    Ok(later)
}

/// The peak of resident memory so far, bytes; 0 if `/proc` does not say.
fn peak_of(child: &Child) -> u64 {
    let status = fs::read_to_string(format!("/proc/{}/status", child.id())).unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let kilobytes = line.and_then(|line| line.split_whitespace().next()?.parse::<u64>().ok());
    kilobytes.unwrap_or(0) << 10
}

impl Ended {
    /// Whether some thread panicked.
    pub fn panicked(&self) -> bool {
        self.messages.contains("panicked at")
    }

    /// Where and why the first thread panicked: two lines of the messages.
    pub fn panic_line(&self) -> String {
        let mut lines = self.messages.lines().skip_while(|line| !line.contains("panicked at")).take(2);
        format!("{} {}", lines.next().unwrap_or_default(), lines.next().unwrap_or_default())
    }

    /// The last message.
    pub fn last_line(&self) -> &str {
        self.messages.lines().rfind(|line| !line.trim().is_empty()).unwrap_or("no messages")
    }
}

impl fmt::Display for Ended {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (self.code, self.signal) {
            (Some(code), _) => write!(f, "exit code {code}"),
            (None, Some(signal)) => write!(f, "signal {signal}"),
            (None, None) => write!(f, "neither exit code nor signal"),
        }
    }
}
