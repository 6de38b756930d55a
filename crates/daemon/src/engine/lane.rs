//! One bench's way through the engine: windows are cut on one thread, judged in order on another,
//! worked on by the pool in between.

use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TryRecvError, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;

use gearwatch_core::analysis::WindowAnalysis;
use gearwatch_core::assemble::{Assembler, Counters, Gap, Taker};
use gearwatch_core::block::Packet;
use gearwatch_core::pipeline::Pipeline;
use gearwatch_core::verdict::Verdict;
use gearwatch_core::window::Window;
use gearwatch_runtime::queue::Inlet;

use super::pool::{Done, Job, Pool, Way};

/// What happens when all carriers are under way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Overloaded {
    /// Cutting waits, and with it the sources.
    Wait,
    /// Whole windows are shed and counted.
    Shed,
}

/// Consecutive windows of one channel that nobody had time for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Shed {
    /// Sensor name.
    pub sensor: Arc<str>,
    /// Number of the first window that was shed.
    pub first_window: u64,
    /// Number of the last one.
    pub last_window: u64,
}

/// What a lane tells. The order is that of the windows, whatever the number of workers.
#[derive(Debug)]
pub enum Told<'a> {
    /// A window and what was measured in it; its verdicts come next.
    Window(&'a Window, &'a WindowAnalysis),
    /// A verdict.
    Verdict(&'a Verdict),
    /// Samples are missing, or do not follow each other.
    Gap(&'a Gap),
    /// Windows were shed.
    Shed(&'a Shed),
    /// A worker panicked at this window; it has no verdict.
    Failed {
        /// Sensor name.
        sensor: &'a str,
        /// Number of the window.
        window: u64,
    },
}

/// What went through a lane. `cut = judged + failed + shed + under way`.
#[derive(Debug, Default)]
pub struct LaneCounters {
    packets: AtomicU64,
    cut: AtomicU64,
    judged: AtomicU64,
    failed: AtomicU64,
    shed: AtomicU64,
    verdicts: AtomicU64,
    samples: Mutex<Counters>,
}

impl LaneCounters {
    /// Packets taken in.
    pub fn packets(&self) -> u64 {
        self.packets.load(Ordering::Relaxed)
    }

    /// Windows cut.
    pub fn cut(&self) -> u64 {
        self.cut.load(Ordering::Relaxed)
    }

    /// Windows judged.
    pub fn judged(&self) -> u64 {
        self.judged.load(Ordering::Relaxed)
    }

    /// Windows at which a worker panicked.
    pub fn failed(&self) -> u64 {
        self.failed.load(Ordering::Relaxed)
    }

    /// Windows shed because the workers were too slow.
    pub fn shed(&self) -> u64 {
        self.shed.load(Ordering::Relaxed)
    }

    /// Verdicts given.
    pub fn verdicts(&self) -> u64 {
        self.verdicts.load(Ordering::Relaxed)
    }

    /// What happened to the samples.
    pub fn samples(&self) -> Counters {
        // A copy that is replaced whole is never half written.
        *self.samples.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// What a lane is made from.
#[derive(Debug)]
pub struct Lane {
    /// The row of stages.
    pub pipeline: Arc<Pipeline>,
    /// When all carriers are under way.
    pub overloaded: Overloaded,
    /// Carriers per worker (at least 1).
    pub windows_per_worker: usize,
}

/// A running lane. It ends when its packets end and all windows are judged.
#[derive(Debug)]
pub struct LaneHandle {
    counters: Arc<LaneCounters>,
    cut: JoinHandle<()>,
    rank: JoinHandle<()>,
    died: Arc<AtomicBool>,
}

/// A thread of a lane panicked: what it held is lost, and the lane cannot go on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the thread {thread} panicked")]
pub struct LaneDied {
    /// Name of the thread.
    pub thread: &'static str,
}

impl LaneHandle {
    /// What went through it so far.
    pub fn counters(&self) -> &Arc<LaneCounters> {
        &self.counters
    }

    /// Both threads have ended.
    pub fn is_finished(&self) -> bool {
        self.cut.is_finished() && self.rank.is_finished()
    }

    /// Either thread has ended by a panic.
    pub fn has_died(&self) -> bool {
        self.died.load(Ordering::Acquire)
    }

    /// Waits for its end.
    ///
    /// # Errors
    /// When one of its threads panicked.
    pub fn join(self) -> Result<(), LaneDied> {
        self.cut.join().map_err(|_| LaneDied { thread: "gw-cut" })?;
        self.rank.join().map_err(|_| LaneDied { thread: "gw-rank" })
    }
}

impl Lane {
    /// Starts the lane's two threads. `tell` is called on the judging thread.
    ///
    /// # Errors
    /// When the system does not give a thread.
    pub fn start(
        self,
        pool: &Pool,
        packets: Inlet<Packet>,
        tell: impl FnMut(Told<'_>) + Send + 'static,
    ) -> std::io::Result<LaneHandle> {
        let counters = Arc::new(LaneCounters::default());
        let (done, finished) = async_channel::unbounded();
        let way = Arc::new(Way { pipeline: self.pipeline, done });
        let carriers = self.windows_per_worker.max(1) * pool.workers() + 1;
        let (back, free) = sync_channel(carriers);
        for _ in 0..carriers {
            let empty = Box::new(Job {
                way: way.clone(),
                seq: 0,
                window: None,
                analysis: WindowAnalysis::empty(),
                failed: false,
                shed: Vec::new(),
                gaps: Vec::new(),
            });
            // There is room for all of them.
            let _ = back.try_send(empty);
        }
        let cutter = Cutter {
            jobs: pool.jobs(),
            free,
            spare: None,
            overloaded: self.overloaded,
            counters: counters.clone(),
            way: way.clone(),
            seq: 0,
            shed: Vec::new(),
            gaps: Vec::new(),
            returned: Vec::new(),
        };
        let died = Arc::new(AtomicBool::new(false));
        let ranker = Ranker { counters: counters.clone(), way, back, next: 0, waiting: VecDeque::new() };
        let cut = std::thread::Builder::new().name("gw-cut".to_owned()).spawn({
            let died = died.clone();
            move || or_died(&died, || cutter.run(&packets))
        })?;
        let rank = std::thread::Builder::new().name("gw-rank".to_owned()).spawn({
            let died = died.clone();
            move || or_died(&died, || ranker.run(&finished, tell))
        })?;
        Ok(LaneHandle { counters, cut, rank, died })
    }
}

/// Says so when a thread ends by a panic, before it ends.
fn or_died(died: &AtomicBool, run: impl FnOnce()) {
    if let Err(panic) = catch_unwind(AssertUnwindSafe(run)) {
        died.store(true, Ordering::Release);
        resume_unwind(panic);
    }
}

/// How long cutting waits before it looks again whether a carrier has come back.
const CARRIER_WAIT: std::time::Duration = std::time::Duration::from_millis(1);

/// The thread that cuts windows.
struct Cutter {
    jobs: async_channel::Sender<Box<Job>>,
    free: Receiver<Box<Job>>,
    /// A carrier that was taken for a window which is being made.
    spare: Option<Box<Job>>,
    overloaded: Overloaded,
    counters: Arc<LaneCounters>,
    way: Arc<Way>,
    seq: u64,
    shed: Vec<Shed>,
    gaps: Vec<Gap>,
    returned: Vec<Window>,
}

/// The other threads of the lane have gone.
struct Gone;

impl Cutter {
    fn run(mut self, packets: &Inlet<Packet>) {
        // However this thread ends, the judging thread is told that no more comes.
        let ended = catch_unwind(AssertUnwindSafe(|| self.cut(packets)));
        let _ = self.way.done.send_blocking(Done::End { jobs: self.seq, shed: self.shed, gaps: self.gaps });
        if let Err(panic) = ended {
            resume_unwind(panic);
        }
    }

    fn cut(&mut self, packets: &Inlet<Packet>) -> Result<(), Gone> {
        let mut assembler = self.way.pipeline.assembler();
        while let Ok(packet) = packets.recv_blocking() {
            gearwatch_runtime::fail::point("cut");
            self.counters.packets.fetch_add(1, Ordering::Relaxed);
            self.step(&mut assembler, packets, |assembler, taker| assembler.push_to(&packet, taker))?;
        }
        self.step(&mut assembler, packets, Assembler::finish_to)
    }

    fn step(
        &mut self,
        assembler: &mut Assembler,
        packets: &Inlet<Packet>,
        push: impl FnOnce(&mut Assembler, &mut dyn Taker),
    ) -> Result<(), Gone> {
        let mut dispatcher = Dispatcher { cutter: self, packets, result: Ok(()) };
        push(assembler, &mut dispatcher);
        let result = dispatcher.result;
        self.gaps.extend(assembler.take_gaps());
        for window in self.returned.drain(..) {
            assembler.recycle(window);
        }
        *self.counters.samples.lock().unwrap_or_else(PoisonError::into_inner) = *assembler.counters();
        result
    }

    /// Gives a window to the workers, or sheds it.
    fn dispatch(&mut self, window: Window, packets: &Inlet<Packet>) -> Result<(), Gone> {
        let mut job = match self.overloaded {
            Overloaded::Wait => self.free.recv().map_err(|_| Gone)?,
            Overloaded::Shed => match self.carrier_unless_behind(packets)? {
                Some(job) => job,
                None => {
                    self.shed(&window.sensor, window.number);
                    self.returned.push(window);
                    return Ok(());
                }
            },
        };
        self.counters.cut.fetch_add(1, Ordering::Relaxed);
        self.returned.extend(job.window.replace(window));
        job.seq = self.seq;
        self.seq += 1;
        job.failed = false;
        // What was shed or missing before this window is told before its verdict.
        std::mem::swap(&mut job.shed, &mut self.shed);
        std::mem::swap(&mut job.gaps, &mut self.gaps);
        self.jobs.send_blocking(job).map_err(|_| Gone)
    }

    /// A carrier, waited for while there is room for the packets that come meanwhile: the windows
    /// of many channels are complete in the same moment, and that is no overload. None when half of
    /// the packets' queue is full.
    fn carrier_unless_behind(&mut self, packets: &Inlet<Packet>) -> Result<Option<Box<Job>>, Gone> {
        if let Some(job) = self.spare.take() {
            return Ok(Some(job));
        }
        loop {
            // As soon as there is one: a worker that waits for windows is lost to all of them.
            match self.free.recv_timeout(CARRIER_WAIT) {
                Ok(job) => return Ok(Some(job)),
                Err(RecvTimeoutError::Disconnected) => return Err(Gone),
                Err(RecvTimeoutError::Timeout) if is_behind(packets) => return Ok(None),
                Err(RecvTimeoutError::Timeout) => {}
            }
        }
    }

    fn shed(&mut self, sensor: &Arc<str>, number: u64) {
        self.counters.cut.fetch_add(1, Ordering::Relaxed);
        self.counters.shed.fetch_add(1, Ordering::Relaxed);
        match self.shed.iter_mut().find(|run| run.sensor == *sensor && run.last_window + 1 == number) {
            Some(run) => run.last_window = number,
            None => self.shed.push(Shed { sensor: sensor.clone(), first_window: number, last_window: number }),
        }
    }
}

/// Half of the packets' queue is full. At the end nothing more comes that could be late.
fn is_behind(packets: &Inlet<Packet>) -> bool {
    packets.capacity().is_some_and(|capacity| 2 * packets.len() >= capacity) && !packets.is_closed()
}

/// Takes the windows of one packet.
struct Dispatcher<'a> {
    cutter: &'a mut Cutter,
    packets: &'a Inlet<Packet>,
    result: Result<(), Gone>,
}

impl Taker for Dispatcher<'_> {
    /// Under overload a window for which there is no carrier is not even made: ten times what the
    /// workers can do must not cost them their time.
    fn wants(&mut self, sensor: &Arc<str>, number: u64) -> bool {
        let Self { cutter, packets, result } = self;
        if cutter.overloaded == Overloaded::Wait || cutter.spare.is_some() || !is_behind(packets) {
            return true;
        }
        match cutter.free.try_recv() {
            Ok(job) => cutter.spare = Some(job),
            Err(TryRecvError::Empty) => cutter.shed(sensor, number),
            Err(TryRecvError::Disconnected) => *result = Err(Gone),
        }
        cutter.spare.is_some()
    }

    fn take(&mut self, window: Window) {
        if self.result.is_ok() {
            self.result = self.cutter.dispatch(window, self.packets);
        }
    }
}

/// The thread that judges.
struct Ranker {
    counters: Arc<LaneCounters>,
    way: Arc<Way>,
    back: SyncSender<Box<Job>>,
    next: u64,
    /// `waiting[i]` is job `next + i`, where it has come.
    waiting: VecDeque<Option<Box<Job>>>,
}

impl Ranker {
    fn run(mut self, finished: &async_channel::Receiver<Done>, mut tell: impl FnMut(Told<'_>)) {
        let mut verdicts = Vec::new();
        let mut end = None;
        while end.as_ref().is_none_or(|&(jobs, _, _)| jobs > self.next) {
            match finished.recv_blocking() {
                Ok(Done::Job(job)) => self.keep(job),
                Ok(Done::End { jobs, shed, gaps }) => end = Some((jobs, shed, gaps)),
                Err(_) => return,
            }
            while let Some(mut job) = self.waiting.front_mut().and_then(Option::take) {
                self.waiting.pop_front();
                self.next += 1;
                self.judge(&mut job, &mut verdicts, &mut tell);
                // The cutting thread may have ended.
                let _ = self.back.try_send(job);
            }
        }
        if let Some((_, shed, gaps)) = end {
            tell_losses(&shed, &gaps, &mut tell);
        }
    }

    /// Puts a job to where its turn is. There are never more than there are carriers.
    fn keep(&mut self, job: Box<Job>) {
        let at = usize::try_from(job.seq.saturating_sub(self.next)).unwrap_or(usize::MAX);
        while self.waiting.len() <= at {
            self.waiting.push_back(None);
        }
        self.waiting[at] = Some(job);
    }

    fn judge(&self, job: &mut Job, verdicts: &mut Vec<Verdict>, tell: &mut impl FnMut(Told<'_>)) {
        gearwatch_runtime::fail::point("rank");
        tell_losses(&job.shed, &job.gaps, tell);
        job.shed.clear();
        job.gaps.clear();
        if job.failed {
            self.counters.failed.fetch_add(1, Ordering::Relaxed);
            if let Some(window) = &job.window {
                tell(Told::Failed { sensor: &window.sensor, window: window.number });
            }
            return;
        }
        self.way.pipeline.judge(&job.analysis, verdicts);
        if let Some(window) = &job.window {
            tell(Told::Window(window, &job.analysis));
        }
        for verdict in verdicts.iter() {
            tell(Told::Verdict(verdict));
        }
        self.counters.judged.fetch_add(1, Ordering::Relaxed);
        self.counters.verdicts.fetch_add(verdicts.len() as u64, Ordering::Relaxed);
    }
}

fn tell_losses(shed: &[Shed], gaps: &[Gap], tell: &mut impl FnMut(Told<'_>)) {
    for gap in gaps {
        tell(Told::Gap(gap));
    }
    for shed in shed {
        tell(Told::Shed(shed));
    }
}
