//! What a sensor makes of light, effect by effect, compared with closed forms and counts. Also the random
//! numbers of all effects, and the scenes in the folder. The tests print every figure that they assert.

use rayon::prelude::*;
use simulator::optics::Aperture;
use simulator::scene::{
    Ambient, BlackLevel, Effect, Exposure, FixedPattern, FrontEnd, HotPixels, Lag, MainsLight,
    Motion, Quantisation, ReadNoise, Response, Saturation, Scene, Sensor, Settling, ShotNoise,
    Simulation, Spot, file, quantise, random,
};
use slitrange::base::fault::Fault;
use slitrange::centre::{Estimator, RowCentre};
use slitrange::measurement::steps::centre_of_spot;
use slitrange::row::Row;
use slitrange::spot;

/// Mean, variance, skewness and excess kurtosis.
fn moments(values: &[f32]) -> [f64; 4] {
    let n = values.len() as f64;
    let mean = values.iter().map(|&x| f64::from(x)).sum::<f64>() / n;
    let central = |power| {
        let powers = values.iter().map(|&x| (f64::from(x) - mean).powi(power));
        powers.sum::<f64>() / n
    };
    let variance = central(2);
    [
        mean,
        variance,
        central(3) / variance.powf(1.5),
        central(4) / variance.powi(2) - 3.0,
    ]
}

fn standard_deviation(values: &[f32]) -> f64 {
    moments(values)[1].sqrt()
}

/// Pixels of 4096 that see even light of so many counts after a second.
fn evenly_lit(counts: f64) -> Scene {
    Scene {
        ambient: Some(Ambient {
            counts_per_second: counts,
            slope: 0.0,
        }),
        ..Scene::dark(Sensor::Row(4096))
    }
}

/// Some rows of a scene, one after the other, after a second of exposure.
fn rows(scene: Scene, rows: u64) -> Vec<f32> {
    let simulation = Simulation::new(scene);
    let distance = simulation.scene().distance;
    (0..rows)
        .flat_map(|row| simulation.row(row, distance, 1.0))
        .collect()
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

// ---- Effects ----

#[test]
fn read_noise_is_white_and_normal() {
    let noise = rows(
        Scene {
            read_noise: Some(ReadNoise { counts: 4.0 }),
            ..Scene::dark(Sensor::Row(4096))
        },
        1000,
    );
    let n = noise.len() as f64;
    let [mean, variance, skewness, kurtosis] = moments(&noise);
    println!("{n} pixels: {mean:.5}, {variance:.4}, {skewness:.5}, {kurtosis:.5}");
    // Five standard errors of each.
    assert!(mean.abs() < 5.0 * 4.0 / n.sqrt());
    assert!((variance / 16.0 - 1.0).abs() < 5.0 * (2.0 / n).sqrt());
    assert!(skewness.abs() < 5.0 * (6.0 / n).sqrt());
    assert!(kurtosis.abs() < 5.0 * (24.0 / n).sqrt());

    // In cells of a quarter of the deviation, to five of it.
    let normal_below = |x: f64| 0.5 * libm::erfc(-x / std::f64::consts::SQRT_2);
    let mut counted = [0.0; 40];
    for noise in &noise {
        let cell = (noise + 20.0).floor() as usize;
        if let Some(counted) = counted.get_mut(cell) {
            *counted += 1.0;
        }
    }
    let expected: Vec<f64> = (0..40)
        .map(|cell| f64::from(cell) / 4.0 - 5.0)
        .map(|x| n * (normal_below(x + 0.25) - normal_below(x)))
        .collect();
    assert_chi_squared("read noise", &counted, &expected);

    // No pixel tells anything of one up to two blocks further, nor its size of the other's size; the
    // generator makes a block of 64 numbers of pairs that are 32 apart.
    for lag in 1..=128 {
        let pairs = || noise.iter().zip(&noise[lag..]);
        let product = |(a, b): (&f32, &f32)| f64::from(a * b) / 16.0;
        let sizes = |(a, b): (&f32, &f32)| f64::from((a * a / 16.0 - 1.0) * (b * b / 16.0 - 1.0));
        let values = pairs().map(product).sum::<f64>() / n.sqrt();
        let squares = pairs().map(sizes).sum::<f64>() / (2.0 * n.sqrt());
        assert!(
            values.abs() < 5.0 && squares.abs() < 5.0,
            "{lag}: {values} {squares}"
        );
    }
}

/// Compares the probability of each number for few electrons, and the first moments for any number n of
/// electrons: mean and variance n, skewness 1 / sqrt(n).
#[test]
fn shot_noise_is_poisson_distributed() {
    for mean in [0.02, 0.5, 3.0, 9.9, 10.1, 30.0, 1000.0, 30_000.0] {
        let electrons_per_count = 8.0;
        let light = rows(
            Scene {
                shot_noise: Some(ShotNoise {
                    electrons_per_count,
                }),
                ..evenly_lit(mean / electrons_per_count)
            },
            250,
        );
        let electrons: Vec<f32> = light.iter().map(|light| light * 8.0).collect();
        assert!(
            electrons
                .iter()
                .all(|n| n.fract() == 0.0 && n.is_sign_positive())
        );
        let n = electrons.len() as f64;
        let [average, variance, skewness, _] = moments(&electrons);
        println!(
            "{mean}: mean {average:.4}, variance over mean {:.5}, skewness {skewness:.4}",
            variance / mean
        );
        // Five standard errors. A Poisson variable's fourth central moment is 3 n^2 + n.
        assert!((average - mean).abs() < 5.0 * (mean / n).sqrt());
        assert!((variance / mean - 1.0).abs() < 5.0 * ((2.0 + 1.0 / mean) / n).sqrt());
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
            let mut probability = (-mean).exp();
            let expected: Vec<f64> = (0..80)
                .map(|k| {
                    let expected = n * probability;
                    probability *= mean / f64::from(k + 1);
                    expected
                })
                .collect();
            assert_chi_squared("electrons", &counted, &expected);
        }
    }
}

/// Light elsewhere on the row does not change a pixel's noise. A row without light draws no random number.
#[test]
fn the_shot_noise_of_a_pixel_does_not_depend_on_other_pixels() {
    let noise = ShotNoise {
        electrons_per_count: 10.0,
    };
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
    let lit = |counts| {
        let deviation = Some(Response { deviation: 0.02 });
        rows(
            Scene {
                response: deviation,
                ..evenly_lit(counts)
            },
            2,
        )
    };
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

/// The deviation is the same in the dark and in light, after any exposure, under metal and on dummy pixels.
/// It stays from row to row.
#[test]
fn the_fixed_pattern_is_the_same_in_the_dark_and_in_light() {
    let scene = Scene {
        fixed_pattern: Some(FixedPattern { counts: 3.0 }),
        ..Scene::dark(Sensor::Tcd1304dg)
    };
    let dark = scene.row(0, 0.8, 1.0);
    let deviation = standard_deviation(&dark);
    println!("{deviation:.3} counts, 3 expected");
    assert!((deviation / 3.0 - 1.0).abs() < 5.0 * (0.5 / 3694.0f64).sqrt());
    let shielded = standard_deviation(&dark[scene.geometry().shielded]);
    println!("{shielded:.3} under metal");
    assert!((shielded / 3.0 - 1.0).abs() < 5.0 * (0.5 / 9.0f64).sqrt());
    assert_eq!(dark, scene.row(99, 0.8, 0.001));
    let lit = Scene {
        ambient: evenly_lit(512.0).ambient,
        ..scene.clone()
    };
    let light = scene.geometry().light;
    let expected: Vec<f32> = dark[light.clone()].iter().map(|x| 512.0 + x).collect();
    assert_eq!(lit.row(0, 0.8, 1.0)[light], expected);
}

/// Each row of a camera's frame has other pixels. The next frame reads the same pixels again.
#[test]
fn each_line_of_a_camera_has_patterns_of_its_own() {
    let scene = Scene {
        fixed_pattern: Some(FixedPattern { counts: 3.0 }),
        response: Some(Response { deviation: 0.02 }),
        hot_pixels: Some(HotPixels {
            share: 0.01,
            counts_per_second: 1000.0,
        }),
        ..Scene::dark(Sensor::Camera)
    };
    let (seed, rows) = (scene.seed, scene.sensor.rows());
    let simulation = Simulation::new(scene.clone());
    let of = |row| simulation.row(row, 0.8, 1.0);
    assert_eq!(of(17), of(17 + rows));
    let product: f64 = of(17)
        .iter()
        .zip(&of(18))
        .filter(|(a, b)| a.abs() < 100.0 && b.abs() < 100.0)
        .map(|(a, b)| f64::from(a * b) / 9.0)
        .sum();
    let correlation = product / 1920.0;
    println!("correlation of two lines {correlation:.3}");
    assert!(correlation.abs() < 5.0 / 1920f64.sqrt());
    let response = scene.response.expect("listed");
    assert!(response.factors(seed, 1, 10) != response.factors(seed, 2, 10));
}

/// The current of hot pixels is proportional to the exposure, and has shot noise as light has.
#[test]
fn the_number_of_hot_pixels_is_binomial() {
    let hot = HotPixels {
        share: 0.01,
        counts_per_second: 400.0,
    };
    let numbers: Vec<f32> = (0..1000)
        .map(|seed| hot.places(seed, 0, 3648).len() as f32)
        .collect();
    let [mean, variance, ..] = moments(&numbers);
    println!("{mean:.2} +- {:.2} of 3648", variance.sqrt());
    let expected = 3648.0 * 0.01 * 0.99;
    assert!((mean - 36.48).abs() < 5.0 * (expected / 1000.0f64).sqrt());
    assert!((variance / expected - 1.0).abs() < 5.0 * (2.0 / 1000.0f64).sqrt());

    // A larger share is the same ones, and more.
    let more = HotPixels { share: 0.02, ..hot }.places(1, 0, 3648);
    let places = hot.places(1, 0, 3648);
    assert!(places.iter().all(|place| more.contains(place)) && more.len() > places.len());

    let scene = Scene {
        hot_pixels: Some(hot),
        ..Scene::dark(Sensor::Row(3648))
    };
    let row = scene.row(0, 0.8, 0.5);
    for (i, &count) in row.iter().enumerate() {
        let expected = if places.contains(&i) { 200.0 } else { 0.0 };
        assert_eq!(count, expected, "pixel {i}");
    }
    // One pixel's variance over the rows: counts over electrons a count.
    let electrons_per_count = 10.0;
    let noisy = Scene {
        shot_noise: Some(ShotNoise {
            electrons_per_count,
        }),
        ..scene
    };
    let all = rows(noisy, 400);
    let hot_ones: Vec<f32> = all
        .chunks(3648)
        .flat_map(|row| places.iter().map(|&place| row[place]))
        .collect();
    let variance = standard_deviation(&hot_ones).powi(2);
    println!("variance {variance:.2}, 40 expected");
    assert!((variance / 40.0 - 1.0).abs() < 5.0 * (2.0 / hot_ones.len() as f64).sqrt());
}

#[test]
fn a_pixel_never_exceeds_its_full_well() {
    let scene = Scene {
        saturation: Some(Saturation {
            full_well: 1000.0,
            blooming: 0.0,
        }),
        ..evenly_lit(0.0)
    };
    let lit = |counts| Scene {
        ambient: evenly_lit(counts).ambient,
        black_level: Some(BlackLevel::steady(200.0)),
        ..scene.clone()
    };
    // The well limits light, and black level comes on top of it.
    assert_eq!(rows(lit(999.0), 1), [1199.0; 4096]);
    assert_eq!(rows(lit(5000.0), 1), [1200.0; 4096]);
}

/// One pixel holds several and a half wells, and its neighbours are empty. Half of the excess goes to either
/// side, and fills one well in each pixel.
#[test]
fn excess_charge_fills_the_neighbours() {
    let saturation = Saturation {
        full_well: 100.0,
        blooming: 1.0,
    };
    let mut light = vec![0.0; 41];
    light[20] = 100.0 + 2.0 * 430.0;
    saturation.apply(&mut light);
    let mut expected = vec![0.0; 41];
    expected[16..=24].fill(100.0);
    (expected[15], expected[25]) = (30.0, 30.0);
    assert_eq!(light, expected);

    // A drain that takes three quarters leaves a quarter.
    let mut light = vec![0.0; 41];
    light[20] = 100.0 + 2.0 * 430.0;
    Saturation {
        blooming: 0.25,
        ..saturation
    }
    .apply(&mut light);
    expected.fill(0.0);
    expected[19..=21].fill(100.0);
    (expected[18], expected[22]) = (7.5, 7.5);
    assert_eq!(light, expected);

    // What has nowhere to go leaves over the end: half of it here.
    let mut light = vec![100.0; 41];
    light[5] = 900.0;
    light[30..].fill(0.0);
    saturation.apply(&mut light);
    expected.fill(100.0);
    expected[34..].fill(0.0);
    assert_eq!(light, expected);
}

/// A gaussian spot five times as high as a well. The total charge stays, and the charge above the well fills
/// the flanks, so the top is flat. The half-length h of the top solves h = (integral of the spot from 0 to h)
/// / well, to a pixel.
#[test]
fn a_bloomed_spot_has_a_flat_top() {
    let (full, width, height) = (1000.0, 12.0, 5000.0);
    let mut light = vec![0.0f32; 801];
    Spot {
        width,
        counts_per_second: 0.0,
    }
    .add(&mut light, 400.0, height);
    let sum = |light: &[f32]| light.iter().map(|&x| f64::from(x)).sum::<f64>();
    let before = light.clone();
    let saturation = Saturation {
        full_well: full,
        blooming: 1.0,
    };
    saturation.apply(&mut light);
    println!(
        "{:.3} counts before, {:.3} after",
        sum(&before),
        sum(&light)
    );
    assert!((sum(&light) / sum(&before) - 1.0).abs() < 1e-6);

    let gathered = |h: f64| {
        let root = std::f64::consts::SQRT_2 * width;
        height * width * (0.5 * std::f64::consts::PI).sqrt() * libm::erf(h / root)
    };
    let (mut low, mut high) = (width, 100.0 * width);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if gathered(middle) > full * middle {
            low = middle;
        } else {
            high = middle;
        }
    }
    let top = light
        .iter()
        .filter(|&&x| f64::from(x) > 0.999 * full)
        .count() as f64;
    println!("a top of {top} pixels, {:.1} expected", 2.0 * low);
    assert!((top - 2.0 * low).abs() <= 2.0);
    // Beyond the top and the one pixel that is partly filled nothing has changed.
    let end = 400 + (low + 2.0) as usize;
    assert_eq!(light[end..], before[end..]);
}

/// For any row, the total charge stays, no pixel exceeds its well, and the mirrored row gives the mirrored
/// result.
#[test]
fn blooming_favours_no_side() {
    let saturation = Saturation {
        full_well: 100.0,
        blooming: 1.0,
    };
    for seed in 0..200 {
        let mut random = random::of_row(seed, Effect::Saturation, 0);
        let mut light = vec![0.0; 3000];
        for (light, normal) in light[1000..2000]
            .iter_mut()
            .zip(random::normals_of(&mut random, 1000))
        {
            *light = (30.0 + 80.0 * normal).max(0.0);
        }
        let sum = |light: &[f32]| light.iter().map(|&x| f64::from(x)).sum::<f64>();
        let before = sum(&light);
        let mut mirrored: Vec<f32> = light.iter().rev().copied().collect();
        saturation.apply(&mut light);
        saturation.apply(&mut mirrored);
        mirrored.reverse();
        assert_eq!(light, mirrored);
        assert!(light.iter().all(|&x| (0.0..=100.001).contains(&x)));
        assert!((sum(&light) / before - 1.0).abs() < 1e-6);
    }
}

/// All outputs have the drift. It rises with time: from row to row of a line sensor, from frame to frame of a
/// camera.
#[test]
fn the_black_level_drifts() {
    for sensor in [Sensor::Tcd1304dg, Sensor::Camera] {
        let scene = Scene {
            black_level: Some(BlackLevel {
                counts: 240.0,
                drift: 3.0,
            }),
            ..Scene::dark(sensor)
        };
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
    let scene = |slope| Scene {
        ambient: Some(Ambient {
            counts_per_second: 2000.0,
            slope,
        }),
        ..Scene::dark(Sensor::Tcd1304dg)
    };
    let light = scene(0.5).sensor.geometry().light;
    for (i, &count) in scene(0.5).row(0, 0.8, 0.25)[light.clone()]
        .iter()
        .enumerate()
    {
        // Exact in single precision.
        assert_eq!(count, 0.25 * (2000.0 + 0.5 * (i as f32 - 1823.5)));
    }
    let row = scene(2.0).row(0, 0.8, 0.25);
    let dark = row[light.clone()].iter().filter(|&&x| x == 0.0).count();
    // The slope crosses zero 1000 pixels from the middle.
    assert_eq!(dark, 824);
    assert!(row[..light.start].iter().all(|&x| x == 0.0));
    assert!(row[light.end..].iter().all(|&x| x == 0.0));
}

/// If the noise is wider than a step, rounding adds a variance of step^2 / 12 and no mean.
#[test]
fn rounding_adds_a_variance_of_a_twelfth_of_the_squared_step() {
    let before = Scene {
        black_level: Some(BlackLevel::steady(300.3)),
        read_noise: Some(ReadNoise { counts: 20.0 }),
        ..Scene::dark(Sensor::Row(4096))
    };
    let step = 16.0;
    let after = Scene {
        quantisation: Some(Quantisation { step }),
        ..before.clone()
    };
    let (before, after) = (rows(before, 100), rows(after, 100));
    assert!(after.iter().all(|x| x % 16.0 == 0.0));
    let error: Vec<f32> = after.iter().zip(&before).map(|(a, b)| a - b).collect();
    let n = error.len() as f64;
    let [mean, variance, ..] = moments(&error);
    println!(
        "{mean:.4}, {variance:.3}, {:.3} expected",
        step * step / 12.0
    );
    // An even distribution's kurtosis is 9/5: a standard error of the variance of sqrt(4/5 / n).
    assert!((variance / (step * step / 12.0) - 1.0).abs() < 5.0 * (0.8 / n).sqrt());
    assert!(mean.abs() < 5.0 * (variance / n).sqrt());
    let more = moments(&after)[1] - moments(&before)[1];
    println!("{more:.2} more in the row's variance");
    assert!((more - step * step / 12.0).abs() < 5.0 * 400.0 * (2.0 / n).sqrt());
}

#[test]
fn counts_round_half_up_and_clip_at_both_ends() {
    let mut counts = [-9.0, -8.0, -7.9, 0.0, 7.9, 8.0, 23.9, 4087.9, 4088.0, 1e9];
    Quantisation { step: 16.0 }.apply(&mut counts, 4095);
    // 8 bits: 256 codes, of which the last is 255 steps.
    assert_eq!(
        counts,
        [
            -16.0, -16.0, 0.0, 0.0, 0.0, 16.0, 16.0, 4080.0, 4080.0, 4080.0
        ]
    );
    let counts = [-3.0, 0.4, 0.5, 7.49, 4094.5, 4095.4, 1e9, f32::NAN];
    assert_eq!(quantise(&counts, 4095), [0, 0, 1, 7, 4095, 4095, 4095, 0]);
}

/// Exposures do not overlap: if the exposure is longer than the sensor's period, rows come at the period of
/// the exposure.
#[test]
fn a_row_takes_as_long_as_its_exposure() {
    for (exposure, period) in [(0.005, 1.0 / 175.4), (0.02, 0.02)] {
        let simulation = Simulation::new(Scene {
            exposure,
            motion: Some(Motion { speed: 0.1 }),
            ..Scene::dark(Sensor::Tcd1304dg)
        });
        let moved = simulation.true_distance(10, 0.8) - 0.8;
        println!("{moved} m in ten rows of {exposure} s");
        assert!((moved - 10.0 * 0.1 * period).abs() < 1e-12);
    }
}

/// One lit pixel gives to the samples 1 - a, a (1 - b), a (1 - b) b ... of its light. Of a step, a is left at
/// the hold and b at the end of the pixel. A spot moves by a / (1 - b) pixels and keeps its light.
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

        let scene = Scene {
            settling: Some(settling),
            ..plain_spot()
        };
        let [before, after] = [plain_spot(), scene].map(|scene| {
            let row = scene.row(0, 0.8, 0.005);
            let sum: f64 = row.iter().map(|&light| f64::from(light)).sum();
            let products = (0..).zip(&row).map(|(i, &x)| f64::from(i) * f64::from(x));
            (sum, products.sum::<f64>() / sum)
        });
        let (moved, expected) = (after.1 - before.1, a / (1.0 - b));
        println!("{time_constant:.1e} s: {moved:.6} pixels, {expected:.6} expected");
        assert!((moved - expected).abs() < 1e-5);
        assert!((settling.shift() - expected).abs() < 1e-9);
        assert!((after.0 / before.0 - 1.0).abs() < 1e-6);
    }
}

/// Black level and light of a settled row are not changed: the first output has no step before it.
#[test]
fn an_even_row_has_settled() {
    let mut counts = [300.0; 100];
    let time_constant = 1e-6;
    Settling { time_constant }.apply(&mut counts);
    assert_eq!(counts, [300.0; 100]);
}

/// Light of 400 counts, amplified by 0.75, above a black level of 300 and an offset of 20 counts. The rail
/// does not depend on the offset. The full well is in electrons, before the gain; read noise comes after the
/// rail.
#[test]
fn the_front_end_amplifies_light_shifts_it_and_clips() {
    let through = |gain, saturation| Scene {
        black_level: Some(BlackLevel::steady(300.0)),
        front_end: Some(FrontEnd {
            gain,
            offset: 20.0,
            saturation,
        }),
        ..evenly_lit(400.0)
    };
    assert_eq!(rows(through(0.75, None), 1), [620.0; 4096]);
    assert_eq!(rows(through(0.75, Some(621.0)), 1), [620.0; 4096]);
    assert_eq!(rows(through(0.75, Some(550.0)), 1), [550.0; 4096]);
    let full = Scene {
        saturation: Some(Saturation {
            full_well: 200.0,
            blooming: 0.0,
        }),
        ..through(1.5, None)
    };
    assert_eq!(rows(full, 1), [620.0; 4096]);

    let noisy = Scene {
        read_noise: Some(ReadNoise { counts: 4.0 }),
        ..through(0.75, Some(550.0))
    };
    let noise = rows(noisy, 25);
    let [mean, variance, ..] = moments(&noise);
    let n = noise.len() as f64;
    println!("{mean:.4} counts, variance {variance:.3} at the rail");
    assert!((mean - 550.0).abs() < 5.0 * 4.0 / n.sqrt());
    assert!((variance / 16.0 - 1.0).abs() < 5.0 * (2.0 / n).sqrt());
}

/// A count of the converter stands for `electrons_per_count` / gain electrons: the variance of shot noise is
/// that share of the counts. The core gets the nominal gain.
#[test]
fn the_gain_amplifies_shot_noise_and_the_core_does_not_know_it() {
    for gain in [0.5, 1.0, 1.6] {
        let nominal = Scene {
            shot_noise: Some(ShotNoise {
                electrons_per_count: 10.0,
            }),
            ..evenly_lit(1000.0)
        };
        let scene = Scene {
            front_end: Some(FrontEnd {
                gain,
                offset: 0.0,
                saturation: None,
            }),
            ..nominal.clone()
        };
        assert_eq!(scene.geometry(), nominal.geometry());
        let light = rows(scene, 100);
        let n = light.len() as f64;
        let [mean, variance, ..] = moments(&light);
        let ratio = variance / mean;
        println!("gain {gain}: {mean:.3} counts, variance over mean {ratio:.5}");
        assert!((mean - 1000.0 * gain).abs() < 5.0 * (variance / n).sqrt());
        assert!((ratio / (gain / 10.0) - 1.0).abs() < 5.0 * (2.0 / n).sqrt());
    }
}

/// What a TCD1304 keeps: 100 counts are 1000 electrons.
const LAG: Lag = Lag {
    counts: 100.0,
    share: 1.0,
};

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
    let lit = Scene {
        lag: Some(LAG),
        ..plain_spot()
    };
    let light = plain_spot().row(0, 0.8, 0.005);
    assert_eq!(lit.row(5, 0.8, 0.005), light);

    let of = |laser, laser_before| {
        let row = 0.005;
        lit.row(
            0,
            0.8,
            Exposure {
                row,
                laser,
                laser_before,
            },
        )
    };
    let (pulse, after) = (of(0.005, 0.0), of(0.0, 0.005));
    let mut highest = 0.0f32;
    for (i, &light) in light.iter().enumerate() {
        let q = f64::from(light);
        assert!((f64::from(after[i]) - q * 100.0 / (100.0 + q)).abs() < 1e-4);
        assert!((pulse[i] + after[i] - light).abs() < 2e-4);
        highest = highest.max(after[i]);
    }
    println!("a ghost of {highest:.2} counts after a spot of 1750");
    assert!((f64::from(highest) - 1750.0 * 100.0 / 1850.0).abs() < 0.01);

    // A full pixel leaves what its well holds, however much light there was.
    let full = Scene {
        saturation: Some(Saturation {
            full_well: 1000.0,
            blooming: 0.0,
        }),
        ..lit
    };
    let off = Exposure {
        laser: 0.0,
        ..0.005.into()
    };
    let highest = full.row(0, 0.8, off).into_iter().fold(0.0, f32::max);
    println!("{highest:.3} counts after a full well of 1000");
    assert!((f64::from(highest) - 1000.0 * 100.0 / 1100.0).abs() < 1e-3);
}

/// The ghost of a moving target is where the spot was in the row before.
#[test]
fn lag_draws_a_ghost_behind_a_moving_target() {
    let moving = Scene {
        motion: Some(Motion { speed: 2.0 }),
        ..plain_spot()
    };
    let lagging = Scene {
        lag: Some(LAG),
        ..moving.clone()
    };
    let (now, before) = (moving.row(7, 0.7, 0.005), moving.row(6, 0.7, 0.005));
    let row = lagging.row(7, 0.7, 0.005);
    let mut worst = 0.0f64;
    for (i, &light) in row.iter().enumerate() {
        let [q, r] = [now[i], before[i]].map(f64::from);
        let expected = q - q * 100.0 / (100.0 + q) + r * 100.0 / (100.0 + r);
        worst = worst.max((f64::from(light) - expected).abs());
    }
    let place = |row: &[f32]| (0..row.len()).max_by(|&a, &b| row[a].total_cmp(&row[b]));
    let (now, before) = (
        place(&now).expect("pixels"),
        place(&before).expect("pixels"),
    );
    println!("spot at {now}, ghost at {before}; off by {worst:.1e} counts at most");
    assert!(worst < 2e-3 && before > now + 20);
}

/// Lamps of 100 Hz and 120 Hz, compared with Simpson's rule over each row's exposure. An exposure of a whole
/// number of their periods does not see them flicker.
#[test]
fn lamps_flicker_from_row_to_row() {
    let lamps = |frequency, phase| MainsLight {
        counts_per_second: 40_000.0,
        slope: 0.0,
        modulation: 0.6,
        frequency,
        phase,
    };
    let scene = |lamps| Scene {
        mains_light: Some(lamps),
        ..Scene::dark(Sensor::Row(16))
    };
    for frequency in [100.0, 120.0] {
        let simulation = Simulation::new(scene(lamps(frequency, Some(0.3))));
        let (exposure, mut range) = (0.004, (f64::MAX, 0.0f64));
        for row in 0..40 {
            let counts = simulation.row(row, 0.8, exposure);
            assert!(counts.iter().all(|&count| count == counts[0]));
            let start = row as f64 / 175.4 - exposure / 2.0;
            let brightness = |step: u32| {
                let time = start + exposure * f64::from(step) / 200.0;
                let weight = match step {
                    0 | 200 => 1.0,
                    _ => f64::from(2 + 2 * (step % 2)),
                };
                let turns = frequency * time;
                weight * (1.0 + 0.6 * (std::f64::consts::TAU * turns + 0.3).cos())
            };
            let sum: f64 = (0..=200).map(brightness).sum();
            let expected = 40_000.0 * sum * exposure / 600.0;
            assert!((f64::from(counts[0]) - expected).abs() < 1e-3, "row {row}");
            range = (range.0.min(expected), range.1.max(expected));
        }
        println!("{frequency} Hz: {:.1} to {:.1} counts", range.0, range.1);
        assert!(range.1 - range.0 > 100.0);

        let simulation = Simulation::new(scene(lamps(frequency, None)));
        for row in 0..40 {
            let counts = simulation.row(row, 0.8, 2.0 / frequency);
            assert!((f64::from(counts[0]) - 80_000.0 / frequency).abs() < 1e-3);
        }
    }

    // Lamps to one side: a row of 16 whose pixels differ by a hundredth of the middle's light.
    let sloped = MainsLight {
        slope: 400.0,
        ..lamps(100.0, None)
    };
    let light = Simulation::new(scene(sloped)).row(3, 0.8, 4e-3);
    let even = Simulation::new(scene(lamps(100.0, None))).row(3, 0.8, 4e-3);
    for (pixel, (&light, &even)) in light.iter().zip(&even).enumerate() {
        let expected = 1.0 + 0.01 * (pixel as f64 - 7.5);
        assert!((f64::from(light) / f64::from(even) - expected).abs() < 1e-6);
    }

    // A drawn phase is even over a turn: of 4000, mean cosine and sine have a variance of 1/2 over 4000.
    let phases = || (0..4000).map(|seed| lamps(100.0, None).phase(seed));
    let means = [f64::cos, f64::sin].map(|it| phases().map(it).sum::<f64>() / 4000.0);
    println!("mean cosine and sine of drawn phases {means:.4?}");
    assert!(
        means
            .iter()
            .all(|mean| mean.abs() < 5.0 * (0.5 / 4000f64).sqrt())
    );
}

/// The light of lamps has shot noise as other light has.
#[test]
fn the_light_of_lamps_has_shot_noise() {
    let lamps = Scene {
        mains_light: Some(MainsLight {
            counts_per_second: 500.0,
            slope: 0.0,
            modulation: 1.0,
            frequency: 100.0,
            phase: None,
        }),
        shot_noise: Some(ShotNoise {
            electrons_per_count: 10.0,
        }),
        ..Scene::dark(Sensor::Row(4096))
    };
    // A second is a whole number of periods.
    let light = rows(lamps, 50);
    let [mean, variance, ..] = moments(&light);
    let n = light.len() as f64;
    println!("{mean:.4} counts, variance {variance:.3}, 50 expected");
    assert!((mean - 500.0).abs() < 5.0 * (50.0 / n).sqrt());
    assert!((variance / 50.0 - 1.0).abs() < 5.0 * (2.0 / n).sqrt());
}

/// The laser shines for 2 ms of a row of 5 ms. The row has the laser's light of 2 ms, and ambient light and
/// dark current of 5 ms. A row without a pulse is that of a scene without a laser, bit for bit, with noise.
#[test]
fn ambient_light_and_dark_current_do_not_depend_on_the_laser() {
    let collected = [Effect::Ambient, Effect::MainsLight, Effect::HotPixels];
    let scene = collected.into_iter().fold(plain_spot(), listing);
    let dark = Scene {
        spot: None,
        ..scene.clone()
    };
    let pulsed = Exposure {
        row: 0.005,
        laser: 0.002,
        laser_before: 0.0,
    };
    let of = |scene: &Scene, exposure: Exposure| scene.row(3, 0.8, exposure);
    let (spot, rest) = (plain_spot().row(3, 0.8, 0.002), dark.row(3, 0.8, 0.005));
    let sum = spot.iter().zip(&rest).map(|(a, b)| a + b);
    let worst = (sum.zip(of(&scene, pulsed))).map(|(a, b)| (a - b).abs());
    let worst = worst.fold(0.0, f32::max);
    println!("off by {worst:.1e} counts at most");
    // The last bit of numbers up to 1024.
    assert!(worst <= 1.3e-4);

    let off = Exposure {
        laser: 0.0,
        ..pulsed
    };
    let noisy = |scene: Scene| {
        let noises = [Effect::ShotNoise, Effect::ReadNoise];
        noises.into_iter().fold(scene, listing)
    };
    assert_eq!(of(&noisy(scene), off), of(&noisy(dark), pulsed));
}

// ---- Random numbers ----

/// Every effect, as a scene's file lists it.
const EVERY_EFFECT: &str = r#"
diffraction = "fresnel"
laser_spot = { waist = 0.42e-3, waist_distance = 0.81, wander = 0.0 }
obliquity = {}
speckle = { polarisations = 2, linewidth = 1e-9, path_spread = 0.0 }
texture = { contrast = 0.2, length = 0.5e-3 }
specular_lobe = { strength = 1.0, width = 0.3, tilt = 0.0 }
reflectivity = { darkest = 0.1, steps = 2, seconds = 0.02 }
defocus = { focus_distance = 0.7 }
coma = { waves = 1.0, field = 5e-3 }
distortion = { share = 0.01, field = 5e-3 }
flare = { magnification = 1.0, width = 20.0, strength = 0.01, veil = 0.001 }
second_reflection = { offset = 50.0, width = 8.0, strength = 0.1 }
ambient = { counts_per_second = 20_000.0, slope = 3.0 }
mains_light = { counts_per_second = 10_000.0, modulation = 0.5, frequency = 100.0 }
motion = { speed = 0.5 }
temperature = { kelvin_per_second = 100.0, expansion = 23e-6 }
response = { deviation = 0.02 }
lag = { counts = 100.0, share = 0.5 }
shot_noise = { electrons_per_count = 10.0 }
saturation = { full_well = 1000.0, blooming = 0.5 }
black_level = { counts = 300.0, drift = 10.0 }
fixed_pattern = { counts = 3.0 }
hot_pixels = { share = 0.01, counts_per_second = 30_000.0 }
settling = { time_constant = 0.4e-6 }
front_end = { gain = 0.8, offset = 20.0, saturation = 900.0 }
read_noise = { counts = 4.0 }
quantisation = { step = 4.0 }
"#;

/// A scene that lists an effect besides what it lists.
fn listing(scene: Scene, effect: Effect) -> Scene {
    let lens = spot_behind_a_lens().to_toml().expect("text");
    let every = Scene::from_toml(&format!("{EVERY_EFFECT}{lens}")).expect("a scene");
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
    for seed in [1, 2] {
        for effect in Effect::ALL {
            for number in [0, 1, 2, 1 << 40] {
                first.push(random::words(&mut random::of_row(seed, effect, number)));
                first.push(random::words(&mut random::of_line(seed, effect, number)));
            }
        }
    }
    let streams = first.len();
    first.sort();
    first.dedup();
    assert_eq!(first.len(), streams);

    let response = Response { deviation: 0.01 }.factors(1, 0, 3648);
    let pattern = FixedPattern { counts: 0.01 }.offsets(1, 0, 3648);
    let mut noise = vec![0.0; 3648];
    ReadNoise { counts: 0.01 }.apply(&mut noise, &mut random::of_row(1, Effect::ReadNoise, 0));
    let response: Vec<f32> = response.iter().map(|factor| factor - 1.0).collect();
    for (a, b) in [
        (&response, &pattern),
        (&pattern, &noise),
        (&noise, &response),
    ] {
        let products = a.iter().zip(b).map(|(a, b)| f64::from(a * b));
        let correlation = products.sum::<f64>() / (3648.0 * 0.01 * 0.01);
        println!("correlation {correlation:.4}");
        assert!(correlation.abs() < 5.0 / 3648f64.sqrt());
    }
}

/// White paper's spot, and nothing else.
fn plain_spot() -> Scene {
    Scene {
        spot: Scene::white_paper().spot,
        ..Scene::dark(Sensor::Tcd1304dg)
    }
}

/// A spot behind a lens, on which every effect can act.
fn spot_behind_a_lens() -> Scene {
    let mut scene = plain_spot();
    scene.optics.aperture = Aperture::PAPER_LENS;
    scene
}

/// A scene's exposure after a row without the laser: with the laser in both, lag would show nothing.
fn after_darkness(scene: &Scene) -> Exposure {
    Exposure {
        laser_before: 0.0,
        ..scene.exposure.into()
    }
}

/// A row, put together by hand: light that is free of noise, and then what the sensor's effects make of it,
/// each with the random numbers that are its own by its name, the seed and the row - and by nothing else that
/// the scene lists.
fn put_together(scene: &Scene, row: u64) -> Vec<f32> {
    let of_the_sensor = [
        Effect::Response,
        Effect::HotPixels,
        Effect::Lag,
        Effect::ShotNoise,
        Effect::Saturation,
        Effect::BlackLevel,
        Effect::FixedPattern,
        Effect::Settling,
        Effect::FrontEnd,
        Effect::ReadNoise,
        Effect::Quantisation,
    ];
    let light_alone = of_the_sensor
        .into_iter()
        .fold(scene.clone(), Scene::without);
    let geometry = scene.sensor.geometry();
    let collected = |row, exposure| {
        let mut counts = light_alone.row(row, scene.distance, exposure);
        let light = &mut counts[geometry.light.clone()];
        if let Some(response) = scene.response {
            let factors = response.factors(scene.seed, 0, light.len());
            light.iter_mut().zip(factors).for_each(|(x, f)| *x *= f);
        }
        if let Some(hot) = scene.hot_pixels {
            for place in hot.places(scene.seed, 0, light.len()) {
                light[place] += (hot.counts_per_second * scene.exposure) as f32;
            }
        }
        counts
    };
    let mut counts = collected(row, after_darkness(scene));
    let light = &mut counts[geometry.light.clone()];
    if let Some(lag) = scene.lag {
        let off = Exposure {
            laser: 0.0,
            ..after_darkness(scene)
        };
        let before = collected(row, off);
        let full_well = scene.saturation.map_or(f64::INFINITY, |it| it.full_well);
        lag.apply(light, &before[geometry.light.clone()], full_well);
    }
    if let Some(noise) = scene.shot_noise {
        let mut random = random::of_row(scene.seed, Effect::ShotNoise, row);
        noise.apply(light, &mut random);
    }
    if let Some(saturation) = scene.saturation {
        saturation.apply(light);
    }
    if let Some(front_end) = scene.front_end {
        front_end.amplify(light);
    }
    if let Some(black) = scene.black_level {
        let level = black.after(row as f64 * scene.sensor.period()) as f32;
        counts.iter_mut().for_each(|x| *x += level);
    }
    if let Some(pattern) = scene.fixed_pattern {
        let offsets = pattern.offsets(scene.seed, 0, counts.len());
        counts.iter_mut().zip(offsets).for_each(|(x, o)| *x += o);
    }
    if let Some(settling) = scene.settling {
        settling.apply(&mut counts);
    }
    if let Some(front_end) = scene.front_end {
        front_end.shift_and_clip(&mut counts);
    }
    if let Some(noise) = scene.read_noise {
        let mut random = random::of_row(scene.seed, Effect::ReadNoise, row);
        noise.apply(&mut counts, &mut random);
    }
    if let Some(quantisation) = scene.quantisation {
        quantisation.apply(&mut counts, scene.sensor.geometry().full_scale());
    }
    counts
}

/// Adding an effect to a scene with all kinds of noise, or removing an effect, changes no bit of the other
/// effects.
#[test]
fn no_effect_changes_the_random_numbers_of_another() {
    let noises = [
        Effect::Response,
        Effect::ShotNoise,
        Effect::FixedPattern,
        Effect::HotPixels,
        Effect::ReadNoise,
    ];
    let noisy = noises.into_iter().fold(spot_behind_a_lens(), listing);
    for effect in Effect::ALL {
        let (without, with) = (
            noisy.clone().without(effect),
            listing(noisy.clone(), effect),
        );
        assert!(with.lists(effect) && !without.lists(effect));
        let mut changed = false;
        for row in [0, 5] {
            let of = |scene: &Scene| scene.row(row, scene.distance, after_darkness(scene));
            assert_eq!(of(&without), put_together(&without, row), "no {effect:?}");
            assert_eq!(of(&with), put_together(&with, row), "{effect:?}");
            changed |= of(&with) != of(&without);
        }
        // The scene is one in which the effect does something.
        assert!(changed, "{effect:?}");
    }
}

/// A scene that lists an effect whose parameters make it do nothing; `None` where there are none such.
fn listing_in_vain(scene: Scene, effect: Effect) -> Option<Scene> {
    let mut scene = listing(scene, effect);
    match effect {
        Effect::Diffraction
        | Effect::LaserSpot
        | Effect::Obliquity
        | Effect::Speckle
        | Effect::Defocus
        | Effect::ShotNoise
        | Effect::Quantisation => return None,
        Effect::Texture => scene.texture.as_mut()?.contrast = 0.0,
        Effect::SpecularLobe => scene.specular_lobe.as_mut()?.strength = 0.0,
        Effect::Reflectivity => scene.reflectivity.as_mut()?.darkest = 1.0,
        Effect::Coma => scene.coma.as_mut()?.waves = 0.0,
        Effect::Distortion => scene.distortion.as_mut()?.share = 0.0,
        Effect::Flare => {
            let flare = scene.flare.as_mut()?;
            (flare.strength, flare.veil) = (0.0, 0.0);
        }
        Effect::SecondReflection => scene.second_reflection.as_mut()?.strength = 0.0,
        Effect::Ambient => scene.ambient = evenly_lit(0.0).ambient,
        Effect::MainsLight => scene.mains_light.as_mut()?.counts_per_second = 0.0,
        Effect::Motion => scene.motion = Some(Motion { speed: 0.0 }),
        Effect::Temperature => scene.temperature.as_mut()?.expansion = 0.0,
        Effect::Response => scene.response = Some(Response { deviation: 0.0 }),
        Effect::Lag => scene.lag.as_mut()?.share = 0.0,
        Effect::Saturation => scene.saturation.as_mut()?.full_well = 1e9,
        Effect::BlackLevel => scene.black_level = Some(BlackLevel::steady(0.0)),
        Effect::FixedPattern => scene.fixed_pattern = Some(FixedPattern { counts: 0.0 }),
        Effect::HotPixels => scene.hot_pixels.as_mut()?.share = 0.0,
        // So short that nothing of a step is left.
        Effect::Settling => scene.settling.as_mut()?.time_constant = 1e-9,
        Effect::FrontEnd => {
            let (gain, offset, saturation) = (1.0, 0.0, None);
            scene.front_end = Some(FrontEnd {
                gain,
                offset,
                saturation,
            });
        }
        Effect::ReadNoise => scene.read_noise = Some(ReadNoise { counts: 0.0 }),
    }
    Some(scene)
}

/// If the parameters of a listed effect are zero, the effect changes no bit of a row with all other effects,
/// whether it draws random numbers or not.
#[test]
fn an_effect_that_does_nothing_changes_nothing() {
    let mut effects = 0;
    for effect in Effect::ALL {
        let others = Effect::ALL.into_iter().filter(|&other| other != effect);
        let without = others.fold(spot_behind_a_lens(), listing).without(effect);
        if let Some(with) = listing_in_vain(without.clone(), effect) {
            let of = |scene: &Scene| scene.row(3, scene.distance, after_darkness(scene));
            assert_eq!(of(&with), of(&without), "{effect:?}");
            effects += 1;
        }
    }
    println!("{effects} effects");
    assert_eq!(effects, 20);
}

/// Counts of some rows, as the converter gives them.
fn counts(simulation: &Simulation, row: u64) -> Vec<u16> {
    let scene = simulation.scene();
    let full_scale = scene.geometry().full_scale();
    quantise(
        &simulation.row(row, scene.distance, scene.exposure),
        full_scale,
    )
}

/// Six rows of a scene to look at: of a camera those in the middle, which see a round spot too.
fn first_rows(scene: &Scene) -> std::ops::Range<u64> {
    let lines = scene.sensor.rows();
    if lines == 1 {
        return 0..6;
    }
    lines / 2 - 3..lines / 2 + 3
}

/// Computes the rows in one thread, in two, and backwards.
#[test]
fn rows_do_not_depend_on_threads_or_order() {
    for name in [
        "old-sensor",
        "moving-target",
        "brushed-metal",
        "paper-on-camera",
    ] {
        let scene = Scene::load(name).expect("a scene");
        let rows = first_rows(&scene);
        let simulation = Simulation::new(scene.clone());
        let one_by_one: Vec<_> = rows.clone().map(|row| counts(&simulation, row)).collect();
        for threads in [1, 2] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
            let pool = pool.build().expect("threads");
            let simulation = Simulation::new(scene.clone());
            let made: Vec<_> = pool.install(|| {
                let rows = rows.clone().into_par_iter();
                rows.map(|row| counts(&simulation, row)).collect()
            });
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
    for name in [
        "quiet-paper",
        "sunlit",
        "saturated",
        "old-sensor",
        "moving-target",
        "warming-up",
        "rusty-metal",
        "paper-on-camera",
        "lens",
        "comb",
    ] {
        let scene = Scene::load(name).expect("a scene");
        let rows = first_rows(&scene);
        let simulation = Simulation::new(scene);
        let mut hash = 0xcbf2_9ce4_8422_2325u64;
        for byte in rows
            .flat_map(|row| counts(&simulation, row))
            .flat_map(u16::to_le_bytes)
        {
            hash = (hash ^ u64::from(byte)).wrapping_mul(0x100_0000_01b3);
        }
        table += &format!("{name:<18} {hash:016x}\n");
    }
    print!("{table}");
    insta::assert_snapshot!("scenes", table);
}

// ---- Scenes ----

#[test]
fn scenes_are_read_and_written() {
    let names = file::names().expect("the folder of scenes");
    println!("{}", names.join(", "));
    assert!(names.len() >= 12);
    for name in names {
        let scene = Scene::load(&name).expect("a scene");
        let text = scene.to_toml().expect("text");
        assert_eq!(Scene::from_toml(&text).expect("a scene"), scene, "{name}");
        assert!(
            scene.about.ends_with('.') && !scene.about.contains('\n'),
            "{name}: {:?} is no sentence",
            scene.about
        );
    }
    let quiet = Scene::load("quiet-paper").expect("a scene");
    let white = Scene {
        about: quiet.about.clone(),
        ..Scene::white_paper()
    };
    assert_eq!(quiet, white);
}

/// Each file says first what the scene shows, and gives the reason for each effect.
#[test]
fn scenes_give_a_reason_for_each_effect() {
    for name in file::names().expect("the folder of scenes") {
        let text = std::fs::read_to_string(file::folder().join(format!("{name}.toml")));
        let text = text.expect("a file");
        assert!(text.starts_with("# "), "{name}");
        let lines: Vec<&str> = text.lines().collect();
        let mut effects = 0;
        for (i, line) in lines.iter().enumerate() {
            if line.starts_with('[') {
                assert!(lines[i - 1].starts_with("# "), "{name}: {line}");
                effects += 1;
            }
        }
        assert!(effects >= 4, "{name}");
    }
}

fn centre(simulation: &Simulation, row: u64) -> Result<RowCentre, Fault> {
    let (counts, geometry) = (counts(simulation, row), simulation.scene().geometry());
    let shielded = &counts[geometry.shielded.clone()];
    let row = Row::new(
        &counts[geometry.light.clone()],
        shielded,
        geometry.full_scale(),
    );
    let row = row.expect("12 bits");
    let (spot, budget) = spot::find(&row)?;
    let estimator = Estimator::default();
    centre_of_spot(estimator, &row, &spot, None, &geometry, None, budget)
}

/// In the rows of each scene, the core finds the spot within a width of its true place, and the check lets it
/// pass; or the core gives the fault that the file names.
#[test]
fn scenes_give_a_centre_or_the_fault_that_their_file_names() {
    for name in file::names().expect("the folder of scenes") {
        let text = std::fs::read_to_string(file::folder().join(format!("{name}.toml")));
        let text = text.expect("a file");
        let announced = text.lines().find_map(|line| {
            let fault = line.strip_prefix("# Expected fault: ")?;
            fault.strip_suffix('.')
        });
        let scene = Scene::load(&name).expect("a scene");
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

/// Checks the errors that the author of a file reads.
#[test]
fn meaningless_scenes_are_refused() {
    let lens = spot_behind_a_lens().to_toml().expect("text");
    let every = format!("{EVERY_EFFECT}{lens}");
    assert!(Scene::from_toml(&every).is_ok());
    let laser_spot = "laser_spot = { waist = 0.42e-3, waist_distance = 0.81, wander = 0.0 }\n";
    for (from, to, words) in [
        (
            "exposure = 0.005",
            "exposure = 0.0",
            "exposure is 0 s: it must be above 0",
        ),
        (
            "\ndistance = 0.8",
            "\ndistance = nan",
            "distance is NaN m: give it a number",
        ),
        (
            "width = 8.6",
            "width = -8.6",
            "spot.width is -8.6 pixels: it must be above 0",
        ),
        (
            "{ counts = 4.0",
            "{ counts = -1.0",
            "read_noise.counts is -1 counts: it cannot be below 0",
        ),
        ("_count = 10.0", "_count = 0.0", "more than 1 are needed"),
        (
            "blooming = 0.5",
            "blooming = 1.5",
            "saturation.blooming is 1.5: it is a share",
        ),
        (
            "{ share = 0.01, c",
            "{ share = -0.1, c",
            "hot_pixels.share is -0.1: it is a share",
        ),
        (
            "modulation = 0.5",
            "modulation = 1.5",
            "mains_light.modulation is 1.5: it is a share",
        ),
        (
            "frequency = 100.0",
            "frequency = 0.0",
            "mains_light.frequency is 0 Hz: it must be above 0",
        ),
        (
            "frequency = 100.0",
            "phase = nan, frequency = 100.0",
            "mains_light.phase is NaN radians",
        ),
        (
            "{ counts = 100.0, share = 0.5",
            "{ counts = 0.0, share = 0.5",
            "lag.counts is 0 counts: it must be above 0",
        ),
        (
            "100.0, share = 0.5",
            "100.0, share = 1.1",
            "lag.share is 1.1: it is a share",
        ),
        (
            "time_constant = 0.4e-6",
            "time_constant = 0.0",
            "settling.time_constant is 0 s: it must be above 0",
        ),
        (
            "gain = 0.8",
            "gain = 0.0",
            "front_end.gain is 0 times: it must be above 0",
        ),
        (
            "offset = 20.0, saturation = 900.0",
            "saturation = -1.0",
            "front_end.saturation is -1 counts: it must be above 0",
        ),
        ("step = 4.0", "step = 0.0", "quantisation.step is 0 counts"),
        (laser_spot, "", "add [laser_spot]"),
        (
            "polarisations = 2",
            "polarisations = 3",
            "light has 1 (metal, gloss) or 2",
        ),
        (
            "waist = 0.42e-3",
            "waist = 9e-6",
            "laser_spot.waist is 0.000009 m: it must be 0.00001",
        ),
        (
            "length = 0.5e-3",
            "length = 0.9e-6",
            "texture.length is 0.0000009 m",
        ),
        (
            "focal_length = 0.05",
            "focal_length = 0.9e-3",
            "optics.focal_length is 0.0009 m",
        ),
        (
            "diameter = 0.00",
            "diameter = -0.00",
            "optics.aperture.lens.diameter is -0.00",
        ),
        (
            "diameter = 0.004",
            "diameter = 0.005",
            "optics.aperture.lens.diameter is 0.005",
        ),
        ("\"tcd1304dg\"", "\"camera\"", "optics.pitch is 0.000008 m"),
        ("\"tcd1304dg\"", "\"tcd1305\"", "unknown variant `tcd1305`"),
        ("{ counts = 4.0", "{ volume = 3", "unknown field `volume`"),
        ("read_noise", "noise", "unknown field `noise`"),
        ("exposure = 0.005\n", "", "missing field `exposure`"),
    ] {
        let changed = every.replace(from, to);
        assert!(changed != every, "{from}");
        let error = format!("{:#}", Scene::from_toml(&changed).expect_err(words));
        println!("{error}");
        assert!(error.contains(words), "{error:?} lacks {words:?}");
    }

    let refused = |scene: &Scene, words: &str| {
        let error = format!("{:#}", scene.check().expect_err(words));
        println!("{error}");
        assert!(error.contains(words), "{error:?} lacks {words:?}");
    };
    let with = |effect| listing(Scene::white_paper(), effect);
    let mut scene = with(Effect::Speckle);
    scene.optics.aperture = Aperture::Slit {
        width: 200e-6,
        height: 4.3e-3,
    };
    refused(&scene, "optics.aperture.slit.height is 0.0043 m");
    let scene = Scene::dark(Sensor::Row(65_537));
    refused(
        &scene,
        "sensor.row is 65537 pixels: it must be 65536 or fewer",
    );
    for effect in [
        Effect::Defocus,
        Effect::Coma,
        Effect::Distortion,
        Effect::Flare,
    ] {
        let name = format!("[{}] is a lens's", effect.name());
        refused(&with(effect), &name);
    }
    let scene = Scene {
        spot: None,
        ..with(Effect::SecondReflection)
    };
    refused(&scene, "add [spot]");
    let error = format!("{:#}", Scene::load("no-such").expect_err("no scene"));
    println!("{error}");
    assert!(error.contains("no-such.toml; there are black-tape"));
}

/// With speckle, the surface is as large as a beam at 1.5 times the distance of the scene's target. The scene
/// accepts distances up to this limit, and refuses larger ones.
#[test]
fn a_scene_with_speckle_refuses_distances_beyond_its_surface() {
    let scene = Scene::load("speckle-receding").expect("a scene");
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
