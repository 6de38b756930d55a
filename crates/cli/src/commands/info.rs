//! `gearwatch info FILE`: what a file holds.

use std::io::Write;
use std::path::PathBuf;

use anyhow::Context;
use clap::Args;

use super::Run;
use crate::exit::Exit;

/// Say what a bench file or recording holds
#[derive(Args)]
pub struct Info {
    /// The file
    file: PathBuf,
}

impl Run for Info {
    const NAME: &'static str = "info";

    fn run(self) -> anyhow::Result<Exit> {
        let bench = gearwatch_io::bench_file::read(&self.file)?;
        let train = gearwatch_core::train::Train::new(&bench);
        let mut out = std::io::stdout().lock();
        writeln!(out, "{}: bench {:?}", self.file.display(), bench.name).context("stdout")?;
        for stage in &train.stages {
            let mesh_hz = stage.mesh_order * train.nominal_input_hz;
            writeln!(
                out,
                "  {}: {} / {} teeth, mesh {mesh_hz:.2} Hz",
                stage.name, stage.pinion_teeth, stage.wheel_teeth
            )
            .context("stdout")?;
        }
        Ok(Exit::Ok)
    }
}
