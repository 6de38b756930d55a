//! The memory of `batch` and `diagnose` does not grow with a recording: `just campaign-memory`.

use std::process::{Command, Stdio};
use std::time::Duration;

use crate::fixture::gearwatch;
use crate::long::{bench, megabytes, record};

/// Ends the command well and gives the largest resident memory that it had (MB).
fn peak_mb(mut command: Command) -> f64 {
    let mut child = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    let status = format!("/proc/{}/status", child.id());
    let mut peak_kib = 0.0_f64;
    loop {
        let text = std::fs::read_to_string(&status).unwrap_or_default();
        let line = text.lines().find_map(|line| line.strip_prefix("VmHWM:"));
        let kib = line.and_then(|line| line.trim().trim_end_matches(" kB").parse().ok());
        peak_kib = peak_kib.max(kib.unwrap_or(0.0));
        if let Some(status) = child.try_wait().unwrap() {
            assert!(matches!(status.code(), Some(0..=2)), "{status}");
            return peak_kib * 1.024e-3;
        }
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// A recording of 4 GiB (or of `GEARWATCH_MEMORY_MIB`) beside one of 100 MB.
#[test]
#[ignore = "writes 4 GiB and works minutes: just campaign-memory"]
fn conform_memory_does_not_grow_with_a_recording() {
    let mib = std::env::var("GEARWATCH_MEMORY_MIB").ok().and_then(|text| text.parse().ok()).unwrap_or(4096);
    let bench = bench();
    let paths = [record(&bench, "short.mcap", 1, 100_000_000), record(&bench, "long.mcap", 1, mib << 20)];
    let judged = ["--bench", "bench.toml", "--baseline", "baseline.json"];
    let commands: [(&str, &[&str]); 3] =
        [("batch", &["--out", "out"]), ("diagnose", &[]), ("diagnose", &["--windows"])];
    for (name, more) in commands {
        let peaks = paths.each_ref().map(|path| {
            let mut command = gearwatch(&[name]);
            command.arg(path.file_name().unwrap()).args(judged).args(more).current_dir(bench.path(""));
            peak_mb(command)
        });
        eprintln!(
            "{name} {}: {:.0} MB with a recording of {:.0} MB, {:.0} MB with one of {:.0} MB",
            more.join(" "),
            peaks[0],
            megabytes(&paths[0]),
            peaks[1],
            megabytes(&paths[1])
        );
        // A short recording does not fill a row group of the table, which takes some 30 MB; what
        // grew with the recording would be hundreds of megabytes here.
        assert!(peaks[1] < 1.2 * peaks[0] + 40.0, "{name} {more:?} grows with the recording");
    }
}
