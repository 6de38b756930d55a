//! What concerns the whole service.

use std::net::SocketAddr;
use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

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
    /// Address of the page and of the metrics, such as `127.0.0.1:8650`; none where left out.
    /// Loopback only, unless there are `page_token_file` and `page_tls`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub page: Option<SocketAddr>,
    /// Names (with port) under which the page may be asked for besides its address, such as
    /// `bench-3:8650`.
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

impl ServiceConfig {
    pub(super) fn problems(&self) -> Vec<String> {
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
