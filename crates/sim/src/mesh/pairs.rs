//! The tooth pairs in contact at one instant, and the force that they carry together.

use super::LoadPoint;

/// Most pairs that can be near contact at once: a contact ratio below 3, and corner contact before
/// and after.
pub const MAX_PAIRS: usize = 4;
/// Least part of the face that misaligned flanks touch on.
const LEAST_PART: f64 = 0.02;
/// Newton steps to the forces of tilted flanks, and their change over the load that ends them.
const TILT_STEPS: usize = 12;
const TILTED: f64 = 1e-6;

/// One tooth pair in contact or near it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pair {
    /// Number of the pair since the start: it enters, nominally, at mesh phase `index`.
    pub index: i64,
    /// Tooth of the pinion, `index mod z₁`.
    pub pinion_tooth: u32,
    /// Tooth of the wheel, `index mod z₂`.
    pub wheel_tooth: u32,
    /// Roll coordinate of the contact on the pinion (m): lever of a friction force about its axis.
    pub pinion_roll_m: f64,
    /// Roll coordinate of the contact on the wheel (m).
    pub wheel_roll_m: f64,
    /// Compliance of the pair alone (m/N).
    pub compliance_m_per_n: f64,
    /// Part of it that both gear bodies contribute (m/N); neighbouring pairs share it.
    pub foundation_m_per_n: f64,
    /// Approach (m) at which this pair begins to touch: flank deviations, and the corner gap before
    /// entry and after exit.
    pub gap_m: f64,
}

/// The pairs near contact, in order of decreasing index (the youngest first).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pairs {
    items: [Pair; MAX_PAIRS],
    len: usize,
    /// `c₁₂ / sqrt(f₁ f₂)` of two pairs on the same bodies.
    pub(super) coupling: f64,
}

/// Force and tangent stiffness of the mesh at one approach.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MeshForce {
    /// Along the line of action, pressing the gears apart (N, ≥ 0).
    pub force_n: f64,
    /// d force / d approach (N/m); 0 out of contact. The force is piecewise linear in the approach.
    pub stiffness_n_per_m: f64,
    /// Share of each pair, in the order of [`Pairs::as_slice`] (N).
    pub pair_forces_n: [f64; MAX_PAIRS],
    /// d share / d approach (N/m).
    pub pair_stiffnesses_n_per_m: [f64; MAX_PAIRS],
    /// The pairs that carry, one bit each in the same order.
    pub set: u8,
}

impl MeshForce {
    #[inline(always)]
    fn add(&mut self, pair: usize, stiffness: f64, depth_m: f64) {
        self.pair_forces_n[pair] = stiffness * depth_m;
        self.pair_stiffnesses_n_per_m[pair] = stiffness;
        self.force_n += stiffness * depth_m;
        self.stiffness_n_per_m += stiffness;
    }
}

impl Pairs {
    /// The pairs.
    #[inline(always)]
    pub fn as_slice(&self) -> &[Pair] {
        &self.items[..self.len]
    }

    #[inline(always)]
    pub(super) fn clear(&mut self) {
        self.len = 0;
    }

    /// The place of a further pair, to be written and then kept or not; `None` where there are
    /// [`MAX_PAIRS`] already.
    #[inline(always)]
    pub(super) fn next(&mut self) -> Option<&mut Pair> {
        self.items.get_mut(self.len)
    }

    /// Keeps the pair that was written last, where `touches` says so.
    #[inline(always)]
    pub(super) fn keep(&mut self, touches: bool) {
        self.len += usize::from(touches);
    }

    /// Opens each pair by a further gap (m).
    pub(crate) fn open(&mut self, gap_m: impl Fn(&Pair) -> f64) {
        for pair in &mut self.items[..self.len] {
            pair.gap_m += gap_m(pair);
        }
    }

    /// Laws that are not linear, about the static load.
    #[inline(always)]
    pub(super) fn under_load(&mut self, load: &LoadPoint) {
        if load.hardening != 0.0 {
            self.harden(load.hardening, load.load_n.abs());
        }
        if load.wedge_m > 0.0 {
            self.tilt(load.wedge_m, load.load_n.abs());
        }
    }

    /// Pairs whose stiffness `F/δ` goes with the load F by the power n, as that of crowned flanks
    /// does (`F = K δ^p`, `n = 1 − 1/p`), vibrate about it by the tangent of that law: `1/(1 − n)`
    /// times as stiff, and as far closed under the static load as the law says. Their compliances
    /// are those of the law at that load.
    #[cold]
    #[inline(never)]
    fn harden(&mut self, exponent: f64, load_n: f64) {
        let Some((approach, _)) = self.approach_at(load_n) else { return };
        for pair in &mut self.items[..self.len] {
            pair.gap_m += exponent * (approach - pair.gap_m).max(0.0);
            pair.compliance_m_per_n *= 1.0 - exponent;
            pair.foundation_m_per_n *= 1.0 - exponent;
        }
    }

    /// Flanks at an angle γ, which opens a wedge of γ b (m) over the face, touch at one edge first.
    /// With the compliance c of what is not shared with the neighbours, a pair that carries F
    /// approaches by `h = √(2 γ b c F)` until the load closes the wedge at `h = γ b`, and by `c F +
    /// γ b/2` beyond. Each pair gets the tangent of its law at the force that it carries at this
    /// phase under the static load, so that how pairs share it follows their compliances and gaps.
    #[cold]
    #[inline(never)]
    fn tilt(&mut self, wedge_m: f64, load_n: f64) {
        let straight = *self;
        let mut forces = [load_n / self.len.max(1) as f64; MAX_PAIRS];
        for _ in 0..TILT_STEPS {
            for ((pair, plain), force) in self.items[..straight.len].iter_mut().zip(straight.as_slice()).zip(forces) {
                let shared = straight.coupling * plain.foundation_m_per_n;
                let own = plain.compliance_m_per_n - shared;
                let part = (2.0 * force * own / wedge_m).sqrt().clamp(LEAST_PART, 1.0);
                pair.compliance_m_per_n = own / part + shared;
                pair.gap_m = plain.gap_m + 0.5 * part * wedge_m;
            }
            let Some((approach, _)) = self.approach_at(load_n) else { return };
            let carried = self.force(approach).pair_forces_n;
            let change = carried.iter().zip(forces).map(|(now, before)| (now - before).abs()).fold(0.0, f64::max);
            forces = carried;
            if change <= TILTED * load_n {
                return;
            }
        }
    }

    /// Compliance c_ij (m/N): `c_ij = λ sqrt(f_i f_j)` off the diagonal.
    #[inline(always)]
    fn compliance(&self, i: usize, j: usize) -> f64 {
        if i == j {
            self.items[i].compliance_m_per_n
        } else {
            self.coupling * (self.items[i].foundation_m_per_n * self.items[j].foundation_m_per_n).sqrt()
        }
    }

    /// The pairs whose flanks would meet at an approach if no other pair carried, one bit each.
    #[inline(always)]
    pub fn met(&self, approach_m: f64) -> u8 {
        let mut set = 0;
        for (i, pair) in self.as_slice().iter().enumerate() {
            set |= u8::from(approach_m > pair.gap_m) << i;
        }
        set
    }

    /// The force at approach `approach_m` of the two gears along the line of action (positive
    /// closing).
    ///
    /// All pairs see one approach: `C F = δ − gap` over the pairs that carry, every force ≥ 0, and
    /// a pair that does not carry stays apart (a linear complementarity problem with one solution,
    /// C being positive definite).
    #[inline(always)]
    pub fn force(&self, approach_m: f64) -> MeshForce {
        let mut set = self.met(approach_m);
        loop {
            let out = self.forced(set, approach_m);
            // A pair that would have to pull is lifted off by its neighbours' foundation: leave the
            // worst out.
            let (mut worst, mut least) = (0, 0.0);
            for (i, &force) in out.pair_forces_n.iter().enumerate() {
                if force < least {
                    (worst, least) = (i, force);
                }
            }
            if least >= 0.0 {
                return out;
            }
            set &= !(1 << worst);
        }
    }

    /// Pairs that carry, one bit each by the pair's number modulo 16.
    #[inline(always)]
    pub(crate) fn touching(&self, force: &MeshForce) -> u32 {
        let carrying = self.as_slice().iter().zip(&force.pair_forces_n).filter(|(_, share)| **share > 0.0);
        carrying.fold(0, |bits, (pair, _)| bits | 1 << (pair.index & 15))
    }

    /// Force (N), stiffness (N/m) and [`Self::touching`] at an approach. As [`Self::force`] to the
    /// last bit, without the shares of the pairs where one pair carries or two that both press.
    #[inline(always)]
    pub(crate) fn carried(&self, approach_m: f64) -> (f64, f64, u32) {
        let set = self.met(approach_m);
        let (first, rest) = (set.trailing_zeros() as usize % MAX_PAIRS, set & set.wrapping_sub(1));
        let a = &self.items[first];
        if set != 0 && rest == 0 {
            let stiffness = 1.0 / a.compliance_m_per_n;
            let force = stiffness * (approach_m - a.gap_m);
            return (force, stiffness, u32::from(force > 0.0) << (a.index & 15));
        }
        if rest != 0 && rest & rest.wrapping_sub(1) == 0 && self.coupling != 0.0 {
            let b = &self.items[rest.trailing_zeros() as usize % MAX_PAIRS];
            let shared = self.coupling * (a.foundation_m_per_n * b.foundation_m_per_n).sqrt();
            let det = 1.0 / (a.compliance_m_per_n * b.compliance_m_per_n - shared * shared);
            let (x, y) = (approach_m - a.gap_m, approach_m - b.gap_m);
            let of_a = (b.compliance_m_per_n * x - shared * y) * det;
            let of_b = (a.compliance_m_per_n * y - shared * x) * det;
            if of_a >= 0.0 && of_b >= 0.0 {
                let stiffness = (b.compliance_m_per_n - shared) * det + (a.compliance_m_per_n - shared) * det;
                let bits = u32::from(of_a > 0.0) << (a.index & 15) | u32::from(of_b > 0.0) << (b.index & 15);
                return (of_a + of_b, stiffness, bits);
            }
        }
        let force = self.force(approach_m);
        (force.force_n, force.stiffness_n_per_m, self.touching(&force))
    }

    /// The force if the pairs of `set` (bits in the order of [`Self::as_slice`]), and no others,
    /// were in contact, even where they would pull.
    #[inline(always)]
    pub fn forced(&self, set: u8, approach_m: f64) -> MeshForce {
        let mut out = MeshForce { set, ..MeshForce::default() };
        let bit = |set: u8| set.trailing_zeros() as usize % MAX_PAIRS;
        let without_first = |set: u8| set & set.wrapping_sub(1);
        let (i, rest) = (bit(set), without_first(set));
        if set == 0 {
            return out;
        }
        if rest == 0 {
            out.add(i, 1.0 / self.items[i].compliance_m_per_n, approach_m - self.items[i].gap_m);
        } else if self.coupling == 0.0 {
            for i in (0..MAX_PAIRS).filter(|i| set >> i & 1 == 1) {
                out.add(i, 1.0 / self.items[i].compliance_m_per_n, approach_m - self.items[i].gap_m);
            }
        } else if without_first(rest) == 0 {
            let j = bit(rest);
            let (a, b, c) = (self.compliance(i, i), self.compliance(j, j), self.compliance(i, j));
            let det = 1.0 / (a * b - c * c);
            let (x, y) = (approach_m - self.items[i].gap_m, approach_m - self.items[j].gap_m);
            out.pair_forces_n[i] = (b * x - c * y) * det;
            out.pair_forces_n[j] = (a * y - c * x) * det;
            out.pair_stiffnesses_n_per_m[i] = (b - c) * det;
            out.pair_stiffnesses_n_per_m[j] = (a - c) * det;
            out.force_n = out.pair_forces_n[i] + out.pair_forces_n[j];
            out.stiffness_n_per_m = out.pair_stiffnesses_n_per_m[i] + out.pair_stiffnesses_n_per_m[j];
        } else {
            self.solve_many(approach_m, &mut out);
        }
        out
    }

    /// Forces and tangent stiffnesses of three or four pairs, all taken to be in contact.
    #[cold]
    fn solve_many(&self, approach_m: f64, out: &mut MeshForce) {
        let mut active = [0_usize; MAX_PAIRS];
        let mut n = 0;
        for i in (0..MAX_PAIRS).filter(|i| out.set >> i & 1 == 1) {
            active[n] = i;
            n += 1;
        }
        let mut forces = [0.0; MAX_PAIRS];
        let mut stiffnesses = [0.0; MAX_PAIRS];
        // Cholesky-free elimination; symmetric positive definite needs no pivoting.
        let mut matrix = [[0.0; MAX_PAIRS]; MAX_PAIRS];
        for r in 0..n {
            for c in 0..n {
                matrix[r][c] = self.compliance(active[r], active[c]);
            }
            forces[r] = approach_m - self.items[active[r]].gap_m;
            stiffnesses[r] = 1.0;
        }
        for p in 0..n {
            let pivot = matrix[p];
            for r in p + 1..n {
                let factor = matrix[r][p] / pivot[p];
                for (value, above) in matrix[r].iter_mut().zip(pivot) {
                    *value -= factor * above;
                }
                forces[r] -= factor * forces[p];
                stiffnesses[r] -= factor * stiffnesses[p];
            }
        }
        for p in (0..n).rev() {
            for c in p + 1..n {
                forces[p] -= matrix[p][c] * forces[c];
                stiffnesses[p] -= matrix[p][c] * stiffnesses[c];
            }
            forces[p] /= matrix[p][p];
            stiffnesses[p] /= matrix[p][p];
        }
        for (k, &i) in active[..n].iter().enumerate() {
            out.pair_forces_n[i] = forces[k];
            out.pair_stiffnesses_n_per_m[i] = stiffnesses[k];
            out.force_n += forces[k];
            out.stiffness_n_per_m += stiffnesses[k];
        }
    }

    /// Approach (m) at which the pairs carry `force_n` together, and the tangent stiffness (N/m)
    /// there; `None` where no pair is near contact.
    #[inline(always)]
    pub fn approach_at(&self, force_n: f64) -> Option<(f64, f64)> {
        let first = self.as_slice().iter().map(|p| p.gap_m).min_by(f64::total_cmp)?;
        if force_n <= 0.0 {
            return Some((first, 0.0));
        }
        // Piecewise linear and increasing with at most MAX_PAIRS + few pieces: Newton from the
        // stiff side ends exactly.
        let lone = self.as_slice().iter().map(|p| p.gap_m + force_n * p.compliance_m_per_n);
        let mut approach = lone.min_by(f64::total_cmp)?;
        let mut stiffness = 0.0;
        for _ in 0..16 {
            let now = self.force(approach);
            stiffness = now.stiffness_n_per_m;
            let step = (force_n - now.force_n) / stiffness;
            approach += step;
            if step.abs() <= 1e-14 * approach.abs() {
                break;
            }
        }
        Some((approach, stiffness))
    }
}

#[cfg(test)]
mod tests {
    use super::{MAX_PAIRS, Pair, Pairs};

    /// One, two and three pairs near contact, alone and pressed together, with and without a body
    /// that they share; one of them is lifted off by its neighbour.
    #[test]
    fn conform_the_short_form_is_the_long_one_to_the_last_bit() {
        let mut lifted = 0;
        for (len, coupling) in (1..MAX_PAIRS).flat_map(|len| [(len, 0.0), (len, 0.8)]) {
            let mut pairs = Pairs { len, coupling, ..Pairs::default() };
            for (i, pair) in pairs.items[..len].iter_mut().enumerate() {
                *pair = Pair {
                    index: 41 - i as i64,
                    compliance_m_per_n: 4e-9 + 1e-9 * i as f64,
                    foundation_m_per_n: 3e-9 + 0.7e-9 * i as f64,
                    gap_m: 2e-6 * i as f64 - 1e-6,
                    ..Pair::default()
                };
            }
            for step in -20..200 {
                let approach = 1e-7 * f64::from(step);
                let long = pairs.force(approach);
                let (force, stiffness, touching) = pairs.carried(approach);
                assert_eq!(force.to_bits(), long.force_n.to_bits(), "{len} {coupling} {approach}");
                assert_eq!(stiffness.to_bits(), long.stiffness_n_per_m.to_bits(), "{len} {coupling} {approach}");
                assert_eq!(touching, pairs.touching(&long));
                lifted += u32::from(long.set != pairs.met(approach));
            }
        }
        assert!(lifted > 0);
    }
}
