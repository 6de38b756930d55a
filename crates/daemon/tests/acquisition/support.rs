//! Benches, instruments and a service that is asked how it is.

use std::io::Read;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use gearwatch_daemon::config::Config;
use gearwatch_daemon::service::{Service, Summary};
use gearwatch_daemon::snapshot::{BenchSnapshot, Snapshot};
use gearwatch_emulate::{Instrument, InstrumentConfig, open_source};
use gearwatch_runtime::stop::Stop;
use gearwatch_sources::SourceContext;
use toml::Table;

pub fn runtime() -> tokio::runtime::Runtime {
    tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build().unwrap()
}

/// An instrument that plays the test signal at 16384 samples per second.
pub fn instrument(runtime: &tokio::runtime::Runtime, config: InstrumentConfig) -> Instrument {
    let bench = gearwatch_io::bench_file::parse(&bench_text("played", 16_384.0), Path::new("played")).unwrap();
    let context = SourceContext::new(Arc::new(bench), PathBuf::new(), Stop::default());
    let keys = Table::from_iter([("speed".to_owned(), "max".into())]);
    let config = InstrumentConfig { detection: Duration::from_millis(20), ..config };
    Instrument::start(config, open_source("test_signal", keys, context).unwrap(), runtime.handle()).unwrap()
}

/// Waits until something is so; fails after ten seconds.
pub fn wait_until(what: &str, mut so: impl FnMut() -> bool) {
    let began = Instant::now();
    while !so() {
        assert!(began.elapsed() < Duration::from_secs(10), "{what}: not after ten seconds");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// One stage that meshes at 100 Hz.
fn bench_text(name: &str, rate_hz: f64) -> String {
    format!(
        "format = \"gearwatch-bench/1\"\nname = {name:?}\nmotor = {{ speed_hz = 5.0 }}\n\
         shaft = [{{ name = \"input\" }}, {{ name = \"output\" }}]\n\
         stage = [{{ name = \"stage1\", pinion = {{ teeth = 20 }}, wheel = {{ teeth = 40 }} }}]\n\
         brake = {{ torque_nm = 10.0 }}\nsensor = [{{ name = \"acc_1\", shaft = \"input\" }}]\n\
         tacho = {{ shaft = \"input\" }}\nacquisition = {{ sample_rate_hz = {rate_hz:?} }}\n"
    )
}

/// Sampled so slowly that everything is quick.
pub fn bench_file(folder: &Path, file: &str, name: &str) {
    std::fs::write(folder.join(file), bench_text(name, 2048.0)).unwrap();
}

/// A service on a thread, asked by its status socket.
pub struct Running {
    folder: tempfile::TempDir,
    stop: Stop,
    thread: JoinHandle<Summary>,
}

impl Running {
    pub fn start(folder: tempfile::TempDir, text: &str) -> Self {
        let config = Config::parse(text, "test", folder.path()).unwrap();
        let stop = Stop::default();
        let told = stop.clone();
        let thread = std::thread::spawn(move || Service::build(config, &told).unwrap().run(&told).unwrap());
        let out = Self { folder, stop, thread };
        wait_until("the service answers", || out.ask().is_some_and(|snapshot| !snapshot.benches.is_empty()));
        out
    }

    fn ask(&self) -> Option<Snapshot> {
        let mut socket = UnixStream::connect(self.folder.path().join("s.sock")).ok()?;
        let mut text = String::new();
        socket.read_to_string(&mut text).ok()?;
        serde_json::from_str(&text).ok()
    }

    pub fn status(&self) -> Snapshot {
        self.ask().expect("the service answers")
    }

    pub fn bench(&self, name: &str) -> BenchSnapshot {
        self.status().benches.into_iter().find(|bench| bench.name == name).unwrap()
    }

    pub fn stop(self) -> Summary {
        self.stop.now();
        self.thread.join().unwrap()
    }
}
