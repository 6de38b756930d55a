//! Condition indicators of one window of one channel, beside the mesh harmonics.
//!
//! A mesh harmonic averages over all teeth: one cracked tooth hardly moves it. The indicators here
//! look at what is left when the regular mesh is taken out, and at the whole signal. Definitions
//! are those of the review of Lebold, McClintic, Campbell, Byington and Maynard ("Review of
//! vibration analysis methods for gearbox diagnostics and prognostics", MFPT 54 (2000) 623), of
//! Večeř, Kreidl and Šmíd ("Condition indicators for gearbox condition monitoring systems", Acta
//! Polytechnica 45 (2005) 35) and of ADS-79E-HDBK; the origin of each stands at [`GearIndicator`].
//!
//! ```text
//! window ─┬─► moments: rms, peak, crest factor, kurtosis
//!         ├─► velocity: rms 10–1000 Hz
//!         └─► angle grid ─► time-synchronous average y of each shaft ─► its lines
//!                              r = y without shaft 1x, 2x and mesh harmonics         (residual)
//!                              d = r without the first sidebands of these harmonics  (difference)
//!                              e = |band of y around the mesh frequency|             (envelope)
//! ```
//!
//! # Uncertainty
//!
//! Each value has a sigma. That of moments is the jackknife over sixteen blocks of the window. That
//! of a functional `f` of the average `y` is `σ² Σ (∂f/∂y_m)²`, with `σ²` the variance of a point
//! of the average from the scatter between revolutions. It is what noise makes of a value in
//! repeated windows. For a difference signal that is noise itself the law is an upper bound: twice
//! the sampling error of a kurtosis.
//!
//! # Limits
//!
//! A shaft needs two whole revolutions in a window, and many for a quiet average:
//! [`GearIndicators::revolutions`] says how many there were. Lines of other shafts fade with the
//! number of revolutions, and those at common multiples not at all. Both gears of one shaft have
//! their residual and difference signals in common. Orders above [`USABLE_SHARE`] of the sample
//! rate are left out.

use crate::estimate::Estimate;
use crate::indicators::envelope::EnvelopeLine;

pub mod columns;
pub mod envelope;
pub mod gear;
pub mod grid;
pub mod kurtogram;
pub mod moments;
pub mod plan;
pub mod resample;
pub mod running;
pub mod table;
pub mod velocity;

/// Share of the sample rate up to which lines of an average are used: there the interpolation
/// between samples is good to 0.5 %.
pub const USABLE_SHARE: f64 = 0.3;

/// Sidebands on each side of the mesh line that the sideband ratio adds up (Hanna et al. 2011).
pub const RATIO_SIDEBANDS: usize = 6;

/// What the whole signal of a channel tells.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum ChannelIndicator {
    /// Root of the mean square about the mean, in the channel's unit.
    Rms,
    /// Largest distance from the mean, in the channel's unit. Sigma: scatter of the peaks of
    /// sixteen blocks (the largest of several Gumbel variables scatters as each of them).
    Peak,
    /// Peak by rms.
    CrestFactor,
    /// Fourth moment by the squared variance: 3 for Gaussian noise, 1.5 for one tone.
    Kurtosis,
    /// Broadband velocity, 10–1000 Hz, in mm/s: the quantity of ISO 20816-1. Known for `m/s^2`, `g`
    /// and `mm/s` only.
    VelocityRms,
}

/// Number of [`ChannelIndicator`]s.
pub const CHANNEL_INDICATORS: usize = 5;

impl ChannelIndicator {
    /// All of them, in the order of arrays and columns.
    pub const ALL: [Self; CHANNEL_INDICATORS] =
        [Self::Rms, Self::Peak, Self::CrestFactor, Self::Kurtosis, Self::VelocityRms];

    /// As written in files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Rms => "rms",
            Self::Peak => "peak",
            Self::CrestFactor => "crest_factor",
            Self::Kurtosis => "kurtosis",
            Self::VelocityRms => "velocity_rms",
        }
    }

    /// What the value is measured in, for a channel in `unit`.
    pub const fn unit(self, unit: &str) -> &str {
        match self {
            Self::Rms | Self::Peak => unit,
            Self::CrestFactor | Self::Kurtosis => "1",
            Self::VelocityRms => "mm/s",
        }
    }
}

/// What the time-synchronous average of a gear's shaft tells. `N` points, means over the average
/// without its mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum GearIndicator {
    /// `PP(y) / Σ A(h z)`: peak to peak of the average by the sum of the mesh harmonics' amplitudes
    /// (R. M. Stewart, Some useful data analysis techniques for gearbox diagnostics, 1977).
    Fm0,
    /// `N Σ d⁴ / (Σ d²)²`: kurtosis of the difference signal (Stewart 1977). One damaged tooth
    /// raises it.
    Fm4,
    /// `N² Σ d⁶ / (Σ d²)³` (H. R. Martin, Statistical moment analysis as a means of surface damage
    /// detection, 1989). 15 for Gaussian noise.
    M6a,
    /// `N³ Σ d⁸ / (Σ d²)⁴` (Martin 1989). 105 for Gaussian noise.
    M8a,
    /// `rms(d) / rms(y - d)`: what is irregular by what is regular (Večeř et al. 2005, after
    /// Swanson).
    EnergyRatio,
    /// Rms of the residual signal, in the channel's unit.
    ResidualRms,
    /// `N Σ r⁴ / (Σ r²)²`: NA4 of one reading (Zakrajsek, Townsend, Decker, NASA TM-105950, 1993).
    /// See [`running`] for NA4 over many, and NA4*.
    ResidualKurtosis,
    /// Rms of the difference signal, in the channel's unit.
    DifferenceRms,
    /// Standard deviation of the envelope of the band around the mesh frequency, in the channel's
    /// unit.
    EnvelopeDeviation,
    /// Kurtosis of that envelope: NB4 of one reading (Zakrajsek, Handschuh, Decker, NASA TM-106467,
    /// 1994).
    EnvelopeKurtosis,
    /// `(A(z-1) + A(z+1)) / 2`: mean of the first sidebands of the mesh frequency, in the channel's
    /// unit (Večeř et al. 2005).
    SidebandIndex,
    /// `Σ_{k=1..6} (A(z-k) + A(z+k)) / A(z)`: sideband energy ratio (Hanna, Hatch, Kalb, Weiss, Luo
    /// 2011).
    SidebandRatio,
}

/// Number of [`GearIndicator`]s.
pub const GEAR_INDICATORS: usize = 12;

impl GearIndicator {
    /// All of them, in the order of arrays and columns.
    pub const ALL: [Self; GEAR_INDICATORS] = [
        Self::Fm0,
        Self::Fm4,
        Self::M6a,
        Self::M8a,
        Self::EnergyRatio,
        Self::ResidualRms,
        Self::ResidualKurtosis,
        Self::DifferenceRms,
        Self::EnvelopeDeviation,
        Self::EnvelopeKurtosis,
        Self::SidebandIndex,
        Self::SidebandRatio,
    ];

    /// As written in files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Fm0 => "fm0",
            Self::Fm4 => "fm4",
            Self::M6a => "m6a",
            Self::M8a => "m8a",
            Self::EnergyRatio => "energy_ratio",
            Self::ResidualRms => "residual_rms",
            Self::ResidualKurtosis => "residual_kurtosis",
            Self::DifferenceRms => "difference_rms",
            Self::EnvelopeDeviation => "envelope_deviation",
            Self::EnvelopeKurtosis => "envelope_kurtosis",
            Self::SidebandIndex => "sideband_index",
            Self::SidebandRatio => "sideband_ratio",
        }
    }

    /// What the value is measured in, for a channel in `unit`.
    pub const fn unit(self, unit: &str) -> &str {
        match self {
            Self::ResidualRms | Self::DifferenceRms | Self::EnvelopeDeviation | Self::SidebandIndex => unit,
            _ => "1",
        }
    }
}

/// Of one gear.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GearIndicators {
    /// Revolutions of its shaft that were averaged; 0 where nothing is known.
    pub revolutions: u32,
    /// By [`GearIndicator::ALL`].
    pub values: [Estimate; GEAR_INDICATORS],
}

impl GearIndicators {
    /// Nothing is known.
    pub const UNKNOWN: Self = Self { revolutions: 0, values: [Estimate::UNKNOWN; GEAR_INDICATORS] };

    /// One of them.
    pub fn get(&self, which: GearIndicator) -> Estimate {
        self.values[which as usize]
    }
}

/// Of one window of one channel.
#[derive(Clone, Debug, PartialEq)]
pub struct Indicators {
    /// By [`ChannelIndicator::ALL`].
    pub channel: [Estimate; CHANNEL_INDICATORS],
    /// Pinion and wheel of each stage, in the order of the bench file.
    pub gears: Vec<[GearIndicators; 2]>,
    /// Envelope at the orders of each bearing of the bench file, in [its
    /// order](crate::bench::BearingOrders::NAMES); unknown without a band.
    pub bearings: Vec<[EnvelopeLine; 4]>,
}

impl Indicators {
    /// Nothing is known, of a train of so many stages.
    pub fn unknown(stages: usize) -> Self {
        Self {
            channel: [Estimate::UNKNOWN; CHANNEL_INDICATORS],
            gears: vec![[GearIndicators::UNKNOWN; 2]; stages],
            bearings: Vec::new(),
        }
    }

    /// Forgets all; does not allocate where there is room for the stages and bearings.
    pub fn clear(&mut self, stages: usize, bearings: usize) {
        self.channel = [Estimate::UNKNOWN; CHANNEL_INDICATORS];
        self.gears.clear();
        self.gears.resize(stages, [GearIndicators::UNKNOWN; 2]);
        self.bearings.clear();
        self.bearings.resize(bearings, [EnvelopeLine::UNKNOWN; 4]);
    }

    /// One of the channel.
    pub fn get(&self, which: ChannelIndicator) -> Estimate {
        self.channel[which as usize]
    }
}
