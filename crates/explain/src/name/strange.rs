//! Lines and envelope orders that no gear makes, and the names that they give.

use gearwatch_core::train::Train;
use gearwatch_sim::effects::{self, EntryPoint};

use crate::change::compare::Comparison;
use crate::finding::{Finding, HOUSING};
use crate::name::bearing;
use crate::name::family::Family;
use crate::name::subname;
use crate::question::Question;
use crate::read::displacement::{self, Displaced};
use crate::read::dsp::Transforms;
use crate::read::envelope::{self, EnvelopeLine, EnvelopeSpectrum};
use crate::read::features::RecordingFeatures;
use crate::read::fixed::FixedLine;
use crate::read::fluctuation::Fluctuation;
use crate::read::folded::FoldedLine;
use crate::read::moved_mode::{self, MovedMode};
use crate::read::order_swing::{Point, Swinging};
use crate::read::scan::{self, StrangeLine, Twin};
use crate::read::transients::{self, Bursts};
use crate::read::wander::{self, Wandering};

/// Channels that are scanned: those of the pairs, without any those of the first recording.
fn channels(recordings: &[RecordingFeatures], comparison: &Comparison) -> Vec<String> {
    if comparison.pairs.is_empty() {
        recordings.first().map(|r| r.channels.iter().map(|c| c.name.clone()).collect()).unwrap_or_default()
    } else {
        comparison.channels.clone()
    }
}

/// Lines and envelope orders outside the train's comb.
#[derive(Default)]
pub struct Strange {
    /// At fixed frequency.
    pub fixed: Vec<StrangeLine>,
    /// What the machine's lines look like that meet at a frequency by chance, from several scans;
    /// empty where there is one speed only.
    pub by_chance: Vec<Vec<StrangeLine>>,
    /// At fixed order.
    pub orders: Vec<StrangeLine>,
    /// In the envelope of the rest.
    pub envelope: Option<EnvelopeLine>,
    /// At fixed frequency on one sensor, the plainest first.
    pub picked_up: Vec<FixedLine>,
    /// Folded about half the sample rate.
    pub folded: Option<FoldedLine>,
    /// There was a reference.
    pub against_reference: bool,
    /// A speed that fluctuates at a fixed frequency.
    pub fluctuation: Option<Fluctuation>,
    /// A turning that swings at a multiple of a shaft.
    pub swinging: Option<Swinging>,
    /// Where bursts stand out most.
    pub bursts: Option<Bursts>,
    /// The narrow band that grew most against the reference.
    pub wandering: Option<Wandering>,
    /// The mode of the path that accounts best for what the background did.
    pub moved_mode: Option<MovedMode>,
    /// A channel that shows more displacement than a bench can.
    pub displaced: Option<Displaced>,
    /// The machine turns later from one instant on: something slips or sticks.
    pub turns_late: bool,
}

/// Least mean excess (nats) of a line that is named, against a reference and without.
const NEW_LINE: f64 = 3.0;
const LONE_LINE: f64 = 4.5;
/// Least excess in any recording of a line that is called foreign without a reference, and its
/// distance (bins) from all combs.
const LONE_LEAST: f64 = 4.0;
const LONE_OFF: f64 = 5.0;
/// Least ln(power over floor) in every recording of lines that tell what chance does.
const LISTED: f64 = 2.0;
/// Probability with which the machine's own lines may pass for lines of a fixed frequency.
const CHANCE: f64 = 0.01;
/// Lines beside the mains that are fitted, and their distance (bins) from all combs.
const FITTED: usize = 8;
const FITTED_OFF: f64 = 3.0;
/// What the amplitude of a line loses at most where its frequency is known to half a bin, relative.
const WINDOWED: f64 = 0.1;
/// Standard scores of the envelope scan above which a bearing is named, where its order is as usual
/// as any that was scanned: the highest score of benches without one falls by a factor of e from
/// score to score, so that each nat by which bearings make an order more or less than others counts
/// as one score. A hundred benches without one, some of other makers, reach 7.0 at an order to
/// which the most usual one would add 1.2.
const ENVELOPE_SCORE: f64 = 8.2;
/// The same against a reference, where the scans of 220 benches reach 7.2.
const ENVELOPE_SCORE_AGAINST: f64 = 8.5;

/// What a line in the swing of all recordings is believed to be worth: a torque that fluctuates at
/// a fixed frequency swings the train as well.
const FLUCTUATES: f64 = 0.95;
/// Probability of one at a multiple of a shaft: a belief, read from no data. Whether torque or
/// speed drives it, and where, is less sure than that it is there.
const SWINGS: f64 = 0.8;

/// ln of the share of energy in the highest hundredth of short blocks, over that in the reference
/// or over a hundredth, from which something bursts that no gear does. Unchanged benches of another
/// generator reach 0.34 against their reference; without one the pulses of sound meshes reach 2.2.
const BURSTS: f64 = 0.8;
const BURSTS_ALONE: f64 = 2.5;

/// How many times the band that fell most a band must grow to be a line that wanders, and what the
/// former counts at least (standard scores). Chance and small changes of the path make bands grow
/// and fall alike: on unchanged benches the two differ by a factor of 1.3. The largest of some
/// thousand normal scores comes to 3.2 on the mean.
const WANDERS: f64 = 2.0;
const LEAST_FALLEN: f64 = 5.0;

/// How sure it is that a mode that moved is of the path: a belief, read from no data.
const MODE_OF_THE_PATH: f64 = 0.65;

/// Nearest multiple of 50 or 60 Hz, where the line lies on one.
fn mains(hz: f64) -> Option<f64> {
    [50.0, 60.0].into_iter().find(|base| {
        let m = (hz / base).round();
        (1.0..=20.0).contains(&m) && (hz - m * base).abs() < 0.12 + 2e-4 * hz
    })
}

/// A line at a fixed frequency that is no mains and stands on several sensors, or on the only one.
fn is_foreign(l: &StrangeLine) -> bool {
    let others = l.by_channel.iter().filter(|e| **e > 1.5).count();
    l.excess > NEW_LINE && l.least > 1.5 && mains(l.position).is_none() && (others > 1 || l.by_channel.len() == 1)
}

/// A line that is no mains, beside all combs; other sensors may not show it.
fn may_be_of_one_sensor(l: &StrangeLine) -> bool {
    l.off_comb > FITTED_OFF && mains(l.position).is_none()
}

impl Strange {
    /// The order of the envelope that a bearing makes, where one is believed.
    pub fn bearing(&self, q: &Question<'_>) -> Option<&EnvelopeLine> {
        let needed = if self.against_reference { ENVELOPE_SCORE_AGAINST } else { ENVELOPE_SCORE };
        let believed = |e: &&EnvelopeLine| e.score + bearing::usual(q.train, e.order, e.range) > needed;
        self.envelope.as_ref().filter(believed)
    }

    fn foreign(&self) -> Vec<&StrangeLine> {
        self.fixed.iter().filter(|l| is_foreign(l)).collect()
    }

    /// New lines at fixed frequencies that are not mains and may be of one sensor (Hz).
    pub fn beside_mains(&self) -> Vec<f64> {
        let new =
            |l: &&StrangeLine| if self.against_reference { l.excess > NEW_LINE } else { self.chance_of(l) < CHANCE };
        self.fixed.iter().filter(|l| may_be_of_one_sensor(l)).filter(new).take(FITTED).map(|l| l.position).collect()
    }

    /// How many lines of the machine that meet at a frequency by chance may be expected to stand
    /// out as much in every recording. Their heights over the least that is listed are taken to be
    /// exponentially distributed, as those of noise are; infinite where nothing tells chance.
    fn chance_of(&self, line: &StrangeLine) -> f64 {
        if self.by_chance.is_empty() {
            return f64::INFINITY;
        }
        let chance = || self.by_chance.iter().flatten().filter(|l| may_be_of_one_sensor(l));
        let heights = || chance().map(|l| l.least - LISTED).filter(|h| *h > 0.0);
        // One more, of a height that is usual.
        let count = 1.0 + heights().count() as f64;
        let mean = (1.0 + heights().sum::<f64>()) / count;
        count / self.by_chance.len() as f64 * (-(line.least - LISTED) / mean).exp()
    }

    /// Several lines at fixed frequencies that are not mains, on several sensors, and more of them
    /// than lines of the bench's own gears that meet at two speeds by chance.
    pub fn foreign_machine(&self) -> bool {
        let lone = |l: &StrangeLine| l.excess > LONE_LINE && l.least > LONE_LEAST && l.off_comb > LONE_OFF;
        let counts = |l: &&StrangeLine| is_foreign(l) && (self.against_reference || lone(l));
        let found = self.fixed.iter().filter(counts).count();
        let by_chance = self.by_chance.iter().flatten().filter(counts).count();
        let expected = (1.0 + by_chance as f64) / (1.0 + self.by_chance.len() as f64);
        found >= if self.against_reference { 2 } else { 3 }
            && (self.by_chance.is_empty() || poisson_tail(found, expected) < CHANCE)
    }
}

/// Probability of so many or more where so many are expected.
fn poisson_tail(count: usize, expected: f64) -> f64 {
    let mut term = (-expected).exp();
    let mut below = 0.0;
    for k in 0..count {
        below += term;
        term *= expected / (k + 1) as f64;
    }
    1.0 - below
}

/// Scans for strange lines.
pub fn strange(
    recordings: &[RecordingFeatures],
    references: &[RecordingFeatures],
    comparison: &Comparison,
    train: &Train,
    transforms: &mut Transforms,
) -> Strange {
    let alone = comparison.pairs.is_empty();
    let twins: Vec<Twin<'_>> = if alone {
        recordings.iter().map(|r| Twin { recording: r, reference: None, beside_hz: 0.0 }).collect()
    } else {
        let pair = |p: &crate::change::compare::Pair| Twin {
            recording: &recordings[p.recording],
            reference: Some(&references[p.reference]),
            beside_hz: 0.0,
        };
        comparison.pairs.iter().map(pair).collect()
    };
    let channels = &channels(recordings, comparison);
    let against_reference = twins.iter().any(|t| t.reference.is_some());
    // A limit makes envelopes of its own.
    let clips = |name: &String| {
        recordings.iter().flat_map(|r| &r.channels).any(|c| c.name == *name && c.integrity.clipped_at.is_some())
    };
    let mut spectra = Vec::new();
    let mut add = |all: &[RecordingFeatures], sign: f64| {
        for (i, r) in all.iter().enumerate() {
            for (c, name) in channels.iter().enumerate().filter(|(_, name)| !clips(name)) {
                if let Some(channel) = r.channels.iter().find(|x| x.name == *name) {
                    spectra.push(EnvelopeSpectrum {
                        revolutions: r.revolutions,
                        channel: c,
                        recording: i,
                        sign,
                        power: envelope::spectrum(transforms, r, channel),
                    });
                }
            }
        }
    };
    add(recordings, 1.0);
    if !references.is_empty() {
        add(references, -(recordings.len() as f64) / references.len() as f64);
    }
    Strange {
        fixed: scan::fixed_lines(&twins, channels, train),
        by_chance: scan::fixed_by_chance(&twins, channels, train),
        orders: scan::order_lines(&twins, channels, train),
        envelope: envelope::scan(&spectra, train, channels.len()),
        picked_up: Vec::new(),
        folded: None,
        fluctuation: None,
        swinging: None,
        against_reference,
        bursts: transients::bursts(transforms, train, recordings, references, channels),
        wandering: wander::wandering(&twins, channels),
        moved_mode: moved_mode::moved_mode(&twins, channels),
        displaced: displacement::displaced(recordings),
        ..Strange::default()
    }
}

/// Effects beside which the orders of the shafts are what they are.
pub fn leaves_shafts(effect: &str) -> bool {
    matches!(
        effect,
        "electrical_pickup"
            | "clock_offset"
            | "belt_slip"
            | "clipping"
            | "aliasing"
            | "bearing_defect"
            | "speed_fluctuation"
    )
}

/// Effects that leave the forces of the machine as they are, and envelopes of other sensors.
fn in_the_data(effect: &str) -> bool {
    matches!(effect, "clipping" | "wrong_tooth_count" | "electrical_pickup" | "scaling" | "clock_offset" | "belt_slip")
}

/// Names what the scans found.
pub fn add_strange(
    q: &Question<'_>,
    (strange, family): (&Strange, Option<&Family>),
    findings: &mut Vec<Finding>,
    unexplained: &mut bool,
    steps: &mut Vec<String>,
) {
    let channels = channels(q.recordings, q.comparison);
    let speeds: Vec<f64> = q.recordings.iter().map(|r| r.input_hz).collect();
    let several = speeds.iter().any(|s| (s / speeds[0] - 1.0).abs() > 0.05);
    let gear_changed = findings.iter().any(|f| {
        matches!(
            f.effect,
            "pitch_error" | "tooth_breakage" | "root_crack" | "pitting" | "eccentricity" | "belt_slip" | "clock_offset"
        )
    });
    let bearing_seen = strange.bearing(q).is_some();
    if let Some(l) = &strange.folded {
        findings.push(aliasing(q, l));
        return;
    }
    // Lines at fixed frequency.
    let foreign = strange.foreign_machine() && (strange.against_reference || several) && !gear_changed;
    let alone = findings.is_empty() && !*unexplained && !bearing_seen;
    // Another machine may have a line that lies on the mains.
    if let Some(l) = strange.picked_up.iter().find(|l| l.multiple.is_some() || alone).filter(|_| !foreign) {
        findings.push(pickup(l, channels.len() == 1));
    } else if foreign {
        let lines = strange.foreign();
        steps.push(format!(
            "{} lines at fixed frequencies that are neither mains nor of this bench, the strongest at {:.2} Hz",
            lines.len(),
            lines[0].position
        ));
        *unexplained = true;
    }
    // Lines at fixed order.
    let off: Vec<&StrangeLine> =
        strange.orders.iter().filter(|l| l.off_comb > 4.0 && l.excess > NEW_LINE && l.least > 1.5).collect();
    let named = |findings: &[Finding]| findings.iter().any(|f| f.effect != "wrong_tooth_count");
    if let Some(e) = strange.bearing(q)
        && (strange.against_reference || !findings.iter().any(|f| !in_the_data(f.effect)))
    {
        *unexplained = false;
        findings.push(bearing::finding(q, e, &channels));
    } else if let Some(family) = family
        && !bearing_seen
        && (strange.against_reference || !findings.iter().any(|f| !in_the_data(f.effect)))
    {
        steps.push(format!("{}: {:.0} nats", family.in_words(), family.nats));
        *unexplained = false;
        let odds = family.nats.exp();
        let mut f = bearing::of_lines(q, family);
        f.probability *= odds / (1.0 + odds);
        findings.push(f);
    } else if strange.against_reference && off.len() >= 2 && !named(findings) && !*unexplained {
        steps.push(format!("lines at orders that no shaft makes, the strongest at {:.3}", off[0].position));
        *unexplained = true;
    }
}

/// Whether something is there that no effect of the library makes.
pub fn has_no_name(q: &Question<'_>, strange: &Strange, steps: &mut Vec<String>) -> bool {
    strange.turns_late || moves_alone(strange, steps) || wanders(strange, steps) || bursts(q, strange, steps)
}

/// Whether something bursts that no gear does.
fn bursts(q: &Question<'_>, strange: &Strange, steps: &mut Vec<String>) -> bool {
    let usual = if strange.against_reference { BURSTS } else { BURSTS_ALONE };
    let Some(bursts) = strange.bursts.as_ref().filter(|b| b.excess > usual) else { return false };
    steps.push(bursts.describe(&channels(q.recordings, q.comparison)));
    true
}

/// Whether one channel shows a displacement that no bench makes and no other channel shows.
fn moves_alone(strange: &Strange, steps: &mut Vec<String>) -> bool {
    let Some(displaced) = &strange.displaced else { return false };
    steps.push(displaced.describe());
    true
}

/// Whether an effect leaves every mode where it is: errors of geometry and forces alter what
/// excites a machine, not how it gives way.
pub fn moves_no_mode(effect: &str) -> bool {
    effects::find(effect).is_ok_and(|e| matches!(e.entry_point(), EntryPoint::Geometry | EntryPoint::Force))
}

/// A mode of the path that moved, beside what moves none. On one sensor alone it is the sensor's
/// own; a bearing of the train whose stiffness changed moves modes as well.
pub fn moved_mode(q: &Question<'_>, strange: &Strange, steps: &mut Vec<String>) -> Option<Finding> {
    let mode = strange.moved_mode.as_ref()?;
    steps.push(mode.describe());
    if mode.nats <= 0.0 {
        return None;
    }
    let channels = &q.comparison.channels;
    let alone = mode.of_one_channel();
    let place = alone.map_or(HOUSING, |c| &channels[c]);
    let odds = mode.nats.exp();
    let mut f = Finding::new("structural_resonance", place.to_owned(), MODE_OF_THE_PATH * odds / (1.0 + odds));
    match alone {
        Some(c) => f.alternatives.push(("sensor_mounting", channels[c].clone())),
        None => f.alternatives.extend(q.train.shafts.iter().map(|(name, _)| ("bearing_compliance", name.clone()))),
    }
    f.evidence.place =
        format!("the background of {} near {:.0} Hz", alone.map_or("all sensors", |c| &channels[c]), mode.hz);
    f.evidence.law = "the same at every speed".into();
    Some(f)
}

/// Whether a narrow band grew, at all speeds alike, far more than chance makes bands grow or fall.
fn wanders(strange: &Strange, steps: &mut Vec<String>) -> bool {
    let Some(w) = &strange.wandering else { return false };
    steps.push(w.describe());
    w.score > WANDERS * w.fallen.max(LEAST_FALLEN)
}

/// The speed fluctuates at a frequency that no shaft has.
pub fn fluctuating(q: &Question<'_>, l: &Fluctuation) -> Finding {
    let input = q.train.shafts[0].0.clone();
    let mut f = Finding::new("speed_fluctuation", input, FLUCTUATES)
        .with("frequency_hz", l.frequency_hz.0, l.frequency_hz.1)
        .with("depth_percent", 100.0 * l.depth.0, 100.0 * l.depth.1);
    f.evidence.place = format!("the angle of the whole train swings at {:.2} Hz in all recordings", l.frequency_hz.0);
    f.evidence.law = "a fixed frequency, no order of a shaft".into();
    f.evidence.support = format!("by noise in {:.0e} of such sets of recordings", l.chance);
    f
}

/// The turning swings at a multiple of a shaft.
pub fn swinging(q: &Question<'_>, s: &Swinging) -> Finding {
    let point = |r: &RecordingFeatures| Point { input_hz: r.input_hz, brake_torque_nm: r.brake_torque_nm };
    let points: Vec<Point> = q.recordings.iter().map(point).collect();
    let mut f = subname::ripple(q, s.shaft, s.multiple, s.load_exponent(&points));
    let (depth, sigma) = s.depth();
    f.probability = SWINGS;
    f = f.with("depth_percent", 100.0 * depth, 100.0 * sigma);
    f.evidence.law = "one swing of the angle accounts for the sidebands of all mesh harmonics at this distance".into();
    f.evidence.support = format!("by chance in {:.0e} of such sets of recordings", s.chance);
    f
}

fn pickup(l: &FixedLine, only_sensor: bool) -> Finding {
    let (hz, sigma_hz) = l.hz;
    let (amplitude, sigma) = l.amplitude;
    let mut f = Finding::new("electrical_pickup", l.channel.clone(), if l.multiple.is_some() { 0.95 } else { 0.6 })
        .with("frequency_hz", hz, sigma_hz)
        .with("amplitude", amplitude, sigma.hypot(WINDOWED * amplitude));
    if l.multiple.is_none() {
        f.alternatives.push(("aliasing", f.place.clone()));
    }
    let on = if only_sensor { "the only sensor" } else { "this sensor alone" };
    f.evidence.place = format!("a line at {hz:.2} Hz at every speed, on {on}");
    f.evidence.law = "fixed frequency, no order".into();
    f.evidence.support = format!(
        "one amplitude in all recordings is likelier by {:.1} nats than another in each; of the machine's own lines {:.0e} may be expected to be as much alike",
        l.alike, l.expected
    );
    f
}

fn aliasing(q: &Question<'_>, l: &FoldedLine) -> Finding {
    let frequency_hz = l.order * q.bench.motor.speed_hz / q.train.motor_order;
    let mut f = Finding::new("aliasing", l.channel.clone(), 0.9)
        .with("frequency_hz", frequency_hz, 1e-3 * frequency_hz)
        .with("amplitude", l.amplitude, 0.1 * l.amplitude);
    f.evidence.place = format!(
        "order {:.3} of the input shaft, above half the sample rate, seen folded on this sensor in {} recordings",
        l.order, l.seen_in
    );
    f.evidence.law = "its line moves against the speed".into();
    f.evidence.support = format!("{:.0} times the power of anything beside it", l.above);
    f
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(position: f64, least: f64, by_channel: &[f64]) -> StrangeLine {
        let excess = by_channel.iter().copied().fold(0.0, f64::max);
        StrangeLine {
            position,
            channel: 0,
            excess,
            least,
            by_channel: by_channel.to_vec(),
            amplitudes: Vec::new(),
            off_comb: 10.0,
        }
    }

    fn found(fixed: Vec<StrangeLine>, by_chance: Vec<Vec<StrangeLine>>) -> Strange {
        Strange { fixed, by_chance, ..Strange::default() }
    }

    /// Of two expected, four or more come in 1 - 19/3 e^-2 of cases, 14 %.
    #[test]
    fn analytic_poisson_tail() {
        assert!((poisson_tail(4, 2.0) - (1.0 - 19.0 / 3.0 * (-2.0f64).exp())).abs() < 1e-12);
        assert_eq!(poisson_tail(0, 2.0), 1.0);
    }

    /// A line of one sensor, 4 nats above the noise in every recording, is asked for where chance
    /// brings lines of 2.3, and not where it brings lines of 4, nor where there is one speed only;
    /// so is one of the only sensor.
    #[test]
    fn analytic_a_line_of_one_sensor_stands_out_of_chance() {
        let own = || vec![line(3663.5, 4.0, &[5.0, 0.0])];
        let chance = |least: f64| vec![vec![line(1234.5, least, &[3.0, 2.0])]; 8];
        assert_eq!(found(own(), chance(2.3)).beside_mains(), [3663.5]);
        assert!(found(own(), chance(4.0)).beside_mains().is_empty());
        assert!(found(own(), Vec::new()).beside_mains().is_empty());
        let only = vec![line(3663.5, 4.0, &[5.0])];
        assert_eq!(found(only, vec![vec![line(1234.5, 2.3, &[3.0])]; 8]).beside_mains(), [3663.5]);
    }

    /// Three lines of several sensors are another machine's where chance brings none, and the
    /// gears' own where it brings as many.
    #[test]
    fn analytic_more_lines_than_by_chance_are_another_machines() {
        let three = || (1..=3).map(|k| line(43.0 * f64::from(k), 5.0, &[6.0, 6.0])).collect::<Vec<_>>();
        assert!(found(three(), vec![Vec::new(); 8]).foreign_machine());
        assert!(!found(three(), vec![three(); 8]).foreign_machine());
    }
}
