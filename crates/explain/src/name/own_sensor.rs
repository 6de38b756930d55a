//! Whether a changed path that reaches all sensors is one sensor's own or the housing's.
//!
//! A mode of one pedestal reaches the sensors of the others through the housing, and a mode of the
//! housing moves no two sensors alike: the words differ by degree. A path is called a sensor's own
//! where it moves that sensor more than twice as much as any other. Not everybody would draw the
//! line just there, which is what the probability says.

use statrs::function::erf::erfc;

use crate::change::locate::Cell;

/// Change of the sensor that moved most over that of the next (ln), from which a path is its own,
/// and how far people may differ about that (standard deviation), as `e^0.25` = 1.3. The words are
/// defined so; neither number was fitted.
const OWN: f64 = std::f64::consts::LN_2;
const SPREAD: f64 = 0.25;

/// The sensor that a path moved most.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Leader {
    /// Its position.
    pub channel: usize,
    /// Root mean square change of its lines over that of the next sensor (ln).
    pub lead: f64,
    /// Probability that the path is its own.
    pub own: f64,
}

/// The sensor of so many whose lines changed most by a function of frequency; `None` where fewer
/// than two have lines, or none changed.
pub fn leader(cells: &[Cell], channels: usize) -> Option<Leader> {
    let mean_square = |channel: usize| {
        let lines = cells.iter().filter(|c| c.channel == channel && c.family.is_some());
        let (sum, n) = lines.fold((0.0, 0usize), |(sum, n), c| (sum + c.change.powi(2), n + 1));
        (n > 0).then(|| sum / n as f64)
    };
    let mut squares: Vec<(usize, f64)> = (0..channels).filter_map(|c| Some((c, mean_square(c)?))).collect();
    squares.sort_by(|a, b| b.1.total_cmp(&a.1));
    let [(channel, most), (_, next), ..] = squares[..] else { return None };
    let lead = 0.5 * (most / next).ln();
    (most > 0.0).then(|| Leader { channel, lead, own: own(lead) })
}

/// Probability that a path which leads by so much (ln) is one sensor's own.
fn own(lead: f64) -> f64 {
    0.5 * erfc((OWN - lead) / (SPREAD * std::f64::consts::SQRT_2))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::change::locate::LINE;

    fn lines(changes: &[(usize, f64)]) -> Vec<Cell> {
        changes.iter().map(|&(channel, change)| Cell { channel, change, ..LINE }).collect()
    }

    /// Changes of 0.5 and 0.2 on the sensors: the lead is ln 2.5. Twice as much is even odds; as
    /// much on both is the housing's, and where the other stands still the path is its own.
    #[test]
    fn analytic_a_path_is_the_own_of_a_sensor_that_it_moves_twice_as_much() {
        let found = leader(&lines(&[(0, 0.2), (0, -0.2), (1, 0.5), (1, -0.5)]), 2).unwrap();
        assert!(found.channel == 1 && (found.lead - 2.5f64.ln()).abs() < 1e-12, "{found:?}");
        assert!((own(OWN) - 0.5).abs() < 1e-12 && own(0.0) < 0.01 && own(f64::INFINITY) == 1.0);
        // One standard deviation of the normal distribution.
        assert!((own(OWN + SPREAD) - 0.8413).abs() < 1e-4);
        assert_eq!(leader(&lines(&[(0, 0.3), (1, 0.0)]), 2).map(|f| f.own), Some(1.0));
        assert_eq!(leader(&lines(&[(0, 0.3)]), 2), None);
        assert_eq!(leader(&lines(&[(0, 0.0), (1, 0.0)]), 2), None);
    }
}
