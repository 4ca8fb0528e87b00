//! How wide the spot on the sensor is. Lengths are in millimetres.

use std::f64::consts::PI;

/// The sigma of the gaussian that fits the light of a point behind a slit, by least squares over four sigma
/// on both sides: Fresnel's integral over the slit.
///
/// The light is |int exp(i pi (v^2 (1/R + 1/z) - 2 v x/z) / lambda) dv|^2, v over the slit, R from the point
/// to the slit and z from the slit to the sensor.
pub fn width_behind_slit(slit: f64, range: f64, focal: f64, wavelength: f64) -> f64 {
    let detail = wavelength * focal / slit;
    // The shadow of a wide slit, or the pattern of a narrow one.
    let shadow = slit * (1.0 + focal / range);
    let step = detail.min(shadow) / 32.0;
    let light = |i| light(i as f64 * step, slit, range, focal, wavelength);
    let steps = (4.0 * (detail + shadow) / step) as usize;
    let pattern: Vec<f64> = (0..=steps).map(light).collect();
    // The misfit has one minimum in this range: a search by thirds.
    let (mut low, mut high) = (0.1 * detail.min(shadow), detail + shadow);
    while high - low > 1e-4 * low {
        let third = (high - low) / 3.0;
        if misfit(&pattern, step, low + third) < misfit(&pattern, step, high - third) {
            high -= third;
        } else {
            low += third;
        }
    }
    0.5 * (low + high)
}

/// The light at a place on the sensor, over the light of a slit in phase: only ratios matter.
fn light(place: f64, slit: f64, range: f64, focal: f64, wavelength: f64) -> f64 {
    // The phase turns by less than a tenth of a turn from point to point.
    let turns = slit * slit / wavelength * (1.0 / range + 1.0 / focal)
        + 2.0 * slit * place.abs() / (wavelength * focal);
    let points = (20.0 * turns).ceil().max(64.0) as usize;
    let (mut re, mut im) = (0.0, 0.0);
    for i in 0..points {
        let v = ((i as f64 + 0.5) / points as f64 - 0.5) * slit;
        let phase =
            PI / wavelength * (v * v * (1.0 / range + 1.0 / focal) - 2.0 * v * place / focal);
        re += phase.cos();
        im += phase.sin();
    }
    (re * re + im * im) / (points * points) as f64
}

/// How badly a gaussian of this sigma fits a pattern. The fit chooses the gaussian's height and a constant
/// level, over four sigma on each side. The result is the mean squared difference, divided by the squared
/// height.
fn misfit(pattern: &[f64], step: f64, sigma: f64) -> f64 {
    let within = ((4.0 * sigma / step) as usize + 1).min(pattern.len());
    let mut sums = [0.0; 6];
    for (i, &light) in pattern[..within].iter().enumerate() {
        // The other half is the same.
        let weight = if i == 0 { 0.5 } else { 1.0 };
        let x = i as f64 * step / sigma;
        let bell = (-0.5 * x * x).exp();
        let terms = [1.0, bell, bell * bell, light, light * bell, light * light];
        for (sum, term) in sums.iter_mut().zip(terms) {
            *sum += weight * term;
        }
    }
    let [n, g, gg, p, pg, pp] = sums;
    let height = (n * pg - g * p) / (n * gg - g * g);
    let level = (p - height * g) / n;
    (pp - height * pg - level * p) / n / (height * height)
}
