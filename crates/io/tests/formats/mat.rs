use std::io::Read;

use gearwatch_io::budget::Budget;
use gearwatch_io::mat::v5::parse;
use gearwatch_io::{OpenOptions, Problem};

use gearwatch_testkit::files::{mat_file, matrix, put, read, shared, structure, values};

fn doubles(n: usize) -> Vec<u8> {
    (0..n).flat_map(|i| (i as f64).to_le_bytes()).collect()
}

/// Of two variables with one name the last counts, and the file says so.
#[test]
fn conform_the_last_of_two_variables_counts() {
    let folder = tempfile::tempdir().unwrap();
    let twice = [matrix("x", 100, 1, 9, &doubles(100)), matrix("x", 1, 80, 7, &[0; 320])];
    let options = OpenOptions { sample_rate_hz: Some(10.0), ..OpenOptions::default() };
    for compressed in [false, true] {
        let path = put(folder.path(), "t.mat", &mat_file(&twice, compressed));
        let (packets, warnings) = read(&path, &options).unwrap();
        assert_eq!(values(&packets, "x"), [0.0; 80]);
        assert!(warnings.iter().any(|w| w.contains("twice")), "{warnings:?}");
    }
}

/// Structs in structs; the rate of the nearest struct; a chosen channel.
#[test]
fn conform_structs_and_rates_are_found() {
    let folder = tempfile::tempdir().unwrap();
    let inner = structure(
        "",
        &[("Fs", matrix("", 1, 1, 9, &512.0_f64.to_le_bytes())), ("y", matrix("", 70, 1, 9, &doubles(70)))],
    );
    let outer = structure("top", &[("inner", inner), ("z", matrix("", 64, 1, 9, &doubles(64)))]);
    let path = put(folder.path(), "t.mat", &mat_file(&[outer], true));
    let chosen = OpenOptions { channels: vec!["acc=top.inner.y:m/s^2".parse().unwrap()], ..OpenOptions::default() };
    let (packets, _) = read(&path, &chosen).unwrap();
    assert_eq!(values(&packets, "acc").len(), 70);
    let text = read(&path, &OpenOptions::default()).unwrap_err().to_string();
    assert!(text.contains("--sample-rate"), "{text}");
    let wrong = OpenOptions { channels: vec!["acc=nothing".parse().unwrap()], ..OpenOptions::default() };
    let text = read(&path, &wrong).unwrap_err().to_string();
    assert!(text.contains("top.inner.y"), "{text}");
}

/// A few kilobytes must not become gigabytes: 64 MiB of zeros, kept as 32-bit integers, are four
/// times what a small file may ask for.
#[test]
fn regress_a_compression_bomb_is_refused() {
    let zeros = |n: usize| mat_file(&[matrix("x", i32::try_from(n).unwrap(), 1, 2, &vec![0; n])], true);
    let (small, bomb) = (zeros(8 << 20), zeros(64 << 20));
    assert!(bomb.len() < 1 << 19);
    let problem = parse(&bomb[..], &mut Budget::of_bytes(&bomb)).unwrap_err();
    assert!(matches!(problem, Problem::Limit { .. }), "{problem}");
    assert_eq!(parse(&small[..], &mut Budget::of_bytes(&small)).unwrap().variables[0].numbers.len(), 8 << 20);
}

/// Every name once, in time that does not grow with the square of their number; the paths of a
/// struct array are bounded together.
#[test]
fn regress_many_names_are_bounded() {
    let many: Vec<Vec<u8>> = (0..50_000).map(|i| matrix(&format!("v{i}"), 1, 1, 2, &[1])).collect();
    let file = mat_file(&many, false);
    assert_eq!(parse(&file[..], &mut Budget::of_bytes(&file)).unwrap().variables.len(), 50_000);
    let long = mat_file(&[matrix(&"n".repeat(2000), 1, 1, 2, &[1])], false);
    let problem = parse(&long[..], &mut Budget::of_bytes(&long)).unwrap_err();
    assert!(problem.to_string().contains("the length of names"), "{problem}");
}

/// HDF5 of a few kilobytes, made by h5py: ten groups with eight links each to the next one, which
/// are a thousand million paths; and an array of which 2 GiB are declared and nothing is written.
/// Each limit says its name.
#[test]
fn regress_small_files_that_ask_for_much_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    for (packed, limit) in [
        (&include_bytes!("shared-groups.mat.gz")[..], "the work to walk its groups"),
        (include_bytes!("declared.mat.gz"), "the memory for its values"),
    ] {
        let mut bytes = Vec::new();
        flate2::read::GzDecoder::new(packed).read_to_end(&mut bytes).unwrap();
        assert!(bytes.len() < 8192, "{limit}");
        let options = OpenOptions { sample_rate_hz: Some(1000.0), unit: Some("g".into()), ..OpenOptions::default() };
        let refused = read(&put(folder.path(), "t.mat", &bytes), &options).unwrap_err().to_string();
        assert!(refused.contains(limit) && refused.contains("above the limit of"), "{refused}");
    }
}

#[test]
fn oracle_bearing_file_opens() {
    let Some(path) = shared("data/readers/MFPT_like_OuterRaceFault_1.mat") else { return };
    let (packets, warnings) = read(&path, &OpenOptions::default()).unwrap();
    assert_eq!(values(&packets, "bearing.gs").len(), 146_484);
    assert!(warnings.iter().any(|w| w.contains("bearing.sr")), "{warnings:?}");
}

/// Rates that stand in a head of their own, as a rate or as a step; two that contradict each other
/// say nothing.
#[test]
fn regress_rates_in_heads_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let scalar = |x: f64| matrix("", 1, 1, 9, &x.to_le_bytes());
    let data = || matrix("data", 70, 1, 9, &doubles(70));
    let rate_of = |heads: &[Vec<u8>]| {
        let file: Vec<Vec<u8>> = heads.iter().cloned().chain([data()]).collect();
        let path = put(folder.path(), "t.mat", &mat_file(&file, true));
        read(&path, &OpenOptions { unit: Some("g".into()), ..OpenOptions::default() }).map(|(packets, _)| {
            packets.iter().find_map(|packet| match packet {
                gearwatch_core::block::Packet::Vibration(block) => Some(block.sample_rate_hz),
                _ => None,
            })
        })
    };
    let rate = structure("File_Header", &[("SampFreq", scalar(12_800.0))]);
    let step = structure("Head", &[("XInc", scalar(1.0 / 12_800.0))]);
    for heads in [vec![rate.clone()], vec![step.clone()], vec![rate.clone(), step]] {
        let found = rate_of(&heads).unwrap().expect("samples");
        assert!((found / 12_800.0 - 1.0).abs() < 1e-12, "{found}");
    }
    let other = structure("Other", &[("fs", scalar(25_600.0))]);
    assert!(rate_of(&[rate, other]).unwrap_err().to_string().contains("--sample-rate"));
}
