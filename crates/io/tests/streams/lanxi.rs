//! The stream of LAN-XI instruments.

use gearwatch_io::lanxi::{
    Body, Damage, Decoded, Decoder, Descriptor, INT24, LONGEST_PAYLOAD, Lost, Message, QualityFlags, Signal,
    SignalQuality, Time, Value, encode,
};
use proptest::prelude::*;

/// Three samples of signal 1 at 1700000000.5 s.
const SAMPLES: &str = "42 4b 14 00 01 00 00 00 00 00 00 00 20 00 00 00 00 00 00 80 00 f1 53 65 11 00 00 00 \
                       01 00 00 00 01 00 03 00 01 00 00 ff ff ff 00 00 40";
/// Clipped and overrun of signal 1 at the same time.
const QUALITY: &str = "42 4b 14 00 02 00 00 00 00 00 00 00 20 00 00 00 00 00 00 80 00 f1 53 65 08 00 00 00 \
                       01 00 01 00 12 00 00 00";

fn bytes(hex: &str) -> Vec<u8> {
    hex.split_whitespace().map(|byte| u8::from_str_radix(byte, 16).unwrap()).collect()
}

fn encoded(messages: &[Message]) -> Vec<u8> {
    let mut out = Vec::new();
    messages.iter().for_each(|message| encode(message, &mut out));
    out
}

/// All that comes out of bytes that are split at these places.
fn decoded(bytes: &[u8], cuts: &[usize]) -> Vec<Decoded> {
    let (mut decoder, mut out, mut at) = (Decoder::default(), Vec::new(), 0);
    let mut ends: Vec<usize> = cuts.iter().map(|cut| cut % (bytes.len() + 1)).collect();
    ends.sort_unstable();
    for end in ends.into_iter().chain([bytes.len()]) {
        decoder.push(&bytes[at..end], &mut |decoded| out.push(decoded));
        at = end;
    }
    out
}

fn time() -> Time {
    Time::from_unix_ns(1_700_000_000_500_000_000)
}

fn samples() -> Message {
    Message { time: time(), body: Body::Signals(vec![Signal { id: 1, counts: vec![1, -1, 0x40_0000] }]) }
}

/// The vectors of the protocol's description, byte for byte in both directions.
#[test]
fn conform_the_published_vectors_are_read_and_written_byte_for_byte() {
    let flags = QualityFlags(QualityFlags::CLIPPED.0 | QualityFlags::OVERRUN.0);
    let quality = Message { time: time(), body: Body::Quality(vec![SignalQuality { id: 1, flags }]) };
    for (hex, message) in [(SAMPLES, samples()), (QUALITY, quality)] {
        assert_eq!(encoded(std::slice::from_ref(&message)), bytes(hex));
        assert_eq!(decoded(&bytes(hex), &[]), [Decoded::Message(message)]);
    }
    assert_eq!(time().nanos(), Some(1_700_000_000_500_000_000));
}

/// One byte at a time, and cut at every place: the same messages.
#[test]
fn conform_a_read_may_end_anywhere() {
    let both = bytes(&format!("{SAMPLES} {QUALITY}"));
    let whole = decoded(&both, &[]);
    assert_eq!(whole.len(), 2);
    assert_eq!(decoded(&both, &(0..both.len()).collect::<Vec<_>>()), whole);
    for cut in 0..both.len() {
        assert_eq!(decoded(&both, &[cut]), whole, "cut at {cut}");
    }
}

#[test]
fn conform_every_descriptor_survives_a_round_trip() {
    let values = [
        Value::DataType(INT24),
        Value::Scale(1188.5022274370185),
        Value::Offset(-0.25),
        Value::Period(Time::period_of(16_384.0)),
        Value::Unit("m/s²".to_owned()),
        Value::VectorLength(0),
        Value::ChannelType(1),
        Value::Other(99, vec![1, 2, 3]),
    ];
    let all = values.into_iter().map(|value| Descriptor { signal: 7, value }).collect();
    let message = Message { time: time(), body: Body::Interpretation(all) };
    assert_eq!(decoded(&encoded(std::slice::from_ref(&message)), &[]), [Decoded::Message(message)]);
    assert_eq!(Time::period_of(16_384.0).rate_hz(), Some(16_384.0));
}

/// The relative of header length 16 has a time without family, in ticks of 2^-32 s. Its first
/// message waits until the second has begun.
#[test]
fn conform_the_short_header_is_read() {
    let mut short = bytes(SAMPLES);
    short.drain(12..16);
    short[2] = 16;
    let long = bytes(SAMPLES);
    assert_eq!(decoded(&short, &[]), []);
    assert_eq!(decoded(&short.repeat(2), &[]), decoded(&long.repeat(2), &[]));
    // A stream is of one form.
    let out = decoded(&[&long[..], &short, &long, &long].concat(), &[]);
    let [Decoded::Message(_), Decoded::Lost(lost), ..] = &out[..] else { panic!("{out:?}") };
    assert_eq!(*lost, Lost { bytes: short.len() as u64, damage: Damage::HeaderLength(16) });
}

/// One flipped bit makes a short header of a long one; at a time near 1970, which an instrument has
/// whose clock is not set, what it then reads as a length is zero, and an interpretation may be
/// empty.
#[test]
fn regress_a_flipped_header_length_is_no_message() {
    let value = Value::Scale(0.0);
    let message = Message {
        time: Time { family: Time::FAMILY, ticks: 0 },
        body: Body::Interpretation(vec![Descriptor { signal: 1, value }]),
    };
    let mut bytes = encoded(&[message.clone(), message.clone(), message.clone()]);
    let one = bytes.len() / 3;
    bytes[2] ^= 4;
    let out = decoded(&bytes, &[]);
    let lost = Lost { bytes: one as u64, damage: Damage::Follows };
    assert_eq!(out, [Decoded::Lost(lost), Decoded::Message(message.clone()), Decoded::Message(message)]);
}

/// A tick of 1/(2^2 · 3 · 5 · 7) s: 420 a second.
#[test]
fn analytic_times_of_any_family() {
    let time = Time { family: [2, 1, 1, 1], ticks: 421 };
    assert_eq!(time.nanos(), Some(1_002_380_952));
    assert_eq!(time.rate_hz(), Some(420.0 / 421.0));
    // 2^255 ticks a second are no clock, and no tick is no period.
    assert_eq!(Time { family: [255, 0, 0, 0], ticks: 1 }.nanos(), None);
    assert_eq!(Time { family: [0; 4], ticks: 0 }.rate_hz(), None);
    assert_eq!(Time { family: [0; 4], ticks: u64::MAX }.nanos(), None);
}

/// A length beyond the bound is refused at once, and the next message is found; a length within it
/// that the payload contradicts is refused as soon as the contradiction is there, long before so
/// many bytes have come.
#[test]
fn conform_a_wrong_length_holds_nothing_up() {
    for length in [(LONGEST_PAYLOAD + 1) as u32, u32::MAX, 100_000, 16, 18] {
        let mut damaged = bytes(SAMPLES);
        damaged[24..28].copy_from_slice(&length.to_le_bytes());
        let stream = [damaged, bytes(QUALITY), bytes(SAMPLES)].concat();
        let out = decoded(&stream, &[]);
        let [Decoded::Lost(lost), Decoded::Message(next), ..] = &out[..] else { panic!("{length}: {out:?}") };
        assert_eq!(lost.bytes, 45, "{length}");
        assert!(matches!(next.body, Body::Quality(_)), "{length}");
        if length > LONGEST_PAYLOAD as u32 {
            assert_eq!(lost.damage, Damage::Length(length));
        }
    }
}

/// Each way in which a payload can contradict itself.
#[test]
fn conform_contradictions_are_named() {
    let signal = |id| Signal { id, counts: vec![1, 2] };
    let twice = Message { time: time(), body: Body::Signals(vec![signal(1), signal(1)]) };
    let nobody = Message { time: time(), body: Body::Signals(vec![signal(0)]) };
    let mut negative = bytes(SAMPLES);
    negative[35] = 0x80;
    let mut text = encoded(&[Message {
        time: time(),
        body: Body::Interpretation(vec![Descriptor { signal: 1, value: Value::Unit("Vx".to_owned()) }]),
    }]);
    *text.last_mut().unwrap() = 0xff;
    for (bytes, why) in [
        (encoded(&[twice]), "comes twice"),
        (encoded(&[nobody]), "signal number"),
        (negative, "negative"),
        (text, "no text"),
    ] {
        let mut decoder = Decoder::default();
        decoder.push(&bytes, &mut |out| panic!("{out:?}"));
        let lost = decoder.lost().unwrap();
        assert!(lost.damage.to_string().contains(why), "{why}: {}", lost.damage);
    }
}

/// A few messages as an instrument sends them; the last ones are there so that damage before them
/// is told.
fn stream() -> impl Strategy<Value = Vec<Message>> {
    let counts = prop::collection::vec(-0x80_0000_i32..=0x7f_ffff, 0..20);
    let signals = prop::collection::btree_map(1_u16..20, counts, 0..4)
        .prop_map(|all| Body::Signals(all.into_iter().map(|(id, counts)| Signal { id, counts }).collect()));
    let quality = prop::collection::btree_map(1_u16..20, 0_u16..32, 0..4).prop_map(|all| {
        let entry = |(id, flags)| SignalQuality { id, flags: QualityFlags(flags) };
        Body::Quality(all.into_iter().map(entry).collect())
    });
    let value = prop_oneof![
        any::<u16>().prop_map(Value::DataType),
        (-1e9..1e9).prop_map(Value::Scale),
        "[a-z/^2]{0,6}".prop_map(Value::Unit),
        (1_u64..1 << 40).prop_map(|ticks| Value::Period(Time { family: Time::FAMILY, ticks })),
    ];
    let descriptor = (1_u16..20, value).prop_map(|(signal, value)| Descriptor { signal, value });
    let interpretation = prop::collection::vec(descriptor, 0..4).prop_map(Body::Interpretation);
    let body = prop_oneof![4 => signals, 1 => quality, 1 => interpretation];
    let message =
        (0_u64..1 << 62, body).prop_map(|(ticks, body)| Message { time: Time { family: Time::FAMILY, ticks }, body });
    prop::collection::vec(message, 1..6)
}

/// The same numbers of the same things; only what they say may differ.
fn same_form(a: &Message, b: &Message) -> bool {
    match (&a.body, &b.body) {
        (Body::Signals(a), Body::Signals(b)) => a.iter().map(|s| s.counts.len()).eq(b.iter().map(|s| s.counts.len())),
        (Body::Quality(a), Body::Quality(b)) => a.len() == b.len(),
        (Body::Interpretation(a), Body::Interpretation(b)) => a.len() == b.len(),
        // What had a type has none any more; whoever reads must take that as damage.
        (_, Body::Unknown(_)) => true,
        _ => false,
    }
}

/// An interpretation with the first descriptors of another.
fn begins(a: &Message, b: &Message) -> bool {
    matches!((&a.body, &b.body), (Body::Interpretation(a), Body::Interpretation(b)) if b.starts_with(a))
}

proptest! {
    #[test]
    fn analytic_any_split_gives_the_same_messages(messages in stream(), cuts in prop::collection::vec(any::<usize>(), 0..40)) {
        let all: Vec<_> = messages.iter().cloned().map(Decoded::Message).collect();
        prop_assert_eq!(decoded(&encoded(&messages), &cuts), all);
    }

    /// One flipped bit costs at most the message that it lies in. Either this message comes with
    /// the same form (and other content, which no checksum protects), or a loss is told before the
    /// next one. An interpretation, which does not say how many descriptors it has, may come with
    /// the first of them before its loss is told. Nothing is invented.
    #[test]
    fn analytic_a_flipped_bit_is_told_or_changes_one_message(
        messages in stream(), bit in any::<usize>(), cuts in prop::collection::vec(any::<usize>(), 0..10),
    ) {
        let mut bytes = encoded(&messages);
        let bit = bit % (8 * bytes.len());
        bytes[bit / 8] ^= 1 << (bit % 8);
        // Two further messages, so that what follows the damage can be seen.
        let after = [samples(), samples()];
        bytes.extend(encoded(&after));
        let sent: Vec<_> = messages.iter().chain(&after).cloned().collect();
        let out = decoded(&bytes, &cuts);
        prop_assert_eq!(&out, &decoded(&bytes, &[]), "the split matters");
        let before = messages.iter().scan(0, |at, message| {
            *at += encoded(std::slice::from_ref(message)).len();
            Some(*at)
        });
        let hit = before.take_while(|end| *end <= bit / 8).count();
        let told = out.iter().any(|decoded| matches!(decoded, Decoded::Lost(_)));
        let came: Vec<_> = out.iter().filter_map(|d| match d { Decoded::Message(m) => Some(m), Decoded::Lost(_) => None }).collect();
        prop_assert_eq!(&came[..hit], &sent[..hit].iter().collect::<Vec<_>>()[..], "what came before the damage");
        if told {
            let place = out.iter().position(|d| matches!(d, Decoded::Lost(_))).unwrap();
            let shortened = matches!((came.get(hit), &sent[hit]), (Some(a), b) if begins(a, b));
            prop_assert!(place == hit || (place == hit + 1 && shortened), "the loss is told at {place}, but lies at {hit}");
            // What comes after it was sent after it: nothing twice, nothing invented.
            let rest = &came[place..];
            prop_assert!(rest.iter().copied().eq(&sent[sent.len() - rest.len()..]), "{:?}", rest);
        } else {
            prop_assert!(same_form(&sent[hit], came[hit]), "{:?} became {:?}", sent[hit], came[hit]);
            let rest = came[hit + 1..].iter().map(|m| (*m).clone()).collect::<Vec<_>>();
            // After an unknown type the last message waits for its successor; else all are there.
            prop_assert_eq!(&rest[..], &sent[hit + 1..][..rest.len()]);
            prop_assert!(rest.len() == sent.len() - hit - 1);
        }
    }

    /// Whatever comes, nothing panics, and no more is held than one message.
    #[test]
    fn analytic_noise_is_only_lost(noise in prop::collection::vec(any::<u8>(), 0..4000)) {
        let mut decoder = Decoder::default();
        let mut messages = 0;
        decoder.push(&noise, &mut |decoded| messages += usize::from(matches!(decoded, Decoded::Message(_))));
        prop_assert!(decoder.pending() <= noise.len());
        prop_assert_eq!(messages, 0);
    }
}
