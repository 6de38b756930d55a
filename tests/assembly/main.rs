//! From packets to windows: nothing is lost in silence, and where blocks end does not matter.

use std::sync::Arc;

use gearwatch_core::analysis::WindowAnalysis;
use gearwatch_core::assemble::{Assembler, GapReason};
use gearwatch_core::block::{Block, Packet, Quality, Samples};
use gearwatch_core::pipeline::{Pipeline, PipelineConfig};
use gearwatch_core::window::{Window, WindowConfig};
use gearwatch_tests::benches::{bench, with_tacho};
use gearwatch_tests::tones::{Run, Tone, add_noise, pulses, samples};
use proptest::prelude::*;

const RATE_HZ: f64 = 1000.0;

fn piece(sensor: &str, first: u64, values: Vec<f32>, quality: Quality) -> Block {
    Block {
        sensor: sensor.into(),
        t0: (first as f64 / RATE_HZ * 1e9).round() as i64,
        sample_rate_hz: RATE_HZ,
        first_sample_index: first,
        unit: "m/s^2".into(),
        samples: Samples::Physical(values),
        quality,
    }
}

/// Values that tell their index, so that a misplaced sample is seen.
fn ramp(first: u64, count: u64) -> Vec<f32> {
    (first..first + count).map(|i| (i % 100_000) as f32).collect()
}

fn assembler(length_s: f64, hop_s: f64) -> Assembler {
    Assembler::new(&WindowConfig { length_s, hop_s, tacho_wait_s: 1.0 }, &[("input".into(), 1.0)], None)
}

fn conserved(assembler: &Assembler) -> bool {
    let c = assembler.counters();
    c.samples_in == c.samples_in_windows + c.samples_discarded + c.samples_pending
}

/// Index of the first sample, length and quality of each window, checked against its contents.
fn outline(windows: &[Window]) -> Vec<(u64, usize, Quality)> {
    for window in windows {
        for (i, x) in window.samples.iter().enumerate() {
            assert_eq!(*x, ((window.first_sample_index + i as u64) % 100_000) as f64);
        }
        assert_eq!(window.t0, (window.first_sample_index as f64 / RATE_HZ * 1e9).round() as i64);
    }
    windows.iter().map(|w| (w.first_sample_index, w.samples.len(), w.quality)).collect()
}

#[test]
fn analytic_windows_and_a_gap() {
    let mut assembler = assembler(1.0, 0.5);
    let mut windows = Vec::new();
    for (first, count) in [(100, 1700), (1800, 300), (2500, 2100)] {
        let block = piece("a", first, ramp(first, count), Quality::GOOD);
        assembler.push(&Packet::Vibration(block), &mut |w| windows.push(w));
        assert!(conserved(&assembler));
    }
    assembler.finish(&mut |w| windows.push(w));
    assert!(conserved(&assembler));
    let starts: Vec<u64> = outline(&windows).iter().map(|w| w.0).collect();
    assert_eq!(starts, [100, 600, 1100, 2500, 3000, 3500], "a new run starts a new row of windows");
    let gaps: Vec<_> = assembler.take_gaps().collect();
    assert_eq!(gaps.len(), 1);
    assert_eq!((gaps[0].reason, gaps[0].expected_index, gaps[0].found_index), (GapReason::IndexJump, 2100, 2500));
    let counters = assembler.counters();
    assert_eq!((counters.samples_missing, counters.gaps, counters.windows), (400, 1, 6));
    assert_eq!((counters.samples_discarded, counters.samples_pending), (100, 0), "4500 to 4600 were in no window");
}

#[test]
fn analytic_every_kind_of_break_is_named() {
    let change = |f: &dyn Fn(&mut Block)| {
        let mut assembler = assembler(0.5, 0.5);
        let mut sink = |_| {};
        assembler.push(&Packet::Vibration(piece("a", 0, ramp(0, 700), Quality::GOOD)), &mut sink);
        let mut next = piece("a", 700, ramp(700, 700), Quality::GOOD);
        f(&mut next);
        assembler.push(&Packet::Vibration(next), &mut sink);
        assert!(conserved(&assembler));
        assembler.take_gaps().map(|g| g.reason).collect::<Vec<_>>()
    };
    assert_eq!(change(&|_| {}), []);
    assert_eq!(change(&|b| b.quality = Quality::GAP_BEFORE), [GapReason::Declared]);
    assert_eq!(change(&|b| b.first_sample_index = 650), [GapReason::IndexBackwards]);
    assert_eq!(change(&|b| b.first_sample_index = 900), [GapReason::IndexJump]);
    assert_eq!(change(&|b| b.sample_rate_hz = 2000.0), [GapReason::RateChange]);
    assert_eq!(change(&|b| b.unit = "g".into()), [GapReason::UnitChange]);
    for rate in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e-300, 1e300] {
        assert_eq!(change(&|b| b.sample_rate_hz = rate), [GapReason::UnusableRate], "{rate}");
    }
    assert_eq!(change(&|b| b.first_sample_index = u64::MAX - 3), [GapReason::UnusableRate]);
}

#[test]
fn analytic_quality_reaches_the_windows_it_touches_and_no_other() {
    let mut assembler = assembler(1.0, 1.0);
    let mut windows = Vec::new();
    for (first, quality) in
        [(0, Quality::SETTLING), (1500, Quality::GOOD), (3000, Quality::OVERLOAD), (3001, Quality::GOOD)]
    {
        let until = match first {
            0 => 1500,
            1500 => 3000,
            3000 => 3001,
            _ => 5000,
        };
        let block = piece("a", first, ramp(first, until - first), quality);
        assembler.push(&Packet::Vibration(block), &mut |w| windows.push(w));
    }
    let qualities: Vec<Quality> = outline(&windows).iter().map(|w| w.2).collect();
    let (s, g, o) = (Quality::SETTLING, Quality::GOOD, Quality::OVERLOAD);
    assert_eq!(qualities, [s, s, g, o, g]);
}

#[test]
fn analytic_clock_that_jumps_is_trouble_and_one_that_drifts_is_not() {
    for (jump_ns, trouble) in [(0, false), (400_000, false), (900_000, false), (20_000_000, true), (-20_000_000, true)]
    {
        let mut assembler = assembler(1.0, 1.0);
        let mut windows = Vec::new();
        for i in 0..4u64 {
            let mut block = piece("a", 750 * i, ramp(750 * i, 750), Quality::GOOD);
            block.t0 += if i >= 2 { jump_ns } else { 0 };
            assembler.push(&Packet::Vibration(block), &mut |w| windows.push(w));
        }
        assert_eq!(windows.iter().map(|w| w.clock_trouble).collect::<Vec<_>>(), [false, trouble, false], "{jump_ns}");
    }
}

/// Stamps of blocks of 100 ms that say another rate than the blocks: 2 % too fast from the second
/// second to the sixth. Windows of a second, one each half second: those that lie in it are in
/// trouble from the third on, and three after it no more are.
#[test]
fn analytic_stamps_of_another_rate_are_trouble_while_they_last() {
    let mut assembler = assembler(1.0, 0.5);
    let mut windows = Vec::new();
    for i in 0..100u64 {
        let mut block = piece("a", 100 * i, ramp(100 * i, 100), Quality::GOOD);
        block.t0 -= 2_000_000 * i.clamp(20, 60).cast_signed();
        assembler.push(&Packet::Vibration(block), &mut |w| windows.push(w));
    }
    for window in &windows {
        let (start, end) = (window.first_sample_index, window.first_sample_index + 1000);
        match window.clock_trouble {
            true => assert!(end > 2000 && start < 7500, "{start}"),
            false => assert!(start < 3000 || end > 6000, "{start}"),
        }
    }
}

#[test]
fn analytic_a_window_waits_for_the_tacho_but_not_forever() {
    let config = WindowConfig { length_s: 1.0, hop_s: 1.0, tacho_wait_s: 0.5 };
    let run = Run::steady(10.0);
    let mut late = Assembler::new(&config, &[("input".into(), 1.0)], Some("input"));
    let mut count = 0;
    let block = |first: u64, n: u64| Packet::Vibration(piece("a", first, ramp(first, n), Quality::GOOD));
    late.push(&block(0, 1400), &mut |_| count += 1);
    assert_eq!(count, 0, "0.4 s is not yet too long");
    let mut with_pulses = late.clone();
    let mut covered = None;
    with_pulses.push(&pulses(run, "input", 1.0, 1.0, 1.2), &mut |w| covered = Some(w));
    let times = covered.expect("the pulses cover it").pulses.times_s;
    assert_eq!(times.len(), 2 + 10 + 2, "two beyond each end: {times:?}");
    late.push(&block(1400, 100), &mut |w| {
        count += 1;
        assert!(w.pulses.times_s.is_empty());
    });
    assert_eq!((count, late.counters().windows_without_tacho_cover), (1, 1), "waited long enough");
    // A tacho that never gave a pulse is not waited for again.
    late.push(&block(1500, 500), &mut |_| count += 1);
    assert_eq!(count, 2);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, ..ProptestConfig::default() })]

    /// Blocks of any length with gaps, going back and quality bits: every sample is accounted for
    /// after every packet, and windows hold what their indices say.
    #[test]
    fn conform_samples_are_conserved(
        steps in prop::collection::vec((0u64..900, -200i64..300, 0u32..32), 1..40),
        length_ms in 64u64..700,
        hop_ms in 10u64..900,
    ) {
        let mut assembler = assembler(length_ms as f64 / 1e3, hop_ms as f64 / 1e3);
        let mut windows = Vec::new();
        let mut at = 1000u64;
        for (count, jump, bits) in steps {
            // Two of three blocks follow on.
            let first = if jump < 100 { at } else { at.saturating_add_signed(jump - 200) };
            let block = piece("a", first, ramp(first, count), Quality(bits));
            assembler.push(&Packet::Vibration(block), &mut |w| windows.push(w));
            prop_assert!(conserved(&assembler));
            at = first + count;
        }
        assembler.finish(&mut |w| windows.push(w));
        prop_assert!(conserved(&assembler));
        prop_assert_eq!(assembler.counters().samples_pending, 0);
        prop_assert_eq!(assembler.counters().windows, windows.len() as u64);
        outline(&windows);
    }

    /// Two channels and a tacho, cut into blocks anywhere: the analyses are the same to the last
    /// bit.
    #[test]
    fn conform_any_split_gives_the_same_analyses(cuts in prop::collection::vec(1usize..3000, 1..30)) {
        let run = Run::ramp(25.0, 0.3, 3.0);
        let bench = with_tacho(bench(25.0, &[(17, 40)]), "shaft0", 1.0);
        let config = PipelineConfig::default();
        let rate_hz = 5000.0;
        let tones: Vec<Tone> =
            (1..=5).map(|h| Tone { order: 17.0 * f64::from(h), amplitude: 1.0, phase_rad: f64::from(h) }).collect();
        let mut signal = samples(run, &tones, rate_hz, 15_000);
        add_noise(&mut signal, 0.3, 5);
        let values: Vec<f32> = signal.iter().map(|&x| x as f32).collect();
        let sensors: [Arc<str>; 2] = ["a".into(), "b".into()];
        let analyse = |lengths: &mut dyn Iterator<Item = usize>| {
            let pipeline = Pipeline::new(&bench, &config, None).expect("a usable bench");
            let mut assembler = pipeline.assembler();
            let mut windows = Vec::new();
            assembler.push(&pulses(run, "shaft0", 1.0, 1.0, 3.2), &mut |w| windows.push(w));
            let mut at = 0;
            while at < values.len() {
                let count = lengths.next().unwrap_or(usize::MAX).min(values.len() - at);
                for sensor in &sensors {
                    let block = Block {
                        sensor: sensor.clone(),
                        t0: (at as f64 / rate_hz * 1e9).round() as i64,
                        sample_rate_hz: rate_hz,
                        first_sample_index: at as u64,
                        unit: "m/s^2".into(),
                        samples: Samples::Physical(values[at..at + count].to_vec()),
                        quality: Quality::GOOD,
                    };
                    assembler.push(&Packet::Vibration(block), &mut |w| windows.push(w));
                }
                at += count;
            }
            assembler.finish(&mut |w| windows.push(w));
            windows.sort_by_key(|w| (w.channel, w.number));
            let mut worker = pipeline.worker();
            let texts = windows.iter().map(|window| {
                let mut out = WindowAnalysis::empty();
                pipeline.analyse(&mut worker, window, &mut out);
                format!("{out:?}")
            });
            texts.collect::<Vec<_>>()
        };
        let whole = analyse(&mut std::iter::empty());
        prop_assert_eq!(whole.len(), 2 * 5);
        prop_assert_eq!(&whole, &analyse(&mut cuts.iter().copied().cycle()));
    }
}
