//! Diagnoses for people.

use std::io::Write;

use anstyle::{AnsiColor, Style};
use gearwatch_core::speed::RPM_PER_HZ;
use gearwatch_core::train::Train;
use gearwatch_core::verdict::{HarmonicVerdict, MachineState, Rank, StateFit, Verdict};

use super::Diagnosis;

/// The width of a bar stands for so many percent: a little more than the step to rank V.
const BAR_PERCENT: f64 = 15.0;
/// Characters of a bar.
const BAR_WIDTH: usize = 12;

/// Prints one recording.
pub(super) fn table(out: &mut impl Write, one: &Diagnosis, train: &Train) -> std::io::Result<()> {
    let bold = Style::new().bold();
    writeln!(out, "{bold}{}{bold:#}", one.recording)?;
    let mut point = String::new();
    for verdict in &one.verdicts {
        let here = operating_point(verdict);
        if here != point {
            writeln!(out, "  {here}")?;
            point = here;
        }
        verdict_table(out, verdict, train)?;
    }
    if one.verdicts.is_empty() {
        writeln!(out, "  nothing could be judged")?;
    }
    let dim = Style::new().dimmed();
    for note in &one.notes {
        writeln!(out, "  {dim}note:{dim:#} {note}")?;
    }
    writeln!(out)
}

pub(super) fn operating_point(verdict: &Verdict) -> String {
    let torque = match verdict.brake_torque_nm {
        torque if torque.is_finite() => format!(", {torque:.1} N m"),
        _ => String::new(),
    };
    let cell = match verdict.cell.as_str() {
        "" => "no baseline here".to_owned(),
        cell => format!("baseline {cell} from {} session(s)", verdict.baseline_sessions),
    };
    let hz = verdict.input_speed_hz.value;
    format!("input shaft {hz:.3} Hz ({:.1} rpm){torque}; {cell}", RPM_PER_HZ * hz)
}

/// Frequency (Hz) of the line that is read as harmonic `k` (from 1): a planetary stage may have it
/// beside `k` times its mesh frequency.
pub(super) fn line_hz(train: &Train, verdict: &Verdict, k: usize) -> f64 {
    match train.stages.iter().find(|stage| stage.name == verdict.stage && !stage.is_comb()) {
        Some(stage) => stage.harmonic_order(k) * verdict.input_speed_hz.value,
        None => k as f64 * verdict.mesh_hz,
    }
}

fn verdict_table(out: &mut impl Write, verdict: &Verdict, train: &Train) -> std::io::Result<()> {
    let style = machine_style(verdict.machine);
    let reason = match verdict.reason.code() {
        "" => String::new(),
        code => format!(" ({})", code.replace('_', " ")),
    };
    write!(
        out,
        "  {} at {}: {style}{}{style:#}{reason}, {} windows",
        verdict.stage,
        verdict.channel,
        verdict.machine.code().replace('_', " "),
        verdict.windows
    )?;
    writeln!(out, "{}", nearest(verdict))?;
    writeln!(
        out,
        "      {:>9} {:>22} {:>11} {:>16}  {:BAR_WIDTH$}  rank",
        "Hz", verdict.unit, "normal", "deviation %", ""
    )?;
    for (k, harmonic) in verdict.harmonics.iter().enumerate() {
        let amplitude = &harmonic.amplitude;
        let amplitude = if amplitude.is_known() {
            format!("{} ± {}", figure(amplitude.value), figure(amplitude.sigma))
        } else {
            "-".to_owned()
        };
        let deviation = &harmonic.deviation_percent;
        let deviation = if deviation.is_known() {
            format!("{:+.2} ± {:.2}", deviation.value, deviation.sigma)
        } else {
            "-".to_owned()
        };
        let style = rank_style(harmonic.rank);
        writeln!(
            out,
            "  {}x  {:>9.2} {amplitude:>22} {:>11} {deviation:>16}  {style}{}  {}{style:#}{}{}",
            k + 1,
            line_hz(train, verdict, k + 1),
            figure(harmonic.baseline),
            bar(harmonic),
            harmonic.rank.code(),
            probability(harmonic),
            if harmonic.shared { "  shared with a line of another stage" } else { "" }
        )?;
    }
    Ok(())
}

/// Four significant figures, without an exponent where that stays readable.
pub(super) fn figure(value: f64) -> String {
    if !value.is_finite() {
        return "-".to_owned();
    }
    let magnitude = value.abs();
    if magnitude >= 1e5 || (magnitude > 0.0 && magnitude < 1e-4) {
        return format!("{value:.2e}");
    }
    let before = if magnitude < 1.0 { 0 } else { magnitude.log10() as usize };
    format!("{value:.*}", 4_usize.saturating_sub(before).max(1))
}

/// The size of a deviation in eighths of a character; it ends with an arrow where it does not fit.
fn bar(harmonic: &HarmonicVerdict) -> String {
    const EIGHTHS: [char; 8] = [' ', '▏', '▎', '▍', '▌', '▋', '▊', '▉'];
    let percent = harmonic.deviation_percent.value.abs();
    if !percent.is_finite() {
        return " ".repeat(BAR_WIDTH);
    }
    let eighths = (percent / BAR_PERCENT * (BAR_WIDTH * 8) as f64).round() as usize;
    let full = (eighths / 8).min(BAR_WIDTH);
    let mut out = "█".repeat(full);
    if eighths > BAR_WIDTH * 8 {
        out.pop();
        out.push('▶');
    } else if full < BAR_WIDTH {
        out.push(EIGHTHS[eighths % 8]);
    }
    let width = out.chars().count();
    out + &" ".repeat(BAR_WIDTH - width)
}

fn probability(harmonic: &HarmonicVerdict) -> String {
    if harmonic.rank_probability.is_finite() { format!(" (p {:.2})", harmonic.rank_probability) } else { String::new() }
}

pub(super) fn nearest(verdict: &Verdict) -> String {
    let named: Vec<String> =
        verdict.states.iter().map(|s| format!("{} {:.0} %", s.name, 100.0 * s.probability)).collect();
    match verdict.state_fit {
        StateFit::NotCompared => String::new(),
        StateFit::None => "; no known fault state fits".to_owned(),
        StateFit::One => format!("; of the known states it resembles {}", named.first().map_or("", String::as_str)),
        StateFit::Several => format!("; of the known states it resembles about equally {}", named.join(", ")),
    }
}

fn machine_style(machine: MachineState) -> Style {
    let colour = match machine {
        MachineState::Normal => AnsiColor::Green,
        MachineState::Deviating | MachineState::PathChanged => AnsiColor::Yellow,
        MachineState::Alarm => AnsiColor::Red,
        MachineState::Unknown => AnsiColor::Magenta,
    };
    Style::new().bold().fg_color(Some(colour.into()))
}

fn rank_style(rank: Rank) -> Style {
    let colour = match rank {
        Rank::Unknown => AnsiColor::Magenta,
        Rank::Zero => AnsiColor::Green,
        Rank::I | Rank::II | Rank::III => AnsiColor::Yellow,
        Rank::IV | Rank::V => AnsiColor::Red,
    };
    Style::new().fg_color(Some(colour.into()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use gearwatch_core::estimate::Estimate;

    fn bar_of(percent: f64) -> String {
        bar(&HarmonicVerdict { deviation_percent: Estimate::new(percent, 0.1), ..HarmonicVerdict::UNKNOWN })
    }

    /// 15 % fill the bar, half of it is half the bar, more ends with an arrow; the sign does not
    /// matter.
    #[test]
    fn analytic_a_bar_is_as_long_as_its_deviation() {
        assert_eq!(bar_of(15.0), "█".repeat(12));
        assert_eq!(bar_of(-7.5).trim_end(), "█".repeat(6));
        assert_eq!(bar_of(0.0).trim_end(), "");
        assert!(bar_of(99.0).ends_with('▶'));
        assert_eq!(bar_of(f64::NAN).trim_end(), "");
        for percent in [0.0, 0.1, 5.0, 14.99, 15.0, 15.2, 99.0] {
            assert_eq!(bar_of(percent).chars().count(), BAR_WIDTH, "{percent}");
        }
    }

    #[test]
    fn conform_figures_have_about_four_places() {
        for (value, text) in
            [(0.41234, "0.4123"), (1.0, "1.0000"), (12.3456, "12.346"), (1234.5, "1234.5"), (f64::NAN, "-")]
        {
            assert_eq!(figure(value), text);
        }
    }
}
