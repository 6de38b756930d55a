//! Alarms and instruments by rows of windows.

use super::*;
use gearwatch_core::estimate::Estimate;
use gearwatch_core::verdict::MachineState;

fn verdict(window: u64, machine: MachineState, instrument: InstrumentState) -> Verdict {
    Verdict {
        stage: "stage1".into(),
        channel: "acc_1".into(),
        window,
        t0: window as i64,
        samples: 1,
        unit: "g".into(),
        mesh_hz: 1.0,
        brake_torque_nm: 0.0,
        machine,
        instrument,
        baseline_sessions: 1,
        ..Verdict::blank()
    }
}

/// `n` normal, `d` deviating, `a` alarm, others unknown.
fn state(c: char) -> MachineState {
    match c {
        'n' => MachineState::Normal,
        'd' => MachineState::Deviating,
        'a' => MachineState::Alarm,
        _ => MachineState::Unknown,
    }
}

/// Feeds a row of states; the windows at which something changed.
fn feed(health: &mut Health, row: &str) -> Vec<(usize, bool, Severity)> {
    let windows = row.chars().enumerate();
    let changes = windows.filter_map(|(i, c)| {
        let alarm = health.take(&verdict(i as u64, state(c), InstrumentState::Ok))?;
        Some((i, alarm.active, alarm.severity))
    });
    changes.collect()
}

fn somebody() -> Acknowledgement {
    Acknowledgement { who: "shift A".into(), why: "seen".into(), from: "here".into(), t_ns: 5, until_ns: None }
}

fn health() -> Health {
    Health::new(AlarmConfig { clear: 4, ..AlarmConfig::default() })
}

#[test]
fn analytic_three_of_five_raise_and_four_normal_in_a_row_clear() {
    // Two of five are too few; unknown windows count for nothing in either direction.
    assert_eq!(feed(&mut health(), "ndndnnndunduuun"), []);
    assert_eq!(feed(&mut health(), "ndnduduu"), [(5, true, Severity::Warning)]);
    // The alarm goes with the fourth normal window in a row, and unknown ones do not count as
    // normal.
    assert_eq!(feed(&mut health(), "dddnnndnnuuuunn"), [(2, true, Severity::Warning), (14, false, Severity::Warning)]);
    // It grows worse with the third window that asks for it.
    assert_eq!(feed(&mut health(), "dddaaa"), [(2, true, Severity::Warning), (5, true, Severity::Critical)]);
}

/// Windows a second apart: the vote stands from the third deviating window on, so that a delay of
/// 4 s raises the alarm at the seventh; a pause in the vote begins the delay anew. Normal windows
/// must go on for 6 s: the seventh ends it. Critical and warning wait each for itself.
#[test]
fn analytic_alarms_wait_in_time_too() {
    let delayed = || Health::new(AlarmConfig { clear: 2, delay_secs: 4.0, clear_secs: 6.0, ..AlarmConfig::default() });
    let feed = |health: &mut Health, row: &str| {
        let windows = row.chars().enumerate().filter_map(|(i, c)| {
            let second = Verdict { t0: i as i64 * 1_000_000_000, ..verdict(i as u64, state(c), InstrumentState::Ok) };
            health.take(&second).map(|alarm| (i, alarm.active, alarm.severity))
        });
        windows.collect::<Vec<_>>()
    };
    assert_eq!(feed(&mut delayed(), "dddddnnnn"), []);
    assert_eq!(feed(&mut delayed(), "dddddddnnnnnnnn"), [(6, true, Severity::Warning), (13, false, Severity::Warning)]);
    assert_eq!(feed(&mut delayed(), "dddddddaaaaaaa"), [(6, true, Severity::Warning), (13, true, Severity::Critical)]);
    // Unknown windows stop neither the clock nor the vote.
    assert_eq!(feed(&mut delayed(), "ddduuud"), [(6, true, Severity::Warning)]);
    let wrong = AlarmConfig { delay_secs: f64::NAN, clear_secs: -1.0, ..AlarmConfig::default() };
    assert_eq!(wrong.problems().len(), 2, "{:?}", wrong.problems());
}

#[test]
fn analytic_a_latched_alarm_stays_until_acknowledged() {
    let mut health = health();
    feed(&mut health, "dddnnnn");
    let alarm = health.alarms().next().unwrap().clone();
    assert!(!alarm.active && !alarm.acknowledged);
    assert!(health.acknowledge("stage9@acc_1", &somebody()).is_none());
    assert!(health.acknowledge(&alarm.id, &somebody()).is_some_and(|alarm| alarm.over));
    assert_eq!(health.alarms().count(), 0);
    // Acknowledged while it holds: it goes by itself later, and an alarm that grows worse must be
    // seen again.
    feed(&mut health, "ddd");
    assert!(health.acknowledge(&alarm.id, &somebody()).is_some_and(|alarm| !alarm.over));
    feed(&mut health, "aaa");
    assert!(!health.alarms().next().unwrap().acknowledged);
    assert!(health.acknowledge(&alarm.id, &somebody()).is_some());
    feed(&mut health, "nnnn");
    assert_eq!(health.alarms().count(), 0);
}

/// The evidence is the line that lies the most sigmas beyond its limit, here 2x:
/// (12 − 10) / 0.5 = 4 beside (20 − 10) / 5 = 2. Who has seen the alarm stands with it until it
/// grows worse.
#[test]
fn analytic_an_alarm_says_what_it_rests_on_and_who_has_seen_it() {
    let mut health = health();
    let mut window = verdict(0, MachineState::Alarm, InstrumentState::Ok);
    window.harmonics[0].deviation_percent = Estimate::new(20.0, 5.0);
    window.harmonics[1].deviation_percent = Estimate::new(-12.0, 0.5);
    for harmonic in &mut window.harmonics[..2] {
        harmonic.amplitude = Estimate::new(0.3, 0.01);
    }
    window.input_speed_hz = Estimate::new(25.0, 0.01);
    let raise = |health: &mut Health, window: &Verdict| (0..3).find_map(|_| health.take(window));
    let alarm = raise(&mut health, &window).expect("raised");
    let evidence = alarm.evidence.as_ref().expect("deviations are known");
    assert_eq!((evidence.harmonic, evidence.deviation_percent, evidence.limit_percent), (2, -12.0, Some(10.0)));
    assert_eq!((evidence.input_speed_hz, evidence.baseline), (Some(25.0), None));
    assert!(evidence.words().starts_with("2x -12.0 % ± 0.5 %"), "{}", evidence.words());
    let seen = health.acknowledge(&alarm.id, &somebody()).expect("it is there");
    assert_eq!(seen.seen.as_deref(), Some(&somebody()));
    assert_eq!(health.alarms().next().and_then(|alarm| alarm.seen.clone()), Some(Box::new(somebody())));
    // A warning that becomes critical must be seen again, and rests on what it has become.
    let mut warned = self::health();
    let slight = Verdict { machine: MachineState::Deviating, ..window.clone() };
    let id = raise(&mut warned, &slight).expect("raised").id;
    warned.acknowledge(&id, &somebody());
    let worse = raise(&mut warned, &window).expect("worse");
    assert_eq!((worse.seen, worse.evidence.and_then(|e| e.limit_percent)), (None, Some(10.0)));
    // Records of earlier versions have neither, and are read.
    let mut text = serde_json::to_value(&alarm).expect("JSON");
    text.as_object_mut().expect("an object").retain(|key, _| key != "evidence");
    assert_eq!(serde_json::from_value::<Alarm>(text).expect("an alarm").evidence, None);
}

/// A latched alarm of before the start stays; one that held goes on, and ends by normal windows as
/// any other; one of a place that is no longer watched waits for somebody to see it.
#[test]
fn regress_a_restart_forgets_no_alarm() {
    let mut before = health();
    feed(&mut before, "dddaaa");
    let held = before.alarms().next().unwrap().clone();
    let mut after = health();
    after.restore(held.clone(), true);
    assert_eq!(after.alarms().next(), Some(&held));
    assert_eq!(feed(&mut after, "nnn"), []);
    assert_eq!(feed(&mut after, "n"), [(0, false, Severity::Critical)]);
    assert!(!after.alarms().next().unwrap().acknowledged, "latched");
    let mut elsewhere = health();
    elsewhere.restore(held.clone(), false);
    assert!(elsewhere.alarms().next().is_some_and(|alarm| !alarm.active));
    assert!(elsewhere.acknowledge(&held.id, &somebody()).is_some_and(|alarm| alarm.over));
    assert_eq!(elsewhere.alarms().count(), 0);
}

#[test]
fn analytic_an_instrument_earns_its_ok() {
    let mut health = health();
    let mut codes = Vec::new();
    let states = [InstrumentState::Ok, InstrumentState::Overload];
    for (window, &bad) in [0, 0, 0, 1, 0, 0, 0].iter().enumerate() {
        let taken = verdict(window as u64, MachineState::Unknown, states[bad]);
        health.take(&taken);
        // Another stage of the same window changes nothing.
        health.take(&Verdict { stage: "stage2".into(), ..taken });
        codes.push(health.instruments().next().unwrap().1.code());
    }
    assert_eq!(codes, ["not_ok_yet", "not_ok_yet", "ok", "overload", "overload", "overload", "ok"]);
    health.begin_anew();
    assert_eq!((health.newest().count(), health.instruments().count()), (0, 0));
    health.take(&verdict(7, MachineState::Unknown, InstrumentState::Ok));
    assert_eq!(health.instruments().next().unwrap().1.code(), "not_ok_yet");
}

/// Windows a second apart. Shelved for 10 s at window 3: it goes and comes without a word, and is
/// told again where it holds after that. One that grows worse is told at once.
#[test]
fn analytic_a_shelved_alarm_is_quiet_for_its_time() {
    let mut health = Health::new(AlarmConfig { needed: 1, of: 1, clear: 2, ..AlarmConfig::default() });
    let mut at = 0;
    let mut feed = |health: &mut Health, row: &str| {
        let mut told = Vec::new();
        for c in row.chars() {
            let window = Verdict { t0: at * 1_000_000_000, ..verdict(at as u64, state(c), InstrumentState::Ok) };
            told.extend(health.take(&window).map(|alarm| (at, alarm.active, alarm.acknowledged)));
            at += 1;
        }
        told
    };
    assert_eq!(feed(&mut health, "dddd"), [(0, true, false)]);
    // The clock of whoever shelves it is another than the data's.
    let for_10_s = Acknowledgement { t_ns: 777_000_000_000, until_ns: Some(787_000_000_000), ..somebody() };
    let shelved = health.acknowledge("stage1@acc_1", &for_10_s).expect("it is there");
    assert_eq!(shelved.seen.and_then(|seen| seen.until_ns), Some(13_000_000_000));
    assert_eq!(feed(&mut health, "nndd"), [(5, false, true), (6, true, true)]);
    assert_eq!(feed(&mut health, "ddddd"), []);
    assert_eq!(feed(&mut health, "d"), [(13, true, false)], "its time is over");
    health.acknowledge("stage1@acc_1", &Acknowledgement { until_ns: Some(1_000_000_000_000), t_ns: 0, ..somebody() });
    assert_eq!(feed(&mut health, "da"), [(15, true, false)], "it has grown worse");
}

/// Channels of one stage are one fault: the first is news, the others are not, one that is worse
/// is; the end is that of the last.
#[test]
fn analytic_channels_of_a_stage_are_one_fault() {
    use MachineState::{Alarm as Grave, Deviating, Normal};
    use Severity::{Critical, Warning};
    let mut health = Health::new(AlarmConfig { needed: 1, of: 1, clear: 1, ..AlarmConfig::default() });
    let mut feed = |stage: &str, channel: &str, machine: MachineState| {
        let window =
            Verdict { stage: stage.into(), channel: channel.into(), ..verdict(0, machine, InstrumentState::Ok) };
        let group = health.take(&window).and_then(|alarm| alarm.group).expect("a change");
        (group.channels.join(" "), group.severity, group.news)
    };
    assert_eq!(feed("stage1", "a", Deviating), ("a".into(), Warning, true));
    assert_eq!(feed("stage1", "b", Deviating), ("a b".into(), Warning, false));
    assert_eq!(feed("stage2", "a", Deviating), ("a".into(), Warning, true));
    assert_eq!(feed("stage1", "c", Grave), ("a b c".into(), Critical, true));
    assert_eq!(feed("stage1", "a", Grave), ("a b c".into(), Critical, false));
    assert_eq!(feed("stage1", "a", Normal), ("b c".into(), Critical, false));
    assert_eq!(feed("stage1", "c", Normal), ("b".into(), Warning, false));
    assert_eq!(feed("stage1", "b", Normal), (String::new(), Warning, true));
}

/// After a standstill, a run-up and a change of load windows ask for nothing for the time that is
/// set; steady ones do.
#[test]
fn analytic_a_run_up_raises_nothing() {
    let config = AlarmConfig { needed: 1, of: 1, settle_secs: 5.0, ..AlarmConfig::default() };
    let mut health = Health::new(config);
    let mut at = 0;
    let mut feed = |speed: f64, torque: f64| {
        let mut window = verdict(at as u64, MachineState::Alarm, InstrumentState::Ok);
        window.t0 = at * 1_000_000_000;
        (window.input_speed_hz, window.brake_torque_nm) = (Estimate::new(speed, 0.01), torque);
        at += 1;
        health.take(&window).is_some()
    };
    assert!((0..5).all(|_| !feed(10.0, 40.0)), "it has just begun");
    assert!((0..4).all(|i| !feed(11.0 + f64::from(i), 40.0)), "it runs up");
    assert!((0..4).all(|_| !feed(14.1, 40.0)), "it has changed by less than 2 %, and 4 s ago by more");
    assert!(feed(14.1, 40.0));
    assert!(!feed(14.1, 45.0), "the load changes");
    let mut wrong = AlarmConfig { settle_secs: -1.0, settle_percent: 0.0, ..AlarmConfig::default() };
    assert_eq!(wrong.problems().len(), 2);
    wrong = AlarmConfig::default();
    assert!(wrong.problems().is_empty() && wrong.settle_secs == 0.0);
}

/// Nothing is raised while somebody works at the bench; the entry says who, stands over a restart,
/// and ends by itself or by whoever ends it.
#[test]
fn analytic_maintenance_raises_nothing_and_ends() {
    let second = |i: i64, machine| Verdict { t0: i * 1_000_000_000, ..verdict(i as u64, machine, InstrumentState::Ok) };
    let mut health = health();
    health.take(&second(0, MachineState::Normal));
    let for_10_s = Acknowledgement { t_ns: 0, until_ns: Some(10_000_000_000), ..somebody() };
    let entry = health.maintain(&for_10_s).expect("it begins");
    assert_eq!((entry.id.as_str(), entry.active, entry.acknowledged, entry.over), (MAINTENANCE, true, true, false));
    assert!((1..10).all(|i| health.take(&second(i, MachineState::Alarm)).is_none()));
    let mut again = self::health();
    again.restore(health.alarms().next().expect("the entry").clone(), true);
    for health in [&mut health, &mut again] {
        let told: Vec<_> = (10..14).filter_map(|i| health.take(&second(i, MachineState::Alarm))).collect();
        assert_eq!(
            told.iter().map(|a| (a.t_ns / 1_000_000_000, a.over)).collect::<Vec<_>>(),
            [(10, true), (13, false)]
        );
    }
    health.maintain(&Acknowledgement { t_ns: 0, until_ns: Some(1_000_000_000_000), ..somebody() });
    let ended = health.maintain(&Acknowledgement { t_ns: 0, until_ns: Some(0), ..somebody() }).expect("it ends");
    assert!(ended.over && health.maintain(&Acknowledgement { until_ns: Some(0), ..somebody() }).is_none());
}
