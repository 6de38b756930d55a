//! Alarms as the service groups them, a line each.

use gearwatch_alarm::Evidence;
use serde_json::Value;

/// Alarms by bench and stage, the gravest first.
pub(super) fn faults(status: &Value) -> &[Value] {
    status["faults"].as_array().map_or(&[], Vec::as_slice)
}

/// One fault on a line: where, how grave, what it rests on, who has seen it.
pub(super) fn in_words(fault: &Value, several: bool) -> String {
    let text = |key: &str| fault[key].as_str().unwrap_or_default();
    let list = |key: &str| fault[key].as_array().map_or(&[][..], Vec::as_slice);
    let channels: Vec<&str> =
        list("channels").iter().filter_map(Value::as_str).filter(|name| !name.is_empty()).collect();
    let bench = if several { format!("{} · ", text("bench")) } else { String::new() };
    let at = if channels.is_empty() { String::new() } else { format!(" at {}", channels.join(", ")) };
    let evidence = serde_json::from_value::<Evidence>(fault["evidence"].clone());
    let evidence = evidence.map_or(String::new(), |evidence| format!(": {}", evidence.words()));
    let over = if fault["active"].as_bool() == Some(true) { "" } else { ", over" };
    let seen = match (list("open").len(), fault["seen"]["who"].as_str()) {
        (0, Some(who)) => format!("seen by {who}"),
        (0, None) => "acknowledged".to_owned(),
        _ => "not acknowledged".to_owned(),
    };
    format!("{bench}{}{at}, {}{evidence}{over} ({seen})", text("stage"), text("severity"))
}
