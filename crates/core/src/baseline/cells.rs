//! Cells: runs at one operating point put together, and what is normal there.

use std::collections::BTreeMap;

use super::{BaselineConfig, LineStatistics, Run, ScatterPrior};

/// An operating point that the baseline has seen.
#[derive(Clone, Debug, PartialEq)]
pub struct Cell {
    /// Mean input-shaft speed (Hz).
    pub input_speed_hz: f64,
    /// Mean torque at the brake (N m), none where unknown.
    pub brake_torque_nm: Option<f64>,
    /// Sessions (with their mounting) that have been there.
    pub sessions: u32,
    /// Runs that have been there.
    pub runs: u32,
}

/// What is normal for one line (or one floor) at one operating point. All variances are of natural logarithms.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reference {
    /// ln of the normal amplitude.
    pub ln: f64,
    /// Variance of that mean from the scatter of the windows.
    pub mean_variance: f64,
    /// Variance from one window to the next within a session, noise included.
    pub scatter_variance: f64,
    /// Degrees of freedom of the scatter.
    pub scatter_freedom: f64,
    /// What of the scatter is noise beside the line.
    pub noise_variance: f64,
    /// Variance between sessions; none where only one session is known.
    pub between_variance: Option<f64>,
    /// Sessions that it was learned from.
    pub sessions: u32,
    /// Variance from interpolating between cells, 0 in a cell.
    pub interpolation_variance: f64,
    /// Degrees of freedom of that; meaningless where the variance is 0.
    pub interpolation_freedom: f64,
}

/// The runs of a cell put together for one line, session by session.
pub(super) struct Gathered {
    /// ln mean and independent windows, by session and mounting.
    pub(super) sessions: Vec<(f64, f64)>,
    /// Pooled variance within sessions.
    pub(super) variance: f64,
    /// Its degrees of freedom.
    pub(super) freedom: f64,
    pub(super) noise_variance: f64,
}

impl Gathered {
    pub(super) fn of(runs: &[&Run], channel: &str, stage: usize, harmonic: usize, floor: bool) -> Option<Self> {
        // (ln mean, scatter, independent windows, noise) of each run, by session and mounting
        let mut by_session: BTreeMap<(&str, &str), Vec<[f64; 4]>> = BTreeMap::new();
        for run in runs {
            let line: Option<LineStatistics> =
                run.channels.get(channel).and_then(|c| c.stages.get(stage)).and_then(|s| s[harmonic]);
            let Some(line) = line else { continue };
            let numbers = if floor {
                let Some(floor) = line.floor else { continue };
                [floor.amplitude.ln(), floor.scatter, floor.effective, 0.0]
            } else {
                [line.amplitude.ln(), line.scatter, line.effective, line.noise]
            };
            by_session.entry((&run.session, &run.mounting)).or_default().push(numbers);
        }
        let mut out = Self { sessions: Vec::new(), variance: 0.0, freedom: 0.0, noise_variance: 0.0 };
        let mut windows = 0.0;
        for runs in by_session.values() {
            let n: f64 = runs.iter().map(|r| r[2]).sum();
            let mean = runs.iter().map(|r| r[2] * r[0]).sum::<f64>() / n;
            // Sum of squares within runs and between the runs of the session (analysis of variance).
            out.variance +=
                runs.iter().map(|r| (r[2] - 1.0) * r[1].powi(2) + r[2] * (r[0] - mean).powi(2)).sum::<f64>();
            out.noise_variance += runs.iter().map(|r| r[2] * r[3].powi(2)).sum::<f64>();
            out.freedom += n - 1.0;
            windows += n;
            out.sessions.push((mean, n));
        }
        if out.freedom <= 0.0 {
            return None;
        }
        out.variance /= out.freedom;
        out.noise_variance /= windows;
        Some(out)
    }

    pub(super) fn reference(&self, prior: ScatterPrior) -> Reference {
        let (scatter_variance, scatter_freedom) = prior.steady(self.variance, self.freedom);
        let count = self.sessions.len() as f64;
        let between_variance = (self.sessions.len() > 1).then(|| {
            // Method of moments: variance of the sessions' means less what the scatter within them explains.
            let mean = self.sessions.iter().map(|s| s.0).sum::<f64>() / count;
            let observed = self.sessions.iter().map(|s| (s.0 - mean).powi(2)).sum::<f64>() / (count - 1.0);
            let explained = self.sessions.iter().map(|s| scatter_variance / s.1).sum::<f64>() / count;
            (observed - explained).max(0.0)
        });
        // Sessions weigh by the inverse of their variance (R. DerSimonian, N. Laird, Control. Clin. Trials 7, 1986).
        let between = between_variance.unwrap_or(0.0);
        let equal = scatter_variance + between <= 0.0;
        let weight = |n: f64| if equal { n } else { 1.0 / (between + scatter_variance / n) };
        let sum: f64 = self.sessions.iter().map(|s| weight(s.1)).sum();
        Reference {
            ln: self.sessions.iter().map(|s| weight(s.1) * s.0).sum::<f64>() / sum,
            mean_variance: self.sessions.iter().map(|s| (weight(s.1) / sum).powi(2) * scatter_variance / s.1).sum(),
            scatter_variance,
            scatter_freedom,
            noise_variance: self.noise_variance.min(scatter_variance),
            between_variance,
            sessions: u32::try_from(self.sessions.len()).unwrap_or(u32::MAX),
            interpolation_variance: 0.0,
            interpolation_freedom: f64::INFINITY,
        }
    }
}

pub(super) type Cells<'a> = (Vec<Cell>, Vec<(Option<f64>, Vec<usize>)>, Vec<Vec<&'a Run>>);

/// Groups the runs: by torque, then by speed, each group as wide as the tolerance.
pub(super) fn cells<'a>(runs: &'a [Run], config: &BaselineConfig) -> Cells<'a> {
    let torque = |run: &Run| run.brake_torque_nm.unwrap_or(f64::NEG_INFINITY);
    let mut sorted: Vec<&Run> = runs.iter().collect();
    sorted.sort_by(|a, b| torque(a).total_cmp(&torque(b)));
    let (mut cells, mut lines, mut members) = (Vec::new(), Vec::new(), Vec::new());
    while let Some(&first) = sorted.first() {
        let belongs = |run: &&&Run| config.torque_matches(first.brake_torque_nm, run.brake_torque_nm);
        let end = sorted.iter().take_while(belongs).count().max(1);
        let mut group: Vec<&Run> = sorted.drain(..end).collect();
        group.sort_by(|a, b| a.input_speed_hz.total_cmp(&b.input_speed_hz));
        let mean_torque =
            first.brake_torque_nm.map(|_| group.iter().map(|run| torque(run)).sum::<f64>() / group.len() as f64);
        let mut line = Vec::new();
        while let Some(&slowest) = group.first() {
            let belongs = |run: &&&Run| config.speed_matches(slowest.input_speed_hz, run.input_speed_hz);
            let end = group.iter().take_while(belongs).count().max(1);
            let here: Vec<&Run> = group.drain(..end).collect();
            let mut origins: Vec<_> = here.iter().map(|run| (&run.session, &run.mounting)).collect();
            origins.sort_unstable();
            origins.dedup();
            line.push(cells.len());
            cells.push(Cell {
                input_speed_hz: here.iter().map(|run| run.input_speed_hz).sum::<f64>() / here.len() as f64,
                brake_torque_nm: mean_torque,
                sessions: u32::try_from(origins.len()).unwrap_or(u32::MAX),
                runs: u32::try_from(here.len()).unwrap_or(u32::MAX),
            });
            members.push(here);
        }
        lines.push((mean_torque, line));
    }
    (cells, lines, members)
}
