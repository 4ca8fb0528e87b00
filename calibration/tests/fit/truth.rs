//! Points whose truth is known.

use calibration::points::Point;
use nalgebra::Vector3;
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution as _, StandardNormal};
use simulator::optics::Optics;
use simulator::with;
use statistics::rms;

/// The nominal geometry on the pixels of a TCD1304DG, with a lens-like distortion of the row.
pub struct Truth {
    optics: Optics,
    /// By how much of itself the place on the sensor, from the axis, is moved at the row's end.
    distortion: f64,
}

/// From the axis to the row's end, in pixels.
const HALF_ROW: f64 = 1824.0;
/// The range of distances in metres.
pub const NEAR: f64 = 0.60;
pub const FAR: f64 = 1.02;

impl Truth {
    pub fn nominal() -> Self {
        Self::distorted(0.0)
    }

    /// That of the paper, on the pixels of its camera: 5.86 um.
    pub fn paper() -> Self {
        Self {
            optics: with(Optics::nominal(), |it| {
                (it.pitch, it.axis) = (5.86e-6, 959.5)
            }),
            distortion: 0.0,
        }
    }

    pub fn distorted(distortion: f64) -> Self {
        Self {
            optics: Optics::nominal(),
            distortion,
        }
    }

    /// D in metres, K in metre pixels and xp in pixels.
    pub fn parameters(&self) -> Vector3<f64> {
        let it = &self.optics;
        let (t, f) = (it.angle.tan(), it.focal_length / it.pitch);
        Vector3::new(
            it.offset - it.baseline / t,
            it.baseline * f * (1.0 + t * t) / (t * t),
            it.axis - f / t,
        )
    }

    /// The centre in pixels for a distance in metres.
    pub fn centre(&self, distance: f64) -> f64 {
        let axis = self.optics.axis;
        let from_axis = self.optics.centre(distance) - axis;
        axis + from_axis * (1.0 + self.distortion * (from_axis / HALF_ROW).powi(2))
    }

    /// The distance in metres for a centre in pixels.
    pub fn distance(&self, centre: f64) -> f64 {
        let axis = self.optics.axis;
        // The distortion is small: each step leaves a small part of the error.
        let mut undistorted = centre;
        for _ in 0..20 {
            let over = self.distortion * ((undistorted - axis) / HALF_ROW).powi(2);
            undistorted = axis + (centre - axis) / (1.0 + over);
        }
        self.optics.distance(undistorted)
    }

    /// Points at even steps, with gaussian noise of the centre in pixels.
    pub fn points(&self, count: usize, noise: f64, random: &mut ChaCha8Rng) -> Vec<Point> {
        let mut point = |i| {
            let distance = NEAR + (FAR - NEAR) * i as f64 / (count - 1) as f64;
            let normal: f64 = StandardNormal.sample(random);
            Point {
                line: i as u64 + 2,
                x_px: self.centre(distance) + noise * normal,
                d_mm: distance * 1e3,
                ..Point::default()
            }
        };
        (0..count).map(&mut point).collect()
    }

    /// Error of a curve in micrometres: root mean square and largest over even steps of the distance.
    pub fn error(&self, curve: impl Fn(f64) -> f64) -> (f64, f64) {
        self.error_where(|_| true, curve)
    }

    /// The root mean square over even steps of the centre.
    pub fn error_over_centres(&self, curve: impl Fn(f64) -> f64) -> f64 {
        const STEPS: usize = 400;
        let (from, to) = (self.optics.centre(NEAR), self.optics.centre(FAR));
        rms((0..=STEPS).map(|i| {
            let undistorted = from + (to - from) * i as f64 / STEPS as f64;
            let distance = self.optics.distance(undistorted);
            1e6 * (curve(self.centre(distance)) - distance)
        }))
    }

    /// The same over those distances for whose centres something holds.
    pub fn error_where(
        &self,
        holds: impl Fn(f64) -> bool,
        curve: impl Fn(f64) -> f64,
    ) -> (f64, f64) {
        const STEPS: usize = 400;
        let distances = (0..=STEPS).map(|i| NEAR + (FAR - NEAR) * i as f64 / STEPS as f64);
        let distances = distances.filter(|&distance| holds(self.centre(distance)));
        let errors = distances.map(|at| 1e6 * (curve(self.centre(at)) - at));
        let errors: Vec<f64> = errors.collect();
        let largest = errors.iter().map(|error| error.abs()).fold(0.0, f64::max);
        (rms(&errors), largest)
    }
}

pub fn seeded(seed: u64) -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(seed)
}

/// Moves that many of the points off, each by up to so many pixels: at least half of it, to either side or to
/// one.
pub fn throw_off(
    points: &mut [Point],
    count: usize,
    size: f64,
    one_sided: bool,
    random: &mut ChaCha8Rng,
) -> Vec<u64> {
    let mut lines = Vec::new();
    while lines.len() < count {
        let point = &mut points[random.random_range(0..points.len())];
        if lines.contains(&point.line) {
            continue;
        }
        let is_up = one_sided || random.random();
        let sign = if is_up { 1.0 } else { -1.0 };
        point.x_px += sign * size * random.random_range(0.5..1.0);
        lines.push(point.line);
    }
    lines
}
