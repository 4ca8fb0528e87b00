//! `slitrange head measure`, on simulated heads whose numbers nobody knows.

use judges::frames::words;
use simulator::scene::Motion;
use slitrange::Geometry;
use slitrange::row::front_end::{Estimate, FrontEnd};

use super::stand_in::{SimulatedHead, StandIn, Trouble};
use crate::command::*;

/// How the pixels of the heads that are not clean differ in the dark, in counts.
const PATTERN: f64 = 5.0;

/// What a simulated head has, as `head measure` should find it.
#[derive(Clone, Copy, Debug)]
struct Truth {
    polarity: Polarity,
    gain: f64,
    read_noise: f64,
    saturation: f64,
    black_level: f64,
}

/// White paper that is brighter than usual: its spot has 70,000 counts at the longest exposure.
const BRIGHT: f64 = 12.5e6;

/// A head whose numbers differ from the nominal ones by up to a factor of two. Every second one has ambient
/// light, pixels that differ, and charge that flows over.
fn head(number: u64) -> (Scene, Truth) {
    let mut random = ChaCha8Rng::seed_from_u64(number);
    let amplification = random.random_range(0.7..1.8);
    let electrons = random.random_range(6.0..18.0);
    let read_noise = random.random_range(2.0..8.0);
    let offset = random.random_range(-100.0..150.0);
    let rail = random.random_range(2000.0..3900.0);
    let is_clean = number.is_multiple_of(2);
    let flaws = match is_clean {
        true => String::new(),
        false => format!(
            "ambient = {{ counts_per_second = 10e3, slope = 2.0 }}
            response.deviation = 0.028
            fixed_pattern.counts = {PATTERN:?}
            saturation = {{ full_well = 6000.0, blooming = 0.1 }}"
        ),
    };
    let effects = format!(
        "shot_noise.electrons_per_count = {electrons}
        read_noise.counts = {read_noise}
        front_end = {{ gain = {amplification}, offset = {offset}, saturation = {rail} }}
        {flaws}"
    );
    let scene = Scene::white_paper().listing(&effects).expect("a scene");
    let scene = with(scene, |it| {
        (it.seed, it.spot) = (number, Some(Spot::new(8.6, BRIGHT)));
    });
    let truth = Truth {
        polarity: match number % 3 {
            0 => Polarity::Rising,
            _ => Polarity::Falling,
        },
        gain: electrons / amplification,
        read_noise,
        saturation: rail,
        black_level: 300.0 + offset,
    };
    (scene, truth)
}

const MEASURE: &str = "head measure --port PORT";
const NO_SAVE: &str = "head measure --port PORT --no-save";

fn sensor(scene: Scene, polarity: Polarity) -> StandIn {
    let sensor = StandIn::new(1);
    sensor.state().light = Some(SimulatedHead::new(scene, polarity));
    sensor
}

fn recorded(sensor: &StandIn) -> FrontEnd {
    found(sensor).expect("a front end")
}

/// What the sensor's record says of its front end.
fn found(sensor: &StandIn) -> Option<FrontEnd> {
    sensor.state().record()?.record().front_end
}

/// A record with this serial number, and otherwise the one in use.
fn with_number(sensor: &StandIn, serial_number: u32) -> EncodedRecord {
    let mut record = sensor.state().record().expect("a record").record().clone();
    record.serial_number = serial_number;
    EncodedRecord::new(record).expect("a record")
}

fn without_front_end(record: &EncodedRecord) -> Record {
    with(record.record().clone(), |it| it.front_end = None)
}

/// Errors in percent of the value, and over the claimed uncertainty.
fn compare(found: &FrontEnd, truth: &Truth) -> [(&'static str, f64, f64); 4] {
    let counts = |it: Estimate<Counts>| (it.value.to_f64(), it.u.to_f64());
    let (black, black_u) = counts(found.black_level);
    // A pixel differs from the 13 shielded ones, and counts of the record have 1/256 as a step.
    let black = (black, black_u.hypot(PATTERN / 13f64.sqrt()));
    let gain = (found.gain.value.to_f64(), found.gain.u.to_f64());
    let saturation = counts(found.saturation.expect("a saturation"));
    [
        ("gain", truth.gain, gain),
        ("read noise", truth.read_noise, counts(found.read_noise)),
        ("saturation", truth.saturation, saturation),
        ("black level", truth.black_level, black),
    ]
    .map(|(name, truth, (value, u))| (name, 100.0 * (value - truth) / truth, (value - truth) / u))
}

/// Twelve unknown heads: each number within 5 %, and within four of its uncertainties.
#[test]
fn unknown_heads_are_measured_to_five_percent() {
    for number in 0..12 {
        let (scene, truth) = head(number);
        let sensor = sensor(scene, truth.polarity);
        sensor.done(NO_SAVE);
        let found = recorded(&sensor);
        assert_eq!(found.polarity, truth.polarity);
        for (name, percent, over_u) in compare(&found, &truth) {
            println!("head {number}: {name} off by {percent:.2} %, {over_u:.2} u");
            assert!(percent.abs() < 5.0, "head {number}: {name}");
            assert!(over_u.abs() < 4.0, "head {number}: {name}");
        }
    }
}

/// Errors over r, root mean square of many readings. The exposure gives the spot half of its room.
fn pull(scene: &Scene, polarity: Polarity, geometry: &Geometry, truth: &Truth) -> f64 {
    const FRAMES: u64 = 1500;
    let options = with(Options::default(), |it| it.rows = 4);
    let mut measurement = Measurement::new(geometry.clone(), options);
    let simulation = Simulation::new(scene.clone());
    let spot = scene.spot.expect("a spot");
    let amplification = scene.front_end.expect("a front end").gain;
    let room = truth.saturation - truth.black_level;
    let laser = 0.5 * room / (amplification * spot.counts_per_second);
    let times = simulator::scene::Exposure {
        row: 5.7e-3,
        laser,
        laser_before: laser,
    };
    let calibration = Calibration::nominal().expect("a curve");
    let errors = CalibrationErrors::Unknown;
    let mut of_outputs = scene.geometry();
    of_outputs.polarity = polarity;
    let true_centre = simulation.true_centre(0, scene.distance);
    let (mut squares, mut readings) = (0.0, 0.0);
    for row in 0..4 * FRAMES {
        let mut words = words(&simulation.row(row, scene.distance, times), &of_outputs);
        let Some(result) = measurement.row(&mut words) else {
            continue;
        };
        let measured = result.expect("a centre");
        let reading = measured.reading(Some(&calibration), &errors, Surface::Off);
        let reading = reading.expect("in range");
        let (_, um_per_pixel) = calibration.distance_at(reading.centre).expect("in range");
        let error = (reading.centre.to_f64() - true_centre) * f64::from(um_per_pixel);
        squares += (error / reading.parts.noise.to_f64()).powi(2);
        readings += 1.0;
    }
    assert_eq!(readings, FRAMES as f64);
    (squares / readings).sqrt()
}

/// After `head measure`, the noise that readings claim is the noise that they have. Before it, a head whose
/// counts have other electrons than assumed claims too much or too little.
#[test]
fn readings_claim_their_noise_after_a_measurement() {
    for number in [0, 2, 4, 6] {
        let (scene, truth) = head(number);
        let sensor = sensor(scene.clone(), truth.polarity);
        sensor.done(NO_SAVE);
        let found = recorded(&sensor);
        // What the firmware assumes: 10 electrons a count, and saturation at full scale.
        let mut assumed = scene.sensor.geometry();
        assumed.polarity = truth.polarity;
        let before = pull(&scene, truth.polarity, &assumed, &truth);
        let after = pull(&scene, truth.polarity, &found.geometry(&assumed), &truth);
        println!(
            "head {number}, {:.1} electrons a count: errors over r {before:.3} before, {after:.3} after",
            truth.gain
        );
        // The pull of 1500 readings is known to 1.8 %.
        assert!((0.95..1.05).contains(&after), "head {number}");
        if truth.gain < 5.0 {
            assert!(before > 1.05, "head {number}");
        }
    }
}

#[test]
fn settings_and_calibration_stay_and_the_figure_is_drawn() {
    let (scene, truth) = head(1);
    let sensor = sensor(scene, truth.polarity);
    let lines = "exposure 187; exposure limit 2000; ambient subtract; estimator phase-table; black fixed 290; \
                 rows 8";
    sensor.state().type_lines(lines);
    let settings = sensor.state().settings();
    let record = sensor.state().record();
    let figured = "head measure --port PORT --csv @transfer.csv --figure @transfer.svg";
    says(&sensor.done(&format!("{figured} --dry-run")), ["a dry run"]);
    assert_eq!(sensor.state().record(), record);
    assert_eq!(sensor.state().settings(), settings);
    let parts = [
        "sensor TCD1304DG at ",
        "laser off: 4 rows",
        "gain ",
        "(until now 10.00)",
        "read noise ",
        "saturation ",
        "black level ",
        "the words fall with light",
        "in use and saved",
    ];
    says(&sensor.done(figured), parts);
    assert_eq!(sensor.state().settings(), settings);
    let saved = sensor.state().saved_record();
    assert_eq!(sensor.state().record(), saved);
    let (before, after) = (record.expect("a record"), saved.expect("a record"));
    assert!(after.record().front_end.is_some());
    assert_eq!(&without_front_end(&after), before.record());
    let table = sensor.text("transfer.csv");
    begins(&table, "signal_counts,variance_counts2,");
    assert!(table.lines().count() > 500);
    let titles = ["noise over light", "top of the spot", "saturated"];
    says(&sensor.text("transfer.svg"), titles);

    // A calibration without a front end leaves the one that was measured.
    let own = EncodedRecord::new(Record {
        serial_number: 7,
        errors: CalibrationErrors::Unknown,
        ..before.record().clone()
    });
    sensor.write("own.record", own.expect("a record").bytes());
    let output = sensor.done("calibrate write --force --port PORT @own.record");
    let kept = "with the front end that was measured on this sensor";
    says(&output, [kept]);
    let saved = || sensor.state().saved_record().expect("a record");
    assert_eq!(saved().record().serial_number, 7);
    assert!(saved().record().front_end.is_some());

    // Measured again, with what was measured before in use.
    assert!(!sensor.done(MEASURE).contains("(until now 10.00)"));
    assert_eq!(saved().record().serial_number, 7);
}

#[test]
fn what_cannot_be_measured_is_said_and_changes_nothing() {
    let (bright, truth) = head(2);
    let moving = with(bright.clone(), |it| {
        it.motion = Some(Motion { speed: 0.05 })
    });
    let lit = |counts| bright.clone().with_height(counts);
    let limit = "exposure limit 10";
    for (scene, line, expected) in [
        (lit(5e3), "", "put a brighter target"),
        (lit(5e6), limit, "put a brighter target"),
        (lit(3e9), "", "put a darker target"),
        (lit(3e8), "", "put a darker target"),
        (bright.clone(), "laser off", "type `laser on`"),
        (moving, "", "check that the target is at rest"),
    ] {
        let sensor = sensor(scene, truth.polarity);
        sensor.state().type_line(line);
        let held = || {
            let state = sensor.state();
            (state.settings(), state.record())
        };
        let before = held();
        says(&sensor.refused(MEASURE), [expected]);
        assert_eq!(held(), before);
    }
    // A dimmer target: the gain is measured, the saturation is not.
    let sensor = sensor(lit(150e3), truth.polarity);
    says(&sensor.done(MEASURE), ["saturation   not measured"]);
    let found = recorded(&sensor);
    assert_eq!(found.saturation, None);
    assert!((found.gain.value.to_f64() / truth.gain - 1.0).abs() < 0.05);
}

/// The spot would reach 0.9 to 2 times the saturation: no pixel that it cuts off makes the gain wrong.
#[test]
fn a_spot_that_just_saturates_gives_the_right_gain() {
    let (scene, truth) = head(2);
    let room = truth.saturation - truth.black_level;
    let amplification = scene.front_end.expect("a front end").gain;
    for times in [0.9, 1.0, 1.05, 1.1, 1.2, 1.3, 1.4, 1.6, 2.0] {
        let counts_per_second = times * room / (amplification * 5.6e-3);
        let sensor = sensor(scene.clone().with_height(counts_per_second), truth.polarity);
        sensor.done(MEASURE);
        let found = recorded(&sensor);
        let error = found.gain.value.to_f64() - truth.gain;
        let u = found.gain.u.to_f64();
        println!(
            "{times} times: gain off by {:.2} %, {:.2} u, saturation {:?}",
            100.0 * error / truth.gain,
            error / u,
            found.saturation.map(|it| it.value.to_f64())
        );
        assert!(error.abs() < 0.05 * truth.gain, "{times}");
        assert!(error.abs() < 4.0 * u, "{times}");
        if let Some(saturation) = found.saturation {
            assert!((saturation.value.to_f64() / truth.saturation - 1.0).abs() < 0.01);
        }
    }
}

#[test]
fn echo_and_map_are_put_back() {
    let (scene, truth) = head(2);
    let sensor = sensor(scene, truth.polarity);
    sensor
        .state()
        .type_lines("laser off; flat dark; flat lit; laser on; echo on");
    sensor.done(NO_SAVE);
    assert!((recorded(&sensor).gain.value.to_f64() / truth.gain - 1.0).abs() < 0.05);
    assert!(sensor.state().settings().echo);
    assert!(sensor.state().settings().stream);
    assert!(sensor.state().is_map_on());
}

#[test]
fn ctrl_c_ends_the_measurement_in_order() {
    let (scene, truth) = head(2);
    let sensor = sensor(scene, truth.polarity);
    let lines = "laser off; flat dark; flat lit; laser on; ambient subtract; exposure 700";
    sensor.state().type_lines(lines);
    let before = sensor.state().settings();
    sensor.state().trouble.interrupted = true;
    begins(&sensor.refused(MEASURE), "ended by Ctrl-C");
    assert_eq!(sensor.state().settings(), before);
    assert!(sensor.state().is_map_on());
    assert_eq!(found(&sensor), None);
}

/// A tool that dies at any moment leaves the flash as it was, or with all that was measured.
#[test]
fn a_tool_that_is_killed_loses_no_calibration() {
    let (scene, truth) = head(2);
    let own = with_number(&sensor(scene.clone(), truth.polarity), 9);
    let mut ends = 0;
    for uses in [
        3, 30, 300, 1000, 2000, 2400, 2500, 2600, 2700, 2800, 2900, 3000, 9000,
    ] {
        let sensor = sensor(scene.clone(), truth.polarity);
        sensor.state().start_with(Some(own.clone()));
        sensor.state().trouble.kill_after = Some(uses);
        let ended = sensor.ends_before_it_is_killed(|| sensor.run(MEASURE).0.is_ok());
        ends += usize::from(ended);
        let saved = sensor.state().saved_record().expect("a record");
        let front_end = saved.record().front_end;
        assert_eq!(saved.record().serial_number, 9);
        assert!(front_end.is_some() || !ended, "{uses}");
        assert_eq!(&without_front_end(&saved), own.record(), "{uses}");
    }
    println!("{ends} of 13 ended");
    assert!((1..13).contains(&ends));
}

/// A sensor that was set to the nominal calibration for a while keeps its own in flash.
#[test]
fn a_calibration_in_flash_is_not_replaced_by_the_nominal_one() {
    let (scene, truth) = head(2);
    let sensor = sensor(scene, truth.polarity);
    let own = with_number(&sensor, 9);
    sensor.state().start_with(Some(own));
    sensor.state().type_line("defaults");
    says(&sensor.refused(MEASURE), ["which would be lost"]);
    let saved = sensor.state().saved_record().expect("a record");
    assert_eq!(saved.record().serial_number, 9);
}

#[test]
fn a_noisy_line_gives_the_same_front_end() {
    let (scene, truth) = head(4);
    let sensor = sensor(scene, truth.polarity);
    sensor.state().trouble = Trouble::of_line(0.002, 0.002);
    sensor.done(MEASURE);
    for (name, _, over_u) in compare(&recorded(&sensor), &truth) {
        println!("{name}: {over_u:.2} u");
        assert!(over_u.abs() < 4.0, "{name}");
    }
}
