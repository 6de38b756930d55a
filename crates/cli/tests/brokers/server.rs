//! A broker as a child process, which can be killed and started again on the same port and the same
//! store.

use std::net::{SocketAddr, TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use crate::fixture::text;
use crate::service::wait_for;

/// A port that was free a moment ago.
pub fn free_port() -> u16 {
    TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port()
}

/// A broker.
pub struct Server {
    program: &'static str,
    args: Vec<String>,
    pub port: u16,
    child: Option<Child>,
}

impl Server {
    /// NATS with JetStream; with a port for MQTT clients too where one is given. `None` where it is
    /// not installed.
    pub fn nats(folder: &Path, mqtt_port: Option<u16>) -> Option<Self> {
        let port = free_port();
        let mqtt = mqtt_port.map_or_else(String::new, |port| format!("mqtt {{ host: \"127.0.0.1\", port: {port} }}\n"));
        let config = format!(
            "server_name: test\nhost: \"127.0.0.1\"\nport: {port}\njetstream {{ store_dir: \"{}\" }}\n{mqtt}",
            text(&folder.join("store"))
        );
        Self::start("/usr/sbin/nats-server", folder, port, &config, "-c")
    }

    /// NATS that speaks TLS only, and asks for a password. `None` where it is not installed.
    pub fn nats_with_tls(folder: &Path, key: &Path, certificate: &Path) -> Option<Self> {
        let port = free_port();
        let config = format!(
            "server_name: test\nhost: \"127.0.0.1\"\nport: {port}\njetstream {{ store_dir: \"{}\" }}\n\
             tls {{ cert_file: \"{}\", key_file: \"{}\" }}\nauthorization {{ user: bench, password: hunter2 }}\n",
            text(&folder.join("store")),
            text(certificate),
            text(key)
        );
        Self::start("/usr/sbin/nats-server", folder, port, &config, "-c")
    }

    /// Mosquitto. `None` where it is not installed.
    pub fn mosquitto(folder: &Path) -> Option<Self> {
        Self::mosquitto_with(folder, "")
    }

    /// Mosquitto with a second port for TLS.
    pub fn mosquitto_with_tls(folder: &Path, key: &Path, certificate: &Path) -> Option<(Self, u16)> {
        let port = free_port();
        let files = format!("certfile {}\nkeyfile {}\n", text(certificate), text(key));
        Some((Self::mosquitto_with(folder, &format!("listener {port} 127.0.0.1\n{files}"))?, port))
    }

    fn mosquitto_with(folder: &Path, listener: &str) -> Option<Self> {
        let port = free_port();
        let config = format!(
            // Killed, it knows the sessions of its clients when it comes back; it holds nothing
            // back from a slow one.
            "allow_anonymous true\npersistence true\npersistence_location {}/\nautosave_on_changes true\nautosave_interval 20\n\
             max_queued_messages 1000000\nmax_inflight_messages 0\nuser root\n\
             listener {port} 127.0.0.1\n{listener}",
            text(folder)
        );
        Self::start("/usr/sbin/mosquitto", folder, port, &config, "-c")
    }

    fn start(program: &'static str, folder: &Path, port: u16, config: &str, flag: &str) -> Option<Self> {
        if !Path::new(program).exists() {
            eprintln!("skipped: {program} is not installed");
            return None;
        }
        std::fs::create_dir_all(folder).unwrap();
        let path: PathBuf = folder.join("server.conf");
        std::fs::write(&path, config).unwrap();
        let mut server = Self { program, args: vec![flag.to_owned(), text(&path).to_owned()], port, child: None };
        server.restart();
        Some(server)
    }

    /// Starts it where it is not running, and waits until it takes connections.
    pub fn restart(&mut self) {
        let child = Command::new(self.program).args(&self.args).stdout(Stdio::null()).stderr(Stdio::null()).spawn();
        self.child = Some(child.unwrap());
        let address = SocketAddr::from(([127, 0, 0, 1], self.port));
        let answers = || TcpStream::connect_timeout(&address, Duration::from_millis(200)).ok();
        assert!(wait_for(Duration::from_secs(20), answers).is_some(), "{} does not answer", self.program);
    }

    /// `kill -9`.
    pub fn kill(&mut self) {
        if let Some(mut child) = self.child.take() {
            child.kill().unwrap();
            child.wait().unwrap();
        }
    }

    pub fn url(&self) -> String {
        format!("nats://127.0.0.1:{}", self.port)
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.kill();
    }
}
