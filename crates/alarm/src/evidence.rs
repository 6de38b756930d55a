//! What an alarm rests on: the line that lies furthest beyond its limit, and the operating point at
//! which it was seen.

use gearwatch_core::rank::RankConfig;
use gearwatch_core::verdict::{HarmonicVerdict, MachineState, Verdict};
use serde::{Deserialize, Serialize};

/// The harmonic of a window that speaks most clearly for an alarm. What is not known is left out,
/// never 0.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Evidence {
    /// Number of the mesh harmonic (1–5).
    pub harmonic: u8,
    /// Peak amplitude in `unit`.
    pub amplitude: f64,
    /// Unit of amplitude and baseline.
    pub unit: String,
    /// Normal amplitude at this operating point, in `unit`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub baseline: Option<f64>,
    /// Signed deviation from the baseline (percent).
    pub deviation_percent: f64,
    /// One sigma of it (percentage points).
    pub deviation_sigma_percent: f64,
    /// |deviation| that the machine's state asks for (percent); none where the state has no limit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub limit_percent: Option<f64>,
    /// Rank of the deviation.
    pub rank: String,
    /// Number of the window.
    pub window: u64,
    /// Speed of the input shaft (Hz).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub input_speed_hz: Option<f64>,
    /// Mesh frequency of the stage (Hz).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mesh_hz: Option<f64>,
    /// Torque at the brake (N m).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub brake_torque_nm: Option<f64>,
}

impl Evidence {
    /// Of a window: the harmonic whose |deviation| lies the most sigmas beyond the limit. None
    /// where no deviation is known.
    pub fn of(verdict: &Verdict, ranks: &RankConfig) -> Option<Self> {
        let limit_percent = match verdict.machine {
            MachineState::Deviating => Some(ranks.steps_percent[0]),
            MachineState::Alarm => Some(ranks.steps_percent[3]),
            MachineState::Normal | MachineState::Unknown | MachineState::PathChanged => None,
        };
        let beyond = |h: &HarmonicVerdict| {
            let deviation = h.deviation_percent;
            // Infinite where sigma is 0 and the deviation is not: nothing speaks more clearly.
            (deviation.value.abs() - limit_percent.unwrap_or(0.0)) / deviation.sigma
        };
        let known =
            verdict.harmonics.iter().enumerate().filter(|(_, h)| {
                h.deviation_percent.is_known() && h.amplitude.value.is_finite() && !beyond(h).is_nan()
            });
        let (k, h) = known.max_by(|a, b| beyond(a.1).total_cmp(&beyond(b.1)))?;
        let finite = |x: f64| Some(x).filter(|x| x.is_finite());
        Some(Self {
            harmonic: k as u8 + 1,
            amplitude: h.amplitude.value,
            unit: verdict.unit.clone(),
            baseline: finite(h.baseline),
            deviation_percent: h.deviation_percent.value,
            deviation_sigma_percent: h.deviation_percent.sigma,
            limit_percent,
            rank: h.rank.code().to_owned(),
            window: verdict.window,
            input_speed_hz: finite(verdict.input_speed_hz.value),
            mesh_hz: finite(verdict.mesh_hz),
            brake_torque_nm: finite(verdict.brake_torque_nm),
        })
    }

    /// In a few words, such as `1x -14.2 % ± 0.8 % (limit 10 %), 25.0 Hz, 40 N m`.
    pub fn words(&self) -> String {
        let mut out = format!(
            "{}x {:+.1} % ± {:.1} %, rank {}",
            self.harmonic, self.deviation_percent, self.deviation_sigma_percent, self.rank
        );
        if let Some(limit) = self.limit_percent {
            out.push_str(&format!(" (limit {limit} %)"));
        }
        if let Some(speed) = self.input_speed_hz {
            out.push_str(&format!(", input shaft {speed:.2} Hz"));
        }
        if let Some(torque) = self.brake_torque_nm {
            out.push_str(&format!(", {torque:.1} N m"));
        }
        out
    }
}
