//! Where the mesh lines lie, against where tacho, stated speed and sheet put them; and what
//! explains the difference.

use gearwatch_core::baseline::Baseline;
use gearwatch_core::bench::Bench;
use gearwatch_core::train::Train;

use crate::comb::CombField;
use crate::dsp::Transforms;
use crate::integrity;
use crate::kinematics;
use crate::look::LookRun;
use crate::sheet::FAST_MOTOR_HZ;
use crate::slip;
use crate::steady::Steady;
use crate::{Finding, Look, Severity, channels};

/// Mean log excess of a comb from which it meets lines, as in the reading of recordings: noise
/// alone reaches 1.3 at the best of some hundred speeds.
const FITS: f64 = 1.6;
/// What another explanation must gain over the sheet's where the sheet's fits, and score by itself
/// where it does not.
const GAIN: f64 = 2.0;
const SURE: f64 = FITS + 1.0;
/// Reaches about an expected speed (relative): a tacho by its sample clock, a display without a
/// belt, a belt's slip, a nominal speed with load.
const TACHO: f64 = 0.015;
const DISPLAY: f64 = 0.01;
const BELT: f64 = 0.04;
const NOMINAL: f64 = 0.08;
/// Slip of an induction motor at full load, at most (relative): design B of NEMA MG 1. A stated
/// speed without a tacho is that of the field, not of the shaft.
const MOST_SLIP: f64 = 0.05;
/// An offset between tacho and lines from which the sample rate is in doubt: clocks are off by some
/// 10⁻⁵.
const CLOCK: f64 = 2e-3;
/// Between the rate that a recording states and that of the sheet nothing decides beforehand: the
/// lines do, by so many nats a line, five for a comb of ten.
const DECIDES: f64 = 0.5;
/// Motor speeds below this are no rpm: no motor turns less than once a second.
const LEAST_RPM: f64 = 60.0;
/// Ratios are taken for a whole number or another shaft within this (relative).
const SAME: f64 = 5e-3;
/// Fewest revolutions of the input shaft, and lines of the comb within the band, by which a speed
/// is judged.
const REVOLUTIONS: f64 = 20.0;
const LEAST_LINES: usize = 3;
/// Share of the sample rate up to which lines are counted: below the usual anti-alias corner.
const USABLE_BAND: f64 = 0.45;
/// A speed that moves by more is a run-up, whose lines are smeared (relative).
const RUN_UP: f64 = 0.02;
/// Samples of the field over which all speeds are tried (s).
const WIDE_S: f64 = 4.0;

/// Where the expected speed came from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum From {
    Tacho,
    Stated,
    Nominal,
}

/// The lines of one recording.
pub(crate) struct Heard<'a> {
    pub(crate) look: &'a Look,
    pub(crate) steady: Steady<'a, LookRun>,
    pub(crate) field: CombField,
    /// Channels that do not show the lines that the others show, and how well the sheet's comb fits
    /// each of them.
    blind: Vec<(&'a str, f64)>,
    /// Expected input-shaft speed (Hz), and how far it may be off (relative).
    pub(crate) expected_hz: f64,
    reach: f64,
    from: From,
    /// Where the sheet's comb fits best within that reach (Hz), and how well.
    pub(crate) input_hz: f64,
    pub(crate) score: f64,
    /// A much better explanation than the expected speed.
    other: Option<Other>,
    /// The lines lie where the slip of the motor behind the stated speed puts them, and not at the
    /// stated speed.
    pub(crate) slips: bool,
    /// How well the sheet's comb fits at the stated speed itself.
    pub(crate) stated_score: f64,
    /// What lines gain if the recording was made at the sheet's rate, where it states another (nats
    /// a line).
    rate_gain: Option<f64>,
}

/// Another explanation of where the lines lie.
#[derive(Clone, Debug)]
struct Other {
    cause: Cause,
    input_hz: f64,
    score: f64,
}

#[derive(Clone, Debug)]
enum Cause {
    /// Stated, or nominal, in rpm.
    Rpm(f64),
    /// The recording was made at the sheet's rate (Hz).
    Rate(f64),
    /// As if the motor drove the input shaft directly, or by another ratio.
    Belt(f64),
    /// Pulses per revolution.
    Pulses(f64),
    /// The tacho sits on another shaft.
    Shaft(String),
    /// None of these: another speed.
    Speed,
}

impl Heard<'_> {
    /// The sheet's lines are where they are expected.
    pub(crate) fn is_settled(&self) -> bool {
        self.score >= FITS && self.other.is_none()
    }

    /// Tacho and lines agree as clocks do, or there is no tacho to contradict.
    pub(crate) fn clock_is_settled(&self) -> bool {
        self.from != From::Tacho || self.score < FITS || (self.input_hz / self.expected_hz - 1.0).abs() <= CLOCK
    }

    /// Something other than teeth explains where the lines lie.
    pub(crate) fn is_explained(&self) -> bool {
        self.other.as_ref().is_some_and(|other| !matches!(other.cause, Cause::Speed))
    }
}

/// Looks for the lines of every recording that is steady and long enough.
pub(crate) fn hear<'a>(bench: &Bench, looks: &'a [Look]) -> Vec<Heard<'a>> {
    let train = Train::new(bench);
    let mut transforms = Transforms::default();
    looks.iter().filter_map(|look| hear_one(bench, &train, look, &mut transforms)).collect()
}

fn hear_one<'a>(bench: &Bench, train: &Train, look: &'a Look, transforms: &mut Transforms) -> Option<Heard<'a>> {
    let steady = steady(bench, look)?;
    let (mut heard, each) = hear_all(bench, train, look, steady, transforms)?;
    heard.blind = blind(train, &heard, each, transforms);
    Some(heard)
}

/// The lines of all channels together; beside them the comb field of each alone.
fn hear_all<'a>(
    bench: &Bench,
    train: &Train,
    look: &'a Look,
    steady: Steady<'a, LookRun>,
    transforms: &mut Transforms,
) -> Option<(Heard<'a>, Vec<CombField>)> {
    let (expected_hz, reach, from) = expected(bench, train, &steady);
    let shortest = steady.channels.iter().map(|c| c.2.samples.len()).min().unwrap_or(0);
    let seconds = shortest as f64 / steady.sample_rate_hz;
    // A speed that is stated sixty times too high must not make a recording look long enough.
    let slowest = if from == From::Tacho { expected_hz } else { expected_hz.min(FAST_MOTOR_HZ / train.motor_order) };
    if seconds * slowest < REVOLUTIONS || seconds < 1.0 {
        return None;
    }
    let (field, each) = CombField::with_each(transforms, &steady.signals(), steady.sample_rate_hz);
    let (input_hz, score) = best(train, &field, &steady, expected_hz, reach).unwrap_or((expected_hz, 0.0));
    let (other, slips, stated_score) = (None, false, score);
    let mut heard = Heard {
        look,
        steady,
        field,
        blind: Vec::new(),
        expected_hz,
        reach,
        from,
        input_hz,
        score,
        other,
        slips,
        stated_score,
        rate_gain: None,
    };
    if let Some((rate, sheet)) = channels::other_rate(bench, look) {
        // At twice the true rate all lines seem to lie at twice their frequency. A motor slips at
        // either.
        let slip = if from == From::Stated && bench.belt.is_none() { MOST_SLIP } else { reach };
        // At half the frequency the comb of the mesh lines meets sidebands, which may be as high;
        // those of all shafts it meets no longer.
        let orders = kinematics::deciding_orders(train);
        let at = |hz: f64| heard.field.search(&orders, hz * (1.0 - slip), hz * (1.0 + reach));
        let ((_, as_stated), (hz, at_sheet)) = (at(expected_hz), at(expected_hz * rate / sheet));
        heard.rate_gain = Some(at_sheet - as_stated);
        let lines = best(train, &heard.field, &heard.steady, hz, SAME).map_or(0.0, |(_, score)| score);
        if at_sheet > as_stated + DECIDES && lines > FITS {
            heard.other = Some(Other { cause: Cause::Rate(sheet), input_hz: hz, score: lines });
            return Some((heard, each));
        }
    }
    heard.other = self::other(bench, train, &heard, transforms);
    if from == From::Stated && bench.belt.is_none() && !heard.is_explained() {
        heard.slip(train);
    }
    Some((heard, each))
}

impl Heard<'_> {
    /// Takes the lines where the slip of the motor puts them, if more of them are there than at the
    /// stated speed: slip is what such a motor does, and nothing speaks against it beforehand.
    fn slip(&mut self, train: &Train) {
        let middle = self.expected_hz * (1.0 - 0.5 * (self.reach + MOST_SLIP));
        let behind = best(train, &self.field, &self.steady, middle, 0.5 * (MOST_SLIP - self.reach));
        let Some((input_hz, score)) = behind.filter(|(_, score)| *score > self.score.max(FITS)) else { return };
        if self.other.as_ref().is_none_or(|other| other.score <= score + GAIN) {
            (self.input_hz, self.score, self.slips, self.other) = (input_hz, score, true, None);
        }
    }
}

/// The longest run of every sensor of the sheet that moves and holds numbers; `None` for run-ups
/// and where there is none.
fn steady<'a>(bench: &Bench, look: &'a Look) -> Option<Steady<'a, LookRun>> {
    let recording = &look.recording;
    let mut channels: Vec<(&str, &str, &_)> = Vec::new();
    let mut rate = f64::NAN;
    for sensor in &bench.sensors {
        let Some((name, channel)) = look.channels.get_key_value(&sensor.name) else { continue };
        let Some(run) = channel.runs.iter().max_by_key(|run| run.samples.len()) else { continue };
        let sound =
            run.samples.iter().all(|x| x.is_finite()) && 2 * integrity::frozen(&run.samples) <= run.samples.len();
        if sound && (channels.is_empty() || channel.sample_rate_hz == rate) {
            rate = channel.sample_rate_hz;
            channels.push((name.as_str(), &*channel.unit, run));
        }
    }
    // What a channel shows for a moment only does not shorten the others.
    let longest = channels.iter().map(|c| c.2.samples.len()).max().unwrap_or(0);
    channels.retain(|c| 2 * c.2.samples.len() >= longest);
    let speeds =
        || recording.operating_points.iter().map(|p| p.motor_speed_hz).filter(|hz| hz.is_finite() && *hz > 0.0);
    let (low, high) = speeds().fold((f64::INFINITY, 0.0_f64), |(low, high), hz| (low.min(hz), high.max(hz)));
    if channels.is_empty() || high > low * (1.0 + RUN_UP) {
        return None;
    }
    let count = speeds().count() as f64;
    // What is stated without a tacho is the speed of the field, behind which the shaft of a motor
    // lags.
    let field = bench.belt.is_none() && recording.tachos.is_empty();
    Some(Steady {
        recording,
        channels,
        sample_rate_hz: rate,
        display_motor_hz: if count > 0.0 { speeds().sum::<f64>() / count } else { f64::NAN },
        most_slip: if field { MOST_SLIP } else { 0.0 },
        brake_torque_nm: look.torques().next().unwrap_or(f64::NAN),
    })
}

/// Expected speed of the input shaft (Hz), how far it may be off, and where it is from.
fn expected(bench: &Bench, train: &Train, steady: &Steady<'_, LookRun>) -> (f64, f64, From) {
    if let Some(hz) = steady.tacho_hz(train) {
        return (hz, TACHO, From::Tacho);
    }
    let slip = if bench.belt.is_some() { BELT } else { 0.0 };
    match steady.display_motor_hz.is_finite() {
        true => (steady.display_motor_hz / train.motor_order, DISPLAY + slip, From::Stated),
        false => (train.nominal_input_hz, NOMINAL + slip, From::Nominal),
    }
}

/// The speed within reach at which the sheet's comb fits best, and its score; `None` where too few
/// of its lines lie in the band.
fn best(train: &Train, field: &CombField, steady: &Steady<'_, LookRun>, hz: f64, reach: f64) -> Option<(f64, f64)> {
    let orders = kinematics::comb_orders(train);
    let highest = USABLE_BAND * steady.sample_rate_hz;
    let inside = orders.iter().filter(|order| **order * hz < highest).count();
    let all = kinematics::speed_orders(train);
    (inside >= LEAST_LINES).then(|| field.speed(&orders, &all, hz * (1.0 - reach), hz * (1.0 + reach)))
}

/// The explanation that fits much better than the expected speed, if there is one. What has a known
/// cause goes before what has none.
fn other(bench: &Bench, train: &Train, heard: &Heard<'_>, transforms: &mut Transforms) -> Option<Other> {
    let needed = (heard.score + GAIN).max(SURE);
    let fits = |hz: f64, reach: f64| best(train, &heard.field, &heard.steady, hz, reach);
    let mut known: Vec<Other> = Vec::new();
    let mut ask = |cause: Cause, hz: f64, reach: f64| {
        if let Some((input_hz, score)) = fits(hz, reach).filter(|(_, score)| *score > needed) {
            known.push(Other { cause, input_hz, score });
        }
    };
    let motor_hz = heard.expected_hz * train.motor_order;
    if heard.from != From::Tacho && motor_hz >= LEAST_RPM {
        ask(Cause::Rpm(motor_hz), heard.expected_hz / 60.0, heard.reach.max(NOMINAL));
    }
    if heard.from != From::Tacho && bench.belt.is_some() {
        ask(Cause::Belt(1.0), motor_hz, heard.reach);
    }
    if heard.from == From::Tacho {
        let display = heard.steady.display_motor_hz;
        let hz = if display.is_finite() { display } else { bench.motor.speed_hz } / train.motor_order;
        let reach = if bench.belt.is_some() { BELT + DISPLAY } else { NOMINAL };
        if let Some((input_hz, score)) = fits(hz, reach).filter(|(_, score)| *score > needed) {
            known.push(Other { cause: tacho_cause(train, heard, input_hz), input_hz, score });
        }
    }
    let best_known = known.into_iter().max_by(|a, b| a.score.total_cmp(&b.score));
    best_known.or_else(|| anywhere(bench, train, heard, needed, transforms))
}

/// What is wrong with a tacho that says another speed than the lines.
fn tacho_cause(train: &Train, heard: &Heard<'_>, input_hz: f64) -> Cause {
    let ratio = heard.expected_hz / input_hz;
    let Some((shaft, tacho)) = heard.steady.recording.tachos.iter().next() else { return Cause::Speed };
    let own = train.shaft_order(shaft).unwrap_or(1.0);
    let mut shafts = train.shafts.clone();
    shafts.push(("motor".into(), train.motor_order));
    let other = shafts.iter().find(|(name, order)| name != shaft && (ratio * own / order - 1.0).abs() < SAME);
    if let Some((name, _)) = other {
        return Cause::Shaft(name.clone());
    }
    let pulses = tacho.pulses_per_rev * ratio;
    let whole = pulses.round();
    if whole >= 1.0 && (pulses / whole - 1.0).abs() < SAME { Cause::Pulses(whole) } else { Cause::Speed }
}

/// A speed far off at which the sheet's lines stand out clearly. At simple ratios harmonics meet
/// each other's lines.
fn anywhere(
    bench: &Bench,
    train: &Train,
    heard: &Heard<'_>,
    needed: f64,
    transforms: &mut Transforms,
) -> Option<Other> {
    let pieces: Vec<&[f32]> = heard
        .steady
        .channels
        .iter()
        .map(|c| &c.2.samples[..c.2.samples.len().min((WIDE_S * heard.steady.sample_rate_hz) as usize)])
        .collect();
    let wide = CombField::new(transforms, &pieces, heard.steady.sample_rate_hz);
    let orders = kinematics::comb_orders(train);
    let (low, high) = (heard.expected_hz * (1.0 - heard.reach), heard.expected_hz * (1.0 + heard.reach));
    let (hz, _) = [(0.2 * low, low), (high, 5.0 * high)]
        .map(|(from, to)| wide.search(&orders, from, to))
        .into_iter()
        .max_by(|a, b| a.1.total_cmp(&b.1))?;
    let ratio = hz / heard.expected_hz;
    let simple = (1..=5).any(|a| (1..=5).any(|b| (ratio * f64::from(a) / f64::from(b) - 1.0).abs() < SAME));
    // The comb of the whole recording is sharper: what stands out must stand out there too.
    let (input_hz, score) = best(train, &heard.field, &heard.steady, hz, SAME)?;
    if simple || score <= needed {
        return None;
    }
    let motor_hz = heard.expected_hz * train.motor_order;
    let by_belt = bench.belt.is_some() && heard.from == From::Stated;
    Some(Other { cause: if by_belt { Cause::Belt(motor_hz / input_hz) } else { Cause::Speed }, input_hz, score })
}

/// What does not fit, a sentence each.
pub(crate) fn findings(bench: &Bench, heard: &[Heard<'_>], baseline: Option<&Baseline>) -> Vec<Finding> {
    let train = Train::new(bench);
    let mut out = slip::findings(bench, &train, heard, baseline);
    for one in heard {
        let mut of_it = vec![];
        of_it.extend(one.other.as_ref().map(|other| explained(bench, &train, one, other)));
        if of_it.is_empty() {
            of_it.extend(clock(one));
            of_it.extend(no_lines(&train, one));
        }
        let undecided = one.rate_gain.is_some_and(|gain| gain > -DECIDES) && !one.is_explained();
        if (of_it.is_empty() || undecided)
            && let Some((rate, sheet)) = channels::other_rate(bench, one.look)
        {
            let lie = if undecided { "say nothing against it, nor for it" } else { "lie where that puts them" };
            of_it.push(finding(
                one,
                "sample_rate",
                "acquisition",
                if undecided { Severity::Doubtful } else { Severity::Note },
                format!("sampled at {rate} Hz, and the mesh lines {lie}"),
                format!("{sheet} Hz, as the bench file says"),
                "correct acquisition.sample_rate_hz of the bench file".into(),
            ));
        }
        out.append(&mut of_it);
        out.extend(deaf(one));
    }
    out
}

fn finding(
    heard: &Heard<'_>,
    id: &'static str,
    place: &str,
    severity: Severity,
    found: String,
    expected: String,
    advice: String,
) -> Finding {
    let recording = heard.look.name().to_owned();
    Finding { id, severity, recording, place: place.to_owned(), found, expected, advice }
}

impl Heard<'_> {
    /// Share by which the input shaft lags behind the stated motor speed; `None` where none is
    /// stated, or the lines are not found.
    pub(crate) fn lag(&self) -> Option<f64> {
        (self.from == From::Stated && self.is_settled()).then_some(1.0 - self.input_hz / self.expected_hz)
    }

    /// The expected speed in words.
    fn said(&self) -> String {
        let from = match self.from {
            From::Tacho => "by the tacho",
            From::Stated => "by the stated motor speed",
            From::Nominal => "by the nominal motor speed, none being stated",
        };
        format!("{:.4} Hz at the input shaft {from}", self.expected_hz)
    }
}

fn explained(bench: &Bench, train: &Train, heard: &Heard<'_>, other: &Other) -> Finding {
    let lines = format!(
        "the mesh lines are those of {:.4} Hz at the input shaft ({:.1} nats a line; at the expected speed {:.1})",
        other.input_hz, other.score, heard.score
    );
    let make = |id, place: &str, severity, advice: String| {
        finding(heard, id, place, severity, lines.clone(), heard.said(), advice)
    };
    match &other.cause {
        Cause::Rpm(motor) => {
            let hz = other.input_hz * train.motor_order;
            let (key, option) = match heard.from {
                From::Nominal => ("motor.speed_hz of the bench file", "speed_rpm"),
                _ => ("the stated motor speed", "--motor-speed with rpm behind the number"),
            };
            let advice = format!("{motor:.2} fits as rpm ({hz:.3} Hz) and not as Hz: correct {key} ({option})");
            make("speed_unit", "motor", Severity::Wrong, advice)
        }
        Cause::Rate(sheet) => make(
            "sample_rate",
            "acquisition",
            Severity::Wrong,
            format!("with the {sheet} Hz of the bench file they fit: correct the stated sample rate"),
        ),
        Cause::Belt(ratio) => {
            let stated = bench.belt.as_ref().map_or(1.0, |belt| belt.ratio);
            let advice = format!("a belt ratio of {ratio:.4} fits, the bench file says {stated}: correct belt.ratio");
            make("wrong_belt_ratio", "belt", Severity::Wrong, advice)
        }
        Cause::Pulses(pulses) => {
            let stated = heard.steady.recording.tachos.values().next().map_or(f64::NAN, |tacho| tacho.pulses_per_rev);
            let advice = format!(
                "{pulses} pulses per revolution fit, {stated} are stated: correct pulses_per_rev of recording or bench file"
            );
            make("tacho_pulses", "tacho", Severity::Wrong, advice)
        }
        Cause::Shaft(shaft) => {
            let advice = format!("a tacho on {shaft} fits: correct its shaft, or its pulses per revolution");
            make("tacho_pulses", "tacho", Severity::Wrong, advice)
        }
        Cause::Speed => make(
            "speed",
            "motor",
            Severity::Doubtful,
            "correct the stated speed, the tacho, the sample rate or the teeth".into(),
        ),
    }
}

/// Tacho and lines contradict each other by more than clocks do: one of them does not count
/// seconds.
fn clock(heard: &Heard<'_>) -> Option<Finding> {
    let ratio = heard.input_hz / heard.expected_hz;
    (!heard.clock_is_settled()).then(|| {
        let rate = heard.steady.sample_rate_hz / ratio;
        finding(
            heard,
            "sample_rate",
            "acquisition",
            Severity::Doubtful,
            format!("the mesh lines lie {:+.2} % off where the tacho puts them", 100.0 * (ratio - 1.0)),
            format!("less than {} %", 100.0 * CLOCK),
            format!("a sample rate of {rate:.1} Hz fits: correct the stated rate, or the clock of the tacho"),
        )
    })
}

fn no_lines(train: &Train, heard: &Heard<'_>) -> Option<Finding> {
    (heard.score < FITS).then(|| {
        let (low, high) = (heard.expected_hz * (1.0 - heard.reach), heard.expected_hz * (1.0 + heard.reach));
        let expected: Vec<String> = train
            .stages
            .iter()
            .map(|s| format!("{} at {:.1} to {:.1} Hz", s.name, s.mesh_order * low, s.mesh_order * high))
            .collect();
        finding(
            heard,
            "no_mesh_lines",
            "all channels",
            Severity::Doubtful,
            format!("no mesh lines where they should be ({:.1} nats a line; noise alone reaches 1.3)", heard.score),
            format!("{}, {}", expected.join(", "), heard.said()),
            "check speed, tacho, sample rate, teeth, and whether the machine turned".into(),
        )
    })
}

/// Channels that do not show what the others show, and the score of each, by its own comb field.
fn blind<'a>(
    train: &Train,
    heard: &Heard<'a>,
    each: Vec<CombField>,
    transforms: &mut Transforms,
) -> Vec<(&'a str, f64)> {
    let steady = &heard.steady;
    if !heard.is_settled() || steady.channels.len() < 2 {
        return Vec::new();
    }
    let shortest = steady.channels.iter().map(|c| c.2.samples.len()).min().unwrap_or(0);
    let mut each = each.into_iter();
    let score = |(name, _, run): &(&'a str, &str, &LookRun)| {
        // What the others do not have of a channel counts for it alone.
        let field = each
            .next()
            .filter(|_| run.samples.len() == shortest)
            .unwrap_or_else(|| CombField::new(transforms, &[&run.samples[..]], steady.sample_rate_hz));
        let score = best(train, &field, steady, heard.input_hz, CLOCK).map_or(0.0, |(_, score)| score);
        (*name, score)
    };
    steady.channels.iter().map(score).filter(|(_, score)| *score < FITS).collect()
}

/// Sensors that do not hear what the others hear.
fn deaf(heard: &Heard<'_>) -> impl Iterator<Item = Finding> {
    heard.blind.iter().map(|(name, score)| {
        finding(
            heard,
            "sensor_blind",
            name,
            Severity::Doubtful,
            format!("it sees nothing of the gears ({score:.1} nats a mesh line; noise alone reaches 1.3)"),
            format!("mesh lines, as the other sensors show them at {:.3} Hz", heard.input_hz),
            "check cable, mounting and range; a sensor that cannot see the gears judges nothing".into(),
        )
    })
}
