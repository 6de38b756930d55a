//! What must not be printed: passwords, tokens, addresses that are keys themselves.

use std::path::Path;

/// A text that shows itself to nobody. It has no way into a message, a log or a state but
/// [`Secret::expose`].
#[derive(Clone, PartialEq, Eq)]
pub struct Secret(String);

impl Secret {
    /// Takes a text.
    pub fn new(text: impl Into<String>) -> Self {
        Self(text.into())
    }

    /// Reads the first line of a file.
    ///
    /// # Errors
    /// When it cannot be read.
    pub fn read(path: &Path) -> std::io::Result<Self> {
        let text = gearwatch_io::text::read_text(path)?;
        Ok(Self(text.lines().next().unwrap_or_default().trim().to_owned()))
    }

    /// The text itself, for the one who must have it.
    pub fn expose(&self) -> &str {
        &self.0
    }
}

impl std::fmt::Debug for Secret {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Secret")
    }
}

/// What of an address may be said: scheme, host and port. User, password, path and query may be
/// secrets.
pub fn place(address: &str) -> String {
    let (scheme, rest) = address.split_once("://").unwrap_or(("", address));
    let authority = rest.split(['/', '?', '#']).next().unwrap_or_default();
    let host = authority.rsplit('@').next().unwrap_or_default();
    if scheme.is_empty() { host.to_owned() } else { format!("{scheme}://{host}") }
}

/// Whether an address carries a secret: a user or password, a query, or a part of the path that
/// looks like a key.
pub fn carries_secret(address: &str) -> bool {
    let rest = address.split_once("://").map_or(address, |(_, rest)| rest);
    let (authority, path) = rest.split_at(rest.find(['/', '?', '#']).unwrap_or(rest.len()));
    authority.contains('@') || path.contains('?') || path.split('/').any(looks_like_key)
}

/// Letters and digits mixed, longer than a word: what services put into addresses that only the
/// owner may know.
fn looks_like_key(part: &str) -> bool {
    const LONGEST_WORD: usize = 16;
    let has = |wanted: fn(&char) -> bool| part.chars().any(|c| wanted(&c));
    part.chars().count() > LONGEST_WORD && has(char::is_ascii_digit) && has(char::is_ascii_alphabetic)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn conform_a_secret_shows_itself_to_nobody() {
        let secret = Secret::new("open sesame");
        assert_eq!(format!("{secret:?} {:?}", Some(&secret)), "Secret Some(Secret)");
        assert_eq!(secret.expose(), "open sesame");
    }

    #[test]
    fn regress_addresses_with_secrets_are_told_from_others() {
        for address in [
            "nats://user:password@broker:4222",
            "https://host/hook?key=1",
            "https://t0ken@host/",
            "https://hooks.example.com/services/T00000000/B00000000/XXXXXXXXXXXX12345678",
            "user:password@host",
        ] {
            assert!(carries_secret(address), "{address}");
            let shown = place(address);
            for secret in ["password", "key=1", "t0ken", "XXXX"] {
                assert!(!shown.contains(secret), "{shown}");
            }
        }
        for address in
            ["http://127.0.0.1:9000/alarms", "nats://127.0.0.1:4222", "https://alerts.example.com/bench-3/gearwatch"]
        {
            assert!(!carries_secret(address), "{address}");
        }
        assert_eq!(place("https://u:p@host:1/x"), "https://host:1");
    }
}
