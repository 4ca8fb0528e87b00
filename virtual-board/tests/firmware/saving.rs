//! Tests of `save`: saved settings and calibrations survive a power cycle. If flash is unusable, the sensor
//! does not use a calibration that might be wrong.

use slitrange_device::store::StoreError;

use super::common::*;
use super::faults::assert_all_are;
use super::kept;
use super::records::{assert_shown, eq1, longest, of_another_head, read_back, shown, upload};

/// A time longer than an erase, which takes 400 ms here.
const SAVING: Duration = Duration::from_millis(900);

fn await_answer(board: &mut VirtualBoard, wanted: &str) -> Nanos {
    let line = board.run_until_line(|line| line == wanted, 2 * SAVING);
    line.expect("an answer").at
}

#[test]
fn saved_settings_are_used_after_a_power_cycle() {
    let mut board = measuring(4);
    let own = eq1();
    upload(&mut board, &own);
    for command in ["rows 7", "mean plain", "estimator gauss-newton"] {
        set(&mut board, command);
    }
    assert_shown(&mut board, Some(&own), FlashStatus::Nothing);
    save(&mut board);
    let stored = FlashStatus::Record(own.sum());
    assert_shown(&mut board, Some(&own), stored);
    Status::ask(&mut board).assert_nothing_lost();

    // Unsaved settings are lost.
    let nominal = EncodedRecord::nominal().expect("a record");
    set(&mut board, "defaults");
    assert_shown(&mut board, Some(&nominal), stored);
    let mut board = power_cycle(board, paper());
    assert_shown(&mut board, Some(&own), stored);
    assert_eq!(read_back(&mut board), own.bytes());
    for command in "rows 7,mean plain,estimator gauss-newton,black fixed 300".split(',') {
        let (name, _) = command.split_once(' ').expect("a value");
        assert_eq!(ask(&mut board, name), command);
    }
    let reading = fresh_results(&mut board, 1).remove(0);
    println!("{reading}");
    assert!(is_reading(&reading) && reading.contains("/7 "), "{reading}");

    // Save the factory's settings. That would lose the stored calibration, so `save` does not do it.
    set(&mut board, "defaults");
    let refusal = ask(&mut board, "save");
    assert!(refusal.starts_with("E17 "), "{refusal}");
    assert_shown(&mut board, Some(&nominal), stored);
    assert_eq!(ask_in_a_pause(&mut board, "save nominal", SAVING), "save");
    let mut board = power_cycle(board, paper());
    let stored = FlashStatus::Record(nominal.sum());
    assert_shown(&mut board, Some(&nominal), stored);
    assert_eq!(ask(&mut board, "rows"), "rows 16");
    Status::ask(&mut board).assert_nothing_lost();
}

/// Saves the longest record again and again. When the first sector is full, the other one is erased. The
/// target moves during each pause.
#[test]
fn saving_pauses_the_stream_and_nothing_else() {
    let (mut board, _) = boot(spot_at(2300.4, 2000.0));
    let own = longest();
    upload(&mut board, &own);
    let mut erased = 0;
    // 9 saves fill a sector.
    for rows in (1..=8).cycle().take(13) {
        set(&mut board, &format!("rows {rows}"));
        fresh_results(&mut board, 1);
        board.flash().take_history();
        board.take_lines();
        board.send("save\r\n");
        let paused = await_answer(&mut board, "save pauses the stream");
        let centre = 2300.4 + 10.0 * f64::from(rows);
        board.set_light(spot_at(centre, 2000.0));
        let done = await_answer(&mut board, "save");
        board.run_until_rows(40, PATIENCE).expect("rows");

        let lasted = (done - paused) / 1_000_000;
        let operations = board.flash().operation_count();
        println!("{rows} rows in a frame: {lasted} ms, {operations} operations");
        // 1.8 KB of words (with the store's own), and perhaps an erase, which takes 400 ms.
        assert!((450..475).contains(&operations), "{operations}");
        erased += usize::from(lasted > 350);
        let mut results = board.take_lines();
        results.retain(|line| is_result(&line.text) && line.at >= paused);
        let is_after = results.iter().all(|line| line.at > done);
        assert!(is_after && results.len() >= 4, "{results:#?}");
        // No frame has rows from before and after the pause. One old result may have waited for the serial
        // line.
        for line in &results[1..] {
            assert!(is_reading(&line.text), "{results:#?}");
            let found = number(&line.text, " x ", " a ");
            assert!((found - centre).abs() < 0.2, "{results:#?}");
        }
    }
    assert_eq!(erased, 2);
    board.flash().take_history();
    save(&mut board);
    let again = board.flash().operation_count();
    assert_eq!(again, 0, "just that was saved already");
    assert_no_reset(&mut board);
    Status::ask(&mut board).assert_nothing_lost();
    let mut board = power_cycle(board, paper());
    assert_shown(&mut board, Some(&own), FlashStatus::Record(own.sum()));
    assert_eq!(ask(&mut board, "rows"), "rows 5");
}

/// The longest frame takes 365 ms and the erase another 400 ms. The watchdog must not reset the chip.
#[test]
fn the_watchdog_waits_for_an_erase() {
    let mut board = measuring(64);
    for command in ["distance", "centre"] {
        board.send(&format!("{command}\r\n"));
    }
    // Run until just before the frame's end.
    fresh_results(&mut board, 1);
    run_ms(&mut board, 330);
    save(&mut board);
    let reading = fresh_results(&mut board, 1).remove(0);
    assert!(reading.contains(" n 64/64 "), "{reading}");
    board.run_for(2 * PATIENCE).expect("a run");
    assert_no_reset(&mut board);
    Status::ask(&mut board).assert_nothing_lost();
}

/// The longest times of the data sheet: a word takes 100 us and an erase 800 ms. No row is lost, and the
/// watchdog resets nothing, with its fastest clock.
#[test]
fn the_slowest_flash_loses_no_row_and_makes_no_reset() {
    let conditions = conditions(|it| {
        (it.flash_word, it.flash_erase, it.watchdog_hz) = (100_000, 800_000_000, 47_000);
    });
    let (mut board, _) = boot_under(spot_at(2300.4, 2000.0), conditions);
    upload(&mut board, &longest());
    let mut slowest = 0;
    // 9 saves fill a sector.
    for rows in 1..=10 {
        set(&mut board, &format!("rows {rows}"));
        board.send("save\r\n");
        let paused = await_answer(&mut board, "save pauses the stream");
        let lasted = (await_answer(&mut board, "save") - paused) / 1_000_000;
        println!("{rows} rows in a frame: {lasted} ms");
        // Some 450 words.
        assert!(lasted >= 45, "{lasted}");
        slowest = slowest.max(lasted);
    }
    assert!((845..1100).contains(&slowest), "{slowest} ms");
    fresh_results(&mut board, 1);
    assert_no_reset(&mut board);
    Status::ask(&mut board).assert_nothing_lost();
    let mut board = power_cycle(board, paper());
    assert_eq!(ask(&mut board, "rows"), "rows 10");
}

/// The core's register that switches interrupts off (NVIC_ICER0), and the bit of flash's interrupt (RM0090
/// table 62).
const FLASH_INTERRUPT_OFF: (u64, u32) = (0xE000_E180, 1 << 4);

/// A flipped bit switches flash's interrupt off, so the firmware never learns that the erase has ended.
#[test]
fn the_watchdog_resets_if_the_flash_never_answers() {
    let mut board = measuring(4);
    fresh_results(&mut board, 1);
    board.send("save\r\n");
    await_text(&mut board, "save pauses the stream");
    run_ms(&mut board, 100);
    let (register, word) = FLASH_INTERRUPT_OFF;
    board.probe_writes(register, word);
    let banner = board.run_until_line(|line| line.contains("slitrange "), 3 * PATIENCE);
    let banner = banner.expect("a banner");
    assert!(banner.text.ends_with("started by watchdog"), "{banner}");
    let shown = shown(&mut board);
    assert_eq!(shown[shown.len() - 1], "calibration stored none");
    save(&mut board);
}

/// No operation reaches the flash.
#[test]
fn a_failed_save_is_reported_and_the_old_configuration_is_kept() {
    let mut board = measuring(4);
    let own = eq1();
    upload(&mut board, &own);
    save(&mut board);
    upload(&mut board, &longest());
    board.flash().cut_power_after(0);
    let refusal = Refusal::NotSaved(StoreError::Worn).to_string();
    assert_eq!(ask_in_a_pause(&mut board, "save", SAVING), refusal);
    let stored = FlashStatus::Record(own.sum());
    assert_shown(&mut board, Some(&longest()), stored);
    let mut board = power_cycle(board, paper());
    assert_shown(&mut board, Some(&own), stored);
    assert_eq!(ask(&mut board, "rows"), "rows 4");
}

fn damaged() -> Contents {
    Contents::new(vec![0x5A; BYTES]).expect("four sectors")
}

/// The saved configuration is unusable: the sensor gives only centres until a person decides.
#[test]
fn without_a_usable_calibration_there_is_no_distance() {
    let mut other_head = Contents::erased();
    let configuration = kept::configuration(of_another_head(), 5, Mean::Plain);
    kept::save(&mut other_head, &configuration);
    for (contents, stored, rows) in [
        (damaged(), FlashStatus::Damaged, 16),
        (other_head, FlashStatus::OtherSensor, 5),
    ] {
        let mut board = boot_with(&SharedFlash::holding(contents), paper());
        assert_shown(&mut board, None, stored);
        assert_eq!(ask(&mut board, "rows"), format!("rows {rows}"));
        assert_all_are(&fresh_results(&mut board, 2), "not calibrated");
        let centre = ask(&mut board, "centre");
        // The centre of the nominal geometry at 0.80 m.
        let off = number(&centre, "x ", " u") - 1771.0;
        assert!(off.abs() < 0.1, "{centre}");
        for command in ["calibration on", "calibration data 0", "save"] {
            let refusal = Refusal::NoCalibration { has_nominal: true }.to_string();
            assert_eq!(ask(&mut board, command), refusal, "{command}");
        }
        assert_eq!(board.flash().operation_count(), 0);

        let own = eq1();
        upload(&mut board, &own);
        assert_shown(&mut board, Some(&own), stored);
        assert!(is_reading(&fresh_results(&mut board, 1)[0]));
        save(&mut board);
        let mut board = power_cycle(board, paper());
        assert_shown(&mut board, Some(&own), FlashStatus::Record(own.sum()));
    }
}

/// `defaults` is the other way to get distances again.
#[test]
fn defaults_brings_back_the_nominal_calibration() {
    let mut board = boot_with(&SharedFlash::holding(damaged()), paper());
    set(&mut board, "defaults");
    let nominal = EncodedRecord::nominal().expect("a record");
    assert_shown(&mut board, Some(&nominal), FlashStatus::Damaged);
    save(&mut board);
    let mut board = power_cycle(board, paper());
    let stored = FlashStatus::Record(nominal.sum());
    assert_shown(&mut board, Some(&nominal), stored);
    assert_readings(&fresh_results(&mut board, 1));
}
