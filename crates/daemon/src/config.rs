//! The configuration of the service: TOML, every key described, unknown keys refused with their place.
//!
//! *validate → build → run*: [`Config::parse`] and [`Config::problems`] touch nothing but the text; what they accept can be built.

use std::collections::BTreeSet;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};

use gearwatch_core::pipeline::PipelineConfig;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use toml::{Spanned, Table};

use crate::health::AlarmConfig;
use crate::kinds::{self, Kind};
use crate::queue::WhenFull;
use crate::sink::{self, SinkConfig};
use crate::source::{self, SourceConfig, Speed};

mod schema;

pub use schema::schema;

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
    /// The values cannot be right.
    #[error("{name}: {}", problems.join("; "))]
    Values {
        /// File name, or what stands for it.
        name: String,
        /// One sentence each.
        problems: Vec<String>,
    },
}

/// Keys as they stand in the file.
#[derive(Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct File {
    /// Always `gearwatch-service/1`.
    format: String,
    /// Things that concern the whole service.
    #[serde(default)]
    service: ServiceConfig,
    /// The benches that are watched.
    #[serde(rename = "bench")]
    benches: Vec<BenchKeys>,
    /// Where verdicts go.
    #[serde(default, rename = "sink", skip_serializing_if = "Vec::is_empty")]
    #[schemars(with = "Vec<schema::SinkKeys>")]
    sinks: Vec<Spanned<Table>>,
}

/// Keys of a bench as they stand in the file.
#[derive(Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct BenchKeys {
    /// Bench file; the built-in demonstration bench where left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    file: Option<PathBuf>,
    /// Baseline file; without one, and without `learn_from`, every rank is `unknown`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    baseline: Option<PathBuf>,
    /// A source of the normal state that ends: the baseline is learned from it at each start, in place of `baseline`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<schema::SourceKeys>")]
    learn_from: Option<Spanned<Table>>,
    /// Fault states of this bench, from `gearwatch signatures --out`; the paper's table where left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    signatures: Option<PathBuf>,
    /// The row of stages from samples to ranks: window, speed, usable band, rank steps, how sure a state must be.
    #[serde(default)]
    #[schemars(with = "serde_json::Value")]
    pipeline: PipelineConfig,
    /// When alarms come and go.
    #[serde(default)]
    alarm: AlarmConfig,
    /// Where its packets come from.
    #[serde(rename = "source")]
    #[schemars(with = "Vec<schema::SourceKeys>")]
    sources: Vec<Spanned<Table>>,
}

/// Things that concern the whole service.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ServiceConfig {
    /// Threads that do the spectra, for all benches together; 0: one a core (0–256).
    pub workers: usize,
    /// Packets that may wait before the windows are cut, per bench (1–1000000).
    pub packet_queue: usize,
    /// Windows in work or waiting for a worker, per bench and worker (1–1024).
    pub windows_per_worker: usize,
    /// Address of the page and of the metrics, such as `127.0.0.1:8650`; none where left out. Loopback only, unless there are
    /// `page_token_file` and `page_tls`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub page: Option<SocketAddr>,
    /// Names (with port) under which the page may be asked for besides its address, such as `bench-3:8650`.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub page_hosts: Vec<String>,
    /// File whose first line is the token that the page asks for (at least 16 characters).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub page_token_file: Option<PathBuf>,
    /// Certificate and key with which the page is served.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub page_tls: Option<PageTls>,
    /// Socket that answers `gearwatch status`; none where left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub status_socket: Option<PathBuf>,
    /// A known signal goes through the workers every ten seconds, and must get its known ranks.
    pub self_test: bool,
    /// Time that sinks get to write what is left when the service stops (s, 0–60).
    pub drain_secs: f64,
}

/// Files of the page's identity (PEM).
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PageTls {
    /// Certificate chain, the server's own first.
    pub certificate: PathBuf,
    /// Private key.
    pub key: PathBuf,
}

impl Default for ServiceConfig {
    fn default() -> Self {
        Self {
            workers: 0,
            packet_queue: 256,
            windows_per_worker: 4,
            page: None,
            page_hosts: Vec::new(),
            page_token_file: None,
            page_tls: None,
            status_socket: None,
            self_test: true,
            drain_secs: 2.0,
        }
    }
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
    /// The benches.
    pub benches: Vec<BenchConfig>,
    /// Where verdicts go.
    pub sinks: Vec<SinkEntry>,
}

/// One bench of the service.
#[derive(Debug)]
pub struct BenchConfig {
    /// Bench file; `None`: the built-in demonstration bench.
    pub file: Option<PathBuf>,
    /// Baseline file.
    pub baseline: Option<PathBuf>,
    /// Learns the baseline at start.
    pub learn_from: Option<SourceEntry>,
    /// Fault states of this bench.
    pub signatures: Option<PathBuf>,
    /// The row of stages from samples to ranks.
    pub pipeline: PipelineConfig,
    /// When alarms come and go.
    pub alarm: AlarmConfig,
    /// Where its packets come from.
    pub sources: Vec<SourceEntry>,
}

/// A source with the keys that all sources have.
#[derive(Debug)]
pub struct SourceEntry {
    /// Unique within its bench; the kind where the file names none.
    pub name: String,
    /// Its kind.
    pub kind: &'static str,
    /// Without a packet for so long a live source counts as silent (s).
    pub data_deadline_secs: f64,
    /// Its own keys.
    pub config: Box<dyn SourceConfig>,
    /// All keys, defaults filled in.
    keys: Table,
}

/// A sink with the keys that all sinks have.
#[derive(Debug)]
pub struct SinkEntry {
    /// Unique; the kind where the file names none.
    pub name: String,
    /// Its kind.
    pub kind: &'static str,
    /// Events that may wait for it.
    pub queue: usize,
    /// What happens when more do; where left out, see [`Config::when_full`].
    pub when_full: Option<WhenFull>,
    /// Its own keys.
    pub config: Box<dyn SinkConfig>,
    /// All keys, defaults filled in.
    keys: Table,
}

/// A source that may be silent for longer is not watched (s).
const LONGEST_DEADLINE_SECS: f64 = 86_400.0;
/// Some minutes of verdicts of a small bench.
const SINK_QUEUE: usize = 4096;

impl Config {
    /// Reads a file.
    ///
    /// # Errors
    /// When it cannot be read, or as [`Self::parse`].
    pub fn read(path: &Path) -> Result<Self, ConfigError> {
        let text =
            std::fs::read_to_string(path).map_err(|source| ConfigError::Read { path: path.to_owned(), source })?;
        let folder = path.parent().map(Path::to_owned).unwrap_or_default();
        Self::parse(&text, &path.display().to_string(), &folder)
    }

    /// Reads a text; `name` stands for the file in messages, relative paths start at `folder`.
    ///
    /// # Errors
    /// With the place, when the text is not TOML, has unknown, missing or mistyped keys, or values that cannot be right.
    pub fn parse(text: &str, name: &str, folder: &Path) -> Result<Self, ConfigError> {
        let syntax = |message: String| ConfigError::Syntax { name: name.to_owned(), message };
        let file: File = toml::from_str(text).map_err(|e| syntax(e.to_string().trim_end().to_owned()))?;
        if file.format != FORMAT {
            return Err(syntax(format!("format is {:?}; this version reads {FORMAT:?}", file.format)));
        }
        let at = |place: &str, table: &Spanned<Table>, message: String| {
            let line = text.get(..table.span().start).map_or(0, |before| before.matches('\n').count()) + 1;
            syntax(format!("line {line}, {place}: {message}"))
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
        let config = Self { name: name.to_owned(), folder: folder.to_owned(), service: file.service, benches, sinks };
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
        let syntax = |message: String| ConfigError::Syntax { name: text(recording), message };
        let speed = toml::Value::try_from(speed).map_err(|e| syntax(e.to_string()))?;
        let source = keys(vec![("kind", "file".into()), ("path", text(recording).into()), ("speed", speed)]);
        let config = Self {
            name: text(recording),
            folder: PathBuf::new(),
            service: ServiceConfig { workers, self_test: false, ..ServiceConfig::default() },
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

    /// What happens when a sink's queue is full: as configured, else wait where no source is live, and drop the oldest where one is.
    pub fn when_full(&self, sink: &SinkEntry) -> WhenFull {
        sink.when_full.unwrap_or(if self.is_live() { WhenFull::DropOldest } else { WhenFull::Block })
    }

    /// The configuration with all defaults filled in, as TOML.
    pub fn shown(&self) -> String {
        let spanned = |keys: &Table| Spanned::new(0..0, keys.clone());
        let file = File {
            format: FORMAT.to_owned(),
            service: self.service.clone(),
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

impl ServiceConfig {
    fn problems(&self) -> Vec<String> {
        let mut out = Vec::new();
        let mut within = |key: &str, value: usize, most: usize, least: usize| {
            if !(least..=most).contains(&value) {
                out.push(format!("service.{key} is {value}; expected {least} to {most}"));
            }
        };
        within("workers", self.workers, 256, 0);
        within("packet_queue", self.packet_queue, 1_000_000, 1);
        within("windows_per_worker", self.windows_per_worker, 1024, 1);
        let protected = self.page_token_file.is_some() && self.page_tls.is_some();
        if let Some(address) = self.page.filter(|address| !address.ip().is_loopback() && !protected) {
            out.push(format!(
                "service.page is {address}, which other machines can reach; expected a loopback address such as 127.0.0.1:8650, or \
                 page_token_file and page_tls beside it"
            ));
        }
        if !(0.0..=60.0).contains(&self.drain_secs) {
            out.push(format!("service.drain_secs is {}; expected 0 to 60", self.drain_secs));
        }
        out
    }

    /// Number of worker threads.
    pub fn worker_count(&self) -> usize {
        match self.workers {
            0 => std::thread::available_parallelism().map_or(1, usize::from),
            count => count,
        }
    }
}

impl BenchConfig {
    fn is_live(&self) -> bool {
        self.sources.iter().any(|source| source.config.is_live())
    }

    fn problems(&self) -> Vec<String> {
        let mut out = self.pipeline.window.problems();
        out.extend(self.pipeline.speed.problems());
        out.extend(self.pipeline.rank.problem());
        out.extend(self.alarm.problems());
        out.extend(self.pipeline.state.problem());
        if self.sources.is_empty() {
            out.push("there is no [[bench.source]]".to_owned());
        }
        if self.baseline.is_some() && self.learn_from.is_some() {
            out.push("baseline and learn_from exclude each other; leave one out".to_owned());
        }
        if let Some(learn_from) = &self.learn_from {
            out.extend(learn_from.config.problems().into_iter().map(|problem| format!("learn_from: {problem}")));
            if learn_from.config.is_live() {
                out.push("learn_from: a live source does not end; use a recording, or speed = \"max\"".to_owned());
            }
        }
        let mut names = BTreeSet::new();
        for source in &self.sources {
            if !names.insert(&source.name) {
                out.push(format!("two sources are called {:?}; give one another name", source.name));
            }
            if !(source.data_deadline_secs > 0.0 && source.data_deadline_secs <= LONGEST_DEADLINE_SECS) {
                out.push(format!(
                    "source {:?}: data_deadline_secs is {}; it must be above 0 and at most a day",
                    source.name, source.data_deadline_secs
                ));
            }
            out.extend(
                source.config.problems().into_iter().map(|problem| format!("source {:?}: {problem}", source.name)),
            );
        }
        out
    }
}

/// Takes a key that all kinds have out of a table.
fn take<T: for<'de> Deserialize<'de>>(keys: &mut Table, key: &str) -> Result<Option<T>, String> {
    match keys.remove(key) {
        None => Ok(None),
        Some(value) => {
            value.try_into().map(Some).map_err(|e: toml::de::Error| format!("{key}: {}", kinds::one_line(&e)))
        }
    }
}

/// The kind's name, and the kind.
fn kind_of<C: ?Sized>(keys: &mut Table, all: &'static [Kind<C>], what: &str) -> Result<&'static Kind<C>, String> {
    let name: Option<String> = take(keys, "kind")?;
    let name = name.ok_or_else(|| {
        let names: Vec<_> = all.iter().map(|kind| kind.name).collect();
        format!("the key \"kind\" is missing; it is one of {}", names.join(", "))
    })?;
    kinds::find(all, &name, what)
}

fn source_entry(keys: &Table) -> Result<SourceEntry, String> {
    let mut own = keys.clone();
    let kind = kind_of(&mut own, source::KINDS, "source")?;
    let name = take(&mut own, "name")?.unwrap_or_else(|| kind.name.to_owned());
    let data_deadline_secs = take(&mut own, "data_deadline_secs")?.unwrap_or(source::DATA_DEADLINE_SECS);
    let (config, shown) = kind.read(own).map_err(|e| format!("{}: {e}", kind.name))?;
    let mut keys = Table::new();
    keys.insert("kind".to_owned(), kind.name.into());
    keys.insert("name".to_owned(), name.clone().into());
    keys.insert("data_deadline_secs".to_owned(), data_deadline_secs.into());
    keys.extend(shown);
    Ok(SourceEntry { name, kind: kind.name, data_deadline_secs, config, keys })
}

fn sink_entry(keys: &Table) -> Result<SinkEntry, String> {
    let mut own = keys.clone();
    let kind = kind_of(&mut own, sink::KINDS, "sink")?;
    let name = take(&mut own, "name")?.unwrap_or_else(|| kind.name.to_owned());
    let queue = take(&mut own, "queue")?.unwrap_or(SINK_QUEUE);
    let when_full = take(&mut own, "when_full")?;
    let (config, shown) = kind.read(own).map_err(|e| format!("{}: {e}", kind.name))?;
    let mut keys = Table::new();
    keys.insert("kind".to_owned(), kind.name.into());
    keys.insert("name".to_owned(), name.clone().into());
    keys.insert("queue".to_owned(), i64::try_from(queue).unwrap_or(i64::MAX).into());
    if let Some(policy) = when_full {
        keys.insert("when_full".to_owned(), toml::Value::try_from(policy).map_err(|e| e.to_string())?);
    }
    keys.extend(shown);
    Ok(SinkEntry { name, kind: kind.name, queue, when_full, config, keys })
}
