//! Lines, load laws and speed laws as measured on simulated runs.

use gearwatch_core::bench::{Bench, HousingMode};
use gearwatch_sim::mesh::MeshModel;

use super::*;

/// Torque and speed of the second operating points: a factor that a law shows in, small enough to
/// keep every mesh closed.
pub(crate) const LOAD_FACTOR: f64 = 1.6;
const SPEED_FACTOR: f64 = 1.2;
/// Undeclared lines may move by this much of the strongest declared change: a train is one
/// mechanical system, and what happens at one line leaks a little into all others through the
/// modulation of the mesh stiffness.
pub(crate) const LEAK: f64 = 0.25;
/// A law holds when the exponent comes out within this of the declared one.
pub(crate) const EXPONENT: f64 = 0.3;

pub(crate) struct Runs {
    point: (f64, f64),
    pub(crate) with: Rendered,
    pub(crate) without: Rendered,
}

impl Runs {
    pub(crate) fn new(setup: &SimSetup, base: &SimSetup, motor_hz: f64, torque_nm: f64) -> Self {
        let with = run(setup, motor_hz, torque_nm);
        let without = run(base, motor_hz, torque_nm);
        Self { point: (motor_hz, torque_nm), with, without }
    }

    /// Change of a line in a sensor.
    pub(crate) fn change(&self, sensor: usize, at: Line) -> f64 {
        let hz = self.point.0;
        (amplitude(&self.with, sensor, at, hz) - amplitude(&self.without, sensor, at, hz)).norm()
    }

    /// Largest change of amplitude, phase left out: the train may come to run at another tooth
    /// position.
    fn loudest(&self, sensor: usize, lines: &[Line]) -> (f64, Option<Line>) {
        let loudness = |run: &Rendered, at: Line| amplitude(run, sensor, at, self.point.0).norm();
        let change = |at: Line| ((loudness(&self.with, at) - loudness(&self.without, at)).abs(), Some(at));
        lines.iter().map(|&at| change(at)).fold((0.0, None), |a, b| if b.0 > a.0 { b } else { a })
    }

    fn largest(&self, sensor: usize, lines: &[Line]) -> f64 {
        lines.iter().map(|&at| self.change(sensor, at)).fold(0.0, f64::max)
    }
}

/// Lines that a train can have: harmonics of its shafts, mesh harmonics with sidebands, and places
/// where it should have none.
pub(crate) fn all_lines(train: &Train) -> Vec<Line> {
    let mut out = Vec::new();
    for &(_, order) in &train.shafts {
        out.extend((1..=6).map(|k| Line::Order(f64::from(k) * order)));
    }
    for stage in &train.stages {
        for h in 1..=5 {
            let mesh = f64::from(h) * stage.mesh_order;
            out.push(Line::Order(mesh));
            for spacing in [stage.pinion_order, stage.wheel_order] {
                out.extend([-2.0, -1.0, 1.0, 2.0].map(|k| Line::Order(mesh + k * spacing)));
            }
            out.push(Line::Order(mesh + 7.37));
        }
    }
    out.push(Line::Hertz(61.3));
    out
}

/// Sidebands of the mesh lines, eight on each side, at the spacing of the gear that a place names.
pub(crate) fn comb(train: &Train, place: &str) -> Vec<Line> {
    let Some(stage) = train.stages.first() else { return Vec::new() };
    let spacing = match place.rsplit('.').next() {
        Some("pinion") => stage.pinion_order,
        Some("wheel") => stage.wheel_order,
        _ => return Vec::new(),
    };
    let beside = |h: u32| (-8..=8).map(move |k| (h, k));
    let lines = (1..=5).flat_map(beside);
    lines.map(|(h, k)| Line::Order(f64::from(h) * stage.mesh_order + f64::from(k) * spacing)).collect()
}

pub(crate) fn same(a: Line, b: Line, first_shaft_hz: f64) -> bool {
    // Two lines within three bins of the record are one.
    let hz = |at: Line| at.recorded_hz(first_shaft_hz, 16_384.0);
    (hz(a) - hz(b)).abs() < 3.0 / RECORD_S
}

pub(crate) fn exponent(low: f64, high: f64, factor: f64) -> f64 {
    (high / low).ln() / factor.ln()
}

fn check(effect: &'static dyn Effect) {
    let bench = bench();
    let places = Place::of(effect, &bench);
    if places.is_empty() {
        // A place that only other benches have, such as a belt.
        return check_shift_behind_a_belt(effect);
    }
    for (place, at) in places {
        match at {
            // A wheel with another number of teeth shifts what comes behind it, and this bench has
            // nothing there.
            Place::Gear { wheel: true, .. } if effect.id() == "wrong_tooth_count" => {}
            Place::Housing => check_at(effect, &place, &with_housing(bench.clone())),
            _ => check_at(effect, &place, &bench),
        }
    }
}

/// The bench with two modes of its housing.
fn with_housing(mut bench: Bench) -> Bench {
    for (frequency_hz, sign) in [(900.0, 1.0), (1700.0, -1.0)] {
        let shape = [("input", 0.7), ("output", 0.5 * sign), ("acc_1", 0.6), ("acc_2", -0.4)];
        bench.housing_modes.push(HousingMode {
            frequency_hz,
            damping_ratio: 0.03,
            mass_kg: 30.0,
            shape: shape.map(|(name, value)| (name.to_owned(), value)).into(),
        });
    }
    bench
}

/// The sensor that sees an effect best: its own, or that of its shaft.
fn sensor_for(place: &str, bench: &Bench) -> usize {
    bench.sensors.iter().position(|sensor| sensor.name == place || sensor.shaft == place).unwrap_or(0)
}

fn check_at(effect: &'static dyn Effect, place: &str, bench: &Bench) {
    let train = Train::new(bench);
    let spec = spec(effect, place);
    let base = SimSetup::nominal(bench);
    let mut setup = base.clone();
    effects::apply(&spec, &mut setup).unwrap_or_else(|e| panic!("{e}"));
    let (_, values) = effects::resolve(&spec, bench).expect("resolves");
    let signature = effect.signature(&values, bench);
    let id = effect.id();
    assert!(!signature.lines.is_empty(), "{id} declares no line");
    let runs = Runs::new(&setup, &base, MOTOR_HZ, TORQUE_NM);
    let sensor = sensor_for(place, bench);
    match id {
        "backlash" => return check_backlash(&setup, &base, &runs, &signature.lines),
        "bearing_defect" => {
            check_passages(id, sensor, &runs, &signature.lines);
            return check_load_zone(&values, bench, sensor);
        }
        "looseness" => return check_play(place, bench, sensor, &signature.lines),
        _ => {}
    }
    match signature.change {
        Change::Shifts => return check_shift(effect, &values, &runs, &train),
        Change::Path => return check_path(place, sensor, (&setup, &base), &runs, &signature.lines),
        Change::Rises | Change::Alters => {}
    }
    let declared = runs.largest(sensor, &signature.lines);
    // What happens once per revolution of a gear makes a comb that goes on beyond the sidebands
    // that are declared.
    let comb = comb(&train, place);
    let stays: Vec<Line> = all_lines(&train)
        .into_iter()
        .filter(|&at| !signature.lines.iter().chain(&comb).any(|&d| same(at, d, MOTOR_HZ)))
        .collect();
    let (elsewhere, worst) = runs.loudest(sensor, &stays);
    assert!(declared > 1e-7, "{id} at {place}: its declared lines change by {declared:.2e} m/s² only");
    assert!(
        elsewhere < LEAK * declared,
        "{id} at {place}: declared lines change by {declared:.2e}, others by up to {elsewhere:.2e} m/s² ({worst:?})"
    );
    if signature.change == Change::Rises {
        let rise = signature
            .lines
            .iter()
            .map(|&at| {
                amplitude(&runs.with, sensor, at, MOTOR_HZ).norm()
                    - amplitude(&runs.without, sensor, at, MOTOR_HZ).norm()
            })
            .fold(0.0, f64::max);
        assert!(rise > 0.25 * declared, "{id} at {place}: lines change by {declared:.2e} but rise by {rise:.2e} m/s²");
    }
    if let Law::Power(_) | Law::Independent = signature.load {
        let expected = if let Law::Power(p) = signature.load { p } else { 0.0 };
        let loaded = Runs::new(&setup, &base, MOTOR_HZ, LOAD_FACTOR * TORQUE_NM);
        let found = exponent(declared, loaded.largest(sensor, &signature.lines), LOAD_FACTOR);
        assert!(
            (found - expected).abs() < EXPONENT,
            "{id} at {place}: grows with torque^{found:.2}, declared {expected}"
        );
    }
    if signature.load == Law::ShaftOrders {
        let loaded = Runs::new(&setup, &base, MOTOR_HZ, LOAD_FACTOR * TORQUE_NM);
        let below_mesh = |at: &&Line| matches!(at, Line::Order(order) if *order < 0.5 * train.stages[0].mesh_order);
        let orders: Vec<Line> = signature.lines.iter().filter(below_mesh).copied().collect();
        let found = exponent(runs.largest(sensor, &orders), loaded.largest(sensor, &orders), LOAD_FACTOR);
        // Measured 0.00 to 0.02: a tenth would be a law.
        assert!(found.abs() < 0.1, "{id} at {place}: its shaft orders grow with torque^{found:.2}");
    }
    if let SpeedLaw::Power(_) | SpeedLaw::Independent = signature.speed {
        let expected = if let SpeedLaw::Power(p) = signature.speed { p } else { 0.0 };
        let faster = Runs::new(&setup, &base, SPEED_FACTOR * MOTOR_HZ, TORQUE_NM);
        let found = exponent(declared, faster.largest(sensor, &signature.lines), SPEED_FACTOR);
        assert!(
            (found - expected).abs() < EXPONENT,
            "{id} at {place}: grows with speed^{found:.2}, declared {expected}"
        );
    }
}

/// The mesh line moves by one factor: it stands where it should now, and is gone from where it was.
fn check_shift(effect: &dyn Effect, values: &Values, runs: &Runs, train: &Train) {
    let moved = match effect.id() {
        "clock_offset" => 1.0 / (1.0 + 1e-6 * values.get("ppm")),
        "belt_slip" => 1.0 - 1e-2 * values.get("slip_percent"),
        "wrong_tooth_count" => values.get("teeth") / f64::from(train.stages[0].pinion_teeth),
        id => panic!("{id} declares a shift; say here by which factor"),
    };
    let hz = train.stages[0].mesh_order * runs.point.0 / train.motor_order;
    let at = |run: &Rendered, hz: f64| amplitude(run, 0, Line::Hertz(hz), 1.0).norm();
    let (before, after, left) = (at(&runs.without, hz), at(&runs.with, hz * moved), at(&runs.with, hz));
    let id = effect.id();
    assert!(after > 0.3 * before, "{id}: {before:.2e} at {hz} Hz before, {after:.2e} where it should be now");
    assert!(left < 0.1 * after, "{id}: {left:.2e} left at {hz} Hz, {after:.2e} where it should be now");
}

/// A defect's passages slip, so its lines are in the power of what it adds, not in its waveform:
/// the squared difference has a line at the passage order and none beside it.
fn check_passages(id: &str, sensor: usize, runs: &Runs, lines: &[Line]) {
    let square: Vec<f64> =
        runs.with.samples[sensor].iter().zip(&runs.without.samples[sensor]).map(|(a, b)| (a - b) * (a - b)).collect();
    let mean = square.iter().sum::<f64>() / square.len() as f64;
    let Some(&Line::Order(order)) = lines.first() else { panic!("{id} declares no order") };
    let part = |order: f64| line(&square, &runs.with.angles_rad, order).norm() / mean;
    assert!(part(order) > 0.4, "{id}: {:.2} at its order {order}", part(order));
    for beside in [0.63, 1.31] {
        assert!(
            part(beside * order) < 0.25 * part(order),
            "{id}: {:.2} at {beside} of its order",
            part(beside * order)
        );
    }
}

/// What a defect adds goes with the load; on the inner race it comes and goes with the turns of the
/// shaft, on the outer race it does not.
fn check_load_zone(values: &Values, bench: &Bench, sensor: usize) {
    let Place::Shaft(shaft) = values.place() else { panic!("a shaft") };
    let train = Train::new(bench);
    let (turns, order) = (train.shafts[shaft].1, values.get("order") * train.shafts[shaft].1);
    let power = |inner: f64, torque_nm: f64| {
        let mut setup = SimSetup::nominal(bench);
        let parameters = [("inner".to_owned(), inner)].into();
        let place = bench.shafts[shaft].name.clone();
        effects::apply(&EffectSpec { effect: "bearing_defect".into(), place, parameters }, &mut setup)
            .expect("applies");
        let runs = Runs::new(&setup, &SimSetup::nominal(bench), MOTOR_HZ, torque_nm);
        let square: Vec<f64> = runs.with.samples[sensor]
            .iter()
            .zip(&runs.without.samples[sensor])
            .map(|(a, b)| (a - b) * (a - b))
            .collect();
        let mean = square.iter().sum::<f64>() / square.len() as f64;
        let part = |order: f64| line(&square, &runs.with.angles_rad, order).norm() / mean;
        (mean.sqrt(), part(turns), part(order - turns).max(part(order + turns)))
    };
    let (outer, inner) = (power(0.0, TORQUE_NM), power(1.0, TORQUE_NM));
    // cos³ of half a turn: the first harmonic is 1.6 of the mean power, its sidebands half of it.
    assert!(inner.1 > 1.0 && inner.2 > 0.4, "inner race: {inner:?}");
    assert!(outer.1 < 0.2 && outer.2 < 0.2, "outer race: {outer:?}");
    let doubled = power(0.0, 2.0 * TORQUE_NM);
    // The mesh hardly stiffens: what a push brings about doubles.
    assert!((doubled.0 / outer.0 - 2.0).abs() < 0.1, "{outer:?} {doubled:?}");
}

/// Play does nothing while a steady force holds the shaft to its side; what turns across the load
/// moves it there and makes harmonics where a linear bearing makes none. They go with the square of
/// the push: a tenth of the unbalance makes a hundredth of 2x. Read from the difference of runs
/// with and without play, so that all else cancels.
fn check_play(place: &str, bench: &Bench, sensor: usize, lines: &[Line]) {
    let Line::Order(turns) = lines[0] else { panic!("an order") };
    let made = |gap_um: f64, push_n: f64| {
        let mut setup = SimSetup::nominal(bench);
        let speed = std::f64::consts::TAU * MOTOR_HZ * turns;
        let mut add = |effect: &str, name: &str, value: f64| {
            let parameters = [(name.to_owned(), value)].into();
            let spec = EffectSpec { effect: effect.into(), place: place.to_owned(), parameters };
            effects::apply(&spec, &mut setup).expect("applies");
        };
        add("looseness", "gap_um", gap_um);
        add("unbalance", "amount_kg_m", push_n / (speed * speed));
        run(&setup, MOTOR_HZ, TORQUE_NM)
    };
    let second = |push_n: f64| {
        let (tight, loose) = (made(0.0, push_n), made(20.0, push_n));
        let change: Vec<f64> = loose.samples[sensor].iter().zip(&tight.samples[sensor]).map(|(a, b)| a - b).collect();
        line(&change, &loose.angles_rad, 2.0 * turns).norm()
    };
    let (strong, weak) = (second(30.0), second(3.0));
    assert!(strong > 1e-5, "{place}: {strong:.1e} m/s²");
    assert!(weak < 0.03 * strong, "{place}: {weak:.1e} of {strong:.1e} m/s² at a tenth of the push");
}

/// Backlash does nothing while the load keeps the teeth together, and sets the flight where it does
/// not.
fn check_backlash(setup: &SimSetup, base: &SimSetup, loaded: &Runs, lines: &[Line]) {
    assert!(loaded.largest(0, lines) < 1e-9, "backlash must not show under load");
    let rattling = |setup: &SimSetup| {
        let mut setup = setup.clone();
        let error = EffectSpec {
            effect: "profile_error".into(),
            place: "stage1".into(),
            parameters: [("e1_um".to_owned(), 15.0)].into(),
        };
        effects::apply(&error, &mut setup).expect("applies");
        setup
    };
    let unloaded = Runs::new(&rattling(setup), &rattling(base), MOTOR_HZ, 0.2);
    assert!(unloaded.largest(0, lines) > 1e-3, "backlash must show where the teeth part");
}

/// The belt's effects on the bench that has one.
fn check_shift_behind_a_belt(effect: &'static dyn Effect) {
    let mut bench = shipped::bench("paper-rig").expect("shipped");
    bench.effects.clear();
    bench.brake.torque_nm = 2.0 * TORQUE_NM;
    let (place, _) = Place::of(effect, &bench).into_iter().next().expect("a place on this bench");
    let spec = EffectSpec { parameters: [("slip_percent".to_owned(), 3.0)].into(), ..spec(effect, &place) };
    let base = SimSetup::nominal(&bench);
    let mut setup = base.clone();
    effects::apply(&spec, &mut setup).expect("applies");
    let (_, values) = effects::resolve(&spec, &bench).expect("resolves");
    let runs = Runs::new(&setup, &base, MOTOR_HZ, 2.0 * TORQUE_NM);
    check_shift(effect, &values, &runs, &Train::new(&bench));
    // Declared: in proportion to the torque.
    assert_eq!(effect.signature(&values, &bench).load, Law::Power(1.0));
    let half = run(&setup, MOTOR_HZ, TORQUE_NM);
    let slip = |run: &Rendered| {
        let turned = run.angles_rad.last().unwrap_or(&0.0) - run.angles_rad[0];
        let seconds = (run.angles_rad.len() - 1) as f64 / run.sample_rate_hz;
        1.0 - turned / (std::f64::consts::TAU * seconds * MOTOR_HZ / 3.56)
    };
    assert!((slip(&runs.with) / slip(&half) - 2.0).abs() < 1e-6);
}

/// One function of frequency alters every line, whatever the load: the ratio at each line is the
/// same at two loads.
fn check_path(place: &str, sensor: usize, (setup, base): (&SimSetup, &SimSetup), runs: &Runs, lines: &[Line]) {
    let ratio = |with: &Rendered, without: &Rendered, at: Line| {
        amplitude(with, sensor, at, MOTOR_HZ) / amplitude(without, sensor, at, MOTOR_HZ)
    };
    let strongest: Vec<Line> =
        lines.iter().copied().filter(|&at| amplitude(&runs.without, sensor, at, MOTOR_HZ).norm() > 1e-4).collect();
    assert!(!strongest.is_empty(), "{place}: no line to see the path in");
    let moved =
        strongest.iter().map(|&at| (ratio(&runs.with, &runs.without, at).norm() - 1.0).abs()).fold(0.0, f64::max);
    assert!(moved > 0.01, "{place}: no line changes by more than {moved:.1e}");
    let loaded = Runs::new(setup, base, MOTOR_HZ, LOAD_FACTOR * TORQUE_NM);
    for &at in &strongest {
        let (one, two) = (ratio(&runs.with, &runs.without, at), ratio(&loaded.with, &loaded.without, at));
        // A path is linear: only the Hann window's side lobes of other lines differ between the
        // loads.
        assert!((one / two - Complex::new(1.0, 0.0)).norm() < 1e-2, "{place}: {one} and {two} at {at:?}");
    }
    // The path of one sensor is not that of another.
    for other in (0..base.bench.sensors.len()).filter(|&other| other != sensor && place != "housing") {
        let still = lines.iter().map(|&at| runs.change(other, at)).fold(0.0, f64::max);
        assert!(still < 1e-9, "{place}: sensor {other} changes by {still:.1e}");
    }
}

/// Four tests share the table, so that they run side by side.
fn quarter(n: usize) {
    for effect in effects::ALL.iter().skip(n).step_by(4) {
        check(*effect);
    }
}

#[test]
fn conform_signatures_first_quarter() {
    quarter(0);
}

#[test]
fn conform_signatures_second_quarter() {
    quarter(1);
}

#[test]
fn conform_signatures_third_quarter() {
    quarter(2);
}

#[test]
fn conform_signatures_last_quarter() {
    quarter(3);
}

/// Pitch errors beyond the deflection declare no law of load, and follow none: at 20 µm
/// neighbouring teeth differ by more than the 3 µm by which a pair gives way, so the load decides
/// how many teeth touch.
#[test]
fn analytic_coarse_pitch_errors_follow_no_law_of_load() {
    let bench = bench();
    let effect = effects::find("pitch_error").expect("known");
    let spec = EffectSpec {
        effect: "pitch_error".into(),
        place: "stage1.pinion".into(),
        parameters: [("total_um".to_owned(), 20.0)].into(),
    };
    let base = SimSetup::nominal(&bench);
    let mut setup = base.clone();
    effects::apply(&spec, &mut setup).expect("applies");
    let (_, values) = effects::resolve(&spec, &bench).expect("resolves");
    let signature = effect.signature(&values, &bench);
    assert_eq!(signature.load, Law::Mixed);
    let change = |torque_nm| Runs::new(&setup, &base, MOTOR_HZ, torque_nm).largest(0, &signature.lines);
    let found = exponent(change(TORQUE_NM), change(LOAD_FACTOR * TORQUE_NM), LOAD_FACTOR);
    assert!(found.abs() > EXPONENT, "torque^{found:.2}: the declaration could be a law after all");
}

/// What pitch errors do to the static approach at some lines, in cycles per mesh cycle, over a
/// revolution of the gear that has them (m).
fn static_change(setup: &SimSetup, base: &SimSetup, torque_nm: f64, lines: &[f64]) -> Vec<f64> {
    const STEPS: u32 = 64;
    let mesh = |setup: &SimSetup| MeshModel::new(&setup.bench, 0, &setup.mesh, &setup.teeth[0]).expect("mesh");
    let (with, without) = (mesh(setup), mesh(base));
    let load = without.at_load(torque_nm / without.base_radii_m()[1]);
    let stage = &setup.bench.stages[0];
    let teeth = if setup.teeth[0].wheel.pitch_error_m.is_empty() { stage.pinion.teeth } else { stage.wheel.teeth };
    // Four revolutions, so that a Hann window tells neighbouring sidebands apart.
    let count = STEPS * teeth * 4;
    let phase = |i: u32| f64::from(i) / f64::from(STEPS);
    let change: Vec<f64> =
        (0..count).map(|i| with.static_point(phase(i), &load).0 - without.static_point(phase(i), &load).0).collect();
    let angles: Vec<f64> = (0..count).map(|i| std::f64::consts::TAU * phase(i)).collect();
    lines.iter().map(|&per_cycle| line(&change, &angles, per_cycle).norm()).collect()
}

/// Why small pitch errors have no law of load beside the mesh lines: the static approach has the
/// same exponents. Under load pairs touch earlier and part later, so that a tooth's error is shared
/// otherwise; that is no resonance and no matter of measuring.
#[test]
fn analytic_sidebands_of_pitch_errors_go_as_pairs_share_the_load() {
    let bench = bench();
    let mesh_order = Train::new(&bench).stages[0].mesh_order;
    let effect = effects::find("pitch_error").expect("known");
    for place in ["stage1.pinion", "stage1.wheel"] {
        let spec = EffectSpec { parameters: [("total_um".to_owned(), 0.2)].into(), ..spec(effect, place) };
        let base = SimSetup::nominal(&bench);
        let mut setup = base.clone();
        effects::apply(&spec, &mut setup).expect("applies");
        let (_, values) = effects::resolve(&spec, &bench).expect("resolves");
        let runs = [TORQUE_NM, LOAD_FACTOR * TORQUE_NM].map(|torque| Runs::new(&setup, &base, MOTOR_HZ, torque));
        // The loudest sidebands up to 4x; what is above meets the mesh resonance.
        let order = |at: &Line| if let Line::Order(order) = at { *order } else { 0.0 };
        let mut lines = effect.signature(&values, &bench).lines;
        lines.retain(|at| (0.5..4.5).contains(&(order(at) / mesh_order)) && (order(at) / mesh_order).fract() != 0.0);
        lines.sort_by(|a, b| runs[0].change(0, *b).total_cmp(&runs[0].change(0, *a)));
        lines.truncate(8);
        let per_cycle: Vec<f64> = lines.iter().map(|at| order(at) / mesh_order).collect();
        let [low, high] =
            [TORQUE_NM, LOAD_FACTOR * TORQUE_NM].map(|torque| static_change(&setup, &base, torque, &per_cycle));
        let mut steepest = 0.0_f64;
        for (i, &at) in lines.iter().enumerate() {
            let found = exponent(runs[0].change(0, at), runs[1].change(0, at), LOAD_FACTOR);
            let expected = exponent(low[i], high[i], LOAD_FACTOR);
            assert!((found - expected).abs() < 0.1, "{place}, {at:?}: torque^{found:.2}, static {expected:.2}");
            steepest = steepest.min(found);
        }
        assert!(steepest < -0.3, "{place}: torque^{steepest:.2}: the declaration could be a law after all");
    }
}
