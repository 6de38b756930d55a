//! A service under load that writes a log, and what can be seen of it from outside.

use std::collections::BTreeMap;
use std::io::Read;
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use gearwatch_daemon::snapshot::{SinkSnapshot, Snapshot};

use crate::fixture::{Bench, gearwatch, text};

/// How many rounds: few in the normal run, all in a campaign.
pub fn rounds(few: u64) -> u64 {
    std::env::var("GEARWATCH_ROUNDS").ok().and_then(|text| text.parse().ok()).unwrap_or(few)
}

/// Moments that follow from a seed: the campaign can be repeated, but for what the machine itself
/// does.
pub struct Moments(u64);

impl Moments {
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// Between two durations.
    pub fn between(&mut self, least: Duration, most: Duration) -> Duration {
        // Steele, Lea, Flood: SplitMix64.
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        let share = ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64;
        least + (most - least).mul_f64(share)
    }
}

/// Writes the configuration of a service whose log goes to `folder`; its test signal runs at this
/// multiple of real time.
pub fn configure(bench: &Bench, folder: &Path, speed: &str, further: &str) -> std::path::PathBuf {
    bench.write(
        "service.toml",
        &format!(
            "format = \"gearwatch-service/1\"\nservice = {{ workers = 2, status_socket = \"status.sock\", self_test = false }}\n\
             [[bench]]\nfile = \"bench.toml\"\n[[bench.source]]\nkind = \"test_signal\"\nspeed = {speed}\n\
             [[sink]]\nkind = \"mcap_log\"\nfolder = \"{}\"\n{further}",
            text(folder)
        ),
    )
}

/// Starts a service.
pub fn start(config: &Path) -> Child {
    gearwatch(&["run", "--config", text(config)]).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap()
}

/// How the service is, if it answers.
pub fn status(bench: &Bench) -> Option<Snapshot> {
    let mut stream = UnixStream::connect(bench.path("status.sock")).ok()?;
    stream.set_read_timeout(Some(Duration::from_secs(2))).ok()?;
    let mut answer = String::new();
    stream.read_to_string(&mut answer).ok()?;
    serde_json::from_str(&answer).ok()
}

/// What the log says of itself.
pub fn log_of(snapshot: &Snapshot) -> Option<&SinkSnapshot> {
    snapshot.sinks.iter().find(|sink| sink.name == "mcap_log")
}

/// A figure of a sink.
pub fn figure(sink: &SinkSnapshot, what: &str) -> Option<u64> {
    sink.figures.iter().find(|(name, _)| name == what).map(|&(_, value)| value as u64)
}

/// Asks until `wanted` gives an answer; `None` when that takes longer than `limit`.
pub fn wait_for<T>(limit: Duration, mut wanted: impl FnMut() -> Option<T>) -> Option<T> {
    let begin = Instant::now();
    loop {
        if let Some(found) = wanted() {
            return Some(found);
        }
        if begin.elapsed() > limit {
            return None;
        }
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Sends a signal by name.
pub fn signal(child: &Child, name: &str) {
    let sent = std::process::Command::new("kill").args([&format!("-{name}"), &child.id().to_string()]).status();
    assert!(sent.unwrap().success());
}

/// Waits for the end; `None` when it takes longer.
pub fn ended_within(child: &mut Child, limit: Duration) -> Option<std::process::ExitStatus> {
    let ended = wait_for(limit, || child.try_wait().unwrap());
    if ended.is_none() {
        child.kill().unwrap();
        child.wait().unwrap();
    }
    ended
}

/// What the service said on stderr; it must have ended.
pub fn said(child: &mut Child) -> String {
    let mut text = String::new();
    if let Some(mut stderr) = child.stderr.take() {
        stderr.read_to_string(&mut text).unwrap();
    }
    text
}

/// All files of a log.
pub fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let logs = entries.filter(|path| path.extension().is_some_and(|end| end == "mcap"));
    logs.map(|path| (path.file_name().unwrap().to_str().unwrap().to_owned(), std::fs::read(&path).unwrap())).collect()
}
