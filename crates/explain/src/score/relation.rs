//! How a line stands to a place: the classes of lines over which an effect spreads its change.

use gearwatch_sim::effects::Place;

use crate::read::lines::Family;

/// Classes of lines as seen from a place.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Relation {
    /// Mesh harmonics of the place's stage.
    Mesh,
    /// First sidebands of the place's shaft about its stage.
    FirstSide,
    /// Further sidebands of the place's shaft about its stage.
    FarSide,
    /// First sidebands of the other shaft of the place's stage.
    FirstBeside,
    /// Further sidebands of the other shaft of the place's stage.
    FarBeside,
    /// Sidebands of the place's shaft about another stage.
    SideElsewhere,
    /// First order of the place's shaft.
    Once,
    /// Further orders of the place's shaft.
    Orders,
    /// First order of the other shaft of the place's stage.
    OnceBeside,
    /// Further orders of the other shaft of the place's stage.
    OrdersBeside,
    /// Mesh harmonics of another stage.
    OtherMesh,
    /// Everything else that the train makes.
    Other,
}

/// All classes.
pub const RELATIONS: [Relation; 12] = [
    Relation::Mesh,
    Relation::FirstSide,
    Relation::FarSide,
    Relation::FirstBeside,
    Relation::FarBeside,
    Relation::SideElsewhere,
    Relation::Once,
    Relation::Orders,
    Relation::OnceBeside,
    Relation::OrdersBeside,
    Relation::OtherMesh,
    Relation::Other,
];

/// Stages and shafts that a place is part of; the shafts of the meshes that it is part of but does not sit on come last.
struct Part {
    stages: Vec<usize>,
    shafts: Vec<usize>,
    beside: Vec<usize>,
}

fn part(place: Place, stages: usize) -> Part {
    let of_shaft = |j: usize| Part {
        stages: (0..stages).filter(|i| *i == j || *i + 1 == j).collect(),
        shafts: vec![j],
        beside: (0..=stages).filter(|k| k.abs_diff(j) == 1).collect(),
    };
    match place {
        Place::Gear { stage, wheel } => Part {
            stages: vec![stage],
            shafts: vec![stage + usize::from(wheel)],
            beside: vec![stage + usize::from(!wheel)],
        },
        Place::Stage(stage) => Part { stages: vec![stage], shafts: vec![stage, stage + 1], beside: Vec::new() },
        Place::Shaft(j) => of_shaft(j),
        Place::Belt | Place::Motor | Place::Coupling => of_shaft(0),
        Place::Brake => of_shaft(stages),
        Place::Sensor(_) | Place::Housing | Place::Acquisition => {
            Part { stages: (0..stages).collect(), shafts: (0..=stages).collect(), beside: Vec::new() }
        }
    }
}

impl Relation {
    /// The class of a line as seen from a place of a train of so many stages.
    pub fn of(family: Family, place: Place, stages: usize) -> Self {
        let own = part(place, stages);
        match family {
            Family::Mesh { stage, .. } if own.stages.contains(&stage) => Self::Mesh,
            Family::Mesh { .. } => Self::OtherMesh,
            Family::Side { stage, shaft, offset, .. } => {
                let first = offset.abs() == 1;
                match (own.stages.contains(&stage), own.shafts.contains(&shaft)) {
                    (true, true) if first => Self::FirstSide,
                    (true, true) => Self::FarSide,
                    (true, false) if first => Self::FirstBeside,
                    (true, false) => Self::FarBeside,
                    (false, true) => Self::SideElsewhere,
                    (false, false) => Self::Other,
                }
            }
            Family::Shaft { shaft, multiple } => match (own.shafts.contains(&shaft), own.beside.contains(&shaft)) {
                (true, _) if multiple == 1 => Self::Once,
                (true, _) => Self::Orders,
                (_, true) if multiple == 1 => Self::OnceBeside,
                (_, true) => Self::OrdersBeside,
                _ => Self::Other,
            },
            Family::Motor { .. } => Self::Other,
        }
    }
}
