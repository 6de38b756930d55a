//! Which tooth pairs are near contact at a phase, how stiff each is, and how far it is from
//! touching.

use std::f64::consts::TAU;

use gearwatch_core::bench::term::Harmonic;

use super::tables::ToothTable;
use super::{CORNER_REACH, LoadPoint, MeshModel, MeshState, Pair, Pairs};
use crate::faults::GearModifications;
use crate::geometry::GearGeometry;
use crate::hertz::Hertz;
use crate::terms::series;

/// Least factor on the stiffness of the pairs: several terms together must not turn the teeth
/// inside out.
const LEAST_STIFFNESS: f64 = 0.02;

impl MeshModel {
    /// Pairs in contact or near it at mesh phase `phase` under a mesh force of about `load_n` (N).
    pub fn pairs(&self, phase: f64, load_n: f64, out: &mut Pairs) {
        self.pairs_at(&MeshState { phase, displacement_m: [0.0; 2] }, &self.at_load(load_n), out);
    }

    /// As [`Self::pairs`], for a prepared load and displaced axes.
    #[inline(always)]
    pub fn pairs_at(&self, state: &MeshState, load: &LoadPoint, out: &mut Pairs) {
        self.collect(state, 0.0, load, self.reach(), out);
    }

    /// As [`Self::pairs_at`] in a slice of the face whose pairs enter `lag` mesh cycles later. Both
    /// gears stand as `state` says.
    pub(crate) fn pairs_behind(&self, state: &MeshState, lag: f64, load: &LoadPoint, out: &mut Pairs) {
        self.collect(state, lag, load, self.reach(), out);
    }

    /// How far outside their path pairs are looked for (mesh cycles).
    #[inline(always)]
    pub(super) fn reach(&self) -> f64 {
        if self.options.corner_contact { CORNER_REACH } else { 0.0 }
    }

    #[inline(always)]
    fn collect(&self, state: &MeshState, lag: f64, load: &LoadPoint, reach: f64, out: &mut Pairs) {
        let shift = self.shift(state);
        out.clear();
        out.coupling = self.coupling;
        let common = self.profile_gap_m(state.phase - lag) + self.wave_gap_m(state.phase) + shift.gap_m;
        let softer = 1.0 / self.stiffness_at(state.phase);
        let at = state.phase - lag + shift.pinion;
        let mut index = (at + reach).floor();
        while at - index <= self.geometry.contact_ratio + reach {
            let s = at - index;
            let n = index;
            let pinion_tooth = tooth(n, self.pinion_turns) as u32;
            let wheel_tooth = tooth(n, self.wheel_turns) as u32;
            index -= 1.0;
            let (pinion, pinion_error) = self.pinion.drive(pinion_tooth);
            let (wheel, wheel_error) = self.wheel.drive(wheel_tooth);
            let Some(pair) = out.next() else { break };
            pair.index = n as i64;
            pair.pinion_tooth = pinion_tooth;
            pair.wheel_tooth = wheel_tooth;
            [pair.pinion_roll_m, pair.wheel_roll_m] = self.geometry.rolls_m(s);
            let deviation = common + pinion_error + wheel_error + self.alternating_gap_m(n);
            let touches = self.pair(s, s - shift.wheel, [pinion, wheel], deviation, (load, reach), pair);
            pair.compliance_m_per_n *= softer;
            pair.foundation_m_per_n *= softer;
            out.keep(touches);
        }
        out.under_load(load);
    }

    /// As [`Self::pairs`] for the back flanks, which touch when the wheel drives the pinion: their
    /// approach is `−δ − backlash`. The back flanks carry healthy teeth's stiffness unless a tooth
    /// is broken, and no deviations.
    ///
    /// A mirror maps them to driving flanks that run backwards, `u ↦ 2 s_P + τ − u`: τ is the
    /// thickness of the pinion's teeth on the pitch circle by the pitch, half without profile
    /// shift.
    pub fn back_pairs(&self, phase: f64, load: &LoadPoint, out: &mut Pairs) {
        out.clear();
        out.coupling = self.coupling;
        let at = 2.0 * self.geometry.pitch_phase() + self.geometry.pinion_thickness - phase;
        let reach = self.reach();
        let mut index = (at + reach).floor();
        while at - index <= self.geometry.contact_ratio + reach {
            let s = at - index;
            let n = -index;
            index -= 1.0;
            let pinion_tooth = tooth(n, self.pinion_turns) as u32;
            let wheel_tooth = tooth(n + 1.0, self.wheel_turns) as u32;
            let (pinion, wheel) = (self.pinion.back(pinion_tooth), self.wheel.back(wheel_tooth));
            let Some(pair) = out.next() else { break };
            pair.index = n as i64;
            pair.pinion_tooth = pinion_tooth;
            pair.wheel_tooth = wheel_tooth;
            [pair.pinion_roll_m, pair.wheel_roll_m] = self.geometry.rolls_m(s);
            let touches = self.pair(s, s, [pinion, wheel], 0.0, (load, reach), pair);
            out.keep(touches);
        }
        out.under_load(load);
    }

    /// Compliance and gap, `deviation_m` included, of the pair at pinion position s₁ and wheel
    /// position s₂; false where it cannot touch.
    #[inline(always)]
    pub(super) fn pair(
        &self,
        s1: f64,
        s2: f64,
        [pinion, wheel]: [&ToothTable; 2],
        deviation_m: f64,
        (load, reach): (&LoadPoint, f64),
        out: &mut Pair,
    ) -> bool {
        let (a, b) = (pinion.at(s1), wheel.at(s2));
        let alone = {
            // Inside the single zone a pair carries all of the load.
            let inside = (s1 - (self.geometry.contact_ratio - 1.0)).min(1.0 - s1);
            if load.blend > 0.0 {
                let part = (0.5 + inside * load.half_per_blend).clamp(0.0, 1.0);
                part * part * (3.0 - 2.0 * part)
            } else {
                f64::from(u8::from(inside >= 0.0))
            }
        };
        let mut hertz = load.hertz_shared + alone * (load.hertz_alone - load.hertz_shared);
        let lost = a.lost + b.lost;
        if lost > 0.0 {
            hertz *= self.shortened(lost);
        }
        out.compliance_m_per_n = (a.compliance + b.compliance + hertz) * load.factor;
        out.foundation_m_per_n = (a.foundation + b.foundation) * load.factor;
        out.gap_m = a.gap + b.gap + deviation_m;
        pinion.can_touch(s1, reach) & wheel.can_touch(s2, reach)
    }

    /// Factor on the contact compliance where a part of the contact line is missing.
    #[cold]
    fn shortened(&self, lost: f64) -> f64 {
        let length = (1.0 - lost).clamp(0.001, 1.0);
        match self.options.hertz {
            Hertz::Linear => 1.0 / length,
            Hertz::LoadDependent => length.powf(-self.options.hertz.length_exponent()),
        }
    }

    /// Teeth of pinion and wheel with damage of their own.
    pub(super) fn special_teeth(&self) -> [Vec<bool>; 2] {
        let of = |gear: &GearModifications, teeth: u32| (0..teeth).map(|t| gear.teeth.contains_key(&t)).collect();
        let [pinion, wheel] = self.tooth_counts();
        [of(&self.modifications.pinion, pinion), of(&self.modifications.wheel, wheel)]
    }

    /// Of pinion and wheel.
    pub(super) fn tooth_counts(&self) -> [u32; 2] {
        [self.geometry.pinion.teeth, self.geometry.wheel.teeth]
    }

    /// All pairs but those of damaged teeth are alike, and nothing turns with a gear: beside the
    /// damage the law of the teeth repeats with the mesh cycle.
    pub(super) fn repeats_with_the_mesh(&self) -> bool {
        self.modifications.repeat_with_the_mesh()
    }

    /// Profile error (m) at a phase, by mesh harmonic, and what all flanks stand back.
    #[inline(always)]
    pub(super) fn profile_gap_m(&self, phase: f64) -> f64 {
        let mut gap = self.modifications.pair.offset_m;
        if !self.profile_error.is_empty() {
            let since_pitch = phase - self.geometry.pitch_phase();
            // cos(h β + φ) by powers of e^{iβ}: one sine and cosine serve all harmonics.
            let (sin, cos) = (TAU * (since_pitch - since_pitch.floor())).sin_cos();
            let (mut re, mut im) = (cos, sin);
            for &[in_phase, quadrature] in &self.profile_error {
                gap += in_phase * re - quadrature * im;
                (re, im) = (re * cos - im * sin, re * sin + im * cos);
            }
        }
        gap
    }

    /// Part (m) of pair n in the alternation of the pairs.
    #[inline(always)]
    pub(super) fn alternating_gap_m(&self, n: f64) -> f64 {
        let half = 0.5 * n;
        self.modifications.pair.alternating_m * (2.0 * (half - half.floor()) - 0.5)
    }

    /// Waves (m) at a phase, by revolution of either gear.
    #[inline(always)]
    pub(super) fn wave_gap_m(&self, phase: f64) -> f64 {
        let mut gap = 0.0;
        for (gear, z) in [
            (&self.modifications.pinion, self.geometry.pinion.teeth),
            (&self.modifications.wheel, self.geometry.wheel.teeth),
        ] {
            for wave in &gear.waves {
                let turns = phase / f64::from(z);
                let turns = turns - turns.floor();
                gap += wave.amplitude_m * (TAU * wave.order * turns + wave.phase_rad).cos();
            }
        }
        gap
    }

    /// Factor on the stiffness of all pairs at a phase.
    #[inline(always)]
    pub(super) fn stiffness_at(&self, phase: f64) -> f64 {
        if self.varies { self.stiffness_waves(phase) } else { 1.0 }
    }

    #[inline(never)]
    fn stiffness_waves(&self, phase: f64) -> f64 {
        let (pinion, wheel) = (&self.modifications.pinion, &self.modifications.wheel);
        let pair = &self.modifications.pair.stiffness_waves;
        let of = |waves: &[Harmonic], turns: f64| series(waves, TAU * turns);
        let z = |gear: &GearGeometry| f64::from(gear.teeth);
        let sum = of(pair, phase - self.geometry.pitch_phase())
            + of(&pinion.stiffness_waves, phase / z(&self.geometry.pinion))
            + of(&wheel.stiffness_waves, phase / z(&self.geometry.wheel));
        (1.0 + sum).max(LEAST_STIFFNESS)
    }

    /// Smallest phase beyond that of `state` at which a pair nominally enters or leaves (a broken
    /// tooth has its own places). With corner contact the force is continuous there; without it the
    /// stiffness jumps.
    pub fn next_event(&self, state: &MeshState) -> f64 {
        let phase = state.phase;
        let mut next = f64::INFINITY;
        let newest = phase.floor() as i64 + 1;
        for n in newest - 4..=newest {
            let (pinion, _) = self.pinion.drive(tooth(n as f64, self.pinion_turns) as u32);
            let (wheel, _) = self.wheel.drive(tooth(n as f64, self.wheel_turns) as u32);
            for (place, on_wheel) in [(wheel.first, true), (pinion.last, false)] {
                if pinion.is_gone() || wheel.is_gone() {
                    continue;
                }
                let mut event = n as f64 + place;
                for _ in 0..2 {
                    let shift = self.shift(&MeshState { phase: event, ..*state });
                    event = n as f64 + place - shift.pinion + if on_wheel { shift.wheel } else { 0.0 };
                }
                if event > phase && event < next {
                    next = event;
                }
            }
        }
        next
    }

    /// Static approach (m) under `load_n` at a phase, the static transmission error, and the
    /// tangent stiffness (N/m) there. Infinite approach and no stiffness where no pair can touch.
    pub fn static_point(&self, phase: f64, load: &LoadPoint) -> (f64, f64) {
        let mut pairs = Pairs::default();
        self.pairs_at(&MeshState { phase, displacement_m: [0.0; 2] }, load, &mut pairs);
        pairs.approach_at(load.load_n).unwrap_or((f64::INFINITY, 0.0))
    }

    /// Stiffness (N/m) of the pairs inside their path taken together, whatever the load, deviations
    /// and corner contact: the k(t) of the literature.
    pub fn stiffness_n_per_m(&self, phase: f64, load: &LoadPoint) -> f64 {
        let mut pairs = Pairs::default();
        let state = MeshState { phase, displacement_m: [0.0; 2] };
        self.collect(&state, 0.0, load, 0.0, &mut pairs);
        pairs.force(1.0).stiffness_n_per_m
    }
}

/// Number of teeth, and turns per tooth.
#[derive(Clone, Copy, Debug)]
pub(super) struct Turns {
    teeth: f64,
    per_tooth: f64,
}

impl Turns {
    pub(super) fn new(teeth: u32) -> Self {
        Self { teeth: f64::from(teeth), per_tooth: 1.0 / f64::from(teeth) }
    }
}

/// Tooth number of pair n, a whole number of any size below 2⁵⁰: n mod z without a division.
#[inline(always)]
pub(super) fn tooth(n: f64, turns: Turns) -> usize {
    // Half a tooth up, so that rounding of the quotient cannot reach the next turn.
    let turn = ((n + 0.5) * turns.per_tooth).floor();
    (n - turn * turns.teeth) as i32 as usize
}
