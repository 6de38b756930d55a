//! Files that hold one channel each of the same recording, as one source.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::bail;
use gearwatch_core::block::{Packet, UnixNanos};
use gearwatch_core::source::Source;
use gearwatch_io::ReadError;
use gearwatch_io::summary::{ChannelSummary, Summary};

use crate::input::{InputOptions, Watched};

/// Rates of one recording differ by less (relative): text rounds them.
const SAME_RATE: f64 = 1e-6;

/// One of the files.
struct Part {
    source: Watched,
    /// Names of its channels in the recording, by those in the file.
    names: BTreeMap<String, Arc<str>>,
    next: Option<Packet>,
    /// Operating points and tachos are taken from the first file that has them.
    states_point: bool,
    tachos: BTreeSet<String>,
}

/// The files as one recording, packets in the order of time.
pub struct Joined {
    parts: Vec<Part>,
}

impl Joined {
    /// Looks through all files, and refuses what cannot be one recording.
    ///
    /// # Errors
    /// When a file cannot be read, or rates, beginnings or lengths differ.
    pub fn open(files: &[PathBuf], options: &InputOptions) -> anyhow::Result<Self> {
        let all = files.iter().map(|path| look_through(path, options)).collect::<anyhow::Result<Vec<_>>>()?;
        same_recording(files, &all)?;
        // A name that two files have says nothing: the file's own name does.
        let mut count: BTreeMap<&str, usize> = BTreeMap::new();
        for name in all.iter().flat_map(|summary| summary.channels.keys()) {
            *count.entry(name).or_default() += 1;
        }
        let mut taken: BTreeSet<String> = BTreeSet::new();
        let mut parts = Vec::with_capacity(files.len());
        let (mut pointed, mut turning) = (false, BTreeSet::new());
        for (path, Summary { channels, tachos, operating_points }) in files.iter().zip(&all) {
            let stem = stem(path);
            let mut names = BTreeMap::new();
            for name in channels.keys() {
                let new = match (count.get(name.as_str()), channels.len()) {
                    (Some(1), _) => name.clone(),
                    (_, 1) => stem.clone(),
                    _ => format!("{stem}.{name}"),
                };
                if !taken.insert(new.clone()) {
                    bail!(
                        "{}: channel {name:?} would be called {new:?}, as one of another file is; name it in {}.toml",
                        path.display(),
                        path.display()
                    );
                }
                names.insert(name.clone(), Arc::from(new));
            }
            let has_point = operating_points.is_some();
            let own: BTreeSet<String> =
                tachos.keys().filter(|shaft| turning.insert((*shaft).clone())).cloned().collect();
            parts.push(Part {
                source: options.open(path)?,
                names,
                next: None,
                states_point: has_point && !pointed,
                tachos: own,
            });
            pointed |= has_point;
        }
        for part in &mut parts {
            part.advance()?;
        }
        Ok(Self { parts })
    }

    /// What is doubtful about each file, in their order.
    pub fn warnings(&self) -> Vec<Vec<String>> {
        self.parts.iter().map(|part| part.source.opened().warnings()).collect()
    }
}

/// The name of a file up to its first dot.
fn stem(path: &Path) -> String {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    name.split('.').next().unwrap_or_default().to_owned()
}

fn look_through(path: &Path, options: &InputOptions) -> anyhow::Result<Summary> {
    match Summary::read(&mut options.open(path)?) {
        (_, Some(error)) => Err(error.into()),
        (summary, None) if summary.channels.is_empty() => bail!("{}: there is no channel in it", path.display()),
        (summary, None) => Ok(summary),
    }
}

/// Channels of one recording begin together, run at one rate and are of one length.
fn same_recording(files: &[PathBuf], all: &[Summary]) -> anyhow::Result<()> {
    let named = |(path, summary): (&PathBuf, &'_ Summary)| {
        let path = path.display().to_string();
        summary.channels.iter().map(|(name, c)| (format!("{path}: channel {name:?}"), c.clone())).collect::<Vec<_>>()
    };
    let each: Vec<(String, ChannelSummary)> = files.iter().zip(all).flat_map(named).collect();
    let Some((first, known)) = each.first() else { return Ok(()) };
    for (place, other) in &each {
        let (rate, other_rate) = (known.sample_rate_hz, other.sample_rate_hz);
        if (other_rate / rate - 1.0).abs() > SAME_RATE {
            bail!("{place} has {other_rate} samples a second, {first} {rate}; channels of one recording have one rate");
        }
        let late_s = other.start_ns.saturating_sub(known.start_ns) as f64 * 1e-9;
        if late_s.abs() * rate > 0.5 {
            bail!("{place} begins {late_s:+.6} s after {first}; channels of one recording begin together");
        }
        if other.samples != known.samples {
            bail!(
                "{place} has {} samples, {first} {}; channels of one recording are of one length",
                other.samples,
                known.samples
            );
        }
    }
    Ok(())
}

impl Part {
    fn advance(&mut self) -> Result<(), ReadError> {
        loop {
            self.next = self.source.next_packet()?;
            match &mut self.next {
                Some(Packet::Vibration(block)) => {
                    if let Some(name) = self.names.get(&*block.sensor) {
                        block.sensor = name.clone();
                    }
                    return Ok(());
                }
                Some(Packet::Tacho(block)) if !self.tachos.contains(&*block.shaft) => {}
                Some(Packet::OperatingPoint(_)) if !self.states_point => {}
                Some(_) | None => return Ok(()),
            }
        }
    }

    fn time(&self) -> Option<UnixNanos> {
        self.next.as_ref().map(|packet| match packet {
            Packet::Vibration(block) => block.t0,
            Packet::Tacho(block) => block.t0,
            Packet::OperatingPoint(point) => point.t,
        })
    }
}

impl Source for Joined {
    type Error = ReadError;

    fn next_packet(&mut self) -> Result<Option<Packet>, ReadError> {
        let Some(part) = self.parts.iter_mut().filter(|part| part.next.is_some()).min_by_key(|part| part.time()) else {
            return Ok(None);
        };
        let packet = part.next.take();
        part.advance()?;
        Ok(packet)
    }
}
