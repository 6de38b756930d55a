//! The work of one shard: items on all cores, an item a thread at a time.

use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use crate::part::{Identity, PartError, PieceWriter, Table, Workshop};
use crate::shard::Shard;
use crate::worklist::WorkListError;

/// What is done with each item of a list. [`crate::judging`] and [`crate::explaining`] are such
/// work.
pub trait Work: Sync {
    /// What a thread keeps from item to item.
    type Bench;

    /// The columns.
    fn table(&self) -> Table;

    /// A thread begins.
    fn bench(&self) -> Self::Bench;

    /// The keys of an item.
    ///
    /// # Errors
    /// When it cannot be read.
    fn identify(&self, path: &Path) -> Result<Identity, Unreadable>;

    /// Writes the rows of an item to its piece and says how many they are.
    ///
    /// # Errors
    /// When the item cannot be worked, or the piece cannot be written.
    fn work(
        &self,
        bench: &mut Self::Bench,
        path: &Path,
        of: &Identity,
        piece: &mut PieceWriter,
    ) -> Result<usize, Trouble>;
}

/// An item whose keys cannot be known.
#[derive(Debug, thiserror::Error)]
pub enum Unreadable {
    /// One of its files cannot be read.
    #[error(transparent)]
    File(#[from] PartError),
    /// The files that belong to it cannot be listed.
    #[error(transparent)]
    List(#[from] WorkListError),
}

/// An item cannot be worked, or the batch cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum Trouble {
    /// This item is passed over; why.
    #[error("{0}")]
    Item(String),
    /// Nothing can be written any more.
    #[error(transparent)]
    Batch(#[from] PartError),
}

/// What a shard is to do.
pub struct Job<'a> {
    /// The whole work list: position decides which shard has an item.
    pub items: &'a [PathBuf],
    /// Which part of it.
    pub shard: Shard,
    /// Folder of the parts.
    pub folder: &'a Path,
    /// Everything beside the items that the rows depend on, as text: rows made with other settings
    /// are made again.
    pub settings: &'a str,
    /// Threads.
    pub threads: usize,
    /// What each thread does first: how the program sets up its threads.
    pub thread_begins: fn(),
    /// A file of the part's name that was not made with these settings may be replaced.
    pub replace: bool,
}

/// What happened to an item.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// It was worked; so many rows.
    Done(usize),
    /// An earlier run had done it.
    Known,
    /// It cannot be worked; why.
    Damaged(String),
}

/// What came of a shard.
#[derive(Debug)]
pub struct Summary {
    /// The part.
    pub part: PathBuf,
    /// Each item of the shard, in order.
    pub outcomes: Vec<(PathBuf, Outcome)>,
    /// Items of other names whose content is that of an earlier one: both are in the part.
    pub twins: Vec<(PathBuf, PathBuf)>,
}

impl Summary {
    /// Items that could not be worked, with the reason.
    pub fn damaged(&self) -> impl Iterator<Item = (&Path, &str)> {
        self.outcomes.iter().filter_map(|(path, outcome)| match outcome {
            Outcome::Damaged(why) => Some((path.as_path(), why.as_str())),
            _ => None,
        })
    }

    /// Items that were worked and gave no row.
    pub fn empty(&self) -> impl Iterator<Item = &Path> {
        self.outcomes.iter().filter(|(_, outcome)| *outcome == Outcome::Done(0)).map(|(path, _)| path.as_path())
    }
}

/// Works a shard. `told` hears of each item as it is finished, from any thread. A damaged item is
/// passed over; a disk that is full or gone ends the work, and what was finished is kept for the
/// next run.
///
/// # Errors
/// When files of the batch cannot be written.
pub fn run<W: Work>(job: &Job<'_>, work: &W, told: &(dyn Fn(&Path, &Outcome) + Sync)) -> Result<Summary, PartError> {
    let workshop = Workshop::open(job.folder, job.shard, job.settings, work.table(), job.replace)?;
    let mine: Vec<&PathBuf> =
        job.items.iter().enumerate().filter(|(position, _)| job.shard.holds(*position)).map(|(_, p)| p).collect();
    let results: Vec<Mutex<Option<Finished>>> = mine.iter().map(|_| Mutex::new(None)).collect();
    let next = AtomicUsize::new(0);
    let failure = Mutex::new(None);
    std::thread::scope(|scope| {
        for _ in 0..job.threads.clamp(1, mine.len().max(1)) {
            scope.spawn(|| {
                (job.thread_begins)();
                let mut bench = work.bench();
                loop {
                    let position = next.fetch_add(1, Ordering::Relaxed);
                    let Some(path) = mine.get(position) else { return };
                    match one(work, &mut bench, &workshop, path) {
                        Ok(finished) => {
                            told(path, &finished.outcome);
                            *lock(&results[position]) = Some(finished);
                        }
                        Err(error) => {
                            lock(&failure).get_or_insert(error);
                            // Nobody begins another item.
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
    let mut twins = Vec::new();
    let mut contents: BTreeMap<Vec<String>, &PathBuf> = BTreeMap::new();
    for (path, result) in mine.into_iter().zip(results) {
        let Some(finished) = lock(&result).take() else { continue };
        if let Some(identity) = finished.identity {
            match contents.get(identity.content()) {
                Some(&first) => twins.push((first.clone(), path.clone())),
                None => drop(contents.insert(identity.content().to_vec(), path)),
            }
            identities.push(identity);
        }
        outcomes.push((path.clone(), finished.outcome));
    }
    Ok(Summary { part: workshop.finish(&identities)?, outcomes, twins })
}

fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    // Values behind these locks are replaced whole; a panic elsewhere ends the scope anyway.
    mutex.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}

struct Finished {
    /// `None` for an item that left no piece.
    identity: Option<Identity>,
    outcome: Outcome,
}

impl Finished {
    fn damaged(why: String) -> Self {
        Self { identity: None, outcome: Outcome::Damaged(why) }
    }
}

fn one<W: Work>(work: &W, bench: &mut W::Bench, workshop: &Workshop, path: &Path) -> Result<Finished, PartError> {
    let identity = match work.identify(path) {
        Ok(identity) => identity,
        Err(why) => return Ok(Finished::damaged(why.to_string())),
    };
    if workshop.is_done(&identity) {
        return Ok(Finished { identity: Some(identity), outcome: Outcome::Known });
    }
    let mut piece = workshop.begin(&identity)?;
    // A fault of this program must not cost the thousand other items; what the thread kept is
    // thrown away with it.
    let worked = catch_unwind(AssertUnwindSafe(|| work.work(bench, path, &identity, &mut piece)));
    match worked {
        Ok(Ok(rows)) => {
            piece.finish()?;
            Ok(Finished { identity: Some(identity), outcome: Outcome::Done(rows) })
        }
        Ok(Err(Trouble::Item(why))) => Ok(Finished::damaged(why)),
        Ok(Err(Trouble::Batch(error))) => Err(error),
        Err(_) => {
            *bench = work.bench();
            Ok(Finished::damaged("a fault of this program".to_owned()))
        }
    }
}
