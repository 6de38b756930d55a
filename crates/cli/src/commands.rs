//! The table of commands: one file a command, one line here.

use std::ffi::OsString;
use std::io::Write;
use std::process::ExitCode;

use anyhow::bail;
use clap::{Arg, Args, Command};
use gearwatch_runtime::kinds::with_feature;

use crate::exit::Exit;
use crate::{memory, terminal};

mod baseline;
#[cfg(feature = "batch")]
mod batch;
mod check;
mod completions;
mod config;
mod convert;
mod diagnose;
mod doctor;
mod emulate;
#[cfg(feature = "explain")]
mod explain;
#[cfg(feature = "brokers")]
mod fleet;
mod grow;
mod history;
mod indicators;
mod info;
mod layout;
mod list;
#[cfg(feature = "manual")]
mod man;
mod modes;
#[cfg(feature = "explain")]
mod paper;
#[cfg(feature = "explain")]
mod prove;
mod recover;
mod replay;
mod report;
mod run;
mod signatures;
mod simulate;
mod sketch;
mod status;
#[cfg(feature = "batch")]
mod sweep;
#[cfg(feature = "terminal")]
mod top;

/// All commands, in the order of `gearwatch --help`.
const COMMANDS: &[CommandEntry] = &[
    kind::<run::RunService>(),
    kind::<status::Status>(),
    kind::<replay::Replay>(),
    kind::<simulate::Simulate>(),
    kind::<emulate::Emulate>(),
    #[cfg(feature = "terminal")]
    kind::<top::Top>(),
    #[cfg(not(feature = "terminal"))]
    left_out("top", "terminal"),
    #[cfg(feature = "brokers")]
    kind::<fleet::Fleet>(),
    #[cfg(not(feature = "brokers"))]
    left_out("fleet", "brokers"),
    kind::<baseline::BaselineCommand>(),
    #[cfg(feature = "explain")]
    kind::<paper::Paper>(),
    #[cfg(not(feature = "explain"))]
    left_out("paper", "explain"),
    kind::<diagnose::Diagnose>(),
    kind::<indicators::Indicators>(),
    kind::<signatures::SignaturesCommand>(),
    kind::<check::CheckBench>(),
    kind::<modes::Modes>(),
    kind::<grow::Grow>(),
    kind::<info::Info>(),
    kind::<convert::Convert>(),
    #[cfg(feature = "batch")]
    kind::<batch::Batch>(),
    #[cfg(not(feature = "batch"))]
    left_out("batch", "batch"),
    #[cfg(feature = "batch")]
    kind::<sweep::Sweep>(),
    #[cfg(not(feature = "batch"))]
    left_out("sweep", "batch"),
    #[cfg(feature = "explain")]
    kind::<explain::Explain>(),
    #[cfg(not(feature = "explain"))]
    left_out("explain", "explain"),
    #[cfg(feature = "explain")]
    kind::<prove::Prove>(),
    #[cfg(not(feature = "explain"))]
    left_out("prove", "explain"),
    kind::<history::HistoryCommand>(),
    kind::<report::ReportCommand>(),
    kind::<recover::Recover>(),
    kind::<doctor::Doctor>(),
    kind::<layout::Layout>(),
    kind::<list::List>(),
    kind::<config::ConfigCommand>(),
    kind::<completions::Completions>(),
    #[cfg(feature = "manual")]
    kind::<man::Manual>(),
    #[cfg(not(feature = "manual"))]
    left_out("man", "manual"),
];

/// A command: what the user may write, and what is then done.
pub trait Run: Args + Send {
    /// As typed.
    const NAME: &'static str;
    /// It works for seconds and ends: the allocator may keep what is free until then.
    const COMPUTES: bool = false;

    /// Does it. Results go to stdout, talk to stderr.
    ///
    /// # Errors
    /// With a message that names file and place, what was expected and what was found, and what to
    /// do next.
    fn run(self) -> anyhow::Result<Exit>;
}

struct CommandEntry {
    name: &'static str,
    /// The cargo feature that a build without this command lacks.
    lacks: Option<&'static str>,
    build: fn() -> Command,
    run: fn(&clap::ArgMatches) -> anyhow::Result<Exit>,
}

const fn kind<T: Run>() -> CommandEntry {
    CommandEntry {
        name: T::NAME,
        lacks: None,
        build: || T::augment_args(Command::new(T::NAME)),
        run: |matches| {
            let command = T::from_arg_matches(matches)?;
            if T::COMPUTES {
                memory::keep_what_is_free();
            }
            command.run()
        },
    }
}

/// A command that this build has left out: it stands in the help and takes any arguments, so that
/// whoever tries it learns what it needs.
#[allow(dead_code, reason = "not used where nothing was left out")]
const fn left_out(name: &'static str, feature: &'static str) -> CommandEntry {
    CommandEntry { name, lacks: Some(feature), build: || Command::new(""), run: |_| Ok(Exit::Unknown) }
}

impl CommandEntry {
    fn command(&self) -> Command {
        let Some(feature) = self.lacks else { return (self.build)() };
        Command::new(self.name)
            .about(format!("(not in this build: {})", with_feature(feature)))
            .disable_help_flag(true)
            .arg(Arg::new("any").num_args(0..).trailing_var_arg(true).allow_hyphen_values(true).hide(true))
    }

    fn run(&self, matches: &clap::ArgMatches) -> anyhow::Result<Exit> {
        match self.lacks {
            Some(feature) => bail!("this build has left it out; {}", with_feature(feature)),
            None => (self.run)(matches),
        }
    }
}

/// The whole command line, for help, completions and manual pages.
pub fn command_line() -> Command {
    Command::new("gearwatch")
        .version(env!("CARGO_PKG_VERSION"))
        .about("Watches, replays, diagnoses, simulates and explains a gear test bench")
        .subcommand_required(true)
        .arg_required_else_help(true)
        .subcommands(COMMANDS.iter().map(CommandEntry::command))
}

/// Parses the arguments, runs the command, and says what went wrong.
pub fn dispatch(args: impl IntoIterator<Item = OsString>) -> ExitCode {
    let matches = match command_line().try_get_matches_from(args) {
        Ok(matches) => matches,
        Err(error) => {
            // A failed print of help to a closed pipe is not worth a message.
            let _ = error.print();
            return ExitCode::from(if error.use_stderr() { Exit::Unknown as u8 } else { Exit::Ok as u8 });
        }
    };
    let Some((name, matches)) = matches.subcommand() else { return ExitCode::from(Exit::Unknown as u8) };
    let Some(kind) = COMMANDS.iter().find(|kind| kind.name == name) else {
        return ExitCode::from(Exit::Unknown as u8);
    };
    match kind.run(matches) {
        Ok(exit) => ExitCode::from(exit as u8),
        // `gearwatch list | head -1`: whoever read has all he wanted.
        Err(error) if is_closed_pipe(&error) => ExitCode::from(Exit::Ok as u8),
        Err(error) => {
            let _ = writeln!(terminal::err(), "gearwatch {name}: {}", sentence(&error));
            ExitCode::from(Exit::Unknown as u8)
        }
    }
}

/// The error and its causes, but none that the sentence so far ends with: many errors tell their
/// cause themselves.
fn sentence(error: &anyhow::Error) -> String {
    error.chain().map(ToString::to_string).fold(String::new(), |so_far, cause| match so_far.as_str() {
        "" => cause,
        said if said.ends_with(&cause) => so_far,
        said => format!("{said}: {cause}"),
    })
}

fn is_closed_pipe(error: &anyhow::Error) -> bool {
    let kind = |cause: &(dyn std::error::Error + 'static)| {
        let io = cause.downcast_ref::<std::io::Error>().map(std::io::Error::kind);
        // A JSON writer wraps the error of what it writes to, and hides it from the chain.
        io.or_else(|| cause.downcast_ref::<serde_json::Error>().and_then(serde_json::Error::io_error_kind))
    };
    error.chain().any(|cause| kind(cause) == Some(std::io::ErrorKind::BrokenPipe))
}

#[cfg(test)]
mod tests {
    use anyhow::Context;

    /// A command that a build has left out takes whatever its users write, and names the feature
    /// that it needs; the help says so too.
    #[test]
    fn conform_a_command_that_was_left_out_names_its_feature() {
        let entry = super::left_out("batch", "batch");
        for line in
            [&["batch"][..], &["batch", "archive/", "--output", "x"], &["batch", "--help"], &["batch", "--", "-1"]]
        {
            let matches = entry.command().try_get_matches_from(line).unwrap();
            let said = entry.run(&matches).err().unwrap().to_string();
            assert!(said.contains("cargo feature \"batch\""), "{said}");
        }
        assert!(entry.command().get_about().unwrap().to_string().contains("cargo feature \"batch\""));
    }

    /// Words of a shell's line, of which single quotes hold some together.
    fn words(line: &str) -> Vec<String> {
        let mut words = vec![String::new()];
        let mut quoted = false;
        for c in line.chars() {
            match c {
                '\'' => quoted = !quoted,
                ' ' if !quoted => words.push(String::new()),
                c => words.last_mut().unwrap().push(c),
            }
        }
        words.retain(|word| !word.is_empty());
        words
    }

    /// Every example of every help is a command line that is understood, up to a pipe, a
    /// redirection or the two spaces before its comment.
    #[test]
    fn conform_examples_are_understood() {
        let mut seen = 0;
        for command in super::command_line().get_subcommands() {
            let help = command.get_after_help().map(ToString::to_string).unwrap_or_default();
            let help = help.split("\\\n").map(str::trim_start).collect::<String>();
            for line in help.lines().filter(|line| line.trim().starts_with("gearwatch ")) {
                let said = line.trim().split("  ").next().and_then(|said| said.split(['|', '>']).next()).unwrap();
                let parsed = super::command_line().try_get_matches_from(words(said));
                assert!(parsed.is_ok(), "{said}: {}", parsed.unwrap_err());
                seen += 1;
            }
        }
        assert!(seen > 50, "{seen}");
    }

    /// What the system said stands once in the sentence, whether an error tells its cause or leaves
    /// that to the chain.
    #[test]
    fn regress_no_cause_is_told_twice() {
        let cause = || std::io::Error::other("no room");
        let told = anyhow::Error::new(cause()).context("a.mcap: no room");
        let left: anyhow::Result<()> = Err(cause()).context("a.mcap").context("log");
        assert_eq!(super::sentence(&told), "a.mcap: no room");
        assert_eq!(super::sentence(&left.unwrap_err()), "log: a.mcap: no room");
    }
}
