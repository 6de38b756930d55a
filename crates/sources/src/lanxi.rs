//! LAN-XI front ends over their Open API: set up by HTTP, then read from a TCP stream.
//!
//! ```text
//! rest.rs     the calls, one by one, with their time limits
//! setup.rs    from module/info to the running measurement, and back to idle in the right order
//! watch.rs    overload and cable faults, which the stream does not tell, by long polling on a thread of its own
//! stream.rs   messages to packets: scale, quality, gaps
//! ```
//!
//! The thread of the source owns the stream's socket. Whatever ends it (an error, a stop, a reload)
//! takes the instrument back to idle.

use std::collections::VecDeque;
use std::io::Read;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use gearwatch_core::block::Packet;
use gearwatch_io::lanxi::Decoder;
use gearwatch_runtime::kinds::Kind;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::inputs::{self, ConfiguredInput, Scalings};
use crate::numbering::Numbering;
use crate::socket::{self, POLL, READ_BYTES, is_timeout};
use crate::{Feed, SourceConfig, SourceContext, SourceError, kind};

mod rest;
mod setup;
mod stream;
mod watch;

use setup::Measurement;
use stream::Reader;
use watch::Watch;

pub(crate) const KIND: Kind<dyn SourceConfig> = kind::<Lanxi>(
    "lanxi",
    "a LAN-XI front end by its Open API (try it with `gearwatch emulate lanxi`)",
    r#"
address = "192.168.1.101"           # or host:port
channels = [
  { input = 1, sensor = "acc_1" },  # sensitivity and unit from the transducer itself (TEDS)
  { input = 2, sensor = "acc_2", sensitivity_v_per_unit = 0.01, unit = "m/s^2", ccld = true },
]
take_over = true                    # ends whatever runs there, as after a crash of this service
"#,
);

/// Keys of a LAN-XI source.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Lanxi {
    /// Host, or host:port, of the instrument's web server.
    address: String,
    /// The inputs that are read; all others are switched off.
    channels: Vec<Input>,
    /// Samples per second of every channel (Hz): 2.56 × bandwidth, as 16384 for 6.4 kHz. That of
    /// the bench file where left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    sample_rate_hz: Option<f64>,
    /// Serial number that the instrument must have. Where left out, the first one that answers is
    /// the one that is expected from then on.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    serial: Option<u64>,
    /// A measurement that runs on the instrument already, of whomever, is ended. Otherwise the
    /// source waits for its end.
    #[serde(default)]
    take_over: bool,
    /// Asks the transducers for sensitivity, unit and supply (TEDS) at each opening.
    #[serde(default = "yes")]
    detect_transducers: bool,
    #[serde(skip)]
    memory: Arc<Mutex<Memory>>,
}

fn yes() -> bool {
    true
}

/// One input of the instrument. What it leaves out comes from the transducer, or is as the
/// instrument has it by default.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Input {
    /// Its number on the instrument, from 1.
    input: u16,
    /// Name of the sensor in the bench file.
    sensor: String,
    /// Sensitivity of the transducer (V per unit, not 0); goes with `unit`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    sensitivity_v_per_unit: Option<f64>,
    /// Unit of the physical values: `m/s^2`, `g`, `mm/s`, `V` or `1`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    unit: Option<String>,
    /// Constant-current supply of the transducer.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    ccld: Option<bool>,
    /// As the instrument names it, such as `10 Vpeak`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    range: Option<String>,
    /// High-pass filter as the instrument names it, such as `7.0 Hz`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    filter: Option<String>,
}

/// What outlives a connection: who the instrument is, and how far its samples are numbered.
#[derive(Debug, Default)]
struct Memory {
    identity: Option<Identity>,
    numberings: Vec<Numbering>,
    /// The last measurement was this source's own and could not be ended: it may be ended the next
    /// time.
    left_open: bool,
}

/// What must be the same each time.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Identity {
    module: String,
    serial: u64,
    /// Type and serial number of each input's transducer, where it says so.
    transducers: Vec<Option<String>>,
}

impl Identity {
    /// What is another than at the first time.
    fn change(&self, now: &Self, inputs: &[Input]) -> Option<String> {
        if (&self.module, self.serial) != (&now.module, now.serial) {
            return Some(format!(
                "the instrument is {} no. {}; the one before was {} no. {}",
                now.module, now.serial, self.module, self.serial
            ));
        }
        let changed = self.transducers.iter().zip(&now.transducers).zip(inputs).find(|((old, new), _)| old != new);
        changed.map(|((old, new), input)| {
            let name = |t: &Option<String>| t.clone().unwrap_or_else(|| "none that says what it is".to_owned());
            format!("the transducer at input {} is {}; the one before was {}", input.input, name(new), name(old))
        })
    }
}

/// Inputs of the largest instrument frame.
const MOST_INPUTS: u16 = 132;

impl SourceConfig for Lanxi {
    fn problems(&self) -> Vec<String> {
        let mut out = Vec::new();
        if self.address.is_empty() || self.address.contains(['/', ' ']) {
            out.push(format!("address is {:?}; expected a host or host:port", self.address));
        }
        if let Some(rate) = self.sample_rate_hz
            && !(rate.is_finite() && rate > 0.0)
        {
            out.push(format!("sample_rate_hz is {rate}; expected a number above 0"));
        }
        let inputs = self.channels.iter().map(|channel| ConfiguredInput {
            name: format!("input {}", channel.input),
            sensor: &channel.sensor,
            scaling: channel.sensitivity_v_per_unit,
            unit: channel.unit.as_deref(),
        });
        out.extend(inputs::number_problems(self.channels.iter().map(|channel| channel.input), MOST_INPUTS));
        out.extend(inputs::problems(inputs, "sensitivity_v_per_unit", Scalings::NotZero));
        out
    }

    fn is_live(&self) -> bool {
        true
    }

    fn open(&self, context: &SourceContext) -> Result<Feed, SourceError> {
        let mut inputs = self.channels.clone();
        // Signals are numbered in the order of the inputs.
        inputs.sort_by_key(|input| input.input);
        let rate_hz = self.sample_rate_hz.unwrap_or(context.bench.acquisition.sample_rate_hz);
        let mut memory = self.memory.lock().unwrap_or_else(PoisonError::into_inner);
        let own = std::mem::take(&mut memory.left_open);
        memory.numberings.resize_with(inputs.len(), Numbering::default);
        memory.numberings.iter_mut().for_each(Numbering::break_here);
        let numberings = memory.numberings.clone();
        let before = memory.identity.clone();
        drop(memory);
        let wanted =
            setup::Wanted { inputs: &inputs, rate_hz, detect: self.detect_transducers, before, serial: self.serial };
        let rest = rest::Rest::new(&self.address, context.stop.clone());
        let measurement = Measurement::start(rest, &wanted, self.take_over || own, &self.memory)?;
        let identity = measurement.identity.clone();
        self.memory.lock().unwrap_or_else(PoisonError::into_inner).identity = Some(identity);
        let watch = Watch::start(measurement.rest.clone(), inputs.iter().map(|input| input.input).collect())?;
        let reader = Reader::new(&self.address, &inputs, &measurement.expected, rate_hz, numberings);
        let mut session = Session {
            reader,
            decoder: Decoder::default(),
            watch,
            buffer: vec![0; READ_BYTES],
            deadline: context.data_deadline,
            memory: self.memory.clone(),
            address: self.address.clone(),
            measurement,
        };
        session.measurement.read_timeout(POLL.min(context.data_deadline / 4))?;
        Ok(socket::feed(context.stop.clone(), move |ready| session.read(ready)))
    }
}

/// One measurement that runs. The fields are dropped in this order: the thread that watches ends
/// before the measurement.
struct Session {
    watch: Watch,
    reader: Reader,
    decoder: Decoder,
    buffer: Vec<u8>,
    deadline: Duration,
    memory: Arc<Mutex<Memory>>,
    address: String,
    measurement: Measurement,
}

impl Session {
    fn read(&mut self, ready: &mut VecDeque<Packet>) -> Result<(), SourceError> {
        if let Some(ended) = self.watch.ended() {
            return Err(self.error(ended));
        }
        match self.measurement.stream().read(&mut self.buffer) {
            Ok(0) => return Err(self.error("the instrument closed the stream".to_owned())),
            Ok(n) => self.take(n, ready)?,
            Err(e) if is_timeout(&e) => {}
            Err(e) => return Err(self.error(format!("the stream failed: {e}"))),
        }
        self.reader.silent(Instant::now(), self.deadline).map_or(Ok(()), |silent| Err(self.error(silent)))
    }

    fn take(&mut self, n: usize, ready: &mut VecDeque<Packet>) -> Result<(), SourceError> {
        let Self { decoder, reader, watch, buffer, .. } = self;
        let mut result = Ok(());
        let status = watch.status();
        decoder.push(buffer.get(..n).unwrap_or_default(), &mut |decoded| {
            if result.is_ok() {
                result = reader.take(decoded, &status, ready);
            }
        });
        result.map_err(|e| self.error(e.to_string()))
    }

    fn error(&self, message: String) -> SourceError {
        SourceError::Peer { peer: self.address.clone(), message }
    }
}

impl Drop for Session {
    fn drop(&mut self) {
        self.watch.end();
        let mut memory = self.memory.lock().unwrap_or_else(PoisonError::into_inner);
        memory.numberings = self.reader.numberings();
    }
}
