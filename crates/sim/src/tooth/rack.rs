//! Flank and fillet against the envelope of the rack that cuts them, by brute force.

use super::*;
use crate::geometry::{ADDENDUM, CLEARANCE, Cutting, Tip};

/// Half of the tooth's angle at a radius that a rack of a profile shift leaves, and whether its
/// round tip cut there.
///
/// The rack's tooth stands beside the gear's tooth: a flank, straight from the addendum line up,
/// and a round tip. For each of many roll angles the outline is cut with the circle of the radius;
/// the least angle over all rolls is what is left. A step of 1e-4 rad past the least one errs by
/// its square.
fn left_by_the_rack(teeth: u32, module: f64, shift: f64, radius: f64) -> (f64, bool) {
    let (sin, cos) = 20_f64.to_radians().sin_cos();
    let (tan, reference) = (sin / cos, 0.5 * module * f64::from(teeth));
    let datum = reference + shift * module;
    let low = datum - ADDENDUM * module;
    let rho = CLEARANCE * module / (1.0 - sin);
    // Middle of the round tip: from the end of the flank across the flank.
    let end = 0.25 * std::f64::consts::PI * module + ADDENDUM * module * tan;
    let middle = (end + rho * cos, low + rho * sin);
    let (mut least, mut round) = (f64::INFINITY, false);
    for step in -9000..=9000 {
        let roll = 1e-4 * f64::from(step);
        let moved = reference * roll;
        let mut offer = |x: f64, y: f64, by_tip: bool| {
            let angle = x.atan2(y) - roll;
            if angle < least {
                (least, round) = (angle, by_tip);
            }
        };
        // The flank: x = moved + π m/4 + (datum − y) tan α, on the circle x² + y² = R².
        let at_0 = moved + 0.25 * std::f64::consts::PI * module + datum * tan;
        let (a, b, c) = (1.0 + tan * tan, -2.0 * at_0 * tan, at_0 * at_0 - radius * radius);
        let root = b * b - 4.0 * a * c;
        if root >= 0.0 {
            let y = (-b + root.sqrt()) / (2.0 * a);
            if y >= low && y <= datum + 1.5 * module {
                offer(at_0 - y * tan, y, false);
            }
        }
        // The round tip: two circles.
        let (x_m, y_m) = (middle.0 + moved, middle.1);
        let far = x_m.hypot(y_m);
        let along = (far * far + radius * radius - rho * rho) / (2.0 * far);
        let across = radius * radius - along * along;
        if across >= 0.0 {
            for side in [-1.0, 1.0] {
                let (u, v) = (along / far, side * across.sqrt() / far);
                let (x, y) = (x_m * u - y_m * v, y_m * u + x_m * v);
                // Between the flank's normal and straight down.
                if x <= x_m && y - y_m <= -rho * sin {
                    offer(x, y, true);
                }
            }
        }
    }
    (least, round)
}

/// Shifted teeth, from thin to nearly pointed and with the middle of the round tip above the
/// rolling line, are what the rack leaves, from root to tip: as an angle to 1e-7 rad, ten times the
/// square of the rolling step. The round tip cuts below the calculated start of the involute and
/// the flank above it.
#[test]
fn oracle_shifted_teeth_are_what_the_rack_leaves() {
    let module = 3e-3;
    for (teeth, shift) in [(14, 0.5), (10, 0.6), (12, 0.95), (24, 0.36), (26, -0.3), (57, -0.8), (80, 1.1), (20, 0.0)] {
        let cutting = Cutting {
            profile_shift: shift,
            tip: Tip::Shortened(0.0),
            ..Cutting::standard(module, 20_f64.to_radians())
        };
        let gear = GearGeometry::drawn("gear", teeth, &cutting, 20e-3, 5e-3).unwrap();
        let profile = ToothProfile::new("gear", &gear, Root::Fillet, &mut Vec::new());
        let start = gear.involute_start_radius_m().expect("not undercut");
        let mut worst = 0.0_f64;
        for i in 1..20 {
            let t = f64::from(i) / 20.0;
            let (height, half, rate) = profile.fillet_point(t);
            let radius = height.hypot(half);
            let (angle, round) = left_by_the_rack(teeth, module, shift, radius);
            assert!(round && radius < start && rate > 0.0, "{teeth} {shift} {t}");
            worst = worst.max((half.atan2(height) - angle).abs());
            let radius = start + t * (gear.tip_radius_m - start);
            let (height, half) = gear.flank_point_m(gear.load_angle_rad(gear.roll_at_radius_m(radius)));
            let (angle, round) = left_by_the_rack(teeth, module, shift, radius);
            assert!(!round && (height.hypot(half) / radius - 1.0).abs() < 1e-12, "{teeth} {shift} {t}");
            worst = worst.max((half.atan2(height) - angle).abs());
            assert!((gear.thickness_m(radius) / (2.0 * radius) - angle).abs() < 1e-7);
        }
        assert!(worst < 1e-7, "{teeth} {shift}: {worst:.1e}");
        // Fillet and flank meet, and the fillet ends on the root circle.
        let (height, half, _) = profile.fillet_point(1.0);
        assert!((height.hypot(half) / start - 1.0).abs() < 1e-12);
        let (height, half, _) = profile.fillet_point(0.0);
        assert!((height.hypot(half) / gear.root_radius_m - 1.0).abs() < 1e-12);
    }
}
