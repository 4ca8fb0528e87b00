//! A geometry that eq. (1) does not describe: what lies between slit and sensor displaces the light as a lens
//! does. A calibration has to find it from readings.

use std::ops::RangeInclusive;

use anyhow::{Context as _, Result};
use nalgebra::{Matrix3, Vector3};
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use crate::optics::Optics;

/// Distances of the paper's position table, in metres: over these the departure from eq. (1) holds.
pub const RANGE: RangeInclusive<f64> = 0.60..=1.02;
/// From the axis to where the displacement is `third + fifth`, in pixels: about the ends of [`RANGE`].
const FIELD: f64 = 600.0;
/// Points to which eq. (1) is fitted, every 0.4 mm of [`RANGE`].
const POINTS: usize = 1051;

/// Eq. (1), and a displacement by third and fifth order of the distance from the axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DistortedOptics {
    /// Eq. (1).
    pub optics: Optics,
    /// Third-order displacement in pixels, 600 pixels from the axis.
    pub third: f64,
    /// Fifth-order displacement in pixels, there.
    pub fifth: f64,
}

impl DistortedOptics {
    /// A geometry near the nominal one that nobody has been told, another one for each seed: baseline and
    /// focal length are up to 1 % off, the offset up to 5 mm, the angle a quarter to half a degree. It
    /// departs from the eq. (1) that fits it best by `departure` metres at most within [`RANGE`].
    ///
    /// # Errors
    /// No displacement of centres departs by as much: `departure` is not a small part of the range.
    pub fn unknown(seed: u64, departure: f64) -> Result<Self> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut off = |most: f64| random.random_range(-most..most);
        // Far enough that nothing else makes up for it.
        let angle_off = off(1.0).signum() * (0.375 + off(0.125));
        let nominal = Optics::nominal();
        let optics = Optics {
            offset: nominal.offset + off(0.005),
            baseline: nominal.baseline * (1.0 + off(0.01)),
            focal_length: nominal.focal_length * (1.0 + off(0.01)),
            angle: nominal.angle + angle_off.to_radians(),
            ..nominal
        };
        let bends_outwards = off(1.0).signum();
        let fifth_of_third = off(0.2);
        let displaced = |third: f64| Self {
            optics,
            third,
            fifth: fifth_of_third * third,
        };
        // A pixel or so. The departure is nearly proportional: each step leaves a small part of the error.
        let mut third = bends_outwards;
        for _ in 0..8 {
            third *= departure / displaced(third).departure()?;
        }
        Ok(displaced(third))
    }

    /// The centre in pixels of a target at a distance in metres.
    pub fn centre(&self, distance: f64) -> f64 {
        let centre = self.optics.centre(distance);
        centre + self.displacement(centre)
    }

    /// Distance in metres for a centre in pixels.
    pub fn distance(&self, centre: f64) -> f64 {
        // Newton's steps to the centre without displacement, which they double the digits of.
        let mut undisplaced = centre;
        for _ in 0..20 {
            let beyond = undisplaced + self.displacement(undisplaced) - centre;
            undisplaced -= beyond / (1.0 + self.stretch(undisplaced));
        }
        self.optics.distance(undisplaced)
    }

    /// Metres a pixel at a centre, without sign.
    pub fn metres_per_pixel(&self, centre: f64) -> f64 {
        (self.distance(centre + 0.5) - self.distance(centre - 0.5)).abs()
    }

    /// How far the distance is from the eq. (1) that fits it best, in metres, where it is farthest within
    /// [`RANGE`].
    ///
    /// # Errors
    /// No eq. (1) fits.
    pub fn departure(&self) -> Result<f64> {
        let points: Vec<(f64, f64)> = (0..POINTS)
            .map(|point| point as f64 / (POINTS - 1) as f64)
            .map(|share| RANGE.start() + share * (RANGE.end() - RANGE.start()))
            .map(|distance| (self.centre(distance), distance))
            .collect();
        largest_residual_of_eq1(&points).context("no eq. (1) fits the distorted geometry")
    }

    /// Pixels by which light is displaced that would fall on `centre`. Beyond the sensor: as at its end.
    fn displacement(&self, centre: f64) -> f64 {
        let from_axis = centre - self.optics.axis;
        let field = from_axis.clamp(-self.optics.axis, self.optics.axis) / FIELD;
        self.third * field.powi(3) + self.fifth * field.powi(5)
    }

    /// The displacement's derivative by the centre.
    fn stretch(&self, centre: f64) -> f64 {
        let from_axis = centre - self.optics.axis;
        if from_axis.abs() > self.optics.axis {
            return 0.0;
        }
        let field = from_axis / FIELD;
        (3.0 * self.third * field.powi(2) + 5.0 * self.fifth * field.powi(4)) / FIELD
    }
}

/// The largest residual in metres of the best-fitting `d = D + K / (x - xp)`, by Gauss-Newton.
fn largest_residual_of_eq1(points: &[(f64, f64)]) -> Option<f64> {
    // d x = D x + xp d + C with C = K - D xp is linear, which gives the start.
    let mut normal = (Matrix3::zeros(), Vector3::zeros());
    for &(x, d) in points {
        let row = Vector3::new(x, d, 1.0);
        normal.0 += row * row.transpose();
        normal.1 += row * (d * x);
    }
    let linear = normal.0.try_inverse()? * normal.1;
    let (mut offset, mut pole) = (linear.x, linear.y);
    let mut k = linear.z + offset * pole;
    let residual = |offset: f64, k: f64, pole: f64, x: f64, d: f64| d - offset - k / (x - pole);
    for _ in 0..20 {
        let mut normal = (Matrix3::zeros(), Vector3::zeros());
        for &(x, d) in points {
            let beyond = 1.0 / (x - pole);
            let row = Vector3::new(1.0, beyond, k * beyond * beyond);
            normal.0 += row * row.transpose();
            normal.1 += row * residual(offset, k, pole, x, d);
        }
        let step = normal.0.try_inverse()? * normal.1;
        (offset, k, pole) = (offset + step.x, k + step.y, pole + step.z);
    }
    let off = |&(x, d): &(f64, f64)| residual(offset, k, pole, x, d).abs();
    let residuals = points.iter().map(off);
    let largest = residuals.fold(0.0, f64::max);
    largest.is_finite().then_some(largest)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::with;

    /// What a calibration has to get below.
    const DEPARTURE: f64 = 300e-6;

    fn of(seed: u64) -> DistortedOptics {
        DistortedOptics::unknown(seed, DEPARTURE).expect("a geometry")
    }

    fn unknown() -> impl Iterator<Item = (u64, DistortedOptics)> {
        (0..40).map(|seed| (seed, of(seed)))
    }

    fn distances(from: f64, to: f64) -> impl Iterator<Item = f64> {
        (0..=1000).map(move |i| from + (to - from) * f64::from(i) / 1000.0)
    }

    #[test]
    fn light_is_displaced_by_third_and_fifth_order() {
        let nominal = Optics::nominal();
        let straight = DistortedOptics {
            optics: nominal,
            third: 0.0,
            fifth: 0.0,
        };
        let bent = with(straight, |it| (it.third, it.fifth) = (3.0, -0.5));
        for distance in distances(0.3, 3.0) {
            assert_eq!(straight.centre(distance), nominal.centre(distance));
        }
        for (from_axis, displacement) in [
            (0.0, 0.0),
            (600.0, 2.5),
            (-600.0, -2.5),
            (300.0, 3.0 / 8.0 - 0.5 / 32.0),
            (1200.0, 24.0 - 16.0),
        ] {
            let centre = nominal.axis + from_axis;
            let found = bent.centre(nominal.distance(centre)) - centre;
            assert!((found - displacement).abs() < 1e-9, "{from_axis}: {found}");
        }
    }

    /// Also beyond the range and the sensor: from 0.3 m the light falls 4000 pixels beside the axis.
    #[test]
    fn distance_is_the_inverse_of_centre() {
        let mut worst = 0.0_f64;
        for (_, optics) in unknown() {
            for distance in distances(0.3, 3.0) {
                worst = worst.max((optics.distance(optics.centre(distance)) - distance).abs());
            }
        }
        println!("{worst:.1e} m");
        assert!(worst < 1e-12);
    }

    /// dd/dx' = (dd/dx) / (dx'/dx).
    #[test]
    fn the_slope_is_the_straight_one_over_the_stretch() {
        for (seed, optics) in unknown() {
            for distance in distances(0.60, 1.02) {
                let straight = optics.optics.centre(distance);
                let stretched = 1.0 + optics.stretch(straight);
                let expected = optics.optics.metres_per_pixel(straight) / stretched;
                let found = optics.metres_per_pixel(optics.centre(distance));
                let off = found / expected - 1.0;
                assert!(off.abs() < 1e-6, "{seed}: {found} {expected}");
            }
        }
    }

    /// The largest residual of the eq. (1) that fits points best, found in another way: for a given pole d =
    /// D + K / (x - xp) is a straight line, and the pole with the least sum of squares is found by golden
    /// section.
    fn largest_residual_of_best(points: &[(f64, f64)]) -> f64 {
        let mean = |value: &dyn Fn(f64, f64) -> f64| {
            statistics::mean(points.iter().map(|&(x, d)| value(x, d)))
        };
        let residuals = |pole: f64| {
            let u = |x: f64| 1.0 / (x - pole);
            let (of_u, of_d) = (mean(&|x, _| u(x)), mean(&|_, d| d));
            let slope =
                mean(&|x, d| (u(x) - of_u) * (d - of_d)) / mean(&|x, _| (u(x) - of_u).powi(2));
            let residual = move |&(x, d): &(f64, f64)| d - of_d - slope * (u(x) - of_u);
            points.iter().map(residual).collect::<Vec<f64>>()
        };
        let squares = |pole: f64| residuals(pole).iter().map(|r| r * r).sum::<f64>();
        // The pole is where the target would be infinitely far away: thousands of pixels beyond the points.
        let ends = points.iter().map(|&(x, _)| x);
        let least = ends.clone().fold(f64::INFINITY, f64::min);
        let (mut from, mut to) = (least - 20_000.0, least - 100.0);
        for _ in 0..100 {
            let part = 0.381_966_011_250_105 * (to - from);
            let (a, b) = (from + part, to - part);
            match squares(a) < squares(b) {
                true => to = b,
                false => from = a,
            }
        }
        let best = residuals(0.5 * (from + to));
        best.iter().fold(0.0, |most, r| r.abs().max(most))
    }

    /// On another grid than the one that it is made on, and of both signs.
    #[test]
    fn an_unknown_geometry_departs_from_eq_1_as_asked() {
        let mut outwards = 0;
        for (seed, optics) in unknown() {
            let point = |distance| (optics.centre(distance), distance);
            let points: Vec<(f64, f64)> = distances(0.60, 1.02).map(point).collect();
            let largest = largest_residual_of_best(&points);
            if seed < 5 {
                let (third, fifth) = (optics.third, optics.fifth);
                println!("{:.2} um by {third:.3} and {fifth:.3} px", largest * 1e6);
            }
            let off = largest / DEPARTURE - 1.0;
            assert!(off.abs() < 0.01, "{seed}: {largest}");
            outwards += usize::from(optics.third > 0.0);
        }
        assert!((10..=30).contains(&outwards), "{outwards} of 40");
    }

    /// The nominal calibration is off by what a ruler shows; the spot is on the sensor with the whole window
    /// (128 pixels) that is fitted, and nowhere on it do two distances share a centre.
    #[test]
    fn an_unknown_geometry_is_not_the_nominal_one_and_within_sight() {
        let nominal = Optics::nominal();
        let mut errors = vec![];
        for (seed, optics) in unknown() {
            let error = |distance| (nominal.distance(optics.centre(distance)) - distance).abs();
            errors.push(distances(0.60, 1.02).map(error).fold(0.0, f64::max));
            for distance in distances(0.60, 1.02) {
                let centre = optics.centre(distance);
                assert!((64.0..3583.0).contains(&centre), "{seed}: {centre}");
            }
            for pixel in 0..3648 {
                let [near, far] = [1, 0].map(|more| optics.distance(f64::from(pixel + more)));
                assert!(far > near, "{seed}: {far} to {near} at {pixel}");
            }
        }
        errors.sort_by(f64::total_cmp);
        let (least, most) = (errors[0], errors[39]);
        println!("the nominal calibration is off by {least:.4} to {most:.4} m");
        assert!(least > 1e-3 && most < 0.1);
    }

    #[test]
    fn a_seed_always_gives_the_same_geometry() {
        assert_eq!(of(3), of(3));
        assert!(of(3) != of(4));
    }
}
