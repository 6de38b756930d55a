//! An answer as columns, as the page draws them.

use gearwatch_core::verdict::HARMONICS;
use serde_json::{Value, json};

use super::cell::ShortSpan;
use super::{Asked, Found, MOST_EVENTS, SECOND};
use crate::span::STATES;

/// Six digits are finer than a screen can show; `null` where nothing is known.
fn number(x: f32) -> Value {
    if !x.is_finite() {
        return Value::Null;
    }
    format!("{x:.5e}").parse::<f64>().map_or(Value::Null, |x| json!(x))
}

pub(super) fn answer(asked: &Asked, every: i64, found: &Found) -> Value {
    let Found { cells, events, files, to_read, troubled, .. } = found;
    let column = |of: &dyn Fn(&ShortSpan) -> f32| -> Value { cells.values().map(|c| number(of(c))).collect() };
    let harmonics = |of: &dyn Fn(&ShortSpan, usize) -> f32| -> Value {
        (0..HARMONICS).map(|h| column(&|c: &ShortSpan| of(c, h))).collect()
    };
    let gravest =
        |c: &ShortSpan| STATES.iter().zip(c.states).find(|(_, n)| *n > 0).map_or("unknown", |(name, _)| *name);
    let wanted = asked.place().is_some();
    let hidden = events.len().saturating_sub(MOST_EVENTS);
    json!({
        "every_s": every / SECOND,
        "files": files,
        "to_read": to_read,
        "troubled": troubled,
        "t0_s": cells.keys().map(|t| t / SECOND).collect::<Vec<_>>(),
        "windows": cells.values().map(|c| c.windows).collect::<Vec<_>>(),
        "not_ok": cells.values().map(|c| c.not_ok).collect::<Vec<_>>(),
        "machine": cells.values().map(gravest).collect::<Vec<_>>(),
        "level": (0..HARMONICS).map(|h| cells.values().map(|c| c.levels[h]).collect::<Vec<_>>()).collect::<Vec<_>>(),
        "dev": harmonics(&|c, h| c.deviations[h].value),
        "dev_sigma": harmonics(&|c, h| c.deviations[h].sigma),
        "amp": harmonics(&|c, h| c.amplitudes[h].value),
        "speed_hz": column(&|c| c.speed.value),
        "torque_nm": column(&|c| c.torque.value),
        "indicator": if wanted { column(&|c| c.indicator.value) } else { Value::Null },
        "indicator_sigma": if wanted { column(&|c| c.indicator.sigma) } else { Value::Null },
        "events": events[hidden..].iter().map(|e| json!({ "t_ns": e.t_ns, "kind": e.kind, "text": e.text })).collect::<Vec<_>>(),
        "events_hidden": hidden,
    })
}
