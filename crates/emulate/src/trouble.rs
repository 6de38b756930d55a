//! Trouble at random moments, the same for the same seed.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// What goes wrong, and how often. Times are seconds of signal; `None` is never.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TroubleConfig {
    /// The same seed, the same trouble.
    pub seed: u64,
    /// Writes end anywhere, often after one byte.
    pub split: bool,
    /// So many calls of `open` are refused with 403.
    pub refuse: u32,
    /// A channel is overloaded, every so often on average.
    pub clip_every_secs: Option<f64>,
    /// Samples are dropped and told as overrun.
    pub overrun_every_secs: Option<f64>,
    /// Nothing is sent for a while.
    pub stall_every_secs: Option<f64>,
    /// Length of a stall (s of wall time).
    pub stall_secs: f64,
    /// The connection is reset in the middle of a message.
    pub drop_every_secs: Option<f64>,
    /// One bit of a message is flipped.
    pub flip_every_secs: Option<f64>,
    /// A message is late by up to 0.05 s of wall time.
    pub delay_every_secs: Option<f64>,
    /// From then on nothing is sent on this connection.
    pub mute_after_secs: Option<f64>,
}

/// The longest delay (s of wall time).
const LONGEST_DELAY_SECS: f64 = 0.05;
/// An overload lasts so long (s of signal).
const CLIP_SECS: f64 = 1.0;
/// An overrun is at most so long (s of signal).
const OVERRUN_SECS: f64 = 0.5;

impl TroubleConfig {
    /// A mixture of everything that a network does, drawn from a seed.
    pub fn of_network(seed: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed ^ 0x006e_6574);
        let mut sometimes = |mean: f64| random.random_bool(0.7).then(|| mean * random.random_range(0.3..3.0));
        Self {
            seed,
            drop_every_secs: sometimes(20.0),
            flip_every_secs: sometimes(4.0),
            delay_every_secs: sometimes(4.0),
            stall_every_secs: sometimes(40.0),
            stall_secs: 0.2,
            overrun_every_secs: sometimes(20.0),
            clip_every_secs: sometimes(20.0),
            mute_after_secs: sometimes(20.0),
            split: random.random_bool(0.5),
            refuse: random.random_range(0..3),
        }
    }
}

/// One thing that goes wrong.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Incident {
    /// A channel is overloaded for so long (s of signal).
    Clip(f64),
    /// So much is dropped (s of signal).
    Overrun(f64),
    /// Nothing is sent for so long (s of wall time).
    Stall(f64),
    /// The next message is cut by a reset.
    Drop,
    /// A bit of the next message is flipped.
    Flip,
    /// The next message is late by so much (s of wall time).
    Delay(f64),
    /// Nothing is sent any more.
    Mute,
}

/// What goes wrong on one connection.
#[derive(Debug)]
pub struct Plan {
    random: ChaCha8Rng,
    /// Mean interval, and when it is due next.
    intervals: [(Option<f64>, f64); 6],
    stall_secs: f64,
    mute_at: f64,
}

impl Plan {
    /// The plan of connection number `connection`.
    pub fn new(config: &TroubleConfig, connection: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(config.seed.wrapping_mul(0x9e37_79b9).wrapping_add(connection));
        let every = [
            config.clip_every_secs,
            config.overrun_every_secs,
            config.stall_every_secs,
            config.drop_every_secs,
            config.flip_every_secs,
            config.delay_every_secs,
        ];
        let intervals = every.map(|mean| (mean, mean.map_or(f64::INFINITY, |mean| exponential(&mut random, mean))));
        Self {
            random,
            intervals,
            stall_secs: config.stall_secs,
            mute_at: config.mute_after_secs.unwrap_or(f64::INFINITY),
        }
    }

    /// What is due by now (s of signal since the connection began).
    pub fn due(&mut self, now_secs: f64) -> Vec<Incident> {
        let mut out = Vec::new();
        if now_secs >= self.mute_at {
            out.push(Incident::Mute);
        }
        for kind in 0..self.intervals.len() {
            let (Some(mean), at) = self.intervals[kind] else { continue };
            if now_secs < at {
                continue;
            }
            self.intervals[kind].1 = now_secs + exponential(&mut self.random, mean);
            out.push(match kind {
                0 => Incident::Clip(CLIP_SECS),
                1 => Incident::Overrun(self.random.random_range(0.0..OVERRUN_SECS)),
                2 => Incident::Stall(self.stall_secs),
                3 => Incident::Drop,
                4 => Incident::Flip,
                _ => Incident::Delay(self.random.random_range(0.0..LONGEST_DELAY_SECS)),
            });
        }
        out
    }

    /// A number below `end` (at least 1).
    pub fn below(&mut self, end: usize) -> usize {
        self.random.random_range(0..end.max(1))
    }
}

/// Time to the next event of a process without memory.
fn exponential(random: &mut ChaCha8Rng, mean: f64) -> f64 {
    -mean * (1.0 - random.random_range(0.0..1.0_f64)).ln()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn analytic_trouble_comes_as_often_as_asked_and_is_the_same_for_the_same_seed() {
        let config = TroubleConfig { seed: 5, flip_every_secs: Some(2.0), ..TroubleConfig::default() };
        let all = |connection| {
            let mut plan = Plan::new(&config, connection);
            (0..100_000).map(|i| plan.due(f64::from(i) * 0.1).len()).collect::<Vec<_>>()
        };
        let flips = all(0).iter().sum::<usize>();
        // A Poisson process of mean 5000 in 10 000 s; its step of 0.1 s makes the mean interval
        // 2.05 s. Five sigma.
        assert!(flips.abs_diff(4878) < 350, "{flips}");
        assert_eq!(all(0), all(0));
        assert_ne!(all(0), all(1));
    }
}
