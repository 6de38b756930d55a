//! Which physics a gear pair has.

use crate::hertz::Hertz;
use crate::tooth::Root;

/// Which physics the pair has. The default is the best; [`MeshOptions::classical`] is the paper's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeshOptions {
    /// Law of the Hertz contact.
    pub hertz: Hertz,
    /// Form of the tooth root.
    pub root: Root,
    /// `c₁₂ / sqrt(f₁ f₂)` of two pairs on the same bodies; `None` adds the pairs up as if each had
    /// bodies of its own. 0.6 is the middle of what finite elements give, 0.55–0.65.
    pub body_coupling: Option<f64>,
    /// Loaded teeth touch before the nominal entry and after the nominal exit.
    pub corner_contact: bool,
    /// Compliance of the gear bodies; without it a pair is 2.6 to 3 times too stiff.
    pub foundation: bool,
}

impl Default for MeshOptions {
    fn default() -> Self {
        Self {
            hertz: Hertz::LoadDependent,
            root: Root::Fillet,
            body_coupling: Some(0.6),
            corner_contact: true,
            foundation: true,
        }
    }
}

impl MeshOptions {
    /// The classical form that the paper uses: linear Hertz contact, straight root, pairs simply
    /// added up.
    pub fn classical() -> Self {
        Self {
            hertz: Hertz::Linear,
            root: Root::Straight,
            body_coupling: None,
            corner_contact: false,
            foundation: true,
        }
    }
}
