//! Growth as text, as rows, and as one JSON object.

use std::io::Write;

use gearwatch_core::rank::RankConfig;
use gearwatch_core::verdict::HARMONICS;
use gearwatch_sim::growth::{Growth, Indicator, LineGroup, Plan};
use serde_json::{Value, json};

use super::constants;
use crate::terminal;

/// Steps that people are shown; all are in the file.
const SHOWN: usize = 11;

/// A run and what it was asked for.
pub(super) struct Of<'a> {
    pub plan: &'a Plan,
    pub growth: &'a Growth,
    pub hours_a_day: f64,
}

/// Hours, or a dash.
pub(super) fn hours(value: Option<f64>) -> String {
    value.map_or_else(|| "-".to_owned(), |hours| format!("{hours:.1}"))
}

/// Two digits, and no minus before nothing.
fn percent(value: f64) -> String {
    let text = format!("{value:.2}");
    if text == "-0.00" { "0.00".into() } else { text }
}

impl Of<'_> {
    /// Calendar days after so many running hours.
    pub fn days(&self, hours: f64) -> f64 {
        hours / self.hours_a_day
    }

    pub fn sensor(&self, indicator: &Indicator) -> &str {
        &self.plan.bench.sensors[indicator.sensor].name
    }

    pub fn stage(&self, indicator: &Indicator) -> &str {
        &self.plan.bench.stages[indicator.stage].name
    }

    /// Positions of the indicators that came to be significant, the first one first.
    pub fn by_time(&self) -> Vec<usize> {
        let first = |i: usize| self.growth.merits[i].first_hours;
        let mut out: Vec<usize> = (0..self.growth.merits.len()).filter(|&i| first(i).is_some()).collect();
        out.sort_by(|&a, &b| first(a).unwrap_or(f64::INFINITY).total_cmp(&first(b).unwrap_or(f64::INFINITY)));
        out
    }

    /// Positions of 1x to 5x of the sensor and stage where something shows first.
    pub fn harmonics(&self) -> Vec<usize> {
        let told = self.by_time().first().map_or(self.growth.indicators[0], |&i| self.growth.indicators[i]);
        self.of(told.sensor, told.stage, LineGroup::Mesh)
    }

    /// Positions of 1x to 5x of a kind.
    pub fn of(&self, sensor: usize, stage: usize, kind: LineGroup) -> Vec<usize> {
        let all = self.growth.indicators.iter().enumerate();
        all.filter(|(_, i)| (i.sensor, i.stage, i.kind) == (sensor, stage, kind)).map(|(at, _)| at).collect()
    }

    /// What it is, in one line.
    pub fn title(&self) -> String {
        let Plan { bench, effect, measured, .. } = self.plan;
        let last = self.growth.steps.last().map_or(0.0, |step| step.hours);
        format!(
            "{}: {} at {}, {last:.4} h, measured at {} Hz, {} N m",
            bench.name, effect.effect, effect.place, measured.motor_hz, measured.torque_nm
        )
    }

    /// The outcome in sentences.
    pub fn outcome(&self) -> Vec<String> {
        let mut out = Vec::new();
        if let Some((end, at)) = self.growth.ended {
            out.push(format!("After {at:.1} h {}.", end.words()));
        }
        out.push(match &self.growth.limit {
            Some((at, what)) => format!("Limit: {what}, after {at:.1} h ({:.1} days).", self.days(*at)),
            None => "The limit is not reached.".into(),
        });
        let first = self.by_time().first().and_then(|&i| self.growth.merits[i].first_hours);
        if let Some(step) = self.growth.steps.get(1).filter(|step| first.is_some_and(|first| first < step.hours)) {
            out.push(format!(
                "Something shows within the first step of {:.1} h, where it is placed by a straight line; more --steps, or fewer --hours, place it better.",
                step.hours
            ));
        }
        out.extend(self.growth.remarks.iter().map(|remark| {
            let mut letters = remark.chars();
            letters.next().map_or_else(String::new, |first| format!("{}{}.", first.to_uppercase(), letters.as_str()))
        }));
        out
    }

    /// For people.
    pub fn print(&self) -> anyhow::Result<()> {
        let mut out = std::io::BufWriter::new(terminal::out());
        writeln!(out, "{}", self.title())?;
        let law: Vec<String> =
            constants(self.plan).map(|(constant, value)| format!("{} = {value:?}", constant.name)).collect();
        writeln!(out, "law: {}\n", law.join(", "))?;
        let shown = self.harmonics();
        let told = self.growth.indicators[shown[0]];
        let steps = &self.growth.steps;
        let (name, unit) = steps[0].growing.unit();
        writeln!(
            out,
            "Deviation in percent and rank of the mesh harmonics of {} at {}",
            self.stage(&told),
            self.sensor(&told)
        )?;
        write!(out, "{:>10} {:>8} {:>17}", "h", "days", format!("{name} ({unit})"))?;
        (1..=HARMONICS).try_for_each(|h| write!(out, " {:>13}", format!("{h}x")))?;
        writeln!(out)?;
        let ranks = RankConfig::default();
        let deviations: Vec<Vec<f64>> = shown.iter().map(|&i| self.growth.deviations_percent(i)).collect();
        let every = steps.len().div_ceil(SHOWN).max(1);
        for (k, step) in steps.iter().enumerate().filter(|(k, _)| k % every == 0 || k + 1 == steps.len()) {
            write!(out, "{:>10.1} {:>8.1} {:>17.3}", step.hours, self.days(step.hours), step.size)?;
            for deviations in &deviations {
                write!(out, " {:>9} {:<3}", percent(deviations[k]), ranks.rank_of(deviations[k]).code())?;
            }
            writeln!(out)?;
        }
        writeln!(out)?;
        for sentence in self.outcome() {
            writeln!(out, "{sentence}")?;
        }
        let found = self.by_time();
        writeln!(
            out,
            "\nFirst significance: rank I and three standard deviations of a window, in three of five windows\n{:<24} {:<12} {:<12} {:>10} {:>10} {:>10} {:>12}",
            "indicator",
            "stage",
            "sensor",
            "first (h)",
            format!("at ({unit})"),
            "rank V (h)",
            "warning (h)"
        )?;
        for i in found.iter().copied() {
            let (indicator, merit) = (&self.growth.indicators[i], &self.growth.merits[i]);
            writeln!(
                out,
                "{:<24} {:<12} {:<12} {:>10} {:>10} {:>10} {:>12}",
                indicator.name(),
                terminal::cell(self.stage(indicator)),
                terminal::cell(self.sensor(indicator)),
                hours(merit.first_hours),
                merit.first_size.map_or_else(|| "-".into(), |size| format!("{size:.3}")),
                hours(merit.rank_v_hours),
                hours(merit.warning_hours)
            )?;
        }
        writeln!(out, "{} of {} indicators never", self.growth.merits.len() - found.len(), self.growth.merits.len())?;
        Ok(out.flush()?)
    }

    /// A row a step, sensor and stage.
    pub fn write_csv(&self, out: impl Write) -> anyhow::Result<()> {
        let mut out = csv::Writer::from_writer(out);
        let kinds = [LineGroup::Mesh, LineGroup::PinionSidebands, LineGroup::WheelSidebands];
        let mut head: Vec<String> =
            ["hours", "days", "size", "size_unit", "pits", "pitted_teeth", "parting", "channel", "stage"]
                .map(str::to_owned)
                .into();
        let (sensors, stages) = (self.plan.bench.sensors.len(), self.plan.bench.stages.len());
        let columns = |sensor, stage| kinds.into_iter().flat_map(move |kind| self.of(sensor, stage, kind));
        for i in columns(0, 0) {
            let name = self.growth.indicators[i].name();
            let amplitude = if name.contains('_') { name.clone() } else { format!("amp_{name}") };
            head.extend([format!("{amplitude}_m_per_s2"), format!("{name}_dev_percent"), format!("{name}_rank")]);
        }
        out.write_record(&head)?;
        let ranks = RankConfig::default();
        let deviations: Vec<Vec<f64>> =
            (0..self.growth.indicators.len()).map(|i| self.growth.deviations_percent(i)).collect();
        for (k, step) in self.growth.steps.iter().enumerate() {
            for sensor in 0..sensors {
                for stage in 0..stages {
                    let pits =
                        |of: fn((usize, usize)) -> usize| step.pits.map_or_else(String::new, |p| of(p).to_string());
                    let mut row = vec![
                        step.hours.to_string(),
                        self.days(step.hours).to_string(),
                        step.size.to_string(),
                        step.growing.unit().1.to_owned(),
                        pits(|p| p.0),
                        pits(|p| p.1),
                        step.parting.to_string(),
                        self.plan.bench.sensors[sensor].name.clone(),
                        self.plan.bench.stages[stage].name.clone(),
                    ];
                    for i in columns(sensor, stage) {
                        let deviation = deviations[i][k];
                        let known = |text: String| if deviation.is_finite() { text } else { String::new() };
                        row.push(step.values[i].to_string());
                        row.push(known(deviation.to_string()));
                        row.push(known(ranks.rank_of(deviation).code().to_owned()));
                    }
                    out.write_record(&row)?;
                }
            }
        }
        Ok(out.flush()?)
    }

    /// Everything, with the merits.
    pub fn object(&self) -> Value {
        let finite = |value: f64| if value.is_finite() { json!(value) } else { Value::Null };
        let law: serde_json::Map<String, Value> =
            constants(self.plan).map(|(constant, value)| (constant.name.to_owned(), json!(value))).collect();
        let steps = self.growth.steps.iter().map(|step| {
            json!({ "hours": step.hours, "days": self.days(step.hours), "size": step.size, "parting": step.parting,
                "pits": step.pits.map(|p| p.0), "pitted_teeth": step.pits.map(|p| p.1) })
        });
        let indicators = self.growth.indicators.iter().enumerate().map(|(i, indicator)| {
            let merit = &self.growth.merits[i];
            json!({ "indicator": indicator.name(), "stage": self.stage(indicator), "channel": self.sensor(indicator),
                "amplitudes_m_per_s2": self.growth.values(i),
                "deviations_percent": self.growth.deviations_percent(i).into_iter().map(finite).collect::<Vec<_>>(),
                "sigma_m_per_s2": self.growth.sigmas[i], "first_hours": merit.first_hours, "first_size": merit.first_size,
                "rank_v_hours": merit.rank_v_hours, "warning_hours": merit.warning_hours })
        });
        let (name, unit) = self.growth.steps[0].growing.unit();
        json!({ "format": "gearwatch-growth/1", "bench": self.plan.bench.name, "effect": self.plan.effect.effect,
            "where": self.plan.effect.place, "law": law, "size": name, "size_unit": unit,
            "measured": { "motor_speed_hz": self.plan.measured.motor_hz, "brake_torque_nm": self.plan.measured.torque_nm },
            "duties": self.plan.duties.iter().map(|duty| json!({ "motor_speed_hz": duty.motor_hz,
                "brake_torque_nm": duty.torque_nm, "share": duty.share })).collect::<Vec<_>>(),
            "seed": self.plan.seed, "hours_a_day": self.hours_a_day,
            "limit": self.growth.limit.as_ref().map(|(at, what)| json!({ "hours": at, "what": what })),
            "ended": self.growth.ended.map(|(end, at)| json!({ "hours": at, "why": end.words() })),
            "remarks": self.growth.remarks, "steps": steps.collect::<Vec<_>>(),
            "indicators": indicators.collect::<Vec<_>>() })
    }
}
