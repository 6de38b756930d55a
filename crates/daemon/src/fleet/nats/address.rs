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

impl FromStr for Address {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (scheme, rest) = text.split_once("://").unwrap_or(("nats", text));
        let tls = match scheme {
            "nats" => false,
            "tls" => true,
            other => return Err(format!("{other:?} is neither nats nor tls")),
        };
        let rest = rest.strip_suffix('/').unwrap_or(rest);
        if rest.contains(['/', '?', '#', '@', ' ']) {
            return Err("behind the host and the port there is something more".to_owned());
        }
        let (host, port) = match rest.strip_prefix('[') {
            Some(inner) => {
                let (host, port) = inner.split_once(']').ok_or("a bracket is open")?;
                (host, if port.is_empty() { None } else { Some(port.strip_prefix(':').ok_or("no port after it")?) })
            }
            None => rest.split_once(':').map_or((rest, None), |(host, port)| (host, Some(port))),
        };
        if host.is_empty() {
            return Err("there is no host".to_owned());
        }
        let port = port.map_or(Ok(PORT), |port| port.parse().map_err(|_| format!("{port:?} is no port")))?;
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
