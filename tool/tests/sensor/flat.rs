//! `slitrange head flat` takes a map of the pixels and saves it.

use statistics::rms;

use super::stand_in::{StandIn, Trouble};
use crate::command::*;

#[test]
fn a_person_darkens_and_lights_the_sensor() {
    let sensor = StandIn::new(1);
    let output = done(sensor.type_in("head flat --port PORT", "\n\n"));
    let lines = [
        "sensor TCD1304DG at ",
        "the laser is off until",
        "cover the sensor",
        "take the slit off",
        "flat dark 299.9 counts",
        "flat lit 2301.1 counts response 0.055 % offset 0.25 counts outside 0",
        "flat on",
        "saved: the map is kept over a power cycle",
    ];
    says(&output, lines);
    assert!(sensor.state().has_saved_map);
    let settings = sensor.state().settings();
    assert!(settings.stream && settings.laser, "they are put back");
}

/// The map of a sensor that sees `scenes/even-light.toml` has the response and the offset of its pixels. 256
/// rows of 2000 counts, with 10 electrons a count and 4 counts of read noise, leave 0.046 % of a response.
/// The mean over 1025 pixels that differ by 2 % leaves 0.062 %, which may be twice as large, as the row has
/// three such means. Of an offset, 4 counts over the root of 256 rows are left, and the rounding to 1/16.
#[test]
fn the_map_has_the_pixels_of_the_scene_in_even_light() {
    let scene = Scene::load("even-light").expect("a scene");
    let sensor = StandIn::new(4);
    sensor.state().type_line("laser off");
    done(sensor.type_in("head flat --port PORT", "\n\n"));
    assert!(!sensor.state().settings().laser, "it was off before");
    let (geometry, seed) = (scene.sensor.geometry(), scene.seed);
    let pixels = geometry.light.len();
    let factors = scene.response.expect("a response").factors(seed, 0, pixels);
    let pattern = scene.fixed_pattern.expect("a pattern");
    let offsets = &pattern.offsets(seed, 0, geometry.words)[geometry.light];
    let mean = statistics::mean(offsets.iter().map(|&it| f64::from(it)));
    let state = sensor.state();
    let entries = state.flat.map().expect("a map").entries();
    // At the ends, fewer neighbours make the mean.
    let inner = 512..pixels - 512;
    let response = rms(inner.clone().map(|i| {
        let gain = 1.0 + f64::from(entries[i].gain_q15()) / 32768.0;
        gain * f64::from(factors[i]) - 1.0
    }));
    let offset =
        rms(inner
            .map(|i| f64::from(entries[i].offset_q4()) / 16.0 - (f64::from(offsets[i]) - mean)));
    println!(
        "off by {:.4} % and {offset:.3} counts, RMS",
        100.0 * response
    );
    assert!(response < 0.046e-2f64.hypot(2.0 * 0.062e-2) && offset < 0.27);
}

#[test]
fn wrong_light_is_asked_for_again() {
    let sensor = StandIn::new(2);
    sensor.state().trouble.wrong_light = 1;
    let flat = |typed| sensor.type_in("head flat --port PORT --no-save", typed);
    let output = done(flat("\n\n\n"));
    let error = "E20 the dark rows are 900 counts brighter at pixel 1760";
    says(&output, [error, "not saved"]);
    assert_eq!(output.matches("Then press Enter.").count(), 3);
    assert!(!sensor.state().has_saved_map);
    // Nobody is there.
    begins(&refused(flat("\n")), "nobody pressed Enter");
    assert!(sensor.state().settings().laser);
    sensor.state().trouble.interrupted = true;
    begins(&refused(flat("")), "stopped by Ctrl-C");
    assert!(sensor.state().settings().laser);
}

#[test]
fn a_script_takes_dark_and_lit_rows_in_two_runs() {
    let sensor = StandIn::new(3);
    let [dark, lit] = ["dark", "lit"].map(|only| format!("head flat --port PORT --only {only}"));
    says(&sensor.refused(&lit), ["E20 there are no dark rows"]);
    assert!(!sensor.done(&dark).contains("flat lit"));
    assert!(!sensor.state().has_saved_map);
    sensor.done(&lit);
    assert!(sensor.state().has_saved_map);
    sensor.state().trouble.broken_flash = true;
    sensor.done(&dark);
    begins(&sensor.refused(&lit), "the map is in use, but not saved: ");
}

#[test]
fn noise_on_the_line_does_not_matter() {
    for seed in 0..20 {
        let sensor = StandIn::new(seed);
        sensor.state().trouble = Trouble::of_line(0.05, 0.05);
        done(sensor.type_in("head flat --port PORT", "\n\n"));
        assert!(sensor.state().has_saved_map);
    }
}
