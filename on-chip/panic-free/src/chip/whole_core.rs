//! Calls of all that the core offers.

use core::fmt::{self, Display, Write};

use slitrange::black_level::{self, BlackPixels};
use slitrange::centre::{self, Estimator};
use slitrange::check;
use slitrange::fault::Fault;
use slitrange::frame::Frame;
use slitrange::measurement::Measurement;
use slitrange::protocol::answer::HELP;
use slitrange::protocol::calibration::{FlashStatus, Shown};
use slitrange::protocol::info::{Banner, Hardware, Info};
use slitrange::protocol::input::Input;
use slitrange::protocol::ladder::Ladder;
use slitrange::protocol::piece::Piece;
use slitrange::protocol::refusal::Refusal;
use slitrange::protocol::status::{SerialErrors, StartCause, Status};
use slitrange::protocol::upload::{Step, Upload};
use slitrange::record::encoded::EncodedRecord;
use slitrange::record::{self, Record};
use slitrange::row::Row;
use slitrange::spot;
use slitrange::store::StoreError;
use slitrange::store::configuration::{self, Configuration};
use slitrange::units::{AsMillimetres, Counts, Micrometres, Pixels};

use super::any::{self, any};

/// The pipeline: any sensor, any settings, any rows.
pub fn measure_rows() {
    let mut measurement = Measurement::new(any::geometry(), any::settings());
    let mut words = [0; 4096];
    while any(true) {
        if any(true) {
            measurement.set(any::settings());
        }
        if any(true) {
            say(&measurement.silence());
        }
        match measurement.row(any::words(&mut words)) {
            Some(Ok(measured)) => {
                any(measured.reading(None).is_ok());
                reached(measured.frame.centre.to_bits());
                #[cfg(feature = "put-an-overflow-in")]
                any(measured.frame.centre.to_bits() + measured.frame.uncertainty.to_bits());
            }
            Some(Err(fault)) => say(&fault),
            None => {}
        }
    }
}

/// Its parts, each given what no part before it would have let through.
pub fn find_centres() {
    let (mut light, mut shielded) = ([0; 4096], [0; 4096]);
    let geometry = any::geometry();
    let Ok(row) = Row::new(any::words(&mut light), any::words(&mut shielded), any(0)) else {
        return;
    };
    let _ = any(spot::find(&row));
    let _ = any(spot::find_again(&row, &any::spot(), any(Pixels::MIN)));
    let spot = any::spot();
    let before = any(true).then(any::row_centre);
    for rung in Estimator::ALL {
        let _ = any(centre::centre(
            rung,
            &row,
            &spot,
            before.as_ref(),
            &geometry,
        ));
        let _ = any(check::centre(rung, &row, &spot, before.as_ref(), &geometry));
    }
    let mut frame = Frame::default();
    let mut black = BlackPixels::default();
    while any(true) {
        frame.add(any(Ok(any::row_centre())));
        black.add(
            any::settings().black_level,
            &row,
            any(Some(spot.background)),
        );
    }
    any(frame.rows());
    if let Ok(centre) = any(frame.centre(any::settings().mean)) {
        reached(centre.centre.to_bits());
    }
    any(black.level(any::settings().black_level));
    any(black_level::centroid(row.light(), spot.background));
}

/// From centres to distances, with whatever calibration is accepted; and its record, written and read, alone and with what is saved.
pub fn find_distances() {
    let Some(calibration) = any::calibration() else {
        return;
    };
    any(calibration.distances().is_ok());
    if let Ok(reading) = any(any::measured().reading(Some(&calibration))) {
        say(&reading);
        reached(reading.distance.to_bits());
    }
    if let Ok((distance, _)) = any(calibration.distance_at(any(Pixels::MIN))) {
        reached(distance.to_bits());
    }
    let mut buffer = [0; 4096];
    let record = any::record(calibration);
    if let Some(record) = &record {
        match record::encode(record, any::bytes(&mut buffer)) {
            Ok(written) => reached(written.len() as i32),
            Err(error) => say(&error),
        }
    }
    match record::decode(any::bytes(&mut buffer)) {
        Ok(record) => reached(record.serial_number as i32),
        Err(error) => say(&error),
    }
    let settings = any::settings();
    match configuration::encode(&Configuration { settings, record }, any::bytes(&mut buffer)) {
        Ok(written) => reached(written.len() as i32),
        Err(error) => say(&StoreError::Configuration(error)),
    }
    match configuration::decode(any::bytes(&mut buffer)) {
        Ok(Configuration { settings, record }) => {
            reached(i32::from(settings.rows));
            reached(record.map_or(0, |record| record.serial_number as i32));
        }
        Err(error) => say(&error),
    }
}

/// A calibration comes in pieces, and is shown.
pub fn take_calibrations() {
    let mut upload = Upload::none();
    let mut in_use = EncodedRecord::nominal();
    while any(true) {
        match upload.take(any(Step::Commit), &any::geometry()) {
            Ok(Some(record)) => in_use = EncodedRecord::new(record).ok(),
            Ok(None) => {}
            Err(refusal) => say(&refusal),
        }
        let written = in_use.as_ref().filter(|_| any(true));
        say(&Shown {
            written,
            on: any(true),
            stored: any(FlashStatus::Nothing),
        });
        if let Some(piece) = written.and_then(|written| Piece::of(written.bytes(), any(0))) {
            say(&piece);
            reached(piece.offset().into());
        }
    }
    say(&any(Refusal::NoUpload));
    any(any::calibration()
        .and_then(any::record)
        .as_ref()
        .is_some_and(Record::is_nominal));
}

/// The constructors of the numbers.
pub fn make_numbers() {
    reached(Pixels::from_int(any(0)).to_bits());
    any(Pixels::from_f32(any(0.0)));
    any(Pixels::from_positive_f32(any(0.0)));
    any(Counts::from_f32(any(0.0)));
    any(Micrometres::from_f32(any(0.0)));
}

/// The serial line: bytes in, answers out.
pub fn talk() {
    let mut input = Input::new();
    while any(true) {
        match input.take(any(0)) {
            Some(Ok(command)) => say(&command),
            Some(Err(error)) => say(&error),
            None => {}
        }
    }
    let hardware = any(Hardware {
        board: "",
        head: "",
        row_us: 0,
    });
    say(&Banner(&hardware, any(StartCause::PowerOn)));
    say(&Info {
        hardware: &hardware,
        geometry: &any::geometry(),
        settings: &any::settings(),
        record: any::calibration().and_then(any::record).as_ref(),
        on: any(true),
    });
    say(&any(Status {
        started_by: StartCause::PowerOn,
        uptime_ms: 0,
        rows: 0,
        rows_lost: 0,
        rows_failed: 0,
        row_cycles: 0,
        readings: 0,
        faults: [0; Fault::KINDS],
        lines_dropped: 0,
        serial_errors: SerialErrors::default(),
    }));
    say(&Ladder);
    say(&HELP);
    say(&any::reading());
    say(&any::measured());
    let fault = any::fault();
    say(&fault);
    say(&fault.advice());
    say(&AsMillimetres(any(Micrometres::MIN)));
    say(&any(Pixels::MIN));
}

/// Writes it, to nowhere.
fn say(what: &dyn Display) {
    let _ = write!(Nowhere, "{what}");
}

struct Nowhere;

impl Write for Nowhere {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        let letters = text.bytes().fold(0, |all, letter| all | letter);
        any(Ok(())).map(|()| reached(letters.into()))
    }
}

/// Where a panic is put in, for the check to find.
#[track_caller]
fn reached(result: i32) {
    if cfg!(feature = "put-panics-in") && any(result) == 0 {
        panic!();
    }
}
