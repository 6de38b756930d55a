//! What changed within one revolution of a gear: recording minus reference, line by line and with
//! phase.
//!
//! The train starts anywhere, so the lines `n` of a shaft's comb turn by `exp(2πi n ψ)` between a
//! recording and its reference. `ψ` is where the phases of all lines agree best: mesh harmonics fix
//! it to a tooth, the usual differences between teeth say which. The difference `Δ_n` that is left
//! belongs to the change alone. A fault of one tooth gives neighbouring lines phases that advance
//! evenly (the Fourier transform of a pulse), whatever the path does to their amplitudes; errors of
//! all teeth give phases without order. How `|Δ_n|` follows the torque at one speed needs no model:
//! the path is the same (PHYSICS 4: L04; stiffness lost goes with the load, geometry does not).

use num_complex::Complex64;

use crate::change::align::{self, CLEAR, Twin};
use crate::question::Question;
use crate::read::dsp::median;
use crate::read::features::{ChannelFeatures, RecordingFeatures, line_at};

/// Lines on each side of a mesh harmonic that count as beside it.
const BESIDE: usize = 5;
/// Lines over which a gain is alike (standard deviation of the weights), where they end, and the
/// usual gain between two loads.
const GAIN_LINES: f64 = 3.0;
const GAIN_REACH: usize = 9;
const USUAL_GAIN: f64 = 0.1;
/// Neighbours that a pair must show for a pattern of its teeth.
const LEAST_NEIGHBOURS: usize = 30;
/// Least agreement of phases (0–1) at which recording and reference count as aligned.
const ALIGNED: f64 = 0.25;

/// `Δ_n` and its noise power.
type Change = (Complex64, f64);

/// The change of a shaft's comb at one operating point and channel.
pub struct Difference {
    /// Position of the pair.
    pub pair: usize,
    /// Position of the channel in the recording.
    pub channel: usize,
    /// `Δ_n` and its noise power, from `n` = 1; `None` at mesh harmonics and where there is nothing
    /// to see.
    pub lines: Vec<Option<Change>>,
}

/// The changes of everything that repeats with a shaft, where recording and reference could be
/// aligned.
pub fn changes(q: &Question<'_>, shaft: usize) -> Vec<Difference> {
    differences(q, shaft, false).0
}

/// The same without what a gain that is smooth over the comb accounts for: another load or
/// stiffness changes all lines of a bench without damage in common with their neighbours.
pub fn changes_beyond_gain(q: &Question<'_>, shaft: usize) -> Vec<Difference> {
    differences(q, shaft, true).0
}

/// What the change of a gear's comb is like.
#[derive(Clone, Copy, Debug, Default)]
pub struct GearChange {
    /// Even advance of the phases of neighbouring lines, 0 (none) to 1 (one pulse a revolution),
    /// chance taken off.
    pub coherence: f64,
    /// Neighbouring lines that it rests on.
    pub neighbours: usize,
    /// Exponent of the change over the torque, with its standard error; needs two loads at one
    /// speed.
    pub exponent: Option<(f64, f64)>,
    /// How many times more often than by chance clear lines lie beside the mesh harmonics of the
    /// stage.
    pub near: f64,
    /// Operating points that could be aligned.
    pub aligned: usize,
}

/// Recordings that are compared: each with its reference, or without any reference at all each high
/// load with the lowest at its speed.
pub fn twins<'a>(q: &'a Question<'a>) -> Vec<(usize, &'a RecordingFeatures, &'a RecordingFeatures)> {
    if !q.comparison.pairs.is_empty() {
        let pair = |(p, pair): (usize, &crate::change::compare::Pair)| {
            (p, &q.recordings[pair.recording], &q.references[pair.reference])
        };
        return q.comparison.pairs.iter().enumerate().map(pair).collect();
    }
    let mut out = Vec::new();
    for (p, high) in q.recordings.iter().enumerate() {
        let low = q
            .recordings
            .iter()
            .filter(|r| {
                (r.input_hz / high.input_hz - 1.0).abs() < 0.03 && high.brake_torque_nm > 1.3 * r.brake_torque_nm
            })
            .min_by(|a, b| a.brake_torque_nm.total_cmp(&b.brake_torque_nm));
        if let Some(low) = low {
            out.push((p, high, low));
        }
    }
    out
}

/// Lines of a shaft's comb in recording and reference that no line of another shaft reaches into.
fn own_lines(
    q: &Question<'_>,
    now: (&RecordingFeatures, &ChannelFeatures),
    before: (&RecordingFeatures, &ChannelFeatures),
    shaft: usize,
) -> Vec<Twin> {
    let pairs = now.1.combs[shaft].iter().zip(&before.1.combs[shaft]);
    pairs
        .zip(1..)
        .filter(|(_, n)| [now, before].iter().all(|(r, c)| !align::crowded(q, r, c, shaft, *n)))
        .map(|((now, before), n)| Twin { n, now: *now, before: *before })
        .collect()
}

/// Takes `g_n R_n` from each line's change, `R` the reference and `g_n` the gain that fits the
/// changes of the lines beside it (least squares with noise, the usual gain as prior); a line has
/// no say in its own.
fn take_out_gain(own: &[Twin], changes: &mut [(usize, Change)]) {
    let seen: Vec<(usize, Complex64, Complex64, f64)> = own
        .iter()
        .zip(changes.iter())
        .map(|(l, (n, (delta, noise)))| (*n, l.before.amplitude, *delta, 1.0 / noise.max(f64::MIN_POSITIVE)))
        .collect();
    for (k, (n, (delta, _))) in changes.iter_mut().enumerate() {
        let first = seen.partition_point(|s| s.0 + GAIN_REACH < *n);
        let end = seen.partition_point(|s| s.0 <= *n + GAIN_REACH);
        let (mut sum, mut weight) = (Complex64::ZERO, USUAL_GAIN.powi(-2));
        for (m, before, change, certain) in seen[first..end].iter().filter(|s| s.0 != *n) {
            let near = (-0.5 * (m.abs_diff(*n) as f64 / GAIN_LINES).powi(2)).exp() * certain;
            sum += change * before.conj() * near;
            weight += before.norm_sqr() * near;
        }
        *delta -= sum / weight * seen[k].1;
    }
}

fn differences(q: &Question<'_>, shaft: usize, beyond_gain: bool) -> (Vec<Difference>, usize) {
    let mut out = Vec::new();
    let mut aligned = 0;
    let mut teeth: Vec<usize> = Vec::new();
    if let Some(s) = q.bench.stages.get(shaft) {
        teeth.push(s.pinion.teeth as usize);
    }
    if let Some(s) = shaft.checked_sub(1).and_then(|i| q.bench.stages.get(i)) {
        teeth.push(s.wheel.teeth as usize);
    }
    for (p, rec, reference) in twins(q) {
        let known = &q.comparison.channels;
        let of = |r: &'_ RecordingFeatures, name: &str| r.channels.iter().position(|c| c.name == name);
        let channels: Vec<(usize, Vec<Twin>)> = rec
            .channels
            .iter()
            .enumerate()
            .filter(|(_, c)| known.is_empty() || known.contains(&c.name))
            .filter_map(|(k, c)| Some((k, c, &reference.channels[of(reference, &c.name)?])))
            .filter(|(_, now, before)| [now, before].iter().all(|c| q.tells_teeth(c)))
            .map(|(k, now, before)| (k, own_lines(q, (rec, now), (reference, before), shaft)))
            .collect();
        let all: Vec<&Twin> = channels.iter().flat_map(|c| &c.1).collect();
        let Some((psi, agreement)) = align::turn(&all) else { continue };
        if agreement < ALIGNED {
            continue;
        }
        aligned += 1;
        for (channel, own) in &channels {
            let mut changes: Vec<(usize, Change)> = own.iter().map(|l| (l.n, l.change(psi))).collect();
            if beyond_gain {
                take_out_gain(own, &mut changes);
            }
            let mut lines = vec![None; own.last().map_or(0, |l| l.n)];
            for (n, change) in changes.into_iter().filter(|(n, _)| teeth.iter().all(|z| n % z != 0)) {
                lines[n - 1] = Some(change);
            }
            out.push(Difference { pair: p, channel: *channel, lines });
        }
    }
    (out, aligned)
}

/// What recordings hold beside the lines of a shaft's comb, so many of its orders above each:
/// nothing that repeats with the shaft. Where lines of any shaft reach into it there is none.
pub fn beside(q: &Question<'_>, shaft: usize, shift: f64) -> Vec<Difference> {
    let mut out = Vec::new();
    for (pair, rec, _) in twins(q) {
        for (channel, c) in rec.channels.iter().enumerate().filter(|(_, c)| q.tells_teeth(c)) {
            let value = |n: usize| {
                let order = (n as f64 + shift) * q.train.shafts[shaft].1;
                let own = line_at(&c.order_spectrum, &c.order_floor, order * rec.revolutions)?;
                let alone = (0..q.train.shafts.len()).all(|j| !align::reaches(q, (rec, c), j, order, &own));
                alone.then_some((own.amplitude, own.noise))
            };
            out.push(Difference { pair, channel, lines: (1..=c.combs[shaft].len()).map(value).collect() });
        }
    }
    out
}

fn clear(l: &Option<(Complex64, f64)>) -> Option<(Complex64, f64)> {
    l.filter(|(d, n)| d.norm_sqr() > CLEAR * n)
}

/// Looks at the change of everything that repeats with a shaft; `stage` says about which mesh
/// harmonics "near" is meant.
pub fn change(q: &Question<'_>, stage: usize, shaft: usize) -> GearChange {
    let (differences, aligned) = differences(q, shaft, false);
    let z =
        q.bench.stages.get(stage).map_or(1, |s| (if shaft == stage { s.pinion.teeth } else { s.wheel.teeth }) as usize);
    let (mut sum, mut weight, mut neighbours) = (0.0, 0.0, 0usize);
    let (mut near, mut all) = (0.0, 0.0);
    for d in &differences {
        let (mut phasor, mut count) = (Complex64::ZERO, 0usize);
        for w in d.lines.windows(2) {
            if let (Some((a, _)), Some((b, _))) = (clear(&w[0]), clear(&w[1])) {
                let product = b * a.conj();
                phasor += product / product.norm();
                count += 1;
            }
        }
        if count >= 6 {
            let m = count as f64;
            // Random phases give |Σ|² = m; that share is taken off.
            let square = ((phasor.norm_sqr() / m - 1.0) / (m - 1.0)).max(0.0);
            sum += m * square.sqrt();
            weight += m;
            neighbours += count;
        }
        for (k, l) in d.lines.iter().enumerate().filter(|(_, l)| clear(l).is_some()) {
            let n = k + 1;
            let power = l.map_or(0.0, |(a, noise)| (a.norm_sqr() / noise).ln());
            all += power;
            if (n % z).min(z - n % z) <= BESIDE {
                near += power;
            }
        }
    }
    GearChange {
        coherence: if weight > 0.0 { sum / weight } else { 0.0 },
        neighbours,
        exponent: exponent(q, &differences),
        near: if all > 0.0 { near / all * z as f64 / (2 * BESIDE + 1) as f64 } else { 0.0 },
        aligned,
    }
}

/// How the change of a gear's comb goes from tooth to tooth.
///
/// Whatever differs from tooth to tooth gives lines `n` the discrete Fourier transform of its
/// values over the `z` teeth, which repeats with `n` modulo `z` and is conjugate at `−n`, times
/// what one tooth's contact and the path make of a line (Mark 1978). So products of neighbouring
/// lines hold `(z − 1)/2` phases at most, however many lines there are: errors of all teeth give
/// phases without order, one tooth the same for all.
#[derive(Clone, Copy, Debug)]
pub struct ToothPattern {
    /// Resultant of the phases of the residues, 0 to 1.
    pub even: f64,
    /// Residues that it rests on, by their weights.
    pub residues: f64,
    /// Phases without order reach a score of `s` with probability `exp(−s)` (Rayleigh's test:
    /// residues × resultant²), mean over pairs.
    pub score: f64,
    /// Share of the products that lines of one residue have in common; low where the change is not
    /// one of this gear's teeth.
    pub shared: f64,
    /// Products of neighbouring lines.
    pub neighbours: usize,
}

/// The pattern of the teeth in the change of a shaft's comb.
pub fn pattern(changes: &[Difference], teeth: usize) -> Option<ToothPattern> {
    let mut pairs: Vec<usize> = changes.iter().map(|d| d.pair).collect();
    pairs.dedup();
    let mut sums = ToothPattern { even: 0.0, residues: 0.0, score: 0.0, shared: 0.0, neighbours: 0 };
    let mut count = 0.0;
    for pair in pairs {
        let mut residues = vec![Complex64::ZERO; teeth.div_ceil(2)];
        let mut neighbours = 0;
        for d in changes.iter().filter(|d| d.pair == pair) {
            for (k, w) in d.lines.windows(2).enumerate() {
                if let (Some((a, _)), Some((b, _))) = (clear(&w[0]), clear(&w[1])) {
                    let product = b * a.conj();
                    let m = (k + 1) % teeth;
                    residues[m.min(teeth - 1 - m)] += product / product.norm();
                    neighbours += 1;
                }
            }
        }
        let weight: f64 = residues.iter().map(|r| r.norm()).sum();
        if neighbours < LEAST_NEIGHBOURS || weight <= 0.0 {
            continue;
        }
        let even = residues.iter().sum::<Complex64>().norm() / weight;
        let independent = weight * weight / residues.iter().map(Complex64::norm_sqr).sum::<f64>();
        count += 1.0;
        sums.even += even;
        sums.residues += independent;
        sums.score += independent * even * even;
        sums.shared += weight / neighbours as f64;
        sums.neighbours += neighbours;
    }
    (count > 0.0).then(|| ToothPattern {
        even: sums.even / count,
        residues: sums.residues / count,
        score: sums.score / count,
        shared: sums.shared / count,
        neighbours: sums.neighbours,
    })
}

/// Median over lines of `ln |Δ_high / Δ_low| / ln(T_high / T_low)` of pairs at one speed.
fn exponent(q: &Question<'_>, differences: &[Difference]) -> Option<(f64, f64)> {
    let mut values = Vec::new();
    for a in differences {
        for b in differences {
            let point = |i: usize| match q.comparison.pairs.get(i) {
                Some(p) => (p.speed_hz, p.torque_nm),
                None => (q.recordings[i].input_hz, q.recordings[i].brake_torque_nm),
            };
            let ((speed, torque), (other_speed, other_torque)) = (point(a.pair), point(b.pair));
            let ratio = other_torque / torque;
            if a.channel != b.channel || (speed / other_speed - 1.0).abs() > 0.03 || ratio.is_nan() || ratio < 1.3 {
                continue;
            }
            for (x, y) in a.lines.iter().zip(&b.lines) {
                if let (Some((d, n)), Some((e, m))) = (x, y)
                    && d.norm_sqr() + e.norm_sqr() > 3.0 * CLEAR * (n + m)
                {
                    let (low, high) = (d.norm_sqr().max(*n), e.norm_sqr().max(*m));
                    values.push(0.5 * (high / low).ln() / ratio.ln());
                }
            }
        }
    }
    if values.len() < 8 {
        return None;
    }
    let middle = median(&mut values);
    let mut spread: Vec<f64> = values.iter().map(|v| (v - middle).abs()).collect();
    // Lines share the errors of alignment and setting: a quarter of them counts as independent.
    let error = 1.4826 * median(&mut spread) * 1.25 / (values.len() as f64 / 4.0).sqrt();
    Some((middle, error.max(0.03)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::explain::Input;
    use crate::measure::measure;
    use crate::prove;
    use rand::{RngExt, SeedableRng};
    use std::f64::consts::TAU;

    /// A comb of 8 mesh harmonics as teeth with these values make it, through a path whose phase
    /// wanders slowly from line to line.
    fn comb_of(values: &[f64], seed: u64) -> Vec<Difference> {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        let z = values.len();
        let mut path = 0.0;
        let lines = (1..8 * z)
            .map(|n| {
                path += 0.3 * (random.random::<f64>() - 0.5);
                let turned =
                    |(i, v): (usize, &f64)| Complex64::from_polar(*v, -TAU * ((n * i) as f64 / z as f64) + path);
                let sum: Complex64 = values.iter().enumerate().map(turned).sum();
                (!n.is_multiple_of(z)).then_some((sum, 1e-6))
            })
            .collect();
        vec![Difference { pair: 0, channel: 0, lines }]
    }

    /// Of a drawn bench with two channels the one whose path changed has no part in a comb's change
    /// and none in what is beside it.
    #[test]
    fn conform_a_channel_whose_path_changed_says_nothing_of_teeth() {
        let measured = |index: u64| {
            let case = prove::case(2_026_112_701, index, Some("eccentricity"))?;
            let (recordings, reference) = (&case.recordings, &case.reference);
            let input = Input { bench: &case.bench, recordings, reference, without: &[] };
            let measured = measure(&input, &mut Vec::new(), &mut |_| {}).ok()?;
            let suits = measured.comparison.channels.len() > 1 && !measured.comparison.pairs.is_empty();
            suits.then_some(measured)
        };
        let m = (1..=8).find_map(measured).unwrap();
        let of = |changed_paths: &[usize]| {
            let q = Question { changed_paths, ..m.question() };
            let all = [changes(&q, 0), changes_beyond_gain(&q, 0), beside(&q, 0, 0.5)];
            all.map(|of| [0, 1].map(|c| of.iter().any(|d| d.channel == c)))
        };
        assert_eq!(of(&[]), [[true; 2]; 3]);
        assert_eq!(of(&[0]), [[false, true]; 3]);
        assert_eq!(of(&[1]), [[true, false]; 3]);
    }

    /// One tooth of 31 gives all 15 phases alike. Errors of all teeth do not, however many lines
    /// there are: the mean score of phases without order is 1, and over forty gears the highest
    /// stays below ln 40 + 2.
    #[test]
    fn analytic_one_tooth_has_even_phases_and_errors_of_all_teeth_have_not() {
        let mut broken = vec![0.0; 31];
        broken[7] = 1.0;
        let one = pattern(&comb_of(&broken, 1), 31).unwrap();
        assert!(one.even > 0.95 && one.score > 12.0 && one.shared > 0.9, "{one:?}");
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(2);
        let mut scores: Vec<f64> = (0..40)
            .map(|seed| {
                let errors: Vec<f64> = (0..31).map(|_| random.random::<f64>() - 0.5).collect();
                pattern(&comb_of(&errors, seed), 31).unwrap().score
            })
            .collect();
        scores.sort_by(f64::total_cmp);
        let mean = scores.iter().sum::<f64>() / 40.0;
        assert!((0.5..1.6).contains(&mean) && scores[39] < 5.7, "{mean} {scores:?}");
    }
}
