//! The linear train's accelerations, row by row.

use crate::linear::LinearTrain;

/// `−M⁻¹K` and `−M⁻¹C`, row by row, zeros left out.
#[derive(Clone, Debug)]
pub(super) struct SparseRows {
    starts: Vec<usize>,
    columns: Vec<usize>,
    stiffness: Vec<f64>,
    damping: Vec<f64>,
}

impl SparseRows {
    pub(super) fn new(linear: &LinearTrain) -> Self {
        let n = linear.names.len();
        let mut out = Self { starts: vec![0], columns: Vec::new(), stiffness: Vec::new(), damping: Vec::new() };
        for i in 0..n {
            for j in 0..n {
                let (k, c) = (linear.stiffness[(i, j)], linear.damping[(i, j)]);
                if k != 0.0 || c != 0.0 {
                    out.columns.push(j);
                    out.stiffness.push(-k / linear.mass[(i, i)]);
                    out.damping.push(-c / linear.mass[(i, i)]);
                }
            }
            out.starts.push(out.columns.len());
        }
        out
    }

    #[inline]
    pub(super) fn apply(&self, positions: &[f64], velocities: &[f64], out: &mut [f64]) {
        for (i, value) in out.iter_mut().enumerate() {
            let mut sum = 0.0;
            for k in self.starts[i]..self.starts[i + 1] {
                let j = self.columns[k];
                sum += self.stiffness[k] * positions[j] + self.damping[k] * velocities[j];
            }
            *value = sum;
        }
    }
}
