//! MCAP, gearwatch's own recordings and foreign ones.

use std::collections::{BTreeMap, BTreeSet};

use gearwatch_core::block::{Packet, Samples};
use gearwatch_core::source::Source;

use crate::mcap::McapSource;
use crate::mcap::fields::MAGIC;
use crate::mcap::source::Contents;
use crate::mcap::walk::Limits;
use crate::open::{Bytes, Input, OpenOptions, Reader};
use crate::problem::Problem;
use crate::units;

use super::Format;

/// See the module.
pub(super) struct Mcap;

impl Format for Mcap {
    fn name(&self) -> &'static str {
        "MCAP"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["mcap"]
    }

    fn help(&self) -> &'static str {
        "recordings of gearwatch; topics with sensor_msgs/msg/Imu (ROS 2) or foxglove.RawAudio of other programs"
    }

    fn sniff(&self, head: &[u8]) -> bool {
        head.starts_with(&MAGIC)
    }

    fn open(&self, input: Input, options: &OpenOptions) -> Result<Box<dyn Reader>, Problem> {
        let source = McapSource::new(input.bytes, Limits::default()).with_sample_rate(options.sample_rate_hz);
        Ok(Box::new(Chosen {
            source,
            options: options.clone(),
            seen: BTreeSet::new(),
            changed: BTreeSet::new(),
            other_rate: BTreeMap::new(),
        }))
    }
}

/// A recording with sensors chosen, renamed, or given another unit or scale.
struct Chosen {
    source: McapSource<Bytes>,
    options: OpenOptions,
    /// Names in the file.
    seen: BTreeSet<String>,
    /// Sensors whose stated unit gave way to that of the options.
    changed: BTreeSet<String>,
    /// Sensors whose stated rate did, with that rate (Hz).
    other_rate: BTreeMap<String, f64>,
}

impl Source for Chosen {
    type Error = Problem;

    fn next_packet(&mut self) -> Result<Option<Packet>, Problem> {
        loop {
            let Some(mut packet) = self.source.next_packet()? else { return self.end() };
            if self.apply(&mut packet) {
                return Ok(Some(packet));
            }
        }
    }
}

impl Chosen {
    /// False for a sensor that was not chosen.
    fn apply(&mut self, packet: &mut Packet) -> bool {
        let Packet::Vibration(block) = packet else { return true };
        if !self.seen.contains(&*block.sensor) {
            self.seen.insert(block.sensor.to_string());
        }
        let wanted = self.options.channels.iter().find(|c| *c.column == *block.sensor);
        if wanted.is_none() && !self.options.channels.is_empty() {
            return false;
        }
        if let Some(rate) = self.options.sample_rate_hz.filter(|rate| *rate != block.sample_rate_hz) {
            self.other_rate.insert(block.sensor.to_string(), block.sample_rate_hz);
            block.sample_rate_hz = rate;
        }
        let unit = wanted.and_then(|w| w.unit.as_ref()).or(self.options.unit.as_ref());
        let mut scale = wanted.and_then(|w| w.scale).or(self.options.scale).unwrap_or(1.0);
        if let Some(unit) = unit {
            let (unit, factor) = units::canonical(unit).unwrap_or((unit, 1.0));
            scale *= factor;
            if *unit != *block.unit {
                if !self.changed.contains(&*block.sensor) {
                    self.changed.insert(block.sensor.to_string());
                }
                block.unit = unit.into();
            }
        }
        if let Some(name) = wanted.and_then(|w| w.name.as_ref()) {
            block.sensor = name.as_str().into();
        }
        if scale != 1.0 {
            match &mut block.samples {
                Samples::Counts { scale: s, offset, .. } => {
                    *s *= scale;
                    *offset *= scale;
                }
                Samples::Physical(values) => values.iter_mut().for_each(|v| *v = (f64::from(*v) * scale) as f32),
            }
        }
        true
    }

    fn end(&self) -> Result<Option<Packet>, Problem> {
        match self.options.channels.iter().find(|wanted| !self.seen.contains(&wanted.column)) {
            Some(wanted) => Err(Problem::option(
                format_args!("--channel {:?}", wanted.column),
                format_args!("no such channel; the file holds {:?}", self.seen),
            )),
            None => Ok(None),
        }
    }
}

impl Reader for Chosen {
    fn warnings(&self) -> Vec<String> {
        let mut warnings = self.source.warnings();
        for sensor in &self.changed {
            warnings.push(format!("{sensor}: the unit of the options stands in place of that in the file"));
        }
        for (sensor, rate) in &self.other_rate {
            warnings
                .push(format!("{sensor}: the sample rate of the options stands in place of the {rate} Hz in the file"));
        }
        warnings
    }

    fn contents(&self) -> Option<Contents> {
        Some(self.source.contents())
    }
}
