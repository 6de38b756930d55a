//! A small bench, recordings of its built-in test signal, and a baseline learned from one of them.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::Arc;

use gearwatch_core::block::Packet;
use gearwatch_core::pipeline::{Pipeline, PipelineConfig};
use gearwatch_daemon::bench::learn;
use gearwatch_daemon::config::Config;
use gearwatch_io::mcap::{Compression, McapWriter, PublishTime};
use gearwatch_runtime::stop::Stop;
use gearwatch_sources::{Feed, SourceContext};

/// One stage that meshes at 100 Hz, sampled so slowly that everything is quick.
pub const BENCH: &str = r#"
format = "gearwatch-bench/1"
name = "small"
motor = { speed_hz = 5.0 }
shaft = [{ name = "input" }, { name = "output" }]
stage = [{ name = "stage1", pinion = { teeth = 20 }, wheel = { teeth = 40 } }]
brake = { torque_nm = 10.0 }
sensor = [{ name = "acc_1", shaft = "input" }, { name = "acc_2", shaft = "output" }]
tacho = { shaft = "input" }
acquisition = { sample_rate_hz = 2048.0 }
"#;

/// A folder with a bench file; what tests write goes there too.
pub struct Bench {
    folder: tempfile::TempDir,
}

impl Bench {
    pub fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("bench.toml"), BENCH).unwrap();
        Self { folder }
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub fn write(&self, name: &str, text: &str) -> PathBuf {
        let path = self.path(name);
        std::fs::write(&path, text).unwrap();
        path
    }

    /// A key and a certificate for this machine, which is its own authority (PEM). `None`, with a
    /// message, where there is no openssl.
    #[expect(clippy::print_stderr, reason = "tests tell what was skipped")]
    pub fn certificate(&self, name: &str) -> Option<(PathBuf, PathBuf)> {
        let (key, certificate) = (self.path(&format!("{name}.key.pem")), self.path(&format!("{name}.pem")));
        let made = Command::new("openssl")
            .args(["req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes", "-days", "2"])
            .args(["-subj", "/CN=localhost", "-addext", "subjectAltName=DNS:localhost,IP:127.0.0.1"])
            .args(["-addext", "basicConstraints=critical,CA:FALSE", "-keyout", text(&key), "-out", text(&certificate)])
            .output();
        if made.is_ok_and(|output| output.status.success()) {
            return Some((key, certificate));
        }
        eprintln!("skipped: openssl is not installed");
        None
    }

    /// The packets of a test signal with these further keys.
    pub fn packets(&self, keys: &str) -> Vec<Packet> {
        let (config, context) = self.test_signal(keys);
        let Feed::Pull(mut pull) = config.benches[0].sources[0].config.open(&context).unwrap() else {
            panic!("the test signal is pulled")
        };
        std::iter::from_fn(|| pull().unwrap()).collect()
    }

    fn test_signal(&self, keys: &str) -> (Config, SourceContext) {
        let text = format!(
            "format = \"gearwatch-service/1\"\n[[bench]]\nfile = \"bench.toml\"\n\
             [[bench.source]]\nkind = \"test_signal\"\nspeed = \"max\"\nfirst_sample_unix_ns = 1000000000\n{keys}"
        );
        let config = Config::parse(&text, "test signal", self.folder.path()).unwrap();
        let bench = gearwatch_io::bench_file::read(&self.path("bench.toml")).unwrap();
        let context = SourceContext::new(Arc::new(bench), self.folder.path().to_owned(), Stop::default());
        (config, context)
    }

    /// A recording of the test signal, changed by `change`.
    pub fn record(&self, name: &str, keys: &str, mut change: impl FnMut(&mut Packet)) -> PathBuf {
        let path = self.path(name);
        let file = std::io::BufWriter::new(std::fs::File::create(&path).unwrap());
        let mut writer = McapWriter::new(file, Compression::Zstd, PublishTime::LogTime).unwrap();
        for mut packet in self.packets(keys) {
            change(&mut packet);
            writer.write(&packet).unwrap();
        }
        writer.finish().unwrap();
        path
    }

    /// Half a minute of the normal state.
    pub fn healthy(&self) -> PathBuf {
        self.record("healthy.mcap", "duration_secs = 30.0\nseed = 7", |_| {})
    }

    /// A fault of this many percent on 1x to 5x from the beginning.
    pub fn faulty(&self, name: &str, percent: [f64; 5]) -> PathBuf {
        let keys = format!(
            "duration_secs = 12.0\nseed = 9\nfault = {{ after_secs = 0.0, stage = \"stage1\", percent = {percent:?} }}"
        );
        self.record(name, &keys, |_| {})
    }

    /// The baseline of the normal state.
    pub fn baseline(&self) -> PathBuf {
        let path = self.path("baseline.json");
        let (config, context) = self.test_signal("duration_secs = 40.0\nseed = 3");
        let settings = PipelineConfig::default();
        let pipeline = Arc::new(Pipeline::new(&context.bench, &settings, None).unwrap());
        let source = &config.benches[0].sources[0];
        let baseline = learn(source, &context, &pipeline, settings.window.length_s, 1).unwrap();
        std::fs::write(&path, gearwatch_io::baseline_file::to_text(&baseline, &path).unwrap()).unwrap();
        path
    }
}

/// The command, without colours and with little talk. `GEARWATCH_BINARY` puts another build in its
/// place.
pub fn gearwatch(args: &[&str]) -> Command {
    let built = env!("CARGO_BIN_EXE_gearwatch").into();
    let mut command = Command::new(std::env::var_os("GEARWATCH_BINARY").unwrap_or(built));
    command.args(args).env("NO_COLOR", "1").env("GEARWATCH_LOG", "warn");
    command
}

pub fn output(args: &[&str]) -> Output {
    gearwatch(args).output().unwrap()
}

pub fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

pub fn stdout(output: &Output) -> String {
    String::from_utf8(output.stdout.clone()).unwrap()
}

pub fn stderr(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).unwrap()
}
