//! The work of one shard: recordings on all cores, a recording a thread at a time.

use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use gearwatch_core::analysis::WindowAnalysis;
use gearwatch_core::pipeline::{Pipeline, WorkerState};
use gearwatch_core::source::Source;
use gearwatch_core::verdict::Verdict;
use gearwatch_io::OpenOptions;

use crate::part::{Identity, PartError, PieceWriter, Workshop, identify};
use crate::rows::Rows;
use crate::shard::Shard;

/// Rows gathered before they go to the piece; bounds the memory of a thread whatever the length of a recording.
const ROWS_AT_A_TIME: usize = 4096;

/// What a shard is to do.
pub struct Job<'a> {
    /// The whole work list: position decides which shard has a recording.
    pub recordings: &'a [PathBuf],
    /// Which part of it.
    pub shard: Shard,
    /// Folder of the parts.
    pub folder: &'a Path,
    /// How recordings are judged.
    pub pipeline: &'a Pipeline,
    /// What recordings leave unsaid.
    pub options: &'a OpenOptions,
    /// Everything beside the recordings that the rows depend on, as text: rows made with other settings are made again.
    pub settings: &'a str,
    /// Threads.
    pub threads: usize,
}

/// What happened to a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// It was worked; so many rows.
    Done(usize),
    /// An earlier run had done it.
    Known,
    /// It cannot be read; why.
    Damaged(String),
}

/// What came of a shard.
#[derive(Debug)]
pub struct Summary {
    /// The part.
    pub part: PathBuf,
    /// Each recording of the shard, in order.
    pub outcomes: Vec<(PathBuf, Outcome)>,
}

impl Summary {
    /// Recordings that could not be read, with the reason.
    pub fn damaged(&self) -> impl Iterator<Item = (&Path, &str)> {
        self.outcomes.iter().filter_map(|(path, outcome)| match outcome {
            Outcome::Damaged(why) => Some((path.as_path(), why.as_str())),
            _ => None,
        })
    }
}

/// Works a shard. `told` hears of each recording as it is finished, from any thread. A damaged recording is passed over; a disk that
/// is full or gone ends the work, and what was finished is kept for the next run.
///
/// # Errors
/// When files of the batch cannot be written.
pub fn run(job: &Job<'_>, told: &(dyn Fn(&Path, &Outcome) + Sync)) -> Result<Summary, PartError> {
    let workshop = Workshop::open(job.folder, job.shard, job.settings)?;
    let mine: Vec<&PathBuf> =
        job.recordings.iter().enumerate().filter(|(position, _)| job.shard.holds(*position)).map(|(_, p)| p).collect();
    let results: Vec<Mutex<Option<Finished>>> = mine.iter().map(|_| Mutex::new(None)).collect();
    let next = AtomicUsize::new(0);
    let failure = Mutex::new(None);
    std::thread::scope(|scope| {
        for _ in 0..job.threads.clamp(1, mine.len().max(1)) {
            scope.spawn(|| {
                let mut bench = Workbench::new(job.pipeline);
                loop {
                    let position = next.fetch_add(1, Ordering::Relaxed);
                    let Some(path) = mine.get(position) else { return };
                    match bench.work(job, &workshop, path) {
                        Ok(finished) => {
                            told(path, &finished.outcome);
                            *lock(&results[position]) = Some(finished);
                        }
                        Err(error) => {
                            lock(&failure).get_or_insert(error);
                            // Nobody begins another recording.
                            next.store(mine.len(), Ordering::Relaxed);
                        }
                    }
                }
            });
        }
    });
    if let Some(error) = lock(&failure).take() {
        return Err(error);
    }
    let mut outcomes = Vec::with_capacity(mine.len());
    let mut identities = Vec::with_capacity(mine.len());
    for (path, result) in mine.into_iter().zip(results) {
        if let Some(finished) = lock(&result).take() {
            identities.extend(finished.identity);
            outcomes.push((path.clone(), finished.outcome));
        }
    }
    Ok(Summary { part: workshop.finish(&identities)?, outcomes })
}

fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    // Values behind these locks are replaced whole; a panic elsewhere ends the scope anyway.
    mutex.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}

struct Finished {
    /// `None` for a recording that left no piece.
    identity: Option<Identity>,
    outcome: Outcome,
}

/// What a thread keeps from recording to recording.
struct Workbench {
    worker: WorkerState,
    analysis: WindowAnalysis,
    verdicts: Vec<Verdict>,
    rows: Rows,
}

/// A recording cannot be read, or the batch cannot be written.
enum Trouble {
    Recording(String),
    Batch(PartError),
}

impl Workbench {
    fn new(pipeline: &Pipeline) -> Self {
        Self {
            worker: pipeline.worker(),
            analysis: WindowAnalysis::empty(),
            verdicts: Vec::new(),
            rows: Rows::default(),
        }
    }

    fn work(&mut self, job: &Job<'_>, workshop: &Workshop, path: &Path) -> Result<Finished, PartError> {
        let name = path.to_string_lossy();
        let identity = match identify(&name, path) {
            Ok(identity) => identity,
            Err(error) => return Ok(Finished { identity: None, outcome: Outcome::Damaged(error.to_string()) }),
        };
        if workshop.is_done(&identity) {
            return Ok(Finished { identity: Some(identity), outcome: Outcome::Known });
        }
        let mut piece = workshop.begin(&identity)?;
        // Rows of a recording that turned out damaged must not go to the next.
        self.rows = Rows::default();
        match self.judge(job, path, &identity, &mut piece) {
            Ok(rows) => {
                piece.finish()?;
                Ok(Finished { identity: Some(identity), outcome: Outcome::Done(rows) })
            }
            Err(Trouble::Recording(why)) => Ok(Finished { identity: None, outcome: Outcome::Damaged(why) }),
            Err(Trouble::Batch(error)) => Err(error),
        }
    }

    fn judge(&mut self, job: &Job<'_>, path: &Path, of: &Identity, piece: &mut PieceWriter) -> Result<usize, Trouble> {
        let unreadable = |error: gearwatch_io::ReadError| Trouble::Recording(error.to_string());
        let mut source = gearwatch_io::open(path, job.options).map_err(unreadable)?;
        let mut assembler = job.pipeline.assembler();
        let mut windows = Vec::new();
        let mut count = 0;
        loop {
            let packet = source.next_packet().map_err(unreadable)?;
            match &packet {
                Some(packet) => assembler.push(packet, &mut |window| windows.push(window)),
                None => assembler.finish(&mut |window| windows.push(window)),
            }
            for window in windows.drain(..) {
                job.pipeline.analyse(&mut self.worker, &window, &mut self.analysis);
                job.pipeline.judge(&self.analysis, &mut self.verdicts);
                for verdict in &self.verdicts {
                    self.rows.push(&of.name, &of.sha256, verdict);
                }
                count += self.verdicts.len();
                assembler.recycle(window);
            }
            if self.rows.len() >= ROWS_AT_A_TIME || packet.is_none() {
                piece.write(&mut self.rows).map_err(Trouble::Batch)?;
            }
            if packet.is_none() {
                return Ok(count);
            }
        }
    }
}
