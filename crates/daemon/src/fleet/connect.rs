//! A connection to the server of the stream.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use async_nats::{Client, ConnectOptions};
use tokio::sync::Notify;

use super::PATIENCE;
use crate::secret::Secret;

/// Who we are to the server, and how we know it.
#[derive(Clone, Default)]
pub struct Access {
    /// User name; none where the secret is a token, or there is none.
    pub user: Option<String>,
    /// Password, or token.
    pub secret: Option<Secret>,
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
            (Some(user), Some(secret)) => options.user_and_password(user.clone(), secret.expose().to_owned()),
            (None, Some(token)) => options.token(token.expose().to_owned()),
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
