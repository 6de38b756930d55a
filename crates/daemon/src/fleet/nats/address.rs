//! Where a server is.

use std::str::FromStr;

/// The port that NATS has been given (IANA).
const PORT: u16 = 4222;

/// `nats://host:port`, or `tls://host:port` where nothing may be said in the clear.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Address {
    pub tls: bool,
    /// A name or an address; of IPv6 without brackets.
    pub host: String,
    pub port: u16,
}

/// What is wrong with an address.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum AddressError {
    /// Before `://` stands something else.
    #[error("{0:?} is neither nats nor tls")]
    Scheme(String),
    /// A path, a query or a user.
    #[error("behind the host and the port there is something more")]
    More,
    /// An address of IPv6 has no end.
    #[error("a bracket is open")]
    Bracket,
    /// Behind the bracket there is something else.
    #[error("no port after it")]
    NoPort,
    /// Nothing stands before the port.
    #[error("there is no host")]
    NoHost,
    /// No number, or one that is too large.
    #[error("{0:?} is no port")]
    Port(String),
}

impl FromStr for Address {
    type Err = AddressError;

    fn from_str(text: &str) -> Result<Self, AddressError> {
        let (scheme, rest) = text.split_once("://").unwrap_or(("nats", text));
        let tls = match scheme {
            "nats" => false,
            "tls" => true,
            other => return Err(AddressError::Scheme(other.to_owned())),
        };
        let rest = rest.strip_suffix('/').unwrap_or(rest);
        if rest.contains(['/', '?', '#', '@', ' ']) {
            return Err(AddressError::More);
        }
        let (host, port) = match rest.strip_prefix('[') {
            Some(inner) => {
                let (host, port) = inner.split_once(']').ok_or(AddressError::Bracket)?;
                (host, if port.is_empty() { None } else { Some(port.strip_prefix(':').ok_or(AddressError::NoPort)?) })
            }
            None => rest.split_once(':').map_or((rest, None), |(host, port)| (host, Some(port))),
        };
        if host.is_empty() {
            return Err(AddressError::NoHost);
        }
        let port = port.map_or(Ok(PORT), |port| port.parse().map_err(|_| AddressError::Port(port.to_owned())))?;
        Ok(Self { tls, host: host.to_owned(), port })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn conform_addresses_are_read() {
        for (text, tls, host, port) in [
            ("nats://127.0.0.1:4222", false, "127.0.0.1", 4222),
            ("tls://broker.example", true, "broker.example", 4222),
            ("broker:5222/", false, "broker", 5222),
            ("nats://[::1]:77", false, "::1", 77),
            ("nats://[::1]", false, "::1", 4222),
        ] {
            let address = Address { tls, host: host.to_owned(), port };
            assert_eq!(text.parse::<Address>(), Ok(address), "{text}");
        }
        for text in ["ws://a", "nats://", "nats://a:x", "nats://a:70000", "nats://a/b", "nats://[::1", "nats://u@h", ""]
        {
            assert!(text.parse::<Address>().is_err(), "{text}");
        }
    }
}
