//! Units as files write them, and as the recording contract knows them.

/// The contract's name of a unit and the factor to it; `None` for a unit that the contract does not
/// know.
pub fn canonical(text: &str) -> Option<(&'static str, f64)> {
    const INCH_MM: f64 = 25.4;
    let mut key: String = text.trim().to_lowercase().chars().filter(|c| !c.is_whitespace()).collect();
    for (from, to) in [("²", "2"), ("^", ""), ("**", ""), ("(", ""), (")", ""), ("[", ""), ("]", "")] {
        key = key.replace(from, to);
    }
    Some(match key.as_str() {
        "m/s2" | "m/s/s" | "ms-2" | "m.s-2" | "m*s-2" => ("m/s^2", 1.0),
        "mm/s2" => ("m/s^2", 1e-3),
        "g" | "gn" | "g_n" | "gpk" => ("g", 1.0),
        "mg" => ("g", 1e-3),
        "mm/s" => ("mm/s", 1.0),
        "m/s" => ("mm/s", 1e3),
        "in/s" | "ips" => ("mm/s", INCH_MM),
        "v" | "volt" | "volts" => ("V", 1.0),
        "mv" => ("V", 1e-3),
        "1" | "-" | "fs" | "counts" => ("1", 1.0),
        _ => return None,
    })
}
