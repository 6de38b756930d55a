//! The simulator: the bench of the bench file, with its effects, through a scenario.

use std::path::PathBuf;

use gearwatch_core::bench::Bench;
use gearwatch_core::source::Source as _;
use gearwatch_runtime::kinds::Kind;
use gearwatch_sim::scenario::{self, Scenario};
use gearwatch_sim::source::{SimConfig, Simulator as Simulation};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::pace::Speed;
use crate::{Feed, Pacer, SourceConfig, SourceContext, SourceError, kind};
use gearwatch_runtime::clock::now_unix_ns;

pub(crate) const KIND: Kind<dyn SourceConfig> = kind::<Simulator>(
    "simulator",
    "the simulated bench: its effects and a scenario of speed, torque, faults that set in and sensors that fail",
    r#"
scenario = "wear.toml"              # or a table in its place; leave out for the normal state without end
speed = 1.0                         # or "max"
seed = 1
"#,
);

/// Keys of the simulator.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
struct Simulator {
    /// Scenario file, or the scenario itself; the normal state without end where left out.
    scenario: Option<ScenarioKey>,
    /// `"max"`, or seconds of simulation per second.
    speed: Speed,
    /// Draws where the train starts, noise, jitter and slip.
    seed: u64,
    /// Length (s, > 0); that of the scenario where left out.
    duration_secs: Option<f64>,
    /// Time of the first sample (ns since the epoch); where left out, now for a paced simulation,
    /// and 0 at full speed, so that the same seed gives the same bytes.
    first_sample_unix_ns: Option<i64>,
}

#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
enum ScenarioKey {
    /// A file, `format = "gearwatch-scenario/1"`.
    File(PathBuf),
    /// The same keys in a table.
    Table(#[schemars(with = "serde_json::Value")] Box<Scenario>),
}

impl Default for Simulator {
    fn default() -> Self {
        Self { scenario: None, speed: Speed::Times(1.0), seed: 1, duration_secs: None, first_sample_unix_ns: None }
    }
}

impl Simulator {
    fn scenario(&self, context: &SourceContext) -> Result<Scenario, SourceError> {
        let mut scenario = match &self.scenario {
            None => Scenario::default(),
            Some(ScenarioKey::Table(scenario)) => (**scenario).clone(),
            Some(ScenarioKey::File(path)) => {
                let path = context.resolve(path);
                let text = gearwatch_io::text::read_text(&path)
                    .map_err(|source| SourceError::Io { path: path.clone(), source })?;
                toml::from_str(&text).map_err(|e| SourceError::Content {
                    path: path.clone(),
                    place: "scenario".to_owned(),
                    expected: scenario::FORMAT.to_owned(),
                    found: e.to_string().trim_end().to_owned(),
                })?
            }
        };
        if self.duration_secs.is_some() {
            scenario.duration_s = self.duration_secs;
        }
        Ok(scenario)
    }
}

impl SourceConfig for Simulator {
    fn problems(&self) -> Vec<String> {
        let mut out: Vec<String> = self.speed.problem().into_iter().collect();
        if let Some(secs) = self.duration_secs
            && !(secs.is_finite() && secs > 0.0)
        {
            out.push(format!("duration_secs is {secs}; expected a number above 0"));
        }
        out
    }

    fn refuses(&self, bench: &Bench) -> Option<String> {
        bench.beyond_simulator()
    }

    fn is_live(&self) -> bool {
        self.speed != Speed::Max
    }

    fn open(&self, context: &SourceContext) -> Result<Feed, SourceError> {
        let failed = |e| SourceError::Reader(Box::new(e));
        let mut simulation = Simulation::new(SimConfig {
            bench: (*context.bench).clone(),
            effects: Vec::new(),
            scenario: self.scenario(context)?,
            seed: self.seed,
            t0: self.first_sample_unix_ns.unwrap_or_else(|| if self.is_live() { now_unix_ns() } else { 0 }),
        })
        .map_err(failed)?;
        let mut pacer = Pacer::new(self.speed, context.stop.clone());
        Ok(Feed::Pull(Box::new(move || {
            let packet = simulation.next_packet().map_err(failed)?;
            Ok(packet.and_then(|packet| pacer.wait_for(&packet).then_some(packet)))
        })))
    }
}
