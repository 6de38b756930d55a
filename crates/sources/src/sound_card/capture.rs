//! The device itself. Its callback only copies; everything else happens on the source's thread.

use std::collections::{BTreeSet, VecDeque};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use cpal::traits::{DeviceTrait, HostTrait, StreamTrait};
use cpal::{BufferSize, Data, Device, ErrorKind, SampleFormat, StreamConfig, SupportedStreamConfigRange};
use gearwatch_core::block::{Block, Packet, Quality, Samples};
use gearwatch_runtime::stop::Stop;

use super::calibration::{self, Calibration};
use super::{Feed, SoundCard, SourceContext, SourceError};
use crate::numbering::{Device as Known, DeviceError};
use gearwatch_runtime::clock::now_unix_ns;

/// Buffers that may wait for the source's thread; a buffer is some milliseconds.
const WAITING: usize = 256;
/// How often a thread that gets nothing looks whether it should stop.
const POLL: Duration = Duration::from_millis(50);

/// One buffer of the device, values from −1 to 1 of all inputs in turn.
struct Buffer {
    values: Vec<f32>,
    /// Wall time of its end (ns since 1970).
    end_ns: i64,
}

/// Why a device cannot be used.
#[derive(Debug, thiserror::Error)]
enum CardError {
    #[error(transparent)]
    Device(#[from] cpal::Error),
    #[error(transparent)]
    Another(#[from] DeviceError),
    #[error("there is no such device; there are {0:?}")]
    NoDevice(Vec<String>),
    #[error("input {0} has no calibration in the device's name; give full_scale and unit")]
    Uncalibrated(u16),
    #[error("it has no {inputs} inputs at {rate} Hz; it offers (inputs, lowest, highest Hz) {offers:?}")]
    NoForm { inputs: usize, rate: u32, offers: BTreeSet<(u16, u32, u32)> },
}

/// What the callbacks tell.
struct Shared {
    /// Samples were lost since the last buffer.
    lost: AtomicBool,
    ended: Mutex<Option<String>>,
}

struct Channel {
    /// Its place among the inputs of the device.
    at: usize,
    sensor: Arc<str>,
    unit: Arc<str>,
    full_scale: f64,
}

pub(super) fn open(config: &SoundCard, context: &SourceContext) -> Result<Feed, SourceError> {
    let error = |e: CardError| SourceError::Peer { peer: config.device.clone(), message: e.to_string() };
    let (device, name) = find(&config.device).map_err(error)?;
    // Serial number and calibration are in the name.
    Known::meet(&config.known, &name).map_err(|e| error(e.into()))?;
    let calibration = calibration::read(&name);
    if let Some(Calibration { model, serial, date, .. }) = &calibration {
        tracing::info!("{model} no. {serial}, calibrated {date} (yymmdd)");
    }
    let channels = channels(config, calibration.as_ref()).map_err(error)?;
    let range = supported(&device, config, &channels).map_err(error)?;
    let inputs = usize::from(range.channels());
    let stream_config = StreamConfig {
        channels: range.channels(),
        // Checked: a whole number of at most 1e7.
        sample_rate: config.sample_rate_hz as u32,
        buffer_size: BufferSize::Default,
    };
    let (out, buffers) = sync_channel(WAITING);
    let shared = Arc::new(Shared { lost: AtomicBool::new(false), ended: Mutex::new(None) });
    let (taken, told) = (shared.clone(), shared.clone());
    let stream = device
        .build_input_stream_raw(
            stream_config,
            range.sample_format(),
            move |data: &Data, _: &_| take(data, &out, &taken),
            move |e| match e.kind() {
                // Recovered by itself; how much is missing only the clock says.
                ErrorKind::Xrun => told.lost.store(true, Ordering::Release),
                ErrorKind::RealtimeDenied => tracing::debug!("{e}"),
                _ => *told.ended.lock().unwrap_or_else(PoisonError::into_inner) = Some(e.to_string()),
            },
            Some(context.data_deadline),
        )
        .map_err(|e| error(e.into()))?;
    stream.play().map_err(|e| error(e.into()))?;
    let mut capture = Capture {
        _stream: stream,
        shared,
        buffers,
        channels,
        inputs,
        rate_hz: config.sample_rate_hz,
        known: config.known.clone(),
        opened: true,
        heard: Instant::now(),
        deadline: context.data_deadline,
        stop: context.stop.clone(),
        ready: VecDeque::new(),
        device: config.device.clone(),
    };
    Ok(Feed::Pull(Box::new(move || capture.next_packet())))
}

/// The device whose name has this part; never another one.
fn find(part: &str) -> Result<(Device, String), CardError> {
    let devices = cpal::default_host().input_devices()?;
    let mut names = Vec::new();
    for device in devices {
        let Ok(description) = device.description() else { continue };
        let all: Vec<_> = std::iter::once(description.name()).chain(description.extended()).collect();
        let name = all.join(" ");
        if name.contains(part) {
            return Ok((device, name));
        }
        names.push(description.name().to_owned());
    }
    Err(CardError::NoDevice(names))
}

fn channels(config: &SoundCard, calibration: Option<&Calibration>) -> Result<Vec<Channel>, CardError> {
    let of = |input: &super::Input| {
        let at = usize::from(input.input) - 1;
        let given = input.full_scale.zip(input.unit.as_deref());
        let own = || calibration.and_then(|c| Some(((*c.full_scale.get(at)?)?, c.unit)));
        let (full_scale, unit) = given.or_else(own).ok_or(CardError::Uncalibrated(input.input))?;
        Ok(Channel { at, sensor: input.sensor.as_str().into(), unit: unit.into(), full_scale })
    };
    config.channels.iter().map(of).collect()
}

/// A form of the stream that the device has, with all inputs that are wanted and as many bits as
/// possible.
fn supported(
    device: &Device,
    config: &SoundCard,
    channels: &[Channel],
) -> Result<SupportedStreamConfigRange, CardError> {
    let rate = config.sample_rate_hz as u32;
    let inputs = channels.iter().map(|channel| channel.at + 1).max().unwrap_or(1);
    let bits = |format: SampleFormat| match format {
        SampleFormat::I32 => Some(4),
        SampleFormat::I24 => Some(3),
        SampleFormat::F32 => Some(2),
        SampleFormat::I16 => Some(1),
        _ => None,
    };
    let all: Vec<_> = device.supported_input_configs()?.collect();
    let fits = |range: &&SupportedStreamConfigRange| {
        usize::from(range.channels()) >= inputs
            && (range.min_sample_rate()..=range.max_sample_rate()).contains(&rate)
            && bits(range.sample_format()).is_some()
    };
    all.iter().filter(fits).max_by_key(|range| bits(range.sample_format())).copied().ok_or_else(|| {
        let offers = all.iter().map(|r| (r.channels(), r.min_sample_rate(), r.max_sample_rate())).collect();
        CardError::NoForm { inputs, rate, offers }
    })
}

/// Copies a buffer; called by the device, which must not wait.
fn take(data: &Data, out: &SyncSender<Buffer>, shared: &Shared) {
    let values: Vec<f32> = match data.sample_format() {
        SampleFormat::F32 => data.as_slice::<f32>().unwrap_or_default().to_vec(),
        SampleFormat::I16 => {
            data.as_slice::<i16>().unwrap_or_default().iter().map(|&v| f32::from(v) / 32_768.0).collect()
        }
        SampleFormat::I24 => {
            let all = data.as_slice::<cpal::I24>().unwrap_or_default().iter();
            all.map(|v| v.inner() as f32 / 8_388_608.0).collect()
        }
        SampleFormat::I32 => {
            let all = data.as_slice::<i32>().unwrap_or_default().iter();
            all.map(|&v| (f64::from(v) / 2_147_483_648.0) as f32).collect()
        }
        // No other was asked for.
        _ => Vec::new(),
    };
    if out.try_send(Buffer { values, end_ns: now_unix_ns() }).is_err() {
        shared.lost.store(true, Ordering::Release);
    }
}

struct Capture {
    _stream: cpal::Stream,
    shared: Arc<Shared>,
    buffers: Receiver<Buffer>,
    channels: Vec<Channel>,
    inputs: usize,
    rate_hz: f64,
    known: Arc<Mutex<Known>>,
    /// The next buffer is the first one.
    opened: bool,
    heard: Instant,
    deadline: Duration,
    stop: Stop,
    ready: VecDeque<Packet>,
    device: String,
}

impl Capture {
    fn next_packet(&mut self) -> Result<Option<Packet>, SourceError> {
        loop {
            if let Some(packet) = self.ready.pop_front() {
                return Ok(Some(packet));
            }
            if self.stop.is_given() {
                return Ok(None);
            }
            let error = |message| SourceError::Peer { peer: self.device.clone(), message };
            if let Some(ended) = self.shared.ended.lock().unwrap_or_else(PoisonError::into_inner).take() {
                return Err(error(ended));
            }
            match self.buffers.recv_timeout(POLL) {
                Ok(buffer) => self.take(&buffer),
                Err(RecvTimeoutError::Timeout) if self.heard.elapsed() <= self.deadline => {}
                Err(RecvTimeoutError::Timeout) => {
                    return Err(error(format!("no samples for {:.1} s", self.deadline.as_secs_f64())));
                }
                Err(RecvTimeoutError::Disconnected) => return Err(error("the device has ended".to_owned())),
            }
        }
    }

    fn take(&mut self, buffer: &Buffer) {
        let samples = buffer.values.len() / self.inputs;
        if samples == 0 {
            return;
        }
        self.heard = Instant::now();
        let lost = self.shared.lost.swap(false, Ordering::AcqRel) | std::mem::take(&mut self.opened);
        let (t0, first_sample_index, gap) = Known::number(&self.known, buffer.end_ns, samples, self.rate_hz, lost);
        for channel in &self.channels {
            let values = buffer.values.iter().skip(channel.at).step_by(self.inputs).take(samples);
            let clipped = values.clone().any(|v| v.abs() >= 1.0);
            self.ready.push_back(Packet::Vibration(Block {
                sensor: channel.sensor.clone(),
                t0,
                sample_rate_hz: self.rate_hz,
                first_sample_index,
                unit: channel.unit.clone(),
                samples: Samples::Physical(values.map(|v| (f64::from(*v) * channel.full_scale) as f32).collect()),
                quality: gap | if clipped { Quality::OVERLOAD } else { Quality::GOOD },
            }));
        }
    }
}
