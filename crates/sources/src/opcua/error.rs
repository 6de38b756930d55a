//! Why a server is given up, and what to do.

use std::time::Duration;

use opcua_types::{Error, StatusCode};

/// Why a server is given up. The address of the server stands before it.
#[derive(Debug, thiserror::Error)]
pub(super) enum ListenError {
    #[error("no answer {what} within {:.1} s (data_deadline_secs)", .within.as_secs_f64())]
    Late { within: Duration, what: &'static str },
    #[error("{0}; is the server running, and are host and port right?")]
    NotThere(Error),
    #[error("expected an OPC UA server (binary, over TCP): {0}")]
    NoServer(Error),
    #[error("expected an endpoint with {wanted}, found {}; set security to what is there", list(.found))]
    Endpoint { wanted: String, found: Vec<String> },
    #[error("expected a login {wanted}, found only {}; set username and password_file, or allow it at the server", list(.found))]
    LoginKind { wanted: &'static str, found: Vec<String> },
    #[error(
        "expected the certificate of {file} (SHA-1 {expected}), found {found}; where the server's has changed, put it there"
    )]
    OtherCertificate { file: String, expected: String, found: String },
    #[error("the login {user} failed: {status}{}", login_hint(*.status))]
    Login { user: String, status: StatusCode },
    #[error("the server gives no subscription: {0}")]
    Subscription(Error),
    #[error(
        "the server sends every {found_secs} s; expected every {expected_secs:.3} s at most, a third of data_deadline_secs: raise that or lower publish_secs"
    )]
    Slow { found_secs: f64, expected_secs: f64 },
    #[error("node {node:?}: expected a variable that can be read, found {status}{}", hint(*.status))]
    Node { node: String, status: StatusCode },
    #[error("node {node:?}: expected a number, found {found}; choose a node with one number")]
    NoNumber { node: String, found: String },
    #[error("{expected} nodes were asked for, {found} answered")]
    Nodes { expected: usize, found: usize },
    #[error("the connection is lost: {status}{}", hint(*.status))]
    Lost { status: StatusCode },
    #[error("the server has ended the subscription: {0}")]
    SubscriptionEnded(StatusCode),
    #[error("the connection has ended")]
    Ended,
    #[error("the client's library has failed on what the server sent")]
    Library,
}

/// All of them, or that there is none.
fn list(found: &[String]) -> String {
    if found.is_empty() { "none".to_owned() } else { found.join(", ") }
}

/// What to do about a refused login.
fn login_hint(status: StatusCode) -> &'static str {
    match status {
        StatusCode::BadUserAccessDenied
        | StatusCode::BadIdentityTokenRejected
        | StatusCode::BadIdentityTokenInvalid => "; check username and password_file",
        other => hint(other),
    }
}

/// What to do about a status that has one usual cause.
fn hint(status: StatusCode) -> &'static str {
    match status {
        StatusCode::BadNodeIdUnknown | StatusCode::BadNodeIdInvalid => {
            "; look up its id at the server, where the number of a name space can have changed"
        }
        StatusCode::BadAttributeIdInvalid => "; it is no variable: choose the variable below it",
        StatusCode::BadNotReadable | StatusCode::BadUserAccessDenied => "; give this user the right to read it",
        StatusCode::BadCertificateUntrusted
        | StatusCode::BadSecurityChecksFailed
        | StatusCode::BadCertificateInvalid
        | StatusCode::BadCertificateUriInvalid
        | StatusCode::BadCertificateTimeInvalid
        | StatusCode::BadCertificateUseNotAllowed => {
            "; let the server trust the file of certificate, and check its dates"
        }
        StatusCode::BadTooManySessions => "; another client must close one, or the server allow more",
        _ => "",
    }
}
