//! What interference between the slits of a comb does, which the simulator leaves out: it adds the light of
//! slits, and not their fields ([`simulator::scene::comb`]).
//!
//! The fields of three neighbouring slits, at the two smallest gaps of the nominal mask, are summed along
//! exact paths in the plane of beam and row: from points of the target through points of each slit to the
//! row. The light of the middle slit's image is compared with the sum of the light of each slit. A plane has
//! no average over the pixel's height and the slit's, so its fringes are at least as strong as a sensor's.
//!
//! The fringes have periods of 3.8 to 6.2 pixels. They are 6 to 11 % of the peak (RMS), and a gaussian of
//! fixed width does not see them. The core weights pixels by their noise, and so sees a little of them: 0.02
//! to 0.03 pixels in the median, 0.08 to 0.09 pixels RMS (30 to 35 um of distance at 0.8 m).

use crate::support::*;
use num_complex::Complex64 as Wave;
use slitrange::frame::comb::{NOMINAL_PLACES_UM, SLIT_WIDTH_UM};

/// Points of a slit's width: 20 to a turn of phase where a neighbour's image is.
const POINTS: usize = 128;
/// Points of a pixel's width: 8 or more to a fringe.
const PARTS: usize = 2;
/// Pixels to either side of the image's middle: as far as half of the gap to the neighbour's.
const HALF: i32 = 56;
/// Sigma in pixels of the gaussian that is fitted.
const SIGMA: f64 = 8.6;
/// Numbers of the slits of the nominal mask: two gaps of 860 um.
const SLITS: [usize; 3] = [0, 1, 2];

/// What waves of these phasors, which come the same ways, add up to.
fn sum(phasors: &[Wave], ways: &[Wave]) -> Wave {
    phasors.iter().zip(ways).map(|(a, b)| a * b).sum()
}

/// Light's way from points of a target, through each slit, to the pixels of the middle slit's image.
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
        let columns = (0..(2 * HALF + 1) * PARTS as i32).map(|i| {
            let pixel = first + (f64::from(i) + 0.5) / PARTS as f64 - 0.5;
            let x = (pixel - optics.axis) * optics.pitch;
            [
                optics.baseline + optics.focal_length * cos + x * sin,
                optics.offset - optics.focal_length * sin + x * cos,
            ]
        });
        let columns: Vec<[f64; 2]> = columns.collect();
        let length = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).hypot(a[1] - b[1]);
        let width = f64::from(SLIT_WIDTH_UM) / 1e6;
        let slits = SLITS.map(|slit| {
            let apertures: Vec<[f64; 2]> = (0..POINTS)
                .map(|i| place(slit) + width * ((i as f64 + 0.5) / POINTS as f64 - 0.5))
                .map(|s| [optics.baseline + s * sin, optics.offset + s * cos])
                .collect();
            let wave = |a, b| Wave::cis(TAU * (length(a, b) / optics.wavelength).fract());
            let ways = |from| apertures.iter().map(move |&it| wave(from, it));
            let from_point = |&x: &f64| ways([x, distance]).collect();
            let to_slit: Vec<Vec<Wave>> = points.iter().map(from_point).collect();
            let of_column = |column: &[f64; 2]| {
                let to_row: Vec<Wave> = apertures.iter().map(|&it| wave(it, *column)).collect();
                to_slit.iter().map(|from| sum(from, &to_row)).collect()
            };
            columns.iter().map(of_column).collect()
        });
        Self {
            slits: slits.to_vec(),
            middle: centre - first,
        }
    }

    /// Each pixel's light from points of these amplitudes: of the slits' fields, and of slits one by one.
    fn add(&self, amplitudes: &[Wave], together: &mut [f64], apart: &mut [f64]) {
        for part in 0..together.len() * PARTS {
            let (mut all, pixel) = (Wave::default(), part / PARTS);
            for slit in &self.slits {
                let own = sum(&slit[part], amplitudes);
                apart[pixel] += own.norm_sqr();
                all += own;
            }
            together[pixel] += all.norm_sqr();
        }
    }

    fn dark(&self) -> [Vec<f64>; 2] {
        [(); 2].map(|()| vec![0.0; 2 * HALF as usize + 1])
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
        let step = match slope > 0.0 {
            true => (SIGMA * score / slope).clamp(-SIGMA, SIGMA),
            false => SIGMA * score.signum(),
        };
        centre += 0.7 * step;
    }
    centre
}

/// What the firmware's core finds in a row of light, `scale` counts for a unit of light, with a black level
/// of 300 counts, noise of 4 counts, and 10 electrons a count.
fn core_finds(light: &[f64], scale: f64, seed: u64) -> Answer {
    let pixels = light.len();
    let counts = noisy_row(&mut random(seed), pixels as u16, |i| {
        light[i as usize] * scale
    });
    checked(&geometry(pixels, 6554), &counts, Estimator::default())
}

/// Of the values without their signs.
fn median(values: &[f64]) -> f64 {
    upper_median(values.iter().map(|x| x.abs()))
}

/// How far interference moves images.
#[derive(Default)]
struct Moved {
    /// By the fit, in pixels.
    fit: Vec<f64>,
    /// By the core, in pixels, where it finds a centre in both rows.
    core: Vec<f64>,
    /// Rows without a centre, and rows that the core calls misfits: with interference, and without.
    lost: [usize; 2],
    misfits: [usize; 2],
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
        let seed = self.fit.len() as u64;
        let found = [together, apart].map(|light| core_finds(light, 1500.0 / peak, seed));
        for (i, found) in found.iter().enumerate() {
            match found {
                Ok(found) => self.misfits[i] += usize::from(found.misfit),
                Err(_) => self.lost[i] += 1,
            }
        }
        if let [Ok(together), Ok(apart)] = found {
            let moved = together.centre.to_f64() - apart.centre.to_f64();
            self.core.push(moved);
        }
    }

    fn print(&self, name: &str) {
        let [of_fit, of_core, of_fringes] =
            [&self.fit, &self.core, &self.fringes].map(|it| largest(it));
        let (fit_by, fringes) = (rms(&self.speckle), rms(&self.fringes));
        let (middle, off, rows) = (median(&self.core), rms(&self.core), self.core.len());
        let (lost, misfits) = (self.lost, self.misfits);
        println!("{name}: the fit moves by {of_fit:.1e} px at most, by speckle {fit_by:.2} RMS");
        println!("the core {middle:.4} px (median), {off:.4} RMS, {of_core:.3} at most of {rows}");
        print!("lost {lost:?}, misfits {misfits:?}; ");
        println!("fringes {fringes:.3} RMS, to {of_fringes:.3}");
    }
}

/// The phase between two slits goes through several turns over the distances, 0.800 to 0.801 m.
#[test]
fn fringes_of_a_point_do_not_move_its_image() {
    let mut moved = Moved::default();
    for step in 0..60 {
        let ways = Ways::new(0.8 + f64::from(step) * 17e-6, &[0.0]);
        let [mut together, mut apart] = ways.dark();
        ways.add(&[Wave::ONE], &mut together, &mut apart);
        moved.add(&together, &apart, ways.middle);
    }
    moved.print("point");
    // The fringes are there, and the fit does not see them.
    assert!(rms(&moved.fringes) > 0.05 && largest(&moved.fringes) < 0.06);
    assert!(largest(&moved.fit) < 1e-9);
    // The image is where the slit's optics say, but for obliquity.
    assert!(largest(&moved.speckle) < 0.01);
    assert!(largest(&moved.core) < 0.03 && moved.lost == [0, 0] && moved.misfits == [0, 0]);
}

#[test]
fn fringes_of_a_rough_surface_move_its_image_less_than_speckle_does() {
    // A beam of 1 mm, to 2.25 radii.
    let (radius, pitch, half) = (0.5e-3, 3.6e-6, 312);
    let places: Vec<f64> = (-half..=half).map(|i| f64::from(i) * pitch).collect();
    let ways = Ways::new(0.8, &places);
    for polarisations in [1, 2] {
        let mut moved = Moved::default();
        for seed in 0..300 {
            let mut random = random(seed);
            let [mut together, mut apart] = ways.dark();
            for _ in 0..polarisations {
                let amplitudes = places.iter().map(|x| {
                    let size = (-(x / radius).powi(2)).exp();
                    let size = size * (-(1.0 - random.random::<f64>()).ln()).sqrt();
                    size * Wave::cis(TAU * random.random::<f64>())
                });
                let amplitudes: Vec<Wave> = amplitudes.collect();
                ways.add(&amplitudes, &mut together, &mut apart);
            }
            moved.add(&together, &apart, ways.middle);
        }
        moved.print(&format!("{polarisations} polarisations"));
        // Speckle moves the image by 1.26 pixels on paper and by 2.67 on metal, 14 times as much or more.
        assert!(rms(&moved.speckle) > 1.0 && largest(&moved.fit) < 1e-4);
        assert!(median(&moved.core) < 0.04 && rms(&moved.core) < 0.15);
        assert!(moved.lost.iter().all(|&lost| lost <= 10));
        // A lopsided image is no misfit: it has a larger u. Fringes make some images no spot.
        assert!(moved.misfits.iter().all(|&misfits| misfits <= 30));
    }
}
