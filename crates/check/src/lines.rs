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
    let mut families = Vec::new();
    for stage in 0..train.stages.len() {
        families.extend((1..=MESH_HARMONICS).map(|harmonic| Family::Mesh { stage, harmonic }));
    }
    for shaft in 0..train.shafts.len() {
        families.extend((1..=SHAFT_MULTIPLES).map(|multiple| Family::Shaft { shaft, multiple }));
    }
    if has_belt {
        families.extend((1..=MOTOR_MULTIPLES).map(|multiple| Family::Motor { multiple }));
    }
    for distance in 1..=SIDE_OFFSETS {
        for stage in 0..train.stages.len() {
            for shaft in [stage, stage + 1] {
                for harmonic in 1..=SIDE_HARMONICS {
                    let side = |offset| Family::Side { stage, harmonic, shaft, offset };
                    families.extend([-distance, distance].map(side));
                }
            }
        }
    }
    let line = |family: Family| Line { family, order: family.order(train) };
    let all = families.into_iter().map(line).filter(|l| l.order > 0.0);
    // Families were added in the order of their rank; a stable sort by order and a sweep keep the
    // first of each heap.
    let mut kept: Vec<(usize, Line)> = all.enumerate().collect();
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

/// Multiples of a shaft's order that differ from whole ones by less lie on its comb: rounding only,
/// since all orders are fractions of tooth numbers.
const ON_COMB: f64 = 1e-6;

impl Family {
    /// Frequency / input-shaft speed; negative of a sideband beyond zero. Stage and shaft must be
    /// of this train.
    pub fn order(&self, train: &Train) -> f64 {
        match *self {
            Self::Mesh { stage, harmonic } => train.stages[stage].mesh_order * f64::from(harmonic),
            Self::Shaft { shaft, multiple } => train.shafts[shaft].1 * f64::from(multiple),
            Self::Motor { multiple } => train.motor_order * f64::from(multiple),
            Self::Side { stage, harmonic, shaft, offset } => {
                let of = &train.stages[stage];
                let spacing = if shaft == stage { of.pinion_order } else { of.wheel_order };
                of.mesh_order * f64::from(harmonic) + spacing * f64::from(offset)
            }
        }
    }

    /// Whether the line is a whole multiple of a shaft's speed, whatever else makes it too: where
    /// tooth numbers have a common factor, sidebands of one gear of a pair lie on the comb of the
    /// other.
    pub fn is_on_comb(&self, train: &Train, shaft: usize) -> bool {
        let multiple = self.order(train) / train.shafts[shaft].1;
        (multiple - multiple.round()).abs() < ON_COMB
    }

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
