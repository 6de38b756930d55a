//! What changed within one revolution of a gear: recording minus reference, line by line and with phase.
//!
//! The train starts anywhere, so the lines `n` of a shaft's comb turn by `exp(2πi n ψ)` between a recording and its reference. `ψ` is where
//! the phases of all lines agree best: mesh harmonics fix it to a tooth, the usual differences between teeth say which. The difference
//! `Δ_n` that is left belongs to the change alone. A fault of one tooth gives neighbouring lines phases that advance evenly (the Fourier
//! transform of a pulse), whatever the path does to their amplitudes; errors of all teeth give phases without order. How `|Δ_n|` follows
//! the torque at one speed needs no model: the path is the same (PHYSICS 4: L04; stiffness lost goes with the load, geometry does not).

use num_complex::Complex64;
use std::f64::consts::TAU;

use crate::dsp::{self, MAIN_LOBE_BINS, Transforms, median};
use crate::features::{ChannelFeatures, LineValue, RecordingFeatures};
use crate::locate::REPEAT_SIGMA;
use crate::name::Question;

/// Power over noise from which a line's phase is used.
const CLEAR: f64 = 5.0;
/// Lines on each side of a mesh harmonic that count as beside it.
const BESIDE: usize = 5;
/// Neighbours that a pair must show for a pattern of its teeth.
const LEAST_NEIGHBOURS: usize = 30;
/// Least agreement of phases (0–1) at which recording and reference count as aligned.
const ALIGNED: f64 = 0.25;

/// The change of a shaft's comb at one operating point and channel.
pub struct Difference {
    /// Position of the pair.
    pub pair: usize,
    /// Position of the channel.
    pub channel: usize,
    /// `Δ_n` and its noise power, from `n` = 1; `None` at mesh harmonics and where there is nothing to see.
    pub lines: Vec<Option<(Complex64, f64)>>,
}

/// The changes of everything that repeats with a shaft, where recording and reference could be aligned.
pub fn changes(q: &Question<'_>, shaft: usize) -> Vec<Difference> {
    differences(q, shaft).0
}

/// What the change of a gear's comb is like.
#[derive(Clone, Copy, Debug, Default)]
pub struct GearChange {
    /// Even advance of the phases of neighbouring lines, 0 (none) to 1 (one pulse a revolution), chance taken off.
    pub coherence: f64,
    /// Neighbouring lines that it rests on.
    pub neighbours: usize,
    /// Exponent of the change over the torque, with its standard error; needs two loads at one speed.
    pub exponent: Option<(f64, f64)>,
    /// How many times more often than by chance clear lines lie beside the mesh harmonics of the stage.
    pub near: f64,
    /// ln of the change's mean power in the first lines beside the mesh harmonics over that in the third to fifth.
    pub first: f64,
    /// Operating points that could be aligned.
    pub aligned: usize,
}

/// Turn `ψ` (revolutions) of the shaft between two recordings, and the agreement of phases there.
fn turn(a: &[&[LineValue]], b: &[&[LineValue]]) -> Option<(f64, f64)> {
    let mut phases: Vec<(f64, Complex64)> = Vec::new();
    for (x, y) in a.iter().zip(b) {
        for (n, (p, q)) in x.iter().zip(y.iter()).enumerate() {
            if p.ratio() > CLEAR && q.ratio() > CLEAR {
                let product = p.amplitude * q.amplitude.conj();
                phases.push(((n + 1) as f64, product / product.norm()));
            }
        }
    }
    let highest = phases.iter().map(|p| p.0).fold(0.0, f64::max);
    if phases.len() < 12 {
        return None;
    }
    let agreement = |psi: f64| {
        phases.iter().map(|(n, u)| (u * Complex64::from_polar(1.0, -TAU * n * psi)).re).sum::<f64>()
            / phases.len() as f64
    };
    // All turns at once: the agreement over an even grid is a transform of the phases gathered by line.
    let count = (4.0 * highest) as usize;
    let mut grid = vec![Complex64::ZERO; count];
    for (n, u) in &phases {
        grid[*n as usize] += u;
    }
    Transforms::default().forward(&mut grid);
    let coarse =
        grid.iter().enumerate().map(|(k, sum)| (k as f64 / count as f64, sum.re)).max_by(|x, y| x.1.total_cmp(&y.1))?;
    let step = 0.05 / count as f64;
    (-20..=20)
        .map(|k| coarse.0 + f64::from(k) * step)
        .map(|psi| (psi, agreement(psi)))
        .max_by(|x, y| x.1.total_cmp(&y.1))
}

/// Recordings that are compared: each with its reference, or without any reference at all each high load with the lowest at its speed.
fn twins<'a>(q: &'a Question<'a>) -> Vec<(usize, &'a RecordingFeatures, &'a RecordingFeatures)> {
    if !q.comparison.pairs.is_empty() {
        let pair = |(p, pair): (usize, &crate::compare::Pair)| {
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

/// Share of a line's power above which what another line leaks into it spoils its phase.
const LEAKED: f64 = 0.05;

/// Whether lines of the other shafts reach into a line of a shaft's comb.
fn crowded(q: &Question<'_>, recording: &RecordingFeatures, channel: &ChannelFeatures, shaft: usize, n: usize) -> bool {
    let order = q.train.shafts[shaft].1 * n as f64;
    let Some(own) = channel.combs[shaft].get(n - 1) else { return true };
    q.train.shafts.iter().enumerate().filter(|(j, _)| *j != shaft).any(|(j, (_, o))| {
        let k = (order / o).round();
        let distance = (order - k * o).abs() * recording.revolutions;
        // The line is read from the three bins about it.
        let nearest = (distance - 1.0).max(0.0);
        if k < 1.0 || nearest >= MAIN_LOBE_BINS as f64 {
            return false;
        }
        let leak = dsp::window_response(nearest).norm_sqr() / dsp::window_response(0.0).norm_sqr();
        let other = channel.combs[j].get(k as usize - 1).map_or(0.0, |l| l.amplitude.norm_sqr());
        leak * other > LEAKED * own.amplitude.norm_sqr() + own.noise
    })
}

fn differences(q: &Question<'_>, shaft: usize) -> (Vec<Difference>, usize) {
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
        fn of<'a>(all: &'a [ChannelFeatures], name: &str, shaft: usize) -> &'a [LineValue] {
            all.iter().find(|c| c.name == name).and_then(|c| c.combs.get(shaft)).map_or(&[], |c| c.as_slice())
        }
        let known = &q.comparison.channels;
        let names: Vec<&String> =
            rec.channels.iter().map(|c| &c.name).filter(|n| known.is_empty() || known.contains(n)).collect();
        let a: Vec<&[LineValue]> = names.iter().map(|n| of(&rec.channels, n, shaft)).collect();
        let b: Vec<&[LineValue]> = names.iter().map(|n| of(&reference.channels, n, shaft)).collect();
        let Some((psi, agreement)) = turn(&a, &b) else { continue };
        if agreement < ALIGNED {
            continue;
        }
        aligned += 1;
        for (channel, (x, y)) in a.iter().zip(&b).enumerate() {
            let lines = x
                .iter()
                .zip(y.iter())
                .enumerate()
                .map(|(k, (p, r))| {
                    let n = k + 1;
                    let spoilt = [rec, reference].iter().any(|r| {
                        r.channels.iter().find(|c| c.name == *names[channel]).is_none_or(|c| crowded(q, r, c, shaft, n))
                    });
                    if spoilt || teeth.iter().any(|z| n % z == 0) {
                        return None;
                    }
                    let delta = p.amplitude * Complex64::from_polar(1.0, -TAU * n as f64 * psi) - r.amplitude;
                    let noise = p.noise + r.noise + 2.0 * REPEAT_SIGMA.powi(2) * r.amplitude.norm_sqr();
                    Some((delta, noise))
                })
                .collect();
            out.push(Difference { pair: p, channel, lines });
        }
    }
    (out, aligned)
}

fn clear(l: &Option<(Complex64, f64)>) -> Option<(Complex64, f64)> {
    l.filter(|(d, n)| d.norm_sqr() > CLEAR * n)
}

/// Looks at the change of everything that repeats with a shaft; `stage` says about which mesh harmonics "near" is meant.
pub fn change(q: &Question<'_>, stage: usize, shaft: usize) -> GearChange {
    let (differences, aligned) = differences(q, shaft);
    let z =
        q.bench.stages.get(stage).map_or(1, |s| (if shaft == stage { s.pinion.teeth } else { s.wheel.teeth }) as usize);
    let (mut sum, mut weight, mut neighbours) = (0.0, 0.0, 0usize);
    let (mut near, mut all) = (0.0, 0.0);
    let mut firsts = Vec::new();
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
        let power_at = |which: std::ops::RangeInclusive<usize>| {
            let at = |k: usize| (k + 1) % z;
            let inside = |k: usize| which.contains(&at(k).min(z - at(k)));
            let powers = d.lines.iter().enumerate().filter(|(k, _)| inside(*k)).filter_map(|(_, l)| *l);
            let (sum, count) = powers.fold((0.0, 0usize), |(s, n), (a, noise)| (s + a.norm_sqr().max(noise), n + 1));
            (count > 0).then(|| (sum / count as f64).ln())
        };
        if let (Some(a), Some(b)) = (power_at(1..=1), power_at(3..=5)) {
            firsts.push(a - b);
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
        first: if firsts.is_empty() { 0.0 } else { median(&mut firsts) },
        aligned,
    }
}

/// How the change of a gear's comb goes from tooth to tooth.
///
/// Whatever differs from tooth to tooth gives lines `n` the discrete Fourier transform of its values over the `z` teeth, which repeats with `n`
/// modulo `z` and is conjugate at `−n`, times what one tooth's contact and the path make of a line (Mark 1978). So products of neighbouring lines
/// hold `(z − 1)/2` phases at most, however many lines there are: errors of all teeth give phases without order, one tooth the same for all.
#[derive(Clone, Copy, Debug)]
pub struct ToothPattern {
    /// Resultant of the phases of the residues, 0 to 1.
    pub even: f64,
    /// Residues that it rests on, by their weights.
    pub residues: f64,
    /// Phases without order reach a score of `s` with probability `exp(−s)` (Rayleigh's test: residues × resultant²), mean over pairs.
    pub score: f64,
    /// Share of the products that lines of one residue have in common; low where the change is not one of this gear's teeth.
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
    use rand::{RngExt, SeedableRng};

    /// A comb of 8 mesh harmonics as teeth with these values make it, through a path whose phase wanders slowly from line to line.
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

    /// One tooth of 31 gives all 15 phases alike. Errors of all teeth do not, however many lines there are: the mean score of phases without
    /// order is 1, and over forty gears the highest stays below ln 40 + 2.
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
