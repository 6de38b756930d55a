//! Worker threads for the spectra of all lanes.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Weak};
use std::thread::JoinHandle;
use std::time::Instant;

use gearwatch_core::analysis::WindowAnalysis;
use gearwatch_core::assemble::Gap;
use gearwatch_core::pipeline::{Pipeline, WorkerState};
use gearwatch_core::window::Window;

use super::lane::Shed;
use super::load::{Load, WorkerClock};

/// What a lane gives to every job, so that a worker can do it and hand it back.
#[derive(Debug)]
pub(super) struct Way {
    pub pipeline: Arc<Pipeline>,
    pub done: async_channel::Sender<Done>,
}

/// What comes to the judging thread of a lane.
#[derive(Debug)]
pub(super) enum Done {
    /// A window was worked on, or its worker panicked.
    Job(Box<Job>),
    /// Cutting has ended.
    End {
        /// So many jobs were given out.
        jobs: u64,
        /// Windows shed after the last job.
        shed: Vec<Shed>,
        /// Gaps after the last job.
        gaps: Vec<Gap>,
    },
}

/// A carrier: goes round from cutting to a worker to judging and back, and takes its buffers along.
#[derive(Debug)]
pub(super) struct Job {
    pub way: Arc<Way>,
    /// Counts the jobs of the lane.
    pub seq: u64,
    pub window: Option<Window>,
    pub analysis: WindowAnalysis,
    /// The worker panicked: the analysis means nothing.
    pub failed: bool,
    /// Windows that were shed directly before this one.
    pub shed: Vec<Shed>,
    /// Gaps directly before this one.
    pub gaps: Vec<Gap>,
}

/// Named threads that do the spectra.
#[derive(Debug)]
pub struct Pool {
    jobs: async_channel::Sender<Box<Job>>,
    threads: Vec<JoinHandle<()>>,
    load: Arc<Load>,
}

impl Pool {
    /// Starts `workers` threads (at least one).
    ///
    /// # Errors
    /// When the system does not give a thread.
    pub fn start(workers: usize) -> std::io::Result<Self> {
        // Not bounded by itself: the carriers of the lanes bound it.
        let (jobs, inlet) = async_channel::unbounded::<Box<Job>>();
        let load = Arc::new(Load::new(workers.max(1)));
        let threads = (0..workers.max(1))
            .map(|number| {
                let (inlet, load) = (inlet.clone(), load.clone());
                std::thread::Builder::new()
                    .name(format!("gw-fft-{number}"))
                    .spawn(move || work(&inlet, load.worker(number)))
            })
            .collect::<Result<_, _>>()?;
        Ok(Self { jobs, threads, load })
    }

    /// Number of threads.
    pub fn workers(&self) -> usize {
        self.threads.len()
    }

    /// A thread has ended although nobody told it to: what it held never comes back, and its lane
    /// waits for ever.
    pub fn has_died(&self) -> bool {
        self.threads.iter().any(JoinHandle::is_finished)
    }

    /// How busy they are.
    pub fn load(&self) -> &Arc<Load> {
        &self.load
    }

    pub(super) fn jobs(&self) -> async_channel::Sender<Box<Job>> {
        self.jobs.clone()
    }
}

impl Drop for Pool {
    /// Ends the threads when the lanes have no more jobs.
    fn drop(&mut self) {
        self.jobs.close();
        for thread in self.threads.drain(..) {
            // A worker catches panics itself; there is nothing left to learn from the result.
            let _ = thread.join();
        }
    }
}

/// A worker's life.
fn work(jobs: &async_channel::Receiver<Box<Job>>, clock: &WorkerClock) {
    // One state a lane; lanes that are gone (after a reload) are forgotten when a new one comes.
    let mut states: Vec<(Weak<Way>, WorkerState)> = Vec::new();
    while let Ok(mut job) = jobs.recv_blocking() {
        gearwatch_runtime::fail::point("worker-thread");
        let begin = Instant::now();
        let at = match states.iter().position(|(way, _)| std::ptr::eq(way.as_ptr(), Arc::as_ptr(&job.way))) {
            Some(at) => at,
            None => {
                states.retain(|(way, _)| way.strong_count() > 0);
                states.push((Arc::downgrade(&job.way), job.way.pipeline.worker()));
                states.len() - 1
            }
        };
        if let (Some((_, state)), Some(window)) = (states.get_mut(at), &job.window) {
            let analysis = &mut job.analysis;
            let pipeline = &job.way.pipeline;
            job.failed = catch_unwind(AssertUnwindSafe(|| {
                gearwatch_runtime::fail::point("worker");
                pipeline.analyse(state, window, analysis);
            }))
            .is_err();
            if job.failed {
                // Half-done work may be in it.
                states.swap_remove(at);
            }
        }
        clock.worked(begin.elapsed());
        let done = job.way.done.clone();
        // The lane has gone: its last jobs interest nobody.
        let _ = done.send_blocking(Done::Job(job));
    }
}
