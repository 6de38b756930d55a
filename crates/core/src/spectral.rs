//! From a window and its shaft angle to the amplitudes of its lines.
//!
//! # The estimator
//!
//! A line of order `o` in a window of `N` samples is the weighted Fourier integral over shaft
//! angle,
//!
//! ```text
//! a(o) = (2 / Σ w_n) Σ w_n x_n e^{-j 2π o θ(t_n)},        amplitude |a|, phase arg a
//! ```
//!
//! with the input-shaft angle `θ` in revolutions. For `x = A cos(2π o θ + φ)` it gives `A e^{jφ}`
//! *whatever* `θ(t)` does inside the window: no scalloping between bins, no smearing in a ramp. It
//! is what an FFT of the signal resampled to equal angles gives at order `o`, with `w dt` in place
//! of `w dθ`, but nothing is interpolated and nothing can fold: every sample that was taken is used
//! once, at its own angle. (Resampling folds the mesh harmonics above half the new rate into
//! sidebands of the lower ones unless it is low-passed first.)
//!
//! The sum is not worked sample by sample. The window times the signal is transformed once; around
//! each mesh harmonic a band of `M ≪ N` bins is cut out with tapered edges and transformed back
//! ([`zoom`]); in this decimated complex signal the remaining phase `o θ(t) - k t` is taken out
//! exactly, and all lines of the band are sums over `M` points. Because `w x` is what was
//! transformed, the band limit costs no accuracy: a line inside the flat part of the band loses
//! only its own side lobes beyond the edge.
//!
//! # The window
//!
//! Kaiser's, whose main lobe is as wide as asked and whose side lobes are then nearly as low as can
//! be (J. F. Kaiser, R. W. Schafer, "On the use of the I0-sinh window for spectrum analysis", IEEE
//! Trans. ASSP 28 (1980) 105): see [`kaiser`].
//!
//! # Lines closer than the main lobe
//!
//! Sidebands of a slow shaft may lie inside the main lobe of their carrier. The lines that are
//! known (mesh harmonics and sidebands of all stages) are then solved for together, the weighted
//! least squares of [`lines`]; lines so close that one window cannot separate them are one unknown,
//! and are marked as shared.
//!
//! # Uncertainty
//!
//! Noise of power `S` beside the line gives `a` a complex error of mean square `floor²`; the
//! amplitude sees one of its two components, so `sigma² = floor² / 2`, plus what an error of the
//! speed takes off the line (see [`harmonics`]). The floor is the median over the order bins of the
//! band that are not on a known line, divided by `ln 2`, which makes it the mean for noise.

pub mod angle;
pub(crate) mod floor;
pub mod harmonics;
mod hum;
pub mod kaiser;
pub mod kernels;
pub mod lines;
pub mod mesh_refine;
pub mod mesh_speed;
pub mod plan;
pub mod pulses_fit;
pub mod small;
pub mod solution;
pub mod tapered;
pub mod windows;
pub mod zoom;
