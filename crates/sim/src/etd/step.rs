//! One step of all runs: the smooth ones together, the others each by itself.

use pulp::{Simd, WithSimd};

use super::cut::Open;
use super::nodes::{MOST_MESHES, Node};
use super::plan::GROUP;
use super::plan::{NODES, Plan};
use super::{Etd, Lane, node_of_state, readings};
use crate::model::Lever;
use crate::rk4::{Diverged, LARGEST_APPROACH_M};

/// `|λ| h` of the Runge–Kutta steps in free flight.
const FREE_FLIGHT: f64 = 0.5;

/// How a step of a lane went.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Step {
    Smooth,
    /// Pairs came or went.
    Kinked,
    /// To be done anew, in parts or in flight.
    Broken,
}

impl<const L: usize> Etd<L> {
    /// One step of all runs.
    ///
    /// # Errors
    /// Where a run leaves everything that makes sense.
    pub fn step(&mut self) -> Result<(), Diverged> {
        let t = self.time();
        let (middle, end) = (t + 0.5 * self.step_s, (self.steps + 1) as f64 * self.step_s);
        for l in 0..L {
            self.hold(l, middle);
        }
        let references = [middle, end].map(|time| std::array::from_fn(|l| self.plans[l].model.rotation.angle(time)));
        let went = self.arch.dispatch(AllRuns { etd: self, references });
        let stages = self.plans[0].stiffness.len();
        for (l, went) in went.into_iter().enumerate() {
            self.lanes[l].effort.steps += u64::from(went != Step::Broken);
            self.lanes[l].effort.kinked += u64::from(went == Step::Kinked);
            if went == Step::Broken {
                self.step_with_events(l, t)?;
                self.settle_passing(l, end);
                self.begin_next(l);
            }
            for stage in 0..stages {
                let approach = self.approach(l, stage);
                if approach.is_nan() || approach.abs() > LARGEST_APPROACH_M {
                    return Err(Diverged { t: end, limit_m: LARGEST_APPROACH_M });
                }
            }
        }
        self.steps += 1;
        Ok(())
    }

    /// Steps all runs as if no step were cut; the state of those that are is kept in their lanes.
    #[inline(always)]
    fn step_runs(&mut self, references: &[[f64; L]; 2]) -> [Step; L] {
        self.bank.predict(&mut self.outputs);
        let stages = self.plans[0].stiffness.len();
        let mut smooth = [false; L];
        if let Some(nodes) = &mut self.nodes {
            smooth = nodes.solve(&self.plans, &self.outputs, references);
            for (stage, values) in self.remainder.chunks_exact_mut(NODES).enumerate().take(stages) {
                values[0] = *nodes.remainder_at_start(stage);
                values[1] = nodes.remainder[stage];
                values[2] = nodes.remainder[stages + stage];
            }
        }
        let mut went = [Step::Smooth; L];
        self.smooth = smooth;
        for l in 0..L {
            if !smooth[l] {
                went[l] = self.step_alone(l, [references[0][l], references[1][l]]);
            }
        }
        if !self.plans[0].model.linear.passage.is_empty() {
            self.pass_on_all(&went);
        }
        self.read_sensors();
        self.bank.advance(&self.remainder);
        if let Some(nodes) = &mut self.nodes {
            nodes.go_on(stages, &smooth);
        }
        for l in 0..L {
            if went[l] == Step::Kinked {
                self.add_kinks(l);
            }
            if !smooth[l] && went[l] != Step::Broken {
                self.begin_next(l);
            }
        }
        went
    }

    /// What planetary stages pass on in the step of every run that is not to be done anew.
    fn pass_on_all(&mut self, went: &[Step; L]) {
        for (l, &went) in went.iter().enumerate() {
            let nodes = match (&self.nodes, went) {
                (_, Step::Broken) => continue,
                (Some(nodes), Step::Smooth) if self.smooth[l] => nodes.solved(self.plans[l].stiffness.len(), l),
                _ => self.lanes[l].solver.nodes,
            };
            self.pass_on(l, &nodes, went == Step::Kinked);
        }
    }

    /// The nodes of a step of one run by the general solver, and their remainders.
    #[inline(always)]
    fn step_alone(&mut self, l: usize, references: [f64; 2]) -> Step {
        let (plan, lane) = (&self.plans[l], &mut self.lanes[l]);
        let stages = plan.stiffness.len();
        // The pairs at the start, continued to the nodes, show where others touch: a first guess as
        // good as any.
        let mut guessed = false;
        if let Some(nodes) = &self.nodes {
            lane.start = nodes.begin(stages, l);
            guessed = nodes.hand_over(stages, l, &lane.start, &mut lane.solver);
        }
        let mut went = Step::Broken;
        if !lane.start.is_open(stages) {
            let mut same = false;
            if !guessed {
                let mut free = [[0.0; 2 * MOST_MESHES]; 2];
                for (half, free) in free.iter_mut().enumerate() {
                    for stage in 0..stages {
                        let (approach, angle) = (half * stages + stage, (2 + half) * stages + stage);
                        free[stage] = self.outputs[approach / GROUP][approach % GROUP][l];
                        free[stages + stage] = self.outputs[angle / GROUP][angle % GROUP][l];
                    }
                }
                let settled = lane.solver.solve(plan, &plan.full, &lane.start, &free, references);
                let [middle, last] = &lane.solver.nodes;
                same = settled && middle.touches_like(&lane.start, stages) && last.touches_like(&lane.start, stages);
            }
            if same {
                went = Step::Smooth;
            } else if self.nodes.is_some() && lane.solver.solve_kinked(plan, &plan.full, &lane.start, &mut lane.kinks) {
                went = Step::Kinked;
            }
        }
        if went == Step::Broken {
            self.bank.z.get(l, &mut lane.z);
        }
        for (input, values) in self.remainder.chunks_exact_mut(NODES).enumerate().take(plan.acting) {
            values[0][l] = lane.start.remainder[input];
            values[1][l] = lane.solver.nodes[0].remainder[input];
            values[2][l] = lane.solver.nodes[1].remainder[input];
        }
        match went {
            Step::Smooth => lane.start = lane.solver.nodes[1],
            Step::Kinked => lane.start = lane.solver.finish(&lane.kinks),
            Step::Broken => {}
        }
        went
    }

    /// The next step of a run begins where its lane stands.
    #[inline(always)]
    fn begin_next(&mut self, l: usize) {
        if let Some(nodes) = &mut self.nodes {
            nodes.set_begin(&self.plans[l], l, &self.lanes[l].start);
        }
    }

    /// Readings of the sensors at middle and end.
    #[inline(always)]
    fn read_sensors(&mut self) {
        let first = 4 * self.plans[0].stiffness.len();
        let sensors = self.readings[0].len();
        for half in 0..2 {
            for s in 0..sensors {
                let o = first + half * sensors + s;
                let mut reading = self.outputs[o / GROUP][o % GROUP];
                for (reading, direct) in reading.iter_mut().zip(&self.direct[half][s]) {
                    *reading += direct;
                }
                for (c, r) in self.sensor_coupling[half][s].iter().zip(&self.remainder) {
                    for l in 0..L {
                        reading[l] = c[l].mul_add(r[l], reading[l]);
                    }
                }
                self.readings[half][s] = reading;
            }
        }
    }

    /// Adds the forces that set in during the step.
    #[inline(always)]
    fn add_kinks(&mut self, l: usize) {
        let (plan, lane) = (&self.plans[l], &mut self.lanes[l]);
        for kink in lane.kinks.as_slice() {
            let c = kink.about_onset();
            plan.late.modal(plan, kink.stage, 1.0 - kink.at, c, &mut lane.ahead[1]);
            self.bank.z.add(l, &lane.ahead[1]);
            for half in 0..2 {
                let since = 0.5 * (half + 1) as f64 - kink.at;
                plan.late.sensors(kink.stage, since, &mut lane.terms);
                for (reading, terms) in self.readings[half].iter_mut().zip(&lane.terms) {
                    reading[l] += c[0] * terms[0] + c[1] * terms[1] + c[2] * terms[2];
                }
            }
        }
    }

    /// Brings the held forces of a run up to date.
    #[inline]
    fn hold(&mut self, l: usize, t: f64) {
        let (plan, lane) = (&self.plans[l], &mut self.lanes[l]);
        if plan.held_for_ever && !lane.external_values.is_empty() {
            return;
        }
        plan.model.external_values(t, &mut lane.external_values);
        if !plan.levers.is_empty() {
            let start = self.nodes.as_ref().map_or(lane.start, |nodes| nodes.begin(plan.stiffness.len(), l));
            lane.add_levers(plan, &start, t);
        }
        if lane.external_values == lane.held_values {
            return;
        }
        lane.held_values.clone_from(&lane.external_values);
        lane.forcing.re.fill(0.0);
        lane.forcing.im.fill(0.0);
        for (vector, &value) in plan.externals.iter().zip(&lane.held_values) {
            for m in 0..plan.len {
                lane.forcing.re[m] += vector.re[m] * value;
                lane.forcing.im[m] += vector.im[m] * value;
            }
        }
        self.bank.hold(l, plan, &readings(plan), &lane.forcing);
    }

    /// A step of one run that events cut, or in which a stage is out of contact. The state before
    /// is in the lane.
    fn step_with_events(&mut self, l: usize, t: f64) -> Result<(), Diverged> {
        let step_s = self.step_s;
        let (plan, lane) = (&self.plans[l], &mut self.lanes[l]);
        let housing = plan.acting..plan.inputs.len();
        lane.start.remainder[housing].copy_from_slice(&self.passing[l].housing);
        let middle = lane.cut_step(plan, t, step_s, &mut self.readings, l);
        let flown = match middle {
            Ok(()) => {
                lane.effort.cut += 1;
                false
            }
            Err(Open) => true,
        };
        if flown {
            self.bank_flight(l, t)?;
        } else {
            self.bank.z.set(l, &self.lanes[l].z);
            for s in 0..self.plans[l].sensors.len() {
                self.readings[1][s][l] = self.plans[l].sensors[s].real_dot(&self.lanes[l].z);
            }
        }
        Ok(())
    }

    /// Runge–Kutta with located events over one step. The bank still holds nothing of this step for
    /// the lane.
    fn bank_flight(&mut self, l: usize, t: f64) -> Result<(), Diverged> {
        let (plan, lane) = (&self.plans[l], &mut self.lanes[l]);
        let len = plan.len;
        lane.effort.free_flight += 1;
        plan.modes.reconstruct((0..len).map(|m| lane.z.at(m)), &mut lane.state);
        let parts = 2 * (0.5 * plan.modes.fastest() * self.step_s / FREE_FLIGHT).ceil().max(1.0) as u32;
        let h = self.step_s / f64::from(parts);
        for part in 0..parts {
            lane.scratch.located(&plan.model, t + f64::from(part) * h, h, &mut lane.state)?;
            if 2 * (part + 1) == parts {
                let modal = plan.modes.project(&lane.state);
                for (s, sensor) in plan.sensors.iter().enumerate() {
                    self.readings[0][s][l] = modal.iter().enumerate().map(|(m, z)| (sensor.at(m) * z).re).sum();
                }
            }
        }
        for (m, value) in plan.modes.project(&lane.state).into_iter().enumerate() {
            (lane.z.re[m], lane.z.im[m]) = (value.re, value.im);
        }
        lane.start = node_of_state(plan, &lane.state, t + self.step_s);
        for (s, sensor) in plan.sensors.iter().enumerate() {
            self.readings[1][s][l] = sensor.real_dot(&lane.z);
        }
        self.bank.z.set(l, &lane.z);
        Ok(())
    }
}

impl Lane {
    /// Moments about eccentric gears in the middle of a step (`t`). They are a thousandth of the
    /// mesh's own, so the force is carried on from the last two steps instead of being solved for.
    fn add_levers(&mut self, plan: &Plan, start: &Node, t: f64) {
        let reference = plan.model.rotation.angle(t);
        let mut carried = None;
        for &Lever { mesh: stage, gear, .. } in &plan.levers {
            let force = start.remainder[stage] + plan.stiffness[stage] * start.approach[stage];
            if carried != Some(stage) {
                let before = self.mesh_forces[stage].unwrap_or(force);
                self.carried[stage] = force + 0.5 * (force - before);
                self.mesh_forces[stage] = Some(force);
                carried = Some(stage);
            }
            let phase = plan.model.phase(stage, reference, start.pinion_rad[stage]);
            let lever = plan.model.contacts[stage].mesh().lever_m(phase)[gear];
            self.external_values.push(-lever * self.carried[stage]);
        }
    }
}

struct AllRuns<'a, const L: usize> {
    etd: &'a mut Etd<L>,
    references: [[f64; L]; 2],
}

impl<const L: usize> WithSimd for AllRuns<'_, L> {
    type Output = [Step; L];

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) -> [Step; L] {
        self.etd.step_runs(&self.references)
    }
}
