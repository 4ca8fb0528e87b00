//! `slitrange head flat` takes a map of the pixels and saves it.

use super::stand_in::{StandIn, Trouble};

#[test]
fn a_person_darkens_and_lights_the_sensor() {
    let sensor = StandIn::new(1, Trouble::default());
    let (result, output) = sensor.command("head", &["flat", "--port", &sensor.port()], "\n\n");
    result.expect("a map");
    for line in [
        "sensor TCD1304DG at ",
        "cover the sensor",
        "remove the slit",
        "flat dark 300.0 counts",
        "flat lit 2300.0 counts response 0.052 % offset 0.26 counts outside 2",
        "flat on",
        "saved: the map is kept over a power cycle",
    ] {
        assert!(output.contains(line), "{line}");
    }
    assert!(sensor.state().has_saved_map);
    assert!(sensor.state().settings().stream, "the stream is put back");
}

#[test]
fn wrong_light_is_asked_for_again() {
    let sensor = StandIn::new(2, Trouble::default());
    sensor.state().wrong_light = 1;
    let port = sensor.port();
    let arguments = ["flat", "--port", &port, "--no-save"];
    let (result, output) = sensor.command("head", &arguments, "\n\n\n");
    result.expect("a map");
    assert!(output.contains("E20 the dark rows are 900 counts brighter at pixel 1760"));
    assert_eq!(output.matches("Then press Enter.").count(), 3);
    assert!(output.contains("not saved"));
    assert!(!sensor.state().has_saved_map);
    // Nobody is there.
    let (result, _) = sensor.command("head", &arguments, "\n");
    let error = result.expect_err("no Enter");
    assert!(error.starts_with("nobody pressed Enter"), "{error}");
}

#[test]
fn a_script_takes_dark_and_lit_rows_in_two_runs() {
    let sensor = StandIn::new(3, Trouble::default());
    let port = sensor.port();
    let run = |only| sensor.command("head", &["flat", "--port", &port, "--only", only], "");
    let (result, _) = run("lit");
    let error = result.expect_err("no dark rows");
    assert!(error.contains("E20 there are no dark rows"), "{error}");
    let (result, output) = run("dark");
    result.expect("dark rows");
    assert!(!output.contains("flat lit"));
    assert!(!sensor.state().has_saved_map);
    run("lit").0.expect("a map");
    assert!(sensor.state().has_saved_map);
    sensor.state().flash_works = false;
    run("dark").0.expect("dark rows");
    let error = run("lit").0.expect_err("no flash");
    assert!(
        error.starts_with("the map is in use, but not saved: "),
        "{error}"
    );
}

/// Lines are lost and garbled, and the tool asks again.
#[test]
fn noise_on_the_line_does_not_matter() {
    let trouble = Trouble {
        lost: 0.05,
        garbled: 0.05,
        ..Trouble::default()
    };
    for seed in 0..20 {
        let sensor = StandIn::new(seed, trouble);
        let (result, _) = sensor.command("head", &["flat", "--port", &sensor.port()], "\n\n");
        result.expect("a map");
        assert!(sensor.state().has_saved_map);
    }
}
