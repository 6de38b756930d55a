//! The periodic motion of some meshes over a common period.
//!
//! The train is linear but for the meshes. With each mesh at its mean stiffness k̄ and damping in the linear part, the rest
//! `R_j = F_j(u_j(t), δ_j) − k̄_j δ_j` drives it: `δ_i = e_i − Σ_j H_ij ∗ R_j`, exact in the frequency domain. Newton's method on δ(t) at equally
//! spaced times; each of its linear systems by GMRES.

use nalgebra::{Complex, DVector};
use realfft::{ComplexToReal, RealFftPlanner, RealToComplex};
use std::sync::Arc;

use super::gmres;
use super::response::{Input, Output, Response};
use super::springs::{Motion, Springs};
use super::{SteadyError, SteadyOptions};
use crate::mesh::Pairs;
use crate::model::TrainModel;
use crate::springs::SpringSlope;

/// Most Newton steps.
const MOST_STEPS: usize = 25;
/// Angle by which no gear vibrates (rad).
const FARTHEST_RAD: f64 = 1.0;

/// What is solved: which meshes move non-linearly, and over which period.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Problem {
    /// Indices of the stages whose meshes vary.
    pub(super) active: Vec<usize>,
    /// Period (s).
    pub(super) period_s: f64,
    /// Revolutions of the first shaft in it.
    pub(super) revolutions: f64,
    /// Number of samples.
    pub(super) samples: usize,
}

/// Frequency responses of a problem's meshes on its grid of frequencies, meshes and friction as inputs.
pub(super) struct Grid {
    pub(super) problem: Problem,
    forward: Arc<dyn RealToComplex<f64>>,
    backward: Arc<dyn ComplexToReal<f64>>,
    /// Approach of active stage i to mesh input j: `approach[i * J + j][bin]`; pinion angle likewise.
    approach: Vec<Vec<Complex<f64>>>,
    angle: Vec<Vec<Complex<f64>>>,
    /// Outputs of the active stages and springs, and their inputs.
    approach_rows: Vec<Output>,
    angle_rows: Vec<Output>,
    inputs: Vec<Input>,
    /// Springs that are not linear; their lines come behind the active stages.
    springs: Springs,
}

/// A force on the linear train: where it acts, and its spectrum.
type Force = (Input, Vec<Complex<f64>>);

/// Spectra of everything that acts on the linear train.
pub(super) struct Solution {
    /// Amplitudes of the forces of each input (peak; bin 0 is the mean).
    pub(super) forces: Vec<Force>,
    /// Where those of the active meshes begin.
    first_mesh: usize,
    /// What springs add to the reading of each sensor: by sensor the amplitude (peak).
    pub(super) direct: Vec<Vec<Complex<f64>>>,
    /// Approach of each active stage and deflection of each spring's line at each sample (m or rad).
    pub(super) approach: Vec<Vec<f64>>,
    /// Deviation of each active stage's pinion (rad).
    angle: Vec<Vec<f64>>,
    /// The same without any vibration.
    resting: Vec<Vec<f64>>,
    /// Products with the linear train that were needed.
    pub(super) iterations: usize,
}

impl Solution {
    /// Spectrum of what the force of a mesh has beyond its mean stiffness; `None` where the problem takes that mesh for linear.
    pub(super) fn rest_of(&self, problem: &Problem, mesh: usize) -> Option<&[Complex<f64>]> {
        let at = problem.active.iter().position(|&active| active == mesh)?;
        self.forces.get(self.first_mesh + at).map(|(_, spectrum)| spectrum.as_slice())
    }
}

/// What stands in the linear train for the meshes and springs, and its responses.
#[derive(Clone, Copy)]
pub(super) struct Linear<'a> {
    pub(super) response: &'a Response,
    /// Mean stiffness and damping of each mesh.
    pub(super) meshes: &'a [(f64, f64)],
    /// Slope of each spring.
    pub(super) slopes: &'a [SpringSlope],
}

impl Grid {
    pub(super) fn new(problem: Problem, model: &TrainModel, response: &Response) -> Self {
        let n = problem.samples;
        let mut planner = RealFftPlanner::new();
        let zero = DVector::zeros(model.coordinates());
        let rows = |row: &DVector<f64>| response.output(row, &zero, None);
        let springs = Springs::new(model, &problem.active);
        let meshes = problem.active.iter().map(|&s| &model.linear.mesh[s]);
        let approach_rows: Vec<_> = meshes.clone().chain(springs.rows(model)).map(rows).collect();
        let angle_rows: Vec<_> = problem
            .active
            .iter()
            .map(|&s| {
                let mut row = zero.clone();
                model.linear.meshes[s].angle.iter().for_each(|&(at, factor)| row[at] += factor);
                rows(&row)
            })
            .collect();
        let mut inputs: Vec<_> = meshes.map(|mesh| response.input(&-mesh)).collect();
        inputs.extend(springs.inputs(model).map(|input| response.input(input)));
        let bins = n / 2 + 1;
        let stages = problem.active.len();
        let count = inputs.len();
        let mut out = Self {
            forward: planner.plan_fft_forward(n),
            backward: planner.plan_fft_inverse(n),
            approach: vec![Vec::with_capacity(bins); count * count],
            angle: vec![Vec::with_capacity(bins); stages * count],
            approach_rows,
            angle_rows,
            inputs,
            springs,
            problem,
        };
        let mut poles = Vec::new();
        for bin in 0..bins {
            let omega = std::f64::consts::TAU * bin as f64 / out.problem.period_s;
            response.poles(omega, &mut poles);
            for (rows, table) in [(&out.approach_rows, &mut out.approach), (&out.angle_rows, &mut out.angle)] {
                for (i, row) in rows.iter().enumerate() {
                    for (j, input) in out.inputs.iter().enumerate() {
                        table[i * count + j].push(if bin == 0 {
                            Complex::new(response.constant(row, input), 0.0)
                        } else {
                            response.at_poles(row, input, &poles)
                        });
                    }
                }
            }
        }
        out
    }

    /// Spectrum of a signal, scaled to amplitudes that the inverse takes back.
    fn spectrum(&self, signal: &[f64]) -> Result<Vec<Complex<f64>>, SteadyError> {
        let mut input = signal.to_vec();
        let mut out = self.forward.make_output_vec();
        self.forward.process(&mut input, &mut out).map_err(|error| SteadyError::Internal(error.to_string()))?;
        let scale = 1.0 / signal.len() as f64;
        out.iter_mut().for_each(|z| *z *= scale);
        Ok(out)
    }

    fn signal(&self, mut spectrum: Vec<Complex<f64>>) -> Result<Vec<f64>, SteadyError> {
        let mut out = self.backward.make_output_vec();
        // A real signal has real ends of the spectrum; rounding of the products leaves a trace there.
        spectrum[0].im = 0.0;
        if let (0, Some(last)) = (self.problem.samples % 2, spectrum.last_mut()) {
            last.im = 0.0;
        }
        self.backward.process(&mut spectrum, &mut out).map_err(|error| SteadyError::Internal(error.to_string()))?;
        Ok(out)
    }

    /// Derivative of a signal by time.
    fn rate(&self, signal: &[f64]) -> Result<Vec<f64>, SteadyError> {
        let mut spectrum = self.spectrum(signal)?;
        for (bin, z) in spectrum.iter_mut().enumerate() {
            *z *= Complex::new(0.0, std::f64::consts::TAU * bin as f64 / self.problem.period_s);
        }
        self.signal(spectrum)
    }

    /// `out_i = Σ_j table_ij ∗ signals_j`.
    fn convolve(
        &self,
        table: &[Vec<Complex<f64>>],
        spectra: &[Vec<Complex<f64>>],
    ) -> Result<Vec<Vec<f64>>, SteadyError> {
        let count = spectra.len();
        (0..table.len() / count)
            .map(|i| {
                let mut sum = vec![Complex::ZERO; spectra[0].len()];
                for (j, spectrum) in spectra.iter().enumerate() {
                    for ((sum, &h), &z) in sum.iter_mut().zip(&table[i * count + j]).zip(spectrum) {
                        *sum += h * z;
                    }
                }
                self.signal(sum)
            })
            .collect()
    }

    /// The periodic motion, from `start` where a neighbouring one is known.
    pub(super) fn solve(
        &self,
        model: &TrainModel,
        Linear { response, meshes: linear, slopes }: Linear<'_>,
        options: &SteadyOptions,
        start: Option<&Solution>,
    ) -> Result<Solution, SteadyError> {
        let Problem { active, samples: n, period_s, .. } = &self.problem;
        let (n, period_s, stages, count) = (*n, *period_s, active.len(), self.inputs.len());
        // The angle of the first shaft at every sample, and what acts from outside.
        let times: Vec<f64> = (0..n).map(|k| period_s * k as f64 / n as f64).collect();
        let angles: Vec<f64> = times.iter().map(|&t| model.rotation.at(t).0).collect();
        let mut forces = self.outside_forces(model, response, &times)?;
        let (outside, outside_angle) = self.outside_motion(response, &forces)?;
        let mut resting: Vec<Vec<f64>> = active
            .iter()
            .map(|&s| {
                let force = model.brake_torque_nm(0.0) * model.force_per_torque[s];
                let contact = &model.contacts[s];
                angles.iter().map(|&a| contact.static_approach(model.phase(s, a, 0.0), force)).collect()
            })
            .collect();
        let scales = self.springs.scales(model);
        if count > stages {
            let rest = model.static_state()?;
            resting.extend(self.springs.deflections(model, &rest).map(|u| vec![u; n]));
        }
        let start = start.filter(|start| start.resting.len() == count && start.resting[0].len() == n);
        // The vibration of the neighbour about its own rest.
        let mut approach = resting.clone();
        if let Some(start) = start {
            for (i, approach) in approach.iter_mut().enumerate() {
                for (sample, approach) in approach.iter_mut().enumerate() {
                    *approach += start.approach[i][sample] - start.resting[i][sample];
                }
            }
        }
        let mut angle = start.map_or_else(|| vec![vec![0.0; n]; stages], |start| start.angle.clone());
        let mut iterations = 0;
        let mut scratch = Pairs::default();
        let mut friction_spectra: Vec<Force> = Vec::new();
        for _ in 0..MOST_STEPS {
            // Forces at the present approach.
            let mut rest = vec![vec![0.0; n]; count];
            // Derivatives by approach or deflection, and by its rate, of a channel by another.
            let mut slope: Vec<(usize, usize, Vec<f64>)> = (0..stages).map(|i| (i, i, vec![0.0; n])).collect();
            let mut rate_slope: Vec<(usize, usize, Vec<f64>)> = Vec::new();
            let mut friction: Vec<[Vec<f64>; 3]> = Vec::new();
            let mut open = None;
            let mut levers: Vec<(usize, f64, Vec<f64>)> = Vec::new();
            for (i, &stage) in active.iter().enumerate() {
                let contact = &model.contacts[stage];
                let (k_mean, _) = linear[stage];
                let rubs = contact.friction != 0.0;
                let runs_out = contact.mesh().is_eccentric();
                let mut moments: [Vec<f64>; 2] = Default::default();
                let width = (model.phase(stage, angles[1], 0.0) - model.phase(stage, angles[0], 0.0)).abs();
                let mut rubbing: [Vec<f64>; 3] = Default::default();
                for sample in 0..n {
                    let phase = model.phase(stage, angles[sample], angle[i][sample]);
                    let delta = approach[i][sample];
                    let now = contact.mean_about(phase, width, delta, &mut scratch);
                    if !now.is_driving() {
                        open = Some(model.linear.meshes[stage].place.stage);
                    }
                    rest[i][sample] = now.force_n - k_mean * delta;
                    slope[i].2[sample] = now.stiffness_n_per_m - k_mean;
                    if runs_out {
                        for (moment, lever) in moments.iter_mut().zip(contact.mesh().lever_m(phase)) {
                            moment.push(-lever * now.force_n);
                        }
                    }
                    if rubs {
                        for (signal, value) in rubbing.iter_mut().zip(now.friction) {
                            signal.push(contact.friction * value);
                        }
                    }
                }
                if rubs {
                    friction.push(rubbing);
                }
                if runs_out {
                    let geometry = &model.linear.meshes[stage];
                    for ((gear, turning), moment) in
                        [geometry.pinion, geometry.wheel].into_iter().zip(geometry.turning).zip(moments)
                    {
                        levers.extend(gear.angle.map(|at| (at, turning, moment)));
                    }
                }
            }
            if !self.springs.is_empty() {
                let rates = approach.iter().map(|motion| self.rate(motion)).collect::<Result<Vec<_>, _>>()?;
                let motion = Motion { deflection: &approach, rate: &rates };
                self.springs.forces(model, (&scales, slopes), motion, &mut rest, &mut slope, &mut rate_slope);
            }
            let mut spectra = Vec::with_capacity(count);
            for rest in &rest {
                spectra.push(self.spectrum(rest)?);
            }
            // Damping beyond what the linear part has.
            for (i, &stage) in active.iter().enumerate() {
                let extra = model.contacts[stage].damping_n_s_per_m - linear[stage].1;
                if extra != 0.0 {
                    let motion = self.spectrum(&approach[i])?;
                    for (bin, (z, d)) in spectra[i].iter_mut().zip(motion).enumerate() {
                        *z += Complex::new(0.0, extra * std::f64::consts::TAU * bin as f64 / period_s) * d;
                    }
                }
            }
            friction_spectra.clear();
            let rubbing_stages = active.iter().filter(|&&s| model.contacts[s].friction != 0.0);
            for (signals, &stage) in friction.iter().zip(rubbing_stages) {
                for (signal, vector) in signals.iter().zip(&model.friction_vectors[stage]) {
                    friction_spectra.push((response.input(vector), self.spectrum(signal)?));
                }
            }
            for (at, turning, moment) in &levers {
                let mut vector = DVector::zeros(model.coordinates());
                vector[*at] = *turning;
                friction_spectra.push((response.input(&vector), self.spectrum(moment)?));
            }
            let mut target = self.convolve(&self.approach, &spectra)?;
            let mut target_angle = self.convolve(&self.angle, &spectra)?;
            let (rubbed, rubbed_angle) = self.outside_motion(response, &friction_spectra)?;
            for (sum, parts) in
                [(&mut target, [&outside, &rubbed]), (&mut target_angle, [&outside_angle, &rubbed_angle])]
            {
                for part in parts {
                    for (sum, part) in sum.iter_mut().flatten().zip(part.iter().flatten()) {
                        *sum += part;
                    }
                }
            }
            // Residual of δ = e − H R, and Newton's step (1 + H (k − k̄)) d = −residual; H carries its sign.
            let residual: Vec<f64> = (0..count)
                .flat_map(|i| target[i].iter().zip(&approach[i]).map(|(t, a)| t - a).collect::<Vec<_>>())
                .collect();
            // The vibration about rest: a gear that runs out moves the teeth much further than that.
            let vibration: Vec<Vec<f64>> = approach
                .iter()
                .zip(&resting)
                .map(|(approach, resting)| approach.iter().zip(resting).map(|(a, r)| a - r).collect())
                .collect();
            let scale_of = |channels: std::ops::Range<usize>| {
                alternating(&vibration[channels.clone()]).max(1e-3 * alternating(&approach[channels])).max(1e-12)
            };
            let scale = scale_of(0..stages);
            let worst_of = |channels: std::ops::Range<usize>| {
                residual[channels.start * n..channels.end * n].iter().fold(0.0_f64, |w, r| w.max(r.abs()))
            };
            let worst = worst_of(0..stages);
            // Springs in torsion deflect by angles: each line is held against its own motion.
            let unsettled = (stages..count).map(|i| worst_of(i..i + 1) / scale_of(i..i + 1)).fold(0.0, f64::max);
            let angle_error = (0..stages)
                .flat_map(|i| target_angle[i].iter().zip(&angle[i]))
                .fold(0.0_f64, |w, (a, b)| w.max((a - b).abs()));
            let angle_scale = alternating(&target_angle).max(1e-9);
            // An iteration that runs away; no phase of a mesh is defined far out.
            if !target_angle.iter().flatten().all(|a| a.abs() < FARTHEST_RAD) {
                return Err(SteadyError::NoConvergence);
            }
            angle = target_angle;
            if worst.max(unsettled * scale) <= options.tolerance * scale
                && angle_error <= options.tolerance * angle_scale
            {
                if let Some(stage) = open.filter(|_| !options.parting) {
                    return Err(SteadyError::ContactLost { stage });
                }
                forces.extend(friction_spectra);
                let first_mesh = forces.len();
                let mut direct = self.springs.direct(model, &spectra[stages..]);
                direct.iter_mut().flat_map(|spectrum| spectrum.iter_mut().skip(1)).for_each(|z| *z *= 2.0);
                for (input, spectrum) in self.inputs.iter().zip(spectra) {
                    forces.push((input.clone(), spectrum));
                }
                for (_, spectrum) in &mut forces {
                    spectrum.iter_mut().skip(1).for_each(|z| *z *= 2.0);
                }
                return Ok(Solution { forces, first_mesh, direct, approach, angle, resting, iterations });
            }
            let inner = (0.1 * options.tolerance / (worst / scale).max(unsettled)).clamp(1e-6, 0.03);
            let mut broken = None;
            let solved = gmres::solve(&residual, inner, |v, out| {
                let product = (|| {
                    let mut parts = vec![vec![0.0; n]; count];
                    for (to, from, slope) in &slope {
                        let v = &v[from * n..(from + 1) * n];
                        parts[*to].iter_mut().zip(v.iter().zip(slope)).for_each(|(part, (v, k))| *part += v * k);
                    }
                    for (to, from, slope) in &rate_slope {
                        let v = self.rate(&v[from * n..(from + 1) * n])?;
                        parts[*to].iter_mut().zip(v.iter().zip(slope)).for_each(|(part, (v, c))| *part += v * c);
                    }
                    let spectra = parts.iter().map(|part| self.spectrum(part)).collect::<Result<Vec<_>, _>>()?;
                    self.convolve(&self.approach, &spectra)
                })();
                match product {
                    Ok(moved) => {
                        for (i, moved) in moved.iter().enumerate() {
                            for sample in 0..n {
                                out[i * n + sample] = v[i * n + sample] - moved[sample];
                            }
                        }
                    }
                    Err(error) => broken = Some(error),
                }
            });
            if let Some(error) = broken {
                return Err(error);
            }
            let Some((step, taken)) = solved else { return Err(SteadyError::NoConvergence) };
            iterations += taken;
            for i in 0..count {
                for sample in 0..n {
                    approach[i][sample] += step[i * n + sample];
                }
            }
        }
        Err(SteadyError::NoConvergence)
    }

    /// Spectra of the outside forces over the period.
    fn outside_forces(
        &self,
        model: &TrainModel,
        response: &Response,
        times: &[f64],
    ) -> Result<Vec<Force>, SteadyError> {
        let mut signals: Vec<Vec<f64>> = Vec::new();
        let mut values = Vec::new();
        for &t in times {
            model.external_values(t, &mut values);
            signals.resize(values.len(), Vec::new());
            for (signal, &value) in signals.iter_mut().zip(&values) {
                signal.push(value);
            }
        }
        let mut out = Vec::new();
        for (signal, vector) in signals.iter().zip(model.external_vectors()) {
            if signal.iter().any(|&value| value != 0.0) {
                out.push((response.input(vector), self.spectrum(signal)?));
            }
        }
        Ok(out)
    }

    /// Approach of the active stages and deflection of the springs, and pinion angle of the stages, that some forces bring about.
    #[expect(clippy::type_complexity, reason = "approach and angle, each by stage and sample")]
    fn outside_motion(
        &self,
        response: &Response,
        forces: &[Force],
    ) -> Result<(Vec<Vec<f64>>, Vec<Vec<f64>>), SteadyError> {
        let bins = self.problem.samples / 2 + 1;
        let mut out = [Vec::new(), Vec::new()];
        for (rows, out) in [&self.approach_rows, &self.angle_rows].into_iter().zip(&mut out) {
            for row in rows {
                let mut sum = vec![Complex::ZERO; bins];
                for (input, spectrum) in forces {
                    sum[0] += response.constant(row, input) * spectrum[0];
                    let largest = spectrum.iter().skip(1).map(|z| z.norm_sqr()).fold(0.0, f64::max);
                    for bin in 1..bins {
                        // Most outside forces have a few lines only.
                        if spectrum[bin].norm_sqr() > 1e-24 * largest {
                            let omega = std::f64::consts::TAU * bin as f64 / self.problem.period_s;
                            sum[bin] += response.at(row, input, omega) * spectrum[bin];
                        }
                    }
                }
                out.push(self.signal(sum)?);
            }
        }
        let [approach, angle] = out;
        Ok((approach, angle))
    }
}

/// Largest distance from the mean.
fn alternating(signals: &[Vec<f64>]) -> f64 {
    signals
        .iter()
        .map(|signal| {
            let mean = signal.iter().sum::<f64>() / signal.len() as f64;
            signal.iter().fold(0.0_f64, |w, x| w.max((x - mean).abs()))
        })
        .fold(0.0, f64::max)
}
