//! libiio 0.x: devices of Linux' Industrial I/O, in this machine or behind `iiod` over a network,
//! USB or a serial line.
//!
//! Functions and types are those of `iio.h` (libiio 0.24); units are those of the kernel's IIO
//! interface (Documentation/ABI/testing/sysfs-bus-iio): (raw + offset) × scale is m/s² for
//! accelerations and mV for voltages.

use std::ffi::{c_char, c_int, c_long, c_longlong, c_uint, c_void};
use std::path::Path;
use std::time::Duration;

use crate::library::{Wanted, functions};
use crate::{DriverError, c_text, from_buffer, from_library};

static WANTED: Wanted = Wanted {
    what: "libiio",
    files: if cfg!(windows) { &["libiio.dll"] } else { &["libiio.so.0"] },
    remedy: "install libiio 0.x (Debian: libiio0), or give the library's path",
};

type Context = *mut c_void;
type Device = *mut c_void;
type Channel = *mut c_void;
type Buffer = *mut c_void;

functions!(WANTED, "C", {
    open = "iio_create_context_from_uri": fn(*const c_char) -> Context;
    close = "iio_context_destroy": fn(Context) -> ();
    set_timeout = "iio_context_set_timeout": fn(Context, c_uint) -> c_int;
    device_count = "iio_context_get_devices_count": fn(Context) -> c_uint;
    device_at = "iio_context_get_device": fn(Context, c_uint) -> Device;
    find_device = "iio_context_find_device": fn(Context, *const c_char) -> Device;
    device_name = "iio_device_get_name": fn(Device) -> *const c_char;
    channel_count = "iio_device_get_channels_count": fn(Device) -> c_uint;
    channel_at = "iio_device_get_channel": fn(Device, c_uint) -> Channel;
    channel_id = "iio_channel_get_id": fn(Channel) -> *const c_char;
    is_output = "iio_channel_is_output": fn(Channel) -> bool;
    is_scanned = "iio_channel_is_scan_element": fn(Channel) -> bool;
    enable = "iio_channel_enable": fn(Channel) -> ();
    disable = "iio_channel_disable": fn(Channel) -> ();
    format = "iio_channel_get_data_format": fn(Channel) -> *const Format;
    channel_number = "iio_channel_attr_read_double": fn(Channel, *const c_char, *mut f64) -> c_int;
    set_channel_number = "iio_channel_attr_write_double": fn(Channel, *const c_char, f64) -> c_int;
    device_number = "iio_device_attr_read_double": fn(Device, *const c_char, *mut f64) -> c_int;
    set_device_number = "iio_device_attr_write_double": fn(Device, *const c_char, f64) -> c_int;
    queue = "iio_device_set_kernel_buffers_count": fn(Device, c_uint) -> c_int;
    channel_index = "iio_channel_get_index": fn(Channel) -> c_long;
    step = "iio_buffer_step": fn(Buffer) -> isize;
    create_buffer = "iio_device_create_buffer": fn(Device, usize, bool) -> Buffer;
    destroy_buffer = "iio_buffer_destroy": fn(Buffer) -> ();
    refill = "iio_buffer_refill": fn(Buffer) -> isize;
    read = "iio_channel_read": fn(Channel, Buffer, *mut c_void, usize) -> usize;
    error_text = "iio_strerror": fn(c_int, *mut c_char, usize) -> ();
});

/// `struct iio_data_format`.
#[repr(C)]
#[allow(dead_code, reason = "fields of C")]
struct Format {
    length: c_uint,
    bits: c_uint,
    shift: c_uint,
    is_signed: bool,
    is_fully_defined: bool,
    is_be: bool,
    with_scale: bool,
    scale: f64,
    repeat: c_uint,
}

/// Readings that wait in the kernel while nobody takes them.
const WAITING: c_uint = 16;

/// An input that is read.
struct Input {
    channel: Channel,
    /// Bytes of one number.
    width: usize,
    /// Its place in a scan.
    index: c_long,
    bits: u32,
    signed: bool,
    scale: f64,
    offset: f64,
    /// What the kernel's interface gives is m/s², mV or something else.
    quantity: Quantity,
}

/// What the numbers of a channel are, by its name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// m/s².
    Acceleration,
    /// Given in volts.
    Voltage,
    /// Whatever it is.
    Other,
}

impl Quantity {
    /// By the beginning of the channel's name: `accel_x`, `voltage0`.
    pub fn of(channel: &str) -> Self {
        match channel.trim_end_matches(|c: char| c.is_ascii_digit()) {
            "voltage" => Self::Voltage,
            name if name == "accel" || name.starts_with("accel_") => Self::Acceleration,
            name if name.starts_with("voltage") => Self::Voltage,
            _ => Self::Other,
        }
    }
}

/// A running acquisition. It stops when it is dropped.
pub struct Acquisition {
    functions: Functions,
    context: Context,
    buffer: Buffer,
    inputs: Vec<Input>,
    samples: usize,
    rate_hz: Option<f64>,
    raw: Vec<u8>,
}

// SAFETY: a libiio context may be used from any thread, and this type from one at a time only.
unsafe impl Send for Acquisition {}

/// What is asked for.
#[derive(Clone, Copy, Debug)]
pub struct Wish<'a> {
    /// `local:`, `ip:192.168.1.30`, `usb:`, `serial:/dev/ttyACM0,115200,8n1`.
    pub uri: &'a str,
    /// Name or id of the device.
    pub device: &'a str,
    /// Ids of its channels.
    pub channels: &'a [&'a str],
    /// Samples per second.
    pub sample_rate_hz: f64,
    /// Sample instants of one reading.
    pub samples: usize,
    /// No answer for so long is an error.
    pub longest: Duration,
}

impl Acquisition {
    /// Finds the device, sets its rate, and starts its buffer.
    ///
    /// # Errors
    /// When the library, the device or a channel is missing, the rate is refused, or the buffer
    /// cannot be had.
    pub fn start(library: Option<&Path>, wish: Wish<'_>) -> Result<Self, DriverError> {
        let functions = Functions::load(library)?;
        let uri = c_text(wish.uri)?;
        // SAFETY: the text ends with a zero byte.
        let context = unsafe { (functions.open)(uri.as_ptr()) };
        if context.is_null() {
            return Err(functions.last_error("iio_create_context_from_uri"));
        }
        // From here on the context is destroyed whatever happens.
        let mut this = Self {
            functions,
            context,
            buffer: std::ptr::null_mut(),
            inputs: Vec::new(),
            samples: wish.samples,
            rate_hz: None,
            raw: Vec::new(),
        };
        let longest_ms = c_uint::try_from(wish.longest.as_millis()).unwrap_or(c_uint::MAX);
        // SAFETY: the context is open. A backend without time limits refuses; it is asked in vain
        // then.
        let _ = unsafe { (this.functions.set_timeout)(context, longest_ms) };
        let device = this.find(wish.device)?;
        this.choose(device, wish.channels)?;
        this.rate_hz = this.set_rate(device, wish.sample_rate_hz);
        // SAFETY: the device belongs to the open context. What it cannot queue it refuses, and goes
        // on with what it has.
        unsafe {
            let _ = (this.functions.queue)(device, WAITING);
            this.buffer = (this.functions.create_buffer)(device, wish.samples, false);
        }
        if this.buffer.is_null() {
            return Err(this.functions.last_error("iio_device_create_buffer"));
        }
        // SAFETY: the buffer is open.
        let (found, expected) = (unsafe { (this.functions.step)(this.buffer) }, scan_bytes(&this.inputs));
        if usize::try_from(found).ok() != Some(expected) {
            return Err(DriverError::Absent(format!(
                "this libiio takes a scan of {expected} bytes for one of {found}, as versions before 0.25 do with inputs of different widths; \
                 read inputs of one width, or install a later version"
            )));
        }
        Ok(this)
    }

    fn find(&self, name: &str) -> Result<Device, DriverError> {
        let (f, text) = (&self.functions, c_text(name)?);
        // SAFETY: the context is open, the text ends with a zero byte.
        let device = unsafe { (f.find_device)(self.context, text.as_ptr()) };
        if !device.is_null() {
            return Ok(device);
        }
        // SAFETY: numbers below the count are devices, whose names live as long as the context.
        let names: Vec<String> = unsafe {
            let count = (f.device_count)(self.context);
            (0..count).map(|at| from_library((f.device_name)((f.device_at)(self.context, at)))).collect()
        };
        Err(DriverError::Absent(format!("there is no device {name:?}; there are {names:?}")))
    }

    /// Enables the channels that are wanted and no others.
    fn choose(&mut self, device: Device, wanted: &[&str]) -> Result<(), DriverError> {
        let f = &self.functions;
        let mut found: Vec<(String, Channel)> = Vec::new();
        // SAFETY: the device belongs to the open context; numbers below the count are channels,
        // whose ids live as long as it.
        unsafe {
            for at in 0..(f.channel_count)(device) {
                let channel = (f.channel_at)(device, at);
                if !(f.is_output)(channel) && (f.is_scanned)(channel) {
                    (f.disable)(channel);
                    found.push((from_library((f.channel_id)(channel)), channel));
                }
            }
        }
        for &id in wanted {
            let Some((_, channel)) = found.iter().find(|(name, _)| name == id) else {
                let names: Vec<&str> = found.iter().map(|(name, _)| name.as_str()).collect();
                return Err(DriverError::Absent(format!("there is no input {id:?}; there are {names:?}")));
            };
            let channel = *channel;
            // SAFETY: the channel belongs to the open context, as does its format.
            let format = unsafe {
                (f.enable)(channel);
                (f.format)(channel).as_ref()
            };
            let format = format.ok_or_else(|| DriverError::Absent(format!("{id}: no format of its numbers")))?;
            let width = (format.length / 8) as usize;
            if !matches!(format.length, 8 | 16 | 32 | 64) || format.repeat > 1 || format.bits > format.length {
                let (bits, times) = (format.length, format.repeat.max(1));
                return Err(DriverError::Absent(format!("{id}: {times} numbers of {bits} bits cannot be read")));
            }
            let number = |name: &std::ffi::CStr, otherwise| {
                let mut value = otherwise;
                // SAFETY: the channel belongs to the open context, `value` takes one number.
                let code = unsafe { (f.channel_number)(channel, name.as_ptr(), &raw mut value) };
                if code < 0 { otherwise } else { value }
            };
            // SAFETY: the channel belongs to the open context.
            let index = unsafe { (f.channel_index)(channel) };
            self.inputs.push(Input {
                channel,
                width,
                index,
                bits: format.bits,
                signed: format.is_signed,
                scale: number(c"scale", 1.0),
                offset: number(c"offset", 0.0),
                quantity: Quantity::of(id),
            });
        }
        Ok(())
    }

    /// Sets the rate and returns the one that the device has then; `None` where it has no such
    /// number.
    fn set_rate(&self, device: Device, rate_hz: f64) -> Option<f64> {
        let (f, name, mut found) = (&self.functions, c"sampling_frequency".as_ptr(), f64::NAN);
        // SAFETY: device and channels belong to the open context, `found` takes one number. Some
        // devices have a fixed rate and refuse the first call.
        unsafe {
            if (f.device_number)(device, name, &raw mut found) >= 0 {
                (f.set_device_number)(device, name, rate_hz);
                return ((f.device_number)(device, name, &raw mut found) >= 0).then_some(found);
            }
            let channel = self.inputs.first()?.channel;
            if (f.channel_number)(channel, name, &raw mut found) >= 0 {
                (f.set_channel_number)(channel, name, rate_hz);
                return ((f.channel_number)(channel, name, &raw mut found) >= 0).then_some(found);
            }
        }
        None
    }

    /// Samples per second that the device has; `None` where it does not say.
    pub fn rate_hz(&self) -> Option<f64> {
        self.rate_hz
    }

    /// Least and largest value of each input, in its unit.
    pub fn ranges(&self) -> Vec<(f64, f64)> {
        self.inputs.iter().map(Input::range).collect()
    }

    /// Waits for the next buffer and gives the values of each input, in m/s², V or as the device
    /// has them.
    ///
    /// # Errors
    /// When nothing came in time, or the device is gone.
    pub fn read(&mut self, values: &mut [Vec<f64>]) -> Result<(), DriverError> {
        let f = &self.functions;
        // SAFETY: the buffer is open.
        let code = unsafe { (f.refill)(self.buffer) };
        if code < 0 {
            return Err(f.error("iio_buffer_refill", code as i64));
        }
        for (input, values) in self.inputs.iter().zip(values) {
            self.raw.resize(self.samples * input.width, 0);
            // SAFETY: the channel is enabled in this buffer, and the library is told how much room
            // there is.
            let bytes = unsafe { (f.read)(input.channel, self.buffer, self.raw.as_mut_ptr().cast(), self.raw.len()) };
            values.clear();
            let numbers = self.raw[..bytes.min(self.raw.len())].chunks_exact(input.width);
            values.extend(numbers.map(|bytes| input.physical(input.number(bytes))));
        }
        Ok(())
    }
}

/// Bytes of a scan as the kernel lays it out: each number at a multiple of its own size, the whole
/// at one of the largest.
fn scan_bytes(inputs: &[Input]) -> usize {
    let mut places: Vec<(c_long, usize)> = inputs.iter().map(|input| (input.index, input.width)).collect();
    places.sort_unstable();
    // Inputs may share a place.
    places.dedup_by_key(|(index, _)| *index);
    let end = places.iter().fold(0, |end: usize, (_, width)| end.next_multiple_of(*width) + width);
    end.next_multiple_of(places.iter().map(|(_, width)| *width).max().unwrap_or(1))
}

impl Input {
    /// A number as `iio_channel_read` leaves it: of this machine's byte order, shifted and with its
    /// sign.
    fn number(&self, bytes: &[u8]) -> f64 {
        let mut wide = [0; 8];
        let of = |bytes: &[u8], wide: &mut [u8; 8]| {
            if cfg!(target_endian = "little") {
                wide[..bytes.len()].copy_from_slice(bytes);
            } else {
                wide[8 - bytes.len()..].copy_from_slice(bytes);
            }
        };
        of(bytes, &mut wide);
        let raw = u64::from_ne_bytes(wide);
        let unused = 64 - 8 * self.width as u32;
        match self.signed {
            true => ((raw << unused).cast_signed() >> unused) as c_longlong as f64,
            false => raw as f64,
        }
    }

    /// The ends of the converter.
    fn range(&self) -> (f64, f64) {
        let half = 2_f64.powi(self.bits as i32 - i32::from(self.signed));
        let (a, b) = (self.physical(if self.signed { -half } else { 0.0 }), self.physical(half - 1.0));
        (a.min(b), a.max(b))
    }

    fn physical(&self, number: f64) -> f64 {
        let value = (number + self.offset) * self.scale;
        if self.quantity == Quantity::Voltage { value * 1e-3 } else { value }
    }
}

impl Drop for Acquisition {
    fn drop(&mut self) {
        // SAFETY: both are open, and are not used again; the buffer goes first, since it belongs to
        // the context.
        unsafe {
            if !self.buffer.is_null() {
                (self.functions.destroy_buffer)(self.buffer);
            }
            (self.functions.close)(self.context);
        }
    }
}

impl Functions {
    /// What `errno` says after a call that returned null. On Windows the C library has one of its
    /// own, which is not seen from here.
    fn last_error(&self, call: &'static str) -> DriverError {
        let seen = if cfg!(windows) { None } else { std::io::Error::last_os_error().raw_os_error() };
        let code = seen.unwrap_or(0);
        self.error(call, -i64::from(code))
    }

    fn error(&self, call: &'static str, code: i64) -> DriverError {
        if code == 0 {
            return DriverError::Call { call, message: "failed without a reason".to_owned(), code };
        }
        let mut text = [0_u8; 256];
        let number = c_int::try_from(-code).unwrap_or(c_int::MAX);
        // SAFETY: the library writes at most as many bytes as it is told, with a zero byte at their
        // end.
        unsafe { (self.error_text)(number, text.as_mut_ptr().cast(), text.len()) };
        DriverError::Call { call, message: from_buffer(&text), code }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn input(width: usize, signed: bool) -> Input {
        let (channel, bits) = (std::ptr::null_mut(), 8 * width as u32);
        Input { channel, width, index: 0, bits, signed, scale: 0.5, offset: 2.0, quantity: Quantity::Other }
    }

    #[test]
    fn analytic_scans_are_padded_as_the_kernel_does() {
        let of = |widths: &[usize]| {
            let inputs: Vec<Input> = widths
                .iter()
                .enumerate()
                .map(|(at, &width)| Input { index: at as c_long, ..input(width, true) })
                .collect();
            scan_bytes(&inputs)
        };
        assert_eq!([of(&[4]), of(&[2, 2, 2]), of(&[4, 2]), of(&[2, 4, 2]), of(&[2, 2, 8])], [4, 6, 8, 12, 16]);
        assert_eq!(scan_bytes(&[input(4, true), input(4, true)]), 4);
    }

    #[test]
    fn analytic_numbers_of_each_width_keep_their_sign() {
        assert_eq!(input(2, true).number(&(-5_i16).to_ne_bytes()), -5.0);
        assert_eq!(input(2, false).number(&65_531_u16.to_ne_bytes()), 65_531.0);
        assert_eq!(input(4, true).number(&i32::MIN.to_ne_bytes()), f64::from(i32::MIN));
        assert_eq!(input(1, true).number(&[0xff]), -1.0);
        assert_eq!(input(8, true).number(&(-3_i64).to_ne_bytes()), -3.0);
        // (raw + offset) × scale, in V where the kernel says mV.
        assert_eq!(input(2, true).physical(10.0), 6.0);
        let volts = Input { quantity: Quantity::Voltage, ..input(2, true) };
        assert_eq!(volts.physical(10.0), 6e-3);
        assert_eq!(input(2, true).range(), (-16_383.0, 16_384.5));
        let falling = Input { bits: 12, scale: -1.0, ..input(2, false) };
        assert_eq!(falling.range(), (-4097.0, -2.0));
    }

    #[test]
    fn conform_the_quantity_follows_from_the_channels_name() {
        assert_eq!(Quantity::of("accel_x"), Quantity::Acceleration);
        assert_eq!(Quantity::of("voltage0"), Quantity::Voltage);
        assert_eq!(Quantity::of("voltage0-voltage1"), Quantity::Voltage);
        assert_eq!(Quantity::of("temp"), Quantity::Other);
    }
}
