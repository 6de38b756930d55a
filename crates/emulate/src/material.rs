//! What is played: packets of any source of the service, again and again, at their own pace.

use std::collections::VecDeque;
use std::sync::Arc;

use gearwatch_core::block::{Block, Packet};

use gearwatch_runtime::kinds;
use gearwatch_runtime::stop::Stop;
use gearwatch_sources::{Feed, KINDS, Pacer, Pull, SourceConfig, SourceContext, SourceError, Speed};

/// Packets that are looked at for the list of channels.
const PEEKED: usize = 4096;

/// Opens the material from its beginning.
pub type Open = Arc<dyn Fn() -> Result<Pull, SourceError> + Send + Sync>;

/// A channel of the material.
#[derive(Clone, Debug, PartialEq)]
pub struct Channel {
    /// Sensor name.
    pub sensor: String,
    /// Unit of its samples.
    pub unit: String,
}

/// Material that is played.
pub struct Material {
    open: Open,
    pull: Pull,
    pacer: Pacer,
    speed: Speed,
    stop: Stop,
    ahead: VecDeque<Packet>,
    channels: Vec<Channel>,
    rate_hz: f64,
}

/// A source of the service as material: its kind and its keys.
///
/// # Errors
/// When there is no such kind, a key is wrong, or the source cannot be pulled.
pub fn open_source(kind: &str, keys: toml::Table, context: SourceContext) -> Result<Open, SourceError> {
    let (config, _) = kinds::find(KINDS, kind, "source")
        .and_then(|kind| kind.read(keys))
        .map_err(|e| SourceError::Bench(e.to_string()))?;
    if let Some(problem) = config.problems().into_iter().next() {
        return Err(SourceError::Bench(format!("{kind}: {problem}")));
    }
    let config: Arc<dyn SourceConfig> = Arc::from(config);
    let kind = kind.to_owned();
    Ok(Arc::new(move || match config.open(&context)? {
        Feed::Pull(pull) => Ok(pull),
        Feed::Push(_) => Err(SourceError::Bench(format!("a source of kind {kind:?} cannot be played"))),
    }))
}

impl Material {
    /// At its beginning.
    ///
    /// # Errors
    /// When it cannot be opened, holds no samples, or channels of several sample rates.
    pub fn new(open: Open, speed: Speed, stop: Stop) -> Result<Self, SourceError> {
        let pull = open()?;
        let pacer = Pacer::new(speed, stop.clone());
        let ahead = VecDeque::new();
        let mut out = Self { open, pull, pacer, speed, stop, ahead, channels: Vec::new(), rate_hz: f64::NAN };
        out.peek()?;
        Ok(out)
    }

    /// The channels, in the order of their first block.
    pub fn channels(&self) -> &[Channel] {
        &self.channels
    }

    /// Samples per second of all channels.
    pub fn rate_hz(&self) -> f64 {
        self.rate_hz
    }

    /// Looks ahead until a channel comes for the second time.
    fn peek(&mut self) -> Result<(), SourceError> {
        while self.ahead.len() < PEEKED {
            let Some(packet) = (self.pull)()? else { break };
            let again = match &packet {
                Packet::Vibration(block) => self.list(block)?,
                Packet::Tacho(_) | Packet::OperatingPoint(_) => false,
            };
            self.ahead.push_back(packet);
            if again {
                break;
            }
        }
        if self.channels.is_empty() {
            return Err(SourceError::Bench("there are no samples to play".to_owned()));
        }
        Ok(())
    }

    /// Lists a channel; `true` if it was listed already.
    fn list(&mut self, block: &Block) -> Result<bool, SourceError> {
        if self.channels.iter().any(|channel| channel.sensor == *block.sensor) {
            return Ok(true);
        }
        if self.channels.is_empty() {
            self.rate_hz = block.sample_rate_hz;
        } else if self.rate_hz != block.sample_rate_hz {
            return Err(SourceError::Bench(format!(
                "{} has {} samples per second, {} has {}; all must have the same to be played",
                self.channels[0].sensor, self.rate_hz, block.sensor, block.sample_rate_hz
            )));
        }
        self.channels.push(Channel { sensor: block.sensor.to_string(), unit: block.unit.to_string() });
        Ok(false)
    }

    /// The next packet when it is due; from the beginning again after the last one. `None` when
    /// asked to stop.
    ///
    /// # Errors
    /// When the material cannot be read on.
    pub fn next_packet(&mut self) -> Result<Option<Packet>, SourceError> {
        let mut reopened = false;
        loop {
            let packet = match self.ahead.pop_front() {
                Some(packet) => Some(packet),
                None => (self.pull)()?,
            };
            if let Some(packet) = packet {
                return Ok(self.pacer.wait_for(&packet).then_some(packet));
            }
            if std::mem::replace(&mut reopened, true) {
                return Err(SourceError::Bench("there are no samples to play".to_owned()));
            }
            self.pull = (self.open)()?;
            self.pacer = Pacer::new(self.speed, self.stop.clone());
        }
    }
}
