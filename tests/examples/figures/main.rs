//! One round of the figures of `docs/performance.md`, as JSON; `tests/peers/table.py` runs it in
//! turn with the peers in Python.
//!
//! `cargo run --release -p gearwatch-tests --example figures -- row | steady | stepping | reading
//! FILE… | mcap FROM TO | scaling KIND SIZE`

#![expect(clippy::print_stdout, reason = "the figures are what it is run for")]

mod reading;
mod row;
mod simulation;

use std::process::ExitCode;
use std::time::Instant;

use serde_json::Value;

/// Why no figure came.
type Failure = Box<dyn std::error::Error>;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    match figures(&arguments) {
        Ok(found) => {
            println!("{found}");
            ExitCode::SUCCESS
        }
        Err(failure) => {
            println!("{}", serde_json::json!({ "failed": failure.to_string() }));
            ExitCode::FAILURE
        }
    }
}

fn figures(arguments: &[String]) -> Result<Value, Failure> {
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match words[..] {
        ["row"] => row::figures(),
        ["steady"] => simulation::steady(),
        ["stepping"] => simulation::stepping(),
        ["reading", ref files @ ..] => reading::figures(files),
        ["mcap", from, to] => reading::to_mcap(from, to),
        ["scaling", kind, size] => row::scaling(kind, size.parse()?),
        _ => Err("expected row, steady, stepping, reading FILE…, mcap FROM TO or scaling KIND SIZE".into()),
    }
}

/// Seconds of one run of `work`: the median of `rounds`, after one that does not count.
fn seconds(rounds: usize, mut work: impl FnMut() -> Result<(), Failure>) -> Result<f64, Failure> {
    work()?;
    let mut all = Vec::with_capacity(rounds);
    for _ in 0..rounds {
        let began = Instant::now();
        work()?;
        all.push(began.elapsed().as_secs_f64());
    }
    all.sort_by(f64::total_cmp);
    all.get(rounds / 2).copied().ok_or_else(|| "no round".into())
}
