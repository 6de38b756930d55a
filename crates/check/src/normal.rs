//! Recordings against the baseline that is to judge them.

use gearwatch_core::baseline::{Baseline, Surface};
use gearwatch_core::bench::Bench;

use crate::speed::Heard;
use crate::{Finding, Look, Severity};

pub(crate) fn findings(
    bench: &Bench,
    looks: &[Look],
    heard: &[Heard<'_>],
    baseline: Option<&Baseline>,
) -> Vec<Finding> {
    let Some(baseline) = baseline else { return Vec::new() };
    let mut out = mixed(baseline);
    let surface = Surface::new(baseline);
    for look in looks {
        let torque = look.torques().next();
        let Some(heard) = heard.iter().find(|heard| heard.look.name() == look.name() && heard.is_settled()) else {
            continue;
        };
        if surface.locate(heard.input_hz, torque).is_none() && torque.is_some() {
            let cells: Vec<String> = surface
                .cells()
                .iter()
                .map(|cell| match cell.brake_torque_nm {
                    Some(torque) => format!("{:.2} Hz at {torque:.1} N m", cell.input_speed_hz),
                    None => format!("{:.2} Hz, torque unstated", cell.input_speed_hz),
                })
                .collect();
            out.push(Finding {
                id: "outside_baseline",
                severity: Severity::Doubtful,
                recording: look.name().to_owned(),
                place: bench.name.clone(),
                found: format!(
                    "{:.2} Hz at the input shaft, {}",
                    heard.input_hz,
                    torque.map_or("torque unstated".to_owned(), |t| format!("{t:.1} N m"))
                ),
                expected: format!("an operating point that the baseline has seen: {}", cells.join(", ")),
                advice: "learn this operating point too; until then it is unknown".into(),
            });
        }
    }
    out
}

/// Cells whose runs differ by more than their own scatter.
fn mixed(baseline: &Baseline) -> Vec<Finding> {
    baseline
        .mixed_cells()
        .into_iter()
        .map(|cell| Finding {
            id: "mixed_cell",
            severity: Severity::Doubtful,
            recording: String::new(),
            place: format!("baseline, {:.2} Hz", cell.input_speed_hz),
            found: format!(
                "its {} runs differ by {:.0} %, {:.1} times what their own scatter explains",
                cell.runs, cell.between_percent, cell.times
            ),
            expected: "runs at one operating point that differ by chance".into(),
            advice: match cell.brake_torque_nm {
                None => "state the torque of each run and learn anew".into(),
                Some(_) => "something else differed: temperature, mounting, order of the runs".to_owned(),
            },
        })
        .collect()
}
