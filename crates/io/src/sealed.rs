//! JSON objects with a checksum of their own: SHA-256 of the object without that key as compact
//! JSON, keys in the order of the file.

use serde_json::Value;
use sha2::{Digest, Sha256};

/// Key of the checksum.
pub(crate) const CHECKSUM: &str = "checksum_sha256";

/// SHA-256, lower-case hexadecimal.
pub(crate) fn sha256_of(text: &str) -> String {
    Sha256::digest(text.as_bytes()).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Text of the object with its checksum; `None` where it is no object.
pub(crate) fn seal(mut value: Value) -> Option<String> {
    let checksum = sha256_of(&value.to_string());
    value.as_object_mut()?.insert(CHECKSUM.to_owned(), Value::String(checksum));
    Some(format!("{value:#}\n"))
}

/// Why a text is not what was sealed.
pub(crate) enum Broken {
    /// No JSON, another format, or no checksum.
    Syntax(String),
    /// The content is not what was written.
    Checksum { found: String, computed: String },
}

/// The object without its checksum, checked; `format` is what its key of that name must hold.
pub(crate) fn unseal(text: &str, format: &str) -> Result<Value, Broken> {
    let mut value: Value = serde_json::from_str(text).map_err(|e| Broken::Syntax(e.to_string()))?;
    let object = value.as_object_mut().ok_or_else(|| Broken::Syntax("expected a JSON object".to_owned()))?;
    match object.get("format").and_then(Value::as_str) {
        Some(found) if found == format => {}
        Some(other) => return Err(Broken::Syntax(format!("format is {other:?}"))),
        None => return Err(Broken::Syntax("the key \"format\" is missing".to_owned())),
    }
    let found = match object.shift_remove(CHECKSUM) {
        Some(Value::String(found)) => found,
        _ => return Err(Broken::Syntax(format!("the key {CHECKSUM:?} is missing"))),
    };
    let computed = sha256_of(&value.to_string());
    if found == computed { Ok(value) } else { Err(Broken::Checksum { found, computed }) }
}
