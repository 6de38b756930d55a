//! A folder with a bench file and short simulated recordings of it.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use gearwatch_core::block::Packet;
use gearwatch_core::source::Source;
use gearwatch_io::OpenOptions;
use gearwatch_io::mcap::{Compression, McapWriter, PublishTime};

/// Settings of most tests: two speeds (Hz) and two loads (N m).
pub const POINTS: [(f64, f64); 4] = [(18.0, 40.0), (18.0, 80.0), (30.0, 40.0), (30.0, 80.0)];

/// The bench of the walk-through, sampled slowly so that everything is quick.
pub fn bench() -> String {
    let bench = include_str!("../../../../examples/walk-through/bench.toml");
    format!("{bench}\n[acquisition]\nsample_rate_hz = 8192.0\n")
}

pub struct Folder(tempfile::TempDir);

impl Folder {
    /// With `bench.toml`.
    pub fn new() -> Self {
        let folder = Self(tempfile::tempdir().unwrap());
        folder.write("bench.toml", &bench());
        folder
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub fn write(&self, name: &str, text: &str) -> PathBuf {
        let path = self.path(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, text).unwrap();
        path
    }

    pub fn read(&self, name: &str) -> String {
        std::fs::read_to_string(self.path(name)).unwrap_or_else(|e| panic!("{name}: {e}"))
    }

    pub fn run(&self, args: &[&str]) -> Output {
        gearwatch(self.0.path(), args)
    }

    /// Simulates a recording of a bench file at a setting: three seconds, with the noise of a usual
    /// machine.
    pub fn simulate(&self, bench: &str, name: &str, (speed, torque): (f64, f64), seed: u64, more: &[&str]) {
        std::fs::create_dir_all(self.path(name).parent().unwrap()).unwrap();
        let (speed, torque, seed) = (speed.to_string(), torque.to_string(), seed.to_string());
        let args = ["simulate", bench, "--speed", &speed, "--torque", &torque, "--seed", &seed, "-o", name];
        // A test may ask for another length, or other noise.
        let length: &[&str] = if more.contains(&"--duration") { &[] } else { &["--duration", "3"] };
        let noise: &[&str] = if more.contains(&"--background") { &[] } else { &["--background", "0.2"] };
        let done = self.run(&[&args[..], length, noise, more].concat());
        assert_eq!(done.status.code(), Some(0), "{}", stderr(&done));
    }

    /// A recording at each of [`POINTS`] in a folder; settings of another `seed` repeat to a tenth
    /// of a per cent.
    pub fn session(&self, bench: &str, folder: &str, seed: u64, more: &[&str]) {
        for (n, (speed, torque)) in POINTS.into_iter().enumerate() {
            let off = 1.0 + 1e-3 * ((seed as f64 * 0.37 + n as f64 * 0.61).fract() - 0.5);
            let name = format!("{folder}/{speed}hz-{torque}nm.mcap");
            self.simulate(bench, &name, (speed * off, torque * off), 10 * seed + n as u64, more);
        }
    }

    /// A recording whose packets are changed, or left out.
    pub fn changed(&self, from: &str, to: &str, mut change: impl FnMut(Packet) -> Option<Packet>) {
        std::fs::create_dir_all(self.path(to).parent().unwrap()).unwrap();
        let mut source = gearwatch_io::open(&self.path(from), &OpenOptions::default()).unwrap();
        let file = std::io::BufWriter::new(std::fs::File::create(self.path(to)).unwrap());
        let mut writer = McapWriter::new(file, Compression::Zstd, PublishTime::LogTime).unwrap();
        while let Some(packet) = source.next_packet().unwrap() {
            if let Some(packet) = change(packet) {
                writer.write(&packet).unwrap();
            }
        }
        writer.finish().unwrap();
    }

    /// `gearwatch explain` with `--out answer`: exit code, what was said, the explanation.
    pub fn explain(&self, args: &[&str]) -> Answer {
        let done = self.run(&[&["explain"], args, &["--out", "answer", "--force"]].concat());
        let said = format!("{}{}", stdout(&done), stderr(&done));
        assert!(matches!(done.status.code(), Some(0 | 1)), "{args:?}: {:?}\n{said}", done.status.code());
        let json = serde_json::from_str(&self.read("answer/explanation.json")).unwrap();
        Answer { code: done.status.code(), said, json }
    }
}

pub struct Answer {
    pub code: Option<i32>,
    pub said: String,
    pub json: serde_json::Value,
}

impl Answer {
    pub fn status(&self) -> &str {
        self.json["status"].as_str().unwrap()
    }

    /// Named effects with their places.
    pub fn named(&self) -> Vec<(String, String)> {
        self.json["effects"].as_array().unwrap().iter().map(candidate).collect()
    }

    pub fn limits(&self) -> Vec<&str> {
        self.json["limits"].as_array().map(|all| all.iter().map(|l| l.as_str().unwrap()).collect()).unwrap_or_default()
    }
}

fn candidate(value: &serde_json::Value) -> (String, String) {
    (value["effect"].as_str().unwrap().into(), value["where"].as_str().unwrap().into())
}

pub fn gearwatch(folder: &Path, args: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_gearwatch"));
    command.current_dir(folder).args(args).env("NO_COLOR", "1").output().expect("the binary runs")
}

pub fn stdout(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

pub fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}
