//! The angle of a shaft through a recording: from tacho pulses or an even speed, with what the mesh
//! lines correct.

use pulp::{Arch, Simd, WithSimd};

/// The angle of a shaft through a recording, worked out where it is asked for: written down it
/// would take as much memory as a channel of the recording, or two.
#[derive(Clone, Debug)]
pub struct Turning {
    start: Start,
    /// What the mesh lines add, at the middles of blocks (revolutions); empty where they add
    /// nothing.
    correction: Vec<f64>,
    len: usize,
}

/// What the angle is found from.
#[derive(Clone, Debug)]
pub enum Start {
    /// An even speed.
    Even {
        /// Of the input shaft (Hz).
        input_hz: f64,
        /// Samples a second.
        sample_rate_hz: f64,
    },
    /// A tacho, whose clock may not be that of the samples.
    Pulses {
        /// By the tacho's clock.
        angle: PulseAngle,
        /// Input speed by the mesh lines, which counts against the sample clock (Hz).
        input_hz: f64,
        /// The same by the tacho.
        tacho_input_hz: f64,
        /// Samples that the tacho goes along with.
        len: usize,
    },
}

impl Turning {
    /// Of so many samples.
    pub fn new(start: Start, len: usize) -> Self {
        Self { start, correction: Vec::new(), len }
    }

    /// Adds to the angle what is given at the middles of so many blocks (revolutions), the same
    /// number each time.
    pub(crate) fn correct(&mut self, by: &[f64]) {
        self.correction.resize(by.len(), 0.0);
        self.correction.iter_mut().zip(by).for_each(|(sum, by)| *sum += by);
    }

    /// Samples.
    pub fn len(&self) -> usize {
        self.len
    }

    /// There is no sample.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Angle at the first sample and at the last (revolutions).
    pub fn ends(&self) -> (f64, f64) {
        let at = |sample: usize| {
            let mut out = [0.0];
            Walk { turning: self, sample, pulse: 0, samples: Vec::new() }.fill(&mut out[..self.len.min(1)]);
            out[0]
        };
        (at(0), at(self.len.saturating_sub(1)))
    }

    /// From the first sample on.
    pub fn walk(&self) -> Walk<'_> {
        Walk { turning: self, sample: 0, pulse: 0, samples: Vec::new() }
    }

    /// Angle at each sample in turn (revolutions).
    pub fn angles(&self) -> impl Iterator<Item = f64> + '_ {
        const AT_A_TIME: usize = 256;
        let mut walk = self.walk();
        let mut some = [0.0; AT_A_TIME];
        (0..self.len).map(move |n| {
            if n.is_multiple_of(AT_A_TIME) {
                walk.fill(&mut some[..AT_A_TIME.min(self.len - n)]);
            }
            some[n % AT_A_TIME]
        })
    }
}

/// The angle sample after sample, many at a time.
pub struct Walk<'a> {
    turning: &'a Turning,
    sample: usize,
    /// The last pulse that was come to, and angles by the pulses.
    pulse: usize,
    samples: Vec<f64>,
}

impl Walk<'_> {
    /// Angle at the next samples (revolutions), no more than there are.
    pub fn fill(&mut self, out: &mut [f64]) {
        let first = self.sample;
        self.sample += out.len();
        Arch::new().dispatch(Fill { walk: self, first, out });
    }

    /// The same from a sample on.
    #[inline(always)]
    fn fill_from(&mut self, first: usize, out: &mut [f64]) {
        match &self.turning.start {
            Start::Even { input_hz, sample_rate_hz } => {
                let begin = first as f64;
                for (i, angle) in out.iter_mut().enumerate() {
                    *angle = input_hz * (begin + f64::from(i as u32)) / sample_rate_hz;
                }
            }
            Start::Pulses { angle: by_pulses, input_hz, tacho_input_hz, len } => {
                // Where the sample clock is off, sample `n` was not taken at `n` steps of the
                // tacho's time.
                let begin = first as f64;
                for (i, position) in out.iter_mut().enumerate() {
                    *position = (begin + f64::from(i as u32)) * input_hz / tacho_input_hz;
                }
                let whole = |position: f64| (position as usize).min(len - 2);
                let (low, high) = (out.first().copied().unwrap_or(0.0), out.last().copied().unwrap_or(0.0));
                let (begin, end) = (whole(low), whole(high) + 2);
                self.samples.resize(end - begin, 0.0);
                self.pulse = by_pulses.fill(begin, self.pulse, &mut self.samples);
                // Positions rise by about one, so that the whole number below is stepped to.
                let (mut at, mut below, last) = (0, begin as f64, end - begin - 2);
                for angle in out.iter_mut() {
                    let position = *angle;
                    while at < last && below + 1.0 <= position {
                        (at, below) = (at + 1, below + 1.0);
                    }
                    let (a, b) = (self.samples[at], self.samples[at + 1]);
                    *angle = a + (b - a) * (position - below);
                }
            }
        }
        let knots = &self.turning.correction;
        if !knots.is_empty() {
            add_between(knots, self.turning.len, first, out);
        }
    }
}

/// Work for the processor's vectors.
struct Fill<'a, 'b> {
    walk: &'a mut Walk<'b>,
    first: usize,
    out: &'a mut [f64],
}

impl WithSimd for Fill<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        self.walk.fill_from(self.first, self.out);
    }
}

/// Adds to the values at samples from `first` on what [`between`] gives at each of `len` samples:
/// samples between the same two middles of blocks together.
#[inline(always)]
fn add_between(values: &[f64], len: usize, first: usize, out: &mut [f64]) {
    let (blocks, last) = (values.len() as f64, values.len() - 2);
    let position = |n: f64| (n + 0.5) * blocks / len as f64 - 0.5;
    let knot = |n: usize| (position(n as f64).max(0.0) as usize).min(last);
    let mut done = 0;
    while done < out.len() {
        let begin = first + done;
        let k = knot(begin);
        // The last sample before the next middle, to within one.
        let guess = ((k as f64 + 1.5) * len as f64 / blocks - 0.5) as usize;
        let mut end = if k == last { first + out.len() } else { guess.clamp(begin + 1, first + out.len()) };
        while end < first + out.len() && knot(end) == k {
            end += 1;
        }
        while end > begin + 1 && knot(end - 1) != k {
            end -= 1;
        }
        add_span(values, k, begin, position, &mut out[done..end - first]);
        done = end - first;
    }
}

/// The same between the middles of blocks `k` and `k + 1`, from a sample on.
#[inline(always)]
fn add_span(values: &[f64], k: usize, begin: usize, position: impl Fn(f64) -> f64, out: &mut [f64]) {
    let (b, c) = (values[k], values[k + 1]);
    let (begin, middle) = (begin as f64, k as f64);
    let at = |i: usize| position(begin + f64::from(i as u32)) - middle;
    if k == 0 || k == values.len() - 2 {
        for (i, out) in out.iter_mut().enumerate() {
            *out += straight(b, c, at(i));
        }
    } else {
        let (a, d) = (values[k - 1], values[k + 2]);
        for (i, out) in out.iter_mut().enumerate() {
            *out += cubic([a, b, c, d], at(i));
        }
    }
}

/// Angle of a shaft from its pulses: cubic through the pulse times, straight on beyond the ends.
#[derive(Clone, Debug)]
pub struct PulseAngle {
    /// Seconds after the first sample.
    pulse_s: Vec<f64>,
    sample_rate_hz: f64,
    /// Revolutions of the shaft that is asked for from pulse to pulse.
    rev_per_pulse: f64,
}

impl PulseAngle {
    /// Of a shaft that turns `order` times as fast as the one whose angle is wanted. `None` with
    /// fewer than four pulses.
    pub fn new(pulse_s: Vec<f64>, pulses_per_rev: f64, sample_rate_hz: f64, order: f64) -> Option<Self> {
        (pulse_s.len() >= 4).then_some(Self { pulse_s, sample_rate_hz, rev_per_pulse: 1.0 / pulses_per_rev / order })
    }

    /// Angle at a sample (revolutions).
    pub fn at(&self, sample: usize) -> f64 {
        let mut out = [0.0];
        self.fill(sample, 0, &mut out);
        out[0]
    }

    /// Angles at samples from `first` on (revolutions); `pulse` is one near them, 0 to begin with,
    /// and the one before the last of them is returned.
    #[inline(always)]
    fn fill(&self, first: usize, mut pulse: usize, out: &mut [f64]) -> usize {
        let time = |sample: usize| sample as f64 / self.sample_rate_hz;
        let mut done = 0;
        while done < out.len() {
            pulse = self.pulse_at(time(first + done), pulse);
            let span = self.span(pulse);
            // The samples before the next pulse, to within one; behind the last one all.
            let until = if pulse + 2 < self.pulse_s.len() { span.end_s } else { f64::INFINITY };
            let guess = (until * self.sample_rate_hz) as usize;
            let mut end = guess.saturating_sub(first).saturating_sub(1).clamp(done + 1, out.len());
            while end < out.len() && time(first + end) < until {
                end += 1;
            }
            let (begin_s, end_s) = (time(first + done), time(first + end - 1));
            let begin = (first + done) as f64;
            let time_of = |i: usize| (begin + f64::from(i as u32)) / self.sample_rate_hz;
            let of_it = out[done..end].iter_mut().enumerate();
            if begin_s > self.pulse_s[0] && end_s < self.pulse_s[self.pulse_s.len() - 1] {
                of_it.for_each(|(i, angle)| *angle = span.at(time_of(i)) * self.rev_per_pulse);
            } else {
                of_it.for_each(|(i, angle)| *angle = self.within(&span, time_of(i)));
            }
            done = end;
        }
        pulse
    }

    /// The last pulse before a time, or the last but one, sought from one near it.
    #[inline(always)]
    fn pulse_at(&self, t: f64, mut pulse: usize) -> usize {
        while pulse > 0 && t < self.pulse_s[pulse] {
            pulse -= 1;
        }
        while pulse + 2 < self.pulse_s.len() && self.pulse_s[pulse + 1] <= t {
            pulse += 1;
        }
        pulse
    }

    /// From a pulse to the next.
    #[inline(always)]
    fn span(&self, pulse: usize) -> Span {
        let (pulse_s, n) = (&self.pulse_s, self.pulse_s.len());
        let slope = |i: usize| {
            // Three-point slope in pulses per second (Catmull–Rom on uneven steps).
            let (a, b) = (i.saturating_sub(1), (i + 1).min(n - 1));
            (b - a) as f64 / (pulse_s[b] - pulse_s[a])
        };
        let (begin_s, end_s) = (pulse_s[pulse], pulse_s[pulse + 1]);
        let slopes = [slope(pulse), slope(pulse + 1)];
        let rises = slopes.map(|slope| slope * (end_s - begin_s));
        Span { pulse: pulse as f64, slopes, rises, begin_s, end_s, per_s: 1.0 / (end_s - begin_s) }
    }

    /// Angle at a time within a span, or beyond the ends of all (revolutions).
    #[inline(always)]
    fn within(&self, span: &Span, t: f64) -> f64 {
        let n = self.pulse_s.len();
        let pulses = if t <= self.pulse_s[0] {
            span.slopes[0] * (t - self.pulse_s[0])
        } else if t >= self.pulse_s[n - 1] {
            (n - 1) as f64 + span.slopes[1] * (t - self.pulse_s[n - 1])
        } else {
            span.at(t)
        };
        pulses * self.rev_per_pulse
    }
}

/// Two neighbouring pulses, and the slopes there (pulses a second, and pulses over the span).
#[derive(Clone, Copy, Debug)]
struct Span {
    pulse: f64,
    slopes: [f64; 2],
    rises: [f64; 2],
    begin_s: f64,
    end_s: f64,
    per_s: f64,
}

impl Span {
    /// Pulses at a time within it.
    #[inline(always)]
    fn at(&self, t: f64) -> f64 {
        let u = (t - self.begin_s) * self.per_s;
        let [m0, m1] = self.rises;
        let (u2, u3) = (u * u, u * u * u);
        self.pulse * (2.0 * u3 - 3.0 * u2 + 1.0)
            + m0 * (u3 - 2.0 * u2 + u)
            + (self.pulse + 1.0) * (-2.0 * u3 + 3.0 * u2)
            + m1 * (u3 - u2)
    }
}

/// Value between the middles of blocks: cubic through four (Catmull–Rom), straight on beyond the
/// ends.
pub(crate) fn between(values: &[f64], position: f64) -> f64 {
    let last = values.len() - 2;
    let k = (position.max(0.0) as usize).min(last);
    let t = position - k as f64;
    let (b, c) = (values[k], values[k + 1]);
    if k == 0 || k == last { straight(b, c, t) } else { cubic([values[k - 1], b, c, values[k + 2]], t) }
}

#[inline(always)]
fn straight(b: f64, c: f64, t: f64) -> f64 {
    b + (c - b) * t
}

#[inline(always)]
fn cubic([a, b, c, d]: [f64; 4], t: f64) -> f64 {
    b + 0.5 * t * (c - a + t * (2.0 * a - 5.0 * b + 4.0 * c - d + t * (3.0 * (b - c) + d - a)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pulses at a time, by the formula alone.
    fn pulses_at(pulse_s: &[f64], t: f64) -> f64 {
        let n = pulse_s.len();
        let slope = |i: usize| {
            let (a, b) = (i.saturating_sub(1), (i + 1).min(n - 1));
            (b - a) as f64 / (pulse_s[b] - pulse_s[a])
        };
        if t <= pulse_s[0] {
            return slope(0) * (t - pulse_s[0]);
        } else if t >= pulse_s[n - 1] {
            return (n - 1) as f64 + slope(n - 1) * (t - pulse_s[n - 1]);
        }
        let at = pulse_s.partition_point(|pulse| *pulse <= t) - 1;
        let h = pulse_s[at + 1] - pulse_s[at];
        let u = (t - pulse_s[at]) / h;
        let (m0, m1) = (slope(at) * h, slope(at + 1) * h);
        let (u2, u3) = (u * u, u * u * u);
        at as f64 * (2.0 * u3 - 3.0 * u2 + 1.0)
            + m0 * (u3 - 2.0 * u2 + u)
            + (at + 1) as f64 * (-2.0 * u3 + 3.0 * u2)
            + m1 * (u3 - u2)
    }

    /// Many samples at a time are what each alone is: by an even speed and by pulses whose clock is
    /// not that of the samples, which begin before the samples and end behind them, or do not; with
    /// a correction that has many blocks, and two.
    #[test]
    fn oracle_a_walk_gives_what_each_sample_has() {
        const LEN: usize = 10_007;
        const RATE_HZ: f64 = 10_000.0;
        let even = (Start::Even { input_hz: 25.0, sample_rate_hz: RATE_HZ }, Vec::new());
        let pulses = |hz: f64, count: u32, from_s: f64| {
            let at = |p: u32| from_s + 0.0041 * f64::from(p) + 1e-4 * (0.3 * f64::from(p)).sin();
            let pulse_s: Vec<f64> = (0..count).map(at).collect();
            let angle = PulseAngle::new(pulse_s.clone(), 2.0, RATE_HZ, 1.7).unwrap();
            (Start::Pulses { angle, input_hz: hz, tacho_input_hz: 25.0, len: LEN }, pulse_s)
        };
        let by_pulses =
            [pulses(25.0, 260, -0.01), pulses(25.03, 200, 0.05), pulses(24.9, 260, 0.0), pulses(25.0, 4, 0.3)];
        for (start, pulse_s) in [even].into_iter().chain(by_pulses) {
            for blocks in [2, 77, 1250] {
                let values: Vec<f64> = (0..blocks).map(|b| 1e-3 * (0.7 * f64::from(b)).sin()).collect();
                let mut turning = Turning::new(start.clone(), LEN);
                turning.correct(&values);
                let walked: Vec<f64> = turning.angles().collect();
                assert_eq!(walked.len(), LEN);
                for (n, walked) in walked.iter().enumerate() {
                    let uncorrected = match &start {
                        Start::Even { input_hz, sample_rate_hz } => input_hz * n as f64 / sample_rate_hz,
                        Start::Pulses { input_hz, tacho_input_hz, len, .. } => {
                            let position = n as f64 * input_hz / tacho_input_hz;
                            let k = (position as usize).min(len - 2);
                            let at = |k: usize| pulses_at(&pulse_s, k as f64 / RATE_HZ) / 2.0 / 1.7;
                            let (a, b) = (at(k), at(k + 1));
                            a + (b - a) * (position - k as f64)
                        }
                    };
                    let position = (n as f64 + 0.5) * values.len() as f64 / LEN as f64 - 0.5;
                    // Some roundings of some hundred revolutions.
                    let off = (walked - uncorrected - between(&values, position)).abs();
                    assert!(off < 1e-12, "{blocks} blocks, sample {n}: {off:.1e}");
                }
                assert_eq!(turning.ends(), (walked[0], walked[LEN - 1]));
            }
        }
    }
}
