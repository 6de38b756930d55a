//! The stage row allocates nothing per window after warm-up, which has seen the speeds: packets to
//! windows, speed, lines, indicators, verdicts. Nor does the way of a packet from a source that
//! pushes into its queue.

// A counting allocator is an implementation of an unsafe trait; it forwards to the system's and
// counts.
#![allow(unsafe_code, reason = "GlobalAlloc is an unsafe trait")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::pin::pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::task::{Context, Poll, Waker};

use gearwatch_core::analysis::WindowAnalysis;
use gearwatch_core::bench::{Bearing, BearingOrders};
use gearwatch_core::block::{Block, Packet, Quality, Samples};
use gearwatch_core::indicators::GearIndicator;
use gearwatch_core::pipeline::{Pipeline, PipelineConfig};
use gearwatch_runtime::queue::{WhenFull, bounded};
use gearwatch_sources::Sender;
use gearwatch_tests::benches::{bench, with_tacho};
use gearwatch_tests::tones::{Run, Tone, add_noise, pulses, samples};

struct Counting;

thread_local! {
    static ALLOCATIONS: Cell<u64> = const { Cell::new(0) };
}

// SAFETY: every call is forwarded unchanged to the system allocator; counting touches a
// thread-local Cell without destructor only.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.with(|n| n.set(n.get() + 1));
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        unsafe { System.dealloc(pointer, layout) }
    }
    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        ALLOCATIONS.with(|n| n.set(n.get() + 1));
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

const RATE_HZ: f64 = 8192.0;

/// 4 s of a run in blocks of 1000 samples, from sample `first` on.
fn blocks(run: Run, first: usize) -> Vec<Packet> {
    let tones: Vec<Tone> = [29.0, 10.44]
        .iter()
        .flat_map(|&mesh| (1..=5).map(move |h| (mesh * f64::from(h), f64::from(h))))
        .map(|(order, phase_rad)| Tone { order, amplitude: 1.0, phase_rad })
        .collect();
    let mut signal = samples(run, &tones, RATE_HZ, 4 * RATE_HZ as usize);
    add_noise(&mut signal, 0.3, 11);
    let packet = |(i, chunk): (usize, &[f64])| {
        let at = first + 1000 * i;
        Packet::Vibration(Block {
            sensor: "a".into(),
            t0: (at as f64 / RATE_HZ * 1e9).round() as i64,
            sample_rate_hz: RATE_HZ,
            first_sample_index: at as u64,
            unit: "m/s^2".into(),
            samples: Samples::Physical(chunk.iter().map(|&x| x as f32).collect()),
            quality: Quality::GOOD,
        })
    };
    signal.chunks(1000).enumerate().map(packet).collect()
}

/// Pulses of both rounds, once a revolution: a round turns whole revolutions, so that the second
/// follows on the first, at the same speeds.
fn pulses_of_rounds(run: Run) -> Packet {
    let Packet::Tacho(mut first) = pulses(run, "shaft0", 1.0, 1.0, 4.5) else { unreachable!("pulses are a tacho's") };
    let second: Vec<i64> = first.pulse_times.iter().filter(|t| **t > 0).map(|t| t + 4_000_000_000).collect();
    first.pulse_times.retain(|t| *t <= 4_000_000_000);
    first.pulse_times.extend(second);
    Packet::Tacho(first)
}

fn allocations_after_warm_up(tacho: bool, ramp_percent: f64) -> (u64, u64) {
    let plain = bench(25.0, &[(29, 100), (36, 90)]);
    let mut bench = if tacho { with_tacho(plain, "shaft0", 1.0) } else { plain };
    // Indicators belong to the row, the envelope at a bearing's orders too.
    let orders = BearingOrders { outer: 3.58, inner: 5.42, element: 2.36, cage: 0.4 };
    bench.bearings.push(Bearing {
        name: "drive end".into(),
        shaft: "shaft0".into(),
        elements: None,
        element_mm: None,
        pitch_mm: None,
        contact_deg: 0.0,
        orders: Some(orders),
    });
    bench.indicators.envelope_hz = Some([1000.0, 2000.0]);
    let config = PipelineConfig { gear_indicators_every: 1, ..PipelineConfig::default() };
    let pipeline = Pipeline::new(&bench, &config, None).expect("a usable bench");
    let mut assembler = pipeline.assembler();
    let mut worker = pipeline.worker();
    let mut analysis = WindowAnalysis::empty();
    let mut verdicts = Vec::new();
    let mut ready = Vec::with_capacity(16);
    let (mut windows, mut known_windows) = (0, 0);
    let known = |analysis: &WindowAnalysis| {
        let gear = analysis.indicators.gears[0][0].get(GearIndicator::Fm4).is_known();
        gear && analysis.indicators.bearings[0][0].depth.is_known()
    };
    let (mut before, mut at_warm) = (0, 0);
    let length = 4 * RATE_HZ as usize;
    for round in 0..2 {
        let run = Run::ramp(25.0, ramp_percent, 4.0);
        let mut packets = blocks(run, round * length);
        if tacho && round == 0 {
            packets.insert(0, pulses_of_rounds(run));
        }
        if round == 1 {
            before = ALLOCATIONS.get();
            at_warm = windows;
        }
        for packet in &packets {
            assembler.push(packet, &mut |w| ready.push(w));
            for window in ready.drain(..) {
                pipeline.analyse(&mut worker, &window, &mut analysis);
                pipeline.judge(&analysis, &mut verdicts);
                known_windows += u64::from(known(&analysis));
                assembler.recycle(window);
                windows += 1;
            }
        }
        if round == 1 {
            before = ALLOCATIONS.get() - before;
        }
    }
    // All but those across the jump between the rounds.
    assert!(known_windows + 2 >= windows, "{known_windows} of {windows} windows have indicators");
    (before, windows - at_warm)
}

#[test]
fn conform_no_allocation_per_window() {
    for (tacho, ramp_percent) in [(false, 0.0), (true, 0.0), (false, 4.0), (true, 4.0)] {
        let (allocations, windows) = allocations_after_warm_up(tacho, ramp_percent);
        assert!(windows >= 7, "{windows}");
        assert_eq!(allocations, 0, "tacho {tacho}, ramp {ramp_percent} %: in {windows} windows");
    }
}

/// Packets through the end of the queue that a source gets, seen on their way: the first one may
/// warm up what is made once.
#[test]
fn conform_no_allocation_per_pushed_packet() {
    let (outlet, inlet) = bounded(4, WhenFull::DropNewest);
    let seen = Arc::new(AtomicU64::new(0));
    let counted = seen.clone();
    let sender = Sender::new(outlet, move |_| {
        counted.fetch_add(1, Ordering::Relaxed);
    });
    let packets = blocks(Run::ramp(25.0, 0.0, 4.0), 0);
    let (all, mut before) = (packets.len() as u64, 0);
    let mut context = Context::from_waker(Waker::noop());
    for (i, packet) in packets.into_iter().enumerate() {
        let sent = pin!(sender.send(packet)).poll(&mut context);
        assert!(matches!(sent, Poll::Ready(Ok(()))), "it never waits");
        assert!(inlet.try_recv().is_ok());
        if i == 0 {
            before = ALLOCATIONS.get();
        }
    }
    assert_eq!((seen.load(Ordering::Relaxed), ALLOCATIONS.get() - before), (all, 0));
}
