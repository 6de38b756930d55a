//! Profile shift and centre distance of an external pair, spur or helical: each follows from the
//! other.
//!
//! # Formula
//! ISO 21771:2007, 4.5 and 5.2 (DIN 3960 has the same), for teeth `z`, normal module `m_n`, helix
//! angle `β`:
//!
//! ```text
//! inv α_w = inv α_t + 2 tan α_n (x1 + x2)/(z1 + z2)                  free of play
//! a_w     = a_0 cos α_t / cos α_w,  a_0 = m_n (z1 + z2)/(2 cos β)
//! k       = x1 + x2 − (a_w − a_0)/m_n                                tips shortened so that the clearance c* m_n stays
//! j       = 2 a_0 cos α_t (inv α_a − inv α_w)                        play at a wider distance a, cos α_a = a_0 cos α_t / a
//! ```
//!
//! The play is along the transverse line of action; what the teeth are thinned by (`backlash_um`)
//! comes on top.

use super::stage::Stage;

/// By how much a stated distance may miss the calculated one and still be taken for it (mm): half
/// of the second decimal, to which drawings round.
pub const ROUNDING_MM: f64 = 0.005;
/// Largest profile shift of either gear, either way (by the module): no rack cuts usable teeth
/// beyond.
pub const MOST_SHIFT: f64 = 2.0;

/// Involute function `inv α = tan α − α` (radians).
pub fn involute(angle_rad: f64) -> f64 {
    angle_rad.tan() - angle_rad
}

/// Largest involute function that is inverted: that of 85°, far beyond any gear.
const MOST_INVOLUTE: f64 = 10.0;

/// The angle (rad) whose involute function has a value above 0 to 10; `None` for any other value.
pub fn inverse_involute(value: f64) -> Option<f64> {
    if !(value > 0.0 && value <= MOST_INVOLUTE) {
        return None;
    }
    // inv α ≈ α³/3 for small angles, and grows faster: Newton's steps from above fall to the root
    // without passing it.
    let mut angle = (3.0 * value).cbrt().min(1.5);
    while involute(angle) < value {
        angle = 0.5 * (angle + std::f64::consts::FRAC_PI_2);
    }
    for _ in 0..50 {
        let step = (involute(angle) - value) / angle.tan().powi(2);
        angle -= step;
        if step.abs() < 1e-15 {
            break;
        }
    }
    Some(angle)
}

/// Working pressure angle (rad) at which gears run free of play, in one section: pressure angle
/// (rad), sum of the profile shifts by the module of that section, sum of the teeth. `None` where
/// there is no such angle, the teeth being too thin.
pub fn play_free_angle_rad(pressure_angle_rad: f64, shift_sum: f64, tooth_sum: f64) -> Option<f64> {
    if shift_sum == 0.0 {
        return Some(pressure_angle_rad);
    }
    inverse_involute(involute(pressure_angle_rad) + 2.0 * pressure_angle_rad.tan() * shift_sum / tooth_sum)
}

/// Profile shift and centre distance of an external pair.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PairShift {
    /// x of pinion and wheel, by the normal module.
    pub coefficients: [f64; 2],
    /// Centre distance free of play (mm).
    pub play_free_mm: f64,
    /// Centre distance at which the pair runs (mm).
    pub centre_distance_mm: f64,
    /// Working pressure angle in the transverse section at that distance (rad).
    pub working_angle_rad: f64,
    /// Tip shortening k by the normal module, of both gears.
    pub tip_shortening: f64,
    /// The pair runs at another distance than [`Self::play_free_mm`].
    pub wider: bool,
}

/// A profile shift that no gear has, and numbers of a pair that do not go together.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ShiftError {
    /// A profile shift that no gear has.
    #[error("{gear}.profile_shift is {found}; expected -{MOST_SHIFT} to {MOST_SHIFT}")]
    Range {
        /// Pinion or wheel.
        gear: &'static str,
        /// As given.
        found: f64,
    },
    /// The base circles overlap.
    #[error(
        "centre_distance_mm is {found_mm}; involutes touch only beyond {bases_mm:.3} mm, the sum of the base radii (without profile shift it is {reference_mm:.3} mm)"
    )]
    Bases {
        /// As given (mm).
        found_mm: f64,
        /// Sum of the base radii (mm).
        bases_mm: f64,
        /// Distance without shift (mm).
        reference_mm: f64,
    },
    /// A distance that no profile shift makes.
    #[error(
        "centre_distance_mm is {found_mm}; it asks for a profile shift of {shift:.2} at {gear}, expected -{MOST_SHIFT} to {MOST_SHIFT} (without profile shift the distance is {reference_mm:.3} mm)"
    )]
    Far {
        /// As given (mm).
        found_mm: f64,
        /// What follows for that gear.
        shift: f64,
        /// Pinion or wheel.
        gear: &'static str,
        /// Distance without shift (mm).
        reference_mm: f64,
    },
    /// Teeth so thin that no distance is free of play.
    #[error(
        "profile_shift of pinion and wheel is {sum:.3} together; expected more than {least:.3} with {teeth} teeth together"
    )]
    Thin {
        /// x1 + x2.
        sum: f64,
        /// Sum at which the working pressure angle is 0.
        least: f64,
        /// z1 + z2.
        teeth: f64,
    },
    /// The teeth jam.
    #[error(
        "centre_distance_mm is {found_mm}; the teeth jam below {play_free_mm:.3} mm, which profile_shift {} and {} ask for; expected that or more, or {sum:.4} as their sum",
        shifts[0],
        shifts[1]
    )]
    Narrow {
        /// As given (mm).
        found_mm: f64,
        /// Free of play (mm).
        play_free_mm: f64,
        /// x of pinion and wheel.
        shifts: [f64; 2],
        /// x1 + x2 that the distance asks for.
        sum: f64,
    },
}

impl Stage {
    /// The file states profile shift of some gear, or says that there is some.
    pub fn is_shifted(&self) -> bool {
        self.gearing.profile_shifted || self.gears().iter().any(|(_, gear)| gear.profile_shift.unwrap_or(0.0) != 0.0)
    }

    /// The file says more of the teeth than that they are those of a standard rack at the standard
    /// distance.
    pub(super) fn has_own_teeth(&self) -> bool {
        let of_a_gear = self.gears().iter().any(|(_, gear)| gear.tip_diameter_mm.is_some());
        self.is_shifted() || of_a_gear || self.gearing.centre_distance_mm.is_some()
    }

    /// The file says that the gears are shifted, but not by how much: it states neither both
    /// coefficients nor one with the centre distance.
    pub(super) fn has_unknown_shift(&self) -> bool {
        let given = [self.pinion.profile_shift, self.wheel.profile_shift].iter().flatten().count();
        let known = given + usize::from(self.gearing.centre_distance_mm.is_some());
        self.gearing.profile_shifted && (given == 0 || known < 2)
    }

    /// One external pair without idlers: what [`Self::pair_shift`] is made for.
    pub fn is_external_pair(&self) -> bool {
        !self.gearing.internal && self.gearing.idlers.is_empty() && self.gearing.planetary.is_none()
    }

    /// Profile shift and centre distance of an external pair. A coefficient that the file leaves
    /// out is 0; where it states the centre distance, it follows from that and the other one, and
    /// both share the sum equally where none is stated.
    ///
    /// # Errors
    /// Where the numbers contradict each other.
    pub fn pair_shift(&self) -> Result<PairShift, ShiftError> {
        let tooth_sum = f64::from(self.pinion.teeth) + f64::from(self.wheel.teeth);
        let (module_mm, helix_cos) = (self.module_mm, self.helix_rad().cos());
        let angle = self.transverse_angle_rad();
        let reference_mm = 0.5 * module_mm * tooth_sum / helix_cos;
        let bases_mm = reference_mm * angle.cos();
        let stated = self.gearing.centre_distance_mm;
        if let Some(found_mm) = stated.filter(|mm| !(mm.is_finite() && *mm > bases_mm)) {
            return Err(ShiftError::Bases { found_mm, bases_mm, reference_mm });
        }
        let at = |mm: f64| (bases_mm / mm).acos();
        // By the normal module: tan α_n = tan α_t cos β.
        let slope = 2.0 * angle.tan() * helix_cos / tooth_sum;
        // A shift that the rounding of the stated distance hides is none.
        let sound = |x: f64| if (x * module_mm).abs() <= ROUNDING_MM { 0.0 } else { x };
        let sum_at = |mm: f64| sound((involute(at(mm)) - involute(angle)) / slope);
        let given = [self.pinion.profile_shift, self.wheel.profile_shift];
        let coefficients = match (given, stated) {
            ([None, None], Some(mm)) => [0.5 * sum_at(mm); 2],
            ([Some(x), None], Some(mm)) => [x, sound(sum_at(mm) - x)],
            ([None, Some(x)], Some(mm)) => [sound(sum_at(mm) - x), x],
            ([x1, x2], _) => [x1.unwrap_or(0.0), x2.unwrap_or(0.0)],
        };
        for ((gear, shift), given) in ["pinion", "wheel"].into_iter().zip(coefficients).zip(given) {
            match (given, stated) {
                _ if shift.abs() <= MOST_SHIFT => {}
                (None, Some(found_mm)) => return Err(ShiftError::Far { found_mm, shift, gear, reference_mm }),
                _ => return Err(ShiftError::Range { gear, found: shift }),
            }
        }
        let sum = coefficients[0] + coefficients[1];
        let Some(free_angle) = play_free_angle_rad(angle, sum * helix_cos, tooth_sum) else {
            return Err(ShiftError::Thin { sum, least: -involute(angle) / slope, teeth: tooth_sum });
        };
        let play_free_mm = if sum == 0.0 { reference_mm } else { bases_mm / free_angle.cos() };
        let wider = match stated {
            Some(mm) if (mm - play_free_mm).abs() > ROUNDING_MM => {
                if mm < play_free_mm {
                    return Err(ShiftError::Narrow {
                        found_mm: mm,
                        play_free_mm,
                        shifts: coefficients,
                        sum: sum_at(mm),
                    });
                }
                Some(mm)
            }
            _ => None,
        };
        Ok(PairShift {
            coefficients,
            play_free_mm,
            centre_distance_mm: wider.unwrap_or(play_free_mm),
            working_angle_rad: wider.map_or(free_angle, at),
            tip_shortening: if sum == 0.0 { 0.0 } else { sum - (play_free_mm - reference_mm) / module_mm },
            wider: wider.is_some(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::Bench;
    use super::*;

    /// A bench of 12 and 24 teeth of 3 mm with keys of the stage, of the pinion and of the wheel.
    fn bench(keys: &str, pinion: &str, wheel: &str) -> Bench {
        let text = format!(
            "format = \"gearwatch-bench/1\"\nname = \"b\"\nmotor = {{ speed_hz = 30.0 }}\nshaft = [{{ name = \"a\" }}, {{ name = \"b\" }}]\n\
             stage = [{{ name = \"s\", {keys} pinion = {{ teeth = 12{pinion} }}, wheel = {{ teeth = 24{wheel} }} }}]"
        );
        Bench::from_toml(&text).unwrap_or_else(|error| panic!("{error}\n{text}"))
    }

    fn stage(keys: &str, pinion: &str, wheel: &str) -> Stage {
        bench(keys, pinion, wheel).stages.remove(0)
    }

    /// The inverse against bisection of `tan α − α`, which needs no derivative and no start: the
    /// last digits of an angle.
    #[test]
    fn analytic_inverse_involute_is_that_of_bisection() {
        for i in 1..=156 {
            let expected = 0.0095 * f64::from(i);
            let value = involute(expected);
            let (mut low, mut high) = (0.0, std::f64::consts::FRAC_PI_2);
            for _ in 0..200 {
                let middle = 0.5 * (low + high);
                if involute(middle) < value { low = middle } else { high = middle }
            }
            let found = inverse_involute(value).unwrap();
            // Rounding of `tan α − α` at 1e-16 times 1 / tan² α: 1e-12 at the least angle.
            let tolerance = 1e-15 + 2e-16 * expected.max(expected.tan()) / expected.tan().powi(2);
            assert!((found - low).abs() < tolerance, "{found} {low}");
        }
        assert_eq!(inverse_involute(0.0), None);
        assert_eq!(inverse_involute(f64::NAN), None);
        assert_eq!(inverse_involute(1e300), None);
    }

    /// "KHK Gear Technical Reference", profile shifted spur gears, the worked example: m = 3 mm,
    /// α = 20°, 12 and 24 teeth, x = 0.6 and 0.36. It gives α_w = 26.0886°, y = 0.83329, a =
    /// 56.4999 mm and addenda of 4.420 and 3.700 mm; and from that centre distance back x1 + x2 =
    /// 0.9600.
    #[test]
    fn literature_khk_centre_distance_of_shifted_spur_gears() {
        let found = stage("", ", profile_shift = 0.6", ", profile_shift = 0.36").pair_shift().unwrap();
        let near = |found: f64, expected: f64, digit: f64| {
            assert!((found - expected).abs() < 0.5 * digit, "{found} {expected}")
        };
        near(found.working_angle_rad.to_degrees(), 26.0886, 1e-4);
        near(found.centre_distance_mm, 56.4999, 1e-4);
        near((found.centre_distance_mm - 54.0) / 3.0, 0.83329, 1e-5);
        near(3.0 * (1.0 + 0.6 - found.tip_shortening), 4.420, 1e-3);
        near(3.0 * (1.0 + 0.36 - found.tip_shortening), 3.700, 1e-3);
        let back = stage("centre_distance_mm = 56.4999,", ", profile_shift = 0.6", "").pair_shift().unwrap();
        near(back.coefficients[1], 0.36, 1e-4);
        let halves = stage("centre_distance_mm = 56.4999,", "", "").pair_shift().unwrap();
        assert_eq!(halves.coefficients[0], halves.coefficients[1]);
        near(halves.coefficients[0], 0.48, 1e-4);
    }

    /// A published calculation by ISO 21771:2007 of a helical pair: 31 and 30 teeth, m_n = 3.5 mm,
    /// a = 116.5 mm, reference distance 114.3447 mm, α_t = 21.29906°, α_wt = 23.87076°, x1 = 0.2910
    /// of x1 + x2 = 0.65188 (scribd 376176518, "Gear generating profile shift calculations").
    #[test]
    fn literature_iso_21771_sum_of_shifts_of_a_helical_pair() {
        let helix = (3.5 * 61.0 / (2.0 * 114.344_728_070_8_f64)).acos().to_degrees();
        let mut stage = stage(
            &format!("kind = \"helical\", helix_angle_deg = {helix}, module_mm = 3.5, centre_distance_mm = 116.5,"),
            "",
            "",
        );
        (stage.pinion.teeth, stage.wheel.teeth) = (31, 30);
        stage.pinion.profile_shift = Some(0.291);
        let found = stage.pair_shift().unwrap();
        assert!((stage.transverse_angle_rad().to_degrees() - 21.299_064_285_9).abs() < 1e-8);
        assert!((found.working_angle_rad.to_degrees() - 23.870_760_965_4).abs() < 1e-7);
        let sum = found.coefficients[0] + found.coefficients[1];
        assert!((sum - 0.651_877_131_2).abs() < 1e-8, "{sum}");
        assert!((found.play_free_mm - 116.5).abs() < 1e-9 && !found.wider);
    }

    /// Without shift, and with shifts that take each other away, angle and distance are the
    /// standard ones to the bit; a stated distance within its rounding is the standard one.
    #[test]
    fn analytic_no_shift_in_sum_is_the_standard_distance() {
        for stage in [
            stage("", "", ""),
            stage("", ", profile_shift = 0.3", ", profile_shift = -0.3"),
            stage("centre_distance_mm = 54.004,", "", ""),
            stage("centre_distance_mm = 53.996,", ", profile_shift = 0.3", ""),
        ] {
            let found = stage.pair_shift().unwrap();
            assert_eq!(found.centre_distance_mm, 54.0);
            assert_eq!(found.working_angle_rad, stage.transverse_angle_rad());
            assert_eq!(found.tip_shortening, 0.0);
            assert_eq!(found.coefficients[0], -found.coefficients[1]);
        }
    }

    /// Wider is play, narrower is refused, and so is what no gear can be; each with the figure that
    /// would be right.
    #[test]
    fn conform_distances_that_go_and_do_not_go_with_the_shift() {
        let shifts = (", profile_shift = 0.6", ", profile_shift = 0.36");
        let at = |mm: &str| stage(&format!("centre_distance_mm = {mm},"), shifts.0, shifts.1).pair_shift();
        let wide = at("56.6").unwrap();
        assert!(wide.wider && wide.centre_distance_mm == 56.6 && (wide.play_free_mm - 56.4999).abs() < 1e-4);
        assert!(!at("56.5").unwrap().wider);
        let said = at("56.4").unwrap_err().to_string();
        assert!(
            said.contains("is 56.4") && said.contains("jam below 56.500 mm") && said.contains("0.6 and 0.36"),
            "{said}"
        );
        let said = at("50.0").unwrap_err().to_string();
        assert!(said.contains("is 50") && said.contains("50.743 mm") && said.contains("54.000 mm"), "{said}");
        let said =
            stage("centre_distance_mm = 80.0,", ", profile_shift = 0.6", "").pair_shift().unwrap_err().to_string();
        assert!(said.contains("at wheel, expected -2 to 2"), "{said}");
        for shift in ["1e300", "-2.1", "nan", "inf"] {
            let said = stage("", &format!(", profile_shift = {shift}"), "").pair_shift().unwrap_err().to_string();
            assert!(said.contains("pinion.profile_shift is") && said.contains("expected -2 to 2"), "{said}");
        }
        let said = stage("", ", profile_shift = -0.9", "").pair_shift().unwrap_err().to_string();
        assert!(said.contains("is -0.900 together; expected more than -0.737"), "{said}");
    }
    /// What says that there is shift, but not how much, is watched and not simulated; two of both
    /// coefficients and the distance say it, a distance alone where nothing is said to be unknown.
    #[test]
    fn conform_the_simulator_asks_for_what_is_not_known() {
        let (x, distance, some) = (", profile_shift = 0.6", "centre_distance_mm = 56.5,", "profile_shifted = true,");
        for (keys, pinion, wheel, known) in [
            ("", "", "", true),
            ("", x, "", true),
            (distance, "", "", true),
            (some, "", "", false),
            (some, x, "", false),
            (some, x, ", profile_shift = 0.36", true),
            (&format!("{some} {distance}"), "", "", false),
            (&format!("{some} {distance}"), x, "", true),
        ] {
            let bench = bench(keys, pinion, wheel);
            assert_eq!(bench.problems(), Vec::<String>::new(), "{keys} {pinion} {wheel}");
            let said = bench.beyond_simulator().unwrap_or_default();
            assert_eq!(said.is_empty(), known, "{keys} {pinion} {wheel}: {said}");
            assert!(known || said.contains("expected profile_shift of both gears, or of one and centre_distance_mm"));
            assert_eq!(bench.beyond_pairs().is_none(), known);
        }
    }

    /// No number makes the check hang or panic, and none that is none passes it.
    #[test]
    fn conform_no_number_is_too_strange() {
        let strange = [f64::NAN, f64::INFINITY, -f64::INFINITY, 0.0, -1.0, 1e-300, 1e300, -2.0, 2.0, 54.0];
        let mut passed = 0;
        for module in strange {
            for x in strange {
                for centres in strange {
                    let mut bench = bench("", ", profile_shift = 0.1", "");
                    let stage = &mut bench.stages[0];
                    (stage.module_mm, stage.wheel.profile_shift) = (module, Some(x));
                    stage.gearing.centre_distance_mm = Some(centres);
                    let numbers = [module, x, centres].iter().all(|value| value.is_finite());
                    let fine = bench.problems().is_empty();
                    assert!(numbers || !fine, "{module} {x} {centres}");
                    passed += usize::from(fine);
                }
            }
        }
        // Among them a module of 2 mm at 54 mm: 36 without shift and wide.
        assert!(passed > 0);
    }
}
