//! The page of the fleet: all benches in a browser on this machine.
//!
//! ```text
//! stream ─► follow ─► Fleet and Past ─► once a second one JSON object ─► GET /api/fleet, /api/events (server-sent events) ─► page
//! ```
//!
//! The page has a follower of its own: it heals after an outage as the terminal does, and what came
//! late stands where it belongs in time.

use std::collections::BTreeMap;
use std::convert::Infallible;
use std::net::SocketAddr;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use axum::Router;
use axum::extract::State;
use axum::http::header;
use axum::response::sse::{Event, KeepAlive, Sse};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use futures_util::stream;
use gearwatch_core::verdict::{Code, MachineState};
use serde::Serialize;
use tokio::net::TcpListener;
use tokio::sync::watch;

use super::{Access, Bench, Fleet, From, Heard, Notice, Told, follow};
use crate::web;

/// How often the page is told.
const TICK: Duration = Duration::from_secs(1);
/// Minutes of the past that a bench's strip shows.
const MINUTES: i64 = 120;

const ASSETS: &[web::Asset] = &[
    ("/", "text/html; charset=utf-8", include_bytes!("assets/fleet.html")),
    ("/assets/fleet.js", "text/javascript; charset=utf-8", include_bytes!("assets/fleet.js")),
    ("/assets/fleet.css", "text/css; charset=utf-8", include_bytes!("assets/fleet.css")),
    ("/assets/style.css", "text/css; charset=utf-8", include_bytes!("../web/assets/style.css")),
    ("/assets/icon.svg", "image/svg+xml", include_bytes!("../web/assets/icon.svg")),
];

/// Worst machine state of each minute of a bench, by the time of its windows.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[serde(transparent)]
struct Past(BTreeMap<i64, i8>);

impl Past {
    fn take(&mut self, heard: &Heard) {
        let Some(t0_ns) = heard.object.get("t0_ns").and_then(serde_json::Value::as_i64) else { return };
        let severity = match MachineState::of_code(heard.text("machine")).unwrap_or_default() {
            MachineState::Alarm => 2,
            MachineState::Deviating | MachineState::PathChanged => 1,
            MachineState::Normal => 0,
            MachineState::Unknown => -1,
        };
        let minute = t0_ns.div_euclid(60_000_000_000);
        let worst = self.0.entry(minute).or_insert(severity);
        *worst = severity.max(*worst);
        let oldest = self.0.last_key_value().map_or(minute, |(newest, _)| newest - MINUTES + 1);
        self.0 = self.0.split_off(&oldest);
    }
}

/// What the page shows.
#[derive(Debug, Default)]
struct Shown {
    fleet: Fleet,
    pasts: BTreeMap<String, Past>,
    /// `connecting`, `reading`, `live`, or what is wrong.
    link: String,
}

#[derive(Serialize)]
struct BenchShown<'a> {
    condition: &'static str,
    past: Option<&'a Past>,
    #[serde(flatten)]
    bench: &'a Bench,
}

impl Shown {
    fn take(&mut self, notice: Notice) {
        match notice {
            Notice::Letter(heard) => {
                if self.fleet.take(&heard) == Told::New && heard.text("kind") == "verdict" {
                    self.pasts.entry(heard.text("bench").to_owned()).or_default().take(&heard);
                }
            }
            Notice::Connected => "reading".clone_into(&mut self.link),
            Notice::CaughtUp => "live".clone_into(&mut self.link),
            Notice::Lost(error) => self.link = format!("away: {error}"),
        }
    }

    fn json(&self, server: &str) -> String {
        let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let now_ns = i64::try_from(since.as_nanos()).unwrap_or(i64::MAX);
        let benches: BTreeMap<&str, BenchShown<'_>> = self
            .fleet
            .benches
            .iter()
            .map(|(name, bench)| {
                let shown = BenchShown { condition: bench.condition(now_ns).code(), past: self.pasts.get(name), bench };
                (name.as_str(), shown)
            })
            .collect();
        let object = serde_json::json!({ "server": server, "link": self.link, "now_ns": now_ns, "benches": benches });
        object.to_string()
    }
}

/// Follows the stream and serves the page until the listener fails.
///
/// # Errors
/// When the listener cannot be used.
pub async fn page(
    listener: std::net::TcpListener,
    server: &str,
    access: &Access,
    stream: &str,
    from: From,
) -> std::io::Result<()> {
    listener.set_nonblocking(true)?;
    let listener = TcpListener::from_std(listener)?;
    let bound = listener.local_addr()?;
    let shown = Mutex::new(Shown { link: "connecting".to_owned(), ..Shown::default() });
    let lock = || shown.lock().unwrap_or_else(PoisonError::into_inner);
    let (sender, receiver) = watch::channel(Arc::<str>::from(lock().json(server)));
    let told = async {
        loop {
            tokio::time::sleep(TICK).await;
            sender.send_replace(lock().json(server).into());
        }
    };
    tokio::select! {
        _ = follow(server, access, stream, from, |notice| lock().take(notice)) => Ok(()),
        () = told => Ok(()),
        served = axum::serve(web::Gate::new(listener), router(receiver, bound)).into_future() => served,
    }
}

fn router(updates: watch::Receiver<Arc<str>>, bound: SocketAddr) -> Router {
    let router = Router::new().route("/api/fleet", get(now)).route("/api/events", get(events)).with_state(updates);
    web::guarded(web::with_assets(router, ASSETS), bound, &[])
}

async fn now(State(updates): State<watch::Receiver<Arc<str>>>) -> Response {
    let json = updates.borrow().to_string();
    ([(header::CONTENT_TYPE, "application/json")], json).into_response()
}

async fn events(State(mut updates): State<watch::Receiver<Arc<str>>>) -> Response {
    updates.mark_changed();
    let events = stream::unfold(updates, |mut updates| async move {
        updates.changed().await.ok()?;
        let event = Event::default().data(&**updates.borrow_and_update());
        Some((Ok::<_, Infallible>(event), updates))
    });
    Sse::new(events).keep_alive(KeepAlive::new().interval(Duration::from_secs(2))).into_response()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn verdict(seq: u64, minute: i64, machine: &str) -> Notice {
        let t0_ns = minute * 60_000_000_000 + 1;
        let text = format!(
            "{{\"bench\":\"b\",\"run\":\"r\",\"seq\":{seq},\"kind\":\"verdict\",\"machine\":\"{machine}\",\"t0_ns\":{t0_ns}}}"
        );
        Notice::Letter(Box::new(Heard::read(0, text.as_bytes()).unwrap()))
    }

    /// A minute shows its worst, a late letter goes where it belongs, a repetition changes nothing,
    /// and the past is bounded.
    #[test]
    fn analytic_the_past_is_by_the_time_of_the_windows() {
        let mut shown = Shown::default();
        shown.take(verdict(1, 100, "normal"));
        shown.take(verdict(2, 100, "alarm"));
        shown.take(verdict(3, 103, "normal"));
        shown.take(verdict(4, 101, "deviating"));
        shown.take(verdict(4, 102, "alarm"));
        let past: Vec<_> = shown.pasts["b"].0.clone().into_iter().collect();
        assert_eq!(past, [(100, 2), (101, 1), (103, 0)]);
        shown.take(verdict(5, 101 + MINUTES, "unknown"));
        let past: Vec<_> = shown.pasts["b"].0.clone().into_iter().collect();
        assert_eq!(past, [(103, 0), (101 + MINUTES, -1)]);
        let json: serde_json::Value = serde_json::from_str(&shown.json("nats://here")).unwrap();
        assert_eq!(json["benches"]["b"]["past"]["103"], 0);
        assert_eq!(json["benches"]["b"]["verdicts"], 5);
    }
}
