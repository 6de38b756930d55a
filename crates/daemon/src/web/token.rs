//! The token that the page asks for: as `Authorization: Bearer …` from programs, and as the password of HTTP basic authentication from browsers.

use std::sync::Arc;
use std::time::Duration;

use axum::extract::{ConnectInfo, Request, State};
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

use super::gate::Peer;

/// A shorter token can be guessed.
const SHORTEST: usize = 16;
/// Whoever guesses waits this long each time.
const PENALTY: Duration = Duration::from_millis(300);

/// The token.
#[derive(Clone)]
pub struct Token {
    text: Arc<str>,
    /// Whoever guesses waits in one row: many connections at once guess no faster than one.
    guesses: Arc<tokio::sync::Mutex<u64>>,
}

impl std::fmt::Debug for Token {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Token")
    }
}

impl Token {
    /// Takes a token; says what is wrong with a bad one.
    ///
    /// # Errors
    /// When it is too short.
    pub fn new(text: &str) -> Result<Self, String> {
        let length = text.chars().count();
        if length < SHORTEST {
            return Err(format!("the token has {length} characters; expected at least {SHORTEST}"));
        }
        Ok(Self { text: text.into(), guesses: Arc::default() })
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

/// Refuses requests without the token with 401.
pub async fn check(State(token): State<Token>, request: Request, next: Next) -> Response {
    if token.admits(request.headers()) {
        return next.run(request).await;
    }
    let peer = request.extensions().get::<ConnectInfo<Peer>>().map(|ConnectInfo(Peer(address))| address.ip());
    let asked = request.headers().contains_key(header::AUTHORIZATION);
    // A browser asks without a token first, which is no guess.
    if asked {
        let mut guesses = token.guesses.lock().await;
        *guesses += 1;
        let from = peer.map_or_else(|| "somebody".to_owned(), |ip| ip.to_string());
        tracing::warn!(guesses = *guesses, "{from} has asked the page with a wrong token");
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
}
