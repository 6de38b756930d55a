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

/// What is normal for one line (or one floor) at one operating point. All variances are of natural
/// logarithms.
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
    /// Variance between the runs of a session, beyond what the scatter within them explains; 0
    /// where no session has two runs.
    pub run_variance: f64,
    /// Degrees of freedom of that.
    pub run_freedom: f64,
    /// Runs that it was learned from.
    pub runs: u32,
    /// Variance from interpolating between cells, 0 in a cell.
    pub interpolation_variance: f64,
    /// Degrees of freedom of that; meaningless where the variance is 0.
    pub interpolation_freedom: f64,
}

/// The runs of a cell put together for one line, session by session.
pub(super) struct Gathered {
    /// By session and mounting.
    pub(super) sessions: Vec<Session>,
    /// Pooled variance within runs.
    pub(super) variance: f64,
    /// Its degrees of freedom.
    pub(super) freedom: f64,
    pub(super) noise_variance: f64,
    /// Mean square between the runs of a session: what the variance within runs would be if runs
    /// differed by chance alone.
    pub(super) run_mean_square: f64,
    /// Its degrees of freedom: runs less sessions.
    pub(super) run_freedom: f64,
    /// Independent windows of a run, as the mean square between runs counts them.
    windows_per_run: f64,
    runs: u32,
}

/// What the runs of a session say together.
pub(super) struct Session {
    ln: f64,
    /// Independent windows.
    windows: f64,
    runs: f64,
}

impl Gathered {
    pub(super) fn of(runs: &[&Run], channel: &str, stage: usize, harmonic: usize, floor: bool) -> Option<Self> {
        Self::by(runs, &|run| {
            let line: LineStatistics = run.channels.get(channel)?.stages.get(stage)?[harmonic]?;
            Some(if floor {
                let floor = line.floor?;
                [floor.amplitude.ln(), floor.scatter, floor.effective, 0.0]
            } else {
                [line.amplitude.ln(), line.scatter, line.effective, line.noise]
            })
        })
    }

    /// Of anything that a run tells by ln mean, scatter, independent windows and noise.
    pub(super) fn by(runs: &[&Run], of: &dyn Fn(&Run) -> Option<[f64; 4]>) -> Option<Self> {
        let mut by_session: BTreeMap<(&str, &str), Vec<[f64; 4]>> = BTreeMap::new();
        for run in runs {
            let Some(numbers) = of(run) else { continue };
            by_session.entry((&run.session, &run.mounting)).or_default().push(numbers);
        }
        let mut out = Self {
            sessions: Vec::new(),
            variance: 0.0,
            freedom: 0.0,
            noise_variance: 0.0,
            run_mean_square: 0.0,
            run_freedom: 0.0,
            windows_per_run: 0.0,
            runs: 0,
        };
        let mut windows = 0.0;
        for runs in by_session.values() {
            let n: f64 = runs.iter().map(|r| r[2]).sum();
            let count = runs.len() as f64;
            let ln = runs.iter().map(|r| r[2] * r[0]).sum::<f64>() / n;
            // Sums of squares within runs, and between the runs of the session (analysis of
            // variance).
            out.variance += runs.iter().map(|r| (r[2] - 1.0) * r[1].powi(2)).sum::<f64>();
            out.run_mean_square += runs.iter().map(|r| r[2] * (r[0] - ln).powi(2)).sum::<f64>();
            out.noise_variance += runs.iter().map(|r| r[2] * r[3].powi(2)).sum::<f64>();
            out.windows_per_run += n - runs.iter().map(|r| r[2] * r[2]).sum::<f64>() / n;
            out.freedom += n - count;
            out.run_freedom += count - 1.0;
            out.runs += u32::try_from(runs.len()).unwrap_or(u32::MAX);
            windows += n;
            out.sessions.push(Session { ln, windows: n, runs: count });
        }
        if out.freedom <= 0.0 {
            return None;
        }
        out.variance /= out.freedom;
        out.noise_variance /= windows;
        if out.run_freedom > 0.0 {
            out.run_mean_square /= out.run_freedom;
            out.windows_per_run /= out.run_freedom;
        }
        Some(out)
    }

    /// Variance between the runs of a session by the method of moments, and its degrees of freedom.
    ///
    /// # Source
    /// S. R. Searle, G. Casella, C. E. McCulloch, "Variance Components" (1992), section 3.6:
    /// unbalanced one-way classification, `σ² = (MSB − MSW) / n₀` with
    /// `n₀ = Σ (N − Σn²/N) / Σ (runs − 1)`.
    pub(super) fn between_runs(&self, scatter_variance: f64, prior: ScatterPrior) -> (f64, f64) {
        if self.run_freedom <= 0.0 {
            return (0.0, f64::INFINITY);
        }
        let (mean_square, freedom) = prior.steady(self.run_mean_square, self.run_freedom);
        (((mean_square - scatter_variance) / self.windows_per_run).max(0.0), freedom)
    }

    pub(super) fn reference(&self, prior: ScatterPrior, run_prior: ScatterPrior) -> Reference {
        let (scatter_variance, scatter_freedom) = prior.steady(self.variance, self.freedom);
        let (run_variance, run_freedom) = self.between_runs(scatter_variance, run_prior);
        let count = self.sessions.len() as f64;
        let between_variance = (self.sessions.len() > 1).then(|| {
            // Method of moments: variance of the sessions' means less what the scatter within them
            // explains.
            let mean = self.sessions.iter().map(|s| s.ln).sum::<f64>() / count;
            let observed = self.sessions.iter().map(|s| (s.ln - mean).powi(2)).sum::<f64>() / (count - 1.0);
            let by_chance = |s: &Session| scatter_variance / s.windows + run_variance / s.runs;
            let explained = self.sessions.iter().map(by_chance).sum::<f64>() / count;
            (observed - explained).max(0.0)
        });
        // Sessions weigh by the inverse of their variance (R. DerSimonian, N. Laird, Control. Clin.
        // Trials 7, 1986).
        let between = between_variance.unwrap_or(0.0);
        let equal = scatter_variance + between <= 0.0;
        let weight = |n: f64| if equal { n } else { 1.0 / (between + scatter_variance / n) };
        let sum: f64 = self.sessions.iter().map(|s| weight(s.windows)).sum();
        let share = |s: &Session| weight(s.windows) / sum;
        Reference {
            ln: self.sessions.iter().map(|s| share(s) * s.ln).sum::<f64>(),
            mean_variance: self.sessions.iter().map(|s| share(s).powi(2) * scatter_variance / s.windows).sum(),
            scatter_variance,
            scatter_freedom,
            noise_variance: self.noise_variance.min(scatter_variance),
            between_variance,
            sessions: u32::try_from(self.sessions.len()).unwrap_or(u32::MAX),
            run_variance,
            run_freedom,
            runs: self.runs,
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
