//! Recordings that can be judged in part: the judgement, and beside it what it cannot say.

use gearwatch_core::block::Packet;

use crate::fixture::{Folder, bench};

fn says(limits: &[&str], wanted: &[&str]) -> bool {
    limits.iter().any(|limit| wanted.iter().all(|w| limit.contains(w)))
}

/// One speed and one load: judged, and what they keep from being told is said, in the file and on
/// the terminal.
#[test]
fn conform_one_operating_point_is_judged_with_its_limits() {
    let folder = Folder::new();
    for (name, seed) in [("before", 1), ("now", 2)] {
        folder.simulate("bench.toml", &format!("{name}/a.mcap"), (30.0, 80.0), seed, &[]);
    }
    let answer = folder.explain(&["bench.toml", "now", "--reference", "before"]);
    assert_eq!((answer.status(), answer.code), ("consistent", Some(0)), "{}", answer.said);
    let limits = answer.limits();
    assert!(says(&limits, &["one speed", "sensor path"]) && says(&limits, &["one load", "80 N m"]), "{limits:?}");
    assert!(answer.said.contains("limit"), "{}", answer.said);
}

/// Teeth that the sheet has wrong are counted, not refused.
#[test]
fn conform_wrong_teeth_are_named() {
    let folder = Folder::new();
    // Among the orders of a pitch error a mesh stands out the more, the more noise hides them.
    folder.session("bench.toml", "now", 1, &["--background", "1"]);
    folder.write("wrong.toml", &bench().replace("teeth = 29", "teeth = 30"));
    let answer = folder.explain(&["wrong.toml", "now"]);
    assert_eq!(answer.named()[0], ("wrong_tooth_count".into(), "stage1.pinion".into()), "{}", answer.said);
    let teeth = answer.json["effects"][0]["parameters"]["teeth"]["value"].as_f64().unwrap();
    assert!((teeth - 29.0).abs() < 0.5, "{teeth}");
    assert!(folder.read("answer/bench.toml").contains("teeth = 29"));
}

/// Clipped samples are named with their level, and no line of them is compared with the reference.
#[test]
fn conform_clipping_is_named_and_nothing_else() {
    let folder = Folder::new();
    folder.session("bench.toml", "before", 1, &[]);
    let loudest = 0.55 * largest(&folder, "before/30hz-80nm.mcap");
    let effect = format!("clipping@acc_1:level={loudest}");
    folder.session("bench.toml", "now", 2, &["--effect", &effect]);
    let answer = folder.explain(&["bench.toml", "now", "--reference", "before"]);
    assert_eq!(answer.named(), [("clipping".to_owned(), "acc_1".to_owned())], "{}", answer.said);
    let level = answer.json["effects"][0]["parameters"]["level"]["value"].as_f64().unwrap();
    assert!((level / loudest - 1.0).abs() < 0.02, "{level} where {loudest} is the limit");
    assert!(says(&answer.limits(), &["clipping", "not compared"]), "{:?}", answer.limits());
}

fn largest(folder: &Folder, name: &str) -> f64 {
    let recording =
        gearwatch_io::open::read_recording(&folder.path(name), &gearwatch_io::OpenOptions::default()).unwrap();
    recording.channels["acc_1"].segments.iter().flat_map(|s| &s.samples).fold(0.0, |most, x| x.abs().max(most))
}

/// A reference that is none, because it is of other settings, another bench or other sensors:
/// judged without it, which is said.
#[test]
fn conform_a_reference_that_does_not_fit_is_left_out() {
    let folder = Folder::new();
    folder.simulate("bench.toml", "now/a.mcap", (30.0, 80.0), 2, &[]);
    folder.simulate("bench.toml", "now/b.mcap", (20.0, 60.0), 3, &[]);
    folder.simulate("bench.toml", "settings/a.mcap", (24.0, 80.0), 1, &[]);
    folder.write("sensors.toml", &bench().replace("acc_1", "left").replace("acc_2", "right"));
    folder.simulate("sensors.toml", "sensors/a.mcap", (30.0, 80.0), 1, &[]);
    folder.write("other.toml", &bench().replace("teeth = 29", "teeth = 37").replace("teeth = 53", "teeth = 97"));
    folder.simulate("other.toml", "other/a.mcap", (30.0, 80.0), 1, &[]);
    for (reference, wanted) in [
        ("settings", &["no reference matches", "24.0 Hz"][..]),
        ("sensors", &["not judged", "left", "acc_1"]),
        ("other", &["not judged", "another bench"]),
    ] {
        let answer = folder.explain(&["bench.toml", "now", "--reference", reference]);
        assert_eq!(answer.status(), "consistent", "{reference}: {}", answer.said);
        assert!(says(&answer.limits(), wanted), "{reference}: {:?}", answer.limits());
        let next = answer.json["advice"].to_string();
        assert!(next.contains("reference"), "{reference}: {next}");
    }
}

/// No stated speed but near the nominal one; no stated load; a run-up beside steady recordings; one
/// of two sensors without signal.
#[test]
fn conform_what_is_missing_is_said() {
    let folder = Folder::new();
    folder.simulate("bench.toml", "one.mcap", (30.0, 60.0), 1, &[]);
    folder.changed("one.mcap", "silent.mcap", |packet| matches!(packet, Packet::Vibration(_)).then_some(packet));
    let answer = folder.explain(&["bench.toml", "silent.mcap"]);
    let limits = answer.limits();
    assert!(
        says(&limits, &["no motor speed", "silent.mcap (30.0"]) && says(&limits, &["no brake torque"]),
        "{limits:?}"
    );

    folder.write(
        "off.toml",
        "format = \"gearwatch-scenario/1\"\n[[sensor_fault]]\nsensor = \"acc_2\"\nkind = \"flat\"\nstart_s = 0.0\nend_s = 9.0\n",
    );
    folder.simulate("bench.toml", "some/one.mcap", (25.0, 60.0), 1, &["--scenario", "off.toml"]);
    folder.write(
        "up.toml",
        "format = \"gearwatch-scenario/1\"\nmotor_speed_hz = [[0.0, 15.0], [3.0, 30.0]]\nduration_s = 3.0\n",
    );
    let up = ["simulate", "bench.toml", "--torque", "60", "--scenario", "up.toml", "-o", "some/up.mcap"];
    assert_eq!(folder.run(&up).status.code(), Some(0));
    let answer = folder.explain(&["bench.toml", "some"]);
    let limits = answer.limits();
    assert!(says(&limits, &["acc_2", "stands still"]) && says(&limits, &["run-ups", "up.mcap"]), "{limits:?}");
}
