//! Free-form terms: physics that a bench has beyond its nominal model, where no effect has a name
//! for it.
//!
//! A term stands at an entry point of the equations of motion. It is a Fourier series over an
//! angle, a law of one spring or damper, or a filter of one channel. [`Term::resolve`] checks one
//! against a bench and says what it means there.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::Bench;

mod problem;

pub use problem::{TermError, TermProblem};

/// A `[[term]]` of the bench file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Term {
    /// What it is: one of [`Expression`] by its text.
    pub expression: String,
    /// Where it enters, such as `stage1.pinion`, `input.bearing`, `belt`, `acc_1`.
    pub place: String,
    /// Coefficients by name; the unit is the end of the name.
    #[serde(default)]
    pub parameters: BTreeMap<String, f64>,
    /// The term goes with the brake torque to this power, about the bench's own torque (1 N m where
    /// that is 0).
    #[serde(default)]
    pub load_exponent: f64,
    /// The term goes with the motor's speed to this power, about the bench's own speed.
    #[serde(default)]
    pub speed_exponent: f64,
}

/// What a term is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Expression {
    /// Geometry error over the turn of a gear, or over the mesh cycle (m, positive is missing
    /// material).
    Geometry,
    /// Relative stiffness over the turn of a gear, or over the mesh cycle.
    Stiffness,
    /// Torque over the turn of motor, shaft or brake.
    Torque,
    /// Force on the bearings of a shaft over its turn.
    Force,
    /// Law of a spring or damper.
    Spring(SpringLaw),
    /// Modes of the path to one sensor.
    ModalFilter,
}

/// Law of a spring or damper: its force against the deflection u and its rate v, per unit of the
/// coefficient.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SpringLaw {
    /// `u`
    Linear,
    /// `u²`, along one line
    Square,
    /// `|u| u`
    SignedSquare,
    /// `u³`
    Cube,
    /// `v`
    Rate,
    /// `|v| v`
    SignedSquareRate,
    /// `sgn v`
    SignRate,
    /// a further spring beyond a dead zone
    DeadZone,
    /// the place's own spring and damper act beyond a clearance only
    Clearance,
}

impl Expression {
    /// All of them.
    pub const ALL: [Self; 14] = [
        Self::Geometry,
        Self::Stiffness,
        Self::Torque,
        Self::Force,
        Self::Spring(SpringLaw::Linear),
        Self::Spring(SpringLaw::Square),
        Self::Spring(SpringLaw::SignedSquare),
        Self::Spring(SpringLaw::Cube),
        Self::Spring(SpringLaw::Rate),
        Self::Spring(SpringLaw::SignedSquareRate),
        Self::Spring(SpringLaw::SignRate),
        Self::Spring(SpringLaw::DeadZone),
        Self::Spring(SpringLaw::Clearance),
        Self::ModalFilter,
    ];

    /// Its text in the bench file.
    pub const fn text(self) -> &'static str {
        match self {
            Self::Geometry => "e(theta)",
            Self::Stiffness => "k(theta)",
            Self::Torque => "torque(theta)",
            Self::Force => "force(theta)",
            Self::Spring(law) => match law {
                SpringLaw::Linear => "u",
                SpringLaw::Square => "u^2",
                SpringLaw::SignedSquare => "|u|u",
                SpringLaw::Cube => "u^3",
                SpringLaw::Rate => "v",
                SpringLaw::SignedSquareRate => "|v|v",
                SpringLaw::SignRate => "sgn(v)",
                SpringLaw::DeadZone => "dead_zone(u)",
                SpringLaw::Clearance => "clearance(u)",
            },
            Self::ModalFilter => "modal_filter",
        }
    }

    /// The expression with a text.
    pub fn parse(text: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|expression| expression.text() == text)
    }
}

impl SpringLaw {
    /// Name, unit and largest size of the coefficient: at a spring or damper along a line, or at
    /// one in torsion. `None` for [`Self::Clearance`], whose spring and damper are those of the
    /// place.
    ///
    /// The largest sizes give some 1e7 N at 10 µm or 0.1 m/s, and some 1e5 N m at 1 mrad or 1
    /// rad/s: more than any bench bears.
    pub const fn coefficient(self, torsion: bool) -> Option<(&'static str, &'static str, f64)> {
        let (along, about) = match self {
            Self::Linear | Self::DeadZone => (("n_per_m", "N/m", 1e12), ("nm_per_rad", "N m/rad", 1e8)),
            Self::Square | Self::SignedSquare => (("n_per_m2", "N/m²", 1e17), ("nm_per_rad2", "N m/rad²", 1e11)),
            Self::Cube => (("n_per_m3", "N/m³", 1e22), ("nm_per_rad3", "N m/rad³", 1e14)),
            Self::Rate => (("n_s_per_m", "N s/m", 1e8), ("nm_s_per_rad", "N m s/rad", 1e5)),
            Self::SignedSquareRate => (("n_s2_per_m2", "N s²/m²", 1e9), ("nm_s2_per_rad2", "N m s²/rad²", 1e5)),
            Self::SignRate => (("n", "N", 1e6), ("nm", "N m", 1e5)),
            Self::Clearance => return None,
        };
        Some(if torsion { about } else { along })
    }
}

/// One harmonic of a series: `cos · cos(order θ) + sin · sin(order θ)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Harmonic {
    /// Periods per turn of the gear or shaft, or per mesh cycle.
    pub order: f64,
    /// Amplitude of the cosine.
    pub cos: f64,
    /// Amplitude of the sine.
    pub sin: f64,
}

/// A mesh, or one of its gears.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Flanks {
    /// Over the mesh cycle of a stage.
    Mesh(usize),
    /// Over the turn of a gear of a stage.
    Gear {
        /// Index of the stage.
        stage: usize,
        /// The driven one.
        wheel: bool,
    },
}

/// What turns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Turning {
    /// The motor's rotor.
    Motor,
    /// A shaft, by index; half of the torque acts at either end.
    Shaft(usize),
    /// The driving end of the last shaft.
    Brake,
}

/// A spring with its damper.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Spring {
    /// Of each gear of a shaft against its bearing.
    Bearing(usize),
    /// Between the ends of a shaft.
    Torsion(usize),
    /// Between motor and first shaft.
    Belt,
    /// Tooth approach of a stage, while teeth touch.
    Mesh(usize),
    /// One mode of the housing, or all of them.
    Housing(Option<usize>),
}

impl Spring {
    /// It is a spring in torsion.
    pub const fn is_torsion(self) -> bool {
        matches!(self, Self::Torsion(_) | Self::Belt)
    }
}

/// How the size of a term follows time, beside load and speed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Growth {
    /// Time constant (s) with which it comes up from nothing; 0 where it is there from the start.
    pub rise_s: f64,
    /// Temperatures (°C) at which it is absent and at full size, linear between and beyond; `None`
    /// for any temperature.
    pub between_c: Option<[f64; 2]>,
}

/// One mode of a path: `gain (f/f₀)² / (1 − (f/f₀)² + 2 i ζ f/f₀)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathMode {
    /// Natural frequency f₀ (Hz).
    pub frequency_hz: f64,
    /// Fraction of critical ζ.
    pub damping_ratio: f64,
    /// Share of the mode.
    pub gain: f64,
}

/// Where a term enters the equations, and what it is there.
#[derive(Clone, Debug, PartialEq)]
pub enum Entry {
    /// Σ (m) on the flanks; positive is missing material.
    Geometry(Flanks, Vec<Harmonic>),
    /// The stiffness of the tooth pairs times 1 + Σ.
    Stiffness(Flanks, Vec<Harmonic>),
    /// Σ (N m), positive in the sense of rotation.
    Torque(Turning, Vec<Harmonic>),
    /// Σ (N) on a shaft, shared by the bearings of its gears, in a fixed direction.
    Force {
        /// Index of the shaft.
        shaft: usize,
        /// From +x, counter-clockwise seen from the motor (rad).
        direction_rad: f64,
        /// Over the turn of the shaft.
        harmonics: Vec<Harmonic>,
    },
    /// A law of a spring or damper.
    Spring {
        /// Which.
        at: Spring,
        /// Its form.
        law: SpringLaw,
        /// Its size, in SI units.
        coefficient: f64,
        /// Half width of the dead zone or clearance (m or rad).
        gap: f64,
        /// Rate (m/s or rad/s) at which `sgn v` is rounded off: `v/√(v² + corner²)`.
        corner: f64,
        /// At a bearing: along this line only (rad); in all directions alike where `None`.
        direction_rad: Option<f64>,
        /// How it follows time.
        growth: Growth,
    },
    /// The path to a sensor times `direct + Σ modes`.
    Path {
        /// Index of the sensor.
        sensor: usize,
        /// What goes past the modes.
        direct: f64,
        /// The modes.
        modes: Vec<PathMode>,
    },
}

/// A term that was checked against its bench.
#[derive(Clone, Debug, PartialEq)]
pub struct ResolvedTerm {
    /// What it is.
    pub entry: Entry,
    /// Power of the brake torque.
    pub load_exponent: f64,
    /// Power of the speed.
    pub speed_exponent: f64,
}

/// Largest power of load or speed.
pub const LARGEST_EXPONENT: f64 = 4.0;
/// Most harmonics of a series and modes of a filter.
pub const MOST_PARTS: usize = 256;
/// Where `sgn v` is rounded off unless the term says otherwise (m/s or rad/s).
const CORNER: f64 = 1e-3;

impl Term {
    /// A series over an angle of `(order, cosine, sine)`.
    pub fn series(expression: Expression, place: &str, harmonics: &[Harmonic]) -> Self {
        let suffix = series_suffix(expression).unwrap_or_default();
        let parameters = harmonics
            .iter()
            .flat_map(|h| [(format!("cos_{}{suffix}", h.order), h.cos), (format!("sin_{}{suffix}", h.order), h.sin)]);
        Self::new(expression, place, parameters)
    }

    /// A law of a spring or damper; `place` is one of [`spring_places`].
    pub fn spring(law: SpringLaw, place: &str, coefficient: f64) -> Self {
        let torsion = place == "belt" || place.ends_with(".torsion");
        let name = law.coefficient(torsion).map(|(name, _, _)| (name.to_owned(), coefficient));
        Self::new(Expression::Spring(law), place, name)
    }

    /// A filter of one mode and what goes past it.
    pub fn modal_filter(sensor: &str, direct: f64, modes: &[PathMode]) -> Self {
        let of_mode = |(i, mode): (usize, &PathMode)| {
            let n = i + 1;
            [
                (format!("frequency_{n}_hz"), mode.frequency_hz),
                (format!("damping_ratio_{n}"), mode.damping_ratio),
                (format!("gain_{n}"), mode.gain),
            ]
        };
        let parameters = modes.iter().enumerate().flat_map(of_mode).chain([("direct".to_owned(), direct)]);
        Self::new(Expression::ModalFilter, sensor, parameters)
    }

    fn new(expression: Expression, place: &str, parameters: impl IntoIterator<Item = (String, f64)>) -> Self {
        Self {
            expression: expression.text().to_owned(),
            place: place.to_owned(),
            parameters: parameters.into_iter().collect(),
            load_exponent: 0.0,
            speed_exponent: 0.0,
        }
    }

    /// What the term means on a bench.
    ///
    /// # Errors
    /// A sentence that says what is wrong and what would be right.
    pub fn resolve(&self, bench: &Bench) -> Result<ResolvedTerm, TermError> {
        let Some(expression) = Expression::parse(&self.expression) else {
            let known = Expression::ALL.map(|e| format!("{:?}", e.text())).join(", ");
            return Err(self.wrong(TermProblem::Expression { found: self.expression.clone(), known }));
        };
        for (name, value) in [("load_exponent", self.load_exponent), ("speed_exponent", self.speed_exponent)] {
            self.within(name, value, -LARGEST_EXPONENT, LARGEST_EXPONENT, "")?;
        }
        let entry = match expression {
            Expression::Geometry => Entry::Geometry(self.flanks(bench)?, self.harmonics("_m", 1e-3, "m", &[])?),
            Expression::Stiffness => {
                let harmonics = self.harmonics("", 0.9, "", &[])?;
                let sum: f64 = harmonics.iter().map(|h| h.cos.hypot(h.sin)).sum();
                if sum > 0.9 {
                    return Err(self.unfit(format!(
                        "the amplitudes sum up to {sum}; expected at most 0.9, so that the stiffness stays above 0"
                    )));
                }
                Entry::Stiffness(self.flanks(bench)?, harmonics)
            }
            Expression::Torque => Entry::Torque(self.turning(bench)?, self.harmonics("_nm", 1e5, "N m", &[])?),
            Expression::Force => Entry::Force {
                shaft: self.shaft(bench, &self.place)?,
                direction_rad: self.value("direction_deg", 0.0, -360.0, 360.0, "degrees")?.to_radians(),
                harmonics: self.harmonics("_n", 1e6, "N", &["direction_deg"])?,
            },
            Expression::Spring(law) => self.resolve_spring(law, bench)?,
            Expression::ModalFilter => self.resolve_filter(bench)?,
        };
        if matches!(entry, Entry::Path { .. }) && (self.load_exponent != 0.0 || self.speed_exponent != 0.0) {
            return Err(self.unfit("a path is the same at any load and speed; leave both exponents at 0"));
        }
        Ok(ResolvedTerm { entry, load_exponent: self.load_exponent, speed_exponent: self.speed_exponent })
    }

    fn resolve_spring(&self, law: SpringLaw, bench: &Bench) -> Result<Entry, TermError> {
        let at = self.spring_at(bench)?;
        let mut known = vec!["rise_s", "from_c", "to_c"];
        let coefficient = match law.coefficient(at.is_torsion()) {
            Some((name, unit, most)) => {
                known.push(name);
                let value = self.parameters.get(name).copied();
                let value = value.ok_or_else(|| self.wrong(TermProblem::Missing { name, unit }))?;
                self.within(name, value, -most, most, unit)?
            }
            None => 1.0,
        };
        let mut gap = 0.0;
        if matches!(law, SpringLaw::DeadZone | SpringLaw::Clearance) {
            let (name, unit, most) = if at.is_torsion() { ("gap_rad", "rad", 0.5) } else { ("gap_m", "m", 5e-3) };
            known.push(name);
            let value = self.parameters.get(name).copied();
            let value = value.ok_or_else(|| self.wrong(TermProblem::Missing { name, unit }))?;
            gap = self.within(name, value, 0.0, most, unit)?;
        }
        let mut corner = 0.0;
        if law == SpringLaw::SignRate {
            let (name, unit) = if at.is_torsion() { ("corner_rad_per_s", "rad/s") } else { ("corner_m_per_s", "m/s") };
            known.push(name);
            corner = self.value(name, CORNER, 1e-6, 1.0, unit)?;
        }
        let mut direction_rad = None;
        if matches!(at, Spring::Bearing(_)) {
            known.push("direction_deg");
            if self.parameters.contains_key("direction_deg") {
                direction_rad = Some(self.value("direction_deg", 0.0, -360.0, 360.0, "degrees")?.to_radians());
            } else if law == SpringLaw::Square {
                return Err(self.unfit("u^2 at a bearing acts along one line; give its direction_deg"));
            }
        }
        if law == SpringLaw::Clearance && matches!(at, Spring::Mesh(_)) {
            return Err(self.unfit("the clearance of a mesh is the key backlash_um of its [[stage]]"));
        }
        let between_c = match (self.parameters.get("from_c"), self.parameters.get("to_c")) {
            (None, None) => None,
            (Some(&from), Some(&to)) => {
                self.within("from_c", from, -273.0, 1000.0, "°C")?;
                self.within("to_c", to, -273.0, 1000.0, "°C")?;
                if (to - from).abs() < 1e-3 {
                    return Err(self.unfit(format!("from_c and to_c are both {from} °C; they must differ")));
                }
                Some([from, to])
            }
            _ => return Err(self.unfit("from_c and to_c go together: absent at the one, full at the other")),
        };
        let growth = Growth { rise_s: self.value("rise_s", 0.0, 0.0, 1e7, "s")?, between_c };
        self.only_known(&known)?;
        Ok(Entry::Spring { at, law, coefficient, gap, corner, direction_rad, growth })
    }

    fn resolve_filter(&self, bench: &Bench) -> Result<Entry, TermError> {
        let sensor = bench.sensors.iter().position(|s| s.name == self.place);
        let sensor = sensor.ok_or_else(|| self.wrong(self.no_place(bench.sensors.iter().map(|s| s.name.clone()))))?;
        let mut known = vec!["direct".to_owned()];
        let mut modes = Vec::new();
        for n in 1..=MOST_PARTS {
            let names = [format!("frequency_{n}_hz"), format!("damping_ratio_{n}"), format!("gain_{n}")];
            if !self.parameters.contains_key(&names[0]) {
                break;
            }
            modes.push(PathMode {
                frequency_hz: self.value(&names[0], 0.0, 1e-3, 1e6, "Hz")?,
                damping_ratio: self.value(&names[1], 0.05, 1e-5, 0.999, "")?,
                gain: self.value(&names[2], 1.0, -1e4, 1e4, "")?,
            });
            known.extend(names);
        }
        let direct = self.value("direct", 1.0, -1e4, 1e4, "")?;
        let known: Vec<&str> = known.iter().map(String::as_str).collect();
        self.only_known(&known)?;
        if modes.is_empty() {
            return Err(self.unfit("there is no mode; give frequency_1_hz, damping_ratio_1 and gain_1"));
        }
        Ok(Entry::Path { sensor, direct, modes })
    }

    /// The harmonics among the parameters `cos_<order><suffix>` and `sin_<order><suffix>`.
    fn harmonics(
        &self,
        suffix: &'static str,
        most: f64,
        unit: &'static str,
        beside: &[&str],
    ) -> Result<Vec<Harmonic>, TermError> {
        let mut out: Vec<Harmonic> = Vec::new();
        for (name, &value) in &self.parameters {
            if beside.contains(&name.as_str()) {
                continue;
            }
            let sine = name.starts_with("sin_");
            let order = name.strip_prefix("cos_").or_else(|| name.strip_prefix("sin_"));
            let order = order.and_then(|rest| rest.strip_suffix(suffix)).and_then(|order| order.parse::<f64>().ok());
            let Some(order) = order.filter(|order| order.is_finite()) else {
                return Err(self.wrong(TermProblem::NoCoefficient { name: name.clone(), suffix }));
            };
            self.within("the order", order, 1e-3, 1e4, "")?;
            self.within(name, value, -most, most, unit)?;
            let at = out.iter().position(|h| h.order == order).unwrap_or_else(|| {
                out.push(Harmonic { order, cos: 0.0, sin: 0.0 });
                out.len() - 1
            });
            *(if sine { &mut out[at].sin } else { &mut out[at].cos }) += value;
        }
        if out.is_empty() || out.len() > MOST_PARTS {
            return Err(self.unfit(format!("the series has {} harmonics; expected 1 to {MOST_PARTS}", out.len())));
        }
        out.sort_by(|a, b| a.order.total_cmp(&b.order));
        Ok(out)
    }

    fn flanks(&self, bench: &Bench) -> Result<Flanks, TermError> {
        let mut known = Vec::new();
        for (stage, spec) in bench.stages.iter().enumerate() {
            if self.place == spec.name {
                return Ok(Flanks::Mesh(stage));
            }
            let [first, second] = spec.gear_names();
            for (wheel, which) in [(false, first), (true, second)] {
                if self.place == format!("{}.{which}", spec.name) {
                    return Ok(Flanks::Gear { stage, wheel });
                }
            }
            known.push(spec.name.clone());
            known.extend(spec.gear_names().map(|gear| format!("{}.{gear}", spec.name)));
        }
        Err(self.wrong(self.no_place(known.into_iter())))
    }

    fn turning(&self, bench: &Bench) -> Result<Turning, TermError> {
        match self.place.as_str() {
            "motor" => Ok(Turning::Motor),
            "brake" => Ok(Turning::Brake),
            name => match bench.shafts.iter().position(|shaft| shaft.name == name) {
                Some(shaft) => Ok(Turning::Shaft(shaft)),
                None => {
                    let shafts = bench.shafts.iter().map(|s| s.name.clone());
                    Err(self.wrong(self.no_place(["motor".to_owned(), "brake".to_owned()].into_iter().chain(shafts))))
                }
            },
        }
    }

    fn shaft(&self, bench: &Bench, name: &str) -> Result<usize, TermError> {
        let found = bench.shafts.iter().position(|shaft| shaft.name == name);
        found.ok_or_else(|| self.wrong(self.no_place(bench.shafts.iter().map(|s| s.name.clone()))))
    }

    fn spring_at(&self, bench: &Bench) -> Result<Spring, TermError> {
        let places = spring_places(bench);
        let found = places.iter().find(|(name, _)| *name == self.place).map(|&(_, spring)| spring);
        found.ok_or_else(|| self.wrong(self.no_place(places.into_iter().map(|(name, _)| name))))
    }

    fn value(&self, name: &str, left_out: f64, min: f64, max: f64, unit: &'static str) -> Result<f64, TermError> {
        match self.parameters.get(name) {
            Some(&value) => self.within(name, value, min, max, unit),
            None => Ok(left_out),
        }
    }

    fn within(&self, name: &str, value: f64, min: f64, max: f64, unit: &'static str) -> Result<f64, TermError> {
        if (min..=max).contains(&value) {
            Ok(value)
        } else {
            Err(self.wrong(TermProblem::OutOfRange { name: name.to_owned(), found: value, min, max, unit }))
        }
    }

    fn only_known(&self, known: &[&str]) -> Result<(), TermError> {
        match self.parameters.keys().find(|name| !known.contains(&name.as_str())) {
            Some(name) => {
                Err(self.wrong(TermProblem::UnknownParameter { name: name.clone(), known: known.join(", ") }))
            }
            None => Ok(()),
        }
    }

    fn no_place(&self, known: impl Iterator<Item = String>) -> TermProblem {
        TermProblem::Place { found: self.place.clone(), known: known.collect::<Vec<_>>().join(", ") }
    }

    fn unfit(&self, problem: impl Into<String>) -> TermError {
        self.wrong(TermProblem::Unfit(problem.into()))
    }

    fn wrong(&self, problem: TermProblem) -> TermError {
        TermError { expression: self.expression.clone(), place: self.place.clone(), problem }
    }
}

/// End of the names of a series' coefficients; `None` for what is no series.
fn series_suffix(expression: Expression) -> Option<&'static str> {
    match expression {
        Expression::Geometry => Some("_m"),
        Expression::Stiffness => Some(""),
        Expression::Torque => Some("_nm"),
        Expression::Force => Some("_n"),
        Expression::Spring(_) | Expression::ModalFilter => None,
    }
}

/// All springs of a bench by the names that terms give them: `SHAFT.bearing`, `SHAFT.torsion`,
/// `belt`, `STAGE`, `housing`, `housing_N`.
pub fn spring_places(bench: &Bench) -> Vec<(String, Spring)> {
    let mut out = Vec::new();
    for (i, shaft) in bench.shafts.iter().enumerate() {
        out.push((format!("{}.bearing", shaft.name), Spring::Bearing(i)));
        out.push((format!("{}.torsion", shaft.name), Spring::Torsion(i)));
    }
    out.extend(bench.belt.iter().map(|_| ("belt".to_owned(), Spring::Belt)));
    out.extend(bench.stages.iter().enumerate().map(|(i, stage)| (stage.name.clone(), Spring::Mesh(i))));
    if !bench.housing_modes.is_empty() {
        out.push(("housing".to_owned(), Spring::Housing(None)));
        out.extend((0..bench.housing_modes.len()).map(|i| (format!("housing_{}", i + 1), Spring::Housing(Some(i)))));
    }
    out
}
