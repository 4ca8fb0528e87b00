//! The lit scatterers of a view, and the field that each of their rows sends to places across the aperture.

use anyhow::{Result, ensure};

use super::View;
use super::complex::{LANES, Matrix, four_sums, phasor};
use super::laser::{Beam, Laser};
use super::surface::{REACH, Scattering, Surface, Term};

/// The geometry of a view: which rows of scatterers are lit, how much, and their phases.
pub struct Lit {
    /// R, from the laser spot to the aperture, in metres.
    pub range: f64,
    /// The beam at the target.
    pub beam: Beam,
    /// sin(theta) and cos(theta).
    angle: (f64, f64),
    /// Places y of the lit rows, from the beam's axis, in metres.
    pub y: Vec<f64>,
    /// Index of the first lit row and column, not yet wrapped.
    first: [i64; 2],
    /// Scatterers in x to either side of the beam's axis.
    half: usize,
    /// Pitch in x.
    pitch: f64,
    /// The scatterers lie at x = (m + 1/2) pitch + shift, to either side alike but for the shift.
    shift: f64,
    wavelength: f64,
}

impl Lit {
    pub fn new(laser: &Laser, scattering: &Scattering, view: &View) -> Self {
        let beam = laser.beam(view.distance);
        let halves =
            [0, 1].map(|axis| ((REACH * beam.radius / scattering.pitch[axis]).ceil()).max(1.0));
        let middle = [0, 1].map(|axis| (view.lateral[axis] / scattering.pitch[axis]).round());
        let first = [0, 1].map(|axis| middle[axis] as i64 - halves[axis] as i64);
        let y = (0..2 * halves[1] as usize)
            .map(|i| (first[1] as f64 + i as f64 + 0.5) * scattering.pitch[1] - view.lateral[1])
            .collect();
        Self {
            range: view.range(),
            beam,
            angle: (view.sin_angle(), view.cos_angle()),
            y,
            first,
            half: halves[0] as usize,
            pitch: scattering.pitch[0],
            shift: middle[0] * scattering.pitch[0] - view.lateral[0],
            wavelength: laser.wavelength,
        }
    }

    /// # Errors
    /// If the lit part is larger than the surface, which would repeat within it.
    pub fn check(&self, surface: &Surface) -> Result<()> {
        let [columns, rows] = surface.scatterers;
        ensure!(
            2 * self.half <= columns && self.y.len() <= rows,
            "a beam of {:.2} mm in diameter needs a surface of {:.1} mm; it is {:?} m",
            2e3 * self.beam.radius,
            2e3 * REACH * self.beam.radius,
            surface.scattering.size
        );
        Ok(())
    }

    /// The field's amplitude at y, and its phase in turns at the place v of the aperture: what does not
    /// depend on x and u.
    pub fn of_row(&self, y: f64, v: f64) -> (f32, f64) {
        let amplitude = libm::exp(-(y / self.beam.radius).powi(2));
        let path = 0.5 * (y * y * self.beam.curvature + (v - y).powi(2) / self.range);
        (amplitude as f32, path / self.wavelength)
    }

    /// Phase in turns at the place u of the aperture that is the same for all scatterers.
    pub fn of_place(&self, u: f64) -> f64 {
        u * (0.5 * u - self.shift * self.angle.1) / (self.range * self.wavelength)
    }

    /// Turns of phase that a scatterer at x has at u more than at the aperture's middle, but for the shift.
    fn tilt(&self, u: f64, x: f64) -> f64 {
        -u * x * self.angle.1 / (self.range * self.wavelength)
    }

    /// Places x over the beam, close enough for the mean through an aperture so many metres wide, and the
    /// light from each, in units of one scatterer of amplitude 1.
    pub fn mean_places(&self, aperture: f64) -> Vec<(f64, f64)> {
        // The trapezoidal rule. It is exact to 1e-9 for a gaussian at five steps to a radius, and for the
        // aperture's diffraction at one step to lambda R / aperture / cos(theta).
        let step = (0.2 * self.beam.radius).min(0.9 * self.wavelength * self.range / aperture);
        let half = (REACH * self.beam.radius / step).ceil() as i32;
        let step = REACH * self.beam.radius / f64::from(half);
        let place = |i: i32| {
            let x = f64::from(i) * step;
            let ends = if i.abs() == half { 0.5 } else { 1.0 };
            let light = libm::exp(-2.0 * (x / self.beam.radius).powi(2));
            (x, ends * light * step / self.pitch)
        };
        (-half..=half).map(place).collect()
    }

    /// All light of the beam on the surface, in the mean, in units of one scatterer of amplitude 1.
    pub fn light(&self) -> f64 {
        let across: f64 = self.mean_places(0.0).iter().map(|&(_, light)| light).sum();
        let amplitudes = self.y.iter().map(|&y| f64::from(self.of_row(y, y).0));
        let squares = amplitudes.map(|amplitude| amplitude * amplitude);
        across * squares.sum::<f64>()
    }

    /// The fields at places `u` of the aperture (columns) that light from each of the places x (rows) makes,
    /// without what [`Lit::of_place`] gives.
    pub fn mean_fields(&self, from: &[(f64, f64)], u: &[f64]) -> Matrix {
        Matrix::from_fn(from.len(), u.len(), |x, column| {
            phasor(self.tilt(u[column], from[x].0 - self.shift))
        })
    }
}

/// The sum over x for places u of the aperture that come in pairs +u and -u.
pub struct RowSums<'a> {
    lit: &'a Lit,
    surface: &'a Surface,
    /// For each wavelength the beam's amplitude and each scatterer's phase at the aperture's middle, along x.
    beams: Vec<(Vec<f32>, Vec<f32>)>,
    /// cos and sin of the tilt for each pair (rows) and place to the right of the beam's axis (columns).
    tilts: Matrix,
    pairs: usize,
    /// Space for a row: the scatterers' waves, and their sums and differences left and right.
    re: Vec<f32>,
    im: Vec<f32>,
    sums: [Vec<f32>; 4],
}

impl<'a> RowSums<'a> {
    /// Prepares for the positive places `u` of the aperture, in metres.
    pub fn new(lit: &'a Lit, surface: &'a Surface, u: &[f64]) -> Self {
        let (sin, cos) = lit.angle;
        let lens = 0.5 * (cos * cos / lit.range + lit.beam.curvature);
        let beam = |wavenumber: f64| {
            let of = |i| {
                let x = (i as f64 - lit.half as f64 + 0.5) * lit.pitch + lit.shift;
                let (re, im) = phasor(wavenumber * x * (x * lens - sin));
                let amplitude = libm::exp(-(x / lit.beam.radius).powi(2)) as f32;
                (amplitude * re, amplitude * im)
            };
            (0..2 * lit.half).map(of).unzip()
        };
        let padded = lit.half.next_multiple_of(LANES);
        Self {
            lit,
            surface,
            beams: (surface.laser.spectrum().iter())
                .map(|line| beam(line.wavenumber))
                .collect(),
            tilts: Matrix::from_fn(u.len(), lit.half, |pair, m| {
                phasor(-lit.tilt(u[pair], (m as f64 + 0.5) * lit.pitch))
            }),
            pairs: u.len(),
            re: vec![0.0; 2 * lit.half],
            im: vec![0.0; 2 * lit.half],
            sums: std::array::from_fn(|_| vec![0.0; padded]),
        }
    }

    /// A matrix for the fields: a row for each lit row of scatterers; the columns are first all +u, then all
    /// -u.
    pub fn fields(&self) -> Matrix {
        Matrix::zeros(self.lit.y.len(), 2 * self.pairs)
    }

    /// The fields of one polarisation and wavelength, without what [`Lit::of_row`] and [`Lit::of_place`]
    /// give.
    pub fn set_fields(&mut self, term: &Term, fields: &mut Matrix) {
        let [columns, rows] = self.surface.scatterers;
        for row in 0..self.lit.y.len() {
            let from = (self.lit.first[1] + row as i64).rem_euclid(rows as i64) as usize * columns;
            self.set_waves(term, from, columns);
            self.fold();
            let [a, b, c, d] = &self.sums;
            let to = row * fields.stride..(row + 1) * fields.stride;
            let (to_re, to_im) = (&mut fields.re[to.clone()], &mut fields.im[to]);
            for pair in 0..self.pairs {
                let (cos, sin) = self.tilts.row(pair);
                // Even part (p + i q) and odd part (r + i s): a wave at +u is even - i odd.
                let [p, q, r, s] = four_sums([a, b, c, d], [cos, sin]);
                (to_re[pair], to_im[pair]) = (p + s, q - r);
                (to_re[self.pairs + pair], to_im[self.pairs + pair]) = (p - s, q + r);
            }
        }
    }

    /// Scatterers times beam, of a surface that repeats.
    fn set_waves(&mut self, term: &Term, from: usize, columns: usize) {
        let (beam_re, beam_im) = &self.beams[term.line];
        let start = self.lit.first[0].rem_euclid(columns as i64) as usize;
        let lit = 2 * self.lit.half;
        let whole = lit.min(columns - start);
        // (first scatterer, first place in the lit part, count)
        for (scatterer, place, count) in [(start, 0, whole), (0, whole, lit - whole)] {
            let scatterers = from + scatterer..from + scatterer + count;
            let places = place..place + count;
            let (a_re, a_im) = (&term.re[scatterers.clone()], &term.im[scatterers]);
            let (b_re, b_im) = (&beam_re[places.clone()], &beam_im[places.clone()]);
            let (to_re, to_im) = (&mut self.re[places.clone()], &mut self.im[places]);
            for i in 0..count {
                to_re[i] = a_re[i] * b_re[i] - a_im[i] * b_im[i];
                to_im[i] = a_re[i] * b_im[i] + a_im[i] * b_re[i];
            }
        }
    }

    /// As cos(tilt) is even in x and sin(tilt) odd, only sums and differences of the waves left and right of
    /// the axis are needed:
    /// half the products, and both places of a pair at once another half.
    fn fold(&mut self) {
        let half = self.lit.half;
        let [sum_re, sum_im, difference_re, difference_im] = &mut self.sums;
        for (waves, sums, differences) in [
            (&self.re, sum_re, difference_re),
            (&self.im, sum_im, difference_im),
        ] {
            let (left, right) = waves.split_at(half);
            let to = sums.iter_mut().zip(differences.iter_mut());
            for ((l, r), (sum, difference)) in left.iter().rev().zip(right).zip(to) {
                *sum = r + l;
                *difference = r - l;
            }
        }
    }
}
