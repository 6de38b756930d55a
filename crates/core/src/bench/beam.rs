//! The geometry of a shaft that bends: what the bench file says of its sections, supports and
//! seats.
//!
//! Positions are millimetres from the end of the shaft on the motor's side. The torsion between the
//! ends of the model and the inertia follow from the sections where the file leaves them out.

use std::f64::consts::PI;

use serde::{Deserialize, Serialize};

use super::{Bench, GearMaterial, Rolling, Shaft};

/// Sections and supports of a shaft, each: they bound the work of its reduction.
pub const MOST_SECTIONS: usize = 64;
/// Two places nearer to each other than this are one (mm).
pub const NEAREST_MM: f64 = 0.01;

/// A cylindrical length of a shaft.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Section {
    /// (mm, > 0).
    pub length_mm: f64,
    /// Outer diameter (mm, > 0).
    pub diameter_mm: f64,
    /// Inner diameter (mm, ≥ 0, below the outer one).
    #[serde(default, skip_serializing_if = "is_zero")]
    pub bore_mm: f64,
}

/// A bearing under a shaft, alike in all radial directions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Support {
    /// Along the shaft (mm).
    pub at_mm: f64,
    /// Radial (N/m, > 0).
    pub stiffness_n_per_m: f64,
    /// Radial (N s/m, ≥ 0).
    #[serde(default)]
    pub damping_n_s_per_m: f64,
    /// Against tilting of the shaft's axis in it (N m/rad, ≥ 0).
    #[serde(default, skip_serializing_if = "is_zero")]
    pub tilt_nm_per_rad: f64,
    /// Name of the `[[bearing]]` that it is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bearing: Option<String>,
    /// Its rolling elements carry as Hertzian contacts, in place of the stiffness.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rolling: Option<Rolling>,
}

/// A shaft as a Timoshenko beam on its supports.
#[derive(Clone, Debug, PartialEq)]
pub struct Beam {
    /// In order from the motor's side.
    pub sections: Vec<Section>,
    /// Their stiffness and damping are as the file has them; [`Beam::scales`] says by what they
    /// have been changed since.
    pub supports: Vec<Support>,
    /// Where the wheel of the stage before sits (mm); none on the first shaft.
    pub wheel_mm: Option<f64>,
    /// Where the pinion of the next stage sits (mm); none on the last shaft.
    pub pinion_mm: Option<f64>,
    /// Of the shaft.
    pub material: GearMaterial,
    /// Bending modes up to here are kept (Hz, > 0).
    pub modes_to_hz: f64,
    /// Damping of the shaft's own deformation, as a fraction of critical (0–1).
    pub damping_ratio: f64,
}

fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

impl Section {
    /// Polar second moment of the cross-section (m⁴): `π (D⁴ − d⁴) / 32`.
    pub fn polar_m4(&self) -> f64 {
        PI / 32.0 * ((1e-3 * self.diameter_mm).powi(4) - (1e-3 * self.bore_mm).powi(4))
    }
}

impl Beam {
    /// (mm).
    pub fn length_mm(&self) -> f64 {
        self.sections.iter().map(|section| section.length_mm).sum()
    }

    /// Sum of the supports' stiffness (N/m) and damping (N s/m), as the file has them.
    pub fn sums(&self) -> (f64, f64) {
        let of = |part: fn(&Support) -> f64| self.supports.iter().map(part).sum();
        (of(|support| support.stiffness_n_per_m), of(|support| support.damping_n_s_per_m))
    }

    /// Factors on stiffness and damping of all supports: what effects and fits have made of the
    /// shaft's `bearing_n_per_m` and `bearing_damping_n_s_per_m`, which start as the sums.
    pub fn scales(&self, shaft: &Shaft) -> (f64, f64) {
        let ratio = |now: f64, sum: f64| if sum > 0.0 { now / sum } else { 1.0 };
        let (stiffness, damping) = self.sums();
        (ratio(shaft.bearing_n_per_m, stiffness), ratio(shaft.bearing_damping_n_s_per_m, damping))
    }

    /// The two places between which the shaft is twisted (mm): the wheel's seat, or the coupling at
    /// the motor's end, and the pinion's seat, or the brake at the other end.
    pub fn twisted_mm(&self) -> [f64; 2] {
        [self.wheel_mm.unwrap_or(0.0), self.pinion_mm.unwrap_or_else(|| self.length_mm())]
    }

    /// Stiffness between [`Self::twisted_mm`] (N m/rad); no finite number where it has no meaning.
    ///
    /// # Formula
    /// `1/k = Σ Δx / (G J)`, `G = E / 2(1 + ν)`.
    pub fn torsion_nm_per_rad(&self) -> f64 {
        let [a, b] = self.twisted_mm();
        let shear = self.material.youngs_modulus_pa / (2.0 * (1.0 + self.material.poisson_ratio));
        let (mut begin, mut compliance) = (0.0, 0.0);
        for section in &self.sections {
            let end = begin + section.length_mm;
            let within = (a.max(b).min(end) - a.min(b).max(begin)).max(0.0);
            compliance += 1e-3 * within / (shear * section.polar_m4());
            begin = end;
        }
        1.0 / compliance
    }

    /// Polar inertia of the sections (kg m²): `Σ ρ J L`.
    pub fn inertia_kg_m2(&self) -> f64 {
        let of = |section: &Section| section.polar_m4() * 1e-3 * section.length_mm;
        self.material.density_kg_per_m3 * self.sections.iter().map(of).sum::<f64>()
    }

    /// What is wrong with the beam of the shaft with an index, one sentence each.
    pub(super) fn problems(&self, bench: &Bench, at: usize) -> Vec<String> {
        let mut out = self.numbers(&bench.shafts[at].name);
        if out.is_empty() {
            self.supports_problems(bench, at, &mut out);
            self.seats_problems(bench, at, &mut out);
        }
        out
    }

    /// Numbers that no shaft can have.
    fn numbers(&self, name: &str) -> Vec<String> {
        let mut out = Vec::new();
        let mut expect = |ok: bool, place: String, value: f64, expected: &str| {
            if !ok {
                out.push(format!("shaft {name:?}: {place} is {value}; expected {expected}"));
            }
        };
        for (i, section) in self.sections.iter().enumerate() {
            let place = |key: &str| format!("{key} of section {}", i + 1);
            let Section { length_mm, diameter_mm, bore_mm } = *section;
            expect(length_mm > 0.0 && length_mm <= 1e5, place("length_mm"), length_mm, "above 0 and at most 100000 mm");
            let fits = diameter_mm > 0.0 && diameter_mm <= 1e5;
            expect(fits, place("diameter_mm"), diameter_mm, "above 0 and at most 100000 mm");
            let hollow = (0.0..diameter_mm).contains(&bore_mm);
            expect(!fits || hollow, place("bore_mm"), bore_mm, &format!("0 to below its diameter_mm of {diameter_mm}"));
        }
        for (i, support) in self.supports.iter().enumerate() {
            let place = |key: &str| format!("{key} of support {}", i + 1);
            let Support { stiffness_n_per_m, damping_n_s_per_m, tilt_nm_per_rad, .. } = *support;
            let stiff = (1e2..=1e13).contains(&stiffness_n_per_m);
            expect(stiff, place("stiffness_n_per_m"), stiffness_n_per_m, "100 to 1e13 N/m");
            let damped = (0.0..=1e9).contains(&damping_n_s_per_m);
            expect(damped, place("damping_n_s_per_m"), damping_n_s_per_m, "0 to 1e9 N s/m");
            let tilted = (0.0..=1e12).contains(&tilt_nm_per_rad);
            expect(tilted, place("tilt_nm_per_rad"), tilt_nm_per_rad, "0 to 1e12 N m/rad");
        }
        expect((1.0..=1e6).contains(&self.modes_to_hz), "modes_to_hz".into(), self.modes_to_hz, "1 to 1000000 Hz");
        expect((0.0..=1.0).contains(&self.damping_ratio), "damping_ratio".into(), self.damping_ratio, "0 to 1");
        let GearMaterial { youngs_modulus_pa, poisson_ratio, density_kg_per_m3 } = self.material;
        let stiff = (1e6..=1e13).contains(&youngs_modulus_pa);
        expect(stiff, "material.youngs_modulus_pa".into(), youngs_modulus_pa, "1e6 to 1e13 Pa");
        expect((0.0..=0.5).contains(&poisson_ratio), "material.poisson_ratio".into(), poisson_ratio, "0 to 0.5");
        let heavy = (1.0..=1e5).contains(&density_kg_per_m3);
        expect(heavy, "material.density_kg_per_m3".into(), density_kg_per_m3, "1 to 100000 kg/m³");
        for (what, count) in [("sections", self.sections.len()), ("supports", self.supports.len())] {
            expect(count <= MOST_SECTIONS, format!("the number of {what}"), count as f64, "at most 64");
        }
        out
    }

    /// Whether the supports hold the shaft, and are what they are called.
    fn supports_problems(&self, bench: &Bench, at: usize, out: &mut Vec<String>) {
        let name = &bench.shafts[at].name;
        for (i, support) in self.supports.iter().enumerate() {
            self.on_shaft(name, &format!("at_mm of support {}", i + 1), support.at_mm, out);
            let place = format!("shaft {name:?}: support {}", i + 1);
            out.extend(support.rolling.iter().flat_map(|rolling| rolling.problems(&place, support, &bench.bearings)));
            let Some(called) = &support.bearing else { continue };
            match bench.bearings.iter().find(|bearing| bearing.name == *called) {
                None => out.push(format!(
                    "shaft {name:?}: support {} names the bearing {called:?}, which is not a [[bearing]]",
                    i + 1
                )),
                Some(bearing) if bearing.shaft != *name => out.push(format!(
                    "shaft {name:?}: support {} names the bearing {called:?}, which sits on shaft {:?}; expected one of {name:?}",
                    i + 1,
                    bearing.shaft
                )),
                Some(_) => {}
            }
        }
        let apart = self.supports.iter().any(|a| (a.at_mm - self.supports[0].at_mm).abs() >= NEAREST_MM);
        if !apart && self.supports.iter().all(|support| support.tilt_nm_per_rad == 0.0) {
            out.push(format!(
                "shaft {name:?} has {} supports in one place and no tilt_nm_per_rad; expected two supports apart from each other, or one with \
                 a stiffness against tilting above 0 N m/rad",
                self.supports.len()
            ));
        }
    }

    /// Whether the gears of the shaft sit on it.
    fn seats_problems(&self, bench: &Bench, at: usize, out: &mut Vec<String>) {
        let name = &bench.shafts[at].name;
        let beside = [("wheel_mm", self.wheel_mm, at.checked_sub(1)), ("pinion_mm", self.pinion_mm, Some(at))];
        for (key, place, stage) in beside {
            let stage = stage.and_then(|stage| bench.stages.get(stage));
            match (place, stage) {
                (Some(mm), Some(_)) => self.on_shaft(name, key, mm, out),
                (None, Some(stage)) => out.push(format!(
                    "shaft {name:?} has sections and no {key}; expected where the gear of stage {:?} sits along it, in mm",
                    stage.name
                )),
                (Some(mm), None) => out.push(format!(
                    "shaft {name:?}: {key} is {mm}, but no stage has such a gear on it; leave the key out"
                )),
                (None, None) => {}
            }
            if let Some(stage) = stage {
                let what = match (&stage.gearing.planetary, stage.gearing.idlers.is_empty()) {
                    (Some(_), _) => "planetary",
                    (None, false) if key == "pinion_mm" => "with idlers",
                    _ => continue,
                };
                out.push(format!(
                    "shaft {name:?} has sections and is beside stage {:?}, which is {what}; expected a pair of gears: leave sections and \
                     supports out and give bearing_n_per_m",
                    stage.name
                ));
            }
        }
        let [a, b] = self.twisted_mm();
        let torsion = bench.shafts[at].torsion_nm_per_rad;
        if out.is_empty() && (a - b).abs() < NEAREST_MM && !(torsion.is_finite() && torsion > 0.0) {
            out.push(format!(
                "shaft {name:?} is twisted between {a} and {b} mm; expected two places apart from each other, or a torsion_nm_per_rad"
            ));
        }
    }

    fn on_shaft(&self, name: &str, key: &str, mm: f64, out: &mut Vec<String>) {
        let length = self.length_mm();
        if !(mm >= 0.0 && mm <= length + 1e-9) {
            out.push(format!("shaft {name:?}: {key} is {mm}; expected 0 to {length} mm, the length of its sections"));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SHEET: &str = r#"
        format = "gearwatch-bench/1"
        name = "bends"
        motor = { speed_hz = 25.0 }
        stage = [{ name = "s", pinion = { teeth = 23 }, wheel = { teeth = 57 } }]
        [[shaft]]
        name = "in"
        pinion_mm = 60.0
        sections = [{ length_mm = 50.0, diameter_mm = 20.0 }, { length_mm = 100.0, diameter_mm = 30.0, bore_mm = 10.0 }]
        supports = [{ at_mm = 10.0, stiffness_n_per_m = 1e8 }, { at_mm = 140.0, stiffness_n_per_m = 2e8, damping_n_s_per_m = 700.0 }]
        [[shaft]]
        name = "out"
    "#;

    /// What follows from the sections: torsion from the coupling to the pinion, `G J / L` of 50 mm
    /// and 10 mm one behind the other, the polar inertia, and the sums of the supports.
    #[test]
    fn analytic_torsion_and_inertia_of_sections() {
        let bench = Bench::from_toml(SHEET).expect("a bench");
        assert_eq!(bench.problems(), Vec::<String>::new());
        let shaft = &bench.shafts[0];
        let polar = [PI / 32.0 * 0.02_f64.powi(4), PI / 32.0 * (0.03_f64.powi(4) - 0.01_f64.powi(4))];
        let shear = 2.06e11 / 2.6;
        let torsion = 1.0 / (0.05 / (shear * polar[0]) + 0.01 / (shear * polar[1]));
        assert!((shaft.torsion_nm_per_rad / torsion - 1.0).abs() < 1e-12, "{}", shaft.torsion_nm_per_rad);
        let inertia = 7850.0 * (0.05 * polar[0] + 0.1 * polar[1]);
        assert!((shaft.inertia_kg_m2 / inertia - 1.0).abs() < 1e-12, "{}", shaft.inertia_kg_m2);
        assert_eq!((shaft.bearing_n_per_m, shaft.bearing_damping_n_s_per_m), (3e8, 700.0));
    }

    /// A bench that is written and read again is the same, also after its bearings were changed as
    /// effects and fits do; one without sections is written as ever.
    #[test]
    fn conform_shafts_that_bend_are_written_as_they_are_read() {
        let mut bench = Bench::from_toml(SHEET).expect("a bench");
        let text = toml::to_string(&bench).expect("text");
        assert_eq!(Bench::from_toml(&text).expect("the same"), bench);
        bench.shafts[0].bearing_n_per_m *= 0.5;
        let again = Bench::from_toml(&toml::to_string(&bench).expect("text")).expect("the same");
        assert_eq!(again.shafts[0].bearing_n_per_m, 1.5e8);
        assert_eq!(again.shafts[0].beam.as_ref().expect("sections").supports[1].stiffness_n_per_m, 1e8);
        let plain = toml::to_string(&Shaft::named("in")).expect("text");
        let keys: Vec<&str> = plain.lines().filter_map(|line| line.split(' ').next()).collect();
        let expected = [
            "name",
            "inertia_kg_m2",
            "torsion_nm_per_rad",
            "torsion_damping_nm_s_per_rad",
            "bearing_n_per_m",
            "bearing_damping_n_s_per_m",
        ];
        assert_eq!(keys, expected);
    }

    /// Every wrong number is told with its key, what was found and what is expected.
    #[test]
    fn conform_wrong_shafts_are_refused() {
        let one = "supports = [{ at_mm = 10.0, stiffness_n_per_m = 1e8 }, { at_mm = 140.0, stiffness_n_per_m = 2e8, damping_n_s_per_m = 700.0 }]";
        let cases = [
            ("pinion_mm = 60.0", "pinion_mm = 151.0", "pinion_mm is 151; expected 0 to 150 mm"),
            ("pinion_mm = 60.0", "", "no pinion_mm; expected where the gear of stage \"s\" sits"),
            ("pinion_mm = 60.0", "pinion_mm = 60.0\nwheel_mm = 5.0", "wheel_mm is 5, but no stage has such a gear"),
            (
                "bore_mm = 10.0",
                "bore_mm = 30.0",
                "bore_mm of section 2 is 30; expected 0 to below its diameter_mm of 30",
            ),
            ("length_mm = 50.0", "length_mm = -50.0", "length_mm of section 1 is -50; expected above 0"),
            ("at_mm = 140.0", "at_mm = 160.0", "at_mm of support 2 is 160; expected 0 to 150 mm"),
            ("at_mm = 140.0", "at_mm = 10.0", "2 supports in one place and no tilt_nm_per_rad"),
            ("stiffness_n_per_m = 2e8", "stiffness_n_per_m = 0.0", "stiffness_n_per_m of support 2 is 0; expected 100"),
            (
                "stiffness_n_per_m = 2e8",
                "stiffness_n_per_m = 2e8, bearing = \"b\"",
                "names the bearing \"b\", which is not",
            ),
            (
                "pinion_mm = 60.0",
                "pinion_mm = 60.0\nbearing_n_per_m = 1e8",
                "has bearing_n_per_m and supports; expected one",
            ),
            (one, "", "has sections and no supports; expected both"),
            ("name = \"out\"", "name = \"out\"\nwheel_mm = 3.0", "has wheel_mm and no sections"),
            (
                "stiffness_n_per_m = 2e8",
                "stiffness_n_per_m = 2e8, rolling = {}",
                "support 2 has rolling and no bearing; expected",
            ),
            (
                "stiffness_n_per_m = 2e8",
                "stiffness_n_per_m = 2e8, rolling = { conformity = 0.5 }",
                "rolling.conformity is 0.5; expected 0.505",
            ),
            ("pinion_mm = 60.0", "pinion_mm = 0.0", "is twisted between 0 and 0 mm"),
        ];
        for (from, to, expected) in cases {
            assert!(SHEET.contains(from), "{from}");
            let said = match Bench::from_toml(&SHEET.replace(from, to)) {
                Ok(bench) => bench.problems().join("; "),
                Err(error) => error.to_string(),
            };
            assert!(said.contains(expected), "{to}: {said}");
        }
    }
}
