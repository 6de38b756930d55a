//! Lines of the shipped train of that kind over the torque, and what of them fits the recordings.
//!
//! Two numbers are common to all lines: the torque at the brake that 100 % stands for, and what
//! bearings and seals take at 0 %. With fitted profile errors each line has two more, size and
//! phase of the transmission error of its own harmonic:
//! `A(T) = A₀(T) + e (cos φ B₁(T) + sin φ B₂(T))`, the first order of the response to a profile
//! error, which is exact but for products with the stiffness of the same tooth pair.

use gearwatch_core::bench::{Bench, EffectSpec, Sensor};
use gearwatch_sim::effects;
use gearwatch_sim::setup::SimSetup;
use gearwatch_sim::steady::{SteadyOptions, SteadySolver};

use super::mean;
use super::measured::{LINES, LOADS, Measured};

/// Torques at which the train is solved (N m): below, the teeth part.
const TORQUES: usize = 14;
const LOWEST_NM: f64 = 2.0;
const HIGHEST_NM: f64 = 90.0;
/// Profile error with which the response is read (µm).
const STEP_UM: f64 = 0.2;
/// Sizes (µm) and phases tried of a profile error.
const SIZES_UM: [f64; 9] = [0.0, 0.3, 0.6, 1.0, 1.6, 2.5, 4.0, 6.0, 9.0];
const PHASES: usize = 16;

type Amplitude = (f64, f64);

/// The train's lines over the torque.
pub struct Sheet {
    /// ln of the torques (N m).
    ln_torque: Vec<f64>,
    /// By line and torque: amplitude, and its change per µm of a profile error of phase 0 and 90
    /// degrees.
    lines: Vec<Vec<[Amplitude; 3]>>,
}

fn bench() -> Bench {
    let mut bench = gearwatch_sim::shipped::bench("spectraquest-like").expect("a shipped bench");
    // The paths are free gains: bearing forces are what is left to model.
    bench.housing_modes.clear();
    bench.effects.clear();
    bench.sensors = ["input", "output"]
        .map(|shaft| Sensor {
            name: format!("acc_{shaft}"),
            shaft: shaft.into(),
            direction_deg: 90.0,
            unit: "m/s^2".into(),
        })
        .to_vec();
    bench
}

impl Sheet {
    pub fn new(m: &Measured) -> Self {
        let bench = bench();
        let motor_hz = mean(m.speed_hz.iter().copied());
        let orders: Vec<f64> = LINES.iter().map(|(stage, h, _)| [32.0, 19.2][*stage] * *h as f64).collect();
        let mut solver = SteadySolver::new(SteadyOptions::default());
        let mut said = String::new();
        let mut solve = |error: Option<(usize, usize, f64)>, torque: f64| -> Option<Vec<Amplitude>> {
            let mut setup = SimSetup::nominal(&bench);
            if let Some((stage, harmonic, phase)) = error {
                let parameters = [(format!("e{harmonic}_um"), STEP_UM), (format!("phase{harmonic}_deg"), phase)];
                let place = bench.stages[stage].name.clone();
                let spec = EffectSpec { effect: "profile_error".into(), place, parameters: parameters.into() };
                effects::apply(&spec, &mut setup).expect("a profile error");
            }
            let solved = solver.solve(&setup, motor_hz, torque, 1, &orders);
            let solved = solved.inspect_err(|e| said = e.to_string()).ok()?;
            // Each stage at the bearing of its own shaft.
            let of = |(k, line): (usize, &(usize, usize, &str))| {
                let a = solved.sensors[line.0][k];
                (a.re, a.im)
            };
            Some(LINES.iter().enumerate().map(of).collect())
        };
        let mut out = Self { ln_torque: Vec::new(), lines: vec![Vec::new(); LINES.len()] };
        for n in 0..TORQUES {
            let share = n as f64 / (TORQUES - 1) as f64;
            let ln = LOWEST_NM.ln() + share * (HIGHEST_NM / LOWEST_NM).ln();
            let Some(base) = solve(None, ln.exp()) else { continue };
            let mut all: Vec<[Amplitude; 3]> = Vec::new();
            for (k, (stage, harmonic, _)) in LINES.iter().enumerate() {
                let mut response = [base[k]; 3];
                for (slot, phase) in response[1..].iter_mut().zip([0.0, 90.0]) {
                    let Some(with) = solve(Some((*stage, *harmonic, phase)), ln.exp()) else { break };
                    *slot = ((with[k].0 - base[k].0) / STEP_UM, (with[k].1 - base[k].1) / STEP_UM);
                }
                all.push(response);
            }
            out.ln_torque.push(ln);
            out.lines.iter_mut().zip(all).for_each(|(line, value)| line.push(value));
        }
        assert!(out.ln_torque.len() > TORQUES / 2, "a steady state at {} torques only: {said}", out.ln_torque.len());
        out
    }

    /// ln amplitude of a line at a torque with a profile error (µm along and across); interpolated
    /// in ln torque.
    fn ln(&self, line: usize, torque_nm: f64, error: (f64, f64)) -> f64 {
        let last = self.ln_torque.len() - 1;
        let x = torque_nm.ln().clamp(self.ln_torque[0], self.ln_torque[last]);
        let i = self.ln_torque.partition_point(|t| *t <= x).clamp(1, last) - 1;
        let t = (x - self.ln_torque[i]) / (self.ln_torque[i + 1] - self.ln_torque[i]);
        let at = |i: usize| {
            let [a, b, c] = self.lines[line][i];
            (a.0 + error.0 * b.0 + error.1 * c.0, a.1 + error.0 * b.1 + error.1 * c.1)
        };
        let ((ar, ai), (br, bi)) = (at(i), at(i + 1));
        (ar + t * (br - ar)).hypot(ai + t * (bi - ai)).max(1e-12).ln()
    }

    /// Brake torques that the loads may stand for: what 100 % is, and what is there at 0 %.
    fn scales(&self) -> Vec<(f64, f64)> {
        let mut out = Vec::new();
        for full in [15.0_f64, 20.0, 27.0, 36.0, 48.0, 64.0, 85.0] {
            for idle in [0.04, 0.08, 0.15, 0.3] {
                let lowest = idle * full;
                if lowest.ln() >= self.ln_torque[0] {
                    out.push((full, lowest));
                }
            }
        }
        out
    }

    fn torque(load: usize, (full, idle): (f64, f64)) -> f64 {
        idle + full * f64::from(LOADS[load]) / 100.0
    }

    /// Trend of a line at all loads, with the profile error that fits the training loads best, and
    /// the misfit there.
    fn fit_line(
        &self,
        m: &Measured,
        training: &[usize],
        line: usize,
        scale: (f64, f64),
        fitted: bool,
    ) -> (Vec<f64>, f64) {
        let mut best = (Vec::new(), f64::INFINITY);
        let sizes: &[f64] = if fitted { &SIZES_UM } else { &SIZES_UM[..1] };
        for size in sizes {
            for n in 0..if *size > 0.0 { PHASES } else { 1 } {
                let phase = std::f64::consts::TAU * n as f64 / PHASES as f64;
                let error = (size * phase.cos(), size * phase.sin());
                let trend: Vec<f64> = (0..LOADS.len()).map(|l| self.ln(line, Self::torque(l, scale), error)).collect();
                let misfit: f64 = (0..m.ln.len())
                    .map(|c| {
                        let gain = mean(training.iter().map(|l| m.ln[c][line][*l] - trend[*l]));
                        training.iter().map(|l| (m.ln[c][line][*l] - trend[*l] - gain).powi(2)).sum::<f64>()
                    })
                    .sum();
                if misfit < best.1 {
                    best = (trend, misfit);
                }
            }
        }
        best
    }

    fn fit(&self, m: &Measured, training: &[usize], fitted: bool) -> (Vec<Vec<f64>>, (f64, f64)) {
        let tried = self.scales().into_iter().map(|scale| {
            let lines: Vec<_> = (0..LINES.len()).map(|line| self.fit_line(m, training, line, scale, fitted)).collect();
            let sum: f64 = lines.iter().map(|l| l.1).sum();
            (sum, lines.into_iter().map(|l| l.0).collect::<Vec<_>>(), scale)
        });
        let best = tried.min_by(|a, b| a.0.total_cmp(&b.0)).expect("a scale");
        (best.1, best.2)
    }

    /// Predicts a load from the others.
    pub fn predict(&self, m: &Measured, training: &[usize], held: usize, fitted: bool) -> Vec<Vec<f64>> {
        let (trends, _) = self.fit(m, training, fitted);
        let value = |c: usize, line: usize| {
            let trend = &trends[line];
            trend[held] + mean(training.iter().map(|l| m.ln[c][line][*l] - trend[*l]))
        };
        (0..m.ln.len()).map(|c| (0..LINES.len()).map(|line| value(c, line)).collect()).collect()
    }

    /// The trend of a line (ln, mean 0) when all loads take part.
    pub fn trend(&self, m: &Measured, line: usize) -> Vec<f64> {
        let everything: Vec<usize> = (0..LOADS.len()).collect();
        let (trends, _) = self.fit(m, &everything, true);
        let level = mean(trends[line].iter().copied());
        trends[line].iter().map(|v| v - level).collect()
    }

    /// In words.
    pub fn torques(&self, m: &Measured, training: &[usize], fitted: bool) -> String {
        let (_, (full, idle)) = self.fit(m, training, fitted);
        format!("100 % is {full} N m, {idle:.1} N m at 0 %")
    }
}
