//! Shafts that bend among the coordinates of the train.
//!
//! Such a shaft has the coordinates of [`crate::beam::Reduced`] in x and in y, and its gears none
//! of their own: where a gear is follows from them. Forces on the housing are those of its
//! supports.

use gearwatch_core::bench::Bench;
use gearwatch_core::train::Train;
use nalgebra::DVector;

use super::parts::gear_bodies;
use super::{BearingFrame, GearPlace, LinearTrain};
use crate::beam::{Disc, Reduced, Rotor};

/// A shaft that bends.
#[derive(Clone, Debug, PartialEq)]
pub struct BeamPlace {
    /// Coordinate of its first x; y is the next one, then follow those of the second mode.
    pub first: usize,
    /// Its matrices.
    pub reduced: Reduced,
    /// 1 where it turns counter-clockwise seen from the motor, else −1.
    pub sense: f64,
}

/// A place at which a bearing holds a shaft.
pub(crate) struct Hold {
    /// Its motion in x and y as a function of the coordinates.
    pub(crate) rows: [DVector<f64>; 2],
    /// (N/m).
    pub(crate) stiffness: f64,
    /// (N s/m).
    pub(crate) damping: f64,
}

/// The reduced shafts, in their order.
pub(super) fn reduced(bench: &Bench) -> Vec<Option<Reduced>> {
    let of_shaft = |(i, shaft): (usize, &gearwatch_core::bench::Shaft)| {
        let beam = shaft.beam.as_ref()?;
        let mut discs = Vec::new();
        let beside = [(beam.wheel_mm, i.checked_sub(1), false), (beam.pinion_mm, Some(i), true)];
        for (place, stage, drives) in beside {
            let (Some(at_mm), Some(at)) = (place, stage.filter(|&at| at < bench.stages.len())) else { continue };
            let bodies = gear_bodies(bench, at);
            let gear = if drives { bodies.first() } else { bodies.last() };
            let width = 1e-3 * bench.stages[at].face_width_mm;
            discs.extend(gear.map(|&(mass, inertia)| Disc::gear(at_mm, mass, inertia, width)));
        }
        Rotor::new(beam, beam.scales(shaft), &discs).reduced(beam.modes_to_hz, beam.damping_ratio)
    };
    bench.shafts.iter().enumerate().map(of_shaft).collect()
}

/// Coordinates of the shafts that bend.
pub(super) fn places(
    bench: &Bench,
    reduced: Vec<Option<Reduced>>,
    dof: &mut impl FnMut(String) -> usize,
) -> Vec<Option<BeamPlace>> {
    let train = Train::new(bench);
    let mut sense = 1.0;
    let mut out = Vec::with_capacity(reduced.len());
    for (i, reduced) in reduced.into_iter().enumerate() {
        let name = &bench.shafts[i].name;
        out.push(reduced.map(|reduced| {
            let mut first = None;
            for k in 1..=reduced.omegas.len() {
                let x = dof(format!("{name}.bend_{k}.x"));
                dof(format!("{name}.bend_{k}.y"));
                first.get_or_insert(x);
            }
            BeamPlace { first: first.unwrap_or(0), reduced, sense }
        }));
        if train.stages.get(i).is_some_and(|stage| stage.reverses) {
            sense = -sense;
        }
    }
    out
}

impl BeamPlace {
    /// A shape in x and y as functions of `n` coordinates.
    fn rows(&self, shape: &DVector<f64>, n: usize) -> [DVector<f64>; 2] {
        std::array::from_fn(|axis| {
            let mut row = DVector::zeros(n);
            for (k, &value) in shape.iter().enumerate() {
                row[self.first + 2 * k + axis] = value;
            }
            row
        })
    }
}

impl LinearTrain {
    /// Lateral motion of a gear in x and y as functions of the coordinates.
    pub fn lateral(&self, gear: GearPlace) -> [DVector<f64>; 2] {
        let n = self.names.len();
        let beam = self.beams.get(gear.shaft).and_then(Option::as_ref);
        match gear.seat.zip(beam) {
            Some((seat, beam)) => beam.rows(&beam.reduced.seats[seat], n),
            None => std::array::from_fn(|axis| {
                let mut row = DVector::zeros(n);
                row[gear.x + axis] = 1.0;
                row
            }),
        }
    }

    /// Where the bearings of a shaft are: at its supports, or at each of these gears.
    pub(crate) fn holds(&self, bench: &Bench, shaft: usize, gears: Vec<GearPlace>) -> Vec<Hold> {
        let spec = &bench.shafts[shaft];
        if let Some(beam) = &self.beams[shaft] {
            let supports = beam.reduced.supports.iter().zip(&beam.reduced.held);
            let of_support = |(held, shape): (&crate::beam::Held, &DVector<f64>)| Hold {
                rows: beam.rows(shape, self.names.len()),
                stiffness: held.stiffness_n_per_m,
                damping: held.damping_n_s_per_m,
            };
            return supports.map(of_support).collect();
        }
        let of_gear = |gear| Hold {
            rows: self.lateral(gear),
            stiffness: spec.bearing_n_per_m,
            damping: spec.bearing_damping_n_s_per_m,
        };
        gears.into_iter().map(of_gear).collect()
    }

    /// Puts the shafts that bend into the matrices.
    pub(super) fn add_beams(&mut self, bench: &Bench) {
        for (shaft, &(_, driving)) in self.shaft_angles.clone().iter().enumerate() {
            // A shaft that nothing holds is told as one whose inertia is no number.
            if bench.shafts[shaft].beam.is_some() && self.beams[shaft].is_none() {
                self.mass[(driving, driving)] = f64::NAN;
            }
        }
        for beam in self.beams.clone().iter().flatten() {
            let reduced = &beam.reduced;
            for (k, omega) in reduced.omegas.iter().enumerate() {
                for axis in 0..2 {
                    let at = beam.first + 2 * k + axis;
                    self.mass[(at, at)] = reduced.mass_kg;
                    self.stiffness[(at, at)] = reduced.mass_kg * omega * omega;
                    for j in 0..reduced.omegas.len() {
                        self.damping[(at, beam.first + 2 * j + axis)] = reduced.damping[(k, j)];
                    }
                }
            }
        }
    }

    /// Adds the gyroscopic moments of the shafts that bend, with the first shaft at a speed
    /// (rad/s).
    pub fn turn(&mut self, speed_rad_per_s: f64) {
        for (beam, order) in self.beams.clone().iter().zip(&self.shaft_orders) {
            let Some(beam) = beam else { continue };
            let spin = beam.sense * order * speed_rad_per_s;
            let n = beam.reduced.omegas.len();
            for (k, j) in (0..n).flat_map(|k| (0..n).map(move |j| (k, j))) {
                let moment = spin * beam.reduced.polar[(k, j)];
                self.damping[(beam.first + 2 * k, beam.first + 2 * j + 1)] += moment;
                self.damping[(beam.first + 2 * k + 1, beam.first + 2 * j)] -= moment;
            }
        }
    }

    /// What forces at the supports of a shaft that bends act on, and what forces at its gears do.
    pub(super) fn beam_frames(&self, shaft: usize) -> Option<[BearingFrame; 2]> {
        let beam = self.beams[shaft].as_ref()?;
        let n = self.names.len();
        let shared = |shapes: &[DVector<f64>]| {
            let share = 1.0 / shapes.len().max(1) as f64;
            let mut frame = BearingFrame { x: DVector::zeros(n), y: DVector::zeros(n), order: 0.0, sense: beam.sense };
            for shape in shapes {
                let [x, y] = beam.rows(shape, n);
                frame.x.axpy(share, &x, 1.0);
                frame.y.axpy(share, &y, 1.0);
            }
            frame
        };
        Some([shared(&beam.reduced.held), shared(&beam.reduced.seats)])
    }
}
