//! `gearwatch convert IN OUT`: a recording of any format as MCAP or UFF.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::{Args, ValueEnum};
use gearwatch_core::recording::Recording;
use gearwatch_core::source::Source;
use gearwatch_io::mcap::{Compression, McapWriter, PublishTime};
use gearwatch_io::uff::{self, Dataset, Form, Values};

use super::Run;
use crate::exit::Exit;
use crate::input::{InputOptions, Watched};

/// Write a recording of any format as MCAP (or UFF)
#[derive(Args)]
#[command(after_help = "Examples:
  gearwatch convert run.csv.gz run.mcap --sample-rate 12800 --unit g
  gearwatch convert bench.mat run.mcap --channel acc_1=bearing.gs:g --motor-speed 25
  gearwatch convert run.mcap run.uff")]
pub struct Convert {
    /// The recording to read
    #[arg(value_name = "IN")]
    input: PathBuf,
    /// The file to write; its end says the format: .mcap or .uff
    #[arg(value_name = "OUT")]
    output: PathBuf,
    /// Compression of MCAP
    #[arg(long, value_enum, default_value_t)]
    compression: Packing,
    /// Form of UFF
    #[arg(long, value_enum, default_value_t)]
    uff: UffForm,
    /// Overwrite OUT
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    options: InputOptions,
}

#[derive(Clone, Copy, Default, ValueEnum)]
enum Packing {
    /// Fastest; vibration packs badly
    #[default]
    None,
    /// Fast
    Lz4,
    /// About a tenth smaller
    Zstd,
}

#[derive(Clone, Copy, Default, ValueEnum)]
enum UffForm {
    /// 58b, exact
    #[default]
    Binary,
    /// 58, six digits
    Text,
}

impl Run for Convert {
    const NAME: &'static str = "convert";

    fn run(self) -> anyhow::Result<Exit> {
        let end = self.output.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        if !matches!(end.as_str(), "mcap" | "uff") {
            bail!("{}: the name must end in .mcap or .uff, which says the format to write", self.output.display());
        }
        if self.output.exists() && !self.force {
            bail!("{}: exists already; --force overwrites it", self.output.display());
        }
        let mut source = self.options.open(&self.input)?;
        // A half-written file never stands under the final name.
        let mut part = self.output.clone().into_os_string();
        part.push(".part");
        let part = PathBuf::from(part);
        let written = self.write(&mut source, &part, &end).and_then(|()| {
            std::fs::rename(&part, &self.output)
                .with_context(|| format!("{}: cannot be written", self.output.display()))
        });
        if written.is_err() {
            // What could not be finished is of no use, and the error is what matters.
            let _ = std::fs::remove_file(&part);
        }
        written?;
        let mut err = std::io::stderr().lock();
        for warning in source.opened().warnings() {
            writeln!(err, "gearwatch convert: {}: {warning}", self.input.display()).context("stderr")?;
        }
        Ok(Exit::Ok)
    }
}

impl Convert {
    fn write(&self, source: &mut Watched, part: &Path, end: &str) -> anyhow::Result<()> {
        let file = File::create(part).with_context(|| format!("{}: cannot be written", part.display()))?;
        let out = BufWriter::new(file);
        let out = if end == "mcap" { self.write_mcap(source, out)? } else { self.write_uff(source, out)? };
        let file = out.into_inner().map_err(|e| e.into_error()).with_context(|| part.display().to_string())?;
        file.sync_all().with_context(|| format!("{}: cannot be written", part.display()))
    }

    fn write_mcap(&self, source: &mut Watched, out: BufWriter<File>) -> anyhow::Result<BufWriter<File>> {
        let compression = match self.compression {
            Packing::None => Compression::None,
            Packing::Lz4 => Compression::Lz4,
            Packing::Zstd => Compression::Zstd,
        };
        let mut writer = McapWriter::new(out, compression, PublishTime::Now)?;
        while let Some(packet) = source.next_packet()? {
            writer.write(&packet)?;
        }
        Ok(writer.finish()?)
    }

    fn write_uff(&self, source: &mut Watched, mut out: BufWriter<File>) -> anyhow::Result<BufWriter<File>> {
        let mut recording = Recording::default();
        while let Some(packet) = source.next_packet()? {
            recording.push(packet);
        }
        let mut datasets = Vec::with_capacity(recording.channels.len());
        for (name, channel) in recording.channels {
            let [segment] = &channel.segments[..] else {
                bail!(
                    "{}: {name} has {} pieces with gaps between them; UFF cannot hold gaps",
                    self.input.display(),
                    channel.segments.len()
                );
            };
            let exact = segment.samples.iter().all(|&v| f64::from(v as f32) == v);
            let values = if exact {
                Values::Single(segment.samples.iter().map(|&v| v as f32).collect())
            } else {
                Values::Double(segment.samples.clone())
            };
            datasets.push(Dataset {
                name,
                unit: Some(channel.unit.to_string()),
                sample_rate_hz: channel.sample_rate_hz,
                t0: segment.t0,
                values,
            });
        }
        let form = match self.uff {
            UffForm::Binary => Form::LittleEndian,
            UffForm::Text => Form::Text,
        };
        uff::write(&mut out, &datasets, form)?;
        Ok(out)
    }
}
