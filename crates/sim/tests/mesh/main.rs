//! The gear pair against formulas, published values and independent computations.

mod components;
mod contact;
mod faults;
mod geometry;
mod reference;
mod shift;
mod stiffness;

use gearwatch_sim::geometry::{GearGeometry, PairGeometry};
use gearwatch_sim::hertz::Material;

/// A gear pair of the literature; all at 20 degrees, ν = 0.3.
struct Specimen {
    pair: PairGeometry,
    material: Material,
}

fn specimen(teeth: [u32; 2], module_m: f64, width_m: f64, bores_m: [f64; 2], youngs_modulus_pa: f64) -> Specimen {
    let alpha = 20_f64.to_radians();
    let gear = |i: usize| GearGeometry::new("gear", teeth[i], module_m, alpha, width_m, bores_m[i]).unwrap();
    Specimen {
        pair: PairGeometry::new(gear(0), gear(1), 0.0).unwrap(),
        material: Material { youngs_modulus_pa, poisson_ratio: 0.3 },
    }
}

/// 19/48 teeth, m = 3.175 mm: the set of Tian, Wu and Liang; its bores are assumed.
fn p1() -> Specimen {
    specimen([19, 48], 3.175e-3, 16e-3, [10e-3, 20e-3], 206.8e9)
}

/// 62/62 teeth, m = 2 mm: the set of Ma 2014.
fn p2() -> Specimen {
    specimen([62, 62], 2e-3, 20e-3, [17.5e-3, 17.5e-3], 206e9)
}
