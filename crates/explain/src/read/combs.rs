//! Orders whose multiples a train makes.

use gearwatch_core::train::Train;

/// Distance (bins) between neighbours of a comb from which it leaves room for lines that are off
/// it.
const COMB_LEAVES_ROOM: f64 = 12.0;

/// Orders whose multiples the train makes: of each shaft, and of each stage at which the same two
/// teeth meet again. A pair of teeth errs as no other does, so that teeth with a common factor,
/// which make few pairs, show lines at multiples of the hunting-tooth order. Left out where these
/// lie too dense to tell.
pub fn combs(train: &Train, revolutions: f64) -> Vec<f64> {
    let pairs = train.stages.iter().map(|s| s.mesh_order / s.hunting_meshes() as f64);
    let apart = pairs.filter(|order| order * revolutions > COMB_LEAVES_ROOM);
    train.shafts.iter().map(|s| s.1).chain(apart).collect()
}

/// Distance of an order to the nearest multiple of the train's combs in a recording of so many
/// revolutions.
pub fn distance_to_combs(train: &Train, revolutions: f64, order: f64) -> f64 {
    let off = |comb: f64| (order / comb - (order / comb).round()).abs() * comb;
    combs(train, revolutions).into_iter().map(off).fold(f64::INFINITY, f64::min)
}

/// The tests, and a train for those of other modules.
#[cfg(test)]
pub mod tests {
    use super::*;
    use gearwatch_core::bench::Bench;

    /// One stage of these teeth.
    pub fn pair(pinion: u32, wheel: u32) -> Train {
        let mut bench = Bench::from_toml(include_str!("../../../sim/src/shipped/single-pair.toml")).unwrap();
        bench.stages[0].pinion.teeth = pinion;
        bench.stages[0].wheel.teeth = wheel;
        Train::new(&bench)
    }

    /// Of 25 and 30 teeth the same two meet every 150 meshes, six turns of the pinion: lines at
    /// multiples of 1/6, of which neither shaft has 54 1/3. Of 25 and 31 the comb of 1/31 is dense
    /// in 100 turns, and tells nothing; in 400 turns it is there.
    #[test]
    fn analytic_teeth_with_a_common_factor_have_a_comb() {
        let common = pair(25, 30);
        assert_eq!(combs(&common, 100.0).len(), 3);
        assert!((combs(&common, 100.0)[2] - 1.0 / 6.0).abs() < 1e-12);
        assert!(distance_to_combs(&common, 100.0, 54.0 + 1.0 / 3.0) < 1e-9);
        assert!((distance_to_combs(&common, 100.0, 54.25) - 1.0 / 12.0).abs() < 1e-9);
        let prime = pair(25, 31);
        assert_eq!(combs(&prime, 100.0).len(), 2);
        assert_eq!(combs(&prime, 400.0).len(), 3);
    }
}
