//! Industrial I/O through the real libiio, whose server is emulated. Skipped with a message where
//! libiio is not installed.
#![allow(clippy::print_stderr, reason = "a test that is skipped says so")]

mod iiod;

use std::time::{Duration, Instant};

use gearwatch_core::block::Quality;

use super::support::{Opened, block, source, values};
use iiod::{ACCEL_SCALE, Iiod, VOLTAGE_OFFSET, VOLTAGE_SCALE, accel, temp, voltage};

const BOTH: &str = "{ input = \"accel_z\", sensor = \"a\" }, { input = \"voltage0\", sensor = \"v\" }";

fn opened(server: &Iiod, rate_hz: f64, channels: &str) -> Opened {
    source(&format!(
        "kind = \"iio\"\nuri = \"ip:{}\"\ndevice = \"adxl355\"\nsample_rate_hz = {rate_hz:?}\nchannels = [{channels}]",
        server.address
    ))
}

fn error_of(source: &Opened) -> String {
    source.open().err().map(|e| e.to_string()).unwrap_or_default()
}

/// `false`, with a message, where there is no libiio.
fn installed() -> bool {
    let nowhere = source(
        "kind = \"iio\"\nuri = \"ip:127.0.0.1:1\"\ndevice = \"x\"\nsample_rate_hz = 4000.0\nchannels = [{ input = \"accel_z\", sensor = \"a\" }]",
    );
    let missing = error_of(&nowhere).contains("libiio cannot be used");
    if missing {
        eprintln!("skipped: libiio is not installed (Debian: libiio0)");
    }
    !missing
}

/// Numbers of other byte order, shifted, signed or not, with scale and offset, become m/s² and V,
/// sample by sample.
#[test]
fn conform_counts_become_physical_values() {
    if !installed() {
        return;
    }
    let server = Iiod::start();
    let mut pull = opened(&server, 4000.0, BOTH).open().unwrap();
    let mut n = 0;
    for _ in 0..5 {
        let (a, v) = (block(&mut pull), block(&mut pull));
        assert_eq!((&*a.sensor, &*a.unit, &*v.sensor, &*v.unit), ("a", "m/s^2", "v", "V"));
        assert_eq!((a.first_sample_index, a.sample_rate_hz, values(&a).len()), (n, 4000.0, values(&v).len()));
        for (&found_a, &found_v) in values(&a).iter().zip(values(&v)) {
            assert_eq!(found_a, (f64::from(accel(n)) * ACCEL_SCALE) as f32, "{n}");
            let expected = (f64::from(voltage(n)) + VOLTAGE_OFFSET) * VOLTAGE_SCALE * 1e-3;
            assert_eq!(found_v, expected as f32, "{n}");
            n += 1;
        }
    }
    let scaled = "{ input = \"voltage0\", sensor = \"v\", sensitivity_v_per_unit = 0.1, unit = \"g\" }";
    let mut pull = opened(&server, 2000.0, scaled).open().unwrap();
    let v = block(&mut pull);
    assert_eq!((&*v.unit, v.sample_rate_hz), ("g", 2000.0));
    assert_eq!(values(&v)[0], (VOLTAGE_OFFSET * VOLTAGE_SCALE * 1e-3 / 0.1) as f32);
}

/// libiio before 0.25 takes the padding at the end of a scan for numbers: that is refused, and a
/// later one must read it right.
#[test]
fn conform_inputs_of_different_widths_are_read_right_or_refused() {
    if !installed() {
        return;
    }
    let server = Iiod::start();
    let both = "{ input = \"accel_z\", sensor = \"a\" }, { input = \"temp\", sensor = \"t\" }";
    match opened(&server, 4000.0, both).open() {
        Err(e) => assert!(e.to_string().contains("a scan of 8 bytes for one of 6"), "{e}"),
        Ok(mut pull) => {
            let (a, t) = (block(&mut pull), block(&mut pull));
            for (n, (&found_a, &found_t)) in values(&a).iter().zip(values(&t)).enumerate() {
                assert_eq!(found_a, (f64::from(accel(n as u64)) * ACCEL_SCALE) as f32);
                assert_eq!(found_t, f32::from(temp(n as u64)));
            }
        }
    }
}

/// The ends of the converter's range are an overload of this input.
#[test]
fn conform_full_scale_is_an_overload() {
    if !installed() {
        return;
    }
    let server = Iiod::start();
    let mut pull = opened(&server, 4000.0, BOTH).open().unwrap();
    let mut marked = 0;
    for _ in 0..12 {
        let (a, v) = (block(&mut pull), block(&mut pull));
        let first = v.first_sample_index;
        // Counts 0 and 4095.
        let ends = (first..first + values(&v).len() as u64).any(|n| matches!(voltage(n), 0 | 4095));
        assert_eq!(v.quality.contains(Quality::OVERLOAD), ends, "{first}");
        // The ramp of this one turns before its ends.
        assert_eq!(a.quality, Quality::GOOD);
        marked += u32::from(ends);
    }
    assert!(marked >= 2, "{marked}");
}

/// A device that goes away, or hangs, is an error; when it is back, what is missing is a gap.
#[test]
fn conform_a_device_that_goes_or_hangs_is_an_error_and_then_a_gap() {
    if !installed() {
        return;
    }
    let server = Iiod::start();
    let source = opened(&server, 4000.0, BOTH);
    for (gone, hangs) in [(true, false), (false, true)] {
        let mut pull = source.open().unwrap();
        let (_, last) = (block(&mut pull), block(&mut pull));
        {
            let mut trouble = server.trouble.lock().unwrap();
            (trouble.gone, trouble.hangs) = (gone, hangs);
        }
        let began = Instant::now();
        let error = loop {
            if let Err(error) = pull() {
                break error.to_string();
            }
            assert!(began.elapsed() < Duration::from_secs(20), "no error");
        };
        assert!(error.starts_with("adxl355 at ip:127.0.0.1:"), "{error}");
        assert!(error.contains("iio_buffer_refill: "), "{error}");
        drop(pull);
        if gone {
            let error = error_of(&source);
            assert!(error.contains("iio_device_create_buffer: "), "{error}");
        }
        *server.trouble.lock().unwrap() = iiod::Trouble::default();
        let after = block(&mut source.open().unwrap());
        assert!(after.quality.contains(Quality::GAP_BEFORE));
        assert!(after.first_sample_index > last.first_sample_index + values(&last).len() as u64);
    }
}

#[test]
fn conform_what_is_not_there_is_said_with_what_is() {
    let absent = source(
        "kind = \"iio\"\nlibrary = \"nowhere/libiio.so.0\"\ndevice = \"x\"\nsample_rate_hz = 4000.0\nchannels = [{ input = \"accel_z\", sensor = \"a\" }]",
    );
    let error = error_of(&absent);
    assert!(error.starts_with("x at local:: libiio cannot be used: "), "{error}");
    assert!(error.ends_with("install libiio 0.x (Debian: libiio0), or give the library's path"), "{error}");
    if !installed() {
        return;
    }
    let server = Iiod::start();
    let error = error_of(&opened(&server, 3000.0, BOTH));
    assert!(error.contains("samples at 4000 Hz instead of 3000; write sample_rate_hz = 4000.0"), "{error}");
    let error = error_of(&opened(&server, 4000.0, "{ input = \"accel_q\", sensor = \"a\" }"));
    assert!(
        error.contains("there is no input \"accel_q\"; there are [\"accel_z\", \"voltage0\", \"temp\", \"timestamp\"]"),
        "{error}"
    );
    let other = source(&format!(
        "kind = \"iio\"\nuri = \"ip:{}\"\ndevice = \"adxl357\"\nsample_rate_hz = 4000.0\nchannels = [{BOTH}]",
        server.address
    ));
    let error = error_of(&other);
    assert!(error.contains("there is no device \"adxl357\"; there are [\"adxl355\", \"fan\"]"), "{error}");
    let nobody = source(&format!(
        "kind = \"iio\"\nuri = \"ip:127.0.0.1:1\"\ndevice = \"adxl355\"\nsample_rate_hz = 4000.0\nchannels = [{BOTH}]"
    ));
    let error = error_of(&nobody);
    assert!(error.contains("iio_create_context_from_uri: "), "{error}");
}
