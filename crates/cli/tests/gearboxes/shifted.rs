//! Shifted pairs as a user has them: simulated, learned and watched; refused where the numbers
//! cannot be.

use super::{gearwatch, shipped, text};

/// The shipped single pair with 14 and 57 teeth, the pinion shifted by half a module.
fn shifted() -> String {
    shipped("single-pair").replace(
        "pinion = { teeth = 23, bore_mm = 20.0 }",
        "pinion = { teeth = 14, bore_mm = 8.0, profile_shift = 0.5 }",
    )
}

/// 14 teeth that no rack cuts without undercut run with x = 0.5, from simulation to alarm: learned
/// from one recording, a broken tooth is seen in another and a further healthy one is not. Modes
/// and fault signatures serve the bench too.
#[test]
fn conform_a_shifted_bench_is_simulated_learned_and_watched() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    std::fs::write(path.join("bench.toml"), shifted()).unwrap();
    let run = |args: &[&str], exit: &[i32]| {
        let done = gearwatch(path, args);
        let said = format!("{}{}", text(&done.stderr), text(&done.stdout));
        assert!(exit.contains(&done.status.code().unwrap_or(-1)), "{args:?}: {said}");
        said
    };
    for (name, seed, effect) in [
        ("monday.mcap", "1", None),
        ("tuesday.mcap", "2", None),
        ("broken.mcap", "3", Some("tooth_breakage@stage1.pinion:fraction=0.8")),
    ] {
        let mut args = vec!["simulate", "bench.toml", "--duration", "20", "--seed", seed, "-o", name];
        args.extend(effect.iter().flat_map(|effect| ["--effect", *effect]));
        let said = run(&args, &[0]);
        assert!(!said.contains("undercut"), "{said}");
    }
    let learn =
        ["baseline", "learn", "monday.mcap", "--bench", "bench.toml", "--session", "monday", "-o", "normal.json"];
    run(&learn, &[0]);
    let judge = |file: &str, exit: &[i32]| {
        run(&["diagnose", file, "--bench", "bench.toml", "--baseline", "normal.json"], exit);
    };
    judge("tuesday.mcap", &[0]);
    judge("broken.mcap", &[1, 2]);
    run(&["modes", "bench.toml"], &[0]);
    run(&["signatures", "bench.toml"], &[0]);
}

/// Each number that cannot be is refused with the file, the place, what was found and what would be
/// right; and so is shift where the simulator does not know it.
#[test]
fn conform_bad_profile_shifts_say_what_would_be_right() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let stage = "name = \"stage1\"\n";
    for (from, to, says) in [
        (", profile_shift = 0.5", "", "expected x ≥ 0.182"),
        (
            "profile_shift = 0.5",
            "profile_shift = 0.1",
            "the rack undercuts 14 teeth with profile_shift = 0.100; expected x ≥ 0.182",
        ),
        ("profile_shift = 0.5", "profile_shift = 1.2", "pointed teeth"),
        ("profile_shift = 0.5", "profile_shift = 3.0", "profile_shift is 3; expected -2 to 2"),
        ("profile_shift = 0.5", "x_coefficient = 0.5", "profile_shift"),
        (stage, "name = \"stage1\"\ncentre_distance_mm = 95.0\n", "involutes touch only beyond 100.077 mm"),
        (
            "bore_mm = 40.0 }",
            "bore_mm = 40.0, profile_shift = 0.0 }\ncentre_distance_mm = 107.0",
            "centre_distance_mm is 107; the teeth jam below 107.931 mm",
        ),
        (
            stage,
            "name = \"stage1\"\nprofile_shifted = true\n",
            "expected profile_shift of both gears, or of one and centre_distance_mm",
        ),
        ("bore_mm = 40.0 }", "bore_mm = 40.0, internal = true }", "has profile shift with an internal wheel"),
        ("bore_mm = 40.0 }", "bore_mm = 40.0 }\nidlers = [{ teeth = 31 }]", "has profile shift with idlers"),
        ("bore_mm = 40.0 }", "bore_mm = 40.0, tip_diameter_mm = 190.0 }", "tip_diameter_mm of at most"),
    ] {
        let bench = shifted();
        assert!(bench.contains(from), "{from}");
        std::fs::write(path.join("bad.toml"), bench.replacen(from, to, 1)).unwrap();
        let done = gearwatch(path, &["simulate", "bad.toml", "-o", "x.mcap", "--duration", "0.2"]);
        let said = text(&done.stderr);
        assert_eq!(done.status.code(), Some(3), "{to}: {said}");
        assert!(said.contains("bad.toml") && said.contains("stage1") || to.contains("x_coeff"), "{to}: {said}");
        assert!(said.contains(says), "{to}: {said}");
        assert!(!path.join("x.mcap").exists(), "{to}");
    }
}
