//! Speed of each recording and the tooth numbers that the lines themselves show.

use gearwatch_core::bench::{Bench, gearing};
use gearwatch_core::train::{StageKinematics, Train};

use crate::comb::CombField;
use crate::dsp;
use crate::steady::{Run, Steady};

/// Multiples of each shaft's speed that shafts make.
pub const SHAFT_MULTIPLES: u8 = 12;

/// Orders of the comb that finds the speed: the first mesh harmonics of every stage.
pub fn comb_orders(train: &Train) -> Vec<f64> {
    train.stages.iter().flat_map(StageKinematics::harmonic_orders).collect()
}

/// Largest change of the teeth of one gear that is tried.
const TEETH_REACH: i64 = 4;
/// How far the speed may lie from the tacho's (relative): sample clocks are better than that, and
/// where they are not, still near. While tooth numbers are in question the narrow reach holds: a
/// tooth in a hundred is a per cent.
const TACHO_REACH: f64 = 0.004;
const CLOCK_REACH: f64 = 0.01;
/// How far the speed may lie from the drive display without a belt (relative): display and sample
/// clock.
const DIRECT_REACH: f64 = 0.008;
/// How far a sample rate may be off that is told from other teeth (relative), where nothing but the
/// drive display says so: a rate that was typed in.
const RATE_REACH: f64 = 0.02;
/// Belt slip that is looked for (relative).
pub(crate) const SLIP_REACH: f64 = 0.04;
/// Gain in mean log excess of all lines, or of those that another tooth number moves, at which it
/// is believed, and how sure the latter must be (standard errors).
///
/// A comb on noise scores about 0.3, one on lines of 10 dB about 2.3: where the sheet's lines are
/// to be there is nothing, and something where the other tooth number puts them.
const TEETH_GAIN: f64 = 0.5;
const TEETH_SURE: f64 = 4.0;
/// Tooth numbers farther off than those that are tried, up to so many: nobody has them, and their
/// scores say what chance gives. The best of a dozen and a half numbers tried must lie so many of
/// their standard deviations above them: by chance once in two thousand sheets, were they normal.
pub(crate) const NOBODYS_REACH: i64 = 24;
pub(crate) const OF_NOBODY: f64 = 4.0;
/// The same where the lines that it moves speak for it as well: one number in twenty that nobody
/// has scores so much. True numbers of single recordings behind a slipping motor come to 2.0 at
/// least, one that errors of all teeth lit to 1.2.
const OF_NOBODY_MOVED: f64 = 1.645;
/// So few say nothing.
const LEAST_NOBODYS: usize = 8;
/// Lines that must move, in all recordings together.
const TEETH_LINES: usize = 8;
/// Lines nearer than this to each other (bins of the time spectrum) are not told apart: speeds
/// wander.
const APART_BINS: f64 = 6.0;

/// Mean log excess of the comb below which it meets no lines: the best of some hundred speeds on
/// noise alone reaches 1.3.
pub(crate) const LEAST_COMB: f64 = 1.6;
/// Mesh lines are those of another pinion where its comb gains so much over the bench's own, which
/// is itself no better than so much above the upper quartile of all teeth: any integer comb meets
/// the orders of a pitch error, and a mesh stands out from them.
const OTHER_BENCH: f64 = 1.0;
const NO_MESH: f64 = 0.5;
/// The same gain of the bench's own comb at another speed.
pub(crate) const OTHER_SPEED: f64 = 2.0;
/// Orders that differ by less (relative) are one, up to rounding.
const SAME_ORDER: f64 = 1e-9;
/// Teeth that are tried.
const TRIED_TEETH: std::ops::RangeInclusive<u32> = 10..=140;

/// Why a recording is not of this bench at the speed that is stated, if it is not; `train` may have
/// a tooth number that the sheet has not.
pub fn stranger(
    bench: &Bench,
    train: &Train,
    sheet: &Train,
    steady: &Steady<'_, impl Run>,
    field: &CombField,
    speed: &Speed,
) -> Option<String> {
    let name = &steady.recording.name;
    if speed.score < LEAST_COMB {
        let tacho = steady.tacho_hz(train);
        let (low, high) = range(bench, train, steady, tacho, TACHO_REACH);
        let from = match (tacho, steady.display_motor_hz.is_finite()) {
            (Some(_), _) => "the tacho",
            (None, true) => "the stated motor speed",
            (None, false) => "the nominal motor speed, none being stated,",
        };
        let expected: Vec<String> = train
            .stages
            .iter()
            .map(|s| format!("{} at {:.1} to {:.1} Hz", s.name, s.mesh_order * low, s.mesh_order * high))
            .collect();
        return Some(format!(
            "{name}: no mesh lines of this bench where {from} puts them ({}): {:.1} nats a line, noise alone reaches {LEAST_COMB}; correct speed, tacho or bench file",
            expected.join(", "),
            speed.score
        ));
    }
    if steady.tacho_hz(train).is_none()
        && let Some(hz) = other_speed(sheet, field, speed)
    {
        let said = if steady.display_motor_hz.is_finite() {
            "that are stated"
        } else {
            "of the nominal speed, none being stated"
        };
        let ratio = bench.belt.as_ref().map_or(1.0, |belt| belt.ratio);
        let stated_hz = Some(steady.display_motor_hz / ratio).filter(|hz| hz.is_finite()).unwrap_or(speed.input_hz);
        return Some(format!(
            "{name}: its mesh lines are those of {hz:.2} Hz at the input shaft, not of the {stated_hz:.2} Hz {said}; correct the speed or the bench file"
        ));
    }
    let (low, high) = (speed.input_hz * (1.0 - 1e-3), speed.input_hz * (1.0 + 1e-3));
    let comb = |order: f64| -> Vec<f64> { (1..=5).map(|h| order * f64::from(h)).collect() };
    // Sun or ring of another number of teeth alone cannot be assembled, so that the lines of a
    // planetary stage are not asked for another pinion.
    let pairs = bench.stages.iter().zip(&train.stages).filter(|(_, kinematics)| kinematics.planetary.is_none());
    for (stage, kinematics) in pairs {
        let own = field.search(&comb(kinematics.mesh_order), low, high).1;
        let mut others: Vec<(f64, u32)> = Vec::new();
        for teeth in TRIED_TEETH {
            let order = kinematics.pinion_order * f64::from(teeth);
            // Combs that share lines with a mesh of the bench say nothing, nor do those of the low
            // orders that every shaft makes.
            let shares = train.stages.iter().any(|s| {
                let ratio = |a: u8, b: u8| order * f64::from(a) / (s.mesh_order * f64::from(b));
                (1..=5).any(|a| (1..=5).any(|b| (ratio(a, b) - 1.0).abs() < 2e-3))
            });
            let of_shaft = train.shafts.iter().any(|(_, own)| {
                let multiple = (order / own).round();
                let off = (multiple * own / order - 1.0).abs();
                // Errors of a gear's teeth light every order of its shaft. Those of the pinion's
                // own are met by all numbers alike, those of another shaft by some.
                let of_another = own != &kinematics.pinion_order && off < SAME_ORDER;
                of_another || (multiple <= f64::from(SHAFT_MULTIPLES) && off < 2e-3)
            });
            if !shares && !of_shaft {
                others.push((field.search(&comb(order), low, high).1, teeth));
            }
        }
        others.sort_by(|a, b| b.0.total_cmp(&a.0));
        if let (Some(best), Some(usual)) = (others.first(), others.get(others.len() / 4))
            && best.0 > own + OTHER_BENCH
            && own < usual.0 + NO_MESH
            && stands_out(best.0, &others.iter().skip(1).map(|(score, _)| *score).collect::<Vec<_>>(), OF_NOBODY)
        {
            return Some(format!(
                "{name}: its mesh lines are those of {} teeth on the pinion of {}, the bench file says {}: another bench, or a wrong tooth number",
                best.1, stage.name, stage.pinion.teeth
            ));
        }
    }
    None
}

/// A speed far off at which the sheet's comb meets lines that are far higher.
fn other_speed(sheet: &Train, field: &CombField, speed: &Speed) -> Option<f64> {
    let orders = comb_orders(sheet);
    let (hz, score) = [(0.33, 0.95), (1.05, 3.0)]
        .map(|(low, high)| field.search(&orders, low * speed.input_hz, high * speed.input_hz))
        .into_iter()
        .max_by(|a, b| a.1.total_cmp(&b.1))?;
    // At simple ratios harmonics meet each other's lines.
    let simple =
        (1..=5).any(|a| (1..=5).any(|b| (hz / speed.input_hz * f64::from(a) / f64::from(b) - 1.0).abs() < 5e-3));
    (score > speed.score + OTHER_SPEED && !simple).then_some(hz)
}

/// A gear with other teeth than the bench file says.
#[derive(Clone, Debug, PartialEq)]
pub struct OtherTeeth {
    /// Position of the stage.
    pub stage: usize,
    /// Else the wheel.
    pub pinion: bool,
    /// Teeth that fit.
    pub teeth: u32,
    /// Teeth by the bench file.
    pub sheet: u32,
    /// Mean gain in log excess per line.
    pub gain: f64,
}

/// Speed of one recording.
#[derive(Clone, Copy, Debug)]
pub struct Speed {
    /// Input-shaft speed (Hz).
    pub input_hz: f64,
    /// Mean log excess of the comb there.
    pub score: f64,
}

/// Range of input-shaft speeds to search (Hz).
fn range(bench: &Bench, train: &Train, steady: &Steady<'_, impl Run>, tacho_hz: Option<f64>, reach: f64) -> (f64, f64) {
    if let Some(hz) = tacho_hz {
        return (hz * (1.0 - reach), hz * (1.0 + reach));
    }
    let known = steady.display_motor_hz.is_finite();
    let centre = if known { steady.display_motor_hz } else { bench.motor.speed_hz } / train.motor_order;
    let spread = if known { DIRECT_REACH } else { 0.05 };
    let slip = if bench.belt.is_some() { SLIP_REACH } else { steady.most_slip };
    (centre * (1.0 - slip.max(spread)), centre * (1.0 + spread))
}

/// Orders that decide between speeds at which the mesh harmonics fit alike: theirs, and the first
/// of every shaft.
pub(crate) fn speed_orders(train: &Train) -> Vec<f64> {
    let shafts = train.shafts.iter().flat_map(|(_, order)| (1..=4).map(move |k| order * f64::from(k)));
    comb_orders(train).into_iter().chain(shafts).collect()
}

/// Orders that decide between tooth numbers: mesh harmonics, their nearest sidebands and shaft
/// orders.
pub(crate) fn deciding_orders(train: &Train) -> Vec<f64> {
    let mut out = speed_orders(train);
    for stage in &train.stages {
        for h in 1..=3 {
            let centre = stage.harmonic_order(h);
            for shaft in [stage.pinion_order, stage.wheel_order] {
                out.extend([centre - shaft, centre + shaft]);
            }
        }
    }
    out
}

/// Which of the deciding orders tell of tooth numbers. Errors of a gear's teeth light the orders of
/// its shaft: where another shaft turns as fast, its lines are there whatever the teeth, and an
/// order tells once.
fn telling(train: &Train, orders: &[f64]) -> Vec<bool> {
    let same = |a: f64, b: f64| (a / b - 1.0).abs() < SAME_ORDER;
    let again = |all: &[f64], k: usize| all[..k].iter().any(|before| same(*before, all[k]));
    let shafts: Vec<f64> = train.shafts.iter().map(|s| s.1).collect();
    let one_to_one = (0..shafts.len()).any(|k| again(&shafts, k));
    (0..orders.len()).map(|k| !one_to_one || !again(orders, k)).collect()
}

/// What lies at the lines that only one of two sets of tooth numbers has.
#[derive(Default)]
struct Moved {
    sheet: Vec<f64>,
    other: Vec<f64>,
}

impl Moved {
    /// Of all recordings, of those lines that tell.
    fn between(fields: &[CombField], (sheet, other): (&Fit, &Fit), telling: &[bool]) -> Self {
        let told = |lines: &[f64]| -> Vec<f64> {
            lines.iter().zip(telling).filter(|(_, tells)| **tells).map(|(hz, _)| *hz).collect()
        };
        let mut moved = Self::default();
        for ((field, sheet), other) in fields.iter().zip(&sheet.lines).zip(&other.lines) {
            moved.add(field, &told(sheet), &told(other));
        }
        moved
    }

    /// Log excess at the frequencies (Hz) of each side that the other side has nothing near.
    fn add(&mut self, field: &CombField, sheet: &[f64], other: &[f64]) {
        let near = |all: &[f64], hz: f64| all.iter().any(|o| (o - hz).abs() < APART_BINS * field.bin_hz());
        let lone = |of: &[f64], against: &[f64]| -> Vec<f64> {
            of.iter().filter(|hz| !near(against, **hz)).filter_map(|hz| field.at(*hz)).collect()
        };
        self.sheet.extend(lone(sheet, other));
        self.other.extend(lone(other, sheet));
    }

    /// Mean gain per line and its standard score.
    fn gain(&self) -> (f64, f64) {
        if self.sheet.len().min(self.other.len()) < TEETH_LINES {
            return (0.0, 0.0);
        }
        let moments = |v: &[f64]| {
            let n = v.len() as f64;
            let mean = v.iter().sum::<f64>() / n;
            (mean, v.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (n * (n - 1.0)))
        };
        let ((a, va), (b, vb)) = (moments(&self.sheet), moments(&self.other));
        (b - a, (b - a) / (va + vb).sqrt().max(1e-9))
    }
}

/// The bench with other teeth on one gear, of a planetary stage on sun or ring with the planets
/// that then fit between them; none where it could not be assembled.
pub fn with_teeth(bench: &Bench, stage: usize, pinion: bool, teeth: u32) -> Option<Bench> {
    let mut other = bench.clone();
    let s = other.stages.get_mut(stage)?;
    let gear = if pinion { &mut s.pinion } else { &mut s.wheel };
    let more = i64::from(teeth) - i64::from(gear.teeth);
    gear.teeth = teeth;
    if let Some(set) = &mut s.gearing.planetary {
        // The ring has twice as many more teeth as the planets, the sun as many fewer.
        let twice = if pinion { -more } else { more };
        set.planet.teeth = u32::try_from(i64::from(set.planet.teeth) + twice / 2).ok()?;
        (twice % 2 == 0 && gearing::problems(s).is_empty()).then_some(())?;
    }
    Some(other)
}

/// Speeds of all recordings by the bench file's own teeth.
pub fn speeds(bench: &Bench, train: &Train, all: &[Steady<'_, impl Run>], fields: &[CombField]) -> Vec<Speed> {
    let orders = comb_orders(train);
    all.iter()
        .zip(fields)
        .map(|(steady, field)| {
            let (input_hz, score) = own_speed(bench, train, steady, field, &orders, CLOCK_REACH);
            Speed { input_hz, score }
        })
        .collect()
}

/// Speed by the bench's own teeth and its score. Where all lines lie together a little farther off
/// than the display may be, the rate is wrong or the motor slips.
pub(crate) fn own_speed(
    bench: &Bench,
    train: &Train,
    steady: &Steady<'_, impl Run>,
    field: &CombField,
    comb: &[f64],
    reach: f64,
) -> (f64, f64) {
    let tacho = steady.tacho_hz(train);
    let (low, high) = range(bench, train, steady, tacho, reach);
    let all = speed_orders(train);
    let near = field.speed(comb, &all, low, high);
    if tacho.is_some() || !steady.display_motor_hz.is_finite() || bench.belt.is_some() {
        return near;
    }
    let far = field.speed(comb, &all, low * (1.0 - RATE_REACH), high * (1.0 + RATE_REACH));
    if far.1 > near.1 + TEETH_GAIN { far } else { near }
}

/// Whether the tacho through a bench's teeth and the drive display cannot both be right: beyond
/// what a display, a sample clock and a belt are off.
fn against_display(bench: &Bench, steady: &Steady<'_, impl Run>) -> bool {
    let train = Train::new(bench);
    let Some(input_hz) = steady.tacho_hz(&train).filter(|_| steady.display_motor_hz.is_finite()) else { return false };
    let (low, high) = range(bench, &train, steady, None, 0.0);
    !(low * (1.0 - CLOCK_REACH)..=high * (1.0 + CLOCK_REACH)).contains(&input_hz)
}

/// The bench with the one tooth number changed that fits all recordings clearly better, if there is
/// one.
///
/// Which lines move depends on where the speed is known: with a tacho on the output shaft, the
/// pinion's teeth move nothing but the input shaft's own lines. So candidates are ranked by all
/// lines and believed by those that move.
pub fn other_teeth(bench: &Bench, all: &[Steady<'_, impl Run>], fields: &[CombField]) -> Option<(OtherTeeth, Bench)> {
    likeliest_teeth(bench, all, fields).filter(|likeliest| likeliest.believed).map(|one| (one.teeth, one.bench))
}

/// The one tooth number whose change fits all recordings best, if any fits better than the sheet.
pub struct LikeliestTeeth {
    /// The gear.
    pub teeth: OtherTeeth,
    /// The bench with that number.
    pub bench: Bench,
    /// Whether it is believed where the sheet's lines may be there.
    pub believed: bool,
}

/// The likeliest other tooth number, believed or not: where it is known that the sheet's lines are
/// not there, it stands beside what else may have moved them.
pub fn likeliest_teeth(bench: &Bench, all: &[Steady<'_, impl Run>], fields: &[CombField]) -> Option<LikeliestTeeth> {
    let sheet = Fit::of(bench, all, fields, true);
    let sheet_tells = telling(&Train::new(bench), &sheet.orders);
    let mut best: Option<Candidate> = None;
    let mut faint: Option<Candidate> = None;
    let mut tried = 0usize;
    for (stage, gears) in bench.stages.iter().enumerate() {
        for (pinion, teeth) in [(true, gears.pinion.teeth), (false, gears.wheel.teeth)] {
            let near = (-TEETH_REACH..=TEETH_REACH).filter(|change| *change != 0);
            for changed in near.filter_map(|change| u32::try_from(i64::from(teeth) + change).ok()).filter(|t| *t >= 5) {
                let Some(other) = with_teeth(bench, stage, pinion, changed) else { continue };
                if all.iter().any(|steady| against_display(&other, steady)) {
                    continue;
                }
                tried += 1;
                let fit = Fit::of(&other, all, fields, false);
                let telling = both(&sheet_tells, &telling(&Train::new(&other), &fit.orders));
                let moved = Moved::between(fields, (&sheet, &fit), &telling);
                let (score, of_sheet) = (fit.score(fields, &telling), sheet.score(fields, &telling));
                let all_lines = score - of_sheet;
                if all_lines <= 0.0 {
                    continue;
                }
                let (gain, sure) = moved.gain();
                let believed = all_lines > TEETH_GAIN || (gain > TEETH_GAIN && sure > TEETH_SURE);
                let place = if believed { &mut best } else { &mut faint };
                if place.as_ref().is_none_or(|one| score > one.score) {
                    let gain = if believed { gain.max(all_lines) } else { all_lines };
                    let gear = OtherTeeth { stage, pinion, teeth: changed, sheet: teeth, gain };
                    *place = Some(Candidate { score, of_sheet, telling, moved, gear, bench: other });
                }
            }
        }
    }
    // What tooth numbers score that nobody has, by all lines and by those that they move.
    let nobodys = |gear: &OtherTeeth, telling: &[bool]| -> Vec<(f64, Moved)> {
        (TEETH_REACH + 1..=NOBODYS_REACH)
            .flat_map(|change| [-change, change])
            .filter_map(|change| u32::try_from(i64::from(gear.sheet) + change).ok())
            .filter(|teeth| *teeth >= *TRIED_TEETH.start())
            .filter_map(|teeth| {
                let fit = Fit::of(&with_teeth(bench, gear.stage, gear.pinion, teeth)?, all, fields, false);
                Some((fit.score(fields, telling), Moved::between(fields, (&sheet, &fit), telling)))
            })
            .collect()
    };
    // A stage whose mesh is faint beside the other's: its share of all lines is small, but what
    // tooth numbers score that nobody has says how small chance is.
    let (one, sure) = best.map(|one| (one, true)).or_else(|| Some((faint?, false)))?;
    let nobody = nobodys(&one.gear, &one.telling);
    let scores: Vec<f64> = nobody.iter().map(|(score, _)| *score).collect();
    let (few, middle) = (nobody.len() <= LEAST_NOBODYS, dsp::median(&mut scores.clone()));
    let told = if sure {
        few || stands_out(one.score, &scores, OF_NOBODY_MOVED)
    } else {
        // The sheet's own lines must not stand out as well. The log excess of all lines is about
        // the log odds of this number, of which each that was tried has its share beforehand.
        let lines = one.telling.iter().filter(|tells| **tells).count() as f64;
        !few && (one.score - one.of_sheet) * lines > (tried as f64).ln()
            && stands_out(one.score, &scores, OF_NOBODY)
            && one.of_sheet < middle + 0.5 * (one.score - middle)
    };
    let believed = told && !sheet_has_lines(&one.moved, &nobody);
    Some(LikeliestTeeth { teeth: one.gear, bench: one.bench, believed })
}

/// A sheet with another tooth number that fits better.
struct Candidate {
    /// Mean log excess of the lines that tell by both sheets: its own, and the first sheet's.
    score: f64,
    of_sheet: f64,
    /// Which they are.
    telling: Vec<bool>,
    moved: Moved,
    gear: OtherTeeth,
    bench: Bench,
}

/// Lines that tell by both of two sheets.
fn both(one: &[bool], other: &[bool]) -> Vec<bool> {
    one.iter().zip(other).map(|(a, b)| *a && *b).collect()
}

/// How a sheet fits all recordings.
struct Fit {
    /// Deciding orders by the sheet.
    orders: Vec<f64>,
    /// Speed of the input shaft in each recording (Hz), and where the sheet puts its lines (Hz).
    input_hz: Vec<f64>,
    lines: Vec<Vec<f64>>,
}

impl Fit {
    fn of(candidate: &Bench, all: &[Steady<'_, impl Run>], fields: &[CombField], own: bool) -> Self {
        let train = Train::new(candidate);
        let (orders, comb) = (deciding_orders(&train), comb_orders(&train));
        let speed = |(steady, field): (&Steady<'_, _>, &CombField)| {
            if own {
                return own_speed(candidate, &train, steady, field, &comb, TACHO_REACH).0;
            }
            let (low, high) = range(candidate, &train, steady, steady.tacho_hz(&train), TACHO_REACH);
            field.speed(&comb, &speed_orders(&train), low, high).0
        };
        let input_hz: Vec<f64> = all.iter().zip(fields).map(speed).collect();
        let lines = input_hz.iter().map(|hz| orders.iter().map(|o| o * hz).collect()).collect();
        Self { orders, input_hz, lines }
    }

    /// Mean log excess of the lines that tell.
    fn score(&self, fields: &[CombField], telling: &[bool]) -> f64 {
        let orders: Vec<f64> =
            self.orders.iter().zip(telling).filter(|(_, tells)| **tells).map(|(order, _)| *order).collect();
        let scores: Vec<f64> = fields.iter().zip(&self.input_hz).map(|(field, hz)| field.score(&orders, *hz)).collect();
        if scores.is_empty() { 0.0 } else { dsp::mean(&scores) }
    }
}

/// Whether the sheet's own lines are there: where the sheet alone puts lines, there is more like
/// what the best tooth number's own lines show than like those of numbers that nobody has. Then
/// something else makes the lines of the best. Lines that both sheets have say nothing: at another
/// speed, behind which the motor slips, most are of that kind.
fn sheet_has_lines(moved: &Moved, nobody: &[(f64, Moved)]) -> bool {
    let enough = nobody.iter().filter(|(_, moved)| moved.other.len() >= TEETH_LINES);
    let mut nobody: Vec<f64> = enough.map(|(_, moved)| dsp::mean(&moved.other)).collect();
    nobody.len() > LEAST_NOBODYS && dsp::mean(&moved.sheet) > 0.5 * (dsp::median(&mut nobody) + dsp::mean(&moved.other))
}

/// Whether the score of a tooth number stands by so many standard deviations out of those of
/// numbers that nobody has. Where sidebands of a pitch error make every whole number fit a little,
/// they scatter by that; a few that share lines with another mesh do not count, the scatter being
/// that of the median.
pub(crate) fn stands_out(score: f64, nobodys: &[f64], deviations: f64) -> bool {
    let middle = dsp::median(&mut nobodys.to_vec());
    let mut off: Vec<f64> = nobodys.iter().map(|x| (x - middle).abs()).collect();
    score > middle + deviations * 1.4826 * dsp::median(&mut off)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// All lines of a wheel that turns as its pinion does are the pinion's; beside another wheel
    /// all lines tell.
    #[test]
    fn analytic_lines_of_a_wheel_that_turns_as_its_pinion_do_not_tell() {
        let tells = |wheel: u32| {
            let mut bench = gearwatch_sim::shipped::bench("single-pair").unwrap();
            (bench.stages[0].pinion.teeth, bench.stages[0].wheel.teeth) = (22, wheel);
            let train = Train::new(&bench);
            telling(&train, &deciding_orders(&train))
        };
        assert!(tells(23).iter().all(|tells| *tells) && tells(44).iter().all(|tells| *tells));
        // Five harmonics of the mesh, four orders of each shaft, two sidebands of each about
        // three harmonics; the pinion's come first.
        let of_wheel = |k: usize| (9..13).contains(&k) || (k >= 13 && (k - 13) % 4 >= 2);
        assert!(tells(22).iter().enumerate().all(|(k, tells)| *tells != of_wheel(k)));
    }

    /// Every number's comb meets the orders that pitch errors light: the best of them is one of
    /// many. Where noise alone is under the others' combs, one that meets lines stands out; a
    /// multiple of it that shares them does not hide it.
    #[test]
    fn analytic_a_tooth_number_stands_out_of_those_that_nobody_has() {
        let lit: Vec<f64> = (0..40).map(|k| 3.2 + 0.5 * f64::from(k).sin()).collect();
        assert!(!stands_out(3.74, &lit, OF_NOBODY_MOVED));
        let mut silent: Vec<f64> = (0..40).map(|k| 0.8 + 0.14 * f64::from(k).sin()).collect();
        silent[7] = 3.4;
        assert!(stands_out(3.47, &silent, OF_NOBODY));
    }
}
