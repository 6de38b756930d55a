//! Several benches and sources in one service: what dies takes nothing else with it.

use std::io::Read;
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use gearwatch_daemon::config::Config;
use gearwatch_daemon::emulate::InstrumentConfig;
use gearwatch_daemon::service::{Service, Summary};
use gearwatch_daemon::snapshot::{BenchSnapshot, Snapshot};
use gearwatch_daemon::stop::Stop;

use super::support::{instrument, runtime, wait_until};

/// One stage that meshes at 100 Hz, sampled so slowly that everything is quick.
pub fn bench_file(folder: &Path, file: &str, name: &str) {
    let text = format!(
        "format = \"gearwatch-bench/1\"\nname = {name:?}\nmotor = {{ speed_hz = 5.0 }}\n\
         shaft = [{{ name = \"input\" }}, {{ name = \"output\" }}]\n\
         stage = [{{ name = \"stage1\", pinion = {{ teeth = 20 }}, wheel = {{ teeth = 40 }} }}]\n\
         brake = {{ torque_nm = 10.0 }}\nsensor = [{{ name = \"acc_1\", shaft = \"input\" }}]\n\
         tacho = {{ shaft = \"input\" }}\nacquisition = {{ sample_rate_hz = 2048.0 }}\n"
    );
    std::fs::write(folder.join(file), text).unwrap();
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

/// Two benches, one fed by an instrument whose plug is pulled: it is NOT OK within two deadlines, comes back when the instrument does, and
/// the other bench misses no window and no sample.
#[test]
fn conform_a_dead_instrument_leaves_the_other_bench_alone() {
    const DEADLINE_SECS: f64 = 1.0;
    let runtime = runtime();
    let first = instrument(&runtime, 1.0, InstrumentConfig::default());
    let address = first.address();
    let folder = tempfile::tempdir().unwrap();
    bench_file(folder.path(), "one.toml", "one");
    bench_file(folder.path(), "two.toml", "two");
    let text = format!(
        "format = \"gearwatch-service/1\"\n[service]\nstatus_socket = \"s.sock\"\nself_test = false\n\
         [[bench]]\nfile = \"one.toml\"\n[[bench.source]]\nkind = \"lanxi\"\naddress = \"{address}\"\nsample_rate_hz = 16384.0\n\
         data_deadline_secs = {DEADLINE_SECS:?}\nchannels = [{{ input = 1, sensor = \"acc_1\" }}]\n\
         [[bench]]\nfile = \"two.toml\"\n[[bench.source]]\nkind = \"test_signal\"\n"
    );
    let running = Running::start(folder, &text);
    wait_until("both deliver", || running.bench("one").windows_judged > 0 && running.bench("two").windows_judged > 0);
    drop(first);
    let pulled = Instant::now();
    wait_until("the first is not all right", || running.bench("one").instrument == "silent");
    let told = pulled.elapsed().as_secs_f64();
    // The state is published once a second.
    assert!(told < 2.0 * DEADLINE_SECS + 1.0, "{told}");
    assert_eq!(running.bench("one").machine, "unknown");
    let before = running.bench("two").windows_judged;
    wait_until("the second goes on", || running.bench("two").windows_judged > before + 1);
    let config = InstrumentConfig { listen: address, ..InstrumentConfig::default() };
    let mut second = None;
    wait_until("the port is free", || {
        let config = config.clone();
        second = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| instrument(&runtime, 1.0, config))).ok();
        second.is_some()
    });
    wait_until("the first is back", || running.bench("one").sources[0].state == "running");
    wait_until("the outage is a gap", || running.bench("one").gaps == 1);
    let one = running.bench("one");
    assert!(one.samples_missing > 0 && one.sources[0].opened >= 2, "{one:?}");
    let two = running.bench("two");
    assert_eq!((two.gaps, two.samples_missing, two.windows_shed, two.sources[0].dropped), (0, 0, 0, 0));
    assert_eq!(two.sources[0].state, "running");
    let stopping = Instant::now();
    let summary = running.stop();
    assert!(summary.stopped && summary.failed.is_empty(), "{summary:?}");
    assert!(stopping.elapsed() < Duration::from_secs(3));
    let stats = second.unwrap();
    assert_eq!(stats.stats().closed_in_order.load(std::sync::atomic::Ordering::Relaxed), 1, "left idle");
}
