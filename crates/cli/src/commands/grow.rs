//! `gearwatch grow BENCH`: wear, a crack or pits from the first hour to the limit, and which
//! indicator shows them when.

mod picture;
mod record;
mod table;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::Args;
use gearwatch_core::speed::parse_speed_hz;
use gearwatch_sim::growth::{self, Duty, GROWING, Plan};

use super::Run;
use super::simulate::{parse_effect, read_bench};
use crate::exit::Exit;
use crate::output::OutputOptions;
use crate::progress::Progress;

/// Follow wear, a root crack or pits over weeks: sizes, mesh harmonics, ranks, and the warning time
/// of each indicator
///
/// Flanks wear by Archard's law, cracks grow by Paris' law, and pits begin by a Weibull law of the
/// contact pressure, under the load that the damaged teeth take. Each step is one steady state of
/// the bench.
#[derive(Args)]
#[command(after_help = "Examples:
  gearwatch grow single-pair --effect tooth_wear@stage1 --hours 1000 --speed 1500rpm --torque 60 --plot wear.html
  gearwatch grow paper-rig --effect root_crack@stage1.pinion:depth_mm=1.5,tooth=3 --torque 400 --hours 500 \\
      --law paris_c=2e-12,paris_m=3.2 --out crack.csv
  gearwatch grow bench.toml --effect pitting@stage2.wheel --hours 4000 --hours-a-day 16 \\
      --duty 1500rpm:60:0.8 --duty 1200rpm:110:0.2 --limit 4 --seed 7 --plot pits.svg
  gearwatch grow single-pair --effect tooth_wear@stage1 --hours 1000 --steps 20 --record weeks.mcap

Effects that grow, and the constants of their laws (--law; the usual values are in docs/growth.md):
  tooth_wear   k_m2_per_n
  root_crack   paris_c, paris_m, threshold_mpa_sqrt_m, toughness_mpa_sqrt_m
  pitting      endurance_mpa, stress_exponent, weibull_slope, growth_cycles

Known for pairs of external spur gears; other stages are refused (exit 3).
Exit codes: 0 done; 3 bad input, or the bench has no steady state.")]
pub struct Grow {
    /// Bench file, or the name of a bench that comes with the program
    bench: PathBuf,
    /// What grows: ID@PLACE, or ID@PLACE:PARAMETER=VALUE,… for its beginning (depth_um, depth_mm,
    /// tooth)
    #[arg(long, value_name = "EFFECT")]
    effect: String,
    /// Constants of its law: NAME=VALUE,…
    #[arg(long, value_name = "NAME=VALUE", value_delimiter = ',')]
    law: Vec<String>,
    /// Running hours
    #[arg(long, value_name = "H", default_value_t = 1000.0)]
    hours: f64,
    /// Steps that they are divided into
    #[arg(long, value_name = "N", default_value_t = 40)]
    steps: usize,
    /// Motor speed at which the bench is measured, in Hz or as 1500rpm; the bench's nominal one
    /// where left out
    #[arg(long, value_name = "HZ|RPM", value_parser = parse_speed_hz)]
    speed: Option<f64>,
    /// Brake torque at which it is measured (N m); the bench's nominal one where left out
    #[arg(long, value_name = "NM")]
    torque: Option<f64>,
    /// What it runs at: speed, torque, share of the hours, as 1500rpm:60:0.8; may be repeated;
    /// where left out always as measured
    #[arg(long = "duty", value_name = "SPEED:NM:SHARE", value_parser = duty)]
    duties: Vec<Duty>,
    /// Hours a day that it runs, for days beside the hours and times in recordings
    #[arg(long, value_name = "H", default_value_t = 24.0)]
    hours_a_day: f64,
    /// Size at which it is at its limit: worn depth in µm, crack in mm, pitted part of the worst
    /// tooth in %. Where left out: a broken tooth, else rank V
    #[arg(long, value_name = "SIZE")]
    limit: Option<f64>,
    /// Scatter of amplitudes from day to day, beside that of windows (percent)
    #[arg(long, value_name = "PERCENT", default_value_t = 2.0)]
    repeatability: f64,
    /// Draws the start, noise and the lives of pits; the same seed gives the same bytes
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Table to write, a row a step, sensor and stage: .csv or .json
    #[arg(short, long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Pictures to write: .svg or .html
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
    /// Recordings to write: a folder for one a step, or FILE.mcap for all of them one after the
    /// other, with gaps between, as a service watches them
    #[arg(long, value_name = "FOLDER|FILE.mcap")]
    record: Option<PathBuf>,
    /// Length of each recording (s)
    #[arg(long, value_name = "S", default_value_t = 10.0)]
    record_length: f64,
    #[command(flatten)]
    overwrite: OutputOptions,
}

impl Run for Grow {
    const NAME: &'static str = "grow";
    const COMPUTES: bool = true;

    fn run(self) -> anyhow::Result<Exit> {
        let form = self.plot.as_deref().map(super::simulate::form).transpose()?;
        let end = |path: &Path| path.extension().and_then(|end| end.to_str()).map(str::to_owned);
        if let Some(path) = self.out.as_deref().filter(|p| !matches!(end(p).as_deref(), Some("csv" | "json"))) {
            bail!("{}: the name must end in .csv or .json, which says the form", path.display());
        }
        for (name, value) in [("--hours-a-day", self.hours_a_day), ("--record-length", self.record_length)] {
            if !(value.is_finite() && value > 0.0) {
                bail!("{name} {value}: expected a number above 0");
            }
        }
        if self.hours_a_day > 24.0 {
            bail!("--hours-a-day {}: a day has 24", self.hours_a_day);
        }
        if !(0.0..=100.0).contains(&self.repeatability) {
            bail!("--repeatability {}: expected 0 to 100 percent", self.repeatability);
        }
        let mut outputs = self.overwrite.reading([&self.bench]);
        let out = self.out.as_deref().map(|path| outputs.target(path)).transpose()?;
        let plot = self.plot.as_deref().map(|path| outputs.target(path)).transpose()?;
        let plan = self.plan()?;
        let recordings =
            self.record.as_deref().map(|path| record::Place::new(path, &plan, &mut outputs)).transpose()?;
        let progress = Progress::new("steps", plan.steps as u64 + 1);
        let run = growth::run(&plan, &mut |step| progress.finished(&format!("step {step}")));
        drop(progress);
        let growth = run.with_context(|| self.bench.display().to_string())?;
        let of = table::Of { plan: &plan, growth: &growth, hours_a_day: self.hours_a_day };
        of.print()?;
        if let Some(target) = out {
            if end(target.path()).as_deref() == Some("csv") {
                let mut file = target.create()?;
                of.write_csv(&mut file)?;
                file.finish()?;
            } else {
                target.write(format!("{}\n", serde_json::to_string_pretty(&of.object())?))?;
            }
        }
        if let Some((target, form)) = plot.zip(form) {
            target.write(picture::picture(form, &of)?)?;
        }
        if let Some(place) = recordings {
            record::write(place, &of, self.record_length)?;
        }
        Ok(Exit::Ok)
    }
}

impl Grow {
    fn plan(&self) -> anyhow::Result<Plan> {
        let bench = read_bench(&self.bench)?;
        let effect = parse_effect(&self.effect)?;
        let law: BTreeMap<String, f64> = self
            .law
            .iter()
            .map(|part| {
                let (name, value) =
                    part.split_once('=').with_context(|| format!("--law {part:?}: expected NAME=VALUE"))?;
                let number =
                    value.trim().parse().with_context(|| format!("--law {part:?}: {value:?} is not a number"))?;
                Ok((name.trim().to_owned(), number))
            })
            .collect::<anyhow::Result<_>>()?;
        let measured = Duty {
            motor_hz: self.speed.unwrap_or(bench.motor.speed_hz),
            torque_nm: self.torque.unwrap_or(bench.brake.torque_nm),
            share: 1.0,
        };
        let duties = if self.duties.is_empty() { vec![measured] } else { self.duties.clone() };
        Ok(Plan {
            bench,
            effect,
            law,
            duties,
            measured,
            hours: self.hours,
            steps: self.steps,
            limit: self.limit,
            repeatability_percent: self.repeatability,
            scatter_s: SCATTER_S,
            seed: self.seed,
        })
    }
}

/// Length of the healthy recording that the scatter of windows is taken from (s): some forty
/// windows, which state a standard deviation within a ninth.
const SCATTER_S: f64 = 20.0;

/// `1500rpm:60:0.8`.
fn duty(text: &str) -> Result<Duty, String> {
    let parts: Vec<&str> = text.split(':').collect();
    let [speed, torque, share] = parts[..] else {
        return Err(format!("{text}: expected SPEED:NM:SHARE, such as 1500rpm:60:0.8"));
    };
    let number = |text: &str| text.trim().parse::<f64>().map_err(|_| format!("{text:?} is not a number"));
    Ok(Duty {
        motor_hz: parse_speed_hz(speed).map_err(|error| error.to_string())?,
        torque_nm: number(torque)?,
        share: number(share)?,
    })
}

/// Value of a constant in a plan, the usual one where it was not given.
fn constants(plan: &Plan) -> impl Iterator<Item = (&'static growth::Constant, f64)> + '_ {
    let table = GROWING.iter().find(|(id, _)| *id == plan.effect.effect).map_or(&[] as &[_], |(_, table)| table);
    table.iter().map(|constant| (constant, plan.law.get(constant.name).copied().unwrap_or(constant.usual)))
}

#[cfg(test)]
mod tests {
    use super::{Grow, duty};

    #[test]
    fn conform_duties_are_read() {
        let read = duty("1500rpm:60:0.8").expect("a duty");
        assert_eq!((read.motor_hz, read.torque_nm, read.share), (25.0, 60.0, 0.8));
        for wrong in ["25", "25:60", "x:60:1", "25:60:1:2"] {
            assert!(duty(wrong).is_err(), "{wrong}");
        }
    }

    /// The help names every effect that grows, with every constant.
    #[test]
    fn conform_the_help_names_all_laws() {
        let command = <Grow as clap::Args>::augment_args(clap::Command::new("grow"));
        let help = command.get_after_help().map(ToString::to_string).unwrap_or_default();
        for (effect, table) in gearwatch_sim::growth::GROWING {
            assert!(help.contains(effect), "{effect}");
            assert!(table.iter().all(|constant| help.contains(constant.name)), "{effect}");
        }
    }
}
