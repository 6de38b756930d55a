//! What the effects at gears have in common.

use gearwatch_core::bench::Bench;
use gearwatch_core::train::Train;

use super::signature::{mesh_lines, shaft_lines, sidebands};
use super::{Change, EffectError, Law, Line, Place, Signature, SpeedLaw, Values};
use crate::faults::{GearModifications, PairModifications};
use crate::setup::SimSetup;

/// One gear of the bench.
#[derive(Clone, Copy, Debug)]
pub(super) struct GearAt {
    pub(super) stage: usize,
    pub(super) wheel: bool,
}

impl GearAt {
    /// The gear that an effect sits on; `None` at any other place.
    pub(super) fn of(values: &Values) -> Option<Self> {
        match values.place() {
            Place::Gear { stage, wheel } => Some(Self { stage, wheel }),
            _ => None,
        }
    }

    pub(super) fn teeth(self, bench: &Bench) -> u32 {
        let stage = &bench.stages[self.stage];
        if self.wheel { stage.wheel.teeth } else { stage.pinion.teeth }
    }

    /// Index of its shaft.
    pub(super) fn shaft(self) -> usize {
        self.stage + usize::from(self.wheel)
    }

    pub(super) fn modifications(self, setup: &mut SimSetup) -> &mut GearModifications {
        let teeth = &mut setup.teeth[self.stage];
        if self.wheel { &mut teeth.wheel } else { &mut teeth.pinion }
    }

    /// The parameter `tooth`, checked against the gear.
    pub(super) fn tooth(self, values: &Values, bench: &Bench) -> Result<u32, EffectError> {
        let (tooth, teeth) = (values.get("tooth"), self.teeth(bench));
        if tooth.fract() != 0.0 || tooth >= f64::from(teeth) {
            return Err(values.unsuitable(format!("there is no tooth {tooth}; the gear has teeth 0 to {}", teeth - 1)));
        }
        Ok(tooth as u32)
    }

    /// Lines of something that happens once per revolution of the gear: harmonics of its shaft, and sidebands about the mesh lines.
    pub(super) fn once_per_revolution(self, bench: &Bench, harmonics: u32) -> Vec<Line> {
        let train = Train::new(bench);
        let spacing = train.shafts[self.shaft()].1;
        let mut lines = sidebands(&train, self.stage, spacing, harmonics);
        lines.extend(shaft_lines(&train, self.shaft(), 2 * harmonics));
        // One tooth of z carries 1/z of every mesh harmonic, and uneven teeth share the load unevenly.
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
    Signature {
        lines: super::signature::mesh_lines(&Train::new(bench), stage),
        change: Change::Alters,
        load,
        speed: SpeedLaw::Resonances,
    }
}

/// Force along the line of action (N) of a stage at the bench's brake torque, without losses: `F = T / r_b`.
pub(super) fn nominal_mesh_force_n(bench: &Bench, stage: usize) -> f64 {
    let ratio: f64 =
        bench.stages[stage + 1..].iter().map(|s| f64::from(s.pinion.teeth) / f64::from(s.wheel.teeth)).product();
    let spec = &bench.stages[stage];
    let base_m = spec.reference_radius_m(spec.wheel.teeth) * spec.transverse_angle_rad().cos();
    bench.brake.torque_nm * ratio / base_m
}

#[cfg(test)]
mod tests {
    use gearwatch_core::bench::EffectSpec;

    use crate::effects::{self, Place, PlaceKind};
    use crate::mesh::MeshModel;
    use crate::test_bench;

    /// Every effect at a stage or gear, with its typical values at every place it may sit, gives a gear pair that can be.
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
