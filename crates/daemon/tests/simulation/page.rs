//! What pages see: the service's own hub, pages that open at any moment, and pages that read
//! nothing for a while.

use std::collections::BTreeMap;
use std::sync::Arc;

use gearwatch_alarm::Health;
use gearwatch_core::verdict::Verdict;
use gearwatch_daemon::web::{AlarmStatus, BenchStatus, Hub, Listener, Status};
use serde_json::Value;

/// A page that lags behind by more messages is told all anew: few, so that it happens in a world.
const LAG: usize = 16;

/// A page that somebody has open.
struct Open {
    listener: Listener,
    /// It reads nothing until then (ms).
    stalls_until: u64,
    newest: Option<u64>,
    /// Ids of the alarms that it shows.
    alarms: Vec<String>,
}

pub struct Pages {
    hub: Arc<Hub>,
    open: Option<Open>,
    /// Windows that a page should show: since the start of the service, or since the time of the
    /// data went back.
    past: Vec<(u64, i64)>,
    newest: Option<u64>,
    /// As told last.
    alarms: Vec<String>,
    pub opened: u64,
    /// Messages that pages fell behind by.
    pub skipped: u64,
    pub lies: Vec<String>,
}

impl Pages {
    pub fn new() -> Self {
        Self {
            hub: Arc::new(Hub::with_lag(LAG)),
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
        (self.hub, self.open) = (Arc::new(Hub::with_lag(LAG)), None);
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
        self.hub.status(&Status { benches: vec![bench], facts, ..Status::default() });
    }

    /// Somebody opens a page: it shows at once all that there is.
    pub fn open(&mut self, now_ms: u64, stalls_until: u64) {
        self.opened += 1;
        self.open = Some(Open { listener: Listener::new(&self.hub), stalls_until, newest: None, alarms: Vec::new() });
        self.take_in(now_ms);
    }

    /// Pages read what has come.
    pub fn read(&mut self, now_ms: u64) {
        if self.open.as_ref().is_some_and(|page| now_ms >= page.stalls_until) {
            self.take_in(now_ms);
        }
    }

    fn take_in(&mut self, now_ms: u64) {
        let Some(page) = &mut self.open else { return };
        let fell_behind_by = page.listener.skipped;
        while let Some(message) = page.listener.try_next() {
            let json: Value = serde_json::from_str(&message.json).unwrap_or_default();
            match message.kind {
                // All that is kept, told anew.
                "past" => {
                    let times: Vec<i64> = self.past.iter().map(|(_, t0)| *t0).collect();
                    let shown = json["t0_ns"].as_array().into_iter().flatten();
                    let shown: Vec<i64> = shown.filter_map(Value::as_i64).collect();
                    if shown != times {
                        let (shown, all) = (shown.len(), times.len());
                        self.lies.push(format!("at {now_ms} ms a page is shown {shown} windows of {all}"));
                    }
                    page.newest = None;
                }
                "verdict" => {
                    let (window, after) = (json["window"].as_u64(), page.newest);
                    if window <= after && after.is_some() {
                        self.lies.push(format!("at {now_ms} ms a page is told of window {window:?} after {after:?}"));
                    }
                    let between = |w: u64| after.is_some_and(|after| w > after) && Some(w) < window;
                    if self.past.iter().any(|(w, _)| between(*w)) {
                        self.lies
                            .push(format!("at {now_ms} ms a page misses what lies between {after:?} and {window:?}"));
                    }
                    page.newest = window;
                }
                "status" => page.alarms = ids(&json),
                _ => {}
            }
        }
        self.skipped += page.listener.skipped - fell_behind_by;
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
