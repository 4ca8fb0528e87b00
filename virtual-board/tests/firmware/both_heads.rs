//! The times of both sensor heads, and what only the S11639 has. The modules `faults`, `laser`, `row`,
//! `row_rate`, `sensor_head` and `trigger` have other tests that run with both heads.

use std::time::Duration;

use slitrange::base::units::Pixels;
use slitrange::distance::Calibration;
use slitrange::distance::eq1::{Eq1, NOMINAL};
use slitrange::row::sensor_heads::{self, S11639_LEAD_IN, TCD1304DG_LEAD_IN};
use slitrange_device::protocol::refusal::Refusal;
use slitrange_device::record::Record;
use virtual_board::board::Conditions;
use virtual_board::row_rate::highest;
use virtual_board::{Row, Sensor, SharedFlash, VirtualBoard};

use super::common::{
    PATIENCE, Status, ask, ask_for_lines, boot_with, firmware_for, fresh_results, is_result,
    measuring_with, number, paper_for, set, slower_sampling, spot_for, with_both_heads,
};
use super::records::{eq1, upload, written};

/// Rows come at the period that the firmware states, each pixel in its word and sampled in the middle of its
/// time. The laser is on as long as the row says.
fn rows_come_on_time(sensor: Sensor) {
    let lead_in = match sensor {
        Sensor::Tcd1304 => TCD1304DG_LEAD_IN,
        Sensor::S11639 => S11639_LEAD_IN,
    };
    let mut board = measuring_with(sensor, 16);
    board.run_for(Duration::from_millis(200)).expect("a run");
    board.head(|head| head.keep_all_rows(true));
    let (before, first) = (board.statistics(), board.head(|head| head.row_count()));
    board.take_lines();
    board.run_for(Duration::from_millis(500)).expect("a run");
    let after = board.statistics();
    let count = board.head(|head| head.row_count()) - first;
    let rows: Vec<Row> = board.head(|head| head.rows().cloned().collect());
    let rows = &rows[rows.len() - count as usize..];
    let period = sensor.row_period() * 1e9;

    let least = rows.iter().map(|row| row.phase.0).fold(1.0, f64::min);
    let most = rows.iter().map(|row| row.phase.1).fold(0.0, f64::max);
    let busy = (after.instructions - before.instructions) as f64
        / (168e6 * (after.seconds - before.seconds));
    println!(
        "{sensor:?}: {count} rows, sampled at {least:.3} to {most:.3} of a pixel's time, the core busy for \
         {:.1} % of the time",
        100.0 * busy
    );
    assert!(rows.iter().all(|row| row.lead_in == lead_in as i64));
    let slower = slower_sampling();
    assert!(least > 0.5 - slower && most < 0.9, "{least} to {most}");
    assert!(most - least < 0.1 + slower, "{least} to {most}");
    assert!((count as f64 - 0.5e9 / period).abs() <= 1.5, "{count} rows");
    for pair in rows.windows(2) {
        let apart = (pair[1].read_out - pair[0].read_out) as f64;
        assert!((apart - period).abs() <= 2_000.0, "{apart} ns");
    }
    let lasers: Vec<u64> = rows.iter().map(|row| row.exposure.laser).collect();
    assert!(lasers.iter().all(|&ns| ns >= 10_000), "{lasers:?}");
    let lines = board.take_lines();
    for line in lines.iter().take(3) {
        println!("{}", line.text);
    }
    // A S11639 has no calibration until its owner makes one.
    let expected = match sensor {
        Sensor::Tcd1304 => "d ",
        Sensor::S11639 => "f not calibrated: x ",
    };
    let results = lines
        .iter()
        .filter(|line| line.text.starts_with(expected))
        .count();
    // A frame may be under way at either end.
    assert!(results as u64 + 2 >= count / 16, "{results} results");
    assert_eq!(
        results,
        lines.iter().filter(|line| is_result(&line.text)).count()
    );
    let status = Status::ask(&mut board);
    println!("a row took {} cycles", status.count("row cycles"));
    status.assert_none(&["rows lost", "rows failed", "rows late", "lines dropped"]);
    board.finish().expect("a clean run");
}

/// The centre that the firmware finds is that of the light, to a twentieth of a pixel.
fn centres_are_right(sensor: Sensor) {
    let centre = 1770.3;
    let (mut board, _) = boot_with(sensor, spot_for(sensor, centre, 1500.0));
    set(&mut board, "rows 4");
    board.take_lines();
    board.run_for(Duration::from_millis(300)).expect("a run");
    let lines = board.take_lines();
    let results: Vec<f64> = (lines.iter())
        .filter(|line| is_result(&line.text))
        .map(|line| number(&line.text, "x ", " ") - centre)
        .collect();
    println!("{sensor:?}: centres are wrong by {results:.3?} px");
    assert!(results.len() > 5, "{lines:#?}");
    assert!(results.iter().all(|error| error.abs() < 0.05));
    board.finish().expect("a clean run");
}

with_both_heads! {
    rows_come_on_time
    centres_are_right
}

/// Without calibration a S11639 gives centres and no distances: the nominal one belongs to the TCD1304DG.
#[test]
#[ignore = "its firmware is a build of its own; .ci/run runs it"]
fn a_new_s11639_has_no_calibration() {
    let (mut board, banner) = boot_with(Sensor::S11639, paper_for(Sensor::S11639));
    assert!(banner.text.contains("S11639-01"), "{}", banner.text);
    assert_eq!(
        ask_for_lines(&mut board, "calibration", 2),
        ["calibration none", "calibration stored none"]
    );
    set(&mut board, "defaults");
    let refusal = Refusal::NoCalibration { has_nominal: false };
    assert_eq!(ask(&mut board, "save"), refusal.to_string());
    board.finish().expect("a clean run");
}

/// A S11639 saves its calibration with the slowest flash (data sheet), loses no row meanwhile, and has the
/// calibration after a power cycle.
#[test]
#[ignore = "its firmware is a build of its own; .ci/run runs it"]
fn a_s11639_saves_its_calibration_and_loses_no_row() {
    let centre = 1500.3;
    let nominal = NOMINAL.expect("a curve");
    let range = nominal.valid().0..=Pixels::from_int(2000);
    let curve = Eq1::new(nominal.d(), nominal.k(), nominal.pole(), range);
    let record = written(Record {
        geometry: sensor_heads::s11639(),
        calibration: Calibration::Eq1(curve.expect("a curve")),
        profile: None,
        ..eq1().record().clone()
    });
    let flash = SharedFlash::default();
    let power_on = || {
        let conditions = Conditions {
            flash_word: 100_000,
            flash_erase: 800_000_000,
            ..Conditions::default()
        };
        let light = spot_for(Sensor::S11639, centre, 2000.0);
        let firmware = firmware_for(Sensor::S11639);
        VirtualBoard::power_on_with_flash_under(firmware, light, flash.clone(), conditions)
            .expect("the board starts")
    };
    let mut board = power_on();
    board
        .run_until_line(|line| line.starts_with("slitrange "), PATIENCE)
        .expect("a banner");
    upload(&mut board, &record);
    // 9 saves fill a sector.
    for rows in 1..=10 {
        set(&mut board, &format!("rows {rows}"));
        board.send("save\r\n");
        let saved = board.run_until_line(|line| line == "save", 2 * PATIENCE);
        saved.expect("an answer");
    }
    fresh_results(&mut board, 1);
    assert_eq!(board.resets().expect("resets"), []);
    Status::ask(&mut board).assert_none(&[
        "rows lost",
        "rows failed",
        "rows late",
        "lines dropped",
    ]);
    board.finish().expect("a clean run");
    let mut board = power_on();
    let line = board.run_until_line(|line| line.starts_with("d "), PATIENCE);
    let line = line.expect("a reading");
    println!("{line}");
    let distance = nominal.distance_at(Pixels::from_f32(centre as f32));
    let off = number(&line.text, "d ", " mm") - distance.expect("in range").0.to_f64() / 1000.0;
    assert!(off.abs() < 1.0, "{line} {off}");
    board.finish().expect("a clean run");
}

#[test]
#[ignore = "a minute: prints the highest rate of rows"]
fn the_highest_rate_of_rows_of_a_s11639() {
    for rows in [1, 16, 64] {
        let rate = highest(firmware_for(Sensor::S11639), rows, 2000.0, 20_000.0, 2000);
        println!(
            "{rows} rows a frame: {:.0} rows a second",
            rate.expect("a rate")
        );
    }
}
