//! From an idle instrument to a running measurement, call by call, and back to idle in the right
//! order.

use std::net::TcpStream;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use serde_json::{Value, json};

use super::rest::{CallError, Rest};
use super::stream::Expected;
use super::{Identity, Input, Memory};
use crate::SourceError;

/// Sample rate / bandwidth of the instrument.
const RATE_PER_BANDWIDTH: f64 = 2.56;
/// Full scale lies 1.5 dB above the nominal range.
const HEADROOM_DB: f64 = 1.5;
/// The stream's port answers within this time, or the instrument is gone.
const CONNECT: Duration = Duration::from_secs(3);

/// What is asked of the instrument.
pub(super) struct Wanted<'a> {
    /// In ascending order.
    pub(super) inputs: &'a [Input],
    pub(super) rate_hz: f64,
    pub(super) detect: bool,
    /// Who it was before.
    pub(super) before: Option<Identity>,
    pub(super) serial: Option<u64>,
}

/// An opened instrument. Whatever happens, dropping it takes the instrument back to idle.
pub(super) struct Measurement {
    pub(super) rest: Rest,
    pub(super) identity: Identity,
    pub(super) expected: Vec<Expected>,
    stream: TcpStream,
    opened: Opened,
}

impl Measurement {
    /// Sets the instrument up and starts it. `may_end`: what runs on it already may be ended.
    pub(super) fn start(
        rest: Rest,
        wanted: &Wanted<'_>,
        may_end: bool,
        memory: &Arc<Mutex<Memory>>,
    ) -> Result<Self, SourceError> {
        let (module, serial) = check_module(&rest, wanted)?;
        open(&rest, may_end)?;
        let mut opened = Opened { rest: rest.clone(), recording: false, socket: None, memory: memory.clone() };
        let call =
            |what: &str, answer: Result<Value, CallError>| answer.map_err(|e| rest.error(format!("{what}: {e}")));
        let wait = |state: &str| {
            let reached = rest.wait_for(state, |s| s["moduleState"] == state);
            reached.map_err(|e| rest.error(format!("waiting for {state}: {e}")))
        };
        wait("RecorderOpened")?;
        call("create", rest.put("create", ""))?;
        wait("RecorderConfiguring")?;
        let transducers = if wanted.detect { detect(&rest)? } else { Vec::new() };
        let identity = Identity {
            module,
            serial,
            transducers: wanted.inputs.iter().map(|input| transducer_name(at(&transducers, input))).collect(),
        };
        if let Some(change) = wanted.before.as_ref().and_then(|before| before.change(&identity, wanted.inputs)) {
            return Err(rest.error(change));
        }
        let mut setup = call("channels/input/default", rest.get("channels/input/default"))?;
        let expected = fill(&mut setup, wanted, &transducers).map_err(|e| rest.error(e.to_string()))?;
        call("channels/input", rest.put("channels/input", &setup.to_string()))?;
        wait("RecorderStreaming")?;
        let socket = call("destination/socket", rest.get("destination/socket"))?;
        let port = socket["tcpPort"].as_u64().and_then(|port| u16::try_from(port).ok());
        let port = port.ok_or_else(|| rest.error(format!("destination/socket: expected a tcpPort, found {socket}")))?;
        let stream = TcpStream::connect_timeout(&rest.stream_address(port)?, CONNECT)
            .map_err(|e| rest.error(format!("the stream at port {port}: {e}")))?;
        opened.socket = stream.try_clone().ok();
        call("measurements", rest.post("measurements"))?;
        opened.recording = true;
        wait("RecorderRecording")?;
        tracing::info!(
            instrument = rest.address,
            "measuring with {} no. {}: {} signals, {} Hz",
            identity.module,
            identity.serial,
            wanted.inputs.len(),
            wanted.rate_hz
        );
        Ok(Self { rest, identity, expected, stream, opened })
    }

    /// The socket, to be read.
    pub(super) fn stream(&self) -> &TcpStream {
        &self.stream
    }

    /// A read waits no longer than this.
    pub(super) fn read_timeout(&self, timeout: Duration) -> Result<(), SourceError> {
        let timeout = Some(timeout.max(Duration::from_millis(1)));
        self.stream.set_read_timeout(timeout).map_err(|e| self.opened.rest.error(format!("the stream: {e}")))
    }
}

/// The instrument belongs to this service from `open` to `close`.
struct Opened {
    rest: Rest,
    recording: bool,
    /// A second handle, so that the socket is shut at its place in the order.
    socket: Option<TcpStream>,
    memory: Arc<Mutex<Memory>>,
}

impl Drop for Opened {
    /// Stop, then close the socket, then finish and close: in another order the instrument takes it
    /// for lost data.
    fn drop(&mut self) {
        let mut away = None;
        let mut last = |path: &str| {
            if away.is_none()
                && let Err(CallError::Away(why)) = self.rest.put_last(path)
            {
                away = Some(why);
            }
        };
        if self.recording {
            last("measurements/stop");
        }
        if let Some(socket) = self.socket.take() {
            // It may be shut already, by the other side.
            let _ = socket.shutdown(std::net::Shutdown::Both);
        }
        last("finish");
        last("close");
        if let Some(why) = away {
            tracing::warn!(instrument = self.rest.address, "it could not be taken back to idle: {why}");
            self.memory.lock().unwrap_or_else(PoisonError::into_inner).left_open = true;
        }
    }
}

/// Type and serial number of the module, if it is the right one and can do what is wanted. Nothing
/// is changed on it.
fn check_module(rest: &Rest, wanted: &Wanted<'_>) -> Result<(String, u64), SourceError> {
    let info = rest.get("module/info").map_err(|e| rest.error(format!("module/info: {e}")))?;
    let text = |value: &Value| value.as_str().map_or_else(|| value.to_string(), str::to_owned);
    let module = text(&info["module"]["type"]["number"]);
    let serial = text(&info["module"]["serial"]);
    let serial: u64 = serial.parse().map_err(|_| {
        rest.error(format!("module/info: expected module.serial, found {serial}; is this a LAN-XI instrument?"))
    })?;
    if let Some(expected) = wanted.serial
        && expected != serial
    {
        return Err(rest.error(format!("the instrument is no. {serial}; the configuration names no. {expected}")));
    }
    let rates: Vec<f64> =
        info["supportedSampleRates"].as_array().into_iter().flatten().filter_map(Value::as_f64).collect();
    if !rates.is_empty() && !rates.contains(&wanted.rate_hz) {
        return Err(rest.error(format!("it cannot sample at {} Hz; it can at {rates:?}", wanted.rate_hz)));
    }
    Ok((module, serial))
}

/// Sets the clock and opens the recorder.
fn open(rest: &Rest, may_end: bool) -> Result<(), SourceError> {
    let now_ms = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |t| t.as_millis());
    rest.put("module/time", &now_ms.to_string()).map_err(|e| rest.error(format!("module/time: {e}")))?;
    let body = json!({ "performTransducerDetection": false }).to_string();
    let refused = match rest.put("open", &body) {
        Ok(_) => return Ok(()),
        Err(e) => e,
    };
    if !matches!(refused, CallError::Status(403, _)) {
        return Err(rest.error(format!("open: {refused}")));
    }
    if may_end {
        tracing::info!(instrument = rest.address, "ending what runs on it");
        for path in ["measurements/stop", "finish", "close"] {
            // Which of these are allowed depends on what runs; the next `open` shows whether they
            // were enough.
            let _ = rest.put(path, "");
        }
        return rest.put("open", &body).map(drop).map_err(|e| rest.error(format!("open: {e}")));
    }
    let state = rest.on_change(0, CONNECT).ok();
    let state = state.as_ref().and_then(|s| s["moduleState"].as_str()).unwrap_or("not told");
    Err(rest.error(format!(
        "open: {refused}; its state is {state}: somebody else uses it, or an earlier run was killed (take_over = true \
         ends what runs there)"
    )))
}

/// What the transducers say of themselves, by input.
fn detect(rest: &Rest) -> Result<Vec<Value>, SourceError> {
    let failed = |e| rest.error(format!("detection of transducers: {e}"));
    rest.post("channels/input/all/transducers/detect").map_err(failed)?;
    rest.wait_for("detected", |state| state["transducerDetectionActive"] == false).map_err(failed)?;
    match rest.get("channels/input/all/transducers").map_err(failed)? {
        Value::Array(all) => Ok(all),
        other => Err(rest.error(format!("detection of transducers: expected a list, found {other}"))),
    }
}

fn at<'a>(transducers: &'a [Value], input: &Input) -> &'a Value {
    transducers.get(usize::from(input.input).wrapping_sub(1)).unwrap_or(&Value::Null)
}

fn transducer_name(transducer: &Value) -> Option<String> {
    let number = transducer["type"]["number"].as_str()?;
    Some(format!("{number} no. {}", transducer["serialNumber"]))
}

/// Why the instrument cannot be set up as configured.
#[derive(Debug, thiserror::Error)]
enum SetupError {
    #[error("channels/input/default: expected channels, found {0}")]
    NoChannels(Value),
    #[error("it has no input {wanted}; it has {inputs}")]
    NoInput { wanted: u16, inputs: usize },
}

/// Turns the default setup into the wanted one; what is known of each wanted signal, in order.
fn fill(setup: &mut Value, wanted: &Wanted<'_>, transducers: &[Value]) -> Result<Vec<Expected>, SetupError> {
    let bandwidth_hz = wanted.rate_hz / RATE_PER_BANDWIDTH;
    let bandwidth =
        if bandwidth_hz >= 1000.0 { format!("{} kHz", bandwidth_hz / 1000.0) } else { format!("{bandwidth_hz} Hz") };
    let Some(channels) = setup["channels"].as_array_mut() else {
        return Err(SetupError::NoChannels(setup.clone()));
    };
    let mut expected = vec![None; wanted.inputs.len()];
    for channel in channels.iter_mut() {
        // Bandwidth and destination must be the same on all, used or not.
        channel["bandwidth"] = json!(bandwidth);
        channel["destinations"] = json!(["socket"]);
        let place = wanted.inputs.iter().position(|input| channel["channel"] == input.input);
        channel["enabled"] = json!(place.is_some());
        if let Some((input, expected)) = place.and_then(|i| Some((wanted.inputs.get(i)?, expected.get_mut(i)?))) {
            *expected = Some(fill_input(channel, input, at(transducers, input)));
        }
    }
    let missing = wanted.inputs.iter().zip(&expected).find(|(_, found)| found.is_none());
    if let Some((input, _)) = missing {
        return Err(SetupError::NoInput { wanted: input.input, inputs: channels.len() });
    }
    Ok(expected.into_iter().flatten().collect())
}

fn fill_input(channel: &mut Value, input: &Input, transducer: &Value) -> Expected {
    channel["name"] = json!(input.sensor);
    if transducer.is_object() {
        channel["transducer"] = transducer.clone();
        // What it needs is a guess of the instrument, which the configuration may correct below.
        channel["ccld"] = transducer["requiresCcld"].clone();
        channel["polvolt"] = transducer["requires200V"].clone();
    }
    if let (Some(sensitivity), Some(unit)) = (input.sensitivity_v_per_unit, &input.unit) {
        if !channel["transducer"].is_object() {
            let kind = json!({ "model": "", "number": "None", "prefix": "", "variant": "" });
            channel["transducer"] =
                json!({ "requires200V": false, "requiresCcld": false, "serialNumber": 0, "type": kind });
        }
        channel["transducer"]["sensitivity"] = json!(sensitivity);
        channel["transducer"]["unit"] = json!(unit);
    }
    for (key, value) in [("range", &input.range), ("filter", &input.filter)] {
        if let Some(value) = value {
            channel[key] = json!(value);
        }
    }
    if let Some(ccld) = input.ccld {
        channel["ccld"] = json!(ccld);
    }
    let range = channel["range"].as_str().and_then(|text| text.split_whitespace().next()?.parse::<f64>().ok());
    let sensitivity = channel["transducer"]["sensitivity"].as_f64().filter(|s| *s != 0.0);
    let scale = range.zip(sensitivity).map(|(range, s)| range * 10_f64.powf(HEADROOM_DB / 20.0) / s);
    Expected { scale }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn input(number: u16) -> Input {
        let sensor = format!("acc_{number}");
        Input { input: number, sensor, sensitivity_v_per_unit: None, unit: None, ccld: None, range: None, filter: None }
    }

    /// The tutorial's example: 10 V range and 10 mV/Pa make a full scale of 1188.5 Pa. Here with an
    /// accelerometer of 10 mV per m/s².
    #[test]
    fn literature_full_scale_from_range_headroom_and_sensitivity() {
        let mut channel = json!({ "channel": 1, "range": "10 Vpeak" });
        let given = Input { sensitivity_v_per_unit: Some(0.01), unit: Some("m/s^2".into()), ..input(1) };
        let scale = fill_input(&mut channel, &given, &Value::Null).scale.unwrap();
        assert!((scale - 1188.5).abs() < 0.05, "{scale}");
        assert_eq!(channel["transducer"]["unit"], "m/s^2");
    }

    #[test]
    fn conform_unwanted_inputs_are_off_and_all_have_one_bandwidth() {
        let channel =
            |number| json!({ "channel": number, "enabled": true, "bandwidth": "51.2 kHz", "range": "10 Vpeak" });
        let mut setup = json!({ "channels": [channel(1), channel(2), channel(3)] });
        let inputs = [input(1), input(3)];
        let wanted = Wanted { inputs: &inputs, rate_hz: 16_384.0, detect: false, before: None, serial: None };
        assert_eq!(fill(&mut setup, &wanted, &[]).unwrap().len(), 2);
        let of = |key: &str| setup["channels"].as_array().unwrap().iter().map(|c| c[key].clone()).collect::<Vec<_>>();
        assert_eq!(of("enabled"), [true, false, true].map(Value::from));
        assert!(of("bandwidth").iter().all(|b| b == "6.4 kHz"));
        assert!(of("destinations").iter().all(|d| *d == json!(["socket"])));
        let inputs = [input(4)];
        let missing = fill(&mut setup, &Wanted { inputs: &inputs, ..wanted }, &[]).unwrap_err();
        assert_eq!(missing.to_string(), "it has no input 4; it has 3");
    }
}
