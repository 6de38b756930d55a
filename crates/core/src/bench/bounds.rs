//! Bounds of a bench: wider than any laboratory bench needs, narrow enough that no file asks for
//! gigabytes or hours.

use super::Bench;
use super::shift::MOST_SHIFT;
use crate::speed::RPM_PER_HZ;

/// Gear stages.
pub const MOST_STAGES: usize = 8;
/// Sensors, housing modes, effects and terms, each.
pub const MOST_PARTS: usize = 256;
/// Teeth of a gear: work and memory of a window grow with them.
pub const MOST_TEETH: u32 = 1000;
/// Characters of a name: it becomes part of a topic, a column and a line on the terminal.
pub const LONGEST_NAME: usize = 120;

/// What a quantity may be, both ends included.
struct Range {
    low: f64,
    high: f64,
    unit: &'static str,
}

const fn range(low: f64, high: f64, unit: &'static str) -> Range {
    Range { low, high, unit }
}

const SPEED: Range = range(0.0, 1e3, "Hz");
const BELT_RATIO: Range = range(1e-2, 1e2, "");
const BELT_LENGTH: Range = range(1.0, 1e6, "mm");
const PULLEY: Range = range(0.1, 1e5, "mm");
const SAMPLE_RATE: Range = range(1.0, 1e7, "Hz");
const TORQUE: Range = range(0.0, 1e6, "N m");
const INERTIA: Range = range(0.0, 1e6, "kg m²");
const MASS: Range = range(1e-6, 1e6, "kg");
const TORSION: Range = range(1e-3, 1e12, "N m/rad");
const TORSION_DAMPING: Range = range(0.0, 1e9, "N m s/rad");
const BEARING: Range = range(1e2, 1e13, "N/m");
const BEARING_DAMPING: Range = range(0.0, 1e9, "N s/m");
const MODULE: Range = range(0.05, 100.0, "mm");
const FACE_WIDTH: Range = range(0.1, 2000.0, "mm");
const BORE: Range = range(0.0, 1e5, "mm");
const PROFILE_SHIFT: Range = range(-MOST_SHIFT, MOST_SHIFT, "");
const TIP: Range = range(0.1, 1e5, "mm");
const CENTRES: Range = range(0.1, 1e5, "mm");
const BACKLASH: Range = range(0.0, 1e4, "µm");
const DAMPING_RATIO: Range = range(0.0, 10.0, "");
const MODE_FREQUENCY: Range = range(0.1, 1e6, "Hz");
const MODE_SHAPE: Range = range(-1e6, 1e6, "");
const YOUNGS_MODULUS: Range = range(1e6, 1e13, "Pa");
const POISSON: Range = range(0.0, 0.5, "");
const DENSITY: Range = range(1.0, 1e5, "kg/m³");
const PULSES: Range = range(1e-3, 1e6, "");
const ANGLE: Range = range(-1e4, 1e4, "degrees");

/// What lies outside of the bounds, one sentence each.
pub(super) fn problems(bench: &Bench) -> Vec<String> {
    let mut check = Check(Vec::new());
    check.counts(bench);
    check.names(bench);
    check.drive(bench);
    check.train(bench);
    check.path(bench);
    check.0
}

/// A number without a row of zeros.
fn figure(value: f64) -> String {
    if value == 0.0 || (1e-4..1e6).contains(&value.abs()) { value.to_string() } else { format!("{value:e}") }
}

struct Check(Vec<String>);

impl Check {
    fn within(&mut self, place: impl FnOnce() -> String, value: f64, range: &Range) {
        let Range { low, high, unit } = range;
        if !(value >= *low && value <= *high) {
            let text =
                format!("{} is {}; expected {} to {} {unit}", place(), figure(value), figure(*low), figure(*high));
            self.0.push(text.trim_end().to_owned());
        }
    }

    fn counts(&mut self, bench: &Bench) {
        let counts = [
            ("stage", bench.stages.len(), MOST_STAGES),
            ("shaft", bench.shafts.len(), MOST_STAGES + 1),
            ("sensor", bench.sensors.len(), MOST_PARTS),
            ("housing_mode", bench.housing_modes.len(), MOST_PARTS),
            ("effect", bench.effects.len(), MOST_PARTS),
            ("term", bench.terms.len(), MOST_PARTS),
            ("bearing", bench.bearings.len(), MOST_PARTS),
        ];
        for (what, found, most) in counts {
            if found > most {
                self.0.push(format!("there are {found} [[{what}]]; at most {most} are read"));
            }
        }
    }

    fn names(&mut self, bench: &Bench) {
        let shafts = bench.shafts.iter().map(|shaft| ("shaft", &shaft.name));
        let stages = bench.stages.iter().map(|stage| ("stage", &stage.name));
        let sensors = bench.sensors.iter().map(|sensor| ("sensor", &sensor.name));
        let bearings = bench.bearings.iter().map(|bearing| ("bearing", &bearing.name));
        for (what, name) in
            [("bench", &bench.name)].into_iter().chain(shafts).chain(stages).chain(sensors).chain(bearings)
        {
            let length = name.chars().count();
            if length == 0 || length > LONGEST_NAME {
                let start: String = name.chars().take(40).collect();
                self.0.push(format!(
                    "the name of a {what}, {start:?}, has {length} characters; expected 1 to {LONGEST_NAME}"
                ));
            } else if name.chars().any(char::is_control) {
                self.0.push(format!("the name of a {what}, {name:?}, has a control character; take it out"));
            }
        }
    }

    fn drive(&mut self, bench: &Bench) {
        self.within(|| "motor.speed_hz".into(), bench.motor.speed_hz, &SPEED);
        let rpm = bench.motor.speed_hz;
        if rpm > SPEED.high
            && rpm / RPM_PER_HZ <= SPEED.high
            && let Some(said) = self.0.last_mut()
        {
            said.push_str(&format!("; a speed in rpm is written speed_rpm = {rpm}"));
        }
        self.within(|| "motor.inertia_kg_m2".into(), bench.motor.inertia_kg_m2, &INERTIA);
        self.within(|| "motor.slip_slope_nm_s_per_rad".into(), bench.motor.slip_slope_nm_s_per_rad, &TORSION_DAMPING);
        if let Some(belt) = &bench.belt {
            self.within(|| "belt.ratio".into(), belt.ratio, &BELT_RATIO);
            self.within(|| "belt.stiffness_nm_per_rad".into(), belt.stiffness_nm_per_rad, &TORSION);
            self.within(|| "belt.damping_nm_s_per_rad".into(), belt.damping_nm_s_per_rad, &TORSION_DAMPING);
            if let Some(mm) = belt.length_mm {
                self.within(|| "belt.length_mm".into(), mm, &BELT_LENGTH);
            }
            if let Some(mm) = belt.motor_pulley_mm {
                self.within(|| "belt.motor_pulley_mm".into(), mm, &PULLEY);
            }
        }
        self.within(|| "brake.torque_nm".into(), bench.brake.torque_nm, &TORQUE);
        self.within(|| "brake.inertia_kg_m2".into(), bench.brake.inertia_kg_m2, &INERTIA);
        if let Some(tacho) = &bench.tacho {
            self.within(|| "tacho.pulses_per_rev".into(), tacho.pulses_per_rev, &PULSES);
        }
        self.within(|| "acquisition.sample_rate_hz".into(), bench.acquisition.sample_rate_hz, &SAMPLE_RATE);
    }

    fn train(&mut self, bench: &Bench) {
        for shaft in &bench.shafts {
            let place = |key: &'static str| move || format!("shaft {:?}: {key}", shaft.name);
            self.within(place("inertia_kg_m2"), shaft.inertia_kg_m2, &INERTIA);
            self.within(place("torsion_nm_per_rad"), shaft.torsion_nm_per_rad, &TORSION);
            self.within(place("torsion_damping_nm_s_per_rad"), shaft.torsion_damping_nm_s_per_rad, &TORSION_DAMPING);
            self.within(place("bearing_n_per_m"), shaft.bearing_n_per_m, &BEARING);
            if let Some(axial) = shaft.axial_n_per_m {
                self.within(place("axial_n_per_m"), axial, &BEARING);
            }
            self.within(place("bearing_damping_n_s_per_m"), shaft.bearing_damping_n_s_per_m, &BEARING_DAMPING);
        }
        for stage in &bench.stages {
            let place = |key: &'static str| move || format!("stage {:?}: {key}", stage.name);
            self.within(place("module_mm"), stage.module_mm, &MODULE);
            self.within(place("face_width_mm"), stage.face_width_mm, &FACE_WIDTH);
            self.within(place("backlash_um"), stage.backlash_um, &BACKLASH);
            self.within(place("mesh_damping_ratio"), stage.mesh_damping_ratio, &DAMPING_RATIO);
            self.within(place("line_of_centres_deg"), stage.line_of_centres_deg, &ANGLE);
            if let Some(centres) = stage.gearing.centre_distance_mm {
                self.within(place("centre_distance_mm"), centres, &CENTRES);
            }
            for (which, gear) in &stage.gears() {
                let part = |key: &'static str| move || format!("stage {:?}: {which}.{key}", stage.name);
                if gear.teeth > MOST_TEETH {
                    self.0.push(format!("{} is {}; expected 5 to {MOST_TEETH}", part("teeth")(), gear.teeth));
                }
                for (key, value, range) in [
                    ("bore_mm", gear.bore_mm, &BORE),
                    ("mass_kg", gear.mass_kg, &MASS),
                    ("inertia_kg_m2", gear.inertia_kg_m2, &INERTIA),
                    ("profile_shift", gear.profile_shift, &PROFILE_SHIFT),
                    ("tip_diameter_mm", gear.tip_diameter_mm, &TIP),
                ] {
                    if let Some(value) = value {
                        self.within(part(key), value, range);
                    }
                }
            }
        }
        let material = &bench.gear_material;
        self.within(|| "gear_material.youngs_modulus_pa".into(), material.youngs_modulus_pa, &YOUNGS_MODULUS);
        self.within(|| "gear_material.poisson_ratio".into(), material.poisson_ratio, &POISSON);
        self.within(|| "gear_material.density_kg_per_m3".into(), material.density_kg_per_m3, &DENSITY);
    }

    fn path(&mut self, bench: &Bench) {
        for (i, mode) in bench.housing_modes.iter().enumerate() {
            let place = |key: &'static str| move || format!("housing_mode {}: {key}", i + 1);
            self.within(place("frequency_hz"), mode.frequency_hz, &MODE_FREQUENCY);
            self.within(place("damping_ratio"), mode.damping_ratio, &DAMPING_RATIO);
            self.within(place("mass_kg"), mode.mass_kg, &MASS);
            for (name, value) in &mode.shape {
                self.within(|| format!("housing_mode {}: shape of {name:?}", i + 1), *value, &MODE_SHAPE);
            }
        }
        for sensor in &bench.sensors {
            self.within(|| format!("sensor {:?}: direction_deg", sensor.name), sensor.direction_deg, &ANGLE);
        }
    }
}
