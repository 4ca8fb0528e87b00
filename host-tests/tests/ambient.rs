//! Ambient light: what `ambient subtract` takes away, and the noise that it costs.

use crate::support::*;
use judges::changing_light::ambient::{
    CHARGE_STAYS, DARK_ROOM, LIGHTS, Light, WHITE_PAPER, noise_of_mean,
};
use slitrange::light::ambient::AmbientMode::{Off, Subtract};

const FRAMES: usize = 400;

fn named(name: &str) -> Light {
    let light = LIGHTS.into_iter().find(|it| it.name == name);
    light.expect("a light")
}

/// The scene beside a window.
fn beside_a_window(scene: Scene) -> Scene {
    let light = "ambient = { counts_per_second = 100e3, slope = 11.0 }";
    listing(scene, light)
}

/// Beside a window the error is at most 1.5 times that of the dark room, and in each light it is the one that
/// the Cramér-Rao bound gives for the light's shot noise and the noise of the mean.
#[test]
#[ignore = "takes 10 CPU s; run by .ci/run"]
fn subtracted_light_costs_the_noise_that_is_computed() {
    let dark = DARK_ROOM.measure(Off, 16, FRAMES);
    println!("dark room: {dark:.3?}");
    for light in LIGHTS {
        let found = light.measure(Subtract, 16, FRAMES);
        let off = light.measure(Off, 16, FRAMES);
        let [price, of_off] = [&found, &off].map(|it| it.rms_um / dark.rms_um);
        let computed = light.computed_price(Subtract, 16);
        let name = light.name;
        println!("{name}: {price:.2} times the dark room's error, computed {computed:.2}");
        println!("with ambient off {of_off:.2}\n{found:.3?}\n{off:.3?}");
        assert_eq!((found.faults, found.flagged > FRAMES / 50), (0, false));
        // The ratio of two standard deviations of 400 readings each is known to 5 %.
        assert!((price / computed - 1.0).abs() < 0.15, "{name}");
        // 95.4 % are expected within 2. Of 400, the standard deviation is 1 %.
        assert!(found.beyond_2 < FRAMES * 8 / 100, "{name}");
        assert_eq!(found.beyond_5, 0, "{name}");
    }
    let window = named("beside a window").measure(Subtract, 16, FRAMES);
    assert!(window.rms_um < 1.5 * dark.rms_um);
}

/// A long frame averages more rows and has the same mean to subtract. Its r contains the noise of the mean,
/// and its errors are as large as its r.
#[test]
fn a_long_frame_has_more_of_the_means_noise() {
    let window = named("beside a window, three times as bright");
    let [one, long] = [(1, 2000), (64, 300)].map(|(rows, frames)| {
        let found = window.measure(Subtract, rows, frames);
        let of_mean = noise_of_mean(rows);
        println!("{rows} rows: {found:.3?}, computed share {of_mean:.4}");
        assert_eq!((found.faults, found.beyond_5), (0, 0));
        let readings = found.readings() as f64;
        // Four standard deviations of an RMS value, and what r is too large by: the spot's own shot noise as
        // noise of the mean, and its share at the end of a frame (1/255 of a row's variance for each row).
        let margin = 4.0 / (2.0 * readings).sqrt();
        let too_large = ((1.0 + f64::from(rows) / 255.0) / (1.0 + of_mean)).sqrt();
        let ratio = found.rms_um / found.r_um;
        println!("RMS over r {ratio:.3}, margin {margin:.3}, too large {too_large:.3}");
        assert!(ratio < 1.0 + margin, "{rows} rows");
        assert!(ratio > 0.95 / too_large - margin, "{rows} rows");
        found
    });
    // The r of 64 rows is that of one row over eight, times the noise of the mean. The mean of r is known to
    // better than 1 %.
    let growth = long.r_um * 8.0 / one.r_um;
    let computed = ((1.0 + 64.0 / 255.0) / (1.0 + 1.0 / 255.0f64)).sqrt();
    println!("r of 64 rows over an eighth of r of one row: {growth:.3}, computed {computed:.3}");
    assert!((growth / computed - 1.0).abs() < 0.03);
}

/// A row with noise and a spot on daylight, and a row of the daylight without noise.
fn lit_and_dark_words() -> (Vec<u16>, Vec<u16>) {
    let window = beside_a_window(Scene::white_paper());
    let lit = listing(window, "read_noise.counts = 40.0");
    let dark = (lit.clone().without(Effect::ReadNoise)).without(Effect::ShotNoise);
    let dark = with(dark, |it| it.spot = None);
    let [lit, dark] = [lit, dark].map(|scene| {
        let geometry = scene.geometry();
        words(&scene.row(1, 0.8, 5e-3), &geometry)
    });
    (lit, dark)
}

fn subtracting(rows: u16) -> Options {
    options(|it| (it.ambient, it.rows) = (Subtract, rows))
}

/// Each row has the same words, so that r changes by the noise of the mean alone. It must not be below the
/// noise of the means that the frame's rows had subtracted, from the first frame on.
#[test]
fn r_contains_all_noise_of_a_mean_that_has_just_begun() {
    let (lit, dark) = lit_and_dark_words();
    for rows in [1u16, 4, 16, 64] {
        let mut measurement = Measurement::new(Scene::white_paper().geometry(), subtracting(rows));
        let mut frame = || {
            loop {
                measurement.ambient_row(&dark);
                if let Some(result) = measurement.row(&mut lit.clone()) {
                    break result.expect("a reading").frame.uncertainty;
                }
            }
        };
        let claims: Vec<f64> = (0..40).map(|_| frame().to_f64()).collect();
        let settled = (0..600).map(|_| frame()).last().expect("frames").to_f64();
        let without = settled / (1.0 + f64::from(rows) / 255.0).sqrt();
        // The weight of each dark row in the mean.
        let mut weights: Vec<f64> = vec![];
        for (number, &claim) in claims.iter().enumerate() {
            let mut of_frame = vec![0.0; weights.len() + usize::from(rows)];
            for _ in 0..rows {
                let part = 0.5f64.powi(((weights.len() + 1).ilog2() as i32).min(7));
                weights.iter_mut().for_each(|weight| *weight *= 1.0 - part);
                weights.push(part);
                for (sum, weight) in of_frame.iter_mut().zip(&weights) {
                    *sum += weight / f64::from(rows);
                }
            }
            let variance: f64 = of_frame.iter().map(|weight| weight * weight).sum();
            let computed = without * (1.0 + f64::from(rows) * variance).sqrt();
            let of_computed = claim / computed;
            println!("frame {number} of {rows} rows: {of_computed:.3} of the computed noise");
            // An uncertainty has steps of 2^-16 pixels.
            assert!(claim > computed - 2e-5, "frame {number} of {rows} rows");
        }
    }
}

/// Options that do not change the mean leave it. With `ambient` or `laser` the mean begins again.
#[test]
fn the_mean_outlasts_other_settings() {
    let (lit, dark) = lit_and_dark_words();
    let geometry = Scene::white_paper().geometry();
    let one = subtracting(1);
    let settled = || {
        let mut measurement = Measurement::new(geometry.clone(), one);
        (0..200).for_each(|_| measurement.ambient_row(&dark));
        measurement
    };
    let measure = |measurement: &mut Measurement| {
        let result = measurement.row(&mut lit.clone());
        let measured = result.expect("a frame").expect("a reading");
        (measured.ambient.to_f64(), measured.frame.uncertainty)
    };
    let expected = measure(&mut settled());
    println!("settled: {expected:?}");
    // The shielded pixels have noise too.
    assert!(expected.0 < 60.0);
    let mut measurement = settled();
    let other = with(one, |it| it.black_level = BlackLevel::Frame);
    for options in [other, one] {
        measurement.set(options, None);
        measurement.set_geometry(geometry.clone());
    }
    assert_eq!(measure(&mut measurement), expected);
    for other in [
        with(one, |it| it.ambient = Off),
        with(one, |it| it.laser = false),
    ] {
        let mut measurement = settled();
        measurement.set(other, None);
        measurement.set(one, None);
        let (ambient, _) = measure(&mut measurement);
        println!("began again: {ambient} counts of ambient light are left");
        assert!(ambient > 300.0);
    }
    let mut measurement = settled();
    measurement.set_geometry(with(geometry, |it| it.saturation = 4000));
    assert!(measure(&mut measurement).0 > 300.0);
}

/// Adds a lamp's light to the pixels.
type Lamp = fn(&mut [f32]);

/// Lamps that are switched on and off: strong daylight from one side, and a sharp image on the spot's flank.
/// Until the mean has followed, no reading may claim to be better than it is.
#[test]
fn light_that_changes_gives_no_wrong_distance_without_a_flag() {
    let from_one_side = |light: &mut [f32]| {
        for (light, pixel) in light.iter_mut().zip(0u16..) {
            *light += 300.0 + 0.25 * f32::from(pixel);
        }
    };
    let on_the_flank = |light: &mut [f32]| {
        for (light, pixel) in light.iter_mut().zip(0u16..) {
            let u = (f32::from(pixel) - 1790.0) / 9.0;
            *light += 400.0 * (-0.5 * u * u).exp();
        }
    };
    let lamps: [(&str, Lamp, usize); 2] = [
        ("from one side", from_one_side, 390),
        // Most frames after a change are flagged: the mean's rest lies beside the spot.
        ("on the flank", on_the_flank, 100),
    ];
    for (name, lamp, fewest) in lamps {
        let mut sensor = DARK_ROOM.settled(Subtract, 16);
        let (mut readings, mut flagged, mut faults, mut worst) = (0, 0, 0, 0.0f64);
        for turn in 0..40 {
            sensor = sensor.with_lamp(if turn % 2 == 0 { lamp } else { |_| () });
            // Frames of 183 ms. A turn ends within a frame.
            for _ in 0..10 {
                for result in sensor.frames(WHITE_PAPER, 1) {
                    let Ok(measured) = result else {
                        faults += 1;
                        continue;
                    };
                    let compared = sensor.compare(&measured);
                    if compared.is_flagged {
                        flagged += 1;
                        continue;
                    }
                    readings += 1;
                    worst = worst.max(compared.error_over_claim());
                }
            }
            for _ in 0..turn % 16 {
                sensor.row(WHITE_PAPER);
            }
        }
        println!("{name}: {readings} good, {flagged} flagged, {faults} faults, {worst:.2} claims");
        assert!(readings > fewest, "{name}");
        assert!(worst < 5.0, "{name}");
    }
}

/// The well is full by the light that the pixels saw: the spot has 50 to 85 % of the room above the daylight,
/// although the daylight is subtracted.
#[test]
fn auto_exposure_leaves_room_for_the_light_that_is_subtracted() {
    // The well holds 4000 counts, of which 300 are no charge. Daylight takes 1710 in the middle of the row.
    const ROOM: f64 = 3795.0 - 1710.0;
    let light = named("beside a window, three times as bright");
    for reflectivity in [0.3, 0.1, 1e-2, 3e-3] {
        let mut sensor = light.sensor(subtracting(Options::default().rows));
        sensor.frames(reflectivity, 3);
        for result in sensor.frames(reflectivity, 10) {
            let measured = result.expect("a reading");
            let height = measured.frame.amplitude.to_f64();
            let percent = 100.0 * height / ROOM;
            let exposure = measured.frame.exposure;
            println!("{reflectivity}: {exposure:?}, {height:.0} counts, {percent:.0} %");
            assert!((49.0..86.0).contains(&percent));
            assert!(!sensor.compare(&measured).is_flagged);
        }
    }
}

/// Charge that stays from a row with the laser on is subtracted as if it were ambient light. A target at rest
/// has the same ghost in all dark rows, and its error hardly grows. After a move, the ghost of the old place
/// stays in the mean for seconds: the readings are off, and claim it.
#[test]
fn readings_claim_the_error_of_charge_that_stays() {
    let [off, subtract] = [Off, Subtract].map(|mode| {
        let found = CHARGE_STAYS.measure(mode, 16, FRAMES);
        println!("at rest, {mode:?}: {found:.3?}");
        assert_eq!((found.faults, found.beyond_5), (0, 0));
        found
    });
    // The ratio of two standard deviations of 400 readings each is known to 5 %.
    assert!(subtract.rms_um < 1.2 * off.rms_um);
    for um in [50, 100, 200, 400, 800, 1600, 3000, 10_000] {
        let mut sensor = CHARGE_STAYS.settled(Subtract, 16);
        sensor.move_to(0.8 + f64::from(um) * 1e-6);
        sensor.row(WHITE_PAPER);
        sensor.start_frame();
        let (mut worst, mut largest, mut last, mut flagged) = (0.0f64, 0.0f64, 0, 0);
        for (frame, result) in sensor.frames(WHITE_PAPER, 60).into_iter().enumerate() {
            let compared = sensor.compare(&result.expect("a reading"));
            if compared.is_flagged {
                flagged += 1;
                continue;
            }
            worst = worst.max(compared.error_over_claim());
            largest = largest.max(compared.error_um.abs());
            if compared.error_um.abs() > 10.0 {
                last = frame + 1;
            }
        }
        print!("{um} um away: at most {largest:.2} um, {worst:.2} claims, ");
        println!("below 10 um after {last} frames, {flagged} flagged");
        assert!(worst < 5.0, "{um} um");
    }
}

/// Rows of a comb beside a window have the same centre as in the dark room, and are as good as they claim.
#[test]
fn a_comb_beside_a_window_is_measured_as_in_the_dark_room() {
    let comb = crate::comb::quiet();
    let window = beside_a_window(comb.clone());
    const ROWS: usize = 200;
    let measure = |scene: &Scene, ambient| {
        let options = options(|it| (it.slits, it.ambient, it.rows) = (Slits::Comb, ambient, 1));
        let geometry = scene.geometry();
        let mut measurement = Measurement::new(geometry.clone(), options);
        let dark = with(scene.clone(), |it| it.spot = None);
        let [lit, dark] = [scene.clone(), dark].map(Simulation::new);
        let mut row = 0;
        let mut next = |simulation: &Simulation| {
            row += 1;
            words(&simulation.row(row, 0.8, scene.exposure), &geometry)
        };
        (0..128).for_each(|_| measurement.ambient_row(&next(&dark)));
        let (mut errors, mut claims) = (vec![], vec![]);
        for _ in 0..ROWS {
            measurement.ambient_row(&next(&dark));
            let result = measurement.row(&mut next(&lit));
            let measured = result.expect("a frame").expect("a reading");
            assert_eq!(measured.comb.expect("slits").used, 16);
            let error = measured.frame.centre.to_f64() - scene.optics.centre(0.8);
            errors.push(error);
            claims.push(error / measured.frame.uncertainty.to_f64());
        }
        (mean(&errors), rms(&errors), rms(&claims))
    };
    let dark = measure(&comb, Off);
    let subtract = measure(&window, Subtract);
    for (name, (mean, rms, claims)) in [
        ("dark room", dark),
        ("window, off", measure(&window, Off)),
        ("window, subtract", subtract),
    ] {
        println!("{name}: mean error {mean:.5} px, RMS {rms:.5} px, {claims:.2} of the claim");
    }
    // Four standard deviations of a mean of 200 rows, twice.
    let margin = 4.0 * f64::hypot(dark.1, subtract.1) / (ROWS as f64).sqrt();
    assert!((subtract.0 - dark.0).abs() < margin);
    // The RMS of 200 is known to 5 %.
    assert!(subtract.2 < 1.2);
}
