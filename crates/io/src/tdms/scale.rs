//! Scales that NI's software writes as properties of a channel.

use super::properties::{Properties, Value};

/// A scale that cannot be used: one that is not linear, such as that of a thermocouple, or that no
/// number comes out of.
#[derive(Debug, PartialEq, thiserror::Error)]
pub(super) enum ScaleError {
    #[error("a polynomial scale above first order")]
    Curved,
    #[error("a scale of kind {0:?}")]
    Kind(String),
    #[error("a scale of {scale} with offset {offset}")]
    Number { scale: f64, offset: f64 },
}

/// Scale and offset of a channel.
///
/// # Errors
/// [`ScaleError`].
pub(super) fn linear(properties: &Properties) -> Result<(f64, f64), ScaleError> {
    let number = |name: &str| properties.get(name).and_then(Value::number);
    if properties.get("NI_Scaling_Status").and_then(Value::text).is_some_and(|status| status == "scaled") {
        return Ok((1.0, 0.0));
    }
    let (mut scale, mut offset) = (1.0, 0.0);
    // From the raw values on, in the order of their numbers.
    for i in 0..count(properties) {
        let kind = properties.get(&format!("NI_Scale[{i}]_Scale_Type")).and_then(Value::text);
        let (slope, intercept) = match kind.as_deref() {
            None => continue,
            Some("Linear") => (
                number(&format!("NI_Scale[{i}]_Linear_Slope")).unwrap_or(1.0),
                number(&format!("NI_Scale[{i}]_Linear_Y_Intercept")).unwrap_or(0.0),
            ),
            Some("Polynomial") => {
                let size = number(&format!("NI_Scale[{i}]_Polynomial_Coefficients_Size")).unwrap_or(0.0);
                let coefficient =
                    |k: u32| number(&format!("NI_Scale[{i}]_Polynomial_Coefficients[{k}]")).unwrap_or(0.0);
                let curved = (2..size.clamp(0.0, 100.0) as u32).any(|k| coefficient(k) != 0.0);
                if curved {
                    return Err(ScaleError::Curved);
                }
                (coefficient(1), coefficient(0))
            }
            Some(other) => return Err(ScaleError::Kind(other.to_owned())),
        };
        offset = offset * slope + intercept;
        scale *= slope;
    }
    if scale == 0.0 || !f64::is_finite(scale) || !f64::is_finite(offset) {
        return Err(ScaleError::Number { scale, offset });
    }
    Ok((scale, offset))
}

/// Number of the raw scaler that the first scale works on.
pub(super) fn source(properties: &Properties) -> u32 {
    let input = (0..count(properties)).find_map(|i| {
        let kinds = ["Linear", "Polynomial"];
        kinds
            .iter()
            .find_map(|kind| properties.get(&format!("NI_Scale[{i}]_{kind}_Input_Source")).and_then(Value::number))
    });
    // Casts from float saturate.
    input.unwrap_or(0.0) as u32
}

fn count(properties: &Properties) -> u32 {
    properties.get("NI_Number_Of_Scales").and_then(Value::number).unwrap_or(0.0).clamp(0.0, 64.0) as u32
}
