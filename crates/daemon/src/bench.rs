//! A bench as the service watches it: bench file, baseline and pipeline, made from its
//! configuration.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use gearwatch_check::{self as check, Look};
use gearwatch_core::baseline::Baseline;
use gearwatch_core::bench::Bench;
use gearwatch_core::pipeline::Pipeline;
use gearwatch_runtime::stop::Stop;
use gearwatch_sources::SourceContext;

use crate::checking;
use crate::config::{BenchConfig, DEMO_BENCH};

mod learn;

pub use learn::{LearnError, learn};

/// A bench with all that is needed to judge its windows.
#[derive(Debug)]
pub struct WatchedBench {
    /// Name from the bench file.
    pub name: Arc<str>,
    /// What is known of the bench.
    pub bench: Arc<Bench>,
    /// The row of stages with the baseline.
    pub pipeline: Arc<Pipeline>,
    /// What is normal, for the log.
    pub baseline: Option<Baseline>,
    /// All its sources are recordings, which were checked before the first verdict.
    pub checked: bool,
}

/// Why a bench cannot be watched.
#[derive(Debug, thiserror::Error)]
pub enum BenchError {
    /// The bench file.
    #[error(transparent)]
    File(#[from] gearwatch_io::bench_file::BenchFileError),
    /// The baseline file.
    #[error(transparent)]
    Baseline(#[from] gearwatch_io::baseline_file::BaselineFileError),
    /// The signature file.
    #[error(transparent)]
    Signatures(#[from] gearwatch_io::signature_file::SignatureFileError),
    /// Bench, pipeline and baseline do not fit.
    #[error("bench {bench:?}: {source}")]
    Pipeline {
        /// Name of the bench.
        bench: String,
        /// What does not fit.
        source: gearwatch_core::pipeline::PipelineError,
    },
    /// A source cannot serve the bench.
    #[error("bench {bench:?}: source {name:?}: {refusal}")]
    Source {
        /// Name of the bench.
        bench: String,
        /// Name of the source.
        name: String,
        /// Why not.
        refusal: String,
    },
    /// Sheet, recordings or baseline are wrong for sure.
    #[error("bench {bench:?}: {refusal}")]
    Check {
        /// Name of the bench.
        bench: String,
        /// What is wrong, expected, and to be done.
        refusal: String,
    },
    /// The baseline could not be learned.
    #[error("bench {bench:?}: learn_from: {source}")]
    Learn {
        /// Name of the bench.
        bench: String,
        /// What went wrong.
        source: Box<LearnError>,
    },
}

/// Reads a bench file, or the built-in demonstration bench.
///
/// # Errors
/// When it cannot be read or its values cannot be right.
pub fn read_bench(path: Option<&Path>) -> Result<Bench, BenchError> {
    Ok(match path {
        Some(path) => gearwatch_io::bench_file::read(path)?,
        None => gearwatch_io::bench_file::parse(DEMO_BENCH, Path::new("the built-in demonstration bench"))?,
    })
}

impl WatchedBench {
    /// Reads bench file and baseline, learns where that is asked for, and plans the pipeline.
    ///
    /// # Errors
    /// When a file cannot be used, or bench, pipeline and baseline do not fit each other.
    pub fn build(config: &BenchConfig, folder: &Path, workers: usize, stop: &Stop) -> Result<Self, BenchError> {
        let file: Option<PathBuf> = config.file.as_ref().map(|path| folder.join(path));
        let bench = Arc::new(read_bench(file.as_deref())?);
        for entry in config.sources.iter().chain(&config.learn_from) {
            if let Some(refusal) = entry.config.refuses(&bench) {
                return Err(BenchError::Source { bench: bench.name.clone(), name: entry.name.clone(), refusal });
            }
        }
        let window_s = config.pipeline.window.length_s;
        let signatures = match &config.signatures {
            Some(path) => Some(gearwatch_io::signature_file::read_for(&folder.join(path), &bench)?),
            None => None,
        };
        let plan = |baseline| -> Result<Pipeline, BenchError> {
            let pipeline = Pipeline::new(&bench, &config.pipeline, baseline)
                .map_err(|source| BenchError::Pipeline { bench: bench.name.clone(), source })?;
            Ok(match &signatures {
                Some(signatures) => pipeline.with_signatures(signatures.clone()),
                None => pipeline,
            })
        };
        let mut baseline = match &config.baseline {
            Some(path) => Some(gearwatch_io::baseline_file::read_for(&folder.join(path), &bench, window_s)?),
            None => None,
        };
        if let Some(entry) = &config.learn_from {
            tracing::info!(bench = bench.name, source = entry.name, "learning the baseline");
            let context = SourceContext::new(bench.clone(), folder.to_owned(), stop.clone());
            let learned = learn(entry, &context, &Arc::new(plan(None)?), window_s, workers)
                .map_err(|e| BenchError::Learn { bench: bench.name.clone(), source: Box::new(e) })?;
            baseline = Some(learned);
        }
        if baseline.is_none() {
            tracing::warn!(bench = bench.name, "there is no baseline: every rank will be unknown");
        }
        let looks: Vec<Look> = config.sources.iter().filter_map(|entry| entry.config.look(folder)).collect();
        let checked = check::check(&bench, &looks, baseline.as_ref());
        let all = looks.len() == config.sources.len();
        if let Some(refusal) = checked.refusal() {
            return Err(BenchError::Check { bench: bench.name.clone(), refusal });
        }
        if all {
            checking::tell(&bench.name, &checked);
        }
        let mut pipeline = plan(baseline.clone())?;
        if all {
            let words: Vec<String> = looks.iter().map(|look| checked.doubts(look.name())).collect();
            let mut words: Vec<&str> = words.iter().flat_map(|words| words.split_whitespace()).collect();
            words.sort_unstable();
            words.dedup();
            pipeline = pipeline.with_doubts(&words.join(" "));
        }
        let name = bench.name.as_str().into();
        Ok(Self { name, pipeline: Arc::new(pipeline), baseline, bench, checked: all })
    }
}
