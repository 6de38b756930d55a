//! Bench files: TOML text to [`Bench`], with errors that name file, line and what would be right.

use std::path::{Path, PathBuf};

use gearwatch_core::bench::Bench;

use crate::text::read_text;

/// Why a bench file cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum BenchFileError {
    /// The file cannot be read.
    #[error("{path}: cannot be read: {cause}")]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        cause: std::io::Error,
    },
    /// The text is not TOML, or has an unknown, missing or mistyped key.
    #[error("{path}: {message}")]
    Syntax {
        /// The file.
        path: PathBuf,
        /// What was expected and found, with line and column.
        message: String,
    },
    /// The values contradict physics or each other.
    #[error("{path}: {}", problems.join("; "))]
    Values {
        /// The file.
        path: PathBuf,
        /// One sentence each.
        problems: Vec<String>,
    },
}

/// Reads and checks a bench file.
///
/// # Errors
/// When it cannot be read, is not in the format, or its values cannot be right.
pub fn read(path: &Path) -> Result<Bench, BenchFileError> {
    let text = read_text(path).map_err(|cause| BenchFileError::Read { path: path.to_owned(), cause })?;
    parse(&text, path)
}

/// Parses and checks the text of a bench file; `path` is named in errors.
///
/// # Errors
/// As [`read`].
pub fn parse(text: &str, path: &Path) -> Result<Bench, BenchFileError> {
    let bench = Bench::from_toml(text)
        .map_err(|e| BenchFileError::Syntax { path: path.to_owned(), message: explain(text, &e) })?;
    let problems = bench.problems();
    if problems.is_empty() { Ok(bench) } else { Err(BenchFileError::Values { path: path.to_owned(), problems }) }
}

/// The text of a bench file that [`parse`] reads as the same bench. Keys that bear a default are
/// written out.
///
/// # Errors
/// When a value cannot be written as TOML.
pub fn to_toml(bench: &Bench) -> Result<String, toml::ser::Error> {
    toml::to_string_pretty(bench)
}

/// Keys by which others name another kind of gear or its geometry, and what to say of them.
const OTHER_GEARS: [(&[&str], &str); 5] = [
    (
        &["helix_deg", "helix_angle", "beta_deg", "overlap_ratio"],
        "a helical stage is kind = \"helical\" with helix_angle_deg, and hand in each gear",
    ),
    (
        &["planets", "carrier", "planetary", "planet_count"],
        "a planetary stage is kind = \"planetary\" with sun = { teeth }, planet = { teeth, count }, ring = { teeth }, and the members that are fixed, in and out",
    ),
    (
        &["addendum_modification", "profile_shift_x", "profile_shift_mm", "x_coefficient"],
        "profile shift is profile_shift in pinion and wheel, the coefficient x by the normal module, as in pinion = { teeth = 14, profile_shift = 0.5 }; profile_shifted = true says that there is some where the coefficients are not known",
    ),
    (
        &["center_distance_mm", "centre_distance", "center_distance", "axis_distance_mm"],
        "the working centre distance of pinion and wheel is centre_distance_mm in the [[stage]]",
    ),
    (
        &["tip_diameter", "outside_diameter_mm", "outer_diameter_mm", "addendum_diameter_mm"],
        "the tip diameter of a gear is tip_diameter_mm in pinion and wheel",
    ),
];

/// Line and table of an error, and the known key that is nearest to an unknown one.
fn explain(text: &str, error: &toml::de::Error) -> String {
    let message = error.message();
    let Some(span) = error.span() else { return message.to_owned() };
    let before = text.get(..span.start).unwrap_or(text);
    let line = before.matches('\n').count() + 1;
    let table = text.lines().take(line).filter(|l| l.trim_start().starts_with('[')).last();
    let place = match table {
        Some(table) => format!("line {line}, under {}", table.split('#').next().unwrap_or(table).trim()),
        None => format!("line {line}"),
    };
    let mut quoted = message.split('`').skip(1).step_by(2);
    if message.starts_with("unknown field")
        && let Some(unknown) = quoted.next()
    {
        if let Some(sentence) = OTHER_GEARS.iter().find(|(keys, _)| keys.contains(&unknown)).map(|(_, says)| says) {
            return format!("{place}: the key {unknown:?} is not supported: {sentence}");
        }
        let known: Vec<&str> = quoted.collect();
        let nearest = known.iter().map(|key| (strsim::levenshtein(unknown, key), *key)).min();
        let hint = match nearest {
            // A third of the letters, rounded up, may differ.
            Some((far, key)) if far <= unknown.len().max(key.len()).div_ceil(3) => format!("; did you mean {key:?}?"),
            _ => String::new(),
        };
        return format!("{place}: unknown key {unknown:?}{hint} (known here: {})", known.join(", "));
    }
    if message.starts_with("missing field")
        && let Some(missing) = quoted.next()
    {
        return format!("{place}: the key {missing:?} is missing");
    }
    format!("{place}: {message}")
}

#[cfg(test)]
mod kinds;

#[cfg(test)]
mod tests {
    use super::*;

    const SMALL: &str = r#"format = "gearwatch-bench/1"
name = "small"

[motor]
speed_hz = 30.0

[[shaft]]
name = "input"
[[shaft]]
name = "output"

[[stage]]
name = "stage1"
pinion = { teeth = 29 }
wheel = { teeth = 100, bore_mm = 40.0 }

[[housing_mode]]
frequency_hz = 620.0
damping_ratio = 0.03
mass_kg = 25.0
shape = { input = 0.8, output = -0.3 }

[[sensor]]
name = "acc_1"
shaft = "input"

[tacho]
shaft = "input"

[[effect]]
effect = "eccentricity"
where = "stage1.pinion"
parameters = { runout_um = 20.0 }

[[term]]
expression = "e(theta)"
place = "stage1.pinion"
parameters = { cos_1_m = 2.0e-6, "sin_2.5_m" = 1.0e-7 }
speed_exponent = 0.5

[[term]]
expression = "clearance(u)"
place = "output.bearing"
parameters = { gap_m = 1.0e-5 }
"#;

    pub(super) fn error(text: &str) -> String {
        parse(text, Path::new("b.toml")).unwrap_err().to_string()
    }

    #[test]
    fn conform_a_bench_survives_being_written() {
        let bench = parse(SMALL, Path::new("b.toml")).unwrap();
        let text = to_toml(&bench).unwrap();
        assert_eq!(parse(&text, Path::new("b.toml")).unwrap(), bench, "{text}");
    }

    #[test]
    fn conform_a_key_of_another_kind_of_gear_is_refused_with_what_is_supported() {
        for (key, says) in [
            ("beta_deg = 12.0", "kind = \"helical\" with helix_angle_deg"),
            ("planets = 3", "kind = \"planetary\" with sun"),
            ("addendum_modification = 0.3", "profile_shift in pinion and wheel"),
            ("center_distance_mm = 200.0", "centre_distance_mm in the [[stage]]"),
            ("outside_diameter_mm = 200.0", "tip_diameter_mm in pinion and wheel"),
        ] {
            let text = error(&SMALL.replace("name = \"stage1\"", &format!("name = \"stage1\"\n{key}")));
            assert!(text.contains("is not supported") && text.contains(says) && text.contains("[[stage]]"), "{text}");
        }
    }

    #[test]
    fn conform_a_term_is_checked_with_its_place() {
        for (from, to, says) in [
            ("e(theta)", "e(t)", "is not an expression; expected one of \"e(theta)\""),
            ("cos_1_m = 2.0e-6", "cos_1_m = 2.0", "cos_1_m is 2; expected -0.001 to 0.001 m"),
            ("cos_1_m = 2.0e-6", "cos_1_um = 2.0", "expected cos_N_m and sin_N_m"),
            ("place = \"stage1.pinion\"", "place = \"pinion\"", "one of stage1, stage1.pinion, stage1.wheel"),
            ("speed_exponent = 0.5", "speed_exponent = 9.0", "speed_exponent is 9; expected -4 to 4"),
            ("gap_m = 1.0e-5", "gap_rad = 1.0e-5", "the parameter gap_m (m) is missing"),
            ("output.bearing", "output", "output.bearing, output.torsion"),
        ] {
            let text = error(&SMALL.replace(from, to));
            assert!(text.contains("term ") && text.contains(says), "{text}");
        }
    }

    #[test]
    fn conform_an_unknown_key_names_line_and_nearest_key() {
        let text = error(&SMALL.replace("frequency_hz", "freqency_hz"));
        assert!(text.contains("b.toml: line 18, under [[housing_mode]]"), "{text}");
        assert!(text.contains("did you mean \"frequency_hz\"?"), "{text}");
        let text = error(&SMALL.replace("[tacho]", "[tachometer]"));
        assert!(text.contains("unknown key \"tachometer\""), "{text}");
        let text = error(&SMALL.replace("teeth = 29", "tooth = 29"));
        assert!(text.contains("line 14") && text.contains("did you mean \"teeth\"?"), "{text}");
    }

    #[test]
    fn conform_a_missing_or_mistyped_key_is_named() {
        let text = error(&SMALL.replace("speed_hz = 30.0\n", ""));
        assert!(text.contains("\"speed_hz\" is missing") && text.contains("[motor]"), "{text}");
        let text = error(&SMALL.replace("speed_hz = 30.0", "speed_hz = \"fast\""));
        assert!(text.contains("line 5") && text.contains("fast"), "{text}");
        let text = error("format = ");
        assert!(text.contains("line 1"), "{text}");
    }

    /// What asked for gigabytes, or overflowed in a worker, is refused with the key, the value and
    /// the bound; the bounds are usable.
    #[test]
    fn regress_values_beyond_all_bounds_are_told() {
        let belt = "[belt]\nratio = 1e-300\n[motor]";
        for (from, to, wanted) in [
            ("teeth = 29", "teeth = 4294967295", "pinion.teeth is 4294967295; expected 5 to 1000"),
            ("[motor]", belt, "belt.ratio is 1e-300; expected 0.01 to 100"),
            ("speed_hz = 30.0", "speed_hz = 1e9", "motor.speed_hz is 1e9; expected 0 to 1000 Hz"),
            (
                "speed_hz = 30.0",
                "speed_hz = 1785.0",
                "expected 0 to 1000 Hz; a speed in rpm is written speed_rpm = 1785",
            ),
            ("bore_mm = 40.0", "bore_mm = nan", "wheel.bore_mm is NaN"),
            ("mass_kg = 25.0", "mass_kg = 1e300", "housing_mode 1: mass_kg is 1e300"),
            ("input = 0.8", "input = inf", "shape of \"input\" is inf"),
            ("\"acc_1\"", "\"a\\u009bb\"", "has a control character"),
            ("\"small\"", "\"\"", "has 0 characters; expected 1 to 120"),
        ] {
            assert!(SMALL.contains(from), "{from}");
            let text = error(&SMALL.replacen(from, to, 1));
            assert!(text.contains(wanted), "{wanted}: {text}");
        }
        let largest =
            SMALL.replace("teeth = 29", "teeth = 1000").replace("\"small\"", &format!("{:?}", "x".repeat(120)));
        assert!(parse(&largest, Path::new("b.toml")).is_ok());
    }
}
