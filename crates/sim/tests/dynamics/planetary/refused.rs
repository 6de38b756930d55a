//! Benches that are refused, with the sentence that says which number is wrong.

use gearwatch_core::bench::{Bench, EffectSpec, Hand, Helix, Stage};
use gearwatch_sim::effects;
use gearwatch_sim::model::TrainModel;
use gearwatch_sim::rotation::Profile;
use gearwatch_sim::setup::SimSetup;

use super::{alone, pair, with};

/// What the simulator cannot do is said with the number that is wrong.
#[test]
fn conform_planets_beyond_the_simulator_are_refused() {
    let mut many = alone([28, 36, 100], 4, ["sun", "carrier"]);
    if let Some(set) = &mut many.stages[0].gearing.planetary {
        set.planets = 9;
    }
    let said = many.beyond_simulator().expect("too many meshes");
    assert!(said.contains("18 meshes") && said.contains("16 at most"), "{said}");
    let mut shifted = alone([28, 36, 100], 4, ["sun", "carrier"]);
    shifted.stages[0].gearing.profile_shifted = true;
    assert!(shifted.beyond_simulator().expect("shifted").contains("profile shift"));
    let bench = alone([28, 36, 100], 4, ["sun", "carrier"]);
    let loose = with(&bench, "looseness", "first", &[]);
    let said =
        TrainModel::new(&loose, Profile::constant(20.0), Profile::constant(60.0), 1).expect_err("refused").to_string();
    assert!(said.contains("planetary stage \"p\""), "{said}");
    let spec = EffectSpec { effect: "planet_position".into(), place: "p.planet_5".into(), parameters: [].into() };
    let said = effects::setup(&bench, &[spec]).expect_err("refused").to_string();
    assert!(said.contains("p.planet_4"), "{said}");
}

/// What cannot be built is refused by the model with the number that is wrong and what would be
/// right.
#[test]
fn conform_what_cannot_be_built_is_refused() {
    let refused = |bench: &Bench, words: &[&str]| {
        let (speed, torque) = (Profile::constant(20.0), Profile::constant(10.0));
        let said = TrainModel::new(&SimSetup::nominal(bench), speed, torque, 1).expect_err("refused").to_string();
        words.iter().for_each(|word| assert!(said.contains(word), "{word}: {said}"));
    };
    let whole = alone([28, 36, 100], 4, ["sun", "carrier"]);
    let changed = |change: &dyn Fn(&mut Stage)| {
        let mut bench = whole.clone();
        change(&mut bench.stages[0]);
        bench
    };
    let planets = |stage: &mut Stage, count: u32| {
        if let Some(set) = &mut stage.gearing.planetary {
            set.planets = count;
        }
    };
    // (28 + 100) / 3 is not whole; eight planets of 36 teeth overlap.
    refused(&changed(&|stage| planets(stage, 3)), &["planet.count is 3", "42.667", "2, 4, 8 planets would fit"]);
    refused(&changed(&|stage| planets(stage, 8)), &["planets 1 and 2 collide", "at most 4"]);
    refused(&changed(&|stage| stage.wheel.teeth = 98), &["ring.teeth is 98", "a ring of 100"]);
    let small = changed(&|stage| {
        (stage.pinion.teeth, stage.wheel.teeth) = (12, 84);
    });
    refused(&small, &["sun.teeth is 12", "below 17.1 teeth", "expected 17 or more"]);
    let mut hands = pair("wheel = { teeth = 57 }");
    hands.stages[0].gearing.helix = Some(Helix { angle_deg: 15.0, hands: [Some(Hand::Right); 2] });
    refused(&hands, &["hands do not match", "pinion \"right\", wheel \"right\"", "wheel.hand = \"left\""]);
    // The rack's tips would cut into the ring's fillets where ring and planet are nearly alike, or
    // the ring has too few teeth for involutes.
    refused(
        &pair("wheel = { teeth = 30, internal = true }"),
        &["wheel has 30 teeth inside", "expected 34 teeth or more"],
    );
}
