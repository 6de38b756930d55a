//! Alarms as HTTP POST with a JSON body; tried again with growing waits until the receiver takes
//! them.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use gearwatch_alarm::{Alarm, MAINTENANCE};
use gearwatch_runtime::kinds::{self, Kind};
use gearwatch_runtime::secret::{Secret, carries_secret, place};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use ureq::Agent;

use super::broker::{broker_error, secret};
use super::{Drain, Events, SinkConfig, SinkContext, SinkError, Standing, kind};
use crate::event::Event;
use gearwatch_runtime::backoff::Backoff;

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
    #[serde(default, skip_serializing_if = "Option::is_none")]
    url: Option<String>,
    /// File whose first line is the address, where the address itself is a secret.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    url_file: Option<PathBuf>,
    /// The receiver must answer within this time (s, 0.1–60).
    #[serde(default = "timeout_secs")]
    timeout_secs: f64,
    /// File whose first line goes along as `Authorization: Bearer …`; none where left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    token_file: Option<PathBuf>,
    /// Where a reader of the text finds the page, such as `https://bench-3:8650`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    link: Option<String>,
    /// Certificate of the authority that signed the receiver's, where the system does not know it
    /// (PEM); for https.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    ca_file: Option<PathBuf>,
}

impl Webhook {
    /// The address, from the configuration or its file.
    fn address(&self, folder: &Path) -> Result<Secret, SinkError> {
        let Some(file) = &self.url_file else { return Ok(Secret::new(self.url.clone().unwrap_or_default())) };
        let address = secret(folder, file)?;
        if is_address(address.expose()) {
            return Ok(address);
        }
        Err(broker_error(
            &folder.join(file).display().to_string(),
            "its first line is no address such as https://host:port/path",
        ))
    }

    /// Reads what the configuration names; the address, how to ask it, and the token.
    fn agent(&self, folder: &Path) -> Result<(Secret, Agent, Option<Secret>), SinkError> {
        let address = self.address(folder)?;
        let token = self.token_file.as_ref().map(|file| secret(folder, file)).transpose()?;
        let config = Agent::config_builder()
            .timeout_global(Some(Duration::from_secs_f64(self.timeout_secs)))
            // Followed, a redirect turns the POST into a GET elsewhere: an alarm that nobody has
            // got would count as posted.
            .max_redirects(0)
            .max_redirects_will_error(false)
            .http_status_as_error(false);
        #[cfg(feature = "tls")]
        let config = if is_https(address.expose()) {
            let ca_file = self.ca_file.as_ref().map(|file| folder.join(file));
            let trust = gearwatch_runtime::tls::Trust::read(ca_file.as_deref())
                .map_err(|e| broker_error(&place(address.expose()), e))?;
            config.tls_config(trust.of_requests())
        } else {
            config
        };
        #[cfg(not(feature = "tls"))]
        if is_https(address.expose()) {
            return Err(broker_error(&place(address.expose()), kinds::with_feature("tls")));
        }
        Ok((address, config.build().into(), token))
    }
}

fn is_https(url: &str) -> bool {
    url.get(..6).is_some_and(|scheme| scheme.eq_ignore_ascii_case("https:"))
}

fn is_address(url: &str) -> bool {
    let parsed = url.parse::<ureq::http::Uri>();
    parsed.is_ok_and(|uri| matches!(uri.scheme_str(), Some("http" | "https")) && uri.host().is_some())
}

fn timeout_secs() -> f64 {
    10.0
}

impl SinkConfig for Webhook {
    fn problems(&self) -> Vec<String> {
        let mut out = Vec::new();
        match &self.url {
            Some(_) if self.url_file.is_some() => out.push("url and url_file exclude each other; leave one out".to_owned()),
            Some(url) if carries_secret(url) => out.push(format!(
                "url holds what looks like a secret (at {}); put the whole address into a file and name that in url_file",
                place(url)
            )),
            Some(url) if !is_address(url) => {
                out.push(format!("url is {url:?}; expected https://host:port/path, or http"));
            }
            None if self.url_file.is_none() => out.push("url or url_file is missing".to_owned()),
            _ => {}
        }
        if self.url.as_ref().is_some_and(|url| is_https(url)) {
            out.extend(kinds::left_out("https", "tls", cfg!(feature = "tls")));
        }
        if self.ca_file.is_some() && self.url.as_ref().is_some_and(|url| !is_https(url)) {
            out.push("ca_file goes with an https url".to_owned());
        }
        if let Some(link) = &self.link {
            if !is_address(link) {
                out.push(format!("link is {link:?}; expected an address such as https://bench-3:8650"));
            } else if carries_secret(link) {
                out.push(
                    "link carries a secret, and it is sent to the receiver; give the page's address alone".to_owned(),
                );
            }
        }
        if !(0.1..=60.0).contains(&self.timeout_secs) {
            out.push(format!("timeout_secs is {}; expected 0.1 to 60", self.timeout_secs));
        }
        out
    }

    fn try_out(&self, folder: &Path) -> Result<(), SinkError> {
        self.agent(folder).map(drop)
    }

    fn open(&self, context: &SinkContext) -> Result<Drain, SinkError> {
        let (url, agent, token) = self.agent(&context.folder)?;
        let hook = Hook { agent, url, token, link: self.link.clone(), counts: Arc::default() };
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
            stalled: false,
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
    url: Secret,
    token: Option<Secret>,
    link: Option<String>,
    counts: Arc<Counts>,
}

impl Hook {
    fn post_all(&self, events: &Events, context: &SinkContext) {
        while let Ok(event) = events.recv_blocking() {
            gearwatch_runtime::fail::point("sink-webhook");
            // That somebody has seen it is no news for whoever must come, nor that another channel
            // shows the same fault.
            let Event::Alarm { bench, alarm, seen: None } = &*event else { continue };
            if !is_news(alarm) {
                continue;
            }
            if !self.deliver(&body(bench, alarm, self.link.as_deref()), context) {
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
                    tracing::error!("{}: an alarm is refused: {why}", place(self.url.expose()));
                    self.counts.refused.fetch_add(1, Ordering::Relaxed);
                    self.counts.trying.store(0, Ordering::Relaxed);
                    return true;
                }
                Outcome::Failed(why) => {
                    let wait = backoff.next_wait(began);
                    tracing::warn!("{}: an alarm waits: {why}; next try in {wait:.1?}", place(self.url.expose()));
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
        let mut request = self.agent.post(self.url.expose()).header("Content-Type", "application/json");
        if let Some(token) = &self.token {
            request = request.header("Authorization", format!("Bearer {}", token.expose()));
        }
        match request.send(body) {
            Ok(answer) => {
                let status = answer.status();
                // Too early, too often, timed out: said of the moment, not of the request.
                if status.is_redirection() {
                    Outcome::Failed(format!(
                        "{status}: it points elsewhere; put the address that it points to into the configuration"
                    ))
                } else if status.is_success() {
                    Outcome::Taken
                } else if status.is_client_error() && !matches!(status.as_u16(), 408 | 425 | 429) {
                    Outcome::Refused(status.to_string())
                } else {
                    Outcome::Failed(status.to_string())
                }
            }
            Err(error) => Outcome::Failed(without(&error.to_string(), self.url.expose())),
        }
    }
}

/// What went wrong, without the address, which may be a secret.
fn without(words: &str, address: &str) -> String {
    words.replace(address, &place(address))
}

/// Whether somebody must hear of it: not of what is shelved, of maintenance, or of one channel more
/// of a fault that is known.
fn is_news(alarm: &Alarm) -> bool {
    let quiet = alarm.active && alarm.acknowledged || alarm.id == MAINTENANCE;
    !quiet && alarm.group.as_ref().is_none_or(|group| group.news)
}

/// What is posted; `link` is where a reader of the text finds the page.
fn body(bench: &str, alarm: &Alarm, link: Option<&str>) -> String {
    let how = match (alarm.active, alarm.over) {
        (true, _) => "alarm",
        (false, true) => "alarm over",
        (false, false) => "alarm that no longer holds and that nobody has seen",
    };
    let mut text =
        format!("gearwatch: {how} at bench {bench}: {} at {}, {}", alarm.stage, alarm.channel, alarm.severity.code());
    if let Some(evidence) = &alarm.evidence {
        text.push_str(&format!(": {}", evidence.words()));
    }
    let with: Vec<&str> = alarm.group.iter().flat_map(|group| &group.channels).map(String::as_str).collect();
    let with: Vec<&str> = with.into_iter().filter(|channel| *channel != alarm.channel).collect();
    if !with.is_empty() {
        text.push_str(&format!("; also at {}", with.join(", ")));
    }
    if let Some(link) = link {
        text.push_str(&format!(" - {link}"));
    }
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
        "evidence": alarm.evidence,
        "group": alarm.group,
        "link": link,
        "text": text,
    })
    .to_string()
}

#[cfg(test)]
mod tests {
    use super::*;
    use gearwatch_alarm::{Evidence, Severity};

    fn alarm() -> Alarm {
        Alarm {
            id: "stage1@acc_1".into(),
            stage: "stage1".into(),
            channel: "acc_1".into(),
            severity: Severity::Critical,
            since_ns: 5,
            t_ns: 7,
            active: true,
            acknowledged: false,
            over: false,
            evidence: Some(Box::new(Evidence {
                harmonic: 2,
                amplitude: 1.25,
                unit: "m/s²".into(),
                baseline: Some(1.0),
                deviation_percent: 25.04,
                deviation_sigma_percent: 0.83,
                limit_percent: Some(10.0),
                rank: "V".into(),
                window: 12,
                input_speed_hz: Some(25.0),
                mesh_hz: Some(725.0),
                brake_torque_nm: Some(40.0),
            })),
            seen: None,
            group: None,
        }
    }

    fn text(alarm: &Alarm, link: Option<&str>) -> String {
        let posted: serde_json::Value = serde_json::from_str(&body("bench 3", alarm, link)).unwrap();
        posted["text"].as_str().unwrap().to_owned()
    }

    /// Whoever reads it on a telephone knows what, where, how much, beyond which limit and at which
    /// operating point, without another program.
    #[test]
    fn conform_the_text_says_what_and_where_and_by_how_much() {
        let mut alarm = alarm();
        assert_eq!(
            text(&alarm, Some("https://bench-3:8650")),
            "gearwatch: alarm at bench bench 3: stage1 at acc_1, critical: 2x +25.0 % ± 0.8 %, rank V (limit 10 %), \
             input shaft 25.00 Hz, 40.0 N m - https://bench-3:8650"
        );
        // What is not known is not said.
        let evidence = alarm.evidence.as_mut().unwrap();
        (evidence.limit_percent, evidence.input_speed_hz, evidence.brake_torque_nm) = (None, None, None);
        assert_eq!(
            text(&alarm, None),
            "gearwatch: alarm at bench bench 3: stage1 at acc_1, critical: 2x +25.0 % ± 0.8 %, rank V"
        );
        alarm.evidence = None;
        alarm.severity = Severity::Warning;
        assert_eq!(text(&alarm, None), "gearwatch: alarm at bench bench 3: stage1 at acc_1, warning");
    }

    #[test]
    fn conform_an_alarm_that_nobody_has_seen_is_not_called_over() {
        let mut alarm = Alarm { active: false, evidence: None, ..alarm() };
        let place = "at bench bench 3: stage1 at acc_1, critical";
        assert_eq!(
            text(&alarm, None),
            format!("gearwatch: alarm that no longer holds and that nobody has seen {place}")
        );
        alarm.over = true;
        assert_eq!(text(&alarm, None), format!("gearwatch: alarm over {place}"));
    }
}
