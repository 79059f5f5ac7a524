//! Work on a thread of its own, and its messages.

use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use pyo3::prelude::*;
use pyo3::types::PyDict;
use vamvs::{Event, Pass, VamvsError};

use crate::{Error, error};

/// How often Ctrl-C is checked.
const LISTEN: Duration = Duration::from_millis(50);

/// How often a thread tries again to send a message.
const OFFER: Duration = Duration::from_millis(5);

/// Whether the interpreter is about to end, and all work with it.
static ENDING: AtomicBool = AtomicBool::new(false);

/// Threads that work.
static WORKING: AtomicUsize = AtomicUsize::new(0);

/// Some work that makes items one by one.
pub struct Work<T> {
    messages: Mutex<Receiver<Message<T>>>,
    stop: Arc<AtomicBool>,
    thread: Mutex<Option<JoinHandle<Result<(), VamvsError>>>>,
    on_event: Option<Py<PyAny>>,
}

/// A message of the thread, which makes the next one while this one is received.
enum Message<T> {
    Event(Event),
    Item(T),
}

/// The thread's end of the channel.
pub struct Teller<T> {
    messages: SyncSender<Message<T>>,
    stop: Arc<AtomicBool>,
}

/// Counts a thread as working while it lives.
struct Working;

impl<T: Send + 'static> Work<T> {
    /// Begins some work; `on_event` receives its progress, and ends the work by returning False.
    pub fn begin(
        on_event: Option<Py<PyAny>>,
        work: impl FnOnce(Teller<T>) -> Result<(), VamvsError> + Send + 'static,
    ) -> Self {
        let (sender, messages) = sync_channel(1);
        let stop = Arc::new(AtomicBool::new(false));
        let teller = Teller { messages: sender, stop: stop.clone() };
        WORKING.fetch_add(1, Ordering::SeqCst);
        let thread = std::thread::spawn(move || {
            let _working = Working;
            work(teller)
        });
        Self { messages: Mutex::new(messages), stop, thread: Mutex::new(Some(thread)), on_event }
    }

    /// The next item; `None` at the end.
    pub fn next(&self, py: Python<'_>) -> PyResult<Option<T>> {
        let next = self.wait_for_next(py);
        if next.is_err() {
            self.stop.store(true, Ordering::SeqCst);
        }
        next
    }

    fn wait_for_next(&self, py: Python<'_>) -> PyResult<Option<T>> {
        loop {
            py.check_signals()?;
            let messages = &self.messages;
            let message =
                py.detach(|| messages.lock().unwrap_or_else(PoisonError::into_inner).recv_timeout(LISTEN));
            match message {
                Ok(Message::Event(event)) => self.tell(py, event)?,
                Ok(Message::Item(item)) => return Ok(Some(item)),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return self.finish().map(|()| None),
            }
        }
    }

    /// Hands an event to Python.
    fn tell(&self, py: Python<'_>, event: Event) -> PyResult<()> {
        let Some(on_event) = &self.on_event else { return Ok(()) };
        let answer = on_event.call1(py, (as_dict(py, event)?,))?;
        if !answer.is_none(py) && !answer.is_truthy(py)? {
            self.stop.store(true, Ordering::SeqCst);
        }
        Ok(())
    }

    fn finish(&self) -> PyResult<()> {
        let thread = self.thread.lock().unwrap_or_else(PoisonError::into_inner).take();
        match thread.map(JoinHandle::join) {
            None | Some(Ok(Ok(()))) => Ok(()),
            Some(Ok(Err(failed))) => Err(error(&failed)),
            Some(Err(_)) => Err(Error::new_err("a bug in vamvs: the work panicked (see the message above)")),
        }
    }
}

impl<T> Drop for Work<T> {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::SeqCst);
    }
}

impl<T> Teller<T> {
    /// Sends an event; returns whether to go on.
    pub fn event(&self, event: Event) -> ControlFlow<()> {
        self.send(Message::Event(event))
    }

    /// Sends an item; an error if nobody wants it any more.
    pub fn item(&self, item: T) -> Result<(), VamvsError> {
        match self.send(Message::Item(item)) {
            ControlFlow::Continue(()) => Ok(()),
            ControlFlow::Break(()) => Err(VamvsError::Cancelled),
        }
    }

    /// Sends a message, after waiting until the one before is received.
    fn send(&self, mut message: Message<T>) -> ControlFlow<()> {
        loop {
            if self.stop.load(Ordering::SeqCst) || ENDING.load(Ordering::SeqCst) {
                return ControlFlow::Break(());
            }
            match self.messages.try_send(message) {
                Ok(()) => return ControlFlow::Continue(()),
                Err(TrySendError::Disconnected(_)) => return ControlFlow::Break(()),
                Err(TrySendError::Full(back)) => message = back,
            }
            std::thread::sleep(OFFER);
        }
    }
}

impl Drop for Working {
    fn drop(&mut self) {
        WORKING.fetch_sub(1, Ordering::SeqCst);
    }
}

/// Ends all work and waits for its threads, at the interpreter's end.
#[pyfunction]
#[pyo3(name = "_wait")]
pub fn wait(py: Python<'_>) {
    ENDING.store(true, Ordering::SeqCst);
    py.detach(|| {
        while WORKING.load(Ordering::SeqCst) > 0 {
            std::thread::sleep(LISTEN);
        }
    });
}

fn as_dict(py: Python<'_>, event: Event) -> PyResult<Bound<'_, PyDict>> {
    let dict = PyDict::new(py);
    let counted = |kind: &str, done: usize, total: usize| {
        dict.set_item("kind", kind)?;
        dict.set_item("done", done)?;
        dict.set_item("total", total)
    };
    match event {
        Event::Warning(text) => {
            dict.set_item("kind", "warning")?;
            dict.set_item("text", text)?;
        }
        Event::DepthMap { name, pass, done, total, resumed, time } => {
            counted("depth_map", done, total)?;
            dict.set_item("name", name)?;
            dict.set_item("pass", if pass == Pass::Final { "final" } else { "photometric" })?;
            dict.set_item("resumed", resumed)?;
            dict.set_item("seconds", time.as_secs_f64())?;
        }
        Event::Fusion { done, total } => counted("fusion", done, total)?,
        Event::Draft { done, total } => counted("draft", done, total)?,
        Event::Mesh { done, total } => counted("mesh", done, total)?,
        Event::Report { done, total } => counted("report", done, total)?,
        Event::Export { done, total } => counted("export", done, total)?,
        other => dict.set_item("kind", format!("{other:?}"))?,
    }
    Ok(dict)
}
