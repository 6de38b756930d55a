//! The command `gearwatch`.

mod commands;
mod exit;
mod format;
mod input;
mod serve;
mod signals;
mod talk;

use std::process::ExitCode;

fn main() -> ExitCode {
    commands::dispatch(std::env::args_os())
}
