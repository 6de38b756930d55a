//! How well an unchanged bench repeats: the numbers of the instrument's part that no law of
//! statistics gives.
//!
//! They stand here together, because they were chosen and not derived. Only [`OVER_FREQUENCY`] was
//! set by recordings of a real two-stage box (SpectraQuest, four sensors; loads of 10, 50 and 90 %
//! chose it, those of 0, 30 and 70 % judged it). The others are what sensors, drives and machines
//! are known for, or a judgement where nothing is known; the tables in `docs/instrument-faults.md`
//! check them, and no number was moved to make a case come out right. Everything else in this part
//! is a probability by chance, a bound, a prior that is written beside it, or a choice of what is
//! looked at (lengths, bands, numbers of lines).

/// Cables: relative amplitude by which cross-spectra of one machine differ from session to session.
/// It limits what averages can say: more of them than `1/0.2²` = 25 add nothing. Amplitudes of a
/// healthy machine scatter by 5 to 10 % from second to second; a judgement for days.
pub(super) const OF_CROSS_SPECTRA: f64 = 0.2;

/// Gains: drift of a sensor (relative). Sensitivities are calibrated to some 1 % (ISO 16063-21).
pub(super) const OF_A_SENSOR: f64 = 0.01;

/// Gains: drift of all channels alike between sessions (relative): load and temperature move all
/// levels a little.
pub(super) const OF_ALL_SENSORS: f64 = 0.03;

/// Gains: scatter of single bands on an unchanged bench (ln), beyond what averaging leaves; each as
/// likely as the others. A judgement: a factor of two about 3 %.
pub(super) const OF_BANDS: [f64; 3] = [0.015, 0.03, 0.06];

/// Gains: wander over frequency on an unchanged bench (ln); each as likely as the others. Set by
/// the real box.
pub(super) const OVER_FREQUENCY: [f64; 3] = [0.0, 0.025, 0.05];

/// Lost samples: wander of the speed over half a second (relative). Drives without a controller
/// follow the mains, ±0.1 % within seconds (ENTSO-E 2017), and the load.
pub(super) const OF_SPEED: f64 = 1.5e-3;

/// Lost samples: share of the agreement of all lines elsewhere that must come back with the gap in
/// place. A wander of the speed gives back less: it is no step. A judgement: more than half.
pub(super) const OF_PHASES: f64 = 0.6;

/// Dead channels: coherence with the others, beyond that of chance, that there must have been, and
/// the share of it that is left at most. A cable that is off has none.
pub(super) const OF_COHERENCE: (f64, f64) = (0.1, 0.05);
