//! What a sensor makes of light, effect by effect, compared with closed forms and counts. Also the random
//! numbers of all effects, and the scenes in the folder.

use crate::support::{self, *};
use simulator::scene::{
    Exposure, FixedPattern, HotPixels, Lag, MainsLight, Quantisation, ReadNoise, Response,
    Saturation, Settling, file, random,
};
use std::collections::HashSet;
use std::f64::consts::{FRAC_PI_2, SQRT_2, TAU};
use std::fmt::Display;

fn moments(values: &[f32]) -> [f64; 4] {
    let mean = statistics::mean(values.iter().map(|&x| f64::from(x)));
    let central =
        |power| statistics::mean(values.iter().map(|&x| (f64::from(x) - mean).powi(power)));
    let variance = central(2);
    let skewness = central(3) / variance.powf(1.5);
    let kurtosis = central(4) / variance.powi(2) - 3.0;
    [mean, variance, skewness, kurtosis]
}

fn standard_deviation(values: &[f32]) -> f64 {
    moments(values)[1].sqrt()
}

/// Mean and variance of nearly normal values are as expected, to five standard errors.
#[track_caller]
fn assert_normal(name: &str, values: &[f32], mean: f64, variance: f64) {
    let n = values.len() as f64;
    let [found, scatter, ..] = moments(values);
    println!("{name}: mean {found:.5} for {mean}, variance {scatter:.5} for {variance}");
    assert!((found - mean).abs() < 5.0 * (variance / n).sqrt(), "{name}");
    let off = (scatter / variance - 1.0).abs();
    assert!(off < 5.0 * (2.0 / n).sqrt(), "{name}");
}

fn sum(light: &[f32]) -> f64 {
    light.iter().map(|&x| f64::from(x)).sum()
}

fn apart<'a>(one: &'a [f32], other: impl IntoIterator<Item = &'a f32>) -> f32 {
    let off = one.iter().zip(other).map(|(a, b)| (a - b).abs());
    off.fold(0.0, f32::max)
}

/// 4096 pixels that see even light of so many counts after a second.
fn evenly_lit(counts: f64) -> Scene {
    let ambient = format!("ambient = {{ counts_per_second = {counts}, slope = 0.0 }}");
    listing(Scene::dark(Sensor::Row(4096)), &ambient)
}

/// Some rows of a scene, one after the other, after a second of exposure.
fn rows(scene: Scene, rows: u64) -> Vec<f32> {
    let simulation = Simulation::new(scene);
    let distance = simulation.scene().distance;
    let row = |row| simulation.row(row, distance, 1.0);
    (0..rows).flat_map(row).collect()
}

/// Sum of the squares of what was counted less what was expected, over what was expected: of so many cells
/// chi squared, which is above n + 5 sqrt(2 n) + 10 in less than one in a million.
fn assert_chi_squared(name: &str, counted: &[f64], expected: &[f64]) {
    let cells = || counted.iter().zip(expected).filter(|&(_, &e)| e >= 10.0);
    let squared: f64 = cells().map(|(c, e)| (c - e).powi(2) / e).sum();
    let n = cells().count() as f64;
    println!("{name}: chi squared {squared:.1} of {n} cells");
    assert!(n >= 2.0 && squared < n + 5.0 * (2.0 * n).sqrt() + 10.0);
}

#[test]
fn read_noise_is_white_and_normal() {
    let dark = Scene::dark(Sensor::Row(4096));
    let noise = rows(listing(dark, "read_noise.counts = 4.0"), 1000);
    let n = noise.len() as f64;
    let [.., skewness, kurtosis] = moments(&noise);
    println!("{n} pixels: {skewness:.5}, {kurtosis:.5}");
    // Five standard errors of each.
    assert_normal("read noise", &noise, 0.0, 16.0);
    assert!(skewness.abs() < 5.0 * (6.0 / n).sqrt());
    assert!(kurtosis.abs() < 5.0 * (24.0 / n).sqrt());
    // In cells of a quarter of the deviation, to five of it.
    let normal_below = |x: f64| 0.5 * libm::erfc(-x / SQRT_2);
    let mut counted = [0.0; 40];
    for noise in &noise {
        if let Some(counted) = counted.get_mut((noise + 20.0).floor() as usize) {
            *counted += 1.0;
        }
    }
    let cells = (0..40).map(|cell| f64::from(cell) / 4.0 - 5.0);
    let expected = cells.map(|x| n * (normal_below(x + 0.25) - normal_below(x)));
    assert_chi_squared("read noise", &counted, &expected.collect::<Vec<_>>());
    // No pixel tells anything of one up to two blocks further, nor its size of the other's size; the
    // generator makes a block of 64 numbers of pairs that are 32 apart.
    for lag in 1..=128 {
        let pairs = || noise.iter().zip(&noise[lag..]);
        let product = |(a, b): (&f32, &f32)| f64::from(a * b) / 16.0;
        let sizes = |(a, b): (&f32, &f32)| f64::from((a * a / 16.0 - 1.0) * (b * b / 16.0 - 1.0));
        let values = pairs().map(product).sum::<f64>() / n.sqrt();
        let squares = pairs().map(sizes).sum::<f64>() / (2.0 * n.sqrt());
        let are_small = values.abs() < 5.0 && squares.abs() < 5.0;
        assert!(are_small, "{lag}: {values} {squares}");
    }
}

/// Compares the probability of each number for few electrons, and the first moments for any number n of
/// electrons: mean and variance n, skewness 1 / sqrt(n).
#[test]
fn shot_noise_is_poisson_distributed() {
    for mean in [0.02, 0.5, 3.0, 9.9, 10.1, 30.0, 1000.0, 30_000.0] {
        let noise = "shot_noise.electrons_per_count = 8.0";
        let light = rows(listing(evenly_lit(mean / 8.0), noise), 250);
        let electrons: Vec<f32> = light.iter().map(|light| light * 8.0).collect();
        let is_whole = |n: &f32| n.fract() == 0.0 && n.is_sign_positive();
        assert!(electrons.iter().all(is_whole));
        let n = electrons.len() as f64;
        let [average, variance, skewness, _] = moments(&electrons);
        let ratio = variance / mean;
        println!("{mean}: mean {average:.4}, variance / mean {ratio:.5}, skewness {skewness:.4}");
        // Five standard errors. A Poisson variable's fourth central moment is 3 n^2 + n.
        assert!((average - mean).abs() < 5.0 * (mean / n).sqrt());
        assert!((ratio - 1.0).abs() < 5.0 * ((2.0 + 1.0 / mean) / n).sqrt());
        if mean >= 9.0 {
            // Of the skewness the approximation is short by up to a fiftieth.
            let expected = 1.0 / mean.sqrt();
            assert!((skewness - expected).abs() < 5.0 * (6.0 / n).sqrt() + 0.02 * expected);
        }
        if mean <= 30.0 {
            let mut counted = vec![0.0; 80];
            for &electrons in &electrons {
                counted[electrons as usize] += 1.0;
            }
            let mut expected = vec![n * (-mean).exp()];
            for k in 1..80 {
                expected.push(expected[k - 1] * mean / k as f64);
            }
            assert_chi_squared("electrons", &counted, &expected);
        }
    }
}

/// Light elsewhere on the row does not change a pixel's noise. A row without light draws no random number.
#[test]
fn the_shot_noise_of_a_pixel_does_not_depend_on_other_pixels() {
    let noise = listing(evenly_lit(0.0), "shot_noise.electrons_per_count = 10.0").shot_noise;
    let noise = noise.expect("listed");
    let stream = || random::of_row(3, Effect::ShotNoise, 7);
    let some = |from: usize, to: usize| {
        let mut light = vec![0.0; 1000];
        light[from..to].fill(50.0);
        noise.apply(&mut light, &mut stream());
        light
    };
    let (all, part) = (some(0, 1000), some(333, 444));
    assert_eq!(all[333..444], part[333..444]);
    assert!(part[..333].iter().chain(&part[444..]).all(|&x| x == 0.0));

    let mut untouched = stream();
    noise.apply(&mut vec![0.0; 1000], &mut untouched);
    assert_eq!(untouched.get_word_pos(), 0);
}

/// The deviation from pixel to pixel is a share of the light, and stays from row to row.
#[test]
fn response_differs_in_proportion_to_light() {
    let lit = |counts| rows(listing(evenly_lit(counts), "response.deviation = 0.02"), 2);
    for counts in [0.0, 100.0, 3000.0] {
        let light = lit(counts);
        assert_eq!(light[..4096], light[4096..]);
        let deviation = standard_deviation(&light[..4096]);
        println!("{counts} counts: {deviation:.3}");
        // 4096 pixels have it to 1.1 %.
        assert!((deviation - 0.02 * counts).abs() <= 5.0 * 0.011 * 0.02 * counts);
    }
    // Factors, whatever the light.
    let doubled: Vec<f32> = lit(100.0).iter().map(|x| 2.0 * x).collect();
    assert_eq!(doubled, lit(200.0));
}

/// Also after any exposure, under metal and on dummy pixels, and from row to row.
#[test]
fn the_fixed_pattern_is_the_same_in_the_dark_and_in_light() {
    let scene = listing(Scene::dark(Sensor::Tcd1304dg), "fixed_pattern.counts = 3.0");
    let dark = scene.row(0, 0.8, 1.0);
    assert_normal("fixed pattern", &dark, 0.0, 9.0);
    let shielded = standard_deviation(&dark[scene.geometry().shielded]);
    println!("{shielded:.3} under metal");
    assert!((shielded / 3.0 - 1.0).abs() < 5.0 * (0.5 / 9.0f64).sqrt());
    assert_eq!(dark, scene.row(99, 0.8, 0.001));
    let light = scene.geometry().light;
    let expected: Vec<f32> = dark[light.clone()].iter().map(|x| 512.0 + x).collect();
    let lit = scene.with(Effect::Ambient, &evenly_lit(512.0));
    assert_eq!(lit.row(0, 0.8, 1.0)[light], expected);
}

/// Each row of a camera's frame has other pixels. The next frame reads the same pixels again.
#[test]
fn each_line_of_a_camera_has_patterns_of_its_own() {
    let patterns = "fixed_pattern.counts = 3.0
        response.deviation = 0.02
        hot_pixels = { share = 0.01, counts_per_second = 1000.0 }";
    let scene = listing(Scene::dark(Sensor::Camera), patterns);
    let simulation = Simulation::new(scene.clone());
    let of = |row| simulation.row(row, 0.8, 1.0);
    assert_eq!(of(17), of(17 + scene.sensor.rows()));
    let (one, other) = (of(17), of(18));
    let pairs = one.iter().zip(&other);
    let cold = pairs.filter(|(a, b)| a.abs() < 100.0 && b.abs() < 100.0);
    let product: f64 = cold.map(|(a, b)| f64::from(a * b) / 9.0).sum();
    let correlation = product / 1920.0;
    println!("correlation of two lines {correlation:.3}");
    assert!(correlation.abs() < 5.0 / 1920f64.sqrt());
    let response = scene.response.expect("listed");
    assert!(response.factors(scene.seed, 1, 10) != response.factors(scene.seed, 2, 10));
}

/// The current of hot pixels is proportional to the exposure, and has shot noise as light has.
#[test]
fn the_number_of_hot_pixels_is_binomial() {
    let dark = Scene::dark(Sensor::Row(3648));
    let leaking = "hot_pixels = { share = 0.01, counts_per_second = 400.0 }";
    let scene = listing(dark, leaking);
    let hot = scene.hot_pixels.expect("listed");
    let number = |seed| hot.places(seed, 0, 3648).len() as f32;
    let numbers: Vec<f32> = (0..1000).map(number).collect();
    assert_normal("hot pixels", &numbers, 36.48, 3648.0 * 0.01 * 0.99);
    // A larger share is the same ones, and more.
    let more = HotPixels { share: 0.02, ..hot }.places(1, 0, 3648);
    let places = hot.places(1, 0, 3648);
    assert!(places.iter().all(|place| more.contains(place)) && more.len() > places.len());

    for (i, &count) in scene.row(0, 0.8, 0.5).iter().enumerate() {
        let expected = if places.contains(&i) { 200.0 } else { 0.0 };
        assert_eq!(count, expected, "pixel {i}");
    }
    // One pixel's variance over the rows: counts over electrons a count.
    let all = rows(listing(scene, "shot_noise.electrons_per_count = 10.0"), 400);
    let hot_ones = |row: &[f32]| places.iter().map(|&place| row[place]).collect::<Vec<_>>();
    let hot_ones: Vec<f32> = all.chunks(3648).flat_map(hot_ones).collect();
    assert_normal("hot pixels' light", &hot_ones, 400.0, 40.0);
}

fn bloom(light: &mut [f32], full_well: f64, blooming: f64) {
    let saturation = Saturation {
        full_well,
        blooming,
    };
    saturation.apply(light);
}

/// One pixel holds several and a half wells, and its neighbours are empty. Half of the excess goes to either
/// side, and fills one well in each pixel. A drain that takes three quarters leaves a quarter of the excess,
/// and one that takes all leaves nothing.
#[test]
fn excess_charge_fills_the_neighbours() {
    let cases = [
        (1.0, 16..=24, 30.0),
        (0.25, 19..=21, 7.5),
        (0.0, 20..=20, 0.0),
    ];
    for (blooming, full, rest) in cases {
        let mut light = vec![0.0; 41];
        light[20] = 100.0 + 2.0 * 430.0;
        bloom(&mut light, 100.0, blooming);
        let mut expected = vec![0.0; 41];
        (expected[full.start() - 1], expected[full.end() + 1]) = (rest, rest);
        expected[full].fill(100.0);
        assert_eq!(light, expected);
    }
    // What has nowhere to go leaves over the end: half of it here.
    let mut light = vec![100.0; 41];
    light[5] = 900.0;
    light[30..].fill(0.0);
    bloom(&mut light, 100.0, 1.0);
    let mut expected = vec![100.0; 41];
    expected[34..].fill(0.0);
    assert_eq!(light, expected);
}

/// A gaussian spot five times as high as a well. The total charge stays, and the charge above the well fills
/// the flanks, so the top is flat. The half-length h of the top solves h = (integral of the spot from 0 to h)
/// / well, to a pixel.
#[test]
fn a_bloomed_spot_has_a_flat_top() {
    let (full_well, width, height) = (1000.0, 12.0, 5000.0);
    let mut light = vec![0.0f32; 801];
    let spot = plain_spot().spot.expect("a spot");
    with(spot, |it| it.width = width).add(&mut light, 400.0, height);
    let before = light.clone();
    bloom(&mut light, full_well, 1.0);
    let [all, after] = [&before, &light].map(|it| sum(it));
    println!("{all:.3} counts before, {after:.3} after");
    assert!((after / all - 1.0).abs() < 1e-6);

    let gathered = |h: f64| height * width * FRAC_PI_2.sqrt() * libm::erf(h / (SQRT_2 * width));
    let half = bisect(width, 100.0 * width, |h| gathered(h) > full_well * h);
    let is_full = |light: &&f32| f64::from(**light) > 0.999 * full_well;
    let top = light.iter().filter(is_full).count() as f64;
    println!("a top of {top} pixels, {:.1} expected", 2.0 * half);
    assert!((top - 2.0 * half).abs() <= 2.0);
    // Beyond the top and the one pixel that is partly filled nothing has changed.
    let end = 400 + (half + 2.0) as usize;
    assert_eq!(light[end..], before[end..]);
}

/// The charge stays, no pixel exceeds its well, and the mirrored row gives the mirrored result.
#[test]
fn blooming_favours_no_side() {
    for seed in 0..200 {
        let mut random = random::of_row(seed, Effect::Saturation, 0);
        let mut light = vec![0.0; 3000];
        let normals = random::normals_of(&mut random, 1000);
        for (light, normal) in light[1000..2000].iter_mut().zip(normals) {
            *light = (30.0 + 80.0 * normal).max(0.0);
        }
        let before = sum(&light);
        let mut mirrored: Vec<f32> = light.iter().rev().copied().collect();
        bloom(&mut light, 100.0, 1.0);
        bloom(&mut mirrored, 100.0, 1.0);
        mirrored.reverse();
        assert_eq!(light, mirrored);
        assert!(light.iter().all(|&x| (0.0..=100.001).contains(&x)));
        assert!((sum(&light) / before - 1.0).abs() < 1e-6);
    }
}

/// All outputs drift with time: from row to row of a line sensor, from frame to frame of a camera.
#[test]
fn the_black_level_drifts() {
    for sensor in [Sensor::Tcd1304dg, Sensor::Camera] {
        let drifting = "black_level = { counts = 240.0, drift = 3.0 }";
        let scene = listing(Scene::dark(sensor), drifting);
        for row in [0, 1, 599, 600, 100_000] {
            let time = match sensor {
                Sensor::Camera => (row / 600) as f64 / 41.6,
                _ => row as f64 / 175.4,
            };
            let level = (240.0 + 3.0 * time) as f32;
            println!("{sensor:?}, row {row}: {level}");
            let row = scene.row(row, 0.8, 0.005);
            assert_eq!(row, vec![level; scene.sensor.geometry().words]);
        }
    }
}

/// Ambient light has the stated height in the middle, and rises by the slope from pixel to pixel. It is
/// proportional to the exposure, never below zero, and absent under metal.
#[test]
fn ambient_light_has_a_slope() {
    let row = |slope: f64| {
        let ambient = format!("ambient = {{ counts_per_second = 2000.0, slope = {slope} }}");
        listing(Scene::dark(Sensor::Tcd1304dg), &ambient).row(0, 0.8, 0.25)
    };
    let light = Sensor::Tcd1304dg.geometry().light;
    for (i, &count) in row(0.5)[light.clone()].iter().enumerate() {
        // Exact in single precision.
        assert_eq!(count, 0.25 * (2000.0 + 0.5 * (i as f32 - 1823.5)));
    }
    let row = row(2.0);
    let dark = row[light.clone()].iter().filter(|&&x| x == 0.0).count();
    // The slope crosses zero 1000 pixels from the middle.
    assert_eq!(dark, 824);
    let mut under_metal = row[..light.start].iter().chain(&row[light.end..]);
    assert!(under_metal.all(|&x| x == 0.0));
}

/// If the noise is wider than a step, rounding adds a variance of step^2 / 12 and no mean.
#[test]
fn rounding_adds_a_variance_of_a_twelfth_of_the_squared_step() {
    let noisy = "black_level.counts = 300.3\nread_noise.counts = 20.0";
    let before = listing(Scene::dark(Sensor::Row(4096)), noisy);
    let after = rows(listing(before.clone(), "quantisation.step = 16.0"), 100);
    let before = rows(before, 100);
    assert!(after.iter().all(|x| x % 16.0 == 0.0));
    let error: Vec<f32> = after.iter().zip(&before).map(|(a, b)| a - b).collect();
    let n = error.len() as f64;
    let ([mean, variance, ..], expected) = (moments(&error), 256.0 / 12.0);
    println!("{mean:.4}, {variance:.3}, {expected:.3} expected");
    // An even distribution's kurtosis is 9/5: a standard error of the variance of sqrt(4/5 / n).
    assert!((variance / expected - 1.0).abs() < 5.0 * (0.8 / n).sqrt());
    assert!(mean.abs() < 5.0 * (variance / n).sqrt());
    let more = moments(&after)[1] - moments(&before)[1];
    println!("{more:.2} more in the row's variance");
    assert!((more - expected).abs() < 5.0 * 400.0 * (2.0 / n).sqrt());
}

#[test]
fn counts_round_half_up_and_clip_at_both_ends() {
    let mut counts = [-9.0, -8.0, -7.9, 0.0, 7.9, 8.0, 23.9, 4087.9, 4088.0, 1e9];
    Quantisation { step: 16.0 }.apply(&mut counts, 4095);
    // 8 bits: 256 codes, of which the last is 255 steps.
    let expected = [-16, -16, 0, 0, 0, 16, 16, 4080, 4080, 4080];
    assert_eq!(counts, expected.map(|it| it as f32));
    let counts = [-3.0, 0.4, 0.5, 7.49, 4094.5, 4095.4, 1e9, f32::NAN];
    assert_eq!(quantise(&counts, 4095), [0, 0, 1, 7, 4095, 4095, 4095, 0]);
}

/// Exposures do not overlap: where they are longer than the sensor's period, rows come at theirs.
#[test]
fn a_row_takes_as_long_as_its_exposure() {
    for (exposure, period) in [(0.005, 1.0 / 175.4), (0.02, 0.02)] {
        let moving = listing(plain_spot(), "motion.speed = 0.1");
        let simulation = Simulation::new(Scene { exposure, ..moving });
        let moved = simulation.true_distance(10, 0.8) - 0.8;
        println!("{moved} m in ten rows of {exposure} s");
        assert!((moved - 10.0 * 0.1 * period).abs() < 1e-12);
    }
}

/// One lit pixel gives to the samples 1 - a, a (1 - b), a (1 - b) b ... of its light. Of a step, a is left at
/// the hold and b at the end of the pixel. A spot moves by a / (1 - b) pixels and keeps its light. An even
/// row does not change: the first output has no step before it.
#[test]
fn an_unsettled_output_moves_the_spot_by_a_closed_form() {
    for time_constant in [0.1e-6, 0.3e-6, 0.6e-6, 1.5e-6] {
        // 16 periods of 10.5 MHz, of which 70 % have passed at the hold.
        let pixel = 16.0 / 10.5e6;
        let [a, b] = [0.7, 1.0].map(|part: f64| (-part * pixel / time_constant).exp());
        let settling = Settling { time_constant };
        let mut counts = vec![0.0; 40];
        counts[10] = 1000.0;
        settling.apply(&mut counts);
        for (k, &count) in (0..).zip(&counts[10..]) {
            let share = match k {
                0 => 1.0 - a,
                _ => a * (1.0 - b) * b.powi(k - 1),
            };
            assert!((f64::from(count) - 1000.0 * share).abs() < 1e-3, "{k}");
        }
        assert!(counts[..10].iter().all(|&count| count == 0.0));

        let mut counts = [300.0; 100];
        settling.apply(&mut counts);
        assert_eq!(counts, [300.0; 100]);

        let slow = format!("settling.time_constant = {time_constant}");
        let [before, after] = [plain_spot(), listing(plain_spot(), &slow)].map(|scene| {
            let row = scene.row(0, 0.8, 0.005);
            let products = (0..).zip(&row).map(|(i, &x)| f64::from(i) * f64::from(x));
            (sum(&row), products.sum::<f64>() / sum(&row))
        });
        let (moved, expected) = (after.1 - before.1, a / (1.0 - b));
        println!("{time_constant:.1e} s: {moved:.6} pixels, {expected:.6} expected");
        assert!((moved - expected).abs() < 1e-5);
        assert!((settling.shift() - expected).abs() < 1e-9);
        assert!((after.0 / before.0 - 1.0).abs() < 1e-6);
    }
}

/// Light of 400 counts, amplified, above a black level of 300 and an offset of 20 counts. The rail does not
/// depend on the offset. The full well is in electrons, before the gain. The core gets the nominal gain.
#[test]
fn the_front_end_amplifies_light_shifts_it_and_clips() {
    let well = "saturation.full_well = 200.0\n";
    for (gain, saturation, well, expected) in [
        (0.75, "", "", 620.0),
        (0.75, ", saturation = 621.0", "", 620.0),
        (0.75, ", saturation = 550.0", "", 550.0),
        (1.5, "", well, 620.0),
    ] {
        let level = format!("{well}black_level.counts = 300.0");
        let nominal = listing(evenly_lit(400.0), &level);
        let front_end = format!("front_end = {{ gain = {gain}, offset = 20.0{saturation} }}");
        let scene = listing(nominal.clone(), &front_end);
        assert_eq!(scene.geometry(), nominal.geometry());
        assert_eq!(rows(scene, 1), [expected; 4096], "{front_end}");
    }
}

/// What a TCD1304 keeps: 100 counts are 1000 electrons.
const LAG: Lag = Lag {
    counts: 100.0,
    share: 1.0,
};

fn lagging(scene: Scene) -> Scene {
    with(scene, |it| it.lag = Some(LAG))
}

/// Bright and faint light leave similar charge. Of a full well of 40,000 electrons less than the noise of 60
/// is left after 20 pulses (M. C. Nelson).
#[test]
fn lag_hardly_depends_on_bright_light() {
    let [bright, half] = [4000.0, 2000.0].map(|counts| 10.0 * LAG.stays(counts));
    println!("{bright:.1} electrons stay of 40,000, {half:.1} of 20,000");
    assert!((bright - 40e6 / 41e3).abs() < 1e-9 && (half - 20e6 / 21e3).abs() < 1e-9);
    let left = (0..20).fold(4000.0, |charge, _| LAG.stays(charge)) * 10.0;
    println!("{left:.1} electrons after 20 pulses");
    assert!((left - 1.0 / (1.0 / 40e3 + 20.0 / 1e3)).abs() < 1e-6 && left < 60.0);
    // Of 0.01 counts the share stays; of 1000, whose share is 300, 300 x 100 / 400.
    let lag = Lag { share: 0.3, ..LAG };
    let (faint, bright) = (lag.stays(0.01), lag.stays(1000.0));
    println!("{faint:.6} of 0.01 counts stay, {bright:.3} of 1000");
    assert!((faint / 0.003 - 1.0).abs() < 1e-4 && (bright - 75.0).abs() < 1e-9);
}

/// The laser is on in one row, and off before and after. The two rows together have the pulse's light, and
/// the second row has what the closed form says. Lag does not show if both rows have the same light.
#[test]
fn lag_moves_charge_to_the_next_row() {
    let lit = lagging(plain_spot());
    let light = plain_spot().row(0, 0.8, 0.005);
    assert_eq!(lit.row(5, 0.8, 0.005), light);

    let of = |scene: &Scene, laser, before| scene.row(0, 0.8, exposure(laser, before));
    let (pulse, after) = (of(&lit, 0.005, 0.0), of(&lit, 0.0, 0.005));
    for (i, &light) in light.iter().enumerate() {
        let q = f64::from(light);
        assert!((f64::from(after[i]) - q * 100.0 / (100.0 + q)).abs() < 1e-4);
        assert!((pulse[i] + after[i] - light).abs() < 2e-4);
    }
    let highest = |row: Vec<f32>| f64::from(row.into_iter().fold(0.0, f32::max));
    let ghost = highest(after);
    println!("a ghost of {ghost:.2} counts after a spot of 1750");
    assert!((ghost - 1750.0 * 100.0 / 1850.0).abs() < 0.01);
    // A full pixel leaves what its well holds, however much light there was.
    let full = listing(lit, "saturation.full_well = 1000.0");
    let ghost = highest(of(&full, 0.0, 0.005));
    println!("{ghost:.3} counts after a full well of 1000");
    assert!((ghost - 1000.0 * 100.0 / 1100.0).abs() < 1e-3);
}

#[test]
fn lag_draws_a_ghost_behind_a_moving_target() {
    let moving = listing(plain_spot(), "motion.speed = 2.0");
    let [now, before] = [7, 6].map(|row| moving.row(row, 0.7, 0.005));
    let expected = now.iter().zip(&before).map(|(&now, &before)| {
        let [q, r] = [now, before].map(f64::from);
        (q - q * 100.0 / (100.0 + q) + r * 100.0 / (100.0 + r)) as f32
    });
    let expected: Vec<f32> = expected.collect();
    let worst = apart(&lagging(moving).row(7, 0.7, 0.005), &expected);
    let place = |row: &[f32]| (0..row.len()).max_by(|&a, &b| row[a].total_cmp(&row[b]));
    let [now, before] = [now, before].map(|row| place(&row).expect("pixels"));
    println!("spot at {now}, ghost at {before}; off by {worst:.1e} counts at most");
    assert!(worst < 2e-3 && before > now + 20);
}

/// Lamps of 100 Hz and 120 Hz, compared with Simpson's rule over each row's exposure. An exposure of a whole
/// number of their periods does not see them flicker.
#[test]
fn lamps_flicker_from_row_to_row() {
    let lamps = |frequency, phase, slope| MainsLight {
        counts_per_second: 40_000.0,
        slope,
        modulation: 0.6,
        frequency,
        phase,
    };
    let lit = |lamps| {
        let dark = Scene::dark(Sensor::Row(16));
        Simulation::new(with(dark, |it| it.mains_light = Some(lamps)))
    };
    for frequency in [100.0, 120.0] {
        let simulation = lit(lamps(frequency, Some(0.3), 0.0));
        let (exposure, mut range) = (0.004, (f64::MAX, 0.0f64));
        for row in 0..40 {
            let counts = simulation.row(row, 0.8, exposure);
            assert!(counts.iter().all(|&count| count == counts[0]));
            let start = row as f64 / 175.4 - exposure / 2.0;
            let mean = support::integral(0.0, 1.0, 100, |part| {
                let turns = frequency * (start + exposure * part);
                1.0 + 0.6 * (TAU * turns + 0.3).cos()
            });
            let expected = 40_000.0 * exposure * mean;
            assert!((f64::from(counts[0]) - expected).abs() < 1e-3, "row {row}");
            range = (range.0.min(expected), range.1.max(expected));
        }
        println!("{frequency} Hz: {:.1} to {:.1} counts", range.0, range.1);
        assert!(range.1 - range.0 > 100.0);

        let simulation = lit(lamps(frequency, None, 0.0));
        for row in 0..40 {
            let counts = simulation.row(row, 0.8, 2.0 / frequency);
            assert!((f64::from(counts[0]) - 80_000.0 / frequency).abs() < 1e-3);
        }
    }
    // Lamps to one side: a row of 16 whose pixels differ by a hundredth of the middle's light.
    let [light, even] = [400.0, 0.0].map(|slope| lit(lamps(100.0, None, slope)).row(3, 0.8, 4e-3));
    for (pixel, (&light, &even)) in light.iter().zip(&even).enumerate() {
        let expected = 1.0 + 0.01 * (pixel as f64 - 7.5);
        assert!((f64::from(light) / f64::from(even) - expected).abs() < 1e-6);
    }
    // A drawn phase is even over a turn: of 4000, mean cosine and sine have a variance of 1/2 over 4000.
    let phases = || (0..4000).map(|seed| lamps(100.0, None, 0.0).phase(seed));
    let means = [f64::cos, f64::sin].map(|it| phases().map(it).sum::<f64>() / 4000.0);
    println!("mean cosine and sine of drawn phases {means:.4?}");
    let most = 5.0 * (0.5 / 4000f64).sqrt();
    assert!(means.iter().all(|mean| mean.abs() < most));
}

/// The laser shines for 2 ms of a row of 5 ms. The row has the laser's light of 2 ms, and ambient light and
/// dark current of 5 ms. A row without a pulse is that of a scene without a laser, bit for bit, with noise.
#[test]
fn ambient_light_and_dark_current_do_not_depend_on_the_laser() {
    let with = |scene, effects: &[Effect]| effects.iter().copied().fold(scene, with_effect);
    let collected = [Effect::Ambient, Effect::MainsLight, Effect::HotPixels];
    let scene = with(plain_spot(), &collected);
    let mut dark = scene.clone();
    dark.spot = None;
    let of = |scene: &Scene, laser| scene.row(3, 0.8, exposure(laser, 0.0));
    let (spot, rest) = (plain_spot().row(3, 0.8, 0.002), dark.row(3, 0.8, 0.005));
    let sum: Vec<f32> = spot.iter().zip(&rest).map(|(a, b)| a + b).collect();
    let worst = apart(&sum, &of(&scene, 0.002));
    println!("off by {worst:.1e} counts at most");
    // The last bit of numbers up to 1024.
    assert!(worst <= 1.3e-4);
    let [scene, dark] = [scene, dark].map(|it| with(it, &[Effect::ShotNoise, Effect::ReadNoise]));
    assert_eq!(of(&scene, 0.0), of(&dark, 0.002));
}

const EVERY_EFFECT: &str = include_str!("scene_sensor/every-effect.toml");

/// The effects whose parameters can make them do nothing, with such parameters.
const EFFECTS_IN_VAIN: &str = include_str!("scene_sensor/in-vain.toml");

/// A scene that lists an effect of [`EVERY_EFFECT`] besides what it lists.
fn with_effect(scene: Scene, effect: Effect) -> Scene {
    let every = listing(spot_behind_a_lens(), EVERY_EFFECT);
    let scene = match effect {
        Effect::Speckle | Effect::Texture => scene.with(Effect::LaserSpot, &every),
        _ => scene,
    };
    scene.with(effect, &every)
}

/// Each effect has its own stream of random numbers for each row, each line of the sensor and each seed. The
/// patterns made from the streams differ too.
#[test]
fn all_random_streams_differ() {
    let mut first = vec![];
    for ((seed, effect), number) in pairs(pairs([1, 2], Effect::ALL), [0, 1, 2, 1 << 40]) {
        first.push(random::words(&mut random::of_row(seed, effect, number)));
        first.push(random::words(&mut random::of_line(seed, effect, number)));
    }
    let different: HashSet<_> = first.iter().collect();
    assert_eq!(different.len(), first.len());

    let response = Response { deviation: 0.01 }.factors(1, 0, 3648);
    let response: Vec<f32> = response.iter().map(|factor| factor - 1.0).collect();
    let pattern = FixedPattern { counts: 0.01 }.offsets(1, 0, 3648);
    let mut noise = vec![0.0; 3648];
    ReadNoise { counts: 0.01 }.apply(&mut noise, &mut random::of_row(1, Effect::ReadNoise, 0));
    let others = [&pattern, &noise, &response];
    for (a, b) in [&response, &pattern, &noise].into_iter().zip(others) {
        let products = a.iter().zip(b).map(|(a, b)| f64::from(a * b));
        let correlation = products.sum::<f64>() / (3648.0 * 0.01 * 0.01);
        println!("correlation {correlation:.4}");
        assert!(correlation.abs() < 5.0 / 3648f64.sqrt());
    }
}

fn plain_spot() -> Scene {
    let spot = Scene::white_paper().spot;
    with(Scene::dark(Sensor::Tcd1304dg), |it| it.spot = spot)
}

/// A spot behind a lens, on which every effect can act.
fn spot_behind_a_lens() -> Scene {
    with(plain_spot(), |it| it.optics.aperture = Aperture::PAPER_LENS)
}

/// A row of 5 ms, while the laser was on for these seconds, and in the row before for those.
fn exposure(laser: f64, laser_before: f64) -> Exposure {
    Exposure {
        row: 0.005,
        laser,
        laser_before,
    }
}

/// A row after one without the laser: with the laser in both, lag would show nothing.
fn after_darkness(scene: &Scene, row: u64) -> Vec<f32> {
    scene.row(row, scene.distance, exposure(0.005, 0.0))
}

/// A row, put together by hand: light that is free of noise, and then what the sensor's effects make of it,
/// each with random numbers of its own by its name, the seed and the row, and by nothing else in the scene.
fn put_together(scene: &Scene, row: u64) -> Vec<f32> {
    // The effects of the sensor are the last ones.
    let of_the_sensor = (Effect::ALL.into_iter()).skip_while(|it| *it != Effect::Response);
    let light_alone = of_the_sensor.fold(scene.clone(), Scene::without);
    let (seed, geometry) = (scene.seed, scene.sensor.geometry());
    let collected = |laser| {
        let mut counts = light_alone.row(row, scene.distance, exposure(laser, 0.0));
        let light = &mut counts[geometry.light.clone()];
        if let Some(response) = scene.response {
            let factors = response.factors(seed, 0, light.len());
            light.iter_mut().zip(factors).for_each(|(x, f)| *x *= f);
        }
        if let Some(hot) = scene.hot_pixels {
            for place in hot.places(seed, 0, light.len()) {
                light[place] += (hot.counts_per_second * scene.exposure) as f32;
            }
        }
        counts
    };
    let mut counts = collected(0.005);
    let light = &mut counts[geometry.light.clone()];
    if let Some(lag) = scene.lag {
        let full_well = scene.saturation.map_or(f64::INFINITY, |it| it.full_well);
        lag.apply(light, &collected(0.0)[geometry.light.clone()], full_well);
    }
    let random = |effect| random::of_row(seed, effect, row);
    let shot_noise = scene.shot_noise.iter();
    shot_noise.for_each(|it| it.apply(light, &mut random(Effect::ShotNoise)));
    scene.saturation.iter().for_each(|it| it.apply(light));
    scene.front_end.iter().for_each(|it| it.amplify(light));
    if let Some(black) = scene.black_level {
        let level = black.after(row as f64 * scene.sensor.period()) as f32;
        counts.iter_mut().for_each(|x| *x += level);
    }
    if let Some(pattern) = scene.fixed_pattern {
        let offsets = pattern.offsets(seed, 0, counts.len());
        counts.iter_mut().zip(offsets).for_each(|(x, o)| *x += o);
    }
    scene.settling.iter().for_each(|it| it.apply(&mut counts));
    let front_end = scene.front_end.iter();
    front_end.for_each(|it| it.shift_and_clip(&mut counts));
    let read_noise = scene.read_noise.iter();
    read_noise.for_each(|it| it.apply(&mut counts, &mut random(Effect::ReadNoise)));
    let quantisation = scene.quantisation.iter();
    quantisation.for_each(|it| it.apply(&mut counts, geometry.full_scale()));
    counts
}

/// Adding an effect to a scene with all kinds of noise, or removing an effect, changes no bit of the other
/// effects. All at once do what each does, in their order: shot noise is in the light of lamps too and before
/// the gain, black level above the full well, and read noise after the rail. Lamps alone are left out, as the
/// row before has other light of them, and the converter's steps, which would hide small differences.
#[test]
fn no_effect_changes_the_random_numbers_of_another() {
    use Effect::{FixedPattern, HotPixels, ReadNoise, Response, ShotNoise};
    let noises = [Response, ShotNoise, FixedPattern, HotPixels, ReadNoise];
    let noisy = (noises.into_iter()).fold(spot_behind_a_lens(), with_effect);
    for effect in Effect::ALL {
        let without = noisy.clone().without(effect);
        let with = with_effect(noisy.clone(), effect);
        assert!(with.lists(effect) && !without.lists(effect));
        let mut changed = false;
        for row in [0, 5] {
            let [bare, full] = [&without, &with].map(|it| after_darkness(it, row));
            assert_eq!(bare, put_together(&without, row), "no {effect:?}");
            assert_eq!(full, put_together(&with, row), "{effect:?}");
            changed |= full != bare;
        }
        // The scene is one in which the effect does something.
        assert!(changed, "{effect:?}");
    }
    let all = listing(spot_behind_a_lens(), EVERY_EFFECT);
    let all = (all.without(Effect::Quantisation)).without(Effect::MainsLight);
    assert_eq!(after_darkness(&all, 5), put_together(&all, 5));
}

/// If the parameters of a listed effect are zero, the effect changes no bit of a row with all other effects,
/// whether it draws random numbers or not.
#[test]
fn an_effect_that_does_nothing_changes_nothing() {
    let every = listing(spot_behind_a_lens(), EVERY_EFFECT);
    for in_vain in EFFECTS_IN_VAIN.lines().filter(|it| !it.starts_with('#')) {
        let name = in_vain.split(' ').next().unwrap_or_default();
        let effect = (Effect::ALL.into_iter()).find(|it| it.name() == name);
        let without = every.clone().without(effect.expect(name));
        let with = listing(without.clone(), in_vain);
        let [with, without] = [with, without].map(|it| after_darkness(&it, 3));
        assert_eq!(with, without, "{name}");
    }
}

fn counts(simulation: &Simulation, row: u64) -> Vec<u16> {
    let scene = simulation.scene();
    let light = simulation.row(row, scene.distance, scene.exposure);
    quantise(&light, scene.geometry().full_scale())
}

/// Six rows of a scene to look at: of a camera those in the middle, which see a round spot too.
fn first_rows(scene: &Scene) -> std::ops::Range<u64> {
    match scene.sensor.rows() {
        1 => 0..6,
        lines => lines / 2 - 3..lines / 2 + 3,
    }
}

#[test]
fn rows_do_not_depend_on_threads_or_order() {
    for name in "old-sensor moving-target brushed-metal paper-on-camera".split(' ') {
        let scene = support::scene(name);
        let rows = first_rows(&scene);
        let simulation = Simulation::new(scene.clone());
        let one_by_one: Vec<_> = rows.clone().map(|row| counts(&simulation, row)).collect();
        for threads in [1, 2] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
            let simulation = Simulation::new(scene.clone());
            let rows = rows.clone().into_par_iter();
            let made = rows.map(|row| counts(&simulation, row));
            let made: Vec<_> = pool.build().expect("threads").install(|| made.collect());
            assert_eq!(made, one_by_one, "{name}, {threads} threads");
        }
        let backwards = rows.rev().map(|row| counts(&simulation, row));
        assert!(backwards.eq(one_by_one.iter().rev().cloned()), "{name}");
    }
}

/// The snapshot has a checksum (FNV-1a) of the bytes of the counts. It shows a change of any random number,
/// or of any light by some millionths.
#[test]
fn rows_of_scenes_never_change() {
    let mut table = String::new();
    // Among them they list every effect that draws random numbers, but for the one phase of mains_light.
    let names = "quiet-paper sunlit saturated old-sensor moving-target warming-up rusty-metal \
                 paper-on-camera lens comb";
    for name in names.split(' ') {
        let scene = support::scene(name);
        let rows = first_rows(&scene);
        let simulation = Simulation::new(scene);
        let bytes = rows.flat_map(|row| counts(&simulation, row));
        let add = |hash: u64, byte: u8| (hash ^ u64::from(byte)).wrapping_mul(0x100_0000_01b3);
        let hash = (bytes.flat_map(u16::to_le_bytes)).fold(0xcbf2_9ce4_8422_2325u64, add);
        table += &format!("{name:<18} {hash:016x}\n");
    }
    print!("{table}");
    insta::assert_snapshot!("scenes", table);
}

#[test]
fn scenes_are_read_and_written() {
    assert!(texts().count() >= 12);
    for (name, scene, _) in texts() {
        let text = scene.to_toml().expect("text");
        assert_eq!(Scene::from_toml(&text).expect("a scene"), scene, "{name}");
        let about = &scene.about;
        let is_a_sentence = about.ends_with('.') && !about.contains('\n');
        assert!(is_a_sentence, "{name}: {about:?}");
    }
    let quiet = support::scene("quiet-paper");
    let white = with(Scene::white_paper(), |it| it.about = quiet.about.clone());
    assert_eq!(quiet, white);
}

fn texts() -> impl Iterator<Item = (String, Scene, String)> {
    let names = file::names().expect("the folder of scenes").into_iter();
    names.map(|name| {
        let text = std::fs::read_to_string(file::folder().join(format!("{name}.toml")));
        (name.clone(), support::scene(&name), text.expect("a file"))
    })
}

#[test]
fn scenes_give_a_reason_for_each_effect() {
    for (name, _, text) in texts() {
        assert!(text.starts_with("# "), "{name}");
        let lines: Vec<&str> = text.lines().collect();
        let effects = lines.windows(2).filter(|it| it[1].starts_with('['));
        let effects: Vec<_> = effects.collect();
        let has_reason = effects.iter().all(|it| it[0].starts_with("# "));
        assert!(has_reason, "{name}: {effects:?}");
        assert!(effects.len() >= 4, "{name}");
    }
}

fn centre(simulation: &Simulation, row: u64) -> Result<RowCentre, Fault> {
    let (counts, geometry) = (counts(simulation, row), simulation.scene().geometry());
    let shielded = &counts[geometry.shielded.clone()];
    let light = &counts[geometry.light.clone()];
    let row = Row::new(light, shielded, geometry.full_scale()).expect("12 bits");
    let (spot, budget) = spot::find(&row)?;
    let estimator = Estimator::default();
    centre_of_spot(estimator, &row, &spot, None, &geometry, None, budget)
}

/// In the rows of each scene, the core finds the spot within a width of its true place, and the check lets it
/// pass; or the core gives the fault that the file names.
#[test]
fn scenes_give_a_centre_or_the_fault_that_their_file_names() {
    for (name, scene, text) in texts() {
        let announced = (text.lines()).find_map(|line| line.strip_prefix("# Expected fault: "));
        let announced = announced.and_then(|fault| fault.strip_suffix('.'));
        let rows = first_rows(&scene);
        let simulation = Simulation::new(scene);
        let mut furthest = 0.0f64;
        for row in rows {
            match (centre(&simulation, row), announced) {
                (Ok(found), None) => {
                    let truth = simulation.true_centre(row, simulation.scene().distance);
                    let off = (found.centre.to_f64() - truth) / found.width.to_f64();
                    furthest = furthest.max(off.abs());
                    assert!(off.abs() < 1.0, "{name}, row {row}: off by {off} widths");
                }
                (Err(fault), Some(announced)) => {
                    assert_eq!(Fault::NAMES[fault.kind()], announced, "{name}, row {row}");
                }
                (found, _) => panic!("{name}, row {row}: {found:?}"),
            }
        }
        match announced {
            Some(fault) => println!("{name}: {fault}"),
            None => println!("{name}: off by {furthest:.3} of a width at most"),
        }
    }
}

/// What is replaced in a scene with every effect, by what, and words of the error. `|` is the end of a line.
const MEANINGLESS: &str = include_str!("scene_sensor/meaningless.txt");

fn assert_error(error: impl Display, words: &str) {
    let error = format!("{error:#}");
    println!("{error}");
    assert!(error.contains(words), "{error:?} lacks {words:?}");
}

#[test]
fn meaningless_scenes_are_refused() {
    let lens = spot_behind_a_lens().to_toml().expect("text");
    let every = format!("{EVERY_EFFECT}{lens}");
    assert!(Scene::from_toml(&every).is_ok());
    for line in MEANINGLESS.trim().lines() {
        let parts = line.split(" => ").map(|part| part.replace('|', "\n"));
        let parts: Vec<String> = parts.collect();
        let changed = every.replace(&parts[0], &parts[1]);
        assert!(changed != every, "{line}");
        assert_error(Scene::from_toml(&changed).expect_err(line), &parts[2]);
    }

    let refused = |scene: &Scene, words: &str| assert_error(scene.check().expect_err(words), words);
    let with = |effect| with_effect(Scene::white_paper(), effect);
    let mut scene = with(Effect::Speckle);
    let (width, height) = (200e-6, 4.3e-3);
    scene.optics.aperture = Aperture::Slit { width, height };
    refused(&scene, "optics.aperture.slit.height is 0.0043 m");
    let words = "sensor.row is 65537 pixels: it must be 1 to 65536";
    refused(&Scene::dark(Sensor::Row(65_537)), words);
    use Effect::{Coma, Defocus, Distortion, Flare};
    for effect in [Defocus, Coma, Distortion, Flare] {
        let name = format!("[{}] is a lens's", effect.name());
        refused(&with(effect), &name);
    }
    let mut scene = with(Effect::SecondReflection);
    scene.spot = None;
    refused(&scene, "add [spot]");
    let error = Scene::load("no-such").expect_err("no scene");
    assert_error(error, "no-such.toml; there are black-tape");
}

/// With speckle, the surface is as large as a beam at 1.5 times the distance of the scene's target. The scene
/// accepts distances up to this limit, and refuses larger ones.
#[test]
fn a_scene_with_speckle_refuses_distances_beyond_its_surface() {
    let scene = support::scene("speckle-receding");
    let farthest = 1.5 * scene.distance;
    for distance in [0.3, farthest] {
        scene.check_distance(distance).expect("a distance");
        Simulation::new(scene.clone()).row(0, distance, scene.exposure);
    }
    for distance in [f64::NAN, -0.1, 0.29, 1.01 * farthest] {
        let error = scene.check_distance(distance).expect_err("too far");
        println!("{error}");
    }
}
