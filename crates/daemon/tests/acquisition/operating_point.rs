//! Modbus TCP against a small server, MQTT against mosquitto (skipped where it
//! is not installed).
#![allow(clippy::print_stdout, reason = "a test that is passed over says so")]

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use gearwatch_core::verdict::MachineState;

use super::support::{Running, bench_file, wait_until};

/// Answers functions 3 and 4 with these registers, until dropped.
struct Registers {
    address: SocketAddr,
    values: Arc<Mutex<Vec<u16>>>,
}

impl Registers {
    fn start(values: &[u16]) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let values = Arc::new(Mutex::new(values.to_vec()));
        let seen = Arc::downgrade(&values);
        std::thread::spawn(move || {
            while let Ok((mut client, _)) = listener.accept() {
                let seen = seen.clone();
                std::thread::spawn(move || {
                    let mut request = [0; 12];
                    while client.read_exact(&mut request).is_ok() {
                        let Some(values) = seen.upgrade() else { return };
                        let all = values.lock().unwrap().clone();
                        if all.is_empty() {
                            // It hangs: the connection is open and nothing comes.
                            std::thread::sleep(Duration::from_secs(60));
                        }
                        let word = |at: usize| usize::from(u16::from_be_bytes([request[at], request[at + 1]]));
                        let asked: Vec<u8> =
                            all.iter().skip(word(8)).take(word(10)).flat_map(|v| v.to_be_bytes()).collect();
                        let mut body = vec![request[6], request[7], asked.len() as u8];
                        body.extend(&asked);
                        if asked.len() != 2 * word(10) {
                            body = vec![request[6], request[7] | 0x80, 2];
                        }
                        let head = [request[0], request[1], 0, 0, 0, body.len() as u8];
                        let _ = client.write_all(&[&head[..], &body].concat());
                    }
                });
            }
        });
        Self { address, values }
    }
}

pub fn service(operating_point: &str) -> Running {
    let folder = tempfile::tempdir().unwrap();
    bench_file(folder.path(), "bench.toml", "b");
    // Readings are matched with samples by time. The signal's own operating point, at its start, is
    // overruled by the first reading.
    let now_ns = SystemTime::now().duration_since(UNIX_EPOCH).unwrap().as_nanos();
    let text = format!(
        "format = \"gearwatch-service/1\"\n[service]\nstatus_socket = \"s.sock\"\nself_test = false\n[[bench]]\nfile = \"bench.toml\"\n\
         learn_from = {{ kind = \"test_signal\", speed = \"max\", duration_secs = 12.0 }}\n\
         [[bench.source]]\nkind = \"test_signal\"\nname = \"signal\"\nseed = 5\nfirst_sample_unix_ns = {now_ns}\n{operating_point}"
    );
    Running::start(folder, &text)
}

/// Torque as read and as told by the newest verdict, and whether the machine's state is known.
pub fn seen(running: &Running) -> (Option<f64>, MachineState) {
    let snapshot = running.status();
    let bench = &snapshot.benches[0];
    (bench.brake_torque_nm, bench.machine)
}

#[test]
fn conform_modbus_gives_the_torque_and_what_is_stale_is_unknown() {
    let drive = Registers::start(&[0, 0, 10_00, 0x8000]);
    let keys = format!(
        "[[bench.source]]\nkind = \"modbus\"\naddress = \"{}\"\npoll_secs = 0.1\ndata_deadline_secs = 0.5\n\
         registers = [{{ quantity = \"brake_torque_nm\", register = 2, scale = 0.01 }}]",
        drive.address
    );
    let running = service(&keys);
    wait_until("the torque is known and the state with it", || seen(&running) == (Some(10.0), MachineState::Normal));
    drive.values.lock().unwrap().clear();
    wait_until("a drive that hangs makes the state unknown", || seen(&running).1 == MachineState::Unknown);
    let error = running.status().benches[0].sources[1].error.clone();
    wait_until("the verdicts themselves are unknown", || seen(&running).0.is_none());
    assert!(error.is_empty() || error.contains("no answer"), "{error}");
    *drive.values.lock().unwrap() = vec![0, 0, 10_00];
    wait_until("it comes back", || seen(&running) == (Some(10.0), MachineState::Normal));
    running.stop();
}

/// A register that the drive does not have is an error with its number.
#[test]
fn conform_modbus_exceptions_are_told() {
    let drive = Registers::start(&[1, 2]);
    let keys = format!(
        "[[bench.source]]\nkind = \"modbus\"\naddress = \"{}\"\n\
         registers = [{{ quantity = \"motor_speed_hz\", table = \"input\", register = 9, encoding = \"f32\" }}]",
        drive.address
    );
    let running = service(&keys);
    wait_until("the exception is told", || running.status().benches[0].sources[1].error.contains("register 9: "));
    assert_eq!(running.status().benches[0].machine, MachineState::Unknown);
    running.stop();
}

struct Broker(Child, u16, tempfile::TempDir);

impl Broker {
    /// `None`, with a message, where there is no mosquitto.
    fn start() -> Option<Self> {
        let Some(program) = ["/usr/sbin/mosquitto", "/usr/bin/mosquitto"].into_iter().find(|p| Path::new(p).exists())
        else {
            println!("skipped: mosquitto is not installed");
            return None;
        };
        let folder = tempfile::tempdir().unwrap();
        let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let file = folder.path().join("mosquitto.conf");
        std::fs::write(&file, format!("listener {port} 127.0.0.1\nallow_anonymous true\n")).unwrap();
        let mut broker = Self(Self::spawn(program, &file), port, folder);
        broker.wait();
        Some(broker)
    }

    fn spawn(program: &str, file: &Path) -> Child {
        Command::new(program).arg("-c").arg(file).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap()
    }

    fn wait(&mut self) {
        wait_until("the broker answers", || TcpStream::connect(("127.0.0.1", self.1)).is_ok());
    }

    fn kill(&mut self) {
        self.0.kill().unwrap();
        self.0.wait().unwrap();
    }

    fn restart(&mut self) {
        self.0 = Self::spawn("/usr/sbin/mosquitto", &self.2.path().join("mosquitto.conf"));
        self.wait();
    }

    /// Publishes by hand: CONNECT, PUBLISH with QoS 0, DISCONNECT (MQTT 3.1.1).
    fn publish(&self, topic: &str, payload: &str, retain: bool) {
        let mut socket = TcpStream::connect(("127.0.0.1", self.1)).unwrap();
        socket.write_all(b"\x10\x0d\x00\x04MQTT\x04\x02\x00\x3c\x00\x01t").unwrap();
        socket.read_exact(&mut [0; 4]).unwrap();
        let mut packet = vec![0x30 | u8::from(retain), (2 + topic.len() + payload.len()) as u8, 0, topic.len() as u8];
        packet.extend(topic.as_bytes());
        packet.extend(payload.as_bytes());
        packet.extend([0xe0, 0]);
        socket.write_all(&packet).unwrap();
        // The broker closes after the last packet; then it has read all.
        let _ = socket.read(&mut [0; 1]);
    }
}

impl Drop for Broker {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn conform_mqtt_gives_the_torque_and_what_is_stale_is_unknown() {
    let Some(mut broker) = Broker::start() else { return };
    // Kept by the broker from some earlier day: not to be believed.
    broker.publish("brake", "{\"t\": 1}", true);
    let keys = format!(
        "[[bench.source]]\nkind = \"mqtt\"\nbroker = \"127.0.0.1:{}\"\nstale_after_secs = 1.0\ndata_deadline_secs = 1.0\n\
         topics = [{{ quantity = \"brake_torque_nm\", topic = \"brake\", pointer = \"/t\" }}]",
        broker.1
    );
    let running = service(&keys);
    let normal = |broker: &Broker| {
        broker.publish("brake", "{\"t\": 10.0}", false);
        std::thread::sleep(Duration::from_millis(100));
        seen(&running) == (Some(10.0), MachineState::Normal)
    };
    wait_until("the torque is known and the state with it", || normal(&broker));
    wait_until("nobody speaks, so that nothing is known", || seen(&running).1 == MachineState::Unknown);
    wait_until("the verdicts themselves are unknown", || seen(&running).0.is_none());
    wait_until("somebody speaks again", || normal(&broker));
    broker.kill();
    wait_until("a dead broker is an error", || !running.status().benches[0].sources[1].error.is_empty());
    assert_eq!(seen(&running).1, MachineState::Unknown);
    broker.restart();
    wait_until("it comes back", || normal(&broker));
    running.stop();
}
