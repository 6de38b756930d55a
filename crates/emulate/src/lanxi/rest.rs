//! The instrument's web server.

use std::net::TcpListener;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use axum::Router;
use axum::extract::{Query, State as Has};
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post, put};
use serde_json::{Value, json};

use super::{Shared, State, count, play};
use gearwatch_runtime::clock::now_unix_ns;

/// Longest wait of a question for a change.
const LONG_POLL: Duration = Duration::from_secs(10);
/// A client connects to the stream just before it starts the measurement.
const CLIENT_SOON: Duration = Duration::from_millis(500);
/// Sample rates: 2.56 × bandwidths, in powers of two.
const RATES: [u32; 7] = [131_072, 65_536, 32_768, 16_384, 8_192, 4_096, 2_048];

/// Answers until the instrument ends.
pub(super) async fn serve(shared: Arc<Shared>, listener: TcpListener) {
    let stop = shared.stop.clone();
    let listener = match tokio::net::TcpListener::from_std(listener) {
        Ok(listener) => listener,
        Err(e) => return tracing::error!("the emulated instrument has no web server: {e}"),
    };
    let router = router(shared);
    if let Err(e) = axum::serve(listener, router).with_graceful_shutdown(async move { stop.given().await }).await {
        tracing::error!("the emulated instrument's web server has ended: {e}");
    }
}

fn router(shared: Arc<Shared>) -> Router {
    let routes = Router::new()
        .route("/module/info", get(info))
        .route("/module/time", put(time))
        .route("/open", put(|Has(s): Has<Arc<Shared>>| async move { s.open_recorder() }))
        .route("/create", put(|Has(s): Has<Arc<Shared>>| async move { s.go(&[State::Opened], State::Configuring) }))
        .route("/channels/input/all/transducers/detect", post(detect))
        .route(
            "/channels/input/all/transducers",
            get(|Has(s): Has<Arc<Shared>>| async move { answer(&s.transducers()) }),
        )
        .route("/channels/input/default", get(|Has(s): Has<Arc<Shared>>| async move { answer(&s.default_setup()) }))
        .route("/channels/input", put(configure))
        .route("/destination/socket", get(socket))
        .route("/measurements", post(start))
        .route("/measurements/stop", put(stop_measurement))
        .route("/finish", put(|Has(s): Has<Arc<Shared>>| async move { s.finish() }))
        .route("/close", put(|Has(s): Has<Arc<Shared>>| async move { s.go(&[State::Opened], State::Idle) }))
        .route("/onchange", get(on_change))
        .with_state(shared);
    Router::new().nest("/rest/rec", routes)
}

fn answer(value: &Value) -> Response {
    ([("content-type", "application/json")], value.to_string()).into_response()
}

impl Shared {
    fn refuse(&self, state: State) -> Response {
        count(&self.stats.refused);
        (StatusCode::FORBIDDEN, format!("not in state {}", state.name())).into_response()
    }

    /// Changes the state, if it is one of `from`.
    fn go(&self, from: &[State], to: State) -> Response {
        let mut recorder = self.recorder();
        if !from.contains(&recorder.state) {
            return self.refuse(recorder.state);
        }
        recorder.state = to;
        drop(recorder);
        self.changed();
        answer(&Value::Null)
    }

    fn open_recorder(&self) -> Response {
        let mut recorder = self.recorder();
        if recorder.refuse > 0 {
            recorder.refuse -= 1;
            return self.refuse(recorder.state);
        }
        drop(recorder);
        self.go(&[State::Idle], State::Opened)
    }

    fn finish(&self) -> Response {
        self.recorder().client = None;
        self.go(&[State::Configuring, State::Streaming], State::Opened)
    }

    fn status(&self, tag: u64) -> Value {
        let recorder = self.recorder();
        let detecting = recorder.detecting.is_some_and(|until| Instant::now() < until);
        let of = |anol: &&str| json!({ "anol": anol, "cmol": "none", "cf": "none" });
        json!({
            "lastUpdateTag": tag, "moduleState": recorder.state.name(), "transducerDetectionActive": detecting,
            "recordingStatus": { "channelStatus": recorder.overload.iter().map(of).collect::<Vec<_>>() },
        })
    }
}

async fn info(Has(shared): Has<Arc<Shared>>) -> Response {
    let mut rates: Vec<f64> = RATES.iter().map(|&rate| f64::from(rate)).collect();
    if !rates.contains(&shared.rate_hz) {
        // It plays what it is given.
        rates.push(shared.rate_hz);
    }
    answer(&json!({
        "module": { "type": { "number": "3050", "model": "", "prefix": "", "variant": "" }, "serial": shared.config.serial },
        "numberOfInputChannels": shared.channels.len(), "supportedSampleRates": rates,
    }))
}

async fn time(Has(shared): Has<Arc<Shared>>, body: String) -> Response {
    let Some(now_ns) = body.trim().parse::<i64>().ok().and_then(|ms| ms.checked_mul(1_000_000)) else {
        return (StatusCode::BAD_REQUEST, "expected milliseconds since 1970").into_response();
    };
    shared.recorder().clock_offset_ns = now_ns.saturating_sub(now_unix_ns());
    answer(&Value::Null)
}

async fn detect(Has(shared): Has<Arc<Shared>>) -> Response {
    let done = shared.config.detection;
    {
        let mut recorder = shared.recorder();
        if recorder.state != State::Configuring {
            return shared.refuse(recorder.state);
        }
        recorder.detecting = Some(Instant::now() + done);
    }
    shared.changed();
    tokio::spawn(async move {
        tokio::time::sleep(done).await;
        shared.changed();
    });
    answer(&Value::Null)
}

async fn configure(Has(shared): Has<Arc<Shared>>, body: String) -> Response {
    let wrong = |why: String| (StatusCode::BAD_REQUEST, why).into_response();
    let setup: Value = match serde_json::from_str(&body) {
        Ok(setup) => setup,
        Err(e) => return wrong(e.to_string()),
    };
    let Some(channels) = setup["channels"].as_array() else { return wrong("expected channels".to_owned()) };
    let first = channels.first().unwrap_or(&Value::Null);
    if channels.iter().any(|c| c["bandwidth"] != first["bandwidth"] || c["destinations"] != json!(["socket"])) {
        return wrong("bandwidth must be the same on all channels, destinations [\"socket\"]".to_owned());
    }
    let bandwidth_hz = bandwidth_hz(&first["bandwidth"]);
    if bandwidth_hz.is_none_or(|hz| (hz * 2.56 - shared.rate_hz).abs() > 1e-6 * shared.rate_hz) {
        return wrong(format!(
            "the material has {} samples per second; bandwidth is {}",
            shared.rate_hz, first["bandwidth"]
        ));
    }
    let mut recorder = shared.recorder();
    if recorder.state != State::Configuring {
        return shared.refuse(recorder.state);
    }
    recorder.setup = setup;
    drop(recorder);
    shared.go(&[State::Configuring], State::Streaming)
}

/// `6.4 kHz` as 6400.
fn bandwidth_hz(text: &Value) -> Option<f64> {
    let (number, unit) = text.as_str()?.split_once(' ')?;
    let factor = match unit {
        "kHz" => 1000.0,
        "Hz" => 1.0,
        _ => return None,
    };
    Some(number.parse::<f64>().ok()? * factor)
}

async fn socket(Has(shared): Has<Arc<Shared>>) -> Response {
    let state = shared.recorder().state;
    if !matches!(state, State::Streaming | State::Recording) {
        return shared.refuse(state);
    }
    answer(&json!({ "tcpPort": shared.stream_port }))
}

async fn start(Has(shared): Has<Arc<Shared>>) -> Response {
    let began = Instant::now();
    while shared.recorder().client.is_none() && began.elapsed() < CLIENT_SOON {
        tokio::time::sleep(super::LOOK).await;
    }
    let (client, measurement) = {
        let mut recorder = shared.recorder();
        if recorder.state != State::Streaming {
            return shared.refuse(recorder.state);
        }
        let Some(client) = recorder.client.take() else {
            return (StatusCode::FORBIDDEN, "nobody is connected to the socket").into_response();
        };
        recorder.state = State::Recording;
        recorder.measurement += 1;
        recorder.overload.fill("none");
        (client, recorder.measurement)
    };
    count(&shared.stats.measurements);
    shared.changed();
    let player = shared.clone();
    let thread = std::thread::Builder::new().name("emulate-play".to_owned());
    match thread.spawn(move || play::play(&player, client, measurement)) {
        Ok(_) => answer(&Value::Null),
        Err(e) => (StatusCode::INTERNAL_SERVER_ERROR, e.to_string()).into_response(),
    }
}

async fn stop_measurement(Has(shared): Has<Arc<Shared>>) -> Response {
    // A client that closed the socket already did so in the wrong order; the player has counted
    // that.
    let recording = shared.recorder().state == State::Recording;
    let answer = shared.go(&[State::Recording], State::Streaming);
    if recording {
        shared.stats.closed_in_order.fetch_add(1, Ordering::Relaxed);
    }
    answer
}

#[derive(serde::Deserialize)]
struct Since {
    #[serde(default)]
    last: u64,
}

async fn on_change(Has(shared): Has<Arc<Shared>>, Query(since): Query<Since>) -> Response {
    let mut tags = shared.tag.subscribe();
    let stop = shared.stop.clone();
    tokio::select! {
        changed = tokio::time::timeout(LONG_POLL, tags.wait_for(|tag| *tag > since.last)) => {
            // After a long wait without a change the instrument says how it is all the same.
            drop(changed);
        }
        () = stop.given() => {}
    }
    let tag = *tags.borrow();
    answer(&shared.status(tag))
}
