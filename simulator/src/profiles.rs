//! Other profiles than the gaussian: the diffraction pattern of a slit by Fraunhofer and by Fresnel, and one
//! with a tail.

use std::f64::consts::{PI, SQRT_2, TAU};

use nalgebra::{Matrix4, Vector4};
use statistics::mean;

use crate::{bound, least_squares};

/// Light along the row, in units of the spot's width, and what a pixel gathers of it.
#[derive(Clone, Debug)]
pub struct Curve {
    /// The light at knots [`STEP`] apart, from -[`REACH`] to [`REACH`] widths; 1 at the peak or near it.
    light: Vec<f64>,
    /// Its integral from the first knot on.
    integral: Vec<f64>,
}

/// From knot to knot, in widths: the interpolation is good to 1e-9.
const STEP: f64 = 0.02;
/// Light beyond so many widths is left out.
const REACH: f64 = 20.0;
const KNOTS: usize = (2.0 * REACH / STEP) as usize + 1;

impl Curve {
    /// The curve of a function of the place in widths.
    pub fn new(light: impl Fn(f64) -> f64) -> Self {
        let place = |half_steps: usize| half_steps as f64 * 0.5 * STEP - REACH;
        let knots: Vec<f64> = (0..KNOTS).map(|i| light(place(2 * i))).collect();
        let mut integral = vec![0.0];
        for (i, ends) in knots.windows(2).enumerate() {
            // Simpson's rule.
            let step = STEP / 6.0 * (ends[0] + 4.0 * light(place(2 * i + 1)) + ends[1]);
            integral.push(integral[i] + step);
        }
        Self {
            light: knots,
            integral,
        }
    }

    /// The same for light whose place is in any unit: the unit of the curve is the sigma, and its origin the
    /// centre, of the gaussian on a level that fits it best within four sigma. `scale` is that sigma,
    /// roughly.
    pub fn in_widths(light: impl Fn(f64) -> f64, scale: f64) -> Self {
        const SAMPLES: f64 = 50.0;
        let middle = (12.0 * SAMPLES) as usize;
        let at = |i| light((i as f64 - middle as f64) / SAMPLES * scale);
        let row: Vec<f64> = (0..=2 * middle).map(at).collect();
        let best = least_squares::fit_near(&row, middle as f64).expect("light that has one peak");
        let width = best.width / SAMPLES * scale;
        let centre = (best.centre - middle as f64) / SAMPLES * scale;
        Self::new(|place| light(place * width + centre) / light(centre))
    }

    /// What a pixel gathers whose centre is `offset` pixels from the spot's, of a spot `width` pixels wide: a
    /// [`phase_tables::Profile`].
    pub fn at(&self, offset: f64, width: f64) -> f64 {
        let (from, to) = ((offset - 0.5) / width, (offset + 0.5) / width);
        width * (self.integral_to(to) - self.integral_to(from))
    }

    /// The integral, by the cubic whose ends and whose slopes there, which are the light, are known.
    fn integral_to(&self, place: f64) -> f64 {
        let knots = ((place + REACH) / STEP).clamp(0.0, (KNOTS - 1) as f64);
        let i = (knots as usize).min(KNOTS - 2);
        let t = knots - i as f64;
        let [a, b] = [self.integral[i], self.integral[i + 1]];
        let [light_a, light_b] = [self.light[i] * STEP, self.light[i + 1] * STEP];
        let rise = b - a;
        let s = 1.0 - t;
        a + rise * t * t * (3.0 - 2.0 * t) + s * t * (s * light_a - t * light_b)
    }
}

/// The gaussian of eq. (5).
pub fn gaussian() -> Curve {
    Curve::new(|place| (-0.5 * place * place).exp())
}

/// sinc^2, eq. (6): as `phase_tables::slit`, which has its first zero at 2.66 widths.
pub fn slit() -> Curve {
    Curve::new(|place| sinc(PI * place / 2.66).powi(2))
}

/// How the light of a laser spot is distributed along the row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Blur {
    /// As in a gaussian beam.
    Gaussian,
    /// Evenly.
    Box,
}

/// [`slit`], blurred by a laser spot whose image has this standard deviation, in widths of the pattern of a
/// point. The width of the curve is that of the blurred pattern.
pub fn blurred_slit(deviation: f64, blur: Blur) -> Curve {
    const POINTS: i32 = 24;
    let point = |i: i32| {
        let u = f64::from(i) / f64::from(POINTS);
        match blur {
            Blur::Gaussian => (4.0 * u * deviation, (-8.0 * u * u).exp()),
            // The trapezoidal rule.
            Blur::Box if i.abs() == POINTS => (3f64.sqrt() * u * deviation, 0.5),
            Blur::Box => (3f64.sqrt() * u * deviation, 1.0),
        }
    };
    let points: Vec<(f64, f64)> = (-POINTS..=POINTS).map(point).collect();
    let light = |place: f64| {
        let of_point = |(at, weight): &(f64, f64)| weight * sinc(PI * (place - at) / 2.66).powi(2);
        points.iter().map(of_point).sum::<f64>()
    };
    Curve::in_widths(light, 1.0)
}

fn sinc(u: f64) -> f64 {
    if u.abs() < 1e-8 { 1.0 } else { u.sin() / u }
}

/// A gaussian with a tail to one side, as veiling glare or a surface that light enters makes: an exponential
/// that falls to 1/e within a sigma, convolved with the gaussian. Its skewness is 0.71.
pub fn tailed() -> Curve {
    // With both lengths 1: exp(1/2 - x) erfc((1 - x)/sqrt 2), up to a factor.
    let light = |x: f64| {
        let inner = (1.0 - x) / SQRT_2;
        // erfc underflows where the exponential overflows.
        match inner > 20.0 {
            true => 0.0,
            false => (0.5 - x).exp() * libm::erfc(inner),
        }
    };
    Curve::in_widths(light, 1.4)
}

/// A slit in front of the sensor and a laser spot on the target, in metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Slit {
    /// Its width.
    pub width: f64,
    /// From it to the sensor.
    pub to_sensor: f64,
    /// From it to the laser spot.
    pub to_spot: f64,
    /// The light's wavelength.
    pub wavelength: f64,
    /// The laser spot's 1/e^2 diameter; zero for a point.
    pub spot_diameter: f64,
}

impl Slit {
    /// 200 um and 650 nm, 50 mm in front of the sensor; the target 0.8 m away and the laser 0.3 m aside.
    pub fn nominal(spot_diameter: f64) -> Self {
        Self {
            width: 200e-6,
            to_sensor: 0.05,
            to_spot: 0.3f64.hypot(0.8),
            wavelength: 650e-9,
            spot_diameter,
        }
    }

    /// [`Self::nominal`] with as wide a slit as has this Fresnel number.
    pub fn of_fresnel_number(number: f64, spot_diameter: f64) -> Self {
        let nominal = Self::nominal(spot_diameter);
        Self {
            width: nominal.width * (number / nominal.fresnel_number()).sqrt(),
            ..nominal
        }
    }

    /// The Fresnel number: the square of half of the slit's width, over the wavelength, times the sum of one
    /// over each distance. The nominal slit has 0.326. From about 0.55 on, the pattern has a flat top.
    pub fn fresnel_number(&self) -> f64 {
        let half = 0.5 * self.width;
        half * half / self.wavelength * (1.0 / self.to_spot + 1.0 / self.to_sensor)
    }

    /// The light at a place on the sensor, from the laser spot as incoherent points: the pattern of a point
    /// is moved by the point's place times to_sensor / to_spot.
    pub fn light(&self, place: f64) -> f64 {
        // A gaussian beam's intensity has a standard deviation of a quarter of its 1/e^2 diameter.
        let blur = self.spot_diameter / 4.0 * self.to_sensor / self.to_spot;
        if blur == 0.0 {
            return self.light_of_point(place);
        }
        const POINTS: i32 = 16;
        let weights = (-POINTS..=POINTS).map(|i| f64::from(i) * 5.0 / f64::from(POINTS));
        let (mut sum, mut weight_sum) = (0.0, 0.0);
        for u in weights {
            let weight = (-0.5 * u * u).exp();
            sum += weight * self.light_of_point(place - u * blur);
            weight_sum += weight;
        }
        sum / weight_sum
    }

    /// Fresnel's diffraction integral over the slit, squared: |int exp(i pi/lambda (u^2 (1/R + 1/z) - 2 u
    /// x/z)) du|^2, u from -w/2 to w/2, over w^2.
    fn light_of_point(&self, place: f64) -> f64 {
        let bent = PI / self.wavelength * (1.0 / self.to_spot + 1.0 / self.to_sensor);
        let tilted = TAU / self.wavelength * place / self.to_sensor;
        // The exponential's odd part cancels. Simpson's rule: a wave is at least 30 steps long.
        let half = 0.5 * self.width;
        let steps = 2 * (16.0 + 2.5 * tilted.abs() * half) as usize;
        let (mut real, mut imaginary) = (0.0, 0.0);
        for i in 0..=steps {
            let u = half * i as f64 / steps as f64;
            let weight = match i {
                _ if i == 0 || i == steps => 1.0,
                _ if i % 2 == 1 => 4.0,
                _ => 2.0,
            };
            let (sin, cos) = (bent * u * u).sin_cos();
            let even = weight * (tilted * u).cos();
            real += cos * even;
            imaginary += sin * even;
        }
        (real * real + imaginary * imaginary) / (3.0 * steps as f64).powi(2)
    }

    /// Its curve.
    pub fn curve(&self) -> Curve {
        // sinc^2 is as wide as a gaussian of 0.376 of the distance to its first zero.
        let scale = 0.376 * self.wavelength * self.to_sensor / self.width;
        Curve::in_widths(|place| self.light(place), scale)
    }
}

/// The Cramér-Rao bound of the centre in pixels where amplitude, width and level are unknown too, as
/// [`bound::Spot::bound`] for the gaussian, from the pixels within `reach` widths.
pub fn bound(curve: &Curve, spot: &bound::Spot, reach: f64) -> f64 {
    let phases = [-0.4, -0.2, 0.0, 0.2, 0.4];
    let variance = |phase: f64| {
        let pixels = (reach * spot.width).ceil() as i32;
        let h = 1e-3 * spot.width;
        let mut information = Matrix4::zeros();
        for i in -pixels..=pixels {
            let offset = f64::from(i) - phase;
            let light = curve.at(offset, spot.width);
            let by_centre =
                (curve.at(offset - h, spot.width) - curve.at(offset + h, spot.width)) / (2.0 * h);
            let by_width =
                (curve.at(offset, spot.width + h) - curve.at(offset, spot.width - h)) / (2.0 * h);
            // In units of the width and of the height, so that the matrix can be inverted.
            let gradient = spot.amplitude
                * Vector4::new(by_centre * spot.width, light, 1.0, by_width * spot.width);
            information += gradient * gradient.transpose() / spot.variance(light);
        }
        let inverse = information.try_inverse();
        let inverse = inverse.expect("four derivatives of a profile are independent");
        inverse[(0, 0)] * spot.width * spot.width
    };
    mean(phases.iter().map(|&phase| variance(phase))).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::with;

    #[test]
    fn pixels_of_a_curve_are_those_of_the_closed_forms() {
        let profiles: [(Curve, phase_tables::Profile<'_>); 2] = [
            (gaussian(), &phase_tables::gaussian),
            (slit(), &phase_tables::slit),
        ];
        for (curve, profile) in &profiles {
            for width in [0.8, 2.0, 8.0, 30.0] {
                for step in -400..400 {
                    let offset = f64::from(step) / 100.0 * width;
                    let (curve, exact) = (curve.at(offset, width), profile(offset, width));
                    let off = curve - exact;
                    assert!(off.abs() < 1e-8, "{offset} {width}: {curve} {exact}");
                }
            }
        }
    }

    /// Where the slit is so narrow that u^2 does not matter, Fresnel's pattern is Fraunhofer's.
    #[test]
    fn a_narrow_slit_has_the_pattern_of_fraunhofer() {
        let slit = with(Slit::nominal(0.0), |it| it.width = 10e-6);
        for step in -300..300 {
            let place = f64::from(step) * 30e-6;
            let fraunhofer = sinc(PI * slit.width * place / (slit.wavelength * 0.05)).powi(2);
            assert!((slit.light(place) - fraunhofer).abs() < 1e-5, "{place}");
        }
    }

    /// On the axis the integral is C(v) + i S(v) with v = w/2 sqrt(2/lambda (1/R + 1/z)), over v: at v = 1
    /// they are 0.779893 and 0.438259 (Abramowitz and Stegun, table 7.7).
    #[test]
    fn on_the_axis_it_is_the_fresnel_integrals() {
        let nominal = Slit::nominal(0.0);
        let curvature = 1.0 / nominal.to_spot + 1.0 / nominal.to_sensor;
        let slit = Slit {
            width: 2.0 * (nominal.wavelength / (2.0 * curvature)).sqrt(),
            ..nominal
        };
        let expected = 0.779_893_4f64.powi(2) + 0.438_259_1f64.powi(2);
        let found = slit.light(0.0);
        assert!((found - expected).abs() < 1e-6, "{found}");
    }

    /// The nominal geometry is no case for Fraunhofer: the first minimum, which would be zero at lambda z / w
    /// = 162.5 um, is 4.5 % of the peak at 164 um, by an independent integration on a grid of 5.86 um.
    #[test]
    fn the_first_minimum_does_not_reach_zero() {
        let point = Slit::nominal(0.0);
        let share = |um| (point.light(f64::from(um) * 1e-6) / point.light(0.0), um);
        let minimum = (100..200).map(share).min_by(|a, b| a.0.total_cmp(&b.0));
        println!("first minimum and its place in um: {minimum:?}");
        assert!(matches!(minimum, Some((depth, 161..=167)) if (0.044..0.046).contains(&depth)));
    }

    #[test]
    fn the_bound_of_a_gaussian_is_that_of_its_closed_form() {
        for electrons_per_count in [None, Some(5.0)] {
            for width in [1.2, 8.0] {
                let spot = bound::Spot {
                    width,
                    amplitude: 1000.0,
                    noise: 2.0,
                    electrons_per_count,
                };
                let ratio = bound(&gaussian(), &spot, 6.5) / spot.bound();
                assert!((ratio - 1.0).abs() < 1e-3, "{width}: {ratio}");
            }
        }
    }
}
