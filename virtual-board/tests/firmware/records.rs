//! Calibrations of every kind, with functions that upload and read them.

use judges::longest;
use slitrange::Polarity;
use slitrange::base::places::PLACES;
use slitrange::base::units::Units;
use slitrange::centre::spot_shape::COMPONENTS;
use slitrange::check::own_spot::Profile;
use slitrange::distance::eq1::{Eq1, NOMINAL};
use slitrange::distance::knots::Knot;
use slitrange::distance::residuals::Corrected;
use slitrange::distance::table::Table;
use slitrange::frame::comb::{Comb, SlitMap};
use slitrange::reading::uncertainty::{FittedErrors, FittedSurface};
use slitrange_device::protocol::calibration::CalibrationAnswer;
use slitrange_device::record::date::Date;
use virtual_board::upload;

use super::common::*;

/// A pixel inside the range of each of [`every_kind`].
pub const CENTRE: f64 = 2300.4;

/// The uncertainties of a calibration, which are the same at all places, in micrometres.
pub fn fitted(curve: i32, deviation: i32) -> CalibrationErrors {
    CalibrationErrors::Fitted(FittedErrors {
        curve: [Micrometres::from_int(curve); PLACES],
        surface: Some(FittedSurface {
            deviation: [Micrometres::from_int(deviation); PLACES],
            height: [Counts::from_int(1000); PLACES],
        }),
    })
}

/// A sensor's record with that calibration. Its settings differ from the defaults.
pub fn record(calibration: Calibration) -> Record {
    Record {
        serial_number: 4_000_000_711,
        date: Date::new(2026, 11, 21).expect("a day"),
        geometry: sensor_heads::tcd1304dg(),
        estimator: Estimator::Adaptive,
        black_level: BlackLevel::Fixed(Counts::from_int(300)),
        calibration,
        errors: fitted(40, 400),
        comb: None,
        front_end: None,
        // The board's spot is symmetric.
        profile: Some(Profile {
            first: Pixels::from_int(1200),
            last: Pixels::from_int(2600),
            width: [Pixels::from_int(8); PLACES],
            // So much that no spot differs from it.
            width_deviation: Pixels::from_int(8),
            components: [[Pixels::default(); PLACES]; COMPONENTS],
            deviation: Pixels::from_int(8),
        }),
    }
}

pub fn written(record: Record) -> EncodedRecord {
    EncodedRecord::new(record).expect("a record")
}

/// A sensor's own eq. (1): a millimetre from the nominal one.
pub fn eq1() -> EncodedRecord {
    let nominal = NOMINAL.expect("a curve");
    let (first, last) = nominal.valid();
    let d = Micrometres::from_bits(nominal.d().to_bits() + Micrometres::from_int(1000).to_bits());
    let curve = Eq1::new(d, nominal.k(), nominal.pole(), first..=last);
    written(record(Calibration::Eq1(curve.expect("a curve"))))
}

/// Eq. (1) of a sensor with a comb, whose mask differs from its drawing by up to 0.8 pixels.
pub fn of_comb() -> EncodedRecord {
    let slits: Vec<SlitMap> = (Comb::nominal().slits().iter().zip(0i32..))
        .map(|(slit, number)| {
            let of_drawing = (number * 7 % 16 - 8) as f32 / 10.0;
            slit.corrected([of_drawing, 0.3, -0.2, 0.1].map(Pixels::from_f32))
        })
        .collect();
    written(with(eq1().record().clone(), |it| {
        (it.comb, it.profile) = (Comb::new(&slits), None)
    }))
}

/// A record with other light-sensitive pixels than this sensor's.
pub fn of_another_head() -> Record {
    with(eq1().record().clone(), |it| it.geometry.light = 36..3683)
}

/// The longest record with the longest comb and the longest front end.
pub fn longest_of_comb() -> EncodedRecord {
    written(Record {
        comb: Some(longest::comb()),
        front_end: Some(longest::front_end(Polarity::Falling)),
        ..longest().record().clone()
    })
}

/// Eq. (1), a table, eq. (1) with residuals, and the longest record that this sensor can have.
pub fn every_kind() -> [EncodedRecord; 4] {
    let nominal = NOMINAL.expect("a curve");
    let distance = |centre| nominal.distance_at(centre).expect("in range").0;
    // A table with a bend of a third of a millimetre.
    let residual = |centre: Pixels| Micrometres::from_f32(300.7 * (centre.to_f32() / 211.3).sin());
    let table = Table::new(&knots(33, distance)).expect("a table");
    let corrected = Corrected::new(nominal.clone(), &knots(21, residual)).expect("usable");
    [
        eq1(),
        written(record(Calibration::Table(table))),
        written(record(Calibration::Corrected(corrected))),
        longest(),
    ]
}

/// Knots over the nominal range, at centres that are not round numbers.
fn knots(count: i32, value: impl Fn(Pixels) -> Micrometres) -> Vec<Knot> {
    let (first, last) = NOMINAL.expect("a curve").valid();
    let step = (last.to_bits() - first.to_bits()) / (count - 1);
    let knot = |i| {
        let centre = Pixels::from_bits(first.to_bits() + i * step);
        let value = value(centre);
        Knot { centre, value }
    };
    (0..count).map(knot).collect()
}

/// The longest record without a comb and a front end.
pub fn longest() -> EncodedRecord {
    written(record(longest::calibration()))
}

pub fn pieces(bytes: &[u8]) -> Vec<Piece> {
    upload::pieces(bytes).expect("pieces")
}

pub fn send(board: &mut VirtualBoard, bytes: &[u8]) {
    upload::send(board, bytes, PATIENCE).expect("an upload");
}

pub fn upload(board: &mut VirtualBoard, written: &EncodedRecord) {
    upload::upload(board, written.bytes(), PATIENCE).expect("an upload");
}

pub fn read_back(board: &mut VirtualBoard) -> Vec<u8> {
    let length = number(&shown(board)[3], "calibration record ", " ") as usize;
    let mut bytes = Vec::new();
    while bytes.len() < length {
        let offset = bytes.len() as u16;
        let line = ask(board, &format!("calibration data {offset}"));
        let words: Vec<&str> = line.split(' ').collect();
        let ["calibration", "data", offset, digits, sum] = words[..] else {
            panic!("{line}");
        };
        bytes.extend_from_slice(Piece::parse(offset, digits, sum).expect("a piece").bytes());
    }
    bytes
}

pub fn shown(board: &mut VirtualBoard) -> Vec<String> {
    let is_last = |line: &str| line.starts_with("calibration stored ");
    ask_until(board, "calibration", is_last)
}

pub fn assert_shown(
    board: &mut VirtualBoard,
    written: Option<&EncodedRecord>,
    stored: FlashStatus,
) {
    let (record, is_on) = (written.map(EncodedRecord::record), true);
    let expected = CalibrationAnswer {
        record,
        is_on,
        stored,
        units: Units::default(),
    };
    assert_eq!(shown(board).join("\r\n"), expected.to_string());
}
