//! Small positive-definite systems on the stack.

/// Cholesky factor of the leading `n` rows; `None` where a pivot falls below `least` of the largest
/// diagonal entry.
pub fn cholesky<const K: usize>(a: &[[f64; K]; K], n: usize, least: f64) -> Option<[[f64; K]; K]> {
    let mut lower = [[0.0; K]; K];
    let largest = (0..n).map(|i| a[i][i]).fold(0.0, f64::max);
    for i in 0..n {
        for j in 0..=i {
            let dot: f64 = (0..j).map(|k| lower[i][k] * lower[j][k]).sum();
            let rest = a[i][j] - dot;
            if i != j {
                lower[i][j] = rest / lower[j][j];
            } else if rest > least * largest {
                lower[i][i] = rest.sqrt();
            } else {
                return None;
            }
        }
    }
    Some(lower)
}

/// Solves `L Lᵀ x = b` in place for the leading `x.len()` rows.
pub fn solve<const K: usize>(lower: &[[f64; K]; K], x: &mut [f64]) {
    let n = x.len();
    for i in 0..n {
        let dot: f64 = (0..i).map(|k| lower[i][k] * x[k]).sum();
        x[i] = (x[i] - dot) / lower[i][i];
    }
    for i in (0..n).rev() {
        let dot: f64 = (i + 1..n).map(|k| lower[k][i] * x[k]).sum();
        x[i] = (x[i] - dot) / lower[i][i];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The Hilbert matrix of order 4 has an integer inverse; its first column solves for the first
    /// unit vector.
    #[test]
    fn literature_hilbert_matrix() {
        let mut a = [[0.0; 6]; 6];
        for (i, row) in a.iter_mut().enumerate() {
            for (j, v) in row.iter_mut().enumerate() {
                *v = 1.0 / (i + j + 1) as f64;
            }
        }
        let lower = cholesky(&a, 4, 1e-12).unwrap();
        let mut x = [1.0, 0.0, 0.0, 0.0];
        solve(&lower, &mut x);
        for (x, exact) in x.iter().zip([16.0, -120.0, 240.0, -140.0]) {
            assert!((x - exact).abs() < 1e-9, "{x} {exact}");
        }
    }

    #[test]
    fn analytic_singular_is_refused() {
        assert!(cholesky(&[[1.0, 1.0], [1.0, 1.0]], 2, 1e-9).is_none());
    }
}
