//! The fleet: what all benches say to one JetStream stream, read by `gearwatch fleet`. `docs/fleet.md` is the contract of subjects, headers and fields.
//!
//! [`follow`] reads the stream from some point on and comes back by itself after an outage; [`Fleet`] is what it makes of the letters: every one
//! counts once, however often it was sent, and holes in the numbers are counted. [`page()`] shows it to a browser.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use async_nats::{Client, ConnectOptions};
use tokio::sync::Notify;

mod follow;
mod page;
mod view;

pub use follow::{From, Notice, follow};
pub use page::page;
pub use view::{Bench, Fleet, Heard, Place, Told};

/// Name of the stream unless the configuration says otherwise.
pub const STREAM: &str = "gearwatch";
/// First part of all subjects unless the configuration says otherwise.
pub const PREFIX: &str = "gearwatch";
/// Header of a letter that may have been sent before.
pub const RESENT_HEADER: &str = "Gearwatch-Resent";
/// A bench says at least so often that it is there.
pub const HEARTBEAT: Duration = Duration::from_secs(10);
/// A bench that was not heard for so long is silent.
pub const SILENCE: Duration = Duration::from_secs(30);
/// So long the server recognises a letter that it has already. What comes later is in the stream twice, marked; [`Fleet`] counts it once.
pub const DUPLICATE_WINDOW: Duration = Duration::from_secs(600);

/// The server must answer within this time.
pub(crate) const PATIENCE: Duration = Duration::from_secs(10);

/// Who we are to the server, and how we know it.
#[derive(Clone, Default)]
pub struct Access {
    /// User name; none where the secret is a token, or there is none.
    pub user: Option<String>,
    /// Password, or token.
    pub secret: Option<String>,
    /// Certificate of the authority that signed the server's.
    pub ca_file: Option<PathBuf>,
}

impl std::fmt::Debug for Access {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Access").field("user", &self.user).field("ca_file", &self.ca_file).finish_non_exhaustive()
    }
}

impl Access {
    fn apply(&self, options: ConnectOptions) -> ConnectOptions {
        let options = match (&self.user, &self.secret) {
            (Some(user), Some(secret)) => options.user_and_password(user.clone(), secret.clone()),
            (None, Some(token)) => options.token(token.clone()),
            _ => options,
        };
        match &self.ca_file {
            Some(file) => options.require_tls(true).add_root_certificates(file.clone()),
            None => options,
        }
    }
}

/// Connects once. The client does not renew the connection by itself, since that would send a later letter before one that was lost; the notice
/// says when it is gone.
pub(crate) async fn connect(server: &str, access: &Access) -> Result<(Client, Arc<Notify>), String> {
    let lost = Arc::new(Notify::new());
    let told = lost.clone();
    let first = AtomicBool::new(true);
    let options = access
        .apply(ConnectOptions::new())
        .name("gearwatch")
        .connection_timeout(PATIENCE)
        .ping_interval(PATIENCE)
        .max_reconnects(1)
        .reconnect_delay_callback(move |_| {
            // Long enough for the loss to be noticed and the client to be dropped.
            if first.swap(false, Ordering::Relaxed) { Duration::ZERO } else { PATIENCE }
        })
        .event_callback(move |event| {
            let told = told.clone();
            async move {
                if !matches!(event, async_nats::Event::Connected) {
                    told.notify_one();
                }
            }
        });
    let client = options.connect(server).await.map_err(|e| e.to_string())?;
    Ok((client, lost))
}

/// What is wrong with the names of a stream and a prefix, one sentence each.
pub(crate) fn name_problems(stream: &str, prefix: &str) -> Vec<String> {
    let plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_');
    let mut out = Vec::new();
    for (key, name) in [("stream", stream), ("prefix", prefix)] {
        if name.is_empty() || !name.chars().all(plain) {
            out.push(format!("{key} is {name:?}; expected letters, digits, - and _"));
        }
    }
    out
}
