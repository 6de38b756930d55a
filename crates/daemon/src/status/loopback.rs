//! A port of the loopback address, and a file with the address and a token in place of a Unix
//! socket.

use std::fs::Metadata;
use std::io::{ErrorKind, Read, Write};
use std::net::{Ipv4Addr, SocketAddr};
use std::path::Path;
use std::time::Duration;

use gearwatch_io::output::Outputs;
use rand::TryRng;
use tokio::io::AsyncReadExt;
use tokio::net::{TcpListener, TcpStream};

/// First word of the file.
const FORMAT: &str = "gearwatch-status/1";
/// Random bytes of a token; it is written in twice as many characters.
const TOKEN: usize = 32;
/// Longest such file.
const LONGEST: u64 = 256;

pub(super) struct Listener {
    listener: TcpListener,
    token: String,
}

impl Listener {
    pub(super) async fn accept(&self) -> std::io::Result<TcpStream> {
        Ok(self.listener.accept().await?.0)
    }

    /// Whether what the client sends first is the token.
    pub(super) async fn admits(&self, client: &mut TcpStream) -> bool {
        let mut given = [0; 2 * TOKEN];
        client.read_exact(&mut given).await.is_ok() && same(&given, self.token.as_bytes())
    }
}

/// Compares in a time that does not tell how many bytes are right.
fn same(a: &[u8], b: &[u8]) -> bool {
    a.len() == b.len() && a.iter().zip(b).fold(0, |all, (x, y)| all | (x ^ y)) == 0
}

fn read(path: &Path) -> std::io::Result<(SocketAddr, String)> {
    let mut text = String::new();
    std::fs::File::open(path)?.take(LONGEST).read_to_string(&mut text)?;
    let wrong = || std::io::Error::new(ErrorKind::InvalidData, "not the file of a status socket");
    let [FORMAT, address, token] = text.split_whitespace().collect::<Vec<_>>()[..] else { return Err(wrong()) };
    let address: SocketAddr = address.parse().map_err(|_| wrong())?;
    // A file of somebody else must not send this program elsewhere.
    if !address.ip().is_loopback() || token.len() != 2 * TOKEN {
        return Err(wrong());
    }
    Ok((address, token.to_owned()))
}

pub(super) fn is_ours(path: &Path, found: &Metadata) -> bool {
    found.is_file() && read(path).is_ok()
}

/// Binds a port and writes the file, in the place of one that a dead process left behind; one that
/// is answered is left alone.
pub(super) async fn bind(path: &Path) -> std::io::Result<Listener> {
    match std::fs::symlink_metadata(path) {
        Ok(found) if is_ours(path, &found) => {
            if ask(path, Duration::from_millis(500)).is_ok_and(|text| !text.is_empty()) {
                return Err(std::io::Error::new(ErrorKind::AddrInUse, "another service answers there"));
            }
        }
        Ok(_) => return Err(super::no_socket()),
        Err(e) if e.kind() == ErrorKind::NotFound => {}
        Err(e) => return Err(e),
    }
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).await?;
    let mut bytes = [0; TOKEN];
    rand::rngs::SysRng.try_fill_bytes(&mut bytes).map_err(std::io::Error::other)?;
    let token: String = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
    let text = format!("{FORMAT} {} {token}\n", listener.local_addr()?);
    let written = Outputs::new(true).target(path).and_then(|target| target.write(text));
    written.map_err(std::io::Error::other)?;
    Ok(Listener { listener, token })
}

pub(super) fn ask(path: &Path, patience: Duration) -> std::io::Result<String> {
    let (address, token) = read(path)?;
    let mut stream = std::net::TcpStream::connect_timeout(&address, patience)?;
    stream.set_read_timeout(Some(patience))?;
    stream.write_all(token.as_bytes())?;
    let mut text = String::new();
    stream.read_to_string(&mut text)?;
    if text.is_empty() {
        return Err(std::io::Error::new(ErrorKind::PermissionDenied, "the token is not that of the service"));
    }
    Ok(text)
}

#[cfg(test)]
mod tests {
    use super::*;
    use tokio::io::AsyncWriteExt;

    async fn serve(listener: Listener, rounds: usize) {
        for _ in 0..rounds {
            let mut client = listener.accept().await.unwrap();
            if listener.admits(&mut client).await {
                client.write_all(b"{}").await.unwrap();
            }
        }
    }

    /// Who reads the file gets the answer; who only finds the port does not.
    #[test]
    fn conform_the_token_of_the_file_opens_the_port() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("status.sock");
        let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().worker_threads(2).build().unwrap();
        let listener = runtime.block_on(bind(&path)).unwrap();
        let (address, token) = read(&path).unwrap();
        assert!(address.ip().is_loopback());
        let serving = runtime.spawn(serve(listener, 3));
        assert_eq!(ask(&path, Duration::from_secs(5)).unwrap(), "{}");
        assert!(runtime.block_on(bind(&path)).is_err_and(|e| e.kind() == ErrorKind::AddrInUse));
        let wrong = token.replace(|c: char| c.is_ascii_digit(), "x");
        std::fs::write(&path, format!("{FORMAT} {address} {wrong}\n")).unwrap();
        assert!(ask(&path, Duration::from_secs(5)).is_err());
        runtime.block_on(serving).unwrap();
        // What the dead one left makes room.
        assert!(runtime.block_on(bind(&path)).is_ok());
    }

    /// A file of something else stays, and none leads away from this machine.
    #[test]
    fn regress_other_files_are_left_alone() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("status.sock");
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        let far = format!("{FORMAT} 192.0.2.1:80 {}\n", "0".repeat(2 * TOKEN));
        for text in ["a baseline", &far] {
            std::fs::write(&path, text).unwrap();
            assert!(ask(&path, Duration::from_secs(1)).is_err_and(|e| e.kind() == ErrorKind::InvalidData));
            assert!(runtime.block_on(bind(&path)).is_err());
            assert_eq!(std::fs::read_to_string(&path).unwrap(), text);
        }
    }
}
