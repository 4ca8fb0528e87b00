use super::*;
use crate::tests::{found_at, gaussian, hash, normal, row, spot_at, tcd1304dg, with};

#[test]
fn a_spot_is_whole_if_five_widths_fit_on_both_sides_and_nothing_is_saturated() {
    let mut light = [300; 101];
    for (centre, is_so) in [(49.5, false), (50.0, true), (50.5, false)] {
        let found = is_whole(&row(&light), &found_at(centre, 10.0));
        assert_eq!(found, is_so, "{centre}");
    }
    light[3] = 4095;
    assert!(!is_whole(&row(&light), &found_at(50.0, 10.0)));
}

#[test]
fn a_cut_spot_needs_a_small_uncertainty_and_a_row_of_eight_widths() {
    // 32 * 0.25 = 8, and 8 * 12.625 = 101.
    for (width, is_so) in [(7.9, false), (8.0, true), (12.625, true), (12.7, false)] {
        let found = is_certain_cut(&row(&[300; 101]), &found_at(1.0, width));
        assert_eq!(found, is_so, "{width}");
    }
}

/// Compares light with its mirror image about a centre of a width, for a spot of a height on a background
/// of a level and a noise.
fn symmetry_of(
    light: &[u16],
    (centre, width, height): (f32, f32, f32),
    background: (f32, f32),
) -> (Symmetry, RowCentre) {
    let spot = spot_at(centre as usize, 0, height, background);
    let found = RowCentre {
        uncertainty: Pixels::from_f32(0.005),
        amplitude: spot.height,
        ..found_at(centre, width)
    };
    let nothing = MaskedPixels::default();
    let symmetry = Symmetry::of(&row(light), &spot, &found, &tcd1304dg(), &nothing, true);
    (symmetry, found)
}

/// Sigma of samples of a gaussian that pixels integrate.
fn with_pixel(width: f32) -> f32 {
    libm::sqrtf(width * width + 1.0 / 12.0)
}

/// Compares a symmetric spot with its mirror image: the width is in pixels, the noise is a count.
fn symmetry(width: f32, centre: f32, seed: usize) -> (Symmetry, RowCentre) {
    let light: [u16; 64] = core::array::from_fn(|i| {
        let spot = 200.5 + 2000.0 * gaussian(i, centre, with_pixel(width));
        spot as u16 + (hash(i + 64 * seed) >> 30) as u16
    });
    symmetry_of(&light, (centre, width, 2000.0), (201.5, 1.1))
}

fn is_clean(symmetry: &Symmetry, found: &RowCentre) -> bool {
    let trust = Trust::of(found, &MaskedPixels::default());
    symmetry.is_spot(trust) && symmetry.is_symmetric(found, trust)
}

/// Compares spots with shot and read noise with their mirror images. The module gives the variance of
/// each statistic. So the mean square of each component is 1. The squares of n pairs have a
/// mean of n - 1, because the shift takes one. The mean of 4000 squares is known to 2.2 %; the test
/// allows five times this.
#[test]
fn statistics_of_noise_have_the_variances_that_the_check_assumes() {
    const ROWS: usize = 4000;
    // That of the TCD1304DG, in counts^2 a count.
    let shot = f32::from(tcd1304dg().shot_variance_per_count_q16) / 65536.0;
    let (level, height, read_noise) = (300.0f32, 2000.0f32, 8.0f32);
    // With the rounding of a word.
    let noise = libm::sqrtf(read_noise * read_noise + 1.0 / 12.0);
    let mut state = 1;
    for width in [3.0f32, 4.3, 9.0] {
        let mut sums = [0.0f64; 9];
        for number in 0..ROWS {
            // At all places within a pixel.
            let centre = 63.0 + number as f32 / ROWS as f32;
            let light: [u16; 128] = core::array::from_fn(|i| {
                let spot = height * gaussian(i, centre, with_pixel(width));
                let noise = libm::sqrtf(read_noise * read_noise + shot * spot);
                (level + spot + noise * normal(&mut state) + 0.5) as u16
            });
            let (it, _) = symmetry_of(&light, (centre, width, height), (level, noise));
            let (along, _, variance) = it.even.fourth.expect("many pairs");
            let flatness = libm::ldexpf(along as f32, -15).powi(2);
            let flatness = flatness / libm::ldexpf(variance as f32, -16);
            let Even { rest, variance, .. } = it.even;
            let scatter = root_of_double(it.pairs) as f32 / 256.0;
            let misfit = rest as f32 / (variance as f32 * scatter);
            let squares = it.squares as f32 / (256 * (it.pairs - 1)) as f32;
            let others = [squares, flatness, misfit, misfit * misfit];
            let statistics = it
                .components
                .map(|it| (it as f32 / 4096.0).powi(2))
                .into_iter()
                .chain(others);
            for (sum, statistic) in sums.iter_mut().zip(statistics) {
                *sum += f64::from(statistic);
            }
        }
        let means = sums.map(|sum| sum / ROWS as f64);
        println!("width {width}: {means:.3?}");
        for mean in &means[..6] {
            assert!((mean - 1.0).abs() < 0.11, "{width}: {means:?}");
        }
        // The check takes the noise at the spot's top for all samples, so k4 is more certain than that.
        assert!((0.35..0.6).contains(&means[6]), "{width}: {means:?}");
        // The fit leaves less than it should where the noise is less than the mean noise: by up to one
        // deviation. The limit is four.
        assert!((-1.0..0.0).contains(&means[7]), "{width}: {means:?}");
        assert!((0.8..2.0).contains(&means[8]), "{width}: {means:?}");
    }
}

#[test]
fn a_row_is_too_short_if_three_widths_fit_on_neither_side() {
    let light = [300; 101];
    for (centre, width, is_too_short) in [
        (50.0, 16.5, false),
        (50.0, 17.0, true),
        (45.0, 17.0, false),
        (55.0, 17.0, false),
        // Exactly three widths on one side.
        (51.0, 17.0, false),
        (49.0, 17.0, false),
        (49.5, 16.75, false),
        (49.5, 17.0, true),
    ] {
        let found = is_row_too_short((&light).into(), &found_at(centre, width));
        assert_eq!(found, is_too_short, "{centre} {width}");
    }
}

/// Steps of 8 counts have a noise of 8 / sqrt(12) = 2.31 counts. Only pixels within six widths and four
/// pixels matter.
#[test]
fn steps_are_coarse_if_their_noise_exceeds_the_rows_noise() {
    let mut light: [u16; 101] = core::array::from_fn(|i| 320 + 8 * (i as u16 % 3));
    let is_coarse = |light: &[u16], noise| {
        let spot = spot_at(50, 0, 1000.0, (320.0, noise));
        is_coarse(row(light).light(), &spot, &found_at(50.0, 4.0))
    };
    assert!(is_coarse(&light, 2.2) && !is_coarse(&light, 2.4));
    // 6 * 4 + 4 = 28 pixels: the 29th does not matter, the 27th does.
    light[50 - 29] += 1;
    light[50 + 29] += 1;
    assert!(is_coarse(&light, 2.2));
    for at in [50 - 27, 50 + 27] {
        light[at] += 1;
        assert!(!is_coarse(&light, 2.2), "{at}");
        light[at] -= 1;
    }
}

/// The rise to a single pixel and the fall behind it are each as large as its height, together twice the
/// height: 400 counts beyond the limit. A spot with a sigma of one pixel has 0.94 of its height. A noise
/// of 100 counts gives the limit SHARP times 200 counts of room. Wider spots are no bad pixels.
#[test]
fn a_single_bright_pixel_is_sharper_than_any_spot() {
    let pixel: [u16; 101] = core::array::from_fn(|i| if i == 50 { 1300 } else { 300 });
    let spot = core::array::from_fn(|i| 300 + (1000.0 * gaussian(i, 50.0, 1.0)) as u16);
    for (light, width, noise, is_sharp) in [
        (pixel, 1.0, 2.0, true),
        (pixel, 1.6, 2.0, false),
        (spot, 1.0, 2.0, false),
        (pixel, 1.0, 100.0, false),
    ] {
        let (spot, found) = (
            spot_at(50, 0, 1000.0, (300.0, noise)),
            found_at(50.0, width),
        );
        let found = super::is_sharp((&light).into(), &spot, &found, &tcd1304dg());
        assert_eq!(found, is_sharp, "{width} {noise}");
    }
}

/// With three or four pairs the norm of u^4 e is often nothing but rounding, and its root not a number.
#[test]
fn flatness_is_a_number_or_is_not_tested() {
    let (mut few, mut without, mut flagged) = (0, 0, 0);
    for seed in 0..200 {
        // So near the row's end that it has few pixels on one side.
        let width = 0.7 + 0.01 * (seed % 60) as f32;
        let (symmetry, found) = symmetry(width, 3.5 + 0.05 * (seed % 33) as f32, seed);
        let is_sensible = |(_, one, variance): (i32, i64, i64)| one > 0 && variance > 0;
        assert!(symmetry.even.fourth.is_none_or(is_sensible), "{width}");
        if symmetry.pairs <= 4 {
            few += 1;
            without += usize::from(symmetry.even.fourth.is_none());
            flagged += usize::from(!is_clean(&symmetry, &found));
        }
    }
    println!("of {few} with three or four pairs {without} have no flatness, {flagged} a flag");
    assert!(without > 0 && flagged <= few / 50);
}

#[test]
fn each_limit_flags() {
    let (good, found) = symmetry(4.0, 32.0, 1);
    assert!(is_clean(&good, &found));
    let spoil: [fn(&mut Symmetry); 10] = [
        |it| it.pairs = 0,
        |it| it.components[0] = i32::MIN,
        |it| it.components[1] = i32::MIN,
        |it| it.components[2] = i32::MAX,
        |it| it.deviations_a_pixel = 0,
        |it| it.worst = i64::MAX,
        |it| it.squares = i64::MAX,
        |it| it.width = Pixels::default(),
        |it| {
            it.even.fourth = it
                .even
                .fourth
                .map(|(_, one, variance)| (i32::MIN, one, variance))
        },
        |it| it.even.rest = i64::MAX,
    ];
    for (i, spoil) in spoil.into_iter().enumerate() {
        let mut spoiled = symmetry(4.0, 32.0, 1).0;
        spoil(&mut spoiled);
        assert!(!is_clean(&spoiled, &found), "{i}");
    }
}

/// A slope of 2.5 counts a pixel is a tilt of thousands of standard deviations under a wide spot with little
/// noise. The check subtracts it. Only the rounding of the words is left, and that is less than the noise.
#[test]
fn the_slope_of_a_tilted_row_leaves_no_tilt() {
    let (centre, width, height) = (450.3, 52.0, 886.0);
    let light: [u16; 901] = core::array::from_fn(|i| {
        let slope = 2600.0 - 2.5 * i as f32;
        (slope + height * gaussian(i, centre, width) + 0.5) as u16
    });
    let spot = spot_at(450, 0, height, (2600.0 - 2.5 * centre, 0.31));
    let found = with(found_at(centre, width), |it| it.amplitude = spot.height);
    let tilted = with(found, |it| it.class.set = TILTED.number);
    let nothing = MaskedPixels::default();
    let [with, without] = [found, tilted].map(|found| {
        let symmetry = Symmetry::of(&row(&light), &spot, &found, &tcd1304dg(), &nothing, false);
        (
            symmetry.components[1] as f32 / 4096.0,
            symmetry.squares as f32 / 256.0,
        )
    });
    println!("{with:.1?} and {without:.3?}");
    // Of 35 pairs.
    assert!(with.0.abs() > 1000.0 && without.0.abs() < 1.0 && without.1 < 60.0);
}

/// A spot of no height, and one of which no pair within three widths counts.
#[test]
fn without_light_that_tells_of_a_shift_nothing_is_clean() {
    let light: [u16; 129] =
        core::array::from_fn(|i| 300 + (2000.0 * gaussian(i, 64.0, 8.0)) as u16);
    let spot = spot_at(64, 0, 2000.0, (300.0, 1.0));
    let middle = MaskedPixels {
        first: 64 - 30,
        block: 1,
        samples: (1 << 61) - 1,
    };
    for (amplitude, masked) in [
        (0.0, MaskedPixels::default()),
        (-1.0, MaskedPixels::default()),
        (2000.0, middle),
    ] {
        let found = RowCentre {
            amplitude: Counts::from_f32(amplitude),
            uncertainty: Pixels::from_int(1),
            ..found_at(64.0, 8.0)
        };
        let symmetry = Symmetry::of(&row(&light), &spot, &found, &tcd1304dg(), &masked, false);
        assert!(
            symmetry.pairs >= 5 && !is_clean(&symmetry, &found),
            "{amplitude}"
        );
        let Symmetry {
            deviations_a_pixel,
            pixels_a_deviation,
            ..
        } = symmetry;
        println!("{amplitude}: {deviations_a_pixel} {pixels_a_deviation}");
        assert!(
            deviations_a_pixel >= 0 && pixels_a_deviation > 0,
            "{amplitude}"
        );
    }
}

/// Compares a spot without noise, lopsided by `skewness`, with its mirror image. A pixel at two widths is
/// brighter by `flaw` counts.
fn lopsided(width: f32, skewness: f32, flaw: u16) -> (Symmetry, RowCentre) {
    let (centre, height, level) = (64.0, 3000.0, 200.0);
    let mut light: [u16; 129] = core::array::from_fn(|i| {
        let u = (i as f32 - centre) / with_pixel(width);
        let lopsided = 1.0 + skewness / 6.0 * (u * u * u - 3.0 * u);
        (level + height * libm::expf(-0.5 * u * u) * lopsided + 0.5) as u16
    });
    light[(centre + 2.0 * width) as usize] += flaw;
    let (symmetry, found) = symmetry_of(&light, (centre, width, height), (level, 1.0));
    let uncertainty = Pixels::from_f32(0.25);
    (symmetry, with(found, |it| it.uncertainty = uncertainty))
}

/// An own spot without deviations.
fn own_spot(width: Pixels, components: [Pixels; COMPONENTS]) -> OwnSpot {
    OwnSpot {
        width,
        width_deviation: Pixels::default(),
        components,
        deviation: Pixels::default(),
    }
}

#[test]
fn the_own_spots_light_leaves_the_components_and_the_squares() {
    let mut symmetry = symmetry(4.0, 32.0, 1).0;
    let deviations = |all: [i32; COMPONENTS]| all.map(|it| it * (1 << 12));
    symmetry.components = deviations([1, 2, 3, 4, 5]);
    // A quarter of a pixel, and a leverage of 0.2.
    (symmetry.deviations_a_pixel, symmetry.leverage) = (4 << 14, 13_107);
    symmetry.squares = 100 << 8;
    let quarters = |all: [i32; COMPONENTS]| all.map(|it| Pixels::from_bits(it * (1 << 14)));
    symmetry.subtract(&own_spot(Pixels::from_int(4), quarters([0; COMPONENTS])));
    assert_eq!(symmetry.components, deviations([1, 2, 3, 4, 5]));
    assert_eq!((symmetry.squares, symmetry.own_of_a_pair), (100 << 8, 0));
    // 1, 2, 1, 0 and -1 standard deviations. Without the shift, the sum of the components' squares rises
    // from 4 + 9 + 16 + 25 to 0 + 4 + 16 + 36.
    symmetry.subtract(&own_spot(Pixels::from_int(4), quarters([1, 2, 1, 0, -1])));
    assert_eq!(symmetry.components, deviations([0, 0, 2, 4, 6]));
    assert_eq!(symmetry.squares, 102 << 8);
    // The root of 5 functions times the leverage times the sum of squares 1 + 4 + 1 + 1.
    let most = symmetry.own_of_a_pair as f32 / 128.0;
    assert!((most - libm::sqrtf(5.0 * 0.2 * 7.0)).abs() < 0.01);
}

/// All of this row's difference from its mirror image is that of the own spot. So no pair may differ by
/// more than `own_of_a_pair`, and nothing else is left.
#[test]
fn the_own_spot_explains_a_lopsided_row_and_no_pixel_that_stands_out() {
    for (width, skewness) in [(3.0, 0.1), (3.0, -0.3), (5.5, 0.2), (9.0, 0.1), (9.0, -0.3)] {
        let (mut row, found) = lopsided(width, skewness, 0);
        let trust = Trust::of(&found, &MaskedPixels::default());
        let shape = row.shape();
        let own = own_spot(shape.width, shape.components);
        assert!(!row.is_symmetric(&found, trust), "{width} {skewness}");
        row.subtract(&own);
        assert!(row.is_symmetric(&found, trust), "{width} {skewness}");
        // The components were rounded to 2^-16 px.
        let rounding = (row.deviations_a_pixel >> 17) + 2;
        assert!(
            row.components.iter().all(|it| it.abs() <= rounding),
            "{:?} {rounding}",
            row.components
        );
        let worst = row.worst.isqrt() as i32;
        println!("{width} {skewness}: {worst} of {}", row.own_of_a_pair);
        // The limit is a few times the most that the own spot makes of a pair, not without end.
        let limits = worst..5 * worst;
        assert!(limits.contains(&row.own_of_a_pair), "{width} {skewness}");

        let mut flawed = lopsided(width, skewness, 900).0;
        flawed.subtract(&own);
        assert!(!flawed.is_symmetric(&found, trust), "{width} {skewness}");
    }
}
