//! The keys of the file as they stand in it, with the kinds of sources and sinks still unread.

use std::path::PathBuf;

use gearwatch_alarm::AlarmConfig;
use gearwatch_core::pipeline::PipelineConfig;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use toml::{Spanned, Table};

use super::{ReportConfig, ServiceConfig, schema};

/// Keys as they stand in the file.
#[derive(Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct File {
    /// Always `gearwatch-service/1`.
    pub(super) format: String,
    /// Things that concern the whole service.
    #[serde(default)]
    pub(super) service: ServiceConfig,
    /// What reports say of bench and people.
    #[serde(default, skip_serializing_if = "ReportConfig::is_empty")]
    pub(super) report: ReportConfig,
    /// The benches that are watched.
    #[serde(rename = "bench")]
    pub(super) benches: Vec<BenchKeys>,
    /// Where verdicts go.
    #[serde(default, rename = "sink", skip_serializing_if = "Vec::is_empty")]
    #[schemars(with = "Vec<schema::SinkKeys>")]
    pub(super) sinks: Vec<Spanned<Table>>,
}

/// Keys of a bench as they stand in the file.
#[derive(Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct BenchKeys {
    /// Bench file; the built-in demonstration bench where left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) file: Option<PathBuf>,
    /// Baseline file; without one, and without `learn_from`, every rank is `unknown`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) baseline: Option<PathBuf>,
    /// A source of the normal state that ends: the baseline is learned from it at each start, in
    /// place of `baseline`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<schema::SourceKeys>")]
    pub(super) learn_from: Option<Spanned<Table>>,
    /// Fault states of this bench, from `gearwatch signatures --out`; the paper's table where left
    /// out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) signatures: Option<PathBuf>,
    /// The row of stages from samples to ranks: window, speed, usable band, rank steps, how sure a
    /// state must be.
    #[serde(default)]
    #[schemars(with = "serde_json::Value")]
    pub(super) pipeline: PipelineConfig,
    /// When alarms come and go.
    #[serde(default)]
    pub(super) alarm: AlarmConfig,
    /// Where its packets come from.
    #[serde(rename = "source")]
    #[schemars(with = "Vec<schema::SourceKeys>")]
    pub(super) sources: Vec<Spanned<Table>>,
}
