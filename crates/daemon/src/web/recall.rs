//! What the page and programs may ask of the log: histories, alarms, spectra and raw data of any
//! time.

use axum::Router;
use axum::extract::{Query, State};
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use gearwatch_history::{Asked, CutError, Sight, Store, Waveform};
use serde::Deserialize;
use serde_json::{Value, json};

use super::{Shared, json as as_json};

pub(super) fn routes() -> Router<Shared> {
    Router::new()
        .route("/api/history", get(history))
        .route("/api/alarms", get(alarms))
        .route("/api/spectra", get(spectra))
        .route("/api/raw", get(raw))
        .route("/api/raw.mcap", get(raw_mcap))
}

/// A row and a time, from the log.
#[derive(Deserialize)]
struct Wanted {
    #[serde(default)]
    bench: String,
    #[serde(default)]
    stage: String,
    #[serde(default)]
    channel: String,
    /// ns since the epoch.
    from: i64,
    to: i64,
    #[serde(default)]
    indicator: String,
}

/// Why there is no answer: status and sentence.
struct Refused(StatusCode, String);

impl IntoResponse for Refused {
    fn into_response(self) -> Response {
        (self.0, format!("{}\n", self.1)).into_response()
    }
}

impl From<std::io::Error> for Refused {
    fn from(e: std::io::Error) -> Self {
        Self(StatusCode::SERVICE_UNAVAILABLE, format!("the log cannot be listed: {e}"))
    }
}

impl From<CutError> for Refused {
    fn from(e: CutError) -> Self {
        let status = match e {
            CutError::Nothing => StatusCode::NOT_FOUND,
            CutError::TooLong(_) | CutError::TooMany => StatusCode::BAD_REQUEST,
            CutError::Write(_) => StatusCode::INTERNAL_SERVER_ERROR,
        };
        Self(status, e.to_string())
    }
}

/// Asks the log where nothing else waits for it: it lists a folder and reads files, which a disk
/// that hangs can make long.
async fn ask<T: Send + 'static>(
    shared: Shared,
    wanted: Wanted,
    question: impl FnOnce(&Store, &Wanted) -> Result<T, Refused> + Send + 'static,
) -> Result<T, Refused> {
    let Some(store) = shared.past else {
        let none = "the service keeps no log: it has no sink of kind mcap_log";
        return Err(Refused(StatusCode::NOT_FOUND, none.to_owned()));
    };
    if wanted.from >= wanted.to {
        return Err(Refused(StatusCode::BAD_REQUEST, "from must be before to (ns since the epoch)".to_owned()));
    }
    let asked = tokio::task::spawn_blocking(move || question(&store, &wanted)).await;
    asked.unwrap_or_else(|e| Err(Refused(StatusCode::INTERNAL_SERVER_ERROR, e.to_string())))
}

fn told(value: &Value) -> Response {
    as_json(value.to_string())
}

async fn history(State(shared): State<Shared>, Query(wanted): Query<Wanted>) -> Result<Response, Refused> {
    let answer = ask(shared, wanted, |store, wanted| {
        let Wanted { bench, stage, channel, from, to, indicator } = wanted;
        let row = (bench.clone(), stage.clone(), channel.clone());
        Ok(store.ask(&Asked { row, from: *from, to: *to, indicator: indicator.clone() })?)
    });
    Ok(told(&answer.await?))
}

async fn alarms(State(shared): State<Shared>, Query(wanted): Query<Wanted>) -> Result<Response, Refused> {
    let answer = ask(shared, wanted, |store, wanted| {
        let (alarms, to_read) = store.alarms(wanted.from, wanted.to)?;
        let told: Vec<_> = alarms.iter().map(|(t_ns, record)| json!({ "t_ns": t_ns, "alarm": record })).collect();
        Ok(json!({ "to_read": to_read, "alarms": told }))
    });
    Ok(told(&answer.await?))
}

async fn spectra(State(shared): State<Shared>, Query(wanted): Query<Wanted>) -> Result<Response, Refused> {
    let answer = ask(shared, wanted, |store, wanted| {
        Ok(seen(&store.sight(&wanted.bench, &wanted.channel, wanted.from, wanted.to)?))
    });
    Ok(told(&answer.await?))
}

/// Four digits are finer than a screen can show.
fn short(x: f32) -> Value {
    format!("{x:.3e}").parse::<f64>().map_or(Value::Null, |x| json!(x))
}

fn seen(sight: &Sight) -> Value {
    let spectra = sight.spectra.iter().map(|s| {
        let amplitude: Vec<Value> = s.amplitude.iter().map(|&a| short(a)).collect();
        json!({ "t0_ns": s.t0_ns, "unit": s.unit, "first_order": s.first_order, "order_step": s.order_step, "amplitude": amplitude })
    });
    json!({ "to_read": sight.to_read, "raw": sight.raw, "spectra": spectra.collect::<Vec<_>>() })
}

/// One channel's samples as numbers of four bytes; what they are stands in the headers.
async fn raw(State(shared): State<Shared>, Query(wanted): Query<Wanted>) -> Result<Response, Refused> {
    let answer =
        ask(shared, wanted, |store, wanted| Ok(store.cut(wanted.from, wanted.to)?.waveform(&wanted.channel)?));
    Ok(samples(&answer.await?))
}

fn samples(wave: &Waveform) -> Response {
    let text = |text: String| HeaderValue::from_str(&text).unwrap_or_else(|_| HeaderValue::from_static(""));
    let bytes: Vec<u8> = wave.samples.iter().flat_map(|x| x.to_le_bytes()).collect();
    let headers = [
        ("content-type", HeaderValue::from_static("application/octet-stream")),
        ("x-t0-ns", text(wave.t0_ns.to_string())),
        ("x-sample-rate-hz", text(wave.sample_rate_hz.to_string())),
        // A header holds ASCII alone, and a unit such as m/s² does not.
        ("x-unit", text(wave.unit.escape_default().to_string())),
    ];
    (headers, bytes).into_response()
}

/// All channels as a recording that `gearwatch explain` and others read.
async fn raw_mcap(State(shared): State<Shared>, Query(wanted): Query<Wanted>) -> Result<Response, Refused> {
    let from = wanted.from;
    let bytes = ask(shared, wanted, |store, wanted| Ok(store.cut(wanted.from, wanted.to)?.mcap()?)).await?;
    let name =
        format!("attachment; filename=\"gearwatch-raw-{}.mcap\"", gearwatch_log::utc(from.div_euclid(1_000_000_000)));
    let disposition = HeaderValue::from_str(&name).unwrap_or_else(|_| HeaderValue::from_static("attachment"));
    let headers = [
        (header::CONTENT_TYPE, HeaderValue::from_static("application/octet-stream")),
        (header::CONTENT_DISPOSITION, disposition),
    ];
    Ok((headers, bytes).into_response())
}
