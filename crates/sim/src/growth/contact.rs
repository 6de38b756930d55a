//! What one pair of teeth bears on its way through the mesh: load, pressure and sliding by place on
//! the path of contact, under the static load.

use std::f64::consts::PI;

use crate::geometry::GearGeometry;
use crate::hertz::Material;
use crate::mesh::{Face, MeshModel, MeshState, Pairs};
use crate::tooth::{Root, ToothProfile};

/// Places along the path of contact that a worn profile is known at: half a percent of a path
/// apart, less than the width of the zone where pairs change.
pub const PLACES: usize = 201;

/// Sections of a fillet among which the one that bends most is sought: a hundredth of a fillet
/// moves the stress by less than 0.1 %.
const SECTIONS: usize = 100;

/// Modulus of two equal bodies in contact (Pa): `1/E* = 2 (1 − ν²)/E` (Johnson 1985, Contact
/// Mechanics, 4.2).
pub fn contact_modulus_pa(material: &Material) -> f64 {
    material.youngs_modulus_pa / (2.0 * (1.0 - material.poisson_ratio * material.poisson_ratio))
}

/// One place of the path of contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FlankPoint {
    /// Mesh cycles since the pair's entry.
    pub cycles: f64,
    /// Roll coordinates of the contact on pinion and wheel (m).
    pub rolls_m: [f64; 2],
    /// Force of the pair along the line of action (N).
    pub load_n: f64,
    /// Half of the width of the contact, `a = √(4 F' R/(π E*))` (m), with the load per width F' and
    /// the curvature `1/R = cos β_b (1/ξ₁ + 1/ξ₂)`.
    pub half_width_m: f64,
    /// Largest pressure `p₀ = √(F' E*/(π R))` (Pa).
    pub largest_pressure_pa: f64,
    /// Mean pressure over the width, `F'/(2a) = π p₀/4` (Pa).
    pub mean_pressure_pa: f64,
    /// Way that the other flank slides over a point of pinion and wheel while it is in contact,
    /// `2a |1 − v₂/v₁|` and `2a |1 − v₁/v₂|` (m); `v = ω ξ` is the speed of the contact along each
    /// flank (Flodin & Andersson 1997, "single point observation").
    pub sliding_m: [f64; 2],
}

impl FlankPoint {
    /// The place at `cycles` of spur teeth with a load `load_n` over a width `length_m`.
    pub fn new(mesh: &MeshModel, cycles: f64, load_n: f64, length_m: f64) -> Self {
        Self::inclined(mesh, cycles, load_n, length_m, 0.0)
    }

    /// The place at `cycles` of teeth inclined by β_b on the base cylinder, with `load_n` along the
    /// transverse line of action over a width `length_m`.
    ///
    /// # Formula
    /// The contact line is `b / cos β_b` long and bears `F / cos β_b` along the normal: the load
    /// per length is `F' = F/b`. Across the line the flanks curve by `cos β_b` of their curvature
    /// in the transverse section (the `cos β_b` in Z_H of ISO 6336-2). The axes are parallel, so
    /// that the flanks slide and roll across the line, with the speeds `ω ξ` of the transverse
    /// section.
    pub fn inclined(mesh: &MeshModel, cycles: f64, load_n: f64, length_m: f64, base_helix_rad: f64) -> Self {
        let pair = mesh.geometry();
        let modulus = contact_modulus_pa(mesh.material());
        let rolls_m = pair.rolls_m(cycles);
        let per_width = load_n / length_m;
        let [own, other] = rolls_m.map(|roll| roll.max(0.0));
        let radius = own * other / ((own + other).max(f64::MIN_POSITIVE) * base_helix_rad.cos());
        let half_width_m = (4.0 * per_width * radius / (PI * modulus)).sqrt();
        let largest_pressure_pa =
            if radius > 0.0 { (per_width * modulus / (PI * radius)).sqrt() } else { f64::INFINITY };
        let mean_pressure_pa = 0.25 * PI * largest_pressure_pa;
        // Speeds of the contact along the flanks, per speed of the pitch line. Where it stands
        // still, on a base circle, a point is passed by half of the contact's width.
        let speed = |roll: f64, gear: &GearGeometry| roll.max(half_width_m).max(f64::MIN_POSITIVE) / gear.base_radius_m;
        let [v1, v2] = [speed(own, &pair.pinion), speed(other, &pair.wheel)];
        let slid = |of: f64, by: f64| 2.0 * half_width_m * (1.0 - by / of).abs();
        Self {
            cycles,
            rolls_m,
            load_n,
            half_width_m,
            largest_pressure_pa,
            mean_pressure_pa,
            sliding_m: [slid(v1, v2), slid(v2, v1)],
        }
    }
}

/// Force (N) of the pair with number `index` at each place of its path, entry first, while all
/// pairs carry `force_n` together. `opened_m` is the further gap of a pair `s` mesh cycles after
/// its entry.
pub fn pair_loads(
    mesh: &MeshModel,
    force_n: f64,
    index: i64,
    places: usize,
    opened_m: impl Fn(f64) -> f64,
) -> Vec<f64> {
    let (load, pair) = (mesh.at_load(force_n), mesh.geometry());
    let mut pairs = Pairs::default();
    (0..places)
        .map(|i| {
            let s = pair.contact_ratio * i as f64 / (places.max(2) - 1) as f64;
            let state = MeshState { phase: index as f64 + s, displacement_m: [0.0; 2] };
            mesh.pairs_at(&state, &load, &mut pairs);
            pairs.open(|p| opened_m(pair.climb() * (p.pinion_roll_m - pair.entry_roll_m) / pair.base_pitch_m));
            let Some((approach, _)) = pairs.approach_at(force_n) else { return 0.0 };
            let force = pairs.force(approach);
            let own = pairs.as_slice().iter().position(|p| p.index == index);
            own.map_or(0.0, |own| force.pair_forces_n[own].max(0.0))
        })
        .collect()
}

/// Phases of a mesh cycle at which the approach of a whole face is solved for; straight between
/// them, as between [`PLACES`].
const PHASES: usize = 200;

/// Load of helical teeth that are all alike, while all slices of their face carry a force together.
#[derive(Clone, Debug)]
pub struct FaceLoads {
    /// By band of equal width along the face, the end that enters first in front, and by place of
    /// the path, entry first: force (N) of a pair along the transverse line of action if all of the
    /// face carried as the band does.
    pub bands_n: Vec<Vec<f64>>,
    /// By phase of the mesh cycle: pairs that carry, as a mean over the face.
    carrying: Vec<f64>,
}

impl FaceLoads {
    /// Under `force_n`. `opened_m` is the further gap of a pair in a band, so many mesh cycles
    /// after its entry there.
    pub fn new(
        mesh: &MeshModel,
        face: &Face,
        force_n: f64,
        (bands, places): (usize, usize),
        opened_m: impl Fn(usize, f64) -> f64,
    ) -> Self {
        let (load, pair) = (face.at_load(mesh, force_n), mesh.geometry());
        let slices = face.count() as usize;
        let band = |slice: usize| slice * bands / slices;
        let open = |pairs: &mut Pairs, slice: usize| {
            pairs.open(|p| {
                let cycles = pair.climb() * (p.pinion_roll_m - pair.entry_roll_m) / pair.base_pitch_m;
                opened_m(band(slice), cycles)
            });
        };
        // Numbers of pairs stay above 0.
        let first = face.overlap_ratio().ceil() + pair.contact_ratio.ceil();
        let state = |phase: f64| MeshState { phase: first + phase, displacement_m: [0.0; 2] };
        let (approaches, carrying): (Vec<f64>, Vec<f64>) = (0..PHASES)
            .map(|i| {
                let mut found = face.pairs(mesh, &state(i as f64 / PHASES as f64), &load);
                found.iter_mut().enumerate().for_each(|(slice, (pairs, _))| open(pairs, slice));
                let approach = Face::approach_of(&found, force_n).map_or(f64::NEG_INFINITY, |(approach, _)| approach);
                let count = |(pairs, gap): &(Pairs, f64)| pairs.force(approach - gap).set.count_ones();
                (approach, found.iter().map(count).sum::<u32>() as f64 / slices as f64)
            })
            .unzip();
        let mut bands_n = vec![vec![0.0; places]; bands];
        let mut slices_in = vec![0.0; bands];
        let mut pairs = Pairs::default();
        for (slice, cut) in face.cuts(mesh).enumerate() {
            slices_in[band(slice)] += 1.0;
            for (i, sum) in bands_n[band(slice)].iter_mut().enumerate() {
                let s = pair.contact_ratio * i as f64 / (places.max(2) - 1) as f64;
                let phase = s + cut.lag;
                cut.mesh.pairs_behind(&state(phase), cut.lag, &load, &mut pairs);
                open(&mut pairs, slice);
                let force = pairs.force(over_a_cycle(&approaches, phase) - cut.gap_m);
                let own = pairs.as_slice().iter().position(|p| p.index == first as i64);
                *sum += own.map_or(0.0, |own| force.pair_forces_n[own].max(0.0));
            }
        }
        for (band, count) in bands_n.iter_mut().zip(slices_in) {
            band.iter_mut().for_each(|force| *force /= f64::max(count, 1.0));
        }
        Self { bands_n, carrying }
    }

    /// Pairs that carry at a phase, as a mean over the face: the length of all contact lines by the
    /// face width, along the axis.
    pub fn pairs_that_carry(&self, phase: f64) -> f64 {
        over_a_cycle(&self.carrying, phase)
    }
}

/// Straight between values at equally spaced phases of a mesh cycle.
fn over_a_cycle(values: &[f64], phase: f64) -> f64 {
    let x = phase.rem_euclid(1.0) * values.len() as f64;
    let before = x as usize % values.len();
    values[before] + x.fract() * (values[(before + 1) % values.len()] - values[before])
}

/// The section at the root of a tooth where bending is largest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RootSection {
    height_m: f64,
    half_m: f64,
}

impl RootSection {
    /// Where a parabola from the tip's load touches the generated fillet (Lewis 1893): the largest
    /// of `(y − y_f)/h²`. Of a tooth without one, the narrowest section.
    pub fn new(gear: &GearGeometry) -> Self {
        let profile = ToothProfile::new("gear", gear, Root::Fillet, &mut Vec::new());
        let angle = gear.load_angle_rad(gear.roll_at_radius_m(gear.tip_radius_m));
        let (height, half) = gear.flank_point_m(angle);
        // Where the force crosses the tooth's centre line.
        let vertex = height - half * angle.tan();
        let bent = |&(y, h): &(f64, f64)| (vertex - y) / (h * h);
        let sections = profile.fillet_sections(SECTIONS);
        let narrow = gear.half_root_m();
        let low = (gear.root_radius_m * gear.root_radius_m - narrow * narrow).max(0.0).sqrt();
        let (height_m, half_m) =
            sections.into_iter().max_by(|a, b| bent(a).total_cmp(&bent(b))).unwrap_or((low, narrow));
        Self { height_m, half_m }
    }

    /// Thickness of the tooth there (m).
    pub fn thickness_m(&self) -> f64 {
        2.0 * self.half_m
    }

    /// Nominal stresses (Pa) there of a tooth whose flank carries `load_n` at a roll coordinate:
    /// bending, and compression by the radial part of the load.
    ///
    /// # Formula
    /// `σ_b = 6 M/(L t²)`, `M = F [cos α₁ (y_C − y_f) − sin α₁ h_C]`, `σ_c = F sin α₁/(L t)`.
    pub fn stresses_pa(&self, gear: &GearGeometry, roll_m: f64, load_n: f64) -> [f64; 2] {
        let angle = gear.load_angle_rad(roll_m);
        let (height, half) = gear.flank_point_m(angle);
        let thickness = self.thickness_m();
        let moment = load_n * (angle.cos() * (height - self.height_m) - angle.sin() * half);
        let bending = 6.0 * moment / (gear.face_width_m * thickness * thickness);
        [bending, load_n * angle.sin() / (gear.face_width_m * thickness)]
    }
}
