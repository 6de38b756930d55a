//! What Prometheus and the page are told.

use super::*;

#[test]
fn conform_unknown_is_minus_one_and_names_are_escaped() {
    let place = PlaceSnapshot {
        stage: "a\"b\\c\nd".into(),
        channel: "acc".into(),
        window: 1,
        machine: MachineState::Unknown,
        reason: "not_resolved".into(),
        levels: vec![-1, 5],
        deviations_percent: vec![None, Some(14.5)],
    };
    let bench = BenchSnapshot {
        name: "b".into(),
        machine: MachineState::Unknown,
        instrument: BenchInstrument::OK,
        motor_speed_hz: None,
        brake_torque_nm: None,
        windows_cut: 2,
        windows_judged: 1,
        windows_shed: 1,
        windows_failed: 0,
        samples_in: 10,
        samples_missing: 0,
        gaps: 0,
        sources: vec![],
        channels: vec![("acc".into(), "overload".into())],
        places: vec![place],
        alarms: vec![],
    };
    let text = Snapshot { benches: vec![bench], ..Snapshot::default() }.prometheus();
    let labels = r#"{bench="b",stage="a\"b\\c\nd",channel="acc",harmonic="#;
    assert!(text.contains(&format!("gearwatch_rank{labels}\"1\"}} -1\n")), "{text}");
    assert!(text.contains(&format!("gearwatch_rank{labels}\"2\"}} 5\n")), "{text}");
    // What is not in the list is unknown too.
    assert!(text.contains(&format!("gearwatch_rank{labels}\"5\"}} -1\n")), "{text}");
    assert!(!text.contains(&format!("gearwatch_deviation_percent{labels}\"1\"")), "{text}");
    assert!(text.contains(r#"gearwatch_channel_ok{bench="b",channel="acc",state="overload"} 0"#), "{text}");
    for line in text.lines().filter(|line| !line.starts_with('#')) {
        assert!(line.rsplit_once(' ').is_some_and(|(_, value)| value.parse::<f64>().is_ok()), "{line}");
    }
}

#[test]
fn analytic_unknown_is_worse_than_normal() {
    use MachineState::{Alarm, Normal, Unknown};
    assert_eq!(worst([].into_iter()), Unknown);
    assert_eq!(worst([Normal, Unknown].into_iter()), Unknown);
    assert_eq!(worst([Unknown, Alarm, Normal].into_iter()), Alarm);
}
