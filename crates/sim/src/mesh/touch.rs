//! The pairs near contact at one phase in the form that makes their law short.
//!
//! # Formula
//! The compliances `c_ij = λ sqrt(f_i f_j)` off the diagonal are of rank one, so with
//! `g = sqrt(λ f)` and `w = 1/(c − λ f)` per pair the pairs that carry have, at an approach δ and
//! `x = δ − gap`,
//!
//! ```text
//! F_i = w_i (x_i − g_i Q / (1 + P))      Σ F = Σ w x − S Q / (1 + P)      Σ dF/dδ = Σ w − S² / (1 + P)
//! P = Σ w g²,  Q = Σ w g x,  S = Σ w g
//! ```
//!
//! however many they are. A pair carries where `x − g Q / (1 + P) > 0`, and stays apart where that
//! is negative.

/// Pairs that are watched at once.
pub const SLOTS: usize = 3;

/// Pairs near contact at one phase, the newest first.
#[derive(Clone, Copy, Debug, Default)]
pub struct Touch {
    /// Number of the newest pair that is watched; the others are its predecessors.
    pub newest: f64,
    /// By pair: stiffness w (N/m), root of the shared compliance g (m/N)^½, gap (m).
    pub pairs: [[f64; 3]; SLOTS],
}

/// Force of one set of pairs at one phase, linear in the approach.
#[derive(Clone, Copy, Debug, Default)]
pub struct SetLaw {
    /// By the approach (N/m).
    pub stiffness_n_per_m: f64,
    /// At no approach (N): below zero where the flanks are apart then.
    pub at_zero_n: f64,
}

impl SetLaw {
    /// Force at an approach (N).
    #[inline(always)]
    pub fn force_n(self, approach_m: f64) -> f64 {
        self.stiffness_n_per_m.mul_add(approach_m, self.at_zero_n)
    }

    /// By how much this law's force exceeds another's, at any approach.
    #[inline(always)]
    pub fn less(self, other: Self) -> Self {
        Self {
            stiffness_n_per_m: self.stiffness_n_per_m - other.stiffness_n_per_m,
            at_zero_n: self.at_zero_n - other.at_zero_n,
        }
    }
}

impl Touch {
    /// Bit of the pair in a slot among the touching ones: its number modulo 16.
    #[inline(always)]
    fn bit(&self, slot: usize) -> u32 {
        1 << ((self.newest as i64 - slot as i64) & 15)
    }

    /// The bits of a set of slots.
    #[inline(always)]
    pub fn touching(&self, set: u8) -> u32 {
        let mut out = 0;
        for slot in 0..SLOTS {
            out |= u32::from(set >> slot & 1) * self.bit(slot);
        }
        out
    }

    /// The slots of some bits; `None` where one of them is not watched.
    #[inline(always)]
    pub fn set(&self, touching: u32) -> Option<u8> {
        let mut set = 0;
        for slot in 0..SLOTS {
            set |= u8::from(touching & self.bit(slot) != 0) << slot;
        }
        (self.touching(set) == touching).then_some(set)
    }

    /// The law of a set of slots, even where some of its pairs would pull.
    #[inline(always)]
    pub fn law(&self, set: u8) -> SetLaw {
        let (mut stiffness, mut s, mut p, mut gaps, mut g_gaps) = (0.0_f64, 0.0_f64, 0.0_f64, 0.0_f64, 0.0_f64);
        for (slot, [w, g, gap]) in self.pairs.iter().enumerate() {
            let w = w * f64::from(set >> slot & 1);
            let wg = w * g;
            stiffness += w;
            s += wg;
            p = wg.mul_add(*g, p);
            gaps = w.mul_add(*gap, gaps);
            g_gaps = wg.mul_add(*gap, g_gaps);
        }
        let part = s / (1.0 + p);
        SetLaw { stiffness_n_per_m: (-part).mul_add(s, stiffness), at_zero_n: part.mul_add(g_gaps, -gaps) }
    }

    /// The slots that carry at an approach: the solution of the complementarity problem, as of
    /// [`super::Pairs::force`].
    #[inline(always)]
    pub fn carrying(&self, approach_m: f64) -> u8 {
        let mut set = 0;
        for (slot, [_, _, gap]) in self.pairs.iter().enumerate() {
            set |= u8::from(approach_m > *gap) << slot;
        }
        loop {
            let (mut p, mut q) = (0.0_f64, 0.0_f64);
            for (slot, [w, g, gap]) in self.pairs.iter().enumerate() {
                let wg = w * g * f64::from(set >> slot & 1);
                p = wg.mul_add(*g, p);
                q = wg.mul_add(approach_m - gap, q);
            }
            let shared = q / (1.0 + p);
            // A pair that would have to pull is lifted off by its neighbours' foundation: leave the
            // worst out.
            let (mut worst, mut least) = (0, 0.0);
            for (slot, [w, g, gap]) in self.pairs.iter().enumerate() {
                let force = w * f64::from(set >> slot & 1) * ((-g).mul_add(shared, approach_m - gap));
                if force < least {
                    (worst, least) = (slot, force);
                }
            }
            if least >= 0.0 {
                return set;
            }
            set &= !(1 << worst);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The law is that of the compliance matrix inverted by hand, for one pair and for two that
    /// share a part.
    #[test]
    fn analytic_law_of_a_set_is_the_inverse_compliance() {
        // c = 1/w + g²: two pairs of 3 and 4, sharing g₁ g₂ = 0.5.
        let (g1, g2) = (0.5_f64, 1.0_f64);
        let (c1, c2, c12) = (3.0, 4.0, g1 * g2);
        let touch = Touch {
            newest: 17.0,
            pairs: [[1.0 / (c1 - g1 * g1), g1, 0.1], [1.0 / (c2 - g2 * g2), g2, -0.2], [1.0, 0.3, 1.0]],
        };
        let alone = touch.law(1);
        assert!((alone.stiffness_n_per_m - 1.0 / c1).abs() < 1e-15 && alone.force_n(0.1).abs() < 1e-15);
        let (x, y) = (0.6 - 0.1, 0.6 + 0.2);
        let det = c1 * c2 - c12 * c12;
        let expected = ((c2 - c12) * x + (c1 - c12) * y) / det;
        assert!((touch.law(3).force_n(0.6) - expected).abs() < 1e-15);
        assert!((touch.law(3).stiffness_n_per_m - (c1 + c2 - 2.0 * c12) / det).abs() < 1e-15);
        // Pair 17 has bit 1, pair 16 bit 0, pair 15 bit 15.
        assert_eq!((touch.touching(3), touch.set(3), touch.set(4)), (3, Some(3), None));
        assert_eq!((touch.carrying(0.6), touch.carrying(0.0), touch.carrying(-0.3)), (3, 2, 0));
        // Just beyond its gap the first pair would have to pull: the other one has pushed its
        // foundation away.
        assert_eq!(touch.carrying(0.101), 2);
    }
}
