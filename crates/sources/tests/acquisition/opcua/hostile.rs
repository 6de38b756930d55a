//! Servers that are none, and a line that flips bytes.

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Sends the same bytes to each client after its first message, and leaves the connection open.
pub fn answers(bytes: &'static [u8]) -> SocketAddr {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    std::thread::spawn(move || {
        while let Ok((mut client, _)) = listener.accept() {
            std::thread::spawn(move || {
                let mut asked = [0; 1024];
                let _ = client.read(&mut asked);
                let _ = client.write_all(bytes);
                while client.read(&mut asked).is_ok_and(|n| n > 0) {}
            });
        }
    });
    address
}

/// Passes bytes on to a server, and of its answers flips about one bit in `every` bytes.
pub fn flipping(server: u16, seed: u64, every: u32) -> u16 {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = listener.local_addr().unwrap().port();
    std::thread::spawn(move || {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        while let Ok((mut client, _)) = listener.accept() {
            let Ok(mut server) = TcpStream::connect(("127.0.0.1", server)) else { return };
            let (Ok(mut from), Ok(mut to)) = (client.try_clone(), server.try_clone()) else { return };
            std::thread::spawn(move || {
                let _ = std::io::copy(&mut from, &mut to);
                let _ = to.shutdown(std::net::Shutdown::Both);
            });
            let mut random = ChaCha8Rng::seed_from_u64(random.random());
            std::thread::spawn(move || {
                let mut bytes = [0; 4096];
                while let Ok(n @ 1..) = server.read(&mut bytes) {
                    for byte in &mut bytes[..n] {
                        if random.random_ratio(1, every) {
                            *byte ^= 1 << random.random_range(0..8);
                        }
                    }
                    if client.write_all(&bytes[..n]).is_err() {
                        break;
                    }
                }
                let _ = client.shutdown(std::net::Shutdown::Both);
            });
        }
    });
    port
}
