//! `gearwatch explain --blind-spots`: what sensors and operating points could not show.

use std::io::{IsTerminal, Write};

use anyhow::Context;
use gearwatch_core::bench::Bench;
use gearwatch_core::recording::Recording;
use gearwatch_explain::blind::{Point, Shows, advice, blind_spots, usual_points};

use crate::exit::Exit;
use crate::terminal;

/// The operating points of recordings, each once.
fn points_of(recordings: &[Recording]) -> Vec<Point> {
    let mut out: Vec<Point> = Vec::new();
    for o in recordings.iter().filter_map(|r| r.operating_points.first()) {
        let near = |p: &Point| {
            (p.motor_hz / o.motor_speed_hz - 1.0).abs() < 0.03
                && (p.torque_nm - o.brake_torque_nm).abs() <= 0.05 * o.brake_torque_nm
        };
        if o.motor_speed_hz > 0.0 && o.brake_torque_nm > 0.0 && !out.iter().any(near) {
            out.push(Point { motor_hz: o.motor_speed_hz, torque_nm: o.brake_torque_nm });
        }
    }
    out
}

/// Prints a line for every effect and place.
pub fn run(bench: &Bench, recordings: &[Recording]) -> anyhow::Result<Exit> {
    let mut points = points_of(recordings);
    if points.is_empty() {
        points = usual_points(bench);
    }
    let talk = std::io::stderr().is_terminal();
    let mut progress = |step: &str| {
        if talk {
            // Progress is a courtesy; a closed terminal is not an error.
            let _ = writeln!(terminal::err(), "  {step}");
        }
    };
    let found = blind_spots(bench, &points, &|_| true, &mut progress)?;
    let mut out = terminal::out();
    let mut print = || -> std::io::Result<()> {
        let settings: Vec<String> =
            points.iter().map(|p| format!("{:.1} Hz {:.0} N m", p.motor_hz, p.torque_nm)).collect();
        writeln!(out, "{}: {} sensors, recorded at {}", bench.name, bench.sensors.len(), settings.join(", "))?;
        writeln!(out, "smallest size that stands out against a reference of the same bench:\n")?;
        for spot in &found {
            let name = format!("{} at {}", spot.effect, spot.place);
            match &spot.shows {
                Shows::From { parameter, value, lines, without_reference } => {
                    let left = match without_reference {
                        Some(share) if *share > 0.15 => {
                            format!("; without a reference {:.0} % of it is left beside an unknown path", 100.0 * share)
                        }
                        Some(_) => "; invisible without a reference".into(),
                        None => "; one load: invisible without a reference".into(),
                    };
                    writeln!(out, "  {name:<44} {parameter} = {value:.2e} in {lines}{left}")?;
                }
                Shows::Not { plain } if *plain < 0.05 => {
                    writeln!(out, "  {name:<44} not told: it changes no line here, or has no steady state")?;
                }
                Shows::Not { plain } => {
                    writeln!(
                        out,
                        "  {name:<44} blind: the largest tried is {plain:.1} times repetition, 4 are needed"
                    )?;
                }
                Shows::Words(words) => writeln!(out, "  {name:<44} {words}")?,
            }
        }
        for text in advice(bench, &points) {
            writeln!(out, "next: {text}")?;
        }
        Ok(())
    };
    print().context("standard output")?;
    Ok(Exit::Ok)
}
