//! Recordings on the command line: files and what they leave unsaid, with a progress bar for long
//! ones.

use std::path::{Path, PathBuf};

use anyhow::Context;
use clap::Args;
use gearwatch_core::baseline::Baseline;
use gearwatch_core::bench::Bench;
use gearwatch_core::block::Packet;
use gearwatch_core::pipeline::{Pipeline, PipelineConfig};
use gearwatch_core::source::Source;
use gearwatch_core::speed::parse_speed_hz;
use gearwatch_io::{ChannelOption, OpenOptions, Opened, ReadError};
use indicatif::{ProgressBar, ProgressStyle};

use crate::terminal;

/// Recordings to read, and what they leave unsaid.
#[derive(Args, Clone, Debug)]
pub struct Input {
    /// Recordings: MCAP, CSV, WAV, UFF, TDMS, MATLAB (see docs/files.md)
    #[arg(required = true, value_name = "FILE")]
    pub files: Vec<PathBuf>,
    #[command(flatten)]
    pub options: InputOptions,
}

/// What recordings leave unsaid. The same can be said in a file `<recording>.toml` beside each.
#[derive(Args, Clone, Debug, Default)]
pub struct InputOptions {
    /// Samples per second, for files that do not state it
    #[arg(long, value_name = "HZ", help_heading = "Recordings")]
    sample_rate: Option<f64>,
    /// Unit of the values: m/s^2, g, mm/s, V or 1
    #[arg(long, help_heading = "Recordings")]
    unit: Option<String>,
    /// Physical value = value in the file × SCALE
    #[arg(long, allow_negative_numbers = true, help_heading = "Recordings")]
    scale: Option<f64>,
    /// Read this channel only; repeat for several. COLUMN is its name in the file or its number
    /// from 1, NAME is the sensor's name from here on
    #[arg(long = "channel", value_name = "[NAME=]COLUMN[:UNIT]", help_heading = "Recordings")]
    channels: Vec<ChannelOption>,
    /// Column or variable with the time in seconds
    #[arg(long, value_name = "COLUMN", help_heading = "Recordings")]
    time_column: Option<String>,
    /// Delimiter of text files, where the guess is wrong
    #[arg(long, value_name = "CHARACTER", help_heading = "Recordings")]
    delimiter: Option<char>,
    /// Text files write 1,5 for one and a half
    #[arg(long, help_heading = "Recordings")]
    decimal_comma: bool,
    /// Motor speed of the recording, in Hz or as 1500rpm
    #[arg(long, value_name = "HZ|RPM", value_parser = parse_speed_hz, help_heading = "Recordings")]
    motor_speed: Option<f64>,
    /// Torque at the brake
    #[arg(long, value_name = "NM", allow_negative_numbers = true, help_heading = "Recordings")]
    torque: Option<f64>,
}

impl InputOptions {
    /// In the words of the file layer.
    pub fn open_options(&self) -> OpenOptions {
        OpenOptions {
            sample_rate_hz: self.sample_rate,
            unit: self.unit.clone(),
            scale: self.scale,
            time_column: self.time_column.clone(),
            delimiter: self.delimiter,
            decimal_comma: self.decimal_comma.then_some(true),
            motor_speed_hz: self.motor_speed,
            motor_speed_rpm: None,
            brake_torque_nm: self.torque,
            channels: self.channels.clone(),
        }
    }

    /// Opens a recording; reading it moves a progress bar on a terminal.
    ///
    /// # Errors
    /// As [`gearwatch_io::open()`].
    pub fn open(&self, path: &Path) -> Result<Watched, ReadError> {
        let opened = gearwatch_io::open(path, &self.open_options())?;
        let bar = if opened.size() < WORTH_A_BAR { ProgressBar::hidden() } else { ProgressBar::new(opened.size()) };
        // Without a terminal on stderr nothing is drawn.
        if let Ok(style) = ProgressStyle::with_template("{msg} {wide_bar} {bytes}/{total_bytes} {bytes_per_sec} {eta}")
        {
            bar.set_style(style);
        }
        bar.set_message(terminal::plain(&path.file_name().unwrap_or_default().to_string_lossy()).into_owned());
        Ok(Watched { opened, bar, packets: 0 })
    }
}

/// The pipeline that judges recordings of a bench: with a baseline, and with fault states of its
/// own in place of the paper's.
///
/// # Errors
/// When the file of the fault states cannot be read or is not of this bench, or the bench makes no
/// pipeline.
pub fn pipeline(bench: &Bench, baseline: Option<Baseline>, signatures: Option<&Path>) -> anyhow::Result<Pipeline> {
    let pipeline = Pipeline::new(bench, &PipelineConfig::default(), baseline)?;
    Ok(match signatures {
        Some(path) => pipeline.with_signatures(gearwatch_io::signature_file::read_for(path, bench)?),
        None => pipeline,
    })
}

/// SHA-256 of a file, for a report that says what it was made from.
///
/// # Errors
/// With the file, when it cannot be read.
pub fn sha256_of(path: &Path) -> anyhow::Result<String> {
    gearwatch_io::digest::sha256_of_file(path).with_context(|| format!("{} cannot be read", path.display()))
}

/// Files below this size are read before a bar could be seen (bytes).
const WORTH_A_BAR: u64 = 16 << 20;

/// An opened recording with its progress bar.
pub struct Watched {
    opened: Opened,
    bar: ProgressBar,
    packets: u64,
}

impl Watched {
    /// The recording.
    pub fn opened(&self) -> &Opened {
        &self.opened
    }
}

impl Source for Watched {
    type Error = ReadError;

    fn next_packet(&mut self) -> Result<Option<Packet>, ReadError> {
        self.packets += 1;
        if self.packets.is_multiple_of(64) {
            self.bar.set_position(self.opened.progress().bytes());
        }
        let next = self.opened.next_packet();
        if !matches!(next, Ok(Some(_))) {
            self.bar.finish_and_clear();
        }
        next
    }
}
