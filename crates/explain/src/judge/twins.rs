//! Twins of a case: comparisons of an unchanged bench with the very lines of the case, drawn and
//! sent through the same search.
//!
//! Masks are not alike: what a pair of settings does to all lines of a shaft makes wide masks gain
//! tens of nats by chance, and one line alone none. So each mask's gain is counted from the median
//! of its own gains in the twins, in units of their mean excess over it, and the largest of all
//! masks stands for the comparison (the minimum of p values, with its own distribution: Westfall
//! and Young 1993). The share of twins in which it is as large as in the case is the probability
//! `p_null` that an unchanged bench comes to as much (a Monte Carlo test: Barnard 1963). Scale,
//! lines and settings are the case's own, so that no other bench and no other generator has a part
//! in it.

use num_complex::Complex64;
use rand::RngExt;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal, StudentT};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::f64::consts::FRAC_1_SQRT_2;

use crate::change::compare::{self, Ratio};
use crate::change::locate::{self, Cell, Place};
use crate::change::masks::{
    self, Mask, RESONANT_SHARE, RESONANT_SLOPE, SHARED_CHANGE, SHARED_SLOPE, STRAY, STRAY_SPREAD, TAIL, USUAL_SCALE,
};
use crate::read::lines::Family;

/// Twins that are drawn: `p_null` is a multiple of a hundredth.
const TWINS: u64 = 99;

/// Least variance of the logarithm that noise gives a line, so that one without noise has an
/// amplitude.
const LEAST_NOISE: f64 = 1e-9;

/// What the twins of a case say of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Twins {
    /// Probability that an unchanged bench comes to as much, the case itself counted: 0.01 at
    /// least.
    pub p_null: f64,
    /// What the case comes to, and the median and largest of what its twins do (mean excesses over
    /// the median gain).
    pub standing: [f64; 3],
    /// By mask.
    masks: Vec<(Place, Tail)>,
    /// Of what the twins come to.
    all: Tail,
}

/// The upper half of a distribution, taken to be exponential.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Tail {
    median: f64,
    /// Mean excess over it.
    excess: f64,
}

impl Tail {
    /// A likelihood ratio of noise alone falls by one in e a nat (Wilks 1938): one more value of
    /// that kind, so that few are not believed too much.
    fn of(mut values: Vec<f64>) -> Self {
        values.sort_by(f64::total_cmp);
        let median = values[values.len() / 2];
        let beyond: Vec<f64> = values.iter().map(|g| g - median).filter(|g| *g > 0.0).collect();
        Self { median, excess: (1.0 + beyond.iter().sum::<f64>()) / (1.0 + beyond.len() as f64) }
    }

    /// Of what a mask gains in twins: nothing in one in which none of its lines stands out. The
    /// gain is a likelihood ratio itself.
    fn of_mask(place: Place, twins: &[Vec<Mask>]) -> Self {
        let gain = |masks: &Vec<Mask>| masks.iter().find(|m| m.place == place).map_or(0.0, |m| m.gain);
        let tail = Self::of(twins.iter().map(gain).collect());
        Self { excess: tail.excess.max(1.0), ..tail }
    }

    fn standing(self, value: f64) -> f64 {
        (value - self.median) / self.excess
    }
}

/// What a mask that gains so much comes to.
fn standing(tails: &[(Place, Tail)], mask: &Mask) -> f64 {
    let own = tails.iter().find(|(place, _)| *place == mask.place);
    own.map_or(f64::NEG_INFINITY, |(_, tail)| tail.standing(mask.gain))
}

impl Twins {
    /// Chance that an unchanged bench comes to as much as this mask does.
    pub fn chance(&self, mask: &Mask) -> f64 {
        self.chance_of(standing(&self.masks, mask))
    }

    /// Chance that an unchanged bench comes to as much as the case does, by the tail of its twins.
    pub fn tail(&self) -> f64 {
        self.chance_of(self.standing[0])
    }

    fn chance_of(&self, standing: f64) -> f64 {
        let over = self.all.standing(standing);
        if over <= 0.0 { 1.0 } else { 0.5 * (-over).exp() }
    }
}

/// Draws the twins of some cells as the lines outside their best mask are; `None` without lines.
pub fn twins(cells: &[Cell], places: &[Place], gaps: &[f64]) -> Option<Twins> {
    let best = *masks::masks(cells, places, gaps).first()?;
    twins_beside(cells, places, gaps, &best)
}

/// What a line of a pair does in one twin.
struct Source {
    /// Change by repetition, before its scale.
    repetition: f64,
    /// Noise in the recording and in the reference, of a power of one.
    noise: [Complex64; 2],
    /// What it strays by, if it does (ln).
    stray: f64,
}

impl Source {
    fn drawn(random: &mut ChaCha8Rng, tails: &StudentT<f64>) -> Self {
        let mut normal = || -> f64 { StandardNormal.sample(random) };
        let noise = [(); 2].map(|()| Complex64::new(normal(), normal()) * FRAC_1_SQRT_2);
        let stray = STRAY_SPREAD * normal();
        let strays = random.random::<f64>() < STRAY;
        Self { repetition: tails.sample(random), noise, stray: if strays { stray } else { 0.0 } }
    }
}

/// Draws the twins of some cells as the lines outside a mask are: those that an unchanged bench
/// would make if the mask were one by chance.
///
/// A line of the case has the amplitude `a` over noise that its variance says. In a twin it is
/// `|a + n|` in the reference and `|a exp(c + x + s σ t) + n|` in the recording. `c` is common to
/// the lines of one order in a pair: as much as settings repeat, in proportion to `s`, and speeds
/// differ (`masks::SHARED_CHANGE`, `masks::SHARED_SLOPE`). `x` is what a few lines stray by
/// (`masks::STRAY`), `n` the noise, `σ` the line's repetition, `t` of a t distribution with the
/// tails that masks take changes to have, `s` the scale of the case's own lines outside the mask.
/// All sensors hear one source: of `n` and `t` a share `√ρ` is that of the line, the same in all
/// channels, and `√(1 − ρ)` that of the channel, `ρ` as in the case's own lines outside the mask,
/// or in all where it covers all.
pub fn twins_beside(cells: &[Cell], places: &[Place], gaps: &[f64], found: &Mask) -> Option<Twins> {
    let lines: Vec<Cell> = cells.iter().filter(|c| c.family.is_some()).copied().collect();
    let tails = StudentT::new(TAIL).ok()?;
    let outside = |c: &&Cell| !locate::covers(found.place, c.family);
    let rho = match lines.iter().any(|c| outside(&c)) {
        true => between_channels(lines.iter().filter(outside)),
        false => between_channels(lines.iter()),
    };
    // Settings that repeat better than usual move lines less together, too.
    let settings = found.outside / USUAL_SCALE;
    let drawn = |twin: u64| {
        let mut random = ChaCha8Rng::seed_from_u64(0x7477_696e);
        random.set_stream(twin);
        let mut of_order: BTreeMap<(usize, (u8, usize, u8)), f64> = BTreeMap::new();
        let mut of_line: BTreeMap<(usize, Family), Source> = BTreeMap::new();
        let twin: Vec<Cell> = lines
            .iter()
            .filter_map(|c| {
                let family = c.family?;
                let common = *of_order.entry((c.pair, order_of(family))).or_insert_with(|| {
                    // Some pairs of recordings stand on the flank of a torsional resonance.
                    let resonant = random.random::<f64>() < RESONANT_SHARE;
                    let slope = if resonant { RESONANT_SLOPE } else { settings * SHARED_SLOPE };
                    let normal: f64 = StandardNormal.sample(&mut random);
                    (settings * SHARED_CHANGE).hypot(slope * gaps[c.pair]) * normal
                });
                let own = Source::drawn(&mut random, &tails);
                let line = of_line.entry((c.pair, family)).or_insert_with(|| Source::drawn(&mut random, &tails));
                let (shared, alone) = (rho.sqrt(), (1.0 - rho).sqrt());
                let repetition = shared * line.repetition + alone * own.repetition;
                let change = common + line.stray + found.outside * c.repetition.sqrt() * repetition;
                let amplitude = ((c.variance - c.repetition).max(LEAST_NOISE).recip() - 1.0).max(0.0).sqrt();
                let noise = |k: usize| c.differs.sqrt() * (shared * line.noise[k] + alone * own.noise[k]);
                as_measured(c, [amplitude * change.exp() + noise(0), amplitude + noise(1)].map(|z| z.norm_sqr()))
            })
            .collect();
        masks::masks(&twin, places, gaps)
    };
    let drawn: Vec<Vec<Mask>> = (0..TWINS).into_par_iter().map(drawn).collect();
    let tails: Vec<(Place, Tail)> = places.iter().map(|&place| (place, Tail::of_mask(place, &drawn))).collect();
    let most = |masks: &[Mask]| masks.iter().map(|m| standing(&tails, m)).fold(f64::NEG_INFINITY, f64::max);
    let own = most(&masks::masks(cells, places, gaps));
    let standings: Vec<f64> = drawn.iter().map(|masks| most(masks)).collect();
    let above = standings.iter().filter(|s| **s >= own).count();
    let largest = standings.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let all = Tail::of(standings);
    let standing = [own, all.median, largest];
    Some(Twins { p_null: (1 + above) as f64 / (1 + TWINS) as f64, standing, masks: tails, all })
}

/// A line as it is measured with these powers (over its noise) in recording and reference; `None`
/// where neither stands out.
fn as_measured(c: &Cell, powers: [f64; 2]) -> Option<Cell> {
    let ratio = Ratio::of(powers, [1.0; 2]);
    let variance = ratio.variance + c.repetition;
    (powers[0].max(powers[1]) >= compare::CLEAR).then_some(Cell {
        change: ratio.log,
        variance,
        noise: c.differs * ratio.unchanged,
        ..*c
    })
}

/// Correlation of the changes of one line between channels, by how often they have the same sign:
/// `ρ = sin π(p − ½)` (Sheppard 1899), which single large changes do not decide; 0 where they have
/// it by chance at most, or where there is one channel.
fn between_channels<'a>(lines: impl Iterator<Item = &'a Cell>) -> f64 {
    let mut rising: BTreeMap<(usize, Family), (f64, f64)> = BTreeMap::new();
    for c in lines {
        let Some(family) = c.family else { continue };
        let (up, down) = rising.entry((c.pair, family)).or_default();
        *if c.change > 0.0 { up } else { down } += 1.0;
    }
    let of = |&(up, down): &(f64, f64)| (0.5 * (up * (up - 1.0) + down * (down - 1.0)), up * down);
    let (same, other) = rising.values().map(of).fold((0.0, 0.0), |sum, x| (sum.0 + x.0, sum.1 + x.1));
    if same > other { (std::f64::consts::PI * (same / (same + other) - 0.5)).sin() } else { 0.0 }
}

/// What a line is modulated by: kind, shaft or stage, multiple.
fn order_of(f: Family) -> (u8, usize, u8) {
    match f {
        Family::Mesh { stage, .. } => (0, stage, 0),
        Family::Shaft { shaft, multiple } => (1, shaft, multiple),
        Family::Motor { multiple } => (2, 0, multiple),
        Family::Side { shaft, offset, .. } => (1, shaft, offset.unsigned_abs()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Mesh lines and sidebands of a stage in four pairs and two channels, changed by normal
    /// deviates of half a standard deviation; the first sidebands of the pinion by more.
    fn cells(seed: u64, moved: f64) -> Vec<Cell> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut out = Vec::new();
        for (pair, channel) in (0..4).flat_map(|p| [(p, 0), (p, 1)]) {
            for harmonic in 1..=5 {
                let side = |shaft, offset| Family::Side { stage: 0, harmonic, shaft, offset };
                let sides = [-2, -1, 1, 2].into_iter().flat_map(|k| [side(0, k), side(1, k)]);
                for family in std::iter::once(Family::Mesh { stage: 0, harmonic }).chain(sides) {
                    let z: f64 = StandardNormal.sample(&mut random);
                    let own = matches!(family, Family::Side { shaft: 0, offset: -1 | 1, .. });
                    let scale = if own { 0.5 + moved } else { 0.5 };
                    let frequency_hz = 100.0 * f64::from(harmonic);
                    let cell = Cell {
                        pair,
                        channel,
                        family: Some(family),
                        frequency_hz,
                        change: 0.06 * scale * z,
                        turn: None,
                        variance: 0.0036,
                        noise: 0.0,
                        repetition: 0.0036,
                        differs: 1.0,
                    };
                    out.push(cell);
                }
            }
        }
        out
    }

    fn p(cells: &[Cell]) -> f64 {
        twins(cells, &locate::places(1, false), &[0.0; 4]).unwrap().p_null
    }

    /// Normal changes have lighter tails than those of the twins and nothing in common, so that p
    /// of an unchanged bench is even or larger: of 40 at most 6 below a tenth (four are expected,
    /// binomial, two standard deviations above: 7.8). Four standard deviations on one mask are the
    /// least p that there is.
    #[test]
    fn analytic_p_is_not_small_without_a_change_and_least_with_one() {
        let all: Vec<f64> = (0..40).map(|seed| p(&cells(seed, 0.0))).collect();
        let below = all.iter().filter(|p| **p < 0.1).count();
        assert!(below <= 7, "{all:?}");
        assert!(all.iter().any(|p| *p > 0.3), "{all:?}");
        assert_eq!(p(&cells(1, 3.5)), 0.01);
    }

    /// Lines of one pair in four channels that all hear the same: heavy-tailed changes of the line,
    /// of which the channels' own part is a tenth of the power.
    fn heard_alike(seed: u64) -> Vec<Cell> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let tails = StudentT::new(TAIL).unwrap();
        let families = (0..3usize).flat_map(|shaft| (1..=12u8).map(move |multiple| Family::Shaft { shaft, multiple }));
        families
            .flat_map(|family| {
                let line: f64 = tails.sample(&mut random);
                std::array::from_fn::<Cell, 4, _>(|channel| {
                    let own: f64 = tails.sample(&mut random);
                    let change = 0.06 * 0.5 * (0.9f64.sqrt() * line + 0.1f64.sqrt() * own);
                    Cell {
                        pair: 0,
                        channel,
                        family: Some(family),
                        frequency_hz: 100.0,
                        change,
                        turn: None,
                        variance: 0.0036,
                        noise: 0.0,
                        repetition: 0.0036,
                        differs: 1.0,
                    }
                })
            })
            .collect()
    }

    /// Four channels that hear one source are no four witnesses. The sign test finds the
    /// correlation, 0.9, within five standard deviations (0.03 of 36 lines, whose six pairs of
    /// channels are one and a half); no chance of 100 unchanged benches is below a thousandth, and
    /// at most 19 p below a tenth (ten are expected, three standard deviations above).
    #[test]
    fn regress_channels_that_hear_one_source_are_one_witness() {
        let all: Vec<(f64, Twins)> = (0..100)
            .map(|seed| {
                let cells = heard_alike(seed);
                (between_channels(cells.iter()), twins(&cells, &locate::places(2, false), &[0.0]).unwrap())
            })
            .collect();
        let rho = all.iter().map(|(rho, _)| rho).sum::<f64>() / 100.0;
        assert!((rho - 0.9).abs() < 0.05, "{rho}");
        let below = |p: f64, of: &dyn Fn(&Twins) -> f64| all.iter().filter(|(_, t)| of(t) < p).count();
        assert_eq!(below(1e-3, &|t| t.chance_of(t.standing[0])), 0);
        assert!(below(0.1, &|t| t.p_null) <= 19, "{}", below(0.1, &|t| t.p_null));
        assert_eq!(between_channels(cells(1, 0.0).iter().filter(|c| c.channel == 0)), 0.0);
    }

    /// The third order of a shaft rises out of the noise to a hundred times it, in two pairs and
    /// three channels, among three hundred sidebands that repeat to 2 %. That line alone is beyond
    /// chance by far; the mask with the sidebands at its distance gains less. A line that stands
    /// out in none of the twins gains nothing there.
    #[test]
    fn regress_one_line_out_of_the_noise_is_beyond_chance_among_many_that_stay() {
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
        let mut all = Vec::new();
        for (pair, channel) in (0..2).flat_map(|p| (0..3).map(move |c| (p, c))) {
            let mut push = |family, amplitudes: [f64; 2]| {
                let cell = Cell {
                    pair,
                    channel,
                    family: Some(family),
                    frequency_hz: 100.0,
                    change: 0.0,
                    turn: None,
                    variance: 0.0,
                    noise: 0.0,
                    repetition: 0.0036,
                    differs: 1.0,
                };
                all.extend(as_measured(&cell, amplitudes.map(|a| a * a)));
            };
            for harmonic in 1..=5u8 {
                for (shaft, offset) in (1..=5i8).flat_map(|k| [(0, k), (0, -k), (1, k), (1, -k)]) {
                    let amplitude = 10.0 * (1.0 + 0.02 * normal());
                    push(Family::Side { stage: 0, harmonic, shaft, offset }, [amplitude, 10.0]);
                }
            }
            push(Family::Shaft { shaft: 0, multiple: 3 }, [100.0, 0.7]);
            push(Family::Shaft { shaft: 0, multiple: 5 }, [10.0, 10.1]);
        }
        let (places, gaps) = (locate::places(1, false), [0.0; 2]);
        let ranked = masks::masks(&all, &places, &gaps);
        assert_eq!(ranked[0].place, Place::ShaftLine(0, 3));
        let twins = twins_beside(&all, &places, &gaps, &ranked[0]).unwrap();
        assert!(twins.chance(&ranked[0]) < 1e-6, "{}", twins.chance(&ranked[0]));
        assert_eq!(Tail::of_mask(ranked[0].place, &[Vec::new(), Vec::new()]), Tail { median: 0.0, excess: 1.0 });
    }
}
