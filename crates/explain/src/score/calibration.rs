//! Every number of the score that was learned or chosen, in one place.
//!
//! Physics is not among them: how an effect spreads over the lines of a bench comes from the simulator ([`PROFILES`], made by `cargo run --example profiles`).

use super::relation::RELATIONS;

/// The numbers.
#[derive(Clone, Copy, Debug)]
pub struct Calibration {
    /// Correlation of the changes of one class of lines, which share what the settings, the path and the model do to them: `n` of them count as `n/(1 + (n − 1) r)`
    /// (Kish 1965, design effect).
    pub lines: f64,
    /// The same of the bands of background.
    pub bands: f64,
    /// Exponent on the likelihood of the simulator's detailed prediction, as a share of its own.
    pub shape: f64,
    /// Degrees of freedom of the t distribution of changes.
    pub tail: f64,
    /// Scatter of a line between two recordings at one setting (ln amplitude): the grid over which it is integrated.
    pub repetition: [f64; 4],
    /// The same of a band of background.
    pub band_repetition: f64,
    /// Change of a line (ln) over change of speed (ln).
    pub speed_slope: f64,
    /// Gain of a session (ln, standard deviation): how far all lines of a channel may shift together.
    pub session: f64,
    /// Width over which a path is one number (ln frequency).
    pub path_width: f64,
    /// Frequency from which a resonance changes a path (Hz).
    pub path_from_hz: f64,
    /// Model error of a path as a share of its change.
    pub path_error: f64,
    /// Prior probability that nothing changed.
    pub nothing: f64,
    /// Prior probability that it is something without a name.
    pub something: f64,
    /// ln of the ratio of burst peaks at which bursts are as likely as none, its scale (per nat), and the most that it says (nats).
    pub bursts: (f64, f64, f64),
    /// Nats that new lines at fixed frequencies say for something beside the machine: for each nat of their excess beyond the first number, and the most.
    pub fixed_lines: (f64, f64, f64),
    /// ln of burst peaks without a reference, likewise.
    pub lone_bursts: (f64, f64, f64),
    /// Prior probability that one group of lines takes part in something without a name.
    pub takes_part: f64,
    /// Share of an effect's largest change that it may leave on any other line, beyond what the simulator says.
    pub leak: f64,
    /// Prior probability of a second effect.
    pub second: f64,
    /// How often a second effect that was named was right (2 of 6 on the development cases).
    pub second_sure: f64,
    /// Share of a pulse a turn at which one tooth is as likely as all, its scale (per nat), and the most that it says (nats).
    pub one_tooth: (f64, f64, f64),
    /// Factor on the sigma of an estimate.
    pub sigma: f64,
    /// Most that is believed of a name: effects that no library has, and models that fit for another reason.
    pub surest: f64,
}

/// The calibration in use.
pub const CALIBRATION: Calibration = Calibration {
    lines: 0.05,
    bands: 0.02,
    shape: 1.0,
    tail: 3.0,
    repetition: [0.012, 0.025, 0.05, 0.1],
    band_repetition: 0.03,
    speed_slope: 8.0,
    session: 0.03,
    path_width: 0.05,
    path_from_hz: 150.0,
    path_error: 0.2,
    nothing: 0.4,
    something: 0.01,
    bursts: (0.4, 0.06, 12.0),
    fixed_lines: (1.8, 1.5, 8.0),
    lone_bursts: (2.5, 0.1, 8.0),
    takes_part: 0.02,
    leak: 0.25,
    second: 0.02,
    second_sure: 0.4,
    one_tooth: (0.52, 0.05, 12.0),
    sigma: 1.5,
    surest: 0.9,
};

/// How an effect of the machine spreads its change.
#[derive(Clone, Copy, Debug)]
pub struct Profile {
    /// Effect id.
    pub effect: &'static str,
    /// Median |ln change| of a class of lines over that of the class that changes most, in the order of [`RELATIONS`].
    pub spread: [f64; RELATIONS.len()],
    /// It adds to what is there, so that its lines rise.
    pub rises: bool,
    /// Change of the background as a share of the largest change of its lines: what meshes add together fills the space between the lines, and what holds a shaft
    /// stands between the gears and the housing.
    pub background: f64,
}

const fn profile(effect: &'static str, rises: bool, background: f64, spread: [f64; RELATIONS.len()]) -> Profile {
    Profile { effect, spread, rises, background }
}

/// Least share: products of what two shafts add, which the steady state leaves out.
const L: f64 = 0.02;

/// Profiles by simulation. In the order of [`RELATIONS`]: mesh, first and further sidebands of the own shaft, of the other, own sidebands about another stage, first and further
/// orders of the own shaft, of the other, another stage's mesh, all else.
pub const PROFILES: &[Profile] = &[
    profile("eccentricity", true, 0.02, [0.03, 1.0, 0.15, L, L, 0.5, 0.5, 0.05, L, L, L, L]),
    profile("pitch_error", true, 0.08, [0.13, 0.45, 1.0, 0.05, 0.05, 0.8, 0.05, 0.85, L, L, L, L]),
    profile("tooth_breakage", true, 0.08, [0.03, 0.5, 0.85, 0.05, 0.05, 0.7, 0.05, 0.3, L, L, L, L]),
    profile("profile_error", false, 0.15, [0.93, 0.7, 0.5, L, L, 0.2, L, 0.03, L, L, L, L]),
    profile("tip_relief", false, 0.15, [0.6, 0.62, 0.83, L, L, 0.2, L, 0.15, L, L, L, L]),
    profile("tooth_wear", false, 0.15, [0.97, 0.66, 0.7, L, L, 0.2, L, 0.11, L, L, L, L]),
    profile("misalignment", false, 0.15, [0.81, 0.67, 0.75, L, L, 0.2, L, 0.03, L, L, L, L]),
    profile("mesh_stiffness", false, 0.15, [0.97, 0.64, 0.65, L, L, 0.2, L, 0.03, L, L, L, L]),
    profile("load_dependent_stiffness", false, 0.15, [0.58, 0.72, 0.86, L, L, 0.2, L, 0.03, L, L, L, L]),
    profile("damping", false, 0.5, [0.74, 0.72, 0.82, 0.6, 0.6, 0.5, L, 0.03, L, L, 0.3, 0.3]),
    profile("bearing_compliance", false, 0.6, [0.68, 0.78, 0.66, 0.86, 0.86, 0.6, 0.03, 0.05, 0.03, 0.05, 0.3, 0.3]),
    profile("shaft_torsion", false, 0.05, [0.05, 0.06, 0.06, 0.06, 0.09, 0.06, 0.03, 0.5, 0.03, 0.63, 0.05, 0.05]),
    profile("unbalance", true, 0.02, [L, 0.05, L, L, L, L, 1.0, 0.03, L, L, L, L]),
    profile("tooth_friction", true, 0.1, [0.26, 0.23, 0.26, L, L, 0.1, 0.43, 1.0, L, L, L, L]),
    profile("looseness", true, 0.1, [0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 1.0, 0.5, 0.05, 0.05, 0.05, 0.05]),
    profile("looseness", false, 0.6, [0.68, 0.78, 0.66, 0.86, 0.86, 0.6, 0.5, 0.2, 0.03, 0.05, 0.3, 0.3]),
    profile("backlash", false, 0.15, [0.5, 0.8, 0.8, L, L, 0.5, 0.3, 0.5, L, L, 0.1, 0.1]),
];

/// Spread of a ripple: its own order, sidebands at that distance, other orders and sidebands of its shaft, all else. A ripple shows in its order, in the sidebands, or in both,
/// as the torsional resonances have it.
pub const RIPPLES: [[f64; 4]; 2] = [[1.0, 0.8, 0.05, 0.02], [1.0, 0.15, 0.05, 0.02]];
