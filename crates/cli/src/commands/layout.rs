//! `gearwatch layout BENCH`: a layout with which a viewer opens the service's logs.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use gearwatch_core::bench::Bench;

use super::Run;
use crate::exit::Exit;
use crate::output::OutputOptions;
use crate::terminal;

mod foxglove;
mod plotjuggler;

/// Write a layout with which Foxglove, Lichtblick or PlotJuggler shows a bench's logs
#[derive(Args)]
#[command(after_help = "Examples:
  gearwatch layout bench.toml > bench.foxglove.json               Foxglove and Lichtblick
  gearwatch layout bench.toml --viewer plotjuggler -o bench.xml
  gearwatch layout paper-rig --channel acc_1 --channel acc_2 -o rig.json

Import it in the viewer, then open files of the log's folder (gearwatch-*.mcap) or of a recording.")]
pub struct Layout {
    /// Bench file, or the name of a bench that comes with the program
    bench: PathBuf,
    /// The viewer
    #[arg(long, value_enum, default_value_t)]
    viewer: Viewer,
    /// Sensor, may be repeated; those of the bench file where left out
    #[arg(long = "channel", value_name = "NAME")]
    channels: Vec<String>,
    /// The service watches several benches: topics of its log name the bench
    #[arg(long)]
    several: bool,
    /// File to write; standard output where left out
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    #[command(flatten)]
    overwrite: OutputOptions,
}

#[derive(Clone, Copy, Default, PartialEq, ValueEnum)]
enum Viewer {
    /// Foxglove and Lichtblick (JSON)
    #[default]
    Foxglove,
    /// PlotJuggler (XML)
    Plotjuggler,
}

/// What a layout shows.
struct Shown {
    bench: String,
    /// `<bench>/` in topics of a log of several benches, else nothing.
    prefix: String,
    stages: Vec<String>,
    channels: Vec<Channel>,
}

struct Channel {
    name: String,
    unit: String,
}

impl Shown {
    fn of(bench: &Bench, wanted: &[String], several: bool) -> anyhow::Result<Self> {
        let sensors = &bench.sensors;
        let unit = |name: &str| sensors.iter().find(|s| s.name == name).map_or("", |s| s.unit.as_str()).to_owned();
        let names: Vec<String> =
            if wanted.is_empty() { sensors.iter().map(|s| s.name.clone()).collect() } else { wanted.to_vec() };
        anyhow::ensure!(
            !names.is_empty(),
            "bench {:?} names no sensors: say which there are with --channel NAME",
            bench.name
        );
        Ok(Self {
            prefix: if several { format!("{}/", bench.name) } else { String::new() },
            bench: bench.name.clone(),
            stages: bench.stages.iter().map(|stage| stage.name.clone()).collect(),
            channels: names.into_iter().map(|name| Channel { unit: unit(&name), name }).collect(),
        })
    }
}

impl Run for Layout {
    const NAME: &'static str = "layout";

    fn run(self) -> anyhow::Result<Exit> {
        let shown = Shown::of(&super::simulate::read_bench(&self.bench)?, &self.channels, self.several)?;
        let text = match self.viewer {
            Viewer::Foxglove => foxglove::layout(&shown)?,
            Viewer::Plotjuggler => plotjuggler::layout(&shown),
        };
        match &self.output {
            Some(path) => self.overwrite.reading([&self.bench]).target(path)?.write(text)?,
            None => std::io::Write::write_all(&mut terminal::out(), text.as_bytes())?,
        }
        Ok(Exit::Ok)
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    fn rig() -> Shown {
        let bench = gearwatch_sim::shipped::bench("paper-rig").expect("a shipped bench");
        Shown::of(&bench, &["acc <1>".into(), "acc_2".into()], false).expect("channels")
    }

    /// Each panel that the arrangement names is configured, and each path names a topic and a field
    /// that the log has.
    #[test]
    fn conform_foxglove_layouts_name_what_the_log_has() {
        let layout: serde_json::Value = serde_json::from_str(&foxglove::layout(&rig()).expect("JSON")).expect("JSON");
        let panels = layout["configById"].as_object().expect("panels");
        let mut named = Vec::new();
        leaves(&layout["layout"], &mut named);
        for tab in panels.values().flat_map(|p| p["tabs"].as_array().into_iter().flatten()) {
            leaves(&tab["layout"], &mut named);
        }
        let named: BTreeSet<_> = named.into_iter().collect();
        assert_eq!(named, panels.keys().cloned().collect(), "arranged and configured panels are the same");

        let fields = [
            "rank_1x",
            "rank_5x",
            "dev_1x_percent",
            "dev_5x_percent",
            "amp_3x",
            "base_3x",
            "floor_3x",
            "order",
            "amplitude",
        ];
        let paths: Vec<_> = panels.values().flat_map(|p| p["paths"].as_array().into_iter().flatten()).collect();
        let text =
            |field: &str| paths.iter().filter(|p| p["value"].as_str().is_some_and(|v| v.contains(field))).count();
        for field in fields {
            let on_an_axis =
                panels.values().any(|p| p["xAxisPath"]["value"].as_str().is_some_and(|v| v.contains(field)));
            assert!(text(field) > 0 || on_an_axis, "{field} is shown");
        }
        assert_eq!(text(r#"/gear/stage2/rank{channel=="acc_2"}.dev_1x_percent"#), 1);
        // Of several benches each has its own topics.
        let north = foxglove::layout(&Shown { prefix: "north/".into(), ..rig() }).expect("JSON");
        assert!(north.contains("/gear/north/stage2/rank{") && north.contains("/spectrum/north/acc_2"), "{north}");
        assert!(plotjuggler::layout(&Shown { prefix: "north/".into(), ..rig() }).contains("/gear/north/stage2/rank/"));
    }

    fn leaves(node: &serde_json::Value, out: &mut Vec<String>) {
        match node.as_str() {
            Some(name) => out.push(name.to_owned()),
            None => ["first", "second"].iter().filter_map(|side| node.get(side)).for_each(|side| leaves(side, out)),
        }
    }

    /// What is written is XML whose names are escaped.
    #[test]
    fn conform_plotjuggler_layouts_are_xml() {
        let layout = plotjuggler::layout(&Shown { stages: vec!["a & <b>".into()], ..rig() });
        assert!(layout.contains("/gear/a &amp; &lt;b&gt;/rank/dev_1x_percent"), "{layout}");
        let opened = layout.matches("<plot ").count();
        assert_eq!(opened, layout.matches("</plot>").count());
        assert_eq!(opened, 2, "ranks and deviations of the one stage");
    }
}
