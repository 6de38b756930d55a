//! `gearwatch simulate` as a user runs it.

use std::path::Path;
use std::process::{Command, Output};

fn gearwatch(folder: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_gearwatch")).current_dir(folder).args(args).output().expect("the binary runs")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// The recording says its speed and length, the same seed gives the same bytes, and both forms of
/// the picture are written.
#[test]
fn conform_a_simulated_recording_is_read_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    std::fs::write(path.join("s.toml"), "format = \"gearwatch-scenario/1\"\nduration_s = 0.5\nmotor_speed_hz = 25.0\n")
        .unwrap();
    let run = |recording: &str, picture: &str| {
        let effect = "tooth_breakage@stage1.pinion:fraction=0.6";
        let args = ["simulate", "single-pair", "--effect", effect, "--scenario", "s.toml"];
        let done = gearwatch(path, &[&args[..], &["-o", recording, "--plot", picture]].concat());
        assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
        assert!(done.stdout.is_empty());
    };
    run("a.mcap", "a.svg");
    run("b.mcap", "b.html");
    let read = |name: &str| std::fs::read(path.join(name)).unwrap();
    assert!(read("a.mcap") == read("b.mcap"), "one seed, two recordings");
    let svg = text(&read("a.svg"));
    assert!(svg.starts_with("<svg") && svg.contains("Order spectrum") && svg.contains("Mesh stiffness"));
    assert!(text(&read("b.html")).contains("tooth_breakage at stage1.pinion"));

    let said = gearwatch(path, &["info", "a.mcap", "--format", "json"]);
    let json: serde_json::Value = serde_json::from_slice(&said.stdout).unwrap();
    // The least speed read: the mean over a packet, which the vibration of the motor moves by some
    // 1e-5 of it.
    let least_hz = json["operating_points"]["motor_speed_hz"][0].as_f64().unwrap();
    assert!((least_hz / 25.0 - 1.0).abs() < 1e-4, "{json}");
    for (name, channel) in json["channels"].as_object().unwrap() {
        let length_s = channel["samples"].as_f64().unwrap() / channel["sample_rate_hz"].as_f64().unwrap();
        // Packets are whole: the last one may run over the end.
        assert!((0.5..0.7).contains(&length_s), "{name}: {length_s} s");
        assert!(channel["rms"].as_f64().unwrap() > 0.0, "{name} is silent");
    }
}

/// What cannot be simulated exits with 3, says what and where, and writes nothing.
#[test]
fn conform_what_cannot_be_simulated_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("s.toml"), "format = \"gearwatch-scenario/1\"\nspeed = 3\n").unwrap();
    for (args, wanted) in [
        (&["singel-pair", "-o", "x.mcap"][..], "singel-pair: no such file"),
        (&["single-pair", "-o", "x.mcap", "--effect", "tooth_brakage@stage1.pinion"], "tooth_brakage"),
        (&["single-pair", "-o", "x.mcap", "--effect", "tooth_breakage"], "expected ID@PLACE"),
        (&["single-pair", "-o", "x.mcap", "--effect", "tooth_breakage@stage9.pinion"], "stage9"),
        (&["single-pair", "-o", "x.mcap", "--effect", "tooth_breakage@stage1.pinion:fraction=7"], "fraction"),
        (&["single-pair", "-o", "x.mcap", "--effect", "tooth_breakage@stage1.pinion:fraktion=0.5"], "fraktion"),
        (&["single-pair", "-o", "x.mcap", "--effect", "tooth_breakage@stage1.pinion:fraction=abc"], "not a number"),
        (&["single-pair", "-o", "x.mcap", "--scenario", "s.toml"], "s.toml"),
        (&["single-pair", "-o", "x.mcap", "--speed", "nan"], "speed"),
        (&["single-pair", "-o", "x.mcap", "--speed=-5"], "speed"),
        (&["single-pair", "-o", "x.mcap", "--speed=0"], "speed"),
        (&["single-pair", "-o", "x.mcap", "--torque=-3"], "torque"),
        (&["single-pair", "-o", "x.mcap", "--torque=1e6"], "breaks the teeth"),
        (&["single-pair", "-o", "x.mcap", "--duration=-1"], "duration"),
        (&["single-pair", "-o", "x.mcap", "--background=-1"], "background_m_per_s2 is -1"),
        (&["single-pair", "-o", "x.mcap", "--plot", "x.png"], "x.png: the name must end in .svg or .html"),
        (&["single-pair", "-o", "x.csv"], "x.csv: the recording is written as MCAP"),
        (&["single-pair"], "nothing to write"),
    ] {
        let done = gearwatch(folder.path(), &[&["simulate"], args].concat());
        let said = text(&done.stderr);
        assert_eq!(done.status.code(), Some(3), "{args:?}: {said}");
        assert!(said.contains(wanted), "{args:?}: {said}");
        assert!(!said.contains("panicked"), "{said}");
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "a file was left");
}

/// A bench file that cannot be: exit code 3, and a sentence with the file, the place, what was
/// found and what would be right.
#[test]
fn conform_bad_bench_files_say_what_would_be_right() {
    let folder = tempfile::tempdir().unwrap();
    let shipped = gearwatch_sim::shipped::BENCHES.iter().find(|shipped| shipped.name == "paper-rig").unwrap();
    for (from, to, found, right) in [
        // Impossible geometry.
        ("teeth = 34, bore_mm = 25.0", "teeth = 12, bore_mm = 12.0", "interference", "needs at least 16 teeth"),
        ("bore_mm = 25.0", "bore_mm = 120.0", "bore diameter is 120", "below the root diameter"),
        ("module_mm = 3.0", "module_mm = -3.0", "module_mm is -3", "above 0 mm"),
        ("module_mm = 3.0", "module_mm = 3.0\npressure_angle_deg = 60.0", "pressure_angle_deg is 60", "10 to 35"),
        ("teeth = 34, bore_mm = 25.0", "teeth = 4", "pinion has 4 teeth", "at least 5"),
        // Stiffness, damping, inertia.
        ("torsion_nm_per_rad = 9000.0", "torsion_nm_per_rad = 0.0", "torsion_nm_per_rad is 0", "above 0 N m/rad"),
        ("bearing_n_per_m = 1.2e8", "bearing_n_per_m = 0.0", "bearing_n_per_m is 0", "above 0 N/m"),
        ("stiffness_nm_per_rad = 4000.0", "stiffness_nm_per_rad = nan", "belt.stiffness_nm_per_rad is NaN", "above 0"),
        ("ratio = 3.56", "ratio = 3.56\nlength_mm = -1600.0", "belt.length_mm is -1600", "above 0 mm"),
        ("ratio = 3.56", "ratio = 3.56\nmotor_pulley_mm = 0.01", "belt.motor_pulley_mm is 0.01", "0.1 to 100000 mm"),
        ("mesh_damping_ratio = 0.06", "mesh_damping_ratio = -0.1", "mesh_damping_ratio is -0.1", "0.03 to 0.1"),
        ("frequency_hz = 410.0", "frequency_hz = 0.0", "housing_mode 1: frequency_hz is 0", "above 0 Hz"),
        ("inertia_kg_m2 = 0.03", "inertia_kg_m2 = -1.0", "brake.inertia_kg_m2 is -1", "above 0 kg m²"),
        // The paper's 1790 in its own unit, ten times over; and the other way round.
        ("torque_nm = 202.0", "torque_nm = 17900.0", "breaks the teeth of stage", "expected at most about"),
        ("torque_nm = 202.0", "torque_nm = -5.0", "brake.torque_nm is -5", "0 N m or more"),
        ("speed_hz = 30.0", "speed_hz = -30.0", "motor.speed_hz is -30", "above 0 Hz"),
        ("speed_hz = 30.0", "speed_hz = 30000.0", "30000", "0 to 1000 Hz"),
        // Effects.
        ("effect = \"eccentricity\"", "effect = \"ecentricity\"", "ecentricity", "did you mean \"eccentricity\""),
        ("runout_um = 6.0", "runout_um = -6.0", "runout_um", "expected 0 to"),
        ("runout_um = 6.0", "runout_mm = 0.006", "runout_mm", "\"runout_um\""),
        ("where = \"stage1.wheel\"", "where = \"stage3.wheel\"", "stage3.wheel", "stage1.wheel"),
        // Things that are not there.
        ("shaft = \"output\"", "shaft = \"exit\"", "\"exit\"", "not a [[shaft]]"),
        ("ratio = 3.56", "ratoi = 3.56", "ratoi", "ratio"),
    ] {
        assert!(shipped.text.contains(from), "{from:?} is not in the bench file");
        std::fs::write(folder.path().join("bench.toml"), shipped.text.replacen(from, to, 1)).unwrap();
        let done = gearwatch(folder.path(), &["simulate", "bench.toml", "-o", "x.mcap", "--duration", "0.2"]);
        let said = text(&done.stderr);
        assert_eq!(done.status.code(), Some(3), "{to}: {said}");
        for wanted in ["bench.toml", found, right] {
            assert!(said.contains(wanted), "{to}: {wanted:?} is not in: {said}");
        }
        assert!(!said.contains("panicked") && said.lines().count() < 8, "{said}");
        assert!(!folder.path().join("x.mcap").exists(), "{to}: a file was left");
    }
}
