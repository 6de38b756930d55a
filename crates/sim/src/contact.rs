//! One mesh as the time steppers see it: force and tangent stiffness at a phase and an approach, on
//! either flank.

use pulp::Arch;

use crate::impact::Impact;
use crate::mesh::{Face, FaceTable, Joint, LoadPoint, MeshModel, MeshState, Pairs, StageMesh};

/// The force law of one mesh at an operating point.
#[derive(Clone, Debug)]
pub struct StageContact {
    mesh: StageMesh,
    /// The law of a face whose slices repeat with the mesh cycle.
    table: Option<Box<FaceTable>>,
    impact: Option<Impact>,
    load: LoadPoint,
    displacement_m: [f64; 2],
    /// Linear damping along the line of action while the flanks touch (N s/m).
    pub damping_n_s_per_m: f64,
    /// Mean tangent stiffness over a mesh cycle at the static force (N/m).
    pub mean_stiffness_n_per_m: f64,
    /// Coefficient of friction.
    pub friction: f64,
    /// Total backlash along the line of action under the static load (m).
    pub backlash_m: f64,
}

/// The pairs of all slices of a face at one phase, kept from one approach to the next.
#[derive(Clone, Debug, Default)]
pub(crate) struct Slices {
    phase: Option<f64>,
    /// With the slice's missing material (m).
    found: Vec<(Pairs, f64)>,
    scratch: Pairs,
}

impl Slices {
    /// The next question is of another instant.
    pub(crate) fn forget(&mut self) {
        self.phase = None;
    }
}

/// What a mesh does at one instant.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Contact {
    /// Elastic force along the line of action (N); negative when the back flanks touch.
    pub force_n: f64,
    /// Its derivative by the approach (N/m).
    pub stiffness_n_per_m: f64,
    /// One bit per touching pair, by the pair's number modulo 16, back flanks in the upper half; 0
    /// out of contact.
    pub touching: u32,
    /// Friction per unit of its coefficient: force on the pinion along the tangent (N), and its
    /// moments about pinion and wheel (N m), each in the sense of the gear's rotation; 0 where the
    /// coefficient is.
    pub friction: [f64; 3],
}

impl Contact {
    /// Some flanks touch.
    pub fn is_closed(&self) -> bool {
        self.touching != 0
    }

    /// The driving flanks touch.
    pub fn is_driving(&self) -> bool {
        self.touching & 0xffff != 0
    }
}

impl StageContact {
    /// The law of a mesh under a static mesh force (N), its gears displaced by the static load (m,
    /// local frame).
    pub fn new(
        mesh: impl Into<StageMesh>,
        impact: Option<Impact>,
        static_force_n: f64,
        displacement_m: [f64; 2],
    ) -> Self {
        let mesh = mesh.into();
        let load = mesh.at_load(static_force_n);
        let friction = if impact.is_some() { 0.0 } else { mesh.section().friction() };
        let mut out = Self {
            mesh,
            table: None,
            impact,
            load,
            displacement_m,
            damping_n_s_per_m: 0.0,
            mean_stiffness_n_per_m: 0.0,
            friction,
            backlash_m: 0.0,
        };
        out.backlash_m = out.mesh().backlash_m(&MeshState { phase: 0.0, displacement_m });
        out.mean_stiffness_n_per_m = out.mean_stiffness(static_force_n);
        if let Some(face) = out.mesh.face().filter(|_| friction == 0.0) {
            let approach = out.static_approach(0.0, static_force_n.max(1.0));
            let table = FaceTable::new(face, out.mesh.section(), &out.load, displacement_m, approach);
            out.table = table.map(Box::new);
        }
        out
    }

    /// The slices of helical teeth: pairs come and go along the face, without events.
    #[inline(always)]
    pub fn face(&self) -> Option<&Face> {
        self.mesh.face()
    }

    /// Mean mesh stiffness c_γ b by ISO 6336-1, method B (N/m), at a mesh force (N).
    pub fn iso_stiffness_n_per_m(&self, load_n: f64) -> f64 {
        self.mesh.iso_stiffness_n_per_m(load_n)
    }

    /// The multibody contact law, where it was chosen.
    pub fn impact(&self) -> Option<&Impact> {
        self.impact.as_ref()
    }

    /// The gear pair; of helical teeth the transverse section.
    #[inline(always)]
    pub fn mesh(&self) -> &MeshModel {
        self.mesh.section()
    }

    /// The pairs near contact of the driving flanks at a mesh phase.
    #[inline(always)]
    pub fn pairs(&self, phase: f64, out: &mut Pairs) {
        self.mesh().pairs_at(&MeshState { phase, displacement_m: self.displacement_m }, &self.load, out);
    }

    /// Tables of whole tooth pairs for this law; `None` where too many pairs may be near contact at
    /// once, and for helical teeth.
    pub(crate) fn joint(&self) -> Option<Joint> {
        if self.face().is_some() {
            return None;
        }
        Joint::new(self.mesh(), &self.load, self.displacement_m)
    }

    /// Force at a mesh phase, an approach and its rate, `pairs` being scratch. The rate matters to
    /// the impact law alone.
    #[inline]
    pub fn at(&self, phase: f64, approach_m: f64, rate_m_per_s: f64, pairs: &mut Pairs) -> Contact {
        if let Some(face) = self.face() {
            return self.along(face, phase, approach_m, pairs);
        }
        self.pairs(phase, pairs);
        match &self.impact {
            Some(law) => self.impact_contact(law, phase, approach_m, rate_m_per_s, pairs),
            None => self.among(pairs, phase, approach_m),
        }
    }

    /// [`Self::mean_about`] at many phases and approaches; `each` gets the place in the row, the
    /// phase and the contact. In the widest arithmetic that the machine has.
    pub(crate) fn means_about(
        &self,
        points: impl Iterator<Item = (f64, f64)>,
        width: f64,
        mut each: impl FnMut(usize, f64, Contact),
    ) {
        let mut scratch = Pairs::default();
        if self.face().is_some() || self.impact.is_some() || !self.mesh().options().corner_contact {
            for (k, (phase, approach_m)) in points.enumerate() {
                each(k, phase, self.mean_about(phase, width, approach_m, &mut scratch));
            }
            return;
        }
        Arch::new().dispatch(
            #[inline(always)]
            || {
                for (k, (phase, approach_m)) in points.enumerate() {
                    self.pairs(phase, &mut scratch);
                    each(k, phase, self.among(&scratch, phase, approach_m));
                }
            },
        );
    }

    /// The mean of [`Self::at`] over a stretch of `width` mesh cycles about a phase, as far as
    /// pairs that come and go make it differ from the value in its middle: without corner contact
    /// they do so at once.
    pub fn mean_about(&self, phase: f64, width: f64, approach_m: f64, pairs: &mut Pairs) -> Contact {
        if self.mesh().options().corner_contact || self.face().is_some() {
            return self.at(phase, approach_m, 0.0, pairs);
        }
        let begin = phase - 0.5 * width;
        let event = self.mesh().next_event(&MeshState { phase: begin, displacement_m: self.displacement_m });
        let before = (event - begin) / width;
        if before >= 1.0 {
            return self.at(phase, approach_m, 0.0, pairs);
        }
        let beside = 1e-6 * width;
        let (first, second) =
            (self.at(event - beside, approach_m, 0.0, pairs), self.at(event + beside, approach_m, 0.0, pairs));
        let mean = |a: f64, b: f64| before * a + (1.0 - before) * b;
        Contact {
            force_n: mean(first.force_n, second.force_n),
            stiffness_n_per_m: mean(first.stiffness_n_per_m, second.stiffness_n_per_m),
            touching: first.touching | second.touching,
            friction: std::array::from_fn(|i| mean(first.friction[i], second.friction[i])),
        }
    }

    /// Force of all slices of the face. Pairs come and go in slices, so that `touching` says
    /// driving or back flanks alone.
    fn along(&self, face: &Face, phase: f64, approach_m: f64, scratch: &mut Pairs) -> Contact {
        if let Some(contact) = self.tabulated(phase, approach_m) {
            return contact;
        }
        let state = MeshState { phase, displacement_m: self.displacement_m };
        let mut out = Contact::default();
        for cut in face.cuts(self.mesh()) {
            cut.mesh.pairs_behind(&state, cut.lag, &self.load, scratch);
            self.add_slice(face, scratch, approach_m - cut.gap_m, &mut out);
        }
        self.with_back_flanks(face, phase, approach_m, out, scratch)
    }

    /// As [`Self::at`] of helical teeth, for several approaches at one phase: the pairs of the
    /// slices are found once.
    pub(crate) fn at_slices(&self, face: &Face, phase: f64, approach_m: f64, slices: &mut Slices) -> Contact {
        if let Some(contact) = self.tabulated(phase, approach_m) {
            return contact;
        }
        if slices.phase != Some(phase) {
            let state = MeshState { phase, displacement_m: self.displacement_m };
            slices.found.resize_with(face.count() as usize, Default::default);
            for ((pairs, gap_m), cut) in slices.found.iter_mut().zip(face.cuts(self.mesh())) {
                cut.mesh.pairs_behind(&state, cut.lag, &self.load, pairs);
                *gap_m = cut.gap_m;
            }
            slices.phase = Some(phase);
        }
        let mut out = Contact::default();
        for (pairs, gap_m) in &slices.found {
            self.add_slice(face, pairs, approach_m - gap_m, &mut out);
        }
        self.with_back_flanks(face, phase, approach_m, out, &mut slices.scratch)
    }

    fn tabulated(&self, phase: f64, approach_m: f64) -> Option<Contact> {
        let (force_n, stiffness_n_per_m) = self.table.as_ref()?.at(phase, approach_m)?;
        Some(Contact { force_n, stiffness_n_per_m, touching: 1, ..Default::default() })
    }

    #[inline(always)]
    fn add_slice(&self, face: &Face, pairs: &Pairs, approach_m: f64, out: &mut Contact) {
        let share = 1.0 / face.count();
        if self.friction == 0.0 {
            let force = pairs.force(approach_m);
            out.force_n += share * force.force_n;
            out.stiffness_n_per_m += share * force.stiffness_n_per_m;
            out.touching |= u32::from(force.set != 0);
            return;
        }
        let slice = self.pressed(pairs, approach_m);
        out.force_n += share * slice.force_n;
        out.stiffness_n_per_m += share * slice.stiffness_n_per_m;
        out.touching |= u32::from(slice.touching != 0);
        for (sum, value) in out.friction.iter_mut().zip(slice.friction) {
            // Friction follows the force along the normal, of which this is the transverse part.
            *sum += share / face.base_helix_rad().cos() * value;
        }
    }

    fn with_back_flanks(
        &self,
        face: &Face,
        phase: f64,
        approach_m: f64,
        mut out: Contact,
        scratch: &mut Pairs,
    ) -> Contact {
        if out.touching == 0 && approach_m < -self.backlash_m {
            let share = 1.0 / face.count();
            for cut in face.cuts(self.mesh()) {
                cut.mesh.back_pairs(phase - cut.lag, &self.load, scratch);
                let slice = scratch.force(-approach_m - self.backlash_m);
                out.force_n -= share * slice.force_n;
                out.stiffness_n_per_m += share * slice.stiffness_n_per_m;
                out.touching |= u32::from(slice.set != 0) << 16;
            }
        }
        out
    }

    /// As [`Self::at`] for pairs that were found before.
    #[inline(always)]
    pub fn among(&self, pairs: &Pairs, phase: f64, approach_m: f64) -> Contact {
        let out = self.pressed(pairs, approach_m);
        if out.touching == 0 && approach_m < -self.backlash_m {
            return self.back(phase, approach_m);
        }
        out
    }

    /// The driving flanks of some pairs; without a coefficient there is no friction.
    #[inline(always)]
    fn pressed(&self, pairs: &Pairs, approach_m: f64) -> Contact {
        if self.friction == 0.0 {
            let (force_n, stiffness_n_per_m, touching) = pairs.carried(approach_m);
            return Contact { force_n, stiffness_n_per_m, touching, ..Default::default() };
        }
        let force = pairs.force(approach_m);
        let mut out = Contact {
            force_n: force.force_n,
            stiffness_n_per_m: force.stiffness_n_per_m,
            touching: pairs.touching(&force),
            ..Default::default()
        };
        let carrying = pairs.as_slice().iter().zip(&force.pair_forces_n).filter(|(_, share)| **share > 0.0);
        let ratio = self.mesh().base_radii_m()[0] / self.mesh().base_radii_m()[1];
        let climb = self.mesh().geometry().climb();
        for (pair, share) in carrying {
            // The pinion's flank slides with Ω₁ ξ₁ against the wheel's Ω₂ ξ₂, ξ growing on the
            // pinion: before the pitch point the wheel's flank is the faster one and drags the
            // pinion along +tangent.
            let sliding = climb * (pair.pinion_roll_m - ratio * pair.wheel_roll_m);
            let sign = if sliding > 0.0 { 1.0 } else { -1.0 };
            out.friction[0] -= sign * share;
            out.friction[1] -= sign * share * climb * pair.pinion_roll_m;
            out.friction[2] += sign * share * climb * pair.wheel_roll_m;
        }
        out
    }

    /// The back flanks, which touch beyond the backlash.
    #[cold]
    fn back(&self, phase: f64, approach_m: f64) -> Contact {
        let mut pairs = Pairs::default();
        self.mesh().back_pairs(phase, &self.load, &mut pairs);
        let force = pairs.force(-approach_m - self.backlash_m);
        let mut out =
            Contact { force_n: -force.force_n, stiffness_n_per_m: force.stiffness_n_per_m, ..Default::default() };
        for (pair, &share) in pairs.as_slice().iter().zip(&force.pair_forces_n) {
            if share > 0.0 {
                out.touching |= 1 << (16 + (pair.index & 15));
            }
        }
        out
    }

    #[cold]
    fn impact_contact(
        &self,
        law: &Impact,
        phase: f64,
        approach_m: f64,
        rate_m_per_s: f64,
        pairs: &mut Pairs,
    ) -> Contact {
        let touching = |pairs: &Pairs, approach: f64| {
            let touch = pairs.as_slice().iter().filter(|pair| approach > pair.gap_m);
            touch.fold(0, |bits, pair| bits | 1 << (pair.index & 15))
        };
        let driving = touching(pairs, approach_m);
        let back = -approach_m - self.backlash_m;
        if driving != 0 || back <= 0.0 {
            let (force_n, stiffness_n_per_m) = law.mesh_force(pairs, approach_m, rate_m_per_s);
            return Contact { force_n, stiffness_n_per_m, touching: driving, ..Default::default() };
        }
        self.mesh().back_pairs(phase, &self.load, pairs);
        let (force, stiffness_n_per_m) = law.mesh_force(pairs, back, -rate_m_per_s);
        Contact { force_n: -force, stiffness_n_per_m, touching: touching(pairs, back) << 16, ..Default::default() }
    }

    /// Approach under a static force at a phase (m).
    pub fn static_approach(&self, phase: f64, force_n: f64) -> f64 {
        if let Some(law) = &self.impact {
            return law.penetration_m(force_n.max(0.0));
        }
        self.static_point(phase, force_n).map_or(0.0, |(approach, _)| approach)
    }

    /// [`Self::static_approach`] at many phases.
    pub(crate) fn static_approaches(&self, phases: impl Iterator<Item = f64>, force_n: f64) -> Vec<f64> {
        if self.impact.is_some() {
            return phases.map(|phase| self.static_approach(phase, force_n)).collect();
        }
        let mut out = Vec::with_capacity(phases.size_hint().0);
        self.static_points(phases, force_n, |point| out.push(point.map_or(0.0, |(approach, _)| approach)));
        out
    }

    /// [`Self::static_point`] at many phases, in the widest arithmetic that the machine has.
    fn static_points(&self, phases: impl Iterator<Item = f64>, force_n: f64, mut each: impl FnMut(Option<(f64, f64)>)) {
        if self.face().is_some() {
            return phases.for_each(|phase| each(self.static_point(phase, force_n)));
        }
        let mut pairs = Pairs::default();
        Arch::new().dispatch(
            #[inline(always)]
            || {
                for phase in phases {
                    self.pairs(phase, &mut pairs);
                    each(pairs.approach_at(force_n));
                }
            },
        );
    }

    /// Static approach (m) and tangent stiffness (N/m) of elastic teeth under a static force at a
    /// phase.
    fn static_point(&self, phase: f64, force_n: f64) -> Option<(f64, f64)> {
        if let Some(face) = self.face() {
            if let Some(point) = self.table.as_ref().and_then(|table| table.static_point(phase, force_n)) {
                return Some(point);
            }
            let state = MeshState { phase, displacement_m: self.displacement_m };
            return face.static_point(self.mesh(), &state, &self.load, force_n.max(1e-3));
        }
        let mut pairs = Pairs::default();
        self.pairs(phase, &mut pairs);
        pairs.approach_at(force_n)
    }

    /// Tangent stiffness under a static force at a phase (N/m).
    pub fn static_stiffness(&self, phase: f64, force_n: f64) -> f64 {
        let approach = self.static_approach(phase, force_n);
        self.at(phase, approach, 0.0, &mut Pairs::default()).stiffness_n_per_m
    }

    fn mean_stiffness(&self, static_force_n: f64) -> f64 {
        const PHASES: u32 = 64;
        // An unloaded mesh is linearised about the lightest load that still closes it.
        let force = static_force_n.max(1.0);
        if let Some(law) = &self.impact {
            return law.tangent_n_per_m(law.penetration_m(force));
        }
        // Another tooth each time: one bad tooth is not the mean.
        let phases = (0..PHASES).map(|i| f64::from(i) * (1.0 + 1.0 / f64::from(PHASES)));
        let mut sum = 0.0;
        self.static_points(phases, force, |point| sum += point.map_or(0.0, |(_, stiffness)| stiffness));
        sum / f64::from(PHASES)
    }
}
