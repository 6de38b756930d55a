//! The program, run to its end, and the smallest bench.

use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

/// Long enough for a loaded machine; what it bounds waited for ever.
const PATIENCE: Duration = Duration::from_secs(60);

/// Runs the program to its end, or kills it after [`PATIENCE`].
pub fn gearwatch(folder: &Path, args: &[&str]) -> Output {
    let mut child = Command::new(env!("CARGO_BIN_EXE_gearwatch"))
        .current_dir(folder)
        .args(args)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the binary runs");
    let begin = Instant::now();
    while child.try_wait().unwrap().is_none() {
        if begin.elapsed() > PATIENCE {
            child.kill().unwrap();
            panic!("{args:?} did not end");
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    child.wait_with_output().unwrap()
}

pub fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// One stage, one sensor.
pub const BENCH: &str = r#"format = "gearwatch-bench/1"
name = "small"
[motor]
speed_hz = 30.0
[[shaft]]
name = "input"
[[shaft]]
name = "output"
[[stage]]
name = "stage1"
pinion = { teeth = 29 }
wheel = { teeth = 100 }
[[sensor]]
name = "acc_1"
shaft = "input"
[brake]
torque_nm = 50.0
"#;
