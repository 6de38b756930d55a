//! Effects that recordings of vibration cannot tell apart, on physical grounds (PHYSICS 5.2).

/// One damaged tooth; a mode on the way to the sensor; material that is missing from the flanks.
const CLASSES: &[&[&str]] = &[
    &["tooth_breakage", "root_crack", "pitting"],
    &["sensor_mounting", "structural_resonance"],
    &["tip_relief", "tooth_wear"],
];

/// Whether two effects are the same, or of one class.
pub fn together(a: &str, b: &str) -> bool {
    a == b || CLASSES.iter().any(|class| class.contains(&a) && class.contains(&b))
}
