//! `gearwatch convert IN OUT`: a recording of any format as MCAP, or in a format of other programs.

mod join;

use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::{Args, ValueEnum};
use gearwatch_core::recording::Recording;
use gearwatch_core::source::Source;
use gearwatch_io::mcap::{Compression, McapWriter, PublishTime};
use gearwatch_io::output::{Output, Target};
use gearwatch_io::save::{SaveFormat, save};
use gearwatch_io::uff::{self, Dataset, Form, Values};
use gearwatch_io::{ReadError, sidecar_path};

use self::join::Joined;
use super::Run;
use crate::exit::Exit;
use crate::input::InputOptions;
use crate::output::{OutputOptions, with_sidecars};
use crate::terminal;

/// Write a recording of any format as MCAP, UFF, CSV, WAV, MATLAB, TDMS or Parquet
///
/// MCAP holds all of a recording; a Parquet table has a row a sample instant. Beside a CSV, WAV,
/// MATLAB or TDMS file a file OUT.toml says units, names, rate and operating point; what neither
/// holds is told on standard error, and gaps are refused.
#[derive(Args)]
#[command(after_help = "Examples:
  gearwatch convert run.csv.gz run.mcap --sample-rate 12800 --unit g
  gearwatch convert bench.mat run.mcap --channel acc_1=bearing.gs:g --motor-speed 25
  gearwatch convert run.mcap run.uff
  gearwatch convert run.mcap run.tdms                 also .csv, .wav, .mat
  gearwatch convert run.mcap run.parquet              a row a sample instant, for DuckDB or pandas
  gearwatch convert acc_1.csv run.mcap --join acc_2.csv acc_3.csv --sample-rate 12800 --unit g")]
pub struct Convert {
    /// The recording to read
    #[arg(value_name = "IN")]
    input: PathBuf,
    /// The file to write; its end says the format: .mcap, .uff, .csv, .wav, .mat, .tdms or .parquet
    #[arg(value_name = "OUT")]
    output: PathBuf,
    /// Further files of the same recording, with other channels of it; what has the same name in
    /// two of them is called as its file
    #[arg(long, value_name = "FILE", num_args = 1..)]
    join: Vec<PathBuf>,
    /// Compression of MCAP
    #[arg(long, value_enum, default_value_t)]
    compression: Packing,
    /// Form of UFF
    #[arg(long, value_enum, default_value_t)]
    uff: UffForm,
    #[command(flatten)]
    overwrite: OutputOptions,
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
        let foreign = SaveFormat::ALL.into_iter().find(|kind| kind.extension() == end);
        if end == "parquet" && cfg!(not(feature = "batch")) {
            bail!("{}: {}", self.output.display(), gearwatch_runtime::kinds::with_feature("batch"));
        }
        if !matches!(end.as_str(), "mcap" | "uff" | "parquet") && foreign.is_none() {
            bail!(
                "{}: the name must end in .mcap, .uff, .csv, .wav, .mat, .tdms or .parquet, which says the format to write",
                self.output.display()
            );
        }
        let files: Vec<PathBuf> = std::iter::once(&self.input).chain(&self.join).cloned().collect();
        let mut outputs = self.overwrite.reading(with_sidecars(&files));
        let target = outputs.target(&self.output)?;
        let target = match foreign {
            Some(kind) => To::Foreign(kind, target, outputs.target(&sidecar_path(&self.output))?),
            None if end == "mcap" => To::Mcap(target),
            #[cfg(feature = "batch")]
            None if end == "parquet" => To::Parquet(target),
            None => To::Uff(target),
        };
        if !self.join.is_empty() {
            let mut source = Joined::open(&files, &self.options)?;
            self.write(&mut source, target)?;
            return files.iter().zip(source.warnings()).try_fold(Exit::Ok, |exit, (path, warnings)| {
                warn(path, &warnings)?;
                Ok(exit)
            });
        }
        let mut source = self.options.open(&self.input)?;
        self.write(&mut source, target)?;
        warn(&self.input, &source.opened().warnings())?;
        Ok(Exit::Ok)
    }
}

/// What is written.
enum To {
    Mcap(Target),
    Uff(Target),
    #[cfg(feature = "batch")]
    Parquet(Target),
    /// With its sidecar file.
    Foreign(SaveFormat, Target, Target),
}

fn whole<S: Source<Error = ReadError>>(source: &mut S) -> Result<Recording, ReadError> {
    let mut recording = Recording::default();
    while let Some(packet) = source.next_packet()? {
        recording.push(packet);
    }
    Ok(recording)
}

/// What is doubtful about a file, on standard error.
fn warn(path: &Path, warnings: &[String]) -> anyhow::Result<()> {
    let mut err = terminal::err();
    for warning in warnings {
        writeln!(err, "gearwatch convert: {}: {warning}", path.display()).context("stderr")?;
    }
    Ok(())
}

impl Convert {
    fn write<S: Source<Error = ReadError>>(&self, source: &mut S, to: To) -> anyhow::Result<()> {
        match to {
            To::Mcap(target) => Ok(self.write_mcap(source, target.create()?)?.finish()?),
            To::Uff(target) => Ok(self.write_uff(source, target.create()?)?.finish()?),
            #[cfg(feature = "batch")]
            To::Parquet(target) => self.write_parquet(source, target),
            To::Foreign(kind, target, sidecar) => self.write_foreign(source, kind, target, sidecar),
        }
    }

    fn write_foreign<S: Source<Error = ReadError>>(
        &self,
        source: &mut S,
        kind: SaveFormat,
        target: Target,
        sidecar: Target,
    ) -> anyhow::Result<()> {
        let recording = whole(source)?;
        let mut out = BufWriter::new(target.create()?);
        let saved = save(&recording, kind, &mut out).with_context(|| self.input.display().to_string())?;
        out.into_inner()
            .map_err(std::io::IntoInnerError::into_error)
            .context("the file cannot be written")?
            .finish()?;
        sidecar.write(saved.sidecar)?;
        warn(&self.output, &saved.left_out)
    }

    #[cfg(feature = "batch")]
    fn write_parquet<S: Source<Error = ReadError>>(&self, source: &mut S, target: Target) -> anyhow::Result<()> {
        let recording = whole(source)?;
        let mut out = target.create()?;
        let left_out = gearwatch_batch::samples::write_parquet(&recording, &mut out)
            .with_context(|| self.input.display().to_string())?;
        out.finish()?;
        warn(&self.output, &left_out)
    }

    fn write_mcap<S: Source<Error = ReadError>>(&self, source: &mut S, out: Output) -> anyhow::Result<Output> {
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

    fn write_uff<S: Source<Error = ReadError>>(&self, source: &mut S, mut out: Output) -> anyhow::Result<Output> {
        let recording = whole(source)?;
        let mut left_out = Vec::new();
        left_out.extend((!recording.operating_points.is_empty()).then(|| "the operating point is left out".to_owned()));
        left_out.extend(recording.tachos.keys().map(|shaft| format!("the tacho of shaft {shaft} is left out")));
        warn(&self.output, &left_out)?;
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
