//! Beams against closed forms and against ROSS.

use std::f64::consts::{PI, TAU};

use gearwatch_core::bench::{Beam, GearMaterial, Section, Support};
use nalgebra::{Complex, DMatrix, DVector};

use super::element::shear_coefficient;
use super::{Disc, Reduced, Rotor};

fn section(length_mm: f64, diameter_mm: f64, bore_mm: f64) -> Section {
    Section { length_mm, diameter_mm, bore_mm }
}

fn support(at_mm: f64, stiffness_n_per_m: f64, damping_n_s_per_m: f64) -> Support {
    Support { at_mm, stiffness_n_per_m, damping_n_s_per_m, tilt_nm_per_rad: 0.0, bearing: None, rolling: None }
}

fn beam(sections: Vec<Section>, supports: Vec<Support>) -> Beam {
    Beam {
        sections,
        supports,
        wheel_mm: None,
        pinion_mm: None,
        material: GearMaterial::default(),
        modes_to_hz: 50_000.0,
        damping_ratio: 0.0,
    }
}

fn reduced(beam: &Beam, discs: &[Disc]) -> Reduced {
    Rotor::new(beam, (1.0, 1.0), discs).reduced(beam.modes_to_hz, beam.damping_ratio).expect("supports hold it")
}

/// Area and second moment of the section, shear stiffness κ G A.
fn properties(section: &Section, material: &GearMaterial) -> (f64, f64, f64) {
    let area = 0.25e-6 * PI * (section.diameter_mm.powi(2) - section.bore_mm.powi(2));
    let shear = material.youngs_modulus_pa / (2.0 * (1.0 + material.poisson_ratio));
    (area, 0.5 * section.polar_m4(), shear_coefficient(section, material.poisson_ratio) * shear * area)
}

/// Cowper's coefficients of a solid circle and of a thin tube, `6 (1 + ν) / (7 + 6 ν)` and
/// `2 (1 + ν) / (4 + 3 ν)`.
#[test]
fn literature_shear_coefficients_of_cowper_1966() {
    let solid = shear_coefficient(&section(1.0, 30.0, 0.0), 0.3);
    assert!((solid - 6.0 * 1.3 / 8.8).abs() < 1e-12, "{solid}");
    let tube = shear_coefficient(&section(1.0, 30.0, 30.0 - 1e-6), 0.3);
    assert!((tube - 2.0 * 1.3 / 4.9).abs() < 1e-9, "{tube}");
}

/// A uniform beam on supports at its ends that are as good as rigid.
///
/// # Formula
/// S. P. Timoshenko (1921), with `k = nπ/L`:
/// `E I k⁴ − (ρ A + (ρ I + ρ E I A/(κ G A)) k²) ω² + ρ² I A/(κ G A) ω⁴ = 0`.
///
/// Ten elements, whose error goes with the sixth power of their length: 4e-7 for two half waves,
/// 2e-5 for four.
#[test]
fn analytic_simply_supported_timoshenko_beam() {
    for (diameter, bore) in [(30.0, 0.0), (60.0, 40.0)] {
        let spec = section(400.0, diameter, bore);
        let found = reduced(&beam(vec![spec.clone()], vec![support(0.0, 1e15, 0.0), support(400.0, 1e15, 0.0)]), &[]);
        let material = GearMaterial::default();
        let (area, second, shear) = properties(&spec, &material);
        let (e, rho) = (material.youngs_modulus_pa, material.density_kg_per_m3);
        for (n, hz) in (1..=4).zip(found.frequencies_hz()) {
            let k2 = (f64::from(n) * PI / 0.4).powi(2);
            let (c, a) = (e * second * k2 * k2, rho * rho * second * area / shear);
            let b = rho * area + (rho * second + rho * e * second * area / shear) * k2;
            let expected = ((b - (b * b - 4.0 * a * c).sqrt()) / (2.0 * a)).sqrt() / TAU;
            assert!((hz / expected - 1.0).abs() < if n < 3 { 1e-6 } else { 2.5e-5 }, "{diameter} {n}: {hz} {expected}");
        }
    }
}

/// Deflection under a force F at a distance a from one support and b from the other, `F a² b² / (3
/// E I L) + F a b / (κ G A L)` in bending and shear, and what the supports give way: `F (b²/k₁ +
/// a²/k₂) / L²`. The element is exact under forces at its nodes, and the reduction under forces at
/// gears: rounding alone is left.
#[test]
fn analytic_static_deflection_under_a_gear() {
    let spec = section(300.0, 28.0, 8.0);
    let (a, b, length) = (0.09, 0.21, 0.3);
    let supports = vec![support(0.0, 2e8, 0.0), support(300.0, 1e8, 0.0)];
    // Bending modes up to 300 Hz: none.
    let rigid = Beam { modes_to_hz: 300.0, ..beam(vec![spec.clone()], supports) };
    let disc = Disc::gear(90.0, 2.0, 3e-3, 0.02);
    let found = reduced(&rigid, &[disc]);
    let (_, second, shear) = properties(&spec, &rigid.material);
    let e = rigid.material.youngs_modulus_pa;
    let bent = f64::powi(a * b, 2) / (3.0 * e * second * length) + a * b / (shear * length);
    let expected = bent + (b * b / 2e8 + a * a / 1e8) / (length * length);
    let stiffness = |k: usize| found.mass_kg * found.omegas[k].powi(2);
    let deflection: f64 = (0..found.omegas.len()).map(|k| found.seats[0][k].powi(2) / stiffness(k)).sum();
    assert!((deflection / expected - 1.0).abs() < 1e-9, "{deflection} {expected}");
    // The supports carry b/L and a/L of the force.
    for (support, share, k) in [(0, b / length, 2e8), (1, a / length, 1e8)] {
        let moved: f64 =
            (0..found.omegas.len()).map(|k| found.seats[0][k] * found.held[support][k] / stiffness(k)).sum();
        assert!((k * moved - share).abs() < 1e-9, "{support}: {}", k * moved);
    }
}

/// A disc in the middle of a shaft that hardly bends, on two supports: `√(2 k/m)`, and tilting
/// `√(k L²/2 / I_d)`; with rotation the tilting whirl by `ω² ∓ (I_p/I_d) Ω ω = ω₀²`. The shaft is
/// 1e5 times stiffer than the supports and 1e4 times lighter than the disc; both err by as much.
#[test]
fn analytic_rigid_rotor() {
    let mut stiff = beam(vec![section(200.0, 60.0, 0.0)], vec![support(0.0, 1e4, 0.0), support(200.0, 1e4, 0.0)]);
    stiff.material.density_kg_per_m3 = 1.0;
    let disc = Disc { at_mm: 100.0, mass_kg: 8.0, polar_kg_m2: 0.06, diametral_kg_m2: 0.035 };
    let found = reduced(&stiff, &[disc]);
    let (bounce, tilt) = ((2e4_f64 / 8.0).sqrt(), (1e4 * 0.2 * 0.2 / 2.0 / 0.035_f64).sqrt());
    let mut expected = [bounce / TAU, tilt / TAU];
    expected.sort_by(f64::total_cmp);
    for (hz, expected) in found.frequencies_hz().iter().zip(expected) {
        assert!((hz / expected - 1.0).abs() < 1e-4, "{hz} {expected}");
    }
    let speed = 200.0;
    let half = 0.5 * 0.06 / 0.035 * speed;
    for (side, whirl) in [(-1.0, 0), (1.0, 1)] {
        let expected = (side * half + (half * half + tilt * tilt).sqrt()) / TAU;
        let near = found.whirl_hz(speed)[whirl].iter().map(|hz| (hz / expected - 1.0).abs()).fold(1.0, f64::min);
        assert!(near < 1e-4, "{side} {expected}: {:?}", found.whirl_hz(speed));
    }
}

/// Amplitude at a place (a row of the coordinates) under an unbalance at another one.
///
/// # Formula
/// With `u_x + i u_y = z e^{iΩt}`: `(K + Ω² G − Ω² M + iΩ C) z = m e Ω² φ`.
fn unbalance(rotor: &Reduced, (from, to): (&DVector<f64>, &DVector<f64>), amount_kg_m: f64, speed: f64) -> f64 {
    let n = rotor.omegas.len();
    let dynamic = DMatrix::from_fn(n, n, |i, j| {
        let own = if i == j { rotor.mass_kg * (rotor.omegas[i].powi(2) - speed * speed) } else { 0.0 };
        Complex::new(own + speed * speed * rotor.polar[(i, j)], speed * rotor.damping[(i, j)])
    });
    let force = from.map(|x| Complex::new(amount_kg_m * speed * speed * x, 0.0));
    let z = dynamic.lu().solve(&force).expect("damped");
    to.iter().zip(z.iter()).map(|(row, z)| z * *row).sum::<Complex<f64>>().norm()
}

/// What ROSS says of a rotor.
struct Ross {
    beam: Beam,
    discs: [Disc; 2],
    /// Hz.
    standstill: [f64; 6],
    /// At 1000 rad/s, backward and forward (Hz).
    whirl: [[f64; 6]; 2],
    /// Response (m) to 1e-4 kg m at the second disc, at the first disc and the second support.
    response: [[f64; 6]; 2],
}

/// Numbers of ROSS 2.3.0 (R. Timbó et al., J. Open Source Softw. 5 (2020) 2120) by
/// `tests/peers/rotors.py`.
fn of_ross() -> [Ross; 2] {
    let disc = |at_mm, mass_kg, diametral_kg_m2, polar_kg_m2| Disc { at_mm, mass_kg, polar_kg_m2, diametral_kg_m2 };
    [
        Ross {
            beam: beam(
                vec![section(60.0, 25.0, 0.0), section(200.0, 40.0, 15.0), section(60.0, 25.0, 0.0)],
                vec![support(20.0, 1.2e8, 1500.0), support(300.0, 0.9e8, 1000.0)],
            ),
            discs: [disc(90.0, 2.0, 2.5e-3, 4.0e-3), disc(230.0, 5.0, 1.2e-2, 2.0e-2)],
            standstill: [389.031606, 883.604307, 1464.857627, 2794.618432, 5080.461808, 5636.421162],
            whirl: [
                [382.256151, 829.275014, 1401.757776, 2698.561629, 5072.963250, 5621.686194],
                [394.988037, 934.094523, 1545.870231, 2894.490011, 5088.257006, 5651.993158],
            ],
            response: [
                [1.374339e-08, 3.590449e-07, 1.665424e-06, 5.026737e-06, 3.854774e-04, 2.646096e-05],
                [8.345081e-09, 2.159576e-07, 9.719948e-07, 2.785206e-06, 1.777159e-04, 1.372982e-06],
            ],
        },
        Ross {
            beam: beam(
                vec![section(300.0, 30.0, 0.0)],
                vec![support(50.0, 1.5e8, 800.0), support(220.0, 1.0e8, 1200.0)],
            ),
            discs: [disc(130.0, 1.5, 1.4e-3, 2.2e-3), disc(290.0, 6.0, 2.1e-2, 4.0e-2)],
            standstill: [187.637697, 601.885602, 946.509517, 2177.056211, 2793.713549, 5741.783571],
            whirl: [
                [131.617665, 544.107719, 938.021795, 2142.184480, 2727.216853, 5725.903915],
                [252.196223, 698.499336, 965.553140, 2206.739010, 2868.673164, 5758.776196],
            ],
            response: [
                [9.902549e-09, 2.551726e-07, 1.172980e-06, 4.329293e-06, 3.218174e-06, 3.538318e-06],
                [1.416962e-08, 3.875509e-07, 2.115681e-06, 1.004376e-05, 1.472362e-05, 9.898541e-06],
            ],
        },
    ]
}

const SPEEDS_RAD_PER_S: [f64; 6] = [100.0, 500.0, 1000.0, 1500.0, 2500.0, 5000.0];

/// Frequencies, whirl and unbalance response of a rotor between bearings and of an overhung one,
/// two discs each. Elements of ROSS err by up to 3e-5 here, with the square of their length.
#[test]
fn oracle_rotors_of_ross() {
    let mut worst = [0.0_f64; 3];
    for rotor in of_ross() {
        let found = reduced(&rotor.beam, &rotor.discs);
        let mut far = |which: usize, found: f64, expected: f64| {
            worst[which] = worst[which].max((found / expected - 1.0).abs());
        };
        found.frequencies_hz().iter().zip(rotor.standstill).for_each(|(&hz, expected)| far(0, hz, expected));
        for (whirl, expected) in found.whirl_hz(1000.0).iter().zip(rotor.whirl) {
            whirl.iter().zip(expected).for_each(|(&hz, expected)| far(1, hz, expected));
        }
        for (to, expected) in [&found.seats[0], &found.held[1]].into_iter().zip(rotor.response) {
            for (speed, expected) in SPEEDS_RAD_PER_S.into_iter().zip(expected) {
                far(2, unbalance(&found, (&found.seats[1], to), 1e-4, speed), expected);
            }
        }
    }
    assert!(worst.iter().all(|&far| far < 1e-4), "{worst:?}");
}
