//! A layout of Foxglove and Lichtblick: a tab a channel with ranks, deviations and the order
//! spectrum, and the log beside them.

use gearwatch_core::rank::RankConfig;
use serde_json::{Map, Value, json};

use super::{Channel, Shown};

const HARMONICS: [&str; 5] = ["1x", "2x", "3x", "4x", "5x"];
/// One a harmonic; told apart by those who see colours otherwise too (Okabe and Ito, Color
/// Universal Design, 2008).
const INKS: [&str; 5] = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00"];
const STEP_INK: &str = "#8888887f";

pub(super) fn layout(shown: &Shown) -> serde_json::Result<String> {
    let mut panels = Map::new();
    let tabs: Vec<Value> = shown.channels.iter().map(|channel| tab(shown, channel, &mut panels)).collect();
    let tab = panel(&mut panels, "Tab", json!({ "activeTabIdx": 0, "tabs": tabs }));
    let log = panel(&mut panels, "RosOut", json!({ "searchTerms": [], "minLogLevel": 1, "topicToRender": "/log" }));
    let gaps = panel(&mut panels, "RawMessages", titled("Gaps", json!({ "topicPath": "/gap" })));
    let below = split("row", log, gaps, 70.0);
    let layout = json!({
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": { "speed": 1.0 },
        "layout": split("column", tab, below, 82.0),
    });
    serde_json::to_string_pretty(&layout).map(|text| text + "\n")
}

fn tab(shown: &Shown, channel: &Channel, panels: &mut Map<String, Value>) -> Value {
    let stages = shown.stages.iter().map(|stage| stage_column(&shown.prefix, stage, channel, panels)).collect();
    let spectrum = spectrum(&shown.prefix, channel, panels);
    json!({ "title": channel.name, "layout": split("column", beside(stages), spectrum, 68.0) })
}

/// Ranks, deviations and amplitudes of one stage below each other.
fn stage_column(prefix: &str, stage: &str, channel: &Channel, panels: &mut Map<String, Value>) -> Value {
    let field = |field: &str| json!({ "value": path(&format!("/gear/{prefix}{stage}/rank"), Some(&channel.name), field), "enabled": true, "timestampMethod": "receiveTime" });
    let named = |name: String, label: &str, ink: &str| {
        let mut path = field(&name);
        path["label"] = json!(label);
        path["color"] = json!(ink);
        path
    };
    let each = |name: &dyn Fn(&str) -> String| -> Vec<Value> {
        HARMONICS.iter().zip(INKS).map(|(h, ink)| named(name(h), h, ink)).collect()
    };
    let ranks = panel(
        panels,
        "StateTransitions",
        titled(&format!("{stage}: ranks"), json!({ "paths": each(&|h| format!("rank_{h}")), "isSynced": true })),
    );
    let steps = RankConfig::default().steps_percent;
    let mut deviations = each(&|h| format!("dev_{h}_percent"));
    deviations.extend(steps.iter().flat_map(|step| [*step, -step]).map(|step| {
        json!({ "value": step.to_string(), "enabled": true, "timestampMethod": "receiveTime", "color": STEP_INK, "label": "step" })
    }));
    let deviations = plot(panels, format!("{stage}: deviation from the baseline"), "%", &deviations);
    let amplitudes = plot(
        panels,
        format!("{stage}: amplitude, baseline and floor of 3x"),
        &channel.unit,
        &[
            named("amp_3x".into(), "amplitude", INKS[0]),
            named("base_3x".into(), "baseline", INKS[2]),
            named("floor_3x".into(), "floor", STEP_INK),
        ],
    );
    split("column", ranks, split("column", deviations, amplitudes, 60.0), 30.0)
}

fn spectrum(prefix: &str, channel: &Channel, panels: &mut Map<String, Value>) -> Value {
    let topic = format!("/spectrum/{prefix}{}", channel.name);
    let line = json!({ "value": path(&topic, None, "amplitude[:]"), "label": "amplitude", "color": INKS[0], "enabled": true, "timestampMethod": "receiveTime" });
    let mut config =
        plot_config(format!("Order spectrum (order of the input shaft, {})", channel.unit), &channel.unit, &[line]);
    config["xAxisVal"] = json!("currentCustom");
    config["xAxisPath"] = json!({ "value": path(&topic, None, "order[:]"), "enabled": true });
    panel(panels, "Plot", config)
}

fn plot(panels: &mut Map<String, Value>, title: String, unit: &str, paths: &[Value]) -> Value {
    let config = plot_config(title, unit, paths);
    panel(panels, "Plot", config)
}

fn plot_config(title: String, unit: &str, paths: &[Value]) -> Value {
    let config = json!({
        "paths": paths,
        "xAxisVal": "timestamp",
        "yAxisLabel": unit,
        "showLegend": true,
        "legendDisplay": "floating",
        "showPlotValuesInLegend": false,
        "showXAxisLabels": true,
        "showYAxisLabels": true,
        "isSynced": true,
        "sidebarDimension": 240,
    });
    titled(&title, config)
}

/// Foxglove and Lichtblick have a key each for the title of a panel.
fn titled(title: &str, mut config: Value) -> Value {
    config["foxglovePanelTitle"] = json!(title);
    config["lichtblickPanelTitle"] = json!(title);
    config
}

/// `/topic{channel=="name"}.field`; a topic with other letters than the grammar of message paths
/// knows is quoted.
fn path(topic: &str, channel: Option<&str>, field: &str) -> String {
    let plain = topic.chars().all(|c| c.is_ascii_alphanumeric() || "_-/".contains(c));
    let topic =
        if plain { topic.to_owned() } else { format!("\"{}\"", topic.replace('\\', "\\\\").replace('"', "\\\"")) };
    // A string has no escapes there, but may stand in either quotes.
    let quote = |name: &str| if name.contains('"') { format!("'{name}'") } else { format!("\"{name}\"") };
    let filter = channel.map_or_else(String::new, |name| format!("{{channel=={}}}", quote(name)));
    format!("{topic}{filter}.{field}")
}

/// Puts a panel into the table and names it.
fn panel(panels: &mut Map<String, Value>, kind: &str, config: Value) -> Value {
    let id = format!("{kind}!gearwatch{}", panels.len());
    panels.insert(id.clone(), config);
    json!(id)
}

fn split(direction: &str, first: Value, second: Value, first_percent: f64) -> Value {
    json!({ "direction": direction, "first": first, "second": second, "splitPercentage": first_percent })
}

/// Columns of the same width.
fn beside(columns: Vec<Value>) -> Value {
    let mut columns = columns.into_iter().rev();
    let Some(last) = columns.next() else { return Value::Null };
    let mut count = 1.0;
    columns.fold(last, |right, left| {
        count += 1.0;
        split("row", left, right, 100.0 / count)
    })
}
