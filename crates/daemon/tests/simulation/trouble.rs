//! Faults, what they do, and who else saw them.

use std::collections::BTreeMap;

/// What goes wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Fault {
    /// A call that makes data durable does not come back for seconds.
    Hang,
    /// Every such call takes a second or so, for a while.
    Slow,
    /// The disk is full for a while.
    Full,
    /// Calls to the disk fail for a while.
    Io,
    /// The process is killed.
    Kill,
    /// The power is cut.
    PowerCut,
    /// Somebody removes or cuts the file that is written.
    Taken,
    /// Somebody sets the wall clock.
    Clock,
    /// The configuration is read again.
    Reload,
    /// A sender is silent for a while.
    Outage,
    /// A bit is changed on its way.
    Flip,
    /// A connection is lost, with all that was under way.
    Lost,
    /// The network holds everything back for a while.
    Held,
    /// The workers cannot keep up for a while.
    Overload,
    /// A worker panics at a window.
    Worker,
    /// The gears are damaged for a while.
    Gears,
    /// Somebody acknowledges the alarms that stand.
    Seen,
    /// The configuration says something else, and is read again.
    Changed,
    /// The configuration is wrong, and is read again.
    Spoilt,
    /// The broker is away for a while.
    Broker,
    /// The line to the broker breaks, with all that is under way.
    Broken,
    /// The spool's disk is full for a while.
    SpoolFull,
    /// Calls to the spool's disk fail for a while.
    SpoolIo,
    /// Somebody opens a page.
    Opened,
    /// Somebody opens a page that reads nothing for a while.
    Stalled,
}

impl Fault {
    pub const ALL: [Self; 25] = [
        Self::Hang,
        Self::Slow,
        Self::Full,
        Self::Io,
        Self::Kill,
        Self::PowerCut,
        Self::Taken,
        Self::Clock,
        Self::Reload,
        Self::Outage,
        Self::Flip,
        Self::Lost,
        Self::Held,
        Self::Overload,
        Self::Worker,
        Self::Gears,
        Self::Seen,
        Self::Changed,
        Self::Spoilt,
        Self::Broker,
        Self::Broken,
        Self::SpoolFull,
        Self::SpoolIo,
        Self::Opened,
        Self::Stalled,
    ];

    /// Those that there were when the worlds were lived that are kept because something was lost in
    /// them.
    pub fn of_old_worlds() -> &'static [Self] {
        const { Self::ALL.split_at(17).0 }
    }
}

/// How often each fault was injected, and how often somebody else saw it.
#[derive(Clone, Debug, Default)]
pub struct Totals(BTreeMap<Fault, (u64, u64)>);

impl Totals {
    pub fn injected(&mut self, fault: Fault) {
        self.0.entry(fault).or_default().0 += 1;
    }

    pub fn witnessed(&mut self, fault: Fault, count: u64) {
        self.0.entry(fault).or_default().1 += count;
    }

    pub fn of(&self, fault: Fault) -> (u64, u64) {
        self.0.get(&fault).copied().unwrap_or_default()
    }

    pub fn add(&mut self, other: &Self) {
        for (fault, (injected, witnessed)) in &other.0 {
            let sum = self.0.entry(*fault).or_default();
            *sum = (sum.0 + injected, sum.1 + witnessed);
        }
    }
}

/// Chance that follows from a seed (SplitMix64; Steele, Lea, Flood 2014).
pub struct Chance(u64);

impl Chance {
    pub fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ 0x5851_f42d_4c95_7f2d)
    }

    /// A number below `bound`.
    pub fn below(&mut self, bound: u64) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        (z ^ (z >> 31)) % bound.max(1)
    }

    pub fn between(&mut self, least: u64, most: u64) -> u64 {
        least + self.below(most - least + 1)
    }
}
