//! The rank paper's figures 3 to 8, on the bench `paper-rig`: peak to peak and RMS of its composite
//! faults over speed and load, and bars of ranks.
//!
//! The paper gives its figures without numbers, so that trends are what can be compared. Its loads
//! of 0, 975 and 1790 are taken as pounds-inch, 0, 110 and 202 N m: as N m the largest would need 8
//! to 24 kW.

use anyhow::{Context, bail};
use gearwatch_core::bench::EffectSpec;
use gearwatch_core::one_shot::each_window;
use gearwatch_core::pipeline::{Pipeline, PipelineConfig};
use gearwatch_core::rank::RankConfig;
use gearwatch_core::verdict::InstrumentState;
use gearwatch_explain::paper::Paper;
use gearwatch_report::{Bars, Chart, Lines, Part, Report, Section, Series, Tone, render};
use gearwatch_sim::scenario::{Course, Scenario};
use gearwatch_sim::shipped;
use gearwatch_sim::signatures::{self, Conditions, Simulated};
use gearwatch_sim::source::{SimConfig, Simulator};
use rayon::prelude::*;
use serde_json::{Value, json};

use super::super::simulate::{Form, START_NS, stacked};
use crate::progress::Progress;

/// The bench, and the gear that carries the faults.
const BENCH: &str = "paper-rig";
const GEAR: &str = "stage1.pinion";
/// States of the figures, from the healthy one to the worst.
const STATES: [&str; 5] = ["normal", "compound_1", "compound_2", "compound_3", "compound_4"];
const SPEEDS_HZ: [f64; 3] = [10.0, 20.0, 30.0];
const TORQUES_NM: [f64; 3] = [0.0, 110.0, 202.0];
/// Length of each simulation (s), five windows: peak to peak of a window scatters by a percent or
/// two.
const LENGTH_S: f64 = 3.0;

/// One state at one speed and load, at the sensor beside the faulty gear.
struct Point {
    state: usize,
    speed: usize,
    torque: usize,
    /// Means over windows (m/s²).
    peak_to_peak: f64,
    rms: f64,
}

/// A claim of the paper and how often it holds here.
struct Finding {
    code: &'static str,
    holds: usize,
    of: usize,
    sentence: String,
}

/// What the figures rest on.
pub(super) struct Figures {
    points: Vec<Point>,
    findings: Vec<Finding>,
    /// Ranks of the paper's simulation and of this bench: state, level of 1x to 5x.
    paper_ranks: Vec<(String, Vec<i8>)>,
    bench_ranks: Vec<(String, Vec<i8>)>,
}

impl Figures {
    /// Simulates all states at all points.
    pub fn simulate(paper: &Paper) -> anyhow::Result<Self> {
        let bench = shipped::bench(BENCH).context("a bench that comes with the program")?;
        let pipeline = Pipeline::new(&bench, &PipelineConfig::default(), None)?;
        let sensor = bench.sensors[0].name.clone();
        let tasks: Vec<(usize, usize, usize)> = (0..TORQUES_NM.len())
            .flat_map(|torque| (0..SPEEDS_HZ.len()).map(move |speed| (torque, speed)))
            .flat_map(|(torque, speed)| (0..STATES.len()).map(move |state| (state, speed, torque)))
            .collect();
        let progress = Progress::new("points", tasks.len() as u64);
        let one = |&(state, speed, torque): &(usize, usize, usize)| -> anyhow::Result<Point> {
            let fault = EffectSpec { effect: STATES[state].into(), place: GEAR.into(), parameters: Default::default() };
            let scenario = Scenario {
                motor_speed_hz: Some(Course::Constant(SPEEDS_HZ[speed])),
                brake_torque_nm: Some(Course::Constant(TORQUES_NM[torque])),
                duration_s: Some(LENGTH_S),
                ..Scenario::default()
            };
            let effects = if state == 0 { Vec::new() } else { vec![fault] };
            let mut simulator =
                Simulator::new(SimConfig { bench: bench.clone(), effects, scenario, seed: 1, t0: START_NS })?;
            let (mut peak_to_peak, mut rms, mut count) = (0.0, 0.0, 0.0);
            each_window::<_, anyhow::Error>(&pipeline, &mut simulator, &mut |window, analysis| {
                if *analysis.sensor == *sensor && analysis.instrument == InstrumentState::Ok {
                    let samples = &window.samples;
                    let mean = samples.iter().sum::<f64>() / samples.len() as f64;
                    let square = samples.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / samples.len() as f64;
                    let ends = |(low, high): (f64, f64), &x: &f64| (low.min(x), high.max(x));
                    let (low, high) = samples.iter().fold((f64::INFINITY, f64::NEG_INFINITY), ends);
                    (peak_to_peak, rms, count) = (peak_to_peak + high - low, rms + square.sqrt(), count + 1.0);
                }
                Ok(())
            })?;
            progress.finished(STATES[state]);
            if count == 0.0 {
                bail!("{} at {} Hz, {} N m: no window", STATES[state], SPEEDS_HZ[speed], TORQUES_NM[torque]);
            }
            Ok(Point { state, speed, torque, peak_to_peak: peak_to_peak / count, rms: rms / count })
        };
        let points = tasks.par_iter().map(one).collect::<anyhow::Result<Vec<Point>>>()?;
        drop(progress);
        let conditions =
            Conditions { stage: 0, wheel: false, pits_on_all: false, motor_hz: SPEEDS_HZ[2], torque_nm: TORQUES_NM[2] };
        let bench_ranks = levels(&signatures::simulate(&bench, conditions)?.states);
        let printed = paper.recomputed.iter().find(|table| table.number == 4).context("table 4")?;
        let ranks = RankConfig::default();
        let paper_ranks = printed.rows.iter().map(|(state, cells)| {
            (state.clone(), cells.iter().map(|cell| ranks.rank_of(cell.deviation_percent).level()).collect())
        });
        let mut out = Self { points, findings: Vec::new(), paper_ranks: paper_ranks.collect(), bench_ranks };
        out.findings = out.found();
        Ok(out)
    }

    fn at(&self, state: usize, speed: usize, torque: usize) -> Option<&Point> {
        self.points.iter().find(|p| (p.state, p.speed, p.torque) == (state, speed, torque))
    }

    /// How many of some neighbouring pairs of points rise.
    fn rises(&self, pairs: impl Iterator<Item = [(usize, usize, usize); 2]>, of: fn(&Point) -> f64) -> (usize, usize) {
        let point = |(state, speed, torque): (usize, usize, usize)| self.at(state, speed, torque);
        let pairs: Vec<bool> = pairs.filter_map(|[a, b]| Some(of(point(b)?) > of(point(a)?))).collect();
        (pairs.iter().filter(|&&rises| rises).count(), pairs.len())
    }

    fn found(&self) -> Vec<Finding> {
        let all = |counts: [usize; 3]| {
            let [a, b, c] = counts;
            (0..a).flat_map(move |x| (0..b).flat_map(move |y| (0..c).map(move |z| (x, y, z))))
        };
        let peak: fn(&Point) -> f64 = |p| p.peak_to_peak;
        let loaded =
            all([4, 3, 2]).map(|(state, speed, torque)| [(state, speed, torque + 1), (state + 1, speed, torque + 1)]);
        let idle = all([4, 3, 1]).map(|(state, speed, _)| [(state, speed, 0), (state + 1, speed, 0)]);
        let severity = self.rises(loaded, peak);
        let severity_idle = self.rises(idle, peak);
        let load =
            self.rises(all([5, 3, 2]).map(|(s, speed, torque)| [(s, speed, torque), (s, speed, torque + 1)]), peak);
        let slow = self.rises(all([5, 1, 3]).map(|(s, _, torque)| [(s, 0, torque), (s, 1, torque)]), peak);
        let fast = self.rises(all([5, 1, 3]).map(|(s, _, torque)| [(s, 1, torque), (s, 2, torque)]), peak);
        let rms = self.rises(all([5, 1, 1]).map(|(s, ..)| [(s, 1, 2), (s, 2, 2)]), |p| p.rms);
        let cells = || {
            let rows = self.paper_ranks.iter().zip(&self.bench_ranks).skip(1);
            rows.flat_map(|((_, paper), (_, bench))| paper.iter().zip(bench))
        };
        let ranks = (cells().filter(|(paper, bench)| paper == bench).count(), cells().count());
        let finding = |code, (holds, of): (usize, usize), sentence| Finding { code, holds, of, sentence };
        vec![
            finding(
                "severity",
                severity,
                format!(
                    "Peak to peak grows from one degree of the composite fault to the next in {} of {} steps under load, as in the paper.",
                    severity.0, severity.1
                ),
            ),
            finding(
                "severity_idle",
                severity_idle,
                format!(
                    "Without load it does so in {} of {} steps: nothing presses the teeth together, and what is wrong with one of them hardly shows.",
                    severity_idle.0, severity_idle.1
                ),
            ),
            finding(
                "load",
                load,
                format!(
                    "It grows from one load to the next in {} of {} steps; the paper says that it grows with the load.",
                    load.0, load.1
                ),
            ),
            finding(
                "speed",
                (slow.0 + fast.0, slow.1 + fast.1),
                format!(
                    "It grows from 10 to 20 Hz in {} of {} cases and from 20 to 30 Hz in {} of {}: which mesh harmonic meets which mode decides.",
                    slow.0, slow.1, fast.0, fast.1
                ),
            ),
            finding(
                "rms_speed",
                rms,
                format!(
                    "RMS at the full load rises from 20 to 30 Hz in {} of {} states; in the paper's figure 7 it rises from 1200 to 1800 rpm. The modes of this housing, which are assumed, decide that.",
                    rms.0, rms.1
                ),
            ),
            finding(
                "ranks",
                ranks,
                format!(
                    "{} of {} ranks of figure 8 are those of this bench at 30 Hz and full load: they belong to one bench, and the paper gives neither its teeth nor its masses.",
                    ranks.0, ranks.1
                ),
            ),
        ]
    }

    /// One sentence a finding.
    pub fn sentences(&self) -> impl Iterator<Item = &str> {
        self.findings.iter().map(|finding| finding.sentence.as_str())
    }

    pub fn object(&self) -> Value {
        let points = self.points.iter().map(|p| {
            json!({ "state": STATES[p.state], "motor_speed_hz": SPEEDS_HZ[p.speed], "brake_torque_nm": TORQUES_NM[p.torque],
                "peak_to_peak_m_per_s2": p.peak_to_peak, "rms_m_per_s2": p.rms })
        });
        let findings = self.findings.iter().map(|finding| {
            json!({ "code": finding.code, "holds": finding.holds, "of": finding.of, "sentence": finding.sentence })
        });
        let ranks = |rows: &[(String, Vec<i8>)]| {
            rows.iter().map(|(state, levels)| json!({ "state": state, "levels": levels })).collect::<Vec<_>>()
        };
        json!({ "bench": BENCH, "where": GEAR, "points": points.collect::<Vec<_>>(),
            "findings": findings.collect::<Vec<_>>(),
            "figure_8": { "paper": ranks(&self.paper_ranks), "bench": ranks(&self.bench_ranks) } })
    }

    /// The text of a file of pictures.
    pub fn picture(&self, form: Form) -> anyhow::Result<String> {
        let peaks: Vec<Chart> = (0..SPEEDS_HZ.len()).map(|speed| self.by_state(speed)).collect();
        let load = self.over(
            "Figures 3 to 6: peak to peak over the load, motor at 30 Hz",
            "brake torque (N m)",
            "peak to peak (m/s²)",
            |p| (p.speed == 2).then_some((TORQUES_NM[p.torque], p.peak_to_peak)),
        );
        let speed = self.over("Figure 7: RMS over the speed of the motor, 202 N m", "motor (Hz)", "RMS (m/s²)", |p| {
            (p.torque == 2).then_some((SPEEDS_HZ[p.speed], p.rms))
        });
        let statistics = peaks.into_iter().chain([load, speed]);
        let ranks = bars(&self.paper_ranks, &self.bench_ranks).into_iter();
        match form {
            Form::Svg => stacked(&statistics.chain(ranks).collect::<Vec<_>>()),
            Form::Html => Ok(render(&Report {
                title: "The rank paper's figures 3 to 8 on the bench paper-rig".into(),
                verdict: self.sentences().collect::<Vec<_>>().join(" "),
                tone: Tone::Plain,
                sections: vec![
                    Section { heading: "Peak to peak and RMS".into(), parts: statistics.map(Part::Chart).collect() },
                    Section { heading: "Ranks".into(), parts: ranks.map(Part::Chart).collect() },
                ],
                appendix: Vec::new(),
                provenance: vec![
                    ("gearwatch".into(), env!("CARGO_PKG_VERSION").into()),
                    ("command".into(), std::env::args().collect::<Vec<_>>().join(" ")),
                ],
            })),
        }
    }

    fn by_state(&self, speed: usize) -> Chart {
        let series = TORQUES_NM.iter().enumerate().map(|(torque, nm)| {
            let value = |state| self.at(state, speed, torque).map_or(f64::NAN, |p| p.peak_to_peak);
            (format!("{nm} N m"), (0..STATES.len()).map(|state| (value(state), f64::NAN)).collect())
        });
        Chart::Bars(Bars {
            caption: format!("Figures 3 to 6: peak to peak by state, motor at {} Hz", SPEEDS_HZ[speed]),
            y_label: "peak to peak (m/s²)".into(),
            groups: STATES.map(str::to_owned).to_vec(),
            series: series.collect(),
            limits: Vec::new(),
        })
    }

    fn over(&self, caption: &str, x: &str, y: &str, of: impl Fn(&Point) -> Option<(f64, f64)>) -> Chart {
        let series = STATES.iter().enumerate().map(|(state, name)| Series {
            name: (*name).into(),
            points: self.points.iter().filter(|p| p.state == state).filter_map(&of).collect(),
        });
        Chart::Lines(Lines {
            caption: caption.into(),
            x_label: x.into(),
            y_label: y.into(),
            log_y: false,
            series: series.collect(),
            marks: Vec::new(),
        })
    }
}

/// Levels of the ranks of simulated states at the first sensor.
fn levels(states: &[Simulated]) -> Vec<(String, Vec<i8>)> {
    let ranks = RankConfig::default();
    let of = |state: &Simulated| state.deviations_percent[0].iter().map(|&d| ranks.rank_of(d).level()).collect();
    states.iter().map(|state| (state.state.name.to_owned(), of(state))).collect()
}

/// Ranks of the paper and of the bench side by side: broken, pitted and composite states, a picture
/// each.
fn bars(paper: &[(String, Vec<i8>)], bench: &[(String, Vec<i8>)]) -> Vec<Chart> {
    let kinds = [("broken teeth", "b", 1..6), ("pits", "p", 6..10), ("composite faults", "c", 10..14)];
    let picture = |(what, letter, range): (&str, &str, std::ops::Range<usize>)| {
        let (paper, bench) = (paper.get(range.clone())?, bench.get(range)?);
        let groups = paper
            .iter()
            .enumerate()
            .flat_map(|(i, (_, levels))| (1..=levels.len()).map(move |h| format!("{letter}{} {h}x", i + 1)));
        let series = |name: &str, rows: &[(String, Vec<i8>)]| {
            let values = rows.iter().flat_map(|(_, levels)| levels).map(|&level| (f64::from(level), f64::NAN));
            (name.to_owned(), values.collect())
        };
        Some(Chart::Bars(Bars {
            caption: format!(
                "Figure 8: {what} by degree and mesh harmonic, the paper's simulation and this bench at 30 Hz, 202 N m"
            ),
            y_label: "rank (0 to V)".into(),
            groups: groups.collect(),
            series: vec![series("paper", paper), series("this bench", bench)],
            limits: Vec::new(),
        }))
    };
    kinds.into_iter().filter_map(picture).collect()
}
