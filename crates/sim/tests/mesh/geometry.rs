//! Geometry of the pair.

use gearwatch_sim::geometry::{GearGeometry, PairGeometry};

use crate::{p1, p2, specimen};

/// Contact ratios to the seven digits known; the double-contact angle is their own definition.
#[test]
fn literature_contact_ratio() {
    assert!((p1().pair.contact_ratio - 1.645626).abs() < 5e-7);
    assert!((p2().pair.contact_ratio - 1.7897798668).abs() < 5e-11);
}

/// Liang's closed form of the double-contact angle (MMT 76, 2014), by pressure angles at the tips:
/// θ_d = tan(acos(z₁ cos α / (z₁ + 2))) − 2π/z₁ − tan(acos(r_b1 / sqrt(r_a2² + a² − 2 r_a2 a
/// cos(acos(z₂ cos α/(z₂ + 2)) − α)))).
#[test]
fn literature_double_contact_angle_in_closed_form() {
    let pair = p1().pair;
    let alpha = 20_f64.to_radians();
    let (z1, z2) = (19.0, 48.0);
    let tip_1 = (z1 * alpha.cos() / (z1 + 2.0)).acos().tan();
    let beta = (z2 * alpha.cos() / (z2 + 2.0)).acos() - alpha;
    let (ra2, a) = (pair.wheel.tip_radius_m, pair.centre_distance_m);
    let reach = (ra2 * ra2 + a * a - 2.0 * ra2 * a * beta.cos()).sqrt();
    let entry = (pair.pinion.base_radius_m / reach).acos().tan();
    let theta = tip_1 - std::f64::consts::TAU / z1 - entry;
    // Both are exact; 1e-12 rad is rounding.
    assert!((theta - pair.double_contact_angle_rad()).abs() < 1e-12, "{theta} {}", pair.double_contact_angle_rad());
}

/// Gap before entry of 34/73 teeth, m = 3 mm, at pinion rotations of 2, 10 and 20 mrad: least
/// distance of the wheel's corner from an involute sampled every 20 µrad, in a script that shares
/// nothing with the crate.
#[test]
fn oracle_corner_gap() {
    let pair = specimen([34, 73], 3e-3, 30e-3, [12e-3, 25e-3], 206e9).pair;
    for (mrad, gap_um) in [(2.0, 0.11554), (10.0, 2.9339), (20.0, 11.9584)] {
        let lead = mrad * 1e-3 * 34.0 / std::f64::consts::TAU;
        let got = 1e6 * pair.corner_gap_m(lead, false);
        // The sampling places the foot within 10 µrad, which costs 1e-4 of the least gap.
        assert!((got / gap_um - 1.0).abs() < 1e-4, "{mrad} mrad: {got} µm, expected {gap_um}");
    }
    assert_eq!(pair.corner_gap_m(0.0, false), 0.0);
    assert!(pair.corner_gap_m(0.02, true) > 0.0);
}

/// The centre distance of 34/73, m = 3 mm, 50 µm larger: T grows by Δa / sin α to first order, ε
/// falls.
#[test]
fn analytic_centre_distance() {
    let near = specimen([34, 73], 3e-3, 30e-3, [12e-3, 25e-3], 206e9).pair;
    let far = PairGeometry::new(near.pinion.clone(), near.wheel.clone(), 50e-6).unwrap();
    let sin = near.operating_angle_rad.sin();
    let growth = far.tangent_length_m - near.tangent_length_m;
    // T'' = −(r_b1 + r_b2)²/T³: the second order is −Δa cot²α/(2a), 1e-3; the third 1e-6.
    let second = 50e-6 / (2.0 * near.centre_distance_m) * (1.0 / (sin * sin) - 1.0);
    assert!((growth * sin / 50e-6 - 1.0 + second).abs() < 1e-5);
    assert!((near.contact_ratio - far.contact_ratio - growth / near.base_pitch_m).abs() < 1e-12);
    assert!(
        (far.operating_angle_rad.cos() * far.centre_distance_m
            - near.operating_angle_rad.cos() * near.centre_distance_m)
            .abs()
            < 1e-15
    );
}

/// What cannot be is refused with what would be right.
#[test]
fn conform_impossible_geometry_is_refused() {
    let alpha = 20_f64.to_radians();
    let gear = |z, bore| GearGeometry::new("pinion", z, 3e-3, alpha, 20e-3, bore);
    assert!(gear(4, 1e-3).unwrap_err().to_string().contains("at least 5"));
    let bore = gear(20, 27e-3).unwrap_err().to_string();
    assert!(bore.contains("54.000 mm") && bore.contains("52.500 mm"), "{bore}");
    assert!(GearGeometry::new("pinion", 20, -3e-3, alpha, 20e-3, 5e-3).unwrap_err().to_string().contains("above 0"));
    // 16 teeth is the least that mates with up to 101 at 20 degrees (17 with a rack); 12 with 100
    // interferes.
    let refused = PairGeometry::new(gear(12, 5e-3).unwrap(), gear(100, 20e-3).unwrap(), 0.0).unwrap_err().to_string();
    assert!(refused.contains("interference") && refused.contains("at least 16 teeth"), "{refused}");
    assert!(PairGeometry::new(gear(16, 5e-3).unwrap(), gear(100, 20e-3).unwrap(), 0.0).is_ok());
    let apart = PairGeometry::new(gear(20, 5e-3).unwrap(), gear(30, 9e-3).unwrap(), 2.5e-3).unwrap_err().to_string();
    assert!(apart.contains("contact ratio"), "{apart}");
    let through = PairGeometry::new(gear(20, 5e-3).unwrap(), gear(30, 9e-3).unwrap(), -6e-3).unwrap_err().to_string();
    assert!(through.contains("base radii"), "{through}");
}
