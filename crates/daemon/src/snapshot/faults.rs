//! What is wrong in a few entries, the gravest first: alarms by bench and stage, and the worst
//! state of all benches. The page and `gearwatch top` show these, so that both say the same.

use gearwatch_alarm::Severity;
use gearwatch_core::verdict::MachineState;

use super::{AlarmSnapshot, BenchSnapshot, Snapshot, gravity};
use crate::states::BenchInstrument;
use crate::web::{Fault, Gravest};

/// How grave an instrument state is: all that are neither good nor unknown are faults.
fn weight(state: BenchInstrument) -> u8 {
    match state {
        BenchInstrument::OK => 0,
        BenchInstrument::Unknown => 1,
        _ => 2,
    }
}

impl Snapshot {
    /// The gravest states of all benches, and which benches are in them: one that is in order must
    /// not hide another that is not.
    pub(super) fn gravest(&self) -> Gravest {
        let names = |in_it: &dyn Fn(&BenchSnapshot) -> bool| {
            self.benches.iter().filter(|bench| in_it(bench)).map(|bench| bench.name.clone()).collect::<Vec<_>>()
        };
        let machines = self.benches.iter().map(|bench| bench.machine);
        let machine = machines.max_by_key(|&state| gravity(state)).unwrap_or(MachineState::Unknown);
        let instruments = self.benches.iter().map(|bench| bench.instrument);
        let instrument = instruments.max_by_key(|&state| weight(state)).unwrap_or_default();
        Gravest {
            machine: machine.code().to_owned(),
            machine_of: names(&|bench| bench.machine == machine),
            instrument: instrument.code().to_owned(),
            instrument_of: names(&|bench| weight(bench.instrument) == weight(instrument)),
        }
    }
}

/// Alarms by bench and stage: what nobody has seen first, then critical ones, then those of many
/// channels.
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
    let grave = |fault: &Fault| (!fault.open.is_empty(), fault.severity == Severity::Critical, fault.ids.len());
    out.sort_by_key(|fault| std::cmp::Reverse(grave(fault)));
    out
}

fn begin(bench: &str, alarm: &AlarmSnapshot) -> Fault {
    let mut fault = Fault {
        bench: bench.to_owned(),
        stage: alarm.stage.clone(),
        severity: alarm.severity,
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
    fault.severity = fault.severity.max(alarm.severity);
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
    use gearwatch_alarm::Severity::{Critical, Warning};
    use gearwatch_core::verdict::MachineState::{Alarm, Normal, Unknown};

    fn alarm(
        stage: &str,
        channel: &str,
        severity: Severity,
        acknowledged: bool,
        deviation_percent: f64,
    ) -> AlarmSnapshot {
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
            severity,
            since_ns: deviation_percent as i64,
            active: true,
            acknowledged,
            stage: stage.into(),
            channel: channel.into(),
            evidence: Some(evidence),
            seen: None,
        }
    }

    fn bench(name: &str, machine: MachineState, alarms: Vec<AlarmSnapshot>) -> BenchSnapshot {
        BenchSnapshot {
            name: name.into(),
            machine,
            instrument: if machine == MachineState::Unknown { BenchInstrument::Silent } else { BenchInstrument::OK },
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
            bench("a", Normal, vec![alarm("s", "1", Critical, true, 40.0), alarm("s", "2", Warning, true, 50.0)]),
            bench("b", Alarm, vec![alarm("s", "1", Warning, false, 12.0), alarm("t", "1", Critical, false, 20.0)]),
        ];
        let said: Vec<String> = faults(&benches)
            .into_iter()
            .map(|f| {
                let deviation = f.evidence.map_or(0.0, |e| e.deviation_percent);
                format!(
                    "{} {} {} {} {} {} {deviation}",
                    f.bench,
                    f.stage,
                    f.severity.code(),
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
        let benches = vec![bench("a", Normal, vec![]), bench("b", Unknown, vec![]), bench("c", Unknown, vec![])];
        let gravest = Snapshot { benches, ..Snapshot::default() }.gravest();
        assert_eq!((gravest.machine.as_str(), gravest.machine_of.join("")), ("unknown", "bc".to_owned()));
        assert_eq!((gravest.instrument.as_str(), gravest.instrument_of.join("")), ("silent", "bc".to_owned()));
        assert_eq!(Snapshot::default().gravest().machine, "unknown");
    }
}
