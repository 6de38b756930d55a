//! Damaged teeth.
//!
//! The reference figures are quasi-static changes of the harmonics of k(t) over one revolution
//! (34/85 teeth, m = 4 mm, b = 30 mm, linear Hertz contact, straight root, pairs added up, one
//! tooth of the pinion hit) by an independent Python implementation. It does not state its bores:
//! radii of 15 and 35 mm make the least stiffness of the *first* row, and all other rows then
//! follow. The fourth harmonic is not compared: 4 (ε − 1) = 3.0, so that it nearly vanishes and its
//! relative change has no meaning.

use std::f64::consts::TAU;

use gearwatch_sim::faults::{
    Breakage, BreakageKind, Crack, GearModifications, Pit, Spall, ToothDamage, ToothModifications,
};
use gearwatch_sim::mesh::{MeshModel, MeshOptions, MeshProblem};
use gearwatch_sim::tooth::Root;

use crate::specimen;

const TEETH: usize = 34;
/// Samples per mesh cycle.
const STEPS: usize = 1000;
/// Samples per revolution.
const SAMPLES: usize = TEETH * STEPS;

fn model_with(options: &MeshOptions, teeth: &ToothModifications) -> Result<MeshModel, MeshProblem> {
    let s = specimen([34, 85], 4e-3, 30e-3, [15e-3, 35e-3], 206e9);
    MeshModel::from_gears((s.pair.pinion.clone(), s.pair.wheel.clone()), s.material, options, teeth, 80e-6)
}

fn model(change: impl FnOnce(&mut GearModifications)) -> MeshModel {
    let mut teeth = ToothModifications::default();
    change(&mut teeth.pinion);
    model_with(&MeshOptions::classical(), &teeth).unwrap()
}

/// k over one revolution of the pinion.
fn revolution(model: &MeshModel) -> Vec<f64> {
    let load = model.at_load(1000.0);
    (0..SAMPLES).map(|i| model.stiffness_n_per_m((i as f64 + 0.5) / STEPS as f64, &load)).collect()
}

/// Complex amplitude at `line` cycles per revolution.
fn line(k: &[f64], line: usize) -> [f64; 2] {
    let (mut re, mut im) = (0.0, 0.0);
    for (i, k) in k.iter().enumerate() {
        let (sin, cos) = (TAU * (i * line % SAMPLES) as f64 / SAMPLES as f64).sin_cos();
        re += k * cos;
        im -= k * sin;
    }
    [2.0 * re / k.len() as f64, 2.0 * im / k.len() as f64]
}

fn amplitude(k: &[f64], at: usize) -> f64 {
    let [re, im] = line(k, at);
    re.hypot(im)
}

/// Change (%) of mesh harmonics 1, 2, 3, 5; least k / healthy k; strongest first-order sideband /
/// first harmonic.
struct Change {
    percent: [f64; 4],
    least: f64,
    mean_percent: f64,
    sideband: f64,
}

fn change(damaged: &MeshModel) -> Change {
    let (healthy, k) = (revolution(&model(|_| {})), revolution(damaged));
    let first = amplitude(&healthy, TEETH);
    let sidebands = (1..=5).flat_map(|h| [TEETH * h - 1, TEETH * h + 1]).map(|at| amplitude(&k, at) / first);
    Change {
        percent: [1, 2, 3, 5].map(|h| 100.0 * (amplitude(&k, TEETH * h) / amplitude(&healthy, TEETH * h) - 1.0)),
        least: k.iter().zip(&healthy).map(|(k, healthy)| k / healthy).fold(f64::INFINITY, f64::min),
        mean_percent: 100.0 * (k.iter().sum::<f64>() / healthy.iter().sum::<f64>() - 1.0),
        sideband: sidebands.fold(0.0, f64::max),
    }
}

fn breakage(fraction: f64, kind: BreakageKind) -> impl FnOnce(&mut ToothDamage) {
    move |damage| damage.breakage = Some(Breakage { fraction, kind })
}

/// The paper's pits, 4, 5, 6, 7 mm one after the other, 1.5 mm deep.
fn pits(count: usize) -> Vec<Pit> {
    [4e-3, 5e-3, 6e-3, 7e-3][..count]
        .iter()
        .map(|&diameter_m| Pit { diameter_m, depth_m: 1.5e-3, height_m: 0.0 })
        .collect()
}

fn assert_near(what: &str, got: f64, expected: f64, tolerance: f64) {
    assert!((got - expected).abs() <= tolerance, "{what}: {got:.4}, expected {expected} ± {tolerance}");
}

/// A missing tooth takes one of z equal pulses out of the pair stiffnesses: every mesh harmonic
/// changes by exactly −1/z, and every multiple of the shaft's speed appears.
#[test]
fn analytic_missing_tooth_takes_one_zth() {
    for kind in [BreakageKind::Width, BreakageKind::Height] {
        let broken = model(|gear| gear.damage_tooth(7, breakage(1.0, kind)));
        let (healthy, k) = (revolution(&model(|_| {})), revolution(&broken));
        for h in 1..=5 {
            let ratio = amplitude(&k, TEETH * h) / amplitude(&healthy, TEETH * h);
            // Rounding of 34 000 terms against a near-null fourth harmonic.
            assert_near("1 − 1/z", ratio, 1.0 - 1.0 / 34.0, 1e-9);
        }
        for at in 1..TEETH {
            assert!(
                amplitude(&k, at) > 1e-4 * amplitude(&k, TEETH)
                    && amplitude(&healthy, at) < 1e-10 * amplitude(&k, TEETH)
            );
        }
    }
}

/// A fraction of the width: 1/5, 2/5, 3/5, 4/5.
#[test]
fn oracle_breakage_of_width() {
    for (fraction, percent, least, sideband) in
        [(0.2, -0.14, 0.955, 0.002), (0.4, -0.33, 0.889, 0.005), (0.6, -0.64, 0.781, 0.009), (0.8, -1.20, 0.573, 0.015)]
    {
        let got = change(&model(|gear| gear.damage_tooth(3, breakage(fraction, BreakageKind::Width))));
        // All harmonics are within 0.02 of the first in the reference; bores that are only nearly
        // its own leave 0.03.
        for percent_h in got.percent {
            assert_near("harmonic, %", percent_h, percent, 0.04);
        }
        assert_near("least k", got.least, least, 0.004);
        // One digit is given, and 4 % for the bores.
        assert_near("sideband", got.sideband, sideband, 0.0005 + 0.04 * sideband);
    }
}

/// A fraction of the height. Where the cut falls decides on the harmonics: 0.5 points allow for the
/// reference's coarser phases.
#[test]
fn oracle_breakage_of_height() {
    for (fraction, percent, least) in
        [(0.2, [-1.05, -2.14, -0.17], 0.504), (0.4, [-3.39, -3.39, -2.91], 0.436), (0.6, [0.75, -3.05, -1.44], 0.0)]
    {
        let got = change(&model(|gear| gear.damage_tooth(3, breakage(fraction, BreakageKind::Height))));
        for (h, expected) in percent.into_iter().enumerate() {
            assert_near("harmonic, %", got.percent[h], expected, 0.5);
        }
        assert_near("least k", got.least, least, 0.004);
    }
    let gone = change(&model(|gear| gear.damage_tooth(3, breakage(0.8, BreakageKind::Height))));
    assert_near("4/5 of the height is the whole path", gone.percent[0], -100.0 / 34.0, 1e-9);
}

/// On one tooth pits all but vanish from the mesh harmonics; on all teeth they do not.
#[test]
fn oracle_pits() {
    let one = change(&model(|gear| gear.damage_tooth(3, |damage| damage.pits = pits(4))));
    assert_near("least k", one.least, 0.862, 0.004);
    assert!(one.percent.into_iter().all(|percent| percent.abs() <= 0.2), "{:?}", one.percent);
    assert!(one.sideband < 0.0022);
    let single = change(&model(|gear| gear.damage_tooth(3, |damage| damage.pits = pits(1))));
    assert!(single.percent.into_iter().all(|percent| percent.abs() <= 0.04), "{:?}", single.percent);
    let all = change(&model(|gear| gear.damage_all(|damage| damage.pits = pits(4))));
    for (got, expected) in all.percent.into_iter().zip([5.1, -3.3, -2.2, -3.5]) {
        assert_near("harmonic, %", got, expected, 0.4);
    }
    assert_near("mean, %", all.mean_percent, -7.7, 0.1);
    assert!(all.sideband < 1e-12, "the same on all teeth has no sidebands");
}

/// Cracks of 1, 2, 3 mm at 60 degrees.
#[test]
fn oracle_root_crack() {
    for (depth, percent, least) in [(1e-3, -0.1, 0.976), (2e-3, -0.25, 0.933), (3e-3, -0.5, 0.871)] {
        let crack = Crack { depth_m: depth, angle_rad: 60_f64.to_radians() };
        let got = change(&model(|gear| gear.damage_tooth(3, |damage| damage.crack = Some(crack))));
        for percent_h in got.percent {
            // One digit is given.
            assert_near("harmonic, %", percent_h, percent, 0.08);
        }
        assert_near("least k", got.least, least, 0.002);
    }
}

/// Faults on different teeth add up as complex lines, their pairs being apart; on the same tooth
/// they do not.
#[test]
fn analytic_composite_faults() {
    let broken = |gear: &mut GearModifications| gear.damage_tooth(3, breakage(0.4, BreakageKind::Width));
    let pitted =
        |tooth: u32| move |gear: &mut GearModifications| gear.damage_tooth(tooth, |damage| damage.pits = pits(4));
    let at = |model: &MeshModel| -> Vec<[f64; 2]> {
        let k = revolution(model);
        [TEETH, 2 * TEETH, TEETH - 1, TEETH + 3].map(|n| line(&k, n)).to_vec()
    };
    let (healthy, b) = (at(&model(|_| {})), at(&model(broken)));
    for (tooth, same) in [(20, false), (3, true)] {
        let p = at(&model(pitted(tooth)));
        let both = at(&model(|gear| {
            broken(gear);
            pitted(tooth)(gear);
        }));
        let mut worst = 0.0_f64;
        for i in 0..healthy.len() {
            for part in 0..2 {
                let sum = b[i][part] + p[i][part] - healthy[i][part];
                worst = worst.max((both[i][part] - sum).abs() / healthy[0][0].hypot(healthy[0][1]));
            }
        }
        if same {
            assert!(worst > 1e-4, "on one tooth the parts must not simply add up: {worst}");
        } else {
            assert!(worst < 1e-12, "on teeth far apart they do: {worst}");
        }
    }
}

/// Width of an equal-area spall against a pit: the spall's sharp ends give more high-order
/// sidebands.
#[test]
fn analytic_spall_has_sharp_ends() {
    let spall = Spall { width_m: 10e-3, length_m: 3e-3, depth_m: 1e-3, height_m: 0.0 };
    let k = revolution(&model(|gear| gear.damage_tooth(3, |damage| damage.spall = Some(spall))));
    let healthy = revolution(&model(|_| {}));
    let steps = k.iter().zip(&healthy).map(|(k, h)| k / h - 1.0).collect::<Vec<_>>();
    let jump = steps.windows(2).map(|w| (w[1] - w[0]).abs()).fold(0.0, f64::max);
    // The contact line loses a third of its length within one cell of the table (6 samples); k_h is
    // a quarter of the tooth's part.
    assert!(jump > 2e-3, "{jump}");
    // The two tables are divided differently; each is within 1e-6 of the exact compliance.
    assert!(steps.iter().all(|&step| step <= 2e-6));
}

/// A pitted band over the whole width is a missing surface: no shorter line, but a gap as deep as
/// the pits.
#[test]
fn analytic_band_over_the_whole_width_is_a_gap() {
    let band = Spall { width_m: 30e-3, length_m: 2e-3, depth_m: 0.1e-3, height_m: 0.0 };
    let model = model(|gear| gear.damage_tooth(3, |damage| damage.spall = Some(band)));
    let pitch = 3.0 + model.geometry().pitch_phase();
    let mut pairs = gearwatch_sim::mesh::Pairs::default();
    model.pairs(pitch, 1000.0, &mut pairs);
    let pair = pairs.as_slice().iter().find(|pair| pair.pinion_tooth == 3).unwrap();
    assert_near("gap", pair.gap_m, 0.1e-3, 1e-18);
}

/// What does not fit is refused with what would.
#[test]
fn conform_impossible_faults_are_refused() {
    let refused = |damage: ToothDamage, tooth: u32| {
        let mut teeth = ToothModifications::default();
        teeth.wheel.teeth.insert(tooth, damage);
        model_with(&MeshOptions::default(), &teeth).unwrap_err().to_string()
    };
    let pit =
        |diameter_m| ToothDamage { pits: vec![Pit { diameter_m, depth_m: 1e-3, height_m: 0.0 }], ..Default::default() };
    let large = refused(pit(12e-3), 3);
    assert!(large.contains("wheel tooth 3") && large.contains("12.00 mm") && large.contains("does not fit"), "{large}");
    assert!(refused(pit(4e-3), 85).contains("teeth 0 to 84"));
    let row =
        ToothDamage { pits: vec![Pit { diameter_m: 7e-3, depth_m: 1e-3, height_m: 0.0 }; 5], ..Default::default() };
    assert!(refused(row, 0).contains("35.00 mm of face width"));
    let broken =
        ToothDamage { breakage: Some(Breakage { fraction: 1.2, kind: BreakageKind::Width }), ..Default::default() };
    assert!(refused(broken, 0).contains("up to 1"));
    let cracked = ToothDamage { crack: Some(Crack { depth_m: 12e-3, angle_rad: 1.0 }), ..Default::default() };
    assert!(refused(cracked, 0).contains("root thickness"));
    let mut soft = ToothModifications::default();
    soft.pair.stiffness_factor = 0.0;
    assert!(model_with(&MeshOptions::default(), &soft).unwrap_err().to_string().contains("expected 0.01 to 100"));
    let mut short = ToothModifications::default();
    short.pinion.pitch_error_m = vec![0.0; 33];
    assert!(model_with(&MeshOptions::default(), &short).unwrap_err().to_string().contains("each of its 34 teeth"));
}

/// Every damage goes through the default physics as well, and never stiffens a pair.
#[test]
fn conform_damage_never_stiffens() {
    let s = specimen([34, 85], 4e-3, 30e-3, [15e-3, 35e-3], 206e9);
    let damages = [
        ToothDamage { pits: pits(4), ..Default::default() },
        ToothDamage {
            breakage: Some(Breakage { fraction: 0.8, kind: BreakageKind::Width }),
            pits: pits(2),
            ..Default::default()
        },
        ToothDamage { crack: Some(Crack { depth_m: 2e-3, angle_rad: 1.0 }), ..Default::default() },
    ];
    for root in [Root::Straight, Root::Fillet] {
        for damage in &damages {
            let mut teeth = ToothModifications::default();
            teeth.wheel.teeth.insert(2, damage.clone());
            let options = MeshOptions { root, ..MeshOptions::default() };
            let damaged = model_with(&options, &teeth).unwrap();
            let plain = MeshModel::from_gears(
                (s.pair.pinion.clone(), s.pair.wheel.clone()),
                s.material,
                &options,
                &ToothModifications::default(),
                0.0,
            )
            .unwrap();
            for i in 0..400 {
                let u = 1.5 + f64::from(i) * 0.01;
                let (load, k) = (damaged.at_load(500.0), |m: &MeshModel| m.static_point(u, &m.at_load(500.0)));
                let (softer, harder) = (k(&damaged).0, k(&plain).0);
                assert!(softer >= harder * (1.0 - 1e-12) && softer.is_finite(), "{u}: {softer} {harder} {load:?}");
            }
        }
    }
}
