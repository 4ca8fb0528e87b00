//! What a lens does that a slit does not: it is focused on one distance, and has aberrations.
//!
//! They belong to a lens ([`crate::optics::Aperture::Lens`]); a slit has neither focus nor pupil to speak of.
//!
//! Defocus and coma are errors of the wavefront in the pupil, W(u, v) in metres. With
//! [`crate::scene::Diffraction`] the light of a point is the pupil's Fourier transform, squared; without, it
//! is spread as rays are, each of which meets the sensor z grad(W) beside the geometric centre, on the
//! gaussian of the scene's spot. Both conserve the light and have the same centre of mass, z <dW/du>.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use serde::{Deserialize, Serialize};

use crate::field::quadrature::gauss_legendre;
use crate::scene::Scene;
use crate::scene::diffraction::sinc;
use crate::scene::shape::geometric_centre;

/// The lens is focused on one distance, and the target is at another. The sensor stays where it is.
///
/// W = D^2/8 (1/d - 1/focus_distance) at the pupil's edge, for a pupil of diameter D and a target at d along
/// the optical axis: a disc of diameter D z |1/d - 1/focus_distance| by geometrical optics (Goodman,
/// Introduction to Fourier Optics, section 6.4.4). A scene that does not list it is in focus wherever the
/// target is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Defocus {
    /// From the lens to the plane that is sharp, along the axis, in metres.
    pub focus_distance: f64,
}

/// Third-order coma: points off the axis have a tail, away from the axis where `waves` is positive (W131 in
/// Hopkins's notation).
///
/// W = W131 rho^2 (u/a), rho being the distance from the pupil's middle over its radius a; W131 grows with
/// the distance from the axis.
/// The centre of mass moves by z W131 / a: two thirds of the tail's length, 3 z W131 / a, lie beyond it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Coma {
    /// Wavefront error at the pupil's edge for a point at `field`, in waves.
    pub waves: f64,
    /// Distance from the axis on the sensor for which `waves` holds, in metres.
    pub field: f64,
}

/// Third-order distortion: a point at x is drawn at x (1 + share (x / field)^2), both from the axis
/// (pincushion where `share` is positive, barrel where it is negative).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Distortion {
    /// Displacement over distance from the axis, at `field`: 0.001 for 0.1 %.
    pub share: f64,
    /// Distance from the axis on the sensor for which `share` holds, in metres.
    pub field: f64,
}

impl Distortion {
    /// Where a point at `centre` is drawn, in pixels.
    pub fn displaced(&self, centre: f64, axis: f64, pitch: f64) -> f64 {
        let x = centre - axis;
        let relative = x * pitch / self.field;
        axis + x * (1.0 + self.share * relative * relative)
    }
}

/// A lens's pupil and the error of the wavefront in it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pupil {
    /// a: its radius, in metres.
    pub radius: f64,
    /// z: from it to the sensor, in metres.
    pub to_sensor: f64,
    /// The light's wavelength, in metres.
    pub wavelength: f64,
    /// W020: defocus at the edge, in metres.
    pub defocus: f64,
    /// W131: coma at the edge, in metres.
    pub coma: f64,
}

/// Light across the rows that a row gathers: a pixel's height about a place, and the laser spot's image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Across {
    /// All of it: a pixel that is much taller than the spot.
    All,
    /// That of a pixel `height` high, `place` from the geometric centre, where a point's light is spread by a
    /// gaussian of sigma `blur` besides; in metres.
    Pixel {
        /// From the geometric centre.
        place: f64,
        /// The pixel's.
        height: f64,
        /// Sigma.
        blur: f64,
    },
}

/// A ray: where it meets the sensor, from the geometric centre in metres, along and across the rows, and its
/// share of the light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Along the rows.
    pub x: f64,
    /// Across the rows.
    pub y: f64,
    /// Its light over that of all.
    pub weight: f64,
}

impl Pupil {
    /// The pupil of a scene's lens of a diameter in metres, for a target at a distance in metres.
    pub(crate) fn of(scene: &Scene, diameter: f64, distance: f64) -> Self {
        let (optics, radius) = (&scene.optics, 0.5 * diameter);
        let (centre, range) = (geometric_centre(scene, distance), optics.range(distance));
        let cosine = optics.focal_length / libm::hypot(optics.focal_length, centre);
        Self {
            radius,
            to_sensor: optics.focal_length,
            wavelength: optics.wavelength,
            defocus: scene.defocus.map_or(0.0, |it| {
                0.5 * radius * radius * (1.0 / (range * cosine) - 1.0 / it.focus_distance)
            }),
            coma: (scene.coma).map_or(0.0, |it| it.waves * optics.wavelength * centre / it.field),
        }
    }

    /// The same without any error.
    pub fn ideal(&self) -> Self {
        Self {
            defocus: 0.0,
            coma: 0.0,
            ..*self
        }
    }

    /// lambda z / D in metres: no detail of any pattern is finer than a wave of this length.
    pub fn detail(&self) -> f64 {
        self.wavelength * self.to_sensor / (2.0 * self.radius)
    }

    /// How far from the geometric centre rays meet the sensor at most, in metres.
    pub fn farthest_ray(&self) -> f64 {
        self.to_sensor / self.radius * (2.0 * self.defocus.abs() + 3.0 * self.coma.abs())
    }

    /// The error of the wavefront in metres, at a place in the pupil in units of its radius.
    fn wavefront(&self, u: f64, v: f64) -> f64 {
        (u * u + v * v) * (self.defocus + self.coma * u)
    }

    /// Rays through evenly weighted parts of the pupil, close enough together for a gaussian of this sigma on
    /// the sensor.
    pub fn rays(&self, sigma: f64) -> Vec<Ray> {
        // At most pi farthest_ray / nodes apart, which is 1.3 sigma.
        let nodes = 2 * (4.0 + 1.25 * self.farthest_ray() / sigma).ceil() as usize;
        let scale = self.to_sensor / self.radius;
        let mut rays = vec![];
        for (t, weight_t) in both_sides(nodes) {
            let (v, half_chord) = libm::sincos(FRAC_PI_2 * t);
            for (place, weight_u) in both_sides(nodes) {
                let u = half_chord * place;
                rays.push(Ray {
                    x: scale * (2.0 * self.defocus * u + self.coma * (3.0 * u * u + v * v)),
                    y: scale * (2.0 * self.defocus * v + self.coma * 2.0 * u * v),
                    // dv = cos dt, and du = half_chord d(place); the disc's area is pi.
                    weight: weight_t * weight_u * FRAC_PI_2 * half_chord * half_chord / PI,
                });
            }
        }
        rays
    }

    /// The field of each chord of the pupil, for places on the sensor along the row.
    pub fn chords(&self, step: f64, reach: f64, farthest_across: f64) -> Chords {
        let k = TAU / self.wavelength;
        let knots = (reach / step).ceil() as i64;
        // Radians from the pupil's middle to its edge, of the wave to the farthest place and of the error of
        // the wavefront: half as many places as radians, and some more, integrate such a wave.
        let error = k * (2.0 * self.defocus.abs() + 3.0 * self.coma.abs());
        let tilt = |place: f64| k * place * self.radius / self.to_sensor;
        let even = |radians: f64| 2 * (0.25 * radians + 6.0).ceil() as usize;
        let along = both_sides(even(tilt(reach) + error));
        // The chord at v = a sin(t) has the half length a cos(t), which takes a wave along it through pi/2
        // times as many radians over t; its field squared has twice as many.
        let chords = gauss_legendre(even(PI * tilt(reach.max(farthest_across)) + error));
        let chords = chords.into_iter().map(|(t, weight)| {
            let (v, half_chord) = libm::sincos(FRAC_PI_2 * t);
            let mut field = vec![(0.0, 0.0); 2 * knots as usize + 1];
            for &(place, weight_u) in &along {
                let u = half_chord * place;
                let turn = -k * step * u * self.radius / self.to_sensor;
                let (sin, cos) = libm::sincos(turn);
                let (mut im, mut re) = libm::sincos(k * self.wavefront(u, v) - knots as f64 * turn);
                for field in &mut field {
                    field.0 += weight_u * re;
                    field.1 += weight_u * im;
                    (re, im) = (re * cos - im * sin, re * sin + im * cos);
                }
            }
            Chord {
                v: v * self.radius,
                half_chord,
                weight: weight * FRAC_PI_2,
                field,
            }
        });
        Chords {
            wavenumber: k / self.to_sensor,
            radius: self.radius,
            chords: chords.collect(),
        }
    }
}

/// The nodes of [`gauss_legendre`] on both sides of zero.
fn both_sides(nodes: usize) -> Vec<(f64, f64)> {
    let right = gauss_legendre(nodes);
    let left = right.iter().rev().map(|&(place, weight)| (-place, weight));
    left.chain(right.iter().copied()).collect()
}

/// The light that goes through the pupil, chord by chord; the chords at -v are as those at v.
#[derive(Clone, Debug)]
pub struct Chords {
    /// k / z.
    wavenumber: f64,
    /// a.
    radius: f64,
    chords: Vec<Chord>,
}

#[derive(Clone, Debug)]
struct Chord {
    /// Where it cuts the pupil, in metres from the middle.
    v: f64,
    /// Half of its length, in radii of the pupil.
    half_chord: f64,
    /// Weight of the quadrature over t, where v = a sin(t) and dv = a half_chord dt.
    weight: f64,
    /// Its field over half_chord at each place along the row, real and imaginary.
    field: Vec<(f64, f64)>,
}

impl Chords {
    /// The light along a row: its mean over a pixel's height, or, for all of it, its integral in metres; in a
    /// unit that depends on the pupil's size only.
    ///
    /// The field at (x, y) is the sum of the chords' fields times exp(-i k v y / z). Its square, weighted
    /// over y, is the sum over pairs of chords of the product of their fields times the transform of the
    /// weight at the difference of their v; all of y leaves each chord with itself (Parseval: 2 pi z / k
    /// times the integral over v).
    pub fn row(&self, across: Across) -> Vec<f64> {
        let mut light = vec![0.0; self.chords.first().map_or(0, |chord| chord.field.len())];
        match across {
            Across::All => {
                for chord in &self.chords {
                    let both_sides = 2.0 * TAU / (self.wavenumber * self.radius);
                    let weight = both_sides * chord.weight * chord.half_chord.powi(3);
                    for (light, (re, im)) in light.iter_mut().zip(&chord.field) {
                        *light += weight * (re * re + im * im);
                    }
                }
            }
            Across::Pixel {
                place,
                height,
                blur,
            } => {
                let weight_at = |v: f64| {
                    let q = self.wavenumber * v;
                    sinc(0.5 * q * height)
                        * libm::exp(-0.5 * (q * blur).powi(2))
                        * libm::cos(q * place)
                };
                for (i, a) in self.chords.iter().enumerate() {
                    for b in &self.chords[i..] {
                        // Of the pairs (v, v'), (v, -v'), (-v, v') and (-v, -v').
                        let pairs = 2.0 * (weight_at(a.v - b.v) + weight_at(a.v + b.v));
                        let both = if std::ptr::eq(a, b) { 1.0 } else { 2.0 };
                        let weight = both * pairs * a.part() * b.part();
                        if weight.abs() < 1e-9 {
                            continue;
                        }
                        for (light, (a, b)) in light.iter_mut().zip(a.field.iter().zip(&b.field)) {
                            *light += weight * (a.0 * b.0 + a.1 * b.1);
                        }
                    }
                }
            }
        }
        light
    }
}

impl Chord {
    /// What its `field` counts for in the pupil's.
    fn part(&self) -> f64 {
        self.weight * self.half_chord * self.half_chord
    }
}
