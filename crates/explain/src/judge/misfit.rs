//! What a prediction leaves of the lines that judge it.

use crate::change::compare::{Comparison, LineChange};
use crate::change::locate::{self, Cell};
use crate::finding::is_path;
use crate::fit::refit;
use crate::judge::own_lines;
use crate::judge::predict::{Named, Prediction};
use crate::question::Question;
use crate::read::lines::Family;

/// Largest misfit of one line (variances): no single one decides.
const CAP: f64 = 100.0;
/// dB of a factor of e.
const DB: f64 = 8.685_889_638;

/// Whether a model is of what all teeth of a mesh do alike. It has the mesh harmonics; sidebands
/// come of errors of single teeth, which no sheet has, and it says nothing of them.
pub fn of_all_teeth(named: &Named) -> bool {
    refit::has_form(&named.spec.effect) && !is_path(&named.spec.effect, &named.spec.place)
}

/// The lines that judge.
pub struct Judged {
    /// With the lines that only the effects in question have.
    pub comparison: Comparison,
    /// By line, whether it counts.
    pub counts: Vec<bool>,
    /// Which they are.
    pub words: &'static str,
}

impl Judged {
    /// Of what all tooth models and paths say, where some pairs are held out.
    pub fn of(q: &Question<'_>, held: &[usize], named: &[Named]) -> Self {
        if named.iter().all(of_all_teeth) {
            let comparison = q.comparison.clone();
            let on_mesh =
                |l: &LineChange| matches!(l.family, Family::Mesh { harmonic, .. } if harmonic <= refit::HARMONICS);
            return Self {
                counts: comparison.lines.iter().map(on_mesh).collect(),
                comparison,
                words: "mesh harmonics",
            };
        }
        let orders = own_lines::orders(q.bench, named);
        let comparison = own_lines::with_own_lines(q, &orders);
        if named.iter().any(|n| is_path(&n.spec.effect, &n.spec.place)) {
            return Self { counts: vec![true; comparison.lines.len()], comparison, words: "all lines" };
        }
        let counts = own_lines::that_count(&comparison, held, &orders);
        Self { comparison, counts, words: "lines that the effects in question move, and those that moved" }
    }
}

/// What a prediction leaves.
pub struct Residuals {
    /// Lines of those left out.
    pub lines: usize,
    /// Root mean square over the standard deviation, of the fitted points. What a model leaves open
    /// makes the deviation wider, and the logarithm of the wider variance over the own counts with
    /// the square (the logarithmic score, Gneiting & Raftery 2007): a model gains by saying which
    /// lines it cannot predict, and pays for it.
    pub fitted: f64,
    /// Of those left out.
    pub held: f64,
    /// Of those left out in dB, by channel.
    pub channels_db: Vec<f64>,
}

impl Residuals {
    /// Of a prediction of all lines of a comparison.
    pub fn of(comparison: &Comparison, predicted: &[Prediction], held: &[usize]) -> Self {
        Self::of_some(comparison, predicted, held, &|_, _| true)
    }

    /// The same of mesh harmonics alone, which the model has whatever the errors of single teeth.
    pub fn of_mesh(comparison: &Comparison, predicted: &[Prediction], held: &[usize]) -> Self {
        Self::of_some(comparison, predicted, held, &|_, c| matches!(c.family, Some(Family::Mesh { .. })))
    }

    /// Of the lines (their position, and the line) that are wanted.
    pub fn of_some(
        comparison: &Comparison,
        predicted: &[Prediction],
        held: &[usize],
        wanted: &dyn Fn(usize, &Cell) -> bool,
    ) -> Self {
        let lines = locate::cells(comparison).into_iter().filter(|c| c.family.is_some()).zip(predicted);
        let wanted = lines.enumerate().filter(|(i, (c, _))| wanted(*i, c)).map(|(_, line)| line);
        let cells: Vec<(Cell, &Prediction)> = wanted.collect();
        let rms = |of: &dyn Fn(&Cell) -> bool, size: &dyn Fn(&Cell, &Prediction) -> f64| {
            let all = cells.iter().filter(|(c, _)| of(c));
            let (sum, n) = all.fold((0.0, 0usize), |(s, n), (c, p)| (s + size(c, p), n + 1));
            (sum / n.max(1) as f64).sqrt()
        };
        let left = |c: &Cell| held.contains(&c.pair);
        let square = |c: &Cell, p: &Prediction| (c.change - p.change).powi(2);
        let scaled = |c: &Cell, p: &Prediction| {
            (square(c, p) / (c.variance + p.variance)).min(CAP) + (p.variance / c.variance).ln_1p()
        };
        let in_db = |c: &Cell, p: &Prediction| DB * DB * square(c, p);
        Self {
            lines: cells.iter().filter(|(c, _)| left(c)).count(),
            fitted: rms(&|c| !left(c), &scaled),
            held: rms(&left, &scaled),
            channels_db: (0..comparison.channels.len()).map(|k| rms(&|c| left(c) && c.channel == k, &in_db)).collect(),
        }
    }
}
