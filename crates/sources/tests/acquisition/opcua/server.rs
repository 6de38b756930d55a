//! A real OPC UA server: `asyncua` of Python, with the nodes of a bench.

use std::io::{BufRead, BufReader, Write};
use std::net::TcpListener;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::Mutex;

const SCRIPT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../sources/tests/acquisition/opcua/server.py");

pub struct Server {
    child: Mutex<Child>,
    kind: &'static str,
    pub port: u16,
    folder: tempfile::TempDir,
}

/// Another Python than `python3` is named by `GEARWATCH_PYTHON`.
fn python() -> String {
    std::env::var("GEARWATCH_PYTHON").unwrap_or_else(|_| "python3".to_owned())
}

impl Server {
    /// Of the kind `plain`, `user` or `secure`; `None`, with a message, where there is no
    /// `asyncua`.
    pub fn start(kind: &'static str) -> Option<Self> {
        let there = Command::new(python()).args(["-c", "import asyncua"]).output();
        if !there.is_ok_and(|output| output.status.success()) {
            eprintln!("skipped: python3 with asyncua is not installed (GEARWATCH_PYTHON names another Python)");
            return None;
        }
        let folder = tempfile::tempdir().unwrap();
        let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let child = Mutex::new(spawn(port, folder.path(), kind));
        Some(Self { child, kind, port, folder })
    }

    /// A file that the server has made.
    pub fn path(&self, file: &str) -> PathBuf {
        self.folder.path().join(file)
    }

    /// Sets a node: `Brake.Torque 20.0`, perhaps with a status: `Brake.Torque 0 BadSensorFailure`.
    pub fn set(&self, command: &str) {
        writeln!(self.child.lock().unwrap().stdin.as_mut().unwrap(), "{command}").unwrap();
    }

    /// Sessions that it holds.
    pub fn sessions(&self) -> usize {
        let file = self.path("sessions");
        let _ = std::fs::remove_file(&file);
        self.set("sessions");
        (0..1000)
            .find_map(|_| {
                std::thread::sleep(std::time::Duration::from_millis(5));
                std::fs::read_to_string(&file).ok()?.parse().ok()
            })
            .expect("it answers within five seconds")
    }

    /// Ends it as a power cut does.
    pub fn kill(&self) {
        let mut child = self.child.lock().unwrap();
        let _ = child.kill();
        let _ = child.wait();
    }

    /// Sends it a signal, as `STOP`.
    #[allow(dead_code, reason = "not all tests hold it up")]
    pub fn signal(&self, name: &str) {
        let id = self.child.lock().unwrap().id().to_string();
        assert!(Command::new("kill").args([&format!("-{name}"), &id]).status().unwrap().success());
    }

    /// Starts it again at the same port, with the values of the beginning.
    pub fn restart(&self) {
        self.kill();
        *self.child.lock().unwrap() = spawn(self.port, self.folder.path(), self.kind);
    }

    /// The keys of a source that reads one node of it.
    pub fn keys(&self, quantity: &str, node: &str) -> String {
        format!(
            "kind = \"opcua\"\nendpoint = \"opc.tcp://127.0.0.1:{}/bench\"\npublish_secs = 0.1\n\
             nodes = [{{ quantity = {quantity:?}, node = {node:?} }}]\n",
            self.port
        )
    }
}

fn spawn(port: u16, folder: &std::path::Path, kind: &str) -> Child {
    let mut child = Command::new(python())
        .args([SCRIPT.as_ref(), port.to_string().as_ref(), folder.as_os_str(), kind.as_ref()])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut line = String::new();
    BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
    assert_eq!(line.trim(), "ready");
    child
}

impl Drop for Server {
    fn drop(&mut self) {
        self.kill();
    }
}
