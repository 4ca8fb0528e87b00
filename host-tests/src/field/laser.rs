//! The laser: a gaussian beam with a gaussian spectrum.

use std::f64::consts::{LN_2, PI};

/// A laser whose beam is gaussian in space and whose line is gaussian in wavelength.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Laser {
    /// Wavelength in metres.
    pub wavelength: f64,
    /// Full width of the line at half its maximum, in metres; 0 for a single wavelength.
    pub linewidth: f64,
    /// How many wavelengths stand for the line, at least 1; without linewidth there is only one. See [`Laser::spectrum`].
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
    /// A single wavelength of 650 nm and a waist of a 1/e^2 diameter in metres on the target, `distance` metres away.
    pub fn focused(waist_diameter: f64, distance: f64) -> Self {
        Self {
            wavelength: 650e-9,
            linewidth: 0.0,
            wavelengths: 1,
            waist_diameter,
            waist_distance: distance,
        }
    }

    /// The beam at a distance in metres: w = w0 sqrt(1 + (z/zR)^2), 1/rho = z / (z^2 + zR^2), zR = pi w0^2 / lambda, with z from the
    /// waist (Siegman, Lasers, 1986, section 17.1).
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

    /// The wavelengths that stand for the line, evenly spaced in the wavenumber (trapezoidal rule).
    ///
    /// With n of them h = sqrt(2 pi / n) standard deviations apart, the coherence of two paths is right while their difference
    /// times [`Laser::wavenumber_deviation`] stays below pi / h = sqrt(pi n / 2); there the error is smallest that the spacing
    /// (coherence that comes back) and the cut ends make together.
    pub fn spectrum(&self) -> Vec<SpectralLine> {
        let centre = 1.0 / self.wavelength;
        if self.linewidth == 0.0 || self.wavelengths <= 1 {
            return vec![SpectralLine {
                wavenumber: centre,
                weight: 1.0,
            }];
        }
        let n = self.wavelengths as f64;
        let step = (2.0 * PI / n).sqrt();
        let deviation = self.wavenumber_deviation() / (2.0 * PI);
        let places = (0..self.wavelengths).map(|i| (i as f64 - 0.5 * (n - 1.0)) * step);
        let weight = |place: f64| libm::exp(-0.5 * place * place);
        let sum: f64 = places.clone().map(weight).sum();
        places
            .map(|place| SpectralLine {
                wavenumber: centre + place * deviation,
                weight: weight(place) / sum,
            })
            .collect()
    }
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

    /// The spectrum's coherence sum w exp(i k path) is exp(-(deviation path)^2 / 2) as far as the documentation says.
    #[test]
    fn the_wavelengths_keep_the_coherence() {
        for wavelengths in [5, 9, 15] {
            let laser = Laser {
                linewidth: 1e-9,
                wavelengths,
                ..Laser::focused(1e-3, 0.8)
            };
            let deviation = laser.wavenumber_deviation();
            let reach = (PI * wavelengths as f64 / 2.0).sqrt();
            let mut worst = 0.0f64;
            for step in 0..=100 {
                let phase = reach * f64::from(step) / 100.0;
                let coherence: f64 = laser
                    .spectrum()
                    .iter()
                    .map(|line| {
                        let k = 2.0 * PI * (line.wavenumber - 1.0 / laser.wavelength);
                        line.weight * (k * phase / deviation).cos()
                    })
                    .sum();
                worst = worst.max((coherence - (-0.5 * phase * phase).exp()).abs());
            }
            println!("{wavelengths} wavelengths: coherence within {worst:.4} up to {reach:.2}");
            assert!(worst < 1.3 * (-0.25 * PI * wavelengths as f64).exp() + 1e-3);
        }
    }
}
