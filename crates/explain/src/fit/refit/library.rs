//! What a joint refit knows of each effect: its numbers, what they usually are, and where a search
//! may start.

/// A parameter of an effect, fitted as its logarithm.
pub struct Free {
    /// Name.
    pub name: &'static str,
    /// Usual value.
    pub usual: f64,
    /// Standard deviation of the logarithm.
    pub spread: f64,
    /// A value that nearly leaves the bench as it is.
    pub none: f64,
    /// Values from which fits start: both sides of what leaves the bench unchanged, since no fit
    /// gets from one to the other.
    pub starts: &'static [f64],
}

const fn free(name: &'static str, usual: f64, spread: f64, none: f64, starts: &'static [f64]) -> Free {
    Free { name, usual, spread, none, starts }
}

const RELIEF: &[Free] = &[
    free("depth_um", 15.0, 0.8, 1.0, &[3.0, 6.0, 10.0, 16.0, 25.0, 40.0]),
    free("length_fraction", 0.27, 0.35, 0.27, &[0.15, 0.22, 0.3, 0.4]),
];
// By Archard the recess wears less than the approach; by sliding alone both wear alike.
const WEAR: &[Free] = &[
    free("recess_ratio", 0.65, 0.4, 1.0, &[0.5, 1.0]),
    free("depth_um", 20.0, 1.0, 1.0, &[5.0, 10.0, 20.0, 40.0, 80.0]),
];
const ANGLE: &[Free] = &[free("angle_mrad", 0.6, 0.9, 0.05, &[0.15, 0.3, 0.6, 1.2, 2.5])];
const EXPONENT: &[Free] = &[free("exponent", 0.13, 0.8, 0.02, &[0.05, 0.1, 0.2, 0.35, 0.6])];
const FRICTION: &[Free] = &[free("coefficient", 0.1, 0.8, 0.005, &[0.02, 0.05, 0.1, 0.2])];
const STIFFNESS: &[Free] = &[free("factor", 1.0, 0.7, 1.0, &[0.3, 0.45, 0.6, 0.8, 1.2, 1.4, 1.7])];
const DAMPING: &[Free] = &[free("factor", 1.0, 1.0, 1.0, &[0.25, 0.4, 0.6, 1.7, 2.5, 4.0])];
const COUPLING: &[Free] = &[free("factor", 0.4, 1.0, 0.95, &[0.05, 0.3, 0.6, 1.4])];

/// The numbers of an effect that changes mesh lines by itself; `None` for others. A profile error
/// has none of these: its amplitudes and phases are numbers of their own.
pub fn fitted(effect: &str) -> Option<&'static [Free]> {
    Some(match effect {
        "tip_relief" => RELIEF,
        "tooth_wear" => WEAR,
        "misalignment" => ANGLE,
        "load_dependent_stiffness" => EXPONENT,
        "tooth_friction" => FRICTION,
        "mesh_stiffness" | "bearing_compliance" | "shaft_torsion" => STIFFNESS,
        "damping" => DAMPING,
        "body_coupling" => COUPLING,
        "profile_error" => &[],
        _ => return None,
    })
}

/// Whether the simulator's form of an effect is one of many that flanks come in.
pub fn has_open_form(effect: &str) -> bool {
    matches!(effect, "tip_relief" | "tooth_wear")
}

/// The start that nearly leaves the bench as it is (natural logarithms): an effect fits no worse
/// than none.
pub fn nearly_none(numbers: &[Free]) -> Option<Vec<f64>> {
    (!numbers.is_empty()).then(|| numbers.iter().map(|n| n.none.ln()).collect())
}

/// All combinations of starts (natural logarithms), in the order of the numbers.
pub fn starts(numbers: &[Free]) -> Vec<Vec<f64>> {
    numbers.iter().fold(vec![Vec::new()], |all, number| {
        let longer = |v: Vec<f64>| number.starts.iter().map(move |s| v.iter().copied().chain([s.ln()]).collect());
        all.into_iter().flat_map(longer).collect()
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use gearwatch_sim::effects;

    /// Every number is a parameter of its effect, and every start lies within the range that the
    /// library allows.
    #[test]
    fn conform_starts_lie_in_the_range_of_the_library() {
        let mut seen = 0;
        for effect in effects::ALL {
            for number in fitted(effect.id()).unwrap_or_default() {
                let range = effect.parameters().iter().find(|p| p.name == number.name).unwrap();
                assert!(
                    number
                        .starts
                        .iter()
                        .chain([&number.usual, &number.none])
                        .all(|s| (range.min..=range.max).contains(s)),
                    "{}: {} from {} to {}",
                    effect.id(),
                    number.name,
                    range.min,
                    range.max
                );
                seen += 1;
            }
        }
        assert_eq!(seen, 12);
    }

    #[test]
    fn analytic_starts_are_all_combinations() {
        let all = starts(RELIEF);
        assert_eq!(all.len(), 24);
        assert!((all[5][0] - 6f64.ln()).abs() < 1e-12 && (all[5][1] - 0.22f64.ln()).abs() < 1e-12);
        assert_eq!(starts(&[]), [Vec::<f64>::new()]);
    }
}
