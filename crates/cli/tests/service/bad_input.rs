//! Bad input: one clear sentence that names the place, exit code 3, nothing on standard output.

use std::process::Output;

use super::fixture::{Bench, output, stderr, text};

fn refused(output: &Output, says: &[&str]) {
    let message = stderr(output);
    assert_eq!(output.status.code(), Some(3), "{message}");
    assert!(output.stdout.is_empty(), "{}", String::from_utf8_lossy(&output.stdout));
    assert!(!message.contains("panicked"), "{message}");
    for part in says {
        assert!(message.contains(part), "{part:?} is not said in: {message}");
    }
}

#[test]
fn conform_recordings_that_cannot_be_read() {
    let bench = Bench::new();
    bench.baseline();
    let file = bench.path("bench.toml");
    let empty = bench.write("empty.mcap", "");
    let folder = bench.path("folder");
    std::fs::create_dir(&folder).unwrap();
    let whole = std::fs::read(bench.healthy()).unwrap();
    let cut = bench.path("cut.mcap");
    std::fs::write(&cut, &whole[..whole.len() / 2]).unwrap();
    let mut bytes = whole.clone();
    let middle = bytes.len() / 3;
    bytes[middle] ^= 0x10;
    let damaged = bench.path("damaged.mcap");
    std::fs::write(&damaged, &bytes).unwrap();
    let cases = [
        (bench.path("missing.mcap"), "cannot be read"),
        (folder, "directory"),
        (empty, "no bytes"),
        (bench.write("noise.mcap", "this is no recording at all"), "noise.mcap"),
        (damaged, "damaged"),
        (cut, "cut.mcap"),
    ];
    for (path, says) in &cases {
        let name = path.file_name().unwrap().to_str().unwrap();
        let one_shot = output(&["diagnose", text(path), "--bench", text(&file)]);
        refused(&one_shot, &[name, says]);
        // A replay says what it read before the damage.
        let replay = output(&["replay", text(path), "--bench", text(&file)]);
        assert_eq!(replay.status.code(), Some(3), "{name}: {}", stderr(&replay));
        assert!(stderr(&replay).contains(says), "{name}: {}", stderr(&replay));
    }
}

#[test]
fn conform_benches_and_baselines_that_cannot_be_used() {
    let bench = Bench::new();
    let recording = bench.healthy();
    let baseline = bench.baseline();
    let file = bench.path("bench.toml");
    let typo = bench.write("typo.toml", &super::fixture::BENCH.replace("torque_nm", "torque_nn"));
    let run = |bench_file: &std::path::Path, baseline: &std::path::Path| {
        output(&["diagnose", text(&recording), "--bench", text(bench_file), "--baseline", text(baseline)])
    };
    refused(&run(&typo, &baseline), &["typo.toml", "torque_nn", "line 7"]);
    refused(&run(&bench.path("none.toml"), &baseline), &["none.toml", "cannot be read"]);
    refused(&run(&file, &bench.path("none.json")), &["none.json", "cannot be read"]);
    let other = bench.write("other.toml", &super::fixture::BENCH.replace("teeth = 40", "teeth = 41"));
    refused(&run(&other, &baseline), &["baseline.json"]);
    let changed = std::fs::read_to_string(&baseline).unwrap().replacen("10.0", "11.0", 1);
    refused(&run(&file, &bench.write("changed.json", &changed)), &["changed.json", "checksum"]);
}

/// A unit that is not the baseline's, and a channel that is not there: unknown, with the reason.
#[test]
fn conform_wrong_unit_and_missing_channel_are_unknown() {
    use gearwatch_core::block::Packet;
    let bench = Bench::new();
    let (file, baseline) = (bench.path("bench.toml"), bench.baseline());
    let unit = bench.record("unit.mcap", "duration_secs = 6.0", |packet| {
        if let Packet::Vibration(block) = packet {
            block.unit = "g".into();
        }
    });
    let channel = bench.record("channel.mcap", "duration_secs = 6.0", |packet| {
        if let Packet::Vibration(block) = packet
            && &*block.sensor == "acc_2"
        {
            block.sensor = "microphone".into();
        }
    });
    let diagnose = |recording| {
        let all = ["diagnose", text(recording), "--bench", text(&file), "--baseline", text(&baseline)];
        let output = output(&all);
        assert_eq!(output.status.code(), Some(3), "{}", stderr(&output));
        super::fixture::stdout(&output)
    };
    let said = diagnose(&unit);
    assert!(said.contains("unknown (other unit)"), "{said}");
    let said = diagnose(&channel);
    assert!(said.contains("channel \"acc_2\" is missing; the recording has acc_1, microphone"), "{said}");
}

#[test]
fn conform_configurations_that_cannot_be_used() {
    let bench = Bench::new();
    let head = "format = \"gearwatch-service/1\"\n[[bench]]\nfile = \"bench.toml\"\n";
    let source = "[[bench.source]]\nkind = \"test_signal\"\n";
    let cases: &[(String, &[&str])] = &[
        ("format = 1".to_owned(), &["line 1", "string"]),
        ("format = \"gearwatch-service/9\"\nbench = []".to_owned(), &["gearwatch-service/9", "gearwatch-service/1"]),
        (format!("{head}{source}[[sinks]]\nkind = \"stdout\""), &["sinks", "line 6"]),
        (head.to_owned(), &["source"]),
        (format!("{head}[[bench.source]]\nkind = \"lanxy\""), &["line 4", "lanxy", "test_signal", "file"]),
        (format!("{head}[[bench.source]]\npath = \"x\""), &["line 4", "\"kind\" is missing"]),
        (format!("{head}[[bench.source]]\nkind = \"file\"\npth = \"x\""), &["line 4", "pth", "path"]),
        (format!("{head}[[bench.source]]\nkind = \"file\""), &["line 4", "path"]),
        (format!("{head}{source}speed = -1.0"), &["speed is -1"]),
        (format!("{head}{source}noise = \"loud\""), &["line 4", "noise", "expected"]),
        (format!("{head}{source}{source}"), &["two sources are called"]),
        (format!("{head}{source}[[sink]]\nkind = \"stdout\"\nwhen_full = \"block\""), &["hold up"]),
        (format!("{head}{source}[[sink]]\nkind = \"stdout\"\nqueue = 0"), &["queue is 0"]),
        (format!("{head}{source}[bench.pipeline.window]\nlength_s = 0.0"), &["length_s is 0"]),
        (format!("{head}{source}[service]\nworkers = 1000"), &["workers is 1000", "256"]),
        (format!("{head}baseline = \"nowhere.json\"\n{source}"), &["nowhere.json"]),
        (format!("{head}{source}fault = {{ after_secs = 1.0, stage = \"stage1\" }}"), &["line 4", "percent"]),
    ];
    for (config, says) in cases {
        let path = bench.write("service.toml", config);
        let checked = output(&["config", "check", text(&path)]);
        refused(&checked, says);
        refused(&checked, &["service.toml"][..usize::from(!says[0].contains("nowhere"))]);
        refused(&output(&["run", "--config", text(&path)]), says);
    }
    refused(&output(&["config", "check", text(&bench.path("none.toml"))]), &["none.toml", "cannot be read"]);
}
