//! The indicators of a bench as a row of columns, and their means over windows.

use crate::bench::{BearingOrders, Bench};
use crate::estimate::Estimate;
use crate::indicators::{CHANNEL_INDICATORS, ChannelIndicator, GEAR_INDICATORS, GearIndicator, Indicators};

/// What a column is measured in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ColumnUnit {
    /// The channel's unit.
    Channel,
    /// mm/s.
    Velocity,
    /// A ratio.
    One,
}

impl ColumnUnit {
    fn new(text: &str) -> Self {
        match text {
            "mm/s" => Self::Velocity,
            "1" => Self::One,
            _ => Self::Channel,
        }
    }

    /// As text, for a channel in `unit`.
    pub fn text<'a>(&self, unit: &'a str) -> &'a str {
        match self {
            Self::Channel => unit,
            Self::Velocity => "mm/s",
            Self::One => "1",
        }
    }
}

/// One number of a window.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Column {
    /// Empty for the whole channel, else `stage1.pinion`, or the name of a bearing and its part,
    /// `drive end.outer`.
    pub place: String,
    /// Name of the indicator.
    pub name: &'static str,
    /// What it is measured in.
    pub unit: ColumnUnit,
}

/// All columns of a bench: the channel's, each gear's, each bearing's. The order never depends on
/// what was measured.
pub fn columns(bench: &Bench) -> Vec<Column> {
    // A unit that is none of those that columns have themselves.
    const CHANNEL: &str = "";
    let of_channel = ChannelIndicator::ALL.map(|i| (i.name(), ColumnUnit::new(i.unit(CHANNEL))));
    let of_gear = GearIndicator::ALL.map(|i| (i.name(), ColumnUnit::new(i.unit(CHANNEL))));
    let mut out = Vec::new();
    let mut push = |place: &str, (name, unit): (&'static str, ColumnUnit)| {
        out.push(Column { place: place.to_owned(), name, unit });
    };
    of_channel.into_iter().for_each(|column| push("", column));
    for stage in &bench.stages {
        for side in stage.gear_names() {
            let place = format!("{}.{side}", stage.name);
            of_gear.into_iter().for_each(|column| push(&place, column));
        }
    }
    for bearing in &bench.bearings {
        for part in BearingOrders::NAMES {
            push(&format!("{}.{part}", bearing.name), ("envelope_depth", ColumnUnit::One));
        }
    }
    out
}

impl Indicators {
    /// The numbers, in the order of [`columns`].
    pub fn row(&self) -> impl Iterator<Item = Estimate> + '_ {
        let bearings = self.bearings.iter().flatten().map(|line| line.depth);
        self.row_without_bearings().chain(bearings)
    }

    /// The numbers in the order of [`names`].
    pub fn row_without_bearings(&self) -> impl Iterator<Item = Estimate> + '_ {
        let gears = self.gears.iter().flatten().flat_map(|gear| gear.values);
        self.channel.into_iter().chain(gears)
    }
}

/// Names of the channel's and the gears' indicators in a baseline, in the order of the row: `rms`,
/// `1.pinion.fm4` with the position of the stage from 1.
pub fn names(stages: usize) -> Vec<String> {
    let gears = (1..=stages).flat_map(|stage| {
        let of_side = move |side: &'static str| GearIndicator::ALL.map(|i| format!("{stage}.{side}.{}", i.name()));
        ["pinion", "wheel"].into_iter().flat_map(of_side)
    });
    ChannelIndicator::ALL.iter().map(|i| i.name().to_owned()).chain(gears).collect()
}

/// Position of a gear's indicator in the row.
pub fn gear_column(stage: usize, side: usize, which: GearIndicator) -> usize {
    CHANNEL_INDICATORS + (2 * stage + side) * GEAR_INDICATORS + which as usize
}

/// Mean of one number over windows.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Mean {
    count: f64,
    mean: f64,
    squares: f64,
    variance: f64,
}

impl Mean {
    /// Takes a number in; one that is not known changes nothing.
    pub fn push(&mut self, x: Estimate) {
        if !x.is_known() {
            return;
        }
        // Welford's recurrence.
        self.count += 1.0;
        let off = x.value - self.mean;
        self.mean += off / self.count;
        self.squares += off * (x.value - self.mean);
        self.variance += x.sigma * x.sigma;
    }

    /// Takes in what another mean has seen. Chan, Golub and LeVeque, "Algorithms for computing the
    /// sample variance", The American Statistician 37 (1983).
    pub fn merge(&mut self, other: &Self) {
        if other.count < 1.0 {
            return;
        }
        let all = self.count + other.count;
        let off = other.mean - self.mean;
        self.squares += other.squares + off * off * self.count * other.count / all;
        self.mean += off * other.count / all;
        self.variance += other.variance;
        self.count = all;
    }

    /// To be kept and read back: count, mean, sum of the squared distances from it, sum of the
    /// stated variances.
    pub fn parts(&self) -> [f64; 4] {
        [self.count, self.mean, self.squares, self.variance]
    }

    /// Of its [`Self::parts`].
    pub fn from_parts([count, mean, squares, variance]: [f64; 4]) -> Self {
        Self { count, mean, squares, variance }
    }

    /// Windows that had a known value.
    pub fn count(&self) -> u64 {
        self.count as u64
    }

    /// Standard deviation between windows; unknown below two.
    pub fn scatter(&self) -> f64 {
        if self.count < 2.0 { f64::NAN } else { (self.squares / (self.count - 1.0)).sqrt() }
    }

    /// The mean. `share`: of a window's samples that are its own, 0.5 for a hop of half a window;
    /// windows that share samples count by it. Sigma: from the larger of the scatter between
    /// windows and what the windows state themselves.
    pub fn estimate(&self, share: f64) -> Estimate {
        if self.count < 1.0 {
            return Estimate::UNKNOWN;
        }
        let independent = (1.0 + (self.count - 1.0) * share.min(1.0)).max(1.0);
        let stated = self.variance / self.count;
        let seen = if self.count < 2.0 { 0.0 } else { self.squares / (self.count - 1.0) };
        Estimate::new(self.mean, (stated.max(seen) / independent).sqrt())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Parts of a row of numbers, put together, have seen the whole row: whatever the parts, also
    /// where one is empty.
    #[test]
    fn analytic_parts_of_a_mean_are_put_together() {
        let of = |range: std::ops::Range<i32>| {
            let mut mean = Mean::default();
            range.for_each(|i| mean.push(Estimate::new(f64::from(i * i), 0.1 * f64::from(i))));
            mean
        };
        let whole = of(0..20).estimate(0.5);
        for cut in 0..=20 {
            let mut parts = of(0..cut);
            parts.merge(&of(cut..20));
            let seen = Mean::from_parts(parts.parts()).estimate(0.5);
            assert!((seen.value - whole.value).abs() < 1e-12 * whole.value, "{cut}: {seen:?} {whole:?}");
            assert!((seen.sigma - whole.sigma).abs() < 1e-12 * whole.sigma, "{cut}: {seen:?} {whole:?}");
        }
    }

    /// Ten windows that do not overlap, 1 to 10: mean 5.5, sigma of the mean `sqrt(55/6 / 10)`;
    /// stated sigmas count where they are larger.
    #[test]
    fn analytic_mean_and_sigma() {
        let of = |sigma: f64| {
            let mut mean = Mean::default();
            (1..=10).for_each(|i| mean.push(Estimate::new(f64::from(i), sigma)));
            mean.push(Estimate::UNKNOWN);
            mean.estimate(1.0)
        };
        assert!((of(0.1).value - 5.5).abs() < 1e-12);
        assert!((of(0.1).sigma - (55.0f64 / 60.0).sqrt()).abs() < 1e-12);
        assert!((of(10.0).sigma - 10.0 / 10f64.sqrt()).abs() < 1e-12);
    }

    /// As many columns as numbers, with bearings too.
    #[test]
    fn conform_columns_are_those_of_the_row() {
        let bench: Bench = serde_json::from_value(serde_json::json!({
            "format": "gearwatch-bench/1", "name": "b", "motor": { "speed_hz": 25.0 },
            "shaft": [{ "name": "a" }, { "name": "b" }, { "name": "c" }],
            "stage": [{ "name": "s1", "pinion": { "teeth": 20 }, "wheel": { "teeth": 40 } },
                      { "name": "s2", "pinion": { "teeth": 21 }, "wheel": { "teeth": 40 } }],
            "bearing": [{ "name": "x", "shaft": "a", "orders": { "outer": 3.5, "inner": 5.4, "element": 2.3, "cage": 0.4 } }],
        }))
        .expect("a bench");
        assert_eq!(bench.problems(), Vec::<String>::new());
        let mut row = Indicators::unknown(2);
        row.clear(2, 1);
        row.gears[1][1].values[GearIndicator::Fm4 as usize] = Estimate::new(3.0, 0.1);
        let columns = columns(&bench);
        assert_eq!(columns.len(), row.row().count());
        let at = gear_column(1, 1, GearIndicator::Fm4);
        assert_eq!((columns[at].place.as_str(), columns[at].name), ("s2.wheel", "fm4"));
        assert_eq!(row.row().nth(at), Some(Estimate::new(3.0, 0.1)));
    }
}
