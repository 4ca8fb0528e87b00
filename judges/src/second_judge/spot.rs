//! Spots of this judge: their shapes, and their light on the pixels.
//!
//! Every shape is symmetric about its centre, so its centre is certain. A shape is a table over the distance
//! from the centre in widths. One width is the half-height width of the shape over that of a gaussian of
//! sigma 1, so all shapes of one width look alike.

use crate::second_judge::Rng;
use rand::Rng as _;
use std::f64::consts::{LN_2, PI};
use std::fmt;
use std::sync::LazyLock;

/// Full width at half height of a gaussian of sigma 1.
const HALF_HEIGHT_WIDTH: f64 = 2.354_820_045_030_949_3;
/// Entries of a table in a width: linear interpolation is then off by 3e-5 of the height at most.
const STEPS: usize = 64;
/// A table reaches so many widths from the centre. The side lobes of sinc^2 are below 1e-4 there.
const REACH: usize = 40;

/// A symmetric shape of height 1 and width 1.
pub struct Shape {
    name: String,
    values: Vec<f64>,
}

impl fmt::Debug for Shape {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.name)
    }
}

impl Shape {
    /// A shape from a function of any width that falls to half its height within `half` units.
    fn of(name: String, function: impl Fn(f64) -> f64, half: f64) -> Self {
        let top = function(0.0);
        // Bisection: the height falls through one half once between the centre and `half`.
        let (mut low, mut high) = (0.0, half);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if function(middle) > 0.5 * top {
                low = middle;
            } else {
                high = middle;
            }
        }
        let width = 2.0 * low / HALF_HEIGHT_WIDTH;
        let value = |i| function(i as f64 / STEPS as f64 * width) / top;
        Self {
            name,
            values: (0..=REACH * STEPS).map(value).collect(),
        }
    }

    /// The shape of a laser spot.
    pub fn gaussian() -> &'static Self {
        &SHAPES[0]
    }

    /// The shape that a narrow slit makes: sinc^2.
    pub fn sinc2() -> &'static Self {
        &SINC2
    }

    /// The height at a distance from the centre in widths.
    fn at(&self, widths: f64) -> f64 {
        between(&self.values, widths.abs() * STEPS as f64)
    }
}

/// The value at a place of a table, by linear interpolation; 0 beyond its end.
fn between(table: &[f64], place: f64) -> f64 {
    let i = place as usize;
    match table.get(i..i + 2) {
        Some(&[near, far]) => near + (far - near) * (place - i as f64),
        _ => 0.0,
    }
}

/// exp(-|x|^p): flatter than a gaussian above p = 2, more pointed below.
fn super_gaussian(power: f64) -> Shape {
    let name = format!("exp(-|x|^{power})");
    Shape::of(name, |x| (-LN_2 * x.abs().powf(power)).exp(), 2.0)
}

/// The pattern of a slit whose half-width a, wavelength and distances make the Fresnel number N = a^2 /
/// (lambda z), blurred by a laser spot: |integral of exp(i pi (N s^2 - u s)) over the slit|^2. The first zero
/// of sinc^2 (N = 0) is at u = 1. The blur is a gaussian's sigma in u.
fn slit(fresnel_number: f64, blur: f64) -> Shape {
    // A quarter of the finest detail: sinc^2 has a period of 1.
    const GRID: usize = 64;
    // 40 widths of 0.38.
    const END: usize = 18 * GRID;
    let intensity = |i| slit_intensity(fresnel_number, i as f64 / GRID as f64);
    let sharp: Vec<f64> = (0..=END).map(intensity).collect();
    let reach = (5.0 * blur * GRID as f64) as i64;
    let weight = |k| (-0.5 * (k as f64 / GRID as f64 / blur).powi(2)).exp();
    let weights: Vec<f64> = (-reach..=reach).map(weight).collect();
    let total: f64 = weights.iter().sum();
    let blurred: Vec<f64> = (0..=END as i64)
        .map(|i| {
            let near = (-reach..=reach).map(|k| sharp.get((i + k).unsigned_abs() as usize));
            let sum: f64 = (near.zip(&weights))
                .map(|(value, weight)| value.unwrap_or(&0.0) * weight)
                .sum();
            sum / total
        })
        .collect();
    let at = |u: f64| between(&blurred, u * GRID as f64);
    let name = format!("slit of Fresnel number {fresnel_number}, blurred by {blur}");
    Shape::of(name, at, 1.5)
}

/// The slit's intensity by Simpson's rule over half of the slit: the other half is its mirror image.
fn slit_intensity(fresnel_number: f64, u: f64) -> f64 {
    const INTERVALS: usize = 160;
    let (mut real, mut imaginary) = (0.0, 0.0);
    for k in 0..=INTERVALS {
        let s = k as f64 / INTERVALS as f64;
        let weight = match k {
            0 | INTERVALS => 1.0,
            odd if odd % 2 == 1 => 4.0,
            _ => 2.0,
        };
        let (sine, cosine) = (PI * fresnel_number * s * s).sin_cos();
        let wave = weight * (PI * u * s).cos();
        real += wave * cosine;
        imaginary += wave * sine;
    }
    (real * real + imaginary * imaginary) / (9.0 * (INTERVALS * INTERVALS) as f64)
}

/// Four families, three shapes each: gaussian (three times the same), super-gaussian, Fraunhofer, Fresnel.
/// Flatter super-gaussians are left out: no slit makes them, and to the check they are boxes.
static SHAPES: LazyLock<Vec<Shape>> = LazyLock::new(|| {
    vec![
        super_gaussian(2.0),
        super_gaussian(2.0),
        super_gaussian(2.0),
        super_gaussian(1.7),
        super_gaussian(2.2),
        super_gaussian(2.5),
        // Laser spots of 0.1 to 0.4 of the slit's resolution.
        slit(0.0, 0.1),
        slit(0.0, 0.25),
        slit(0.0, 0.4),
        // The drawing's slit has 0.33.
        slit(0.2, 0.15),
        slit(0.33, 0.15),
        slit(0.33, 0.3),
    ]
});

/// The pattern of a narrow slit without a blur.
static SINC2: LazyLock<Shape> = LazyLock::new(|| slit(0.0, 0.01));

/// A spot.
#[derive(Clone, Copy, Debug)]
pub struct Spot {
    /// Its shape.
    pub shape: &'static Shape,
    /// Its centre in pixels: pixel i reaches from i - 0.5 to i + 0.5.
    pub centre: f64,
    /// Its width (a gaussian's sigma) in pixels.
    pub width: f64,
    /// Its height in counts. Zero: there is no spot.
    pub height: f64,
}

impl Spot {
    /// A spot of any shape.
    pub fn draw(random: &mut Rng, centre: f64, width: f64, height: f64) -> Self {
        Self {
            shape: &SHAPES[random.random_range(0..SHAPES.len())],
            centre,
            width,
            height,
        }
    }

    /// The light at a place, in counts that a pixel would have if the light were the same all over it.
    pub fn at(&self, place: f64) -> f64 {
        self.height * self.shape.at((place - self.centre) / self.width)
    }

    /// Adds the light to pixels, behind a glass with a transmission at each place.
    pub fn add_to(&self, pixels: &mut [f64], transmission: impl Fn(f64) -> f64) {
        if self.height == 0.0 {
            return;
        }
        // The midpoint rule is a convolution with a symmetric comb, so it moves no centre.
        let points = match self.width {
            width if width < 2.0 => 12,
            width if width < 4.0 => 6,
            _ => 4,
        };
        let offset = |k| (k as f64 + 0.5) / points as f64 - 0.5;
        let offsets: Vec<f64> = (0..points).map(offset).collect();
        for (i, pixel) in pixels.iter_mut().enumerate() {
            let light = offsets.iter().map(|offset| {
                let place = i as f64 + offset;
                match self.at(place) {
                    0.0 => 0.0,
                    light => light * transmission(place),
                }
            });
            *pixel += light.sum::<f64>() / points as f64;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_shapes_have_the_same_half_height_width() {
        for shape in SHAPES.iter() {
            assert!((shape.at(0.0) - 1.0).abs() < 1e-9);
            assert!((shape.at(0.5 * HALF_HEIGHT_WIDTH) - 0.5).abs() < 1e-3);
        }
        let gaussian = &SHAPES[0];
        assert!((gaussian.at(1.0) - (-0.5f64).exp()).abs() < 1e-4);
        // sinc^2 of half a period: the first zero is at 1 / 0.376 widths.
        assert!(slit(0.0, 0.01).at(1.0 / 0.3762) < 1e-3);
    }

    #[test]
    fn the_pixels_hold_all_light_about_the_centre() {
        for width in [1.2, 3.0, 9.0] {
            let spot = Spot {
                shape: &SHAPES[0],
                centre: 100.3,
                width,
                height: 1000.0,
            };
            let mut pixels = vec![0.0; 200];
            spot.add_to(&mut pixels, |_| 1.0);
            let sum: f64 = pixels.iter().sum();
            let moment: f64 = pixels.iter().enumerate().map(|(i, p)| i as f64 * p).sum();
            assert!((sum / (1000.0 * width * (2.0 * PI).sqrt()) - 1.0).abs() < 1e-4);
            assert!((moment / sum - 100.3).abs() < 1e-4, "{}", moment / sum);
        }
    }
}
