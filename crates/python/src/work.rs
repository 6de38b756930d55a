//! Long work beside Python: on a thread of its own, without the interpreter's lock, heard while it goes, and ended by Ctrl-C.

use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use gearwatch_core::block::Packet;
use gearwatch_core::source::Source;
use pyo3::prelude::*;

use crate::failure::{Failure, What};

/// How often Python is asked whether Ctrl-C was pressed.
const TICK: Duration = Duration::from_millis(50);

enum Message<T> {
    Step(String),
    Done(Result<T, Failure>),
}

/// The worker's side.
pub struct Control<'a> {
    cancelled: &'a AtomicBool,
    tell: &'a dyn Fn(String),
}

/// Unwinds a thread whose work nobody waits for any more.
struct Cancelled;

impl Control<'_> {
    /// Nobody waits for the result any more.
    pub fn is_cancelled(&self) -> bool {
        self.cancelled.load(Ordering::Relaxed)
    }

    /// Says what comes next. Work that cannot return early ends here after Ctrl-C.
    pub fn step(&self, what: &str) {
        if self.is_cancelled() {
            resume_unwind(Box::new(Cancelled));
        }
        (self.tell)(what.to_owned());
    }
}

/// Runs `work` on a thread of its own. `progress` is called with each step's sentence.
pub fn interruptible<T: Send + 'static>(
    py: Python<'_>,
    progress: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce(&Control<'_>) -> Result<T, Failure> + Send + 'static,
) -> PyResult<T> {
    let (sender, receiver) = channel();
    let cancelled = Arc::new(AtomicBool::new(false));
    let seen = cancelled.clone();
    std::thread::Builder::new().name("gearwatch".to_owned()).spawn(move || run(&seen, &sender, work))?;
    // Shared with the closure that waits without the lock.
    let receiver = Mutex::new(receiver);
    let give_up = |error: PyErr| {
        cancelled.store(true, Ordering::Relaxed);
        error
    };
    loop {
        match py.detach(|| wait(&receiver)) {
            Ok(Message::Step(what)) => {
                if let Some(progress) = progress {
                    progress.call1((what,)).map_err(give_up)?;
                }
            }
            Ok(Message::Done(result)) => return Ok(result?),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => {
                return Err(Failure::new(What::Other, "a thread of gearwatch has ended: a fault of the program").into());
            }
        }
        py.check_signals().map_err(give_up)?;
    }
}

fn wait<T>(receiver: &Mutex<Receiver<Message<T>>>) -> Result<Message<T>, RecvTimeoutError> {
    receiver.lock().unwrap_or_else(PoisonError::into_inner).recv_timeout(TICK)
}

fn run<T>(cancelled: &AtomicBool, sender: &Sender<Message<T>>, work: impl FnOnce(&Control<'_>) -> Result<T, Failure>) {
    let tell = |what| drop(sender.send(Message::Step(what)));
    let control = Control { cancelled, tell: &tell };
    // A panic has been printed by its hook; without a result the other side says that the thread has ended.
    if let Ok(result) = catch_unwind(AssertUnwindSafe(|| work(&control))) {
        // Nobody listens after Ctrl-C.
        let _ = sender.send(Message::Done(result));
    }
}

/// A source that ends when nobody waits for it any more.
pub struct Heeding<'a, S> {
    pub source: S,
    pub control: &'a AtomicBool,
}

impl<'a, S> Heeding<'a, S> {
    pub fn new(source: S, control: &Control<'a>) -> Self {
        Self { source, control: control.cancelled }
    }
}

impl<S: Source> Source for Heeding<'_, S>
where
    Failure: From<S::Error>,
{
    type Error = Failure;

    fn next_packet(&mut self) -> Result<Option<Packet>, Failure> {
        if self.control.load(Ordering::Relaxed) {
            return Err(Failure::interrupted());
        }
        Ok(self.source.next_packet()?)
    }
}
