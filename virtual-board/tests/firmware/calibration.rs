//! Calibrations that come over the serial line: what was sent is used as the core uses it, or nothing changes.

use slitrange::black_level::BlackLevel;
use slitrange::calibration::Calibration;
use slitrange::calibration::date::Date;
use slitrange::calibration::knots::{Interpolation, Knot};
use slitrange::calibration::record::Record;
use slitrange::calibration::residuals::Corrected;
use slitrange::calibration::table::Table;
use slitrange::calibration::written::Written;
use slitrange::estimator::Estimator;
use slitrange::measurement::{Measurement, Settings};
use slitrange::protocol::calibration::{Shown, Stored};
use slitrange::protocol::piece::{PIECE, Piece};
use slitrange::protocol::refusal::Refusal;
use slitrange::triangulation::NOMINAL;
use slitrange::units::{Counts, Micrometres, Pixels};
use slitrange::{frame, sensor_heads};
use virtual_board::VirtualBoard;

use crate::common::{
    Status, ask, ask_for_lines, fresh_results, is_reading, measuring, number, set,
};

/// The record of a sensor of its own with that calibration.
pub fn record(calibration: Calibration) -> Record {
    Record {
        serial_number: 4711,
        date: Date::new(2026, 11, 21).expect("a day"),
        geometry: sensor_heads::tcd1304dg(),
        estimator: Estimator::Adaptive,
        black_level: BlackLevel::Fixed(Counts::from_int(300)),
        calibration,
    }
}

fn written(record: Record) -> Written {
    Written::new(record).expect("a record")
}

/// Knots all over the nominal range: `values` at evenly spaced centres, of which none is a round number.
fn knots(count: usize, value: impl Fn(Pixels) -> Micrometres) -> Vec<Knot> {
    let (first, last) = (1191.0, 2654.0);
    (0..count)
        .map(|i| {
            let centre = first + (last - first) * i as f64 / (count - 1) as f64;
            let centre = Pixels::from_f32(centre as f32);
            Knot {
                centre,
                value: value(centre),
            }
        })
        .collect()
}

/// A calibration of each kind, the longest of its kind.
pub fn calibrations() -> [Calibration; 4] {
    let nominal = NOMINAL.expect("a curve");
    let (first, last) = nominal.valid();
    let distance = |centre: Pixels| {
        let inside = centre.max(first).min(last);
        nominal.distance_at(inside).expect("in range").0
    };
    // Bent by a third of a millimetre, and as long as numbers get.
    let residual =
        |centre: Pixels| Micrometres::from_f32(300.7 * (centre.to_f32() / 211.3).sin() - 5000.0);
    let table = |interpolation: Interpolation| {
        let knots = knots(interpolation.most(), distance);
        Calibration::Table(Table::new(interpolation, &knots).expect("a table"))
    };
    let corrected = |interpolation: Interpolation| {
        let knots = knots(interpolation.most(), residual);
        let corrected = Corrected::new(nominal.clone(), interpolation, &knots);
        Calibration::Corrected(corrected.expect("usable"))
    };
    [
        table(Interpolation::Linear),
        table(Interpolation::Cubic),
        corrected(Interpolation::Cubic),
        corrected(Interpolation::Linear),
    ]
}

fn pieces(bytes: &[u8]) -> Vec<Piece> {
    (0..bytes.len())
        .step_by(PIECE)
        .map(|offset| Piece::of(bytes, offset as u16).expect("a piece"))
        .collect()
}

/// Sends all of a record but the commit.
fn send(board: &mut VirtualBoard, bytes: &[u8]) {
    set(board, &format!("calibration begin {}", bytes.len()));
    for piece in pieces(bytes) {
        set(board, &piece.to_string());
    }
}

pub fn upload(board: &mut VirtualBoard, written: &Written) {
    send(board, written.bytes());
    set(board, "calibration commit");
}

/// The record in use, read piece by piece.
fn read_back(board: &mut VirtualBoard) -> Vec<u8> {
    let shown = ask_for_lines(board, "calibration", 11);
    let length = number(&shown[3], "calibration record ", " ") as usize;
    let mut bytes = Vec::new();
    while bytes.len() < length {
        let offset = bytes.len() as u16;
        let line = ask(board, &format!("calibration data {offset}"));
        let words: Vec<&str> = line.split(' ').collect();
        let ["calibration", "data", offset, digits, sum] = words[..] else {
            panic!("{line}");
        };
        let piece = Piece::parse(offset, digits, sum).expect("a piece");
        bytes.extend_from_slice(piece.bytes());
    }
    bytes
}

/// The answer to `calibration` with that record in use.
fn assert_shown(board: &mut VirtualBoard, written: &Written, stored: Stored) {
    let shown = Shown {
        written: Some(written),
        on: true,
        stored,
    }
    .to_string();
    let lines: Vec<&str> = shown.split("\r\n").collect();
    assert_eq!(ask_for_lines(board, "calibration", lines.len()), lines);
}

#[test]
fn a_sensor_without_its_own_has_the_nominal_calibration() {
    let mut board = measuring(4);
    let nominal = Written::nominal().expect("a record");
    assert_shown(&mut board, &nominal, Stored::Nothing);
    assert_eq!(read_back(&mut board), nominal.bytes());
    set(&mut board, "calibration off");
    assert!(fresh_results(&mut board, 1)[0].starts_with("f not calibrated: x "));
    assert_eq!(
        ask_for_lines(&mut board, "calibration", 11)[0],
        "calibration off"
    );
    set(&mut board, "calibration on");
    assert!(is_reading(&fresh_results(&mut board, 1)[0]));
    let bytes = nominal.bytes().len();
    let offset = bytes as u16;
    assert_eq!(
        ask(&mut board, &format!("calibration data {offset}")),
        Refusal::NoPiece { offset, bytes }.to_string()
    );
    board.finish().expect("a clean run");
}

/// The settings that a record brings, and the board's other ones.
fn settings(record: &Record, rows: u16) -> Settings {
    Settings {
        rows,
        mean: frame::Mean::default(),
        estimator: record.estimator,
        black_level: record.black_level,
    }
}

/// Each kind at its longest: it is sent while readings stream, and read back; then each frame's line is the one that the core makes on
/// this PC from the words that the sensor head sent.
#[test]
fn what_was_sent_is_what_readings_are_made_with() {
    for calibration in calibrations() {
        let mut board = measuring(8);
        board.head(|head| head.keep_all_rows(true));
        let written = written(record(calibration));
        println!("{} bytes", written.bytes().len());
        upload(&mut board, &written);
        assert_shown(&mut board, &written, Stored::Nothing);
        assert_eq!(read_back(&mut board), written.bytes());
        assert_eq!(ask(&mut board, "estimator"), "estimator adaptive");
        assert_eq!(ask(&mut board, "black"), "black fixed 300");
        assert!(
            ask_for_lines(&mut board, "info", 8)
                .contains(&"info serial number 4711, calibrated 2026-11-21".to_owned())
        );

        let lines = fresh_results(&mut board, 12);
        let rows: Vec<_> = board.head(|head| head.rows().cloned().collect());
        let record = written.record();
        // Frames begin with whichever row was the first with these settings.
        let same = (0..8)
            .map(|first| {
                let mut measurement =
                    Measurement::new(sensor_heads::tcd1304dg(), settings(record, 8));
                rows[first..]
                    .iter()
                    .filter_map(|row| measurement.row(&mut row.words.clone()))
                    .map(|result| {
                        let measured = result.expect("a centre");
                        let reading = measured.reading(Some(&record.calibration));
                        reading.expect("a distance").to_string()
                    })
                    .collect::<Vec<String>>()
            })
            .any(|pc| pc.windows(lines.len()).any(|window| window == lines));
        assert!(same, "the PC nowhere says {lines:#?}");
        Status::ask(&mut board).assert_none(&["rows lost", "rows failed", "lines dropped"]);
        board.finish().expect("a clean run");
    }
}
