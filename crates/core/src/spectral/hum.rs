//! How much of a window is nothing but the mains: what an open input picks up.

use num_complex::Complex64;

use crate::spectral::kernels::kernels;
use crate::train::{StageKinematics, Train};

/// Mains frequencies of the world (Hz).
const MAINS_HZ: [f64; 2] = [50.0, 60.0];

/// Odd multiples that rectifiers and saturated cores put beside the first.
const MULTIPLES: [f64; 4] = [1.0, 3.0, 5.0, 7.0];

/// The mains is held within this share of its nominal frequency, in all but the worst hours.
const DRIFT: f64 = 0.01;

/// In windows whose lines are wider (to each side, Hz), everything lies on some multiple of the
/// mains.
const WIDEST_HZ: f64 = 10.0;

/// Share of the power above which a signal is hum. A sensor that still feels the machine has its
/// mesh lines and its noise beside it.
const MOSTLY: f64 = 0.8;

/// Bins that are summed up at a time.
const PIECE: usize = 512;

/// The signal is hum and little else. `spectrum` are the bins 0…N/2 of a window of `length_s`,
/// whose lines are `half_width` bins wide to each side. Nothing is said where a line of the machine
/// lies on the mains' first one: it cannot be told from it.
pub fn is_hum(spectrum: &[Complex64], length_s: f64, half_width: f64, train: &Train, input_hz: f64) -> bool {
    let reach = half_width.ceil() + 1.0;
    if reach > WIDEST_HZ * length_s {
        return false;
    }
    let lines = MAINS_HZ.map(|mains_hz| {
        if is_of_machine(mains_hz, reach / length_s, train, input_hz) {
            return 0.0;
        }
        MULTIPLES.into_iter().map(|multiple| around(spectrum, multiple * mains_hz, length_s, reach)).sum::<f64>()
    });
    let most = lines.into_iter().fold(0.0, f64::max);
    // An offset says nothing of the mains. Where the machine is heard, its first few lines settle
    // it.
    let mut total = 0.0;
    for bins in spectrum.get(reach as usize..).unwrap_or_default().chunks(PIECE) {
        total += power(bins);
        if most <= MOSTLY * total {
            return false;
        }
    }
    most > MOSTLY * total
}

kernels! {
    /// Sum of the powers of bins, in eight parts: a single sum waits for each of its additions.
    fn power<'a>(_simd; bins: &'a [Complex64]) -> f64 {
        let (eights, rest) = bins.as_chunks::<8>();
        let mut sums = [0.0; 8];
        for eight in eights {
            for lane in 0..8 {
                sums[lane] += eight[lane].re * eight[lane].re + eight[lane].im * eight[lane].im;
            }
        }
        for y in rest {
            sums[0] += y.re * y.re + y.im * y.im;
        }
        sums.iter().sum()
    }
}

/// Power in the line at a frequency, wherever in its range it lies.
fn around(spectrum: &[Complex64], hz: f64, length_s: f64, reach: f64) -> f64 {
    let bins = |hz: f64, beyond: f64| (hz * length_s + beyond).max(0.0) as usize;
    let (from, until) = (bins(hz * (1.0 - DRIFT), -reach), bins(hz * (1.0 + DRIFT), reach + 1.0));
    let until = until.min(spectrum.len());
    spectrum[from.min(until)..until].iter().map(Complex64::norm_sqr).sum()
}

/// A shaft turns, twice turns, or teeth mesh at this frequency.
fn is_of_machine(hz: f64, reach_hz: f64, train: &Train, input_hz: f64) -> bool {
    let shafts = train.shafts.iter().map(|(_, order)| *order).chain([train.motor_order]);
    let turns = shafts.flat_map(|order| [order, 2.0 * order]);
    let meshes = train.stages.iter().flat_map(StageKinematics::harmonic_orders);
    turns.chain(meshes).any(|order| (order * input_hz - hz).abs() <= 2.0 * reach_hz + DRIFT * hz)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Lines of these frequencies and powers, in windows of one second at 2048 Hz.
    fn hum(lines: &[(f64, f64)], input_hz: f64) -> bool {
        let mut spectrum = vec![Complex64::ZERO; 1025];
        lines.iter().for_each(|&(hz, power)| spectrum[hz as usize] += power.sqrt());
        let shafts = vec![("input".to_owned(), 1.0)];
        let train = Train { motor_order: 1.0, shafts, stages: Vec::new(), nominal_input_hz: input_hz };
        is_hum(&spectrum, 1.0, 3.4, &train, input_hz)
    }

    /// More than four fifths of the power on the mains and its odd multiples; an offset does not
    /// count, and what a shaft may have made is not hum.
    #[test]
    fn analytic_hum_is_four_fifths_of_the_power() {
        assert!(hum(&[(0.0, 100.0), (50.0, 0.7), (150.0, 0.15), (333.0, 0.15)], 7.0));
        assert!(hum(&[(60.0, 0.85), (333.0, 0.15)], 7.0));
        assert!(!hum(&[(50.0, 0.7), (333.0, 0.3)], 7.0));
        assert!(!hum(&[(55.0 + 12.0, 1.0)], 7.0), "another frequency");
        for input_hz in [50.0, 49.0, 25.0] {
            assert!(!hum(&[(50.0, 1.0)], input_hz), "{input_hz}");
        }
    }
}
