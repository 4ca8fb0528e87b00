//! What interference between the slits of a comb does, which the simulator leaves out: it adds the light of
//! slits, and not their fields ([`simulator::comb`]).
//!
//! The fields of three neighbouring slits, at the two smallest gaps of the nominal mask, are summed along
//! exact paths in the plane of beam and row: from points of the target through points of each slit to the
//! row. The light of the middle slit's image is compared with the sum of the light of each slit. A plane has
//! no average over the pixel's height and the slit's, so its fringes are stronger than a sensor's.

use std::f64::consts::TAU;

use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use simulator::optics::Optics;
use simulator::scene::Sensor;
use slitrange::centre::{self, Estimator};
use slitrange::comb::{NOMINAL_PLACES_UM, SLIT_WIDTH_UM};
use slitrange::row::Row;
use slitrange::spot;

/// Points of a slit's width: 20 to a turn of phase where a neighbour's image is.
const POINTS: usize = 128;

/// Points of a pixel's width: 8 or more to a fringe.
const PARTS: usize = 2;

/// Pixels to either side of the image's middle: as far as half of the gap to the neighbour's.
const HALF: i32 = 56;

/// Sigma in pixels of the gaussian that is fitted.
const SIGMA: f64 = 8.6;

/// Numbers of the slits of the nominal mask: gaps of 860 um on both sides of the middle one, which is near
/// the row's end.
const SLITS: [usize; 3] = [0, 1, 2];

#[derive(Clone, Copy, Default)]
struct Wave {
    re: f64,
    im: f64,
}

impl Wave {
    fn of_path(metres: f64, wavelength: f64) -> Self {
        let (im, re) = (TAU * (metres / wavelength).fract()).sin_cos();
        Self { re, im }
    }

    fn add_product(&mut self, a: Self, b: Self) {
        self.re += a.re * b.re - a.im * b.im;
        self.im += a.re * b.im + a.im * b.re;
    }

    fn light(self) -> f64 {
        self.re * self.re + self.im * self.im
    }
}

/// The way of light from points of a target, through each of the slits, to the pixels of the middle slit's
/// image.
struct Ways {
    /// For each slit and part of a pixel: from each point of the target.
    slits: Vec<Vec<Vec<Wave>>>,
    /// The image's middle, in pixels from the first one that is computed.
    middle: f64,
}

impl Ways {
    /// For a target at a distance in metres, with points at these places along the baseline.
    fn new(distance: f64, points: &[f64]) -> Self {
        let optics = Optics::nominal();
        let (sin, cos) = optics.angle.sin_cos();
        let place = |slit: usize| f64::from(NOMINAL_PLACES_UM[slit]) / 1e6;
        let centre = optics.behind(place(SLITS[1])).centre(distance);
        let first = centre.round() - f64::from(HALF);
        // In coordinates of the casing: along the baseline, and along the beam.
        let columns: Vec<[f64; 2]> = (0..(2 * HALF + 1) * PARTS as i32)
            .map(|i| {
                let pixel = first + (f64::from(i) + 0.5) / PARTS as f64 - 0.5;
                let x = (pixel - optics.axis) * optics.pitch;
                [
                    optics.baseline + optics.focal_length * cos + x * sin,
                    optics.offset - optics.focal_length * sin + x * cos,
                ]
            })
            .collect();
        let length = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).hypot(a[1] - b[1]);
        let width = f64::from(SLIT_WIDTH_UM) / 1e6;
        let slits = SLITS.map(|slit| {
            let apertures: Vec<[f64; 2]> = (0..POINTS)
                .map(|i| place(slit) + width * ((i as f64 + 0.5) / POINTS as f64 - 0.5))
                .map(|s| [optics.baseline + s * sin, optics.offset + s * cos])
                .collect();
            let wave = |a, b| Wave::of_path(length(a, b), optics.wavelength);
            let to_slit: Vec<Vec<Wave>> = points
                .iter()
                .map(|&x| {
                    apertures
                        .iter()
                        .map(|&it| wave([x, distance], it))
                        .collect()
                })
                .collect();
            let of_column = |column: &[f64; 2]| {
                let to_row: Vec<Wave> = apertures.iter().map(|&it| wave(it, *column)).collect();
                let sum = |from: &Vec<Wave>| {
                    let mut sum = Wave::default();
                    for (&a, &b) in from.iter().zip(&to_row) {
                        sum.add_product(a, b);
                    }
                    sum
                };
                to_slit.iter().map(sum).collect()
            };
            columns.iter().map(of_column).collect()
        });
        Self {
            slits: slits.to_vec(),
            middle: centre - first,
        }
    }

    /// Adds the light of each pixel from points of these amplitudes: of the slits' fields, and of the slits
    /// one by one.
    fn add(&self, amplitudes: &[Wave], together: &mut [f64], apart: &mut [f64]) {
        for pixel in 0..together.len() {
            for part in 0..PARTS {
                let mut all = Wave::default();
                for slit in &self.slits {
                    let mut own = Wave::default();
                    for (&way, &amplitude) in slit[pixel * PARTS + part].iter().zip(amplitudes) {
                        own.add_product(way, amplitude);
                    }
                    apart[pixel] += own.light();
                    all.re += own.re;
                    all.im += own.im;
                }
                together[pixel] += all.light();
            }
        }
    }

    fn dark(&self) -> [Vec<f64>; 2] {
        [
            vec![0.0; 2 * HALF as usize + 1],
            vec![0.0; 2 * HALF as usize + 1],
        ]
    }
}

/// Centre in pixels of the gaussian of [`SIGMA`] that fits best by least squares, where there is no level:
/// the zero of the sum of light times the gaussian's derivative.
fn fit(light: &[f64], start: f64) -> f64 {
    let mut centre = start;
    for _ in 0..100 {
        let (mut score, mut slope) = (0.0, 0.0);
        for (i, light) in light.iter().enumerate() {
            let u = (i as f64 - centre) / SIGMA;
            let bell = (-0.5 * u * u).exp();
            score += light * u * bell;
            slope += light * (1.0 - u * u) * bell;
        }
        let step = if slope > 0.0 {
            (SIGMA * score / slope).clamp(-SIGMA, SIGMA)
        } else {
            SIGMA * score.signum()
        };
        centre += 0.7 * step;
    }
    centre
}

/// What the core's default estimator says of light with so many counts at its peak, on a black level: rounded
/// to whole counts, without noise.
fn core_centre(light: &[f64], scale: f64) -> Option<f64> {
    let geometry = Sensor::Row(light.len()).geometry();
    let counts: Vec<u16> = light
        .iter()
        .map(|x| (x * scale + 300.0).round() as u16)
        .collect();
    let row = Row::new(&counts, &[], geometry.full_scale()).ok()?;
    let spot = spot::find(&row).ok()?;
    let found = centre::centre(Estimator::default(), &row, &spot, None, &geometry).ok()?;
    Some(found.centre.to_f64())
}

fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|x| x * x).sum::<f64>() / values.len() as f64).sqrt()
}

fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |most, x| most.max(x.abs()))
}

/// How far interference moves images.
#[derive(Default)]
struct Moved {
    /// By the fit, in pixels.
    fit: Vec<f64>,
    /// By the core's default estimator, in pixels.
    core: Vec<f64>,
    /// Rows where the core finds a centre of only one of the two.
    lost: usize,
    /// RMS of the fringes within two sigma, over the peak.
    fringes: Vec<f64>,
    /// From the geometric centre to that of the light of slits apart, in pixels.
    speckle: Vec<f64>,
}

impl Moved {
    fn add(&mut self, together: &[f64], apart: &[f64], middle: f64) {
        let peak = apart.iter().fold(0.0f64, |peak, &x| peak.max(x));
        let centre = fit(apart, middle);
        self.speckle.push(centre - middle);
        self.fit.push(fit(together, centre) - centre);
        let near = apart.iter().zip(together).skip(HALF as usize - 17).take(35);
        let off: Vec<f64> = near.map(|(a, b)| (b - a) / peak).collect();
        self.fringes.push(rms(&off));
        let scale = 1500.0 / peak;
        match (core_centre(together, scale), core_centre(apart, scale)) {
            (Some(together), Some(apart)) => self.core.push(together - apart),
            (None, None) => (),
            _ => self.lost += 1,
        }
    }

    fn print(&self, name: &str) {
        println!(
            "{name}: fit moves by {:.1e} RMS, {:.1e} at most; core by {:.1e} RMS, {:.1e} at most ({} rows, \
             {} lost); fringes {:.4} RMS, {:.4} at most; speckle moves by {:.3} RMS",
            rms(&self.fit),
            largest(&self.fit),
            rms(&self.core),
            largest(&self.core),
            self.core.len(),
            self.lost,
            rms(&self.fringes),
            largest(&self.fringes),
            rms(&self.speckle)
        );
    }
}

/// The phase between two slits goes through many turns from 0.800 m to 0.801 m.
#[test]
fn fringes_of_a_point_do_not_move_its_image() {
    let mut moved = Moved::default();
    for step in 0..60 {
        let ways = Ways::new(0.8 + f64::from(step) * 17e-6, &[0.0]);
        let [mut together, mut apart] = ways.dark();
        ways.add(&[Wave { re: 1.0, im: 0.0 }], &mut together, &mut apart);
        moved.add(&together, &apart, ways.middle);
    }
    moved.print("point");
}

#[test]
fn fringes_of_a_rough_surface_do_not_move_its_image() {
    // A beam of 1 mm, to 2.25 radii.
    let (radius, pitch, half) = (0.5e-3, 3.6e-6, 312);
    let places: Vec<f64> = (-half..=half).map(|i| f64::from(i) * pitch).collect();
    let ways = Ways::new(0.8, &places);
    for polarisations in [1, 2] {
        let mut moved = Moved::default();
        for seed in 0..300 {
            let mut random = ChaCha8Rng::seed_from_u64(seed);
            let [mut together, mut apart] = ways.dark();
            for _ in 0..polarisations {
                let amplitudes: Vec<Wave> = places
                    .iter()
                    .map(|x| {
                        let size = (-(x / radius).powi(2)).exp();
                        let size = size * (-(1.0 - random.random::<f64>()).ln()).sqrt();
                        let (im, re) = (TAU * random.random::<f64>()).sin_cos();
                        Wave {
                            re: size * re,
                            im: size * im,
                        }
                    })
                    .collect();
                ways.add(&amplitudes, &mut together, &mut apart);
            }
            moved.add(&together, &apart, ways.middle);
        }
        moved.print(&format!("{polarisations} polarisations"));
    }
}
