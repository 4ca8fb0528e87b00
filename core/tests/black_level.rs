//! What the setting `black` changes: the centroid, its height and the greatest height that can be measured;
//! no bit of any other estimator.

use slitrange::base::units::Counts;
use slitrange::centre::half_width;
use slitrange::row::sensor_heads::tcd1304dg;
use slitrange::{
    BlackLevel, Estimator, Fault, Geometry, Measured, Measurement, Options, Row, spot,
};

/// What a shielded pixel reads, and what a light pixel reads besides it where no spot is.
const DARK: f64 = 200.0;
const AMBIENT: f64 = 300.0;

/// A row's counts: a gaussian spot on ambient light that the shielded pixels do not see, with a dither of
/// three counts for noise.
fn counts(centre: f64, width: f64, height: f64) -> Vec<u16> {
    let head = tcd1304dg();
    let count = |i: usize| {
        let light = if head.light.contains(&i) {
            let u = (i as f64 - head.light.start as f64 - centre) / width;
            AMBIENT + height * (-0.5 * u * u).exp()
        } else {
            0.0
        };
        let dither = (i as u32).wrapping_mul(2_654_435_761) >> 30;
        ((DARK + light).round() as u16 + dither as u16).min(head.full_scale())
    };
    (0..head.words).map(count).collect()
}

/// Measures a frame of one row of these counts.
fn measured_by(
    head: Geometry,
    counts: &[u16],
    estimator: Estimator,
    black_level: BlackLevel,
) -> Result<Measured, Fault> {
    let options = Options {
        rows: 1,
        estimator,
        black_level,
        ..Options::default()
    };
    let mut words: Vec<u16> = counts.iter().map(|count| 4095 - count).collect();
    let frame = Measurement::new(head, options).row(&mut words);
    frame.expect("a frame of one row is complete")
}

fn measured(counts: &[u16], estimator: Estimator, how: BlackLevel) -> Result<Measured, Fault> {
    measured_by(tcd1304dg(), counts, estimator, how)
}

/// All ways to find the black level, and what each gives in f64 for a row whose spot is narrower than 10
/// pixels.
fn black_levels(counts: &[u16], centre: f64) -> Vec<(BlackLevel, f64)> {
    let head = tcd1304dg();
    let mean = |pixels: &[u16]| {
        let sum: f64 = pixels.iter().map(|&count| f64::from(count)).sum();
        sum / pixels.len() as f64
    };
    let shielded = mean(&counts[head.shielded]);
    let light = counts[head.light].iter().enumerate();
    let is_far = |i: usize| (i as f64 - centre).abs() > 64.0;
    let unlit: Vec<u16> = light.filter(|(i, _)| is_far(*i)).map(|it| *it.1).collect();
    let unlit = mean(&unlit);
    let mut all = vec![(BlackLevel::Shielded, shielded), (BlackLevel::Frame, unlit)];
    for level in [0, 200, 450, 900] {
        all.push((BlackLevel::Fixed(Counts::from_int(level)), f64::from(level)));
    }
    all
}

/// Eq. (2) in f64: the place where the counts above the level, in a window of three widths to either side,
/// have their centroid. And the light above the background in that window over that of a gaussian of height
/// 1.
fn reference(light: &[u16], level: f64, background: f64, width: f64, start: f64) -> (f64, f64) {
    let half_window = 3.0 * width;
    let weight = |i: usize, at: f64| (half_window + 0.5 - (i as f64 - at).abs()).clamp(0.0, 1.0);
    let moment = |at: f64| -> f64 {
        let of = |(i, count): (usize, &u16)| {
            weight(i, at) * (i as f64 - at) * (f64::from(*count) - level)
        };
        light.iter().enumerate().map(of).sum()
    };
    // It falls from the left to the right of the spot.
    let (mut left, mut right) = (start - 0.5 * width, start + 0.5 * width);
    assert!(moment(left) > 0.0 && moment(right) < 0.0);
    for _ in 0..60 {
        let middle = 0.5 * (left + right);
        if moment(middle) > 0.0 {
            left = middle;
        } else {
            right = middle;
        }
    }
    let of = |(i, count): (usize, &u16)| weight(i, left) * (f64::from(*count) - background);
    let gathered: f64 = light.iter().enumerate().map(of).sum();
    (left, gathered / (2.4999 * width))
}

#[test]
fn the_black_level_changes_no_bit_of_the_fits() {
    for (centre, width, height) in [
        (1800.3, 1.3, 1500.0),
        (1800.3, 9.0, 2000.0),
        (900.8, 40.0, 300.0),
    ] {
        let counts = counts(centre, width, height);
        for estimator in Estimator::ALL {
            if estimator == Estimator::Centroid {
                continue;
            }
            let first = measured(&counts, estimator, BlackLevel::Shielded).expect("a centre");
            for (black_level, _) in black_levels(&counts, centre) {
                let found = measured(&counts, estimator, black_level).expect("a centre");
                assert_eq!(found.frame, first.frame, "{estimator:?} {black_level:?}");
            }
        }
    }
}

#[test]
fn the_centroid_and_its_height_follow_the_black_level() {
    let head = tcd1304dg();
    let (mut most_apart, mut worst) = (0.0f64, 0.0f64);
    for step in 0..20 {
        let (true_centre, width, height) = (1800.0 + 0.05 * f64::from(step), 1.3, 1500.0);
        let counts = counts(true_centre, width, height);
        let light = &counts[head.light.clone()];
        let row = Row::new(light, &[], head.saturated_from()).expect("12 bits");
        let (spot, _) = spot::find(&row).expect("a spot");
        let width = half_width::width(light.into(), &spot, None)
            .expect("a width")
            .to_f64();
        let background = spot.background.level.to_f64();
        let (mut lowest, mut highest) = (f64::MAX, f64::MIN);
        for (black_level, level) in black_levels(&counts, true_centre) {
            let found = measured(&counts, Estimator::Centroid, black_level).expect("a centre");
            let (centre, height) = reference(light, level, background, width, true_centre);
            worst = worst.max((found.frame.centre.to_f64() - centre).abs());
            let above_black = height + background - level;
            let off = found.frame.amplitude.to_f64() - above_black;
            assert!(off.abs() < 1e-3 * height, "{black_level:?}: {off}");
            // Steps of 1/256, and a pixel more or less beside the window of `frame`.
            assert!((found.black_level.to_f64() - level).abs() < 0.01);
            (lowest, highest) = (lowest.min(centre), highest.max(centre));
        }
        most_apart = most_apart.max(highest - lowest);
    }
    println!("centroids up to {worst:.1e} px off the reference, moved by {most_apart:.1e} px");
    // 2^-8 pixel is the last step of a window, of which 3 % are left.
    assert!(worst < 2e-4, "{worst}");
    // A centroid with any other level would not pass.
    assert!(most_apart > 10.0 * 2e-4, "{most_apart}");
}

#[test]
fn ambient_light_changes_neither_the_width_nor_the_uncertainty_of_a_centroid() {
    let counts = counts(1800.3, 9.0, 2000.0);
    let of = |black| {
        let found = measured(&counts, Estimator::Centroid, black).expect("a centre");
        (found.frame.width.to_f64(), found.frame.uncertainty.to_f64())
    };
    let (width, uncertainty) = of(BlackLevel::Frame);
    for (black_level, _) in black_levels(&counts, 1800.3) {
        let found = of(black_level);
        let (wider, more) = (found.0 / width - 1.0, found.1 / uncertainty - 1.0);
        assert!(wider.abs() < 1e-3 && more.abs() < 1e-2, "{black_level:?}");
    }
}

#[test]
fn heights_up_to_the_limit_above_the_black_level_can_be_measured() {
    let head: Geometry = tcd1304dg();
    // The dither is three counts at most.
    let most = f64::from(head.full_scale()) - DARK - AMBIENT;
    let (below, beyond) = (counts(1800.0, 9.0, most - 4.0), counts(1800.0, 9.0, most));
    for (black_level, level) in black_levels(&below, 1800.0) {
        let limit = f64::from(head.full_scale()) - level;
        let found = measured(&below, Estimator::Centroid, black_level).expect("a centre");
        let found_limit = head.height_limit(found.black_level).to_f64();
        assert!((found_limit - limit).abs() < 0.01, "{black_level:?}");
        // The dither raises the top to the limit, and the mean height to two counts below it.
        let height = found.frame.amplitude.to_f64();
        let heights = limit - 20.0..limit;
        assert!(heights.contains(&height), "{black_level:?}: {height}");
        let found = measured(&beyond, Estimator::Centroid, black_level);
        let is_saturated = matches!(found, Err(Fault::Saturated { .. }));
        assert!(is_saturated, "{black_level:?}: {found:?}");
    }
}

#[test]
fn a_spot_below_the_black_level_has_no_centre() {
    let counts = counts(1800.3, 9.0, 1000.0);
    let black_level = BlackLevel::Fixed(Counts::from_int(2500));
    let found = measured(&counts, Estimator::Centroid, black_level);
    assert!(matches!(found, Err(Fault::NoSpot { .. })), "{found:?}");
}

#[test]
fn a_sensor_without_shielded_pixels_takes_the_background() {
    let head = Geometry {
        shielded: 0..0,
        ..tcd1304dg()
    };
    let counts = counts(1800.3, 9.0, 1000.0);
    let found = measured_by(head, &counts, Estimator::Centroid, BlackLevel::Shielded);
    let height = found.expect("a centre").frame.amplitude.to_f64();
    assert!((height - 1000.0).abs() < 10.0, "{height}");
}
