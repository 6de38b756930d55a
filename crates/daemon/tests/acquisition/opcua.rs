//! OPC UA against a real server, `asyncua` of Python (passed over with a message where it is not installed).
#![allow(clippy::print_stderr, reason = "a test that is skipped says so")]

use std::io::{BufRead, BufReader, Write};
use std::net::TcpListener;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::Mutex;

use super::operating_point::{seen, service};
use super::support::wait_until;

struct Server {
    child: Mutex<Child>,
    port: u16,
    /// Of the nodes.
    space: String,
}

impl Server {
    /// `None`, with a message, where there is no `asyncua`. Another Python than `python3` is named by `GEARWATCH_PYTHON`.
    fn start(port: Option<u16>) -> Option<Self> {
        let python = std::env::var("GEARWATCH_PYTHON").unwrap_or_else(|_| "python3".to_owned());
        let found = Command::new(&python).args(["-c", "import asyncua"]).stderr(Stdio::null()).status();
        if !found.is_ok_and(|status| status.success()) {
            eprintln!(
                "skipped: asyncua is not installed (pip install asyncua; GEARWATCH_PYTHON names a Python that has it)"
            );
            return None;
        }
        let port = port.unwrap_or_else(|| TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port());
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/acquisition/opcua.py");
        let mut child = Command::new(python)
            .arg(script)
            .arg(port.to_string())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut space = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut space).unwrap();
        Some(Self { child: Mutex::new(child), port, space: space.trim().to_owned() })
    }

    fn tell(&self, command: &str) {
        writeln!(self.child.lock().unwrap().stdin.as_mut().unwrap(), "{command}").unwrap();
    }

    /// The source that reads a node of it.
    fn keys(&self, node: &str) -> String {
        let (port, space) = (self.port, &self.space);
        format!(
            "[[bench.source]]\nkind = \"opcua\"\nendpoint = \"opc.tcp://127.0.0.1:{port}/bench\"\npublish_secs = 0.1\ndata_deadline_secs = 1.0\n\
             nodes = [{{ quantity = \"brake_torque_nm\", node = \"{space};s={node}\", scale = 0.01 }}]"
        )
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let mut child = self.child.lock().unwrap();
        let _ = child.kill();
        let _ = child.wait();
    }
}

/// A torque that does not change holds while the server speaks; one that the server calls bad, and that of a server that is gone, is unknown.
#[test]
fn conform_opcua_gives_the_torque_while_the_server_vouches_for_it() {
    let Some(server) = Server::start(None) else { return };
    let running = service(&server.keys("Brake.Torque"));
    wait_until("the torque is known and the state with it", || seen(&running) == (Some(10.0), "normal".into()));
    // Longer than the data deadline: nothing changes, and the server says that it is there.
    std::thread::sleep(std::time::Duration::from_millis(2500));
    assert_eq!(seen(&running), (Some(10.0), "normal".into()));
    assert_eq!(running.status().benches[0].sources[1].error, "");
    server.tell("bad");
    wait_until("a bad value makes the state unknown", || seen(&running).1 == "unknown");
    server.tell("torque 1000");
    wait_until("it is good again", || seen(&running) == (Some(10.0), "normal".into()));
    let port = server.port;
    drop(server);
    wait_until("a dead server is an error", || !running.status().benches[0].sources[1].error.is_empty());
    wait_until("and the state is unknown", || seen(&running).1 == "unknown");
    let _server = Server::start(Some(port)).unwrap();
    wait_until("it comes back", || seen(&running) == (Some(10.0), "normal".into()));
    running.stop();
}

#[test]
fn conform_opcua_nodes_that_are_not_there_or_no_numbers_are_told() {
    let Some(server) = Server::start(None) else { return };
    let running = service(&server.keys("Brake.Tork"));
    let error = || running.status().benches[0].sources[1].error.clone();
    wait_until("the server's word is told", || error().contains("s=Brake.Tork\": BadNodeIdUnknown"));
    running.stop();
    let running = service(&server.keys("Brake.Name"));
    wait_until("the source runs", || running.status().benches[0].sources[1].error.is_empty());
    std::thread::sleep(std::time::Duration::from_millis(500));
    assert_eq!(running.status().benches[0].machine, "unknown");
    running.stop();
}
