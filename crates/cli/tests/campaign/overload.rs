//! More than the machine can do: what is not processed is counted exactly, memory stays bounded,
//! the capacity is kept. And what stands still at the far ends, a page, a broker, does not reach
//! the ranks.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::PathBuf;
use std::process::{Child, ChildStdin, Stdio};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use gearwatch_core::block::Packet;
use gearwatch_core::pipeline::{Pipeline, PipelineConfig};
use gearwatch_core::window::WindowConfig;
use gearwatch_daemon::config::Config;
use gearwatch_daemon::engine::{Lane, Overloaded, Pool};
use gearwatch_runtime::queue::{self, WhenFull};
use gearwatch_runtime::stop::Stop;
use gearwatch_sources::{Feed, SourceContext};

use crate::fixture::{Bench, gearwatch, text};
use crate::service::{ended_within, signal, wait_for};

/// A second of signal of so many channels, in packets of a tenth of a second.
fn one_second(home: &Bench, channels: usize, rate: f64) -> (Arc<gearwatch_core::bench::Bench>, Vec<Packet>) {
    let sensors: Vec<_> = (0..channels).map(|i| format!("{{ name = \"acc_{i}\", shaft = \"input\" }}")).collect();
    let bench = format!(
        "format = \"gearwatch-bench/1\"\nname = \"wide\"\nmotor = {{ speed_hz = 25.0 }}\n\
         shaft = [{{ name = \"input\" }}, {{ name = \"output\" }}]\n\
         stage = [{{ name = \"stage1\", pinion = {{ teeth = 29 }}, wheel = {{ teeth = 100 }} }}]\nbrake = {{ torque_nm = 10.0 }}\n\
         sensor = [{}]\ntacho = {{ shaft = \"input\" }}\nacquisition = {{ sample_rate_hz = {rate:?} }}\n",
        sensors.join(", ")
    );
    let path = home.write("wide.toml", &bench);
    let bench = Arc::new(gearwatch_io::bench_file::read(&path).unwrap());
    let service = "format = \"gearwatch-service/1\"\n[[bench]]\nfile = \"wide.toml\"\n[[bench.source]]\nkind = \"test_signal\"\n\
                   speed = \"max\"\nduration_secs = 1.0\n";
    let config = Config::parse(service, "wide", &home.path("")).unwrap();
    let context = SourceContext::new(bench.clone(), PathBuf::new(), Stop::default());
    let Feed::Pull(mut pull) = config.benches[0].sources[0].config.open(&context).unwrap() else { unreachable!() };
    (bench, std::iter::from_fn(|| pull().unwrap()).collect())
}

/// The same second again, `n` seconds later.
fn later(packet: &Packet, n: u64, rate: f64) -> Packet {
    let shift = n as i64 * 1_000_000_000;
    let mut packet = packet.clone();
    match &mut packet {
        Packet::Vibration(block) => {
            block.t0 += shift;
            block.first_sample_index += (n as f64 * rate) as u64;
        }
        Packet::Tacho(tacho) => {
            tacho.t0 += shift;
            tacho.pulse_times.iter_mut().for_each(|t| *t += shift);
        }
        Packet::OperatingPoint(point) => point.t += shift,
    }
    packet
}

/// What became of a load.
struct Load {
    secs: f64,
    /// Time that processors spent on it, without the making of the signal (s).
    cpu_secs: f64,
    /// Time that processors had for it: what they spent on it and what they idled. What others and
    /// the making of the signal took is not in it (s).
    cpu_offered_secs: f64,
    offered: u64,
    dropped: u64,
    cut: u64,
    judged: u64,
    shed: u64,
}

/// What is offered, and how densely windows are cut from it.
#[derive(Clone, Copy)]
struct Signal<'a> {
    bench: &'a gearwatch_core::bench::Bench,
    second: &'a [Packet],
    rate: f64,
    hop_s: f64,
}

/// Offers `factor` seconds of signal a second, for some seconds; as much as goes where there is no
/// factor.
fn offer(signal: &Signal<'_>, factor: Option<f64>, secs: f64) -> Load {
    let Signal { bench, second, rate, hop_s } = *signal;
    let window = WindowConfig { hop_s, ..WindowConfig::default() };
    let pipeline =
        Arc::new(Pipeline::new(bench, &PipelineConfig { window, ..PipelineConfig::default() }, None).unwrap());
    let pool = Pool::start(2).unwrap();
    let (policy, overloaded) = match factor {
        Some(_) => (WhenFull::DropNewest, Overloaded::Shed),
        None => (WhenFull::Block, Overloaded::Wait),
    };
    let (outlet, packets) = queue::bounded(4096, policy);
    let lane = Lane { pipeline, overloaded, windows_per_worker: 4 }.start(&pool, packets, |_| {}).unwrap();
    let (begin, cpu, idle) = (Instant::now(), cpu_secs(), idle_secs());
    'all: for n in 0.. {
        for (i, packet) in second.iter().enumerate() {
            if let Some(factor) = factor {
                let due = (n as f64 + i as f64 / second.len() as f64) / factor;
                std::thread::sleep(Duration::from_secs_f64((due - begin.elapsed().as_secs_f64()).max(0.0)));
            }
            if begin.elapsed().as_secs_f64() > secs {
                break 'all;
            }
            let _ = outlet.put_blocking(later(packet, n, rate));
        }
    }
    outlet.close();
    let counters = lane.counters().clone();
    wait_for(Duration::from_secs(60), || lane.is_finished().then_some(())).expect("the lane ends");
    let secs = begin.elapsed().as_secs_f64();
    lane.join().unwrap();
    let dropped = outlet.counters().dropped();
    assert_eq!(outlet.counters().entered(), counters.packets() + dropped, "packets in = taken + dropped");
    assert_eq!(counters.cut(), counters.judged() + counters.shed() + counters.failed(), "windows cut = judged + shed");
    let cpu_secs = cpu_secs() - cpu;
    Load {
        secs,
        cpu_secs,
        cpu_offered_secs: cpu_secs + idle_secs() - idle,
        offered: outlet.counters().entered(),
        dropped,
        cut: counters.cut(),
        judged: counters.judged(),
        shed: counters.shed(),
    }
}

fn rss_mib() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|line| line.starts_with("VmRSS:")).unwrap_or_default();
    line.split_whitespace().nth(1).and_then(|kib| kib.parse::<u64>().ok()).unwrap_or(0) / 1024
}

/// Time that processors have spent on this process, but for the calling thread (s). Linux counts it
/// in hundredths of a second.
fn cpu_secs() -> f64 {
    let of = |who: &str| {
        let stat = std::fs::read_to_string(format!("/proc/{who}/stat")).unwrap_or_default();
        let fields = stat.rsplit_once(") ").map_or("", |(_, fields)| fields).split(' ').skip(11).take(2);
        fields.filter_map(|ticks| ticks.parse::<f64>().ok()).sum::<f64>() / 100.0
    };
    of("self") - of("thread-self")
}

/// Time that all processors have idled (s).
fn idle_secs() -> f64 {
    let stat = std::fs::read_to_string("/proc/stat").unwrap_or_default();
    let all = stat.lines().next().unwrap_or_default();
    // user, nice, system, idle, waiting for a disk
    all.split_whitespace().skip(4).take(2).filter_map(|ticks| ticks.parse::<f64>().ok()).sum::<f64>() / 100.0
}

/// The widths that a bench may have.
const WIDTHS: [(usize, f64); 2] = [(64, 16_384.0), (8, 204_800.0)];

#[test]
#[ignore = "a minute, and says something only of a release build; `just campaign-overload`"]
fn conform_many_channels_take_less_than_half_a_core() {
    let home = Bench::new();
    for (channels, rate) in WIDTHS {
        let (bench, second) = one_second(&home, channels, rate);
        let signal = Signal { bench: &bench, second: &second, rate, hop_s: 0.5 };
        for factor in [1.0, 2.0, 5.0, 10.0] {
            let load = offer(&signal, Some(factor), 8.0);
            let share = load.cpu_secs / load.secs;
            println!(
                "{channels} channels at {rate} Hz, {factor:>4} times: {} windows, {} shed; {:.1} % of one core",
                load.cut,
                load.shed,
                100.0 * share
            );
            if factor == 1.0 {
                assert!(load.shed == 0 && load.dropped == 0, "{} windows, {} packets", load.shed, load.dropped);
                assert!(share < 0.5 || cfg!(debug_assertions), "{share}");
            }
        }
    }
}

/// Windows so close that real time is all the machine can do, and then more than that: by 1.5, 3
/// and 10 times.
#[test]
#[ignore = "minutes, and says something only of a release build; `just campaign-overload`"]
fn conform_overload_is_shed_and_counted() {
    let home = Bench::new();
    for (channels, rate) in WIDTHS {
        let (bench, second) = one_second(&home, channels, rate);
        let dense = Signal { bench: &bench, second: &second, rate, hop_s: 0.02 };
        let capacity = offer(&dense, None, 8.0);
        let real_time = channels as f64 / dense.hop_s;
        let most = capacity.judged as f64 / capacity.secs;
        // Windows that a second of a processor gives. Whoever makes the signal runs on the same
        // machine, and so may others: their seconds are not counted, but idle ones are, so that
        // workers that wait for each other would be told.
        let in_a_second = |load: &Load| load.judged as f64 / load.cpu_offered_secs;
        println!(
            "{channels} channels at {rate} Hz, a window each 20 ms: capacity {:.2} times real time, {:.0} windows in a second of a processor",
            most / real_time,
            in_a_second(&capacity)
        );
        for beyond in [1.5, 3.0, 10.0] {
            let load = offer(&dense, Some(beyond * most / real_time), 8.0);
            let kept = in_a_second(&load) / in_a_second(&capacity);
            println!(
                "  {beyond:>4} times that: {} windows = {} judged + {} shed, {} of {} packets dropped; {:.0} % of the capacity stay ({:.0} % \
                 by the clock, in which the making of the signal is); RSS {} MiB",
                load.cut,
                load.judged,
                load.shed,
                load.dropped,
                load.offered,
                100.0 * kept,
                100.0 * load.judged as f64 / load.secs / most,
                rss_mib()
            );
            // Three times what the machine can do is nearly twenty times real time here. Far beyond
            // that the samples themselves, which are taken in before anything is shed, cost a part
            // of the processors.
            let least = if beyond <= 3.0 { 0.9 } else { 0.8 };
            assert!(kept >= least || cfg!(debug_assertions), "{kept}");
        }
    }
    assert!(rss_mib() < 2048, "{} MiB", rss_mib());
}

/// A peer that takes connections and says nothing.
fn black_hole() -> u16 {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = listener.local_addr().unwrap().port();
    std::thread::spawn(move || {
        let mut held = Vec::new();
        held.extend(listener.incoming());
    });
    port
}

/// A service that reads samples from its standard input, and the moments at which its lines came.
struct Timed {
    child: Child,
    stdin: ChildStdin,
    lines: Arc<Mutex<Vec<(u64, Instant)>>>,
}

const RATE: u64 = 2048;
const CHUNK: u64 = 32;

fn timed(home: &Bench, name: &str, page: &str, further: &str) -> Timed {
    let config = home.write(
        &format!("{name}.toml"),
        &format!(
            "format = \"gearwatch-service/1\"\nservice = {{ workers = 1, self_test = false{page} }}\n[[bench]]\nfile = \"bench.toml\"\n\
             [[bench.source]]\nkind = \"pipe\"\npath = \"-\"\nframing = {{ encoding = \"f32le\", channels = [\"acc_1\", \"acc_2\"], \
             sample_rate_hz = 2048.0 }}\n[[sink]]\nkind = \"stdout\"\n[[sink]]\nkind = \"mcap_log\"\nfolder = \"log-{name}\"\n{further}"
        ),
    );
    let mut child = gearwatch(&["run", "--config", text(&config)])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let (stdin, stdout) = (child.stdin.take().unwrap(), child.stdout.take().unwrap());
    let lines = Arc::new(Mutex::new(Vec::new()));
    let kept = lines.clone();
    std::thread::spawn(move || {
        for line in BufReader::new(stdout).lines().map_while(Result::ok) {
            let came = Instant::now();
            let object: serde_json::Value = serde_json::from_str(&line).unwrap();
            let end = object["first_sample_index"].as_u64().unwrap() + object["samples"].as_u64().unwrap();
            kept.lock().unwrap().push((end, came));
        }
    });
    Timed { child, stdin, lines }
}

/// Milliseconds from the last sample of a window to its line: median and 99 %.
fn latency(service: &Timed, written: &[Instant]) -> (f64, f64, usize) {
    let lines = service.lines.lock().unwrap();
    let mut all: Vec<f64> = lines
        .iter()
        // While the service starts, samples wait for it and not it for them.
        .filter(|&&(end, _)| end > 3 * RATE)
        .filter_map(|&(end, came)| {
            let at = written.get(usize::try_from(end.div_ceil(CHUNK)).unwrap() - 1)?;
            Some(1000.0 * came.saturating_duration_since(*at).as_secs_f64())
        })
        .collect();
    all.sort_by(f64::total_cmp);
    let at = |share: f64| all[((all.len() - 1) as f64 * share) as usize];
    (at(0.5), at(0.99), all.len())
}

#[test]
#[ignore = "a minute; `just campaign-overload`"]
fn conform_what_stands_still_does_not_reach_the_ranks() {
    let secs: u64 = std::env::var("GEARWATCH_LATENCY_SECS").ok().and_then(|text| text.parse().ok()).unwrap_or(60);
    let home = Bench::new();
    let hole = black_hole();
    let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let stuck = format!(
        "[[sink]]\nkind = \"nats\"\nservers = [\"nats://127.0.0.1:{hole}\"]\nspool = \"spool\"\n\
         [[sink]]\nkind = \"mqtt\"\nport = {hole}\nspool = \"spool-mqtt\"\n\
         [[sink]]\nkind = \"webhook\"\nurl = \"http://127.0.0.1:{hole}/\"\n"
    );
    let mut services =
        [timed(&home, "free", "", ""), timed(&home, "stuck", &format!(", page = \"127.0.0.1:{port}\""), &stuck)];
    // Viewers that ask for everything and read nothing.
    let address = format!("127.0.0.1:{port}");
    let connect = || TcpStream::connect(&address).ok();
    let viewers: Vec<_> = (0..5)
        .map(|_| {
            let mut viewer = wait_for(Duration::from_secs(10), connect).expect("the page answers");
            write!(viewer, "GET /api/events HTTP/1.1\r\nHost: {address}\r\n\r\n").unwrap();
            viewer
        })
        .collect();
    let begin = Instant::now();
    let mut written = Vec::new();
    for chunk in 0..secs * RATE / CHUNK {
        let bytes: Vec<u8> = (chunk * CHUNK..(chunk + 1) * CHUNK)
            .flat_map(|i| {
                let t = i as f32 / RATE as f32;
                let v = (100.0 * std::f32::consts::TAU * t).sin() + 0.5 * (200.0 * std::f32::consts::TAU * t).sin();
                [v, v].map(f32::to_le_bytes).concat()
            })
            .collect();
        let due = (chunk + 1) as f64 * CHUNK as f64 / RATE as f64;
        std::thread::sleep(Duration::from_secs_f64((due - begin.elapsed().as_secs_f64()).max(0.0)));
        // In turn first, so that neither is always the later one.
        let order = if chunk % 2 == 0 { [0, 1] } else { [1, 0] };
        for i in order {
            services[i].stdin.write_all(&bytes).unwrap();
            services[i].stdin.flush().unwrap();
        }
        written.push(Instant::now());
    }
    std::thread::sleep(Duration::from_millis(500));
    let (free, stuck) = (latency(&services[0], &written), latency(&services[1], &written));
    println!(
        "last sample to line: alone median {:.2} ms, 99 % {:.2} ms; with a stopped page, broker and webhook {:.2} ms, {:.2} ms; {} and {} lines",
        free.0, free.1, stuck.0, stuck.1, free.2, stuck.2
    );
    for service in &mut services {
        signal(&service.child, "TERM");
        ended_within(&mut service.child, Duration::from_secs(5));
    }
    for mut viewer in viewers {
        viewer.set_read_timeout(Some(Duration::from_millis(100))).unwrap();
        let _ = viewer.read(&mut [0; 64]);
    }
    assert_eq!(free.2, stuck.2, "each window once at both");
    // Half a millisecond is the grain of a busy machine's scheduler; 5 % of more than that would be
    // told.
    assert!(stuck.0 <= free.0 * 1.05 + 0.5, "median {:.2} ms against {:.2} ms", stuck.0, free.0);
    if secs >= 60 {
        assert!(free.1 < 50.0 && stuck.1 < 50.0, "99 %: {:.2} ms and {:.2} ms", free.1, stuck.1);
    }
}
