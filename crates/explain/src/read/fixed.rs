//! Lines at fixed frequencies, fitted where they must lie: the mains and their multiples, and
//! whatever a scan points at.
//!
//! Each is fitted by least squares over the bins about it, together with every multiple of every
//! shaft that reaches into them. The shafts' lines are laid in as they wander with the speed: what
//! a shaft does is told from what stays, down to a fraction of a bin, and where they cannot be told
//! apart the noise of the fit says so. A line that enters behind the machine has one amplitude in
//! all recordings, at any phase; its gain is the log likelihood ratio of that (Rice), against
//! nothing and against the same line in the reference.
//!
//! A machine has lines that nobody listed. How often one lies at a frequency in all recordings is
//! read from the recordings themselves: the same is asked at frequencies beside the mains, where
//! none enters. Its amplitude is another one in each recording; so that it passes for what enters
//! behind the machine, those must be alike by chance. And it reaches other sensors: a place beside
//! the mains counts where this sensor leads the others by as much.

mod joint;
mod sham;

use gearwatch_core::train::Train;
use num_complex::Complex64;

use self::joint::{About, Cell};
use self::sham::Shams;
use crate::read::SAME_SPEED;
use crate::read::dsp::{self, Transforms};
use crate::read::features::{RecordingFeatures, Steady};

/// Frequencies of public mains (Hz), and their multiples that are looked at: what a six-pulse
/// rectifier draws.
const MAINS_HZ: [f64; 2] = [50.0, 60.0];
const MULTIPLES: u32 = 12;
/// Deviation of the mains' frequency that is allowed for (relative): 50 mHz in 50 Hz, the standard
/// range of European grids.
const DEVIATION: f64 = 1e-3;
/// Half width of what is known of a line's frequency (bins).
const PLACE_BINS: f64 = 0.3;

/// Lines of the machine that may be expected to be as much alike, among all places asked, where a
/// line is taken for one that enters behind it.
const EXPECTED: f64 = 1e-3;
/// The least gain of two speeds. Among all the multiples a line of the machine that nobody listed
/// may lie at one speed (94 nats at 240 Hz); 50 and 60 Hz themselves may be seen at one speed,
/// where at the others a shaft's line lies on them.
const GAIN_EACH: f64 = 5.0;
/// Gain of a speed below which it speaks against one amplitude.
const AGAINST: f64 = -3.0;
/// Gain from which another sensor has the line too.
const HEARD: f64 = 15.0;

impl Cell {
    /// Log likelihood of an amplitude at any phase over that of none.
    fn gain(&self, amplitude: f64) -> f64 {
        ln_bessel_i0(2.0 * amplitude * self.amplitude / self.noise) - amplitude * amplitude / self.noise
    }
}

/// A line at one frequency on one sensor.
#[derive(Clone, Debug)]
pub struct FixedLine {
    /// Frequency and its standard deviation (Hz).
    pub hz: (f64, f64),
    /// Multiple of the mains that it lies on.
    pub multiple: Option<u32>,
    /// Sensor.
    pub channel: String,
    /// Peak amplitude in all recordings, and its standard deviation.
    pub amplitude: (f64, f64),
    /// Nats; where there is a reference against the same line before.
    pub gain: f64,
    /// Nats of one amplitude in all recordings over one that is drawn anew in each.
    pub alike: f64,
    /// Odds that the reference has the line as well; 0 without one.
    pub known: f64,
    /// Nats, by speed of the machine, against nothing.
    pub by_speed: Vec<f64>,
    /// Speeds at which it gains enough by an amplitude of their own.
    pub speeds_seen: usize,
    /// Nats that it gains more than at any other sensor.
    pub lead: f64,
    /// Largest gain of the same line on another sensor, where its amplitude is one there too.
    pub elsewhere: f64,
    /// Lines of the machine that may be expected to be as much alike in all recordings of this
    /// sensor, among all places asked, and those that the reference has.
    pub expected: f64,
}

impl FixedLine {
    /// No speed speaks against it, and two speak for it.
    fn is_steady(&self) -> bool {
        let seen = self.by_speed.iter().filter(|g| **g > GAIN_EACH).count();
        self.by_speed.len() > 1 && self.by_speed.iter().all(|g| *g > AGAINST) && (seen > 1 || self.multiple == Some(1))
    }

    /// A line is there at two speeds at least, whatever its amplitude, and is new where there is a
    /// reference.
    fn is_there(&self) -> bool {
        self.gain > GAIN_EACH && self.speeds_seen > 1
    }

    /// The machine's own lines do not do as much.
    fn is_one_amplitude(&self) -> bool {
        self.is_steady() && self.expected < EXPECTED
    }

    /// It entered behind this sensor: the others do not hear it.
    pub fn is_picked_up(&self) -> bool {
        self.is_one_amplitude() && self.elsewhere < HEARD
    }
}

/// ln I₀, by Abramowitz & Stegun 9.8.1 and 9.8.2 (2e-7).
fn ln_bessel_i0(x: f64) -> f64 {
    let t = x / 3.75;
    if t < 1.0 {
        let t = t * t;
        let c = [3.515_622_9, 3.089_942_4, 1.206_749_2, 0.265_973_2, 0.036_076_8, 0.004_581_3];
        c.iter().rev().fold(0.0, |sum, c| (sum + c) * t).ln_1p()
    } else {
        let c = [
            0.398_942_28,
            0.013_285_92,
            0.002_253_19,
            -0.001_575_65,
            0.009_162_81,
            -0.020_577_06,
            0.026_355_37,
            -0.016_476_33,
            0.003_923_77,
        ];
        x - 0.5 * x.ln() + c.iter().rev().fold(0.0, |sum, c| sum / t + c).ln()
    }
}

/// The amplitude that some cells have in common, and what it gains.
fn in_common(cells: &[&Cell]) -> (f64, f64) {
    let top = cells.iter().map(|c| c.amplitude).fold(0.0, f64::max);
    let sum = |a: f64| cells.iter().map(|c| c.gain(a)).sum::<f64>();
    // Steps of 2 %, down to a tenth of the largest.
    (0..=114).map(|k| top * 0.98f64.powi(k)).map(|a| (a, sum(a))).fold((0.0, 0.0), |b, x| if x.1 > b.1 { x } else { b })
}

/// The mains and their multiples, in order.
fn mains() -> Vec<Place> {
    let multiple = |base: f64, m: u32| Place { hz: base * f64::from(m), multiple: Some(m), wander: DEVIATION };
    let of = |base: &f64| (1..=MULTIPLES).map(|m| multiple(*base, m)).collect::<Vec<_>>();
    let mut places: Vec<Place> = MAINS_HZ.iter().flat_map(of).collect();
    places.sort_by(|a, b| a.hz.total_cmp(&b.hz));
    places.dedup_by(|a, b| a.hz == b.hz);
    places
}

/// How likely the largest line of a pick-up is at one of the places asked, before it was looked
/// for. That of the mains is mostly their frequency itself or a low multiple of it, of amplitudes
/// as the inverse of the multiple: its power, `m^-2`, parts what the multiples have together.
fn share(asked: &[Place], k: usize) -> f64 {
    let power = |p: &Place| p.multiple.map(|m| f64::from(m).powi(-2));
    let all: f64 = asked.iter().filter_map(power).sum();
    let multiples = asked.iter().filter(|p| p.multiple.is_some()).count() as f64;
    power(&asked[k]).map_or(1.0, |own| multiples * own / all) / asked.len() as f64
}

/// What some cells gain by a line of the machine, whose amplitude is drawn anew in each recording
/// (Rayleigh amplitudes, so that powers are exponential) from the scale that suits them best.
fn drawn_anew(cells: &[&Cell]) -> f64 {
    let gain = |scale: f64| {
        let of = |c: &&Cell| {
            let ratio = scale / c.noise;
            c.ratio() * ratio / (1.0 + ratio) - ratio.ln_1p()
        };
        cells.iter().map(of).sum::<f64>()
    };
    let top = cells.iter().map(|c| c.amplitude.powi(2)).fold(0.0, f64::max);
    // Steps of 10 %, down to some thousandth of the largest power.
    (-7..=66).map(|k| gain(top * 0.9f64.powi(k))).fold(0.0, f64::max)
}

/// Lines of the mains, and at the other frequencies that are asked (Hz), the plainest first.
/// `steady` holds the recordings, then the references.
pub fn fit(
    transforms: &mut Transforms,
    train: &Train,
    steady: &[Steady<'_>],
    recordings: &[RecordingFeatures],
    references: &[RecordingFeatures],
    others: &[f64],
) -> Vec<FixedLine> {
    let mut names: Vec<&str> = Vec::new();
    // A limit makes lines without end.
    let clips = |name: &str| {
        recordings.iter().flat_map(|r| &r.channels).any(|c| c.name == name && c.integrity.clipped_at.is_some())
    };
    for (name, _, _) in steady[..recordings.len()].iter().flat_map(|s| &s.channels) {
        if !names.contains(name) && !clips(name) {
            names.push(name);
        }
    }
    let mut places = mains();
    let beside = sham::beside(&places);
    places.extend(others.iter().map(|&hz| Place { hz, multiple: None, wander: 0.0 }));
    let asked = places.len();
    places.extend(beside);
    let cells: Vec<Vec<Vec<Option<Cell>>>> = steady
        .iter()
        .zip(recordings.iter().chain(references))
        .map(|(s, f)| {
            let spectra: Vec<Option<Vec<Complex64>>> = names
                .iter()
                .map(|name| {
                    let run = s.channels.iter().find(|c| c.0 == *name)?.2;
                    Some(dsp::windowed_spectrum(transforms, &run.samples[..f.phase_rev.len()]))
                })
                .collect();
            places.iter().map(|place| place.cells(&spectra, train, f)).collect()
        })
        .collect();
    let line_at = |k: usize, c: usize| {
        let own: Vec<Option<Cell>> = cells[..recordings.len()].iter().map(|of| of[k][c]).collect();
        let before: Vec<Cell> = cells[recordings.len()..].iter().filter_map(|of| of[k][c]).collect();
        line(&places[k], names[c], recordings, &own, &before)
    };
    // By place and sensor.
    let lines: Vec<Vec<Option<FixedLine>>> =
        (0..places.len()).map(|k| with_leads((0..names.len()).map(|c| line_at(k, c)).collect())).collect();
    let shams: Vec<Shams> = (0..names.len()).map(|c| Shams::new(lines[asked..].iter().map(|of| &of[c]))).collect();
    let mut out: Vec<FixedLine> = Vec::new();
    for (k, lines) in lines.into_iter().take(asked).enumerate() {
        let first = out.len();
        out.extend(lines.into_iter().zip(&shams).filter_map(|(line, shams)| {
            let l = line?;
            Some(FixedLine { expected: shams.expected(&l, 1.0 / share(&places[..asked], k)), ..l })
        }));
        let gains: Vec<(String, f64)> =
            out[first..].iter().map(|l| (l.channel.clone(), if l.is_one_amplitude() { l.gain } else { 0.0 })).collect();
        for l in &mut out[first..] {
            l.elsewhere = gains.iter().filter(|g| g.0 != l.channel).map(|g| g.1).fold(0.0, f64::max);
        }
    }
    out.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    out
}

/// Lines of the sensors at one place, each with its lead over the others.
fn with_leads(lines: Vec<Option<FixedLine>>) -> Vec<Option<FixedLine>> {
    let gains: Vec<f64> = lines.iter().map(|l| l.as_ref().map_or(0.0, |l| l.gain.max(0.0))).collect();
    let heard = |c: usize| gains.iter().enumerate().filter(|(other, _)| *other != c).map(|g| *g.1).fold(0.0, f64::max);
    let led = |(c, line): (usize, Option<FixedLine>)| line.map(|l| FixedLine { lead: l.gain - heard(c), ..l });
    lines.into_iter().enumerate().map(led).collect()
}

/// A line of one channel from its cells in the recordings and before; `None` where nothing is
/// gained.
fn line(
    place: &Place,
    channel: &str,
    recordings: &[RecordingFeatures],
    own: &[Option<Cell>],
    before: &[Cell],
) -> Option<FixedLine> {
    let cells: Vec<&Cell> = own.iter().flatten().collect();
    let (amplitude, alone) = in_common(&cells);
    if alone <= 0.0 {
        return None;
    }
    let all: Vec<&Cell> = cells.iter().copied().chain(before).collect();
    let gain = if before.is_empty() { alone } else { alone - in_common(&all).1 };
    let mut speeds: Vec<(f64, Vec<&Cell>)> = Vec::new();
    for (cell, recording) in own.iter().zip(recordings) {
        match speeds.iter_mut().find(|s| (s.0 / recording.input_hz - 1.0).abs() < SAME_SPEED) {
            Some(s) => s.1.extend(cell),
            None => speeds.push((recording.input_hz, cell.iter().collect())),
        }
    }
    let gained = |cells: &[&Cell]| cells.iter().map(|c| c.gain(amplitude)).sum();
    let weight: f64 = cells.iter().map(|c| c.noise.recip()).sum();
    let hz = cells.iter().map(|c| c.hz / c.noise).sum::<f64>() / weight;
    let hz_per_bin = recordings.iter().map(|r| r.hz_per_bin).fold(0.0, f64::max);
    Some(FixedLine {
        hz: (hz, PLACE_BINS * hz_per_bin),
        multiple: place.multiple,
        channel: channel.to_owned(),
        // Half of the noise power lies along the amplitude.
        amplitude: (amplitude, (2.0 * weight).sqrt().recip()),
        gain,
        alike: alone - drawn_anew(&cells),
        known: if before.is_empty() { 0.0 } else { (-gain).exp() },
        by_speed: speeds.iter().map(|s| gained(&s.1)).collect(),
        speeds_seen: speeds.iter().filter(|s| in_common(&s.1).1 > GAIN_EACH).count(),
        lead: gain,
        elsewhere: 0.0,
        expected: f64::INFINITY,
    })
}

/// A frequency at which a line is sought.
#[derive(Clone, Copy)]
struct Place {
    hz: f64,
    /// Of the mains.
    multiple: Option<u32>,
    /// How far from there it may lie (relative).
    wander: f64,
}

impl Place {
    /// The cells of one recording, by channel; for the mains the plainest within their deviation.
    fn cells(&self, spectra: &[Option<Vec<Complex64>>], train: &Train, f: &RecordingFeatures) -> Vec<Option<Cell>> {
        let mut out = vec![None; spectra.len()];
        let Some(about) = About::new(self.hz, train, f) else { return out };
        // Steps of at most a bin: half a bin off its place a line loses a tenth.
        let widest = self.wander * self.hz;
        let steps = (widest / f.hz_per_bin).ceil() as i32;
        for step in -steps..=steps {
            let hz = self.hz + widest * f64::from(step) / f64::from(steps.max(1));
            let Some(fit) = about.fit(hz, f) else { continue };
            for (slot, spectrum) in out.iter_mut().zip(spectra) {
                let Some(cell) = spectrum.as_ref().and_then(|s| fit.cell(s)) else { continue };
                if slot.is_none_or(|s: Cell| cell.ratio() > s.ratio()) {
                    *slot = Some(cell);
                }
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prove::draw::Draw;
    use gearwatch_core::bench::Bench;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use std::f64::consts::TAU;

    const RATE_HZ: f64 = 2048.0;
    const SECONDS: f64 = 6.0;
    const MAINS: Place = Place { hz: 50.0, multiple: Some(1), wander: DEVIATION };

    /// A machine at a speed that wanders by a thousandth in two seconds.
    fn turning(input_hz: f64) -> RecordingFeatures {
        let count = (SECONDS * RATE_HZ) as usize;
        let angle = |n: usize| {
            let t = n as f64 / RATE_HZ;
            input_hz * (t + 1e-3 / (0.5 * TAU) * (0.5 * TAU * t).sin())
        };
        RecordingFeatures {
            name: String::new(),
            display_motor_hz: f64::NAN,
            brake_torque_nm: f64::NAN,
            input_hz,
            tacho_input_hz: None,
            comb_score: 0.0,
            carriers: 0,
            revolutions: input_hz * SECONDS,
            start_rev: 0.0,
            hz_per_bin: 1.0 / SECONDS,
            sample_rate_hz: RATE_HZ,
            lines: Vec::new(),
            taken: Vec::new(),
            phase_rev: (0..count).map(angle).collect(),
            swing: None,
            channels: Vec::new(),
        }
    }

    fn train() -> Train {
        let text = r#"{"format":"gearwatch-bench/1","name":"t","motor":{"speed_hz":25.0},"brake":{"torque_nm":10.0},
            "shaft":[{"name":"a"},{"name":"b"}],
            "stage":[{"name":"s","module_mm":2.0,"face_width_mm":20.0,"pinion":{"teeth":20},"wheel":{"teeth":41}}],
            "sensor":[],"acquisition":{"sample_rate_hz":2048.0}}"#;
        Train::new(&serde_json::from_str::<Bench>(text).unwrap())
    }

    /// The cell of 50 Hz in a machine whose first shaft's line is fifty times as large, beside a
    /// pick-up of this amplitude in noise of deviation 1.
    fn cell(input_hz: f64, pickup: f64, seed: u64) -> Cell {
        let f = turning(input_hz);
        let mut noise = Draw(ChaCha8Rng::seed_from_u64(seed));
        let phase = noise.uniform(0.0, 1.0);
        let samples: Vec<f64> = f
            .phase_rev
            .iter()
            .enumerate()
            .map(|(n, turn)| {
                let mains = (TAU * (50.0 * n as f64 / RATE_HZ + phase)).cos();
                5.0 * (TAU * 2.0 * turn).cos() + pickup * mains + noise.normal()
            })
            .collect();
        let spectrum = dsp::windowed_spectrum(&mut Transforms::default(), &samples);
        MAINS.cells(&[Some(spectrum)], &train(), &f)[0].unwrap()
    }

    fn judged(cells: &[(f64, Cell)], before: &[Cell]) -> Option<FixedLine> {
        let recordings: Vec<RecordingFeatures> = cells.iter().map(|c| turning(c.0)).collect();
        let own: Vec<Option<Cell>> = cells.iter().map(|c| Some(c.1)).collect();
        let l = line(&MAINS, "acc", &recordings, &own, before)?;
        // None of a hundred shams, and 50 Hz among all places of the mains.
        let (shams, places) = (Shams::new(vec![None; 100].iter()), 1.0 / share(&mains(), 0));
        Some(FixedLine { expected: shams.expected(&l, places), ..l })
    }

    /// Three sensors that gain 40, 10 and nothing: the first leads by 30, the second is 30 behind.
    /// A sensor that would lose by the line counts as one without it.
    #[test]
    fn analytic_a_sensor_leads_the_next() {
        let cell = Cell { hz: 50.0, amplitude: 3.0, noise: 1.0 };
        let own = judged(&[(25.0, cell)], &[]).unwrap();
        let lead = |gains: [Option<f64>; 3]| -> Vec<Option<f64>> {
            let line = |gain: Option<f64>| gain.map(|gain| FixedLine { gain, ..own.clone() });
            with_leads(gains.map(line).into()).into_iter().map(|l| l.map(|l| l.lead)).collect()
        };
        assert_eq!(lead([Some(40.0), Some(10.0), None]), [Some(30.0), Some(-30.0), None]);
        assert_eq!(lead([Some(40.0), Some(-5.0), None]), [Some(40.0), Some(-45.0), None]);
    }

    /// Ten multiples and two other places: each of the two has a twelfth, the multiples the rest by
    /// their power, so that the third has a ninth of the first.
    #[test]
    fn analytic_a_pick_up_of_the_mains_is_largest_at_low_multiples() {
        let of_50 = (1..=10).map(|m| Place { hz: 50.0 * f64::from(m), multiple: Some(m), wander: DEVIATION });
        let others = [77.0, 91.0].map(|hz| Place { hz, multiple: None, wander: 0.0 });
        let places: Vec<Place> = of_50.chain(others).collect();
        let shares: Vec<f64> = (0..places.len()).map(|k| share(&places, k)).collect();
        assert!((shares.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        assert!((shares[11] - 1.0 / 12.0).abs() < 1e-12);
        assert!((shares[2] / shares[0] - 1.0 / 9.0).abs() < 1e-12);
    }

    /// Amplitudes that are alike are one, those that differ by a factor of three are not, however
    /// clear; the scale that suits a power of `r` times the noise is `r - 1`, and gains
    /// `r - 1 - ln r`.
    #[test]
    fn analytic_amplitudes_that_differ_are_drawn_anew() {
        let cell = |amplitude: f64| Cell { hz: 50.0, amplitude, noise: 1.0 };
        let alike = |amplitudes: [f64; 4]| {
            let cells = amplitudes.map(cell);
            let cells: Vec<&Cell> = cells.iter().collect();
            in_common(&cells).1 - drawn_anew(&cells)
        };
        assert!(alike([9.4, 10.0, 10.7, 9.9]) > 3.0);
        assert!(alike([6.0, 15.0, 7.0, 18.0]) < -15.0);
        let one = cell(5.0);
        assert!((drawn_anew(&[&one]) - (24.0 - 25f64.ln())).abs() < 0.01);
    }

    /// Tables of Abramowitz & Stegun, 9.8.
    #[test]
    fn literature_bessel_i0() {
        for (x, value) in [(0.0, 1.0f64), (1.0, 1.266_065_878), (5.0, 27.239_871_82), (10.0, 2_815.716_628)] {
            assert!((ln_bessel_i0(x) - value.ln()).abs() < 3e-7, "{x}");
        }
    }

    /// A quarter of a hertz (1.5 bins) from a shaft's line fifty times as large the pick-up is read
    /// within its noise; at the very frequency only the wander of the speed tells them apart, and
    /// the noise says how far. Far from it the noise is that of two bins of a Blackman-Harris
    /// spectrum, 1.38 of `4 · 2.0 / n`.
    #[test]
    fn analytic_a_line_beside_a_shafts_is_read_within_its_noise() {
        let clear = (1.379 * 8.0 / (SECONDS * RATE_HZ)).sqrt();
        for (input_hz, low, high) in [(24.4, 0.6, 1.6), (25.125, 0.6, 3.0), (25.0, 2.0, 100.0)] {
            for seed in 1..6 {
                let found = cell(input_hz, 0.1, seed);
                assert!((found.amplitude - 0.1).powi(2) < 9.0 * found.noise, "{input_hz}: {found:?}");
                assert!((low..high).contains(&(found.noise.sqrt() / clear)), "{input_hz}: {found:?}");
            }
        }
    }

    /// A pick-up of a fifth of the noise is one at two speeds, is none where the reference has it,
    /// and noise alone, or a line at one speed only, is none.
    #[test]
    fn analytic_one_amplitude_at_all_speeds_is_picked_up() {
        let four = |pickup: [f64; 2], seed: u64| -> Vec<(f64, Cell)> {
            [(15.3, pickup[0], 0), (15.32, pickup[0], 1), (26.0, pickup[1], 2), (26.02, pickup[1], 3)]
                .map(|(hz, a, k)| (hz, cell(hz, a, 10 * seed + k)))
                .to_vec()
        };
        for seed in 1..6 {
            let found = judged(&four([0.2; 2], seed), &[]).unwrap();
            assert!(found.is_picked_up(), "seed {seed}: {found:?}");
            assert!((found.amplitude.0 - 0.2).abs() < 4.0 * found.amplitude.1 + 0.1 * 0.2, "{found:?}");
            assert!((found.hz.0 - 50.0).abs() < 2.0 * found.hz.1, "{found:?}");
            let before: Vec<Cell> = four([0.2; 2], 100 + seed).into_iter().map(|c| c.1).collect();
            assert!(judged(&four([0.2; 2], seed), &before).is_none_or(|l| !l.is_picked_up()));
            for pickup in [[0.0; 2], [0.0, 0.3]] {
                assert!(judged(&four(pickup, seed), &[]).is_none_or(|l| !l.is_picked_up()), "{pickup:?}");
            }
        }
    }
}
