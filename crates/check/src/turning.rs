//! The angle of a shaft through a recording: from tacho pulses or an even speed, with what the mesh
//! lines correct.

/// The angle of a shaft through a recording, worked out where it is asked for: written down it
/// would take as much memory as a channel of the recording, or two.
#[derive(Clone, Debug)]
pub struct Turning {
    start: Start,
    /// At the middles of blocks, one set after the other.
    pub(crate) corrections: Vec<Vec<f64>>,
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
        Self { start, corrections: Vec::new(), len }
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
        (self.from(0).next().unwrap_or(0.0), self.from(self.len.saturating_sub(1)).next().unwrap_or(0.0))
    }

    /// Angle at each sample in turn (revolutions).
    pub fn angles(&self) -> impl Iterator<Item = f64> + '_ {
        self.from(0)
    }

    fn from(&self, sample: usize) -> impl Iterator<Item = f64> + '_ {
        let mut pulses = [0, 0];
        (sample..self.len).map(move |n| {
            let mut angle = match &self.start {
                Start::Even { input_hz, sample_rate_hz } => input_hz * n as f64 / sample_rate_hz,
                Start::Pulses { angle, input_hz, tacho_input_hz, len } => {
                    // Where the sample clock is off, sample `n` was not taken at `n` steps of the
                    // tacho's time.
                    let position = n as f64 * input_hz / tacho_input_hz;
                    let k = (position as usize).min(len - 2);
                    let (a, b) = (angle.at(k, &mut pulses[0]), angle.at(k + 1, &mut pulses[1]));
                    a + (b - a) * (position - k as f64)
                }
            };
            for correction in &self.corrections {
                angle += between(correction, (n as f64 + 0.5) * correction.len() as f64 / self.len as f64 - 0.5);
            }
            angle
        })
    }
}

/// Angle of a shaft from its pulses: cubic through the pulse times, straight on beyond the ends.
#[derive(Clone, Debug)]
pub struct PulseAngle {
    /// Seconds after the first sample.
    pulse_s: Vec<f64>,
    pulses_per_rev: f64,
    sample_rate_hz: f64,
    /// Revolutions of that shaft in one of the shaft that is asked for.
    order: f64,
}

impl PulseAngle {
    /// Of a shaft that turns `order` times as fast as the one whose angle is wanted. `None` with
    /// fewer than four pulses.
    pub fn new(pulse_s: Vec<f64>, pulses_per_rev: f64, sample_rate_hz: f64, order: f64) -> Option<Self> {
        (pulse_s.len() >= 4).then_some(Self { pulse_s, pulses_per_rev, sample_rate_hz, order })
    }

    /// Angle at a sample (revolutions); `pulse` is one before it, from which the next is sought,
    /// 0 to begin with.
    pub fn at(&self, sample: usize, pulse: &mut usize) -> f64 {
        let (pulse_s, n) = (&self.pulse_s, self.pulse_s.len());
        let slope = |i: usize| {
            // Three-point slope in pulses per second (Catmull–Rom on uneven steps).
            let (a, b) = (i.saturating_sub(1), (i + 1).min(n - 1));
            (b - a) as f64 / (pulse_s[b] - pulse_s[a])
        };
        let t = sample as f64 / self.sample_rate_hz;
        while *pulse + 2 < n && pulse_s[*pulse + 1] <= t {
            *pulse += 1;
        }
        let at = *pulse;
        let (t0, t1) = (pulse_s[at], pulse_s[at + 1]);
        let pulses = if t <= pulse_s[0] {
            slope(0) * (t - pulse_s[0])
        } else if t >= pulse_s[n - 1] {
            (n - 1) as f64 + slope(n - 1) * (t - pulse_s[n - 1])
        } else {
            let h = t1 - t0;
            let u = (t - t0) / h;
            let (m0, m1) = (slope(at) * h, slope(at + 1) * h);
            let (u2, u3) = (u * u, u * u * u);
            at as f64 * (2.0 * u3 - 3.0 * u2 + 1.0)
                + m0 * (u3 - 2.0 * u2 + u)
                + (at + 1) as f64 * (-2.0 * u3 + 3.0 * u2)
                + m1 * (u3 - u2)
        };
        pulses / self.pulses_per_rev / self.order
    }
}

/// Value between the middles of blocks: cubic through four (Catmull–Rom), straight on beyond the
/// ends.
pub(crate) fn between(values: &[f64], position: f64) -> f64 {
    let last = values.len() - 2;
    let k = (position.max(0.0) as usize).min(last);
    let t = position - k as f64;
    let (b, c) = (values[k], values[k + 1]);
    if k == 0 || k == last {
        return b + (c - b) * t;
    }
    let (a, d) = (values[k - 1], values[k + 2]);
    b + 0.5 * t * (c - a + t * (2.0 * a - 5.0 * b + 4.0 * c - d + t * (3.0 * (b - c) + d - a)))
}
