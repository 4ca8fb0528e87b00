//! Calls of all that the core offers.

use core::fmt::{self, Display, Write};

use slitrange::base::units::{AsMillimetres, Counts, Micrometres, Pixels};
use slitrange::base::work_budget::WorkBudget;
use slitrange::centre::tables::GAUSSIAN;
use slitrange::centre::{self, Estimator, phase_table};
use slitrange::frame::Frame;
use slitrange::light::black_level::{self, BlackPixels};
use slitrange::measurement::{Measurement, centre_of_spot, robust_centre};
use slitrange::row::Row;
use slitrange::row::pixels::flat_field::{FlatField, Kind, TakeError, Taken};
use slitrange::row::pixels::map::{Correction, Entry, PixelMap, window};
use slitrange::spot;
use slitrange::spot::region::Region;
use slitrange_device::protocol::advice::advice;
use slitrange_device::protocol::command::Command;
use slitrange_device::protocol::info::{BrownOut, Clock, Hardware};
use slitrange_device::protocol::input::{Echo, Input};
use slitrange_device::protocol::line::{CentreLine, FaultLine, PartsOf, ReadingLine};
use slitrange_device::protocol::modbus::{self, Shown};
use slitrange_device::protocol::packet::{
    Decoder, Message, Packed, Packets, RowHead as RowPacket, RowWords, Window, parts_of_text,
    unpack,
};
use slitrange_device::protocol::row_lines::{HeadCheck, RowExposure, RowHead, RowPart, RowPixels};
use slitrange_device::protocol::selftest::RowTest;
use slitrange_device::protocol::status::{StartCause, Vitals};
use slitrange_device::protocol::upload::Step;
use slitrange_device::record;
use slitrange_device::session::flat::Outcome;
use slitrange_device::session::{Actions, AddressPrefix, Event, Session};
use slitrange_device::settings::serial_line::Format;
use slitrange_device::store::configuration::{self, Configuration};
use slitrange_device::store::encoded_map::{Read, Reader, Words};
use slitrange_device::store::pixel_map::StoredMap;
use slitrange_device::store::{StoreError, Stored};

use super::any::{self, any};

/// The pipeline: any sensor, any settings, any rows.
pub fn measure_rows() {
    let mut measurement = Measurement::new(any::geometry(), any::settings().options());
    let mut words = [0; 4096];
    while any(true) {
        if any(true) {
            measurement.set(any::settings().options(), any(true).then(any::profile));
        }
        if any(true) {
            say(&measurement.silence());
        }
        if any(true) {
            measurement.set_geometry(any::front_end().geometry(&any::geometry()));
        }
        if let Some(comb) = any::comb() {
            measurement.set_comb(comb);
        }
        match measurement.row(any::words(&mut words)) {
            Some(Ok(measured)) => {
                any(measured
                    .reading(None, &any::errors(), any::settings().surface)
                    .is_ok());
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
    let (spot, before) = (&spot, any(true).then(any::row_centre));
    let (before, profile) = (before.as_ref(), any(true).then(any::profile));
    let (geometry, profile) = (&geometry, profile.as_ref());
    for estimator in Estimator::ALL {
        let _ = any(centre::centre(estimator, &row, spot, before, geometry));
        let budget = any(WorkBudget::of_row());
        let checked = centre_of_spot(estimator, &row, spot, before, geometry, profile, budget);
        let _ = any(checked);
    }
    let budget = &mut any(WorkBudget::of_row());
    let _ = any(robust_centre(&row, spot, before, geometry, profile, budget));
    let by_table = phase_table::centre(&row, spot, before, geometry, &GAUSSIAN);
    let _ = any(by_table);
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
    black.merge(any(black));
    any(black.level(any::settings().black_level));
    any(geometry.height_limit(any(Counts::MIN)));
    any(row
        .with_saturation(any(0))
        .reaches_saturation(any(0)..any(0)));
    any(geometry.saturated_from().max(row.saturated_from()));
    any(black_level::centroid(row.light(), spot.background));
}

/// The map of the pixels: read from any words, taken from any rows, used on any row.
pub fn correct_pixels() {
    let mut field = FlatField::new();
    let mut words = [0; 4096];
    let mut measurement = Measurement::new(any::geometry(), any::settings().options());
    while any(true) {
        let geometry = any::geometry();
        if let Err(error) = field.begin(any(Kind::Dark), &geometry) {
            say(&error);
        }
        match field.add(any::words(&mut words), &geometry) {
            Some(Ok(taken)) => reached(taken.mean.to_bits()),
            Some(Err(error)) => say(&error),
            None => {}
        }
        let mut reader = Reader::default();
        while any(true) {
            match reader.take(any([0; 4]), any(true).then(|| field.place())) {
                Read::Whole(number) => reached(number as i32),
                Read::More | Read::Later(_) | Read::NoMap => {
                    reached(i32::from(reader.summary().outside))
                }
            }
        }
        reached(reader.pixels() as i32);
        measurement.ambient_row(any::words(&mut words));
        if let Some(result) =
            measurement.row_with(any::words(&mut words), any::exposure(), field.map())
        {
            reached(result.map_or(0, |measured| measured.frame.centre.to_bits()));
        }
        if let Some(map) = field.map() {
            let light = any::words(&mut words);
            let correction = any(Correction::Gain);
            let pixels = any(0)..any(0);
            map.correct(
                light,
                pixels,
                any(Counts::MIN),
                &any::geometry(),
                correction,
            );
            reached(i32::from(light.first().copied().unwrap_or_default()));
            reached(map.background_of(any::spot().background).noise.to_bits());
            for word in Words::new(map, any(0)) {
                reached(i32::from_le_bytes(word));
            }
            any(map.entries().len());
        }
    }
    let width = any(true).then(|| any(Pixels::MIN));
    reached(window(any(0), any(0), width).end as i32);
    any(Entry::new(any(0), any(0)));
    if any(true) {
        field.place().clear();
    }
    reached(PixelMap::is_whole(field.place()).into());
}

/// From centres to distances, with whatever calibration is accepted; and its record, written and read, alone
/// and with what is saved.
pub fn find_distances() {
    let Some(calibration) = any::calibration() else {
        return;
    };
    any(calibration.distances().is_ok());
    if let Ok(reading) =
        any(any::measured().reading(Some(&calibration), &any::errors(), any::settings().surface))
    {
        say(&ReadingLine(&reading));
        say(&PartsOf(&reading.parts, any::settings().units));
        say(&ReadingLine(&any(reading).relative_to(&any(reading))));
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
    let configuration = Configuration { settings, record };
    match configuration::encode(&configuration.as_ref(), any::bytes(&mut buffer)) {
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

pub fn make_numbers() {
    reached(Pixels::from_int(any(0)).to_bits());
    any(Pixels::from_f32(any(0.0)));
    any(Pixels::from_positive_f32(any(0.0)));
    any(Counts::from_f32(any(0.0)));
    any(Micrometres::from_f32(any(0.0)));
}

/// The serial line: bytes and frames in, text out, with whatever flash holds; and what the other end may
/// show.
pub fn talk() {
    let hardware = any(Hardware {
        board: "",
        head: "",
        row_us: 0,
        longest_exposure: slitrange::base::exposure::Exposure::LONGEST,
        clock: Clock::External,
        brown_out: BrownOut::Off,
        last_stop: any(Some("")),
    });
    let (mut input, mut echo) = (Input::new(), Echo::default());
    let mut session = Session::new(hardware, any::geometry(), any(StartCause::PowerOn));
    let mut actions = Actions::default();
    session.start(&stored(), &mut actions);
    let (mut packets, mut decoder) = (Packets::default(), Decoder::new());
    let vitals = any(Vitals::default());
    while any(true) {
        let event = match any(0) {
            1 => Event::Frame(any(true).then(any::measured).ok_or(any::fault())),
            2 => Event::Saved(any(Ok(()))),
            4 => Event::Flat(outcome()),
            6 => {
                let mut request = [0; 4096];
                let answer = session.answer_modbus(any::bytes(&mut request), &vitals, &mut actions);
                reached(answer.bytes.len() as i32);
                continue;
            }
            8 => {
                let mut words = [0; 4096];
                let geometry = any::geometry();
                let row = geometry.row(any::words(&mut words));
                let measured = any(true).then(any::measured).ok_or(any::fault());
                Event::Tested(row.ok().and_then(|row| RowTest::of(&row, &measured)))
            }
            7 => Event::LineForAll(Ok(any(Command::Nothing))),
            3 => Event::Line(Ok(any(Command::Upload(any(Step::Commit))))),
            5 => match input.type_in(any(0), &mut echo) {
                Some(command) => Event::Line(command),
                None => {
                    say(&echo.as_str());
                    continue;
                }
            },
            _ => match input.take(any(0)) {
                Some(command) => Event::Line(command),
                None => continue,
            },
        };
        session.take(event, &vitals, &mut actions);
        say(&actions.text.as_str());
        say(&AddressPrefix(actions.address));
        input.set_address(session.settings().address);
        input.set_units(session.settings().units);
        reached(input.is_for_all().into());
        send_packets(&actions, &mut packets, &mut decoder);
        if let Some(applied) = &actions.apply {
            reached(i32::from(applied.settings.rows));
            reached(applied.profile.map_or(0, |profile| profile.first.to_bits()));
            reached(
                applied
                    .comb
                    .as_ref()
                    .map_or(0, |comb| comb.slits().len() as i32),
            );
        }
        reached(session.is_map_on().into());
        reached(session.is_within_limits().into());
        if let Some(configuration) = session.configuration() {
            reached(i32::from(configuration.settings.rows));
        }
    }
    say(&any(Command::Nothing));
    send_row();
    answer_a_master();
    say(&ReadingLine(&any::reading()));
    say(&CentreLine(&any::measured()));
    let fault = any::fault();
    say(&FaultLine(&fault, any(Region::ALL)));
    say(&advice(&fault));
    say(&AsMillimetres(any(Micrometres::MIN)));
    say(&any(Pixels::MIN));
}

/// Any request to the Modbus registers, in any state.
fn answer_a_master() {
    let mut request = [0; 4096];
    let result = any(true).then(|| match any(true) {
        true => Ok(any::reading()),
        false => Err(any::fault()),
    });
    let shown = Shown {
        inputs: &modbus::inputs(result.as_ref(), any(0)),
        settings: &any::settings(),
        is_relative: any(true),
        can_save: any(true),
    };
    let answer = modbus::answer(any::bytes(&mut request), any(0), &shown);
    reached(
        answer
            .bytes
            .iter()
            .fold(0, |sum: i32, &byte| sum ^ i32::from(byte)),
    );
    for change in &answer.changes {
        say(change);
    }
}

/// What the session says as packets, and what the other end reads.
fn send_packets(actions: &Actions, packets: &mut Packets, decoder: &mut Decoder) {
    for part in parts_of_text(actions.text.as_str()) {
        reached(packets.encode(Message::Text(part)).len() as i32);
    }
    reached((any(Format::Text) == Format::Binary).into());
    if let Some(result) = actions.result {
        reached(packets.encode(Message::Result(result)).len() as i32);
    }
    let mut words = [0; 4096];
    let words = any::words(&mut words);
    if let Some(window) = Window::new(&any::measured(), &any::geometry(), words) {
        reached(packets.encode(window.message(any(0))).len() as i32);
    }
    let mut row = RowWords::new(any(0), words);
    let head = Message::Row(RowPacket {
        number: any(0),
        skipped: any(0),
        time_us: any(0),
        exposure: any::exposure(),
        words: row.left() as u16,
        result: any(true).then(any::measured).ok_or(any::fault()),
    });
    reached(packets.encode(head).len() as i32);
    while let Some(message) = row.next_message() {
        reached(packets.encode(message).len() as i32);
    }
    let packed = Packed::new(words.iter().copied());
    reached(unpack(packed.bytes()).map(i32::from).max().unwrap_or(0));
    match decoder.take(any(0)) {
        Some(Ok(packet)) => reached(packet.sequence.into()),
        Some(Err(error)) => say(&error),
        None => {}
    }
}

/// A row for the serial line, and the lines that the other end reads.
fn send_row() {
    let mut words = [0; 4096];
    let mut measurement = Measurement::new(any::geometry(), any::settings().options());
    let measured = measurement.measure_alone(any::words(&mut words), any::exposure(), None);
    let geometry = any::geometry();
    let row = geometry.row(any::words(&mut words));
    let row = row.unwrap_or_else(|_| geometry.empty_row());
    let exposure = match any(true) {
        true => RowExposure::of_laser(any::exposure()),
        false => RowExposure::Unknown,
    };
    let region = any::settings().searched();
    let head = RowHead::new(any(RowPart::Whole), &row, exposure, &measured, region);
    say(&head);
    for line in RowPixels::lines(row.light(), head.sent()) {
        say(&line);
    }
    let bytes = any([0; 64]);
    let line = core::str::from_utf8(&bytes).unwrap_or_default();
    if let Some(line) = RowPixels::parse(line) {
        say(&line);
    }
    if let Some(check) = HeadCheck::parse(line) {
        say(&check);
        say(&HeadCheck::of([line]));
    }
    if let Some(exposure) = RowExposure::parse(line) {
        say(&exposure);
    }
}

fn outcome() -> Outcome {
    let summary = any(true).then(|| any(*PixelMap::EMPTY.summary()));
    let taken = Taken {
        mean: any(Counts::MIN),
        map: summary,
    };
    match any(0) {
        0 => Outcome::Loaded(any(Ok(StoredMap::Nothing)), summary),
        1 => Outcome::Taken(any(Kind::Dark), Ok(taken)),
        2 => Outcome::Taken(any(Kind::Dark), Err(any(TakeError::Silent))),
        3 => Outcome::Saved(any(Ok(()))),
        _ => Outcome::Erased(any(Ok(()))),
    }
}

fn stored() -> Stored {
    let settings = any::settings();
    let record = any::calibration().and_then(any::record);
    let configuration = Configuration { settings, record };
    match any(0) {
        0 => Stored::Nothing,
        1 => Stored::Newest(configuration),
        2 => Stored::Older(configuration),
        3 => Stored::Later(any(0)),
        _ => Stored::Unusable,
    }
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
