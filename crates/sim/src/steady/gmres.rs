//! GMRES: the solution of `A x = b` where only products with A are known (Saad & Schultz 1986),
//! without restart.

/// Largest number of iterations; each keeps one vector.
const MOST_ITERATIONS: usize = 60;

/// Solves `A x = b` from x = 0 until the residual is below `tolerance` times that of x = 0. Returns
/// x and the iterations taken, or `None` where that many do not suffice.
///
/// `apply(v, out)` puts A v into `out`.
pub(super) fn solve(b: &[f64], tolerance: f64, mut apply: impl FnMut(&[f64], &mut [f64])) -> Option<(Vec<f64>, usize)> {
    let norm = dot(b, b).sqrt();
    let mut x = vec![0.0; b.len()];
    if norm == 0.0 {
        return Some((x, 0));
    }
    let mut basis = vec![b.iter().map(|b| b / norm).collect::<Vec<_>>()];
    // Upper triangle of the Hessenberg matrix after the rotations, by columns.
    let mut triangle: Vec<Vec<f64>> = Vec::new();
    let mut rotations: Vec<(f64, f64)> = Vec::new();
    let mut right = vec![norm];
    for k in 0..MOST_ITERATIONS {
        let mut next = vec![0.0; b.len()];
        apply(&basis[k], &mut next);
        let mut column = Vec::with_capacity(k + 2);
        for vector in &basis {
            let along = dot(&next, vector);
            for (next, v) in next.iter_mut().zip(vector) {
                *next -= along * v;
            }
            column.push(along);
        }
        let length = dot(&next, &next).sqrt();
        for (i, &(cos, sin)) in rotations.iter().enumerate() {
            let (upper, lower) = (column[i], column[i + 1..].first().copied().unwrap_or(0.0));
            column[i] = cos * upper + sin * lower;
            if i + 1 < column.len() {
                column[i + 1] = cos * lower - sin * upper;
            }
        }
        let radius = column[k].hypot(length);
        let (cos, sin) = if radius > 0.0 { (column[k] / radius, length / radius) } else { (1.0, 0.0) };
        column[k] = radius;
        rotations.push((cos, sin));
        triangle.push(column);
        let last = right[k];
        right[k] = cos * last;
        right.push(-sin * last);
        if right[k + 1].abs() <= tolerance * norm || length == 0.0 {
            let mut weights = vec![0.0; k + 1];
            for i in (0..=k).rev() {
                let known: f64 = (i + 1..=k).map(|j| triangle[j][i] * weights[j]).sum();
                weights[i] = (right[i] - known) / triangle[i][i];
            }
            for (weight, vector) in weights.iter().zip(&basis) {
                for (x, v) in x.iter_mut().zip(vector) {
                    *x += weight * v;
                }
            }
            return Some((x, k + 1));
        }
        for value in &mut next {
            *value /= length;
        }
        basis.push(next);
    }
    None
}

/// In eight sums side by side: one alone waits for each addition.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<8>(), b.as_chunks::<8>());
    let mut sums = [0.0; 8];
    for (a, b) in a.iter().zip(b) {
        for (sum, (a, b)) in sums.iter_mut().zip(a.iter().zip(b)) {
            *sum += a * b;
        }
    }
    sums.iter().sum::<f64>() + a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::solve;

    /// An unsymmetric system of 5: exact after 5 iterations at most.
    #[test]
    fn analytic_small_system() {
        let a = |i: usize, j: usize| if i == j { 4.0 + i as f64 } else { 1.0 / (1.0 + 2.0 * i as f64 + j as f64) };
        let expected = [1.0, -2.0, 0.5, 3.0, -1.0];
        let apply = |v: &[f64], out: &mut [f64]| {
            for (i, out) in out.iter_mut().enumerate() {
                *out = (0..5).map(|j| a(i, j) * v[j]).sum();
            }
        };
        let mut b = [0.0; 5];
        apply(&expected, &mut b);
        let (x, iterations) = solve(&b, 1e-13, apply).unwrap();
        assert!(iterations <= 5);
        for (x, expected) in x.iter().zip(expected) {
            assert!((x - expected).abs() < 1e-12);
        }
        assert_eq!(solve(&[0.0; 5], 1e-9, apply), Some((vec![0.0; 5], 0)));
    }
}
