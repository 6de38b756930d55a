//! Which part of the work this process does: `I/N`, I from 1 to N.

use std::fmt;
use std::str::FromStr;

/// Shard `index` of `count`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    index: u32,
    count: u32,
}

/// Why a shard cannot be.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ShardError {
    /// Not of the form I/N.
    #[error("shard {0:?}: expected I/N with I from 1 to N, such as 3/10")]
    Form(String),
    /// I is 0 or above N.
    #[error("shard {index}/{count}: the shards of {count} are 1/{count} to {count}/{count}")]
    Range {
        /// I.
        index: u32,
        /// N.
        count: u32,
    },
    /// A variable of Slurm's array jobs is not a number, or the array does not step by one.
    #[error("{0}: give --shard I/N")]
    Slurm(String),
}

impl Shard {
    /// All of the work.
    pub const WHOLE: Self = Self { index: 1, count: 1 };

    /// Shard `index` of `count`.
    ///
    /// # Errors
    /// When `index` is not from 1 to `count`.
    pub fn new(index: u32, count: u32) -> Result<Self, ShardError> {
        if (1..=count).contains(&index) { Ok(Self { index, count }) } else { Err(ShardError::Range { index, count }) }
    }

    /// The shard of this task of a Slurm array job (`sbatch --array=1-10`, or from any other first
    /// index), or the whole outside of one. `variable` looks up an environment variable.
    ///
    /// # Errors
    /// When the variables are there but make no sense.
    pub fn from_slurm(variable: impl Fn(&str) -> Option<String>) -> Result<Self, ShardError> {
        let number = |name: &str| -> Result<Option<u32>, ShardError> {
            let Some(text) = variable(name) else { return Ok(None) };
            text.parse().map(Some).map_err(|_| ShardError::Slurm(format!("{name} is {text:?}, not a number")))
        };
        let Some(id) = number("SLURM_ARRAY_TASK_ID")? else { return Ok(Self::WHOLE) };
        let (Some(first), Some(last)) = (number("SLURM_ARRAY_TASK_MIN")?, number("SLURM_ARRAY_TASK_MAX")?) else {
            return Err(ShardError::Slurm("SLURM_ARRAY_TASK_ID is set without SLURM_ARRAY_TASK_MIN and _MAX".into()));
        };
        // Single tasks of an array that are run again (--array=3, --array=3,7) do not say how many
        // the whole has.
        if first == last {
            return Err(ShardError::Slurm(format!("the array holds {id} alone, and may be a part of a larger one")));
        }
        let span = last.checked_sub(first).and_then(|d| d.checked_add(1));
        let span =
            span.ok_or_else(|| ShardError::Slurm(format!("SLURM_ARRAY_TASK_MIN {first} is above _MAX {last}")))?;
        if number("SLURM_ARRAY_TASK_COUNT")?.is_some_and(|count| count != span) {
            return Err(ShardError::Slurm(format!("the array {first}-{last} does not hold every index")));
        }
        let index = id.checked_sub(first).and_then(|d| d.checked_add(1)).unwrap_or(0);
        Self::new(index, span)
    }

    /// Whether the recording at `position` of the work list is in this shard: positions are dealt
    /// out in turn, so that shards of a list that is sorted by date take equally long.
    pub fn holds(self, position: usize) -> bool {
        position % self.count as usize == (self.index - 1) as usize
    }

    /// N of I/N.
    pub fn count(self) -> u32 {
        self.count
    }

    /// N of the shards that a file of this name is a part of; `None` where it is no part.
    pub fn count_of_part(name: &str) -> Option<u32> {
        let (index, count) = name.strip_prefix("part-")?.strip_suffix(".parquet")?.split_once("-of-")?;
        Self::new(index.parse().ok()?, count.parse().ok()?).ok().map(Self::count)
    }

    /// Name of the part that this shard leaves.
    pub fn part_name(self) -> String {
        format!("part-{:05}-of-{:05}.parquet", self.index, self.count)
    }
}

impl fmt::Display for Shard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.index, self.count)
    }
}

impl FromStr for Shard {
    type Err = ShardError;

    fn from_str(text: &str) -> Result<Self, ShardError> {
        let form = || ShardError::Form(text.to_owned());
        let (index, count) = text.split_once('/').ok_or_else(form)?;
        Self::new(index.trim().parse().map_err(|_| form())?, count.trim().parse().map_err(|_| form())?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn analytic_every_position_is_in_one_shard() {
        for count in 1..=7 {
            for position in 0..50 {
                let holders = (1..=count).filter(|&i| Shard::new(i, count).unwrap().holds(position)).count();
                assert_eq!(holders, 1);
            }
        }
    }

    #[test]
    fn conform_what_makes_no_sense_is_refused() {
        for text in ["", "3", "0/4", "5/4", "a/b", "1/0", "-1/3", "1/3/5"] {
            assert!(text.parse::<Shard>().is_err(), "{text}");
        }
        assert_eq!(
            "11/10".parse::<Shard>().unwrap_err().to_string(),
            "shard 11/10: the shards of 10 are 1/10 to 10/10"
        );
        assert_eq!("3/10".parse::<Shard>().unwrap().to_string(), "3/10");
    }

    #[test]
    fn conform_parts_are_known_by_name() {
        assert_eq!(Shard::count_of_part(&Shard::new(3, 10).unwrap().part_name()), Some(10));
        for name in ["part-3.parquet", "part-00003-of-00010.lock", "sweep.parquet", "part-00011-of-00010.parquet"] {
            assert_eq!(Shard::count_of_part(name), None, "{name}");
        }
    }

    fn slurm(id: &str, min: &str, max: &str, count: &str) -> Result<Shard, ShardError> {
        Shard::from_slurm(|name| {
            let value = match name {
                "SLURM_ARRAY_TASK_ID" => id,
                "SLURM_ARRAY_TASK_MIN" => min,
                "SLURM_ARRAY_TASK_MAX" => max,
                _ => count,
            };
            Some(value.to_owned())
        })
    }

    #[test]
    fn conform_slurm_arrays_from_zero_and_from_one() {
        assert_eq!(slurm("0", "0", "9", "10").unwrap().to_string(), "1/10");
        assert_eq!(slurm("10", "1", "10", "10").unwrap().to_string(), "10/10");
        assert!(slurm("3", "3", "7", "2").is_err(), "a partial array cannot know the whole");
        assert!(slurm("3", "3", "3", "1").is_err(), "nor can a single task");
        assert!(slurm("x", "1", "2", "2").is_err());
        assert_eq!(Shard::from_slurm(|_| None).unwrap(), Shard::WHOLE);
    }
}
