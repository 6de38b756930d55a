//! Who we are to a server, and how we know it.

use std::path::PathBuf;

use gearwatch_runtime::secret::Secret;

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
