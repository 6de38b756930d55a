//! TDMS files that are read at any place give the packets of the same bytes that come from the
//! front, which are held in memory.

use std::path::Path;

use gearwatch_core::source::Source;
use gearwatch_io::{OpenOptions, Opened, open, open_bytes};

use gearwatch_testkit::files::put;

/// Packets, warnings and error, as text: a float says its bits.
fn told(opened: Result<Opened, gearwatch_io::ReadError>) -> Vec<String> {
    let mut opened = match opened {
        Ok(opened) => opened,
        Err(error) => return vec![error.to_string()],
    };
    let mut lines = Vec::new();
    loop {
        match opened.next_packet() {
            Ok(Some(packet)) => lines.push(format!("{packet:?}")),
            Ok(None) => break,
            Err(error) => {
                lines.push(error.to_string());
                break;
            }
        }
    }
    lines.extend(opened.warnings());
    lines
}

fn options() -> OpenOptions {
    OpenOptions { sample_rate_hz: Some(1000.0), unit: Some("g".into()), ..OpenOptions::default() }
}

/// Both ways of reading; how many packets there were.
fn both(path: &Path, bytes: &[u8], what: &str) -> usize {
    std::fs::write(path, bytes).unwrap();
    let by_blocks = told(open(path, &options()));
    let in_memory = told(open_bytes(path, Box::new(std::io::Cursor::new(bytes.to_vec())), &options()));
    assert!(by_blocks == in_memory, "{what}: {by_blocks:.2000?}\n\nbut in memory: {in_memory:.2000?}");
    by_blocks.iter().filter(|line| line.starts_with("Vibration")).count()
}

/// Numbers that follow from a seed.
struct Dice(u64);

impl Dice {
    fn roll(&mut self, below: u64) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) % below
    }

    fn one_in(&mut self, n: u64) -> bool {
        self.roll(n) == 0
    }

    fn bytes(&mut self, n: usize) -> Vec<u8> {
        (0..n).map(|_| self.roll(256) as u8).collect()
    }
}

/// Codes and sizes of types: integers, floats, wide integers, and truth values, which are no
/// numbers.
const KINDS: [(u32, usize); 9] = [(2, 2), (9, 4), (10, 8), (3, 4), (5, 1), (4, 8), (7, 4), (1, 1), (0x21, 1)];

/// A file as it is written piece by piece.
struct Writer {
    big: bool,
    out: Vec<u8>,
}

impl Writer {
    fn u32(&self, v: u32) -> [u8; 4] {
        if self.big { v.to_be_bytes() } else { v.to_le_bytes() }
    }

    fn u64(&self, v: u64) -> [u8; 8] {
        if self.big { v.to_be_bytes() } else { v.to_le_bytes() }
    }

    fn words(&self, words: &[u32]) -> Vec<u8> {
        words.iter().flat_map(|&word| self.u32(word)).collect()
    }

    fn segment(&mut self, mask: u32, meta: &[u8], raw: &[u8], unfinished: bool) {
        let next = if unfinished { u64::MAX } else { (meta.len() + raw.len()) as u64 };
        let mask = mask | u32::from(self.big) << 6;
        self.out.extend(b"TDSm");
        self.out.extend(mask.to_le_bytes());
        self.out
            .extend([self.u32(4713).to_vec(), self.u64(next).to_vec(), self.u64(meta.len() as u64).to_vec()].concat());
        self.out.extend(meta);
        self.out.extend(raw);
    }

    /// Objects with the index of their raw data.
    fn objects(&self, objects: &[(usize, Vec<u8>)]) -> Vec<u8> {
        let mut meta = self.u32(objects.len() as u32).to_vec();
        for (k, index) in objects {
            let path = format!("/'g'/'a{k}'");
            meta.extend(self.u32(path.len() as u32));
            meta.extend(path.as_bytes());
            meta.extend(index);
            meta.extend(self.u32(0));
        }
        meta
    }
}

const METADATA: u32 = 2;
const NEW_LIST: u32 = 4;
const RAW: u32 = 8;
const INTERLEAVED: u32 = 1 << 5;
const DAQMX: u32 = 1 << 7;

/// A file of some segments: types, lengths, order of bytes and of values mostly stay, and sometimes
/// change.
fn drawn(seed: u64) -> Vec<u8> {
    let mut dice = Dice(seed);
    let channels = 1 + dice.roll(4) as usize;
    let mut kinds: Vec<_> = (0..channels).map(|_| KINDS[dice.roll(9) as usize]).collect();
    let mut writer = Writer { big: dice.one_in(3), out: Vec::new() };
    let mut interleaved = dice.one_in(2);
    let mut counts = vec![1 + dice.roll(400); channels];
    let (steady, segments) = (dice.one_in(2), 1 + dice.roll(6));
    let mut described = false;
    for segment in 0..segments {
        let change = !steady && segment > 0;
        let again = !described || change || dice.one_in(3);
        if change && dice.one_in(4) {
            kinds[dice.roll(channels as u64) as usize] = KINDS[dice.roll(9) as usize];
        }
        if change && dice.one_in(2) {
            counts = vec![dice.roll(700); channels];
        }
        if change && dice.one_in(4) {
            (writer.big, interleaved) = (dice.one_in(2), dice.one_in(2));
        }
        if !interleaved && again && dice.one_in(2) {
            counts.iter_mut().for_each(|count| *count = dice.roll(700));
        } else if interleaved {
            counts = vec![counts[0]; channels];
        }
        let index = |k: usize| [writer.words(&[20, kinds[k].0, 1]), writer.u64(counts[k]).to_vec()].concat();
        let objects: Vec<_> = (0..channels).map(|k| (k, index(k))).collect();
        let meta = if again { writer.objects(&objects) } else { Vec::new() };
        let chunk: usize = kinds.iter().zip(&counts).map(|(kind, count)| kind.1 * *count as usize).sum();
        let cut = if dice.one_in(5) { dice.roll(chunk as u64 + 1) as usize } else { 0 };
        let chunks = 1 + dice.roll(4) as usize;
        let raw = dice.bytes((chunk * chunks).saturating_sub(cut));
        let mask = RAW | if interleaved { INTERLEAVED } else { 0 } | if again { METADATA | NEW_LIST } else { 0 };
        writer.segment(mask, &meta, &raw, segment + 1 == segments && dice.one_in(3));
        described = true;
    }
    let mut out = writer.out;
    if dice.one_in(3) {
        let left = dice.roll(out.len() as u64) as usize;
        out.truncate(left.max(1));
    }
    out
}

#[test]
fn oracle_drawn_files_read_by_blocks_are_those_in_memory() {
    let folder = tempfile::tempdir().unwrap();
    let packets: usize =
        (0..600).map(|seed| both(&folder.path().join("a.tdms"), &drawn(seed), &format!("seed {seed}"))).sum();
    assert!(packets > 5000, "{packets}");
}

/// With bits that are flipped anywhere both ways say the same, be it samples or an error.
#[test]
fn oracle_damaged_files_read_by_blocks_say_what_they_say_in_memory() {
    let folder = tempfile::tempdir().unwrap();
    let mut dice = Dice(11);
    for seed in 0..600 {
        let mut bytes = drawn(seed);
        for _ in 0..1 + dice.roll(3) {
            // Most of them in the front, where the descriptions are.
            let within = if dice.one_in(4) { bytes.len() } else { bytes.len().min(250) };
            bytes[dice.roll(within as u64) as usize] ^= 1 << dice.roll(8);
        }
        both(&folder.path().join("a.tdms"), &bytes, &format!("seed {seed}"));
    }
}

/// Rows of two DAQmx buffers in several chunks and segments, the last one cut: all three channels,
/// also where one of them has fewer rows than its buffer.
#[test]
fn oracle_raw_daqmx_data_by_blocks_are_those_in_memory() {
    let folder = tempfile::tempdir().unwrap();
    for (big, fewer, cut) in [(false, 0, 0), (true, 0, 3), (false, 40, 0), (true, 40, 41)] {
        let mut writer = Writer { big, out: Vec::new() };
        // Type, buffer, offset; rows.
        let places = [(3, 0, 0, 300), (5, 0, 2, 300 - fewer), (2, 1, 1, 200)];
        let index = |&(kind, buffer, offset, rows): &(u32, u32, u32, u64)| {
            let front = [writer.words(&[0x1269, u32::MAX, 1]), writer.u64(rows).to_vec()].concat();
            [front, writer.words(&[1, kind, buffer, offset, 0, 0, 2, 7, 5])].concat()
        };
        let objects: Vec<_> = places.iter().map(index).enumerate().collect();
        let meta = writer.objects(&objects);
        let mut dice = Dice(7);
        for segment in 0..3 {
            let raw = dice.bytes(2 * (300 * 7 + 200 * 5) - if segment == 2 { cut } else { 0 });
            let (mask, meta) =
                if segment == 0 { (RAW | DAQMX | METADATA | NEW_LIST, &meta[..]) } else { (RAW | DAQMX, &[][..]) };
            writer.segment(mask, meta, &raw, segment == 2);
        }
        let packets = both(&folder.path().join("d.tdms"), &writer.out, &format!("{big} {fewer} {cut}"));
        assert!(packets > 30, "{packets}");
    }
}

/// Two channels of a megabyte each in one chunk: when the file is open, the samples are not read
/// yet; they are when they are asked for. One that is cut in between says where.
#[test]
fn conform_blocks_are_read_when_they_are_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let mut writer = Writer { big: false, out: Vec::new() };
    let count = 1 << 18;
    let index = || [writer.words(&[20, 9, 1]), writer.u64(count).to_vec()].concat();
    let meta = writer.objects(&[(0, index()), (1, index())]);
    writer.segment(RAW | METADATA | NEW_LIST, &meta, &vec![0; 8 << 18], false);
    let path = put(folder.path(), "long.tdms", &writer.out);
    let mut opened = open(&path, &options()).unwrap();
    let size = writer.out.len() as u64;
    assert!(opened.progress().bytes() < size / 10, "{} of {size}", opened.progress().bytes());
    while opened.next_packet().unwrap().is_some() {}
    assert!(opened.progress().bytes() >= 8 << 18);

    let mut opened = open(&path, &options()).unwrap();
    std::fs::OpenOptions::new().write(true).open(&path).unwrap().set_len(size / 3).unwrap();
    let error = loop {
        match opened.next_packet() {
            Ok(packet) => assert!(packet.is_some(), "a file that was cut was read to its end"),
            Err(error) => break error.to_string(),
        }
    };
    assert!(error.contains("long.tdms: damaged at byte") && error.contains("became shorter"), "{error}");
}
