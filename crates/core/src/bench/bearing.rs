//! Rolling bearings of a bench, and what its condition indicators are told.

use serde::{Deserialize, Serialize};

/// A rolling bearing: either its geometry or its orders.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Bearing {
    /// Unique among bearings.
    pub name: String,
    /// The shaft that carries it; its inner ring turns with the shaft.
    pub shaft: String,
    /// Rolling elements in a row (≥ 3).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub elements: Option<u32>,
    /// Diameter of a rolling element (mm, > 0).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub element_mm: Option<f64>,
    /// Pitch diameter (mm, above that of an element).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pitch_mm: Option<f64>,
    /// Contact angle (degrees, 0–60).
    #[serde(default)]
    pub contact_deg: f64,
    /// Multiples of the shaft's speed as the maker states them, in place of the geometry.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub orders: Option<BearingOrders>,
}

/// Multiples of the shaft's speed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BearingOrders {
    /// Elements over a point of the outer ring (BPFO).
    pub outer: f64,
    /// Elements over a point of the inner ring (BPFI).
    pub inner: f64,
    /// Turns of an element (BSF).
    pub element: f64,
    /// Turns of the cage (FTF).
    pub cage: f64,
}

impl BearingOrders {
    /// In the order of [`BearingOrders::NAMES`].
    pub fn all(&self) -> [f64; 4] {
        [self.outer, self.inner, self.element, self.cage]
    }

    /// As written in files.
    pub const NAMES: [&str; 4] = ["outer", "inner", "element", "cage"];
}

impl Bearing {
    /// Orders as stated, else of the geometry without slip (T. A. Harris, Rolling Bearing
    /// Analysis), with `g = d/D cos φ` and `n` elements:
    ///
    /// ```text
    /// outer n/2 (1 - g)      inner n/2 (1 + g)      element D/(2d) (1 - g²)      cage (1 - g)/2
    /// ```
    pub fn orders(&self) -> Option<BearingOrders> {
        if self.orders.is_some() {
            return self.orders;
        }
        let (n, d, pitch) = (f64::from(self.elements?), self.element_mm?, self.pitch_mm?);
        let g = d / pitch * self.contact_deg.to_radians().cos();
        Some(BearingOrders {
            outer: 0.5 * n * (1.0 - g),
            inner: 0.5 * n * (1.0 + g),
            element: 0.5 * pitch / d * (1.0 - g * g),
            cage: 0.5 * (1.0 - g),
        })
    }

    /// What is wrong with the values, one sentence each.
    pub(super) fn problems(&self, shafts: &[super::Shaft]) -> Vec<String> {
        let mut out = Vec::new();
        let name = &self.name;
        if !shafts.iter().any(|s| s.name == self.shaft) {
            out.push(format!("bearing {name:?} sits on shaft {:?}, which is not a [[shaft]]", self.shaft));
        }
        let geometry = [self.elements.is_some(), self.element_mm.is_some(), self.pitch_mm.is_some()];
        match &self.orders {
            Some(_) if geometry.contains(&true) => out.push(format!(
                "bearing {name:?} has both orders and a geometry; expected either orders, or elements, element_mm and pitch_mm"
            )),
            Some(orders) => {
                for (which, order) in BearingOrders::NAMES.iter().zip(orders.all()) {
                    if !(order > 0.0 && order <= 1e3) {
                        out.push(format!("bearing {name:?}: orders.{which} is {order}; expected above 0 and at most 1000"));
                    }
                }
            }
            None if geometry.contains(&false) => out.push(format!(
                "bearing {name:?} has neither orders nor a whole geometry; expected elements, element_mm and pitch_mm, or orders"
            )),
            None => {
                let (elements, d, pitch) =
                    (self.elements.unwrap_or(0), self.element_mm.unwrap_or(0.0), self.pitch_mm.unwrap_or(0.0));
                if !(3..=1000).contains(&elements) {
                    out.push(format!("bearing {name:?} has {elements} elements; expected 3 to 1000"));
                }
                if !(d > 0.0 && d < pitch && pitch <= 1e5) {
                    out.push(format!(
                        "bearing {name:?}: element_mm is {d} and pitch_mm {pitch}; expected 0 < element_mm < pitch_mm ≤ 100000"
                    ));
                }
                if !(0.0..=60.0).contains(&self.contact_deg) {
                    out.push(format!(
                        "bearing {name:?}: contact_deg is {}; expected 0 to 60 degrees",
                        self.contact_deg
                    ));
                }
            }
        }
        out
    }
}

/// What the condition indicators are told. None of it bears on ranks.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct IndicatorSettings {
    /// Band whose envelope is read at the bearings' orders (Hz). `gearwatch indicators` proposes
    /// one by the kurtogram.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub envelope_hz: Option<[f64; 2]>,
    /// Zone boundaries A/B, B/C and C/D of the velocity (mm/s rms), from the part of ISO 20816 that
    /// the machine belongs to.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub velocity_limits_mm_s: Option<[f64; 3]>,
}

impl IndicatorSettings {
    pub(super) fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// Zone of a velocity by the limits: `A` to `D`; none without limits or for an unknown
    /// velocity.
    pub fn zone(&self, velocity_mm_s: f64) -> Option<char> {
        let limits = self.velocity_limits_mm_s?;
        if !velocity_mm_s.is_finite() {
            return None;
        }
        ['A', 'B', 'C', 'D'].get(limits.iter().filter(|&&limit| velocity_mm_s > limit).count()).copied()
    }

    /// What is wrong with the values, one sentence each.
    pub(super) fn problems(&self) -> Vec<String> {
        let mut out = Vec::new();
        if let Some([low, high]) = self.envelope_hz
            && !(low >= 0.0 && high > low && high <= 1e7)
        {
            out.push(format!("indicators.envelope_hz is [{low}, {high}]; expected 0 ≤ lower end < upper end"));
        }
        if let Some([ab, bc, cd]) = self.velocity_limits_mm_s
            && !(ab > 0.0 && bc > ab && cd > bc && cd <= 1e4)
        {
            out.push(format!(
                "indicators.velocity_limits_mm_s is [{ab}, {bc}, {cd}]; expected three rising numbers above 0 mm/s"
            ));
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// SKF 6205-2RS JEM of the bearing data centre of Case Western Reserve University: 9 balls of
    /// 7.94 mm on 39.04 mm have the published orders 3.5848, 5.4152, 2.3570 (half of the printed
    /// 4.7135, which counts both races) and 0.39828.
    #[test]
    fn literature_orders_of_a_6205() {
        let bearing = Bearing {
            name: "de".into(),
            shaft: "input".into(),
            elements: Some(9),
            element_mm: Some(7.94),
            pitch_mm: Some(39.04),
            contact_deg: 0.0,
            orders: None,
        };
        let found = bearing.orders().expect("a geometry").all();
        for (found, published) in found.iter().zip([3.5848, 5.4152, 2.35675, 0.39828]) {
            assert!((found / published - 1.0).abs() < 1e-3, "{found} and {published}");
        }
    }

    /// A limit belongs to the better zone.
    #[test]
    fn conform_zones() {
        let settings = IndicatorSettings { velocity_limits_mm_s: Some([1.4, 2.8, 4.5]), ..Default::default() };
        let zones = [1.0, 1.4, 1.5, 4.0, 9.0, f64::NAN].map(|v| settings.zone(v));
        assert_eq!(zones, [Some('A'), Some('A'), Some('B'), Some('C'), Some('D'), None]);
        assert_eq!(IndicatorSettings::default().zone(1.0), None);
    }
}
