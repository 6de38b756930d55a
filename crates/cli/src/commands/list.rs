//! `gearwatch list`: what there is to choose from.

use std::io::Write;

use clap::Args;
use gearwatch_daemon::kinds::Kind;
use gearwatch_daemon::{sink, source};

use super::Run;
use crate::exit::Exit;

/// List the kinds of sources and sinks, file formats and simulated effects
#[derive(Args)]
#[command(after_help = "Examples:
  gearwatch list                 everything
  gearwatch list sources         sources only, each with an example for the configuration
  gearwatch list formats")]
pub struct List {
    /// What to list; everything where left out
    #[arg(value_enum)]
    what: Option<What>,
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
}

impl Run for List {
    const NAME: &'static str = "list";

    fn run(self) -> anyhow::Result<Exit> {
        let mut out = std::io::stdout().lock();
        let wanted = |what| self.what.is_none_or(|one| one == what);
        if wanted(What::Sources) {
            kinds(&mut out, "Sources", "[[bench.source]]", source::KINDS, self.what.is_some())?;
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
            for effect in gearwatch_sim::effects::ALL {
                writeln!(out, "  {:22} {}", effect.id(), effect.help())?;
            }
        }
        Ok(Exit::Ok)
    }
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
