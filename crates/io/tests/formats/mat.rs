use gearwatch_io::mat::v5::parse;
use gearwatch_io::{OpenOptions, Problem};

use crate::files::{mat_file, matrix, put, read, shared, structure, values};

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

/// A few kilobytes must not become gigabytes: nothing is unpacked beyond the limit.
#[test]
fn regress_a_compression_bomb_is_refused() {
    let zeros = matrix("x", 1 << 20, 1, 2, &vec![0; 1 << 20]);
    let bomb = mat_file(&[zeros.clone(), zeros.clone(), zeros], true);
    assert!(bomb.len() < 1 << 16);
    for limit in [1 << 20, 3 << 20] {
        let problem = parse(&bomb, limit).unwrap_err();
        assert!(matches!(problem, Problem::Limit { .. }), "{problem}");
    }
    assert_eq!(parse(&bomb, 4 << 20).unwrap().variables.len(), 1);
}

#[test]
fn oracle_bearing_file_opens() {
    let Some(path) = shared("data/readers/MFPT_like_OuterRaceFault_1.mat") else { return };
    let (packets, warnings) = read(&path, &OpenOptions::default()).unwrap();
    assert_eq!(values(&packets, "bearing.gs").len(), 146_484);
    assert!(warnings.iter().any(|w| w.contains("bearing.sr")), "{warnings:?}");
}

/// Rates that stand in a head of their own, as a rate or as a step; two that contradict each other say nothing.
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
