//! What a log of the service carries with it.

use std::path::Path;

use gearwatch_log::{Attachment, Context};

use crate::bench::WatchedBench;
use crate::config::Config;

/// What a log needs to be understood without this machine.
pub(super) fn log_context(config: &Config, benches: &[WatchedBench]) -> Context {
    let attachment = |name: String, media_type: &str, text: String| Attachment {
        name,
        media_type: media_type.to_owned(),
        data: text.into_bytes(),
    };
    let mut attachments = vec![attachment("service.toml".to_owned(), "application/toml", config.shown())];
    for bench in benches {
        if let Ok(text) = toml::to_string(&*bench.bench) {
            attachments.push(attachment(format!("{}.bench.toml", bench.name), "application/toml", text));
        }
        let name = format!("{}.baseline.json", bench.name);
        let baseline = bench.baseline.as_ref();
        if let Some(Ok(text)) = baseline.map(|b| gearwatch_io::baseline_file::to_text(b, Path::new(&name))) {
            attachments.push(attachment(name, "application/json", text));
        }
    }
    let facts = [("gearwatch".to_owned(), env!("CARGO_PKG_VERSION").to_owned())].into();
    Context { attachments, facts }
}
