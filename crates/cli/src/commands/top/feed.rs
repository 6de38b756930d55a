//! Reads the service's stream of events on a thread of its own, and comes back when the service
//! does.

use std::io::{BufRead, BufReader};
use std::sync::mpsc::SyncSender;
use std::time::Duration;

use gearwatch_core::verdict::Verdict;
use percent_encoding::{NON_ALPHANUMERIC, utf8_percent_encode};
use serde::Deserialize;
use serde_json::Value;

use crate::page::Page;

/// A verdict, and the bench that it is of.
#[derive(Debug, Deserialize)]
pub struct Judged {
    /// Name of the bench; empty where the service does not say it.
    #[serde(default)]
    pub bench: String,
    /// The verdict.
    #[serde(flatten)]
    pub verdict: Verdict,
}

/// What came in.
pub enum Message {
    /// The past of a row: its levels, a letter a window.
    Past(Value),
    /// A verdict on one window.
    Verdict(Box<Judged>),
    /// How the service is.
    Status(Value),
    /// The link is up, or why it is not.
    Link(Result<(), String>),
}

/// The service says how it is once a second; after this long without a word the link counts as
/// lost.
pub const SILENCE: Duration = Duration::from_secs(6);
const AGAIN: Duration = Duration::from_secs(1);
/// One event holds one window, one status or an hour of a row; more is not this service.
const LONGEST_LINE: usize = 4 << 20;

/// The link to a service.
pub struct Feed {
    page: Page,
}

impl Feed {
    /// Starts reading; the thread ends with the process or when nobody receives.
    pub fn start(page: Page, out: SyncSender<Message>) -> std::io::Result<Self> {
        let feed = Self { page: page.clone() };
        std::thread::Builder::new().name("top-feed".into()).spawn(move || {
            loop {
                let error = match read(&page, &out) {
                    Ok(()) => "the service closed the stream".to_owned(),
                    Err(error) => error.to_string(),
                };
                if out.send(Message::Link(Err(error))).is_err() {
                    return;
                }
                std::thread::sleep(AGAIN);
            }
        })?;
        Ok(feed)
    }

    /// Acknowledges an alarm in the name of whoever is logged in, and says how that went.
    pub fn acknowledge(&self, id: &str) -> String {
        let who = ["USER", "LOGNAME", "USERNAME"].iter().find_map(|name| std::env::var(name).ok());
        let who = who.filter(|who| !who.is_empty()).unwrap_or_else(|| "somebody at a terminal".to_owned());
        let seen = serde_json::json!({ "who": who, "why": "seen in gearwatch top" });
        match self.page.post(&path_of(id), &seen) {
            Ok(_) => format!("alarm {id} acknowledged"),
            Err(error) => format!("alarm {id} could not be acknowledged: {error}"),
        }
    }
}

/// An id holds slashes between bench, stage and channel, and whatever names hold.
fn path_of(id: &str) -> String {
    format!("/api/alarms/{}/acknowledge", utf8_percent_encode(id, NON_ALPHANUMERIC))
}

fn read(page: &Page, out: &SyncSender<Message>) -> anyhow::Result<()> {
    let response = page.get("/api/events")?;
    if out.send(Message::Link(Ok(()))).is_err() {
        return Ok(());
    }
    let mut lines = BufReader::new(response.into_body().into_reader());
    let mut kind = String::new();
    let mut line = String::new();
    loop {
        line.clear();
        let mut bounded = std::io::Read::take(&mut lines, LONGEST_LINE as u64);
        if bounded.read_line(&mut line)? == 0 {
            return Ok(());
        }
        let text = line.trim_end();
        if let Some(name) = text.strip_prefix("event:") {
            name.trim().clone_into(&mut kind);
        } else if let Some(data) = text.strip_prefix("data:") {
            let message = match kind.as_str() {
                "past" => Message::Past(serde_json::from_str(data)?),
                "verdict" => Message::Verdict(serde_json::from_str(data)?),
                "status" => Message::Status(serde_json::from_str(data)?),
                _ => continue,
            };
            if out.send(message).is_err() {
                return Ok(());
            }
        }
    }
}

#[cfg(test)]
mod tests {
    /// The slashes of an id are no slashes of the path: the service knew no such route.
    #[test]
    fn regress_an_alarm_is_one_part_of_the_path() {
        assert_eq!(super::path_of("stage1/acc 1"), "/api/alarms/stage1%2Facc%201/acknowledge");
    }
}
