//! The screen as text.

use super::*;
use ratatui::Terminal;
use ratatui::backend::TestBackend;

#[test]
fn analytic_bars_grow_from_the_middle() {
    assert_eq!(bar(10.0, 4), "    │██");
    assert_eq!(bar(-20.0, 4), "████│    ");
    assert_eq!(bar(99.0, 4), "    │████");
}

/// One bench in order must not hide another that is not; rows and alarms say whose they are.
#[test]
fn regress_the_lamps_speak_of_all_benches() {
    let mut screen = Screen::new("http://bench".into());
    screen.take(Message::Link(Ok(())));
    let fault = serde_json::json!({"bench": "south", "stage": "stage1", "severity": "critical", "active": true, "ids": ["south/stage1@acc", "south/stage1@b"],
        "open": ["south/stage1@b"], "channels": ["acc", "b"], "evidence": null, "seen": {"who": "shift A"}});
    screen.take(Message::Status(serde_json::json!({
        "gravest": {"machine": "alarm", "instrument": "flat_line"},
        "faults": [fault],
        "benches": [
            {"name": "north", "machine": "normal", "instrument": "ok", "alarms": []},
            {"name": "south", "machine": "alarm", "instrument": "flat_line", "alarms": []},
        ]
    })));
    for bench in ["north", "south"] {
        let verdict = serde_json::json!({"bench": bench, "stage": "stage1", "channel": "acc", "machine": "normal", "instrument": "ok"});
        screen.take(Message::Verdict(Box::new(serde_json::from_value(verdict).unwrap())));
    }
    let mut terminal = Terminal::new(TestBackend::new(140, 30)).unwrap();
    terminal.draw(|frame| screen.draw(frame)).unwrap();
    let text = terminal.backend().to_string();
    assert!(text.contains("machine alarm") && text.contains("instrument flat_line"), "{text}");
    for place in
        ["north · stage1 · acc", "south · stage1 · acc", "south · stage1 at acc, b, critical (not acknowledged)"]
    {
        assert!(text.contains(place), "{place}: {text}");
    }
    assert_eq!(screen.selected_alarms(), ["south/stage1@b"]);
}

/// A naked V on a stage that is called normal is green and dim, and a question.
#[test]
fn regress_the_colour_says_no_more_than_the_verdict() {
    let of = |machine: &str, p| Look::of(state_of(machine.as_bytes()[0]), 5, Some(p));
    assert!(of("normal", 0.7) == Look { colour: 0, level: 5, sure: false });
    assert!(of("deviating", 0.8) == Look { colour: 3, level: 5, sure: true });
    assert!(of("alarm", 0.9) == Look { colour: 5, level: 5, sure: true });
    assert!(of("path_changed", 0.9).colour == PATH && of("unknown", 0.9).colour == -1);
}

/// A lost link must not go on showing a machine in order.
#[test]
fn regress_a_lost_link_is_not_normal() {
    let mut screen = Screen::new("http://bench".into());
    screen.take(Message::Link(Ok(())));
    screen.take(Message::Status(
        serde_json::json!({"gravest": {"machine": "normal"}, "benches": [{"name": "b", "machine": "normal", "instrument": "ok"}]}),
    ));
    let mut terminal = Terminal::new(TestBackend::new(120, 30)).unwrap();
    let mut shown = |screen: &Screen| {
        terminal.draw(|frame| screen.draw(frame)).unwrap();
        terminal.backend().to_string()
    };
    assert!(shown(&screen).contains("machine normal"));
    screen.take(Message::Link(Err("connection refused".into())));
    let text = shown(&screen);
    assert!(text.contains("machine unknown") && text.contains("lost (connection refused)"), "{text}");
}
