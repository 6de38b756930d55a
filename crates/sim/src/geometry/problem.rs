//! Why a gear cannot be, and why two gears do not go together.

use gearwatch_core::bench::ShiftError;

/// A gear that cannot be.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GearError {
    /// Fewer teeth than any involute gear has.
    #[error("{which} has {teeth} teeth; an involute gear has at least 5")]
    FewTeeth {
        /// The gear.
        which: String,
        /// As given.
        teeth: u32,
    },
    /// Module or face width.
    #[error("{which}: {name} is {found_mm} mm; it must be above 0")]
    Length {
        /// The gear.
        which: String,
        /// Which length.
        name: &'static str,
        /// As given (mm).
        found_mm: f64,
    },
    /// Pressure angle.
    #[error("{which}: pressure angle is {found_deg:.3} degrees; expected 10 to 35 (20 is usual)")]
    PressureAngle {
        /// The gear.
        which: String,
        /// As given (degrees).
        found_deg: f64,
    },
    /// Bore of an external gear.
    #[error(
        "{which}: bore diameter is {found_mm:.3} mm; it must be above 0 and below the root diameter, {root_mm:.3} mm"
    )]
    Bore {
        /// The gear.
        which: String,
        /// Diameter as given (mm).
        found_mm: f64,
        /// Root diameter (mm).
        root_mm: f64,
    },
    /// Rim of an internal gear.
    #[error(
        "{which}: the rim ends at a diameter of {found_mm:.3} mm; it must be beyond the root diameter, {root_mm:.3} mm"
    )]
    Rim {
        /// The gear.
        which: String,
        /// Diameter as given (mm).
        found_mm: f64,
        /// Root diameter (mm).
        root_mm: f64,
    },
    /// Profile shift and centre distance of its pair contradict each other.
    #[error(transparent)]
    Centres(#[from] ShiftError),
    /// Profile shift that no gear has.
    #[error("{which}: profile_shift is {found}; expected -{most} to {most}")]
    Shift {
        /// The gear.
        which: String,
        /// As given.
        found: f64,
        /// Most, either way.
        most: f64,
    },
    /// Flanks that the rack cuts away at their foot.
    #[error("{which}: the rack undercuts {teeth} teeth with profile_shift = {shift:.3}; expected x ≥ {least:.3}")]
    Undercut {
        /// The gear.
        which: String,
        /// Its teeth.
        teeth: u32,
        /// Profile shift by the normal module.
        shift: f64,
        /// Least profile shift by the normal module.
        least: f64,
    },
    /// Tips below the flank.
    #[error(
        "{which}: the tip diameter is {found_mm:.3} mm; the involute begins at {start_mm:.3} mm and tips end beyond it"
    )]
    Tip {
        /// The gear.
        which: String,
        /// As given (mm).
        found_mm: f64,
        /// Where the involute begins (mm).
        start_mm: f64,
    },
    /// Tips too thin.
    #[error(
        "{which}: pointed teeth, {found_mm:.3} mm thick at the tip diameter of {tip_mm:.3} mm; expected {least_mm:.3} mm (0.2 m) or more: less profile_shift, or a tip_diameter_mm of at most {most_mm:.3}"
    )]
    Pointed {
        /// The gear.
        which: String,
        /// Tip diameter (mm).
        tip_mm: f64,
        /// Thickness there (mm).
        found_mm: f64,
        /// Least thickness (mm).
        least_mm: f64,
        /// Tip diameter at which it is reached (mm).
        most_mm: f64,
    },
    /// An internal gear with so few teeth that their tips lie inside its base circle.
    #[error(
        "{which} has {teeth} teeth inside: their tips would reach below the base circle, where there is no involute; expected {fewest} teeth or more at {angle_deg:.1} degrees"
    )]
    NoInvolute {
        /// The gear.
        which: String,
        /// As given.
        teeth: u32,
        /// Fewest that can be.
        fewest: f64,
        /// Pressure angle (degrees).
        angle_deg: f64,
    },
}

/// Two gears that do not go together.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PairError {
    /// Teeth inside on both sides.
    #[error("both gears are internal; one of a pair is external")]
    BothInternal,
    /// The base circles overlap.
    #[error(
        "the centre distance is {found_mm:.4} mm; involutes touch only beyond the {} of the base radii, {bases_mm:.4} mm",
        if *internal { "difference" } else { "sum" }
    )]
    CentreDistance {
        /// Centre distance (mm).
        found_mm: f64,
        /// One of the gears is internal.
        internal: bool,
        /// Sum or difference of the base radii (mm).
        bases_mm: f64,
    },
    /// Tips reach below the other gear's base circle.
    #[error(
        "interference: the tips of the gear with {long} teeth reach below the base circle of the gear with {short} teeth; \
         at {angle_deg:.1} degrees and without profile shift the smaller one needs at least {fewest} teeth; with {short} it needs profile_shift: expected x ≥ {shift:.3}"
    )]
    Interference {
        /// Teeth of the gear whose tips reach too far.
        long: u32,
        /// Teeth of the other.
        short: u32,
        /// Pressure angle (degrees).
        angle_deg: f64,
        /// Fewest teeth of the smaller one.
        fewest: u32,
        /// Profile shift from which on the other gear's flanks are whole.
        shift: f64,
    },
    /// Tips of shifted gears reach below the involute of the other gear.
    #[error(
        "interference: the tips of the {long}, {tip_mm:.3} mm across, reach below the involute of the {short}, which begins at {start_mm:.3} mm; expected a tip_diameter_mm of at most {most_mm:.3} of the {long}, or more profile_shift of the {short}"
    )]
    BelowInvolute {
        /// The gear whose tips reach too far.
        long: &'static str,
        /// The other.
        short: &'static str,
        /// Tip diameter of the one (mm).
        tip_mm: f64,
        /// Where the involute of the other begins (mm, diameter).
        start_mm: f64,
        /// Tip diameter that would do (mm).
        most_mm: f64,
    },
    /// The teeth jam.
    #[error("the centre distance is {found_mm:.4} mm; the teeth jam below {free_mm:.4} mm, expected that or more")]
    Jams {
        /// Centre distance (mm).
        found_mm: f64,
        /// Free of play (mm).
        free_mm: f64,
    },
    /// No distance is free of play.
    #[error(
        "the profile shifts are {sum:.3} of the module together; at that no centre distance is free of play, expected more"
    )]
    Thin {
        /// Sum by the module of the section.
        sum: f64,
    },
    /// The gear inside is nearly as large as the internal one.
    #[error(
        "interference: nothing would be left of the {around} internal teeth that clears the fillets of the gear with {inside} teeth; expected a smaller gear inside"
    )]
    NothingLeft {
        /// Teeth of the internal gear.
        around: u32,
        /// Teeth of the gear inside.
        inside: u32,
    },
    /// Contact ratio below 1.
    #[error(
        "the contact ratio is {0:.3}; below 1 the teeth lose each other in every mesh. \
         More teeth, a smaller pressure angle, a smaller centre distance or less profile shift raise it"
    )]
    LowContactRatio(f64),
    /// Contact ratio of 3 or more.
    #[error("the contact ratio is {0:.3}; the model covers spur gears from 1 to below 3")]
    HighContactRatio(f64),
}
