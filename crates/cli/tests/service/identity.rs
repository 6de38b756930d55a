//! The same recording gives the same bytes, whatever the way and the number of workers.

use super::fixture::{Bench, gearwatch, output, stderr, text};

/// Service, replay and one-shot; 1, 2 and 8 workers; from a file and from standard input of a
/// service.
#[test]
fn conform_live_replay_and_one_shot_say_the_same_bytes() {
    let bench = Bench::new();
    let recording = bench.faulty("day.mcap", [3.0, 6.0, -9.0, 12.0, 20.0]);
    let (baseline, file) = (bench.baseline(), bench.path("bench.toml"));
    let fixed = ["--bench", text(&file), "--baseline", text(&baseline)];
    let mut lines = Vec::new();
    for workers in ["1", "2", "8"] {
        let service = bench.write(
            &format!("service-{workers}.toml"),
            &format!(
                "format = \"gearwatch-service/1\"\nservice = {{ workers = {workers} }}\n\
                 [[bench]]\nfile = \"bench.toml\"\nbaseline = \"baseline.json\"\n\
                 [[bench.source]]\nkind = \"file\"\npath = \"day.mcap\"\n[[sink]]\nkind = \"stdout\"\n"
            ),
        );
        let ways = [
            output(&["run", "--config", text(&service)]),
            output(&[&["replay", text(&recording), "--workers", workers], &fixed[..]].concat()),
            output(&[&["diagnose", text(&recording), "--windows", "--workers", workers], &fixed[..]].concat()),
        ];
        for way in ways {
            // 5x stands at rank V from the first window on: what the service says beside the lines
            // is that alarm.
            assert!(stderr(&way).lines().all(|line| line.contains(" alarm ")), "{}", stderr(&way));
            lines.push(way.stdout);
        }
    }
    // 12 s in windows of 1 s every 0.5 s: 23 windows of two channels and one stage.
    assert_eq!(lines[0].iter().filter(|&&b| b == b'\n').count(), 46);
    for other in &lines[1..] {
        assert!(*other == lines[0], "differs:\n{}", String::from_utf8_lossy(other));
    }
    for line in lines[0].split(|&b| b == b'\n').filter(|line| !line.is_empty()) {
        let object: serde_json::Value = serde_json::from_slice(line).unwrap();
        assert_eq!((&object["rank_1x"], &object["rank_5x"]), (&"I".into(), &"V".into()), "{object}");
        assert!(object.as_object().unwrap().values().all(|value| !value.is_object() && !value.is_array()), "{object}");
    }
}

/// A replay at a pace says the same as one at full speed, and takes its time: 12 s at 20 times the
/// speed.
#[test]
fn conform_a_paced_replay_keeps_its_pace_and_says_the_same() {
    let bench = Bench::new();
    let recording = bench.healthy();
    let file = bench.path("bench.toml");
    let replay = |speed| output(&["replay", text(&recording), "--bench", text(&file), "--speed", speed]);
    let begin = std::time::Instant::now();
    let paced = replay("20");
    assert!(begin.elapsed().as_secs_f64() >= 30.0 / 20.0, "{:?}", begin.elapsed());
    assert!(paced.stdout == replay("max").stdout);
}

/// Numbers through a pipe and from a file that grows: the windows are those of the same samples.
#[test]
fn conform_a_pipe_and_a_growing_file_are_read_to_their_ends() {
    let bench = Bench::new();
    let samples: Vec<f32> = (0..2048 * 4).map(|i| (i as f32 * 0.307).sin() + 0.5 * (i as f32 * 0.614).cos()).collect();
    let lines: String = samples.iter().map(|v| format!("{v:?}\n")).collect();
    let bytes: Vec<u8> = samples.iter().flat_map(|v| v.to_le_bytes()).collect();
    bench.write("samples.txt", &lines);
    let configured = |kind: &str, path: &str, encoding: &str, further: &str| {
        bench.write(
            &format!("{kind}-{encoding}.toml"),
            &format!(
                "format = \"gearwatch-service/1\"\n[[bench]]\nfile = \"bench.toml\"\n[[bench.source]]\nkind = \"{kind}\"\n\
                 path = \"{path}\"\n{further}\nframing = {{ encoding = \"{encoding}\", channels = [\"acc_1\"], \
                 sample_rate_hz = 2048.0, first_sample_unix_ns = 0 }}\n[[sink]]\nkind = \"stdout\"\n"
            ),
        )
    };
    let growing = configured("growing_file", "samples.txt", "lines", "end_after_idle_secs = 0.3");
    let from_file = output(&["run", "--config", text(&growing)]);
    let piped = configured("pipe", "-", "f32le", "");
    let mut child = gearwatch(&["run", "--config", text(&piped)])
        .stdin(std::process::Stdio::piped())
        .stdout(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    let mut stdin = child.stdin.take().unwrap();
    for part in bytes.chunks(1001) {
        std::io::Write::write_all(&mut stdin, part).unwrap();
    }
    drop(stdin);
    let from_pipe = child.wait_with_output().unwrap();
    assert_eq!(from_pipe.status.code(), Some(0));
    // 4 s in windows of 1 s every 0.5 s.
    assert_eq!(from_pipe.stdout.iter().filter(|&&b| b == b'\n').count(), 7);
    assert!(from_pipe.stdout == from_file.stdout, "{}", stderr(&from_file));
}
