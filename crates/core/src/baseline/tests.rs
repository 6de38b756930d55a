use super::*;
use crate::testing::{Random, window};

const FLOORS: [f64; HARMONICS] = [0.01, 0.02, 0.01, 0.01, 0.02];

fn origin(session: &str, recording: &str) -> Origin {
    Origin { session: session.into(), mounting: "m".into(), recording: recording.into() }
}

fn empty() -> Baseline {
    Baseline {
        format: FORMAT.into(),
        bench: "test".into(),
        bench_sha256: "0".repeat(64),
        machine: None,
        history: Vec::new(),
        window_s: 1.0,
        rank_steps_percent: crate::rank::RankConfig::default().steps_percent,
        config: BaselineConfig::default(),
        stages: vec!["stage1".into()],
        runs: vec![],
    }
}

/// Runs of `count` windows at one operating point, all harmonics at `level` with a relative
/// scatter.
fn runs(origin: &Origin, point: (f64, f64), level: f64, scatter: f64, count: u64, random: &mut Random) -> Vec<Run> {
    let mut learner = Learner::new(BaselineConfig::default());
    for n in 0..count {
        let amplitudes = std::array::from_fn(|_| level * (scatter * random.normal()).exp());
        learner.push(&window(n, point.0, point.1, amplitudes, FLOORS));
    }
    learner.finish(origin).expect("windows")
}

fn first_line(baseline: &Baseline, speed: f64, torque: Option<f64>) -> Option<Reference> {
    let surface = Surface::new(baseline);
    surface.line(&surface.locate(speed, torque)?, "acc", 0, 0)
}

/// 20 windows, of which 9 are wild (ten times the amplitude): the learned amplitude stays within
/// four standard errors of the sound ones, the scatter is theirs, and the wild ones are counted.
#[test]
fn analytic_learner_survives_nine_wild_windows_of_twenty() {
    let mut random = Random(21);
    let mut learner = Learner::new(BaselineConfig::default());
    for n in 0..20 {
        let wild = if n % 2 == 0 && n < 18 { 10.0 } else { 1.0 };
        let amplitudes = std::array::from_fn(|_| 3.0 * wild * (0.05 * random.normal()).exp());
        learner.push(&window(n, 30.0, 50.0, amplitudes, FLOORS));
    }
    let runs = learner.finish(&origin("s", "a")).expect("windows");
    for line in runs[0].channels["acc"].stages[0] {
        let line = line.expect("a line");
        assert_eq!((line.windows, line.left_out), (11, 9));
        assert!((line.amplitude / 3.0).ln().abs() < 4.0 * 0.05 / 11.0_f64.sqrt(), "{line:?}");
        // Standard deviation from 11: within a factor 2 of the truth, 4 sigma.
        assert!((0.025..0.1).contains(&line.scatter), "{line:?}");
        assert!((line.noise - 1e-3).abs() < 1e-9);
        assert!((line.floor.expect("a floor").scatter) < 1e-12);
    }
}

#[test]
fn conform_windows_of_a_faulty_instrument_teach_nothing() {
    let mut learner = Learner::new(BaselineConfig::default());
    let mut bad = window(0, 30.0, 50.0, [1.0; HARMONICS], FLOORS);
    bad.instrument = crate::verdict::InstrumentState::Overload;
    learner.push(&bad);
    let mut lost = window(1, f64::NAN, 50.0, [1.0; HARMONICS], FLOORS);
    lost.input_speed_hz = crate::estimate::Estimate::UNKNOWN;
    learner.push(&lost);
    assert_eq!(learner.refused().len(), 2);
    let error = learner.finish(&origin("s", "a.mcap")).expect_err("nothing learned").to_string();
    assert!(error.contains("a.mcap") && error.contains("overload 1") && error.contains("no_speed 1"), "{error}");
    let error = Learner::new(BaselineConfig::default()).finish(&origin("s", "b")).expect_err("empty");
    assert!(error.to_string().contains("shorter than a window"), "{error}");
}

/// A recording that dwells at three operating points becomes three runs, whatever their order.
#[test]
fn analytic_operating_points_are_told_apart() {
    let mut learner = Learner::new(BaselineConfig::default());
    for n in 0..30 {
        let (speed, torque) = [(30.0, 50.0), (30.1, 100.0), (20.0, 50.2)][(n % 3) as usize];
        learner.push(&window(n, speed, torque, [speed; HARMONICS], FLOORS));
    }
    let runs = learner.finish(&origin("s", "a")).expect("windows");
    let points: Vec<_> = runs.iter().map(|r| (r.input_speed_hz, r.brake_torque_nm.expect("known"))).collect();
    let expected = [(20.0, 50.2), (30.0, 50.0), (30.1, 100.0)];
    for (found, wanted) in points.iter().zip(expected) {
        assert!((found.0 - wanted.0).abs() < 1e-9 && (found.1 - wanted.1).abs() < 1e-9, "{points:?}");
    }
    assert_eq!(runs.len(), 3);
}

#[test]
fn analytic_merge_is_associative_commutative_and_idempotent() {
    let mut random = Random(22);
    let mut one = |session: &str, recording: &str, torque: f64| {
        let mut baseline = empty();
        let runs = runs(&origin(session, recording), (30.0, torque), 1.0, 0.05, 8, &mut random);
        baseline.add(runs).expect("added");
        baseline
    };
    let (a, b, c) = (one("s2", "x", 10.0), one("s1", "x", 10.0), one("s1", "y", 50.0));
    let join = |x: &Baseline, y: &Baseline| x.merged(y).expect("joined");
    let all = join(&join(&a, &b), &c);
    assert_eq!(all, join(&a, &join(&b, &c)));
    assert_eq!(all, join(&join(&c, &b), &a));
    assert_eq!(all, join(&all, &a));
    assert_eq!(all.runs.len(), 3);
    assert_eq!(all.sessions().len(), 2);
    // The same recording with other content is not silently one of the two.
    let other = one("s1", "x", 10.0);
    let error = all.merged(&other).expect_err("a conflict").to_string();
    assert!(error.contains("\"x\"") && error.contains("\"s1\""), "{error}");
    let wrong = Baseline { window_s: 2.0, ..empty() };
    assert!(all.merged(&wrong).expect_err("other windows").to_string().contains("window length"));
    let mut volts = one("s3", "z", 10.0);
    volts.runs[0].channels.get_mut("acc").expect("acc").unit = "V".into();
    assert!(all.merged(&volts).expect_err("other unit").to_string().contains("m/s^2"));
}

/// Six sessions that differ by 8 % (sigma) with 3 % scatter within: the spread between them is
/// found (a standard deviation from 6 is right within a factor 2.2, 3 sigma), one session alone
/// says that it does not know.
#[test]
fn oracle_spread_between_sessions() {
    let mut random = Random(23);
    let mut baseline = empty();
    let mut offsets = Vec::new();
    for session in 0..6 {
        let offset = 0.08 * random.normal();
        offsets.push(offset);
        let origin = origin(&format!("s{session}"), "a");
        baseline.add(runs(&origin, (30.0, 50.0), offset.exp(), 0.03, 20, &mut random)).expect("added");
        let reference = first_line(&baseline, 30.0, Some(50.0)).expect("a cell");
        assert_eq!(reference.sessions, session + 1);
        assert_eq!(reference.between_variance.is_some(), session > 0);
    }
    let reference = first_line(&baseline, 30.0, Some(50.0)).expect("a cell");
    let mean = offsets.iter().sum::<f64>() / 6.0;
    let spread = (offsets.iter().map(|o| (o - mean).powi(2)).sum::<f64>() / 5.0).sqrt();
    let found = reference.between_variance.expect("six sessions").sqrt();
    // Each session's mean is known to 0.03/√20 = 0.7 %.
    assert!((found - spread).abs() < 0.01, "{found} against {spread}");
    assert!((reference.ln - mean).abs() < 0.01, "{reference:?}");
    assert!((reference.scatter_variance.sqrt() / 0.03 - 1.0).abs() < 0.2, "{reference:?}");
}

/// Cells at 10, 15, 20, 25, 30 Hz and 0, 50, 100 N m of a curved surface: between them the
/// interpolated amplitude is right within three times its stated sigma, in a cell it is the cell's,
/// outside nothing is said.
#[test]
fn analytic_interpolation_states_its_error() {
    let mut random = Random(24);
    let truth = |speed: f64, torque: f64| 0.5 * (speed / 20.0).ln().powi(2) + 1e-4 * torque * torque - 0.002 * torque;
    let mut baseline = empty();
    for speed in [10.0, 15.0, 20.0, 25.0, 30.0] {
        for torque in [0.0, 50.0, 100.0] {
            let origin = origin("s", &format!("{speed} {torque}"));
            let level = truth(speed, torque).exp();
            baseline.add(runs(&origin, (speed, torque), level, 0.001, 8, &mut random)).expect("added");
        }
    }
    let surface = Surface::new(&baseline);
    assert_eq!(surface.cells().len(), 15);
    for (speed, torque) in [(12.0, 0.0), (17.3, 50.0), (20.0, 20.0), (28.0, 75.0), (11.0, 99.0)] {
        let reference = first_line(&baseline, speed, Some(torque)).expect("inside");
        let misfit = (reference.ln - truth(speed, torque)).abs();
        let sigma = (reference.interpolation_variance + reference.mean_variance).sqrt();
        assert!(misfit < 3.0 * sigma, "{speed} Hz, {torque} N m: {misfit} against {sigma}");
        assert!(reference.interpolation_variance > 0.0);
    }
    let cell = first_line(&baseline, 20.0, Some(50.0)).expect("a cell");
    assert!((cell.ln - truth(20.0, 50.0)).abs() < 4.0 * 0.001 / 8.0_f64.sqrt());
    // Outside by more than the tolerance (1 % of speed, 3 % of torque).
    for (speed, torque) in [(9.8, Some(50.0)), (30.4, Some(50.0)), (20.0, Some(104.0)), (20.0, None)] {
        assert_eq!(first_line(&baseline, speed, torque), None, "{speed} {torque:?}");
    }
    for (speed, torque) in [(9.95, Some(50.0)), (30.2, Some(50.0)), (20.0, Some(102.0))] {
        assert!(first_line(&baseline, speed, torque).is_some(), "{speed} {torque:?}");
    }
    let mut name = String::new();
    surface.write_name(&surface.locate(28.0, Some(75.0)).expect("inside"), &mut name);
    assert_eq!(name, "25.00–30.00 Hz, 50.0–100.0 N m");
}

/// Two cells have no inner one by which the error of interpolating could be known: nothing is said
/// between them.
#[test]
fn conform_no_interpolation_without_an_inner_cell() {
    let mut random = Random(25);
    let mut baseline = empty();
    for speed in [20.0, 30.0] {
        let origin = origin("s", &format!("{speed}"));
        baseline.add(runs(&origin, (speed, f64::NAN), 1.0, 0.01, 8, &mut random)).expect("added");
    }
    assert_eq!(first_line(&baseline, 25.0, None), None);
    assert!(first_line(&baseline, 20.1, None).is_some());
    assert_eq!(first_line(&baseline, 20.1, Some(0.0)), None, "a torque is known now and was not then");
    // One window has no scatter, and so judges nothing.
    let small = |count: u64, random: &mut Random| {
        let mut small = empty();
        small.add(runs(&origin("s", "a"), (20.0, f64::NAN), 1.0, 0.01, count, random)).expect("added");
        first_line(&small, 20.0, None)
    };
    assert_eq!(small(1, &mut random), None);
    assert!(small(4, &mut random).expect("four windows").scatter_freedom >= 2.0);
}

/// Six loads that were not stated become one cell of six runs. What a further run may deviate by is
/// the spread of the runs, not that of windows within a run: of 400 further runs of such a machine
/// at most the stated share lies beyond two sigma.
#[test]
fn regress_loads_that_were_not_stated_widen_the_cell() {
    let mut random = Random(31);
    let (mut beyond, mut trials, mut mixed) = (0, 0, 0);
    for _ in 0..40 {
        let mut baseline = empty();
        for run in 0..6 {
            let level = (0.3 * random.normal()).exp();
            let origin = origin("s", &format!("{run}"));
            baseline.add(runs(&origin, (30.0, f64::NAN), level, 0.05, 15, &mut random)).expect("added");
        }
        mixed += usize::from(baseline.mixed_cells().len() == 1);
        let reference = first_line(&baseline, 30.0, None).expect("a cell");
        for _ in 0..10 {
            let ln = 0.3 * random.normal();
            let observed = crate::deviation::Observed::Average { ln, scatter_variance: 0.0025, effective: 15.0 };
            let deviation = crate::deviation::Deviation::new(observed, &reference, ScatterPrior::NONE);
            beyond += i32::from(deviation.ln.abs() > 2.0 * deviation.variance.sqrt());
            trials += 1;
        }
    }
    // Student's t with 5 degrees of freedom: 10.2 % beyond two sigma; of 400 in 40 groups 16 % at
    // the most, with 3 standard errors.
    assert!(f64::from(beyond) < 0.16 * f64::from(trials), "{beyond} of {trials}");
    assert_eq!(mixed, 40);
}

/// Runs of one load that differ by chance alone are no mixed cell, and the cell stays as sharp as
/// one of one long run.
#[test]
fn oracle_equal_runs_are_not_mixed() {
    let mut random = Random(32);
    let (mut mixed, mut run_variance) = (0, 0.0);
    for _ in 0..100 {
        let mut baseline = empty();
        for run in 0..4 {
            let origin = origin("s", &format!("{run}"));
            baseline.add(runs(&origin, (30.0, 50.0), 1.0, 0.05, 15, &mut random)).expect("added");
        }
        mixed += baseline.mixed_cells().len();
        run_variance += first_line(&baseline, 30.0, Some(50.0)).expect("a cell").run_variance / 100.0;
    }
    assert_eq!(mixed, 0);
    // The mean of a run is known to 0.05/√15 = 1.3 %; what is left as spread between equal runs is
    // less than half of that.
    assert!(run_variance.sqrt() < 0.5 * 0.05 / 15.0_f64.sqrt(), "{}", run_variance.sqrt());
}

/// Cells that are rough from file to file, with gaps between them that differ: the stated sigma of
/// what lies in a narrow gap is not that of a bend which shrinks with it, which covered a third.
/// Three misfits that share their cells are worth two degrees of freedom or more: Student's t
/// covers 57.7 and 81.6 % within one and two sigma, of 200 baselines 88 and 142 at least, less 4
/// standard errors.
#[test]
fn regress_roughness_does_not_shrink_with_the_gap() {
    let mut random = Random(33);
    let (mut within_one, mut within_two, count) = (0, 0, 200);
    for _ in 0..count {
        let mut baseline = empty();
        for torque in [0.0, 40.0, 80.0, 90.0, 130.0] {
            let level = (0.2 * random.normal()).exp();
            let origin = origin("s", &format!("{torque}"));
            baseline.add(runs(&origin, (30.0, torque), level, 0.01, 15, &mut random)).expect("added");
        }
        let reference = first_line(&baseline, 30.0, Some(85.0)).expect("inside");
        let misfit = (reference.ln - 0.2 * random.normal()).abs();
        let sigma = (reference.interpolation_variance + reference.mean_variance).sqrt();
        within_one += i32::from(misfit < sigma);
        within_two += i32::from(misfit < 2.0 * sigma);
    }
    assert!(within_one >= 88 && within_two >= 142, "{within_one} and {within_two} of {count}");
}
