//! Known changes in real recordings of a two-stage box (`../shared/data/gfd_spectraquest` beside
//! the checkout; skipped where it is missing).

#![allow(
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "the table is shown with --nocapture, and what was skipped is told"
)]

use std::io::Read;
use std::path::PathBuf;

use flate2::read::GzDecoder;
use gearwatch_check::dsp::Transforms;
use gearwatch_check::kinematics;
use gearwatch_check::steady::{Steady, steady};
use gearwatch_check::{Look, Severity, check};
use gearwatch_core::bench::{Bench, Sensor};
use gearwatch_core::block::{Block, OperatingPoint, Packet, Quality, Samples};
use gearwatch_core::recording::{Channel, Recording, Segment};
use gearwatch_core::train::Train;
use gearwatch_explain::drill::change::{Change, Kind};
use gearwatch_explain::drill::{INSTRUMENT, Outcome, Question, drill, halves, table};
use gearwatch_explain::explain::{Input, explain};
use gearwatch_explain::instrument;
use rayon::prelude::*;

/// Inferred from the lines in the recordings (README there).
const RATE_HZ: f64 = 12_800.0;
/// All loads of the recordings (%), and those at which the sheet is asked.
const LOADS: [u32; 6] = [0, 10, 30, 50, 70, 90];
const SHEET_LOADS: [u32; 3] = [0, 50, 90];
/// Where the drive display stands: the motor turns at 29.6 to 29.8 Hz.
const MOTOR_HZ: f64 = 29.7;

/// The shipped bench of that kind with the four sensors of the recordings, whose unit and places
/// nobody stated.
fn bench() -> Bench {
    let shipped = gearwatch_sim::shipped::BENCHES.iter().find(|b| b.name == "spectraquest-like").unwrap().text;
    let mut bench: Bench = toml::from_str(shipped).unwrap();
    bench.sensors = [("a1", "input"), ("a2", "intermediate"), ("a3", "output"), ("a4", "output")]
        .map(|(name, shaft)| Sensor { name: name.into(), shaft: shaft.into(), direction_deg: 90.0, unit: "1".into() })
        .into();
    bench.housing_modes.clear();
    bench.effects.clear();
    bench.tacho = None;
    bench.acquisition.sample_rate_hz = RATE_HZ;
    bench
}

/// Recordings by state (`h`, `b`) and load (%); none where the data is missing.
fn recordings(states: &str, loads: &[u32]) -> Vec<Recording> {
    let usual = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data/gfd_spectraquest");
    let folder = std::env::var_os("GEARWATCH_RECORDINGS").map_or_else(|| PathBuf::from(usual), PathBuf::from);
    if !folder.is_dir() {
        eprintln!("skipped: there is no {}", folder.display());
        return Vec::new();
    }
    let names = states.chars().flat_map(|s| loads.iter().map(move |l| (format!("{s}30hz{l}"), *l)));
    names
        .map(|(name, load)| {
            let mut text = String::new();
            let file = std::fs::File::open(folder.join(format!("{name}.csv.gz"))).unwrap();
            GzDecoder::new(file).read_to_string(&mut text).unwrap();
            let rows: Vec<Vec<f64>> =
                text.lines().skip(1).map(|l| l.split(',').map(|f| f.trim().parse().unwrap()).collect()).collect();
            let mut out = Recording { name, ..Recording::default() };
            for c in 0..4 {
                let samples = rows.iter().map(|r| r[c]).collect();
                let segment = Segment { t0: 0, first_sample_index: 0, samples, quality: Quality::GOOD };
                let channel = Channel { sample_rate_hz: RATE_HZ, unit: "1".into(), segments: vec![segment] };
                out.channels.insert(format!("a{}", c + 1), channel);
            }
            let brake_torque_nm = f64::from(load);
            let point = OperatingPoint { motor_speed_hz: MOTOR_HZ, brake_torque_nm, ..OperatingPoint::UNKNOWN };
            out.operating_points.push(point);
            out
        })
        .collect()
}

fn run(recordings: &[Recording], kinds: &[Kind]) -> Vec<Outcome> {
    let done = |through: usize, all: usize| {
        if through.is_multiple_of(50) {
            eprintln!("{through} of {all}");
        }
    };
    let sheet = bench();
    let outcomes = drill(&Question { bench: &sheet, recordings, reference: &[], kinds }, &done).unwrap();
    for o in outcomes.iter().filter(|o| !o.is_right()) {
        println!("{} {:?} place {} size {}: {:?}", o.recording, o.change.kind, o.change.place, o.change.size, o.named);
    }
    outcomes
}

/// Parts of one recording that nobody changed, and what each is compared with: from so far to so
/// far.
const SPLITS: [[(f64, f64); 2]; 4] =
    [[(0.5, 1.0), (0.0, 0.5)], [(0.0, 0.5), (0.5, 1.0)], [(0.6, 1.0), (0.0, 0.6)], [(0.0, 0.4), (0.4, 1.0)]];

/// From a share of the recording to another.
fn part(recording: &Recording, from: f64, to: f64) -> Recording {
    let mut out = recording.clone();
    for run in out.channels.values_mut().flat_map(|c| &mut c.segments) {
        let at = |share: f64| (share * run.samples.len() as f64) as usize;
        let (from, to) = (at(from), at(to));
        run.samples = run.samples[from..to].to_vec();
        run.first_sample_index += from as u64;
        run.t0 += (from as f64 * 1e9 / RATE_HZ).round() as i64;
    }
    out
}

/// What is named of each split: effects and places.
fn undisturbed(recordings: &[Recording]) -> Vec<Vec<(String, String)>> {
    let sheet = bench();
    let splits: Vec<[Recording; 2]> =
        recordings.iter().flat_map(|r| SPLITS.map(|parts| parts.map(|(from, to)| part(r, from, to)))).collect();
    splits
        .par_iter()
        .map(|[now, before]| {
            let [recordings, reference] = [now, before].map(std::slice::from_ref);
            let answer = explain(&Input { bench: &sheet, recordings, reference, without: &[] }, &mut |_| {}).unwrap();
            answer.explanation.effects.into_iter().map(|e| (e.effect, e.place)).collect()
        })
        .collect()
}

/// All channels at one level, in every recording.
fn levelled(recordings: &[Recording]) -> Vec<Recording> {
    let mut out = recordings.to_vec();
    for run in out.iter_mut().flat_map(|r| r.channels.values_mut()).flat_map(|c| &mut c.segments) {
        let rms = (run.samples.iter().map(|x| x * x).sum::<f64>() / run.samples.len() as f64).sqrt();
        run.samples.iter_mut().for_each(|x| *x /= rms);
    }
    out
}

/// Lines of the table in the documentation.
fn lines(outcomes: &[Outcome], beside: &str) -> String {
    let mut text = String::new();
    for row in table(outcomes) {
        let (_, unit) = row.kind.sizes();
        let size = match unit {
            "" => String::new(),
            "bits" => format!("{:.0} bits", -row.size),
            _ => format!("{} {unit}", row.size),
        };
        let others: Vec<String> = row.others.iter().take(4).map(|(name, n)| format!("{name} {n}")).collect();
        text.push_str(&format!(
            "| {}{beside} | {size} | {} | {} | {} | {} |\n",
            row.kind.words(),
            row.runs,
            row.right,
            row.physics,
            others.join(", ")
        ));
    }
    text
}

/// The changes that go through the whole of `explain`, one size of each, and all that are asked of
/// the instrument's part alone.
const WHOLE: [(Kind, f64); 6] = [
    (Kind::Gain, 3.0),
    (Kind::Swap, 1.0),
    (Kind::Dead, 1.0),
    (Kind::Polarity, 1.0),
    (Kind::Mains, 3.0),
    (Kind::Lost, 512.0),
];

/// A change in the second half of each recording, at all its places, and what is named of it.
fn changed(recordings: &[Recording], changes: &[(Kind, f64)], whole: bool) -> Vec<Outcome> {
    changed_on(&bench(), recordings, changes, whole)
}

/// The same on any bench.
fn changed_on(sheet: &Bench, recordings: &[Recording], changes: &[(Kind, f64)], whole: bool) -> Vec<Outcome> {
    let mut tasks = Vec::new();
    for (kind, size) in changes {
        for (place, truth) in kind.places(sheet).into_iter().enumerate() {
            let change = Change { kind: *kind, place, size: *size };
            tasks.extend(recordings.iter().map(|r| (r, change, truth.clone())));
        }
    }
    let through = std::sync::atomic::AtomicUsize::new(0);
    let count = tasks.len();
    tasks
        .into_par_iter()
        .map(|(recording, change, truth)| {
            let named =
                if whole { explained(sheet, recording, change) } else { Ok(examined(sheet, recording, change)) };
            let done = 1 + through.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
            if done.is_multiple_of(50) {
                eprintln!("{done} of {count}");
            }
            let outcome = Outcome { change, recording: recording.name.clone(), truth, named };
            if !outcome.is_right() {
                let Change { kind, place, size } = change;
                println!("{} {kind:?} place {place} size {size}: {:?}", outcome.recording, outcome.named);
            }
            outcome
        })
        .collect()
}

/// What the whole of `explain` names of one change in the second half of a recording.
fn explained(sheet: &Bench, recording: &Recording, change: Change) -> Result<Vec<(String, String)>, String> {
    let mut sheet = sheet.clone();
    let (mut now, reference) = halves(recording).remove(0);
    change.make(&mut sheet, &mut now, MOTOR_HZ, 1);
    let recordings = std::slice::from_ref(&now);
    explain(&Input { bench: &sheet, recordings, reference: &reference, without: &[] }, &mut |_| {})
        .map(|a| a.explanation.effects.into_iter().map(|e| (e.effect, e.place)).collect())
        .map_err(|e| e.to_string())
}

/// The head of a table in the documentation.
const HEAD: &str = "| change | size | runs | named right | with a name of the machine | what else was named |\n|---|---|---|---|---|---|\n";

/// With `GEARWATCH_WRITE` a table goes into its place in `docs/instrument-faults.md`.
fn write(place: &str, text: &str) {
    println!("{text}");
    if std::env::var_os("GEARWATCH_WRITE").is_some() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/instrument-faults.md");
        let page = std::fs::read_to_string(path).unwrap();
        let (before, rest) = page.split_once(&format!("<!-- {place} -->\n")).unwrap();
        let (_, after) = rest.split_once(&format!("<!-- end of {place} -->")).unwrap();
        std::fs::write(path, format!("{before}<!-- {place} -->\n{text}<!-- end of {place} -->{after}")).unwrap();
    }
}

/// Of each kind at least 95 % are right.
fn most_are_right(outcomes: &[Outcome]) {
    for kind in Kind::INSTRUMENT {
        let of_kind: Vec<&Outcome> = outcomes.iter().filter(|o| o.change.kind == kind).collect();
        let right = of_kind.iter().filter(|o| o.is_right()).count();
        assert!(100 * right >= 95 * of_kind.len(), "{kind:?}: {right} of {}", of_kind.len());
    }
}

/// Four splits of each recording, through the whole of `explain`: at most one of forty gets a name.
#[test]
#[ignore = "minutes: just campaign-drill"]
fn campaign_table_of_undisturbed_parts() {
    let recordings = recordings("hb", &LOADS);
    if recordings.is_empty() {
        return;
    }
    let all = undisturbed(&recordings);
    let named: Vec<&Vec<(String, String)>> = all.iter().filter(|n| !n.is_empty()).collect();
    let of_machine =
        named.iter().filter(|n| n.iter().any(|(effect, _)| !INSTRUMENT.contains(&effect.as_str()))).count();
    let (runs, right) = (all.len(), all.len() - named.len());
    write("undisturbed", &format!("{HEAD}| nothing (parts of one file) | | {runs} | {right} | {of_machine} | |\n"));
    assert!(40 * named.len() <= runs, "{named:?}");
}

/// Every change of the instrument but the clock, which takes a tacho, at every size and place in
/// every recording, asked of the instrument's part alone.
#[test]
#[ignore = "minutes: just campaign-drill"]
fn campaign_table_of_the_instruments_part() {
    let recordings = recordings("hb", &LOADS);
    if recordings.is_empty() {
        return;
    }
    let all: Vec<(Kind, f64)> = Kind::INSTRUMENT
        .into_iter()
        .filter(|k| *k != Kind::Clock)
        .flat_map(|k| k.sizes().0.iter().map(move |s| (k, *s)))
        .collect();
    let (plain, level) =
        (changed(&recordings, &all, false), changed(&levelled(&recordings), &[(Kind::Swap, 1.0)], false));
    write("alone", &format!("{HEAD}{}{}", lines(&plain, ""), lines(&level, ", all channels at one level")));
    most_are_right(&plain);
    most_are_right(&level);
}

/// One size of six changes, at every place and load (`GEARWATCH_LOADS`), through the whole of
/// `explain`: no run names anything of the machine.
#[test]
#[ignore = "an hour of one core: just campaign-drill"]
fn campaign_table_of_the_whole() {
    let recordings = recordings("hb", &asked_loads());
    if recordings.is_empty() {
        return;
    }
    let outcomes = changed(&recordings, &WHOLE, true);
    write("whole", &format!("{HEAD}{}", lines(&outcomes, "")));
    most_are_right(&outcomes);
    assert_eq!(outcomes.iter().map(Outcome::physics).sum::<usize>(), 0);
}

/// One tooth more in the sheet, on each gear, through the whole of `explain`: named, or nothing is.
/// A tooth of the last wheel moves no mesh line, and shows in sidebands that a box without load
/// hardly has.
#[test]
#[ignore = "minutes: just campaign-drill"]
fn campaign_table_of_the_sheet() {
    let recordings = recordings("hb", &SHEET_LOADS);
    if recordings.is_empty() {
        return;
    }
    let outcomes = changed(&recordings, &[(Kind::Sheet, 1.0)], true);
    write("sheet", &format!("{HEAD}{}", lines(&outcomes, "")));
    assert_eq!(outcomes.iter().map(Outcome::physics).sum::<usize>(), 0);
    let wrong = |o: &&Outcome| !o.is_right() && o.named.as_ref().is_ok_and(|named| !named.is_empty());
    assert_eq!(outcomes.iter().filter(wrong).count(), 0);
}

/// Loads from `GEARWATCH_LOADS`; all without.
fn asked_loads() -> Vec<u32> {
    let asked = |text: String| text.split(',').map(|load| load.parse().unwrap()).collect();
    std::env::var("GEARWATCH_LOADS").map_or(LOADS.to_vec(), asked)
}

/// Kinds by name from `GEARWATCH_KINDS`, recordings from `GEARWATCH_LOADS` and `GEARWATCH_STATES`;
/// all without.
#[test]
#[ignore = "minutes: GEARWATCH_KINDS=Swap,Lost cargo test -p gearwatch-explain --test drill -- --ignored --nocapture"]
fn campaign_changes_in_real_recordings() {
    let asked = |name: &str, usual: &str| std::env::var(name).unwrap_or_else(|_| usual.into());
    let kinds = asked("GEARWATCH_KINDS", "");
    let all = std::iter::once(Kind::Nothing).chain(Kind::INSTRUMENT).chain(Kind::MACHINE);
    let kinds: Vec<Kind> =
        all.filter(|k| kinds.is_empty() || kinds.split(',').any(|n| n == format!("{k:?}"))).collect();
    let recordings = recordings(&asked("GEARWATCH_STATES", "hb"), &asked_loads());
    if !recordings.is_empty() {
        println!("{}", lines(&run(&recordings, &kinds), ""));
    }
}

/// Other benches: each folder of `GEARWATCH_CASES` holds `bench.toml` and `recordings/`. Every
/// change but the clock is put into the second half of each recording and asked of the instrument's
/// part alone; at least 95 % of each kind are named right. Halves that nobody changed get no name
/// of it.
#[test]
#[ignore = "minutes: GEARWATCH_CASES=folder cargo test -p gearwatch-explain --test drill -- --ignored --nocapture other_benches"]
fn campaign_changes_in_recordings_of_other_benches() {
    let Some(cases) = std::env::var_os("GEARWATCH_CASES") else { return };
    let mut folders: Vec<PathBuf> = std::fs::read_dir(cases).unwrap().map(|e| e.unwrap().path()).collect();
    folders.retain(|f| f.join("bench.toml").is_file());
    folders.sort();
    let changes: Vec<(Kind, f64)> = std::iter::once(Kind::Nothing)
        .chain(Kind::INSTRUMENT)
        .filter(|k| *k != Kind::Clock)
        .flat_map(|k| k.sizes().0.iter().map(move |s| (k, *s)))
        .collect();
    let mut all = Vec::new();
    for folder in folders {
        let sheet = gearwatch_io::bench_file::read(&folder.join("bench.toml")).unwrap();
        let mut files: Vec<PathBuf> =
            std::fs::read_dir(folder.join("recordings")).unwrap().map(|e| e.unwrap().path()).collect();
        files.sort();
        let recordings: Vec<Recording> = files
            .iter()
            .map(|f| gearwatch_io::read_recording(f, &gearwatch_io::OpenOptions::default()).unwrap())
            .collect();
        println!("{}", folder.display());
        all.extend(changed_on(&sheet, &recordings, &changes, false));
    }
    println!("{}", lines(&all, ""));
    most_are_right(&all);
    assert!(all.iter().filter(|o| o.change.kind == Kind::Nothing).all(Outcome::is_right));
}

/// What the instrument's part alone names of one change in the second half of a recording: effects
/// and places.
fn examined(sheet: &Bench, recording: &Recording, change: Change) -> Vec<(String, String)> {
    let mut sheet = sheet.clone();
    let (mut changed, reference) = halves(recording).remove(0);
    change.make(&mut sheet, &mut changed, MOTOR_HZ, 1);
    let found = instrument::examine(&sheet, &[changed], &reference).faults;
    found.into_iter().map(|f| (f.effect.to_owned(), f.place)).collect()
}

/// One change of each kind at one load, in every run of the tests: each is named, at its place, and
/// nothing beside; halves that nobody changed get no name.
#[test]
fn literature_instrument_changes_of_a_real_recording_are_named() {
    let recordings = recordings("h", &[30]);
    for recording in &recordings {
        let unchanged = examined(&bench(), recording, Change { kind: Kind::Nothing, place: 0, size: 1.0 });
        assert!(unchanged.is_empty(), "{}: {unchanged:?}", recording.name);
        for kind in Kind::INSTRUMENT.into_iter().filter(|k| *k != Kind::Clock) {
            let (place, truth) = kind.places(&bench()).into_iter().enumerate().next_back().unwrap();
            let size = kind.sizes().0[kind.sizes().0.len() - 1];
            let named = examined(&bench(), recording, Change { kind, place, size });
            let expected: Vec<(String, String)> =
                truth.iter().map(|t| (t.effect.to_owned(), t.place.clone())).collect();
            let same = named.len() == expected.len() && expected.iter().all(|t| named.contains(t));
            assert!(same, "{kind:?}: {named:?}");
        }
    }
}

/// A file says the nominal speed, the motor turns slower: without a reference nothing of it is
/// named, neither teeth nor a clock nor a bearing at the sum of two shafts' orders (1.400 of the
/// healthy box; 2.6, three of the input less one of the intermediate shaft, of the broken one).
#[test]
fn regress_a_nominal_speed_is_no_fault_of_the_machine() {
    for states in ["h", "b"] {
        let mut recordings = recordings(states, &[0, 30, 90]);
        if recordings.is_empty() {
            return;
        }
        recordings.iter_mut().flat_map(|r| &mut r.operating_points).for_each(|point| point.motor_speed_hz = 30.0);
        let input = Input { bench: &bench(), recordings: &recordings, reference: &[], without: &[] };
        let answer = explain(&input, &mut |_| {}).unwrap().explanation;
        let named: Vec<(&str, &str)> = answer.effects.iter().map(|e| (&*e.effect, &*e.place)).collect();
        assert!(named.is_empty(), "{states}: {named:?}");
        assert!(answer.limits.iter().all(|l| !l.contains("not judged:")), "{:?}", answer.limits);
    }
}

/// A recording as it is looked at before the first verdict, at a rate and a motor speed that are
/// stated.
fn look(recording: &Recording, sample_rate_hz: f64, motor_speed_hz: f64) -> Look {
    let mut look = Look::new(&recording.name);
    for point in &recording.operating_points {
        look.push(&Packet::OperatingPoint(OperatingPoint { motor_speed_hz, ..*point }));
    }
    for (name, channel) in &recording.channels {
        for segment in &channel.segments {
            look.push(&Packet::Vibration(Block {
                sensor: name.as_str().into(),
                t0: segment.t0,
                sample_rate_hz,
                first_sample_index: segment.first_sample_index,
                unit: channel.unit.clone(),
                samples: Samples::Physical(segment.samples.iter().map(|x| *x as f32).collect()),
                quality: Quality::GOOD,
            }));
        }
    }
    look
}

/// The motor of the real box slips by 0.8 to 1.3 % behind the nominal 30 Hz: that is noted, and no
/// doubt of speed, lines or teeth. At twice and half the true rate each recording is refused for
/// its rate, with the speed stated and without, or doubted at least: none is silent.
#[test]
fn regress_slip_and_rate_of_a_real_motor_are_told_apart() {
    let recordings = recordings("h", &LOADS);
    let sheet = bench();
    let ids = |checked: &gearwatch_check::Checked, least: Severity| -> Vec<&'static str> {
        checked.findings.iter().filter(|f| f.severity >= least).map(|f| f.id).collect()
    };
    let (mut refused, mut all) = (0, 0);
    for recording in &recordings {
        let checked = check(&sheet, &[look(recording, RATE_HZ, 30.0)], None);
        assert_eq!(ids(&checked, Severity::Doubtful), Vec::<&str>::new(), "{}: {checked:#?}", recording.name);
        assert!(ids(&checked, Severity::Note).contains(&"slip"), "{}", recording.name);
        for (rate, speed) in [(2.0, 30.0), (0.5, 30.0), (2.0, f64::NAN), (0.5, f64::NAN)] {
            let checked = check(&sheet, &[look(recording, rate * RATE_HZ, speed)], None);
            println!(
                "{} at {rate} of its rate, stated {speed} Hz: {:?}",
                recording.name,
                checked.findings.iter().map(|f| (f.id, f.severity)).collect::<Vec<_>>()
            );
            assert!(
                ids(&checked, Severity::Doubtful).contains(&"sample_rate"),
                "{} at {rate}: {checked:#?}",
                recording.name
            );
            refused += usize::from(checked.refusal().is_some());
            all += 1;
        }
    }
    println!("{refused} of {all} refused, the others doubtful");
    // Twice the rate at 90 % load is doubtful, with and without a stated speed.
    assert!(10 * refused >= 9 * all);
}

/// The second stage's mesh is faint beside the first's: one tooth more or fewer on its pinion is
/// told all the same, and the right number is left alone.
#[test]
fn literature_a_tooth_off_in_a_faint_stage_is_counted() {
    for recording in recordings("hb", &[30]) {
        for sheet in [47, 48, 49] {
            let sheet = kinematics::with_teeth(&bench(), 1, true, sheet).unwrap();
            let steady: Vec<Steady<'_>> = steady(&sheet, &Train::new(&sheet), &recording).ok().into_iter().collect();
            let fields: Vec<_> = steady.iter().map(|s| s.comb_field(&mut Transforms::default())).collect();
            let found = kinematics::other_teeth(&sheet, &steady, &fields).map(|f| (f.0.stage, f.0.pinion, f.0.teeth));
            let truth = (sheet.stages[1].pinion.teeth != 48).then_some((1, true, 48));
            assert_eq!(found, truth, "{}", recording.name);
        }
    }
}

/// A tooth more or fewer on one gear, where the nominal speed is stated, behind which the motor
/// slips by about as much as a tooth is: each is told at its gear by recordings of three loads, and
/// by one of them alone in 23 of 24 at least (33 teeth for 32 at 30 % load may pass: with 3.9 % of
/// slip that sheet meets as many lines). No other gear is named.
#[test]
fn regress_a_tooth_off_is_told_at_the_nominal_speed() {
    let recordings = recordings("h", &[0, 30, 90]);
    let looks: Vec<Look> = recordings.iter().map(|r| look(r, RATE_HZ, 30.0)).collect();
    if looks.is_empty() {
        return;
    }
    let mut silent = 0;
    for (stage, pinion) in [(0, true), (0, false), (1, true), (1, false)] {
        let right = &bench().stages[stage];
        let (gear, teeth) = if pinion { ("pinion", right.pinion.teeth) } else { ("wheel", right.wheel.teeth) };
        for wrong in [teeth - 1, teeth + 1] {
            let sheet = kinematics::with_teeth(&bench(), stage, pinion, wrong).unwrap();
            let expected = [(format!("{}.{gear}", right.name), format!("lines of {teeth} teeth"))];
            let told = |looks: &[Look]| -> Vec<(String, String)> {
                let checked = check(&sheet, looks, None);
                let teeth = checked.findings.iter().filter(|f| f.id == "tooth_number" && f.severity > Severity::Note);
                teeth.map(|f| (f.place.clone(), f.found.split(',').next().unwrap_or_default().to_owned())).collect()
            };
            assert_eq!(told(&looks), expected);
            for look in &looks {
                let told = told(std::slice::from_ref(look));
                assert!(told.is_empty() || told == expected, "{}: {told:?}, {expected:?}", look.name());
                silent += usize::from(told.is_empty());
            }
        }
    }
    assert!(silent <= 1, "{silent} of 24");
}
