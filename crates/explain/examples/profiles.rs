//! How each effect spreads its change over the classes of lines, on drawn benches with usual errors of the teeth.

use gearwatch_core::train::Train;
use gearwatch_explain::prove::draw::{self, Draw};
use gearwatch_explain::prove::machine::real;
use gearwatch_explain::read::lines::of_train;
use gearwatch_explain::score::relation::{RELATIONS, Relation};
use gearwatch_sim::effects::{self, Place};
use gearwatch_sim::steady::{SteadyOptions, SteadySolver};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

fn main() {
    let benches: u64 = std::env::args().nth(1).and_then(|a| a.parse().ok()).unwrap_or(4);
    let ids = [
        "eccentricity",
        "pitch_error",
        "tooth_breakage",
        "root_crack",
        "pitting",
        "profile_error",
        "tip_relief",
        "tooth_wear",
        "misalignment",
        "mesh_stiffness",
        "load_dependent_stiffness",
        "body_coupling",
        "damping",
        "bearing_compliance",
        "shaft_torsion",
        "unbalance",
        "torque_ripple",
        "speed_fluctuation",
        "ghost_component",
        "tooth_friction",
        "looseness",
    ];
    for id in ids {
        let mut values: Vec<Vec<f64>> = vec![Vec::new(); RELATIONS.len()];
        let mut tops = Vec::new();
        for b in 0..benches {
            let mut d = Draw(ChaCha8Rng::seed_from_u64(9000 + b));
            let bench = draw::bench(&mut d);
            let before = real(&mut d, &bench, 0.6);
            let Some(spec) = draw::effect(&mut d, &bench, id) else { continue };
            let mut after = before.clone();
            if effects::apply(&spec, &mut after).is_err() {
                continue;
            }
            let Ok(effect) = effects::find(id) else { continue };
            let Ok(place) = Place::parse(&spec.place, effect, &bench) else { continue };
            let train = Train::new(&bench);
            let lines = of_train(&train, bench.belt.is_some(), 0.002);
            let orders: Vec<f64> = lines.iter().map(|l| l.order).collect();
            let options = SteadyOptions { samples_per_cycle: 128, tolerance: 1e-3, together: false };
            for (speed, load) in [(1.0, 1.0), (0.7, 0.6)] {
                let mut solver = SteadySolver::new(options);
                let (hz, torque) = (speed * bench.motor.speed_hz, load * bench.brake.torque_nm);
                let Ok(x) = solver.solve(&before, hz, torque, 1, &orders) else { continue };
                let Ok(y) = solver.solve(&after, hz, torque, 1, &orders) else { continue };
                let mut by: Vec<Vec<f64>> = vec![Vec::new(); RELATIONS.len()];
                for s in 0..bench.sensors.len() {
                    // What lies 60 dB below the strongest line is noise.
                    let top = x.sensors[s].iter().map(|z| z.norm()).fold(0.0, f64::max) * 5e-4;
                    for (k, l) in lines.iter().enumerate() {
                        let (p, q) = (x.sensors[s][k].norm(), y.sensors[s][k].norm());
                        if p.max(q) > 3.0 * top && l.order * x.first_shaft_hz < 7000.0 {
                            let r = RELATIONS
                                .iter()
                                .position(|r| *r == Relation::of(l.family, place, bench.stages.len()))
                                .unwrap_or(0);
                            by[r].push((q.max(top) / p.max(top)).ln().abs());
                        }
                    }
                }
                let med: Vec<Option<f64>> = by
                    .iter_mut()
                    .map(|v| {
                        if v.is_empty() {
                            return None;
                        }
                        v.sort_by(f64::total_cmp);
                        Some(v[v.len() / 2])
                    })
                    .collect();
                let top = med.iter().flatten().copied().fold(0.0, f64::max);
                if top < 0.02 {
                    continue;
                }
                tops.push(top);
                for (r, m) in med.iter().enumerate() {
                    if let Some(m) = m {
                        values[r].push((m / top).max(0.003));
                    }
                }
            }
        }
        let text: Vec<String> = values
            .iter()
            .map(|v| {
                if v.is_empty() {
                    " -   ".into()
                } else {
                    format!("{:.3}", (v.iter().map(|x| x.ln()).sum::<f64>() / v.len() as f64).exp())
                }
            })
            .collect();
        println!(
            "{id:26} n {:2} top {:.2}  {}",
            tops.len(),
            tops.iter().sum::<f64>() / tops.len().max(1) as f64,
            text.join(" ")
        );
    }
}
