use core::ops::Range;

use super::*;
use crate::centre::gauss_newton::MaskedPixels;
use crate::row::Polarity;
use crate::tests::{bare, gaussian, hash};

impl Norms {
    fn sums(&self) -> [f32; 8] {
        let it = self;
        [it.l0, it.l1, it.l2, it.m0, it.m1, it.m2, it.m3, it.m4]
    }
}

impl Even {
    /// All sums, the norms first.
    fn all(&self) -> impl Iterator<Item = f32> {
        let norms = [self.norms.samples].into_iter().chain(self.norms.sums());
        norms.chain([self.p, self.p0, self.p1, self.p2, self.squares])
    }
}

impl Odd {
    fn all(&self) -> [f32; 19] {
        let it = self;
        let [squares, worst] = [it.squares, it.worst];
        [
            it.m1, it.m2, it.m3, it.m4, it.m5, it.m6, it.m7, it.tt, it.t1, it.t3, it.t5, it.t7,
            it.z1, it.z3, it.z5, it.z7, it.zt, squares, worst,
        ]
    }
}

#[test]
fn the_mirror_is_the_nearest_half_pixel() {
    for (centre, right, left, to_right, offset) in [
        (10.0, 11, 10, 1.0, 0.0),
        (10.2, 11, 10, 1.0, 0.2),
        (10.3, 11, 11, 0.5, -0.2),
        (10.5, 11, 11, 0.5, 0.0),
        (9.8, 11, 10, 1.0, -0.2),
    ] {
        let place = Place::of(Pixels::from_f32(centre));
        let found = (place.right, place.left, place.to_right);
        assert_eq!(found, (right, left, to_right), "{centre}");
        assert!((place.offset - offset).abs() < 1e-4, "{centre}");
    }
    for end in [Pixels::MIN, Pixels::MAX] {
        let place = Place::of(end);
        assert!(place.right >= 1 && place.offset.abs() <= 0.5);
    }
}

/// Saturated pixels, masked ones, and both; samples of all sizes, and mirrors near the row's ends.
#[test]
fn a_pair_with_a_gap_is_one_whose_samples_take_one() {
    let light: [u16; 300] = core::array::from_fn(|i| (hash(i) >> 24) as u16);
    for (pixels, centre) in (1..=7).flat_map(|pixels| [150.2, 150.7, 20.0].map(|at| (pixels, at))) {
        for (saturation, samples) in [
            (Some(252), 0),
            (None, 1 << 40 | 3),
            (Some(252), 1 << 90 | 1 << 5),
        ] {
            let masked = MaskedPixels {
                first: 10,
                block: 3,
                samples,
            };
            let pairs = Pairs {
                light: (&light).into(),
                mirror: Place::of(Pixels::from_f32(centre)),
                pixels,
                u: 0.1,
                pitch: 0.2,
                level: 0,
                gaps: Gaps {
                    saturation,
                    masked: &masked,
                },
            };
            let found = pairs.places_of_gaps();
            let (from, end) = (pairs.mirror.right - 1, pairs.mirror.left + 1);
            for pair in 0..pairs.number().1 {
                let right = from + pair * pixels;
                let left = end - pair * pixels;
                let is_gap = !(pairs.gaps.leave(pairs.light, right..right + pixels + 2)
                    && pairs.gaps.leave(pairs.light, left - pixels - 2..left));
                assert_eq!(found >> pair & 1 == 1, is_gap, "{pixels} {centre} {pair}");
            }
        }
    }
}

/// A gaussian sampled at whole pixels, without noise. At a width of 0.85 pixels, interpolation makes an
/// error in z of 5 % of the height, and the correction leaves 0.2 %.
#[test]
fn interpolation_leaves_no_derivatives() {
    for (width, limit) in [(0.85f32, 2.5e-3), (1.5, 5e-5), (4.0, 2e-7)] {
        let (mut worst, mut without) = (0.0f32, 0.0f32);
        for step in -25..=25 {
            let offset = step as f32 / 100.0;
            let y = |x: f32| libm::expf(-0.5 * (x - offset) * (x - offset) / (width * width));
            let correction = Correction::of(offset, 1.0 / width, 1.0);
            let next = if offset > 0.0 { 1.0 } else { -1.0 };
            let moved = |x: f32| y(x) + offset.abs() * (y(x + next) - y(x));
            for i in 1..8 {
                let x = i as f32 * 0.5;
                let z = moved(x) - moved(-x);
                let u = x / width;
                worst = worst.max((z + correction.at(u, libm::expf(-0.5 * u * u))).abs());
                without = without.max(z.abs());
            }
        }
        println!("width {width}: {worst:.1e} of the height, {without:.1e} before");
        assert!(worst < limit && without > 2.0 * worst, "{width}");
    }
}

/// All sums in f64, from the definitions, with the sum of their terms' magnitudes. Counts, not
/// [`Pairs::units_a_count`].
fn reference(pairs: &Pairs<'_>, noise: &Noise) -> [(f64, f64); 33] {
    let light = |pixel: usize| f64::from(pairs.light.get(pixel).expect("a pixel"));
    let offset = f64::from(pairs.mirror.offset);
    let level = f64::from(pairs.level) / 256.0;
    let moved = |pixel: usize| {
        let first = if offset > 0.0 { pixel } else { pixel - 1 };
        light(pixel) + offset * (light(first + 1) - light(first)) - level
    };
    let counts = |pixels: Range<usize>| {
        let saturation = pairs.gaps.saturation.unwrap_or(u16::MAX);
        let mut pixels = pixels.start - 1..pixels.end + 1;
        pixels
            .all(|pixel| pairs.light.get(pixel) < Some(saturation) && !pairs.gaps.masked.has(pixel))
    };
    let mut sums = [(0.0, 0.0); 33];
    for i in 0.. {
        let u = f64::from(pairs.u) + f64::from(pairs.pitch) * f64::from(i);
        let from = pairs.mirror.right + i as usize * pairs.pixels;
        let to = pairs.mirror.left as i64 - i64::from(i) * pairs.pixels as i64;
        let start = to - pairs.pixels as i64;
        let last = f64::from(pairs.u) + f64::from(REACH) - f64::from(pairs.pitch * 1e-4);
        if u > last || start < 1 || from + pairs.pixels >= pairs.light.len() {
            break;
        }
        let (right, left) = (from..from + pairs.pixels, start as usize..to as usize);
        if !counts(right.clone()) || !counts(left.clone()) {
            continue;
        }
        let (right, left): (f64, f64) = (right.map(moved).sum(), left.map(moved).sum());
        let e = libm::exp(-0.5 * u * u);
        let Correction { c0, c1, c2, .. } = noise.correction;
        let [c0, c1, c2] = [c0, c1, c2].map(f64::from);
        let z = right - left + u * e * (c0 + u * u * (c1 + u * u * c2));
        let p = right + left;
        let w = 1.0 / (f64::from(noise.dark) + f64::from(noise.shot) * p.max(0.0));
        let f = |power: i32| libm::pow(u, power.into()) * e;
        let mut terms = [0.0; 33];
        for (k, term) in terms[..7].iter_mut().enumerate() {
            *term = w * f(1) * f(1 + 2 * k as i32);
        }
        terms[7] = w * u * u;
        for (k, power) in [1, 3, 5, 7].into_iter().enumerate() {
            terms[8 + k] = w * u * f(power);
            terms[12 + k] = w * z * f(power);
        }
        terms[16] = w * z * u;
        terms[17] = w * z * z;
        let [e0, e1, e2] = [f(0), f(2), f(4)];
        let (alone, squares) = (
            [1.0, e0, e1, e2],
            [e0 * e0, e0 * e1, e0 * e2, e1 * e2, e2 * e2],
        );
        terms[19..23].copy_from_slice(&alone);
        terms[23..28].copy_from_slice(&squares);
        terms[28..].copy_from_slice(&[p, p * e0, p * e1, p * e2, p * p]);
        // z is a small difference of samples.
        let difference = (right.abs() + left.abs()) / z.abs().max(1e-9);
        for (i, (sum, term)) in sums.iter_mut().zip(terms).enumerate() {
            let of_z = (12..18).contains(&i);
            let cancels = if of_z { difference } else { 1.0 };
            *sum = (sum.0 + term, sum.1 + term.abs() * cancels);
        }
        sums[18].0 = sums[18].0.max(w * z * z);
    }
    // The worst pair is one of the squares.
    sums[18].1 = sums[17].1;
    sums
}

/// Rows with a spot, noise and a level that is no whole number: samples of all sizes, at all places about
/// the mirror, whole, near the row's ends, and with saturated and masked pixels.
#[test]
fn sums_agree_with_their_definitions() {
    let (mut worst, mut whole, mut others) = (0.0f64, 0, 0);
    let widths = [
        0.9, 1.5, 2.5, 4.5, 7.0, 10.5, 14.0, 20.0, 25.0, 33.0, 40.0, 60.0f32,
    ];
    for (case, width) in (0..60).flat_map(|case| widths.map(|width| (case, width))) {
        let is_near_the_end = case % 5 == 4;
        let start = if is_near_the_end {
            4.0 * width + 3.0
        } else {
            450.0
        };
        let centre = start + 0.173 * case as f32;
        let mut light: [u16; 901] = core::array::from_fn(|i| {
            let spot = (200.0 + 2000.0 * gaussian(i, centre, width)) as u16;
            spot + (hash(i + 901 * case) >> 28) as u16
        });
        let has_saturated = case % 5 == 2;
        if has_saturated {
            light[centre as usize + 3] = 4095;
        }
        let geometry = bare(light.len(), [Polarity::Rising, Polarity::Falling][case % 2]);
        let words = light.map(|count| count ^ geometry.inverted());
        let row = geometry.row(&words).expect("a row");
        let masked = MaskedPixels {
            first: 440,
            block: 2,
            samples: if case % 5 == 3 { 0b1001_1000_0000 } else { 0 },
        };
        let pixels = (width / 6.0) as usize + 1;
        let block = pixels as f32;
        let per_s = 1.0 / libm::sqrtf(width * width + block * block / 12.0);
        let mirror = Place::of(Pixels::from_f32(centre));
        let pairs = Pairs {
            light: row.light(),
            mirror,
            pixels,
            u: (mirror.to_right + 0.5 * (block - 1.0)) * per_s,
            pitch: block * per_s,
            level: 200 * 256 + 77,
            gaps: Gaps {
                saturation: has_saturated.then_some(4095),
                masked: &masked,
            },
        };
        let unit = pairs.units_a_count();
        let noise = |unit: f32| Noise {
            correction: Correction::of(mirror.offset, per_s, 2000.0 * block * unit),
            dark: 2.0 * 16.0 * block * unit * unit,
            shot: 0.1 * unit,
        };
        let number = if pairs.are_whole() {
            &mut whole
        } else {
            &mut others
        };
        *number += 1;
        let (odd, even) = pairs.sums(&noise(unit), false);
        let (w, z) = (unit * unit, unit);
        // Weights fall with the square of the unit.
        let mut units = [w; 33];
        units[12..17].fill(w / z);
        units[17..28].fill(1.0);
        units[28..32].fill(1.0 / unit);
        units[32] = 1.0 / w;
        let found = odd.all().into_iter().chain(even.all());
        let sums = reference(&pairs, &noise(1.0)).into_iter().zip(units);
        for (i, (found, ((sum, magnitude), unit))) in found.zip(sums).enumerate() {
            let error = (f64::from(found) * f64::from(unit) - sum).abs();
            worst = worst.max(error / magnitude);
            let is_right = error <= 2e-5 * magnitude;
            assert!(is_right, "{i} of {width} at {centre}: {found} {sum}");
        }
    }
    println!("{worst:.1e} of {whole} whole and {others} others");
    assert!(whole > 100 && others > 100);
}

/// The sums over all pairs in f64, one after the other. Beyond the reach lies less than 1e-6 of a sum,
/// and the rounding of single precision is 2e-7.
#[test]
fn the_series_gives_the_sums_over_all_pairs() {
    let mut worst = 0.0f64;
    // A sample has one pixel below a width of six, two below twelve, and so on.
    for width in [2.0f32, 3.0, 5.9, 6.0, 10.5, 12.0, 17.9, 18.0, 25.0, 35.9] {
        let block = libm::floorf(width / 6.0) + 1.0;
        let s = libm::sqrtf(width * width + block * block / 12.0);
        let pitch = block / s;
        // The mirror between two pixels, and in the middle of a pixel.
        for to_right in [0.5, 1.0] {
            let first = (to_right + 0.5 * (block - 1.0)) / s;
            let number = (REACH / pitch) as usize + 1;
            let mut sums = [0.0f64; 8];
            for i in 0..number {
                let u = f64::from(first) + i as f64 * f64::from(pitch);
                let e = libm::exp(-0.5 * u * u);
                let parts = [0, 2, 4].map(|power| (power, e)).into_iter();
                let parts = parts.chain([0, 2, 4, 6, 8].map(|power| (power, e * e)));
                for (sum, (power, part)) in sums.iter_mut().zip(parts) {
                    *sum += u.powi(power) * part;
                }
            }
            let norms = Norms::of_all(first, pitch, number);
            assert_eq!(norms.samples, number as f32);
            for (norm, sum) in norms.sums().into_iter().zip(sums) {
                let error = (f64::from(norm) / sum - 1.0).abs();
                worst = worst.max(error);
                assert!(error < 1.5e-6, "{width} {to_right}: {norm} {sum}");
            }
        }
    }
    println!("{worst:.1e}");
}
