//! The server side of libiio's network protocol (`iiod`, version 0.24), with one device of four
//! inputs: an accelerometer of 20 bits in 32, shifted by four, signed and of the other byte order;
//! a converter of 12 bits, unsigned, in 32; one of 16 bits; and a time that is not read. Samples
//! are made as they are asked for, at the pace of the clock.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

const DESCRIPTION: &str = r#"<?xml version="1.0" encoding="utf-8"?><!DOCTYPE context [<!ELEMENT context (device | context-attribute)*><!ELEMENT context-attribute EMPTY><!ELEMENT device (channel | attribute | debug-attribute | buffer-attribute)*><!ELEMENT channel (scan-element?, attribute*)><!ELEMENT attribute EMPTY><!ELEMENT scan-element EMPTY><!ELEMENT debug-attribute EMPTY><!ELEMENT buffer-attribute EMPTY><!ATTLIST context name CDATA #REQUIRED description CDATA #IMPLIED><!ATTLIST context-attribute name CDATA #REQUIRED value CDATA #REQUIRED><!ATTLIST device id CDATA #REQUIRED name CDATA #IMPLIED><!ATTLIST channel id CDATA #REQUIRED type (input|output) #REQUIRED name CDATA #IMPLIED><!ATTLIST scan-element index CDATA #REQUIRED format CDATA #REQUIRED scale CDATA #IMPLIED><!ATTLIST attribute name CDATA #REQUIRED filename CDATA #IMPLIED><!ATTLIST debug-attribute name CDATA #REQUIRED><!ATTLIST buffer-attribute name CDATA #REQUIRED>]><context name="network" description="emulated"><device id="iio:device0" name="adxl355"><channel id="accel_z" type="input"><scan-element index="0" format="be:s20/32&gt;&gt;4" /><attribute name="scale" filename="in_accel_scale" /></channel><channel id="voltage0" type="input"><scan-element index="1" format="le:u12/32&gt;&gt;0" /><attribute name="scale" filename="in_voltage0_scale" /><attribute name="offset" filename="in_voltage0_offset" /></channel><channel id="temp" type="input"><scan-element index="2" format="le:s16/16&gt;&gt;0" /></channel><channel id="timestamp" type="input"><scan-element index="3" format="le:s64/64&gt;&gt;0" /></channel><attribute name="sampling_frequency" /></device><device id="iio:device1" name="fan" /></context>"#;

/// m/s² per count.
pub const ACCEL_SCALE: f64 = 3.824_593e-5;
/// mV per count, and counts before.
pub const VOLTAGE_SCALE: f64 = 1.220_703_125;
pub const VOLTAGE_OFFSET: f64 = -2048.0;

/// What happens to it.
#[derive(Clone, Copy, Debug, Default)]
pub struct Trouble {
    /// So many samples are skipped at the next reading.
    pub skip: u64,
    /// Buffers are refused, as of a device that was unplugged.
    pub gone: bool,
    /// It answers no more.
    pub hangs: bool,
}

/// Server and device.
pub struct Iiod {
    pub address: SocketAddr,
    pub trouble: Arc<Mutex<Trouble>>,
}

struct State {
    rate_hz: f64,
    trouble: Arc<Mutex<Trouble>>,
}

/// Sample n of the accelerometer: a ramp through both signs.
pub fn accel(n: u64) -> i32 {
    (n % 0xf_fff0) as i32 - 0x7_fff8
}

/// Of the converter.
pub fn voltage(n: u64) -> u32 {
    (n % 4096) as u32
}

/// And of the narrow one.
pub fn temp(n: u64) -> i16 {
    (n % 1000) as i16 - 500
}

impl Iiod {
    pub fn start() -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let trouble = Arc::new(Mutex::new(Trouble::default()));
        let state = Arc::new(Mutex::new(State { rate_hz: 4000.0, trouble: trouble.clone() }));
        std::thread::spawn(move || {
            while let Ok((client, _)) = listener.accept() {
                let state = state.clone();
                std::thread::spawn(move || serve(client, &state));
            }
        });
        Self { address, trouble }
    }
}

/// Numbers of the kernel.
const EINVAL: i32 = -22;
const ENOENT: i32 = -2;
const ENODEV: i32 = -19;

/// An opened buffer.
struct Stream {
    mask: u32,
    next: u64,
    rate_hz: f64,
    began: Instant,
}

fn serve(mut client: TcpStream, state: &Mutex<State>) -> Option<()> {
    client.set_nodelay(true).ok()?;
    let mut lines = BufReader::new(client.try_clone().ok()?);
    let mut stream: Option<Stream> = None;
    loop {
        let mut line = String::new();
        if lines.read_line(&mut line).ok()? == 0 {
            return None;
        }
        let words: Vec<&str> = line.split_whitespace().collect();
        let trouble = *state.lock().unwrap().trouble.lock().unwrap();
        if trouble.hangs {
            std::thread::sleep(Duration::from_secs(60));
        }
        let answer = |client: &mut TcpStream, code: i32| writeln!(client, "{code}").ok();
        match words.as_slice() {
            [] => {}
            ["VERSION"] => writeln!(client, "0.24.emulate").ok()?,
            ["PRINT"] => write!(client, "{}\n{DESCRIPTION}\n", DESCRIPTION.len()).ok()?,
            ["TIMEOUT", _] | ["SET", "iio:device0", "BUFFERS_COUNT", _] => answer(&mut client, 0)?,
            ["READ", "iio:device0", name @ ..] => {
                let value = match name {
                    ["sampling_frequency"] => format!("{}", state.lock().unwrap().rate_hz),
                    ["INPUT", "accel_z", "scale"] => ACCEL_SCALE.to_string(),
                    ["INPUT", "voltage0", "scale"] => VOLTAGE_SCALE.to_string(),
                    ["INPUT", "voltage0", "offset"] => VOLTAGE_OFFSET.to_string(),
                    _ => {
                        answer(&mut client, ENOENT)?;
                        continue;
                    }
                };
                write!(client, "{}\n{value}\n", value.len()).ok()?;
            }
            ["WRITE", "iio:device0", "sampling_frequency", length] => {
                let mut value = vec![0; length.parse().ok()?];
                lines.read_exact(&mut value).ok()?;
                let value = String::from_utf8_lossy(&value);
                let asked: f64 = value.trim_matches(['\0', '\n', ' ']).parse().ok()?;
                // It has 4000 Hz and halves of it, and takes the nearest one.
                let halves = (4000.0 / asked).log2().round().clamp(0.0, 10.0);
                state.lock().unwrap().rate_hz = 4000.0 / halves.exp2();
                answer(&mut client, value.len() as i32)?;
            }
            ["OPEN", "iio:device0", _, mask] => {
                let rate_hz = state.lock().unwrap().rate_hz;
                let mask = u32::from_str_radix(mask, 16).ok()?;
                stream = Some(Stream { mask, next: 0, rate_hz, began: Instant::now() });
                answer(&mut client, if trouble.gone { ENODEV } else { 0 })?;
            }
            ["CLOSE", "iio:device0"] => {
                stream = None;
                answer(&mut client, 0)?;
            }
            ["READBUF", "iio:device0", bytes] => {
                let Some(stream) = stream.as_mut().filter(|_| !trouble.gone) else {
                    answer(&mut client, ENODEV)?;
                    continue;
                };
                stream.next += std::mem::take(&mut state.lock().unwrap().trouble.lock().unwrap().skip);
                let data = stream.take(bytes.parse().ok()?);
                write!(client, "{}\n{:08x}\n", data.len(), stream.mask).ok()?;
                client.write_all(&data).ok()?;
            }
            ["EXIT"] => return None,
            _ => answer(&mut client, EINVAL)?,
        }
    }
}

impl Stream {
    /// As the kernel lays scans out: each number at a multiple of its own size, the whole at one of
    /// the largest.
    fn take(&mut self, bytes: usize) -> Vec<u8> {
        let with = |index: u32| self.mask & (1 << index) != 0;
        let wide = 4 * (usize::from(with(0)) + usize::from(with(1)));
        let scan = wide + if wide > 0 { 4 } else { 2 } * usize::from(with(2));
        let samples = (bytes / scan) as u64;
        let due = self.began + Duration::from_secs_f64((self.next + samples) as f64 / self.rate_hz);
        std::thread::sleep(due.saturating_duration_since(Instant::now()));
        let mut out = Vec::with_capacity(bytes);
        for n in self.next..self.next + samples {
            if with(0) {
                // The lowest four bits are not the number's.
                out.extend(((accel(n) << 4) | 0x9).to_be_bytes());
            }
            if with(1) {
                out.extend(voltage(n).to_le_bytes());
            }
            if with(2) {
                out.extend(temp(n).to_le_bytes());
            }
            out.resize(out.len().next_multiple_of(scan), 0);
        }
        self.next += samples;
        out
    }
}
