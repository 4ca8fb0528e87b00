use core::ops::Range;
use std::vec::Vec;

use super::*;
use crate::base::numeric::inverse_root_of_64;
use crate::centre::gauss_newton::MaskedPixels;
use crate::row::Polarity;
use crate::tests::{bare, gaussian, hash};

impl Norms {
    fn sums(&self) -> [f64; 8] {
        let it = self;
        let sums = [it.l0, it.l1, it.l2, it.m0, it.m1, it.m2, it.m3, it.m4];
        sums.map(|sum| f64::from(sum) / f64::from(1 << 24))
    }
}

impl Even {
    /// All sums, the norms first, those with p in units of z.
    fn all(&self) -> impl Iterator<Item = f64> {
        let norms = [f64::from(self.norms.samples)]
            .into_iter()
            .chain(self.norms.sums());
        let EvenSums {
            p,
            p0,
            p1,
            p2,
            squares,
        } = self.sums;
        let sums = [(p, 64.0), (p0, 8.0), (p1, 16.0), (p2, 64.0)];
        let sums = sums.map(|(sum, unit)| f64::from(sum) * unit);
        norms.chain(sums).chain([16.0 * squares as f64])
    }
}

#[test]
fn the_mirror_is_the_nearest_half_pixel() {
    for (centre, right, left, is_in_a_pixel, offset) in [
        (10.0, 11, 10, true, 0.0),
        (10.2, 11, 10, true, 0.2),
        (10.3, 11, 11, false, -0.2),
        (10.5, 11, 11, false, 0.0),
        (9.8, 11, 10, true, -0.2),
    ] {
        let place = Place::of(Pixels::from_f32(centre));
        let found = (place.right, place.left, place.is_in_a_pixel);
        assert_eq!(found, (right, left, is_in_a_pixel), "{centre}");
        assert!((place.offset.to_f32() - offset).abs() < 1e-4, "{centre}");
    }
    for end in [Pixels::MIN, Pixels::MAX] {
        let place = Place::of(end);
        assert!(place.right >= 1 && place.offset.to_f32().abs() <= 0.5);
    }
}

/// One, Q6.26.
const Q26: i32 = 1 << 26;

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
                pitch: Q26 / 5,
                per_pitch: 5 << 24,
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

impl Correction {
    /// Those of 1, u^2 and u^4 in units of z.
    fn coefficients(&self) -> [f64; 3] {
        let unit = f64::from(1 << self.coarser);
        let coefficients = [(self.c0, unit), (self.c1, unit), (self.c2, unit / 256.0)];
        coefficients.map(|(it, unit)| f64::from(it) * unit)
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
            let height = 1 << 28;
            let per_s = (Q26 as f32 / width) as i32;
            let correction = Correction::of(Pixels::from_f32(offset), per_s, height);
            let [c0, c1, c2] = correction
                .coefficients()
                .map(|it| it as f32 / height as f32);
            let next = if offset > 0.0 { 1.0 } else { -1.0 };
            let moved = |x: f32| y(x) + offset.abs() * (y(x + next) - y(x));
            for i in 1..8 {
                let x = i as f32 * 0.5;
                let z = moved(x) - moved(-x);
                let u = x / width;
                let of_interpolation =
                    u * libm::expf(-0.5 * u * u) * (c0 + u * u * (c1 + u * u * c2));
                worst = worst.max((z + of_interpolation).abs());
                without = without.max(z.abs());
            }
        }
        println!("width {width}: {worst:.1e} of the height, {without:.1e} before");
        assert!(worst < limit && without > 2.0 * worst, "{width}");
    }
}

/// The widest inputs: a quarter of a pixel, the largest height, and widths from where the correction stops to
/// grow. What `Scale::columns` computes with wrapping products fits 32 bits, out to eight widths.
#[test]
fn no_correction_wraps() {
    let mut largest = 0;
    for (offset, tenths) in [-0.25, -0.21, 0.1, 0.21, 0.25]
        .into_iter()
        .flat_map(|at| (3..=65).map(move |it| (at, it)))
    {
        let per_s = Q26 / tenths * 10;
        let it = Correction::of(Pixels::from_f32(offset), per_s, i32::MAX);
        for step in 0..=80 {
            let u = f64::from(step) / 10.0;
            let f1 = u * libm::exp(-0.5 * u * u) * f64::from(1 << 30);
            let (f1, square) = (f1 as i64, (u * u * f64::from(1 << 24)) as i64);
            let c1 = ((i64::from(it.c2) * square) >> 32) + i64::from(it.c1);
            let c0 = ((c1 * (1 << 8) * square) >> 32) + i64::from(it.c0);
            let correction = ((c0 * f1) >> 32) * (1 << it.coarser);
            for sum in [c1 * (1 << 8), c0, correction] {
                largest = largest.max(sum.abs());
                assert!(i32::try_from(sum).is_ok(), "{offset} {tenths} {u}");
            }
        }
    }
    println!("2^{:.1}", (largest as f64).log2());
}

/// What a pair is in f64, from the definitions. In counts, not in units of z.
struct Exact {
    u: f64,
    e: f64,
    p: f64,
    /// In standard deviations, as the functions times `root` are.
    z: f64,
    root: f64,
}

fn reference(pairs: &Pairs<'_>, noise: &Noise, dark: u64) -> Vec<Exact> {
    let light = |pixel: usize| f64::from(pairs.light.get(pixel).expect("a pixel"));
    let offset = pairs.mirror.offset.to_f64();
    let level = f64::from(pairs.level) / 256.0;
    let unit = libm::ldexp(1.0, pairs.fraction() as i32);
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
    let mut exact = Vec::new();
    for i in 0.. {
        let (first, pitch) = (f64::from(pairs.first()), f64::from(pairs.pitch));
        let u = (first + pitch * f64::from(i)) / f64::from(Q26);
        let from = pairs.mirror.right + i as usize * pairs.pixels;
        let to = pairs.mirror.left as i64 - i64::from(i) * pairs.pixels as i64;
        let start = to - pairs.pixels as i64;
        let last = f64::from(REACH) + (first - pitch * 1e-4) / f64::from(Q26);
        if u > last || start < 1 || from + pairs.pixels >= pairs.light.len() {
            break;
        }
        let (right, left) = (from..from + pairs.pixels, start as usize..to as usize);
        if !counts(right.clone()) || !counts(left.clone()) {
            continue;
        }
        let (right, left): (f64, f64) = (right.map(moved).sum(), left.map(moved).sum());
        let e = libm::exp(-0.5 * u * u);
        let coefficients = noise.correction.map_or([0.0; 3], |it| it.coefficients());
        let [c0, c1, c2] = coefficients.map(|it| it / unit);
        let z = right - left + u * e * (c0 + u * u * (c1 + u * u * c2));
        let p = right + left;
        let dark = dark as f64 / (unit * unit);
        let variance = dark + f64::from(noise.shot) / 65536.0 * p.max(0.0);
        let (z, root) = (z / variance.sqrt(), (dark / variance).sqrt());
        exact.push(Exact { u, e, p, z, root });
    }
    exact
}

impl Exact {
    /// The terms of the sums of [`Even::all`].
    fn even(&self) -> [f64; 14] {
        let Self { u, e, p, .. } = *self;
        let (e1, e2) = (u * u * e, u.powi(4) * e);
        let squares = [e * e, e * e1, e * e2, e1 * e2, e2 * e2];
        let mut terms = [1.0; 14];
        terms[1..4].copy_from_slice(&[e, e1, e2]);
        terms[4..9].copy_from_slice(&squares);
        terms[9..].copy_from_slice(&[p, p * e, p * e1, p * e2, p * p]);
        terms
    }

    fn odd(&self) -> [f64; COMPONENTS] {
        let f = |power| self.root * self.u.powi(power) * self.e;
        [f(1), self.root * self.u, f(3), f(5), f(7)]
    }
}

/// The components in standard deviations, by the method of Gram and Schmidt.
fn exact_components(pairs: &[Exact]) -> [f64; COMPONENTS] {
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let z: Vec<f64> = pairs.iter().map(|pair| pair.z).collect();
    let mut before: Vec<Vec<f64>> = Vec::new();
    core::array::from_fn(|i| {
        let whole: Vec<f64> = pairs.iter().map(|pair| pair.odd()[i]).collect();
        let mut rest = whole.clone();
        for function in &before {
            let along = dot(&rest, function);
            rest.iter_mut()
                .zip(function)
                .for_each(|(it, f)| *it -= along * f);
        }
        let norm = dot(&rest, &rest);
        // As `Odd::of`.
        if norm <= libm::ldexp(1.0, -13) * dot(&whole, &whole) {
            return 0.0;
        }
        rest.iter_mut().for_each(|it| *it /= norm.sqrt());
        before.push(rest);
        before.last().map_or(0.0, |function| dot(&z, function))
    })
}

/// Rows with a spot, noise, and a level that is no whole number: samples of all sizes, at all places about
/// the mirror, whole, near the row's ends, with saturated and masked pixels, and lopsided.
#[test]
fn sums_agree_with_their_definitions() {
    let (mut worst_sum, mut worst_component, mut worst_square) = (0.0f64, 0.0f64, 0.0f64);
    let (mut whole, mut others, mut largest) = (0, 0, 0.0f64);
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
        let second = [0.0, 3.0, 100.0, 1500.0][case % 4];
        let mut light: [u16; 901] = core::array::from_fn(|i| {
            let spot = 200.0 + 2000.0 * gaussian(i, centre, width);
            let second = second * gaussian(i, centre + 1.7 * width, 0.8 * width);
            (spot + second) as u16 + (hash(i + 901 * case) >> 28) as u16
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
        let samples = libm::sqrtf(width * width + block * block / 12.0) / block;
        let mirror = Place::of(Pixels::from_f32(centre));
        let pitch = (Q26 as f32 / samples) as i32;
        let pairs = Pairs {
            light: row.light(),
            mirror,
            pixels,
            pitch,
            per_pitch: (samples * (1 << 24) as f32) as i32,
            level: 200 * 256 + 77,
            gaps: Gaps {
                saturation: has_saturated.then_some(4095),
                masked: &masked,
            },
        };
        let unit = libm::ldexpf(1.0, pairs.fraction() as i32);
        // Less noise than that of the row makes z larger than 16 bits hold.
        let read = [4.0, 0.5][case / 20 % 2];
        let dark = (2.0 * read * read * block * unit * unit) as u64;
        let height = (2000.0 * block * unit) as i32;
        let noise = Noise {
            correction: (pixels == 1).then(|| Correction::of(mirror.offset, pitch, height)),
            per_root: inverse_root_of_64(dark),
            // 0.1.
            shot: 6554,
        };
        let number = if pairs.are_whole() {
            &mut whole
        } else {
            &mut others
        };
        *number += 1;
        let (odd, even) = pairs.sums(&noise, false);
        let exact = reference(&pairs, &noise, dark);
        let mut units = [1.0; 14];
        units[9..13].fill(f64::from(unit));
        units[13] = f64::from(unit * unit);
        for (i, (found, unit)) in even.all().zip(units).enumerate() {
            // Products far from the centre have the absolute error of those at the centre.
            let least = if i < 9 { 1.0 } else { 1000.0 };
            let terms = exact.iter().map(|pair| pair.even()[i]);
            let (sum, magnitude) = terms.fold((0.0, least), |(sum, all), term| {
                (sum + term, all + term.abs())
            });
            let error = (found / unit - sum).abs() / magnitude;
            worst_sum = worst_sum.max(error);
            assert!(error <= 2e-5, "{i} of {width} at {centre}: {found} {sum}");
        }
        let squares: f64 = exact.iter().map(|pair| pair.z * pair.z).sum();
        let (components, rest) = odd.components(1 << 16);
        let found = components.map(|it| f64::from(it) / 4096.0);
        let (norm, bits) = odd.norm_of_shift();
        let worst = odd.worst() as f64 / 128.0;
        let most = exact.iter().map(|pair| pair.z.abs()).fold(0.0, f64::max);
        largest = largest.max(most);
        let norm_of_shift = exact.iter().map(|it| it.odd()[0].powi(2)).sum();
        // The sum of squares is rounded to Q8, and z to Q7: the largest to one and a half steps.
        for (found, exact, step) in [
            (rest as f64 / 256.0 + found[0] * found[0], squares, 0.01),
            (worst * worst, most * most, 0.01),
            (libm::ldexp(norm.into(), -bits).powi(2), norm_of_shift, 1e-6),
        ] {
            let error = (found - exact).abs();
            worst_square = worst_square.max(error / (exact + step / 0.03));
            assert!(
                error <= 0.03 * exact + step,
                "{width} at {centre}: {found} {exact}"
            );
        }
        // Of fewer pairs a function may be rounding alone.
        if exact.len() < 11 {
            continue;
        }
        for (found, exact) in found.into_iter().zip(exact_components(&exact)) {
            let error = (found - exact).abs() / (1.0 + most);
            worst_component = worst_component.max(error);
            assert!(
                error <= 0.02,
                "{width} at {centre}: {found} {exact}, {most}"
            );
        }
    }
    println!(
        "{whole} whole and {others} others, z up to {largest:.0}: sums {worst_sum:.1e}, squares \
         {worst_square:.1e}, components {worst_component:.1e} standard deviations"
    );
    assert!(whole > 100 && others > 100 && largest > 300.0);
}

/// The sums over all pairs in f64, one after the other. Beyond the reach lies less than 1e-6 of a sum,
/// and the rounding of single precision is 2e-7.
#[test]
fn the_series_gives_the_sums_over_all_pairs() {
    let mut worst = 0.0f64;
    // A sample has one pixel below a width of six, two below twelve, and so on.
    for width in [2.0f32, 3.0, 5.9, 6.0, 10.5, 12.0, 17.9, 18.0, 25.0, 35.9] {
        let block = libm::floorf(width / 6.0) + 1.0;
        let samples = libm::sqrtf(width * width + block * block / 12.0) / block;
        let nothing = MaskedPixels::default();
        // The mirror between two pixels, and in the middle of a pixel.
        for centre in [10.5, 10.0] {
            let pairs = Pairs {
                light: (&[0; 20]).into(),
                mirror: Place::of(Pixels::from_f32(centre)),
                pixels: block as usize,
                pitch: (Q26 as f32 / samples) as i32,
                per_pitch: (samples * (1 << 24) as f32) as i32,
                level: 0,
                gaps: Gaps {
                    saturation: None,
                    masked: &nothing,
                },
            };
            let (number, _) = pairs.number();
            let mut sums = [0.0f64; 8];
            for i in 0..number {
                let u = f64::from(pairs.first()) + i as f64 * f64::from(pairs.pitch);
                let u = u / f64::from(Q26);
                let e = libm::exp(-0.5 * u * u);
                let parts = [0, 2, 4].map(|power| (power, e)).into_iter();
                let parts = parts.chain([0, 2, 4, 6, 8].map(|power| (power, e * e)));
                for (sum, (power, part)) in sums.iter_mut().zip(parts) {
                    *sum += u.powi(power) * part;
                }
            }
            let norms = Norms::of_all(&pairs, number);
            assert_eq!(norms.samples, number as i32);
            for (norm, sum) in norms.sums().into_iter().zip(sums) {
                let error = (norm / sum - 1.0).abs();
                worst = worst.max(error);
                assert!(error < 4e-6, "{width} {centre}: {norm} {sum}");
            }
        }
    }
    println!("{worst:.1e}");
}

#[test]
fn a_root_is_right_to_half_a_percent() {
    assert_eq!(root_of_weight(UNLIT), 65535 << 14);
    let (mut worst, mut mean, mut number) = (0.0f64, 0.0, 0);
    for step in 0..6000 {
        let variance = f64::from(UNLIT) * libm::exp(f64::from(step) * 0.002);
        let exact = f64::from(1 << 30) * libm::sqrt(f64::from(UNLIT) / variance);
        let error = f64::from(root_of_weight(variance as u32)) / exact - 1.0;
        worst = worst.max(error.abs());
        mean += error;
        number += 1;
    }
    mean /= f64::from(number);
    println!("worst {worst:.4}, mean {mean:.5}");
    assert!(worst < 5e-3 && mean.abs() < 5e-4);
}
