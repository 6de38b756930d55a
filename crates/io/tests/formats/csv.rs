use gearwatch_core::block::Quality;
use gearwatch_io::OpenOptions;

use gearwatch_testkit::files::{blocks, gzip, put, read, shared, values};

fn given(rate: f64) -> OpenOptions {
    OpenOptions { sample_rate_hz: Some(rate), unit: Some("g".into()), ..OpenOptions::default() }
}

/// The same three rows, written in the ways that are common.
#[test]
fn conform_delimiters_decimal_signs_and_headers_are_found_out() {
    let folder = tempfile::tempdir().unwrap();
    let ways = [
        "1.5,2.5\n-3.25,4\n5e-1,6\n",
        "1,5;2,5\n-3,25;4\n0,5;6\n",
        "1.5\t2.5\r\n-3.25\t4\r\n0.5\t6\r\n",
        "  1.5   2.5\n -3.25  4\n  0.5  6\n",
        "1,5\t2,5\n-3,25\t4\n0,5\t6\n",
        "a1,a2\n1.5,2.5\n-3.25,4\n0.5,6\n",
        "\u{feff}\"a1\";\"a2\"\n1,5;2,5\n\n-3,25;4\n0,5;6",
        "# recorded on Monday\n# a1 a2\n1.5 2.5\n-3.25 4\n0.5 6\n",
        "Logger 3000\nStart: 12:00\n\na1 [g],a2 [g]\n1.5,2.5\n-3.25,4\n0.5,6\n",
        "a1;a2\ng;g\n1,5;2,5\n-3,25;4\n0,5;6\n",
    ];
    for (i, text) in ways.iter().enumerate() {
        for (name, bytes) in [("t.csv", text.as_bytes().to_vec()), ("t.csv.gz", gzip(text.as_bytes()))] {
            let (packets, _) =
                read(&put(folder.path(), name, &bytes), &given(100.0)).unwrap_or_else(|e| panic!("{i}: {e}"));
            let (one, two) = if text.contains("a1") { ("a1", "a2") } else { ("ch1", "ch2") };
            assert_eq!(values(&packets, one), [1.5, -3.25, 0.5], "{text}");
            assert_eq!(values(&packets, two), [2.5, 4.0, 6.0], "{text}");
        }
    }
}

#[test]
fn conform_units_come_from_the_header_and_are_converted() {
    let folder = tempfile::tempdir().unwrap();
    let path =
        put(folder.path(), "t.csv", b"t [ms],x [mm/s\xc2\xb2],y [furlong]\n0,1000,1\n1,2000,2\n2,3000,3\n3,4000,4\n");
    let (packets, warnings) = read(&path, &OpenOptions::default()).unwrap();
    assert_eq!(values(&packets, "x"), [1.0, 2.0, 3.0, 4.0]);
    let block = blocks(&packets)[0].clone();
    assert_eq!((&*block.unit, block.sample_rate_hz.round()), ("m/s^2", 1000.0));
    assert!(warnings.iter().any(|w| w.contains("furlong")), "{warnings:?}");
}

/// A time column gives rate, start and gaps.
#[test]
fn analytic_a_time_column_gives_rate_and_gaps() {
    let folder = tempfile::tempdir().unwrap();
    let mut text = String::from("time,a\n");
    for i in (0..2000).filter(|i| !(700..900).contains(i)) {
        text.push_str(&format!("{:.6},{i}\n", 1_700_000_000.25 + f64::from(i) / 2048.0));
    }
    let (packets, warnings) = read(&put(folder.path(), "t.csv", text.as_bytes()), &OpenOptions::default()).unwrap();
    let blocks = blocks(&packets);
    // Six digits of seconds: half a microsecond over a second.
    assert!((blocks[0].sample_rate_hz / 2048.0 - 1.0).abs() < 1e-6, "{}", blocks[0].sample_rate_hz);
    assert_eq!(blocks[0].t0, 1_700_000_000_250_000_000);
    let gaps: Vec<u64> =
        blocks.iter().filter(|b| b.quality.contains(Quality::GAP_BEFORE)).map(|b| b.first_sample_index).collect();
    assert_eq!(gaps, [900]);
    assert!(warnings.iter().any(|w| w.contains("1 gaps")), "{warnings:?}");
    assert_eq!(values(&packets, "a").len(), 1800);
}

#[test]
fn conform_what_is_missing_or_wrong_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let say = |text: &str, options: &OpenOptions| {
        read(&put(folder.path(), "t.csv", text.as_bytes()), options).unwrap_err().to_string()
    };
    let text = say("1,2\n3,4\n5,6\n", &OpenOptions::default());
    assert!(text.contains("--sample-rate"), "{text}");
    let text = say("0.1,2\n0.2,4\n0.3,6\n", &OpenOptions::default());
    assert!(text.contains("--time-column 1"), "{text}");
    let text = say("a,b\n1,2\n3,4\n5,6\n7,oops\n", &given(10.0));
    assert!(text.contains("line 5") && text.contains("\"b\"") && text.contains("oops"), "{text}");
    let text = say("a,b\n1,2\n3,4\n5,6\n7\n", &given(10.0));
    assert!(text.contains("line 5") && text.contains("2 fields"), "{text}");
    let text = say("no numbers\nin this text\n", &given(10.0));
    assert!(text.contains("rows of numbers"), "{text}");
    let text = say("t,a\n3,1\n2,2\n1,3\n0,4\n", &OpenOptions::default());
    assert!(text.contains("ascending"), "{text}");
    let wide = "1".repeat(2 << 20);
    let text = say(&format!("1\n2\n3\n{wide}\n"), &given(10.0));
    assert!(text.contains("limit"), "{text}");
}

/// NaN, infinity and empty fields are read and their blocks marked.
#[test]
fn conform_values_that_are_no_numbers_are_marked() {
    let folder = tempfile::tempdir().unwrap();
    for hole in ["NaN", "inf", "-Infinity", ""] {
        let text = format!("1,2\n3,4\n5,{hole}\n7,8\n");
        let (packets, warnings) = read(&put(folder.path(), "t.csv", text.as_bytes()), &given(10.0)).unwrap();
        let marks: Vec<Quality> = blocks(&packets).iter().map(|b| b.quality).collect();
        assert_eq!(marks, [Quality::GOOD, Quality::INVALID], "{hole}");
        assert!(warnings.iter().any(|w| w.contains("marked invalid")), "{warnings:?}");
    }
}

/// A unit that nobody gives counts as 1, with a warning.
#[test]
fn conform_an_unknown_unit_is_a_warning() {
    let folder = tempfile::tempdir().unwrap();
    let options = OpenOptions { sample_rate_hz: Some(10.0), ..OpenOptions::default() };
    let (packets, warnings) = read(&put(folder.path(), "t.csv", b"1\n2\n3\n"), &options).unwrap();
    assert_eq!(&*blocks(&packets)[0].unit, "1");
    assert!(warnings.iter().any(|w| w.contains("--unit")), "{warnings:?}");
}

/// Real recordings: four channels each, of equal length, as their README says.
#[test]
fn oracle_spectraquest_recordings_open() {
    let Some(folder) = shared("data/gfd_spectraquest") else { return };
    let path = folder.join("h30hz0.csv.gz");
    let (packets, _) = read(&path, &given(12_800.0)).unwrap();
    for sensor in ["a1", "a2", "a3", "a4"] {
        assert_eq!(values(&packets, sensor).len(), 88_832);
    }
    assert_eq!(values(&packets, "a1")[..2], [f64::from(4.63671_f32), f64::from(1.9928_f32)]);
}
