//! `gearwatch explain --tables`: the paper's tables as printed, through a path, with a sign
//! flipped, with states swapped.

use rand::{RngExt, SeedableRng};

use crate::fixture::{Folder, stderr, stdout};

/// The paper's tables 2 and 5, as the program carries them.
fn tables() -> (Vec<String>, Vec<Vec<f64>>, Vec<Vec<f64>>) {
    let tables = gearwatch_explain::paper::tables().unwrap();
    (tables.simulation.states.clone(), tables.simulation.amplitudes.clone(), tables.experiment.amplitudes)
}

fn text(states: &[String], amplitudes: &[Vec<f64>]) -> String {
    let rows = states.iter().zip(amplitudes).map(|(state, row)| {
        let row: Vec<String> = row.iter().map(|a| format!("{a:.7}")).collect();
        format!("{state},{}\n", row.join(","))
    });
    format!("state,1x,2x,3x,4x,5x\n{}", rows.collect::<String>())
}

/// Each harmonic through a gain of its own, with noise.
fn through_path(amplitudes: &[Vec<f64>], noise: f64, seed: u64) -> Vec<Vec<f64>> {
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
    let gains = [0.0957, 0.0583, 0.0662, 0.0896, 0.2422];
    // The sum of twelve even numbers is near enough to a Gaussian one.
    let mut normal = move || (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0;
    amplitudes
        .iter()
        .map(|row| row.iter().zip(gains).map(|(a, g)| a * g * (1.0 + noise * normal())).collect())
        .collect()
}

fn relate(simulation: &str, experiment: &str) -> String {
    let folder = Folder::new();
    folder.write("simulation.csv", simulation);
    folder.write("experiment.csv", experiment);
    let done = folder.run(&["explain", "--tables", "simulation.csv", "experiment.csv"]);
    assert_eq!(done.status.code(), Some(0), "{}", stderr(&done));
    stdout(&done)
}

/// What follows, without its line breaks.
fn finding(said: &str) -> String {
    said.split_once("Finding\n").unwrap().1.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// The figures that the data's own description gives: 43 of 65 signs differ, all of the
/// experiment's are positive, AIC −785 for the rectified model against −324 for a path; and the
/// refusal to name physics.
#[test]
fn literature_tables_as_printed_are_not_independent() {
    let (states, simulation, experiment) = tables();
    let said = relate(&text(&states, &simulation), &text(&states, &experiment));
    for wanted in [
        "positive in the experiment  65",
        "of the same sign            22   of the other sign 43",
        "-785",
        "-324",
        "R² 0.994",
    ] {
        assert!(said.contains(wanted), "{wanted:?} is not in:\n{said}");
    }
    let finding = finding(&said);
    assert!(finding.contains("not independent") && finding.contains("attributed"), "{finding}");
}

#[test]
fn oracle_a_linear_path_is_seen_and_not_resolved() {
    let (states, simulation, _) = tables();
    for seed in 0..5 {
        let said = relate(&text(&states, &simulation), &text(&states, &through_path(&simulation, 0.004, seed)));
        let finding = finding(&said);
        assert!(finding.contains("linear path"), "{finding}");
        assert!(!said.contains("not independent") && said.contains("the spectral shape differs"), "{said}");
    }
    // One gain for all harmonics leaves the shape as it is.
    let tenth: Vec<Vec<f64>> = simulation.iter().map(|row| row.iter().map(|a| 0.1 * a).collect()).collect();
    let said = relate(&text(&states, &simulation), &text(&states, &tenth));
    assert!(said.contains("the spectral shape is the same") && finding(&said).contains("linear path"), "{said}");
}

/// A single sign, and two rows, are named as what contradicts.
#[test]
fn oracle_a_flipped_sign_and_swapped_states_are_named() {
    let (states, simulation, _) = tables();
    let mut flipped = through_path(&simulation, 0.004, 7);
    // The deviation with the largest size, mirrored about the normal state.
    let (row, column) = (1..states.len())
        .flat_map(|r| (0..5).map(move |c| (r, c)))
        .max_by(|a, b| {
            let size = |(r, c): (usize, usize)| (simulation[r][c] / simulation[0][c] - 1.0).abs();
            size(*a).total_cmp(&size(*b))
        })
        .unwrap();
    flipped[row][column] = 2.0 * flipped[0][column] - flipped[row][column];
    let said = relate(&text(&states, &simulation), &text(&states, &flipped));
    assert!(said.contains(&states[row]) && said.contains("sign"), "{} is not in:\n{said}", states[row]);
    assert!(finding(&said).contains("only after the changes named"), "{}", finding(&said));

    let mut swapped = through_path(&simulation, 0.004, 8);
    swapped.swap(3, 8);
    let said = relate(&text(&states, &simulation), &text(&states, &swapped));
    assert!(said.contains(&states[3]) && said.contains(&states[8]) && said.contains("have changed places"), "{said}");
}

/// The printed tables beside the repository, where they are: the program carries the same figures.
#[test]
#[expect(clippy::print_stderr, reason = "tests tell what was skipped")]
fn literature_the_program_carries_the_printed_tables() {
    let printed = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/paper");
    if !printed.is_dir() {
        eprintln!("skipped: the paper's tables are not at {}", printed.display());
        return;
    }
    let (states, simulation, experiment) = tables();
    let read = |name: &str| std::fs::read_to_string(printed.join(name)).unwrap();
    let (from_files, from_program) = (
        relate(&read("table2_simulation.csv"), &read("table5_experiment.csv")),
        relate(&text(&states, &simulation), &text(&states, &experiment)),
    );
    assert_eq!(finding(&from_files), finding(&from_program));
    for line in ["positive in the experiment", "correlation", "experiment = ("] {
        let of = |said: &str| said.lines().find(|l| l.contains(line)).map(str::to_owned);
        assert_eq!(of(&from_files), of(&from_program));
    }
}
