//! Long work beside Python: on a thread of its own, without the interpreter's lock, heard while it
//! goes, and ended by Ctrl-C.

use std::cell::RefCell;
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

/// Ends the work of several threads of Python at once: Ctrl-C is heard by the main one only.
#[pyclass(frozen, module = "gearwatch")]
#[derive(Default)]
pub struct Cancel(Arc<AtomicBool>);

#[pymethods]
impl Cancel {
    #[new]
    fn new() -> Self {
        Self::default()
    }

    /// Ends all work of threads that heed it.
    fn now(&self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

thread_local! {
    static HEEDED: RefCell<Option<Arc<AtomicBool>>> = const { RefCell::new(None) };
}

/// From here on, work that this thread of Python begins ends with `cancel` too.
#[pyfunction]
pub fn heed(cancel: &Cancel) {
    HEEDED.set(Some(cancel.0.clone()));
}

/// The worker's side.
pub struct Control<'a> {
    cancelled: &'a AtomicBool,
    tell: &'a (dyn Fn(String) + Sync),
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
    let cancelled = HEEDED.with_borrow(Clone::clone).unwrap_or_default();
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
        if cancelled.load(Ordering::Relaxed) {
            return Err(Failure::interrupted().into());
        }
    }
}

fn wait<T>(receiver: &Mutex<Receiver<Message<T>>>) -> Result<Message<T>, RecvTimeoutError> {
    receiver.lock().unwrap_or_else(PoisonError::into_inner).recv_timeout(TICK)
}

fn run<T: Send>(
    cancelled: &AtomicBool,
    sender: &Sender<Message<T>>,
    work: impl FnOnce(&Control<'_>) -> Result<T, Failure>,
) {
    let tell = |what| drop(sender.send(Message::Step(what)));
    let control = Control { cancelled, tell: &tell };
    // A panic has been printed by its hook; without a result the other side says that the thread
    // has ended.
    if let Ok(result) = catch_unwind(AssertUnwindSafe(|| work(&control))) {
        // Nobody listens after Ctrl-C.
        let _ = sender.send(Message::Done(result));
    }
}

/// How much of a source has passed, of how much; 0 where the whole is not known.
pub trait Measured {
    /// Passed, and all, in any unit.
    fn passed(&self) -> (u64, u64);
}

/// A source that ends when nobody waits for it any more.
pub struct Heeding<'a, S> {
    pub source: S,
    control: &'a Control<'a>,
    /// Says the passed share of a source of this name.
    tell: Option<(String, fn(&S) -> (u64, u64))>,
    told_percent: u64,
}

impl<'a, S> Heeding<'a, S> {
    pub fn new(source: S, control: &'a Control<'a>) -> Self {
        Self { source, control, tell: None, told_percent: 0 }
    }

    /// Says now and then how much has passed.
    pub fn telling(mut self, name: &str) -> Self
    where
        S: Measured,
    {
        self.control.step(name);
        self.tell = Some((name.to_owned(), S::passed));
        self
    }
}

impl<S: Source> Source for Heeding<'_, S>
where
    Failure: From<S::Error>,
{
    type Error = Failure;

    fn next_packet(&mut self) -> Result<Option<Packet>, Failure> {
        if self.control.is_cancelled() {
            return Err(Failure::interrupted());
        }
        if let Some((name, passed)) = &self.tell
            && let (passed, all) = passed(&self.source)
            && let Some(percent) = (100 * passed).checked_div(all)
            && percent > self.told_percent
        {
            self.told_percent = percent;
            self.control.step(&format!("{name}: {percent} %"));
        }
        Ok(self.source.next_packet()?)
    }
}
