//! Per-tooth tables over the path of contact. A gear has one table per kind of tooth, so a stage with faults costs a few
//! tables, never one per pair of teeth.

use crate::faults::{Breakage, BreakageKind, GearModifications, TipRelief, ToothDamage};
use crate::foundation::{Foundation, lever_m};
use crate::geometry::PairGeometry;
use crate::hertz::Material;
use crate::mesh::MeshOptions;
use crate::tooth::ToothProfile;

/// Cells per mesh cycle: with linear interpolation the compliance errs by < 1e-5.
const CELLS_PER_CYCLE: f64 = 160.0;
/// The tables go on this far (mesh cycles) beyond both ends of the nominal path, for eccentric gears.
const MARGIN: f64 = 0.1;

/// What one tooth contributes at one point of the path.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Node {
    /// Tooth and body (m/N).
    pub(super) compliance: f64,
    /// Body alone (m/N).
    pub(super) foundation: f64,
    /// Fraction of the contact line that is missing.
    pub(super) lost: f64,
    /// Missing material (m).
    pub(super) gap: f64,
}

/// One kind of tooth over the path of contact, by position s in mesh cycles since the pair's nominal entry.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ToothTable {
    nodes: Vec<Node>,
    per_cycle: f64,
    offset: f64,
    /// First and last position that the tooth can touch at; empty where it is gone.
    pub(super) first: f64,
    pub(super) last: f64,
}

impl ToothTable {
    /// Linear interpolation, held at the ends of the table.
    #[inline]
    pub(super) fn at(&self, s: f64) -> Node {
        let last = self.nodes.len() - 2;
        let x = (s * self.per_cycle + self.offset).clamp(0.0, (last + 1) as f64);
        let i = (x as usize).min(last);
        let w = x - i as f64;
        let (a, b) = (&self.nodes[i], &self.nodes[i + 1]);
        Node {
            compliance: a.compliance + w * (b.compliance - a.compliance),
            foundation: a.foundation + w * (b.foundation - a.foundation),
            lost: a.lost + w * (b.lost - a.lost),
            gap: a.gap + w * (b.gap - a.gap),
        }
    }

    /// True where the tooth can never touch.
    pub(super) fn is_gone(&self) -> bool {
        self.first >= self.last
    }
}

/// All teeth of one gear.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct GearTables {
    tables: Vec<ToothTable>,
    /// Table of each tooth for the driving flank and for the back flank.
    of_tooth: Vec<(u16, u16)>,
    /// Cumulative pitch error of each tooth (m).
    pitch_error_m: Vec<f64>,
}

/// Which of the two gears.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Side {
    Pinion,
    Wheel,
}

impl Side {
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Pinion => "pinion",
            Self::Wheel => "wheel",
        }
    }
}

impl GearTables {
    pub(super) fn new(
        side: Side,
        pair: &PairGeometry,
        material: &Material,
        options: &MeshOptions,
        modifications: &GearModifications,
        wear_m: f64,
        warnings: &mut Vec<String>,
    ) -> Result<Self, String> {
        let gear = match side {
            Side::Pinion => &pair.pinion,
            Side::Wheel => &pair.wheel,
        };
        let teeth = gear.teeth as usize;
        if let Some(&tooth) = modifications.teeth.keys().find(|&&t| t >= gear.teeth) {
            return Err(format!(
                "{}: there is no tooth {tooth}; a gear with {teeth} teeth has teeth 0 to {}",
                side.name(),
                teeth - 1
            ));
        }
        if !(modifications.pitch_error_m.is_empty() || modifications.pitch_error_m.len() == teeth) {
            return Err(format!(
                "{}: {} pitch errors are given; expected one for each of its {teeth} teeth",
                side.name(),
                modifications.pitch_error_m.len()
            ));
        }
        let builder = Builder {
            side,
            pair,
            material,
            profile: ToothProfile::new(side.name(), gear, options.root, warnings),
            foundation: options.foundation.then(|| Foundation::new(side.name(), gear, warnings)),
            relief: modifications.tip_relief,
            wear_m,
        };
        modifications.all_teeth.check(&format!("{}, all teeth", side.name()), gear)?;
        let mut kinds: Vec<(&ToothDamage, u16)> = Vec::new();
        let healthy = ToothDamage::default();
        let mut tables = Vec::new();
        let mut kind_of = |damage, tables: &mut Vec<ToothTable>| -> Result<u16, String> {
            if let Some(&(_, kind)) = kinds.iter().find(|(known, _)| *known == damage) {
                return Ok(kind);
            }
            let kind = u16::try_from(tables.len())
                .map_err(|_| format!("{}: more than {} kinds of damaged teeth", side.name(), u16::MAX))?;
            tables.push(builder.table(damage));
            kinds.push((damage, kind));
            Ok(kind)
        };
        let mut of_tooth = Vec::with_capacity(teeth);
        for tooth in 0..gear.teeth {
            let damage = modifications.teeth.get(&tooth).unwrap_or(&modifications.all_teeth);
            damage.check(&format!("{} tooth {tooth}", side.name()), gear)?;
            let drive = kind_of(damage, &mut tables)?;
            let back = if damage.affects_back_flank() { drive } else { kind_of(&healthy, &mut tables)? };
            of_tooth.push((drive, back));
        }
        let pitch_error_m =
            if modifications.pitch_error_m.is_empty() { vec![0.0; teeth] } else { modifications.pitch_error_m.clone() };
        Ok(Self { tables, of_tooth, pitch_error_m })
    }

    /// Table and pitch error of a tooth's driving flank.
    #[inline]
    pub(super) fn drive(&self, tooth: u32) -> (&ToothTable, f64) {
        let tooth = tooth as usize;
        (&self.tables[usize::from(self.of_tooth[tooth].0)], self.pitch_error_m[tooth])
    }

    /// Table of a tooth's back flank.
    #[inline]
    pub(super) fn back(&self, tooth: u32) -> &ToothTable {
        &self.tables[usize::from(self.of_tooth[tooth as usize].1)]
    }
}

/// Makes the tables of one gear.
struct Builder<'a> {
    side: Side,
    pair: &'a PairGeometry,
    material: &'a Material,
    profile: ToothProfile,
    foundation: Option<Foundation>,
    relief: Option<TipRelief>,
    wear_m: f64,
}

impl Builder<'_> {
    fn table(&self, damage: &ToothDamage) -> ToothTable {
        let Self { pair, material, .. } = *self;
        let gear = match self.side {
            Side::Pinion => &pair.pinion,
            Side::Wheel => &pair.wheel,
        };
        // Both ends of the path are nodes: the tip is a kink.
        let cells = (pair.contact_ratio * CELLS_PER_CYCLE).round();
        let per_cycle = cells / pair.contact_ratio;
        let margin = (MARGIN * per_cycle).ceil();
        let count = (cells + 2.0 * margin) as usize + 1;
        let position = |i: usize| (i as f64 - margin) / per_cycle;
        let tip_roll = gear.roll_at_radius_m(gear.tip_radius_m);
        let roll = |s: f64| {
            let pinion_roll = pair.entry_roll_m + s * pair.base_pitch_m;
            let own = match self.side {
                Side::Pinion => pinion_roll,
                Side::Wheel => pair.tangent_length_m - pinion_roll,
            };
            own.clamp(0.0, tip_roll)
        };
        let angle = |i: usize| gear.load_angle_rad(roll(position(i)));
        // The pinion's contact climbs its tooth, the wheel's descends it.
        let ascending = |i: usize| if self.side == Side::Pinion { i } else { count - 1 - i };
        let angles: Vec<f64> = (0..count).map(|i| angle(ascending(i))).collect();
        // A tooth that is gone still needs finite numbers: it never touches, so they are never used.
        let gone = damage.breakage.is_some_and(|b| b.fraction >= 1.0);
        let healthy = ToothDamage::default();
        let flexure = self.profile.flexure(material, if gone { &healthy } else { damage }, &angles);
        let broken_width = match damage.breakage {
            Some(Breakage { fraction, kind: BreakageKind::Width }) => fraction,
            _ => 0.0,
        };
        let furthest = pair.pitch_phase().max(pair.contact_ratio - pair.pitch_phase());
        let nodes = (0..count)
            .map(|i| {
                let (s, a) = (position(i), angle(i));
                let foundation = self.foundation.as_ref().map_or(0.0, |foundation| {
                    foundation.compliance_m_per_n(material, gear.face_width_m, a, lever_m(gear, a))
                });
                let (length, depth) = damage.lost_length_m(gear, gear.flank_point_m(a).0);
                let mut lost = broken_width + (1.0 - broken_width) * length / gear.face_width_m;
                let mut gap = self.relief_m(s) + self.wear_m * (s - pair.pitch_phase()).abs() / furthest;
                if lost > 0.999 {
                    // The contact line falls wholly into the recess: full length at its bottom.
                    lost = broken_width;
                    gap += depth;
                }
                Node { compliance: flexure[ascending(i)].total() + foundation, foundation, lost, gap }
            })
            .collect();
        let (mut first, mut last) = (0.0, pair.contact_ratio);
        if let Some(Breakage { fraction, kind }) = damage.breakage {
            if gone {
                (first, last) = (1.0, 0.0);
            } else if kind == BreakageKind::Height {
                // Nothing touches above r_cut = r_a − f (r_a − r_f): late on a pinion tooth, early on a wheel tooth.
                let cut = gear.tip_radius_m - fraction * (gear.tip_radius_m - gear.root_radius_m);
                let reach = (tip_roll - gear.roll_at_radius_m(cut)) / pair.base_pitch_m;
                match self.side {
                    Side::Pinion => last -= reach,
                    Side::Wheel => first += reach,
                }
            }
        }
        ToothTable { nodes, per_cycle, offset: margin, first, last }
    }

    /// Tip relief at position s (m): on the pinion before its exit, on the wheel after its entry.
    fn relief_m(&self, s: f64) -> f64 {
        let Some(relief) = self.relief else { return 0.0 };
        let from_tip = match self.side {
            Side::Pinion => self.pair.contact_ratio - s,
            Side::Wheel => s,
        };
        let along = (relief.length_fraction - from_tip) / relief.length_fraction;
        relief.depth_m * along.clamp(0.0, 1.0).powi(relief.power)
    }
}
