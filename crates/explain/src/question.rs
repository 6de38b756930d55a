//! What is asked: everything that was measured of the recordings, beside the sheet.

use gearwatch_core::bench::Bench;
use gearwatch_core::train::Train;

use crate::change::compare::Comparison;
use crate::read::features::{ChannelFeatures, RecordingFeatures};
use crate::read::kinematics::OtherTeeth;
use crate::read::ratio::Ratios;

/// Everything that was measured.
pub struct Question<'a> {
    /// With corrected teeth where the sheet's were wrong.
    pub bench: &'a Bench,
    /// Kinematics of `bench`.
    pub train: &'a Train,
    /// Steady recordings.
    pub recordings: &'a [RecordingFeatures],
    /// Steady reference recordings.
    pub references: &'a [RecordingFeatures],
    /// Recordings against reference.
    pub comparison: &'a Comparison,
    /// Speeds; recordings first, then references.
    pub ratios: &'a Ratios,
    /// A tooth number of the sheet that is wrong.
    pub teeth: Option<&'a OtherTeeth>,
    /// Effects that are taken out of the library.
    pub without: &'a [&'a str],
    /// Channels of the comparison whose path changed beside others: what that makes of a comb is no
    /// change of a tooth.
    pub changed_paths: &'a [usize],
}

impl Question<'_> {
    /// Whether a channel tells of single teeth: what clips makes lines of its own, and so does a
    /// path that changed.
    pub fn tells_teeth(&self, channel: &ChannelFeatures) -> bool {
        let changed = |c: &usize| self.comparison.channels[*c] == channel.name;
        channel.integrity.clipped_at.is_none() && !self.changed_paths.iter().any(changed)
    }
}
