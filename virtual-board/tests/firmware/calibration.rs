//! Tests of calibrations over the serial line: the firmware uses the uploaded calibration as the core does,
//! or nothing changes.

use slitrange::frame::comb::Comb;
use slitrange_device::record::RecordError;

use super::common::*;
use super::identical::lines_of_pc;
use super::records::{
    CENTRE, assert_shown, eq1, every_kind, longest, of_another_head, of_comb, pieces, read_back,
    record, send, shown, upload, written,
};

#[test]
fn an_uncalibrated_sensor_uses_the_nominal_calibration() {
    let mut board = measuring(4);
    let nominal = EncodedRecord::nominal().expect("a record");
    assert_shown(&mut board, Some(&nominal), FlashStatus::Nothing);
    assert_eq!(read_back(&mut board), nominal.bytes());
    set(&mut board, "calibration off");
    assert!(fresh_results(&mut board, 1)[0].starts_with("f not calibrated: x "));
    assert_eq!(shown(&mut board)[0], "calibration off");
    set(&mut board, "calibration on");
    assert!(is_reading(&fresh_results(&mut board, 1)[0]));
}

/// Uploads each kind of calibration while readings stream, and reads it back. Then each frame's line is the
/// line that the core gives on this PC for the same words of the sensor head.
#[test]
fn readings_use_the_uploaded_calibration() {
    let mut board = measuring_in(spot_at(CENTRE, 2000.0), 6);
    keep_all_rows(&mut board);
    for written in every_kind() {
        println!("{} bytes", written.bytes().len());
        set(&mut board, "defaults");
        set(&mut board, "rows 6");
        upload(&mut board, &written);
        assert_shown(&mut board, Some(&written), FlashStatus::Nothing);
        assert_eq!(read_back(&mut board), written.bytes());
        assert_eq!(ask(&mut board, "estimator"), "estimator adaptive");
        assert_eq!(ask(&mut board, "black"), "black fixed 300");
        let info = ask_for_lines(&mut board, "info", 11).join("\n");
        assert!(info.contains("\ninfo serial number 4000000711, calibrated 2026-11-21"));

        let lines = fresh_results(&mut board, 5);
        println!("{}", lines[4]);
        assert_readings(&lines);
        let rows = kept_rows(&mut board);
        // The rows of these lines are among the last rows.
        let last = &rows[rows.len() - 60..];
        assert!(agree(&lines, last, &written), "{lines:#?}");
    }
    Status::ask(&mut board).assert_nothing_lost();
}

/// Uploads and saves the record of a comb, and cuts the power. Then readings use the record's slits, as the
/// core does on this PC.
#[test]
fn readings_use_the_slits_of_a_saved_comb() {
    let scene = Scene::load("comb").expect("a scene");
    let mut board = measuring_in(of_scene(scene, Target::at(0.8)), 6);
    let written = of_comb();
    upload(&mut board, &written);
    assert_eq!(ask(&mut board, "slits"), "slits comb");
    save(&mut board);
    press_reset(&mut board);
    let stored = FlashStatus::Record(written.sum());
    assert_shown(&mut board, Some(&written), stored);
    assert!(shown(&mut board).contains(&"calibration slits 16".to_owned()));
    assert_eq!(read_back(&mut board), written.bytes());
    assert_eq!(ask(&mut board, "slits"), "slits comb");
    keep_all_rows(&mut board);
    let lines = fresh_results(&mut board, 5);
    println!("{}", lines[4]);
    assert_readings(&lines);
    for line in &lines {
        assert!(line.contains(" k 1") && !line.ends_with(" s"), "{line}");
    }
    let rows: Vec<_> = kept_rows(&mut board);
    assert!(agree(&lines, &rows, &written), "{lines:#?}");
    // With the mask's drawing, the distances are others.
    let drawn = with(written.record().clone(), |it| {
        it.comb = Some(Comb::nominal())
    });
    assert!(!agree(&lines, &rows, &super::records::written(drawn)));

    // The centre of each slit, in a second line.
    stop_the_stream(&mut board);
    let both = ask_for_lines(&mut board, "centre", 2);
    println!("{both:#?}");
    assert!(both[0].contains(" k 1"), "{}", both[0]);
    let images: Vec<&str> = both[1].split(' ').collect();
    assert_eq!((images[0], images.len()), ("slits", 17));
    Status::ask(&mut board).assert_nothing_lost();
}

/// The lines of frames of six rows, of which the first frame begins with the first row.
fn on_this_pc(rows: &[virtual_board::Row], written: &EncodedRecord) -> Vec<String> {
    let record = written.record();
    let options = Options {
        rows: 6,
        estimator: record.estimator,
        black_level: record.black_level,
        slits: record.slits(),
        ..Options::default()
    };
    let (calibration, comb) = (Some(&record.calibration), record.comb.clone());
    lines_of_pc(rows, options, calibration, &record.errors, comb)
}

/// Whether the PC says these lines too, with this record. A frame begins with one of the first six rows.
fn agree(lines: &[String], rows: &[virtual_board::Row], written: &EncodedRecord) -> bool {
    (0..6).any(|first| {
        let pc = on_this_pc(&rows[first..], written);
        pc.windows(lines.len()).any(|window| window == lines)
    })
}

fn in_use(board: &mut VirtualBoard) -> Vec<String> {
    let mut all = shown(board);
    all.extend(["estimator", "black", "rows"].map(|command| ask(board, command)));
    all
}

fn assert_refused(board: &mut VirtualBoard, command: &str, refusal: Refusal) {
    assert_eq!(ask(board, command), refusal.to_string(), "{command}");
}

/// Provokes each refusal at each step of an upload. After all of them, the old calibration is still in use.
#[test]
fn a_refused_upload_changes_nothing() {
    let mut board = measuring(4);
    upload(&mut board, &eq1());
    set(&mut board, "estimator gauss-newton");
    let before = in_use(&mut board);

    let other = written(record(longest().record().calibration.clone()));
    let (bytes, commit) = (other.bytes(), "calibration commit");
    let all = pieces(bytes);
    assert_refused(&mut board, commit, Refusal::NoUpload);
    assert_refused(&mut board, &all[0].to_string(), Refusal::NoUpload);

    // Half of the record, with wrong pieces in between.
    let announced = bytes.len();
    set(&mut board, &format!("calibration begin {announced}"));
    set(&mut board, &all[0].to_string());
    for (at, piece) in all.iter().enumerate().take(8).skip(1) {
        let expected = 16 * at;
        let (skipped, offset) = (&all[at + 2], 16 * (at + 2));
        let wrong = Refusal::WrongOffset { offset, expected };
        assert_refused(&mut board, &skipped.to_string(), wrong);
        set(&mut board, &piece.to_string());
        // A repeated piece is accepted: the answer to the first one may have been lost.
        set(&mut board, &piece.to_string());
    }
    // A digit of the next piece is wrong.
    let garbled = all[8].to_string().replacen(" 128 ", " 129 ", 1);
    let answer = ask(&mut board, &garbled);
    assert!(answer.starts_with("E7 checksum "), "{answer}");
    let (came, beyond) = (128, Piece::new(announced as u16, &[0]).expect("a piece"));
    let end = announced + 1;
    let too_long = Refusal::TooLong { end, announced };
    assert_refused(&mut board, &beyond.to_string(), too_long);
    assert_refused(&mut board, commit, Refusal::Incomplete { came, announced });
    assert_eq!(in_use(&mut board), before);
    set(&mut board, "calibration abort");
    assert_refused(&mut board, commit, Refusal::NoUpload);

    // A whole record in which a bit was wrong before it was divided into pieces.
    let mut damaged = eq1().bytes().to_vec();
    damaged[20] ^= 0x10;
    send(&mut board, &damaged);
    let answer = ask(&mut board, commit);
    let damage = "E12 the record is damaged, its CRC is ";
    assert!(answer.starts_with(damage), "{answer}");
    assert_refused(&mut board, commit, Refusal::NoUpload);
    send(&mut board, &[1, 2, 3]);
    let short = Refusal::Record(RecordError::Short { bytes: 3 });
    assert_refused(&mut board, commit, short);

    send(&mut board, written(of_another_head()).bytes());
    assert_refused(&mut board, commit, Refusal::OtherSensor);

    let (offset, bytes) = (eq1().bytes().len() as u16, eq1().bytes().len());
    let no_piece = Refusal::NoPiece { offset, bytes };
    assert_refused(&mut board, &format!("calibration data {offset}"), no_piece);
    assert_eq!(in_use(&mut board), before);
    assert_readings(&fresh_results(&mut board, 2));
    Status::ask(&mut board).assert_nothing_lost();
}

/// One byte in fifty is garbled. The test repeats each line until the answer is right.
#[test]
fn an_upload_over_a_noisy_line_arrives_whole() {
    let mut board = measuring(4);
    stop_the_stream(&mut board);
    garble(&mut board, 10_000, 10_000);
    let [_, _, cubic, ..] = every_kind();
    let bytes = cubic.bytes();
    let mut lines = vec![format!("calibration begin {}", bytes.len())];
    lines.extend(pieces(bytes).iter().map(Piece::to_string));
    let mut again = 0;
    for line in &lines {
        while ask(&mut board, line) != *line {
            again += 1;
            assert!(again < 10 * lines.len(), "{line}");
            // The rest of the garbled line, with or without an answer.
            board.send("\r\n");
            board.run_for(PATIENCE / 20).expect("a run");
            board.take_lines();
        }
    }
    garble(&mut board, 0, 0);
    println!("{} lines, {again} sent again", lines.len());
    assert!(again >= 10, "{again}");
    set(&mut board, "calibration commit");
    assert_eq!(read_back(&mut board), bytes);
}

#[test]
fn defaults_restores_the_state_of_a_new_sensor() {
    let mut board = measuring(4);
    set(&mut board, "defaults");
    let new = in_use(&mut board);
    assert_eq!(new.last().map(String::as_str), Some("rows 16"));
    upload(&mut board, &eq1());
    for command in ["rows 3", "mean plain", "black frame", "calibration off"] {
        set(&mut board, command);
    }
    assert_ne!(in_use(&mut board), new);
    set(&mut board, "defaults");
    assert_eq!(in_use(&mut board), new);
    assert_eq!(ask(&mut board, "mean"), "mean weighted");
}

/// The centre of a spot inside and outside the range of the nominal calibration, and without a calibration.
#[test]
fn a_centre_needs_no_calibration() {
    for (centre, has_distance) in [(1800.3, true), (3000.7, false)] {
        let mut board = measuring_in(spot_at(centre, 2000.0), 4);
        for command in ["calibration on", "calibration off"] {
            set(&mut board, command);
            let streamed = fresh_results(&mut board, 1).remove(0);
            let has_distance = has_distance && command.ends_with("on");
            assert_eq!(is_reading(&streamed), has_distance, "{streamed}");
            let line = ask(&mut board, "centre");
            println!("{line}");
            assert!(line.starts_with("x "), "{line}");
            let (found, claimed) = (number(&line, "x ", " u"), number(&line, " u ", " a "));
            assert!((0.001..0.01).contains(&claimed), "{line}");
            assert!((found - centre).abs() < 5.0 * claimed, "{line}");
            assert!(line.contains(" n 4/4 b ") && line.contains(" e a w "));
            assert_eq!(line.split(' ').count(), 20, "{line}");
        }
        // Each command gives one frame's answer.
        stop_the_stream(&mut board);
        say(&mut board, "centre\r\ndistance", 250);
        let texts = take_texts(&mut board);
        let [fault, advice, centre] = &texts[..] else {
            panic!("{texts:#?}");
        };
        assert!(fault.starts_with("f not calibrated: x "), "{fault}");
        let expected = "(send `calibration on`; without a calibration, upload one, \
                        or send `defaults` (TCD1304DG only))";
        assert_eq!(advice, expected);
        assert!(centre.starts_with("x "), "{centre}");
    }
}

#[test]
fn a_frame_without_a_centre_gives_its_fault_with_advice() {
    for (height, fault) in [(0.0, "f no spot: "), (12_000.0, "f saturated: ")] {
        let (mut board, _) = boot(spot_at(1800.3, height));
        set(&mut board, "exposure 5600");
        stop_the_stream(&mut board);
        say(&mut board, "centre", 250);
        let texts = take_texts(&mut board);
        println!("{texts:?}");
        let [said, advice] = &texts[..] else {
            panic!("{texts:#?}");
        };
        assert!(said.starts_with(fault) && advice.starts_with('('));
    }
}
