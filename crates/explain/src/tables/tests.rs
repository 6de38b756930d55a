use super::*;
use crate::paper;

/// splitmix64 and Box–Muller.
struct Random(u64);

impl Random {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn normal(&mut self) -> f64 {
        (-2.0 * (1.0 - self.uniform()).ln()).sqrt() * (std::f64::consts::TAU * self.uniform()).cos()
    }
}

/// An experiment: gains by harmonic and noise (relative).
fn through_path(table: &AmplitudeTable, noise: f64, random: &mut Random) -> AmplitudeTable {
    let gains = [0.0957, 0.0583, 0.0662, 0.0896, 0.2422];
    let mut out = table.clone();
    for row in &mut out.amplitudes {
        for (a, gain) in row.iter_mut().zip(gains) {
            *a *= gain * (1.0 + noise * random.normal());
        }
    }
    out
}

/// The figures of the paper's tables, as recomputed independently with NumPy.
#[test]
fn oracle_statistics_of_tables_2_and_5() {
    let tables = paper::tables().expect("the embedded tables");
    let r = relate(&tables.simulation, &tables.experiment).expect("related");
    assert_eq!((r.cells, r.simulation_positive, r.experiment_positive, r.same_sign, r.same_rank), (65, 22, 65, 22, 62));
    assert!((r.same_sign_p - 0.0125).abs() < 5e-4, "{}", r.same_sign_p);
    assert!((r.experiment_positive_p / 2.0_f64.powi(-64) - 1.0).abs() < 1e-6, "{}", r.experiment_positive_p);
    assert!((r.correlation_signed + 0.455_557_63).abs() < 1e-7);
    assert!((r.correlation_absolute - 0.997_115_74).abs() < 1e-7);
    assert!((r.absolute_gap - 0.308_949_659).abs() < 1e-8);
    let line = r.against_absolute;
    for (found, expected) in [
        (line.slope.value, 1.002_096_22),
        (line.slope.sigma, 0.009_609_76),
        (line.intercept.value, 0.219_329_08),
        (line.intercept.sigma, 0.067_832_81),
        (line.r_squared, 0.994_239_794),
        (line.scatter, 0.377_768_658),
    ] {
        assert!((found - expected).abs() < 1e-8, "{found} against {expected}");
    }
    let aic = |model| r.models.iter().find(|m| m.model == model).expect("fitted").aic;
    for (model, expected) in [
        (Model::Rectified, -785.340_165),
        (Model::PowerLaw, -482.185_556),
        (Model::NoRelation, -436.627_650),
        (Model::LinearPath, -324.048_473),
    ] {
        assert!((aic(model) - expected).abs() < 1e-6, "{model:?}: {}", aic(model));
    }
    for (found, printed) in r.normal_ratio.iter().zip([0.0957, 0.0583, 0.0662, 0.0896, 0.2422]) {
        assert!((found - printed).abs() < 5e-5, "{found}");
    }
    assert_eq!(r.finding, Finding::NotIndependent);
}

/// The simulated table through gains with 0.4 % noise: a linear path and nothing else, in each of
/// 200 draws.
#[test]
fn oracle_linear_path_with_noise_is_recognised_and_not_resolvable() {
    let simulation = paper::tables().expect("the embedded tables").simulation;
    let mut random = Random(1);
    for draw in 0..200 {
        let experiment = through_path(&simulation, 0.004, &mut random);
        let r = relate(&simulation, &experiment).expect("related");
        assert_eq!((&r.finding, r.corrections.len()), (&Finding::LinearPath, 0), "draw {draw}: {:?}", r.models);
        let path = r.models[1];
        // 70 cells, 5 gains: rms 0.4 % × √(65/70), known to 9 % (one sigma).
        assert!((path.scatter / 0.004 / (65.0_f64 / 70.0).sqrt() - 1.0).abs() < 0.4, "{path:?}");
    }
    assert!(Finding::LinearPath.sentence().contains("not resolvable"));
    // Without any noise, as well.
    let exact = relate(&simulation, &through_path(&simulation, 0.0, &mut random)).expect("related");
    assert_eq!((exact.finding, exact.corrections), (Finding::LinearPath, vec![]));
}

/// One sign, one harmonic's signs, one state's, or all flipped: named, in each of 50 draws. The
/// single sign is that of pitting_3 at 4x (−15.7 %), the harmonic 2x, the state pitting_1.
#[test]
fn oracle_flipped_signs_are_flagged() {
    let simulation = paper::tables().expect("the embedded tables").simulation;
    let mut random = Random(2);
    let (fourth, second) = (simulation.harmonics[3].clone(), simulation.harmonics[1].clone());
    let flip = |chosen: &dyn Fn(&str, usize) -> bool| {
        let mut flipped = simulation.clone();
        for state in 1..flipped.states.len() {
            for harmonic in 0..flipped.harmonics.len() {
                if chosen(&flipped.states[state], harmonic) {
                    let normal = flipped.amplitudes[0][harmonic];
                    flipped.amplitudes[state][harmonic] = 2.0 * normal - flipped.amplitudes[state][harmonic];
                }
            }
        }
        flipped
    };
    type Chosen = Box<dyn Fn(&str, usize) -> bool>;
    let one = Correction::Flip { state: "pitting_3".into(), harmonic: fourth };
    let cases: [(Chosen, Correction); 4] = [
        (Box::new(|s, h| s == "pitting_3" && h == 3), one),
        (Box::new(|_, h| h == 1), Correction::FlipHarmonic(second)),
        (Box::new(|s, _| s == "pitting_1"), Correction::FlipState("pitting_1".into())),
        (Box::new(|_, _| true), Correction::FlipAll),
    ];
    for (chosen, correction) in &cases {
        for _ in 0..50 {
            let experiment = through_path(&flip(chosen), 0.004, &mut random);
            let r = relate(&simulation, &experiment).expect("related");
            assert_eq!((&r.finding, &r.corrections), (&Finding::Contradiction, &vec![correction.clone()]));
        }
    }
}

#[test]
fn oracle_swapped_states_are_flagged() {
    let simulation = paper::tables().expect("the embedded tables").simulation;
    let mut random = Random(3);
    for (a, b) in [("broken_1_5", "pitting_2"), ("pitting_1", "compound_3"), ("pitting_4", "compound_4")] {
        let index = |name: &str| simulation.states.iter().position(|s| s == name).expect("a state");
        let (a_index, b_index) = (index(a), index(b));
        for _ in 0..50 {
            let mut experiment = through_path(&simulation, 0.004, &mut random);
            experiment.amplitudes.swap(a_index, b_index);
            let r = relate(&simulation, &experiment).expect("related");
            let swap = vec![Correction::Swap(a.to_owned(), b.to_owned())];
            assert_eq!((&r.finding, &r.corrections), (&Finding::Contradiction, &swap));
        }
    }
}

/// An experiment that is nothing but noise about constants, and one whose noise drowns the
/// deviations.
#[test]
fn oracle_noise_is_not_explained() {
    let simulation = paper::tables().expect("the embedded tables").simulation;
    let mut random = Random(4);
    for _ in 0..50 {
        let mut constant = simulation.clone();
        for row in 1..constant.amplitudes.len() {
            constant.amplitudes[row] = constant.amplitudes[0].clone();
        }
        let r = relate(&simulation, &through_path(&constant, 0.01, &mut random)).expect("related");
        assert!(matches!(r.finding, Finding::NoRelation), "{:?}", r.finding);
        let r = relate(&simulation, &through_path(&simulation, 0.5, &mut random)).expect("related");
        assert!(matches!(r.finding, Finding::Undecided(_) | Finding::NoRelation), "{:?}", r.finding);
    }
}

#[test]
fn conform_bad_tables_are_refused_in_a_sentence() {
    let message = |text: &str| AmplitudeTable::parse(text, "t.csv").expect_err("refused").to_string();
    assert!(message("").contains("state"), "{}", message(""));
    assert!(message("state,a\nn,1\nb,2\n").contains("2 states"));
    assert!(message("state,a\nn,1\nb,x\n").contains("line 3"), "{}", message("state,a\nn,1\nb,x\n"));
    assert!(message("state,a\nn,1\nb,-1\n").contains("above 0"));
    assert!(message("state,a\nn,1\nb\n").contains("line 3"), "{}", message("state,a\nn,1\nb\n"));
    assert!(message("state,a\nn,1\nn,2\n").contains("twice"));
    assert!(message("name,a\nn,1\n").contains("\"state\""));
    let table = |text: &str| AmplitudeTable::parse(text, "t.csv").expect("a table");
    let a = table("state,x\nn,1\na,2\nb,3\nc,4\n");
    let ordered = relate(&a, &table("state,y\nn,10\nc,40\na,20\nb,30\n")).expect("the order does not matter");
    assert!((ordered.against_signed.slope.value - 1.0).abs() < 1e-12);
    let other = relate(&a, &table("state,y\nn,10\nd,40\na,20\nb,30\n")).expect_err("other states").to_string();
    assert!(other.contains("states") && other.contains("\"d\""), "{other}");
    let wide = relate(&a, &table("state,y,z\nn,1,1\na,2,1\nb,3,1\nc,4,1\n")).expect_err("other harmonics");
    assert!(wide.to_string().contains("harmonics"), "{wide}");
}
