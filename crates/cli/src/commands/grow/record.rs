//! A recording of each step.

use std::path::{Path, PathBuf};

use anyhow::Context;
use gearwatch_core::block::{Packet, Quality};
use gearwatch_core::source::Source;
use gearwatch_io::mcap::{Compression, McapWriter, PublishTime};
use gearwatch_io::output::{Outputs, Target};
use gearwatch_sim::growth::{Plan, Step};
use gearwatch_sim::scenario::{Course, Scenario};
use gearwatch_sim::source::{SimConfig, Simulator};

use super::super::simulate::START_NS;
use super::table::Of;
use crate::progress::Progress;

/// Where the recordings go.
pub(super) enum Place {
    /// All into one file.
    File(Target),
    /// One a step.
    Folder(PathBuf, Vec<Target>),
}

impl Place {
    pub fn new(path: &Path, plan: &Plan, outputs: &mut Outputs) -> anyhow::Result<Self> {
        if path.extension().is_some_and(|end| end == "mcap") {
            return Ok(Self::File(outputs.target(path)?));
        }
        // Hours are known after the run only: a crack may end it.
        let name = |step: usize| path.join(format!("step-{step:04}.mcap"));
        let targets = (0..=plan.steps).map(|step| Ok(outputs.target_in_new_folder(&name(step))?));
        Ok(Self::Folder(path.to_owned(), targets.collect::<anyhow::Result<_>>()?))
    }
}

pub(super) fn write(place: Place, of: &Of<'_>, length_s: f64) -> anyhow::Result<()> {
    let progress = Progress::new("recordings", of.growth.steps.len() as u64);
    match place {
        Place::File(target) => {
            let mut writer = McapWriter::new(target.create()?, Compression::Zstd, PublishTime::LogTime)?;
            for step in &of.growth.steps {
                one(of, step, length_s, &mut |packet| Ok(writer.write(packet)?))?;
                progress.finished("");
            }
            writer.finish()?.finish()?;
        }
        Place::Folder(folder, targets) => {
            std::fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
            for (step, target) in of.growth.steps.iter().zip(targets) {
                let mut writer = McapWriter::new(target.create()?, Compression::Zstd, PublishTime::LogTime)?;
                one(of, step, length_s, &mut |packet| Ok(writer.write(packet)?))?;
                writer.finish()?.finish()?;
                progress.finished("");
            }
        }
    }
    Ok(())
}

/// Simulates a step, at the time of the calendar that its hours come to.
fn one(
    of: &Of<'_>,
    step: &Step,
    length_s: f64,
    take: &mut dyn FnMut(&Packet) -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    let Plan { bench, effect, measured, seed, .. } = of.plan;
    let scenario = Scenario {
        motor_speed_hz: Some(Course::Constant(measured.motor_hz)),
        brake_torque_nm: Some(Course::Constant(measured.torque_nm)),
        duration_s: Some(length_s),
        ..Scenario::default()
    };
    // Of recordings one after the other the second must not begin before the first ends.
    let place = of.growth.steps.iter().position(|other| other.hours == step.hours).unwrap_or_default();
    let begin_s = (86_400.0 * of.days(step.hours)).round().max(place as f64 * (length_s.ceil() + 1.0));
    let begun = effect.effect == "tooth_wear" && effect.parameters.contains_key("depth_um");
    let config = SimConfig {
        bench: bench.clone(),
        effects: if begun { vec![effect.clone()] } else { Vec::new() },
        scenario,
        seed: seed.wrapping_add(place as u64),
        t0: START_NS + (1e9 * begin_s) as i64,
    };
    let mut simulator = Simulator::changed(config, |setup| step.growing.apply(setup))?;
    while let Some(mut packet) = simulator.next_packet()? {
        if let Packet::Vibration(block) = &mut packet {
            if block.first_sample_index == 0 && place > 0 {
                block.quality |= Quality::GAP_BEFORE;
            }
            // The count goes on over the gap between two recordings.
            block.first_sample_index += (begin_s * block.sample_rate_hz).round() as u64;
        }
        take(&packet)?;
    }
    Ok(())
}
