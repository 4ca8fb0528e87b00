//! The laser: a gaussian beam with a gaussian spectrum.

use std::f64::consts::{FRAC_1_SQRT_2, LN_2, PI};

use statistics::rms;

/// A laser whose beam is gaussian in space and whose line is gaussian in wavelength.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Laser {
    /// Wavelength in metres.
    pub wavelength: f64,
    /// Full width of the line at half its maximum, in metres; 0 for a single wavelength.
    pub linewidth: f64,
    /// How many wavelengths stand for the line, at least 1; without linewidth there is only one. See
    /// [`Laser::spectrum`].
    pub wavelengths: usize,
    /// 1/e^2 diameter of the intensity at the waist, in metres.
    pub waist_diameter: f64,
    /// From the laser to the waist, in metres.
    pub waist_distance: f64,
}

/// The beam where it meets the target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Beam {
    /// Radius in metres at which the amplitude has fallen to 1/e.
    pub radius: f64,
    /// 1/rho: curvature of the wavefront in 1/m, positive where the beam diverges.
    pub curvature: f64,
}

/// A wavelength that stands for a part of the spectrum.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpectralLine {
    /// 1/lambda, in 1/m.
    pub wavenumber: f64,
    /// Its share of the light; the shares' sum is 1.
    pub weight: f64,
}

impl Laser {
    /// A single wavelength of 650 nm and a waist of a 1/e^2 diameter in metres on the target, `distance`
    /// metres away.
    pub fn focused(waist_diameter: f64, distance: f64) -> Self {
        Self {
            wavelength: 650e-9,
            linewidth: 0.0,
            wavelengths: 1,
            waist_diameter,
            waist_distance: distance,
        }
    }

    /// The beam at a distance in metres: w = w0 sqrt(1 + (z/zR)^2), 1/rho = z / (z^2 + zR^2), zR = pi w0^2 /
    /// lambda, with z from the waist (Siegman, Lasers, 1986, section 17.1).
    pub fn beam(&self, distance: f64) -> Beam {
        let waist = 0.5 * self.waist_diameter;
        let rayleigh = PI * waist * waist / self.wavelength;
        let z = distance - self.waist_distance;
        Beam {
            radius: waist * (1.0 + (z / rayleigh).powi(2)).sqrt(),
            curvature: z / (z * z + rayleigh * rayleigh),
        }
    }

    /// Standard deviation of the wavenumber k = 2 pi / lambda over the line, in rad/m.
    pub fn wavenumber_deviation(&self) -> f64 {
        2.0 * PI * self.linewidth / (2.0 * (2.0 * LN_2).sqrt()) / self.wavelength.powi(2)
    }

    /// The wavelengths that stand for the line: the medians of as many equal shares of its light, pulled
    /// apart so that their variance is that of the line.
    ///
    /// For light from a material's depth the contrast is then within 1.5 % up to path spreads of 2 /
    /// [`Laser::wavenumber_deviation`] with 5 wavelengths, and of 3 with 9. (With as many evenly spaced ones,
    /// or those of Gauss and Hermite, it is 10 % too high, as most of the light is in a few of them.)
    pub fn spectrum(&self) -> Vec<SpectralLine> {
        let centre = 1.0 / self.wavelength;
        if self.linewidth == 0.0 || self.wavelengths <= 1 {
            return vec![SpectralLine {
                wavenumber: centre,
                weight: 1.0,
            }];
        }
        let n = self.wavelengths as f64;
        let median = |i| normal_quantile((i as f64 + 0.5) / n);
        let medians: Vec<f64> = (0..self.wavelengths).map(median).collect();
        let deviation = self.wavenumber_deviation() / (2.0 * PI) / rms(&medians);
        let line = |median| SpectralLine {
            wavenumber: centre + median * deviation,
            weight: 1.0 / n,
        };
        medians.into_iter().map(line).collect()
    }
}

/// Below which value a standard normal variable lies with a probability: by bisection.
pub(crate) fn normal_quantile(probability: f64) -> f64 {
    let (mut low, mut high) = (-8.0, 8.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if 0.5 * libm::erfc(-middle * FRAC_1_SQRT_2) < probability {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A Rayleigh length behind the waist the beam is sqrt 2 as wide, and nowhere more curved: rho = 2 zR.
    #[test]
    fn a_rayleigh_length_from_the_waist() {
        let laser = Laser::focused(0.5e-3, 0.2);
        let rayleigh = PI * 0.25e-3f64.powi(2) / 650e-9;
        println!("Rayleigh length {rayleigh:.4} m");
        let beam = laser.beam(0.2 + rayleigh);
        assert!((beam.radius / 0.25e-3 - 2f64.sqrt()).abs() < 1e-12);
        assert!((1.0 / beam.curvature / rayleigh - 2.0).abs() < 1e-12);
        assert_eq!(laser.beam(0.2).curvature, 0.0);
    }

    /// Contrast of light from paths that are distributed exponentially with mean l,
    /// `C^2 = sum w w' / (1 + (k - k')^2 l^2)`, against that of the whole line,
    /// `C^2 = sqrt(pi) q exp(q^2) erfc(q)` with `q = 1 / 2 l s` (s is the wavenumber's deviation).
    #[test]
    fn the_wavelengths_keep_the_contrast() {
        for (wavelengths, spreads) in [(5, 2.0), (9, 3.0)] {
            let laser = Laser {
                linewidth: 0.5e-9,
                wavelengths,
                ..Laser::focused(1e-3, 0.8)
            };
            let spectrum = laser.spectrum();
            let mut worst = 0.0f64;
            for step in 1..=20 {
                let path = spreads * f64::from(step) / 20.0 / laser.wavenumber_deviation();
                let mut square = 0.0;
                for a in &spectrum {
                    for b in &spectrum {
                        let phase = 2.0 * PI * (a.wavenumber - b.wavenumber) * path;
                        square += a.weight * b.weight / (1.0 + phase * phase);
                    }
                }
                let q = 0.5 / (path * laser.wavenumber_deviation());
                let exact = PI.sqrt() * q * (q * q).exp() * libm::erfc(q);
                worst = worst.max(((square / exact).sqrt() - 1.0).abs());
            }
            println!("{wavelengths} wavelengths: contrast within {worst:.4} up to {spreads}");
            assert!(worst < 0.015);
        }
    }
}
