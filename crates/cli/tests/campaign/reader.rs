//! The log opens in the official Python reader with the same counts and values.

use std::process::Command;
use std::time::Duration;

use gearwatch_core::block::Packet;
use gearwatch_core::source::Source;

use crate::fixture::{Bench, text};
use crate::service::{configure, ended_within, files, signal, start};

/// Counts by topic, the sum of all window numbers, and of the samples of all raw blocks.
const READ: &str = r#"
import json, pathlib, sys
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
counts, windows, samples, ranks = {}, 0, 0, {}
for path in sorted(pathlib.Path(sys.argv[1]).glob("*.mcap")):
    with open(path, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        assert reader.get_header().profile == "gearwatch", path
        assert reader.get_summary().statistics.message_count > 0, path
        names = [a.name for a in reader.iter_attachments()]
        assert "service.toml" in names, names
        for schema, channel, message in reader.iter_messages():
            counts[channel.topic] = counts.get(channel.topic, 0) + 1
            if channel.topic.endswith("/rank"):
                verdict = json.loads(message.data)
                windows += verdict["window"]
                ranks[verdict["rank_1x"]] = ranks.get(verdict["rank_1x"], 0) + 1
        file.seek(0)
        for schema, channel, message, block in make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages(topics=["/vib/acc_1"]):
            samples += len(block.samples) + len(block.counts)
print(json.dumps({"counts": counts, "windows": windows, "samples": samples, "ranks": ranks}))
"#;

#[test]
fn conform_the_python_reader_sees_the_same() {
    let there = Command::new("python3").args(["-c", "import mcap.reader, mcap_protobuf.decoder"]).output();
    if !there.is_ok_and(|output| output.status.success()) {
        eprintln!("skipped: python3 with mcap and mcap-protobuf-support is not installed");
        return;
    }
    let bench = Bench::new();
    let folder = bench.path("log");
    let config = configure(&bench, &folder, "20.0", "rotate_bytes = 262144\nraw = { keep = \"all\" }");
    let mut child = start(&config);
    std::thread::sleep(Duration::from_secs(3));
    signal(&child, "TERM");
    assert_eq!(ended_within(&mut child, Duration::from_secs(5)).and_then(|s| s.code()), Some(0));
    let read = Command::new("python3").args(["-c", READ, text(&folder)]).output().unwrap();
    assert!(read.status.success(), "{}", String::from_utf8_lossy(&read.stderr));
    let theirs: serde_json::Value = serde_json::from_slice(&read.stdout).unwrap();
    let mut counts = std::collections::BTreeMap::<String, u64>::new();
    let (mut windows, mut samples) = (0, 0);
    for (name, bytes) in files(&folder) {
        for message in mcap::MessageStream::new(&bytes).unwrap().map(|m| m.unwrap_or_else(|e| panic!("{name}: {e}"))) {
            *counts.entry(message.channel.topic.clone()).or_default() += 1;
            if message.channel.topic.ends_with("/rank") {
                let verdict: serde_json::Value = serde_json::from_slice(&message.data).unwrap();
                windows += verdict["window"].as_u64().unwrap();
            }
        }
        let mut opened = gearwatch_io::open(&folder.join(&name), &gearwatch_io::OpenOptions::default()).unwrap();
        while let Some(packet) = opened.next_packet().unwrap() {
            if let Packet::Vibration(block) = packet
                && &*block.sensor == "acc_1"
            {
                samples += block.samples.len();
            }
        }
    }
    assert_eq!(theirs["counts"], serde_json::to_value(&counts).unwrap());
    assert_eq!(theirs["windows"], windows);
    assert_eq!(theirs["samples"], samples);
    assert!(samples > 50_000 && counts["/gear/stage1/rank"] > 50, "{counts:?}");
}
