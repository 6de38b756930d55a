//! What the effects at gears have in common.

use gearwatch_core::bench::{Bench, Gear};
use gearwatch_core::train::Train;

use super::signature::{mesh_lines, sidebands};
use super::{Change, EffectError, Law, Line, Place, Signature, SpeedLaw, Values};
use crate::faults::{GearModifications, PairModifications};
use crate::geometry::{GearError, GearGeometry};
use crate::meshes::{self, MeshGear};
use crate::setup::SimSetup;

/// Which gear of a stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Which {
    /// Pinion or sun.
    First,
    /// Wheel or ring.
    Last,
    /// Planet or idler, from 0, and whether by its flanks towards ring or wheel.
    Middle { gear: usize, second: bool },
}

/// One gear of the bench.
#[derive(Clone, Copy, Debug)]
pub(super) struct GearAt {
    pub(super) stage: usize,
    pub(super) which: Which,
}

impl GearAt {
    /// The gear that an effect sits on; `None` at any other place.
    pub(super) fn of(values: &Values) -> Option<Self> {
        match values.place() {
            Place::Gear { stage, wheel } => Some(Self { stage, which: if wheel { Which::Last } else { Which::First } }),
            Place::Middle { stage, gear, second } => Some(Self { stage, which: Which::Middle { gear, second } }),
            _ => None,
        }
    }

    pub(super) fn gear(self, bench: &Bench) -> &Gear {
        let stage = &bench.stages[self.stage];
        match (self.which, &stage.gearing.planetary) {
            (Which::First, _) => &stage.pinion,
            (Which::Last, _) => &stage.wheel,
            (Which::Middle { .. }, Some(set)) => &set.planet,
            (Which::Middle { gear, .. }, None) => &stage.gearing.idlers[gear],
        }
    }

    pub(super) fn teeth(self, bench: &Bench) -> u32 {
        self.gear(bench).teeth
    }

    /// Teeth inside.
    fn is_internal(self, bench: &Bench) -> bool {
        let gearing = &bench.stages[self.stage].gearing;
        self.which == Which::Last && (gearing.internal || gearing.planetary.is_some())
    }

    /// Its geometry, before the teeth of an internal gear are cut back for their mate.
    pub(super) fn geometry(self, bench: &Bench) -> Result<GearGeometry, GearError> {
        let side = match self.which {
            Which::First => Some(0),
            Which::Last => Some(1),
            Which::Middle { .. } => None,
        };
        let of = MeshGear { name: "gear".to_owned(), gear: self.gear(bench), internal: self.is_internal(bench), side };
        meshes::gear_geometry(&bench.stages[self.stage], &of)
    }

    /// The flanks that the effect sits on.
    pub(super) fn modifications(self, setup: &mut SimSetup) -> &mut GearModifications {
        let teeth = &mut setup.teeth[self.stage];
        match self.which {
            Which::First => &mut teeth.pinion,
            Which::Last => &mut teeth.wheel,
            Which::Middle { gear, second } => {
                let gear = &mut setup.between[self.stage].gears[gear];
                if second { &mut gear.second } else { &mut gear.first }
            }
        }
    }

    /// Changes the whole gear: of a planet or idler the flanks on both sides of its teeth.
    pub(super) fn change_all(self, setup: &mut SimSetup, change: impl Fn(&mut GearModifications)) {
        change(self.modifications(setup));
        if let Which::Middle { gear, second } = self.which {
            change(Self { which: Which::Middle { gear, second: !second }, ..self }.modifications(setup));
        }
    }

    /// The parameter `tooth`, checked against the gear.
    pub(super) fn tooth(self, values: &Values, bench: &Bench) -> Result<u32, EffectError> {
        let (tooth, teeth) = (values.get("tooth"), self.teeth(bench));
        if tooth.fract() != 0.0 || tooth >= f64::from(teeth) {
            return Err(values.unsuitable(format!("there is no tooth {tooth}; the gear has teeth 0 to {}", teeth - 1)));
        }
        Ok(tooth as u32)
    }

    /// Turns of the gear, against its carrier where it has one, per revolution of the first shaft.
    pub(super) fn order(self, train: &Train, bench: &Bench) -> f64 {
        match self.which {
            _ if train.stages[self.stage].planetary.is_some() => {
                train.stages[self.stage].mesh_order / f64::from(self.teeth(bench))
            }
            Which::First => train.shafts[self.stage].1,
            Which::Last => train.shafts[self.stage + 1].1,
            Which::Middle { .. } => train.stages[self.stage].mesh_order / f64::from(self.teeth(bench)),
        }
    }

    /// Lines of something that happens once per revolution of the gear: harmonics of its shaft, and
    /// sidebands about the mesh lines.
    pub(super) fn once_per_revolution(self, bench: &Bench, harmonics: u32) -> Vec<Line> {
        let train = Train::new(bench);
        let spacing = self.order(&train, bench);
        let mut lines = sidebands(&train, self.stage, spacing, harmonics);
        lines.extend((1..=2 * harmonics).map(|k| Line::Order(f64::from(k) * spacing)));
        // A sensor that stands still sees all of it once more at the passing of the planets.
        if let Some(set) = &train.stages[self.stage].planetary {
            let beside = |line: &Line| match *line {
                Line::Order(order) => {
                    [-1.0, 1.0].map(|sign| Line::Order(order + sign * set.carrier_order.abs())).to_vec()
                }
                Line::Hertz(_) => Vec::new(),
            };
            let passed: Vec<Line> = lines.iter().flat_map(beside).collect();
            lines.extend(passed);
        }
        // One tooth of z carries 1/z of every mesh harmonic, and uneven teeth share the load
        // unevenly.
        lines.extend(mesh_lines(&train, self.stage));
        lines
    }
}

/// The pair that an effect sits on; `None` at any other place.
pub(super) fn pair<'a>(values: &Values, setup: &'a mut SimSetup) -> Option<&'a mut PairModifications> {
    match values.place() {
        Place::Stage(stage) => Some(&mut setup.teeth[stage].pair),
        _ => None,
    }
}

/// Signature of what changes the mesh harmonics of a stage and nothing else.
pub(super) fn mesh_harmonics(values: &Values, bench: &Bench, load: Law) -> Signature {
    let Place::Stage(stage) = values.place() else { return Signature::nothing() };
    mesh_harmonics_of(stage, bench, load)
}

/// As [`mesh_harmonics`], of a stage.
pub(super) fn mesh_harmonics_of(stage: usize, bench: &Bench, load: Law) -> Signature {
    Signature {
        lines: super::signature::mesh_lines(&Train::new(bench), stage),
        change: Change::Alters,
        load,
        speed: SpeedLaw::Resonances,
    }
}

/// Force along the line of action (N) of a mesh of a stage at the bench's brake torque, without
/// losses: `F = T / r_b`.
pub(super) fn nominal_mesh_force_n(bench: &Bench, stage: usize) -> f64 {
    bench.brake.torque_nm * meshes::force_per_torque(bench, &Train::new(bench), stage)
}

#[cfg(test)]
mod tests {
    use gearwatch_core::bench::EffectSpec;

    use crate::effects::{self, Place, PlaceKind};
    use crate::mesh::MeshModel;
    use crate::test_bench;

    /// Every effect at a stage or gear, with its typical values at every place it may sit, gives a
    /// gear pair that can be.
    #[test]
    fn conform_typical_values_suit_the_bench() {
        let mut bench = test_bench::two_stages();
        // Teeth that the typical pits and breaks fit on.
        for stage in &mut bench.stages {
            stage.face_width_mm = 30.0;
        }
        let mut seen = 0;
        for effect in effects::ALL {
            for (place, at) in Place::of(*effect, &bench) {
                if !matches!(at, Place::Stage(_) | Place::Gear { .. }) {
                    continue;
                }
                let spec = EffectSpec { effect: effect.id().into(), place: place.clone(), parameters: [].into() };
                let setup = effects::setup(&bench, &[spec]).unwrap_or_else(|error| panic!("{error}"));
                for (stage, teeth) in setup.teeth.iter().enumerate() {
                    MeshModel::new(&setup.bench, stage, &setup.mesh, teeth)
                        .unwrap_or_else(|error| panic!("{} at {place}: {error}", effect.id()));
                }
                seen += 1;
            }
        }
        // 9 effects at stages beside `damping`, 7 at gears.
        let places = |kind| Place::all(kind, &bench).len();
        assert_eq!(seen, 10 * places(PlaceKind::Stage) + 7 * places(PlaceKind::Gear));
    }
}
