//! Alarms as HTTP POST with a JSON body; tried again with growing waits until the receiver takes them.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use ureq::Agent;

use super::broker::secret;
use super::{Drain, Events, SinkConfig, SinkContext, SinkError, Standing, kind};
use crate::event::Event;
use crate::health::Alarm;
use crate::kinds::{self, Kind};
use crate::service::Backoff;

pub(super) const KIND: Kind<dyn SinkConfig> = kind::<Webhook>(
    "webhook",
    "alarms as HTTP POST of a JSON object whose \"text\" chat servers show",
    r#"
url = "http://127.0.0.1:9000/alarms"
timeout_secs = 10.0
"#,
);

/// Keys of the webhook sink.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Webhook {
    /// Where alarms go: `https://…`, or `http://…`.
    url: String,
    /// The receiver must answer within this time (s, 0.1–60).
    #[serde(default = "timeout_secs")]
    timeout_secs: f64,
    /// File whose first line goes along as `Authorization: Bearer …`; none where left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    token_file: Option<PathBuf>,
    /// Certificate of the authority that signed the receiver's, where the system does not know it (PEM); for https.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    ca_file: Option<PathBuf>,
}

impl Webhook {
    fn is_https(&self) -> bool {
        self.url.get(..6).is_some_and(|scheme| scheme.eq_ignore_ascii_case("https:"))
    }
}

fn timeout_secs() -> f64 {
    10.0
}

impl SinkConfig for Webhook {
    fn problems(&self) -> Vec<String> {
        let mut out = Vec::new();
        let parsed = self.url.parse::<ureq::http::Uri>();
        if !parsed.is_ok_and(|uri| matches!(uri.scheme_str(), Some("http" | "https")) && uri.host().is_some()) {
            out.push(format!("url is {:?}; expected https://host:port/path, or http", self.url));
        }
        if self.is_https() {
            out.extend(kinds::left_out("https", "tls", cfg!(feature = "tls")));
        }
        if self.ca_file.is_some() && !self.is_https() {
            out.push("ca_file goes with an https url".to_owned());
        }
        if !(0.1..=60.0).contains(&self.timeout_secs) {
            out.push(format!("timeout_secs is {}; expected 0.1 to 60", self.timeout_secs));
        }
        out
    }

    fn open(&self, context: &SinkContext) -> Result<Drain, SinkError> {
        let token = self.token_file.as_ref().map(|file| secret(&context.folder, file)).transpose()?;
        let config = Agent::config_builder()
            .timeout_global(Some(Duration::from_secs_f64(self.timeout_secs)))
            .http_status_as_error(false);
        #[cfg(feature = "tls")]
        let config = if self.is_https() {
            let ca_file = self.ca_file.as_ref().map(|file| context.folder.join(file));
            let trust =
                crate::tls::Trust::read(ca_file.as_deref()).map_err(|e| super::broker::broker_error(&self.url, e))?;
            config.tls_config(trust.of_requests())
        } else {
            config
        };
        let hook = Hook { agent: config.build().into(), url: self.url.clone(), token, counts: Arc::default() };
        let counts = hook.counts.clone();
        context.voice.answer_with(move || counts.standing());
        let context = context.clone();
        Ok(Drain::Thread(Box::new(move |events| {
            hook.post_all(&events, &context);
            Ok(())
        })))
    }
}

#[derive(Debug, Default)]
struct Counts {
    posted: AtomicU64,
    tries_failed: AtomicU64,
    refused: AtomicU64,
    trying: AtomicU64,
}

impl Counts {
    fn standing(&self) -> Standing {
        let count = |value: &AtomicU64| value.load(Ordering::Relaxed);
        let (posted, refused, trying) = (count(&self.posted), count(&self.refused), count(&self.trying));
        let tries_failed = count(&self.tries_failed);
        Standing {
            // An alarm that nobody takes is not all right, however long it waits.
            ok: refused == 0 && trying == 0,
            detail: format!("{posted} alarms posted, {refused} refused, {tries_failed} tries failed"),
            figures: vec![
                ("posted", posted as f64),
                ("refused", refused as f64),
                ("tries_failed", tries_failed as f64),
                ("waiting", trying as f64),
            ],
        }
    }
}

/// What became of one try.
enum Outcome {
    Taken,
    /// It will never be taken.
    Refused(String),
    /// Perhaps later.
    Failed(String),
}

struct Hook {
    agent: Agent,
    url: String,
    token: Option<String>,
    counts: Arc<Counts>,
}

impl Hook {
    fn post_all(&self, events: &Events, context: &SinkContext) {
        while let Ok(event) = events.recv_blocking() {
            crate::fail::point("sink-webhook");
            let Event::Alarm { bench, alarm } = &*event else { continue };
            if !self.deliver(&body(bench, alarm), context) {
                return;
            }
        }
    }

    /// Tries until it is taken, refused, or the service ends at once; false in the last case.
    fn deliver(&self, body: &str, context: &SinkContext) -> bool {
        let mut backoff = Backoff::default();
        loop {
            let began = Instant::now();
            match self.post(body) {
                Outcome::Taken => {
                    self.counts.posted.fetch_add(1, Ordering::Relaxed);
                    self.counts.trying.store(0, Ordering::Relaxed);
                    return true;
                }
                Outcome::Refused(why) => {
                    tracing::error!("{}: an alarm is refused: {why}", self.url);
                    self.counts.refused.fetch_add(1, Ordering::Relaxed);
                    self.counts.trying.store(0, Ordering::Relaxed);
                    return true;
                }
                Outcome::Failed(why) => {
                    let wait = backoff.next_wait(began);
                    tracing::warn!("{}: an alarm waits: {why}; next try in {wait:.1?}", self.url);
                    self.counts.tries_failed.fetch_add(1, Ordering::Relaxed);
                    self.counts.trying.store(1, Ordering::Relaxed);
                    if !context.stop.sleep(wait) {
                        return false;
                    }
                }
            }
        }
    }

    fn post(&self, body: &str) -> Outcome {
        let mut request = self.agent.post(&self.url).header("Content-Type", "application/json");
        if let Some(token) = &self.token {
            request = request.header("Authorization", format!("Bearer {token}"));
        }
        match request.send(body) {
            Ok(answer) => {
                let status = answer.status();
                // Too early, too often, timed out: said of the moment, not of the request.
                if status.is_success() {
                    Outcome::Taken
                } else if status.is_client_error() && !matches!(status.as_u16(), 408 | 425 | 429) {
                    Outcome::Refused(status.to_string())
                } else {
                    Outcome::Failed(status.to_string())
                }
            }
            Err(error) => Outcome::Failed(error.to_string()),
        }
    }
}

fn body(bench: &str, alarm: &Alarm) -> String {
    let how = if alarm.active { "alarm" } else { "alarm over" };
    serde_json::json!({
        "kind": "alarm",
        "bench": bench,
        "id": format!("{bench}/{}", alarm.id),
        "stage": alarm.stage,
        "channel": alarm.channel,
        "severity": alarm.severity.code(),
        "active": alarm.active,
        "acknowledged": alarm.acknowledged,
        "since_ns": alarm.since_ns,
        "t_ns": alarm.t_ns,
        "text": format!("gearwatch: {how} at bench {bench}: {} at {}, {}", alarm.stage, alarm.channel, alarm.severity.code()),
    })
    .to_string()
}
