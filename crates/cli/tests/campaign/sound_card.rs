//! A sound card that is one to the system: PulseAudio plays a known signal into a sink of its own
//! in real time, ALSA names what can be heard there as a device. Only in builds with the cargo
//! feature `sound-card`: `just campaign-sound-card`.

use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use crate::fixture::{Bench, gearwatch, text};
use crate::service::{ended_within, signal, wait_for};

const RATE: usize = 48_000;
/// Amplitudes of the first two mesh harmonics, as a share of full scale.
const PLAYED: [f64; 2] = [0.2, 0.05];
const FULL_SCALE: f64 = 100.0;
const MESH_HZ: f64 = 1000.0;

/// Ends with the value.
struct Ended(Child);

impl Drop for Ended {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn program(name: &str, run: &Path) -> Command {
    let mut command = Command::new(name);
    command.env("XDG_RUNTIME_DIR", run).env("HOME", run).stdout(Stdio::null()).stderr(Stdio::null());
    command
}

/// Two channels of 16 bits, so many seconds of them.
fn played(secs: usize) -> Vec<u8> {
    let value = |i: usize| {
        let turn = std::f64::consts::TAU * MESH_HZ * i as f64 / RATE as f64;
        PLAYED[0] * turn.sin() + PLAYED[1] * (2.0 * turn).sin()
    };
    let counts = (0..secs * RATE).map(|i| (value(i) * 32768.0).round() as i16);
    counts.flat_map(|count| [count, count / 2]).flat_map(i16::to_le_bytes).collect()
}

#[test]
fn conform_a_sound_card_is_measured_in_real_time() {
    if !cfg!(feature = "sound-card") {
        eprintln!("skipped: this build cannot read sound cards (cargo feature `sound-card`)");
        return;
    }
    let bench = Bench::new();
    let run = bench.path("run");
    std::fs::create_dir(&run).unwrap();
    std::fs::set_permissions(&run, std::fs::Permissions::from_mode(0o700)).unwrap();
    let server = program("pulseaudio", &run)
        .args(["-n", "--daemonize=no", "--exit-idle-time=-1", "-L", "module-native-protocol-unix", "-L"])
        .arg(format!("module-null-sink sink_name=bench rate={RATE} channels=2 format=s16le"))
        .spawn();
    let Ok(server) = server else {
        eprintln!("skipped: PulseAudio is not installed");
        return;
    };
    let _server = Ended(server);
    let answers = || program("pactl", &run).arg("info").status().is_ok_and(|status| status.success()).then_some(());
    wait_for(Duration::from_secs(10), answers).expect("PulseAudio answers");
    let signal_file = bench.path("signal.raw");
    std::fs::write(&signal_file, played(60)).unwrap();
    let player = program("pacat", &run)
        .args(["--rate", &RATE.to_string(), "--channels", "2", "--format", "s16le", "-d", "bench", text(&signal_file)])
        .spawn();
    let _player = Ended(player.unwrap());

    let names = bench.write(
        "asound.conf",
        "</usr/share/alsa/alsa.conf>\npcm.bench {\n type pulse\n device \"bench.monitor\"\n\
         hint { show on  description \"333D01 in the test\" }\n}\n",
    );
    bench.write(
        "card.toml",
        &format!(
            "format = \"gearwatch-bench/1\"\nname = \"card\"\nmotor = {{ speed_hz = 50.0 }}\n\
             shaft = [{{ name = \"input\" }}, {{ name = \"output\" }}]\n\
             stage = [{{ name = \"stage1\", pinion = {{ teeth = 20 }}, wheel = {{ teeth = 40 }} }}]\nbrake = {{ torque_nm = 10.0 }}\n\
             sensor = [{{ name = \"acc_1\", shaft = \"input\" }}]\nacquisition = {{ sample_rate_hz = {RATE}.0 }}\n"
        ),
    );
    let config = bench.write(
        "service.toml",
        &format!(
            "format = \"gearwatch-service/1\"\nservice = {{ self_test = false }}\n[[bench]]\nfile = \"card.toml\"\n\
             [[bench.source]]\nkind = \"sound_card\"\ndevice = \"333D01\"\nsample_rate_hz = {RATE}.0\n\
             channels = [{{ input = 1, sensor = \"acc_1\", full_scale = {FULL_SCALE:?}, unit = \"m/s^2\" }}]\n\
             [[sink]]\nkind = \"stdout\"\n"
        ),
    );
    let lines = bench.path("lines.jsonl");
    let mut child = gearwatch(&["run", "--config", text(&config)])
        .env("XDG_RUNTIME_DIR", &run)
        .env("HOME", &run)
        .env("ALSA_CONFIG_PATH", &names)
        .stdout(std::fs::File::create(&lines).unwrap())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    std::thread::sleep(Duration::from_secs(12));
    signal(&child, "TERM");
    assert_eq!(ended_within(&mut child, Duration::from_secs(5)).and_then(|s| s.code()), Some(0));
    let lines = std::fs::read_to_string(&lines).unwrap();
    let verdicts: Vec<serde_json::Value> = lines.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    println!("{} windows, the last {}", verdicts.len(), verdicts.last().unwrap());
    assert!(verdicts.len() >= 12, "{} windows in 12 s", verdicts.len());
    for verdict in &verdicts {
        assert_eq!(verdict["instrument"], "ok", "{verdict}");
        for (key, share) in [("amp_1x", PLAYED[0]), ("amp_2x", PLAYED[1])] {
            let (found, expected) = (verdict[key].as_f64().unwrap(), share * FULL_SCALE);
            // The resampling of PulseAudio and 16 bits: far below a thousandth.
            assert!((found / expected - 1.0).abs() < 1e-3, "{key} {found}, expected {expected}");
        }
    }
}
