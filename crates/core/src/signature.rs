//! Fault states by the pattern of deviations that they show.

use std::sync::Arc;

use statrs::distribution::{ChiSquared, ContinuousCDF};

use crate::estimate::Estimate;
use crate::rank::RankConfig;
use crate::verdict::{HARMONICS, NEAREST_STATES, NearState, Rank, StateFit, Verdict};

/// What a state does to one harmonic.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Expected {
    /// |deviation| lies in this rank; the sign is not known (the paper's tables).
    Rank(Rank),
    /// Signed deviation in percent, with the sigma of the model that says so (the simulator).
    Signed(Estimate),
}

/// A state of the machine and its pattern.
#[derive(Clone, Debug, PartialEq)]
pub struct Signature {
    /// Name of the state.
    pub name: Arc<str>,
    /// 1x to 5x.
    pub harmonics: [Expected; HARMONICS],
    /// Who says so.
    pub source: Arc<str>,
}

/// States that a verdict is compared with.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SignatureTable {
    /// All equally probable beforehand.
    pub signatures: Vec<Signature>,
}

/// States at one stage, channel and operating point of a bench.
#[derive(Clone, Debug, PartialEq)]
pub struct SignaturesAt {
    /// Name of the stage.
    pub stage: String,
    /// Name of the channel.
    pub channel: String,
    /// Speed of the first shaft (Hz).
    pub input_speed_hz: f64,
    /// Torque at the brake (N m).
    pub brake_torque_nm: f64,
    /// The states.
    pub table: SignatureTable,
}

/// The states that a pipeline compares with: one table for everything, or tables of this bench by
/// stage, channel and operating point.
#[derive(Clone, Debug, PartialEq)]
pub enum Signatures {
    /// The same states whatever the stage, channel and operating point.
    Everywhere(SignatureTable),
    /// Those of the bench; where none is near nothing is compared.
    OfBench(Vec<SignaturesAt>),
}

/// Largest relative distance in speed at which a bench's states hold: a mode with 2 % of damping is
/// 4 % wide.
const SPEED_REACH: f64 = 0.02;
/// Largest relative distance in torque.
const TORQUE_REACH: f64 = 0.1;

impl Signatures {
    /// The table that a verdict was compared with.
    pub fn of(&self, verdict: &Verdict) -> Option<&SignatureTable> {
        self.at(&verdict.stage, &verdict.channel, verdict.input_speed_hz.value, verdict.brake_torque_nm)
    }

    /// The table for a stage and channel at an operating point; an unknown torque (`NaN`) fits any.
    pub fn at(&self, stage: &str, channel: &str, input_speed_hz: f64, brake_torque_nm: f64) -> Option<&SignatureTable> {
        let tables = match self {
            Self::Everywhere(table) => return Some(table),
            Self::OfBench(tables) => tables,
        };
        let distance = |at: &SignaturesAt| {
            let speed = (input_speed_hz / at.input_speed_hz - 1.0).abs() / SPEED_REACH;
            let torque = (brake_torque_nm / at.brake_torque_nm - 1.0).abs() / TORQUE_REACH;
            speed.max(if torque.is_nan() { 0.0 } else { torque })
        };
        let here = tables.iter().filter(|at| at.stage == stage && at.channel == channel);
        let near = here.map(|at| (distance(at), at)).filter(|(distance, _)| *distance <= 1.0);
        near.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, at)| &at.table)
    }
}

/// Share of the probability that the states named together must hold.
const CREDIBLE: f64 = 0.95;

/// Chi-square probability below which a state does not agree with the deviations.
const LEAST_GOODNESS: f64 = 0.01;

/// Table 4 of the paper. One tooth count, one load, one speed: on another bench it names what the
/// pattern resembles.
const PAPER_TABLE_4: [(&str, [Rank; HARMONICS]); 14] = {
    use Rank::{I, II, III, IV, V, Zero};
    [
        ("normal", [Zero, Zero, Zero, Zero, Zero]),
        ("broken_1_5", [Zero, I, Zero, I, II]),
        ("broken_2_5", [Zero, I, Zero, I, I]),
        ("broken_3_5", [Zero, I, Zero, II, II]),
        ("broken_4_5", [Zero, I, I, III, I]),
        ("broken_total", [Zero, I, I, II, I]),
        ("pitting_1", [II, II, II, II, IV]),
        ("pitting_2", [I, IV, I, V, II]),
        ("pitting_3", [I, V, Zero, V, I]),
        ("pitting_4", [I, V, Zero, V, II]),
        ("compound_1", [I, I, Zero, Zero, I]),
        ("compound_2", [II, II, III, V, II]),
        ("compound_3", [II, V, II, IV, Zero]),
        ("compound_4", [II, Zero, III, IV, V]),
    ]
};

impl SignatureTable {
    /// The paper's 14 states.
    pub fn paper() -> Self {
        let source: Arc<str> =
            "The Absolute Deviation Rank Diagnostic Approach to Gear Tooth Composite Fault, table 4".into();
        let signature = |(name, ranks): &(&str, [Rank; HARMONICS])| Signature {
            name: (*name).into(),
            harmonics: ranks.map(Expected::Rank),
            source: source.clone(),
        };
        Self { signatures: PAPER_TABLE_4.iter().map(signature).collect() }
    }

    /// Compares the deviations (percent; unknown ones are left out) with all states, and hands the
    /// nearest to `nearest`.
    ///
    /// Each state's likelihood is a product over the harmonics: the normal density of the signed
    /// deviation about a signed expectation, or, for a rank, the probability of the rank's two
    /// signed intervals divided by their width. Rank V has no upper end and takes the width of rank
    /// IV. Goodness of fit is Pearson's chi-square of the distances to the expectations, 0 inside a
    /// rank's interval, so that for ranks the probability given is an upper limit.
    pub fn compare(
        &self,
        ranks: &RankConfig,
        deviations_percent: &[Estimate; HARMONICS],
        nearest: &mut Vec<NearState>,
    ) -> StateFit {
        nearest.clear();
        let judged = deviations_percent.iter().filter(|d| d.is_known() && d.sigma > 0.0).count();
        let Ok(chi_square) = ChiSquared::new(judged as f64) else { return StateFit::NotCompared };
        let fit_of = |signature: &Signature| {
            let (mut ln_likelihood, mut distance_squared) = (0.0, 0.0);
            for (expected, &d) in signature.harmonics.iter().zip(deviations_percent) {
                if d.is_known() && d.sigma > 0.0 {
                    let (ln, z) = expected.fit(ranks, d);
                    ln_likelihood += ln;
                    distance_squared += z * z;
                }
            }
            (ln_likelihood, chi_square.sf(distance_squared))
        };
        let best = self.signatures.iter().map(|s| fit_of(s).0).fold(f64::NEG_INFINITY, f64::max);
        if !best.is_finite() {
            return StateFit::NotCompared;
        }
        let sum: f64 = self.signatures.iter().map(|s| (fit_of(s).0 - best).exp()).sum();
        let mut some_agrees = false;
        for signature in &self.signatures {
            let (ln_likelihood, goodness) = fit_of(signature);
            some_agrees |= goodness >= LEAST_GOODNESS;
            let probability = (ln_likelihood - best).exp() / sum;
            // Kept sorted; the table's order decides between equals.
            let at = nearest.iter().take_while(|n| n.probability >= probability).count();
            if at < NEAREST_STATES {
                nearest.truncate(NEAREST_STATES - 1);
                nearest.insert(at, NearState { name: signature.name.clone(), probability, goodness });
            }
        }
        match nearest.first() {
            _ if !some_agrees => StateFit::None,
            Some(first) if first.probability >= CREDIBLE && first.goodness >= LEAST_GOODNESS => StateFit::One,
            _ => StateFit::Several,
        }
    }
}

impl Expected {
    /// ln likelihood (of a density in 1/percent), and distance in sigmas.
    fn fit(&self, ranks: &RankConfig, deviation_percent: Estimate) -> (f64, f64) {
        match *self {
            Self::Signed(expected) => {
                let sigma = deviation_percent.sigma.hypot(expected.sigma);
                let z = (deviation_percent.value - expected.value) / sigma;
                (-0.5 * z * z - (sigma * std::f64::consts::TAU.sqrt()).ln(), z)
            }
            Self::Rank(rank) => {
                let Some((low, high)) = ranks.interval_percent(rank) else { return (f64::NEG_INFINITY, f64::INFINITY) };
                let [.., iv, v] = ranks.steps_percent;
                let width = if high.is_finite() { high - low } else { v - iv };
                let size = deviation_percent.value.abs();
                let z = (low - size).max(size - high).max(0.0) / deviation_percent.sigma;
                // Far outside the integral underflows; the density at the nearest end stands in for
                // it there.
                let far = -0.5 * z * z - (deviation_percent.sigma * std::f64::consts::TAU.sqrt()).ln();
                let inside = (ranks.probability_of(rank, deviation_percent) / (2.0 * width)).ln();
                (if z > 30.0 { far } else { inside }, z)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(values: [f64; HARMONICS], sigma: f64) -> [Estimate; HARMONICS] {
        values.map(|value| Estimate::new(value, sigma))
    }

    fn compare(deviations: &[Estimate; HARMONICS]) -> (StateFit, Vec<NearState>) {
        let mut nearest = Vec::new();
        let fit = SignatureTable::paper().compare(&RankConfig::default(), deviations, &mut nearest);
        (fit, nearest)
    }

    /// Signed deviations of the paper's table 2 from its normal state, known to 0.1 %: each state
    /// is found again, whatever sign its harmonics have.
    #[test]
    fn literature_each_state_of_table_2_is_its_own_nearest() {
        let table_2 = [
            ("normal", [0.0, 0.0, 0.0, 0.0, 0.0]),
            ("broken_1_5", [-0.515, 2.713, 0.732, 3.091, -4.418]),
            ("broken_3_5", [-0.686, 1.667, 0.635, 4.845, -4.217]),
            ("pitting_1", [-5.405, -4.762, -4.810, -6.349, -11.761]),
            ("pitting_3", [-3.346, 13.622, -0.146, -15.706, 2.278]),
            ("compound_4", [-5.534, -0.791, -8.057, -12.281, -13.509]),
        ];
        for (name, values) in table_2 {
            let (fit, nearest) = compare(&at(values, 0.1));
            assert_eq!((fit, &*nearest[0].name), (StateFit::One, name), "{nearest:?}");
        }
    }

    #[test]
    fn analytic_unresolved_deviations_fit_several_and_wild_ones_none() {
        let (fit, nearest) = compare(&at([1.0, -2.0, 3.0, 0.0, 2.0], 10.0));
        assert_eq!(fit, StateFit::Several, "{nearest:?}");
        assert_eq!(nearest.len(), NEAREST_STATES);
        assert!(nearest.windows(2).all(|pair| pair[0].probability >= pair[1].probability));
        // 1x at +60 % is beyond every state of the table (1x is at most rank II).
        let (fit, nearest) = compare(&at([60.0, 0.0, 0.0, 0.0, 0.0], 0.5));
        assert_eq!(fit, StateFit::None, "{nearest:?}");
        assert!(nearest[0].probability.is_finite() && nearest[0].goodness < 1e-9);
        assert_eq!(compare(&[Estimate::UNKNOWN; HARMONICS]), (StateFit::NotCompared, vec![]));
    }

    /// The nearest operating point serves, within 2 % of speed and 10 % of torque; other stages and
    /// channels have none.
    #[test]
    fn conform_signatures_of_a_bench_hold_where_they_were_made() {
        let at = |speed, torque| SignaturesAt {
            stage: "s".into(),
            channel: "a".into(),
            input_speed_hz: speed,
            brake_torque_nm: torque,
            table: SignatureTable { signatures: SignatureTable::paper().signatures[..torque as usize].to_vec() },
        };
        let of_bench = Signatures::OfBench(vec![at(10.0, 5.0), at(10.0, 5.4), at(20.0, 9.0)]);
        let found = |stage, channel, speed, torque: f64| {
            of_bench.at(stage, channel, speed, torque).map(|table| table.signatures.len())
        };
        assert_eq!(found("s", "a", 10.1, 5.0), Some(5));
        assert_eq!(found("s", "a", 19.9, f64::NAN), Some(9));
        assert_eq!(found("s", "a", 20.5, 9.0), None);
        assert_eq!(found("s", "a", 10.0, 6.5), None);
        assert_eq!(found("t", "a", 10.0, 5.0), None);
        assert_eq!(found("s", "b", 10.0, 5.0), None);
        assert!(Signatures::Everywhere(SignatureTable::paper()).at("t", "b", f64::NAN, f64::NAN).is_some());
    }

    /// Two signed signatures d' sigmas apart, measured midway: equally likely. Measured on the
    /// first: the ratio is exp(d'²/2).
    #[test]
    fn analytic_likelihood_of_signed_signatures() {
        let signature = |name: &str, first: f64| Signature {
            name: name.into(),
            harmonics: [first, 0.0, 0.0, 0.0, 0.0].map(|v| Expected::Signed(Estimate::new(v, 3.0))),
            source: "test".into(),
        };
        let table = SignatureTable { signatures: vec![signature("up", 10.0), signature("down", -10.0)] };
        let mut nearest = Vec::new();
        let ranks = RankConfig::default();
        let fit = table.compare(&ranks, &at([0.0; HARMONICS], 4.0), &mut nearest);
        assert_eq!(fit, StateFit::Several);
        assert!((nearest[0].probability - 0.5).abs() < 1e-12);
        table.compare(&ranks, &at([2.0, 0.0, 0.0, 0.0, 0.0], 4.0), &mut nearest);
        // sigma = hypot(3, 4) = 5; (12² − 8²) / (2·25) = 1.6
        assert!((nearest[0].probability / nearest[1].probability - 1.6_f64.exp()).abs() < 1e-9);
        assert_eq!(&*nearest[0].name, "up");
    }
}
