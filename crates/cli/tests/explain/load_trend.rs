//! Real recordings of a healthy two-stage box at six loads: what a model of its train explains of
//! the trend of mesh lines over load, on loads that took no part in fitting, and what stays
//! unexplained.
//!
//! The recordings are not part of the project: without them (`../shared` beside the repository) the
//! test says so and skips. With `GEARWATCH_PICTURES=folder` it writes the picture of
//! `docs/explain.md` there.
//!
//! All models have a free gain per channel and line, since nobody knows the path from a bearing to
//! a sensor. What they predict is how a line's amplitude moves with the load; a model that is left
//! with gains alone is the constant.

mod measured;
mod modelled;
mod picture;

use measured::{LINES, Measured};

/// Decibels of a natural logarithm of amplitudes.
const DB: f64 = 8.685_889_638;

/// Root mean square error (dB) on held-out loads: by line, each model; and over all lines with the
/// standard error over the six loads.
struct Judged {
    name: &'static str,
    by_line: Vec<f64>,
    all: f64,
    error: f64,
}

/// ln amplitudes by channel and line at a held-out load, from the training loads.
type Predict<'a> = dyn FnMut(&[usize], usize) -> Vec<Vec<f64>> + 'a;

/// Predicts each load from the others. `predict(training loads, held-out load)` gives ln amplitudes
/// by channel and line.
fn judge(name: &'static str, m: &Measured, predict: &mut Predict<'_>) -> Judged {
    let loads = measured::LOADS.len();
    let mut by_line = vec![(0.0, 0usize); LINES.len()];
    let mut by_load = Vec::new();
    for held in 0..loads {
        let training: Vec<usize> = (0..loads).filter(|l| *l != held).collect();
        let predicted = predict(&training, held);
        let (mut sum, mut count) = (0.0, 0usize);
        for (channel, lines) in predicted.iter().enumerate() {
            for (line, value) in lines.iter().enumerate() {
                let square = (DB * (value - m.ln[channel][line][held])).powi(2);
                by_line[line].0 += square;
                by_line[line].1 += 1;
                sum += square;
                count += 1;
            }
        }
        by_load.push(sum / count as f64);
    }
    let mean = by_load.iter().sum::<f64>() / loads as f64;
    let variance = by_load.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (loads - 1) as f64;
    Judged {
        name,
        by_line: by_line.into_iter().map(|(sum, n)| (sum / n as f64).sqrt()).collect(),
        all: mean.sqrt(),
        // Of the mean square by load, carried to its root.
        error: (variance / loads as f64).sqrt() / (2.0 * mean.sqrt()),
    }
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, n) = values.fold((0.0, 0usize), |(s, n), v| (s + v, n + 1));
    sum / n as f64
}

/// The mean over the training loads.
fn constant(m: &Measured, training: &[usize], _: usize) -> Vec<Vec<f64>> {
    m.ln.iter().map(|lines| lines.iter().map(|v| mean(training.iter().map(|l| v[*l]))).collect()).collect()
}

/// A straight line of ln amplitude over load, with one slope per line for all channels, or one for
/// each.
fn straight(m: &Measured, training: &[usize], held: usize, shared: bool) -> Vec<Vec<f64>> {
    let x: Vec<f64> = measured::LOADS.iter().map(|l| f64::from(*l)).collect();
    let middle = mean(training.iter().map(|l| x[*l]));
    let slope = |channels: &[usize], line: usize| {
        let (mut xy, mut xx) = (0.0, 0.0);
        for c in channels {
            let v = &m.ln[*c][line];
            let level = mean(training.iter().map(|l| v[*l]));
            for l in training {
                xy += (x[*l] - middle) * (v[*l] - level);
                xx += (x[*l] - middle).powi(2);
            }
        }
        xy / xx
    };
    let all: Vec<usize> = (0..m.ln.len()).collect();
    let level = constant(m, training, held);
    let predict = |c: usize, line: usize| {
        let channels = if shared { all.clone() } else { vec![c] };
        level[c][line] + slope(&channels, line) * (x[held] - middle)
    };
    (0..m.ln.len()).map(|c| (0..LINES.len()).map(|line| predict(c, line)).collect()).collect()
}

/// What the other three channels did at the held-out load: one source behind linear paths would do
/// the same on all. No model of the train with a free path can be better than the truth of this.
fn others(m: &Measured, training: &[usize], held: usize) -> Vec<Vec<f64>> {
    let level = constant(m, training, held);
    let moved = |c: usize, line: usize| m.ln[c][line][held] - level[c][line];
    (0..m.ln.len())
        .map(|c| {
            (0..LINES.len())
                .map(|line| level[c][line] + mean((0..m.ln.len()).filter(|o| *o != c).map(|o| moved(o, line))))
                .collect()
        })
        .collect()
}

#[test]
#[expect(clippy::print_stderr, reason = "the figures of the whole set are for people")]
fn literature_load_trend_of_a_healthy_box() {
    let Some(m) = measured::read() else { return };
    let sheet = modelled::Sheet::new(&m);
    let mut all = vec![
        judge("constant", &m, &mut |t, h| constant(&m, t, h)),
        judge("straight line, one slope a line", &m, &mut |t, h| straight(&m, t, h, true)),
        judge("straight line, a slope a channel", &m, &mut |t, h| straight(&m, t, h, false)),
        judge("train as its sheet says", &m, &mut |t, h| sheet.predict(&m, t, h, false)),
        judge("train with profile errors fitted", &m, &mut |t, h| sheet.predict(&m, t, h, true)),
        judge("the other three channels", &m, &mut |t, h| others(&m, t, h)),
    ];
    eprintln!("rms error on held-out loads (dB), by line and over all:");
    let names: Vec<&str> = LINES.iter().map(|l| l.2).collect();
    eprintln!("{:<34}{}      all", "", names.iter().map(|n| format!("{n:>8}")).collect::<String>());
    for j in &all {
        let lines: String = j.by_line.iter().map(|v| format!("{v:>8.2}")).collect();
        eprintln!("{:<34}{lines}   {:.2} ± {:.2}", j.name, j.all, j.error);
    }
    eprintln!("scatter of a mean over a recording: {:.2} dB", DB * m.standard_error);
    for fitted in [false, true] {
        let everything: Vec<usize> = (0..measured::LOADS.len()).collect();
        eprintln!("torques that fit (fitted profile: {fitted}): {}", sheet.torques(&m, &everything, fitted));
    }
    if let Some(folder) = std::env::var_os("GEARWATCH_PICTURES") {
        picture::write(std::path::Path::new(&folder), &m, &sheet, &all);
    }
    let of = |name: &str| all.iter().find(|j| j.name == name).map(|j| j.all).unwrap();
    // What the documentation says: the load moves the lines by far more than recordings scatter, …
    assert!(of("constant") > 3.0 * DB * m.standard_error);
    all.retain(|j| j.all.is_finite());
    assert_eq!(all.len(), 6);
}
