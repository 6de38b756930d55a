//! From what was measured in a window, or averaged over many, to the verdict.

use std::fmt::Write;

use serde::{Deserialize, Serialize};

use crate::aggregate::Average;
use crate::analysis::{StageAnalysis, WindowAnalysis};
use crate::baseline::{Baseline, Place, ScatterPrior, Surface};
use crate::deviation::{Deviation, Observed};
use crate::doubts::Doubts;
use crate::estimate::Estimate;
use crate::rank::RankConfig;
use crate::signature::{SignatureTable, Signatures};
use crate::state::{Path, StateConfig};
use crate::verdict::{
    HARMONICS, HarmonicVerdict, InstrumentState, MachineState, NEAREST_STATES, Reason, StageIndicators, StateFit,
    Verdict,
};

/// How windows are judged.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct JudgeConfig {
    /// Rank steps.
    pub rank: RankConfig,
    /// How sure the machine's state must be.
    pub state: StateConfig,
}

/// Why a baseline cannot judge a pipeline.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum JudgeError {
    /// A value of the configuration is unusable.
    #[error("{0}")]
    Config(String),
    /// The stages are not those of the baseline.
    #[error("the baseline knows the stages {baseline:?}, but the bench has {bench:?}")]
    Stages {
        /// Of the baseline.
        baseline: Vec<String>,
        /// Of the bench.
        bench: Vec<String>,
    },
}

/// Judges windows by a baseline. Immutable; [`Judge::judge`] is a pure function of window and
/// judge.
#[derive(Clone, Debug)]
pub struct Judge {
    config: JudgeConfig,
    stages: Vec<String>,
    /// Stages whose states no table knows, by position; empty where all are of one kind.
    without_states: Vec<bool>,
    normal: Option<Surface>,
    signatures: Signatures,
    doubts: Doubts,
}

/// What was measured of a line and of the floor beside it.
type Pair = (Option<Observed>, Option<Observed>);

impl Judge {
    /// For a pipeline with these stages, in its order; without a baseline every rank is unknown.
    ///
    /// # Errors
    /// When the configuration is unusable, or the stages are not those of the baseline.
    pub fn new(
        config: JudgeConfig,
        stages: Vec<String>,
        baseline: Option<&Baseline>,
        signatures: SignatureTable,
    ) -> Result<Self, JudgeError> {
        if let Some(problem) = config.rank.problem().or(config.state.problem()) {
            return Err(JudgeError::Config(problem));
        }
        let normal = baseline.map(Surface::new);
        if let Some(baseline) = baseline.filter(|b| b.stages != stages) {
            return Err(JudgeError::Stages { baseline: baseline.stages.clone(), bench: stages });
        }
        Ok(Self {
            config,
            stages,
            without_states: Vec::new(),
            normal,
            signatures: Signatures::Everywhere(signatures),
            doubts: Doubts::default(),
        })
    }

    /// Compares with other states from now on.
    pub fn set_signatures(&mut self, signatures: Signatures) {
        self.signatures = signatures;
    }

    /// Leaves the stages that are marked uncompared with states: those of the paper, and of the
    /// simulator, are of spur pairs.
    pub fn leave_states(&mut self, marked: Vec<bool>) {
        self.without_states = marked;
    }

    /// The doubts that verdicts carry; setting them holds for all that share this judge.
    pub fn doubts(&self) -> &Doubts {
        &self.doubts
    }

    /// Another judge of the same kind may carry other doubts.
    pub fn doubt_anew(&mut self) {
        self.doubts = Doubts::default();
    }

    /// The states that verdicts are matched with.
    pub fn signatures(&self) -> &Signatures {
        &self.signatures
    }

    /// Judges one window: one verdict for each stage, in order. Verdicts already in `out` are
    /// overwritten and their buffers used again, so that after the first windows nothing is
    /// allocated.
    pub fn judge(&self, window: &WindowAnalysis, out: &mut Vec<Verdict>) {
        let observed = |_: usize, stage: &StageAnalysis, harmonic: usize| -> Pair {
            let line = stage.harmonics[harmonic];
            let known = line.amplitude.is_known() && line.amplitude.value > 0.0;
            let floor = line.floor.is_finite() && line.floor > 0.0;
            (
                known.then(|| Observed::Window {
                    ln: line.amplitude.value.ln(),
                    noise: line.amplitude.sigma / line.amplitude.value,
                }),
                // How far a floor scatters is known from the baseline alone.
                floor.then(|| Observed::Window { ln: line.floor.ln(), noise: 0.0 }),
            )
        };
        self.judge_stages(window, 1, &observed, out);
    }

    /// Judges an average over windows of one channel at one operating point.
    pub fn judge_average(&self, average: &Average, out: &mut Vec<Verdict>) {
        let observed = |stage: usize, _: &StageAnalysis, harmonic: usize| average.observed(stage, harmonic);
        self.judge_stages(&average.analysis, average.windows, &observed, out);
    }

    fn judge_stages(
        &self,
        window: &WindowAnalysis,
        windows: u32,
        observed: &dyn Fn(usize, &StageAnalysis, usize) -> Pair,
        out: &mut Vec<Verdict>,
    ) {
        out.resize_with(self.stages.len().min(window.stages.len()), blank);
        let torque = Some(window.operating_point.brake_torque_nm).filter(|t| t.is_finite());
        let place = match &self.normal {
            _ if window.instrument != InstrumentState::Ok => Err(Reason::Instrument),
            None => Err(Reason::NoBaseline),
            Some(normal) => match normal.unit(&window.sensor) {
                None => Err(Reason::ChannelNotInBaseline),
                Some(unit) if *unit != *window.unit => Err(Reason::OtherUnit),
                Some(_) => normal.locate(window.input_speed_hz.value, torque).ok_or_else(|| match torque {
                    None if normal.knows_torque() => Reason::TorqueMissing,
                    _ => Reason::OutsideBaseline,
                }),
            },
        };
        let deviations = |index: usize, normal: &Surface, place: &Place| {
            let pairs = std::array::from_fn(|harmonic| observed(index, &window.stages[index], harmonic));
            StageDeviations::new(&pairs, normal, place, &window.sensor, index)
        };
        // The path belongs to the sensor: lines of all stages speak of it, a line that two of them
        // share only once.
        let mut path = Path::default();
        if let (Ok(place), Some(normal)) = (&place, &self.normal) {
            for (index, stage) in window.stages.iter().enumerate().take(out.len()) {
                let StageDeviations { mut lines, mut floors, .. } = deviations(index, normal, place);
                for harmonic in (0..HARMONICS).filter(|&h| index > 0 && stage.shared[h]) {
                    (lines[harmonic], floors[harmonic]) = (None, None);
                }
                path.add(&self.config.rank, &lines, &floors);
            }
        }
        for (index, verdict) in out.iter_mut().enumerate() {
            self.describe(verdict, index, window, windows);
            match (&place, &self.normal) {
                (Ok(place), Some(normal)) => {
                    normal.write_name(place, &mut verdict.cell);
                    let with_states = !self.without_states.get(index).copied().unwrap_or(false);
                    self.compare(verdict, &deviations(index, normal, place), &path, with_states);
                    if let Some(indicators) = &mut verdict.indicators {
                        indicators.compare(index, &|position| normal.indicator(place, &window.sensor, position));
                    }
                }
                (Err(reason), _) => verdict.reason = *reason,
                (Ok(_), None) => verdict.reason = Reason::NoBaseline,
            }
        }
    }

    /// Everything that is known without a baseline.
    fn describe(&self, verdict: &mut Verdict, index: usize, window: &WindowAnalysis, windows: u32) {
        overwrite(&mut verdict.stage, &self.stages[index]);
        overwrite(&mut verdict.channel, &window.sensor);
        overwrite(&mut verdict.unit, &window.unit);
        verdict.cell.clear();
        verdict.window = window.window;
        verdict.t0 = window.t0;
        verdict.first_sample_index = window.first_sample_index;
        verdict.samples = window.samples;
        verdict.input_speed_hz = window.input_speed_hz;
        verdict.mesh_hz = window.stages[index].mesh_hz;
        verdict.brake_torque_nm = window.operating_point.brake_torque_nm;
        verdict.machine = MachineState::Unknown;
        verdict.instrument = window.instrument;
        verdict.resolvable = false;
        verdict.reason = Reason::None;
        verdict.doubts.clone_from(self.doubts.words());
        verdict.windows = windows;
        verdict.baseline_sessions = 0;
        verdict.state_fit = StateFit::NotCompared;
        verdict.states.clear();
        verdict.indicators = StageIndicators::of(&window.indicators, index);
        let stage = &window.stages[index];
        for (k, harmonic) in verdict.harmonics.iter_mut().enumerate() {
            let line = &stage.harmonics[k];
            *harmonic = HarmonicVerdict {
                amplitude: line.amplitude,
                floor: line.floor,
                shared: stage.shared[k],
                ..HarmonicVerdict::UNKNOWN
            };
        }
    }

    fn compare(&self, verdict: &mut Verdict, deviations: &StageDeviations, path: &Path, with_states: bool) {
        if deviations.lines.iter().all(Option::is_none) {
            verdict.reason = Reason::BaselineTooSmall;
            return;
        }
        verdict.baseline_sessions = deviations.sessions;
        for (harmonic, judged) in verdict.harmonics.iter_mut().enumerate() {
            judged.baseline = deviations.normal[harmonic];
            if let Some(deviation) = &deviations.lines[harmonic] {
                judged.deviation_percent = deviation.percent();
                judged.rank = self.config.rank.rank_of(judged.deviation_percent.value);
                judged.rank_probability = self.config.rank.rank_probability(judged.deviation_percent);
            }
        }
        verdict.machine = self.config.state.machine(&self.config.rank, &deviations.lines, path);
        let judged = |h: &&HarmonicVerdict| h.deviation_percent.is_known();
        verdict.resolvable = verdict.harmonics.iter().filter(judged).all(|h| h.rank_probability > 0.5);
        if verdict.machine == MachineState::Unknown {
            let torn = self.config.state.is_path_or_gear(&self.config.rank, &deviations.lines, path);
            verdict.reason = if torn { Reason::PathOrGear } else { Reason::NotResolved };
        }
        if with_states && verdict.machine != MachineState::PathChanged {
            let percents: [Estimate; HARMONICS] = std::array::from_fn(|h| verdict.harmonics[h].deviation_percent);
            let table = self.signatures.of(verdict);
            verdict.state_fit = table.map_or(StateFit::NotCompared, |table| {
                table.compare(&self.config.rank, &percents, &mut verdict.states)
            });
        }
    }
}

/// How far the lines and floors of one stage at one sensor lie from normal; none where that is not
/// known.
struct StageDeviations {
    lines: [Option<Deviation>; HARMONICS],
    floors: [Option<Deviation>; HARMONICS],
    /// Normal amplitudes, `NaN` where not known.
    normal: [f64; HARMONICS],
    /// Sessions behind the least known line.
    sessions: u32,
}

impl StageDeviations {
    fn new(observed: &[Pair; HARMONICS], normal: &Surface, place: &Place, sensor: &str, stage: usize) -> Self {
        let (line_prior, floor_prior) =
            normal.priors(sensor, stage).unwrap_or((ScatterPrior::NONE, ScatterPrior::NONE));
        let mut out = Self {
            lines: [None; HARMONICS],
            floors: [None; HARMONICS],
            normal: [f64::NAN; HARMONICS],
            sessions: u32::MAX,
        };
        for (harmonic, &(line, floor)) in observed.iter().enumerate() {
            if let (Some(line), Some(reference)) = (line, normal.line(place, sensor, stage, harmonic)) {
                let deviation = Deviation::new(line, &reference, line_prior);
                out.normal[harmonic] = reference.ln.exp();
                if deviation.percent().is_known() {
                    out.lines[harmonic] = Some(deviation);
                    out.sessions = out.sessions.min(reference.sessions);
                }
            }
            if let (Some(floor), Some(reference)) = (floor, normal.floor(place, sensor, stage, harmonic)) {
                out.floors[harmonic] = Some(Deviation::new(floor, &reference, floor_prior));
            }
        }
        out
    }
}

fn overwrite(target: &mut String, text: &str) {
    target.clear();
    target.push_str(text);
}

/// A verdict that says nothing, with room for what it will say.
fn blank() -> Verdict {
    let mut cell = String::new();
    // Room for the longest name of a cell.
    let _ = write!(cell, "{:80}", "");
    Verdict {
        cell,
        states: Vec::with_capacity(NEAREST_STATES),
        instrument: InstrumentState::Ok,
        windows: 0,
        ..Verdict::blank()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::aggregate::Aggregate;
    use crate::baseline::{BaselineConfig, FORMAT, Learner, Origin};
    use crate::testing::{Random, window};
    use crate::verdict::Rank;

    const NORMAL: [f64; HARMONICS] = [5.0, 3.0, 2.0, 1.0, 0.5];
    const FLOORS: [f64; HARMONICS] = [0.05, 0.03, 0.02, 0.01, 0.01];

    fn draw(level: &[f64; HARMONICS], scatter: f64, random: &mut Random) -> [f64; HARMONICS] {
        level.map(|a| a * (scatter * random.normal()).exp())
    }

    fn learned(count: u64, scatter: f64, random: &mut Random) -> Baseline {
        let mut learner = Learner::new(BaselineConfig::default());
        for n in 0..count {
            let floors = draw(&FLOORS, 0.1, random);
            learner.push(&window(n, 30.0, 50.0, draw(&NORMAL, scatter, random), floors));
        }
        let origin = Origin { session: "s".into(), mounting: "m".into(), recording: "r".into() };
        Baseline {
            format: FORMAT.into(),
            bench: "test".into(),
            bench_sha256: String::new(),
            machine: None,
            history: Vec::new(),
            window_s: 1.0,
            rank_steps_percent: RankConfig::default().steps_percent,
            config: BaselineConfig::default(),
            stages: vec!["stage1".into()],
            runs: learner.finish(&origin).expect("windows"),
        }
    }

    fn judge(baseline: Option<&Baseline>) -> Judge {
        let stages = vec!["stage1".to_owned()];
        Judge::new(JudgeConfig::default(), stages, baseline, SignatureTable::paper()).expect("a judge")
    }

    fn verdict(judge: &Judge, window: &WindowAnalysis) -> Verdict {
        let mut out = Vec::new();
        judge.judge(window, &mut out);
        assert_eq!(out.len(), 1);
        out.remove(0)
    }

    /// A baseline of twelve windows with a kurtosis of 3 that scatters by 3 %: one of 4 deviates by
    /// 33 %, within four of the stated sigmas and more than four of them from nothing; an FM4 that
    /// the baseline never saw has no deviation.
    #[test]
    fn analytic_indicators_have_baseline_and_deviation() {
        let mut random = Random(11);
        let mut with = |number: u64, kurtosis: f64| {
            let mut window = window(number, 30.0, 50.0, draw(&NORMAL, 0.02, &mut random), FLOORS);
            window.indicators.clear(1, 0);
            window.indicators.channel[3] = Estimate::new(kurtosis * (0.03 * random.normal()).exp(), 0.01);
            window
        };
        let mut learner = Learner::new(BaselineConfig::default());
        (0..12).for_each(|n| learner.push(&with(n, 3.0)));
        let origin = Origin { session: "s".into(), mounting: "m".into(), recording: "r".into() };
        let mut baseline = learned(12, 0.02, &mut Random(1));
        baseline.runs = learner.finish(&origin).expect("windows");
        let mut window = with(20, 4.0);
        window.indicators.gears[0][0].values[1] = Estimate::new(3.0, 0.1);
        let found = verdict(&judge(Some(&baseline)), &window).indicators.expect("indicators");
        let Estimate { value, sigma } = found.channel_normal[3].deviation_percent;
        assert!((found.channel_normal[3].baseline / 3.0 - 1.0).abs() < 0.04, "{found:?}");
        assert!((value - 100.0 / 3.0).abs() < 4.0 * sigma && value > 4.0 * sigma, "{value} ± {sigma}");
        assert!(!found.gears_normal[0][1].deviation_percent.is_known());
    }

    /// 400 baselines of 12 windows each judge 10 further windows of the same machine: called
    /// deviating or worse in at most the stated 1 % (binomial, 4 standard errors above: 1.6 %), and
    /// nearly all the rest is not resolved or normal.
    #[test]
    fn oracle_false_alarms_are_as_rare_as_stated() {
        let mut random = Random(31);
        let (mut alarms, mut ranked, mut total) = (0, 0, 0);
        for _ in 0..400 {
            let judge = judge(Some(&learned(12, 0.06, &mut random)));
            for n in 0..10 {
                let floors = draw(&FLOORS, 0.1, &mut random);
                let found = verdict(&judge, &window(n, 30.0, 50.0, draw(&NORMAL, 0.06, &mut random), floors));
                alarms += u32::from(!matches!(found.machine, MachineState::Normal | MachineState::Unknown));
                ranked += u32::from(found.harmonics[0].rank != Rank::Zero);
                total += 1;
                assert_eq!(found.baseline_sessions, 1);
            }
        }
        assert!(f64::from(alarms) < 0.016 * f64::from(total), "{alarms} of {total}");
        // The naked rank of the same windows is above 0 nearly always, which is why it is not the
        // machine's state.
        assert!(f64::from(ranked) > 0.8 * f64::from(total), "{ranked} of {total}");
    }

    /// A machine that scatters by 6 % and moved by 8.5 % (rank III is 7 to 10 %): one window cannot
    /// resolve the rank, the average over 400 can, sigma 6 %/√400 = 0.3 % and 0.3 % of the
    /// baseline.
    #[test]
    fn analytic_an_average_resolves_what_a_window_cannot() {
        let mut random = Random(32);
        let judge = judge(Some(&learned(400, 0.06, &mut random)));
        let moved = NORMAL.map(|a| 1.085 * a);
        let mut aggregate = Aggregate::new(BaselineConfig::default());
        let mut resolvable = 0;
        for n in 0..400 {
            let window = window(n, 30.0, 50.0, draw(&moved, 0.06, &mut random), draw(&FLOORS, 0.1, &mut random));
            resolvable += u32::from(verdict(&judge, &window).resolvable);
            aggregate.push(&window);
        }
        assert!(resolvable < 8, "{resolvable} of 400 windows");
        let averages = aggregate.finish();
        assert_eq!((averages.len(), averages[0].windows), (1, 400));
        let mut out = Vec::new();
        judge.judge_average(&averages[0], &mut out);
        let found = &out[0];
        assert_eq!((found.machine, found.windows, found.resolvable), (MachineState::Deviating, 400, true), "{found:?}");
        for harmonic in &found.harmonics {
            assert_eq!(harmonic.rank, Rank::III);
            assert!(harmonic.rank_probability > 0.9, "{harmonic:?}");
            assert!((0.003..0.008).contains(&(harmonic.deviation_percent.sigma / 100.0)), "{harmonic:?}");
            assert!((harmonic.deviation_percent.value - 8.5).abs() < 4.0 * harmonic.deviation_percent.sigma);
        }
    }

    #[test]
    fn conform_unknown_is_never_normal() {
        let mut random = Random(33);
        let baseline = learned(20, 0.05, &mut random);
        let sound = window(0, 30.0, 50.0, NORMAL, FLOORS);
        let reasons = |judge: &Judge, window: &WindowAnalysis, reason: Reason| {
            let found = verdict(judge, window);
            assert_eq!((found.machine, found.reason), (MachineState::Unknown, reason));
            assert!(
                found.harmonics.iter().all(|h| h.rank == Rank::Unknown && h.rank_probability.is_nan()),
                "{found:?}"
            );
            assert!(!found.resolvable && found.states.is_empty() && found.state_fit == StateFit::NotCompared);
            assert_eq!(found.harmonics[0].amplitude.value, 5.0, "what was measured is still said");
        };
        let with = judge(Some(&baseline));
        assert_eq!(verdict(&with, &sound).machine, MachineState::Normal);
        reasons(&judge(None), &sound, Reason::NoBaseline);
        for instrument in [InstrumentState::Overload, InstrumentState::FlatLine, InstrumentState::ClockTrouble] {
            reasons(&with, &WindowAnalysis { instrument, ..sound.clone() }, Reason::Instrument);
        }
        reasons(&with, &window(0, 31.0, 50.0, NORMAL, FLOORS), Reason::OutsideBaseline);
        reasons(&with, &window(0, 30.0, 60.0, NORMAL, FLOORS), Reason::OutsideBaseline);
        reasons(&with, &window(0, 30.0, f64::NAN, NORMAL, FLOORS), Reason::TorqueMissing);
        reasons(&judge(Some(&learned(1, 0.05, &mut random))), &sound, Reason::BaselineTooSmall);
        let mut elsewhere = baseline.clone();
        let channel = elsewhere.runs[0].channels.remove("acc").expect("acc");
        elsewhere.runs[0].channels.insert("other".into(), channel);
        reasons(&judge(Some(&elsewhere)), &sound, Reason::ChannelNotInBaseline);
        let mut volts = baseline.clone();
        volts.runs[0].channels.get_mut("acc").expect("acc").unit = "V".into();
        reasons(&judge(Some(&volts)), &sound, Reason::OtherUnit);
        // A verdict that is used again keeps nothing of the one before.
        let mut out = vec![verdict(&with, &sound)];
        judge(None).judge(&sound, &mut out);
        assert_eq!(
            format!("{:?}", out[0]),
            format!("{:?}", verdict(&judge(None), &sound)),
            "NaN is not equal to itself"
        );
    }

    #[test]
    fn conform_a_baseline_of_other_stages_is_refused() {
        let mut random = Random(34);
        let baseline = learned(5, 0.05, &mut random);
        let make = |baseline: &Baseline, stages: &[&str]| {
            let stages = stages.iter().map(|s| (*s).to_owned()).collect();
            Judge::new(JudgeConfig::default(), stages, Some(baseline), SignatureTable::paper())
        };
        assert!(make(&baseline, &["first"]).expect_err("other stages").to_string().contains("\"first\""));
    }
}
