//! What is simulated: the bench plus everything that effects and scenarios add to it.
//!
//! Effects change a [`SimSetup`]; the simulator is then built from it once. So an effect needs to know nothing of the
//! integrator, and composite effects go through one model instead of being added up.

use gearwatch_core::bench::Bench;

use crate::faults::ToothModifications;
use crate::mesh::MeshOptions;

/// How often something repeats.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rate {
    /// Times per revolution of the shaft with this index.
    PerRevolution {
        /// Index of the shaft; `None` for the motor.
        shaft: Option<usize>,
        /// Multiple of its speed.
        order: f64,
    },
    /// At a fixed frequency (Hz).
    Hertz(f64),
}

/// The reference rotation is not even: `Ω(t) = Ω (1 + depth cos(rate))`, the same for all shafts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpeedFluctuation {
    /// How often.
    pub rate: Rate,
    /// Amplitude / mean speed (1).
    pub depth: f64,
}

/// Where a torque ripple enters the train.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RippleAt {
    /// The motor's torque.
    Motor,
    /// The driven end of the first shaft.
    Coupling,
    /// The brake's torque.
    Brake,
}

/// A torque `T (1 + depth cos(order θ))` about its mean, with the angle of the part where it enters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TorqueRipple {
    /// Where.
    pub at: RippleAt,
    /// Per revolution of that part.
    pub order: f64,
    /// Amplitude / mean torque there (1).
    pub depth: f64,
}

/// A force on the bearings of a shaft that its rotation brings about.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ShaftForce {
    /// `m e Ω²`, rotating with the shaft.
    Unbalance {
        /// Index of the shaft.
        shaft: usize,
        /// Mass × eccentricity (kg m).
        amount_kg_m: f64,
    },
    /// One short push per passage of a rolling element over a defect, towards the loaded side, with cage slip.
    Impacts {
        /// Index of the shaft.
        shaft: usize,
        /// Passages per revolution of the shaft.
        order: f64,
        /// Peak force (N).
        force_n: f64,
    },
    /// The seat of the bearing is out of round by the gap: the shaft is let go and caught once per revolution.
    LooseSeat {
        /// Index of the shaft.
        shaft: usize,
        /// Radial play (m).
        gap_m: f64,
    },
}

/// A single resonance in the path to a sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Resonance {
    /// Natural frequency (Hz).
    pub frequency_hz: f64,
    /// Fraction of critical.
    pub damping_ratio: f64,
    /// Its kind.
    pub kind: ResonanceKind,
}

/// How a resonance joins the path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ResonanceKind {
    /// A further structural mode beside the path: `H = 1 + gain · (f/f₀)² / (1 − (f/f₀)² + 2iζ f/f₀)`.
    Parallel {
        /// Share of the mode in the motion at the sensor.
        gain: f64,
    },
    /// The sensor on its mounting: `H = 1 / (1 − (f/f₀)² + 2iζ f/f₀)`.
    Mounting,
}

/// A tone that is added to a sensor's signal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tone {
    /// How often; above half the sampling rate it folds back, as in a converter without a filter.
    pub rate: Rate,
    /// Amplitude in the sensor's unit.
    pub amplitude: f64,
}

/// A sensor and its channel.
#[derive(Clone, Debug, PartialEq)]
pub struct SensorSetup {
    /// Factor on the signal.
    pub gain: f64,
    /// In the order of application.
    pub resonances: Vec<Resonance>,
    /// Added before the converter.
    pub tones: Vec<Tone>,
    /// Level at which the amplifier clips, in the sensor's unit.
    pub clip_level: Option<f64>,
    /// White noise of sensor and amplifier, standard deviation per sample in the sensor's unit.
    pub noise: f64,
    /// Full scale of the converter, in the sensor's unit.
    pub full_scale: f64,
    /// Bits of the converter.
    pub bits: u32,
    /// Corner of the first-order high-pass of the transducer supply (Hz).
    pub coupling_hz: f64,
}

impl SensorSetup {
    /// A common 100 mV/g transducer at a 24-bit converter: full scale 500 m/s², noise 2 mm/s² a sample, 0.5 Hz coupling; the same
    /// figures through the unit for `g`, and as plain numbers for any other unit.
    pub fn typical(unit: &str) -> Self {
        let unit_per_metre = metres_per_second2_to(unit);
        Self {
            gain: 1.0,
            resonances: Vec::new(),
            tones: Vec::new(),
            clip_level: None,
            noise: 2e-3 * unit_per_metre,
            full_scale: 500.0 * unit_per_metre,
            bits: 24,
            coupling_hz: 0.5,
        }
    }
}

/// Factor from m/s² to a sensor's unit: `g` = 9.80665 m/s²; `V` stands for a 100 mV/g transducer; 1 otherwise.
pub fn metres_per_second2_to(unit: &str) -> f64 {
    match unit {
        "g" => 1.0 / 9.806_65,
        "V" => 0.1 / 9.806_65,
        _ => 1.0,
    }
}

/// `F = max(0, K p^n + c(p) ṗ)` for a penetration p > 0, with `c` rising as a cubic step from 0 at p = 0 to `damping` at `depth`.
///
/// # Source
/// IMPACT of ADAMS. It knows no bending of teeth and no second pair: with the usual `K = 4/3 √R E*`, n = 3/2 a mesh comes out three to
/// six times too soft at bench loads, stiffens with F^(1/3), and is almost undamped at p ≪ depth. The mesh frequency shows only through
/// geometric errors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImpactLaw {
    /// K (N/m^n).
    pub stiffness: f64,
    /// n.
    pub exponent: f64,
    /// Damping at full depth (N s/m).
    pub damping_n_s_per_m: f64,
    /// Penetration at which the damping is full (m).
    pub depth_m: f64,
}

impl ImpactLaw {
    /// The usual figures of gear papers for flanks with radii of curvature `ρ = r sin α` at the pitch point (m):
    /// `K = 4/3 √R E*`, `1/R = 1/ρ₁ + 1/ρ₂`, `E* = E/(2(1−ν²))`, n = 3/2, 50 N s/mm at 0.1 mm.
    pub fn typical(radii_m: [f64; 2], youngs_modulus_pa: f64, poisson_ratio: f64) -> Self {
        let radius = 1.0 / (1.0 / radii_m[0] + 1.0 / radii_m[1]);
        let modulus = youngs_modulus_pa / (2.0 * (1.0 - poisson_ratio * poisson_ratio));
        Self { stiffness: 4.0 / 3.0 * radius.sqrt() * modulus, exponent: 1.5, damping_n_s_per_m: 5e4, depth_m: 1e-4 }
    }

    /// Force (N) at a penetration (m) closing at a speed (m/s).
    pub fn force_n(&self, penetration: f64, speed: f64) -> f64 {
        if penetration <= 0.0 {
            return 0.0;
        }
        let part = (penetration / self.depth_m).min(1.0);
        let damping = self.damping_n_s_per_m * part * part * (3.0 - 2.0 * part);
        (self.stiffness * penetration.powf(self.exponent) + damping * speed).max(0.0)
    }

    /// Elastic tangent stiffness (N/m) under a force (N): `n K^(1/n) F^(1 − 1/n)`.
    pub fn tangent_n_per_m(&self, force_n: f64) -> f64 {
        self.exponent * self.stiffness.powf(1.0 / self.exponent) * force_n.max(0.0).powf(1.0 - 1.0 / self.exponent)
    }
}

/// Everything that is simulated.
#[derive(Clone, Debug, PartialEq)]
pub struct SimSetup {
    /// The bench; effects change its numbers, never its names.
    pub bench: Bench,
    /// Physics of the tooth contacts.
    pub mesh: MeshOptions,
    /// What is wrong with the teeth, one per stage of the bench, in its order.
    pub teeth: Vec<ToothModifications>,
    /// The contact law of multibody programs in place of elastic tooth pairs, for all meshes.
    pub impact: Option<ImpactLaw>,
    /// Creep of the belt at the bench's nominal torque (1); it grows with the torque.
    pub belt_creep: f64,
    /// Uneven reference rotation.
    pub speed_fluctuations: Vec<SpeedFluctuation>,
    /// Ripple of driving and braking torques.
    pub torque_ripples: Vec<TorqueRipple>,
    /// Forces on bearings.
    pub shaft_forces: Vec<ShaftForce>,
    /// One per sensor of the bench, in its order.
    pub sensors: Vec<SensorSetup>,
    /// The sample clock runs fast by this (1e-6); the recording still says the nominal rate.
    pub clock_ppm: f64,
    /// Standard deviation of a tacho edge (s).
    pub tacho_jitter_s: f64,
}

impl SimSetup {
    /// The bench as its file says, its own `[[effect]]` tables not yet applied.
    pub fn nominal(bench: &Bench) -> Self {
        let mut bench = bench.clone();
        bench.effects.clear();
        Self {
            sensors: bench.sensors.iter().map(|sensor| SensorSetup::typical(&sensor.unit)).collect(),
            mesh: MeshOptions::default(),
            teeth: vec![ToothModifications::default(); bench.stages.len()],
            impact: None,
            bench,
            belt_creep: 0.0,
            speed_fluctuations: Vec::new(),
            torque_ripples: Vec::new(),
            shaft_forces: Vec::new(),
            clock_ppm: 0.0,
            tacho_jitter_s: 2e-6,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 34 / 73 teeth, module 3, at 730 N: penetration 12.5 µm, tangent stiffness 0.87e8 N/m (0.45e8 at 100 N, 1.66e8 at 5 kN).
    #[test]
    fn literature_tangent_stiffness_of_the_impact_law() {
        let law = ImpactLaw::typical([0.051, 0.1095].map(|r: f64| r * 20_f64.to_radians().sin()), 2.06e11, 0.3);
        for (force, tangent) in [(100.0, 0.45e8), (730.0, 0.87e8), (5000.0, 1.66e8)] {
            let found = law.tangent_n_per_m(force);
            assert!((found / tangent - 1.0).abs() < 0.01, "{found} at {force} N");
        }
        let penetration = (730.0 / law.stiffness).powf(1.0 / 1.5);
        assert!((penetration - 12.5e-6).abs() < 0.1e-6, "{penetration}");
        assert!((law.force_n(penetration, 0.0) - 730.0).abs() < 1e-9);
        assert_eq!(law.force_n(penetration, -1e9), 0.0, "a contact never pulls");
    }
}
