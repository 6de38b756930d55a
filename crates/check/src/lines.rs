//! Which spectral lines a gear train can make, as multiples of the input shaft's speed.

use gearwatch_core::train::Train;

/// Where a line belongs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Family {
    /// Mesh harmonic `harmonic` of stage `stage`.
    Mesh {
        /// Position of the stage.
        stage: usize,
        /// 1 for the mesh frequency.
        harmonic: u8,
    },
    /// Multiple of a shaft's speed.
    Shaft {
        /// Position of the shaft.
        shaft: usize,
        /// 1 for the shaft's speed.
        multiple: u8,
    },
    /// Multiple of the motor's speed, where a belt is between motor and input shaft.
    Motor {
        /// 1 for the motor's speed.
        multiple: u8,
    },
    /// Sideband of a mesh harmonic.
    Side {
        /// Position of the stage.
        stage: usize,
        /// Mesh harmonic.
        harmonic: u8,
        /// Position of the shaft.
        shaft: usize,
        /// Multiple of the shaft's speed, negative below the harmonic.
        offset: i8,
    },
}

/// A line of the train.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Line {
    /// Where it belongs.
    pub family: Family,
    /// Frequency / input-shaft speed.
    pub order: f64,
}

/// Mesh harmonics that are looked at.
pub const MESH_HARMONICS: u8 = 12;
/// Mesh harmonics whose sidebands are looked at.
pub const SIDE_HARMONICS: u8 = 8;
/// Sidebands on each side.
pub const SIDE_OFFSETS: i8 = 5;
pub use crate::kinematics::SHAFT_MULTIPLES;
/// Multiples of the motor's speed.
pub const MOTOR_MULTIPLES: u8 = 6;

/// Orders that differ by less are one line: whole multiples of one shaft's revolution, up to
/// rounding.
pub const SAME_LINE: f64 = 1e-7;

/// All lines of a train, ascending; of lines closer than `resolution` (orders) only the most likely
/// owner stays.
pub fn of_train(train: &Train, has_belt: bool, resolution: f64) -> Vec<Line> {
    let mut all = Vec::new();
    let mut add = |family, order: f64| {
        if order > 0.0 {
            all.push(Line { family, order });
        }
    };
    for (i, stage) in train.stages.iter().enumerate() {
        for harmonic in 1..=MESH_HARMONICS {
            add(Family::Mesh { stage: i, harmonic }, stage.mesh_order * f64::from(harmonic));
        }
    }
    for (j, (_, order)) in train.shafts.iter().enumerate() {
        for multiple in 1..=SHAFT_MULTIPLES {
            add(Family::Shaft { shaft: j, multiple }, order * f64::from(multiple));
        }
    }
    if has_belt {
        for multiple in 1..=MOTOR_MULTIPLES {
            add(Family::Motor { multiple }, train.motor_order * f64::from(multiple));
        }
    }
    for distance in 1..=SIDE_OFFSETS {
        for (i, stage) in train.stages.iter().enumerate() {
            for (shaft, shaft_order) in [(i, stage.pinion_order), (i + 1, stage.wheel_order)] {
                for harmonic in 1..=SIDE_HARMONICS {
                    for offset in [-distance, distance] {
                        add(
                            Family::Side { stage: i, harmonic, shaft, offset },
                            stage.mesh_order * f64::from(harmonic) + shaft_order * f64::from(offset),
                        );
                    }
                }
            }
        }
    }
    // Families were added in the order of their rank; a stable sort by order and a sweep keep the
    // first of each heap.
    let mut kept: Vec<(usize, Line)> = all.into_iter().enumerate().collect();
    kept.sort_by(|a, b| a.1.order.total_cmp(&b.1.order).then(a.0.cmp(&b.0)));
    let mut out: Vec<(usize, Line)> = Vec::with_capacity(kept.len());
    for entry in kept {
        match out.last_mut() {
            Some(last) if entry.1.order - last.1.order < resolution => {
                if entry.0 < last.0 {
                    *last = entry;
                }
            }
            _ => out.push(entry),
        }
    }
    out.into_iter().map(|(_, line)| line).collect()
}

impl Family {
    /// The line in words, with the names of the bench.
    pub fn describe(&self, train: &Train) -> String {
        let shaft_name = |j: usize| train.shafts.get(j).map_or("?", |s| s.0.as_str());
        let stage_name = |i: usize| train.stages.get(i).map_or("?", |s| s.name.as_str());
        match *self {
            Self::Mesh { stage, harmonic } => format!("{} {harmonic}x", stage_name(stage)),
            Self::Shaft { shaft, multiple } => format!("{} shaft {multiple}x", shaft_name(shaft)),
            Self::Motor { multiple } => format!("motor {multiple}x"),
            Self::Side { stage, harmonic, shaft, offset } => {
                format!("{} {harmonic}x {offset:+} {}", stage_name(stage), shaft_name(shaft))
            }
        }
    }
}
