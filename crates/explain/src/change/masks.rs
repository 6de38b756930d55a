//! Masks of machine lines, judged by the scale of the changes inside and outside.

use std::collections::BTreeMap;

use crate::change::locate::{Cell, Place, covers};
use crate::read::dsp::median;
use crate::read::lines::Family;

/// What a mask of machine lines says.
#[derive(Clone, Copy, Debug)]
pub struct Mask {
    /// The mask.
    pub place: Place,
    /// Gain in log likelihood over an unchanged bench (nats).
    pub gain: f64,
    /// Scale of the changes inside, in standard deviations of repetition.
    pub inside: f64,
    /// The same outside.
    pub outside: f64,
    /// Lines inside.
    pub cells: usize,
}

/// Degrees of freedom of the t distribution of changes: lines at resonances and near cancellation
/// change far more than others.
pub(crate) const TAIL: f64 = 4.0;
/// The same of noise, whose power at a line is read from its neighbours: `2/σ²` of the logarithm of
/// a power that is known to a third.
const NOISE_TAIL: f64 = 18.0;
/// Share of lines that are not what they seem, since they meet another line or nearly cancel, and
/// how far their changes spread (ln). Of 7717 lines in 17 comparisons of unchanged benches of the
/// independent generator two changed by more than four standard deviations.
pub(crate) const STRAY: f64 = 0.001;
pub(crate) const STRAY_SPREAD: f64 = 1.0;
/// Grid of scales: first, ratio, number.
const FIRST_SCALE: f64 = 0.2;
const SCALE_RATIO: f64 = 1.15;
pub(crate) const SCALES: usize = 36;
/// Scale of an unchanged bench, median and spread (ln); none lies above the largest.
pub const USUAL_SCALE: f64 = 0.5;
const USUAL_SPREAD: f64 = 0.3;
const LARGEST_USUAL: f64 = 0.85;
/// Lines of one order in several channels and recordings share their errors: this share of them
/// counts.
pub(crate) const INDEPENDENT: f64 = 0.4;

/// Median change of a mask's lines (standard deviations); 0 of none.
pub fn median_change(cells: &[Cell], place: Place) -> f64 {
    let inside = |c: &&Cell| c.family.is_some() && covers(place, c.family);
    let mut all: Vec<f64> = cells.iter().filter(inside).map(|c| c.score().abs()).collect();
    if all.is_empty() { 0.0 } else { median(&mut all) }
}

/// Scale number `k` of the grid.
pub(crate) fn scale(k: usize) -> f64 {
    FIRST_SCALE * SCALE_RATIO.powi(k as i32)
}

/// Log density of a change that is off by so much, at each scale of repetition, up to a constant.
/// Noise is known, and has no scale: lines that it alone moves tell nothing of how settings repeat.
/// The sum of both has a t distribution whose degrees of freedom are those of Welch (1947) and
/// Satterthwaite (1946). Few lines stray, however well the others repeat (a contaminated
/// distribution: Tukey 1960), so that two or three of them make no mask.
pub(crate) fn densities(cell: &Cell, off: f64) -> [f64; SCALES] {
    std::array::from_fn(|k| {
        let variance = cell.unchanged(scale(k));
        let noise = cell.noise / variance;
        let tail = (noise * noise / NOISE_TAIL + (1.0 - noise).powi(2) / TAIL).recip();
        // ln Γ((ν + 1)/2) − ln Γ(ν/2) − ½ ln πν, to 1/ν.
        let peak = -0.25 / tail;
        let own = peak - 0.5 * variance.ln() - 0.5 * (tail + 1.0) * (off * off / (tail * variance)).ln_1p();
        let wide = variance + STRAY_SPREAD * STRAY_SPREAD;
        let stray = STRAY.ln() - 0.5 * wide.ln() - 0.5 * off * off / wide;
        own.max(stray) + (-(own - stray).abs()).exp().ln_1p()
    })
}

/// Scales that an unchanged bench may have.
fn usual_scales() -> impl Iterator<Item = usize> {
    (0..SCALES).take_while(|&k| scale(k) <= LARGEST_USUAL)
}

/// ln prior density of a scale of an unchanged bench, up to a constant.
fn prior(k: usize) -> f64 {
    -0.5 * ((scale(k) / USUAL_SCALE).ln() / USUAL_SPREAD).powi(2)
}

/// Log likelihood, prior included, of sums by scale at the best scale of an unchanged bench.
fn at_a_usual_scale(sums: &[f64; SCALES]) -> f64 {
    usual_scales().map(|k| sums[k] + prior(k)).fold(f64::NEG_INFINITY, f64::max)
}

/// Masks of the machine, best first: inside, changes have one scale (of a mesh, those of some of
/// its harmonics, whichever), outside the usual one. The
/// wider a mask, the more its quiet lines speak against it; the narrower, the more the changes that
/// it leaves.
///
/// Lines that one order of a shaft modulates share what the settings do to it: near a torsional
/// resonance a part in a thousand of speed is a tenth of the amplitude. An unchanged bench may
/// change them together by that much (`gaps`: ln of the speed ratio of each pair).
pub fn masks(cells: &[Cell], places: &[Place], gaps: &[f64]) -> Vec<Mask> {
    let usual: Vec<(usize, f64)> = usual_scales().map(|k| (k, prior(k))).collect();
    masks_over(cells, places, gaps, &usual)
}

/// The same beside an effect that was named: what that does elsewhere in the train is not known, so
/// the lines outside a mask may have any scale.
pub fn masks_beside(cells: &[Cell], places: &[Place], gaps: &[f64]) -> Vec<Mask> {
    let any: Vec<(usize, f64)> = (0..SCALES).map(|k| (k, 0.0)).collect();
    masks_over(cells, places, gaps, &any)
}

/// Evidence of changes of which each source has one scale or another, beyond that of the first
/// alone; by source `ln(b/a)`, of its lines at either scale. Which share π of the sources changed
/// is not known, and any is as likely: `∫ Π (1 − π + π bᵢ/aᵢ) dπ = Σ_m E_m B(m + 1, n − m + 1)`,
/// with the elementary symmetric sums E_m of the ratios (a beta-binomial mixture).
fn some_of_them(ratios: &[f64]) -> f64 {
    let log_sum = |a: f64, b: f64| a.max(b) + (-(a - b).abs()).exp().ln_1p();
    let mut sums = vec![0.0];
    for ratio in ratios {
        let of_all = sums[sums.len() - 1] + ratio;
        for m in (1..sums.len()).rev() {
            sums[m] = log_sum(sums[m], sums[m - 1] + ratio);
        }
        sums.push(of_all);
    }
    // ln B(m + 1, n − m + 1), from 1/(n + 1) at m = 0 on.
    let n = ratios.len() as f64;
    let mut share = -(n + 1.0).ln();
    let mut out = share;
    for (m, sum) in (1u32..).zip(&sums[1..]) {
        share += (f64::from(m) / (n - f64::from(m) + 1.0)).ln();
        out = log_sum(out, share + sum);
    }
    out
}

/// Masks over lines outside whose scales have these ln prior densities.
fn masks_over(cells: &[Cell], places: &[Place], gaps: &[f64], outside: &[(usize, f64)]) -> Vec<Mask> {
    let lines: Vec<&Cell> = cells.iter().filter(|c| c.family.is_some()).collect();
    let tables: Vec<[f64; SCALES]> = lines.iter().map(|c| densities(c, c.change)).collect();
    let mut all = [0.0; SCALES];
    for t in &tables {
        all.iter_mut().zip(t).for_each(|(a, v)| *a += INDEPENDENT * v);
    }
    let changed = usual_scales().count();
    let null = outside.iter().map(|(k, prior)| all[*k] + prior).fold(f64::NEG_INFINITY, f64::max);
    let mut out: Vec<Mask> = places
        .iter()
        .filter_map(|&place| {
            let mut inside = [0.0; SCALES];
            let mut count = 0;
            // An error of the profile moves the harmonics that its form holds.
            let mut by_harmonic: BTreeMap<u8, [f64; SCALES]> = BTreeMap::new();
            for (c, t) in lines.iter().zip(&tables) {
                if covers(place, c.family) {
                    inside.iter_mut().zip(t).for_each(|(a, v)| *a += INDEPENDENT * v);
                    count += 1;
                    if let (Place::Mesh(_), Some(Family::Mesh { harmonic, .. })) = (place, c.family) {
                        let own = by_harmonic.entry(harmonic).or_insert([0.0; SCALES]);
                        own.iter_mut().zip(t).for_each(|(a, v)| *a += INDEPENDENT * v);
                    }
                }
            }
            let together = common_change(&lines, place, gaps);
            let mut best: Option<(f64, usize, usize)> = None;
            for &(k0, prior) in outside {
                // What lies within the usual scales is no change, however quiet the rest is.
                for k1 in changed.max(k0 + 1)..SCALES {
                    let gained = if by_harmonic.is_empty() {
                        inside[k1] - inside[k0]
                    } else {
                        let ratios: Vec<f64> = by_harmonic.values().map(|sums| sums[k1] - sums[k0]).collect();
                        some_of_them(&ratios)
                    };
                    let log = all[k0] + prior + gained;
                    if best.is_none_or(|b| log > b.0) {
                        best = Some((log, k0, k1));
                    }
                }
            }
            let (log, k0, k1) = best.filter(|_| count > 0)?;
            // One free scale, known to within its own sampling error.
            let price = 0.5 * (1.0 + count as f64).ln();
            // What an unchanged bench makes of the same lines when they may change together.
            let relief = together.map_or(0.0, |t| (t.likelihood[k0] - t.price - inside[k0]).max(0.0));
            Some(Mask { place, gain: log - null - price - relief, inside: scale(k1), outside: scale(k0), cells: count })
        })
        .collect();
    out.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    out
}

/// Log likelihood of all lines of an unchanged bench, whose changes have one usual scale; variances
/// count, so that cells with a prediction of their own can be compared with the same without.
pub fn unchanged(cells: &[Cell]) -> f64 {
    let mut all = [0.0; SCALES];
    for c in cells.iter().filter(|c| c.family.is_some()) {
        all.iter_mut().zip(densities(c, c.change)).for_each(|(a, v)| *a += INDEPENDENT * v);
    }
    at_a_usual_scale(&all)
}

/// How much an order must gain (nats) and stand out (ratio of scales) among the lines of a wider
/// mask to be its cause: gears and bearings that change came to 28 nats and four times at most, not
/// both.
const CAUSE_GAIN: f64 = 40.0;
const CAUSE_STANDS_OUT: f64 = 4.0;

/// The one order within a wider mask whose lines rise far above the rest of it: a strong ripple
/// drags all lines of its shaft along.
pub fn cause_within(cells: &[Cell], wide: &Mask, places: &[Place]) -> Option<Mask> {
    let inside: Vec<&Cell> = cells.iter().filter(|c| c.family.is_some() && covers(wide.place, c.family)).collect();
    let tables: Vec<[f64; SCALES]> = inside.iter().map(|c| densities(c, c.change)).collect();
    let sum = |of: &dyn Fn(&Cell) -> bool| {
        let mut sums = [0.0; SCALES];
        for (_, t) in inside.iter().zip(&tables).filter(|(c, _)| of(c)) {
            sums.iter_mut().zip(t).for_each(|(a, v)| *a += INDEPENDENT * v);
        }
        (0..SCALES).map(|k| (sums[k], k)).fold((f64::NEG_INFINITY, 0), |a, b| if b.0 > a.0 { b } else { a })
    };
    let together = sum(&|_| true).0;
    let orders = places.iter().filter(|p| matches!(p, Place::ShaftOrder(_, k) if *k > 1));
    let candidates = orders.filter_map(|&place| {
        let covered: Vec<&&Cell> = inside.iter().filter(|c| covers(place, c.family)).collect();
        let rising = covered.iter().filter(|c| c.change > 0.0).count();
        if covered.len() == inside.len() || 2 * rising <= covered.len() {
            return None;
        }
        let ((own, k1), (rest, k0)) = (sum(&|c| covers(place, c.family)), sum(&|c| !covers(place, c.family)));
        let gain = own + rest - together;
        (gain > CAUSE_GAIN && scale(k1) > CAUSE_STANDS_OUT * scale(k0)).then(|| Mask {
            place,
            gain,
            inside: scale(k1),
            outside: scale(k0),
            cells: covered.len(),
        })
    });
    candidates.max_by(|a, b| a.gain.total_cmp(&b.gain))
}

/// First order of a shaft over every other kind of line (medians) from which it is the cause,
/// whatever else moved: a rotor out of balance shakes the whole train, and a wide mask gains by
/// that. Unbalance comes to 8.8 to 40 on 9 benches, anything else that moves it by five standard
/// deviations to 5.5 at most on 430.
const ONCE_ALONE: f64 = 7.0;
const ONCE_CLEAR: f64 = 5.0;

/// What a first order has to lead.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Once {
    /// Whatever else of the train changed: meshes, gears, rows of orders.
    OfTrain,
    /// The row and the gears of its own shaft. What was named changes the rest.
    OfShaft,
}

/// The first order of a shaft, where it changed far more than what may follow it.
pub fn once_alone(cells: &[Cell], ranked: &[Mask], places: &[Place], others: Once) -> Option<Mask> {
    let leads = |m: &&Mask| {
        let Place::ShaftLine(own, 1) = m.place else { return false };
        let follows = |p: &&Place| match **p {
            Place::Mesh(_) => others == Once::OfTrain,
            Place::Gear(_, shaft) | Place::FirstSide(_, shaft) | Place::ShaftOrders(shaft) => {
                others == Once::OfTrain || shaft == own
            }
            _ => false,
        };
        let most = places.iter().filter(follows).map(|p| median_change(cells, *p)).fold(USUAL_SCALE, f64::max);
        let change = median_change(cells, m.place);
        change > ONCE_CLEAR && change > ONCE_ALONE * most
    };
    ranked.iter().find(leads).copied()
}

/// Spreads of a set of changes (ln) that are tried: first, ratio, number.
const FIRST_SPREAD: f64 = 0.02;
const SPREAD_RATIO: f64 = 1.25;
pub(crate) const SPREADS: usize = 26;

/// Spread number `k` of these.
pub(crate) fn spread(k: usize) -> f64 {
    FIRST_SPREAD * SPREAD_RATIO.powi(k as i32)
}

/// Lines of a mask when what they have in common in each pair is taken off: log likelihood by
/// scale, and the price of it.
struct Together {
    likelihood: [f64; SCALES],
    price: f64,
}

/// Change that lines of one order share by chance (ln): at equal speed, per change of speed away
/// from torsional resonances, and (1/2ζ at 0.5 %) on the flank of one.
pub(crate) const SHARED_CHANGE: f64 = 0.04;
pub(crate) const SHARED_SLOPE: f64 = 15.0;
pub(crate) const RESONANT_SLOPE: f64 = 100.0;
/// Share of speeds on such a flank, and the price of the assumption (nats).
pub(crate) const RESONANT_SHARE: f64 = 0.1;
const RESONANT_PRICE: f64 = 2.3;

fn common_change(lines: &[&Cell], place: Place, gaps: &[f64]) -> Option<Together> {
    if !matches!(place, Place::FirstSide(..) | Place::ShaftLine(..) | Place::ShaftOrder(..) | Place::MotorOrder(_)) {
        return None;
    }
    let mut out = Together { likelihood: [0.0; SCALES], price: 0.0 };
    for (pair, gap) in gaps.iter().enumerate() {
        let inside: Vec<&&Cell> = lines.iter().filter(|c| c.pair == pair && covers(place, c.family)).collect();
        let mut changes: Vec<f64> = inside.iter().map(|c| c.change).collect();
        let shared = if changes.is_empty() { 0.0 } else { crate::read::dsp::median(&mut changes) };
        let usual = SHARED_CHANGE.hypot(SHARED_SLOPE * gap);
        let resonant = SHARED_CHANGE.hypot(RESONANT_SLOPE * gap);
        let price = |sigma: f64| 0.5 * (shared / sigma).powi(2);
        out.price += price(usual).min(price(resonant) + (resonant / usual).ln() + RESONANT_PRICE);
        for c in inside {
            let t = densities(c, c.change - shared);
            out.likelihood.iter_mut().zip(t).for_each(|(a, v)| *a += INDEPENDENT * v);
        }
    }
    Some(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// All ways to choose which of four sources changed, and the share by quadrature.
    #[test]
    fn oracle_some_of_the_sources_changed() {
        let ratios = [3.0, -2.0, 0.5, 40.0];
        let steps = 2000;
        let at = |share: f64| ratios.iter().map(|r| 1.0 - share + share * f64::exp(*r)).product::<f64>();
        let sum: f64 = (0..steps).map(|k| at((f64::from(k) + 0.5) / f64::from(steps))).sum::<f64>();
        // The midpoint rule errs by the second derivative, some 12, by 24 N².
        assert!((some_of_them(&ratios) - (sum / f64::from(steps)).ln()).abs() < 1e-6);
        assert!((some_of_them(&[0.0; 12])).abs() < 1e-12);
        // All of twelve changed, or none: one of 13 shares that are alike.
        assert!((some_of_them(&[200.0; 12]) - (2400.0 - 13f64.ln())).abs() < 1e-9);
        assert!((some_of_them(&[-200.0; 12]) + 13f64.ln()).abs() < 1e-9);
        assert_eq!(some_of_them(&[]), 0.0);
    }

    /// Lines that change by their own scale are as an unchanged bench has them; by ten times that
    /// they are not, and a prediction that takes the changes off gains it back, less what its own
    /// variance costs: half of ln 2 a line where it doubles the variance. Of noise as large as the
    /// usual repetition it costs half the logarithm of by how much both are more than repetition, a
    /// fifth to 0.85 of the usual, alone.
    #[test]
    fn analytic_a_prediction_gains_what_it_takes_off() {
        let with = |z: f64, noise: f64, repetition: f64| -> Vec<Cell> {
            let of = |k: u8| {
                let change = 0.1 * z * if k.is_multiple_of(2) { 1.0 } else { -1.0 };
                let family = Some(Family::Shaft { shaft: 0, multiple: k });
                Cell {
                    pair: 0,
                    channel: 0,
                    family,
                    frequency_hz: 100.0,
                    change,
                    turn: None,
                    variance: noise + repetition,
                    noise,
                    repetition,
                    differs: 1.0,
                }
            };
            (1..=40).map(of).collect()
        };
        let (usual, moved) = (unchanged(&with(0.3, 0.0, 0.01)), unchanged(&with(5.0, 0.0, 0.01)));
        assert!(usual > moved + INDEPENDENT * 40.0);
        let (narrow, wide) = (unchanged(&with(0.0, 0.0, 0.01)), unchanged(&with(0.0, 0.0, 0.02)));
        // What strays add to the density at 0, over that of lines as wide as they may be (0.85 of
        // the usual).
        let strays = INDEPENDENT * 40.0 * STRAY * LARGEST_USUAL * 0.02f64.sqrt() / STRAY_SPREAD;
        assert!((narrow - wide - INDEPENDENT * 40.0 * 0.5 * 2f64.ln()).abs() < strays);
        let noisy = unchanged(&with(0.0, 0.01, 0.01));
        let price = |scale: f64| INDEPENDENT * 40.0 * 0.5 * (1.0 + scale.powi(-2)).ln();
        assert!((price(LARGEST_USUAL)..price(FIRST_SCALE)).contains(&(narrow - noisy)));
    }

    /// Thirty multiples of a shaft in twelve pairs, one of which changes by so many standard
    /// deviations; the others by less than one.
    fn cells(loud: u8, z: f64) -> Vec<Cell> {
        let of = |pair: usize| {
            (1..=30u8).map(move |multiple| {
                let z = if multiple == loud { z } else { 0.9 * (f64::from(multiple) + pair as f64).sin() };
                let family = Some(Family::Shaft { shaft: 1, multiple });
                Cell {
                    pair,
                    channel: 0,
                    family,
                    frequency_hz: 100.0,
                    change: 0.1 * z,
                    turn: None,
                    variance: 0.01,
                    noise: 0.0,
                    repetition: 0.01,
                    differs: 1.0,
                }
            })
        };
        (0..12).flat_map(of).collect()
    }

    /// At the others' scale of 0.5 a change of 200 costs 5 ln(200 / 2 · 0.5) nats, at one of its
    /// own ln(200 / 0.5): twelve such lines gain 0.4 · 12 · 20, and the order is the cause. One
    /// that falls is not added to the machine, and one that rises by 2 is no ripple that drags
    /// others along.
    #[test]
    fn analytic_an_order_far_above_its_mask_is_the_cause() {
        let places: Vec<Place> = (1..=6).map(|k| Place::ShaftOrder(1, k)).collect();
        let ask = |cells: &[Cell]| {
            let wide = Mask { place: Place::Gear(0, 1), gain: 100.0, inside: 2.0, outside: 0.5, cells: cells.len() };
            cause_within(cells, &wide, &places).map(|m| m.place)
        };
        assert_eq!(ask(&cells(3, 200.0)), Some(Place::ShaftOrder(1, 3)));
        assert_eq!(ask(&cells(3, -200.0)), None);
        assert_eq!(ask(&cells(3, 2.0)), None);
        // The first order is run-out or unbalance, which have masks of their own.
        assert_eq!(ask(&cells(1, 200.0)), None);
    }

    /// Of thirty multiples that change by 0.6 standard deviations (median) the first changes by 20,
    /// more than seven times the others; by 4 it may be repetition, and beside a mesh harmonic that
    /// changes by 3 it is not alone.
    #[test]
    fn analytic_a_first_order_alone_is_the_cause() {
        let places = [Place::ShaftLine(1, 1), Place::ShaftOrders(1), Place::Mesh(0), Place::Gear(0, 1)];
        let ask = |cells: &[Cell]| {
            once_alone(cells, &masks(cells, &places, &[0.0; 12]), &places, Once::OfTrain).map(|m| m.place)
        };
        let mut loud = cells(1, 20.0);
        assert!((0.5..0.75).contains(&median_change(&loud, Place::ShaftOrders(1))));
        assert_eq!(median_change(&loud, Place::Mesh(0)), 0.0);
        assert_eq!(ask(&loud), Some(Place::ShaftLine(1, 1)));
        assert_eq!(ask(&cells(1, 4.0)), None);
        let mesh = Some(Family::Mesh { stage: 0, harmonic: 1 });
        loud.push(Cell { family: mesh, change: 0.3, ..loud[0] });
        assert_eq!(ask(&loud), None);
        // What was named changes the mesh: of its own shaft's lines it is alone still.
        let ranked = masks(&loud, &places, &[0.0; 12]);
        let of_shaft = |cells: &[Cell]| once_alone(cells, &ranked, &places, Once::OfShaft).map(|m| m.place);
        assert_eq!(of_shaft(&loud), Some(Place::ShaftLine(1, 1)));
        let side = |offset| Some(Family::Side { stage: 0, harmonic: 1, shaft: 1, offset });
        loud.extend([-1, 1].map(|offset| Cell { family: side(offset), change: 0.5, ..loud[0] }));
        let places: Vec<Place> = places.iter().copied().chain([Place::FirstSide(0, 1)]).collect();
        assert_eq!(once_alone(&loud, &ranked, &places, Once::OfShaft).map(|m| m.place), None);
    }
}
