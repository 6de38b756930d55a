//! Slip of the motor behind its stated speed: a number of the bench, learned with the baseline.

use super::Baseline;

/// Runs whose torques lie this far apart (relative to the largest) say how slip grows with the
/// load.
const TWO_LOADS: f64 = 0.2;
/// Drive displays are read, and typed in, to 0.1 Hz in 30 or so (relative): uniform within it, one
/// part in a thousand.
const DISPLAY: f64 = 1e-3;
/// The rotor's resistance grows by 0.4 % a kelvin, and slip with it: 20 to 60 K between cold and
/// warm make a tenth and a quarter of it.
const WARM: f64 = 0.15;

/// Share by which the input shaft lags behind the stated motor speed, over the torque at the brake:
/// `s(T) = s₀ + s₁ T`.
///
/// Induction motors slip in proportion to their torque up to the nominal one (IEC 60034-1); a belt
/// creeps in the same way.
#[derive(Clone, Debug, PartialEq)]
pub struct Slip {
    /// Torque at the brake (N m), none where unstated, and slip of each run.
    pub runs: Vec<(Option<f64>, f64)>,
    /// At no load; the mean of all runs where loads are unstated or alike.
    pub at_no_load: f64,
    /// Growth (1/N m).
    pub per_nm: f64,
    /// Standard deviation of the runs about that.
    pub scatter: f64,
}

impl Slip {
    /// From torques (N m, none where unstated) and slips; `None` without any.
    pub fn of(runs: Vec<(Option<f64>, f64)>) -> Option<Self> {
        let count = runs.len() as f64;
        if runs.is_empty() {
            return None;
        }
        let mean = runs.iter().map(|run| run.1).sum::<f64>() / count;
        let known: Vec<(f64, f64)> = runs.iter().filter_map(|run| Some((run.0?, run.1))).collect();
        let (low, high) = known.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), r| (l.min(r.0), h.max(r.0)));
        let (mut at_no_load, mut per_nm, mut numbers) = (mean, 0.0, 1.0);
        if known.len() == runs.len() && high - low > TWO_LOADS * high.abs().max(low.abs()) {
            let middle = known.iter().map(|run| run.0).sum::<f64>() / count;
            let (xy, xx) = known
                .iter()
                .fold((0.0, 0.0), |(xy, xx), (t, s)| (xy + (t - middle) * (s - mean), xx + (t - middle).powi(2)));
            per_nm = xy / xx;
            at_no_load = mean - per_nm * middle;
            numbers = 2.0;
        }
        let left: f64 = runs.iter().map(|(t, s)| (s - at_no_load - per_nm * t.unwrap_or(0.0)).powi(2)).sum();
        let scatter = (left / (count - numbers).max(1.0)).sqrt();
        Some(Self { runs, at_no_load, per_nm, scatter })
    }

    /// What is expected at a torque (N m), and its standard deviation; the torque decides only
    /// where the law knows one.
    pub fn at(&self, brake_torque_nm: Option<f64>) -> (f64, f64) {
        let unstated = brake_torque_nm.is_none() && self.per_nm != 0.0;
        let torque = brake_torque_nm.unwrap_or(0.0);
        let value = if unstated {
            self.runs.iter().map(|run| run.1).sum::<f64>() / self.runs.len() as f64
        } else {
            self.at_no_load + self.per_nm * torque
        };
        // A load that nobody stated may be any of those that were learned.
        let spread = if unstated { self.per_nm.abs() * self.widest() / 12f64.sqrt() } else { 0.0 };
        (value, (DISPLAY.powi(2) + (WARM * value).powi(2) + self.scatter.powi(2) + spread.powi(2)).sqrt())
    }

    fn widest(&self) -> f64 {
        let known = self.runs.iter().filter_map(|run| run.0);
        let (low, high) = known.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), t| (l.min(t), h.max(t)));
        (high - low).max(0.0)
    }
}

impl Baseline {
    /// Slip behind the stated motor speeds of the runs; `None` where none was stated. `motor_order`
    /// is the speed of the motor over that of the input shaft.
    pub fn slip(&self, motor_order: f64) -> Option<Slip> {
        let of = |run: &super::Run| {
            let slip = 1.0 - run.input_speed_hz * motor_order / run.motor_speed_hz?;
            slip.is_finite().then_some((run.brake_torque_nm, slip))
        };
        Slip::of(self.runs.iter().filter_map(of).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Six loads of a motor that slips by 0.8 % at no load and 0.4 % more at 90 N m: the law is
    /// found, and a rate that is 0.9 % off stands out from it.
    #[test]
    fn analytic_slip_is_a_law_over_torque() {
        let law = |torque: f64| 0.008 + 0.004 * torque / 90.0;
        let loads = [0.0, 10.0, 30.0, 50.0, 70.0, 90.0];
        let slip = Slip::of(loads.iter().map(|t| (Some(*t), law(*t))).collect()).unwrap();
        assert!((slip.at_no_load - 0.008).abs() < 1e-12 && (slip.per_nm - 0.004 / 90.0).abs() < 1e-12, "{slip:?}");
        let (value, sigma) = slip.at(Some(60.0));
        assert!((value - law(60.0)).abs() < 1e-12 && sigma < 0.002, "{value} ± {sigma}");
        assert!((law(60.0) + 0.009 - value) / sigma > 4.0);
        // Unstated: somewhere among them.
        let (value, wider) = slip.at(None);
        assert!(wider > sigma && law(0.0) < value && value < law(90.0), "{value} ± {wider}");
        assert_eq!(Slip::of(Vec::new()), None);
        let one = Slip::of(vec![(None, 0.01)]).unwrap();
        assert_eq!((one.at(Some(5.0)).0, one.per_nm), (0.01, 0.0));
    }
}
