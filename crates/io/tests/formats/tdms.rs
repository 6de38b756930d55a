use gearwatch_io::OpenOptions;
use gearwatch_io::budget::Budget;
use gearwatch_io::tdms::parse;

use gearwatch_testkit::files::{LENGTH, read, shared, tdms, values};

/// A segment that its writer never closed (its length is all ones) is read as far as it goes.
#[test]
fn conform_an_unfinished_last_segment_is_read() {
    for big in [false, true] {
        let mut bytes = tdms(big);
        let second = bytes.windows(4).rposition(|w| w == b"TDSm").unwrap();
        bytes[second + 12..second + 20].fill(0xFF);
        let parsed = parse(&bytes[..], &mut Budget::of_bytes(&bytes)).unwrap();
        assert_eq!(parsed.channels.iter().map(|c| c.values.len()).collect::<Vec<_>>(), [LENGTH, LENGTH]);
        assert!(parsed.warnings.iter().any(|w| w.contains("never finished")));
        bytes.truncate(bytes.len() - 100);
        let parsed = parse(&bytes[..], &mut Budget::of_bytes(&bytes)).unwrap();
        assert_eq!(parsed.channels.iter().map(|c| c.values.len()).collect::<Vec<_>>(), [LENGTH, LENGTH - 50]);
    }
}

#[test]
fn conform_sizes_beyond_the_file_are_refused() {
    let bytes = tdms(false);
    // The number of values of the first object.
    let at = bytes.windows(8).position(|w| w == [150, 0, 0, 0, 0, 0, 0, 0]).unwrap();
    for count in [u64::MAX, 1 << 63, 1 << 40] {
        let mut bytes = bytes.clone();
        bytes[at..at + 8].copy_from_slice(&count.to_le_bytes());
        if let Ok(parsed) = parse(&bytes[..], &mut Budget::of_bytes(&bytes)) {
            assert!(!parsed.warnings.is_empty());
        }
    }
}

/// Raw DAQmx data with linear scales: seven channels at five to seven tenths of a volt from each other.
#[test]
fn oracle_daqmx_data_are_scaled() {
    let Some(path) = shared("data/readers/raw1.tdms") else { return };
    let (packets, _) = read(&path, &OpenOptions::default()).unwrap();
    let mean = |name: &str| {
        let values = values(&packets, name);
        assert_eq!(values.len(), 2000, "{name}");
        values.iter().sum::<f64>() / values.len() as f64
    };
    let names =
        ["First_Channel", "Second_Chan", "Third_Chan", "Fourth_Chan", "Fifth_Chan", "Sixth_Chan", "Seventh_Cha"];
    let means = names.map(mean);
    assert!(means.windows(2).all(|w| (w[1] - w[0] - 0.81).abs() < 0.1), "{means:?}");
}

/// Labview's example: a sweep of amplitude up to 6 and one of phase with amplitude 1.
#[test]
fn oracle_big_endian_file_opens() {
    let Some(path) = shared("data/readers/big_endian.tdms") else { return };
    let (packets, _) = read(&path, &OpenOptions::default()).unwrap();
    let peak = |name: &str| values(&packets, name).iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    assert!((peak("Phase_sweep") - 1.0).abs() < 1e-6);
    assert!((peak("Amplitude_sweep") - 6.0).abs() < 1e-3);
}

#[test]
fn conform_other_marks_and_versions_are_refused() {
    let mut bytes = tdms(false);
    bytes[8] = 1;
    assert!(parse(&bytes[..], &mut Budget::of_bytes(&bytes)).unwrap_err().to_string().contains("version 4712 or 4713"));
    bytes[0] = b'X';
    assert!(parse(&bytes[..], &mut Budget::of_bytes(&bytes)).unwrap_err().to_string().contains("the mark TDSm"));
}
