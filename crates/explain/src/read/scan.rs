//! Lines that the gear train does not make: at fixed orders and at fixed frequencies.
//!
//! Each scan walks over candidate positions and asks of every recording and channel how far the
//! power there stands above its local floor and, where there is a reference, above the reference. A
//! candidate counts by its mean logarithm over recordings, each capped, so that one recording alone
//! cannot carry it.

use gearwatch_core::train::Train;
use num_complex::Complex64;

use crate::read::SAME_SPEED;
use crate::read::combs::distance_to_combs;
use crate::read::features::{ChannelFeatures, RecordingFeatures, USABLE_BAND};

/// A recording and the reference at its operating point, where there is one.
#[derive(Clone, Copy)]
pub struct Twin<'a> {
    /// The recording.
    pub recording: &'a RecordingFeatures,
    /// The reference.
    pub reference: Option<&'a RecordingFeatures>,
    /// How far beside a frequency it is read (Hz): 0 but where chance is asked.
    pub beside_hz: f64,
}

/// A line outside the train's comb.
#[derive(Clone, Debug)]
pub struct StrangeLine {
    /// Order of the input shaft, or frequency in Hz.
    pub position: f64,
    /// Position of the channel that shows it best.
    pub channel: usize,
    /// Mean over recordings of ln(power / what was expected), best channel.
    pub excess: f64,
    /// Least of them.
    pub least: f64,
    /// Mean excess by channel.
    pub by_channel: Vec<f64>,
    /// Peak amplitude by recording, in the best channel.
    pub amplitudes: Vec<f64>,
    /// Distance to the nearest multiple of a shaft order relative to the line width; large where
    /// the line belongs to no shaft.
    pub off_comb: f64,
}

/// Cap of ln(power / expected) of one recording.
const CAP: f64 = 6.0;
/// Power over floor that makes a candidate in one spectrum.
const CANDIDATE: f64 = 18.0;

/// Distance (orders) up to which a strong line may light others, and their share of its power: the
/// angle is not followed faster, and what is left of the speed's wander modulates the line. A line
/// 60 dB above the noise lights such at −37 to −46 dB.
const SKIRT_REACH: f64 = 0.25;
const SKIRT: f64 = 1e-3;

fn channel_of<'a>(recording: &'a RecordingFeatures, name: &str) -> Option<&'a ChannelFeatures> {
    recording.channels.iter().find(|c| c.name == name)
}

fn peak(spectrum: &[Complex64], bin: f64, reach: usize) -> (f64, usize) {
    let centre = bin.round() as usize;
    let low = centre.saturating_sub(reach);
    let high = (centre + reach + 1).min(spectrum.len());
    (low..high).map(|k| (spectrum[k].norm_sqr(), k)).fold((0.0, centre), |a, b| if b.0 > a.0 { b } else { a })
}

/// Which spectrum a scan walks over.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Axis {
    Order,
    Time,
}

fn spectrum(channel: &ChannelFeatures, axis: Axis) -> (&[Complex64], &[f64]) {
    match axis {
        Axis::Order => (&channel.order_spectrum, &channel.order_floor),
        Axis::Time => (&channel.remainder, &channel.remainder_floor),
    }
}

fn bins_per_unit(recording: &RecordingFeatures, axis: Axis) -> f64 {
    match axis {
        Axis::Order => recording.revolutions,
        Axis::Time => 1.0 / recording.hz_per_bin,
    }
}

/// ln(power / expected) of one recording, channel and position.
fn excess(twin: &Twin<'_>, name: &str, axis: Axis, position: f64) -> Option<(f64, f64)> {
    // A limit makes lines without end.
    let channel = channel_of(twin.recording, name).filter(|c| c.integrity.clipped_at.is_none())?;
    let (bins, floor) = spectrum(channel, axis);
    let position = if axis == Axis::Time { position + twin.beside_hz } else { position };
    let at = position * bins_per_unit(twin.recording, axis);
    if at < 1.0 {
        return None;
    }
    if at + 8.0 > bins.len() as f64 {
        return None;
    }
    if axis == Axis::Time && twin.recording.taken.get(at.round() as usize).copied().unwrap_or(true) {
        return None;
    }
    let (power, k) = peak(bins, at, 1);
    let mut expected = floor[k];
    if axis == Axis::Order && twin.reference.is_none() {
        let reach = (SKIRT_REACH * twin.recording.revolutions) as usize;
        expected = expected.max(SKIRT * peak(bins, at, reach).0);
    }
    if let Some(reference) = twin.reference {
        let other = channel_of(reference, name)?;
        let (bins, floor) = spectrum(other, axis);
        let at = position * bins_per_unit(reference, axis);
        let (before, j) = peak(bins, at, 2);
        expected = expected.max(before).max(*floor.get(j)?);
        // A line that keeps its order (on the time axis) or its frequency (on the order axis) in
        // the reference is an old one.
        let (bins, floor) = spectrum(other, if axis == Axis::Time { Axis::Order } else { Axis::Time });
        let ratio = if axis == Axis::Time { 1.0 / twin.recording.input_hz } else { twin.recording.input_hz };
        let at = match axis {
            Axis::Time => position * ratio * reference.revolutions,
            Axis::Order => position * ratio / reference.hz_per_bin,
        };
        let (before, j) = peak(bins, at, 2);
        expected = expected.max(before).max(*floor.get(j)?);
    }
    Some(((power / expected.max(f64::MIN_POSITIVE)).ln(), power.sqrt()))
}

/// Positions that stand out in one spectrum.
fn candidates(twin: &Twin<'_>, axis: Axis, skip: &dyn Fn(&RecordingFeatures, f64) -> bool) -> Vec<f64> {
    let mut out = Vec::new();
    let per_unit = bins_per_unit(twin.recording, axis);
    let highest = USABLE_BAND * twin.recording.sample_rate_hz / twin.recording.hz_per_bin;
    for channel in &twin.recording.channels {
        let (bins, floor) = spectrum(channel, axis);
        let end = (bins.len().saturating_sub(8)).min(highest as usize);
        for k in 24..end {
            let p = bins[k].norm_sqr();
            if p < CANDIDATE * floor[k] || p < bins[k - 1].norm_sqr() || p <= bins[k + 1].norm_sqr() {
                continue;
            }
            // Vertex of the parabola through three logarithms: the position to a tenth of a bin.
            let (a, b, c) = (bins[k - 1].norm_sqr().ln(), p.ln(), bins[k + 1].norm_sqr().ln());
            let shift = 0.5 * (a - c) / (a - 2.0 * b + c);
            let position = (k as f64 + if shift.is_finite() { shift } else { 0.0 }) / per_unit;
            if skip(twin.recording, position) {
                continue;
            }
            let position = if axis == Axis::Time { position - twin.beside_hz } else { position };
            if let Some((e, _)) = excess(twin, &channel.name, axis, position)
                && e > 2.0
            {
                out.push(position);
            }
        }
    }
    out
}

fn walk(
    twins: &[Twin<'_>],
    channels: &[String],
    axis: Axis,
    skip: &dyn Fn(&RecordingFeatures, f64) -> bool,
    off_comb: &dyn Fn(f64) -> f64,
) -> Vec<StrangeLine> {
    let mut positions: Vec<f64> = twins.iter().flat_map(|t| candidates(t, axis, skip)).collect();
    positions.sort_by(f64::total_cmp);
    let width = twins.iter().map(|t| 1.0 / bins_per_unit(t.recording, axis)).fold(0.0, f64::max);
    let of_speed = speeds(twins);
    let several = of_speed.iter().any(|k| *k > 0);
    let mut found: Vec<StrangeLine> = Vec::new();
    for position in positions {
        let mut best: Option<StrangeLine> = None;
        let mut by_channel = Vec::with_capacity(channels.len());
        for (c, name) in channels.iter().enumerate() {
            let judged: Vec<Option<(f64, f64)>> = twins.iter().map(|t| excess(t, name, axis, position)).collect();
            let cells: Vec<(f64, f64)> = judged.iter().flatten().copied().collect();
            // A line above the band at the higher speed is judged where it can be seen, at two
            // recordings at least; one of a fixed frequency at two speeds.
            let first = judged.iter().zip(&of_speed).find(|x| x.0.is_some()).map(|x| x.1);
            let at_one = judged.iter().zip(&of_speed).all(|(cell, speed)| cell.is_none() || Some(speed) == first);
            if cells.len() < 2.min(twins.len()) || (axis == Axis::Time && several && at_one) {
                by_channel.push(0.0);
                continue;
            }
            let mean = cells.iter().map(|x| x.0.clamp(-1.0, CAP)).sum::<f64>() / cells.len() as f64;
            let least = cells.iter().map(|x| x.0).fold(f64::INFINITY, f64::min);
            by_channel.push(mean);
            if best.as_ref().is_none_or(|b| mean > b.excess) {
                best = Some(StrangeLine {
                    position,
                    channel: c,
                    excess: mean,
                    least,
                    by_channel: Vec::new(),
                    amplitudes: cells.iter().map(|x| x.1).collect(),
                    off_comb: off_comb(position),
                });
            }
        }
        let Some(mut line) = best else { continue };
        line.by_channel = by_channel;
        match found.last_mut() {
            Some(last) if position - last.position < 2.0 * width => {
                if line.excess > last.excess {
                    *last = line;
                }
            }
            _ => found.push(line),
        }
    }
    found.retain(|l| l.excess > 2.0);
    found.sort_by(|a, b| b.excess.total_cmp(&a.excess));
    found
}

/// Lines locked to shaft angle that are not in the train's list.
pub fn order_lines(twins: &[Twin<'_>], channels: &[String], train: &Train) -> Vec<StrangeLine> {
    let known = |r: &RecordingFeatures, order: f64| {
        let reach = 4.0 / r.revolutions;
        let i = r.lines.partition_point(|l| l.order < order - reach);
        r.lines.get(i).is_some_and(|l| l.order < order + reach)
    };
    let width = twins.iter().map(|t| 1.0 / t.recording.revolutions).fold(0.0, f64::max);
    let off = |order: f64| distance_to_combs(train, width.recip(), order) / width;
    walk(twins, channels, Axis::Order, &known, &off)
}

/// Lines at the same frequency at every speed; needs recordings at speeds that differ, or the
/// reference, to mean anything.
pub fn fixed_lines(twins: &[Twin<'_>], channels: &[String], train: &Train) -> Vec<StrangeLine> {
    let known =
        |r: &RecordingFeatures, hz: f64| r.taken.get((hz / r.hz_per_bin).round() as usize).copied().unwrap_or(true);
    let off = |hz: f64| {
        twins
            .iter()
            .map(|t| {
                let (r, order) = (t.recording, (hz + t.beside_hz) / t.recording.input_hz);
                distance_to_combs(train, r.revolutions, order) * r.revolutions
            })
            .fold(0.0, f64::max)
    };
    walk(twins, channels, Axis::Time, &known, &off)
}

/// Distances (bins) at which the recordings of other speeds are read beside each other: beyond what
/// a line is wide, within what a path is even.
const BESIDE_BINS: [f64; 8] = [-97.0, -83.0, -59.0, -41.0, 37.0, 53.0, 71.0, 89.0];

/// Which of the speeds that occur each recording has, counted as they come.
fn speeds(twins: &[Twin<'_>]) -> Vec<usize> {
    let mut known: Vec<f64> = Vec::new();
    let mut of = |hz: f64| {
        known.iter().position(|s| (s / hz - 1.0).abs() < SAME_SPEED).unwrap_or_else(|| {
            known.push(hz);
            known.len() - 1
        })
    };
    twins.iter().map(|t| of(t.recording.input_hz)).collect()
}

/// What the machine's own lines do by chance: the lines that a scan for fixed frequencies finds
/// where each speed is read at another distance beside the others, once for each distance. Empty
/// where there is one speed only.
pub fn fixed_by_chance(twins: &[Twin<'_>], channels: &[String], train: &Train) -> Vec<Vec<StrangeLine>> {
    let of_speed = speeds(twins);
    if of_speed.iter().all(|k| *k == 0) {
        return Vec::new();
    }
    let width = twins.iter().map(|t| t.recording.hz_per_bin).fold(0.0, f64::max);
    let beside = |bins: f64| {
        let moved: Vec<Twin<'_>> =
            twins.iter().zip(&of_speed).map(|(t, k)| Twin { beside_hz: *k as f64 * bins * width, ..*t }).collect();
        fixed_lines(&moved, channels, train)
    };
    BESIDE_BINS.map(beside).into()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::read::combs::tests::pair;
    use crate::read::integrity::Integrity;

    const HZ_PER_BIN: f64 = 0.25;
    const BINS: usize = 16_384;

    /// A recording of one sensor whose remainder and order spectrum are of noise of power 1 but for
    /// lines (bin, power).
    fn recording(input_hz: f64, fixed: &[(usize, f64)], orders: &[(usize, f64)], taken: &[usize]) -> RecordingFeatures {
        let spectrum = |lines: &[(usize, f64)]| {
            let mut out = vec![Complex64::ONE; BINS];
            lines.iter().for_each(|(bin, power)| out[*bin] = Complex64::from(power.sqrt()));
            out
        };
        let channel = ChannelFeatures {
            name: "acc".into(),
            unit: "m/s^2".into(),
            values: Vec::new(),
            combs: Vec::new(),
            floor: Vec::new(),
            order_spectrum: spectrum(orders),
            order_floor: vec![1.0; BINS],
            remainder: spectrum(fixed),
            remainder_floor: vec![1.0; BINS],
            angle_signal: Vec::new(),
            integrity: Integrity { clipped_at: None, frozen: 0, overload: false },
        };
        RecordingFeatures {
            name: String::new(),
            display_motor_hz: f64::NAN,
            brake_torque_nm: f64::NAN,
            input_hz,
            tacho_input_hz: None,
            comb_score: 0.0,
            carriers: 0,
            revolutions: input_hz / HZ_PER_BIN,
            start_rev: 0.0,
            hz_per_bin: HZ_PER_BIN,
            sample_rate_hz: 8192.0,
            lines: Vec::new(),
            taken: (0..BINS).map(|k| taken.contains(&k)).collect(),
            phase_rev: Vec::new(),
            swing: None,
            channels: vec![channel],
        }
    }

    fn twins(recordings: &[RecordingFeatures]) -> Vec<Twin<'_>> {
        recordings.iter().map(|recording| Twin { recording, reference: None, beside_hz: 0.0 }).collect()
    }

    /// A line at 700 Hz at two speeds is one of fixed frequency. Lines of the machine 53 bins apart
    /// are none, and meet in the one scan in which the speeds are read so far beside each other. A
    /// line that the machine's own cover at one speed is judged at the other alone, which says
    /// nothing.
    #[test]
    fn analytic_lines_that_meet_by_chance_are_counted() {
        let slow = recording(20.0, &[(2800, 400.0), (4000, 400.0), (6000, 400.0)], &[], &[]);
        let fast = recording(31.0, &[(2800, 400.0), (4053, 400.0)], &[], &[5999, 6000, 6001]);
        let (both, train) = ([slow, fast], pair(23, 57));
        let channels = ["acc".to_owned()];
        // Lines that stand out in every recording.
        let hz = |found: &[StrangeLine]| -> Vec<f64> {
            found.iter().filter(|l| l.least > 2.0).map(|l| l.position.round()).collect()
        };
        assert_eq!(hz(&fixed_lines(&twins(&both), &channels, &train)), [700.0]);
        let by_chance = fixed_by_chance(&twins(&both), &channels, &train);
        let met: Vec<usize> = (0..by_chance.len()).filter(|k| !hz(&by_chance[*k]).is_empty()).collect();
        assert_eq!(met.iter().map(|k| BESIDE_BINS[*k]).collect::<Vec<_>>(), [53.0]);
        assert_eq!(hz(&by_chance[met[0]]), [1000.0]);
        assert!(fixed_by_chance(&twins(&both[..1]), &channels, &train).is_empty());
    }

    /// A line 56 dB above the noise hides one 36 dB below it in the next quarter of a turn, which
    /// it may light itself, and not one 20 dB below it, nor one beyond.
    #[test]
    fn analytic_a_strong_line_hides_what_it_lights() {
        let strong = (4000, 400_000.0);
        let of = |near: (usize, f64)| {
            let one = [recording(20.0, &[], &[strong, near], &[])];
            let found = order_lines(&twins(&one), &["acc".to_owned()], &pair(23, 57));
            found.iter().any(|l| (l.position * one[0].revolutions).round() == near.0 as f64)
        };
        assert!(!of((4015, 100.0)));
        assert!(of((4015, 4000.0)));
        assert!(of((4035, 100.0)));
    }
}
