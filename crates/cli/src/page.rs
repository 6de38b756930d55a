//! The page of a running service, asked from the command line: over TLS and with its token where it
//! has them.

use std::path::PathBuf;
use std::time::Duration;

use anyhow::Context;
use clap::Args;
use ureq::http::Response;
use ureq::{Agent, Body};

/// How a page proves itself, and what it asks for.
#[derive(Args)]
pub struct PageAccess {
    /// File whose first line is the page's token
    #[arg(long, value_name = "FILE")]
    token_file: Option<PathBuf>,
    /// Certificate of the authority that signed the page's, where the system does not know it (PEM)
    #[arg(long, value_name = "FILE")]
    ca_file: Option<PathBuf>,
}

/// A page that can be asked.
#[derive(Clone)]
pub struct Page {
    agent: Agent,
    url: String,
    token: Option<String>,
}

impl PageAccess {
    /// The page at this address; it must begin to answer within `patience`.
    pub fn page(&self, url: &str, patience: Duration) -> anyhow::Result<Page> {
        let url = url.trim_end_matches('/').to_owned();
        let token = self.token_file.as_ref().map(|file| {
            let text = gearwatch_io::text::read_text(file).with_context(|| file.display().to_string())?;
            Ok::<_, anyhow::Error>(text.lines().next().unwrap_or_default().trim().to_owned())
        });
        // A service on this machine or this network: nothing for a proxy.
        let config =
            Agent::config_builder().proxy(None).timeout_connect(Some(patience)).timeout_recv_response(Some(patience));
        #[cfg(feature = "tls")]
        let config = if url.starts_with("https:") {
            let trust = gearwatch_runtime::tls::Trust::read(self.ca_file.as_deref())?;
            config.tls_config(trust.of_requests())
        } else {
            config
        };
        #[cfg(not(feature = "tls"))]
        if url.starts_with("https:") {
            anyhow::bail!("{url}: this build has left out https; {}", gearwatch_runtime::kinds::with_feature("tls"));
        }
        Ok(Page { agent: config.build().into(), url, token: token.transpose()? })
    }
}

#[cfg_attr(not(feature = "terminal"), allow(dead_code, reason = "`top` does more than ask"))]
impl Page {
    /// Its address.
    pub fn url(&self) -> &str {
        &self.url
    }

    /// Asks for a path.
    pub fn get(&self, path: &str) -> Result<Response<Body>, ureq::Error> {
        let mut request = self.agent.get(format!("{}{path}", self.url));
        if let Some(token) = &self.token {
            request = request.header("authorization", format!("Bearer {token}"));
        }
        request.call()
    }

    /// Sends a JSON object to a path.
    pub fn post(&self, path: &str, object: &serde_json::Value) -> Result<Response<Body>, ureq::Error> {
        let mut request = self.agent.post(format!("{}{path}", self.url)).header("content-type", "application/json");
        if let Some(token) = &self.token {
            request = request.header("authorization", format!("Bearer {token}"));
        }
        request.send(object.to_string())
    }
}
