//! Where an effect enters the equations of motion, or what comes before and behind them.

/// Entry points, as in the explanation contract: told more surely than the name of an effect, since
/// each moves other lines by another law.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum EntryPoint {
    /// Samples of a channel, or numbers of the sheet: nothing of the machine changes.
    Data,
    /// The way from bearings to samples of a channel, a function of frequency.
    Path,
    /// The clock, the belt or the driving speed: the angle that all lines follow.
    Clock,
    /// A force or torque on a shaft.
    Force,
    /// A bearing: its stiffness, or impacts at its orders.
    Bearing,
    /// A deviation of flanks from the ideal, in metres, over the angle of a gear or mesh.
    Geometry,
    /// Stiffness of teeth or shafts, over angle or load.
    Stiffness,
    /// Damping or friction.
    Damping,
    /// A dead zone.
    Clearance,
}

impl EntryPoint {
    /// All, in the order of the contract.
    pub const ALL: [Self; 9] = [
        Self::Data,
        Self::Path,
        Self::Clock,
        Self::Force,
        Self::Bearing,
        Self::Geometry,
        Self::Stiffness,
        Self::Damping,
        Self::Clearance,
    ];

    /// As written in files.
    pub const fn code(self) -> &'static str {
        match self {
            Self::Data => "data",
            Self::Path => "path",
            Self::Clock => "clock",
            Self::Force => "force",
            Self::Bearing => "bearing",
            Self::Geometry => "geometry",
            Self::Stiffness => "stiffness",
            Self::Damping => "damping",
            Self::Clearance => "clearance",
        }
    }

    /// In words, to stand before a place.
    pub const fn words(self) -> &'static str {
        match self {
            Self::Data => "an error of the data",
            Self::Path => "a change of the path",
            Self::Clock => "an error of clock or speed",
            Self::Force => "a force or torque",
            Self::Bearing => "a change of a bearing",
            Self::Geometry => "an error of geometry",
            Self::Stiffness => "a change of stiffness",
            Self::Damping => "a change of damping or friction",
            Self::Clearance => "a clearance",
        }
    }
}
