//! What the table says to wrong effects, places and values.

use super::*;

fn complaint(effect: &str, place: &str, parameters: &[(&str, f64)]) -> String {
    let parameters = parameters.iter().map(|&(name, value)| (name.to_owned(), value)).collect();
    let spec = EffectSpec { effect: effect.into(), place: place.into(), parameters };
    let mut setup = SimSetup::nominal(&bench());
    effects::apply(&spec, &mut setup).expect_err("must be refused").to_string()
}

#[test]
fn conform_an_unknown_effect_names_the_nearest() {
    assert!(complaint("ecentricity", "stage1.pinion", &[]).contains("\"eccentricity\""));
}

#[test]
fn conform_an_unknown_place_names_the_places() {
    let text = complaint("eccentricity", "stage1.pinon", &[]);
    assert!(text.contains("did you mean \"stage1.pinion\"") && text.contains("stage1.wheel"), "{text}");
    let text = complaint("belt_slip", "belt", &[]);
    assert!(text.contains("no place for it"), "{text}");
}

#[test]
fn conform_an_unknown_parameter_names_the_nearest() {
    let text = complaint("eccentricity", "stage1.pinion", &[("runout_mm", 1.0)]);
    assert!(text.contains("\"runout_um\""), "{text}");
}

#[test]
fn conform_a_value_out_of_range_says_the_range() {
    for value in [-1.0, 1e9, f64::NAN] {
        let text = complaint("belt_slip_", "belt", &[("x", value)]);
        assert!(text.contains("did you mean"), "{text}");
        let text = complaint("unbalance", "input", &[("amount_kg_m", value)]);
        assert!(text.contains("expected 0 to 1 kg m"), "{text}");
    }
}

#[test]
fn conform_values_that_do_not_go_together_are_refused() {
    let text = complaint("aliasing", "acc_1", &[("frequency_hz", 1000.0)]);
    assert!(text.contains("half the sampling rate"), "{text}");
    let text = complaint("speed_fluctuation", "input", &[("order", 1.0), ("frequency_hz", 3.0)]);
    assert!(text.contains("both"), "{text}");
    let text = complaint("damping", "housing", &[]);
    assert!(text.contains("housing_mode"), "{text}");
}
