//! The meshes of a bench: one of a pair, one more for each idler, two for each planet.
//!
//! # Planets
//! In the frame of the carrier the axes stand still, and every mesh is one of two gears: sun and
//! planet, planet and ring. Which of the two drives follows from torque and speed: the torque that
//! acts on the sun from outside has the sense `τ` of the driving member (the other one where the
//! carrier drives), the sun turns against the carrier with the sense `ρ` of `n_s − n_c`. Where both
//! are equal the sun drives its planets and they the ring, else the ring them and they the sun.
//!
//! # Phases
//! J. Lin, R. G. Parker, "Mesh phasing relationships in planetary and epicyclic gears", J. Mech.
//! Des. 126 (2004) 365, in mesh cycles `u` that grow with time, planet `i` at the angle `ψ_i`
//! (turns):
//!
//! ```text
//! sun     u_si = u_s − ρ z_s ψ_i
//! ring    u_ri = u_s + ρ z_r ψ_i + (s_r − s_s) − (z_p ∓ 1)/2        s: from entry to the pitch point
//! ```
//!
//! A planet's tooth meets the ring half a turn after the sun, with its other flank, half a tooth
//! earlier (−) where the sun drives, later (+) where the ring does. An idler is the same with a
//! wheel in place of the ring. With the assembled planets' `(z_s + z_r) ψ_i` whole, tooth `n` of a
//! planet at the sun is tooth `n + k_i` of the ring mesh.

use gearwatch_core::bench::{Bench, Gear, Member, Planetary, Stage};
use gearwatch_core::train::Train;
use gearwatch_core::train::planetary::{position, speeds};

use crate::faults::{GearModifications, ToothModifications};
use crate::geometry::{ADDENDUM, CLEARANCE, Cutting, GearError, GearGeometry, PairGeometry, RIM, Tip};
use crate::mesh::MeshProblem;

/// Which mesh of its stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeshKind {
    /// Gear `from` of pinion, idlers, wheel with the next one.
    Chain {
        /// From 0, the pinion.
        from: usize,
    },
    /// Sun and a planet.
    Sun {
        /// From 0.
        planet: usize,
    },
    /// Ring and a planet.
    Ring {
        /// From 0.
        planet: usize,
    },
}

/// One mesh of a bench.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MeshPlace {
    /// Position of its stage.
    pub stage: usize,
    /// Which of the stage's.
    pub kind: MeshKind,
}

/// A gear of a mesh.
#[derive(Clone, Debug)]
pub(crate) struct MeshGear<'a> {
    pub(crate) name: String,
    pub(crate) gear: &'a Gear,
    pub(crate) internal: bool,
    /// 0 for the pinion and 1 for the wheel of a pair.
    pub(crate) side: Option<usize>,
}

/// All meshes, by stage; of a planetary stage those of the sun first.
pub fn of_bench(bench: &Bench) -> Vec<MeshPlace> {
    let of_stage = |(stage, spec): (usize, &Stage)| -> Vec<MeshPlace> {
        let place = |kind| MeshPlace { stage, kind };
        match &spec.gearing.planetary {
            Some(set) => {
                let planets = 0..set.planets as usize;
                let suns = planets.clone().map(|planet| place(MeshKind::Sun { planet }));
                suns.chain(planets.map(|planet| place(MeshKind::Ring { planet }))).collect()
            }
            None => (0..=spec.gearing.idlers.len()).map(|from| place(MeshKind::Chain { from })).collect(),
        }
    };
    bench.stages.iter().enumerate().flat_map(of_stage).collect()
}

/// Senses of a planetary stage whose driving member turns counter-clockwise: `τ` of the torque on
/// the sun and `ρ` of the sun's turning against the carrier.
pub(crate) fn senses(stage: &Stage, set: &Planetary) -> [f64; 2] {
    let whole = speeds(stage.pinion.teeth, stage.wheel.teeth, set.fixed);
    let driving = whole[position(set.input)].signum();
    let torque = if set.input == Member::Carrier { -1.0 } else { 1.0 };
    [torque, (driving * (whole[0] - whole[1]).signum()) as f64]
}

/// The sun drives its planets, and they the ring.
pub(crate) fn sun_drives(stage: &Stage) -> bool {
    stage.gearing.planetary.as_ref().is_none_or(|set| {
        let [torque, turning] = senses(stage, set);
        torque == turning
    })
}

/// Static mesh force of a stage per torque on the last shaft (1/m); planets share theirs equally.
pub(crate) fn force_per_torque(bench: &Bench, train: &Train, stage: usize) -> f64 {
    let spec = &bench.stages[stage];
    let base = |teeth: u32| spec.reference_radius_m(teeth) * spec.transverse_angle_rad().cos();
    let last = train.shafts.last().map_or(1.0, |&(_, order)| order);
    let out = train.shafts[stage + 1].1;
    let Some(set) = &spec.gearing.planetary else { return last / (out * base(spec.wheel.teeth)) };
    // T_s : T_c : T_r = z_s : −(z_s + z_r) : z_r.
    let (sun, ring) = (f64::from(spec.pinion.teeth), f64::from(spec.wheel.teeth));
    let of_output = match set.output {
        Member::Sun => 1.0,
        Member::Carrier => sun / (sun + ring),
        Member::Ring => sun / ring,
    };
    last / out * of_output / (f64::from(set.planets) * base(spec.pinion.teeth))
}

/// Where the tips of a gear of a pair end whose tips are shortened by so much by the normal module.
pub(crate) fn tip(gear: &Gear, shortening: f64) -> Tip {
    gear.tip_diameter_mm.map_or(Tip::Shortened(shortening), |mm| Tip::At(0.5e-3 * mm))
}

/// Geometry of a gear with straight teeth, whether or not its teeth can be used. A bore diameter of
/// an internal gear is that around its rim.
pub(crate) fn gear_geometry(spec: &Stage, of: &MeshGear<'_>) -> Result<GearGeometry, GearError> {
    let &MeshGear { ref name, gear, internal, side } = of;
    let module_m = spec.module_mm * 1e-3;
    let (angle, width) = (spec.pressure_angle_deg.to_radians(), spec.face_width_mm * 1e-3);
    let stated = gear.bore_mm.map(|mm| mm * 0.5e-3);
    if internal {
        let reference = 0.5 * module_m * f64::from(gear.teeth);
        let outer = stated.unwrap_or(reference + (ADDENDUM + CLEARANCE + RIM) * module_m);
        return GearGeometry::internal(name, gear.teeth, module_m, angle, width, outer);
    }
    let bore = stated.unwrap_or(module_m * f64::from(gear.teeth) / 8.0);
    let mut cut = Cutting::standard(module_m, angle);
    if let Some(side) = side.filter(|_| spec.is_external_pair()) {
        let shift = spec.pair_shift()?;
        (cut.profile_shift, cut.tip) = (shift.coefficients[side], tip(gear, shift.tip_shortening));
    }
    GearGeometry::drawn(name, gear.teeth, &cut, width, bore)
}

impl MeshPlace {
    /// What it is called: that of the stage, with the planet or idler.
    pub fn name(&self, bench: &Bench) -> String {
        let stage = &bench.stages[self.stage].name;
        match self.kind {
            MeshKind::Chain { from: 0 } => stage.clone(),
            MeshKind::Chain { from } => format!("{stage}.idler_{from}"),
            MeshKind::Sun { planet } => format!("{stage}.sun_planet_{}", planet + 1),
            MeshKind::Ring { planet } => format!("{stage}.ring_planet_{}", planet + 1),
        }
    }

    /// Driving and driven gear.
    pub(crate) fn gears<'a>(&self, bench: &'a Bench) -> [MeshGear<'a>; 2] {
        let spec = &bench.stages[self.stage];
        let gear =
            |name: &str, gear: &'a Gear, internal: bool| MeshGear { name: name.to_owned(), gear, internal, side: None };
        match self.kind {
            MeshKind::Chain { from } => {
                let idlers = &spec.gearing.idlers;
                let at = |i: usize| match i {
                    0 => MeshGear { side: Some(0), ..gear("pinion", &spec.pinion, false) },
                    i if i <= idlers.len() => gear(&format!("idlers[{}]", i - 1), &idlers[i - 1], false),
                    _ => MeshGear { side: Some(1), ..gear("wheel", &spec.wheel, spec.gearing.internal) },
                };
                [at(from), at(from + 1)]
            }
            MeshKind::Sun { .. } | MeshKind::Ring { .. } => {
                // A planetary stage has planets.
                let planet = spec.gearing.planetary.as_ref().map_or(&spec.pinion, |set| &set.planet);
                let planet = gear("planet", planet, false);
                let central = match self.kind {
                    MeshKind::Sun { .. } => gear("sun", &spec.pinion, false),
                    _ => gear("ring", &spec.wheel, true),
                };
                let central_drives = sun_drives(spec) == matches!(self.kind, MeshKind::Sun { .. });
                if central_drives { [central, planet] } else { [planet, central] }
            }
        }
    }

    /// Geometry of both gears.
    pub(crate) fn geometry(&self, bench: &Bench) -> Result<(GearGeometry, GearGeometry), GearError> {
        let geometry = |of: MeshGear<'_>| gear_geometry(&bench.stages[self.stage], &of)?.usable(&of.name);
        let [first, second] = self.gears(bench);
        Ok((geometry(first)?, geometry(second)?))
    }

    /// What is wrong with the teeth of both gears, `between` being what is wrong with the stage's
    /// gears in the middle, `teeth` with pinion (sun), wheel (ring) and all meshes of the stage,
    /// `phase` that of the mesh.
    pub(crate) fn teeth(
        &self,
        (spec, between): (&Stage, &Between),
        mut teeth: ToothModifications,
        phase: &Phase,
    ) -> ToothModifications {
        match self.kind {
            MeshKind::Chain { from } => {
                if from > 0 {
                    let gear = &between.gears[from - 1].second;
                    let count = spec.gearing.idlers[from - 1].teeth;
                    teeth.pinion = gear.turned(phase.shift, phase.turned_cycles, 0.0, count);
                }
                if let Some(idler) = between.gears.get(from) {
                    teeth.wheel = idler.first.clone();
                }
            }
            MeshKind::Sun { planet } | MeshKind::Ring { planet } => {
                let Some(set) = &spec.gearing.planetary else { return teeth };
                let at_sun = matches!(self.kind, MeshKind::Sun { .. });
                let drives = sun_drives(spec);
                let flanks = &between.gears[planet];
                let of_planet = if at_sun {
                    flanks.first.clone()
                } else {
                    let half_turn = if drives { 0.0 } else { std::f64::consts::PI };
                    flanks.second.turned(phase.shift, phase.turned_cycles, half_turn, set.planet.teeth)
                };
                let central = if at_sun { teeth.pinion } else { teeth.wheel };
                (teeth.pinion, teeth.wheel) =
                    if at_sun == drives { (central, of_planet) } else { (of_planet, central) };
                teeth.pair.offset_m += between.offset_m(spec, set, planet, at_sun);
            }
        }
        teeth
    }
}

/// Where a mesh stands at the start, and how its first gear's teeth are counted.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Phase {
    /// (cycles).
    pub(crate) cycles: f64,
    /// Tooth `n` of a planet or idler at its first mesh is tooth `n + shift` here.
    pub(crate) shift: i64,
    /// By which this mesh is ahead of the gear's first one, `shift` included (cycles).
    pub(crate) turned_cycles: f64,
}

/// Phases of all meshes of a stage, the first one at `cycles`.
pub(crate) fn phases(bench: &Bench, stage: usize, cycles: f64) -> Result<Vec<Phase>, MeshProblem> {
    let places: Vec<MeshPlace> = of_bench(bench).into_iter().filter(|place| place.stage == stage).collect();
    let spec = &bench.stages[stage];
    let pitch = |place: &MeshPlace| -> Result<f64, MeshProblem> {
        let (first, second) = place.geometry(bench)?;
        Ok(PairGeometry::new(first, second, 0.0)?.pitch_phase())
    };
    let first = Phase { cycles, ..Phase::default() };
    let Some(set) = &spec.gearing.planetary else {
        let mut out = vec![first];
        for pair in places.windows(2) {
            let idler = f64::from(pair[1].gears(bench)[0].gear.teeth);
            let ahead = pitch(&pair[1])? - pitch(&pair[0])? - 0.5 * (idler - 1.0);
            let before = out.last().map_or(cycles, |phase| phase.cycles);
            out.push(Phase { cycles: before + ahead, shift: 0, turned_cycles: ahead });
        }
        return Ok(out);
    };
    let [torque, turning] = senses(spec, set);
    let later = if torque == turning { -1.0 } else { 1.0 };
    let (sun, ring, planet) = (f64::from(spec.pinion.teeth), f64::from(spec.wheel.teeth), f64::from(set.planet.teeth));
    let planets = set.planets as usize;
    let ahead = pitch(&places[planets])? - pitch(&places[0])? - 0.5 * (planet + later);
    let positions = set.positions_turns();
    let at_sun = positions.iter().map(|turns| Phase { cycles: cycles - turning * sun * turns, ..first });
    let at_ring = positions.iter().map(|turns| {
        let shift = (turning * (sun + ring) * turns).round();
        // The planet's own position within the reach that the bench file allows moves the ring's
        // phase, as it does the sun's.
        let cycles = cycles + turning * ring * turns + ahead;
        Phase { cycles, shift: shift as i64, turned_cycles: ahead + shift }
    });
    Ok(at_sun.chain(at_ring).collect())
}

/// What is wrong with one gear between pinion and wheel, or sun and ring: each of its two flanks
/// meets another gear.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MiddleGear {
    /// Teeth towards pinion or sun.
    pub first: GearModifications,
    /// Teeth towards wheel or ring.
    pub second: GearModifications,
    /// By which a planet's pin is out of its place along the circle of the pins, in the sense in
    /// which the sun is driven (m).
    pub position_m: f64,
}

/// What is wrong between pinion and wheel of a stage.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Between {
    /// Planets or idlers.
    pub gears: Vec<MiddleGear>,
    /// Of the middle of all pins from the carrier's axis, in x and y of the carrier's frame (m).
    pub carrier_off_centre_m: [f64; 2],
}

impl Between {
    /// Nothing is wrong.
    pub fn of_stage(stage: &Stage) -> Self {
        let planets = stage.gearing.planetary.as_ref().map_or(0, |set| set.planets as usize);
        let count = planets + stage.gearing.idlers.len();
        Self { gears: vec![MiddleGear::default(); count], ..Self::default() }
    }

    /// By how much the flanks of a planet stand back at the sun or the ring because its pin is not
    /// where it belongs (m).
    ///
    /// A pin that is ahead by e withdraws its planet from both meshes by `e cos α`; one that is
    /// further out withdraws it from the sun by `sin α` of that and presses it into the ring.
    fn offset_m(&self, stage: &Stage, set: &Planetary, planet: usize, at_sun: bool) -> f64 {
        let [torque, _] = senses(stage, set);
        let psi = std::f64::consts::TAU * set.positions_turns()[planet];
        let [x, y] = self.carrier_off_centre_m;
        let (sin, cos) = psi.sin_cos();
        let radial = x * cos + y * sin;
        let ahead = torque * (y * cos - x * sin) + self.gears[planet].position_m;
        let (sin, cos) = stage.transverse_angle_rad().sin_cos();
        ahead * cos + if at_sun { radial * sin } else { -radial * sin }
    }
}
