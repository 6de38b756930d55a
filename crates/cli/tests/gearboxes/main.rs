//! Helical and planetary benches as a user watches them: learned, diagnosed, checked and watched by
//! the service; refused where only a spur bench will do.

mod shifted;
mod synthesis;

use std::path::Path;
use std::process::{Command, Output};

use gearwatch_core::bench::Bench;
use serde_json::Value;
use synthesis::{AMPLITUDES, PASS, Raised, record};

fn gearwatch(folder: &Path, args: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_gearwatch"));
    command.current_dir(folder).args(args).env("NO_COLOR", "1").env("GEARWATCH_LOG", "warn");
    command.output().expect("the binary runs")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn lines(output: &Output, exit: i32) -> Vec<Value> {
    assert_eq!(output.status.code(), Some(exit), "{}\n{}", text(&output.stderr), text(&output.stdout));
    text(&output.stdout).lines().map(|line| serde_json::from_str(line).expect("an object a line")).collect()
}

fn shipped(name: &str) -> String {
    let shipped = gearwatch_sim::shipped::BENCHES.iter().find(|shipped| shipped.name == name);
    format!("{}\n[acquisition]\nsample_rate_hz = 10240.0\n", shipped.expect("shipped").text)
}

/// A folder with the bench, three healthy recordings and what was learned from them as sessions of
/// their own.
fn learned(bench_text: &str) -> (tempfile::TempDir, Bench) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    std::fs::write(path.join("bench.toml"), bench_text).unwrap();
    let bench = gearwatch_io::bench_file::read(&path.join("bench.toml")).unwrap();
    let mut parts = vec!["baseline".to_owned(), "merge".to_owned()];
    for day in 1..=3 {
        let (recording, part) = (format!("day{day}.mcap"), format!("day{day}.json"));
        record(&bench, day, None, &path.join(&recording));
        let session = format!("day{day}");
        let args = ["baseline", "learn", &recording, "--bench", "bench.toml", "--session", &session, "-o", &part];
        let done = gearwatch(path, &args);
        assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
        parts.push(part);
    }
    parts.extend(["-o".to_owned(), "normal.json".to_owned()]);
    let parts: Vec<&str> = parts.iter().map(String::as_str).collect();
    let done = gearwatch(path, &parts);
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    (folder, bench)
}

const USUAL: [&str; 4] = ["--bench", "bench.toml", "--baseline", "normal.json"];

/// One harmonic of one stage is 8 % louder: rank III exactly there, 0 everywhere else, in the
/// averages of `diagnose` and, from the same recording, in the windows that the service judges; a
/// healthy day is within limits, and nothing is doubted.
fn one_harmonic_raised(bench_text: &str, raised: Raised) {
    let (folder, bench) = learned(bench_text);
    let path = folder.path();
    record(&bench, 11, None, &path.join("healthy.mcap"));
    record(&bench, 12, Some(raised), &path.join("raised.mcap"));
    let checked = gearwatch(path, &["check", "bench.toml", "healthy.mcap", "--baseline", "normal.json"]);
    assert_eq!(checked.status.code(), Some(0), "{}{}", text(&checked.stdout), text(&checked.stderr));
    let diagnose = |recording: &str, exit| {
        let args = [&["diagnose", recording, "--format", "json"][..], &USUAL].concat();
        lines(&gearwatch(path, &args), exit)
    };
    let ranks = |verdict: &Value| -> Vec<String> {
        (1..=5).map(|k| verdict[format!("rank_{k}x")].as_str().unwrap_or("?").to_owned()).collect()
    };
    let expected = |verdict: &Value| -> Vec<String> {
        let here = verdict["stage"] == *bench.stages[raised.stage].name;
        (1..=5).map(|k| if here && k == raised.harmonic { "III" } else { "0" }.to_owned()).collect()
    };
    for verdict in diagnose("healthy.mcap", 0) {
        assert_eq!((ranks(&verdict), &verdict["machine"]), (vec!["0".to_owned(); 5], &"normal".into()), "{verdict}");
    }
    let verdicts = diagnose("raised.mcap", 1);
    assert_eq!(verdicts.len(), bench.stages.len() * bench.sensors.len());
    for verdict in &verdicts {
        assert_eq!(ranks(verdict), expected(verdict), "{verdict}");
        assert_eq!(verdict["doubts"], "", "{verdict}");
        if bench.stages[0].gearing.planetary.is_some() && verdict["stage"] == *bench.stages[0].name {
            // States are those of spur pairs.
            assert_eq!(verdict["state_fit"], "not_compared", "{verdict}");
        }
    }
    let service = "format = \"gearwatch-service/1\"\n[[bench]]\nfile = \"bench.toml\"\nbaseline = \"normal.json\"\n\
                   [[bench.source]]\nkind = \"file\"\npath = \"raised.mcap\"\n[[sink]]\nkind = \"stdout\"\n";
    std::fs::write(path.join("service.toml"), service).unwrap();
    let windows = lines(&gearwatch(path, &["run", "--config", "service.toml"]), 0);
    let replayed = gearwatch(path, &[&["replay", "raised.mcap"][..], &USUAL].concat());
    assert_eq!(lines(&replayed, 0), windows);
    let batch = gearwatch(path, &[&["batch", "raised.mcap", "--out", "ranks"][..], &USUAL].concat());
    assert_eq!(batch.status.code(), Some(0), "{}", text(&batch.stderr));
    // 16 s in windows of 1 s every half second.
    assert_eq!(windows.len(), 31 * verdicts.len());
    let mut third = (0, 0);
    for window in &windows {
        let here = window["stage"] == *bench.stages[raised.stage].name;
        for k in 1..=5 {
            let true_percent = if here && k == raised.harmonic { 100.0 * (raised.factor - 1.0) } else { 0.0 };
            let [found, sigma] =
                ["dev", "dev_sigma"].map(|name| window[format!("{name}_{k}x_percent")].as_f64().unwrap());
            // One normal number in 150 000 lies farther off; there are up to 1240 here.
            assert!(
                (found - true_percent).abs() < 4.5 * sigma,
                "{k}x: {found} ± {sigma}, not {true_percent}: {window}"
            );
            if here && k == raised.harmonic {
                third = (third.0 + 1, third.1 + usize::from(window[format!("rank_{k}x")] == "III"));
            }
        }
    }
    // 8 % is one and two percent from the ends of rank III, and a window alone is worth half a
    // percent to one.
    assert!(third.1 * 4 >= third.0 * 3, "{third:?}");
}

#[test]
fn conform_a_helical_box_is_watched() {
    one_harmonic_raised(&shipped("helical-two-stage"), Raised { stage: 1, harmonic: 2, factor: 1.08 });
}

#[test]
fn conform_a_planetary_stage_is_watched() {
    one_harmonic_raised(&shipped("planetary-parallel"), Raised { stage: 0, harmonic: 3, factor: 1.08 });
}

/// Sun 22, planets 20, ring 62 with four planets, whose phases cancel the mesh line at 1x, 3x and
/// 5x: harmonics are read where the planets leave a line, also without a tacho.
const OUT_OF_PHASE: &str = r#"format = "gearwatch-bench/1"
name = "out of phase"
motor = { speed_hz = 30.0 }
shaft = [{ name = "sun_shaft" }, { name = "carrier_shaft" }]
stage = [{ name = "planetary", kind = "planetary", sun = { teeth = 22 }, planet = { teeth = 20, count = 4 }, ring = { teeth = 62 } }]
brake = { torque_nm = 10.0 }
sensor = [{ name = "acc_1", shaft = "carrier_shaft" }]
acquisition = { sample_rate_hz = 8192.0 }
"#;

#[test]
fn conform_planets_out_of_phase_are_watched_without_a_tacho() {
    one_harmonic_raised(OUT_OF_PHASE, Raised { stage: 0, harmonic: 3, factor: 1.08 });
}

/// Every other part that the members can have: a speed increaser as in a wind turbine, a sun that
/// stands still with planets out of phase, a carrier that stands still.
#[test]
fn conform_other_members_are_watched() {
    let stage = |members: &str, sun: u32, planet: u32, count: u32, ring: u32, motor_hz: f64| {
        OUT_OF_PHASE
            .replace("sun = { teeth = 22 }", &format!("{members}, sun = {{ teeth = {sun} }}"))
            .replace("planet = { teeth = 20, count = 4 }", &format!("planet = {{ teeth = {planet}, count = {count} }}"))
            .replace("ring = { teeth = 62 }", &format!("ring = {{ teeth = {ring} }}"))
            .replace("speed_hz = 30.0", &format!("speed_hz = {motor_hz:?}"))
    };
    let third = Raised { stage: 0, harmonic: 3, factor: 1.08 };
    // 99 is a multiple of three, and so is 21 + 99: 297 Hz at 3 Hz of the carrier.
    one_harmonic_raised(&stage("in = \"carrier\", out = \"sun\"", 21, 39, 3, 99, 3.0), third);
    // 62 teeth of the sun that stands still; the carrier turns at 10 Hz 98 / 160 in the sense of
    // the ring.
    one_harmonic_raised(&stage("fixed = \"sun\"", 62, 18, 4, 98, 10.0), third);
    one_harmonic_raised(&stage("fixed = \"carrier\"", 28, 36, 4, 100, 20.0), third);
}

/// Amplitudes at the lines that the planets leave are those of the sum over planets: `A w_d / 2`
/// beside the mesh line, `A w_0` on it. Within half a percent, five sigmas of the mean over 31
/// windows at the weakest line.
#[test]
fn analytic_amplitudes_of_planets_out_of_phase() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    std::fs::write(path.join("bench.toml"), OUT_OF_PHASE).unwrap();
    let bench = gearwatch_io::bench_file::read(&path.join("bench.toml")).unwrap();
    record(&bench, 5, None, &path.join("day.mcap"));
    // Without a baseline nothing is judged: exit 3.
    let verdicts = lines(&gearwatch(path, &["diagnose", "day.mcap", "--bench", "bench.toml", "--format", "json"]), 3);
    let [verdict] = verdicts.as_slice() else { panic!("{verdicts:?}") };
    for (k, amplitude) in (1..=5).zip(AMPLITUDES) {
        // 62 k is a multiple of four for even k, else two carrier orders from one.
        let expected = amplitude * if k % 2 == 0 { PASS[0] } else { 0.5 * PASS[2] };
        let found = verdict[format!("amp_{k}x")].as_f64().unwrap_or(f64::NAN);
        assert!((found / expected - 1.0).abs() < 5e-3, "{k}x: {found}, expected {expected}");
    }
    // The table and the report name the lines that were read: the mesh is at 30 Hz 62 22 / 84 =
    // 487.14 Hz, 1x at 64/62 of it, within the drift of the speed.
    let args = ["diagnose", "day.mcap", "--bench", "bench.toml", "--report", "day.html"];
    let table = text(&gearwatch(path, &args).stdout);
    let row = table.lines().find(|line| line.trim_start().starts_with("1x ")).expect("a row of 1x");
    let hz: f64 = row.split_whitespace().nth(1).and_then(|hz| hz.parse().ok()).expect("a frequency");
    assert!((hz / 502.86 - 1.0).abs() < 3e-3, "{row}");
    assert!(std::fs::read_to_string(path.join("day.html")).unwrap().contains(&format!("1x, {hz:.2} Hz")), "{hz}");
}

/// One tooth too many on the sun, with the planets and the ring that go with it, is doubted; what
/// asks for the simulator is refused with what is supported.
#[test]
fn conform_wrong_teeth_are_found_and_the_simulator_refuses() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let text_of = shipped("planetary-parallel");
    std::fs::write(path.join("bench.toml"), &text_of).unwrap();
    let bench = gearwatch_io::bench_file::read(&path.join("bench.toml")).unwrap();
    record(&bench, 21, None, &path.join("day.mcap"));
    let other =
        text_of.replace("{ teeth = 28 }", "{ teeth = 32 }").replace("{ teeth = 36, count", "{ teeth = 34, count");
    std::fs::write(path.join("other.toml"), other).unwrap();
    let checked = gearwatch(path, &["check", "other.toml", "day.mcap"]);
    let said = text(&checked.stdout);
    assert_ne!(checked.status.code(), Some(0), "{said}");
    assert!(said.contains("planetary.sun") && said.contains("lines of 28 teeth"), "{said}");
    let shifted = text_of.replace("kind = \"planetary\"", "kind = \"planetary\"\nprofile_shifted = true");
    std::fs::write(path.join("shifted.toml"), shifted).unwrap();
    let service = "format = \"gearwatch-service/1\"\n[[bench]]\nfile = \"shifted.toml\"\n[[bench.source]]\nkind = \"simulator\"\n";
    std::fs::write(path.join("service.toml"), service).unwrap();
    for args in [
        &["run", "--config", "service.toml"][..],
        &["config", "check", "service.toml"],
        &["simulate", "shifted.toml", "-o", "x.mcap"],
        &["sweep", "shifted.toml", "--out", "sweep.csv"],
        &["signatures", "bench.toml"],
        &["explain", "bench.toml", "day.mcap"],
    ] {
        let done = gearwatch(path, args);
        let said = text(&done.stderr);
        assert_eq!(done.status.code(), Some(3), "{args:?}: {said}");
        assert!(said.contains("stage \"planetary\"") && said.contains("know external"), "{args:?}: {said}");
        assert!(!path.join("x.mcap").exists(), "{args:?}");
    }
}

/// A planetary bench from simulation to alarm: learned from one recording, a broken tooth of each
/// member is seen in another, and a further healthy one is not.
#[test]
fn conform_a_planetary_bench_is_simulated_learned_and_watched() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    std::fs::write(path.join("bench.toml"), shipped("planetary-parallel")).unwrap();
    let simulate = |seed: &str, effect: Option<&str>, to: &str| {
        let mut args = vec!["simulate", "bench.toml", "--duration", "20", "--seed", seed, "-o", to];
        args.extend(effect.iter().flat_map(|effect| ["--effect", *effect]));
        let done = gearwatch(path, &args);
        assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    };
    simulate("1", None, "monday.mcap");
    let learned = gearwatch(
        path,
        &["baseline", "learn", "monday.mcap", "--bench", "bench.toml", "--session", "monday", "-o", "normal.json"],
    );
    assert_eq!(learned.status.code(), Some(0), "{}", text(&learned.stderr));
    let diagnose = |file: &str| {
        gearwatch(path, &["diagnose", file, "--bench", "bench.toml", "--baseline", "normal.json"]).status.code()
    };
    simulate("2", None, "tuesday.mcap");
    assert_eq!(diagnose("tuesday.mcap"), Some(0));
    for (n, place) in ["planetary.sun", "planetary.ring", "planetary.planet_2"].iter().enumerate() {
        let file = format!("broken-{n}.mcap");
        simulate("3", Some(&format!("tooth_breakage@{place}:fraction=0.8")), &file);
        assert!(matches!(diagnose(&file), Some(1 | 2)), "{place}");
    }
}

/// Modes of a planetary stage: text, JSON and page agree, and only modes of the kind that the
/// planets' phases let through have critical speeds.
#[test]
fn conform_modes_of_a_planetary_stage() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let shown = gearwatch(path, &["modes", "planetary-parallel", "--highest", "200", "--plot", "modes.html"]);
    let said = text(&shown.stdout);
    assert_eq!(shown.status.code(), Some(0), "{}", text(&shown.stderr));
    assert!(
        said.contains("1x rotational, 2x rotational") && said.contains("parallel and the shafts between"),
        "{said}"
    );
    let page = std::fs::read_to_string(path.join("modes.html")).unwrap();
    assert!(page.contains("Campbell") || page.contains("Eigenfrequencies (level)"));
    let parsed = gearwatch(path, &["modes", "planetary-parallel", "--highest", "200", "--format", "json"]);
    let object: serde_json::Value = serde_json::from_slice(&parsed.stdout).unwrap();
    let stage = &object["planetary_stages"][0];
    let critical = stage["critical"].as_array().unwrap();
    assert!(!critical.is_empty());
    for crossing in critical {
        let mode = &stage["modes"][crossing["mode"].as_u64().unwrap() as usize - 1];
        assert_eq!(mode["kind"], "rotational", "{crossing}");
        assert!(said.contains(&format!(
            "{:.2} Hz   {}",
            crossing["motor_hz"].as_f64().unwrap(),
            crossing["line"].as_str().unwrap()
        )));
    }
}
