//! The difference of two readings, `zero`: what both share of their errors does not count.
//!
//! | part | shared by both readings |
//! |---|---|
//! | noise, motion | nothing |
//! | shape | nothing |
//! | pixels | all at the same centre, nothing one width away, and up to minus 0.45 beyond |
//! | calibration | all for a small step, nothing over half of the range |
//! | geometry | all, but it grows with the distance |
//! | surface | all for a small step, nothing for one beyond the speckle's memory |
//!
//! For two errors with the standard deviations a and b, and the correlation rho, the difference has the
//! variance a^2 + b^2 - 2 rho a b.
//!
//! **Surface.** If the target moves along the beam by a step D, rho = exp(-(D / L)^2), with the memory L = K
//! lambda R^3 / (w b d). So for a step far below L the error is a share of the step: sqrt(2) e / L, where e
//! is the surface's part. On white paper with a laser spot of 1 mm that share is about one, with a spot of
//! 0.42 mm it is a quarter (docs/uncertainty.md). A target that slides sideways forgets sooner.
//!
//! The sensor knows D only by its own readings. If the error shortens the step, the reading alone would also
//! claim less: readings of 0 would claim nothing. So D is the step that was read, and the part itself on top.
//!
//! **Ranges.** Lengths are below 2^23 um and correlations are -0.45 to 1, so a variance is below 2^50. A lag
//! is below 2^16 widths, because a width counts as at least a pixel. The memory is above 100 um, so D is
//! below 2^19 memories. The squares of both are below 2^38, of which expf makes 0.

use crate::base::Micrometres;
use crate::base::numeric::at_least;
use crate::reading::Reading;
use crate::reading::uncertainty::{Parts, memory_um};

impl Reading {
    /// This reading relative to an earlier one: distance and uncertainty are those of the difference.
    pub fn relative_to(&self, zero: &Self) -> Self {
        let now = self;
        let bits = now.distance.to_bits();
        let distance = Micrometres::from_bits(bits.saturating_sub(zero.distance.to_bits()));
        let step = distance.to_f32();
        let pixels = now.centre.to_f32() - zero.centre.to_f32();
        let in_widths = pixels / now.width.to_f32().max(zero.width.to_f32()).max(1.0);
        let memory = memory_um(now.distance.to_f32() - 0.5 * step);
        let (a, b) = (&zero.parts, &now.parts);
        let parts = Parts {
            noise: root(a.noise, b.noise, 0.0),
            shape: root(a.shape, b.shape, 0.0),
            pixels: root(a.pixels, b.pixels, of_pixels(in_widths)),
            calibration: root(a.calibration, b.calibration, of_curve(step)),
            surface: surface(a.surface, b.surface, step, memory),
            // Each tolerance moves both distances, in proportion.
            geometry: root(a.geometry, b.geometry, 1.0),
            motion: root(a.motion, b.motion, 0.0),
        };
        Self {
            distance,
            uncertainty: parts.combined(),
            parts,
            is_nominal: zero.is_nominal || now.is_nominal,
            has_other_settings: zero.has_other_settings || now.has_other_settings,
            ..*now
        }
    }
}

/// The standard deviation of the difference of two errors.
fn root(a: Micrometres, b: Micrometres, correlation: f32) -> Micrometres {
    let (a, b) = (a.to_f32(), b.to_f32());
    let between = a - b;
    // a^2 + b^2 - 2 rho a b, without the loss of digits where rho is near 1.
    let variance = between * between + 2.0 * (1.0 - correlation) * a * b;
    Micrometres::from_f32(dual_mac::square_root(at_least(variance, 0.0)))
}

/// Pixels act with the weight u exp(-u^2), with u from the centre in widths, as an unweighted fit has it. Its
/// correlation with itself at a lag.
fn of_pixels(lag: f32) -> f32 {
    let square = lag * lag;
    (1.0 - square) * libm::expf(-0.5 * square)
}

/// The error of eq. (1), whose three parameters were fitted over half a metre, changes over so much.
const CURVE_MEMORY_UM: f32 = 150_000.0;

fn of_curve(step: f32) -> f32 {
    let over = step / CURVE_MEMORY_UM;
    libm::expf(-over * over)
}

/// The surface's part: see the module. The memory is L in micrometres.
fn surface(a: Micrometres, b: Micrometres, step: f32, memory: f32) -> Micrometres {
    /// Each pass adds a share sqrt(2) e / L of what the pass before added, 0.84 on white paper: 16 passes
    /// find 94 % or more.
    const PASSES: usize = 16;
    let mut part = Micrometres::default();
    for _ in 0..PASSES {
        let over = (step.abs() + part.to_f32()) / memory;
        part = root(a, b, libm::expf(-over * over));
    }
    part
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The correlation of the weights u exp(-u^2) with themselves, as sums over steps of a tenth: for such
    /// functions these are exact to far more digits than an f32 has.
    // Thousands of exponentials take minutes under Miri.
    #[cfg(not(miri))]
    #[test]
    fn pixels_errors_forget_as_the_weights_of_a_fit_do() {
        let weight = |u: f64| u * (-u * u).exp();
        let product = |lag: f64| -> f64 {
            let places = (-120..=60).map(|i| f64::from(i) / 10.0);
            places.map(|u| weight(u) * weight(u + lag)).sum()
        };
        let (whole, mut least) = (product(0.0), 1.0);
        for lag in (0..=24).map(|i| f64::from(i) / 4.0) {
            let [expected, found] = [product(lag) / whole, f64::from(of_pixels(lag as f32))];
            assert!((found - expected).abs() < 1e-6, "{lag}: {found} {expected}");
            assert_eq!(of_pixels(-lag as f32), of_pixels(lag as f32));
            least = found.min(least);
        }
        assert!((-0.45..-0.44).contains(&least), "{least}");
    }

    /// For a short step, sqrt(2) e / L = 1/2 makes a part u = (step + u) / 2.
    #[test]
    fn the_surfaces_part_allows_for_a_step_that_was_read_too_short() {
        let memory = 840.0;
        let error = Micrometres::from_f32(0.5 * memory / core::f32::consts::SQRT_2);
        for step in [0.0, 5.0, -5.0] {
            let part = surface(error, error, step, memory).to_f32();
            assert!((part - step.abs()).abs() < 0.05, "{step}: {part}");
        }
    }
}
