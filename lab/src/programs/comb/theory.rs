//! What speckle allows, in closed forms: one slit, a comb, and a filled aperture as wide as the comb. Lengths
//! are in metres.
//!
//! `spot` is the 1/e^2 diameter of the laser's spot on the target, and s a quarter of it: the standard
//! deviation of its light. `patterns` is M, the number of equal speckle patterns in an image.
//!
//! **One slit.** An image with the light I has a normal error of the variance s^2 b^-2 d^2 / (2 M) `<I>` / I
//! (see [`slitrange::reading::uncertainty`]).
//!
//! **A comb.** If n images are independent and weighed by their light, their mean has the variance s^2 b^-2
//! d^2 / (2 M) `<I>` / sum I. The sum of the light is a gamma variable of n M, whose inverse has the mean M /
//! (n M - 1) / `<I>`. So the variance of the mean is s^2 b^-2 d^2 / (2 (n M - 1)).
//!
//! **A filled aperture** of the width A, as a lens has, finds the centroid of its image: the mean tilt of the
//! wave over A, weighed by light. The tilts at two places are correlated as exp(-2 a x^2), a = 2 (pi s cos
//! theta / (lambda R))^2, so A holds A sqrt(2 a / pi) independent speckles. Its error is that of one
//! slit over the root of this number.
//!
//! **The limit** of Dorsch, Häusler and Herrmann (Appl. Opt. 33, 1306 (1994)) is C lambda / (2 pi sin u sin
//! theta), with the contrast C = 1 / sqrt(M), the half-angle u of the aperture, and the angle theta of
//! triangulation. It holds for spots that the aperture hardly resolves.

use core::f64::consts::PI;

use simulator::optics::Optics;
use slitrange::frame::comb::{NOMINAL_PLACES_UM, SLIT_WIDTH_UM};

use crate::table;

/// Standard deviation of a distance by speckle through one slit, for an image of the mean light.
pub fn one_slit(distance: f64, spot: f64, patterns: f64) -> f64 {
    0.25 * spot * distance / (Optics::nominal().baseline * (2.0 * patterns).sqrt())
}

/// RMS error of a distance by the weighted mean of independent images.
pub fn comb(distance: f64, spot: f64, patterns: f64, slits: usize) -> f64 {
    one_slit(distance, spot, patterns) * (patterns / (slits as f64 * patterns - 1.0)).sqrt()
}

/// From the first slit's outer edge to the last one's.
pub fn span() -> f64 {
    let [first, .., last] = NOMINAL_PLACES_UM;
    1e-6 * f64::from(last - first + SLIT_WIDTH_UM)
}

/// Size of a speckle at the mask: lambda R over the spot's diameter.
pub fn speckle_size(distance: f64, spot: f64) -> f64 {
    let optics = Optics::nominal();
    optics.wavelength * optics.range(distance) / spot
}

pub fn speckles(distance: f64, spot: f64, aperture: f64) -> f64 {
    let optics = Optics::nominal();
    let seen = 0.25 * spot * optics.viewing_angle(distance).cos();
    let fall = PI * seen / (optics.wavelength * optics.range(distance));
    let a = 2.0 * fall * fall;
    aperture * (2.0 * a / PI).sqrt()
}

/// RMS error of a distance by the centroid of a filled aperture's image, for a spot that the aperture
/// resolves.
pub fn filled(distance: f64, spot: f64, patterns: f64, aperture: f64) -> f64 {
    one_slit(distance, spot, patterns) / speckles(distance, spot, aperture).sqrt()
}

/// Dorsch, Häusler and Herrmann's limit of an aperture of a width.
pub fn limit(distance: f64, patterns: f64, aperture: f64) -> f64 {
    let optics = Optics::nominal();
    let half_angle = (0.5 * aperture / optics.range(distance)).atan();
    let theta = optics.viewing_angle(distance);
    optics.wavelength / (patterns.sqrt() * 2.0 * PI * half_angle.sin() * theta.sin())
}

/// A kind of surface at 0.8 m: its name, the spot's diameter, M, and the measured RMS error in micrometres.
pub type Kind = (String, f64, u8, f64);

pub fn report(distance: f64, kinds: &[Kind]) -> String {
    let width = 1e-6 * f64::from(SLIT_WIDTH_UM);
    let slits = NOMINAL_PLACES_UM.len();
    let rows = kinds.iter().map(|(name, spot, patterns, rms)| {
        let (spot, patterns) = (*spot, f64::from(*patterns));
        let um = |metres: f64| format!("{:.0}", 1e6 * metres);
        vec![
            name.clone(),
            format!("{:.2}", 1e3 * speckle_size(distance, spot)),
            format!("{:.0}", speckles(distance, spot, span())),
            um(one_slit(distance, spot, patterns)),
            um(comb(distance, spot, patterns, slits)),
            format!("{rms:.0}"),
            um(filled(distance, spot, patterns, span())),
            um(limit(distance, patterns, span())),
            um(limit(distance, patterns, width)),
        ]
    });
    let head = "surface at 0.8 m, spot | speckle, mm | speckles in the comb's span | one slit | comb by theory \
                | comb as measured | filled aperture | limit of Dorsch et al. | limit, one slit";
    table::of(head, rows)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng as _, SeedableRng as _};
    use rand_chacha::ChaCha8Rng;

    #[test]
    fn figures_of_the_nominal_comb() {
        assert!((span() - 14.9e-3).abs() < 1e-9);
        assert!((speckle_size(0.8, 1e-3) - 0.555e-3).abs() < 1e-6);
        // The figure that the core takes without a calibration.
        let core = 0.8 * f64::from(slitrange::reading::uncertainty::SPECKLE);
        assert!((one_slit(0.8, 1e-3, 1.0) / core - 1.0).abs() < 1e-6);
        // The paper's lens: 0.12 mm.
        assert!((limit(0.8, 1.0, 50e-3 / 12.0) - 0.12e-3).abs() < 2e-6);
    }

    /// Light and tilt of the wave at some places of the mask's plane, for a surface of metal: scatterers of
    /// random phases under a gaussian spot. Tilts are places on the target in metres.
    fn random_field(distance: f64, spot: f64, surface: u64, places: &[f64]) -> Vec<[f64; 2]> {
        let optics = Optics::nominal();
        let mut random = ChaCha8Rng::seed_from_u64(surface);
        let s = 0.25 * spot * optics.viewing_angle(distance).cos();
        // Only phases are random: the centre of the light on the target stays. The field repeats after lambda
        // R over the scatterers' pitch, 0.13 m.
        let scatterers: Vec<[f64; 3]> = (0..400)
            .map(|i| {
                let place = 7.0 * s * ((f64::from(i) + 0.5) / 400.0 - 0.5);
                let amplitude = (-place * place / (4.0 * s * s)).exp();
                let phase: f64 = random.random_range(0.0..2.0 * PI);
                [place, amplitude * phase.cos(), amplitude * phase.sin()]
            })
            .collect();
        let k = 2.0 * PI / (optics.wavelength * optics.range(distance));
        let at = |&x: &f64| {
            let [mut e, mut de] = [[0.0; 2]; 2];
            for &[place, re, im] in &scatterers {
                let (sin, cos) = (k * place * x).sin_cos();
                let wave = [re * cos - im * sin, re * sin + im * cos];
                for part in 0..2 {
                    e[part] += wave[part];
                    de[part] += place * wave[part];
                }
            }
            let light = e[0] * e[0] + e[1] * e[1];
            [light, (e[0] * de[0] + e[1] * de[1]) / light]
        };
        places.iter().map(at).collect()
    }

    /// The mean of tilts, weighed by light, and the sum of the light.
    fn mean(field: &[[f64; 2]]) -> (f64, f64) {
        let light: f64 = field.iter().map(|it| it[0]).sum();
        let tilts: f64 = field.iter().map(|it| it[0] * it[1]).sum();
        (tilts / light, light)
    }

    fn slits() -> [f64; 16] {
        NOMINAL_PLACES_UM.map(|um| 1e-6 * f64::from(um))
    }

    #[test]
    fn closed_forms_agree_with_random_fields() {
        let (distance, surfaces) = (0.8, 1000);
        let whole: Vec<f64> = (0..150)
            .map(|i| span() * (f64::from(i) / 150.0 - 0.5))
            .collect();
        let rms = |spot: f64, places: &[f64]| {
            let angles = (0..surfaces).map(|it| mean(&random_field(distance, spot, it, places)).0);
            statistics::rms(angles) / Optics::nominal().viewing_angle(distance).sin()
        };
        for spot in [1e-3, 0.5e-3] {
            let theory = [
                comb(distance, spot, 1.0, 16),
                filled(distance, spot, 1.0, span()),
            ];
            let found = [rms(spot, &slits()), rms(spot, &whole)];
            println!("{spot}: theory {theory:?}, random fields {found:?}");
            for (theory, found) in theory.into_iter().zip(found) {
                assert!((found / theory - 1.0).abs() < 0.12);
            }
        }
    }

    /// The scatter of the slits takes them as independent. Far targets and small spots have speckles wider
    /// than the gaps, and the scatter is then too small. Student's factor for 16 slits and the core's factor
    /// for neighbours are in u.
    #[test]
    fn far_targets_and_small_spots_make_neighbours_share_speckles() {
        let surfaces = 2000;
        let study = |distance: f64, spot: f64| {
            let (mut within, mut shared, mut all) = (0, 0.0, 0.0);
            for surface in 0..surfaces {
                let field = random_field(distance, spot, surface, &slits());
                let (mean, light) = mean(&field);
                let scatter: f64 = field.iter().map(|it| it[0] * (it[1] - mean).powi(2)).sum();
                let u = 1.09
                    * f64::from(slitrange::frame::comb::NEIGHBOURS)
                    * (scatter / 15.0 / light).sqrt();
                within += u64::from(mean.abs() <= 2.0 * u);
                let weighed: Vec<f64> = field.iter().map(|it| it[0].sqrt() * it[1]).collect();
                shared += weighed.windows(2).map(|two| two[0] * two[1]).sum::<f64>() / 15.0;
                all += weighed.iter().map(|it| it * it).sum::<f64>() / 16.0;
            }
            let (correlation, share) = (shared / all, within as f64 / surfaces as f64);
            println!("{distance} m, {spot} m: neighbours {correlation:.3}, within 2u {share:.3}");
            (correlation, share)
        };
        let (correlation, share) = study(0.8, 1e-3);
        assert!(correlation.abs() < 0.05 && share > 0.95);
        let (correlation, share) = study(0.8, 0.42e-3);
        assert!((0.2..0.32).contains(&correlation) && (0.88..0.94).contains(&share));
        let (correlation, share) = study(1.1, 0.42e-3);
        assert!((0.36..0.5).contains(&correlation) && (0.84..0.9).contains(&share));
    }
}
