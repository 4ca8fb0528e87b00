//! The rough surface: scatterers on a lattice, each with a random amplitude and phase, and an extra path in
//! the material.

use anyhow::{Result, ensure};
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use super::complex::phasor;
use super::laser::Laser;

/// How a surface scatters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scattering {
    /// 1, or 2 where the surface depolarises: then two independent speckle patterns of half the light each
    /// add up.
    pub polarisations: usize,
    /// Mean of the extra optical path in the material, in metres, which is distributed exponentially; 0 for a
    /// surface that light does not enter. It is the whole path, there and back, times the refractive index.
    pub path_spread: f64,
    /// From scatterer to scatterer along x and y, in metres.
    ///
    /// Along x the field repeats when sin(theta) changes by lambda / pitch. The table's 0.6 to 1.02 m are
    /// 0.166 of sin(theta), an aperture adds 0.006: below 3.8 um. Along y it repeats within the aperture at
    /// lambda R / pitch; R is 0.67 m and more, the aperture 4.2 mm at most: below 104 um, less a speckle's
    /// size.
    pub pitch: [f64; 2],
    /// Size of the surface in metres, beyond which it repeats. A beam larger than that is refused.
    pub size: [f64; 2],
}

impl Scattering {
    /// One polarisation from the very surface, good for the table from 0.6 to 1.02 m.
    pub fn surface() -> Self {
        Self {
            polarisations: 1,
            path_spread: 0.0,
            pitch: [3.6e-6, 90e-6],
            size: [8e-3, 8e-3],
        }
    }
}

/// A scatterer's reach, in radii of the beam: beyond, its light is below 4e-5 of the middle's.
pub(super) const REACH: f64 = 2.25;

/// A prepared surface: the scatterers' complex amplitudes for each polarisation and wavelength.
#[derive(Clone, Debug)]
pub struct Surface {
    /// The laser that it was prepared for.
    pub laser: Laser,
    /// How it scatters.
    pub scattering: Scattering,
    /// Scatterers along x and y.
    pub(super) scatterers: [usize; 2],
    /// For each polarisation and wavelength.
    pub(super) terms: Vec<Term>,
}

/// The scatterers in one polarisation at one wavelength.
#[derive(Clone, Debug)]
pub(super) struct Term {
    /// Index of the wavelength in [`Laser::spectrum`].
    pub line: usize,
    /// Share of the light.
    pub weight: f64,
    /// Real parts of the amplitudes, a row along x after the other; their mean square is 1/2.
    pub re: Vec<f32>,
    /// Imaginary parts.
    pub im: Vec<f32>,
}

impl Surface {
    /// A surface of circular complex gaussian scatterers. The random numbers of a polarisation's row of
    /// scatterers are a stream of their own.
    ///
    /// # Errors
    /// If polarisations are neither 1 nor 2, or a pitch or size is not positive.
    pub fn new(laser: &Laser, scattering: &Scattering, seed: u64) -> Result<Self> {
        let Scattering {
            polarisations,
            path_spread,
            pitch,
            size,
        } = *scattering;
        ensure!(
            (1..=2).contains(&polarisations),
            "light has 1 or 2 polarisations, not {polarisations}"
        );
        ensure!(
            pitch.iter().chain(&size).all(|&length| length > 0.0),
            "pitch {pitch:?} m and size {size:?} m of a surface must be positive"
        );
        let scatterers = [0, 1].map(|axis| (size[axis] / pitch[axis]).round().max(1.0) as usize);
        let [columns, rows] = scatterers;
        let spectrum = laser.spectrum();
        let mut terms = Vec::new();
        for polarisation in 0..polarisations {
            // Amplitude, phase in turns, and extra path in metres.
            let mut drawn = Vec::with_capacity(columns * rows);
            for row in 0..rows {
                let mut random = ChaCha8Rng::seed_from_u64(seed);
                random.set_stream((polarisation * rows + row) as u64);
                for _ in 0..columns {
                    // 1 - x: a logarithm of zero is out of the question.
                    let mut exponential = || -libm::log(1.0 - random.random::<f64>());
                    let amplitude = exponential().sqrt();
                    let path = match path_spread > 0.0 {
                        true => path_spread * exponential(),
                        false => 0.0,
                    };
                    drawn.push((amplitude as f32, random.random::<f64>(), path));
                }
            }
            for (line, spectral) in spectrum.iter().enumerate() {
                let wavenumber = spectral.wavenumber - 1.0 / laser.wavelength;
                let amplitude = |&(amplitude, turns, path): &(f32, f64, f64)| {
                    let (re, im) = phasor(turns + wavenumber * path);
                    (amplitude * re, amplitude * im)
                };
                let (re, im) = drawn.iter().map(amplitude).unzip();
                terms.push(Term {
                    line,
                    weight: spectral.weight / polarisations as f64,
                    re,
                    im,
                });
            }
        }
        Ok(Self {
            laser: *laser,
            scattering: *scattering,
            scatterers,
            terms,
        })
    }

    /// The same with a texture: the reflectance at each place (x, y) in metres from the surface's middle,
    /// within half its size.
    /// Its mean should be 1, as the unit of light is that of a surface without texture.
    #[must_use]
    pub fn with_reflectance(mut self, reflectance: impl Fn(f64, f64) -> f64) -> Self {
        let [columns, rows] = self.scatterers;
        let amplitudes: Vec<f32> = (0..columns * rows)
            .map(|i| [self.place(i % columns, 0), self.place(i / columns, 1)])
            .map(|[x, y]| reflectance(x, y).sqrt() as f32)
            .collect();
        self.dim(&amplitudes);
        self
    }

    /// Multiplies the amplitudes with these, again and again.
    fn dim(&mut self, amplitudes: &[f32]) {
        let terms = self.terms.iter_mut();
        let parts = terms.flat_map(|it| [&mut it.re, &mut it.im]);
        for values in parts.flat_map(|it| it.chunks_exact_mut(amplitudes.len())) {
            let pairs = values.iter_mut().zip(amplitudes);
            pairs.for_each(|(value, amplitude)| *value *= amplitude);
        }
    }

    /// The same with a texture that varies along x only: the reflectance at each place x in metres. It is
    /// asked for once for a column of scatterers, which takes a hundredth of the time.
    #[must_use]
    pub fn with_reflectance_along(mut self, reflectance: impl Fn(f64) -> f64) -> Self {
        let [columns, _] = self.scatterers;
        let amplitudes: Vec<f32> = (0..columns)
            .map(|column| reflectance(self.place(column, 0)).sqrt() as f32)
            .collect();
        self.dim(&amplitudes);
        self
    }

    /// A scatterer's place in metres along an axis. The second half stands for negative places.
    fn place(&self, index: usize, axis: usize) -> f64 {
        let count = self.scatterers[axis];
        let signed = (index + count / 2) % count;
        (signed as f64 - (count / 2) as f64 + 0.5) * self.scattering.pitch[axis]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::with;

    /// Circular complex gaussian: mean |a|^2 1, mean |a|^4 2, no mean, no mean square; within five standard
    /// errors of 200,000.
    #[test]
    fn amplitudes_are_circular_complex_gaussian() {
        let surface = Surface::new(&Laser::focused(1e-3, 0.8), &Scattering::surface(), 3).unwrap();
        let term = &surface.terms[0];
        let n = term.re.len() as f64;
        let mean = |value: &dyn Fn(f64, f64) -> f64| {
            let pairs = term.re.iter().zip(&term.im);
            statistics::mean(pairs.map(|(&re, &im)| value(re.into(), im.into())))
        };
        let power = mean(&|re, im| re * re + im * im);
        let fourth = mean(&|re, im| (re * re + im * im).powi(2));
        let (offset, square, product) = (
            mean(&|re, _| re),
            mean(&|re, im| re * re - im * im),
            mean(&|re, im| re * im),
        );
        println!("{n} scatterers: {power:.4} {fourth:.4} {offset:.4} {square:.4} {product:.4}");
        let error = 5.0 / n.sqrt();
        assert!((power - 1.0).abs() < error && (fourth - 2.0).abs() < 4.5 * error);
        assert!(offset.abs() < error && square.abs() < error && product.abs() < error);
    }

    #[test]
    fn a_reflectance_along_x_is_one_that_ignores_y() {
        let laser = Laser::focused(1e-3, 0.8);
        let scattering = with(Scattering::surface(), |it| it.size = [1e-3, 1e-3]);
        let surface = || Surface::new(&laser, &scattering, 5).unwrap();
        let reflectance = |x: f64| 1.0 + 1e3 * x;
        let along = surface().with_reflectance_along(reflectance);
        let plane = surface().with_reflectance(|x, _| reflectance(x));
        assert_eq!(along.terms[0].re, plane.terms[0].re);
        assert_eq!(along.terms[0].im, plane.terms[0].im);
        assert_ne!(along.terms[0].re, surface().terms[0].re);
    }
}
