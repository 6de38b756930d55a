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

/// A segment of one object in the group `g`, with the index and the raw bytes that it is given.
fn segment(mask: u32, index: &[u32], raw: &[u8]) -> Vec<u8> {
    let mut meta = [1_u32.to_le_bytes(), 8_u32.to_le_bytes()].concat();
    meta.extend(b"/'g'/'a'");
    meta.extend(index.iter().chain(&[0]).flat_map(|word| word.to_le_bytes()));
    let mut out = b"TDSm".to_vec();
    out.extend([mask, 4713].iter().flat_map(|word| word.to_le_bytes()));
    out.extend([meta.len() + raw.len(), meta.len()].iter().flat_map(|length| (*length as u64).to_le_bytes()));
    out.extend(meta);
    out.extend(raw);
    out
}

/// Half a megabyte of DAQmx with 20 000 scalers in 20 000 buffers, and 100 000 segments that say
/// nothing: both are read once through. Looked up for each other, or told one by one, they would be
/// without end.
#[test]
fn regress_many_scalers_and_segments_are_read_once_through() {
    let count = 20_000;
    let mut index = vec![0x1269, u32::MAX, 1, 1, 0, count];
    (0..count).for_each(|_| index.extend([3, count - 1, 0, 0, 7]));
    index.push(count);
    index.extend((0..count).map(|k| if k + 1 == count { 2 } else { 0 }));
    let bytes = segment(0x8E, &index, &[0; 200]);
    assert!(bytes.len() > 480_000);
    assert_eq!(parse(&bytes[..], &mut Budget::of_bytes(&bytes)).unwrap().channels.len(), 1);
    let mut bytes = segment(0x0E, &[20, 10, 1, 1, 0], &[0; 8]);
    for _ in 0..100_000 {
        bytes.extend(b"TDSm");
        bytes.extend([8_u32, 4713].iter().flat_map(|word| word.to_le_bytes()));
        bytes.extend([1_u64, 0].iter().flat_map(|length| length.to_le_bytes()));
        bytes.push(1);
    }
    let parsed = parse(&bytes[..], &mut Budget::of_bytes(&bytes)).unwrap();
    assert!(parsed.warnings.len() <= 64, "{} sentences about one file", parsed.warnings.len());
}

/// Raw DAQmx data with linear scales: seven channels at five to seven tenths of a volt from each
/// other.
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
