//! `slitrange head flat` takes a map of the pixels and saves it.

use super::stand_in::{StandIn, Trouble};
use crate::command::*;

#[test]
fn a_person_darkens_and_lights_the_sensor() {
    let sensor = StandIn::new(1);
    let output = done(sensor.type_in("head flat --port PORT", "\n\n"));
    let lines = [
        "sensor TCD1304DG at ",
        "cover the sensor",
        "remove the slit",
        "flat dark 300.0 counts",
        "flat lit 2300.0 counts response 0.052 % offset 0.26 counts outside 2",
        "flat on",
        "saved: the map is kept over a power cycle",
    ];
    says(&output, lines);
    assert!(sensor.state().has_saved_map);
    assert!(sensor.state().settings().stream, "the stream is put back");
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
