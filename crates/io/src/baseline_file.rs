//! Baseline files: JSON with a checksum of its own and the hash of the bench that it belongs to.
//!
//! The file is the [`Baseline`] as a JSON object with one key more, `checksum_sha256`: SHA-256 of
//! the object without that key as compact JSON, keys in the order of the file. White space does not
//! matter, every other change is noticed.

use std::path::{Path, PathBuf};

use gearwatch_core::baseline::{Baseline, Change, FORMAT, Machine, Rebinding};
use gearwatch_core::bench::Bench;

use crate::sealed::{self, Broken, sha256_of};
use crate::text::read_text;

/// Window lengths that differ by less are the same (relative): the length of a window is a whole
/// number of samples.
const WINDOW_TOLERANCE: f64 = 1e-3;

/// Why a baseline file cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum BaselineFileError {
    /// The file cannot be read.
    #[error("{path}: cannot be read: {cause}")]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        cause: std::io::Error,
    },
    /// Not JSON, or not a baseline.
    #[error("{path}: is not a baseline ({FORMAT}): {message}")]
    Syntax {
        /// The file.
        path: PathBuf,
        /// What was expected and found, with line and column.
        message: String,
    },
    /// The content is not what was written.
    #[error(
        "{path}: the checksum is {found}, but the content has {computed}; the file was changed or damaged after it was \
         written: learn it again or take a copy"
    )]
    Checksum {
        /// The file.
        path: PathBuf,
        /// In the file.
        found: String,
        /// Of the content.
        computed: String,
    },
    /// The values contradict each other.
    #[error("{path}: {}", problems.join("; "))]
    Values {
        /// The file.
        path: PathBuf,
        /// One sentence each.
        problems: Vec<String>,
    },
    /// Made for another machine.
    #[error(
        "{path}: was learned on bench {baseline:?}, but this bench, {bench:?}, is another: {}; {}",
        sentences(changes),
        advice(changes)
    )]
    OtherBench {
        /// The file.
        path: PathBuf,
        /// Bench of the baseline.
        baseline: String,
        /// The bench in use.
        bench: String,
        /// The fields that differ.
        changes: Vec<Change>,
    },
    /// Made before baselines said what they rest on, with another bench file.
    #[error(
        "{path}: was learned with another bench file than this of {bench:?}, and does not say what it rests on. Where teeth, ratios, \
         sensors and units are the same, tie it to this bench: gearwatch baseline rebind {path} --bench BENCH --reason TEXT; otherwise learn it \
         again"
    )]
    OtherFile {
        /// The file.
        path: PathBuf,
        /// The bench in use.
        bench: String,
    },
    /// Made with windows of another length.
    #[error(
        "{path}: was learned with windows of {expected} s, but windows are now {found} s; floors and scatter depend on the \
         length: set it to {expected} s, or learn again"
    )]
    OtherWindow {
        /// The file.
        path: PathBuf,
        /// Of the baseline (s).
        expected: f64,
        /// In use (s).
        found: f64,
    },
}

fn sentences(changes: &[Change]) -> String {
    changes.iter().map(|change| change.sentence.as_str()).collect::<Vec<_>>().join("; ")
}

fn advice(changes: &[Change]) -> &'static str {
    if changes.iter().any(|change| change.new_lines) {
        "what was learned means something else there: learn it again"
    } else {
        "where it holds all the same, say why with `gearwatch baseline rebind --reason`; otherwise learn it again"
    }
}

/// Hash of a bench's content, lower-case hexadecimal: SHA-256 of the bench as compact JSON.
/// Comments, spacing and defaults written out or left out do not change it.
pub fn bench_sha256(bench: &Bench) -> String {
    // Neither doubts that were cleared nor what condition indicators are told change what a
    // baseline was learned from.
    let bench = &Bench {
        check: gearwatch_core::bench::Check::default(),
        bearings: Vec::new(),
        indicators: gearwatch_core::bench::IndicatorSettings::default(),
        ..bench.clone()
    };
    // A bench holds nothing but strings, numbers and lists of them: it always has a JSON form.
    sha256_of(&serde_json::to_string(bench).unwrap_or_default())
}

/// Text of a baseline file.
///
/// # Errors
/// When a value has no JSON form (NaN, infinite).
pub fn to_text(baseline: &Baseline, path: &Path) -> Result<String, BaselineFileError> {
    let syntax = |message: String| BaselineFileError::Syntax { path: path.to_owned(), message };
    let value = serde_json::to_value(baseline).map_err(|e| syntax(e.to_string()))?;
    sealed::seal(value).ok_or_else(|| syntax("it is no JSON object".to_owned()))
}

/// Parses the text of a baseline file; `path` is named in errors.
///
/// # Errors
/// When it is no baseline, the checksum is wrong, or the values contradict each other.
pub fn parse(text: &str, path: &Path) -> Result<Baseline, BaselineFileError> {
    let syntax = |message: String| BaselineFileError::Syntax { path: path.to_owned(), message };
    let value = sealed::unseal(text, FORMAT).map_err(|broken| match broken {
        Broken::Syntax(message) => syntax(message),
        Broken::Checksum { found, computed } => BaselineFileError::Checksum { path: path.to_owned(), found, computed },
    })?;
    let baseline: Baseline = serde_json::from_value(value).map_err(|e| syntax(e.to_string()))?;
    let problems = baseline.problems();
    if problems.is_empty() { Ok(baseline) } else { Err(BaselineFileError::Values { path: path.to_owned(), problems }) }
}

/// Reads and checks a baseline file.
///
/// # Errors
/// When it cannot be read, is above [`LARGEST_TEXT`](crate::text::LARGEST_TEXT) (a thousand runs of
/// eight channels take some 20 MB), or as [`parse`].
pub fn read(path: &Path) -> Result<Baseline, BaselineFileError> {
    let read_error = |cause| BaselineFileError::Read { path: path.to_owned(), cause };
    let text = read_text(path).map_err(read_error)?;
    parse(&text, path)
}

/// Reads a baseline for use with this bench and these windows.
///
/// # Errors
/// As [`read`], and when it belongs to another bench or another window length.
pub fn read_for(path: &Path, bench: &Bench, window_s: f64) -> Result<Baseline, BaselineFileError> {
    let baseline = read(path)?;
    check_use(&baseline, path, bench, window_s)?;
    Ok(baseline)
}

/// Checks that a baseline belongs to this bench and these windows.
///
/// # Errors
/// When it does not.
pub fn check_use(baseline: &Baseline, path: &Path, bench: &Bench, window_s: f64) -> Result<(), BaselineFileError> {
    match &baseline.machine {
        Some(machine) => {
            let changes = machine.changes(&Machine::of(bench));
            if !changes.is_empty() {
                return Err(other_bench(baseline, path, bench, changes));
            }
        }
        None if baseline.bench_sha256 != bench_sha256(bench) => {
            return Err(BaselineFileError::OtherFile { path: path.to_owned(), bench: bench.name.clone() });
        }
        None => {}
    }
    let same = (baseline.window_s - window_s).abs() <= WINDOW_TOLERANCE * baseline.window_s;
    if !same {
        return Err(BaselineFileError::OtherWindow {
            path: path.to_owned(),
            expected: baseline.window_s,
            found: window_s,
        });
    }
    Ok(())
}

fn other_bench(baseline: &Baseline, path: &Path, bench: &Bench, changes: Vec<Change>) -> BaselineFileError {
    let (path, baseline, bench) = (path.to_owned(), baseline.bench.clone(), bench.name.clone());
    BaselineFileError::OtherBench { path, baseline, bench, changes }
}

/// Ties a baseline to a bench that it still holds for, and notes why. `t_ns` is now. Gives what had
/// changed.
///
/// # Errors
/// When the lines that were learned mean something else on this bench: other teeth, ratios, stages
/// or units.
pub fn rebind(
    baseline: &mut Baseline,
    path: &Path,
    bench: &Bench,
    reason: &str,
    t_ns: i64,
) -> Result<Vec<Change>, BaselineFileError> {
    let now = Machine::of(bench);
    let mut changes = baseline.machine.as_ref().map_or_else(Vec::new, |machine| machine.changes(&now));
    // A file that does not say what it rests on still names its stages, and the unit of each
    // channel.
    let is: Vec<&String> = bench.stages.iter().map(|stage| &stage.name).collect();
    if baseline.stages.iter().ne(is.iter().copied()) {
        let sentence = format!("the stages were {:?}, are {is:?}", baseline.stages);
        changes.push(Change { sentence, new_lines: true });
    }
    for (name, channel) in baseline.runs.iter().flat_map(|run| &run.channels) {
        let unit = bench.sensors.iter().find(|sensor| &sensor.name == name).map(|sensor| &sensor.unit);
        if let Some(unit) = unit.filter(|unit| **unit != channel.unit) {
            let sentence = format!("sensor {name:?}: unit was {}, is {unit}", channel.unit);
            if changes.iter().all(|change| change.sentence != sentence) {
                changes.push(Change { sentence, new_lines: true });
            }
        }
    }
    if changes.iter().any(|change| change.new_lines) {
        return Err(other_bench(baseline, path, bench, changes));
    }
    let sentences = changes.iter().map(|change| change.sentence.clone()).collect();
    baseline.history.push(Rebinding { t_ns, reason: reason.to_owned(), changes: sentences });
    baseline.machine = Some(now);
    baseline.bench.clone_from(&bench.name);
    baseline.bench_sha256 = bench_sha256(bench);
    Ok(changes)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use gearwatch_core::baseline::{
        BaselineConfig, FloorStatistics, IndicatorStatistics, LineStatistics, Run, RunChannel,
    };

    use super::*;

    const BENCH: &str = r#"
format = "gearwatch-bench/1"
name = "b"
motor = { speed_hz = 30.0 }
shaft = [ { name = "in" }, { name = "out" } ]
stage = [ { name = "s", pinion = { teeth = 20 }, wheel = { teeth = 40 } } ]
"#;

    fn bench(text: &str) -> Bench {
        crate::bench_file::parse(text, Path::new("bench.toml")).expect("a good bench")
    }

    fn baseline() -> Baseline {
        let bench = bench(BENCH);
        let mut baseline = Baseline::new(&bench, bench_sha256(&bench), 1.0, BaselineConfig::default());
        let line = LineStatistics {
            windows: 19,
            left_out: 1,
            effective: 11.375_123_456_789,
            amplitude: 0.1 + 0.2,
            scatter: 0.05,
            noise: 1e-3,
            floor: Some(FloorStatistics { effective: 12.0, amplitude: 1e-5, scatter: 0.2 }),
        };
        let channel = RunChannel {
            unit: "m/s^2".into(),
            windows: 20,
            stages: vec![[Some(line), None, Some(line), None, Some(line)]],
            indicators: BTreeMap::from([(
                "1.pinion.fm4".to_owned(),
                IndicatorStatistics { effective: 4.5, value: 3.1, scatter: 0.02, noise: 0.01 },
            )]),
        };
        let run = Run {
            session: "monday".into(),
            mounting: "first".into(),
            recording: "a.mcap".into(),
            input_speed_hz: 29.757,
            brake_torque_nm: None,
            motor_speed_hz: None,
            channels: BTreeMap::from([("acc".to_owned(), channel)]),
        };
        baseline.add(vec![run]).expect("the first run");
        baseline
    }

    #[test]
    fn conform_round_trip_through_a_file() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("normal.json");
        std::fs::write(&path, to_text(&baseline(), &path).expect("a text")).expect("written");
        assert_eq!(read_for(&path, &bench(BENCH), 1.0).expect("read"), baseline());
        // White space is nobody's business.
        let text = std::fs::read_to_string(&path).expect("text");
        let compact: serde_json::Value = serde_json::from_str(&text).expect("JSON");
        assert_eq!(parse(&compact.to_string(), &path).expect("compact"), baseline());
    }

    /// Every digit and every letter of the text, changed one at a time: refused each time, or the
    /// same baseline (the 17th digit of a number may not matter).
    #[test]
    fn conform_every_changed_character_is_noticed() {
        let path = Path::new("normal.json");
        let text = to_text(&baseline(), path).expect("text");
        let mut changed = 0;
        for (at, byte) in text.bytes().enumerate() {
            let other = match byte {
                b'0'..=b'8' => byte + 1,
                b'9' => b'0',
                b'a'..=b'y' => byte + 1,
                _ => continue,
            };
            let mut bytes = text.clone().into_bytes();
            bytes[at] = other;
            let tampered = String::from_utf8(bytes).expect("still ASCII");
            match parse(&tampered, path) {
                Ok(same) => assert_eq!(same, baseline(), "byte {at} of {tampered}"),
                Err(_) => changed += 1,
            }
        }
        assert!(changed > 500, "{changed}");
        for end in 0..text.len() - 1 {
            assert!(parse(&text[..end], path).is_err() || text[end..].trim().is_empty(), "cut at {end}");
        }
    }

    #[test]
    fn conform_other_bench_and_other_window_are_refused_in_a_sentence() {
        let path = Path::new("normal.json");
        let refused =
            |bench: &Bench, window_s| check_use(&baseline(), path, bench, window_s).expect_err("refused").to_string();
        let other = bench(&BENCH.replace("teeth = 40", "teeth = 41"));
        let text = refused(&other, 1.0);
        assert!(text.contains("normal.json") && text.contains("stage \"s\": wheel.teeth was 40, is 41"), "{text}");
        assert!(text.ends_with("learn it again") && !text.contains("rebind"), "{text}");
        let text = refused(&bench(BENCH), 0.5);
        assert!(text.contains("windows of 1 s") && text.contains("now 0.5 s"), "{text}");
        // Comments and defaults written out are not another bench.
        let same = bench(&format!("# a comment\n{}", BENCH.replace("speed_hz = 30.0", "speed_hz = 30")));
        assert_eq!(bench_sha256(&same), bench_sha256(&bench(BENCH)));
    }

    /// A name, a stiffness, a damping or an effect is nothing that lines are measured by.
    #[test]
    fn conform_what_does_not_matter_keeps_a_baseline() {
        let path = Path::new("normal.json");
        for (from, to) in [
            ("name = \"b\"", "name = \"bench 3\""),
            ("speed_hz = 30.0", "speed_hz = 25.0"),
            ("{ name = \"in\" }", "{ name = \"in\", bearing_n_per_m = 2e8 }"),
            ("teeth = 20 }", "teeth = 20, bore_mm = 12.0 }"),
        ] {
            assert!(BENCH.contains(from), "{from}");
            let changed = bench(&BENCH.replace(from, to));
            assert_ne!(bench_sha256(&changed), bench_sha256(&bench(BENCH)));
            check_use(&baseline(), path, &changed, 1.0).expect(to);
        }
    }

    /// What matters and is no other line is named, and kept with a reason; what makes other lines
    /// is not kept for any reason.
    #[test]
    fn conform_a_baseline_is_tied_anew_with_a_reason() {
        let path = Path::new("normal.json");
        let tacho = bench(&format!("{BENCH}tacho = {{ shaft = \"in\" }}\n"));
        let text = check_use(&baseline(), path, &tacho, 1.0).expect_err("refused").to_string();
        assert!(
            text.contains("tacho was none, is 1 pulses per revolution of \"in\"") && text.contains("rebind"),
            "{text}"
        );
        let mut bound = baseline();
        let changes = rebind(&mut bound, path, &tacho, "the tacho was there all along", 7).expect("tied");
        assert_eq!(changes.len(), 1);
        check_use(&bound, path, &tacho, 1.0).expect("it holds now");
        assert_eq!(bound.history.len(), 1);
        assert_eq!((bound.history[0].t_ns, bound.history[0].reason.as_str()), (7, "the tacho was there all along"));
        // It survives the file, and with it why.
        assert_eq!(parse(&to_text(&bound, path).expect("text"), path).expect("read"), bound);
        let teeth = bench(&BENCH.replace("teeth = 40", "teeth = 41"));
        let error = rebind(&mut baseline(), path, &teeth, "because", 7).expect_err("other lines");
        assert!(error.to_string().contains("wheel.teeth was 40, is 41"), "{error}");
    }

    /// Files of before baselines said what they rest on: good for the very same bench file, and
    /// told how to go on with a changed one.
    #[test]
    fn conform_older_files_are_read_and_can_be_tied() {
        let path = Path::new("normal.json");
        let mut old = baseline();
        old.machine = None;
        let text = to_text(&old, path).expect("text");
        assert!(!text.contains("\"machine\"") && !text.contains("\"history\""), "{text}");
        let old = parse(&text, path).expect("an older file");
        check_use(&old, path, &bench(BENCH), 1.0).expect("the same bench file");
        let renamed = bench(&BENCH.replace("name = \"b\"", "name = \"c\""));
        let error = check_use(&old, path, &renamed, 1.0).expect_err("another file").to_string();
        assert!(error.contains("gearwatch baseline rebind normal.json"), "{error}");
        let mut tied = old.clone();
        assert_eq!(rebind(&mut tied, path, &renamed, "renamed", 1).expect("tied"), []);
        check_use(&tied, path, &renamed, 1.0).expect("it holds now");
    }

    #[test]
    fn conform_what_is_no_baseline_is_named() {
        let path = Path::new("x.json");
        let message = |text: &str| parse(text, path).expect_err("refused").to_string();
        assert!(message("").contains("x.json"));
        assert!(message("[]").contains("expected a JSON object"));
        assert!(message("{}").contains("\"format\" is missing"));
        assert!(message(r#"{"format":"gearwatch-baseline/2"}"#).contains("gearwatch-baseline/2"));
        assert!(message(r#"{"format":"gearwatch-baseline/1"}"#).contains("checksum_sha256"));
        // A right checksum over wrong values.
        let mut bad = baseline();
        bad.runs[0].channels.get_mut("acc").expect("acc").stages[0][0].as_mut().expect("a line").amplitude = -1.0;
        let text = to_text(&bad, path).expect("text");
        assert!(message(&text).contains("amplitude that is not above 0"), "{}", message(&text));
    }
}
