//! `gearwatch info FILE`: what a file holds.

use std::fmt::Write as _;
use std::io::{Read, Write};
use std::path::Path;

use anyhow::Context;
use clap::Args;
use gearwatch_check::{self as check, Severity};
use gearwatch_core::speed::RPM_PER_HZ;
use gearwatch_io::Problem;
use gearwatch_io::mcap::source::Contents;
use gearwatch_io::mcap::walk::Topic;
use gearwatch_io::summary::{ChannelSummary, Summary};
use gearwatch_io::text::{open_regular, read_text};
use serde_json::{Value, json};

mod stages;

use super::Run;
use crate::exit::Exit;
use crate::format::Format;
use crate::input::Input;
use crate::terminal;

/// Say what recordings, bench files and baselines hold, and whether they belong together
#[derive(Args)]
#[command(after_help = "Examples:
  gearwatch info run.mcap
  gearwatch info run.csv.gz --sample-rate 12800 --unit g
  gearwatch info bench.toml baseline.json --format json")]
pub struct Info {
    #[command(flatten)]
    input: Input,
    /// Text for people, or one JSON object a file
    #[arg(long, value_enum, default_value_t)]
    format: Format,
}

/// What is said of one file.
struct Said {
    text: String,
    json: Value,
    error: Option<anyhow::Error>,
}

impl Run for Info {
    const NAME: &'static str = "info";

    fn run(self) -> anyhow::Result<Exit> {
        let mut exit = Exit::Ok;
        for path in &self.input.files {
            let said = match kind_of(path) {
                FileKind::Bench => bench(path),
                FileKind::Json => stated(path),
                FileKind::Recording => recording(path, &self.input),
            };
            let said = said.unwrap_or_else(|error| Said { text: String::new(), json: Value::Null, error: Some(error) });
            let mut out = terminal::out();
            match self.format {
                Format::Text => write!(out, "{}", said.text).context("stdout")?,
                Format::Json if said.json.is_null() => {}
                Format::Json => writeln!(out, "{}", said.json).context("stdout")?,
            }
            if let Some(error) = said.error {
                exit = Exit::Unknown;
                writeln!(terminal::err(), "gearwatch info: {error:#}").context("stderr")?;
            }
        }
        Ok(self.fit()?.map_or(exit, |_| Exit::Unknown))
    }
}

impl Info {
    /// A bench file among the files is checked with the recordings beside it; hands back what is
    /// wrong, if anything.
    fn fit(&self) -> anyhow::Result<Option<String>> {
        let of = |kind: FileKind| self.input.files.iter().filter(move |path| kind_of(path) == kind);
        let Some(bench) = of(FileKind::Bench).find_map(|path| gearwatch_io::bench_file::read(path).ok()) else {
            return Ok(None);
        };
        let baseline = of(FileKind::Json).find_map(|path| gearwatch_io::baseline_file::read(path).ok());
        let open = self.input.options.open_options();
        let looks: Vec<_> =
            of(FileKind::Recording).filter_map(|path| gearwatch_sources::look(path, &open).ok()).collect();
        let checked = check::check(&bench, &looks, baseline.as_ref());
        let mut out = std::io::stdout().lock();
        match self.format {
            Format::Text if checked.findings.is_empty() => {}
            Format::Text => {
                writeln!(out, "check of {:?}", bench.name).context("stdout")?;
                checked
                    .findings
                    .iter()
                    .try_for_each(|f| writeln!(out, "  {}: {f}", word(f.severity)))
                    .context("stdout")?;
            }
            Format::Json if checked.findings.is_empty() && looks.is_empty() => {}
            Format::Json => {
                writeln!(out, "{}", json!({ "check": bench.name, "findings": checked.findings })).context("stdout")?
            }
        }
        Ok(checked.refusal())
    }
}

const fn word(severity: Severity) -> &'static str {
    match severity {
        Severity::Wrong => "wrong",
        Severity::Doubtful => "doubtful",
        Severity::Note => "note",
    }
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum FileKind {
    Bench,
    Json,
    Recording,
}

/// From the name, and for JSON from the first character too.
fn kind_of(path: &Path) -> FileKind {
    let end = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    if end == "toml" {
        return FileKind::Bench;
    }
    let mut first = [0; 1];
    let begins_with_brace =
        open_regular(path).and_then(|mut f| f.read_exact(&mut first)).is_ok_and(|()| first == *b"{");
    if begins_with_brace { FileKind::Json } else { FileKind::Recording }
}

fn bench(path: &Path) -> anyhow::Result<Said> {
    let bench = gearwatch_io::bench_file::read(path)?;
    let train = gearwatch_core::train::Train::new(&bench);
    let mut text = format!("{}: bench {:?}\n", path.display(), bench.name);
    writeln!(
        text,
        "  motor {:.4} Hz ({:.1} rpm), input shaft {:.4} Hz at {:.4} Hz of the motor, sample rate {} Hz",
        bench.motor.speed_hz,
        RPM_PER_HZ * bench.motor.speed_hz,
        train.nominal_input_hz,
        bench.motor.speed_hz,
        bench.acquisition.sample_rate_hz
    )?;
    let stages = stages::stages(&mut text, &bench, &train)?;
    for sensor in &bench.sensors {
        writeln!(text, "  sensor {} on {}, {}", sensor.name, sensor.shaft, sensor.unit)?;
    }
    if let Some(tacho) = &bench.tacho {
        writeln!(text, "  tacho on {}, {} pulses per revolution", tacho.shaft, tacho.pulses_per_rev)?;
    }
    for effect in &bench.effects {
        writeln!(text, "  effect {} at {}", effect.effect, effect.place)?;
    }
    let json = json!({
        "file": path.display().to_string(), "format": bench.format, "name": bench.name,
        "motor_speed_hz": bench.motor.speed_hz, "input_speed_hz": train.nominal_input_hz,
        "sample_rate_hz": bench.acquisition.sample_rate_hz, "stages": stages,
        "sensors": bench.sensors.iter().map(|s| &s.name).collect::<Vec<_>>(),
    });
    Ok(Said { text, json, error: None })
}

/// A JSON file that says its own format, such as a baseline or an explanation: its fields, lists by
/// their length.
fn stated(path: &Path) -> anyhow::Result<Said> {
    let text = read_text(path).with_context(|| format!("{}: cannot be read", path.display()))?;
    let value: Value = serde_json::from_str(&text).with_context(|| format!("{}: is not JSON", path.display()))?;
    let Some(format) = value.get("format").and_then(Value::as_str) else {
        anyhow::bail!("{}: expected a JSON object that says its \"format\", found none", path.display());
    };
    let mut text = format!("{}: {format}\n", path.display());
    let mut json = json!({ "file": path.display().to_string() });
    for (key, value) in value.as_object().into_iter().flatten() {
        let short = match value {
            Value::Array(items) => json!({ "items": items.len() }),
            Value::Object(fields) => json!({ "fields": fields.len() }),
            other => other.clone(),
        };
        match value {
            Value::Array(items) => writeln!(text, "  {key}: {} items", items.len())?,
            Value::Object(fields) => writeln!(text, "  {key}: {} fields", fields.len())?,
            other => writeln!(text, "  {key}: {other}")?,
        }
        json[key] = short;
    }
    Ok(Said { text, json, error: None })
}

fn recording(path: &Path, input: &Input) -> anyhow::Result<Said> {
    let mut source = input.options.open(path)?;
    let (summary, error) = Summary::read(&mut source);
    let opened = source.opened();
    let mut warnings = opened.warnings();
    for (name, channel) in &summary.channels {
        if channel.changed_blocks > 0 {
            warnings.push(format!("{name}: {} blocks have another unit or sample rate", channel.changed_blocks));
        }
    }
    let mut text = format!("{}: {}, {} bytes\n", path.display(), opened.format().name(), opened.size());
    for (name, channel) in &summary.channels {
        describe(&mut text, name, channel)?;
    }
    for (shaft, tacho) in &summary.tachos {
        write!(text, "  tacho {shaft}: {} pulses, {} per revolution", tacho.pulses, tacho.pulses_per_rev)?;
        if let (Some(mean), Some(min), Some(max)) = (tacho.mean_speed_hz, tacho.min_speed_hz, tacho.max_speed_hz) {
            write!(text, ", mean {mean:.4} Hz ({min:.4} to {max:.4} Hz)")?;
        }
        text.push('\n');
    }
    if let Some(points) = &summary.operating_points {
        write!(text, "  operating points: {}", points.count)?;
        for (range, what, unit) in [
            (points.motor_speed_hz, "motor", "Hz"),
            (points.brake_torque_nm, "brake", "N m"),
            (points.temperature_c, "temperature", "°C"),
        ] {
            match range {
                Some((low, high)) if low == high => write!(text, ", {what} {low} {unit}")?,
                Some((low, high)) => write!(text, ", {what} {low} to {high} {unit}")?,
                None => {}
            }
        }
        text.push('\n');
    }
    let contents = opened.contents();
    // A log of the service is whole without raw data.
    let error = error.filter(|error| {
        !(matches!(error.problem, Problem::Empty(_))
            && contents.as_ref().is_some_and(|c| c.is_log() && !c.topics.is_empty()))
    });
    if let Some(contents) = contents.as_ref().filter(|contents| contents.is_log()) {
        describe_log(&mut text, contents)?;
    }
    for warning in &warnings {
        writeln!(text, "  note: {warning}")?;
    }
    let mut json = json!({
        "file": path.display().to_string(), "format": opened.format().name(), "bytes": opened.size(),
        "warnings": warnings,
    });
    let fields = serde_json::to_value(&summary)?;
    for (key, value) in fields.as_object().into_iter().flatten() {
        json[key] = value.clone();
    }
    if let Some(contents) = contents {
        json["contents"] = serde_json::to_value(contents)?;
    }
    if let Some(error) = &error {
        json["error"] = json!(error.to_string());
    }
    Ok(Said { text, json, error: error.map(anyhow::Error::from) })
}

/// The topics of a log of the service.
fn describe_log(text: &mut String, contents: &Contents) -> std::fmt::Result {
    write!(text, "  log of the service, written by {}", contents.written_by)?;
    if let (Some(first), Some(last)) = (contents.first_ns, contents.last_ns) {
        write!(text, ", {:.3} s", last.saturating_sub(first) as f64 / 1e9)?;
    }
    writeln!(text)?;
    for Topic { topic, schema, messages } in &contents.topics {
        writeln!(text, "    {topic}: {messages} messages ({schema})")?;
    }
    Ok(())
}

fn describe(text: &mut String, name: &str, channel: &ChannelSummary) -> std::fmt::Result {
    writeln!(
        text,
        "  {name}: {} samples at {:.6} Hz, {:.4} s, {}, rms {:.6} ({:.6} to {:.6})",
        channel.samples,
        channel.sample_rate_hz,
        channel.duration_s,
        if channel.unit == "1" { "no unit" } else { &channel.unit },
        channel.rms,
        channel.min,
        channel.max
    )?;
    for gap in &channel.gaps {
        writeln!(
            text,
            "    gap at {:.4} s: {} samples missing, {:.1} ms between its ends",
            gap.at_s,
            gap.samples,
            gap.step_s * 1e3
        )?;
    }
    if channel.more_gaps > 0 {
        writeln!(text, "    and {} more gaps", channel.more_gaps)?;
    }
    if channel.not_finite > 0 {
        writeln!(text, "    {} values are not finite numbers", channel.not_finite)?;
    }
    for (name, blocks) in &channel.quality {
        writeln!(text, "    {name}: {blocks} blocks")?;
    }
    Ok(())
}
