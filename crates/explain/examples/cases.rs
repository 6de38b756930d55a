//! Answers folders of cases without the command line around it: `cases explain CASES OUT` writes an explanation a case and the seconds that each took,
//! `cases evidence CASES OUT` writes what was measured, `cases drawn SEED FIRST LAST` draws cases and scores the answers.

use std::path::{Path, PathBuf};
use std::time::Instant;

use gearwatch_core::recording::Recording;
use gearwatch_explain::explain::{Input, explain};
use gearwatch_explain::measure::{Measured, measure};
use gearwatch_explain::read::dsp::Transforms;
use gearwatch_explain::read::features::RecordingFeatures;
use gearwatch_explain::read::lines::Family;
use gearwatch_explain::read::transients;
use gearwatch_io::open::{OpenOptions, read_recording};
use serde_json::{Value, json};

fn recordings(folder: &Path) -> Vec<Recording> {
    let mut files: Vec<PathBuf> =
        std::fs::read_dir(folder).map(|d| d.flatten().map(|e| e.path()).collect()).unwrap_or_default();
    files.sort();
    files.iter().filter_map(|f| read_recording(f, &OpenOptions::default()).ok()).collect()
}

fn family(f: Family) -> Value {
    match f {
        Family::Mesh { stage, harmonic } => json!(["m", stage, harmonic]),
        Family::Shaft { shaft, multiple } => json!(["s", shaft, multiple]),
        Family::Motor { multiple } => json!(["o", multiple]),
        Family::Side { stage, harmonic, shaft, offset } => json!(["b", stage, harmonic, shaft, offset]),
    }
}

fn features(t: &mut Transforms, r: &RecordingFeatures) -> Value {
    let r5 = |x: f64| if x.is_finite() { json!(format!("{x:.4e}").parse::<f64>().unwrap_or(x)) } else { Value::Null };
    let channels: Vec<Value> = r
        .channels
        .iter()
        .map(|c| {
            let values: Vec<Value> = c
                .values
                .iter()
                .map(|v| match v {
                    Some(v) => json!([r5(v.amplitude.re), r5(v.amplitude.im), r5(v.noise)]),
                    None => Value::Null,
                })
                .collect();
            let combs: Vec<Vec<Value>> = c
                .combs
                .iter()
                .map(|k| k.iter().map(|v| json!([r5(v.amplitude.re), r5(v.amplitude.im), r5(v.noise)])).collect())
                .collect();
            let floor: Vec<Value> = c.floor.iter().map(|f| json!([r5(f.frequency_hz), r5(f.power), f.bins])).collect();
            let unsteady: Vec<Value> = transients::unsteady(t, r, c)
                .iter()
                .map(|u| json!([u.frequency_hz, r5(u.bursts), r5(u.wander), r5(u.peaks)]))
                .collect();
            json!({"name": c.name, "unsteady": unsteady, "values": values, "combs": combs, "floor": floor,
                   "clipped": c.integrity.clipped_at, "frozen": c.integrity.frozen, "overload": c.integrity.overload})
        })
        .collect();
    json!({"name": r.name, "display": r5(r.display_motor_hz), "torque": r5(r.brake_torque_nm), "input_hz": r.input_hz,
           "tacho_hz": r.tacho_input_hz, "score": r5(r.comb_score), "carriers": r.carriers, "revs": r.revolutions,
           "lines": r.lines.iter().map(|l| json!([family(l.family), l.order])).collect::<Vec<_>>(), "channels": channels})
}

fn evidence(m: &Measured) -> Value {
    let lines = |all: &[gearwatch_explain::read::scan::StrangeLine]| -> Vec<Value> {
        all.iter()
            .map(|l| {
                json!({"at": l.position, "channel": l.channel, "excess": l.excess, "least": l.least,
                            "by_channel": l.by_channel, "off_comb": l.off_comb, "amplitudes": l.amplitudes})
            })
            .collect()
    };
    let fixed = |l: &gearwatch_explain::read::fixed::FixedLine| {
        json!({"hz": l.hz.0, "multiple": l.multiple, "channel": l.channel, "amplitude": l.amplitude.0, "gain": l.gain,
               "by_speed": l.by_speed, "elsewhere": l.elsewhere})
    };
    let mut t = Transforms::default();
    json!({
        "stages": m.train.stages.iter().map(|s| json!([s.name, s.pinion_teeth, s.wheel_teeth, s.mesh_order])).collect::<Vec<_>>(),
        "shafts": m.train.shafts, "motor_order": m.train.motor_order, "belt": m.bench.belt.is_some(),
        "sensors": m.bench.sensors.iter().map(|s| json!([s.name, s.shaft, s.direction_deg])).collect::<Vec<_>>(),
        "nominal_torque": m.bench.brake.torque_nm,
        "tacho": m.bench.tacho.as_ref().map(|t| t.shaft.clone()),
        "recordings": m.recordings.iter().map(|r| features(&mut t, r)).collect::<Vec<_>>(),
        "references": m.references.iter().map(|r| features(&mut t, r)).collect::<Vec<_>>(),
        "pairs": m.comparison.pairs.iter().map(|p| json!([p.recording, p.reference, p.speed_hz, p.torque_nm, p.speed_gap])).collect::<Vec<_>>(),
        "channels": m.comparison.channels,
        "slip": m.ratios.slip, "clock": m.ratios.clock,
        "teeth": m.teeth.as_ref().map(|t| format!("{t:?}")),
        "fixed": lines(&m.strange.fixed), "orders": lines(&m.strange.orders),
        "envelope": m.strange.envelope.as_ref().map(|e| json!({"order": e.order, "score": e.score, "by_channel": e.by_channel, "noise": e.noise})),
        "picked_up": m.strange.picked_up.iter().map(fixed).collect::<Vec<_>>(),
        "folded": m.strange.folded.as_ref().map(|f| json!({"order": f.order, "channel": f.channel, "least": f.least, "amplitude": f.amplitude})),
    })
}

/// Draws cases and scores the answers.
fn drawn(seed: u64, first: u64, last: u64) {
    let (mut sum, mut count, mut nulls, mut false_names) = (0.0, 0usize, 0usize, 0usize);
    for index in first..last {
        let begin = Instant::now();
        let Some(Ok(s)) = gearwatch_explain::prove::prove(seed, index, None) else { continue };
        let truth: Vec<String> = s.truth.effects.iter().map(|e| format!("{}@{}", e.effect, e.place)).collect();
        let named: Vec<String> = s
            .named
            .iter()
            .map(|n| format!("{}@{} {:.2}{}", n.0, n.1, n.2, if n.3 { "" } else { " (wrong)" }))
            .collect();
        println!(
            "{index} {:?} ref {} {} -> {} {} first {:?} {:.1} s",
            s.truth.kind,
            s.truth.reference,
            truth.join(" + "),
            s.status.code(),
            named.join(", "),
            s.first,
            begin.elapsed().as_secs_f64()
        );
        if s.truth.kind == gearwatch_explain::prove::Kind::Null {
            nulls += 1;
            false_names += usize::from(!s.named.is_empty());
        }
        sum += s.first.iter().sum::<f64>();
        count += s.first.len();
    }
    println!("named first {sum} of {count}; false names on {false_names} of {nulls} nulls");
}

fn main() {
    let args: Vec<String> = std::env::args().skip(1).collect();
    if let [mode, seed, first, last] = &args[..]
        && mode == "drawn"
    {
        drawn(seed.parse().expect("a seed"), first.parse().expect("a number"), last.parse().expect("a number"));
        return;
    }
    let [mode, cases, out, names @ ..] = &args[..] else {
        eprintln!("cases explain|evidence CASES OUT [CASE...]");
        std::process::exit(2);
    };
    let out = Path::new(out);
    std::fs::create_dir_all(out).expect("the folder of answers");
    let mut folders: Vec<PathBuf> = std::fs::read_dir(cases).expect("the cases").flatten().map(|e| e.path()).collect();
    folders.retain(|f| f.join("bench.toml").exists());
    folders.sort();
    for folder in folders {
        let name = folder.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if !names.is_empty() && !names.contains(&name) {
            continue;
        }
        let target =
            if mode == "explain" { out.join(&name).join("explanation.json") } else { out.join(format!("{name}.json")) };
        if target.exists() {
            continue;
        }
        let Ok(bench) = gearwatch_io::bench_file::read(&folder.join("bench.toml")) else { continue };
        let (now, before) = (recordings(&folder.join("recordings")), recordings(&folder.join("reference")));
        let input = Input { bench: &bench, recordings: &now, reference: &before, without: &[] };
        let begin = Instant::now();
        let text = if mode == "explain" {
            match explain(&input, &mut |_| {}) {
                Ok(answer) => {
                    std::fs::create_dir_all(out.join(&name)).expect("the folder of an answer");
                    let toml = gearwatch_io::bench_file::to_toml(&answer.bench).expect("a bench file");
                    std::fs::write(out.join(&name).join("bench.toml"), toml).expect("a bench file");
                    serde_json::to_string_pretty(&answer.explanation).expect("JSON")
                }
                Err(e) => {
                    println!("{name}: {e}");
                    continue;
                }
            }
        } else {
            match measure(&input, &mut |_| {}) {
                Ok(m) => evidence(&m).to_string(),
                Err(e) => {
                    println!("{name}: {e}");
                    continue;
                }
            }
        };
        let seconds = begin.elapsed().as_secs_f64();
        std::fs::write(&target, text).expect("an answer");
        println!("{name} 0 {seconds:.2}");
        if mode == "explain" {
            use std::io::Write;
            let mut times =
                std::fs::OpenOptions::new().create(true).append(true).open(out.join("times.txt")).expect("times");
            writeln!(times, "{name} 0 {seconds:.2}").expect("times");
        }
    }
}
