//! OPC UA in a service (skipped with a message where `asyncua` of Python is not installed).
#![allow(clippy::print_stderr, reason = "a test that is skipped says so")]

#[path = "../../../sources/tests/acquisition/opcua/server.rs"]
#[allow(dead_code, reason = "shared with the tests of sources")]
mod server;

use std::time::{Duration, Instant};

use gearwatch_core::verdict::MachineState;

use super::operating_point::{seen, service};
use super::support::wait_until;
use server::Server;

/// A torque that does not change holds while the server sends messages. One whose status is
/// bad, and that of a server that is gone, is unknown.
#[test]
fn conform_opcua_gives_the_torque_while_the_server_sends() {
    let Some(server) = Server::start("plain") else { return };
    let keys = server.keys("brake_torque_nm", "ns=2;s=Brake.Torque");
    let running = service(&format!("[[bench.source]]\ndata_deadline_secs = 1.0\n{keys}"));
    let normal = || seen(&running) == (Some(10.0), MachineState::Normal);
    let error = || running.status().benches[0].sources[1].error.clone();
    wait_until("the torque is known and the state with it", normal);
    // Longer than the data deadline.
    std::thread::sleep(Duration::from_millis(2500));
    assert_eq!(seen(&running), (Some(10.0), MachineState::Normal));
    assert_eq!(error(), "");
    server.set("Brake.Torque 10 BadSensorFailure");
    wait_until("a bad value makes the state unknown", || seen(&running).1 == MachineState::Unknown);
    assert_eq!(error(), "");
    server.set("Brake.Torque 10");
    wait_until("it is good again", normal);
    server.kill();
    wait_until("a dead server is an error", || error().contains("opc.tcp://127.0.0.1"));
    wait_until("and the state is unknown", || seen(&running).1 == MachineState::Unknown);
    server.restart();
    // The waits between tries double up to half a minute, and some tries have failed by now.
    let began = Instant::now();
    while !normal() {
        assert!(began.elapsed() < Duration::from_secs(70), "it does not come back: {:?}", error());
        std::thread::sleep(Duration::from_millis(50));
    }
    running.stop();
}

/// A node that is not there stands in the state, and is looked for again.
#[test]
fn conform_opcua_nodes_that_are_not_there_are_in_the_state() {
    let Some(server) = Server::start("plain") else { return };
    let keys = server.keys("brake_torque_nm", "ns=2;s=Brake.Tork");
    let running = service(&format!("[[bench.source]]\ndata_deadline_secs = 1.0\n{keys}"));
    wait_until("the node is named", || {
        running.status().benches[0].sources[1].error.contains("node \"ns=2;s=Brake.Tork\": expected a variable")
    });
    assert_eq!(running.status().benches[0].machine, MachineState::Unknown);
    running.stop();
}
