//! What pages see: the service's own hub, pages that open at any moment, and pages that read nothing for a while.

use std::collections::BTreeMap;

use gearwatch_core::verdict::Verdict;
use gearwatch_daemon::health::Health;
use gearwatch_daemon::web::{AlarmStatus, BenchStatus, Hub, Message, Status};
use serde_json::Value;
use tokio::sync::broadcast::{Receiver, error::TryRecvError};

/// A page that lags behind by more messages skips some: few, so that it happens in a world.
const LAG: usize = 16;

/// A page that somebody has open.
struct Open {
    receiver: Receiver<Message>,
    /// It reads nothing until then (ms).
    stalls_until: u64,
    newest: Option<u64>,
    /// Messages that it was told to have missed since the last verdict.
    skipped: u64,
    /// Ids of the alarms that it shows.
    alarms: Vec<String>,
}

pub struct Pages {
    hub: Hub,
    open: Option<Open>,
    /// Windows that a page should show: since the start of the service, or since the time of the data went back.
    past: Vec<(u64, i64)>,
    newest: Option<u64>,
    /// As told last.
    alarms: Vec<String>,
    pub opened: u64,
    /// Messages that pages skipped, as they were told.
    pub skipped: u64,
    pub lies: Vec<String>,
}

impl Pages {
    pub fn new() -> Self {
        Self {
            hub: Hub::with_lag(LAG),
            open: None,
            past: Vec::new(),
            newest: None,
            alarms: Vec::new(),
            opened: 0,
            skipped: 0,
            lies: Vec::new(),
        }
    }

    /// The service begins anew: pages lose their connection, and nothing is remembered.
    pub fn restart(&mut self) {
        (self.hub, self.open) = (Hub::with_lag(LAG), None);
        self.past.clear();
        (self.newest, self.alarms) = (None, Vec::new());
    }

    pub fn verdict(&mut self, verdict: &Verdict) {
        if self.past.last().is_some_and(|(_, t0)| verdict.t0 < *t0) {
            self.past.clear();
        }
        self.past.push((verdict.window, verdict.t0));
        self.newest = Some(verdict.window);
        self.hub.verdict("bench", verdict, Value::Array(Vec::new()));
    }

    /// Once a second.
    pub fn status(&mut self, health: &Health, log: &str) {
        self.alarms = health.alarms().map(|alarm| alarm.id.clone()).collect();
        let alarms = health.alarms().map(|alarm| AlarmStatus {
            id: alarm.id.clone(),
            since_ns: alarm.since_ns,
            place: String::new(),
            what: String::new(),
            state: String::new(),
            acknowledged: alarm.acknowledged,
            stage: alarm.stage.clone(),
            channel: alarm.channel.clone(),
            evidence: None,
            seen: None,
        });
        let bench = BenchStatus {
            name: "bench".into(),
            machine: String::new(),
            instrument: String::new(),
            motor_speed_hz: None,
            brake_torque_nm: None,
            temperature_c: None,
            sources: Vec::new(),
            alarms: alarms.collect(),
        };
        let facts = BTreeMap::from([("log".to_owned(), log.to_owned())]);
        self.hub.status(&Status { benches: vec![bench], facts });
    }

    /// Somebody opens a page: it shows at once all that there is.
    pub fn open(&mut self, now_ms: u64, stalls_until: u64) {
        let (kept, receiver) = self.hub.subscribe();
        let kept: Vec<(&str, Value)> =
            kept.map(|m| (m.kind, serde_json::from_str(&m.json).unwrap_or_default())).collect();
        let of = |kind: &str| kept.iter().filter(|(k, _)| *k == kind).map(|(_, json)| json.clone()).collect::<Vec<_>>();
        let times: Vec<i64> = self.past.iter().map(|(_, t0)| *t0).collect();
        let past = of("past").pop().map_or_else(Vec::new, |past| {
            past["t0_ns"].as_array().into_iter().flatten().filter_map(Value::as_i64).collect::<Vec<_>>()
        });
        if past != times {
            let (shown, all) = (past.len(), times.len());
            self.lies.push(format!("at {now_ms} ms a page that opens shows {shown} windows of {all}"));
        }
        let newest = of("verdict").pop().and_then(|verdict| verdict["window"].as_u64());
        if newest != self.newest {
            self.lies.push(format!("at {now_ms} ms a page that opens shows window {newest:?}, not {:?}", self.newest));
        }
        self.opened += 1;
        let alarms = of("status").pop().map_or_else(Vec::new, |status| ids(&status));
        self.open = Some(Open { receiver, stalls_until, newest, skipped: 0, alarms });
        self.compare(now_ms);
    }

    /// Pages read what has come.
    pub fn read(&mut self, now_ms: u64) {
        let Some(page) = self.open.as_mut().filter(|page| now_ms >= page.stalls_until) else { return };
        loop {
            match page.receiver.try_recv() {
                Ok(message) if message.kind == "verdict" => {
                    let json: Value = serde_json::from_str(&message.json).unwrap_or_default();
                    let window = json["window"].as_u64();
                    let (after, skipped) = (page.newest, std::mem::take(&mut page.skipped));
                    if window <= after && after.is_some() {
                        self.lies.push(format!("at {now_ms} ms a page is told of window {window:?} after {after:?}"));
                    }
                    let hole = self.past.iter().any(|(w, _)| Some(*w) > after && Some(*w) < window);
                    if hole && skipped == 0 {
                        self.lies
                            .push(format!("at {now_ms} ms a page misses what lies between {after:?} and {window:?}"));
                    }
                    page.newest = window;
                }
                Ok(message) if message.kind == "status" => {
                    page.alarms = ids(&serde_json::from_str(&message.json).unwrap_or_default());
                }
                Ok(_) => {}
                Err(TryRecvError::Lagged(count)) => {
                    page.skipped += count;
                    self.skipped += count;
                }
                Err(TryRecvError::Empty | TryRecvError::Closed) => break,
            }
        }
        self.compare(now_ms);
    }

    /// A page that has read all shows the newest window and the alarms that stand.
    fn compare(&mut self, now_ms: u64) {
        let Some(page) = &self.open else { return };
        if page.newest != self.newest || page.alarms != self.alarms {
            self.lies.push(format!(
                "at {now_ms} ms a page shows window {:?} and alarms {:?}; there are {:?} and {:?}",
                page.newest, page.alarms, self.newest, self.alarms
            ));
        }
    }
}

fn ids(status: &Value) -> Vec<String> {
    let alarms = status["benches"][0]["alarms"].as_array().into_iter().flatten();
    alarms.filter_map(|alarm| alarm["id"].as_str().map(str::to_owned)).collect()
}
