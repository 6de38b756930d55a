//! Oscillators with a gap and a varying stiffness against published and analytic behaviour, stepped
//! by the located Runge–Kutta.
//!
//! `x″ + 2ζ x′ + κ(t) g(x) = F_m + Σ F_j (jΩ)² cos jΩt` with a dead zone of ±1 (Kahraman & Singh
//! 1990, 1991).

use std::f64::consts::TAU;

use gearwatch_sim::rk4::{RungeKutta, Switched};

struct Oscillator {
    zeta: f64,
    mean: f64,
    omega: f64,
    /// F_j, first harmonic first.
    forces: Vec<f64>,
    /// Amplitudes of −cos jΩt in the stiffness.
    stiffness: Vec<f64>,
    gap: f64,
}

impl Oscillator {
    fn kappa(&self, t: f64) -> f64 {
        let wave = |(j, a): (usize, &f64)| a * ((j + 1) as f64 * self.omega * t).cos();
        1.0 - self.stiffness.iter().enumerate().map(wave).sum::<f64>()
    }
}

impl Switched for Oscillator {
    type Regime = i8;

    fn derivative(&mut self, t: f64, x: &[f64], out: &mut [f64]) {
        let spring = x[0] - x[0].clamp(-self.gap, self.gap);
        let drive = |(j, f): (usize, &f64)| {
            let w = (j + 1) as f64 * self.omega;
            f * w * w * (w * t).cos()
        };
        let force: f64 = self.forces.iter().enumerate().map(drive).sum();
        out[0] = x[1];
        out[1] = self.mean + force - 2.0 * self.zeta * x[1] - self.kappa(t) * spring;
    }

    fn regime(&mut self, _t: f64, x: &[f64]) -> i8 {
        i8::from(x[0] > self.gap) - i8::from(x[0] < -self.gap)
    }
}

const STEPS: u32 = 100;

/// Half the peak to peak of the last four of `periods` periods, from a state that is carried on.
fn half_peak_to_peak(system: &mut Oscillator, state: &mut [f64; 2], periods: u32) -> f64 {
    let h = TAU / system.omega / f64::from(STEPS);
    let mut stepper = RungeKutta::new(2);
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for n in 0..periods * STEPS {
        stepper.located(system, f64::from(n) * h, h, state);
        if n >= (periods - 4) * STEPS {
            (low, high) = (low.min(state[0]), high.max(state[0]));
        }
    }
    0.5 * (high - low)
}

fn kahraman_singh_1990(omega: f64) -> Oscillator {
    Oscillator { zeta: 0.05, mean: 0.1, omega, forces: vec![0.05], stiffness: vec![], gap: 1.0 }
}

fn kahraman_singh_1991(omega: f64) -> Oscillator {
    Oscillator {
        zeta: 0.05,
        mean: 0.1,
        omega,
        forces: vec![0.01, 0.004, 0.002],
        stiffness: vec![0.2, 0.1, 0.05],
        gap: 1.0,
    }
}

/// Amplitude of a harmonic of the forcing over the last four of `periods` periods, `steps` steps a
/// period.
fn amplitude(system: &mut Oscillator, state: &mut [f64; 2], periods: u32, steps: u32, harmonic: u32) -> f64 {
    let h = TAU / system.omega / f64::from(steps);
    let mut stepper = RungeKutta::new(2);
    let (mut re, mut im) = (0.0, 0.0);
    for n in 0..periods * steps {
        if n >= (periods - 4) * steps {
            let (sin, cos) = (TAU * f64::from(harmonic * n % steps) / f64::from(steps)).sin_cos();
            (re, im) = (re + state[0] * cos, im + state[0] * sin);
        }
        stepper.located(system, f64::from(n) * h, h, state);
    }
    re.hypot(im) / f64::from(2 * steps)
}

/// T1: without contact loss the response is `F Ω² / √((1−Ω²)² + (2ζΩ)²)`. Steps of a four hundredth
/// of a period err by 1e-8 of it.
#[test]
fn analytic_linear_oscillator() {
    for omega in [0.5, 0.6, 0.7] {
        let mut state = [1.1, 0.0];
        let found = amplitude(&mut kahraman_singh_1990(omega), &mut state, 100, 400, 1);
        let expected: f64 = 0.05 * omega * omega / ((1.0 - omega * omega).powi(2) + (0.1 * omega).powi(2)).sqrt();
        assert!((found / expected - 1.0).abs() < 1e-6, "{omega}: {found} {expected}");
    }
}

/// T2, published-type case with constant stiffness: values of an independent RK4 of 400 steps a
/// period; amplitudes to 0.2 %.
#[test]
fn literature_kahraman_singh_1990_amplitudes() {
    let mut state = [1.1, 0.0];
    for (omega, expected) in [
        (0.5, 0.016_630),
        (0.6, 0.028_002),
        (0.7, 0.047_592),
        (0.75, 0.063_361),
        (0.8, 0.086_772),
        (0.85, 0.255_53),
        (0.9, 0.229_16),
    ] {
        let found = half_peak_to_peak(&mut kahraman_singh_1990(omega), &mut state, 200);
        assert!((found / expected - 1.0).abs() < 2e-3, "{omega}: {found} {expected}");
    }
    for (omega, expected) in [(1.0, 0.186_98), (1.1, 0.155_86), (1.2, 0.132_65), (1.5, 0.089_357)] {
        let found = half_peak_to_peak(&mut kahraman_singh_1990(omega), &mut state, 200);
        assert!((found / expected - 1.0).abs() < 2e-3, "{omega}: {found} {expected}");
    }
}

/// T2: jump up between 0.828 and 0.830, jump down between 0.7075 and 0.7085; in between both
/// motions live.
#[test]
fn literature_kahraman_singh_1990_jumps_and_bistability() {
    let mut low = [1.1, 0.0];
    // Swept up slowly: a state from rest would fall into the upper motion.
    for omega in [0.7, 0.75, 0.79, 0.81, 0.82, 0.824] {
        half_peak_to_peak(&mut kahraman_singh_1990(omega), &mut low, 150);
    }
    assert!(half_peak_to_peak(&mut kahraman_singh_1990(0.827), &mut low, 300) < 0.12);
    assert!(half_peak_to_peak(&mut kahraman_singh_1990(0.831), &mut low, 300) > 0.25);
    let mut high = low;
    for omega in [0.8, 0.75] {
        let expected = if omega == 0.8 { 0.285_72 } else { 0.318_34 };
        let found = half_peak_to_peak(&mut kahraman_singh_1990(omega), &mut high, 200);
        assert!((found / expected - 1.0).abs() < 2e-3, "{omega}: {found} {expected}");
    }
    assert!(half_peak_to_peak(&mut kahraman_singh_1990(0.715), &mut high, 200) > 0.3);
    assert!(half_peak_to_peak(&mut kahraman_singh_1990(0.7095), &mut high, 300) > 0.3);
    assert!(half_peak_to_peak(&mut kahraman_singh_1990(0.7065), &mut high, 300) < 0.06);
}

/// T3, periodic stiffness (set of Kahraman & Singh 1991): second-harmonic resonance at 0.5, two
/// motions at 0.7.
#[test]
fn literature_kahraman_singh_1991() {
    let mut state = [1.1, 0.0];
    for (omega, expected) in [(0.4, 0.067_66), (0.5, 0.145_67)] {
        let found = half_peak_to_peak(&mut kahraman_singh_1991(omega), &mut state, 300);
        assert!((found / expected - 1.0).abs() < 5e-3, "{omega}: {found} {expected}");
    }
    let mut down = [1.1, 0.0];
    for (omega, expected) in [
        (1.5, 0.033_55),
        (1.1, 0.100_57),
        (1.0, 0.138_26),
        (0.9, 0.186_96),
        (0.8, 0.256_35),
        (0.7, 0.353_97),
        (0.65, f64::NAN),
        (0.62, f64::NAN),
        (0.6, 0.486_91),
    ] {
        let found = half_peak_to_peak(&mut kahraman_singh_1991(omega), &mut down, 300);
        // Between the values that are known the sweep only goes on.
        assert!(expected.is_nan() || (found / expected - 1.0).abs() < 5e-3, "{omega} down: {found} {expected}");
    }
    let mut up = [1.1, 0.0];
    for (omega, expected) in [(0.6, 0.062_57), (0.7, 0.058_03), (0.8, 0.081_33)] {
        let found = half_peak_to_peak(&mut kahraman_singh_1991(omega), &mut up, 300);
        assert!((found / expected - 1.0).abs() < 5e-3, "{omega} up: {found} {expected}");
    }
    // Above 0.835 there is one motion again.
    assert!(half_peak_to_peak(&mut kahraman_singh_1991(0.85), &mut up, 300) > 0.2);
}

/// T3 at Ω = 0.5: the second harmonic is the resonant one, 0.12401 against 0.03002 of the first
/// (0.5 %).
#[test]
fn literature_kahraman_singh_1991_second_harmonic() {
    for (harmonic, expected) in [(1, 0.030_02), (2, 0.124_01)] {
        let found = amplitude(&mut kahraman_singh_1991(0.5), &mut [1.1, 0.0], 300, 400, harmonic);
        assert!((found / expected - 1.0).abs() < 5e-3, "{harmonic}: {found} {expected}");
    }
}

/// Runge–Kutta is of order 4 on a smooth system: halving the step divides the error by 16 (a tenth
/// of slack for the next order).
#[test]
fn analytic_order_of_runge_kutta() {
    let end = |steps: u32| {
        let mut system = Oscillator { gap: 0.0, ..kahraman_singh_1991(0.7) };
        let (mut state, mut stepper) = ([1.0, 0.2], RungeKutta::new(2));
        let h = 40.0 / f64::from(steps);
        for n in 0..steps {
            stepper.plain(&mut system, f64::from(n) * h, h, &mut state);
        }
        state[0]
    };
    let exact = end(64_000);
    let (coarse, fine) = ((end(1000) - exact).abs(), (end(2000) - exact).abs());
    assert!((coarse / fine - 16.0).abs() < 1.6, "{coarse:.2e} {fine:.2e}");
}

/// A stiffness that jumps between two values twice a period, as k(t) does without corner contact.
struct Rectangular {
    omega: f64,
}

impl Rectangular {
    /// The stiff three fifths of a period.
    fn is_stiff(&self, t: f64) -> bool {
        (self.omega * t / TAU).rem_euclid(1.0) < 0.6
    }
}

impl Switched for Rectangular {
    type Regime = bool;

    fn derivative(&mut self, t: f64, x: &[f64], out: &mut [f64]) {
        let kappa = if self.is_stiff(t) { 1.2 } else { 0.7 };
        out[0] = x[1];
        out[1] = 1.0 - 0.1 * x[1] - kappa * x[0];
    }

    fn regime(&mut self, t: f64, _x: &[f64]) -> bool {
        self.is_stiff(t)
    }
}

/// With its steps ended on the jumps Runge–Kutta keeps its order 4 where the stiffness jumps (16 a
/// halving, a tenth of slack); over them it does not.
#[test]
fn analytic_order_of_runge_kutta_with_located_jumps() {
    let end = |steps: u32, located: bool| {
        // No number of steps here divides the period: jumps fall anywhere.
        let mut system = Rectangular { omega: 0.3 };
        let (mut state, mut stepper) = ([1.0, 0.2], RungeKutta::new(2));
        let h = 100.0 / f64::from(steps);
        for n in 0..steps {
            let t = f64::from(n) * h;
            if located {
                stepper.located(&mut system, t, h, &mut state);
            } else {
                stepper.plain(&mut system, t, h, &mut state);
            }
        }
        state[0]
    };
    let exact = end(64_000, true);
    let error = |steps, located| (end(steps, located) - exact).abs();
    let ratio = error(400, true) / error(800, true);
    assert!((ratio - 16.0).abs() < 1.6, "{ratio}");
    assert!(error(800, false) > 20.0 * error(800, true), "{:.1e} {:.1e}", error(800, false), error(800, true));
}

/// T4: Mathieu's instability at Ω = 2 sets in at k = 4ζ, and at ζ = 0.05, k = 0.4 the multiplier is
/// 1.1687 a period.
#[test]
fn literature_mathieu_threshold() {
    let growth_at = |k: f64, zeta: f64, omega: f64| {
        // κ = 1 − (−k) cos Ωt, no gap: the whole line is a spring.
        let mut system = Oscillator { zeta, mean: 0.0, omega, forces: vec![], stiffness: vec![-k], gap: 0.0 };
        let mut state = [1.0, 0.3];
        let h = TAU / system.omega / 200.0;
        let mut stepper = RungeKutta::new(2);
        let mut norm = 1.0;
        let mut last = 0.0;
        for n in 0..400 * 200_u32 {
            stepper.plain(&mut system, f64::from(n) * h, h, &mut state);
            if n % 200 == 199 {
                let length = state[0].hypot(state[1]);
                last = length / norm;
                state.iter_mut().for_each(|x| *x /= length);
                norm = 1.0;
            }
        }
        last
    };
    let growth = |k, zeta| growth_at(k, zeta, 2.0);
    for (zeta, threshold) in [(0.01, 0.040_00), (0.05, 0.200_11), (0.1, 0.400_87)] {
        assert!(growth(threshold * 0.99, zeta) < 1.0 && growth(threshold * 1.01, zeta) > 1.0, "{zeta}");
    }
    let found = growth(0.4, 0.05);
    assert!((found - 1.1687).abs() < 2e-4, "{found}");
    // It is unstable from Ω = 1.8201 to 2.1654.
    for (inside, outside) in [(1.822, 1.818), (2.1635, 2.1675)] {
        assert!(growth_at(0.4, 0.05, inside) > 1.0 && growth_at(0.4, 0.05, outside) < 1.0, "{inside} {outside}");
    }
}

/// T5: free undamped bounce through the dead zone keeps its energy to 1e-8 over 1000 passages, the
/// walls being located.
#[test]
fn analytic_free_bounce_keeps_its_energy() {
    let mut system = Oscillator { zeta: 0.0, mean: 0.0, omega: 1.0, forces: vec![], stiffness: vec![], gap: 1.0 };
    let mut state = [0.0, 0.8];
    let energy = |x: &[f64; 2]| 0.5 * x[1] * x[1] + 0.5 * (x[0].abs() - 1.0).max(0.0).powi(2);
    let start = energy(&state);
    let mut stepper = RungeKutta::new(2);
    // Half a period of the wall's spring and the flight of 2/0.8 between the walls: 5.64; 1000
    // periods with steps of 0.01.
    let h = 0.01;
    let (mut crossings, mut before) = (0, 1.0_f64);
    for n in 0..2_000_000_u32 {
        stepper.located(&mut system, f64::from(n) * h, h, &mut state);
        if state[1] * before < 0.0 {
            crossings += 1;
        }
        before = state[1];
        if crossings == 2000 {
            break;
        }
    }
    assert_eq!(crossings, 2000);
    assert!((energy(&state) / start - 1.0).abs() < 1e-8, "{:.2e}", energy(&state) / start - 1.0);
}
