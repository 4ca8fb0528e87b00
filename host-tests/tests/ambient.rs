//! Ambient light: what `ambient subtract` takes away, and the noise that it costs.

use host_tests::changing_light::ambient::{DARK_ROOM, LIGHTS, Light, WHITE_PAPER, noise_of_mean};
use slitrange::ambient::AmbientMode::{Off, Subtract};
use slitrange::settings::Settings;

const FRAMES: usize = 400;

fn named(name: &str) -> Light {
    LIGHTS
        .into_iter()
        .find(|it| it.name == name)
        .expect("a light")
}

/// Beside a window the error is at most 1.5 times that of the dark room, and in each light it is the one that
/// the Cramér-Rao bound gives for the light's shot noise and the noise of the mean.
#[test]
fn subtracted_light_costs_the_noise_that_is_computed() {
    let dark = DARK_ROOM.measure(Off, 16, FRAMES);
    println!("dark room: {dark:.3?}");
    for light in LIGHTS {
        let found = light.measure(Subtract, 16, FRAMES);
        let off = light.measure(Off, 16, FRAMES);
        let price = found.rms_um / dark.rms_um;
        let computed = light.computed_price(Subtract, 16);
        println!(
            "{}: {price:.2} times the dark room's error, computed {computed:.2}, with ambient off {:.2}\n\
             {found:.3?}\n{off:.3?}",
            light.name,
            off.rms_um / dark.rms_um
        );
        assert_eq!((found.faults, found.flagged > FRAMES / 50), (0, false));
        // The ratio of two standard deviations of 400 readings each is known to 5 %.
        assert!((price / computed - 1.0).abs() < 0.15, "{}", light.name);
        // 95.4 % are expected within 2. Of 400, the standard deviation is 1 %.
        assert!(found.beyond_2 < FRAMES * 8 / 100, "{}", light.name);
        assert_eq!(found.beyond_5, 0, "{}", light.name);
    }
    let window = named("beside a window").measure(Subtract, 16, FRAMES);
    assert!(window.rms_um < 1.5 * dark.rms_um);
}

/// A long frame averages more rows and has the same mean to subtract.
#[test]
fn a_long_frame_has_more_of_the_means_noise() {
    let window = named("beside a window");
    for (rows, least, most) in [(1, 0.0, 0.01), (16, 0.05, 0.07), (64, 0.18, 0.25)] {
        let share = noise_of_mean(rows);
        let (price, off) = (
            window.computed_price(Subtract, rows),
            window.computed_price(Off, rows),
        );
        println!(
            "{rows} rows: the mean adds {share:.4} of the rows' variance; {price:.3}, off {off:.3}"
        );
        assert!((least..most).contains(&share));
    }
}

/// Adds a lamp's light to the pixels.
type Lamp = fn(&mut [f32]);

/// Lamps that are switched on and off: strong daylight from one side, and a sharp image on the spot's flank.
/// Until the mean has followed, there is too much light or too little, and no reading may claim to be better
/// than it is.
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
        println!(
            "{name}: {readings} readings, {flagged} flagged, {faults} faults, {worst:.2} claims"
        );
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
    let settings = Settings {
        ambient: Subtract,
        ..Settings::default()
    };
    for reflectivity in [0.3, 0.1, 1e-2, 3e-3] {
        let mut sensor = named("beside a window, three times as bright").sensor(settings);
        sensor.frames(reflectivity, 3);
        for result in sensor.frames(reflectivity, 10) {
            let measured = result.expect("a reading");
            let height = measured.frame.amplitude.to_f64();
            let percent = 100.0 * height / ROOM;
            println!(
                "{reflectivity}: {:?}, {height:.0} counts, {percent:.0} %",
                measured.frame.exposure
            );
            assert!((49.0..86.0).contains(&percent));
            assert!(!sensor.compare(&measured).is_flagged);
        }
    }
}
