//! One world: what happens in it follows from its seed alone.

use std::sync::{Arc, Mutex};
use std::time::Duration;

use gearwatch_alarm::{Acknowledgement, AlarmConfig, Health};
use gearwatch_core::verdict::{MachineState, Verdict};
use gearwatch_core::window::Window;
use gearwatch_daemon::event::Event;
use gearwatch_log::{
    AlarmRecord, Cause, Compression, Condition, Gap, Judgement, LogConfig, Now, Record, Sender, Sent, Stepper, Watch,
};
use gearwatch_testkit::disk::{Fault as DiskFault, Plan, Simulated};

use crate::line::{Heard, Intake, Line, Seen};
use crate::page::Pages;
use crate::post::{Post, bench};
use crate::trouble::{Chance, Fault, Totals};
use crate::written;
use gearwatch_testkit::log::context;

/// The world goes on in steps of this (ms): a frame of samples is sent, a window is complete each
/// second, the supervisor looks.
const STEP_MS: u64 = 250;
/// When the wall clock of a world begins (ns since 1970).
const BEGINNING_NS: i64 = 1_795_228_800_000_000_000;

/// What was handed to the log.
pub struct Offered {
    pub sent: Sent,
    /// Which start of the service it was handed to.
    pub start: usize,
    pub what: What,
}

pub enum What {
    /// A window, and its line.
    Window(u64, Vec<u8>),
    Gap,
    Alarm(Box<AlarmRecord>),
}

/// All but the log itself, which is at work on the disk while the rest goes on.
pub struct Outside {
    mono_ms: u64,
    /// How far the wall clock was set (ms).
    wall_ms: i64,
    log: Option<(Sender, Watch)>,
    health: Health,
    /// Sender and network, and the service's side while there is one.
    line: Line,
    intake: Option<Intake>,
    /// The sinks beside the log, and the pages.
    pub post: Post,
    pub pages: Pages,
    chance: Chance,
    /// Numbers of windows: of the first one of this start, and of the next one.
    first_window: u64,
    next_window: u64,
    worker_fails: bool,
    overloaded_until: u64,
    damaged_until: u64,
    pub offered: Vec<Offered>,
    pub start: usize,
    /// (number, when it was accepted) of results that are not durable yet.
    waiting: Vec<(u64, u64)>,
    /// Something was wrong with the disk or the log until then.
    trouble_until: u64,
    /// The next call that makes something durable takes so long; those up to a time take so long.
    hang_ms: u64,
    slow: (u64, u64),
    waits: Waits,
    /// As configured.
    group_ms: u64,
    pub looks: u64,
    pub looks_ok: u64,
    pub lies: Vec<String>,
    totals: Totals,
}

/// A time in which results wait longer than a group and a step explain, as the service's supervisor
/// says.
#[derive(Default)]
struct Wait {
    /// Since when (ms).
    since: Option<u64>,
    /// What was durable at the last look, and since when (ms).
    durable: (u64, u64),
    longest_ms: u64,
    /// The log said why, or somebody took a file: no sync need be slow.
    explained: bool,
}

/// What the supervisor's looks say of syncs.
#[derive(Default)]
struct Waits {
    now: Wait,
    /// When the last wait without an explanation was over (ms).
    before: Option<u64>,
}

/// Without anything durable for longer than two slow syncs, one after the other, and a group of a
/// second: a sync hangs.
const HANGS_MS: u64 = 4500;
/// Slow syncs make one wait after the other; a sync that hung is followed by none.
const SOON_MS: u64 = 2500;

impl Waits {
    /// Takes a look; says what a wait that is over was.
    fn take(&mut self, judged: &Judgement, group_ms: u64, now_ms: u64) -> Option<Fault> {
        let durable = judged.state.durable_seq;
        let wait = &mut self.now;
        if judged.waits.as_millis() as u64 <= group_ms + STEP_MS {
            let over = std::mem::take(wait);
            let since = over.since.filter(|_| !over.explained)?;
            let before = self.before.replace(now_ms);
            let soon = before.is_some_and(|before| since < before + SOON_MS);
            return (over.longest_ms > HANGS_MS).then_some(Fault::Hang).or(soon.then_some(Fault::Slow));
        }
        if wait.since.is_none() {
            (wait.since, wait.durable) = (Some(now_ms), (durable, now_ms));
        }
        if durable > wait.durable.0 {
            wait.durable = (durable, now_ms);
        }
        wait.longest_ms = wait.longest_ms.max(now_ms - wait.durable.1);
        wait.explained |= judged.state.condition != Condition::Ok || judged.state.files_lost > 0;
        None
    }
}

pub struct World {
    outside: Arc<Mutex<Outside>>,
    disk: Simulated,
    chance: Chance,
    faults: Vec<Fault>,
    config: LogConfig,
    log: Option<Stepper>,
    /// The disk is put right then.
    mend_at: Option<u64>,
    /// The last sync that hangs is over then (ms).
    hung_until: u64,
    /// Starts that ended by a kill or a power cut, or whose end the disk did not take; and those
    /// that ended by a power cut.
    pub crashed: Vec<usize>,
    pub powerless: Vec<usize>,
    /// Starts whose file was taken away, once for each time.
    pub taken: Vec<usize>,
    /// Every fault is told: one world is looked at.
    tells: bool,
    /// Alarms that the last start found, and those that should stand by what was kept.
    pub restored: Vec<AlarmRecord>,
}

fn now_of(mono_ms: u64, wall_ms: i64) -> Now {
    let wall_ns = BEGINNING_NS + (mono_ms as i64 + wall_ms) * 1_000_000;
    Now { wall_ns, mono: Duration::from_millis(mono_ms) }
}

impl Outside {
    fn now(&self) -> Now {
        now_of(self.mono_ms, self.wall_ms)
    }

    /// Time passes, with all that happens meanwhile but the log's own work.
    fn pass(&mut self, ms: u64) {
        let end = self.mono_ms + ms;
        while self.mono_ms < end {
            self.mono_ms = (self.mono_ms / STEP_MS + 1) * STEP_MS;
            let wall_ns = self.now().wall_ns;
            self.line.sample(self.mono_ms, wall_ns, self.intake.is_some());
            self.receive();
            self.look();
            if self.log.is_some() {
                self.post.pass(self.mono_ms);
                self.pages.read(self.mono_ms);
            }
        }
    }

    fn offer(&mut self, what: What, record: Record) {
        let Some((sender, _)) = &self.log else { return };
        let sent = sender.send(record, self.now());
        if let Sent::Queued { seq } = sent {
            self.waiting.push((seq, self.mono_ms));
        }
        self.offered.push(Offered { sent, start: self.start, what });
    }

    /// What has come over the network goes its way.
    fn receive(&mut self) {
        let pieces = self.line.deliver(self.mono_ms, &mut self.chance);
        let Some(intake) = &mut self.intake else { return };
        let heard = intake.take(&pieces);
        intake.account();
        self.lies.append(&mut intake.lies);
        for heard in heard {
            match heard {
                Heard::Missing(missing) => {
                    let last = missing.found_index.saturating_sub(1).max(missing.expected_index);
                    let count = missing.found_index.saturating_sub(missing.expected_index);
                    self.gap("acc_1", (missing.expected_index, last, count), Cause::Discontinuity);
                }
                Heard::Verdicts(window, verdicts) => self.window(&window, verdicts),
            }
        }
    }

    fn gap(&mut self, channel: &str, (first, last, count): (u64, u64, u64), cause: Cause) {
        let gap = Gap { channel: channel.to_owned(), first, last, count, cause, t_ns: self.now().wall_ns };
        self.tell(&Event::Gap { bench: bench(), gap: gap.clone() });
        self.offer(What::Gap, Record::Gap(gap));
    }

    fn window(&mut self, window: &Window, verdicts: Vec<Verdict>) {
        // Numbers of all starts in one row, so that no two windows have the same.
        let number = self.first_window + window.number;
        if number != self.next_window {
            self.lies
                .push(format!("at {} ms window {number} came where {} was to come", self.mono_ms, self.next_window));
        }
        self.next_window = number + 1;
        if std::mem::take(&mut self.worker_fails) {
            return self.gap("acc_1 windows", (number, number, 1), Cause::Failure);
        }
        if self.mono_ms < self.overloaded_until {
            return self.gap("acc_1 windows", (number, number, 1), Cause::Overload);
        }
        for mut verdict in verdicts {
            verdict.window = number;
            if self.mono_ms < self.damaged_until {
                verdict.machine = MachineState::Alarm;
            }
            let line = serde_json::to_string(&verdict).unwrap();
            let changed = self.health.take(&verdict);
            let verdict = Arc::new(verdict);
            self.pages.verdict(&verdict);
            self.tell(&Event::Verdict {
                bench: bench(),
                several: false,
                verdict: verdict.clone(),
                line: line.as_str().into(),
            });
            let record = Record::Verdict { bench: None, verdict, line: line.as_str().into() };
            self.offer(What::Window(number, line.into_bytes()), record);
            if let Some(alarm) = changed {
                self.totals.witnessed(Fault::Gears, u64::from(alarm.active));
                self.tell(&Event::Alarm { bench: bench(), alarm: alarm.clone(), seen: None });
                self.alarm(AlarmRecord::new("bench", &alarm, None));
            }
        }
    }

    /// Tells the sinks beside the log.
    fn tell(&mut self, event: &Event) {
        let t_ns = self.now().wall_ns;
        self.post.tell(event, self.mono_ms, t_ns);
    }

    fn alarm(&mut self, alarm: AlarmRecord) {
        self.offer(What::Alarm(Box::new(alarm.clone())), Record::Alarm(Arc::new(alarm)));
    }

    /// The supervisor looks, and is checked by what this world knows itself.
    fn look(&mut self) {
        let Some((_, watch)) = &mut self.log else { return };
        let judged = watch.look(Duration::from_millis(self.mono_ms));
        let durable = judged.state.durable_seq;
        self.waiting.retain(|(seq, _)| *seq > durable);
        let oldest_ms = self.waiting.first().map_or(0, |(_, since)| self.mono_ms - since);
        if let Some(seen) = self.waits.take(&judged, self.group_ms, self.mono_ms) {
            self.totals.witnessed(seen, 1);
        }
        if self.mono_ms.is_multiple_of(1000) {
            self.pages.status(&self.health, if judged.ok { "ok" } else { &judged.why });
        }
        self.looks += 1;
        self.looks_ok += u64::from(judged.ok);
        if judged.ok && oldest_ms > 2000 {
            self.lies.push(format!("at {} ms ok, while a result waits for {oldest_ms} ms", self.mono_ms));
        }
        if judged.state.files_removed > 0 {
            self.lies.push(format!("at {} ms a file was removed, though all are to be kept", self.mono_ms));
        }
        // Twelve seconds after the last trouble everything is all right again, and must be said to
        // be.
        if !judged.ok && oldest_ms < 1900 && self.mono_ms > self.trouble_until + 12_000 {
            self.lies.push(format!("at {} ms not ok without a reason: {}", self.mono_ms, judged.why));
        }
    }

    /// The service's side of the line ends.
    fn hang_up(&mut self) {
        self.line.cut(self.mono_ms);
        let Some(intake) = self.intake.take() else { return };
        let Seen { damaged, lost, silent, bursts } = intake.seen;
        self.totals.witnessed(Fault::Flip, damaged);
        self.totals.witnessed(Fault::Lost, lost);
        self.totals.witnessed(Fault::Outage, silent);
        self.totals.witnessed(Fault::Held, bursts);
    }

    /// Somebody other than the injector saw a fault.
    pub fn witness(&mut self, fault: Fault, count: u64) {
        self.totals.witnessed(fault, count);
    }

    fn trouble(&mut self, ms: u64) {
        self.trouble_until = self.trouble_until.max(self.mono_ms + ms);
    }
}

impl World {
    /// Lets a world be for so long, with faults of these kinds, then ends it in good order.
    pub fn live(seed: u64, secs: u64, faults: &[Fault]) -> Self {
        let mut chance = Chance::new(seed);
        let config = LogConfig {
            group_ms: [50, 200, 1000][chance.below(3) as usize],
            queue_records: [4, 8, 64][chance.below(3) as usize],
            rotate_bytes: [8 << 10, 64 << 10][chance.below(2) as usize],
            rotate_secs: 60,
            keep_secs: 400 * 86_400,
            ..LogConfig::default()
        };
        let disk = Simulated::new(seed);
        let outside = Outside {
            mono_ms: 0,
            wall_ms: 0,
            log: None,
            health: health(),
            line: Line::new(seed),
            intake: None,
            post: Post::new(seed),
            pages: Pages::new(),
            chance: Chance::new(!seed),
            first_window: 0,
            next_window: 0,
            worker_fails: false,
            overloaded_until: 0,
            damaged_until: 0,
            offered: Vec::new(),
            start: 0,
            waiting: Vec::new(),
            trouble_until: 0,
            hang_ms: 0,
            slow: (0, 0),
            waits: Waits::default(),
            group_ms: config.group_ms,
            looks: 0,
            looks_ok: 0,
            lies: Vec::new(),
            totals: Totals::default(),
        };
        let outside = Arc::new(Mutex::new(outside));
        let meanwhile = outside.clone();
        disk.set_meanwhile(move || {
            let mut outside = meanwhile.lock().unwrap();
            let slow = if outside.mono_ms < outside.slow.0 { outside.slow.1 } else { 0 };
            let ms = std::mem::take(&mut outside.hang_ms) + slow;
            if ms > 0 {
                outside.trouble(ms);
                outside.pass(ms);
            }
        });
        let mut world = Self {
            outside,
            disk,
            chance,
            faults: faults.to_vec(),
            config: written::read(&written::text(&config)).expect("it is right"),
            log: None,
            mend_at: None,
            hung_until: 0,
            crashed: Vec::new(),
            powerless: Vec::new(),
            taken: Vec::new(),
            tells: std::env::var_os("GEARWATCH_SEED").is_some(),
            restored: Vec::new(),
        };
        world.start();
        while world.at(|outside| outside.mono_ms) < secs * 1000 {
            world.step();
        }
        world.mend();
        world.calm();
        world.stop();
        world.start();
        world.stop();
        world.at(|outside| outside.post.finish(outside.mono_ms));
        world
    }

    pub fn disk(&self) -> &Simulated {
        &self.disk
    }

    pub fn totals(&self) -> Totals {
        self.at(|outside| outside.totals.clone())
    }

    pub fn at<T>(&self, ask: impl FnOnce(&mut Outside) -> T) -> T {
        ask(&mut self.outside.lock().unwrap())
    }

    fn now(&self) -> Now {
        self.at(|outside| outside.now())
    }

    fn step(&mut self) {
        if self.chance.below(40) == 0 {
            self.inject();
        }
        self.at(|outside| outside.pass(STEP_MS));
        if self.mend_at.is_some_and(|at| self.at(|outside| outside.mono_ms) >= at) {
            self.mend();
        }
        let now = self.now();
        match &mut self.log {
            Some(log) => log.step(now),
            // A disk that fails can keep a start from reading the folder; it is tried again.
            None => self.start(),
        }
    }

    fn mend(&mut self) {
        self.mend_at = None;
        self.disk.plan(None);
        self.disk.set_capacity(None);
        self.at(|outside| {
            outside.trouble(1000);
            outside.post.disk().plan(None);
            outside.post.disk().set_capacity(None);
        });
    }

    /// Nothing goes wrong for a while.
    fn calm(&mut self) {
        self.at(|outside| (outside.slow, outside.hang_ms) = ((0, 0), 0));
        for _ in 0..120 {
            self.at(|outside| outside.pass(STEP_MS));
            let now = self.now();
            match &mut self.log {
                Some(log) => log.step(now),
                None => self.start(),
            }
        }
    }

    fn start(&mut self) {
        let started = Stepper::start(self.config.clone(), context(), Box::new(self.disk.clone()), self.now());
        let Ok(log) = started else { return };
        if self.tells {
            println!("a start finds {:?}", log.recovery());
        }
        self.restored = log.recovery().alarms.clone();
        let (sender, watch) = (log.sender(), log.watch());
        let (restored, group_ms) = (self.restored.clone(), self.config.group_ms);
        self.at(|outside| {
            outside.start += 1;
            outside.waiting.clear();
            (outside.waits, outside.group_ms) = (Waits::default(), group_ms);
            outside.health = health();
            restored.into_iter().for_each(|record| outside.health.restore(record.alarm, true));
            outside.log = Some((sender, watch));
            outside.intake = Some(Intake::new());
            outside.pages.restart();
            outside.first_window = outside.next_window;
            outside.trouble(0);
        });
        self.log = Some(log);
    }

    /// Ends the log in good order, if the disk lets it.
    fn stop(&mut self) {
        let now = self.now();
        let Some(log) = self.log.take() else { return };
        // The sources end before the log does.
        self.at(Outside::hang_up);
        let closed = log.stop(now);
        let start = self.at(|outside| {
            outside.log = None;
            outside.post.end(true, outside.mono_ms);
            outside.start
        });
        if !closed {
            self.crashed.push(start);
        }
    }

    fn crash(&mut self) {
        self.log = None;
        let start = self.at(|outside| {
            outside.hang_up();
            outside.log = None;
            outside.post.end(false, outside.mono_ms);
            (outside.hang_ms, outside.slow) = (0, (0, 0));
            outside.start
        });
        self.crashed.push(start);
    }

    /// Whether a fault can be told from those that last.
    fn has_room_for(&self, fault: Fault, mono_ms: u64) -> bool {
        let of_a_disk = matches!(fault, Fault::Full | Fault::Io | Fault::Taken | Fault::SpoolFull | Fault::SpoolIo);
        // Syncs that hang soon after one another look like slow ones.
        let too_soon = fault == Fault::Hang && mono_ms < self.hung_until + 2 * SOON_MS;
        !(too_soon || of_a_disk && self.mend_at.is_some())
    }

    fn kill(&mut self) {
        self.crash();
        self.disk.restart();
        self.at(|outside| outside.post.disk().restart());
        self.start();
        // The next start finds that the log was not closed.
        let unclean = self.log.as_ref().is_some_and(|log| log.recovery().unclean);
        self.at(|outside| outside.totals.witnessed(Fault::Kill, u64::from(unclean)));
    }

    fn power_cut(&mut self) {
        let before = self.disk.witness();
        self.crash();
        self.powerless.extend(self.crashed.last());
        self.disk.power_cut();
        self.at(|outside| outside.post.power_cut());
        let torn = self.disk.witness().torn_bytes > before.torn_bytes;
        self.at(|outside| outside.totals.witnessed(Fault::PowerCut, u64::from(torn)));
        self.start();
    }

    fn inject(&mut self) {
        let fault = self.faults[self.chance.below(self.faults.len() as u64) as usize];
        let (mono_ms, running) = self.at(|outside| (outside.mono_ms, outside.log.is_some()));
        if !running || !self.has_room_for(fault, mono_ms) {
            return;
        }
        let for_ms = self.chance.between(1, 15) * 1000;
        if self.tells {
            println!(
                "{mono_ms} ms, number {}: {fault:?} {for_ms} ms",
                self.log.as_ref().map_or(0, Stepper::durable_seq)
            );
        }
        self.at(|outside| outside.totals.injected(fault));
        match fault {
            Fault::Hang => {
                self.hung_until = mono_ms + for_ms;
                self.at(|outside| outside.hang_ms = for_ms);
            }
            Fault::Slow => {
                let each_ms = self.chance.between(300, 1500);
                self.at(|outside| outside.slow = (mono_ms + 2 * for_ms, each_ms));
            }
            Fault::Full => {
                let used = self.disk.contents().values().map(|file| file.len() as u64).sum::<u64>();
                self.disk.set_capacity(Some(used + self.chance.below(600)));
                self.mend_at = Some(mono_ms + for_ms);
                self.at(|outside| outside.trouble(for_ms + 3000));
            }
            Fault::Io => {
                let for_good = self.chance.below(2) == 0;
                let call = self.chance.between(1, 6);
                self.disk.plan(Some(Plan { call, fault: DiskFault::Io, for_good }));
                self.mend_at = Some(mono_ms + for_ms);
                self.at(|outside| outside.trouble(for_ms + 3000));
            }
            Fault::Kill => self.kill(),
            Fault::PowerCut => self.power_cut(),
            Fault::Taken => self.take_away(),
            Fault::Clock => {
                const DAY_MS: i64 = 86_400_000;
                let by_ms = [3_600_000, -DAY_MS, 401 * DAY_MS, -1000, -300 * DAY_MS][self.chance.below(5) as usize];
                self.at(|outside| outside.wall_ms += by_ms);
            }
            Fault::Reload => {
                self.stop();
                self.start();
                let found = self.log.as_ref().is_some_and(|log| !log.recovery().unclean);
                self.at(|outside| outside.totals.witnessed(fault, u64::from(found)));
            }
            Fault::Changed => {
                let text = written::text(&written::changed(&self.config, &mut self.chance));
                self.read_again(&text);
            }
            Fault::Spoilt => {
                let text = written::text(&written::changed(&self.config, &mut self.chance));
                let text = written::spoilt(&text, &mut self.chance);
                self.read_again(&text);
            }
            Fault::Outage => self.at(|outside| outside.line.silent_until = mono_ms + for_ms),
            // Fifteen windows at once do not fit into the shortest queue.
            Fault::Held => self.at(|outside| {
                outside.line.held_until = mono_ms + for_ms;
                outside.trouble(for_ms + 1000);
            }),
            Fault::Flip => {
                let at = self.chance.below(1 << 20);
                self.at(|outside| outside.line.flip = Some(at));
            }
            Fault::Lost => self.at(|outside| {
                outside.line.cut(mono_ms + for_ms / 5);
                outside.intake.as_mut().into_iter().for_each(Intake::connect_again);
            }),
            Fault::Overload => self.at(|outside| outside.overloaded_until = mono_ms + for_ms),
            Fault::Worker => self.at(|outside| outside.worker_fails = true),
            Fault::Gears => self.at(|outside| outside.damaged_until = mono_ms + 2 * for_ms),
            Fault::Seen => self.acknowledge(),
            // Long enough for the spool to become full now and then.
            Fault::Broker => self.at(|outside| outside.post.away_until = mono_ms + 5 * for_ms),
            Fault::Broken => self.at(|outside| outside.post.broken_until = mono_ms + for_ms / 5),
            Fault::SpoolFull => {
                let room = self.chance.below(3000);
                self.at(|outside| {
                    let used = outside.post.disk().contents().values().map(|file| file.len() as u64).sum::<u64>();
                    outside.post.disk().set_capacity(Some(used + room));
                });
                self.mend_at = Some(mono_ms + for_ms);
            }
            Fault::SpoolIo => {
                let (for_good, call) = (self.chance.below(2) == 0, self.chance.between(1, 6));
                let plan = Some(Plan { call, fault: DiskFault::Io, for_good });
                self.at(|outside| outside.post.disk().plan(plan));
                self.mend_at = Some(mono_ms + for_ms);
            }
            Fault::Opened => self.at(|outside| outside.pages.open(mono_ms, 0)),
            // Two messages a second, and room for sixteen.
            Fault::Stalled => self.at(|outside| outside.pages.open(mono_ms, mono_ms + 2 * for_ms)),
        }
    }

    /// A configuration that is right is taken; with a wrong one the service goes on as it is.
    fn read_again(&mut self, text: &str) {
        match written::read(text) {
            Ok(config) => {
                self.stop();
                self.config = config;
                self.start();
            }
            Err(_) => self.at(|outside| outside.totals.witnessed(Fault::Spoilt, 1)),
        }
    }

    /// How the files are packed that are written last.
    pub fn compression(&self) -> &'static str {
        match self.config.compression {
            Compression::None => "",
            Compression::Zstd => "zstd",
        }
    }

    fn take_away(&mut self) {
        let Some(file) = self.log.as_ref().map(|log| log.state().file).filter(|file| !file.is_empty()) else { return };
        let before = self.disk.witness().taken;
        if self.chance.below(2) == 0 {
            self.disk.take_away(&file);
        } else {
            let length = self.disk.contents().get(&file).map_or(0, Vec::len) as u64;
            self.disk.cut(&file, self.chance.below(length) as usize);
        }
        let taken = self.disk.witness().taken - before;
        self.at(|outside| {
            outside.totals.witnessed(Fault::Taken, taken);
            outside.trouble(3000);
        });
        let start = self.at(|outside| outside.start);
        self.taken.push(start);
    }

    fn acknowledge(&mut self) {
        self.at(|outside| {
            let ids: Vec<String> = outside.health.alarms().map(|alarm| alarm.id.clone()).collect();
            for id in ids {
                let t_ns = outside.now().wall_ns;
                let seen = Acknowledgement {
                    who: "somebody".into(),
                    why: "seen".into(),
                    from: "here".into(),
                    t_ns,
                    until_ns: None,
                };
                let Some(alarm) = outside.health.acknowledge(&id, &seen) else { continue };
                outside.totals.witnessed(Fault::Seen, 1);
                outside.tell(&Event::Alarm {
                    bench: bench(),
                    alarm: alarm.clone(),
                    seen: Some(Arc::new(seen.clone())),
                });
                outside.alarm(AlarmRecord::new("bench", &alarm, Some(&seen)));
            }
        });
    }

    /// What the world as a whole saw of faults that last.
    pub fn witness_of_lasting(&self) {
        let disk = self.disk.witness();
        self.at(|outside| {
            outside.totals.witnessed(Fault::Io, disk.io_errors);
            outside.totals.witnessed(Fault::Full, disk.found_full);
            let spool = outside.post.disk().witness();
            let told_lost = outside.post.told_lost();
            for (fault, count) in [
                (Fault::SpoolIo, spool.io_errors),
                (Fault::SpoolFull, spool.found_full),
                (Fault::Broker, outside.post.outages.min(told_lost)),
                (Fault::Broken, outside.post.resent()),
                (Fault::Opened, outside.pages.opened),
                (Fault::Stalled, outside.pages.skipped),
            ] {
                outside.totals.witnessed(fault, count);
            }
        });
    }
}

fn health() -> Health {
    Health::new(AlarmConfig { clear: 4, ..AlarmConfig::default() })
}
