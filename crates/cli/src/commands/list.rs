//! `gearwatch list`: what there is to choose from.

use std::collections::BTreeMap;
use std::io::Write;

use anyhow::Context;
use clap::Args;
use gearwatch_core::verdict::{FIELDS, Field, Holds, Part};
use gearwatch_daemon::sink;
use gearwatch_runtime::kinds::Kind;
use gearwatch_sim::effects::{Effect, Parameter, Place, Signature, Values};

use super::Run;
use crate::exit::Exit;
use crate::terminal;

/// List the kinds of sources and sinks, file formats, simulated effects and the fields of a verdict
#[derive(Args)]
#[command(after_help = "Examples:
  gearwatch list                 everything
  gearwatch list sources         sources only, each with an example for the configuration
  gearwatch list effects         effects with their places, parameters, ranges and laws
  gearwatch list formats
  gearwatch list fields          fields of a verdict: type, unit, meaning; codes with their meanings
  gearwatch list fields --json-schema > verdict.schema.json")]
pub struct List {
    /// What to list; everything where left out
    #[arg(value_enum)]
    what: Option<What>,
    /// Print the JSON schema of a verdict instead (with `fields`)
    #[arg(long)]
    json_schema: bool,
}

#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum What {
    /// Where packets come from
    Sources,
    /// Where verdicts go
    Sinks,
    /// Recordings that can be read
    Formats,
    /// Physics that the simulator can switch on
    Effects,
    /// Fields of a verdict, in JSON, Parquet and the log
    Fields,
}

impl Run for List {
    const NAME: &'static str = "list";

    fn run(self) -> anyhow::Result<Exit> {
        let mut out = terminal::out();
        if self.json_schema {
            anyhow::ensure!(
                self.what == Some(What::Fields),
                "--json-schema goes with one list only: gearwatch list fields --json-schema"
            );
            serde_json::to_writer_pretty(&mut out, &gearwatch_log::verdict_schema())?;
            writeln!(out)?;
            return Ok(Exit::Ok);
        }
        let wanted = |what| self.what.is_none_or(|one| one == what);
        if wanted(What::Sources) {
            kinds(&mut out, "Sources", "[[bench.source]]", gearwatch_sources::KINDS, self.what.is_some())?;
        }
        if wanted(What::Sinks) {
            kinds(&mut out, "Sinks", "[[sink]]", sink::KINDS, self.what.is_some())?;
        }
        if wanted(What::Formats) {
            writeln!(out, "Formats of recordings")?;
            for format in gearwatch_io::formats::FORMATS {
                writeln!(out, "  {:14} {}", format.name(), format.help())?;
            }
        }
        if wanted(What::Effects) {
            writeln!(out, "Effects of the simulator")?;
            let longest = gearwatch_sim::effects::every().map(|effect| effect.id().len()).max().unwrap_or(0);
            for effect in gearwatch_sim::effects::every() {
                writeln!(out, "  {:longest$} {}", effect.id(), effect.help())?;
                if self.what.is_some() {
                    describe(&mut out, effect)?;
                }
            }
        }
        if wanted(What::Fields) {
            fields(&mut out, self.what.is_some())?;
        }
        Ok(Exit::Ok)
    }
}

/// Fields of a verdict. Of the harmonics and states the first of each stands for all, of the
/// indicators the value for its five numbers; `all` lists every one.
fn fields(out: &mut impl Write, all: bool) -> std::io::Result<()> {
    writeln!(out, "Fields of a verdict")?;
    let first = |field: &&Field| match field.part {
        Part::Window => true,
        Part::Harmonic(k) | Part::State(k) => k == 1,
        Part::Indicator => false,
    };
    for field in FIELDS.iter().filter(|field| all || first(field)) {
        let (kind, codes) = match field.holds {
            Holds::Text => ("text", Vec::new()),
            Holds::Code(codes) => ("code", codes()),
            Holds::Time => ("time", Vec::new()),
            Holds::Count | Holds::Level => ("integer", Vec::new()),
            Holds::Flag => ("flag", Vec::new()),
            Holds::Number => ("number", Vec::new()),
        };
        writeln!(out, "  {:26} {kind:8} {:8} {}", field.name, field.unit, field.meaning)?;
        // The ranks of all harmonics have the same codes.
        if all && !matches!(field.part, Part::Harmonic(2..)) {
            for (code, meaning) in codes {
                writeln!(out, "      {:24} {meaning}", if code.is_empty() { "(empty)" } else { code })?;
            }
        }
    }
    Ok(())
}

/// Places, parameters and declared laws of an effect, these as on the bench of the paper at typical
/// values.
fn describe(out: &mut impl Write, effect: &dyn Effect) -> anyhow::Result<()> {
    let places: Vec<&str> = effect.places().iter().map(|place| place.pattern()).collect();
    writeln!(out, "      {:16} {}", "where", places.join(", "))?;
    for Parameter { name, unit, min, typical, max } in effect.parameters() {
        let unit = if *unit == "1" { String::new() } else { format!(" {unit}") };
        writeln!(out, "      {name:16} {min} to {max}{unit}, typically {typical}")?;
    }
    let bench = gearwatch_sim::shipped::bench("paper-rig").context("the bench of the paper")?;
    if let Some((_, place)) = Place::of(effect, &bench).into_iter().next() {
        let Signature { change, load, speed, .. } =
            effect.signature(&Values::new(effect, place, &BTreeMap::new())?, &bench);
        writeln!(out, "      {:16} {change}; {load}; {speed}", "signature")?;
    }
    if !effect.confused_with().is_empty() {
        writeln!(out, "      {:16} {}", "confused with", effect.confused_with().join(", "))?;
    }
    Ok(())
}

/// One line a kind; with its example where `examples` is set.
fn kinds<C: ?Sized>(
    out: &mut impl Write,
    title: &str,
    header: &str,
    kinds: &[Kind<C>],
    examples: bool,
) -> std::io::Result<()> {
    writeln!(out, "{title}")?;
    for kind in kinds {
        writeln!(out, "  {:14} {}", kind.name, kind.help)?;
        if examples {
            writeln!(out, "      {header}\n      kind = {:?}", kind.name)?;
            for line in kind.example.trim().lines() {
                writeln!(out, "      {line}")?;
            }
            writeln!(out)?;
        }
    }
    Ok(())
}
