//! The token that the page asks for: as `Authorization: Bearer …` from programs, and as the
//! password of HTTP basic authentication from browsers.

use std::collections::BTreeMap;
use std::net::IpAddr;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use axum::extract::{ConnectInfo, Request, State};
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

use super::gate::Peer;

/// A shorter token can be guessed.
const SHORTEST: usize = 16;
/// Whoever guesses waits this long each time.
const PENALTY: Duration = Duration::from_millis(300);

/// Whoever has been let in is told of again after so long.
const TOLD_FOR: Duration = Duration::from_secs(3600);
/// So many addresses are remembered; with more, the one that was told of first is told of again
/// sooner.
const MOST_TOLD: usize = 256;

/// Who was let in, and when that was told.
type Admitted = BTreeMap<Option<IpAddr>, Instant>;

/// The token.
#[derive(Clone)]
pub struct Token {
    text: Arc<str>,
    /// Whoever guesses waits in one row: many connections at once guess no faster than one.
    guesses: Arc<tokio::sync::Mutex<u64>>,
    admitted: Arc<Mutex<Admitted>>,
}

impl std::fmt::Debug for Token {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Token")
    }
}

/// A token that could be guessed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the token has {length} characters; expected at least {SHORTEST}")]
pub struct ShortToken {
    /// Its characters.
    pub length: usize,
}

impl Token {
    /// Takes a token; says what is wrong with a bad one.
    ///
    /// # Errors
    /// When it is too short.
    pub fn new(text: &str) -> Result<Self, ShortToken> {
        let length = text.chars().count();
        if length < SHORTEST {
            return Err(ShortToken { length });
        }
        Ok(Self { text: text.into(), guesses: Arc::default(), admitted: Arc::default() })
    }

    /// Whether this address is to be told of: a page asks for many things, and its visit is told
    /// once.
    fn is_news(&self, peer: Option<IpAddr>, now: Instant) -> bool {
        let mut admitted = self.admitted.lock().unwrap_or_else(PoisonError::into_inner);
        let news = admitted.get(&peer).is_none_or(|told| now.saturating_duration_since(*told) >= TOLD_FOR);
        if news {
            if admitted.len() == MOST_TOLD
                && let Some(oldest) = admitted.iter().min_by_key(|(_, told)| **told).map(|(peer, _)| *peer)
            {
                admitted.remove(&oldest);
            }
            admitted.insert(peer, now);
        }
        news
    }

    fn admits(&self, headers: &HeaderMap) -> bool {
        let given = headers.get(header::AUTHORIZATION).and_then(|value| value.to_str().ok());
        let Some((scheme, rest)) = given.and_then(|text| text.split_once(' ')) else { return false };
        if scheme.eq_ignore_ascii_case("bearer") {
            return same(rest.trim().as_bytes(), self.text.as_bytes());
        }
        if !scheme.eq_ignore_ascii_case("basic") {
            return false;
        }
        let Some(decoded) = base64(rest.trim()) else { return false };
        let password = decoded.iter().position(|&byte| byte == b':').map(|colon| &decoded[colon + 1..]);
        password.is_some_and(|password| same(password, self.text.as_bytes()))
    }
}

/// Compares in a time that does not tell how many bytes are right.
fn same(a: &[u8], b: &[u8]) -> bool {
    a.len() == b.len() && a.iter().zip(b).fold(0, |all, (x, y)| all | (x ^ y)) == 0
}

/// Bytes of base64 (RFC 4648, section 4), padded or not.
fn base64(text: &str) -> Option<Vec<u8>> {
    let (mut bits, mut count, mut out) = (0_u32, 0, Vec::new());
    for byte in text.trim_end_matches('=').bytes() {
        let value = match byte {
            b'A'..=b'Z' => byte - b'A',
            b'a'..=b'z' => byte - b'a' + 26,
            b'0'..=b'9' => byte - b'0' + 52,
            b'+' => 62,
            b'/' => 63,
            _ => return None,
        };
        bits = (bits << 6 | u32::from(value)) & 0xff_ffff;
        count += 6;
        if count >= 8 {
            count -= 8;
            out.push((bits >> count) as u8);
        }
    }
    Some(out)
}

/// Refuses requests without the token with 401. Who is let in is told, and who is not.
pub async fn check(State(token): State<Token>, request: Request, next: Next) -> Response {
    let peer = request.extensions().get::<ConnectInfo<Peer>>().map(|ConnectInfo(Peer(address))| address.ip());
    let from = || peer.map_or_else(|| "somebody".to_owned(), |ip| ip.to_string());
    if token.admits(request.headers()) {
        if token.is_news(peer, Instant::now()) {
            tracing::info!("{} has asked the page with the token, and is let in", from());
        }
        return next.run(request).await;
    }
    let asked = request.headers().contains_key(header::AUTHORIZATION);
    // A browser asks without a token first, which is no guess.
    if asked {
        let mut guesses = token.guesses.lock().await;
        *guesses += 1;
        tracing::warn!(guesses = *guesses, "{} has asked the page with a wrong token", from());
        tokio::time::sleep(PENALTY).await;
    }
    let challenge = HeaderValue::from_static("Basic realm=\"gearwatch\", charset=\"UTF-8\"");
    (StatusCode::UNAUTHORIZED, [(header::WWW_AUTHENTICATE, challenge)], "the token is missing or wrong\n")
        .into_response()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// RFC 4648, section 10, and RFC 7617, section 2.
    #[test]
    fn literature_base64_and_basic_authentication() {
        for (text, bytes) in [("", ""), ("Zg==", "f"), ("Zm8=", "fo"), ("Zm9v", "foo"), ("Zm9vYmFy", "foobar")] {
            assert_eq!(base64(text).as_deref(), Some(bytes.as_bytes()));
        }
        assert_eq!(base64("QWxhZGRpbjpvcGVuIHNlc2FtZQ==").as_deref(), Some(&b"Aladdin:open sesame"[..]));
        assert_eq!(base64("Zm9v!"), None);
    }

    #[test]
    fn conform_only_the_token_is_admitted() {
        let token = Token::new("open sesame, please").unwrap();
        let admits = |value: &str| {
            let headers = [(header::AUTHORIZATION, value.parse().unwrap())].into_iter().collect();
            token.admits(&headers)
        };
        assert!(admits("Bearer open sesame, please"));
        assert!(admits("basic b3BlcmF0b3I6b3BlbiBzZXNhbWUsIHBsZWFzZQ=="));
        for wrong in
            ["Bearer open sesame", "Bearer ", "Basic b3BlcmF0b3I6", "Basic ???", "Digest x", "open sesame, please"]
        {
            assert!(!admits(wrong), "{wrong}");
        }
        assert!(!token.admits(&HeaderMap::new()));
        assert!(Token::new("short").is_err());
    }

    /// For the audit: each address once an hour, however often it asks, and a bounded number of
    /// them.
    #[test]
    fn conform_who_is_let_in_is_told_once_an_hour() {
        let token = Token::new("open sesame, please").unwrap();
        let begin = Instant::now();
        let peer = |n: u32| Some(IpAddr::from(n.to_be_bytes()));
        assert!(token.is_news(peer(1), begin) && token.is_news(None, begin));
        assert!(!token.is_news(peer(1), begin + Duration::from_secs(3599)));
        assert!(token.is_news(peer(1), begin + Duration::from_secs(3600)));
        (2..2000).for_each(|n| assert!(token.is_news(peer(n), begin + Duration::from_secs(3600))));
        assert!(token.admitted.lock().unwrap().len() <= MOST_TOLD);
    }
}
