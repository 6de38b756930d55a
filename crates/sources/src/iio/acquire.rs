//! Reads the device, buffer by buffer.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Instant;

use gearwatch_core::block::{Block, Packet, Quality, Samples};
use gearwatch_drivers::iio::{Acquisition, Wish};

use super::lateness::Lateness;
use super::{Feed, Iio, SourceContext, SourceError};
use crate::numbering::{Device, same_rate};
use gearwatch_runtime::clock::now_unix_ns;

/// A reading lasts so long (s).
const READING_SECS: f64 = 0.1;

struct Channel {
    sensor: Arc<str>,
    unit: Arc<str>,
    factor: f64,
    /// The ends of the converter, before the factor.
    range: (f64, f64),
}

pub(super) fn open(config: &Iio, context: &SourceContext) -> Result<Feed, SourceError> {
    let peer = format!("{} at {}", config.device, config.uri);
    let error = move |message: String| SourceError::Peer { peer: peer.clone(), message };
    let library = config.library.as_ref().map(|path| context.resolve(path));
    let names: Vec<&str> = config.channels.iter().map(|channel| channel.input.as_str()).collect();
    let wish = Wish {
        uri: &config.uri,
        device: &config.device,
        channels: &names,
        sample_rate_hz: config.sample_rate_hz,
        samples: (config.sample_rate_hz * READING_SECS).ceil().max(1.0) as usize,
        longest: context.data_deadline,
    };
    let mut device = Acquisition::start(library.as_deref(), wish).map_err(|e| error(e.to_string()))?;
    match device.rate_hz() {
        Some(rate_hz) => same_rate(config.sample_rate_hz, rate_hz).map_err(|e| error(e.to_string()))?,
        None => {
            tracing::warn!(device = config.device, "the device does not say its rate; that of the file is believed")
        }
    }
    let rate_hz = device.rate_hz().unwrap_or(config.sample_rate_hz);
    let shared = config.met.clone();
    Device::meet(&shared, &config.device).map_err(|e| error(e.to_string()))?;
    let channels: Vec<Channel> = config
        .channels
        .iter()
        .zip(device.ranges())
        .map(|(channel, range)| {
            let (unit, factor) = channel.scaling();
            Channel { sensor: channel.sensor.as_str().into(), unit: unit.into(), factor, range }
        })
        .collect();
    let mut values = vec![Vec::new(); channels.len()];
    let stop = context.stop.clone();
    let (mut lateness, started) = (Lateness::default(), Instant::now());
    let (mut lost, mut ready) = (true, VecDeque::new());
    Ok(Feed::Pull(Box::new(move || {
        loop {
            if let Some(packet) = ready.pop_front() {
                return Ok(Some(packet));
            }
            if stop.is_given() {
                return Ok(None);
            }
            device.read(&mut values).map_err(|e| error(e.to_string()))?;
            let samples = values.iter().map(Vec::len).min().unwrap_or(0);
            if samples == 0 {
                continue;
            }
            if let Some(missing) = lateness.missing(started.elapsed().as_secs_f64(), samples as f64 / rate_hz) {
                tracing::warn!("{missing:.2} s of samples were lost before they could be read");
                lost = true;
            }
            let (t0, first_sample_index, gap) =
                Device::number(&shared, now_unix_ns(), samples, rate_hz, std::mem::take(&mut lost));
            for (channel, values) in channels.iter().zip(&values) {
                let values = &values[..samples];
                let clipped = values.iter().any(|&v| v <= channel.range.0 || v >= channel.range.1);
                ready.push_back(Packet::Vibration(Block {
                    sensor: channel.sensor.clone(),
                    t0,
                    sample_rate_hz: rate_hz,
                    first_sample_index,
                    unit: channel.unit.clone(),
                    samples: Samples::Physical(values.iter().map(|v| (v * channel.factor) as f32).collect()),
                    quality: gap | if clipped { Quality::OVERLOAD } else { Quality::GOOD },
                }));
            }
        }
    })))
}
