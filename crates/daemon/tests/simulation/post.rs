//! The way of the letters: the service's own desk (numbering, spool, order, marks of repetition) on
//! a disk of its own, a line that breaks, and a broker that keeps what it has confirmed, and
//! nothing else.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::Arc;
use std::time::{Duration, Instant};

use gearwatch_daemon::event::Event;
use gearwatch_daemon::sink::{Desk, HandedOut, Position};
use gearwatch_testkit::disk::Simulated;
use serde_json::Value;

use crate::trouble::Chance;

/// The spool takes some forty letters: a broker that is away for a minute makes it full.
const SPOOL_BYTES: u64 = 64 << 10;
/// Letters under way at once, as the carriers have it.
const WINDOW: usize = 64;
/// How often the desk is told to make durable what it has, as its task does.
const TICK_MS: u64 = 500;
/// How long a letter, or the word that it is there, takes (ms).
const LATENCY_MS: u64 = 700;

/// A letter as the world knows it itself.
struct Written {
    /// Names the window, where the letter is about one.
    window: Option<u64>,
    /// Letters that this world had written before.
    serial: u64,
    /// The power was cut before it was durable; nobody has promised it.
    excused: bool,
}

/// On its way to the broker, or its confirmation on the way back.
struct UnderWay {
    due_ms: u64,
    letter: HandedOut,
    /// When the broker had it, so that its word goes back.
    back_ms: Option<u64>,
}

/// What the broker has.
#[derive(Default)]
struct Broker {
    /// In the order in which they came.
    letters: Vec<Value>,
}

pub struct Post {
    disk: Simulated,
    desk: Option<Desk>,
    begun: Instant,
    chance: Chance,
    run: u64,
    /// By run and number.
    written: BTreeMap<(String, u64), Written>,
    /// Letters of this run.
    count: u64,
    /// As the desk stood when this run began, letters that waited, and those written since.
    balance: u64,
    /// So many letters were written when the desk said last that all of them are durable.
    durable: u64,
    last_tick_ms: u64,
    under_way: VecDeque<UnderWay>,
    broker: Broker,
    connected: bool,
    /// The broker is away until then; the line is broken until then.
    pub away_until: u64,
    pub broken_until: u64,
    /// Lost for want of room or refused by the disk, as the desks of all runs have counted.
    lost: u64,
    /// How often the desk found itself without a broker.
    pub outages: u64,
    pub lies: Vec<String>,
}

/// What came of it, in figures.
#[derive(Clone, Copy, Debug, Default)]
pub struct Delivered {
    pub letters: u64,
    pub resent: u64,
    pub told_lost: u64,
    pub missing: u64,
}

impl Post {
    pub fn new(seed: u64) -> Self {
        Self {
            disk: Simulated::new(seed ^ 0x70_05),
            desk: None,
            begun: Instant::now(),
            chance: Chance::new(seed ^ 0x1e77e5),
            run: 0,
            written: BTreeMap::new(),
            count: 0,
            balance: 0,
            durable: 0,
            last_tick_ms: 0,
            under_way: VecDeque::new(),
            broker: Broker::default(),
            connected: false,
            away_until: 0,
            broken_until: 0,
            lost: 0,
            outages: 0,
            lies: Vec::new(),
        }
    }

    pub fn disk(&self) -> &Simulated {
        &self.disk
    }

    fn figure(desk: &Desk, name: &str) -> u64 {
        desk.standing().figures.iter().find(|(key, _)| *key == name).map_or(0, |(_, value)| *value as u64)
    }

    fn run_name(&self) -> String {
        format!("{:08x}", self.run)
    }

    /// Opens the desk where it is not open. A disk that fails can keep it from that; the sink is
    /// then tried again.
    fn open(&mut self) {
        if self.desk.is_some() {
            return;
        }
        self.run += 1;
        let heartbeat = Duration::from_secs(10);
        let Ok(desk) = Desk::open(Box::new(self.disk.clone()), SPOOL_BYTES, heartbeat, self.run_name()) else { return };
        (self.count, self.balance) = (0, Self::figure(&desk, "waiting"));
        self.desk = Some(desk);
    }

    /// Something happened that a broker's readers have to know of.
    pub fn tell(&mut self, event: &Event, now_ms: u64, t_ns: i64) {
        self.open();
        let now = self.begun + Duration::from_millis(now_ms);
        let run = self.run_name();
        // While the sink cannot be opened its queue takes events and loses the rest; here they are
        // lost at once, and the log has them.
        let Some(desk) = &mut self.desk else { return };
        let window = match event {
            Event::Verdict { verdict, .. } => Some(verdict.window),
            _ => None,
        };
        for letter in 0..desk.take(event, now, t_ns) {
            self.count += 1;
            self.balance += 1;
            let serial = self.written.len() as u64;
            let window = window.filter(|_| letter == 0);
            self.written.insert((run.clone(), self.count), Written { window, serial, excused: false });
        }
    }

    /// Time has come to `now_ms`: letters and confirmations arrive, the desk hands out more.
    pub fn pass(&mut self, now_ms: u64) {
        self.open();
        let Some(desk) = &self.desk else { return };
        if now_ms >= self.last_tick_ms + TICK_MS {
            self.last_tick_ms = now_ms;
            if desk.tick() {
                self.durable = self.written.len() as u64;
            }
        }
        if now_ms < self.away_until.max(self.broken_until) {
            return self.hang_up("the broker is away", now_ms);
        }
        if !self.connected {
            self.connected = true;
            desk.connected();
        }
        while self.under_way.len() < WINDOW {
            let Some(letter) = desk.hand_out() else { break };
            let last_ms = self.under_way.back().map_or(0, |last| last.due_ms);
            let due_ms = (now_ms + self.chance.below(LATENCY_MS)).max(last_ms);
            self.under_way.push_back(UnderWay { due_ms, letter, back_ms: None });
        }
        for under in &mut self.under_way {
            if under.back_ms.is_none() && under.due_ms <= now_ms {
                self.broker.letters.push(serde_json::from_str(&under.letter.payload).expect("a letter is JSON"));
                under.back_ms = Some(now_ms + self.chance.below(LATENCY_MS));
            }
        }
        while self.under_way.front().is_some_and(|first| first.back_ms.is_some_and(|back| back <= now_ms)) {
            let position: Option<Position> = self.under_way.pop_front().map(|first| first.letter.position);
            position.into_iter().for_each(|position| desk.confirm(position));
        }
        self.look(now_ms);
    }

    /// Every letter that waited or was written is confirmed, waits, or is counted as lost.
    fn look(&mut self, now_ms: u64) {
        let Some(desk) = &self.desk else { return };
        let [confirmed, waiting, lost] = ["confirmed", "waiting", "lost"].map(|name| Self::figure(desk, name));
        if confirmed + waiting + lost < self.balance {
            let balance = self.balance;
            self.lies.push(format!(
                "at {now_ms} ms {balance} letters are {confirmed} confirmed, {waiting} that wait and {lost} lost"
            ));
        }
        if desk.standing().ok != (lost == 0) {
            self.lies.push(format!("at {now_ms} ms {lost} letters are lost: {:?}", desk.standing()));
        }
    }

    /// The connection is lost, with all that is under way; part of that has got there before.
    fn hang_up(&mut self, why: &str, now_ms: u64) {
        if !std::mem::take(&mut self.connected) {
            return;
        }
        // A stream keeps its order: what got there is the beginning of what was on its way.
        let mut arrives = true;
        for under in self.under_way.drain(..).filter(|under| under.back_ms.is_none()) {
            arrives &= self.chance.below(2) == 0;
            if arrives {
                self.broker.letters.push(serde_json::from_str(&under.letter.payload).expect("a letter is JSON"));
            }
        }
        if let Some(desk) = &self.desk {
            desk.disconnected(why);
            self.outages += u64::from(!desk.standing().detail.starts_with("connected"));
        }
        self.look(now_ms);
    }

    /// The service ends, in order or not.
    pub fn end(&mut self, in_order: bool, now_ms: u64) {
        self.hang_up("the service ends", now_ms);
        let Some(desk) = self.desk.take() else { return };
        self.lost += Self::figure(&desk, "lost");
        if in_order {
            desk.close();
        }
    }

    /// The power is cut: what was spooled since the last tick need not be there.
    pub fn power_cut(&mut self) {
        self.disk.power_cut();
        let durable = self.durable;
        self.written.values_mut().filter(|letter| letter.serial >= durable).for_each(|letter| letter.excused = true);
    }

    /// Nothing new comes in and nothing goes wrong: all that waits gets there.
    pub fn finish(&mut self, mut now_ms: u64) {
        (self.away_until, self.broken_until) = (0, 0);
        let waiting = |desk: &Option<Desk>| desk.as_ref().map_or(1, |desk| Self::figure(desk, "waiting"));
        let end_ms = now_ms + 120_000;
        self.pass(now_ms);
        while waiting(&self.desk) > 0 && now_ms < end_ms {
            now_ms += 250;
            self.pass(now_ms);
        }
        if waiting(&self.desk) > 0 {
            self.lies.push(format!("{} letters wait for ever", waiting(&self.desk)));
        }
        self.end(true, now_ms);
    }

    /// Letters that came to the broker more than once and said so.
    pub fn resent(&self) -> u64 {
        self.broker.letters.iter().filter(|letter| letter["resent"] == true).count() as u64
    }

    /// Letters that were lost, as gap letters say.
    pub fn told_lost(&self) -> u64 {
        let spool_full = |letter: &&Value| letter["kind"] == "gap" && letter["cause"] == "spool_full";
        self.broker.letters.iter().filter(spool_full).filter_map(|letter| letter["count"].as_u64()).sum()
    }

    /// What the broker has, in the order in which it came.
    pub fn letters(&self) -> &[Value] {
        &self.broker.letters
    }

    /// Panics where a letter is missing that nobody has told of, came out of order, or came again
    /// without a mark.
    pub fn judge(&self, label: &str, lines: &BTreeMap<u64, Vec<u8>>) -> Delivered {
        assert!(self.lies.is_empty(), "{label}: {:?}", self.lies.first());
        let mut there: BTreeSet<(String, u64)> = BTreeSet::new();
        let mut newest: BTreeMap<&str, u64> = BTreeMap::new();
        let (mut newest_run, mut late) = ("", 0);
        for letter in &self.broker.letters {
            let (run, seq) = (letter["run"].as_str().unwrap(), letter["seq"].as_u64().unwrap());
            let key = (run.to_owned(), seq);
            if !there.insert(key.clone()) {
                assert_eq!(letter["resent"], true, "{label}: a repetition without a mark: {letter}");
                continue;
            }
            let last = newest.get(run).copied().unwrap_or(0);
            if seq <= last || run < newest_run {
                // What had to go for want of room, and whose file the disk still had after a power
                // cut: told as lost, and there after all.
                late += 1;
                let marked = letter["resent"] == true && late <= self.lost;
                assert!(marked, "{label}: number {seq} of run {run} came behind {last} of {newest_run}");
            } else {
                newest.insert(run, seq);
                newest_run = run;
            }
            let Some(written) = self.written.get(&key) else { panic!("{label}: nobody has written {letter}") };
            if let Some(line) = written.window.and_then(|window| lines.get(&window)) {
                let mut own = letter.clone();
                ["resent", "kind", "bench", "run", "seq"].iter().for_each(|key| {
                    own.as_object_mut().unwrap().shift_remove(*key);
                });
                let line: Value = serde_json::from_slice(line).unwrap();
                assert_eq!(own, line, "{label}: a letter is not what was said");
            }
        }
        let missing: Vec<_> = self.written.iter().filter(|(key, _)| !there.contains(key)).collect();
        let unexcused = missing.iter().filter(|(_, letter)| !letter.excused).count() as u64;
        assert!(
            unexcused <= self.lost,
            "{label}: {unexcused} letters never came, and {} are told as lost: {:?}",
            self.lost,
            missing.iter().filter(|(_, letter)| !letter.excused).map(|(key, _)| key).collect::<Vec<_>>()
        );
        Delivered {
            letters: there.len() as u64,
            resent: self.resent(),
            told_lost: self.told_lost(),
            missing: missing.len() as u64,
        }
    }
}

/// The name under which all letters go.
pub fn bench() -> Arc<str> {
    "bench".into()
}
