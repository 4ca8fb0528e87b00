//! Calibrations of every kind, with functions that upload and read them.

use slitrange::base::places::PLACES;
use slitrange::base::units::{Counts, Micrometres, Pixels};
use slitrange::centre::Estimator;
use slitrange::centre::spot_shape::COMPONENTS;
use slitrange::check::own_spot::Profile;
use slitrange::distance::Calibration;
use slitrange::distance::eq1::{Eq1, NOMINAL};
use slitrange::distance::knots::{Knot, MAX_KNOTS};
use slitrange::distance::residuals::Corrected;
use slitrange::distance::table::Table;
use slitrange::frame::comb::{CORRECTIONS, Comb, LARGEST_CORRECTION, SlitMap};
use slitrange::light::black_level::BlackLevel;
use slitrange::reading::uncertainty::{CalibrationErrors, FittedErrors, FittedSurface};
use slitrange::row::front_end::{Estimate, FrontEnd, LARGEST_GAIN};
use slitrange::row::{Geometry, Polarity, sensor_heads};
use slitrange_device::protocol::calibration::{CalibrationAnswer, FlashStatus};
use slitrange_device::protocol::piece::Piece;
use slitrange_device::record::Record;
use slitrange_device::record::date::Date;
use slitrange_device::record::encoded::EncodedRecord;
use virtual_board::{VirtualBoard, upload};

use super::common::*;

/// A pixel inside the range of each of [`every_kind`].
pub const CENTRE: f64 = 2300.4;

/// A sensor's record with that calibration. Its settings differ from the defaults.
pub fn record(calibration: Calibration) -> Record {
    Record {
        serial_number: 4_000_000_711,
        date: Date::new(2026, 11, 21).expect("a day"),
        geometry: sensor_heads::tcd1304dg(),
        estimator: Estimator::Adaptive,
        black_level: BlackLevel::Fixed(Counts::from_int(300)),
        calibration,
        errors: CalibrationErrors::Fitted(FittedErrors {
            curve: [Micrometres::from_int(40); PLACES],
            surface: Some(FittedSurface {
                deviation: [Micrometres::from_int(400); PLACES],
                height: [Counts::from_int(1000); PLACES],
            }),
        }),
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
    let drawn = Comb::nominal();
    let slits: Vec<SlitMap> = (drawn.slits().iter().zip(0i32..))
        .map(|(slit, number)| {
            let of_drawing = (number * 7 % 16 - 8) as f32 / 10.0;
            slit.corrected([of_drawing, 0.3, -0.2, 0.1].map(Pixels::from_f32))
        })
        .collect();
    written(Record {
        comb: Comb::new(&slits),
        profile: None,
        ..eq1().record().clone()
    })
}

/// A record with other light-sensitive pixels than this sensor's.
pub fn of_another_head() -> Record {
    Record {
        geometry: Geometry {
            light: 36..3683,
            ..sensor_heads::tcd1304dg()
        },
        ..eq1().record().clone()
    }
}

/// A front end whose numbers take all bytes that they can.
fn widest_front_end() -> FrontEnd {
    let counts = |value| Estimate {
        value: Counts::from_int(value),
        u: Counts::from_int(4095),
    };
    let (value, u) = (LARGEST_GAIN, LARGEST_GAIN);
    FrontEnd {
        polarity: Polarity::Falling,
        gain: Estimate { value, u },
        read_noise: counts(32),
        saturation: Some(counts(4095)),
        black_level: counts(3960),
    }
}

/// The longest record with the longest comb and the longest front end.
pub fn longest_of_comb() -> EncodedRecord {
    let most = Pixels::from_int(LARGEST_CORRECTION);
    let places = (0..8).map(|i| i - 16_384).chain((0..8).map(|i| i + 8_193));
    let slit = |place| SlitMap::nominal(place).corrected([most; CORRECTIONS]);
    let slits: Vec<SlitMap> = places.map(slit).collect();
    written(Record {
        comb: Comb::new(&slits),
        front_end: Some(widest_front_end()),
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

/// The longest record: the largest number of knots. Centres beyond 2048 pixels, residuals beyond 0.52 m and a
/// K of 55 bits need the most bytes.
pub fn longest() -> EncodedRecord {
    let knots: Vec<Knot> = (0..MAX_KNOTS as i32)
        .map(|i| Knot {
            centre: Pixels::from_bits((2048 << 16) + i * 800_000),
            value: Micrometres::from_int(2_000_000 + i),
        })
        .collect();
    let (first, last) = (knots[0].centre, knots[MAX_KNOTS - 1].centre);
    let (d, pole) = (Micrometres::from_int(-8_000_000), Pixels::from_int(-32_768));
    let curve = Eq1::new(d, 1 << 54, pole, first..=last);
    let corrected = Corrected::new(curve.expect("a curve"), &knots);
    written(record(Calibration::Corrected(corrected.expect("usable"))))
}

pub fn pieces(bytes: &[u8]) -> Vec<Piece> {
    upload::pieces(bytes).expect("pieces")
}

/// Sends all of a record except the commit.
pub fn send(board: &mut VirtualBoard, bytes: &[u8]) {
    upload::send(board, bytes, PATIENCE).expect("an upload");
}

pub fn upload(board: &mut VirtualBoard, written: &EncodedRecord) {
    upload::upload(board, written.bytes(), PATIENCE).expect("an upload");
}

/// The record in use, read piece by piece.
pub fn read_back(board: &mut VirtualBoard) -> Vec<u8> {
    let shown = shown(board);
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

/// The answer to `calibration`.
pub fn shown(board: &mut VirtualBoard) -> Vec<String> {
    let is_last = |line: &str| line.starts_with("calibration stored ");
    ask_until(board, "calibration", is_last)
}

/// Asserts that the board shows the record as the core does.
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
    };
    assert_eq!(shown(board).join("\r\n"), expected.to_string());
}
