//! The power that noise alone shows beside the lines of a band.

use num_complex::Complex64;

/// Order bins beside a harmonic that the floor rests on at least.
const FLOOR_BINS: usize = 16;

/// Mean power of noise in one order bin, from the bins that are not on a known line: their median,
/// divided by `ln 2`. `crowding` says of each order bin how near known lines are; bins nearer to
/// them are taken only where those beyond are too few. `powers` is scratch.
pub(crate) fn floor_power(spectrum: &[Complex64], crowding: &[u8], reach: usize, powers: &mut Vec<u64>) -> f64 {
    let m = spectrum.len();
    let reach = reach.min(m / 2 - 1);
    let middle = crowding.len() / 2;
    for most in 0..=2 {
        powers.clear();
        let (below, above) = (&spectrum[m - reach..], &spectrum[..=reach]);
        let (crowd_below, crowd_above) = (&crowding[middle - reach..middle], &crowding[middle..=middle + reach]);
        for (bins, crowd) in [(below, crowd_below), (above, crowd_above)] {
            powers.extend(
                bins.iter().zip(crowd).filter(|(_, crowd)| **crowd <= most).map(|(y, _)| y.norm_sqr().to_bits()),
            );
        }
        if powers.len() >= FLOOR_BINS {
            break;
        }
    }
    median_power(powers) / std::f64::consts::LN_2
}

/// Median, reordering the values; `NaN` of none.
pub(crate) fn median(values: &mut [f64]) -> f64 {
    if values.is_empty() {
        return f64::NAN;
    }
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// The same of powers given by their bits, which order like the numbers because these are not
/// negative.
pub(crate) fn median_power(bits: &mut [u64]) -> f64 {
    if bits.is_empty() {
        return f64::NAN;
    }
    let middle = bits.len() / 2;
    f64::from_bits(*bits.select_nth_unstable(middle).1)
}
