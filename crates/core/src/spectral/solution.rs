//! What turns the sums over a band into the amplitudes of its lines.
//!
//! Lines mix in the sums `y_i = a(o_i)` by the transform `G` of the window, `y = G a`; solving that
//! system is the weighted least-squares fit of all of them. With the noise correlated by the
//! transform `C` of the squared window, the covariance of the solution is `G⁻¹ C G⁻¹` times the
//! variance of a line that stands alone.
//!
//! `G` and `C` depend on nothing but the revolutions that the window spans. The line windows are
//! therefore stretched over shaft angle, not over time, and span a value from a fixed grid of
//! revolutions just below what the samples hold: `G⁻¹` is worked out once for a step of the grid
//! and serves all windows of like speed, in ramps too. A [`Cell`] is a pure function of its number,
//! so that what a worker saw before does not show in any result.

use crate::spectral::kernels::ROW;
use crate::spectral::lines::{Band, LinePlan, MAX_GROUP};
use crate::spectral::small::{cholesky, solve};
use crate::spectral::windows::{LineWindow, Shape, Windows};

/// Ratio of neighbouring spans: the edge that is given away costs 0.2 % of the signal on average.
const GRID: f64 = 1.004;

/// Cells that are kept: speeds within 6 % of one another.
const CELLS: usize = 16;

/// Below this pivot, by the largest, lines cannot be told apart in floating point, let alone in
/// noise.
const LEAST_PIVOT: f64 = 1e-9;

/// Distance from known lines (bins) at which bins are taken for the floor where those beyond the
/// guard's main lobe are too few.
const CLOSER: f64 = 1.5;

/// One band at one span.
#[derive(Clone, Debug, Default)]
pub struct BandSolution {
    /// Rows of `G⁻¹` for the lines that are reported, each filled up with zeros to a multiple of
    /// `ROW`.
    pub rows: Vec<f64>,
    /// Variance of each, by that of a line that stands alone.
    pub variance: Vec<f64>,
    /// The carrier's row for the guard window, over the lines beside the carrier.
    pub guard_row: Vec<f64>,
    /// Its variance.
    pub guard_variance: f64,
    /// How near known lines are, by order bin from the lowest: 0 none within the guard's main lobe,
    /// 1 not nearer than 1.5 bins, 2 nearer.
    pub crowding: Vec<u8>,
}

/// Length of a row with what fills it up.
fn stride(band: &Band) -> usize {
    band.unknowns.len().next_multiple_of(ROW)
}

/// All bands at one span.
#[derive(Clone, Debug)]
pub struct Cell {
    number: Option<i64>,
    /// Revolutions of the input shaft that the line windows span.
    pub span: f64,
    /// By band.
    pub bands: Vec<BandSolution>,
}

/// The cells that a worker has used, one for each remainder of their numbers.
pub struct Solutions {
    cells: Vec<Cell>,
    half_band: usize,
    coupling: Box<Coupling>,
}

/// How the sums of a coupled group mix, and how their noise is correlated.
#[derive(Clone, Debug, Default)]
struct Coupling {
    g: [[f64; MAX_GROUP]; MAX_GROUP],
    c: [[f64; MAX_GROUP]; MAX_GROUP],
}

impl Solutions {
    /// Room for the cells; bands reach `half_band` bins to either side at most.
    pub fn new(lines: &LinePlan, half_band: usize) -> Self {
        let band = |band: &Band| BandSolution {
            rows: vec![0.0; band.own * stride(band)],
            variance: vec![f64::NAN; band.own],
            guard_row: vec![0.0; band.beside_carrier.len()],
            guard_variance: f64::NAN,
            crowding: vec![0; 2 * half_band],
        };
        let cell = Cell { number: None, span: f64::NAN, bands: lines.bands.iter().map(band).collect() };
        Self { cells: vec![cell; CELLS], half_band, coupling: Box::default() }
    }

    /// The cell for a window of so many revolutions.
    pub fn at(&mut self, lines: &LinePlan, windows: &Windows, revolutions: f64) -> &Cell {
        let number = (revolutions.ln() / GRID.ln()).floor() as i64;
        let Self { cells, half_band, coupling } = self;
        let cell = &mut cells[number.rem_euclid(CELLS as i64) as usize];
        if cell.number != Some(number) {
            cell.number = Some(number);
            cell.span = (number as f64 * GRID.ln()).exp();
            for (band, solution) in lines.bands.iter().zip(&mut cell.bands) {
                solution.work_out(band, windows, cell.span, coupling);
                solution.crowd(band, windows.guard_half_width(), cell.span, *half_band);
            }
        }
        cell
    }
}

impl BandSolution {
    fn work_out(&mut self, band: &Band, windows: &Windows, span: f64, coupling: &mut Coupling) {
        let count = band.unknowns.len();
        let offset = |i: usize| band.unknowns[i].offset * span;
        coupling.fill(&windows.efficient, count, &offset);
        self.rows.fill(0.0);
        self.variance.fill(f64::NAN);
        if let Some(lower) = cholesky(&coupling.g, count, LEAST_PIVOT) {
            for (i, row) in self.rows.chunks_exact_mut(stride(band)).enumerate() {
                row[i] = 1.0;
                solve(&lower, &mut row[..count]);
                self.variance[i] = coupling.variance(&row[..count]);
            }
        }
        coupling.fill(&windows.guard, band.beside_carrier.len(), &|i| offset(band.beside_carrier[i]));
        self.guard_row.fill(0.0);
        self.guard_row[0] = 1.0;
        self.guard_variance = match cholesky(&coupling.g, self.guard_row.len(), LEAST_PIVOT) {
            None => f64::NAN,
            Some(lower) => {
                solve(&lower, &mut self.guard_row);
                coupling.variance(&self.guard_row)
            }
        };
    }

    /// Marks the bins near known lines, wherever these lie at the speeds of the cell.
    fn crowd(&mut self, band: &Band, half_width: f64, span: f64, half_band: usize) {
        self.crowding.fill(0);
        for (near, mark) in [(half_width, 1), (CLOSER, 2)] {
            for offset in &band.known_offsets {
                let (a, b) = (offset * span, offset * span * GRID);
                let from = (a.min(b) - near).ceil() as i64 + half_band as i64;
                let to = (a.max(b) + near).floor() as i64 + half_band as i64;
                let last = self.crowding.len() as i64 - 1;
                if from <= last && to >= 0 {
                    self.crowding[from.max(0) as usize..=to.min(last) as usize].fill(mark);
                }
            }
        }
    }
}

impl Coupling {
    fn fill<S: Shape>(&mut self, window: &LineWindow<S>, count: usize, offset: &dyn Fn(usize) -> f64) {
        for i in 0..count {
            for j in 0..=i {
                let apart = offset(i) - offset(j);
                let (g, c) = (window.mixing(apart), window.correlation(apart));
                (self.g[i][j], self.g[j][i]) = (g, g);
                (self.c[i][j], self.c[j][i]) = (c, c);
            }
        }
    }

    /// `row C row`.
    fn variance(&self, row: &[f64]) -> f64 {
        let times = |c: &[f64; MAX_GROUP]| row.iter().zip(c).map(|(b, c)| b * c).sum::<f64>();
        row.iter().zip(&self.c).map(|(a, c)| a * times(c)).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::{StageKinematics, Train};

    fn train() -> Train {
        Train {
            motor_order: 1.0,
            shafts: Vec::new(),
            stages: vec![StageKinematics::pair("", 29, 100, 1.0), StageKinematics::pair("", 36, 90, 0.29)],
            nominal_input_hz: 25.0,
        }
    }

    /// Whatever a worker has seen before, a speed has the same solution.
    #[test]
    fn conform_cells_do_not_remember() {
        let windows = Windows::new(4096, 10.0);
        let lines = LinePlan::new(&train(), windows.guard_half_width(), 25.0);
        let mut used = Solutions::new(&lines, 128);
        for i in 0..400 {
            used.at(&lines, &windows, 20.0 + 0.1 * f64::from(i));
        }
        let mut fresh = Solutions::new(&lines, 128);
        let (a, b) = (used.at(&lines, &windows, 25.013).clone(), fresh.at(&lines, &windows, 25.013));
        assert!(a.span <= 25.013 && a.span > 25.013 / GRID / 1.000_001);
        for (a, b) in a.bands.iter().zip(&b.bands) {
            assert_eq!((&a.rows, &a.variance, &a.guard_row), (&b.rows, &b.variance, &b.guard_row));
            assert_eq!(a.crowding, b.crowding);
        }
    }
}
