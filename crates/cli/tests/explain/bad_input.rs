//! What cannot be judged: exit code 3, a sentence with the file, what was expected and what was
//! found, and nothing written.

use gearwatch_core::block::{Packet, Samples};

use crate::fixture::{Folder, bench, stderr, stdout};

/// Refused with all of these words, and nothing written.
fn refused(folder: &Folder, args: &[&str], wanted: &[&str]) {
    let done = folder.run(&[&["explain"], args, &["--out", "answer"]].concat());
    let said = stderr(&done);
    assert_eq!(done.status.code(), Some(3), "{args:?}: {said}{}", stdout(&done));
    for wanted in wanted {
        assert!(said.contains(wanted), "{args:?}: {wanted:?} is not in: {said}");
    }
    assert!(!said.contains("panicked") && said.lines().count() < 8, "{args:?}: {said}");
    if !said.contains("not judged") {
        assert!(!folder.path("answer").exists(), "{args:?}: an answer was written");
        return;
    }
    // What was read and could not be judged is told in the file too, and nothing else is written.
    let answer: serde_json::Value = serde_json::from_str(&folder.read("answer/explanation.json")).unwrap();
    assert_eq!(answer["status"], "not_judged", "{args:?}");
    assert!(answer["limits"][0].as_str().is_some_and(|why| said.contains(why)), "{args:?}: {answer}");
    assert_eq!(std::fs::read_dir(folder.path("answer")).unwrap().count(), 1, "{args:?}");
    std::fs::remove_dir_all(folder.path("answer")).unwrap();
}

#[test]
fn conform_files_that_are_no_recordings_are_refused() {
    let folder = Folder::new();
    std::fs::create_dir(folder.path("empty")).unwrap();
    folder.write("notes/readme.txt", "nothing was recorded on Monday");
    folder.write("notes/settings.toml", "speed = 3");
    folder.write("text/monday.mcap", "the bench ran all day");
    folder.write("void/monday.mcap", "");
    folder.write("mixed/monday.csv", "day,remark\n1,quiet\n2,loud\n");
    refused(&folder, &["bench.toml", "empty"], &["empty holds no recording", "MCAP"]);
    refused(&folder, &["bench.toml", "notes"], &["notes holds no recording"]);
    refused(&folder, &["bench.toml", "nowhere"], &["nowhere", "cannot be read"]);
    refused(&folder, &["bench.toml", "text"], &["text/monday.mcap"]);
    refused(&folder, &["bench.toml", "void"], &["void/monday.mcap"]);
    refused(&folder, &["bench.toml", "mixed"], &["mixed/monday.csv"]);
    refused(&folder, &["bench.toml"], &["RECORDINGS"]);
    folder.simulate("bench.toml", "good.mcap", (30.0, 80.0), 1, &[]);
    let whole = std::fs::read(folder.path("good.mcap")).unwrap();
    std::fs::write(folder.path("cut.mcap"), &whole[..whole.len() / 3]).unwrap();
    refused(&folder, &["bench.toml", "good.mcap", "--reference", "empty"], &["empty holds no recording"]);
    refused(&folder, &["bench.toml", "good.mcap", "--reference", "good.mcap"], &["good.mcap", "its own reference"]);
    refused(&folder, &["bench.toml", "cut.mcap"], &["cut.mcap"]);
}

#[test]
fn conform_bench_files_that_cannot_be_are_refused() {
    let folder = Folder::new();
    folder.simulate("bench.toml", "good.mcap", (30.0, 80.0), 1, &[]);
    for (name, from, to, wanted) in [
        ("key.toml", "teeth = 29", "tooths = 23", &["key.toml", "line", "tooths", "teeth"][..]),
        ("shaft.toml", "shaft = \"input\"\ndirection", "shaft = \"exit\"\ndirection", &["shaft.toml", "exit"]),
        ("module.toml", "module_mm = 2.5", "module_mm = -2.5", &["module.toml", "module_mm is -2.5"]),
        ("rate.toml", "sample_rate_hz = 8192.0", "sample_rate_hz = 0.0", &["rate.toml", "sample_rate_hz"]),
        ("effect.toml", "effect = \"pitch_error\"", "effect = \"pitch_eror\"", &["effect.toml", "pitch_error"]),
        (
            "twice.toml",
            "[tacho]\nshaft = \"input\"",
            "[[sensor]]\nname = \"acc_1\"\nshaft = \"input\"\n[tacho]\nshaft = \"input\"",
            &["twice.toml", "acc_1"],
        ),
    ] {
        let text = bench();
        assert!(text.contains(from), "{from:?} is not in the bench file");
        folder.write(name, &text.replacen(from, to, 1));
        refused(&folder, &[name, "good.mcap"], wanted);
    }
    refused(&folder, &["none.toml", "good.mcap"], &["none.toml"]);
    refused(&folder, &["good.mcap", "good.mcap"], &["good.mcap"]);
}

/// Recordings of another bench, or of this one under other settings than they say.
#[test]
fn conform_recordings_that_do_not_fit_are_refused() {
    let folder = Folder::new();
    folder.simulate("bench.toml", "good.mcap", (30.0, 80.0), 1, &[]);
    let refused = |args: &[&str], wanted: &[&str]| refused(&folder, args, wanted);
    // Another unit, another rate, other sensors.
    folder.write(
        "g.toml",
        &bench()
            .replace("direction_deg = 90.0", "direction_deg = 90.0\nunit = \"g\"")
            .replace("direction_deg = 45.0", "direction_deg = 45.0\nunit = \"g\""),
    );
    refused(&["g.toml", "good.mcap"], &["good.mcap", "acc_1", "\"m/s^2\"", "\"g\""]);
    folder.write("rate.toml", &bench().replace("8192.0", "12800.0"));
    refused(&["rate.toml", "good.mcap"], &["good.mcap", "8192 Hz", "12800 Hz"]);
    folder.write("names.toml", &bench().replace("acc_1", "left").replace("acc_2", "right"));
    refused(&["names.toml", "good.mcap"], &["good.mcap", "acc_1", "left"]);
    // Too short.
    folder.simulate("bench.toml", "short.mcap", (30.0, 80.0), 1, &["--duration", "0.4"]);
    refused(&["bench.toml", "short.mcap"], &["short.mcap", "revolutions", "20 are needed"]);
    // A run-up alone.
    folder.write(
        "up.toml",
        "format = \"gearwatch-scenario/1\"\nmotor_speed_hz = [[0.0, 15.0], [3.0, 30.0]]\nduration_s = 3.0\n",
    );
    let up = ["simulate", "bench.toml", "--torque", "60", "--scenario", "up.toml", "-o", "up.mcap"];
    assert_eq!(folder.run(&up).status.code(), Some(0));
    refused(&["bench.toml", "up.mcap"], &["only run-ups", "steady speed"]);
    // A cable that is off.
    folder.changed("good.mcap", "dead.mcap", |packet| {
        Some(match packet {
            Packet::Vibration(mut block) => {
                let count = match &block.samples {
                    Samples::Physical(x) => x.len(),
                    Samples::Counts { counts, .. } => counts.len(),
                };
                block.samples = Samples::Physical(vec![0.25; count]);
                Packet::Vibration(block)
            }
            other => other,
        })
    });
    refused(&["bench.toml", "dead.mcap"], &["dead.mcap", "acc_1", "stands still"]);
    // Another bench with sensors of the same name; the same bench at another speed than is stated.
    folder.write("other.toml", &bench().replace("teeth = 29", "teeth = 37").replace("teeth = 53", "teeth = 97"));
    refused(&["other.toml", "good.mcap"], &["good.mcap", "those of 29 teeth", "stage1", "says 37"]);
    let restated = |packet| {
        Some(match packet {
            Packet::OperatingPoint(mut point) => {
                point.motor_speed_hz = 21.0;
                Packet::OperatingPoint(point)
            }
            other => other,
        })
    };
    folder.changed("good.mcap", "restated.mcap", |packet| match packet {
        Packet::Tacho(_) => None,
        other => restated(other),
    });
    refused(&["bench.toml", "restated.mcap"], &["restated.mcap", "those of 30.0", "21."]);
    // No speed at all, and far from the nominal one.
    folder.changed("good.mcap", "silent.mcap", |packet| matches!(packet, Packet::Vibration(_)).then_some(packet));
    folder.write("slow.toml", &bench().replace("speed_hz = 30.0", "speed_hz = 12.0"));
    refused(&["slow.toml", "silent.mcap"], &["silent.mcap", "none being stated"]);
}

/// The words of the commands themselves.
#[test]
fn conform_contradicting_arguments_are_refused() {
    let folder = Folder::new();
    folder.simulate("bench.toml", "good.mcap", (30.0, 80.0), 1, &[]);
    folder.write("taken", "a file");
    for (args, wanted) in [
        (&["bench.toml", "good.mcap", "--out", "taken"][..], "taken: expected a folder"),
        (&["bench.toml", "good.mcap", "--report", "nowhere/r.html"], "nowhere/r.html"),
        (&["--tables", "a.csv"], "--tables"),
        (&["--tables", "a.csv", "b.csv"], "a.csv"),
        (&["--tables", "a.csv", "b.csv", "bench.toml"], "--tables"),
        (&["bench.toml", "--reference"], "--reference"),
        (&["--blind-spots"], "BENCH"),
    ] {
        let done = folder.run(&[&["explain"], args].concat());
        assert_eq!(done.status.code(), Some(3), "{args:?}: {}", stderr(&done));
        assert!(stderr(&done).contains(wanted), "{args:?}: {}", stderr(&done));
    }
}

/// Recordings are compared with nothing where the reference holds no numbers: that is not
/// `consistent`.
#[test]
fn regress_a_reference_that_cannot_be_judged_gives_no_answer() {
    let folder = Folder::new();
    for (name, seed) in [("good.mcap", 1), ("before.mcap", 2)] {
        folder.simulate("bench.toml", name, (30.0, 80.0), seed, &[]);
    }
    folder.changed("before.mcap", "nan.mcap", |mut packet| {
        if let Packet::Vibration(block) = &mut packet {
            block.samples = Samples::Physical(vec![f32::NAN; block.samples.len()]);
        }
        Some(packet)
    });
    let wanted = ["not judged", "none of the 1 recordings of the reference can be judged"];
    refused(&folder, &["bench.toml", "good.mcap", "--reference", "nan.mcap"], &wanted);
}
