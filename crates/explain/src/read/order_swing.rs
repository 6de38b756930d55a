//! A turning that swings at a multiple of a shaft: a motor, brake or joint that drives unevenly.
//!
//! The angle swings by `ε = Re(E e^{2πi o θ})` about even turning. Every line of the train at order
//! `q`, of complex amplitude `C`, then has sidebands `X(q + o) = iπqE C` and `X(q − o) = iπqE* C`,
//! as long as `2πq|E|` is small. One `E` fits all mesh harmonics of all stages on all channels,
//! since they share the angle. What the teeth make beside a harmonic has no such law: it is the
//! scatter that `E` has to stand out of. Once the angle follows, the lines are those of the even
//! turning again, and larger swings come out in a few passes.

use gearwatch_check::last_wheel::OrderSpectra;
use gearwatch_core::bench::Bench;
use gearwatch_core::train::Train;
use num_complex::Complex64;
use std::f64::consts::{PI, TAU};

use crate::read::SAME_SPEED;
use crate::read::dsp;

/// Spectra of a recording over shaft angle, with the noise of their bins, by channel.
type Spectra<'a> = OrderSpectra<(&'a [Complex64], &'a [f64])>;

/// Multiples of each shaft that are looked at, and mesh harmonics.
const MULTIPLES: u8 = 12;
const HARMONICS: u8 = 8;
/// Least amplitude of a mesh harmonic, of the largest of its stage and channel, and its least power
/// over noise: beside a weaker one stand the sidebands of its neighbours, and noise, as high as
/// what a swing makes.
const LEAST_SHARE: f64 = 0.1;
const CLEAR: f64 = 100.0;
/// Chance, by the scatter of the teeth's own sidebands, of such a fit in all recordings, below
/// which it is believed: as of a fluctuation at a fixed frequency.
const CHANCE: f64 = 1e-8;
/// Swing of a reference, of that of the recordings, above which it was there before. A belief, read
/// from no data.
const USUAL: f64 = 0.3;
/// Largest total cumulative pitch deviation of a gear that anyone runs (m): grade 10 of ISO
/// 1328-1:2013, a module of 3 mm and a diameter of 100 mm, has 112 µm (`0.002 d + 0.55 √d + 0.7 m +
/// 12` at grade 5, times √2 a grade). It swings the mesh as an uneven turning does, but no further.
const WORST_PITCH_M: f64 = 125e-6;
/// Standard deviation of a depth beside its scatter (relative): what the teeth make at the same
/// order.
const OF_DEPTH: f64 = 0.1;
/// Loads that differ (ln).
const LOADS_APART: f64 = 0.3;
/// Largest phase of a mesh harmonic that the first look believes (rad): its first sidebands are 12
/// % below what grows with the swing (`J₁(β)` against `β/2`).
const SMALL_RAD: f64 = 1.0;
/// Mesh harmonics that tell a swing from what teeth make, at least.
const LEAST_HARMONICS: usize = 3;
/// Passes in which an angle follows a swing: each takes up what the one before left.
const PASSES: usize = 4;

/// A swing of one recording.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OrderSwing {
    /// Of the first shaft.
    pub order: f64,
    /// Amplitude (revolutions of the first shaft) and phase at the first sample.
    pub rev: Complex64,
}

impl OrderSwing {
    /// Amplitude of the speed (relative).
    pub fn depth(&self) -> f64 {
        TAU * self.order * self.rev.norm()
    }

    /// Lets an angle (revolutions, per sample) follow it.
    pub fn follow(&self, angle: &mut [f64]) {
        let Some(&first) = angle.first() else { return };
        for a in angle {
            *a += (self.rev * Complex64::from_polar(1.0, TAU * self.order * (*a - first))).re;
        }
    }
}

/// What a recording shows at one order.
#[derive(Clone, Copy, Debug)]
struct Seen {
    rev: Complex64,
    /// ln of the chance of such a fit.
    ln_chance: f64,
    /// Phase of the highest harmonic that took part (rad).
    phase_rad: f64,
}

/// A mesh harmonic with what stands beside it as modulation: `(X₊/C − (X₋/C)*) / 2`, which a swing
/// makes `iπqE`.
struct Carrier {
    order: f64,
    beside: Complex64,
}

/// The mesh harmonics of a recording that are clear enough, with their sidebands at one distance.
fn carriers(r: &Spectra<'_>, train: &Train, order: f64) -> Vec<Carrier> {
    let mut out = Vec::new();
    for (bins, floor) in &r.channels {
        let nearest = |q: f64| (q * r.revolutions).round();
        let value = |q: f64| {
            let bin = bins.get(nearest(q) as usize).copied().unwrap_or_default();
            bin / dsp::window_response(nearest(q) - q * r.revolutions)
        };
        let clear = |q: f64| {
            let floor = floor.get(nearest(q) as usize).copied().unwrap_or(f64::INFINITY);
            value(q).norm_sqr() > CLEAR * floor
        };
        for stage in &train.stages {
            let orders: Vec<f64> = (1..=HARMONICS).map(|h| f64::from(h) * stage.mesh_order).collect();
            let most = orders.iter().map(|q| value(*q).norm()).fold(0.0, f64::max);
            for q in orders.into_iter().filter(|q| value(*q).norm() > LEAST_SHARE * most && clear(*q)) {
                let (above, below) = (value(q + order) / value(q), value(q - order) / value(q));
                out.push(Carrier { order: q, beside: 0.5 * (above - below.conj()) });
            }
        }
    }
    out
}

/// The swing that fits some carriers best by least squares, with the chance of as good a fit: `(1 −
/// R²)^(n − 1)` of `n` complex Gaussian values. Channels hear one source, so that all of them are
/// one value a harmonic.
fn fit(carriers: &[Carrier]) -> Option<Seen> {
    let weight: f64 = carriers.iter().map(|c| (PI * c.order).powi(2)).sum();
    let mut orders: Vec<f64> = carriers.iter().map(|c| c.order).collect();
    orders.sort_by(f64::total_cmp);
    orders.dedup();
    let highest = *orders.last()?;
    if orders.len() < LEAST_HARMONICS {
        return None;
    }
    let rev = carriers.iter().map(|c| c.beside * Complex64::new(0.0, -PI * c.order)).sum::<Complex64>() / weight;
    let total: f64 = carriers.iter().map(|c| c.beside.norm_sqr()).sum();
    let left: f64 = carriers.iter().map(|c| (c.beside - Complex64::new(0.0, PI * c.order) * rev).norm_sqr()).sum();
    let ln_chance = (orders.len() - 1) as f64 * (left / total).max(f64::MIN_POSITIVE).ln();
    Some(Seen { rev, ln_chance, phase_rad: TAU * highest * rev.norm() })
}

/// The same with the harmonics that the swing does not move too far: those of high order are left
/// out until it is small.
fn seen(r: &Spectra<'_>, train: &Train, order: f64) -> Option<Seen> {
    let mut all = carriers(r, train, order);
    all.sort_by(|a, b| a.order.total_cmp(&b.order));
    let mut best: Option<Seen> = None;
    while let Some(found) = fit(&all) {
        let small = found.phase_rad < SMALL_RAD;
        if best.as_ref().is_none_or(|b| found.ln_chance < b.ln_chance) {
            best = Some(found);
        }
        if small {
            break;
        }
        all.pop();
    }
    best
}

/// Where a recording was made.
#[derive(Clone, Copy, Debug)]
pub struct Point {
    /// Speed of the first shaft (Hz).
    pub input_hz: f64,
    /// Torque at the brake (N m).
    pub brake_torque_nm: f64,
}

/// A swing that all recordings show.
#[derive(Clone, Debug)]
pub struct Swinging {
    /// Position of the shaft.
    pub shaft: usize,
    /// Multiple of its speed.
    pub multiple: u8,
    /// By recording; `None` of one that cannot show it.
    pub swings: Vec<Option<OrderSwing>>,
    /// Chance of it by the scatter of the teeth's own sidebands, among all orders looked at.
    pub chance: f64,
}

impl Swinging {
    /// Lets the angles of the recordings follow it, as far as they show it. `left` reads a
    /// recording again with an angle that follows a swing, and gives what that leaves of it.
    pub fn follow(&mut self, mut left: impl FnMut(usize, OrderSwing) -> Option<OrderSwing>) {
        for (at, swing) in self.swings.iter_mut().enumerate() {
            let Some(swing) = swing else { continue };
            for _ in 0..PASSES {
                let Some(left) = left(at, *swing) else { break };
                swing.rev += left.rev;
            }
        }
    }

    /// Amplitude of the speed (relative), mean over recordings with its standard deviation.
    pub fn depth(&self) -> (f64, f64) {
        let depths: Vec<f64> = self.swings.iter().flatten().map(OrderSwing::depth).collect();
        let mean = dsp::mean(&depths);
        let spread = depths.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / depths.len() as f64;
        (mean, (spread / depths.len() as f64).sqrt().hypot(OF_DEPTH * mean))
    }

    /// Exponent of the torque in the law of the depth, from recordings of one speed; `None` where
    /// none differ in load.
    pub fn load_exponent(&self, points: &[Point]) -> Option<f64> {
        let all: Vec<_> = points.iter().zip(&self.swings).filter_map(|(p, s)| Some((p, s.as_ref()?))).collect();
        let mut exponents = Vec::new();
        for (k, (a, x)) in all.iter().enumerate() {
            for (b, y) in &all[k + 1..] {
                let loads = (b.brake_torque_nm / a.brake_torque_nm).ln();
                if (b.input_hz / a.input_hz - 1.0).abs() < SAME_SPEED && loads.abs() > LOADS_APART {
                    exponents.push((y.depth() / x.depth()).ln() / loads);
                }
            }
        }
        (!exponents.is_empty()).then(|| dsp::mean(&exponents))
    }
}

/// The multiple of a shaft at which all recordings swing and their references do not, further than
/// a wrong gear could make it. The first order is that of a gear out of centre.
pub fn scan(bench: &Bench, train: &Train, recordings: &[Spectra<'_>], references: &[Spectra<'_>]) -> Option<Swinging> {
    let of_shafts = (0..train.shafts.len()).flat_map(|shaft| (2..=MULTIPLES).map(move |multiple| (shaft, multiple)));
    let all: Vec<Swinging> = of_shafts.filter_map(|at| swinging(train, at, recordings)).collect();
    let tried = (train.shafts.len() * usize::from(MULTIPLES - 1)) as f64;
    let mut best = all.into_iter().min_by(|a, b| a.chance.total_cmp(&b.chance))?;
    best.chance = (tried * best.chance).min(1.0);
    let order = f64::from(best.multiple) * train.shafts[best.shaft].1;
    let mean = |swings: Vec<OrderSwing>| dsp::mean(&swings.iter().map(|s| s.rev.norm()).collect::<Vec<_>>());
    let now = mean(best.swings.iter().flatten().copied().collect());
    let before: Vec<OrderSwing> = references.iter().filter_map(|r| left(r, train, order)).collect();
    let was_there = before.is_empty() || mean(before) > USUAL * now;
    let at_teeth_m = TAU * now * train.shafts[best.shaft].1 * smallest_radius_m(bench, best.shaft);
    (best.chance < CHANCE && !was_there && at_teeth_m > WORST_PITCH_M).then_some(best)
}

/// What all recordings show at a multiple of a shaft; `None` where most cannot.
fn swinging(train: &Train, (shaft, multiple): (usize, u8), recordings: &[Spectra<'_>]) -> Option<Swinging> {
    let order = f64::from(multiple) * train.shafts[shaft].1;
    let all: Vec<Option<Seen>> = recordings.iter().map(|r| seen(r, train, order)).collect();
    let shown = all.iter().flatten().count();
    let chance = ln_chance(recordings, &all).exp();
    let swings = all.into_iter().map(|s| s.map(|s| OrderSwing { order, rev: s.rev })).collect();
    (2 * shown > recordings.len()).then_some(Swinging { shaft, multiple, swings, chance })
}

/// ln of the chance in all recordings: the teeth are the same at all loads of one speed, and so is
/// the path, so that only other speeds are independent.
fn ln_chance(recordings: &[Spectra<'_>], all: &[Option<Seen>]) -> f64 {
    let of: Vec<(f64, f64)> =
        recordings.iter().zip(all).filter_map(|(r, s)| Some((r.input_hz, s.as_ref()?.ln_chance))).collect();
    let at_its_speed = |(hz, own): &(f64, f64)| {
        own / of.iter().filter(|(other, _)| (other / hz - 1.0).abs() < SAME_SPEED).count() as f64
    };
    of.iter().map(at_its_speed).sum()
}

/// Reference radius of the smallest gear on a shaft (m).
fn smallest_radius_m(bench: &Bench, shaft: usize) -> f64 {
    let gears = bench.stages.iter().enumerate().flat_map(|(i, stage)| {
        let radius = |teeth| stage.reference_radius_m(teeth);
        [(i, radius(stage.pinion.teeth)), (i + 1, radius(stage.wheel.teeth))]
    });
    gears.filter(|(on, _)| *on == shaft).map(|g| g.1).fold(f64::INFINITY, f64::min)
}

/// What the angle of a recording still leaves of a swing at an order.
pub fn left(r: &Spectra<'_>, train: &Train, order: f64) -> Option<OrderSwing> {
    seen(r, train, order).map(|s| OrderSwing { order, rev: s.rev })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::read::dsp::Transforms;

    const LEN: usize = 1 << 15;
    const REVOLUTIONS: f64 = 60.3;

    /// Spectrum over an angle that follows some swing of a turning that swings by `rev` at twice
    /// the first shaft, heard through five mesh harmonics; each has sidebands of the teeth's own,
    /// of one per cent and phases without a law.
    fn spectrum(mesh: f64, rev: Complex64, followed: Option<OrderSwing>) -> Vec<Complex64> {
        let even = |n: usize| REVOLUTIONS * n as f64 / (LEN - 1) as f64;
        let heard = |n: usize| {
            let turned = even(n) + (rev * Complex64::from_polar(1.0, TAU * 2.0 * even(n))).re;
            let line = |order: f64, size: f64, phase: f64| size * (TAU * order * turned + phase).cos();
            let of = |h: u8| {
                let (h, q) = (f64::from(h), f64::from(h) * mesh);
                line(q, 1.0, 2.0 * h) + line(q + 2.0, 0.01, 5.0 * h * h) + line(q - 2.0, 0.01, 3.0 * h * h * h)
            };
            (1..=5).map(of).sum()
        };
        let signal: Vec<f64> = (0..LEN).map(heard).collect();
        let mut angle: Vec<f64> = (0..LEN).map(even).collect();
        followed.into_iter().for_each(|swing| swing.follow(&mut angle));
        let mut transforms = Transforms::default();
        let over_angle = dsp::resample_to_angle(&mut transforms, &signal, &angle);
        dsp::windowed_spectrum(&mut transforms, &over_angle)
    }

    fn spectra<'a>(bins: &'a [Complex64], floor: &'a [f64]) -> Spectra<'a> {
        OrderSpectra {
            sample_rate_hz: 16384.0,
            input_hz: 30.0,
            tacho_input_hz: None,
            revolutions: REVOLUTIONS,
            channels: vec![(bins, floor)],
        }
    }

    /// A swing that turns the fifth harmonic by 1.2 rad is seen, and comes out in four passes to
    /// what the teeth's own sidebands leave: `0.01 / (πq)` of each harmonic. Without it they fit no
    /// swing, and one that the reference has is none of the recordings' own.
    #[test]
    fn analytic_the_angle_follows_a_swing() {
        let bench = Bench::from_toml(include_str!("../../../sim/src/shipped/single-pair.toml")).unwrap();
        let train = Train::new(&bench);
        let mesh = train.stages[0].mesh_order;
        let rev = Complex64::from_polar(1.2 / (TAU * 5.0 * mesh), 0.7);
        let floor = vec![1e-9; LEN];
        let (swings, still) = (spectrum(mesh, rev, None), spectrum(mesh, Complex64::ZERO, None));
        let of = |bins| [spectra(bins, &floor), spectra(bins, &floor)];
        let found = scan(&bench, &train, &of(&swings), &of(&still)).unwrap();
        assert_eq!((found.shaft, found.multiple), (0, 2));
        let mut swing = found.swings[0].unwrap();
        for _ in 0..4 {
            let followed = spectrum(mesh, rev, Some(swing));
            swing.rev += left(&spectra(&followed, &floor), &train, swing.order).unwrap().rev;
        }
        assert!((swing.rev - rev).norm() < 0.01 / (PI * mesh), "{swing:?} of {rev}");
        assert!(scan(&bench, &train, &of(&still), &of(&still)).is_none());
        assert!(scan(&bench, &train, &of(&swings), &of(&swings)).is_none());
    }

    /// Three channels that hear one source say no more than one, and two loads at one speed no more
    /// than one recording; another speed does.
    #[test]
    fn analytic_channels_and_loads_are_one_witness() {
        let carrier = |h: u8| {
            let order = 20.0 * f64::from(h);
            let beside = Complex64::new(0.0, PI * order * 1e-4) + Complex64::from_polar(1e-3, f64::from(h * h));
            Carrier { order, beside }
        };
        let one: Vec<Carrier> = (1..=5).map(carrier).collect();
        let three: Vec<Carrier> = (0..3).flat_map(|_| (1..=5).map(carrier)).collect();
        let seen = [one, three].map(|c| fit(&c).unwrap());
        assert!((seen[0].ln_chance - seen[1].ln_chance).abs() < 1e-9, "{seen:?}");
        assert!(fit(&[carrier(1), carrier(2), carrier(2)]).is_none());
        let at = |input_hz: f64| OrderSpectra { input_hz, ..spectra(&[], &[]) };
        let chance = |speeds: &[f64]| {
            let recordings: Vec<Spectra<'_>> = speeds.iter().map(|hz| at(*hz)).collect();
            ln_chance(&recordings, &vec![Some(seen[0]); speeds.len()])
        };
        assert!((chance(&[20.0, 20.01, 35.0]) - 2.0 * chance(&[20.0])).abs() < 1e-9);
    }

    /// A swing of a depth that grows with the torque has the exponent 1, one of a constant depth 0;
    /// other speeds say nothing of it.
    #[test]
    fn analytic_depth_over_torque_has_an_exponent() {
        let point = |input_hz: f64, brake_torque_nm: f64| Point { input_hz, brake_torque_nm };
        let swing = |size: f64| Some(OrderSwing { order: 2.0, rev: Complex64::from(size) });
        let points = [point(20.0, 10.0), point(20.1, 40.0), point(35.0, 40.0)];
        let exponent = |sizes: [f64; 3]| {
            let swings = sizes.map(swing).to_vec();
            Swinging { shaft: 0, multiple: 2, swings, chance: 1e-9 }.load_exponent(&points)
        };
        assert!((exponent([1e-4, 4e-4, 9e-4]).unwrap() - 1.0).abs() < 1e-12);
        assert!(exponent([1e-4, 1e-4, 9e-4]).unwrap().abs() < 1e-12);
        let apart = Swinging { shaft: 0, multiple: 2, swings: vec![swing(1e-4); 2], chance: 1e-9 };
        assert!(apart.load_exponent(&points[1..]).is_none());
    }
}
