use gearwatch_io::budget::Budget;
use gearwatch_io::uff::{Dataset, Form, Parsed, Values, write};
use gearwatch_io::{OpenOptions, Problem};

use gearwatch_testkit::files::{read, shared, values};

fn parse(bytes: &[u8]) -> Result<Parsed, Problem> {
    gearwatch_io::uff::parse(bytes, &mut Budget::of_bytes(bytes))
}

/// The same record as text and as binary: the same values to the six digits of the text.
#[test]
fn oracle_text_and_binary_of_one_record_agree() {
    let Some(folder) = shared("data/readers") else { return };
    let (text, _) = read(&folder.join("Sample_UFF58_ascii.uff"), &OpenOptions::default()).unwrap();
    let (binary, _) = read(&folder.join("Sample_UFF58b_bin.uff"), &OpenOptions::default()).unwrap();
    let (text, binary) = (values(&text, "Mic_01"), values(&binary, "Mic_01"));
    assert_eq!(text.len(), 79_292);
    assert_eq!(text.len(), binary.len());
    for (a, b) in text.iter().zip(&binary) {
        // Half a unit of the sixth digit, and the rounding of the text to a single.
        let digit = 10_f64.powf(b.abs().max(1e-30).log10().floor() - 5.0);
        assert!((a - b).abs() <= 0.5 * digit + f64::from(f32::EPSILON) * b.abs(), "{a} {b}");
    }
}

/// A whole number of hertz is found behind the six digits of the step.
#[test]
fn oracle_sample_rates_are_whole() {
    let Some(folder) = shared("data/readers") else { return };
    for (name, rate, count) in [
        ("Sample_UFF58_ascii.uff", 65_536.0, 1),
        ("MPSTD_Set001_4ch_accel_bin.uff", 3200.0, 4),
        ("binary8byte.uff", 100.0, 1),
    ] {
        let parsed = parse(&std::fs::read(folder.join(name)).unwrap()).unwrap();
        assert_eq!(parsed.datasets.len(), count);
        assert!(parsed.datasets.iter().all(|d| d.sample_rate_hz == rate), "{name}");
    }
}

fn dataset(values: Values) -> Dataset {
    Dataset {
        name: "acc 1".into(),
        unit: Some("m/s^2".into()),
        sample_rate_hz: 16_384.0,
        t0: 1_460_987_398_500_000_000,
        values,
    }
}

/// Binary is exact; text is exact to its digits.
#[test]
fn conform_what_is_written_is_read() {
    let single = dataset(Values::Single((0..100).map(|i| (i as f32 * 0.37).sin() * 1e-3).collect()));
    let double = dataset(Values::Double((0..101).map(|i| f64::from(i).exp() * -1e-20).collect()));
    for form in [Form::LittleEndian, Form::BigEndian] {
        let mut out = Vec::new();
        write(&mut out, &[single.clone(), double.clone()], form).unwrap();
        assert_eq!(parse(&out).unwrap().datasets, [single.clone(), double.clone()]);
    }
    let mut out = Vec::new();
    write(&mut out, &[single.clone(), double.clone()], Form::Text).unwrap();
    for (got, wanted) in parse(&out).unwrap().datasets.iter().zip([&single, &double]) {
        let relative = if matches!(wanted.values, Values::Single(_)) { 6e-6 } else { 6e-13 };
        assert_eq!((got.t0, got.sample_rate_hz), (wanted.t0, wanted.sample_rate_hz));
        for (a, b) in got.values.iter().zip(wanted.values.iter()) {
            assert!((a - b).abs() <= relative * b.abs(), "{a} {b}");
        }
    }
}

/// D exponents, numbers that touch, empty lines before the end, other datasets before and after.
#[test]
fn conform_habits_of_other_programs_are_read() {
    let mut out = Vec::new();
    write(&mut out, &[dataset(Values::Single(vec![-1.25; 12]))], Form::Text).unwrap();
    let text = String::from_utf8(out).unwrap();
    let text = text.replace("E+", "D+").replace("    -1\r\n", "\r\n    -1\r\n");
    let text = format!("    -1\n   151\nmodel\n    -1\n{text}    -1\n   164\nunits\n    -1\n");
    // Thirteen columns with a sign fill them: the numbers touch.
    let text = text.replace(" -1.25000D+00", "-1.250000D+00");
    let parsed = parse(text.as_bytes()).unwrap();
    assert_eq!(parsed.datasets[0].values, Values::Single(vec![-1.25; 12]));
    assert_eq!(parsed.warnings.len(), 2, "{:?}", parsed.warnings);
}

#[test]
fn conform_contradictions_are_refused() {
    let mut out = Vec::new();
    write(&mut out, &[dataset(Values::Single(vec![1.0; 12]))], Form::Text).unwrap();
    let text = String::from_utf8(out).unwrap();
    let more = text.replace("         2        12", "         2        13");
    assert!(parse(more.as_bytes()).unwrap_err().to_string().contains("1 more values"));
    let huge = text.replace("         2        12", "         2999999999");
    assert!(parse(huge.as_bytes()).unwrap_err().to_string().contains("at most"));
    let fewer = text.replace("         2        12", "         2         7");
    assert!(parse(fewer.as_bytes()).is_err());
}
