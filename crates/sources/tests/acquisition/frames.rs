//! TCP and UDP against a sender.

use std::net::{SocketAddr, TcpListener, UdpSocket};
use std::time::{Duration, Instant};

use gearwatch_emulate::{FrameSender, Material, TroubleConfig};
use gearwatch_runtime::stop::Stop;
use gearwatch_sources::Speed;

use super::support::{DEADLINE, Judge, ramp, source};

const FRAMES: &str = "frames = { channels = [\"acc_1\", \"acc_2\"], unit = \"1\" }";

/// A sender on a thread of its own; ends when dropped.
struct Sender(Stop);

impl Drop for Sender {
    fn drop(&mut self) {
        self.0.now();
    }
}

fn sender(trouble: TroubleConfig, run: impl FnOnce(&mut FrameSender) + Send + 'static) -> Sender {
    let stop = Stop::default();
    let told = stop.clone();
    std::thread::spawn(move || {
        let material = Material::new(ramp(&["acc_1", "acc_2"]), Speed::Times(20.0), told.clone()).unwrap();
        run(&mut FrameSender::new(material, trouble, told));
    });
    Sender(stop)
}

fn serve(trouble: TroubleConfig) -> (Sender, SocketAddr) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    (sender(trouble, move |sender| sender.serve(&listener).unwrap()), address)
}

/// A port that is free now.
fn free_port() -> SocketAddr {
    UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap()
}

#[test]
fn conform_a_sender_that_is_called_and_one_that_calls() {
    let (_called, address) = serve(TroubleConfig { split: true, ..TroubleConfig::default() });
    let here = free_port();
    let _calls = sender(TroubleConfig::default(), move |sender| sender.connect(here).unwrap());
    for keys in [format!("connect = \"{address}\""), format!("listen = \"{here}\"\nfrom = \"127.0.0.1\"")] {
        let source = source(&format!("kind = \"tcp\"\n{keys}\n{FRAMES}"));
        let mut judge = Judge::default();
        let mut pull = source.open().unwrap();
        while judge.samples < 65_536 {
            judge.take(&pull().unwrap().unwrap());
        }
        assert_eq!((judge.gaps, judge.desynchronised, judge.wrong_alone), (0, 0, 0), "{keys}");
        source.context.stop.now();
        while pull().expect("it ends without an error when told").is_some() {}
    }
}

/// Flipped bits cost whole frames, lost connections whatever was under way: all of it is in the
/// gaps, and no sample is wrong.
#[test]
fn conform_damage_and_loss_are_gaps_of_the_right_length() {
    let trouble = TroubleConfig {
        seed: 4,
        flip_every_secs: Some(1.5),
        overrun_every_secs: Some(4.0),
        drop_every_secs: Some(8.0),
        ..TroubleConfig::default()
    };
    let (_sender, address) = serve(trouble);
    let source = source(&format!("kind = \"tcp\"\nconnect = \"{address}\"\n{FRAMES}"));
    let mut judge = Judge::default();
    let errors = source.read_for(Duration::from_secs(2), &mut judge);
    assert!(judge.gaps >= 10 && !errors.is_empty(), "{judge:?} {errors:?}");
    assert_eq!((judge.desynchronised, judge.wrong_alone, judge.wrong_length), (0, 0, 0), "{judge:?}");
}

#[test]
fn conform_datagrams_that_are_lost_or_damaged_are_gaps_of_the_right_length() {
    let here = free_port();
    let source = source(&format!("kind = \"udp\"\nlisten = \"{here}\"\n{FRAMES}"));
    let mut pull = source.open().unwrap();
    let trouble =
        TroubleConfig { seed: 4, flip_every_secs: Some(1.0), drop_every_secs: Some(1.0), ..TroubleConfig::default() };
    let _sender = sender(trouble, move |sender| sender.datagrams(here).unwrap());
    let (mut judge, began) = (Judge::default(), Instant::now());
    while judge.samples < 500_000 && began.elapsed() < Duration::from_secs(10) {
        judge.take(&pull().unwrap().unwrap());
    }
    assert!(judge.gaps >= 10, "{judge:?}");
    assert_eq!((judge.desynchronised, judge.wrong_alone, judge.wrong_length), (0, 0, 0), "{judge:?}");
}

/// Silence of a connection that stays open ends it after the deadline.
#[test]
fn conform_a_silent_sender_is_an_error() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    let source = source(&format!("kind = \"tcp\"\nconnect = \"{address}\"\n{FRAMES}"));
    let mut pull = source.open().unwrap();
    let began = Instant::now();
    let error = pull().unwrap_err().to_string();
    assert!(error.contains("no frame for 0.4 s"), "{error}");
    assert!(began.elapsed() < Duration::from_millis(800));
}

/// Somebody else sends the same stream to the same port: beside the true sender they are not heard,
/// and no sample seems to be missing. Seen before: 3.4 million.
#[test]
fn regress_a_forged_stream_beside_the_true_one_is_not_heard() {
    let here = free_port();
    let source = source(&format!("kind = \"udp\"\nlisten = \"{here}\"\n{FRAMES}"));
    let mut pull = source.open().unwrap();
    let truth = sender(TroubleConfig::default(), move |sender| sender.datagrams(here).unwrap());
    let (mut judge, began) = (Judge::default(), Instant::now());
    while judge.samples < 100_000 {
        judge.take(&pull().unwrap().unwrap());
    }
    let _forger = sender(TroubleConfig::default(), move |sender| sender.datagrams(here).unwrap());
    while judge.samples < 1_000_000 && began.elapsed() < Duration::from_secs(20) {
        judge.take(&pull().unwrap().unwrap());
    }
    assert_eq!((judge.gaps, judge.missing, judge.desynchronised, judge.wrong_alone), (0, 0, 0, 0), "{judge:?}");
    // When the true one has been silent for the deadline, another may take its place: the same
    // sender from another port is one.
    drop(truth);
    std::thread::sleep(2 * DEADLINE);
    let heard = judge.samples;
    while judge.samples < heard + 50_000 && began.elapsed() < Duration::from_secs(30) {
        judge.take(&pull().unwrap().unwrap());
    }
    assert!(judge.samples >= heard + 50_000, "{judge:?}");
}
