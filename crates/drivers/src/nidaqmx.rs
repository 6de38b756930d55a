//! NI-DAQmx: continuous acquisition of analogue inputs by the device's own clock.
//!
//! Functions, types and numbers are those of `NIDAQmx.h` and of NI's reference of the C interface
//! (names of the constants are kept beside them).

use std::ffi::{c_char, c_void};
use std::path::Path;
use std::time::Duration;

use crate::library::{Wanted, functions};
use crate::{DriverError, c_text, from_buffer};

static WANTED: Wanted = Wanted {
    what: "NI-DAQmx",
    files: if cfg!(windows) { &["nicaiu.dll"] } else { &["libnidaqmx.so.1", "libnidaqmx.so"] },
    remedy: "install NI-DAQmx from ni.com, or give the library's path",
};

type Task = *mut c_void;

functions!(WANTED, "system", {
    create_task = "DAQmxCreateTask": fn(*const c_char, *mut Task) -> i32;
    clear_task = "DAQmxClearTask": fn(Task) -> i32;
    start_task = "DAQmxStartTask": fn(Task) -> i32;
    stop_task = "DAQmxStopTask": fn(Task) -> i32;
    voltage = "DAQmxCreateAIVoltageChan": fn(Task, *const c_char, *const c_char, i32, f64, f64, i32, *const c_char) -> i32;
    acceleration = "DAQmxCreateAIAccelChan": fn(
        Task, *const c_char, *const c_char, i32, f64, f64, i32, f64, i32, i32, f64, *const c_char
    ) -> i32;
    clock = "DAQmxCfgSampClkTiming": fn(Task, *const c_char, f64, i32, i32, u64) -> i32;
    clock_rate = "DAQmxGetSampClkRate": fn(Task, *mut f64) -> i32;
    buffer = "DAQmxCfgInputBuffer": fn(Task, u32) -> i32;
    read = "DAQmxReadAnalogF64": fn(Task, i32, f64, u32, *mut f64, u32, *mut i32, *mut u32) -> i32;
    overload_found = "DAQmxGetReadOverloadedChansExist": fn(Task, *mut u32) -> i32;
    overloaded = "DAQmxGetReadOverloadedChans": fn(Task, *mut c_char, u32) -> i32;
    serial = "DAQmxGetDevSerialNum": fn(*const c_char, *mut u32) -> i32;
    last_error = "DAQmxGetExtendedErrorInfo": fn(*mut c_char, u32) -> i32;
});

/// `DAQmx_Val_Cfg_Default`: the wiring that the device takes by itself.
const DEFAULT_WIRING: i32 = -1;
/// `DAQmx_Val_Volts`.
const VOLTS: i32 = 10_348;
/// `DAQmx_Val_AccelUnit_g`, `DAQmx_Val_MetersPerSecondSquared`.
const G: i32 = 10_186;
const METRES_PER_SECOND_SQUARED: i32 = 12_470;
/// `DAQmx_Val_mVoltsPerG`.
const MILLIVOLTS_PER_G: i32 = 12_509;
/// `DAQmx_Val_Internal`, `DAQmx_Val_None`: where the current of an IEPE sensor comes from.
const INTERNAL: i32 = 10_200;
const NO_EXCITATION: i32 = 10_230;
/// `DAQmx_Val_Rising`, `DAQmx_Val_ContSamps`.
const RISING: i32 = 10_280;
const CONTINUOUS: i32 = 10_123;
/// `DAQmx_Val_GroupByScanNumber`: all channels of one instant, then the next.
const BY_SCAN: u32 = 1;
/// `DAQmxErrorSamplesNotYetAvailable`: the time was too short for so many samples.
const NOT_YET: i32 = -200_284;
/// Seconds that the library's buffer holds.
const BUFFERED_SECS: f64 = 10.0;

/// What an input measures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Measures {
    /// An accelerometer.
    Acceleration {
        /// In mV per g.
        sensitivity_mv_per_g: f64,
        /// Its current by the device (A); 0 for none.
        iepe_current_a: f64,
        /// The values are m/s², not g.
        metric: bool,
    },
    /// Volts.
    Voltage,
}

/// An analogue input.
#[derive(Clone, Debug, PartialEq)]
pub struct Input {
    /// Such as `cDAQ1Mod1/ai0`.
    pub physical: String,
    /// What it measures.
    pub measures: Measures,
    /// Largest value, in volts.
    pub range_v: f64,
}

/// A running acquisition. It stops when it is dropped.
pub struct Acquisition {
    functions: Functions,
    task: Task,
    inputs: usize,
    rate_hz: f64,
}

// SAFETY: NI-DAQmx lets a task be used from any thread, and this type from one at a time only.
unsafe impl Send for Acquisition {}

impl Acquisition {
    /// Configures and starts all inputs with one clock.
    ///
    /// # Errors
    /// When the library is missing, or refuses the inputs or the rate.
    pub fn start(library: Option<&Path>, inputs: &[Input], sample_rate_hz: f64) -> Result<Self, DriverError> {
        let functions = Functions::load(library)?;
        let mut task: Task = std::ptr::null_mut();
        // SAFETY: an empty name lets the library choose one; `task` takes the handle.
        let code = unsafe { (functions.create_task)(c"".as_ptr(), &raw mut task) };
        functions.check("DAQmxCreateTask", code)?;
        // From here on the task is cleared whatever happens.
        let mut this = Self { functions, task, inputs: inputs.len(), rate_hz: sample_rate_hz };
        inputs.iter().try_for_each(|input| this.add(input))?;
        let buffered = sample_rate_hz * BUFFERED_SECS;
        let f = &this.functions;
        // SAFETY: the task is open; an empty source is the device's own clock.
        let code = unsafe { (f.clock)(task, c"".as_ptr(), sample_rate_hz, RISING, CONTINUOUS, buffered as u64) };
        f.check("DAQmxCfgSampClkTiming", code)?;
        // SAFETY: the task is open.
        f.check("DAQmxCfgInputBuffer", unsafe { (f.buffer)(task, buffered as u32) })?;
        let mut rate_hz = sample_rate_hz;
        // SAFETY: the task is open, `rate_hz` takes one number.
        f.check("DAQmxGetSampClkRate", unsafe { (f.clock_rate)(task, &raw mut rate_hz) })?;
        // SAFETY: the task is open.
        f.check("DAQmxStartTask", unsafe { (f.start_task)(task) })?;
        this.rate_hz = rate_hz;
        Ok(this)
    }

    fn add(&self, input: &Input) -> Result<(), DriverError> {
        let physical = c_text(&input.physical)?;
        let (f, name, none) = (&self.functions, c"".as_ptr(), std::ptr::null());
        match input.measures {
            Measures::Voltage => {
                let range = input.range_v;
                // SAFETY: the task is open; both texts end with a zero byte; no custom scale.
                let code = unsafe {
                    (f.voltage)(self.task, physical.as_ptr(), name, DEFAULT_WIRING, -range, range, VOLTS, none)
                };
                f.check("DAQmxCreateAIVoltageChan", code)
            }
            Measures::Acceleration { sensitivity_mv_per_g, iepe_current_a, metric } => {
                let range = range_of(input);
                let unit = if metric { METRES_PER_SECOND_SQUARED } else { G };
                let excitation = if iepe_current_a > 0.0 { INTERNAL } else { NO_EXCITATION };
                // SAFETY: as above.
                let code = unsafe {
                    (f.acceleration)(
                        self.task,
                        physical.as_ptr(),
                        name,
                        DEFAULT_WIRING,
                        -range,
                        range,
                        unit,
                        sensitivity_mv_per_g,
                        MILLIVOLTS_PER_G,
                        excitation,
                        iepe_current_a,
                        none,
                    )
                };
                f.check("DAQmxCreateAIAccelChan", code)
            }
        }
    }

    /// Samples per second that the device has, which may not be those that were asked for.
    pub fn rate_hz(&self) -> f64 {
        self.rate_hz
    }

    /// Reads up to `samples.len()` / inputs sample instants, all inputs of one instant in turn, and
    /// returns how many came in time.
    ///
    /// # Errors
    /// When samples were lost, or the device is gone.
    pub fn read(&mut self, samples: &mut [f64], longest: Duration) -> Result<usize, DriverError> {
        let most = i32::try_from(samples.len() / self.inputs).unwrap_or(i32::MAX);
        let room = u32::try_from(samples.len()).unwrap_or(u32::MAX);
        let mut came = 0;
        // SAFETY: the task is open, and the library is told how much room there is.
        let code = unsafe {
            (self.functions.read)(
                self.task,
                most,
                longest.as_secs_f64(),
                BY_SCAN,
                samples.as_mut_ptr(),
                room,
                &raw mut came,
                std::ptr::null_mut(),
            )
        };
        if code != NOT_YET {
            self.functions.check("DAQmxReadAnalogF64", code)?;
        }
        Ok(usize::try_from(came).unwrap_or(0).min(samples.len() / self.inputs))
    }

    /// Inputs that were driven past their range since the last reading; none where the device
    /// cannot say.
    pub fn overloaded(&self) -> Overloaded {
        let mut found = 0;
        // SAFETY: the task is open, `found` takes one number.
        let code = unsafe { (self.functions.overload_found)(self.task, &raw mut found) };
        if code != 0 || found == 0 {
            return Overloaded(String::new());
        }
        let mut names = [0_u8; 4096];
        // SAFETY: the task is open; the library writes at most as many bytes as it is told, with a
        // zero byte at their end.
        let code = unsafe { (self.functions.overloaded)(self.task, names.as_mut_ptr().cast(), names.len() as u32) };
        let names = if code == 0 { from_buffer(&names) } else { String::new() };
        // Which ones cannot be had: none of them is to be trusted.
        Overloaded(if names.is_empty() { ALL.to_owned() } else { names })
    }

    /// Serial number of a device (`cDAQ1Mod1`), where it has one.
    pub fn serial(&self, device: &str) -> Option<u32> {
        let device = c_text(device).ok()?;
        let mut serial = 0;
        // SAFETY: the text ends with a zero byte, `serial` takes one number.
        let code = unsafe { (self.functions.serial)(device.as_ptr(), &raw mut serial) };
        (code == 0 && serial != 0).then_some(serial)
    }
}

/// Stands for every input.
const ALL: &str = "*";

/// The inputs that are overloaded, as the library lists them: `cDAQ1Mod1/ai0, cDAQ1Mod1/ai2:3`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Overloaded(String);

impl Overloaded {
    /// This input is one of them.
    pub fn contains(&self, physical: &str) -> bool {
        let (wanted, number) = split(physical);
        self.0 == ALL
            || self.0.split(',').map(str::trim).any(|entry| {
                let (first, last) = entry.split_once(':').unwrap_or((entry, ""));
                let (name, first) = split(first);
                // The end of a range is a number, or a whole name.
                let last = if last.is_empty() { first } else { split(last).1 };
                name.eq_ignore_ascii_case(wanted) && (first..=last).contains(&number)
            })
    }
}

/// A name and the number at its end; 0 where there is none.
fn split(name: &str) -> (&str, u64) {
    let stem = name.trim_end_matches(|c: char| c.is_ascii_digit());
    (stem, name[stem.len()..].parse().unwrap_or(0))
}

/// Largest value of an input in its unit.
pub fn range_of(input: &Input) -> f64 {
    match input.measures {
        Measures::Voltage => input.range_v,
        Measures::Acceleration { sensitivity_mv_per_g, metric, .. } => {
            let in_g = input.range_v * 1e3 / sensitivity_mv_per_g;
            if metric { in_g * STANDARD_GRAVITY } else { in_g }
        }
    }
}

/// m/s² (ISO 80000-3).
pub const STANDARD_GRAVITY: f64 = 9.806_65;

impl Drop for Acquisition {
    fn drop(&mut self) {
        // SAFETY: the task is open, and is not used again.
        unsafe {
            (self.functions.stop_task)(self.task);
            (self.functions.clear_task)(self.task);
        }
    }
}

impl Functions {
    /// Negative numbers are errors, positive ones warnings.
    fn check(&self, call: &'static str, code: i32) -> Result<(), DriverError> {
        if code >= 0 {
            return Ok(());
        }
        let mut text = [0_u8; 2048];
        // SAFETY: the library writes at most as many bytes as it is told, with a zero byte at their
        // end.
        let said = unsafe { (self.last_error)(text.as_mut_ptr().cast(), text.len() as u32) };
        let said = if said >= 0 { from_buffer(&text) } else { String::new() };
        // Several lines: the first ones say what, the last ones which task.
        let said = said.split_whitespace().collect::<Vec<_>>().join(" ");
        let message = if said.is_empty() { format!("error {code}") } else { format!("error {code}: {said}") };
        Err(DriverError::Call { call, message, code: i64::from(code) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn conform_lists_of_inputs_are_read_as_the_library_writes_them() {
        let list = Overloaded("cDAQ1Mod1/ai0, cDAQ1Mod1/ai2:3,cDAQ1Mod2/ai11:cDAQ1Mod2/ai12".to_owned());
        for (name, among) in [
            ("cDAQ1Mod1/ai0", true),
            ("cdaq1mod1/ai0", true),
            ("cDAQ1Mod1/ai1", false),
            ("cDAQ1Mod1/ai3", true),
            ("cDAQ1Mod1/ai4", false),
            ("cDAQ1Mod2/ai1", false),
            ("cDAQ1Mod2/ai12", true),
            ("cDAQ1Mod3/ai0", false),
        ] {
            assert_eq!(list.contains(name), among, "{name}");
        }
        assert!(!Overloaded(String::new()).contains("Dev1/ai0"));
        assert!(Overloaded(ALL.to_owned()).contains("Dev1/ai0"));
    }

    #[test]
    fn analytic_the_range_of_an_accelerometer_is_the_voltage_over_its_sensitivity() {
        let input = |measures| Input { physical: "Dev1/ai0".to_owned(), measures, range_v: 5.0 };
        let metric = |metric| Measures::Acceleration { sensitivity_mv_per_g: 100.0, iepe_current_a: 0.002, metric };
        assert_eq!(range_of(&input(Measures::Voltage)), 5.0);
        assert_eq!(range_of(&input(metric(false))), 50.0);
        assert_eq!(range_of(&input(metric(true))), 50.0 * STANDARD_GRAVITY);
    }
}
