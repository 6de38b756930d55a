//! Reads the device, buffer by buffer.

use std::collections::{BTreeSet, VecDeque};
use std::sync::Arc;
use std::time::{Duration, Instant};

use gearwatch_core::block::{Block, Packet, Quality, Samples};
use gearwatch_drivers::nidaqmx::Acquisition;

use super::{Feed, NiDaqmx, SourceContext, SourceError};
use crate::numbering::{Device, same_rate};
use gearwatch_runtime::clock::now_unix_ns;

/// A reading lasts so long (s).
const READING_SECS: f64 = 0.05;
/// How often a thread that gets nothing looks whether it should stop.
const POLL: Duration = Duration::from_millis(200);

struct Channel {
    sensor: Arc<str>,
    unit: Arc<str>,
    factor: f64,
}

pub(super) fn open(config: &NiDaqmx, context: &SourceContext) -> Result<Feed, SourceError> {
    let error = |message: String| SourceError::Peer { peer: "NI-DAQmx".to_owned(), message };
    let asked: Vec<_> = config.channels.iter().map(super::Input::asked).collect();
    let inputs: Vec<_> = asked.iter().map(|(input, _)| input.clone()).collect();
    let library = config.library.as_ref().map(|path| context.resolve(path));
    let mut device =
        Acquisition::start(library.as_deref(), &inputs, config.sample_rate_hz).map_err(|e| error(e.to_string()))?;
    same_rate(config.sample_rate_hz, device.rate_hz()).map_err(|e| error(e.to_string()))?;
    let names: BTreeSet<&str> = inputs.iter().filter_map(|input| input.physical.split('/').next()).collect();
    let serials: Vec<String> =
        names.iter().filter_map(|name| device.serial(name).map(|serial| format!("{name} no. {serial:X}"))).collect();
    let shared = config.device.clone();
    Device::meet(&shared, &serials.join(", ")).map_err(|e| error(e.to_string()))?;
    let channels: Vec<Channel> = config
        .channels
        .iter()
        .zip(&asked)
        .map(|(channel, (_, factor))| Channel {
            sensor: channel.sensor.as_str().into(),
            unit: channel.unit.as_deref().unwrap_or("V").into(),
            factor: *factor,
        })
        .collect();
    let rate_hz = device.rate_hz();
    let count = (rate_hz * READING_SECS).ceil().max(1.0) as usize;
    let mut values = vec![0.0; count * channels.len()];
    let (stop, deadline) = (context.stop.clone(), context.data_deadline);
    let (mut heard, mut opened, mut ready) = (Instant::now(), true, VecDeque::new());
    Ok(Feed::Pull(Box::new(move || {
        loop {
            if let Some(packet) = ready.pop_front() {
                return Ok(Some(packet));
            }
            if stop.is_given() {
                return Ok(None);
            }
            let samples = device.read(&mut values, POLL).map_err(|e| error(e.to_string()))?;
            if samples == 0 {
                if heard.elapsed() > deadline {
                    return Err(error(format!("no samples for {:.1} s", deadline.as_secs_f64())));
                }
                continue;
            }
            heard = Instant::now();
            let overloaded = device.overloaded();
            let (t0, first_sample_index, gap) =
                Device::number(&shared, now_unix_ns(), samples, rate_hz, std::mem::take(&mut opened));
            for (at, (channel, input)) in channels.iter().zip(&inputs).enumerate() {
                let overload = if overloaded.contains(&input.physical) { Quality::OVERLOAD } else { Quality::GOOD };
                let of_channel = values.iter().skip(at).step_by(channels.len()).take(samples);
                ready.push_back(Packet::Vibration(Block {
                    sensor: channel.sensor.clone(),
                    t0,
                    sample_rate_hz: rate_hz,
                    first_sample_index,
                    unit: channel.unit.clone(),
                    samples: Samples::Physical(of_channel.map(|v| (v * channel.factor) as f32).collect()),
                    quality: gap | overload,
                }));
            }
        }
    })))
}
