//! What explain reads from a recording: speed, complex order lines with their local noise, floors, and the spectra they came from.

use num_complex::Complex64;

use gearwatch_core::bench::Bench;
use gearwatch_core::recording::{Recording, Segment};
use gearwatch_core::train::Train;

use crate::angle::{self, CombField};
use crate::carriers;
use crate::dsp::{self, LINE_FIT_NOISE_GAIN, MAIN_LOBE_BINS, Transforms, median};
use crate::integrity::{self, Integrity};
use crate::lines::{self, Line};

/// Distance of two listed lines from which they are told apart (bins): the joint fit pays for it with ten times the noise of a line alone.
const SEPARABLE_BINS: f64 = 0.5;
/// Bins on each side of a line from which its noise is read.
const NOISE_BINS: usize = 60;
/// Share of the sample rate up to which lines are used: below the usual anti-alias corner.
pub const USABLE_BAND: f64 = 0.45;
/// Floor bands per octave.
const BANDS_PER_OCTAVE: f64 = 6.0;
/// Lower edge of the first floor band (Hz).
const FIRST_BAND_HZ: f64 = 50.0;

/// A line as measured.
#[derive(Clone, Copy, Debug)]
pub struct LineValue {
    /// Complex peak amplitude, phase at the start of the angle axis.
    pub amplitude: Complex64,
    /// Mean power that noise alone would show in `amplitude`.
    pub noise: f64,
}

impl LineValue {
    /// Power over noise.
    pub fn ratio(&self) -> f64 {
        self.amplitude.norm_sqr() / self.noise.max(f64::MIN_POSITIVE)
    }
}

/// Background between the lines in one band.
#[derive(Clone, Copy, Debug)]
pub struct FloorBand {
    /// Middle of the band (Hz).
    pub frequency_hz: f64,
    /// Mean power of one bin of the windowed spectrum.
    pub power: f64,
    /// Bins that were read.
    pub bins: usize,
}

/// One channel of one recording.
pub struct ChannelFeatures {
    /// Sensor name.
    pub name: String,
    /// Unit of the samples.
    pub unit: String,
    /// In the order of [`RecordingFeatures::lines`]; `None` where the line lies outside the usable band.
    pub values: Vec<Option<LineValue>>,
    /// All multiples of each shaft's speed, from 1, in the order of the train's shafts: what repeats with one revolution of it.
    pub combs: Vec<Vec<LineValue>>,
    /// Background.
    pub floor: Vec<FloorBand>,
    /// Spectrum over shaft angle; bin `k` is order `k / revolutions`.
    pub order_spectrum: Vec<Complex64>,
    /// Mean noise power per bin of `order_spectrum`.
    pub order_floor: Vec<f64>,
    /// Spectrum over time of what stays when the train's lines are taken out over angle; bin `k` is `k × hz_per_bin`.
    pub remainder: Vec<Complex64>,
    /// Mean noise power per bin of `remainder`.
    pub remainder_floor: Vec<f64>,
    /// Samples over even steps of shaft angle.
    pub angle_signal: Vec<f64>,
    /// Clipping, flat lines, values that are not numbers.
    pub integrity: Integrity,
}

/// A recording at one operating point.
pub struct RecordingFeatures {
    /// File name or label.
    pub name: String,
    /// Motor speed as displayed (Hz); `NaN` where unknown.
    pub display_motor_hz: f64,
    /// Torque at the brake as set (N m); `NaN` where unknown.
    pub brake_torque_nm: f64,
    /// Input-shaft speed that the gear lines show (Hz).
    pub input_hz: f64,
    /// Input-shaft speed by the tacho (Hz).
    pub tacho_input_hz: Option<f64>,
    /// Mean log excess of the comb at `input_hz`.
    pub comb_score: f64,
    /// Mesh harmonics that carried the angle.
    pub carriers: usize,
    /// Revolutions of the input shaft in the recording.
    pub revolutions: f64,
    /// Revolution of the input shaft at the first sample as counted from the first tacho pulse; 0 without a tacho.
    pub start_rev: f64,
    /// Width of a bin of the time spectrum (Hz).
    pub hz_per_bin: f64,
    /// Samples per second.
    pub sample_rate_hz: f64,
    /// The lines that were read.
    pub lines: Vec<Line>,
    /// Bins that the train's lines take, in order spectra and (as near as the speed is steady) in time spectra.
    pub taken: Vec<bool>,
    /// Input-shaft angle at each sample (revolutions).
    pub phase_rev: Vec<f64>,
    /// By channel.
    pub channels: Vec<ChannelFeatures>,
}

impl RecordingFeatures {
    /// Frequency of an order (Hz).
    pub fn order_hz(&self, order: f64) -> f64 {
        order * self.input_hz
    }

    /// Position of an order in the order spectra.
    pub fn order_bin(&self, order: f64) -> f64 {
        order * self.revolutions
    }
}

/// Samples of a recording that belong together: the longest gap-free run of every channel.
pub struct Steady<'a> {
    /// The recording.
    pub recording: &'a Recording,
    /// Channel name, unit and run.
    pub channels: Vec<(&'a str, &'a str, &'a Segment)>,
    /// Samples per second.
    pub sample_rate_hz: f64,
    /// Motor speed as displayed, mean (Hz).
    pub display_motor_hz: f64,
    /// (N m).
    pub brake_torque_nm: f64,
}

/// A recording that was not used, or not as a steady one.
pub enum Unused {
    /// Speed moves through it.
    RunUp,
    /// It cannot be judged; the sentence says why.
    Bad(String),
}

/// Speed change within a recording above which it is a run-up (relative).
const RUN_UP: f64 = 0.02;
/// Bins between neighbours of a shaft's comb above which the whole comb is taken out.
const COMB_SPACING: f64 = 40.0;
/// Shortest recording that is judged (input-shaft revolutions).
const SHORTEST_REVOLUTIONS: f64 = 20.0;

/// Picks the samples to judge, or says why not.
///
/// # Errors
/// [`Unused`] for run-ups and for recordings that do not fit the bench.
pub fn steady<'a>(bench: &Bench, train: &Train, recording: &'a Recording) -> Result<Steady<'a>, Unused> {
    let bad = |text: String| Err(Unused::Bad(format!("{}: {text}", recording.name)));
    let mut channels = Vec::new();
    let mut dead = Vec::new();
    let mut rate = f64::NAN;
    for sensor in &bench.sensors {
        let Some((name, channel)) = recording.channels.get_key_value(&sensor.name) else { continue };
        if *channel.unit != sensor.unit {
            return bad(format!(
                "channel {} is in {:?}, the bench file says {:?}; correct one of them",
                sensor.name, channel.unit, sensor.unit
            ));
        }
        let Some(run) = channel.segments.iter().max_by_key(|s| s.samples.len()) else { continue };
        if run.samples.iter().any(|x| !x.is_finite()) {
            return bad(format!("channel {} holds samples that are not numbers", sensor.name));
        }
        // A cable that is off is no vibration; the other channels may still be judged.
        if 2 * integrity::frozen(&run.samples) > run.samples.len() {
            dead.push(sensor.name.as_str());
            continue;
        }
        let expected = bench.acquisition.sample_rate_hz;
        if (channel.sample_rate_hz / expected - 1.0).abs() > 0.01 {
            return bad(format!(
                "channel {} was sampled at {} Hz, the bench file says {expected} Hz; correct one of them",
                sensor.name, channel.sample_rate_hz
            ));
        }
        rate = channel.sample_rate_hz;
        channels.push((name.as_str(), &*channel.unit, run));
    }
    if channels.is_empty() && !dead.is_empty() {
        return bad(format!("channel {} stands still for most of it; check cable and supply", dead.join(", ")));
    }
    if channels.is_empty() {
        let found: Vec<&str> = recording.channels.keys().map(String::as_str).collect();
        let known: Vec<&str> = bench.sensors.iter().map(|s| s.name.as_str()).collect();
        return bad(format!(
            "none of its channels ({}) is a sensor of the bench file ({})",
            found.join(", "),
            known.join(", ")
        ));
    }
    let speeds: Vec<f64> =
        recording.operating_points.iter().map(|p| p.motor_speed_hz).filter(|s| s.is_finite() && *s > 0.0).collect();
    let torques: Vec<f64> =
        recording.operating_points.iter().map(|p| p.brake_torque_nm).filter(|s| s.is_finite()).collect();
    let mean = |v: &[f64]| if v.is_empty() { f64::NAN } else { v.iter().sum::<f64>() / v.len() as f64 };
    let (low, high) = speeds.iter().fold((f64::INFINITY, 0.0f64), |(l, h), &s| (l.min(s), h.max(s)));
    if high > low * (1.0 + RUN_UP) {
        return Err(Unused::RunUp);
    }
    let display = mean(&speeds);
    let guess = if display.is_finite() { display } else { bench.motor.speed_hz } / train.motor_order;
    let shortest = channels.iter().map(|c| c.2.samples.len()).min().unwrap_or(0);
    let revolutions = shortest as f64 / rate * guess;
    if revolutions < SHORTEST_REVOLUTIONS {
        return bad(format!(
            "its longest run without a gap holds {revolutions:.1} revolutions of the input shaft; at least {SHORTEST_REVOLUTIONS} are needed, {:.0} s at this speed",
            (SHORTEST_REVOLUTIONS / guess).ceil()
        ));
    }
    Ok(Steady { recording, channels, sample_rate_hz: rate, display_motor_hz: display, brake_torque_nm: mean(&torques) })
}

impl Steady<'_> {
    /// Mean input-shaft speed by the tacho (Hz): whole pulses over the time between the first and the last.
    pub fn tacho_hz(&self, train: &Train) -> Option<f64> {
        let (shaft, tacho) = self.recording.tachos.iter().next()?;
        let order = train.shaft_order(shaft)?;
        let (first, last) = (tacho.pulse_times.first()?, tacho.pulse_times.last()?);
        let turns = (tacho.pulse_times.len() - 1) as f64 / tacho.pulses_per_rev / order;
        let speed = turns / ((last - first) as f64 * 1e-9);
        (tacho.pulse_times.len() >= 4 && speed.is_finite() && speed > 0.0).then_some(speed)
    }

    /// Input-shaft angle by the tacho (revolutions per sample), the mean speed that it gives (Hz), or nothing.
    pub fn tacho_angle(&self, train: &Train) -> Option<(Vec<f64>, f64)> {
        let (_, _, run) = self.channels.first()?;
        let (shaft, tacho) = self.recording.tachos.iter().next()?;
        let order = train.shaft_order(shaft)?;
        let pulses: Vec<f64> = tacho.pulse_times.iter().map(|t| (t - run.t0) as f64 * 1e-9).collect();
        if pulses.windows(2).any(|w| w[1] <= w[0]) || tacho.pulses_per_rev <= 0.0 {
            return None;
        }
        let mut angle = angle::from_pulses(&pulses, tacho.pulses_per_rev, self.sample_rate_hz, run.samples.len())?;
        angle.iter_mut().for_each(|a| *a /= order);
        let seconds = (angle.len() - 1) as f64 / self.sample_rate_hz;
        let speed = (angle[angle.len() - 1] - angle[0]) / seconds;
        (speed.is_finite() && speed > 0.0).then_some((angle, speed))
    }

    /// The comb field of all channels.
    pub fn comb_field(&self, transforms: &mut Transforms) -> CombField {
        let signals: Vec<&[f64]> = self.channels.iter().map(|c| c.2.samples.as_slice()).collect();
        CombField::new(transforms, &signals, self.sample_rate_hz)
    }
}

/// Orders of the comb that finds the speed: the first mesh harmonics of every stage and the first orders of every shaft.
pub fn comb_orders(train: &Train) -> Vec<f64> {
    let mut out = Vec::new();
    for stage in &train.stages {
        out.extend((1..=5).map(|h| stage.mesh_order * f64::from(h)));
    }
    out
}

/// Reads one steady recording, given the input-shaft speed that the comb search found.
pub fn read(
    transforms: &mut Transforms,
    bench: &Bench,
    train: &Train,
    steady: &Steady<'_>,
    input_hz: f64,
    comb_score: f64,
) -> RecordingFeatures {
    let rate = steady.sample_rate_hz;
    let len = steady.channels.iter().map(|c| c.2.samples.len()).min().unwrap_or(0);
    let tacho = steady.tacho_angle(train);
    let tacho_input_hz = tacho.as_ref().map(|t| t.1);
    let start: Vec<f64> = (0..len).map(|n| input_hz * n as f64 / rate).collect();
    let slowest = train.shafts.iter().map(|s| s.1).fold(f64::INFINITY, f64::min) * input_hz;
    let half_width = (0.4 * slowest).min(1.5);
    let mesh_orders: Vec<f64> = train.stages.iter().map(|s| s.mesh_order).collect();
    let signals: Vec<&[f64]> = steady.channels.iter().map(|c| c.2.samples.as_slice()).collect();
    // The tacho follows the wander of the speed, the comb knows its mean against the sample clock: start from both.
    let start = match &tacho {
        Some((angle, speed)) => (0..len).map(|n| at_sample(angle, n as f64 * input_hz / speed)).collect(),
        None => start,
    };
    let (angle, carried) = carriers::refine(transforms, &signals, rate, &start, &mesh_orders, half_width);
    let revolutions = (angle[len - 1] - angle[0]) * len as f64 / (len - 1) as f64;
    let input_hz = revolutions * rate / len as f64;
    let start_rev = tacho.as_ref().map_or(0.0, |t| t.0[0]);
    let lines = lines::of_train(train, bench.belt.is_some(), SEPARABLE_BINS / revolutions);
    let taken = occupied(len / 2 + 1, lines.iter().map(|l| l.order * revolutions));
    let mut of_shafts = taken.clone();
    for (_, order) in &train.shafts {
        // A shaft's whole comb can go where that leaves most bins free.
        let spacing = order * revolutions;
        if spacing > COMB_SPACING {
            let count = ((len / 2) as f64 / spacing) as usize;
            let whole = occupied(len / 2 + 1, (1..=count).map(|m| m as f64 * spacing));
            of_shafts.iter_mut().zip(whole).for_each(|(a, b)| *a |= b);
        }
    }
    let channels = steady
        .channels
        .iter()
        .map(|(name, unit, run)| {
            let samples = &run.samples[..len];
            let angle_signal = dsp::resample_to_angle(transforms, samples, &angle);
            let order_spectrum = dsp::windowed_spectrum(transforms, &angle_signal);
            let highest = USABLE_BAND * rate / input_hz;
            let order_floor = floor_of(&order_spectrum, &taken);
            let combs: Vec<Vec<LineValue>> = train
                .shafts
                .iter()
                .map(|(_, order)| comb(&order_spectrum, &order_floor, order * revolutions, highest * revolutions))
                .collect();
            let fit = LineFit {
                spectrum: &order_spectrum,
                floor: &order_floor,
                lines: &lines,
                shafts: &train.shafts,
                combs: &combs,
                revolutions,
            };
            let values = fit.all(highest);
            let floor = bands(&order_spectrum, &taken, rate / len as f64, rate);
            let remainder = dsp::remainder_over_time(transforms, &order_spectrum, &of_shafts, &angle);
            let remainder_floor = floor_of(&remainder, &of_shafts);
            ChannelFeatures {
                name: (*name).to_owned(),
                unit: (*unit).to_owned(),
                values,
                combs,
                floor,
                order_spectrum,
                order_floor,
                remainder,
                remainder_floor,
                angle_signal,
                integrity: integrity::check(samples, run.quality),
            }
        })
        .collect();
    RecordingFeatures {
        name: steady.recording.name.clone(),
        display_motor_hz: steady.display_motor_hz,
        brake_torque_nm: steady.brake_torque_nm,
        input_hz,
        tacho_input_hz,
        comb_score,
        carriers: carried,
        revolutions,
        start_rev,
        hz_per_bin: rate / len as f64,
        sample_rate_hz: rate,
        lines,
        taken: of_shafts,
        phase_rev: angle,
        channels,
    }
}

/// Angle by the tacho at a time in its own samples: where the sample clock is off, sample `n` was not taken at `n` steps of the tacho's time.
fn at_sample(angle: &[f64], position: f64) -> f64 {
    let k = (position as usize).min(angle.len() - 2);
    angle[k] + (angle[k + 1] - angle[k]) * (position - k as f64)
}

/// Bins within the main lobe of a line.
pub fn occupied(len: usize, positions: impl Iterator<Item = f64>) -> Vec<bool> {
    let mut taken = vec![false; len];
    for p in positions {
        let centre = p.round() as usize;
        for t in
            taken.iter_mut().take((centre + MAIN_LOBE_BINS).min(len)).skip(centre.saturating_sub(MAIN_LOBE_BINS - 1))
        {
            *t = true;
        }
    }
    taken
}

/// Mean noise power of each bin from the median of its free neighbours (median of exponential = ln 2 × mean).
fn floor_of(spectrum: &[Complex64], taken: &[bool]) -> Vec<f64> {
    let step = NOISE_BINS / 2;
    let mut knots: Vec<f64> = Vec::new();
    let mut window = Vec::with_capacity(8 * NOISE_BINS);
    let mut centre = 0;
    while centre < spectrum.len() + step {
        let mut half = NOISE_BINS;
        loop {
            window.clear();
            let high = (centre + half + 1).min(spectrum.len());
            for k in centre.saturating_sub(half).min(high)..high {
                if !taken[k] {
                    window.push(spectrum[k].norm_sqr());
                }
            }
            // Crowded neighbourhoods are widened until enough free bins stand for the noise.
            if window.len() >= NOISE_BINS / 2 || half >= 4 * NOISE_BINS {
                break;
            }
            half *= 2;
        }
        let value = median(&mut window) / std::f64::consts::LN_2;
        knots.push(if value.is_finite() && value > 0.0 {
            value
        } else {
            knots.last().copied().unwrap_or(f64::MIN_POSITIVE)
        });
        centre += step;
    }
    (0..spectrum.len())
        .map(|i| {
            let k = i / step;
            let t = (i % step) as f64 / step as f64;
            knots[k] * (1.0 - t) + knots[(k + 1).min(knots.len() - 1)] * t
        })
        .collect()
}

/// Amplitudes at the multiples of a spacing (bins), each by itself.
fn comb(spectrum: &[Complex64], floor: &[f64], spacing: f64, highest: f64) -> Vec<LineValue> {
    let end = highest.min((spectrum.len() - 2 * MAIN_LOBE_BINS) as f64);
    (1..)
        .map(|n| f64::from(n) * spacing)
        .take_while(|p| *p < end)
        .map(|position| {
            let bin = position.round() as usize;
            let (mut sum, mut weight) = (Complex64::ZERO, 0.0);
            for (k, value) in spectrum.iter().enumerate().take(bin + 2).skip(bin.saturating_sub(1)) {
                let w = dsp::window_response(k as f64 - position);
                sum += w.conj() * value;
                weight += w.norm_sqr();
            }
            LineValue { amplitude: sum / weight, noise: floor[bin] * LINE_FIT_NOISE_GAIN }
        })
        .collect()
}

/// What the lines of one spectrum are read from.
struct LineFit<'a> {
    spectrum: &'a [Complex64],
    floor: &'a [f64],
    lines: &'a [Line],
    shafts: &'a [(String, f64)],
    combs: &'a [Vec<LineValue>],
    revolutions: f64,
}

/// Power of a multiple of a shaft that nobody listed over the median of its neighbours on the comb.
const UNLISTED: f64 = 4.0;
/// Neighbours on each side.
const BESIDE: usize = 4;

impl LineFit<'_> {
    /// Amplitudes of all lines by least squares over the bins about each, jointly with the lines beside it.
    ///
    /// Errors of the teeth put a little on every multiple of every shaft. Where such a multiple lies in a line's bins without being listed, it beats with the
    /// line at a phase that differs from recording to recording; it takes part as a random amplitude of the size that its comb has there, so
    /// that the line's noise says how far it can be told from it.
    fn all(&self, highest_order: f64) -> Vec<Option<LineValue>> {
        let usable = self.lines.partition_point(|l| l.order < highest_order);
        let mut out = vec![None; self.lines.len()];
        for (i, slot) in out.iter_mut().enumerate().take(usable) {
            *slot = self.one(i, usable);
        }
        out
    }

    fn one(&self, i: usize, usable: usize) -> Option<LineValue> {
        let reach = 2.0 * MAIN_LOBE_BINS as f64;
        let position = self.lines[i].order * self.revolutions;
        let bin = position.round() as usize;
        if bin < 2 * MAIN_LOBE_BINS || bin + 2 * MAIN_LOBE_BINS >= self.spectrum.len() {
            return None;
        }
        let far = |l: &Line| (l.order * self.revolutions - position).abs() > reach;
        let first = self.lines[..i].iter().rposition(far).map_or(0, |k| k + 1);
        let last = self.lines[i..usable].iter().position(far).map_or(usable, |k| i + k);
        let (low, high) = (bin - MAIN_LOBE_BINS, bin + MAIN_LOBE_BINS);
        // Only lines that reach into these bins take part.
        let reaches = |p: f64| p > low as f64 - 3.0 && p < high as f64 + 3.0;
        // Positions, and the power of those that are random.
        let mut members: Vec<(f64, Option<f64>)> = vec![(position, None)];
        let listed = (first..last).filter(|k| *k != i).map(|k| self.lines[k].order * self.revolutions);
        members.extend(listed.filter(|p| reaches(*p)).map(|p| (p, None)));
        for ((_, order), comb) in self.shafts.iter().zip(self.combs) {
            let spacing = order * self.revolutions;
            let nearest = (position / spacing).round() as usize;
            for n in nearest.saturating_sub(BESIDE).max(1)..=nearest + BESIDE {
                let p = n as f64 * spacing;
                let same = lines::SAME_LINE * self.revolutions;
                if reaches(p) && members.iter().all(|m| (m.0 - p).abs() > same) {
                    members.push((p, Some(usual_power(comb, n))));
                }
            }
        }
        let n = members.len();
        let mut normal = nalgebra::DMatrix::<Complex64>::zeros(n, n);
        let mut right = nalgebra::DVector::<Complex64>::zeros(n);
        let mut row = vec![Complex64::ZERO; n];
        for (k, bin_value) in self.spectrum.iter().enumerate().take(high + 1).skip(low) {
            row.iter_mut().zip(&members).for_each(|(r, m)| *r = dsp::window_response(k as f64 - m.0));
            for a in 0..n {
                right[a] += row[a].conj() * bin_value;
                for b in 0..n {
                    normal[(a, b)] += row[a].conj() * row[b];
                }
            }
        }
        // Alone, a line's normal equation is the energy of the window response; crowding raises the variance by this factor.
        let alone = normal[(0, 0)].re;
        let noise = self.floor[bin] * LINE_FIT_NOISE_GAIN;
        for (a, (_, power)) in members.iter().enumerate() {
            if let Some(power) = power {
                normal[(a, a)] += noise * alone / power.max(f64::MIN_POSITIVE);
            }
        }
        let inverse = normal.try_inverse()?;
        let amplitude = (0..n).map(|a| inverse[(0, a)] * right[a]).sum();
        let crowding = (inverse[(0, 0)].re * alone).max(1.0);
        Some(LineValue { amplitude, noise: noise * crowding })
    }
}

/// Power that a multiple of a shaft usually has where nobody listed it: that of its neighbours.
fn usual_power(comb: &[LineValue], n: usize) -> f64 {
    let beside = (n.saturating_sub(BESIDE).max(1)..=n + BESIDE).filter(|k| *k != n);
    let mut powers: Vec<f64> = beside.filter_map(|k| comb.get(k - 1)).map(|l| l.amplitude.norm_sqr()).collect();
    if powers.is_empty() { 0.0 } else { UNLISTED * median(&mut powers) }
}

/// The value below which a quarter lies; `NaN` of nothing. Lines that nobody listed sit in the upper part of a band, its lower quartile
/// is noise: −ln 0.75 of the mean of an exponential distribution.
fn lower_quartile(values: &mut [f64]) -> f64 {
    if values.is_empty() {
        return f64::NAN;
    }
    let at = values.len() / 4;
    let (_, quartile, _) = values.select_nth_unstable_by(at, f64::total_cmp);
    *quartile
}

/// Background in sixths of an octave, between the lines.
fn bands(spectrum: &[Complex64], taken: &[bool], hz_per_bin: f64, rate: f64) -> Vec<FloorBand> {
    let mut out = Vec::new();
    let ratio = 2f64.powf(1.0 / BANDS_PER_OCTAVE);
    let mut low = FIRST_BAND_HZ;
    while low * ratio < USABLE_BAND * rate {
        let (a, b) = ((low / hz_per_bin) as usize, ((low * ratio / hz_per_bin) as usize).min(spectrum.len()));
        let mut powers: Vec<f64> = (a..b).filter(|&k| !taken[k]).map(|k| spectrum[k].norm_sqr()).collect();
        let bins = powers.len();
        out.push(FloorBand {
            frequency_hz: low * ratio.sqrt(),
            power: lower_quartile(&mut powers) / -(0.75f64.ln()),
            bins,
        });
        low *= ratio;
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    /// A line, and 0.3 bins beside it a multiple of another shaft half as large, unlisted, at any phase. By itself the line would be read wrong by up to a
    /// half; the joint fit tells both apart where there is little noise, and prices it. With noise as large as the neighbour it owns up to the doubt.
    #[test]
    fn analytic_a_line_beside_another_comb_is_told_apart_at_a_price() {
        const LEN: usize = 8192;
        const REVOLUTIONS: f64 = 64.0;
        let shafts = [("a".to_owned(), 1.0), ("b".to_owned(), (9.5 + 0.3 / REVOLUTIONS) / 20.0)];
        let family = crate::lines::Family::Shaft { shaft: 0, multiple: 9 };
        let lines = [Line { family, order: 9.5 }];
        let read = |phase: f64, floor: f64| {
            let signal: Vec<f64> = (0..LEN)
                .map(|n| {
                    let turn = n as f64 * REVOLUTIONS / LEN as f64;
                    // The other shaft makes all its multiples alike.
                    let comb: f64 = (14..27).map(|k| (TAU * shafts[1].1 * f64::from(k) * turn + phase).cos()).sum();
                    (TAU * 9.5 * turn).cos() + 0.5 * comb
                })
                .collect();
            let spectrum = dsp::windowed_spectrum(&mut Transforms::default(), &signal);
            let floor = vec![floor; spectrum.len()];
            let combs: Vec<Vec<LineValue>> =
                shafts.iter().map(|s| comb(&spectrum, &floor, s.1 * REVOLUTIONS, 40.0 * REVOLUTIONS)).collect();
            let alone = comb(&spectrum, &floor, 9.5 * REVOLUTIONS, 40.0 * REVOLUTIONS)[0];
            let (spectrum, floor, lines, combs) = (&spectrum, &floor[..], &lines[..], &combs[..]);
            let fit = LineFit { spectrum, floor, lines, shafts: &shafts, combs, revolutions: REVOLUTIONS };
            (fit.all(40.0)[0].unwrap(), alone)
        };
        let mut worst_alone = 0.0f64;
        for k in 0..16 {
            let phase = TAU * f64::from(k) / 16.0;
            let (value, alone) = read(phase, 1e-8);
            worst_alone = worst_alone.max((alone.amplitude.norm() - 1.0).abs());
            assert!((value.amplitude.norm() - 1.0).abs() < 1e-3, "{value:?}");
            // Window responses 0.3 bins apart agree to 0.98: 1/(1 − 0.98²) = 25 times the variance.
            assert!((10.0..60.0).contains(&(value.noise / alone.noise)), "{value:?} {alone:?}");
            let (value, _) = read(phase, 0.25);
            let off = value.amplitude.norm() - 1.0;
            assert!(off.powi(2) < 2.0 * value.noise && value.noise > 0.25, "{value:?}");
        }
        assert!(worst_alone > 0.3, "{worst_alone}");
    }
}
