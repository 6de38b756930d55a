//! One channel's spectra and the times of its raw data in files that are not in the levels, or that
//! the levels show too coarsely.

use std::collections::BTreeMap;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::time::Duration;

use gearwatch_io::mcap::contract::VIBRATION_PREFIX;
use gearwatch_io::mcap::walk::{Limits, Walk};

use crate::extent::Extent;
use crate::raw::Stretches;
use crate::spectra::{LoggedSpectrum, Spectrum};

/// Files that are remembered.
const MOST: usize = 64;

/// What a file holds of one channel.
#[derive(Clone, Debug)]
pub(crate) struct Glance {
    pub(crate) spectra: Vec<Spectrum>,
    pub(crate) raw: Vec<(i64, i64)>,
    extent: Extent,
}

impl Glance {
    pub(crate) fn of(path: &Path, bench: &str, channel: &str) -> Self {
        let extent = Extent::of(path);
        let (mut spectra, mut stretches) = (Vec::new(), Stretches::default());
        if let Ok(file) = gearwatch_io::text::open_regular(path) {
            let mut walk = Walk::new(BufReader::with_capacity(1 << 20, file), Limits::default());
            // A log of several benches names the bench in the topic.
            let spectrum = [format!("/spectrum/{channel}"), format!("/spectrum/{bench}/{channel}")];
            let raw = format!("{VIBRATION_PREFIX}{channel}");
            // A file that is being written ends in the middle.
            while let Ok(Some(message)) = walk.next_message() {
                if message.channel.topic == raw {
                    stretches.push(channel, i64::try_from(message.log_time).unwrap_or(i64::MAX));
                } else if spectrum.contains(&message.channel.topic) {
                    let logged = serde_json::from_slice::<LoggedSpectrum>(message.data);
                    let own = logged.ok().filter(|logged| logged.bench == bench || logged.bench.is_empty());
                    spectra.extend(own.and_then(LoggedSpectrum::kept));
                }
            }
        }
        spectra.sort_by_key(|spectrum| spectrum.t0_ns);
        Self { spectra, raw: stretches.0.remove(channel).unwrap_or_default(), extent }
    }
}

/// What was glanced at lately.
#[derive(Debug, Default)]
pub(crate) struct Glances(BTreeMap<(PathBuf, String, String), Glance>);

impl Glances {
    /// What is known of a file, where that is not too old; `open`: it is being written.
    pub(crate) fn get(&self, path: &Path, bench: &str, channel: &str, open: bool, again: Duration) -> Option<Glance> {
        let kept = self.0.get(&(path.to_owned(), bench.to_owned(), channel.to_owned()))?;
        (!kept.extent.is_behind(path, open, again)).then(|| kept.clone())
    }

    pub(crate) fn put(&mut self, path: &Path, bench: &str, channel: &str, glance: Glance) {
        self.0.insert((path.to_owned(), bench.to_owned(), channel.to_owned()), glance);
        while self.0.len() > MOST {
            let oldest = self.0.iter().min_by_key(|(_, glance)| glance.extent.read()).map(|(key, _)| key.clone());
            let Some(oldest) = oldest else { return };
            self.0.remove(&oldest);
        }
    }
}
