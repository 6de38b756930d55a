//! `sensor_msgs/msg/Imu`, alone or inside another ROS 2 message: its linear acceleration as three
//! sensors in m/s².
//!
//! There is one sample a message, with a time stamp that jitters. The sample rate is estimated from
//! the stamps; stamps that are missing make a gap.

use std::collections::VecDeque;

use gearwatch_core::block::{Packet, UnixNanos};

use super::ros2::Picker;
use crate::blocks::RowBlocks;
use crate::columns::{Sensor, clean};
use crate::mcap::definitions::Channel;
use crate::problem::Problem;
use crate::timing::{self, ESTIMATE_FROM, Grid, LOOK_AHEAD};

/// Reads the messages of one topic.
pub struct Imu {
    picker: Picker,
    topic: String,
    sample_rate_hz: Option<f64>,
    ahead: VecDeque<(UnixNanos, [f64; 3])>,
    first: UnixNanos,
    state: Option<(Grid, RowBlocks)>,
}

impl Imu {
    /// A reader for a channel that holds an Imu; `None` for other channels. Without a given sample
    /// rate it is estimated.
    ///
    /// # Errors
    /// When the definition of its message cannot be understood.
    pub fn for_channel(channel: &Channel, sample_rate_hz: Option<f64>) -> Result<Option<Self>, Problem> {
        let Some(schema) = channel.schema.as_ref().filter(|s| s.encoding == "ros2msg") else { return Ok(None) };
        if channel.encoding != "cdr" {
            return Ok(None);
        }
        let definition = String::from_utf8_lossy(&schema.data);
        // Definitions that have nothing to do with it need not be understood.
        if !schema.name.ends_with("/Imu")
            && !definition.contains("sensor_msgs/Imu")
            && !definition.contains("sensor_msgs/msg/Imu")
        {
            return Ok(None);
        }
        let wanted = [
            "header.stamp.sec",
            "header.stamp.nanosec",
            "linear_acceleration.x",
            "linear_acceleration.y",
            "linear_acceleration.z",
        ];
        let picker = Picker::compile(&schema.name, &definition, "sensor_msgs/Imu", &wanted)?;
        Ok(picker.map(|picker| Self {
            picker,
            topic: channel.topic.clone(),
            sample_rate_hz,
            ahead: VecDeque::new(),
            first: 0,
            state: None,
        }))
    }

    /// Takes one message; packets come out of [`Imu::pop`] some messages later.
    ///
    /// # Errors
    /// When the message is damaged or its stamp goes back.
    pub fn push(&mut self, data: &[u8], log_time: u64, offset: u64) -> Result<(), Problem> {
        let place = || format!("topic {}, message at byte {offset}", self.topic);
        let values = self.picker.pick(data).map_err(|e| Problem::damaged(place(), e, "less or other data"))?;
        let [sec, nanosec, x, y, z] = values[..] else { return Ok(()) };
        let stamp = if sec == 0.0 && nanosec == 0.0 {
            i64::try_from(log_time).unwrap_or(i64::MAX)
        } else {
            // Both came from 32-bit integers.
            (sec as i64) * 1_000_000_000 + nanosec as i64
        };
        self.ahead.push_back((stamp, [x, y, z]));
        if self.state.is_none() && self.ahead.len() < ESTIMATE_FROM {
            return Ok(());
        }
        self.begin()?;
        self.advance(LOOK_AHEAD)
    }

    /// Works off everything that was held back, at the end of the file.
    ///
    /// # Errors
    /// When there are too few messages for a sample rate.
    pub fn finish(&mut self) -> Result<(), Problem> {
        if self.ahead.is_empty() {
            return Ok(());
        }
        self.begin()?;
        self.advance(0)?;
        if let Some((_, blocks)) = &mut self.state {
            blocks.flush();
        }
        Ok(())
    }

    /// The next packet that is ready.
    pub fn pop(&mut self) -> Option<Packet> {
        self.state.as_mut().and_then(|(_, blocks)| blocks.pop())
    }

    /// A sentence on the sample rate, once it is known.
    pub fn note(&self) -> Option<String> {
        let (_, blocks) = self.state.as_ref()?;
        let rate = blocks.sensors().first()?.sample_rate_hz;
        let how =
            if self.sample_rate_hz.is_some() { "given" } else { "estimated from the time stamps of its messages" };
        Some(format!("{}: one sample a message; the sample rate of {rate:.4} Hz is {how}", self.topic))
    }

    fn begin(&mut self) -> Result<(), Problem> {
        if self.state.is_some() {
            return Ok(());
        }
        self.first = self.ahead.front().map_or(0, |row| row.0);
        let period = match self.sample_rate_hz {
            Some(rate) => 1.0 / rate,
            None => {
                let stamps: Vec<f64> = self.ahead.iter().map(|row| self.seconds(row.0)).collect();
                timing::period_s(&stamps).map_err(|e| {
                    Problem::missing(format_args!("the sample rate of {} ({e} needed)", self.topic), "--sample-rate")
                })?
            }
        };
        let sensors = ["x", "y", "z"].iter().enumerate().map(|(column, axis)| Sensor {
            column,
            name: format!("{}_{axis}", clean(&self.topic)).into(),
            unit: "m/s^2".into(),
            scale: 1.0,
            sample_rate_hz: 1.0 / period,
            t0: self.first,
        });
        self.state = Some((Grid::new(period), RowBlocks::new(sensors.collect())));
        Ok(())
    }

    /// Works off rows until only `keep` are held back.
    fn advance(&mut self, keep: usize) -> Result<(), Problem> {
        while self.ahead.len() > keep {
            let mut upcoming = [0.0; LOOK_AHEAD];
            let mut n = 0;
            for (slot, row) in upcoming.iter_mut().zip(&self.ahead) {
                *slot = self.seconds(row.0);
                n += 1;
            }
            let (Some((stamp, row)), Some((grid, blocks))) = (self.ahead.pop_front(), &mut self.state) else {
                return Ok(());
            };
            let missing = grid
                .missing_before(&upcoming[..n])
                .map_err(|e| Problem::damaged(format_args!("topic {}", self.topic), e, "a jump back"))?;
            blocks.push(stamp, row, missing);
        }
        Ok(())
    }

    fn seconds(&self, stamp: UnixNanos) -> f64 {
        stamp.saturating_sub(self.first) as f64 / 1e9
    }
}
