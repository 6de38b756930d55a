//! Log files of tests: windows with known numbers.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::Path;

use mcap::records::MessageHeader;
use serde_json::{Value, json};

const SECOND: i64 = 1_000_000_000;
/// 2026-11-22T00:00:00Z.
pub(crate) const START: i64 = 1_795_305_600 * SECOND;

/// Topic, time (ns since the epoch) and text.
pub(crate) type Logged = (String, i64, Value);

/// A log file that is being written.
pub(crate) fn begin(folder: &Path, number: usize) -> mcap::Writer<BufWriter<File>> {
    let path = folder.join(format!("gearwatch-{number:08}-{number:012}-20261122T0{number}0000Z.mcap"));
    mcap::Writer::new(BufWriter::new(File::create(path).expect("a file"))).expect("a log")
}

/// Messages in their order, readable from now on.
pub(crate) fn put(log: &mut mcap::Writer<BufWriter<File>>, messages: &[Logged]) {
    for (sequence, (topic, t_ns, value)) in messages.iter().enumerate() {
        let channel_id = log.add_channel(0, topic, "json", &BTreeMap::new()).expect("a channel");
        let time = u64::try_from(*t_ns).expect("after 1970");
        let head = MessageHeader { channel_id, sequence: sequence as u32, log_time: time, publish_time: time };
        log.write_to_known_channel(&head, value.to_string().as_bytes()).expect("written");
    }
    log.flush().expect("flushed");
}

/// A closed log file.
pub(crate) fn write(folder: &Path, number: usize, messages: &[Logged]) {
    let mut log = begin(folder, number);
    put(&mut log, messages);
    log.finish().expect("an end");
}

/// Windows of half a minute from `first` on, of two rows: 1x differs from window to window, 2x is
/// known in every third one, the rest never.
pub(crate) fn windows(first: i64, count: i64) -> Vec<Logged> {
    let mut out = Vec::new();
    for i in first..first + count {
        let t0 = START + i * 30 * SECOND;
        let machine = if i % 3 == 2 { "deviating" } else { "normal" };
        for channel in ["a", "b"] {
            let mut line = json!({
                "bench": "b", "stage": "s", "channel": channel, "unit": "g", "cell": if i % 100 < 50 { "slow" } else { "fast" }, "t0_ns": t0,
                "first_sample_index": i * 30_000, "samples": 60_000, "machine": machine,
                "instrument": if i % 7 == 0 { "overload" } else { "ok" }, "input_speed_hz": 25.0 + 0.01 * (i % 5) as f64, "input_speed_sigma_hz": 0.02,
                "brake_torque_nm": 40.0, "dev_1x_percent": (i * i % 17) as f64, "dev_sigma_1x_percent": 0.5, "amp_1x": 1.0 + 0.001 * i as f64,
                "sigma_1x": 0.01, "level_1x": i % 4, "rms": 3.0 + (i % 2) as f64, "rms_sigma": 0.1,
            });
            if i % 3 == 0 {
                line["dev_2x_percent"] = json!(-2.0 + 0.1 * i as f64);
                line["dev_sigma_2x_percent"] = json!(0.2);
            }
            out.push(("/gear/s/rank".to_owned(), t0, line));
        }
        if i % 2 == 0 {
            let order: Vec<f64> = (0..50).map(|k| f64::from(k) * 0.5).collect();
            let amplitude: Vec<f64> = (0..50).map(|k| 0.001 * f64::from(k + 1) * (1.0 + i as f64)).collect();
            let spectrum = json!({ "bench": "b", "channel": "a", "unit": "g", "t0_ns": t0, "order": order, "amplitude": amplitude });
            out.push(("/spectrum/a".to_owned(), t0, spectrum));
        }
    }
    out
}
