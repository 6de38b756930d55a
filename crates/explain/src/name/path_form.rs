//! What a changed path does over frequency: one factor, a sensor on a spring, a mode that came or
//! moved, modes that are damped otherwise.

use num_complex::Complex64;

use crate::change::locate::Cell;
use crate::read::dsp::median;

/// Price of a number that is fitted, for `n` bands: Schwarz' criterion (1978).
fn price(numbers: usize, bands: usize) -> f64 {
    numbers as f64 * (bands.max(1) as f64).ln()
}

/// Median change of a sensor over frequency in sixths of an octave: (Hz, ln ratio, variance).
pub type Profile = Vec<(f64, f64, f64)>;

/// The profile of a channel.
pub fn profile(cells: &[Cell], channel: usize) -> Profile {
    let mut out = Vec::new();
    let ratio = 2f64.powf(1.0 / 6.0);
    let mut low = 20.0;
    while low < 1e5 {
        let members: Vec<&Cell> = cells
            .iter()
            .filter(|c| c.channel == channel && c.frequency_hz >= low && c.frequency_hz < low * ratio)
            .collect();
        if members.len() >= 3 {
            let mut values: Vec<f64> = members.iter().map(|c| c.change).collect();
            let middle = median(&mut values);
            let mut spread: Vec<f64> = members.iter().map(|c| (c.change - middle).abs()).collect();
            let sigma = (1.4826 * median(&mut spread)).max(0.04);
            out.push((low * ratio.sqrt(), middle, sigma * sigma / members.len() as f64 + 0.03 * 0.03));
        }
        low *= ratio;
    }
    out
}

/// Misfit per band of one factor for all frequencies.
pub fn one_factor_misfit(profile: &[(f64, f64, f64)]) -> f64 {
    let (sum, weight) = profile.iter().fold((0.0, 0.0), |(s, w), p| (s + p.1 / p.2, w + 1.0 / p.2));
    let level = sum / weight.max(1e-12);
    robust(profile.iter().map(|p| (p.1 - level).powi(2) / p.2))
}

/// A path with one resonance.
pub struct PathFit {
    /// Of the resonance (Hz).
    pub frequency_hz: f64,
    /// How far it may lie from there (Hz, root mean square): another resonance may do as well.
    pub spread_hz: f64,
    /// Its damping ratio.
    pub damping: f64,
    /// Below it.
    pub gain: f64,
    /// Misfit per band.
    pub left: f64,
}

impl PathFit {
    fn none(damping: f64) -> Self {
        Self { frequency_hz: f64::NAN, spread_hz: f64::NAN, damping, gain: 1.0, left: f64::INFINITY }
    }

    /// With the spread that places (Hz, misfit per band) have by their likelihood, all as likely
    /// before in the logarithm. What the best of them leaves is the scale of the errors.
    fn spread_over(self, places: &[(f64, f64)], bands: f64) -> Self {
        let weight = |left: f64| (-0.5 * bands * (left - self.left) / self.left.max(1.0)).exp();
        let of = |&(hz, left): &(f64, f64)| (weight(left), weight(left) * (hz - self.frequency_hz).powi(2));
        let (sum, squares) = places.iter().map(of).fold((0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
        Self { spread_hz: (squares / sum).sqrt(), ..self }
    }
}

/// `gain / |1 − (f/f0)² + 2iζ f/f0|`, the sensor on a spring (PHYSICS L11), searched on a grid.
pub fn mounting_fit(profile: &[(f64, f64, f64)]) -> PathFit {
    let mut best = PathFit::none(0.06);
    let mut places = Vec::with_capacity(120);
    for i in 0..120 {
        let f0 = 300.0 * (12_000.0f64 / 300.0).powf(f64::from(i) / 119.0);
        let mut least = f64::INFINITY;
        for damping in [0.02, 0.04, 0.06, 0.1, 0.16, 0.25] {
            let shape = |f: f64| {
                let r = f / f0;
                -0.5 * ((1.0 - r * r).powi(2) + (2.0 * damping * r).powi(2)).ln()
            };
            let (sum, weight) =
                profile.iter().fold((0.0, 0.0), |(s, w), p| (s + (p.1 - shape(p.0)) / p.2, w + 1.0 / p.2));
            let level = sum / weight.max(1e-12);
            let left = robust(profile.iter().map(|p| (p.1 - level - shape(p.0)).powi(2) / p.2));
            least = least.min(left);
            if left < best.left {
                best = PathFit { frequency_hz: f0, damping, gain: level.exp(), left, ..best };
            }
        }
        places.push((f0, least));
    }
    best.spread_over(&places, profile.len() as f64)
}

/// `|1 + a H(f)|` of a mode at `f0`, with a complex share `a` of its own in what each sensor reads,
/// searched on a grid. The gain is the clearest sensor's, the misfit that of all.
pub fn resonance_fit(profiles: &[Profile]) -> PathFit {
    let mut best = PathFit::none(0.03);
    let mut places = Vec::with_capacity(160);
    let bands: f64 = profiles.iter().map(|p| p.len() as f64).sum();
    for i in 0..160 {
        let f0 = 80.0 * (6000.0f64 / 80.0).powf(f64::from(i) / 159.0);
        let mut least = f64::INFINITY;
        for damping in [0.01, 0.02, 0.03, 0.05, 0.08] {
            let mode = |f: f64| {
                let r = f / f0;
                r * r / Complex64::new(1.0 - r * r, 2.0 * damping * r)
            };
            let of = |profile: &Profile| {
                let modes: Vec<Complex64> = profile.iter().map(|p| mode(p.0)).collect();
                let shares = [0.05, 0.1, 0.2, 0.4, 0.8, 1.6]
                    .into_iter()
                    .flat_map(|size| (0..8).map(move |turn| (size, f64::from(turn) * std::f64::consts::FRAC_PI_4)));
                let misfit = |(size, turn): (f64, f64)| {
                    let a = Complex64::from_polar(size, turn);
                    let form = |h: &Complex64| (Complex64::ONE + a * h).norm().max(1e-3).ln();
                    let left = robust(profile.iter().zip(&modes).map(|(p, h)| (p.1 - form(h)).powi(2) / p.2));
                    (left * profile.len() as f64, size)
                };
                shares.map(misfit).fold((f64::INFINITY, 1.0), |a, b| if b.0 < a.0 { b } else { a })
            };
            let each: Vec<(f64, f64)> = profiles.iter().map(of).collect();
            let left = each.iter().map(|e| e.0).sum::<f64>() / bands;
            least = least.min(left);
            if left < best.left {
                let gain = each.iter().map(|e| e.1).fold(0.0, f64::max);
                best = PathFit { frequency_hz: f0, damping, gain, left, ..best };
            }
        }
        places.push((f0, least));
    }
    best.spread_over(&places, bands)
}

/// A structure whose modes are damped otherwise than before.
pub struct DampingFit {
    /// Damping over what it was.
    pub factor: f64,
    /// Modes at which that shows.
    pub modes: usize,
    /// By how much it accounts better for the profile than modes that came or moved.
    pub nats: f64,
}

/// Modes that are sought, at most, and must be found: damping of a structure changes at all of its
/// modes, and one alone may have moved.
const MOST_MODES: usize = 6;
const LEAST_MODES: usize = 2;

/// How well the form at a mode is known, in proportion to its change: bands of a sixth of an octave
/// smear modes of a few per cent, and neighbours overlap.
const FORM: f64 = 0.25;
/// Factors on the damping of a mode that are tried (ln).
const FACTORS: [f64; 10] = [-1.8, -1.3, -0.9, -0.6, -0.35, 0.35, 0.6, 0.9, 1.3, 1.8];

/// A profile as a sum of changes at single modes.
struct AtModes {
    /// What is left, limited, and the price of the numbers.
    cost: f64,
    price: f64,
    modes: usize,
}

/// Modes are added one by one, each where it leaves least, as long as they gain more than their
/// numbers cost: a frequency and a damping ratio; and for each sensor whether it shows the mode, or
/// a factor of its own out of several.
fn at_modes(profiles: &[Profile], factors: &[f64]) -> AtModes {
    let bands: usize = profiles.iter().map(Vec::len).sum();
    let of_sensor = if factors.len() > 1 { price(1, bands) } else { 2.0 * std::f64::consts::LN_2 };
    let of_mode = price(2, bands) + profiles.len() as f64 * of_sensor;
    let cost = |profile: &Profile, left: &[f64]| {
        robust(left.iter().zip(profile).map(|(d, p)| d * d / p.2)) * profile.len() as f64
    };
    let mut left: Vec<Vec<f64>> = profiles.iter().map(|profile| profile.iter().map(|p| p.1).collect()).collect();
    let total = profiles.iter().zip(&left).map(|(profile, left)| cost(profile, left)).sum();
    let mut out = AtModes { cost: total, price: 0.0, modes: 0 };
    while out.modes < MOST_MODES {
        let places = (0..120).map(|i| 80.0 * (6000.0f64 / 80.0).powf(f64::from(i) / 119.0));
        let forms = places.flat_map(|f0| [0.02, 0.03, 0.05, 0.08].map(|damping| (f0, damping)));
        let next = forms.map(|(f0, damping)| {
            let of = |(profile, left): (&Profile, &Vec<f64>)| {
                let without = (cost(profile, left), left.clone());
                let with = |k: &f64| {
                    let of = |(p, d): (&(f64, f64, f64), &f64)| d - damped(p.0 / f0, damping, k.exp());
                    let next: Vec<f64> = profile.iter().zip(left).map(of).collect();
                    (cost(profile, &next), next)
                };
                factors.iter().map(with).fold(without, |a, b| if b.0 < a.0 { b } else { a })
            };
            let each: Vec<(f64, Vec<f64>)> = profiles.iter().zip(&left).map(of).collect();
            (each.iter().map(|e| e.0).sum::<f64>(), each)
        });
        let Some((to, next)) = next.reduce(|a, b| if b.0 < a.0 { b } else { a }) else { break };
        if out.cost - to < of_mode {
            break;
        }
        left = next.into_iter().map(|e| e.1).collect();
        out = AtModes { cost: to, price: out.price + of_mode, modes: out.modes + 1 };
    }
    out
}

/// A structure whose modes are damped otherwise than before: `Σ −½ ln[((1 − r²)² + (2kζr)²) / ((1 −
/// r²)² + (2ζr)²)]`, `r = f/f0`, with one factor `k` for all modes and sensors. Each mode falls at
/// its own frequency where it is damped more and rises where it is damped less, by `ln k`; between
/// them nothing changes. A mode that came or moved raises one side and lowers the other, so the
/// same sum with a factor of its own for each mode and sensor stands for that, beside one
/// resonance. `None` without modes.
pub fn damping_fit(profiles: &[Profile], resonance: &PathFit) -> Option<DampingFit> {
    let bands: usize = profiles.iter().map(Vec::len).sum();
    let roughly = |profile: &Profile| profile.iter().map(|p| (p.0, p.1, p.2 + (FORM * p.1).powi(2))).collect();
    let rough: Vec<Profile> = profiles.iter().map(roughly).collect();
    let moved = at_modes(&rough, &FACTORS);
    let other = (moved.cost + moved.price).min(resonance.left * bands as f64 + price(2 + 2 * profiles.len(), bands));
    let one = |k: &f64| (*k, at_modes(&rough, &[*k]));
    let total = |fit: &AtModes| fit.cost + fit.price + price(1, bands);
    let fits = FACTORS.iter().map(one).filter(|(_, fit)| fit.modes >= LEAST_MODES);
    let (k, best) = fits.reduce(|a, b| if total(&b.1) < total(&a.1) { b } else { a })?;
    Some(DampingFit { factor: k.exp(), modes: best.modes, nats: 0.5 * (other - total(&best)) })
}

/// ln of what one mode makes of a change of its damping ratio by a factor.
fn damped(r: f64, damping: f64, factor: f64) -> f64 {
    let about = |zeta: f64| (1.0 - r * r).powi(2) + (2.0 * zeta * r).powi(2);
    -0.5 * (about(factor * damping) / about(damping)).ln()
}

/// Mean of squares, each limited: a few bands that follow something else do not decide.
fn robust(squares: impl Iterator<Item = f64>) -> f64 {
    let (mut sum, mut n) = (0.0, 0usize);
    for s in squares {
        sum += s.min(25.0);
        n += 1;
    }
    sum / n.max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sixths of an octave with a deviation of 0.05, in which a path changed as told.
    fn bands(change: &dyn Fn(f64) -> f64) -> Vec<(f64, f64, f64)> {
        (0..42).map(|k| 60.0 * 2f64.powf(f64::from(k) / 6.0)).map(|hz| (hz, change(hz), 0.0025)).collect()
    }

    /// A clear mode is placed to a few per cent. Where nothing changed any place will do, and the
    /// spread says so.
    #[test]
    fn analytic_a_resonance_that_may_lie_elsewhere_has_a_wide_spread() {
        let mode = |hz: f64, f0: f64| {
            let r = hz / f0;
            (Complex64::ONE + 0.8 * r * r / Complex64::new(1.0 - r * r, 0.06 * r)).norm().ln()
        };
        let fit = |change: &dyn Fn(f64) -> f64| resonance_fit(&[bands(change)]);
        let clear = fit(&|hz| mode(hz, 1400.0));
        assert!((clear.frequency_hz / 1400.0 - 1.0).abs() < 0.04 && clear.spread_hz < 60.0, "{}", clear.spread_hz);
        let nothing = fit(&|_| 0.0);
        assert!(nothing.spread_hz > 0.5 * nothing.frequency_hz, "{} {}", nothing.frequency_hz, nothing.spread_hz);
    }

    /// Four modes of 3 % that are damped two and a half times as much: the factor to a step of the
    /// grid, and by many nats rather than one resonance. A mode that moved by 13 % is none of it,
    /// and a factor for all frequencies has no modes.
    #[test]
    fn analytic_damping_changes_at_all_modes_alike() {
        let modes = [210.0, 600.0, 1400.0, 4800.0];
        let damping = bands(&|hz| modes.iter().map(|f0| damped(hz / f0, 0.03, 2.5)).sum());
        let ask = |profile: &[(f64, f64, f64)]| {
            let profiles = [profile.to_vec()];
            damping_fit(&profiles, &resonance_fit(&profiles)).filter(|fit| fit.nats > 0.0)
        };
        let found = ask(&damping).unwrap();
        assert!((found.factor.ln() - 2.5f64.ln()).abs() < 0.35 && found.modes >= 3, "{} {}", found.factor, found.modes);
        let mode = |hz: f64, f0: f64| (1.0 + 8.0 / Complex64::new(1.0 - (hz / f0).powi(2), 0.04 * hz / f0)).norm().ln();
        let moved = bands(&|hz| mode(hz, 1400.0) - mode(hz, 1600.0));
        assert!(ask(&moved).is_none());
        assert!(ask(&bands(&|_| 0.3)).is_none());
        assert!(ask(&bands(&|_| 0.0)).is_none());
    }

    /// Two modes that are damped less, on two sensors alike: a second sensor adds to the evidence,
    /// since the modes and the factor are the same. Modes that moved on one of them alone are no
    /// damping.
    #[test]
    fn analytic_sensors_share_modes_and_damping() {
        let ask = |profiles: &[Profile]| damping_fit(profiles, &resonance_fit(profiles)).map_or(0.0, |fit| fit.nats);
        let of_modes = |modes: [f64; 2]| bands(&|hz| modes.iter().map(|f0| damped(hz / f0, 0.03, 0.4)).sum());
        let both = [of_modes([400.0, 1900.0]), of_modes([400.0, 1900.0])];
        assert!(ask(&both) > ask(&both[..1]) && ask(&both) > 0.0, "{} {}", ask(&both), ask(&both[..1]));
        let mode = |hz: f64, f0: f64| (1.0 + 8.0 / Complex64::new(1.0 - (hz / f0).powi(2), 0.04 * hz / f0)).norm().ln();
        let moved = [bands(&|_| 0.0), bands(&|hz| mode(hz, 1400.0) - mode(hz, 1600.0))];
        assert!(ask(&moved) <= 0.0, "{}", ask(&moved));
    }
}
