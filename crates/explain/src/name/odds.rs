//! Odds of an effect by how far a figure is from what sound machines show.

use std::f64::consts::TAU;

/// What sound machines show of a figure: a Gaussian.
#[derive(Clone, Copy, Debug)]
pub struct Usual {
    /// Mean.
    pub middle: f64,
    /// Standard deviation.
    pub sigma: f64,
}

impl Usual {
    /// Odds of an effect that may take the figure from the middle to anywhere `most` away, as
    /// likely each, by how far it is. `before` is what is believed beforehand. None on the side
    /// to which the effect does not go; further away than `most` counts as that.
    pub fn odds(&self, off: f64, most: f64, before: f64) -> f64 {
        if off < 0.0 {
            return 0.0;
        }
        let without = (-0.5 * (off.min(most) / self.sigma).powi(2)).exp() / (self.sigma * TAU.sqrt());
        before / (most * without)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Even odds where the density without the effect is `before` times that with it, none on the
    /// other side, and no more beyond the most that the effect does.
    #[test]
    fn analytic_odds_by_distance() {
        let usual = Usual { middle: -0.2, sigma: 0.5 };
        let (most, before) = (8.0, 1.0 / 30.0);
        let peak = 1.0 / (usual.sigma * TAU.sqrt());
        let even = usual.sigma * (2.0 * (peak * most / before).ln()).sqrt();
        assert!((usual.odds(even, most, before) - 1.0).abs() < 1e-9);
        assert_eq!(usual.odds(-0.1, most, before), 0.0);
        assert!(usual.odds(0.0, most, before) < 0.01);
        assert_eq!(usual.odds(most, most, before), usual.odds(2.0 * most, most, before));
        assert!(usual.odds(most, most, before) > 1e9);
    }
}
