//! Who may ask: the `Host` header must name this server, and so must the `Origin` where there is
//! one.
//!
//! Comparing `Origin` with `Host` alone does not help against a rebound name, in which both are
//! foreign; an allow-list does.

use std::net::SocketAddr;
use std::sync::Arc;

use axum::extract::{Request, State};
use axum::http::{HeaderMap, Method, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

/// The `Host` values that are answered.
#[derive(Debug)]
pub struct AllowedHosts(Vec<String>);

impl AllowedHosts {
    /// The bound address, `localhost` at the same port where that is a loopback address, and the
    /// hosts that the user added.
    pub fn new(bound: SocketAddr, also: &[String]) -> Self {
        let mut hosts = vec![bound.to_string()];
        if bound.ip().is_loopback() {
            hosts.push(format!("localhost:{}", bound.port()));
        }
        hosts.extend(also.iter().map(|host| host.to_ascii_lowercase()));
        Self(hosts)
    }

    /// Whether `host` (with its port) is one of them.
    pub fn allows(&self, host: &str) -> bool {
        let host = host.to_ascii_lowercase();
        self.0.contains(&host)
    }

    /// Whether a request with these headers may be answered.
    pub fn admits(&self, method: &Method, headers: &HeaderMap) -> bool {
        let text = |name| headers.get(name).map(|value: &header::HeaderValue| value.to_str().unwrap_or("\0"));
        let host_is_ours = text(header::HOST).is_some_and(|host| self.allows(host));
        let origin_is_ours = text(header::ORIGIN).is_none_or(|origin| {
            origin
                .split_once("://")
                .is_some_and(|(scheme, host)| matches!(scheme, "http" | "https") && self.allows(host))
        });
        // A form of a foreign page cannot send JSON without asking first.
        let json = text(header::CONTENT_TYPE).is_some_and(|media| media.starts_with("application/json"));
        host_is_ours && origin_is_ours && (matches!(*method, Method::GET | Method::HEAD) || json)
    }
}

/// Refuses requests that [`AllowedHosts`] does not admit with 403.
pub(super) async fn check(State(allowed): State<Arc<AllowedHosts>>, request: Request, next: Next) -> Response {
    if allowed.admits(request.method(), request.headers()) {
        next.run(request).await
    } else {
        (StatusCode::FORBIDDEN, "this server answers requests to its own address only\n").into_response()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn admits(method: Method, headers: &[(header::HeaderName, &str)]) -> bool {
        let allowed = AllowedHosts::new("127.0.0.1:8080".parse().unwrap(), &["bench-pc:8080".into()]);
        let map = headers.iter().map(|(name, value)| (name.clone(), value.parse().unwrap())).collect();
        allowed.admits(&method, &map)
    }

    #[test]
    fn conform_foreign_hosts_and_origins_are_refused() {
        for host in ["127.0.0.1:8080", "localhost:8080", "LOCALHOST:8080", "bench-pc:8080"] {
            assert!(admits(Method::GET, &[(header::HOST, host)]), "{host}");
        }
        for host in ["evil.com", "evil.com:8080", "127.0.0.1.evil.com:8080", "127.1:8080", "127.0.0.1", "localhost:80"]
        {
            assert!(!admits(Method::GET, &[(header::HOST, host)]), "{host}");
        }
        assert!(!admits(Method::GET, &[]), "no host");
        let own = (header::HOST, "localhost:8080");
        for origin in ["null", "http://evil.com", "http://evil.com:8080", "file://", "https://localhost.evil.com:8080"]
        {
            assert!(!admits(Method::GET, &[own.clone(), (header::ORIGIN, origin)]), "{origin}");
        }
        assert!(admits(Method::GET, &[own.clone(), (header::ORIGIN, "http://localhost:8080")]));
        // Rebinding: host and origin agree and are both foreign.
        assert!(!admits(Method::GET, &[(header::HOST, "evil.com"), (header::ORIGIN, "http://evil.com")]));
    }

    #[test]
    fn conform_a_change_needs_json() {
        let own = (header::HOST, "localhost:8080");
        assert!(!admits(Method::POST, std::slice::from_ref(&own)));
        assert!(!admits(Method::POST, &[own.clone(), (header::CONTENT_TYPE, "text/plain")]));
        assert!(admits(Method::POST, &[own, (header::CONTENT_TYPE, "application/json")]));
    }
}
