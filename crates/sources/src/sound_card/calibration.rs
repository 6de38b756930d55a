//! The calibration that USB accelerometers carry in their name.
//!
//! ```text
//! offset  length
//!  0       6     model: 333D01, 485B39, 633A01, SDC…
//!  7       1     format: 1 acceleration, 2 voltage, 3 voltage with a gain of 20
//!  8       6     serial number
//! 14       5     format 1: counts of 24 bit per m/s² of channel A; then 5 of channel B; then the date, yymmdd
//! 14       7     formats 2 and 3: counts of 24 bit per V of channel A; then 7 of channel B; then the date
//! ```
//!
//! Source: The Modal Shop, interface guide MAN-0343.

/// Models by the letters that only they have in their names.
const MODELS: [&str; 4] = ["333D", "485B", "633A", "SDC0"];
/// Counts of full scale: 24 bit.
const FULL_SCALE_COUNTS: f64 = 8_388_608.0;
/// Gain of format 3.
const GAIN: f64 = 20.0;

/// What a device says of itself.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Calibration {
    pub(super) model: String,
    pub(super) serial: String,
    /// Unit of the physical values.
    pub(super) unit: &'static str,
    /// Physical value of full scale of channel A and B; `None` where the device says 0, as for an
    /// input that it does not have.
    pub(super) full_scale: [Option<f64>; 2],
    /// When it was calibrated (yymmdd).
    pub(super) date: String,
}

/// Finds the calibration in a name; `None` where there is none.
pub(super) fn read(name: &str) -> Option<Calibration> {
    // In ASCII a part of the text is a part of its bytes.
    let start = MODELS.iter().find_map(|model| name.find(model)).filter(|_| name.is_ascii())?;
    let part = |from: usize, to: usize| name.get(start + from..start + to);
    let digits = |from, to| part(from, to).filter(|text| text.bytes().all(|b| b.is_ascii_digit()));
    let (unit, length, gain) = match part(7, 8)? {
        "1" => ("m/s^2", 5, 1.0),
        "2" => ("V", 7, 1.0),
        "3" => ("V", 7, GAIN),
        _ => return None,
    };
    let end = 14 + 2 * length;
    let scale = |from| -> Option<Option<f64>> {
        let counts_per_unit: f64 = digits(from, from + length)?.parse().ok()?;
        Some((counts_per_unit > 0.0).then(|| gain * FULL_SCALE_COUNTS / counts_per_unit))
    };
    Some(Calibration {
        model: part(0, 6)?.to_owned(),
        serial: digits(8, 14)?.to_owned(),
        unit,
        full_scale: [scale(14)?, scale(14 + length)?],
        date: digits(end, end + 6)?.to_owned(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 855400 / counts is full scale in g: 2^23 / 9.80665 = 855 400.
    #[test]
    fn literature_acceleration_in_counts_per_metre_and_second_squared() {
        let found = read("333D01 10123454365408745170131 USB Audio").unwrap_or_else(|| panic!("no calibration"));
        assert_eq!((found.model.as_str(), found.serial.as_str(), found.unit), ("333D01", "012345", "m/s^2"));
        let [Some(a), Some(b)] = found.full_scale else { panic!("{found:?}") };
        assert!((a / 9.80665 - 855_400.0 / 43_654.0).abs() < 1e-4, "{a}");
        assert!((b / 9.80665 - 855_400.0 / 8_745.0).abs() < 1e-3, "{b}");
        assert_eq!(found.date, "170131");
    }

    #[test]
    fn conform_voltage_gain_and_what_is_no_calibration() {
        let of =
            |format: char| read(&format!("USB: 485B39 {format}00004208388600000000170131")).unwrap_or_else(|| panic!());
        assert_eq!(of('2').unit, "V");
        // 838 860 counts per V: full scale is 10 V; an input that is not there says 0.
        let [Some(plain), None] = of('2').full_scale else { panic!("{:?}", of('2')) };
        assert!((plain - 10.0).abs() < 1e-4, "{plain}");
        let [Some(gained), None] = of('3').full_scale else { panic!() };
        assert!((gained - 200.0).abs() < 1e-2, "{gained}");
        assert_eq!((of('2').serial.as_str(), of('2').date.as_str()), ("000042", "170131"));
        for name in
            ["HDA Intel PCH", "333D01", "333D01 90123454365408745170131", "333D01 1012345x365408745170131", "333D01 1é"]
        {
            assert_eq!(read(name), None, "{name}");
        }
    }
}
