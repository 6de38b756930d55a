//! What is wrong in a few entries, the gravest first: alarms by bench and stage, and the worst state of all benches. The page and `gearwatch top` show
//! these, so that both say the same.

use super::{AlarmSnapshot, BenchSnapshot, Snapshot};
use crate::web::{Fault, Gravest};

/// Machine states, from good to grave.
const MACHINE: [&str; 5] = ["normal", "unknown", "deviating", "path_changed", "alarm"];
/// Instrument states that are no fault; all others are worse.
const INSTRUMENT: [&str; 2] = ["ok", "unknown"];

impl Snapshot {
    /// The gravest states of all benches, and which benches are in them: one that is in order must not hide another that is not.
    pub(super) fn gravest(&self) -> Gravest {
        let of = |state: fn(&BenchSnapshot) -> &str, order: &[&str]| {
            let weight = |code: &str| order.iter().position(|known| *known == code).unwrap_or(order.len());
            let worst = self.benches.iter().map(state).max_by_key(|code| weight(code)).unwrap_or("unknown").to_owned();
            let benches = self.benches.iter().filter(|b| weight(state(b)) == weight(&worst)).map(|b| b.name.clone());
            let benches = benches.collect::<Vec<_>>();
            (worst, benches)
        };
        let (machine, machine_of) = of(|bench| &bench.machine, &MACHINE);
        let (instrument, instrument_of) = of(|bench| &bench.instrument, &INSTRUMENT);
        Gravest { machine, machine_of, instrument, instrument_of }
    }
}

/// Alarms by bench and stage: what nobody has seen first, then critical ones, then those of many channels.
pub(super) fn faults(benches: &[BenchSnapshot]) -> Vec<Fault> {
    let mut out: Vec<Fault> = Vec::new();
    for bench in benches {
        for alarm in &bench.alarms {
            let known = out.iter_mut().find(|fault| fault.bench == bench.name && fault.stage == alarm.stage);
            match known {
                Some(fault) => join(fault, alarm),
                None => out.push(begin(&bench.name, alarm)),
            }
        }
    }
    let grave = |fault: &Fault| (!fault.open.is_empty(), fault.severity == "critical", fault.ids.len());
    out.sort_by_key(|fault| std::cmp::Reverse(grave(fault)));
    out
}

fn begin(bench: &str, alarm: &AlarmSnapshot) -> Fault {
    let mut fault = Fault {
        bench: bench.to_owned(),
        stage: alarm.stage.clone(),
        severity: alarm.severity.clone(),
        since_ns: alarm.since_ns,
        active: false,
        ids: Vec::new(),
        open: Vec::new(),
        channels: Vec::new(),
        evidence: None,
        seen: None,
    };
    join(&mut fault, alarm);
    fault
}

fn join(fault: &mut Fault, alarm: &AlarmSnapshot) {
    if alarm.severity == "critical" {
        fault.severity.clone_from(&alarm.severity);
    }
    fault.since_ns = fault.since_ns.min(alarm.since_ns);
    fault.active |= alarm.active;
    fault.ids.push(alarm.id.clone());
    fault.channels.push(alarm.channel.clone());
    if !alarm.acknowledged {
        fault.open.push(alarm.id.clone());
    }
    // The channel that speaks most clearly: its deviation lies the most sigmas beyond the limit.
    let beyond = |e: &gearwatch_alarm::Evidence| {
        (e.deviation_percent.abs() - e.limit_percent.unwrap_or(0.0)) / e.deviation_sigma_percent
    };
    if let Some(evidence) = &alarm.evidence
        && fault.evidence.as_ref().is_none_or(|known| beyond(evidence) > beyond(known))
    {
        fault.evidence = Some(evidence.clone());
    }
    if alarm.seen.as_ref().map(|seen| seen.t_ns) > fault.seen.as_ref().map(|seen| seen.t_ns) {
        fault.seen.clone_from(&alarm.seen);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gearwatch_alarm::Evidence;

    fn alarm(stage: &str, channel: &str, severity: &str, acknowledged: bool, deviation_percent: f64) -> AlarmSnapshot {
        let evidence = Evidence {
            harmonic: 1,
            amplitude: 1.0,
            unit: "g".into(),
            baseline: None,
            deviation_percent,
            deviation_sigma_percent: 1.0,
            limit_percent: Some(10.0),
            rank: "V".into(),
            window: 1,
            input_speed_hz: None,
            mesh_hz: None,
            brake_torque_nm: None,
        };
        AlarmSnapshot {
            id: format!("{stage}@{channel}"),
            severity: severity.into(),
            since_ns: deviation_percent as i64,
            active: true,
            acknowledged,
            stage: stage.into(),
            channel: channel.into(),
            evidence: Some(evidence),
            seen: None,
        }
    }

    fn bench(name: &str, machine: &str, alarms: Vec<AlarmSnapshot>) -> BenchSnapshot {
        BenchSnapshot {
            name: name.into(),
            machine: machine.into(),
            instrument: if machine == "unknown" { "silent".into() } else { "ok".into() },
            motor_speed_hz: None,
            brake_torque_nm: None,
            windows_cut: 0,
            windows_judged: 0,
            windows_shed: 0,
            windows_failed: 0,
            samples_in: 0,
            samples_missing: 0,
            gaps: 0,
            sources: vec![],
            channels: vec![],
            places: vec![],
            alarms,
        }
    }

    #[test]
    fn analytic_alarms_of_a_stage_are_one_entry_and_the_gravest_is_first() {
        let benches = [
            bench("a", "normal", vec![alarm("s", "1", "critical", true, 40.0), alarm("s", "2", "warning", true, 50.0)]),
            bench(
                "b",
                "alarm",
                vec![alarm("s", "1", "warning", false, 12.0), alarm("t", "1", "critical", false, 20.0)],
            ),
        ];
        let said: Vec<String> = faults(&benches)
            .into_iter()
            .map(|f| {
                let deviation = f.evidence.map_or(0.0, |e| e.deviation_percent);
                format!(
                    "{} {} {} {} {} {} {deviation}",
                    f.bench,
                    f.stage,
                    f.severity,
                    f.channels.len(),
                    f.open.len(),
                    f.since_ns
                )
            })
            .collect();
        assert_eq!(said, ["b t critical 1 1 20 20", "b s warning 1 1 12 12", "a s critical 2 0 40 50"]);
    }

    #[test]
    fn analytic_the_worst_of_all_benches_is_told_with_its_benches() {
        let benches = vec![bench("a", "normal", vec![]), bench("b", "unknown", vec![]), bench("c", "unknown", vec![])];
        let gravest = Snapshot { benches, ..Snapshot::default() }.gravest();
        assert_eq!((gravest.machine.as_str(), gravest.machine_of.join("")), ("unknown", "bc".to_owned()));
        assert_eq!((gravest.instrument.as_str(), gravest.instrument_of.join("")), ("silent", "bc".to_owned()));
        assert_eq!(Snapshot::default().gravest().machine, "unknown");
    }
}
