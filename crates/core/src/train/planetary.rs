//! Kinematics of a planetary stage, and which of its lines a fixed sensor sees.
//!
//! # Speeds
//!
//! Willis' equation, with teeth `z` and speeds `n` of sun, ring and carrier (R. Willis, Principles
//! of Mechanism, 1841):
//!
//! ```text
//! (n_s - n_c) / (n_r - n_c) = - z_r / z_s
//! mesh                 f = z_s |n_s - n_c| = z_r |n_r - n_c|        of sun and planets as of planets and ring
//! planet on its pin    f / z_p,  in space  n_c - (n_s - n_c) z_s / z_p
//! planet passes        N |n_c|
//! ```
//!
//! # Lines
//!
//! With a fixed ring every planet meshes `z_r` times a turn of the carrier, planet `i` at the angle
//! `ψ_i` (turns) ahead of the first. A sensor that stands still hears each planet more or less
//! loudly as it passes, a function of the carrier's angle with coefficients `w_d`. The sum over
//! planets is
//!
//! ```text
//! Σ_k Σ_d A_k w_d [ Σ_i e^{j 2π (k z_r + d) ψ_i} ] e^{j 2π (k z_r + d) n_c t}
//! ```
//!
//! So the line of order `m = k z_r + d` of the carrier has the weight `|Σ_i e^{j 2π m ψ_i}| / N`:
//! with N equally spaced planets it is one where `m` is a multiple of N, else nothing (P. D.
//! McFadden, J. D. Smith, "An explanation for the asymmetry of the modulation sidebands about the
//! tooth meshing frequency in epicyclic gear vibration", Proc. IMechE 199 C1 (1985) 65; J. McNames,
//! "Fourier series analysis of epicyclic gearbox vibration", J. Vib. Acoust. 124 (2002) 150; M.
//! Inalpolat, A. Kahraman, J. Sound Vib. 323 (2009) 677). With a fixed sun `z_s` is in place of
//! `z_r`; with a fixed carrier nothing passes and the lines are those of the mesh.
//!
//! *The k-th harmonic* of such a stage is the line nearest to `k z` whose weight is
//! [`LEAST_WEIGHT`] at least, of two that are equally near the one with more weight, of equals the
//! upper: the acceleration of a given force or displacement grows with frequency. Where no line
//! within N orders has that weight, it is the one with most.
//!
//! A central gear that is off centre or cracked turns with its own speed in space. Its sidebands
//! about a visible line lie at multiples of that speed: in the frame of the carrier the
//! once-per-turn error has `n_s - n_c` and meets planet `i` late by `ψ_i`, which selects `d = ± 1`
//! in place of 0 and adds `n_c`.

use crate::bench::{Member, Planetary};
use crate::verdict::HARMONICS;

/// Weight of the planets' phases from which a line counts as one that they leave.
pub const LEAST_WEIGHT: f64 = 0.5;

/// Lines on each side of a harmonic, in planet passes, that are known to be there.
const KNOWN_PASSES: i64 = 2;

/// Speeds and lines of a planetary stage. Orders are multiples of the input shaft's speed, positive
/// in the sense of the stage's driving member.
#[derive(Clone, Debug, PartialEq)]
pub struct PlanetarySet {
    /// Number of planets.
    pub planets: u32,
    /// Teeth of a planet.
    pub planet_teeth: u32,
    /// Stands still.
    pub fixed: Member,
    /// On the stage's first shaft.
    pub input: Member,
    /// On its second shaft.
    pub output: Member,
    /// Speed of the sun.
    pub sun_order: f64,
    /// Speed of the carrier.
    pub carrier_order: f64,
    /// Speed of the ring.
    pub ring_order: f64,
    /// Speed of a planet in space.
    pub planet_order: f64,
    /// Speed of a planet on its pin (≥ 0).
    pub planet_spin_order: f64,
    /// Planets that pass a fixed point, 0 where the carrier stands still (≥ 0).
    pub pass_order: f64,
    /// Of each harmonic, from `k` times the mesh order (signed; a multiple of the carrier's order).
    pub shifts: [f64; HARMONICS],
    /// Of each harmonic: lines beside it that the planets leave, from its own line.
    pub beside: [Vec<f64>; HARMONICS],
}

/// Weight of the carrier order `m` with planets at `positions` (turns).
pub fn weight(positions: &[f64], m: i64) -> f64 {
    let turned = |turns: &f64| (std::f64::consts::TAU * (turns * m as f64).fract()).sin_cos();
    let (sine, cosine) = positions.iter().map(turned).fold((0.0, 0.0), |sum, z| (sum.0 + z.0, sum.1 + z.1));
    sine.hypot(cosine) / positions.len().max(1) as f64
}

/// Speeds of sun, carrier and ring in a common unit, as whole numbers.
pub fn speeds(sun: u32, ring: u32, fixed: Member) -> [i64; 3] {
    let (s, r) = (i64::from(sun), i64::from(ring));
    match fixed {
        Member::Ring => [s + r, s, 0],
        Member::Sun => [0, r, s + r],
        Member::Carrier => [r, 0, -s],
    }
}

/// Position of a member among [`speeds`].
pub fn position(member: Member) -> usize {
    match member {
        Member::Sun => 0,
        Member::Carrier => 1,
        Member::Ring => 2,
    }
}

impl PlanetarySet {
    /// For a sun, a ring and what else the stage has, its first shaft turning at `order`.
    pub fn new(sun: u32, ring: u32, set: &Planetary, order: f64) -> Self {
        let whole = speeds(sun, ring, set.fixed);
        // The driving member turns, for it is not the fixed one.
        let unit = order / whole[position(set.input)] as f64;
        let [sun_order, carrier_order, ring_order] = whole.map(|speed| speed as f64 * unit);
        let (teeth, ahead) = (f64::from(set.planet.teeth), (sun_order - carrier_order) * f64::from(sun));
        let positions = set.positions_turns();
        let mut out = Self {
            planets: set.planets,
            planet_teeth: set.planet.teeth,
            fixed: set.fixed,
            input: set.input,
            output: set.output,
            sun_order,
            carrier_order,
            ring_order,
            planet_order: carrier_order - ahead / teeth,
            planet_spin_order: ahead.abs() / teeth,
            pass_order: f64::from(set.planets) * carrier_order.abs(),
            shifts: [0.0; HARMONICS],
            beside: Default::default(),
        };
        let Some(teeth) = out.passed_teeth(sun, ring) else { return out };
        let reach = i64::from(set.planets);
        for k in 0..HARMONICS {
            let mesh = (k as i64 + 1) * i64::from(teeth);
            let line = harmonic_line(&positions, mesh);
            out.shifts[k] = (line - mesh) as f64 * carrier_order.abs();
            out.beside[k] = (-KNOWN_PASSES * reach..=KNOWN_PASSES * reach)
                .filter(|&d| d != 0 && line + d > 0 && weight(&positions, line + d) >= LEAST_WEIGHT)
                .map(|d| d as f64 * carrier_order.abs())
                .collect();
        }
        out
    }

    /// Teeth of the central gear that stands still, which the planets roll over; none where the
    /// carrier stands still.
    pub fn passed_teeth(&self, sun: u32, ring: u32) -> Option<u32> {
        match self.fixed {
            Member::Ring => Some(ring),
            Member::Sun => Some(sun),
            Member::Carrier => None,
        }
    }

    /// Which gear's teeth an average over turns of a member shows, 0 for the sun and 1 for the
    /// ring: see [`Train::gears_on`](super::Train::gears_on).
    pub fn side_seen_by(&self, member: Member) -> Option<usize> {
        match (self.fixed, member) {
            (Member::Ring, Member::Carrier) | (Member::Carrier, Member::Ring) => Some(1),
            (Member::Sun, Member::Carrier) | (Member::Carrier, Member::Sun) => Some(0),
            _ => None,
        }
    }

    /// Speed of a member.
    pub fn order_of(&self, member: Member) -> f64 {
        match member {
            Member::Sun => self.sun_order,
            Member::Carrier => self.carrier_order,
            Member::Ring => self.ring_order,
        }
    }
}

/// Order of the carrier at which the harmonic at `mesh` is read.
pub fn harmonic_line(positions: &[f64], mesh: i64) -> i64 {
    let reach = positions.len() as i64;
    // The heavier one, the first of equals.
    let heavier = |a: (i64, f64), b: (i64, f64)| if b.1 > a.1 + 1e-9 { b } else { a };
    let weighed = |m: i64| (m, if m > 0 { weight(positions, m) } else { 0.0 });
    let mut most = (mesh, 0.0);
    for d in 0..=reach {
        let here = heavier(weighed(mesh + d), weighed(mesh - d));
        if here.1 >= LEAST_WEIGHT {
            return here.0;
        }
        most = heavier(most, here);
    }
    most.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::Gear;

    fn set(planets: u32, planet: u32, fixed: Member, input: Member, output: Member) -> Planetary {
        let planet = Gear::with_teeth(planet);
        Planetary { planets, planet, positions_deg: Vec::new(), fixed, input, output }
    }

    /// Every choice of fixed, driving and driven member satisfies Willis' equation, leaves the
    /// fixed member at rest and the driving one at its speed, and both meshes of a planet have one
    /// frequency: rolling without slip, worked out from the planet's speed alone.
    #[test]
    fn analytic_willis_for_every_fixed_member() {
        for fixed in Member::ALL {
            for input in Member::ALL.into_iter().filter(|m| *m != fixed) {
                let output = Member::ALL.into_iter().find(|m| *m != fixed && *m != input).unwrap();
                let found = PlanetarySet::new(28, 100, &set(4, 36, fixed, input, output), 0.7);
                assert_eq!((found.order_of(fixed), found.order_of(input)), (0.0, 0.7));
                let (s, c, r) = (found.sun_order, found.carrier_order, found.ring_order);
                assert!(((s - c) * 28.0 + (r - c) * 100.0).abs() < 1e-12);
                let spin = found.planet_order - c;
                assert!(((s - c) * 28.0 + spin * 36.0).abs() < 1e-12 && ((r - c) * 100.0 - spin * 36.0).abs() < 1e-12);
                assert!((spin.abs() - found.planet_spin_order).abs() < 1e-12);
            }
        }
    }

    /// Sun 28, ring 100 standing still, four planets of 36: the carrier turns 7/32 times as fast as
    /// the sun (1 : 4.571), which makes the mesh 175/8 of it, and 100 is a multiple of four.
    #[test]
    fn analytic_planetary_of_28_36_and_100_teeth() {
        let found = PlanetarySet::new(28, 100, &set(4, 36, Member::Ring, Member::Sun, Member::Carrier), 1.0);
        assert!((found.carrier_order - 7.0 / 32.0).abs() < 1e-15);
        assert!((100.0 * found.carrier_order - 21.875).abs() < 1e-12);
        assert_eq!(found.shifts, [0.0; HARMONICS]);
    }

    /// With 84 and 99 teeth of a ring and three or four planets: the multiples of N nearest to k z,
    /// and no others within reach.
    #[test]
    fn analytic_lines_are_multiples_of_the_number_of_planets() {
        for (teeth, planets) in [(84, 3), (99, 4), (70, 3), (98, 4), (61, 5), (100, 4)] {
            let positions: Vec<f64> = (0..planets).map(|i| i as f64 / planets as f64).collect();
            for m in 0..500 {
                let expected = f64::from(u8::from(m % planets == 0));
                assert!((weight(&positions, m) - expected).abs() < 1e-9, "{m} of {planets}");
            }
            for k in 1..=5 {
                let (mesh, line) = (k * teeth, harmonic_line(&positions, k * teeth));
                let nearest = (mesh - planets..=mesh + planets).filter(|m| m % planets == 0).map(|m| (m - mesh).abs());
                assert!(line % planets == 0 && Some((line - mesh).abs()) == nearest.min(), "{mesh}: {line}");
                // Of two equally near ones the upper.
                assert!((line - mesh).abs() * 2 != planets || line > mesh);
            }
        }
    }

    /// Sun 27, ring 99, four planets at 0, 32, 63 and 95 steps of 1/126 of a turn: two pairs that
    /// stand opposite, so that odd orders vanish, and with `|cos(π m 32/126)|` for even ones 98 has
    /// 0.94 and 100 has 0.32; of 296 and 298, equally near to 297, 296 has more (0.85 and 0.54).
    #[test]
    fn analytic_lines_of_planets_at_unequal_places() {
        let positions = [0.0, 32.0, 63.0, 95.0].map(|steps| steps / 126.0);
        for (m, expected) in [(98, 0.9397), (99, 0.0), (100, 0.3185), (296, 0.8534), (297, 0.0), (298, 0.5425)] {
            assert!((weight(&positions, m) - expected).abs() < 1e-3, "{m}: {}", weight(&positions, m));
        }
        assert_eq!([99, 198, 297].map(|mesh| harmonic_line(&positions, mesh)), [98, 198, 296]);
    }

    /// Two pairs of planets, 5° off equal spacing: the lines about a multiple of four stay, those
    /// that equal spacing forbids appear with little weight, and weights are those of the sum
    /// written out.
    #[test]
    fn analytic_weights_of_unequal_planets() {
        let positions = [0.0, 95.0 / 360.0, 0.5, 275.0 / 360.0];
        for m in [72_i64, 71, 70, 74] {
            let pair = if m % 2 == 0 { 2.0 } else { 0.0 };
            let by_hand = pair * (std::f64::consts::PI * m as f64 * 95.0 / 360.0).cos().abs() / 2.0;
            assert!((weight(&positions, m) - by_hand).abs() < 1e-9, "{m}");
        }
    }
}
