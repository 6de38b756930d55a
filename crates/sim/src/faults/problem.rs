//! Why a tooth cannot be damaged so.

/// Damage that a tooth cannot have.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{place}: {problem}")]
pub struct ToothError {
    /// Which tooth.
    pub place: String,
    /// What is wrong and what would be right.
    pub problem: ToothProblem,
}

/// What is wrong with a damage.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ToothProblem {
    /// Share of the tooth that is broken off.
    #[error("{0} of the tooth is broken; expected a fraction above 0 and up to 1")]
    Breakage(f64),
    /// A pit larger than the flank.
    #[error(
        "a pit of {found_mm:.2} mm does not fit on the flank, which is {flank_mm:.2} mm high at module {module_mm} mm; \
         expected a diameter above 0 and up to that"
    )]
    PitDiameter {
        /// As given (mm).
        found_mm: f64,
        /// Height of the flank (mm).
        flank_mm: f64,
        /// Module (mm).
        module_mm: f64,
    },
    /// A pit that is too deep.
    #[error("a pit is {found_mm:.2} mm deep; expected above 0 and up to half a module, {most_mm:.2} mm")]
    PitDepth {
        /// As given (mm).
        found_mm: f64,
        /// Half a module (mm).
        most_mm: f64,
    },
    /// Pits that have no room beside each other.
    #[error(
        "the pits side by side need {needed_mm:.2} mm of face width and the tooth has {width_mm:.2} mm; \
         use fewer or smaller pits"
    )]
    Pits {
        /// Sum of the diameters (mm).
        needed_mm: f64,
        /// Face width (mm).
        width_mm: f64,
    },
    /// A spall: width, height and depth (mm).
    #[error(
        "a spall of {:.2} mm × {:.2} mm × {:.2} mm (width × height × depth) does not fit; expected up to {:.2} × {:.2} × {:.2} mm",
        found_mm[0], found_mm[1], found_mm[2], most_mm[0], most_mm[1], most_mm[2]
    )]
    Spall {
        /// As given.
        found_mm: [f64; 3],
        /// The most that fits.
        most_mm: [f64; 3],
    },
    /// A crack that would cut the tooth off.
    #[error(
        "a crack of {depth_mm:.2} mm at {angle_deg:.0} degrees; expected a depth above 0 that leaves a fifth of the \
         root thickness of {root_mm:.2} mm"
    )]
    Crack {
        /// As given (mm).
        depth_mm: f64,
        /// As given (degrees).
        angle_deg: f64,
        /// Thickness of the root (mm).
        root_mm: f64,
    },
}
