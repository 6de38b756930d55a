//! The answer: `format = "gearwatch-explanation/1"`.

use std::collections::BTreeMap;

use gearwatch_core::bench::Term;
use gearwatch_core::estimate::Estimate;
use gearwatch_core::verdict::published;
use gearwatch_sim::effects::{self, EntryPoint};
use serde::{Serialize, Serializer};

/// The value of the key `format`.
pub const FORMAT: &str = "gearwatch-explanation/1";

/// What the mismatch finder says.
#[derive(Clone, Debug)]
pub struct Explanation {
    /// Always [`FORMAT`].
    pub format: &'static str,
    /// In one word.
    pub status: Status,
    /// Most probable first.
    pub effects: Vec<NamedEffect>,
    /// Where nothing in the library accounts for the mismatch: what comes nearest, with what
    /// probability, most probable first. In JSON it stands among the effects, marked `nearest`.
    pub nearest: Vec<NamedEffect>,
    /// A law that accounts for what has no name; in JSON it stands among the effects, whose
    /// `effect` is then null.
    pub free_term: Option<FreeTerm>,
    /// Largest first.
    pub mismatch: Vec<Mismatch>,
    /// How much better the model is with the effects in it.
    pub fit: Option<Fit>,
    /// Probability that an unchanged bench misfits its reference as much as these recordings do;
    /// absent without a reference.
    pub p_null: Option<f64>,
    /// Of what has no name: the force that would account for it.
    pub latent_force: Option<LatentForce>,
    /// What to record next, and why.
    pub advice: Vec<String>,
    /// What these recordings keep from being told: settings that are missing, channels and
    /// recordings that could not be used.
    pub limits: Vec<String>,
    /// What was found on the way, in order: data, calibration, tests.
    pub steps: Vec<String>,
}

/// A force without a name, as it would account for what is left.
#[derive(Clone, Debug, Serialize)]
pub struct LatentForce {
    /// Length of its period in revolutions of the input shaft.
    pub period_rev: f64,
    /// What turns with it on this bench, and what else may.
    pub period_of: Vec<String>,
    /// Recording that the force was read from.
    pub recording: String,
    /// `N` through the simulator's response; else the unit of the sensor.
    pub unit: String,
    /// Position in the period (0 to 1).
    pub turn: Vec<f64>,
    /// Posterior mean.
    pub force: Vec<f64>,
    /// One standard deviation.
    pub sigma: Vec<f64>,
    /// Exponent of the amplitude over the torque, from recordings at one speed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub load_exponent: Option<f64>,
    /// Exponent over the speed, from recordings at one load; the path is in it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub speed_exponent: Option<f64>,
}

/// The keys of the JSON object in their order.
#[derive(Serialize)]
struct Object<'a> {
    format: &'static str,
    status: Status,
    effects: Vec<Member<'a>>,
    mismatch: &'a [Mismatch],
    #[serde(skip_serializing_if = "Option::is_none")]
    fit: Option<&'a Fit>,
    #[serde(skip_serializing_if = "Option::is_none")]
    p_null: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    latent_force: Option<&'a LatentForce>,
    advice: &'a [String],
    #[serde(skip_serializing_if = "<[String]>::is_empty")]
    limits: &'a [String],
    steps: &'a [String],
}

#[derive(Serialize)]
#[serde(untagged)]
enum Member<'a> {
    Named(&'a NamedEffect),
    Near {
        nearest: bool,
        #[serde(flatten)]
        effect: &'a NamedEffect,
    },
    Free {
        effect: Option<()>,
        #[serde(flatten)]
        term: &'a FreeTerm,
    },
}

impl Serialize for Explanation {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let named = self.effects.iter().map(Member::Named);
        let near = self.nearest.iter().map(|effect| Member::Near { nearest: true, effect });
        let free = self.free_term.iter().map(|term| Member::Free { effect: None, term });
        let object = Object {
            format: self.format,
            status: self.status,
            effects: named.chain(near).chain(free).collect(),
            mismatch: &self.mismatch,
            fit: self.fit.as_ref(),
            p_null: self.p_null,
            latent_force: self.latent_force.as_ref(),
            advice: &self.advice,
            limits: &self.limits,
            steps: &self.steps,
        };
        object.serialize(serializer)
    }
}

/// The answer in one word.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Status {
    /// No mismatch beyond noise and calibration.
    Consistent,
    /// Effects are named.
    Explained,
    /// A set of effects that these recordings cannot tell apart.
    Ambiguous,
    /// A mismatch that nothing in the library accounts for.
    Unexplained,
}

impl Status {
    /// As written in JSON.
    pub const fn code(self) -> &'static str {
        match self {
            Self::Consistent => "consistent",
            Self::Explained => "explained",
            Self::Ambiguous => "ambiguous",
            Self::Unexplained => "unexplained",
        }
    }
}

/// Effect and place.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
pub struct Candidate {
    /// Effect id.
    pub effect: String,
    /// Place.
    #[serde(rename = "where")]
    pub place: String,
}

/// A number with its sigma, as published.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Published {
    #[serde(serialize_with = "rounded")]
    value: f64,
    #[serde(serialize_with = "rounded")]
    sigma: f64,
}

impl From<Estimate> for Published {
    fn from(e: Estimate) -> Self {
        Self { value: e.value, sigma: e.sigma }
    }
}

impl Published {
    /// Best estimate.
    pub fn value(&self) -> f64 {
        self.value
    }

    /// One standard deviation.
    pub fn sigma(&self) -> f64 {
        self.sigma
    }
}

/// Kinds of evidence, each in a sentence.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Evidence {
    /// Which lines.
    #[serde(rename = "where")]
    pub place: String,
    /// How the change follows load and speed.
    pub law: String,
    /// Which sidebands and harmonics carry it.
    pub support: String,
    /// How the simulator's own signature agrees.
    pub shape: String,
}

/// Where an effect enters the equations, with the probability that this is where.
#[derive(Clone, Debug, Serialize)]
pub struct Entry {
    /// What it is.
    #[serde(serialize_with = "code")]
    pub kind: EntryPoint,
    /// Place.
    #[serde(rename = "where")]
    pub place: String,
    /// Of kind and place (0–1).
    #[serde(serialize_with = "rounded")]
    pub probability: f64,
}

impl Entry {
    /// Of an effect, its probability and what cannot be told from it. What the name leaves open is
    /// taken as shared evenly by these and by what is not in the set: those that enter at the same
    /// place speak for the entry point, though not for the name. Names of the instrument, which no
    /// simulation has, are of the data.
    pub fn of(effect: &str, place: &str, probability: f64, others: &[Candidate]) -> Self {
        let kind = |effect: &str| effects::find(effect).map_or(EntryPoint::Data, |e| e.entry_point());
        let own = kind(effect);
        let alike = others.iter().filter(|o| o.place == place && kind(&o.effect) == own).count();
        let share = alike as f64 / (others.len() + 1) as f64;
        Self { kind: own, place: place.to_owned(), probability: probability + (1.0 - probability) * share }
    }
}

fn code<S: Serializer>(kind: &EntryPoint, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(kind.code())
}

/// An effect that is named.
#[derive(Clone, Debug, Serialize)]
pub struct NamedEffect {
    /// Effect id.
    pub effect: String,
    /// Place.
    #[serde(rename = "where")]
    pub place: String,
    /// That effect and place are right (0–1).
    #[serde(serialize_with = "rounded")]
    pub probability: f64,
    /// Estimates by parameter name.
    pub parameters: BTreeMap<String, Published>,
    /// What these recordings cannot tell from it.
    pub indistinguishable_from: Vec<Candidate>,
    /// Where it enters the equations.
    pub entry_point: Entry,
    /// Why.
    pub evidence: Evidence,
}

/// A law of a spring or damper that no effect of the library has.
#[derive(Clone, Debug, Serialize)]
pub struct FreeTerm {
    /// Where it stands.
    #[serde(rename = "where")]
    pub place: String,
    /// That law and place are right (0–1), among the laws that were tried.
    #[serde(serialize_with = "rounded")]
    pub probability: f64,
    /// Its coefficient.
    pub parameters: BTreeMap<String, Published>,
    /// Where it enters the equations.
    pub entry_point: Entry,
    /// As the new bench file has it.
    pub term: Term,
}

/// A line at which recordings and model differ.
#[derive(Clone, Debug, Serialize)]
pub struct Mismatch {
    /// File name.
    pub recording: String,
    /// Sensor name.
    pub channel: String,
    /// The line in words.
    pub what: String,
    /// Order of the input shaft.
    #[serde(serialize_with = "rounded")]
    pub order: f64,
    /// (Hz).
    #[serde(serialize_with = "rounded")]
    pub frequency_hz: f64,
    /// Amplitude in the channel's unit.
    #[serde(serialize_with = "rounded")]
    pub measured: f64,
    /// Likewise.
    #[serde(serialize_with = "rounded")]
    pub modelled: f64,
    /// Of the difference, scatter of repeated recordings included.
    #[serde(serialize_with = "rounded")]
    pub sigma: f64,
    /// Difference over sigma.
    #[serde(serialize_with = "rounded")]
    pub z: f64,
    /// Share of the whole misfit.
    #[serde(serialize_with = "rounded")]
    pub share: f64,
}

/// How much better the model is.
#[derive(Clone, Debug, Serialize)]
pub struct Fit {
    /// What the figures are.
    pub metric: String,
    /// Without the effects, over the recordings that were fitted.
    #[serde(serialize_with = "rounded")]
    pub train_before: f64,
    /// With them.
    #[serde(serialize_with = "rounded")]
    pub train_after: f64,
    /// Without the effects, over recordings that were not fitted.
    #[serde(serialize_with = "rounded")]
    pub held_out_before: f64,
    /// With them.
    #[serde(serialize_with = "rounded")]
    pub held_out_after: f64,
    /// What noise and repetition alone give.
    #[serde(serialize_with = "rounded")]
    pub noise_floor: f64,
    /// Recordings that were not fitted.
    pub held_out: Vec<String>,
    /// What else was tried on the recordings that were not fitted.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub beside: Vec<Beside>,
    /// Misfit of these recordings with the same effect at a place where nothing was found, which
    /// stands in `beside` too.
    #[serde(skip)]
    pub sham: Option<f64>,
}

/// A rival of what was named, fitted and judged in the same way.
#[derive(Clone, Debug, Serialize)]
pub struct Beside {
    /// In words.
    pub what: String,
    /// Misfit of the recordings that were not fitted.
    #[serde(serialize_with = "rounded")]
    pub held_out: f64,
}

fn rounded<S: Serializer>(value: &f64, serializer: S) -> Result<S::Ok, S::Error> {
    // Six digits: more would be bits of the transform, not of the bench.
    let short: f64 = if value.is_finite() { format!("{value:.5e}").parse().unwrap_or(*value) } else { *value };
    serializer.serialize_f64(published(short))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn candidate(effect: &str, place: &str) -> Candidate {
        Candidate { effect: effect.to_owned(), place: place.to_owned() }
    }

    /// Of 0.4 that a name leaves open, three others and the unknown have 0.1 each; wear and a
    /// profile error of the same stage are geometry as relief is, friction is not, and another
    /// stage is another place.
    #[test]
    fn analytic_what_enters_alike_speaks_for_the_entry_point() {
        let others = [
            candidate("tooth_wear", "stage1"),
            candidate("tooth_friction", "stage1"),
            candidate("profile_error", "stage2"),
        ];
        let entry = Entry::of("tip_relief", "stage1", 0.6, &others);
        assert_eq!((entry.kind, entry.place.as_str()), (EntryPoint::Geometry, "stage1"));
        assert!((entry.probability - 0.7).abs() < 1e-12);
        assert_eq!(Entry::of("tip_relief", "stage1", 0.6, &[]).probability, 0.6);
        assert_eq!(Entry::of("channel_dead", "acc_1", 0.9, &[]).kind, EntryPoint::Data);
    }
}
