//! The configuration of the service: TOML, every key described, unknown keys refused with their
//! place.
//!
//! *validate → build → run*: [`Config::parse`] and [`Config::problems`] touch nothing but the text;
//! what they accept can be built.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use gearwatch_alarm::AlarmConfig;
use gearwatch_core::pipeline::PipelineConfig;
use gearwatch_runtime::queue::WhenFull;
use gearwatch_sources::Speed;
use toml::{Spanned, Table};

use entry::{sink_entry, source_entry};
use keys::{BenchKeys, File};

mod bench;
mod entry;
mod keys;
mod report;
mod schema;
mod service;

pub use bench::BenchConfig;
pub use entry::{EntryError, SinkEntry, SourceEntry};
pub use report::ReportConfig;
pub use schema::schema;
pub use service::{PageTls, ServiceConfig};

/// The value of the key `format`.
pub const FORMAT: &str = "gearwatch-service/1";

/// What `gearwatch run` does without arguments.
pub const DEFAULT: &str = include_str!("config/default.toml");

/// The bench of [`DEFAULT`].
pub const DEMO_BENCH: &str = gearwatch_sim::shipped::DEMO_BENCH;

/// Why a configuration cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// The file cannot be read.
    #[error("{}: cannot be read: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// Not TOML, or an unknown, missing or mistyped key.
    #[error("{name}: {message}")]
    Syntax {
        /// File name, or what stands for it.
        name: String,
        /// Place, what was expected and what was found.
        message: String,
    },
    /// A table of a source or a sink.
    #[error("{name}: line {line}, {place}: {source}")]
    Entry {
        /// File name, or what stands for it.
        name: String,
        /// Where the table begins.
        line: usize,
        /// The table's name.
        place: &'static str,
        /// What is wrong.
        source: Box<EntryError>,
    },
    /// The values cannot be right.
    #[error("{name}: {}", problems.join("; "))]
    Values {
        /// File name, or what stands for it.
        name: String,
        /// One sentence each.
        problems: Vec<String>,
    },
}

/// A configuration that was read; see [`Config::problems`].
#[derive(Debug)]
pub struct Config {
    /// File name, or what stands for it.
    pub name: String,
    /// Relative paths start here.
    pub folder: PathBuf,
    /// The whole service.
    pub service: ServiceConfig,
    /// What reports say of bench and people.
    pub report: ReportConfig,
    /// The benches.
    pub benches: Vec<BenchConfig>,
    /// Where verdicts go.
    pub sinks: Vec<SinkEntry>,
}

impl Config {
    /// Reads a file.
    ///
    /// # Errors
    /// When it cannot be read, or as [`Self::parse`].
    pub fn read(path: &Path) -> Result<Self, ConfigError> {
        let text = gearwatch_io::text::read_text(path)
            .map_err(|source| ConfigError::Read { path: path.to_owned(), source })?;
        let folder = path.parent().map(Path::to_owned).unwrap_or_default();
        Self::parse(&text, &path.display().to_string(), &folder)
    }

    /// Reads a text; `name` stands for the file in messages, relative paths start at `folder`.
    ///
    /// # Errors
    /// With the place, when the text is not TOML, has unknown, missing or mistyped keys, or values
    /// that cannot be right.
    pub fn parse(text: &str, name: &str, folder: &Path) -> Result<Self, ConfigError> {
        let syntax = |message: String| ConfigError::Syntax { name: name.to_owned(), message };
        let file: File = toml::from_str(text).map_err(|e| syntax(e.to_string().trim_end().to_owned()))?;
        if file.format != FORMAT {
            return Err(syntax(format!("format is {:?}; this version reads {FORMAT:?}", file.format)));
        }
        let at = |place, table: &Spanned<Table>, source| {
            let line = text.get(..table.span().start).map_or(0, |before| before.matches('\n').count()) + 1;
            ConfigError::Entry { name: name.to_owned(), line, place, source: Box::new(source) }
        };
        let mut benches = Vec::new();
        for keys in file.benches {
            let mut sources = Vec::new();
            for table in &keys.sources {
                sources.push(source_entry(table.get_ref()).map_err(|e| at("[[bench.source]]", table, e))?);
            }
            let learn_from = match &keys.learn_from {
                Some(table) => Some(source_entry(table.get_ref()).map_err(|e| at("learn_from", table, e))?),
                None => None,
            };
            let BenchKeys { file, baseline, signatures, pipeline, alarm, .. } = keys;
            benches.push(BenchConfig { file, baseline, learn_from, signatures, pipeline, alarm, sources });
        }
        let mut sinks = Vec::new();
        for table in &file.sinks {
            sinks.push(sink_entry(table.get_ref()).map_err(|e| at("[[sink]]", table, e))?);
        }
        let (name, folder) = (name.to_owned(), folder.to_owned());
        let config = Self { name, folder, service: file.service, report: file.report, benches, sinks };
        let problems = config.problems();
        if problems.is_empty() { Ok(config) } else { Err(ConfigError::Values { name: config.name, problems }) }
    }

    /// The built-in configuration.
    ///
    /// # Errors
    /// Never in a build whose tests pass.
    pub fn built_in() -> Result<Self, ConfigError> {
        Self::parse(DEFAULT, "the built-in configuration", Path::new(""))
    }

    /// What `gearwatch replay` does: one recording to standard output.
    ///
    /// # Errors
    /// When the values cannot be right.
    pub fn of_recording(
        recording: &Path,
        bench: &Path,
        baseline: Option<&Path>,
        signatures: Option<&Path>,
        speed: Speed,
        workers: usize,
    ) -> Result<Self, ConfigError> {
        let text = |path: &Path| path.display().to_string();
        let keys = |pairs: Vec<(&str, toml::Value)>| {
            pairs.into_iter().map(|(key, value)| (key.to_owned(), value)).collect::<Table>()
        };
        let syntax = |e: EntryError| ConfigError::Syntax { name: text(recording), message: e.to_string() };
        let speed = toml::Value::try_from(speed).map_err(|e| syntax(e.into()))?;
        let source = keys(vec![("kind", "file".into()), ("path", text(recording).into()), ("speed", speed)]);
        let config = Self {
            name: text(recording),
            folder: PathBuf::new(),
            service: ServiceConfig { workers, self_test: false, ..ServiceConfig::default() },
            report: ReportConfig::default(),
            benches: vec![BenchConfig {
                file: Some(bench.to_owned()),
                baseline: baseline.map(Path::to_owned),
                learn_from: None,
                signatures: signatures.map(Path::to_owned),
                pipeline: PipelineConfig::default(),
                alarm: AlarmConfig::default(),
                sources: vec![source_entry(&source).map_err(syntax)?],
            }],
            sinks: vec![sink_entry(&keys(vec![("kind", "stdout".into())])).map_err(syntax)?],
        };
        let problems = config.problems();
        if problems.is_empty() { Ok(config) } else { Err(ConfigError::Values { name: config.name, problems }) }
    }

    /// What is wrong with the values, one sentence each; opens nothing.
    pub fn problems(&self) -> Vec<String> {
        let mut out = self.service.problems();
        if self.benches.is_empty() {
            out.push("there is no [[bench]]".to_owned());
        }
        let mut files = BTreeSet::new();
        for (number, bench) in self.benches.iter().enumerate() {
            let place = format!("[[bench]] {}", number + 1);
            if !files.insert(&bench.file) {
                out.push(format!("{place}: the same bench file stands above already"));
            }
            out.extend(bench.problems().into_iter().map(|problem| format!("{place}: {problem}")));
        }
        let mut names = BTreeSet::new();
        for sink in &self.sinks {
            if !names.insert(&sink.name) {
                out.push(format!("two sinks are called {:?}; give one another name", sink.name));
            }
            if !(1..=1 << 20).contains(&sink.queue) {
                out.push(format!("sink {:?}: queue is {}; expected 1 to 1048576", sink.name, sink.queue));
            }
            if sink.when_full == Some(WhenFull::Block) && self.is_live() {
                out.push(format!(
                    "sink {:?}: when_full = \"block\" would hold up the ranks of a live source; use drop_oldest or drop_newest",
                    sink.name
                ));
            }
            out.extend(sink.config.problems().into_iter().map(|problem| format!("sink {:?}: {problem}", sink.name)));
        }
        out
    }

    /// Any source is live, so that nothing downstream of it may wait.
    pub fn is_live(&self) -> bool {
        self.benches.iter().any(BenchConfig::is_live)
    }

    /// What happens when a sink's queue is full: as configured, else wait where no source is live,
    /// and drop the oldest where one is.
    pub fn when_full(&self, sink: &SinkEntry) -> WhenFull {
        sink.when_full.unwrap_or(if self.is_live() { WhenFull::DropOldest } else { WhenFull::Block })
    }

    /// The configuration with all defaults filled in, as TOML.
    pub fn shown(&self) -> String {
        let spanned = |keys: &Table| Spanned::new(0..0, keys.clone());
        let file = File {
            format: FORMAT.to_owned(),
            service: self.service.clone(),
            report: self.report.clone(),
            benches: self
                .benches
                .iter()
                .map(|bench| BenchKeys {
                    file: bench.file.clone(),
                    baseline: bench.baseline.clone(),
                    signatures: bench.signatures.clone(),
                    learn_from: bench.learn_from.as_ref().map(|entry| spanned(&entry.keys)),
                    pipeline: bench.pipeline.clone(),
                    alarm: bench.alarm.clone(),
                    sources: bench.sources.iter().map(|entry| spanned(&entry.keys)).collect(),
                })
                .collect(),
            sinks: self.sinks.iter().map(|entry| spanned(&entry.keys)).collect(),
        };
        toml::to_string(&file).unwrap_or_else(|e| format!("# cannot be shown: {e}\n"))
    }
}
