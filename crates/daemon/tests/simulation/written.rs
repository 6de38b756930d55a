//! The configuration as people write it: right or wrong, and read by the service's own reader.

use std::path::Path;

use gearwatch_daemon::config::Config;
use gearwatch_log::{Compression, LogConfig};

use crate::trouble::Chance;

/// A service file whose log has these keys.
pub fn text(log: &LogConfig) -> String {
    let LogConfig { group_ms, queue_records, rotate_bytes, rotate_secs, .. } = log;
    let compression = match log.compression {
        Compression::None => "none",
        Compression::Zstd => "zstd",
    };
    format!(
        "format = \"gearwatch-service/1\"\n[[bench]]\nfile = \"bench.toml\"\n[[bench.source]]\nkind = \"test_signal\"\n\
         [[sink]]\nkind = \"mcap_log\"\ngroup_ms = {group_ms}\nqueue_records = {queue_records}\nrotate_bytes = {rotate_bytes}\n\
         rotate_secs = {rotate_secs}\ncompression = \"{compression}\"\n"
    )
}

/// Reads a service file as the service does, and gives what it says of the log.
pub fn read(text: &str) -> Result<LogConfig, String> {
    let config = Config::parse(text, "service.toml", Path::new("")).map_err(|e| e.to_string())?;
    // What the service takes it for, with all defaults.
    let shown: toml::Table = toml::from_str(&config.shown()).map_err(|e| e.to_string())?;
    // A text that was cut before the log is right, and a service without a log; such a world has
    // nothing to judge, and does not take it.
    let sink = shown
        .get("sink")
        .and_then(toml::Value::as_array)
        .and_then(|sinks| sinks.first())
        .and_then(toml::Value::as_table);
    let mut keys = sink.cloned().ok_or("there is no log")?;
    for key in ["kind", "name", "queue", "when_full"] {
        keys.remove(key);
    }
    keys.try_into().map_err(|e| e.to_string())
}

/// The keys of a log that somebody changes.
pub fn changed(log: &LogConfig, chance: &mut Chance) -> LogConfig {
    LogConfig {
        group_ms: chance.between(20, 1000),
        queue_records: chance.between(4, 64) as usize,
        rotate_bytes: chance.between(4, 64) << 10,
        rotate_secs: chance.between(20, 90),
        compression: match log.compression {
            Compression::None => Compression::Zstd,
            Compression::Zstd => Compression::None,
        },
        ..log.clone()
    }
}

/// A slip of the pen.
pub fn spoilt(text: &str, chance: &mut Chance) -> String {
    match chance.below(5) {
        0 => text.replace("group_ms", "grup_ms"),
        1 => text.replace("rotate_bytes = ", "rotate_bytes = -"),
        2 => text.replace("rotate_secs = ", "rotate_secs = 1000"),
        3 => text.replace("gearwatch-service/1", "gearwatch-service/9"),
        // An editor that had written half of it; may be right by chance.
        _ => text[..chance.below(text.len() as u64) as usize].to_owned(),
    }
}
