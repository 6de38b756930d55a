//! The instrument's web server: one call, one time limit, one clear error.

use std::net::{SocketAddr, ToSocketAddrs};
use std::time::{Duration, Instant};

use gearwatch_runtime::stop::Stop;
use serde_json::Value;
use ureq::Agent;

use crate::SourceError;

/// A call that sets something up may take so long.
const PATIENCE: Duration = Duration::from_secs(5);
/// A call on the way out: the service must not be held up by an instrument that is gone.
const LAST_PATIENCE: Duration = Duration::from_millis(700);
/// A change of state, such as the detection of transducers, may take so long.
const LONGEST_CHANGE: Duration = Duration::from_secs(30);
/// No answer is longer.
const LONGEST_ANSWER: u64 = 1 << 20;

/// What went wrong with a call.
#[derive(Debug)]
pub(super) enum CallError {
    /// The instrument answered so: 4xx the wrong state or a wrong request, 5xx a fault of its own.
    Status(u16, String),
    /// No answer.
    Away(String),
    /// An answer that is not understood.
    Answer(String),
    /// The service stops.
    Stopping,
}

impl std::fmt::Display for CallError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Status(403, text) => write!(f, "403, the wrong state for this ({text})"),
            Self::Status(code @ 500.., text) => write!(f, "{code}, a fault of the instrument, restart it ({text})"),
            Self::Status(code, text) => write!(f, "{code} ({text})"),
            Self::Away(what) => write!(f, "no answer: {what}"),
            Self::Answer(what) => write!(f, "{what}"),
            Self::Stopping => write!(f, "the service stops"),
        }
    }
}

/// The calls that a client needs.
#[derive(Clone, Debug)]
pub(super) struct Rest {
    agent: Agent,
    pub(super) address: String,
    stop: Stop,
}

impl Rest {
    pub(super) fn new(address: &str, stop: Stop) -> Self {
        // An instrument on the bench's own network is never behind a proxy.
        let agent = Agent::config_builder().proxy(None).http_status_as_error(false).max_redirects(0).build().into();
        Self { agent, address: address.to_owned(), stop }
    }

    pub(super) fn get(&self, path: &str) -> Result<Value, CallError> {
        self.call("GET", path, None, PATIENCE)
    }

    pub(super) fn put(&self, path: &str, body: &str) -> Result<Value, CallError> {
        self.call("PUT", path, Some(body), PATIENCE)
    }

    pub(super) fn post(&self, path: &str) -> Result<Value, CallError> {
        self.call("POST", path, Some(""), PATIENCE)
    }

    /// A call on the way out; also when the service stops.
    pub(super) fn put_last(&self, path: &str) -> Result<Value, CallError> {
        self.exchange("PUT", path, Some(""), LAST_PATIENCE)
    }

    /// The state, when it is another than that of `tag`; an error of kind `Away` when nothing
    /// changed within `patience`.
    pub(super) fn on_change(&self, tag: u64, patience: Duration) -> Result<Value, CallError> {
        self.call("GET", &format!("onchange?last={tag}"), None, patience)
    }

    /// Waits until the state is as wanted.
    pub(super) fn wait_for(&self, what: &str, reached: impl Fn(&Value) -> bool) -> Result<(), CallError> {
        let began = Instant::now();
        let mut tag = 0;
        loop {
            match self.on_change(tag, PATIENCE) {
                Ok(state) if reached(&state) => return Ok(()),
                Ok(state) => tag = last_update_tag(&state),
                Err(CallError::Away(_)) if began.elapsed() < LONGEST_CHANGE => {}
                Err(e) => return Err(e),
            }
            if began.elapsed() >= LONGEST_CHANGE {
                return Err(CallError::Answer(format!("not {what} after {} s", LONGEST_CHANGE.as_secs())));
            }
        }
    }

    fn call(&self, method: &str, path: &str, body: Option<&str>, patience: Duration) -> Result<Value, CallError> {
        if self.stop.is_given() { Err(CallError::Stopping) } else { self.exchange(method, path, body, patience) }
    }

    fn exchange(&self, method: &str, path: &str, body: Option<&str>, patience: Duration) -> Result<Value, CallError> {
        let away = |e: ureq::Error| CallError::Away(e.to_string());
        let url = format!("http://{}/rest/rec/{path}", self.address);
        let request = ureq::http::Request::builder().method(method).uri(url).header("content-type", "application/json");
        let wrong = |e: ureq::http::Error| CallError::Answer(e.to_string());
        let mut answer = match body {
            Some(body) => {
                let request = request.body(body.to_owned()).map_err(wrong)?;
                self.agent.run(self.agent.configure_request(request).timeout_global(Some(patience)).build())
            }
            None => {
                let request = request.body(()).map_err(wrong)?;
                self.agent.run(self.agent.configure_request(request).timeout_global(Some(patience)).build())
            }
        }
        .map_err(away)?;
        let text = answer.body_mut().with_config().limit(LONGEST_ANSWER).read_to_string().map_err(away)?;
        let status = answer.status().as_u16();
        if !(200..300).contains(&status) {
            let text: String = text.chars().filter(|c| !c.is_control()).take(200).collect();
            return Err(CallError::Status(status, text));
        }
        if text.trim().is_empty() {
            return Ok(Value::Null);
        }
        // Some calls answer in plain words, which nobody reads.
        Ok(serde_json::from_str(&text).unwrap_or(Value::Null))
    }

    /// Where the stream is to be had: the same host at another port.
    pub(super) fn stream_address(&self, port: u16) -> Result<SocketAddr, SourceError> {
        let host = self.address.rsplit_once(':').map_or(self.address.as_str(), |(host, tail)| {
            if tail.chars().all(|c| c.is_ascii_digit()) && !tail.is_empty() { host } else { &self.address }
        });
        let host = host.trim_start_matches('[').trim_end_matches(']');
        let found = (host, port).to_socket_addrs().map_err(|e| self.error(format!("{host}: {e}")))?.next();
        found.ok_or_else(|| self.error(format!("{host} has no address")))
    }

    pub(super) fn error(&self, message: String) -> SourceError {
        SourceError::Peer { peer: self.address.clone(), message }
    }
}

/// The number of the state, for the next question.
pub(super) fn last_update_tag(state: &Value) -> u64 {
    state["lastUpdateTag"].as_u64().unwrap_or(0)
}
