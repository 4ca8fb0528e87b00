//! The row live: what the screen shows, and what keys change.

use slitrange::base::exposure::{Exposure, ExposureMode};
use slitrange::centre::Estimator;

use super::screen::Person;
use super::stand_in::StandIn;
use crate::command::*;

/// What is seen at each key, without the port's name.
fn scope(sensor: &StandIn, keys: &[(usize, Key)]) -> (Vec<String>, String) {
    let (mut seen, output) = Person::new(sensor, keys).types("scope --port PORT");
    for picture in &mut seen {
        let lines: Vec<&str> = picture.lines().skip(1).collect();
        *picture = lines.join("\n");
    }
    (seen, output)
}

#[test]
fn the_window_and_the_whole_row_are_shown() {
    let sensor = StandIn::new(1);
    let (seen, output) = scope(&sensor, &[(3, Key::Char('z')), (3, Key::Quit)]);
    insta::assert_snapshot!(seen.join("\n\n"));
    // No setting changed, and the stream is on as before.
    assert_eq!(output, "");
    assert!(sensor.state().settings().stream);
}

#[test]
fn keys_change_exposure_and_estimator() {
    let sensor = StandIn::new(2);
    let keys = [Key::Down, Key::Down, Key::Up, Key::Char('e'), Key::Quit].map(|key| (2, key));
    let (seen, output) = scope(&sensor, &keys);
    says(&seen[0], ["exposure 5600 us (auto)"]);
    // 5600 / 1.25, and once more, and back.
    for (picture, us) in [(1, 4480), (2, 3584), (3, 4480)] {
        says(&seen[picture], [format!("exposure {us} us, black level")]);
    }
    says(&seen[3], ["estimator adaptive"]);
    says(&seen[4], ["estimator gauss-newton"]);
    let now = sensor.state().settings();
    let exposure = Exposure::from_us(4480).expect("an exposure");
    assert_eq!(now.exposure, ExposureMode::Fixed(exposure));
    assert_eq!(now.estimator, Estimator::GaussNewton);
    let exposure = "now exposure 4480 (it was exposure auto), ";
    let estimator = "now estimator gauss-newton (it was estimator adaptive), ";
    says(&output, [exposure, estimator]);
    // Back to auto.
    scope(&sensor, &[(2, Key::Char('a')), (2, Key::Quit)]);
    assert_eq!(sensor.state().settings().exposure, ExposureMode::Auto);
}

#[test]
fn a_key_sets_the_region_around_the_spot_and_widens_it() {
    let sensor = StandIn::new(6);
    let keys = ['r', 'r', 'z', 'R', 'r'].map(|key| (2, Key::Char(key)));
    let (seen, output) = scope(&sensor, &[&keys[..], &[(2, Key::Quit)]].concat());
    // Twelve widths of 8.006 px to both sides of 1800.25, and twice that.
    for (picture, region) in [
        (1, "1703 1896"),
        (2, "1606 1993"),
        (3, "1606 1993"),
        (5, "1703 1896"),
    ] {
        let words = format!("estimator adaptive, region {region}, ");
        // The whole spot is in it.
        says(&seen[picture], [&*words, "px, u 0.014 px"]);
    }
    for picture in [0, 4] {
        assert!(!seen[picture].contains(", region"), "{}", seen[picture]);
    }
    let region = sensor.state().settings().region;
    assert_eq!(Some(region), Region::new(1703, 1896));
    says(&output, ["now region 1703 1896 (it was region all), "]);
    // Wider than the row, it is all pixels again.
    let keys = [(2, Key::Char('r')); 5];
    let (_, output) = scope(&sensor, &[&keys[..], &[(2, Key::Quit)]].concat());
    says(&output, ["now region all (it was region 1703 1896), "]);
}

#[test]
fn without_a_spot_the_whole_row_is_shown_with_the_fault() {
    let sensor = StandIn::new(3);
    sensor.state().spot_height = 0.0;
    let (seen, _) = scope(&sensor, &[(3, Key::Quit)]);
    says(&seen[0], ["no spot: ", "3648"]);
    // The advice goes on in the next line, up to its end.
    says(&seen[0], ["exposure is long", "enough)"]);
}

#[test]
fn it_goes_on_after_the_cable_was_out() {
    let sensor = StandIn::new(4);
    sensor.at_steps([(300, |state| state.unplug(Duration::from_secs(2)))]);
    let (seen, _) = scope(&sensor, &[(600, Key::Quit)]);
    says(&seen[0], ["centre 1800.2"]);
}

#[test]
fn without_a_terminal_there_is_another_way() {
    let error = StandIn::new(5).refused("scope --port PORT");
    says(&error, ["`slitrange row --figure FILE`"]);
}
