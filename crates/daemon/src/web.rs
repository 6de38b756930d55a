//! The live page: an HTTP server on the loopback interface with the page's files, a stream of
//! events and the acknowledgement of alarms.
//!
//! ```text
//! engine ─► Hub (newest values, bounded history) ─► GET /api/events (server-sent events) ─► page
//!                                                ◄─ POST /api/alarms/{id}/acknowledge    ◄─
//! ```
//!
//! The page never touches the pipeline: it sees what the [`Hub`] was told. A slow page never holds
//! up ranks: it is told all anew.

mod gate;
mod guard;
mod hub;
mod past;
mod recall;
#[cfg(feature = "tls")]
mod tls;
mod token;

use std::convert::Infallible;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use axum::body::Bytes;
use axum::extract::{ConnectInfo, Path, State};
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::sse::{Event, KeepAlive, Sse};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use axum::{Extension, Router};
use futures_util::stream;
use gearwatch_alarm::Acknowledgement;
use serde::Deserialize;
use tokio::sync::Semaphore;

use gearwatch_history::Store;
use gearwatch_runtime::clock::now_unix_ns;

pub use gate::{Gate, Peer};
pub use guard::AllowedHosts;
pub use hub::{AlarmStatus, BenchStatus, Fault, Gravest, Hub, Listener, Message, SourceStatus, Status};
#[cfg(feature = "tls")]
pub use tls::{CertificateError, CertificateProblem, Secured, acceptor};
pub use token::{ShortToken, Token};

/// Pages that may listen at once; one more is refused with 503.
const MOST_LISTENERS: usize = 64;

/// A file of the page: path, media type, bytes.
pub(crate) type Asset = (&'static str, &'static str, &'static [u8]);

/// All files of the folder `web/assets`, as the build script lists them.
const ASSETS: &[Asset] = include!(concat!(env!("OUT_DIR"), "/assets.rs"));

const TEXT: &str = "text/plain; charset=utf-8";

/// The guides that the page points to, as they are written: a bench has no network.
const GUIDES: &[Asset] = &[
    ("/docs/page.md", TEXT, include_bytes!("../../../docs/page.md")),
    ("/docs/alarms.md", TEXT, include_bytes!("../../../docs/alarms.md")),
    ("/docs/baseline.md", TEXT, include_bytes!("../../../docs/baseline.md")),
    ("/docs/glossary.md", TEXT, include_bytes!("../../../docs/glossary.md")),
    ("/docs/indicators.md", TEXT, include_bytes!("../../../docs/indicators.md")),
    ("/docs/instrument-faults.md", TEXT, include_bytes!("../../../docs/instrument-faults.md")),
    ("/docs/log.md", TEXT, include_bytes!("../../../docs/log.md")),
    ("/docs/service.md", TEXT, include_bytes!("../../../docs/service.md")),
    ("/docs/troubleshooting.md", TEXT, include_bytes!("../../../docs/troubleshooting.md")),
];

/// The page may load what this server sends, and nothing else.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self'; \
                      base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// Acknowledges an alarm by its id; false where there is no such alarm.
pub type Acknowledge = Arc<dyn Fn(&str, Acknowledgement) -> bool + Send + Sync>;

/// What the service says of itself at this moment.
pub type Text = Arc<dyn Fn() -> String + Send + Sync>;

/// Texts for programs.
#[derive(Clone)]
pub struct Texts {
    /// For Prometheus.
    pub metrics: Text,
    /// The whole state as JSON, as the status socket gives it.
    pub snapshot: Text,
}

/// What the page shows, and what it can do.
#[derive(Clone)]
pub struct Ends {
    /// The newest of everything.
    pub hub: Arc<Hub>,
    /// Acknowledges alarms.
    pub acknowledge: Acknowledge,
    /// The log, where there is one.
    pub past: Option<Store>,
}

#[derive(Clone)]
struct Shared {
    hub: Arc<Hub>,
    acknowledge: Acknowledge,
    past: Option<Store>,
    listeners: Arc<Semaphore>,
}

/// The routes of the page. `bound` is the address that the server listens on; only requests that
/// name it (or a host of `also`) in their `Host` header are answered, which keeps foreign pages and
/// rebound names out.
pub fn router(ends: Ends, texts: Texts, bound: SocketAddr, also: &[String]) -> Router {
    let Texts { metrics, snapshot } = texts;
    let Ends { hub, acknowledge, past } = ends;
    let shared = Shared { hub, acknowledge, past, listeners: Arc::new(Semaphore::new(MOST_LISTENERS)) };
    let router = Router::new()
        .route("/metrics", get(move || async move { exposition(metrics()) }))
        .route("/api/events", get(events))
        .merge(recall::routes())
        .route("/api/snapshot", get(move || async move { json(snapshot()) }))
        .route("/api/status", get(status))
        .route("/api/alarms/{id}/acknowledge", post(acknowledge_alarm))
        .with_state(shared);
    guarded(with_assets(with_assets(router, ASSETS), GUIDES), bound, also)
}

/// With the files of a page.
pub(crate) fn with_assets(router: Router, assets: &'static [Asset]) -> Router {
    assets.iter().fold(router, |router, &(path, media, bytes)| {
        router.route(path, get(move || async move { asset(media, bytes) }))
    })
}

/// Answers only requests that name the bound address, or a host of `also`, and are not long.
pub(crate) fn guarded(router: Router, bound: SocketAddr, also: &[String]) -> Router {
    router
        .layer(axum::middleware::from_fn_with_state(Arc::new(AllowedHosts::new(bound, also)), guard::check))
        .layer(axum::extract::DefaultBodyLimit::max(64 * 1024))
}

/// In front of all routes: requests without the token are refused.
pub fn with_token(router: Router, token: Token) -> Router {
    router.layer(axum::middleware::from_fn_with_state(token, token::check))
}

fn asset(media: &'static str, bytes: &'static [u8]) -> Response {
    let headers = [
        (header::CONTENT_TYPE, HeaderValue::from_static(media)),
        (header::CONTENT_SECURITY_POLICY, HeaderValue::from_static(POLICY)),
        (header::X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff")),
        (header::CACHE_CONTROL, HeaderValue::from_static("no-cache")),
    ];
    (headers, bytes).into_response()
}

fn exposition(text: String) -> Response {
    ([(header::CONTENT_TYPE, "text/plain; version=0.0.4; charset=utf-8")], text).into_response()
}

fn json(text: String) -> Response {
    ([(header::CONTENT_TYPE, "application/json")], text).into_response()
}

async fn status(State(shared): State<Shared>) -> Response {
    json(shared.hub.status_json())
}

/// What somebody says who has seen an alarm.
#[derive(Deserialize)]
struct Seen {
    who: String,
    why: String,
    /// It holds so long alone: the alarm is shelved, or the bench in maintenance (min); 0 ends
    /// that.
    #[serde(default)]
    minutes: Option<f64>,
}

/// An alarm is shelved for a month at most (min).
const LONGEST_SHELF: f64 = 31.0 * 24.0 * 60.0;

/// Longest name, and longest reason (characters).
const LONGEST: (usize, usize) = (100, 1000);

async fn acknowledge_alarm(
    State(shared): State<Shared>,
    Path(id): Path<String>,
    peer: Option<Extension<ConnectInfo<Peer>>>,
    body: Bytes,
) -> Response {
    let seen = serde_json::from_slice(&body).ok();
    let seen = seen.map(|Seen { who, why, minutes }| Seen { who: plain(&who), why: plain(&why), minutes });
    let fits = |text: &str, longest: usize| !text.is_empty() && text.chars().count() <= longest;
    let is_right = |seen: &Seen| {
        let time = seen.minutes.is_none_or(|minutes| (0.0..=LONGEST_SHELF).contains(&minutes));
        fits(&seen.who, LONGEST.0) && fits(&seen.why, LONGEST.1) && time
    };
    let Some(Seen { who, why, minutes }) = seen.filter(is_right) else {
        let help = "an acknowledgement says who and why: {\"who\": \"…\", \"why\": \"…\"}, at most 100 and 1000 characters; \
             \"minutes\" (0 to 44640) shelves it for a time\n";
        return (StatusCode::BAD_REQUEST, help).into_response();
    };
    let from = peer.map_or_else(String::new, |Extension(ConnectInfo(Peer(address)))| address.to_string());
    let t_ns = now_unix_ns();
    let until_ns = minutes.map(|minutes| t_ns.saturating_add((60e9 * minutes) as i64));
    let seen = Acknowledgement { who, why, from, t_ns, until_ns };
    // A sink may make whoever tells it wait.
    let told = tokio::task::spawn_blocking(move || (shared.acknowledge)(&id, seen)).await;
    if told.unwrap_or(false) { StatusCode::NO_CONTENT } else { StatusCode::NOT_FOUND }.into_response()
}

/// On one line, without characters that a terminal obeys.
fn plain(text: &str) -> String {
    text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect::<String>().trim().to_owned()
}

async fn events(State(shared): State<Shared>) -> Response {
    let Ok(permit) = Arc::clone(&shared.listeners).try_acquire_owned() else {
        return (StatusCode::SERVICE_UNAVAILABLE, "too many pages are open").into_response();
    };
    let told = stream::unfold((Listener::new(&shared.hub), permit), |(mut listener, permit)| async move {
        let message = listener.next().await?;
        Some((event(&message), (listener, permit)))
    });
    Sse::new(told).keep_alive(KeepAlive::new().interval(Duration::from_secs(2))).into_response()
}

fn event(message: &Message) -> Result<Event, Infallible> {
    Ok(Event::default().event(message.kind).data(&*message.json))
}
