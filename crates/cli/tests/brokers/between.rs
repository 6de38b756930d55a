//! Sits between the service and an MQTT broker, passes on every byte, and writes down what was
//! published and what the broker has confirmed: what the service promises can be judged there,
//! whatever a broker that is killed does with what it has confirmed.

use std::collections::BTreeMap;
use std::io::{Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::sync::{Arc, Mutex};
use std::time::Instant;

use gearwatch_daemon::fleet::Heard;

/// A letter that was published.
pub struct Sent {
    pub letter: Heard,
    /// When the broker's confirmation went back to the service.
    pub confirmed: Option<Instant>,
}

/// All that went through, in the order in which it was published.
pub type Seen = Arc<Mutex<Vec<Sent>>>;

/// Listens in front of a broker; gives the port, and what was seen.
pub fn listen(broker: u16) -> (u16, Seen) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let (port, seen) = (listener.local_addr().unwrap().port(), Seen::default());
    let all = seen.clone();
    std::thread::spawn(move || {
        for client in listener.incoming().flatten() {
            // Dropped where the broker is away: the service sees a connection that ends at once.
            let Ok(server) = TcpStream::connect(("127.0.0.1", broker)) else { continue };
            let under_way = Arc::new(Mutex::new(BTreeMap::new()));
            let ways =
                [(client.try_clone(), server.try_clone(), true), (server.try_clone(), client.try_clone(), false)];
            for (from, to, outward) in ways {
                let (seen, under_way) = (all.clone(), under_way.clone());
                let (from, to) = (from.unwrap(), to.unwrap());
                std::thread::spawn(move || pass(from, to, |packet| note(packet, outward, &seen, &under_way)));
            }
        }
    });
    (port, seen)
}

/// Passes on whole packets until one side ends, and then ends the other.
fn pass(mut from: TcpStream, mut to: TcpStream, note: impl Fn(&[u8])) {
    let (mut bytes, mut piece) = (Vec::new(), [0; 65536]);
    'all: while let Ok(count @ 1..) = from.read(&mut piece) {
        bytes.extend(&piece[..count]);
        while let Some(length) = packet_length(&bytes) {
            note(&bytes[..length]);
            if to.write_all(&bytes[..length]).is_err() {
                break 'all;
            }
            bytes.drain(..length);
        }
    }
    let _ = (from.shutdown(Shutdown::Both), to.shutdown(Shutdown::Both));
}

/// Bytes of the first packet, if all of them are there (MQTT 3.1.1, section 2.2).
fn packet_length(bytes: &[u8]) -> Option<usize> {
    let (mut length, mut shift) = (0, 0);
    for (at, byte) in bytes.iter().enumerate().skip(1) {
        length |= usize::from(byte & 0x7f) << shift;
        shift += 7;
        if byte & 0x80 == 0 {
            return Some(at + 1 + length).filter(|all| *all <= bytes.len());
        }
    }
    None
}

/// Letters by the number that the protocol gives them, while they are under way.
type UnderWay = Mutex<BTreeMap<u16, usize>>;

fn note(packet: &[u8], outward: bool, seen: &Seen, under_way: &UnderWay) {
    let head = packet.iter().skip(1).take_while(|byte| **byte & 0x80 != 0).count() + 2;
    let (kind, body) = (packet[0] >> 4, &packet[head..]);
    let number = |at: usize| u16::from_be_bytes([body[at], body[at + 1]]);
    match (outward, kind) {
        // PUBLISH (3.3): topic, number, content.
        (true, 3) => {
            let topic = usize::from(number(0));
            let Some(letter) = Heard::read(0, &body[topic + 4..]) else { return };
            let mut seen = seen.lock().unwrap();
            seen.push(Sent { letter, confirmed: None });
            under_way.lock().unwrap().insert(number(topic + 2), seen.len() - 1);
        }
        // PUBACK (3.4).
        (false, 4) => {
            // Only one lock at a time: the other way takes them in the other order.
            let at = under_way.lock().unwrap().remove(&number(0));
            if let Some(at) = at {
                seen.lock().unwrap()[at].confirmed = Some(Instant::now());
            }
        }
        _ => {}
    }
}
