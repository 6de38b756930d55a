//! Kinematics of the gear train: speeds of all shafts and mesh orders, relative to the input shaft.
//!
//! Everything that looks for lines asks here, so that one description of the stages decides for
//! all: the signal path, the check, the indicators, pictures.

use crate::bench::{Bench, Stage};
use crate::verdict::HARMONICS;

pub mod planetary;

pub use planetary::PlanetarySet;

/// Kinematics of one gear stage.
#[derive(Clone, Debug, PartialEq)]
pub struct StageKinematics {
    /// Stage name.
    pub name: String,
    /// Teeth of the driving gear; of the sun in a planetary stage.
    pub pinion_teeth: u32,
    /// Teeth of the driven gear; of the ring in a planetary stage.
    pub wheel_teeth: u32,
    /// Speed of the stage's first shaft / input-shaft speed.
    pub pinion_order: f64,
    /// Speed of its second shaft / input-shaft speed.
    pub wheel_order: f64,
    /// Mesh frequency / input-shaft speed.
    pub mesh_order: f64,
    /// Speed of the second shaft / that of the first, as a fraction.
    pub ratio: (u32, u32),
    /// The second shaft turns against the first.
    pub reverses: bool,
    /// Teeth of each idler and its speed / input-shaft speed.
    pub idlers: Vec<(u32, f64)>,
    /// What a planetary stage has besides.
    pub planetary: Option<PlanetarySet>,
}

impl StageKinematics {
    /// An external pair whose pinion turns at `pinion_order`.
    pub fn pair(name: &str, pinion_teeth: u32, wheel_teeth: u32, pinion_order: f64) -> Self {
        Self {
            name: name.to_owned(),
            pinion_teeth,
            wheel_teeth,
            pinion_order,
            wheel_order: pinion_order * f64::from(pinion_teeth) / f64::from(wheel_teeth),
            mesh_order: pinion_order * f64::from(pinion_teeth),
            ratio: (pinion_teeth, wheel_teeth),
            reverses: true,
            idlers: Vec::new(),
            planetary: None,
        }
    }

    /// A stage whose first shaft turns at `order`. Helix and internal teeth change neither speeds
    /// nor mesh frequency; an idler of `z` teeth turns at `n z_pinion / z`.
    fn new(stage: &Stage, order: f64) -> Self {
        let (first, second) = (stage.pinion.teeth, stage.wheel.teeth);
        let mut out = Self::pair(&stage.name, first, second, order);
        let gearing = &stage.gearing;
        // Each external mesh turns the sense.
        let external = gearing.idlers.len() + usize::from(!gearing.internal);
        out.reverses = external % 2 == 1;
        out.idlers = gearing.idlers.iter().map(|gear| (gear.teeth, out.mesh_order / f64::from(gear.teeth))).collect();
        if let Some(set) = &gearing.planetary {
            let whole = planetary::speeds(first, second, set.fixed);
            let planetary = PlanetarySet::new(first, second, set, order);
            let speed = |member| whole[planetary::position(member)];
            let magnitude = |member| u32::try_from(speed(member).unsigned_abs()).unwrap_or(1);
            out.ratio = (magnitude(set.output), magnitude(set.input));
            out.reverses = speed(set.output) * speed(set.input) < 0;
            out.wheel_order = planetary.order_of(set.output).abs();
            out.mesh_order = f64::from(first) * (planetary.sun_order - planetary.carrier_order).abs();
            out.planetary = Some(planetary);
        }
        out
    }

    /// Order of the line that is read as harmonic `k` (from 1): `k` times the mesh order; in a
    /// planetary stage the line nearest to it that the planets leave.
    pub fn harmonic_order(&self, k: usize) -> f64 {
        let shift = self.planetary.as_ref().and_then(|set| set.shifts.get(k.wrapping_sub(1)));
        k as f64 * self.mesh_order + shift.unwrap_or(&0.0)
    }

    /// All lines that are read as harmonics, from 1x.
    pub fn harmonic_orders(&self) -> [f64; HARMONICS] {
        std::array::from_fn(|h| self.harmonic_order(h + 1))
    }

    /// The harmonics are whole multiples of the first.
    pub fn is_comb(&self) -> bool {
        self.planetary.as_ref().is_none_or(|set| set.shifts == [0.0; HARMONICS])
    }

    /// Lines beside harmonic `k` (from 1) that a healthy stage shows, besides the sidebands of both
    /// shafts, from the harmonic's line: those that planets make as they pass, the first sidebands
    /// of idlers.
    pub fn beside(&self, k: usize) -> Vec<f64> {
        let mut out: Vec<f64> = self.idlers.iter().flat_map(|&(_, order)| [-order, order]).collect();
        let passes = self.planetary.as_ref().and_then(|set| set.beside.get(k.wrapping_sub(1)));
        out.extend(passes.into_iter().flatten());
        out
    }

    /// Tooth meshes after which the same teeth meet again, by the two gears of the pair (for a
    /// planetary stage sun and planet); the hunting-tooth order is the mesh order divided by it.
    pub fn hunting_meshes(&self) -> u64 {
        let gcd = |mut a: u64, mut b: u64| {
            while b > 0 {
                (a, b) = (b, a % b);
            }
            a
        };
        let first = u64::from(self.pinion_teeth);
        let mate = self.idlers.first().map(|idler| idler.0).or(self.planetary.as_ref().map(|set| set.planet_teeth));
        let second = u64::from(mate.unwrap_or(self.wheel_teeth));
        first / gcd(first, second).max(1) * second
    }
}

/// Kinematics of the whole train. Orders are multiples of the input shaft's speed.
#[derive(Clone, Debug, PartialEq)]
pub struct Train {
    /// Motor speed / input-shaft speed: the belt ratio, 1 without a belt.
    pub motor_order: f64,
    /// Speed of each shaft / input-shaft speed, with its name, from motor to brake.
    pub shafts: Vec<(String, f64)>,
    /// From motor to brake.
    pub stages: Vec<StageKinematics>,
    /// Input-shaft speed at the motor's nominal speed (Hz).
    pub nominal_input_hz: f64,
}

impl Train {
    /// Kinematics of a bench: for a pair `n_(i+1) = n_i z_pinion / z_wheel`, mesh order
    /// `n_i z_pinion`; for a planetary stage see [`planetary`].
    pub fn new(bench: &Bench) -> Self {
        let motor_order = bench.belt.as_ref().map_or(1.0, |belt| belt.ratio);
        let mut order = 1.0;
        let mut shafts = Vec::with_capacity(bench.shafts.len());
        let mut stages = Vec::with_capacity(bench.stages.len());
        for (i, shaft) in bench.shafts.iter().enumerate() {
            shafts.push((shaft.name.clone(), order));
            if let Some(stage) = bench.stages.get(i) {
                let kinematics = StageKinematics::new(stage, order);
                order = kinematics.wheel_order;
                stages.push(kinematics);
            }
        }
        Self { motor_order, shafts, stages, nominal_input_hz: bench.motor.speed_hz / motor_order }
    }

    /// Speed of a shaft (or of `motor`) / input-shaft speed; `None` for an unknown name.
    pub fn shaft_order(&self, name: &str) -> Option<f64> {
        if name == "motor" {
            return Some(self.motor_order);
        }
        self.shafts.iter().find(|(n, _)| n == name).map(|&(_, order)| order)
    }

    /// Gears whose teeth an average over turns of a shaft shows: position of the stage, 0 for
    /// pinion or sun and 1 for wheel or ring, teeth. The carrier's shaft shows the teeth of the
    /// central gear that stands still, for they meet planets at fixed angles of the carrier; a gear
    /// that meets planets which move shows in no average of its own shaft.
    pub fn gears_on(&self, shaft: usize) -> Vec<(usize, usize, u32)> {
        let mut out = Vec::new();
        for (i, stage) in self.stages.iter().enumerate() {
            let teeth = [stage.pinion_teeth, stage.wheel_teeth];
            match &stage.planetary {
                None if shaft == i => out.push((i, 0, teeth[0])),
                None if shaft == i + 1 => out.push((i, 1, teeth[1])),
                Some(set) if shaft == i || shaft == i + 1 => {
                    let member = if shaft == i { set.input } else { set.output };
                    if let Some(side) = set.side_seen_by(member) {
                        out.push((i, side, teeth[side]));
                    }
                }
                _ => {}
            }
        }
        // A shaft's own driving gear first.
        out.sort_by_key(|gear| std::cmp::Reverse(gear.0));
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::Bench;

    fn bench(stages: serde_json::Value, belt: Option<f64>) -> Bench {
        let names = ["input", "intermediate", "output", "fourth"];
        let count = stages.as_array().map_or(0, Vec::len);
        let shafts: Vec<_> = names[..=count].iter().map(|name| serde_json::json!({ "name": name })).collect();
        let mut text = serde_json::json!({
            "format": crate::bench::FORMAT, "name": "b", "motor": { "speed_hz": 30.0 }, "shaft": shafts, "stage": stages,
        });
        if let Some(ratio) = belt {
            text["belt"] = serde_json::json!({ "ratio": ratio });
        }
        let bench: Bench = serde_json::from_value(text).expect("a bench");
        assert_eq!(bench.problems(), Vec::<String>::new());
        bench
    }

    /// 34 teeth behind a 1:3.56 belt at 30 Hz mesh at 286.5 Hz (the paper's simulated mesh line is
    /// 286 Hz).
    #[test]
    fn literature_mesh_frequency_of_the_papers_bench() {
        let stages = serde_json::json!([
            { "name": "stage1", "pinion": { "teeth": 34 }, "wheel": { "teeth": 73 } },
            { "name": "stage2", "pinion": { "teeth": 36 }, "wheel": { "teeth": 90 } },
        ]);
        let train = Train::new(&bench(stages, Some(3.56)));
        let mesh_hz = train.stages[0].mesh_order * train.nominal_input_hz;
        assert!((mesh_hz - 286.517).abs() < 1e-3, "{mesh_hz}");
        let output = train.shaft_order("output").unwrap();
        assert!((output - 34.0 / 73.0 * 36.0 / 90.0).abs() < 1e-15);
        assert_eq!(train.shaft_order("motor"), Some(3.56));
        assert_eq!(train.gears_on(1), [(1, 0, 36), (0, 1, 73)]);
    }

    /// Bell 206 helicopter: 71/19 (bevel there) at 100 Hz, then sun 27, planets 35, ring 99
    /// standing still. Published are 3.73 and 4.67, 17.45 in all, and 5.73 Hz of the carrier
    /// ("Vibration sideband modulations and harmonics separation of a planetary helicopter gearbox
    /// with two different configurations", Advances in Acoustics and Vibration 2016, 9820768, table
    /// 1).
    #[test]
    fn literature_helicopter_gearbox() {
        let stages = serde_json::json!([
            { "name": "first", "pinion": { "teeth": 19 }, "wheel": { "teeth": 71 } },
            { "name": "planetary", "kind": "planetary", "profile_shifted": true, "sun": { "teeth": 27 }, "planet": { "teeth": 35, "count": 3 }, "ring": { "teeth": 99 } },
        ]);
        let train = Train::new(&bench(stages, None));
        let [sun, carrier] = [1, 2].map(|i: usize| 100.0 * train.shafts[i].1);
        assert!((100.0 / sun - 3.73).abs() < 0.01 && (sun / carrier - 4.67).abs() < 0.005);
        assert!((100.0 / carrier - 17.45).abs() < 0.02 && (carrier - 5.73).abs() < 0.005, "{carrier}");
    }

    /// The layout of a wind turbine: planetary with fixed ring 99, three planets 39, sun 21, driven
    /// at the carrier; then 82/23 and 88/22. By hand (1 + 99/21) 82/23 88/22 = 81.4907, so 22.09
    /// rpm of the rotor at 1800 rpm; the last pinion of 22 teeth meshes at 660 Hz.
    #[test]
    fn analytic_speed_increaser_of_a_wind_turbine() {
        let stages = serde_json::json!([
            { "name": "planetary", "kind": "planetary", "module_mm": 10.0, "fixed": "ring", "in": "carrier", "out": "sun",
              "sun": { "teeth": 21 }, "planet": { "teeth": 39, "count": 3 }, "ring": { "teeth": 99 } },
            { "name": "second", "kind": "helical", "helix_angle_deg": 14.0, "pinion": { "teeth": 82 }, "wheel": { "teeth": 23 } },
            { "name": "high", "kind": "helical", "helix_angle_deg": 14.0, "pinion": { "teeth": 88 }, "wheel": { "teeth": 22 } },
        ]);
        let train = Train::new(&bench(stages, None));
        let total = train.shafts[3].1;
        assert!((total - 81.4907).abs() < 5e-5, "{total}");
        let input_hz = 30.0 / total;
        assert!((60.0 * input_hz - 22.09).abs() < 5e-3, "{}", 60.0 * input_hz);
        assert!((train.stages[0].mesh_order - 99.0).abs() < 1e-12);
        assert!((train.stages[2].mesh_order * input_hz - 660.0).abs() < 1e-9);
        // 99 is a multiple of three: all planets in phase, the carrier's average shows the ring.
        assert!(train.stages[0].is_comb());
        assert_eq!(train.gears_on(0), [(0, 1, 99)]);
        assert_eq!(train.gears_on(1), [(1, 0, 82)]);
    }

    /// Internal teeth and one idler keep the sense, two idlers turn it; the mesh frequency is that
    /// of the pinion, an idler turns by its own teeth.
    #[test]
    fn analytic_senses_and_idlers() {
        let stages = serde_json::json!([
            { "name": "a", "pinion": { "teeth": 20 }, "wheel": { "teeth": 60, "internal": true } },
            { "name": "b", "pinion": { "teeth": 20 }, "wheel": { "teeth": 40 }, "idlers": [{ "teeth": 25 }] },
            { "name": "c", "pinion": { "teeth": 20 }, "wheel": { "teeth": 40 }, "idlers": [{ "teeth": 25 }, { "teeth": 32 }] },
        ]);
        let train = Train::new(&bench(stages, None));
        assert_eq!(train.stages.iter().map(|stage| stage.reverses).collect::<Vec<_>>(), [false, false, true]);
        let idlers = &train.stages[1].idlers;
        assert!((idlers[0].1 - 20.0 / 3.0 / 25.0).abs() < 1e-15);
        assert_eq!(train.stages[1].beside(1), [-idlers[0].1, idlers[0].1]);
        assert_eq!(train.stages[0].hunting_meshes(), 60);
        assert_eq!(train.stages[1].hunting_meshes(), 100);
    }

    /// 62 teeth of the ring and four planets: lines at 64, 124, 188 (187 is no line), 248 and 312
    /// carrier orders (310 lies half way between 308 and 312).
    #[test]
    fn analytic_harmonics_of_planets_out_of_phase() {
        let stages = serde_json::json!([{ "name": "p", "kind": "planetary",
            "sun": { "teeth": 22 }, "planet": { "teeth": 20, "count": 4 }, "ring": { "teeth": 62 } }]);
        let train = Train::new(&bench(stages, None));
        let (stage, carrier) = (&train.stages[0], train.shafts[1].1);
        assert!((carrier - 22.0 / 84.0).abs() < 1e-15 && !stage.is_comb());
        for (k, m) in [(1, 64.0), (2, 124.0), (3, 188.0), (4, 248.0), (5, 312.0)] {
            assert!((stage.harmonic_order(k) - m * carrier).abs() < 1e-9, "{k}: {}", stage.harmonic_order(k) / carrier);
        }
        let beside: Vec<f64> = stage.beside(1).iter().map(|d| (d / carrier).round()).collect();
        assert_eq!(beside, [-8.0, -4.0, 4.0, 8.0]);
    }
}
