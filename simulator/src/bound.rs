//! The Cramér-Rao bound: the smallest standard deviation that any unbiased estimate of a spot's centre can
//! have, when its amplitude, width and black level are unknown too.

use std::ops::RangeInclusive;

use nalgebra::{Matrix4, Vector4};
use phase_tables::gaussian;
use statistics::rms;

use crate::scene::{Effect, Simulation};

/// A spot and the noise on it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spot {
    /// Sigma in pixels.
    pub width: f64,
    /// Height in counts.
    pub amplitude: f64,
    /// Standard deviation of the white noise in counts, rounding to counts apart (its 1/12 is added).
    pub noise: f64,
    /// Electrons a count, where the spot has shot noise.
    pub electrons_per_count: Option<f64>,
}

impl Spot {
    /// The bound in pixels, from pixels as far as six sigma: root mean square over places of the centre in a
    /// pixel.
    pub fn bound(&self) -> f64 {
        let reach = self.reach();
        let bound = |phase| self.bound_from(phase, -reach..=reach);
        rms([-0.4, -0.2, 0.0, 0.2, 0.4].map(bound))
    }

    /// The same for a spot that the sensor's edge cuts, `centre` pixels from the middle of its first pixel:
    /// from the pixels that there are.
    pub fn bound_cut(&self, centre: f64) -> f64 {
        let last = centre.ceil() as i32 + self.reach();
        self.bound_from(centre, 0..=last)
    }

    /// The variance of a pixel that has this share of the height, in square counts.
    pub fn variance(&self, light: f64) -> f64 {
        let of_shot = |electrons| self.amplitude * light / electrons;
        self.noise * self.noise + 1.0 / 12.0 + self.electrons_per_count.map_or(0.0, of_shot)
    }

    fn reach(&self) -> i32 {
        (6.0 * self.width + 3.0).ceil() as i32
    }

    /// From the inverse of the Fisher information of four parameters.
    fn bound_from(&self, centre: f64, pixels: RangeInclusive<i32>) -> f64 {
        let h = 1e-4 * self.width;
        let mut information = Matrix4::zeros();
        for i in pixels {
            let offset = f64::from(i) - centre;
            let light = gaussian(offset, self.width);
            let by_centre =
                (gaussian(offset - h, self.width) - gaussian(offset + h, self.width)) / (2.0 * h);
            let by_width =
                (gaussian(offset, self.width + h) - gaussian(offset, self.width - h)) / (2.0 * h);
            let (by_centre, by_width) = (self.amplitude * by_centre, self.amplitude * by_width);
            let gradient = Vector4::new(by_centre, light, 1.0, by_width);
            information += gradient * gradient.transpose() / self.variance(light);
        }
        // Columns differ by orders of magnitude: scaled to a unit diagonal before the inversion.
        let scale = information.diagonal().map(|value| 1.0 / value.sqrt());
        let scaled = Matrix4::from_diagonal(&scale) * information * Matrix4::from_diagonal(&scale);
        let inverse = scaled.try_inverse();
        let inverse = inverse.expect("four derivatives of a gaussian are independent");
        inverse[(0, 0)].sqrt() * scale[0]
    }
}

/// The bound in pixels for a row of a scene, with the target at a distance in metres, after an exposure in
/// seconds.
///
/// It is that of a gaussian with read noise and its own shot noise. `None` where the scene lists an effect
/// besides these that moves the spot, shapes it or adds noise; with speckle, say, the error is not bounded by
/// noise. `None` too for a comb, whose rows show more than one spot.
pub fn of_row(simulation: &Simulation, distance: f64, exposure: f64) -> Option<f64> {
    let scene = simulation.scene();
    let amplitude = scene.spot?.counts_per_second * exposure;
    let electrons_per_count = scene.shot_noise.map(|noise| noise.electrons_per_count);
    // A full well changes nothing as long as the spot, with six sigma of its noise, does not fill it.
    let shot = electrons_per_count.map_or(0.0, |electrons| (amplitude / electrons).sqrt());
    let is_full = |well: f64| amplitude + 6.0 * shot > well;
    let is_known = |effect: &Effect| match effect {
        Effect::BlackLevel | Effect::LaserSpot | Effect::ShotNoise | Effect::ReadNoise => true,
        Effect::Saturation => !scene.saturation.is_some_and(|it| is_full(it.full_well)),
        _ => false,
    };
    let is_noisy = scene.shot_noise.is_some() || scene.read_noise.is_some();
    let mut listed = (Effect::ALL.into_iter()).filter(|&effect| scene.lists(effect));
    let has_one_slit = scene.comb.is_none();
    if !is_noisy
        || !has_one_slit
        || scene.sensor.rows() > 1
        || !listed.all(|effect| is_known(&effect))
    {
        return None;
    }
    let spot = Spot {
        width: simulation.spot_width(distance),
        amplitude,
        noise: scene.read_noise.map_or(0.0, |noise| noise.counts),
        electrons_per_count,
    };
    Some(spot.bound())
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{PI, TAU};

    use super::*;
    use crate::scene::{Ambient, LaserSpot, Saturation, Scene};
    use crate::with;

    /// White paper has the bound of its gaussian; a laser spot of 1 mm widens it by its image, 0.25 mm
    /// cos(theta) z / R (0.854 m, cos 0.936): 13.7 um or 1.71 pixels in quadrature. What the bound does not
    /// know leaves none.
    #[test]
    fn a_scene_has_a_bound_where_it_is_noise_alone() {
        let plain = Spot {
            width: 8.6,
            amplitude: 350_000.0 * 0.0057,
            noise: 4.0,
            electrons_per_count: Some(10.0),
        };
        let wide = with(plain, |it| it.width = 8.6f64.hypot(1.71));
        let laser_spot = LaserSpot::new(1e-3, 0.8);
        let daylight = Ambient {
            counts_per_second: 10_000.0,
            slope: 0.0,
        };
        let well = |full_well| {
            let blooming = 0.0;
            Some(Saturation {
                full_well,
                blooming,
            })
        };
        let (plain, wide) = (Some(plain.bound()), Some(wide.bound()));
        type Change<'a> = &'a dyn Fn(&mut Scene);
        let no_noise: Change<'_> = &|it| (it.shot_noise, it.read_noise) = (None, None);
        let cases: [(&str, Change<'_>, Option<f64>); 6] = [
            ("paper", &|_| (), plain),
            ("a deep well", &|it| it.saturation = well(3795.0), plain),
            ("a full well", &|it| it.saturation = well(1500.0), None),
            ("1 mm", &|it| it.laser_spot = Some(laser_spot), wide),
            ("daylight", &|it| it.ambient = Some(daylight), None),
            ("no noise", no_noise, None),
        ];
        for (name, change, expected) in cases {
            let mut scene = Scene::white_paper();
            change(&mut scene);
            let found = of_row(&Simulation::new(scene), 0.8, 0.0057);
            println!("{name}: {found:?} px, expected {expected:?}");
            match (found, expected) {
                (Some(found), Some(expected)) => assert!((found / expected - 1.0).abs() < 0.002),
                (found, expected) => assert_eq!(found, expected, "{name}"),
            }
        }
    }

    /// A spot far from the edge is whole; nearer, the figures of an independent computation (2000 counts, 5
    /// electrons a count, noise of 2, at a width of 10.5: 0.0214 whole, and 0.0229, 0.0393 and 0.141 at two,
    /// one and no widths).
    #[test]
    fn a_cut_spot_is_less_certain() {
        let spot = Spot {
            width: 10.5,
            amplitude: 2000.0,
            noise: 2.0,
            electrons_per_count: Some(5.0),
        };
        assert!((spot.bound_cut(100.0) / spot.bound() - 1.0).abs() < 1e-6);
        for (widths, expected) in [(2.0, 0.0229), (1.0, 0.0393), (0.0, 0.141)] {
            let bound = spot.bound_cut(widths * spot.width);
            println!("{widths} widths from the edge: {bound:.4} px, expected {expected}");
            assert!((bound / expected - 1.0).abs() < 0.02);
        }
    }

    /// In white noise the bound is sqrt(2/sqrt(pi)) sqrt(sigma) noise/amplitude; in pure shot noise
    /// sigma/sqrt(electrons).
    #[test]
    fn closed_forms() {
        for width in [3.0, 10.5] {
            let of = |amplitude, noise, electrons_per_count| {
                let spot = Spot {
                    width,
                    amplitude,
                    noise,
                    electrons_per_count,
                };
                spot.bound()
            };
            let noise = (400.0f64 + 1.0 / 12.0).sqrt();
            let white =
                of(1000.0, 20.0, None) / ((2.0 / PI.sqrt() * width).sqrt() * noise / 1000.0);
            let electrons = 4000.0 * 100.0 * width * TAU.sqrt();
            let shot = of(4000.0, 0.0, Some(100.0)) / (width / electrons.sqrt());
            println!("sigma {width}: white {white}, shot {shot} of the closed form");
            assert!((white - 1.0).abs() < 0.01 && (shot - 1.0).abs() < 0.02);
        }
    }
}
