//! Modbus RTU: a request's bytes in, the answer's bytes out. Pure; the firmware brings the bytes, and parts
//! them by the silence between requests.
//!
//! The sensor answers the functions 3 (read holding registers), 4 (read input registers), 6 (write a
//! register) and 16 (write registers). docs/serial-line.md lists the registers, and says what they hold. All
//! registers of one answer are of the same result.
//!
//! A request that writes several registers changes all of them or none. A request with a wrong checksum, or
//! for another station, changes nothing and has no answer. Bytes before a request, as an answer of another
//! station, are skipped: a computation may hide the silence between the two. A request for all stations, or
//! of another function, needs the silence. One for station 0 is for all stations: it is carried out without
//! an answer.
//!
//! The crate rmodbus reads requests too, but panics on some of them: rmodbus 0.13.0 trusts the byte count of
//! a request with function 16, although fewer bytes came.

use core::fmt::Write as _;

use heapless::Vec;

use crate::filters::Limits;
use crate::filters::average::Average;
use crate::settings::serial_line::Format;
use crate::settings::trigger::Trigger;
use crate::settings::{Setting, Settings, Value, split_words};
use crate::text::Text;
use slitrange::base::exposure::{Exposure, ExposureMode};
use slitrange::{Fault, Micrometres, Pixels, Reading};

/// The longest request and the longest answer, in bytes (Modbus over serial line V1.02, section 2.3).
pub const MAX_BYTES: usize = 256;

/// The station that a request is for: this one, or 0 for all.
const ALL_STATIONS: u8 = 0;

/// The number of input registers.
pub const INPUTS: usize = 24;

/// From here on, both functions that read have the input registers.
const READINGS: u16 = 1000;

/// The number of holding registers. A register never changes its number: new ones follow at the end.
const HOLDINGS: usize = 18;

/// The settings in holding registers, with the first register and the one behind the last.
const SETTINGS: [(Setting, usize, usize); 9] = [
    (Setting::Rows, 0, 1),
    (Setting::Exposure, 1, 2),
    (Setting::ExposureLimit, 2, 3),
    (Setting::Laser, 3, 4),
    (Setting::Format, 4, 5),
    (Setting::Address, 5, 6),
    (Setting::Average, 7, 8),
    (Setting::Trigger, TRIGGER, TRIGGER + 1),
    (Setting::Limits, 11, HOLDINGS),
];

/// The holding registers that are no settings.
const SAVE: usize = 6;
const ZERO: usize = 8;
const MEASURE: usize = 10;

const TRIGGER: usize = 9;

/// What a pair of registers holds instead of a number.
const NO_VALUE: i32 = i32::MIN;

/// Why a request is not carried out, by the numbers of the Modbus application protocol V1.1b3, section 7.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Exception {
    Function = 1,
    Address = 2,
    Value = 3,
    /// The sensor has nothing to save, would lose a calibration, or measures without being asked.
    Failure = 4,
}

/// What the registers show.
#[derive(Clone, Copy, Debug)]
pub struct Shown<'a> {
    /// The input registers, as [`inputs`] makes them.
    pub inputs: &'a [u16; INPUTS],
    /// The settings in use.
    pub settings: &'a Settings,
    /// Whether distances are relative to a reading, or will be from the next frame on.
    pub is_relative: bool,
    /// Whether a `save` would be carried out.
    pub can_save: bool,
}

/// What a request leads to.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Answer {
    /// The bytes to send. Empty if nobody expects an answer.
    pub bytes: Vec<u8, MAX_BYTES>,
    /// The settings to change.
    pub changes: Vec<Value, { SETTINGS.len() }>,
    /// What follows them: `zero`, or `zero off`.
    pub zero: Option<bool>,
    /// Whether to start a frame then.
    pub measure: bool,
    /// Whether to save then.
    pub save: bool,
}

/// Answers the request to a station that `bytes` end with.
pub fn answer(bytes: &[u8], station: u8, shown: &Shown<'_>) -> Answer {
    let mut requests = (0..bytes.len()).filter_map(|start| {
        let request = bytes.get(start..)?;
        // An answer of another station may end with bytes that look like a request. Zeros are frequent in it,
        // so a request to station 0 counts only from the first byte on.
        let may_be = has_length(request) && request.first() != Some(&ALL_STATIONS);
        (start == 0 || may_be).then_some(request)
    });
    requests
        .find_map(|request| carry_out(request, station, shown))
        .unwrap_or_default()
}

/// Whether a request is as long as its function says.
fn has_length(request: &[u8]) -> bool {
    match *request {
        [_, 3 | 4 | 6, ..] => request.len() == 8,
        [_, 16, _, _, _, _, length, ..] => request.len() == usize::from(length).saturating_add(9),
        _ => false,
    }
}

/// `None` if the request is not for this station, or is no request.
fn carry_out(request: &[u8], station: u8, shown: &Shown<'_>) -> Option<Answer> {
    let (body, sum) = request.split_last_chunk()?;
    if request.len() > MAX_BYTES || checksum(body) != u16::from_le_bytes(*sum) {
        return None;
    }
    let (&[to, function], data) = body.split_first_chunk()?;
    if to != station && to != ALL_STATIONS {
        return None;
    }
    let mut answer = Answer::default();
    let mut bytes = Vec::new();
    add(&mut bytes, &[station, function])?;
    match execute(function, data, shown, &mut answer) {
        Ok(Content::Registers(registers)) => {
            let length = u8::try_from(registers.len()).ok()?;
            bytes.push(length.saturating_mul(2)).ok()?;
            for register in registers {
                add(&mut bytes, &register.to_be_bytes())?;
            }
        }
        Ok(Content::Written(what)) => add(&mut bytes, &what)?,
        Err(exception) => {
            answer = Answer::default();
            bytes.clear();
            add(&mut bytes, &[station, function | 0x80, exception as u8])?;
        }
    }
    if to != ALL_STATIONS {
        let sum = checksum(&bytes).to_le_bytes();
        add(&mut bytes, &sum)?;
        answer.bytes = bytes;
    }
    Some(answer)
}

/// Adds bytes. `None` if there is no room.
fn add(to: &mut Vec<u8, MAX_BYTES>, bytes: &[u8]) -> Option<()> {
    bytes.iter().try_for_each(|&byte| to.push(byte).ok())
}

/// The checksum at the end of a request and of an answer, the low byte first (Modbus over serial line V1.02,
/// section 6.2.2). The crate crc has it too, but with two of its CRC-16 in a program the compiler cannot
/// exclude an overflow in either.
pub fn checksum(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0xFFFF, |sum, &byte| {
        (0..8).fold(sum ^ u16::from(byte), |sum, _| match sum & 1 {
            0 => sum >> 1,
            _ => (sum >> 1) ^ 0xA001,
        })
    })
}

/// What an answer says after the function.
enum Content {
    /// The registers that were read.
    Registers(Vec<u16, INPUTS>),
    /// The first four bytes of a request that wrote.
    Written([u8; 4]),
}

fn execute(
    function: u8,
    data: &[u8],
    shown: &Shown<'_>,
    answer: &mut Answer,
) -> Result<Content, Exception> {
    if !matches!(function, 3 | 4 | 6 | 16) {
        return Err(Exception::Function);
    }
    let (&head, rest) = data.split_first_chunk::<4>().ok_or(Exception::Value)?;
    let [a, b, c, d] = head;
    let (first, count) = (u16::from_be_bytes([a, b]), u16::from_be_bytes([c, d]));
    match (function, rest) {
        (3 | 4, []) => match (function, first.checked_sub(READINGS)) {
            (_, Some(first)) => registers(shown.inputs, first, count),
            (4, None) => registers(shown.inputs, first, count),
            _ => registers(&holdings(shown), first, count),
        },
        (6, []) => {
            write(first, &[count.to_be_bytes()], shown, answer)?;
            Ok(Content::Written(head))
        }
        (16, [length, bytes @ ..]) => {
            let (values, odd) = bytes.as_chunks();
            let is_whole = odd.is_empty() && usize::from(*length) == bytes.len();
            if !is_whole || values.is_empty() || values.len() != usize::from(count) {
                return Err(Exception::Value);
            }
            write(first, values, shown, answer)?;
            Ok(Content::Written(head))
        }
        _ => Err(Exception::Value),
    }
}

fn registers(all: &[u16], first: u16, count: u16) -> Result<Content, Exception> {
    // The most that fit in an answer (Modbus application protocol V1.1b3, sections 6.3 and 6.4).
    if !(1..=125).contains(&count) {
        return Err(Exception::Value);
    }
    let first = usize::from(first);
    let end = first.saturating_add(count.into());
    let some = all.get(first..end).ok_or(Exception::Address)?;
    let mut registers = Vec::new();
    for &register in some {
        // There is room for all.
        let _ = registers.push(register);
    }
    Ok(Content::Registers(registers))
}

/// Reads the values of some holding registers. A setting of several registers is as these and its others say.
fn write(
    first: u16,
    values: &[[u8; 2]],
    shown: &Shown<'_>,
    answer: &mut Answer,
) -> Result<(), Exception> {
    let first = usize::from(first);
    let end = first.saturating_add(values.len());
    let mut all = holdings(shown);
    let places = all.get_mut(first..end).ok_or(Exception::Address)?;
    for (place, &value) in places.iter_mut().zip(values) {
        *place = u16::from_be_bytes(value);
    }
    for (setting, from, to) in SETTINGS {
        if first < to && from < end {
            let registers = all.get(from..to).unwrap_or_default();
            let has_others = end > from.saturating_add(1);
            // There is room for all.
            let _ = (answer.changes).push(value(setting, registers, has_others)?);
        }
    }
    let is_written = |register| (first..end).contains(&register);
    let asks = |register: usize, value| match value {
        0 | 1 => Ok(is_written(register) && value == 1),
        _ => Err(Exception::Value),
    };
    answer.save = asks(SAVE, all[SAVE])?;
    answer.measure = asks(MEASURE, all[MEASURE])?;
    answer.zero = is_written(ZERO).then_some(asks(ZERO, all[ZERO])?);
    let is_continuous = all[TRIGGER] == Trigger::Continuous as u16;
    if answer.save && !shown.can_save || answer.measure && is_continuous {
        return Err(Exception::Failure);
    }
    Ok(())
}

/// The value of a setting, from its registers: their words are read as those of the serial line. A request
/// may write others than the first register.
fn value(setting: Setting, registers: &[u16], has_others: bool) -> Result<Value, Exception> {
    let (&number, others) = registers.split_first().ok_or(Exception::Address)?;
    let name = |names: &[&'static str], number: u16| {
        let name = names.get(usize::from(number)).copied();
        name.ok_or(Exception::Value)
    };
    let mut words = Text::<40>::default();
    // The longest words are three numbers of 32 bits, each with a blank.
    let _ = match setting {
        Setting::Laser => words.write_str(name(&["off", "on"], number)?),
        Setting::Format => words.write_str(name(Format::NAMES, number)?),
        Setting::Trigger => words.write_str(name(Trigger::NAMES, number)?),
        Setting::Exposure if number == 0 => words.write_str("auto"),
        Setting::Average if number == 0 => words.write_str("none"),
        Setting::Average => {
            let kind = name(&["", "moving", "median", "recursive"], number / 100)?;
            write!(words, "{kind} {}", number % 100)
        }
        Setting::Limits if number == 0 && (!has_others || others.iter().all(|&it| it == 0)) => {
            words.write_str("off")
        }
        Setting::Limits if number == 1 => others.as_chunks().0.iter().try_for_each(|&[a, b]| {
            let ([a, b], [c, d]) = (u16::to_be_bytes(a), u16::to_be_bytes(b));
            write!(words, "{} ", i32::from_be_bytes([a, b, c, d]))
        }),
        Setting::Limits => return Err(Exception::Value),
        _ => write!(words, "{number}"),
    };
    let value = setting.read(&split_words(words.as_str()));
    value.map_err(|_| Exception::Value)
}

fn holdings(shown: &Shown<'_>) -> [u16; HOLDINGS] {
    let settings = shown.settings;
    let exposure = match settings.exposure {
        ExposureMode::Auto => 0,
        ExposureMode::Fixed(exposure) => exposure.us(),
    };
    let average = match settings.average {
        Average::None => 0,
        Average::Moving(length) => 100 + u16::from(length),
        Average::Median(length) => 200 + u16::from(length),
        Average::Recursive(length) => 300 + u16::from(length),
    };
    let (has_limits, limits) = match settings.limits {
        Limits::Off => (0, [Micrometres::default(); 3]),
        Limits::Within {
            low,
            high,
            hysteresis,
        } => (1, [low, high, hysteresis]),
    };
    // Limits are whole micrometres.
    let [[l0, l1], [h0, h1], [y0, y1]] =
        limits.map(|it| halves((it.to_bits() >> Micrometres::FRACTION).cast_unsigned()));
    [
        settings.rows,
        exposure,
        settings.exposure_limit.us(),
        settings.laser.into(),
        settings.format as u16,
        settings.address,
        0,
        average,
        shown.is_relative.into(),
        settings.trigger as u16,
        0,
        has_limits,
        l0,
        l1,
        h0,
        h1,
        y0,
        y1,
    ]
}

/// The input registers after the latest result, `None` before the first one. `counter` is the number of
/// results since the start.
pub fn inputs(result: Option<&Result<Reading, Fault>>, counter: u32) -> [u16; INPUTS] {
    let [count_high, count_low] = halves(counter);
    let none = halves(NO_VALUE.cast_unsigned());
    let nan = halves(f32::NAN.to_bits());
    let (status, flags, pairs, floats, rest) = match result {
        Some(Ok(reading)) => (
            0,
            flags(reading),
            [
                tenths(reading.distance),
                tenths(reading.uncertainty),
                tenths(reading.parts.noise),
                ten_thousandths(reading.centre),
            ]
            .map(|number| halves(number.cast_unsigned())),
            [
                reading.distance.to_f32() / 1000.0,
                reading.uncertainty.to_f32() / 1000.0,
                reading.parts.noise.to_f32() / 1000.0,
                reading.centre.to_f32(),
            ]
            .map(|number| halves(number.to_bits())),
            [
                // At most full scale.
                rounded(reading.amplitude.to_f32()),
                reading.rows_used,
                reading.rows,
                reading.exposure.map_or(0, Exposure::us),
            ],
        ),
        Some(Err(fault)) => (number(fault), 0, [none; 4], [nan; 4], [0; 4]),
        None => (u16::MAX, 0, [none; 4], [nan; 4], [0; 4]),
    };
    let [[d0, d1], [u0, u1], [r0, r1], [x0, x1]] = pairs;
    let [[f0, f1], [g0, g1], [h0, h1], [i0, i1]] = floats;
    let [height, rows_used, rows, exposure] = rest;
    [
        status, flags, count_high, count_low, d0, d1, u0, u1, r0, r1, x0, x1, height, rows_used,
        rows, exposure, f0, f1, g0, g1, h0, h1, i0, i1,
    ]
}

/// The number of a fault, from 1.
fn number(fault: &Fault) -> u16 {
    u16::try_from(fault.kind()).map_or(u16::MAX, |kind| kind.saturating_add(1))
}

/// A number of counts, rounded.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "`as` takes the whole part, saturates, and maps NaN to zero"
)]
fn rounded(counts: f32) -> u16 {
    (counts + 0.5) as u16
}

fn flags(reading: &Reading) -> u16 {
    u16::from(reading.misfits > 0)
        | (u16::from(reading.correlated.is_some()) * 2)
        | (u16::from(reading.is_nominal) * 4)
        | (u16::from(reading.has_other_settings) * 8)
}

/// A distance in 0.1 um, rounded to the nearest.
#[expect(clippy::cast_possible_truncation, reason = "the result is below 2^27")]
fn tenths(distance: Micrometres) -> i32 {
    // Q24.8 times 10 fits an i64.
    ((i64::from(distance.to_bits()) * 10 + (1 << 7)) >> Micrometres::FRACTION) as i32
}

/// A place in 0.0001 px, rounded to the nearest.
#[expect(clippy::cast_possible_truncation, reason = "the result is below 2^29")]
fn ten_thousandths(place: Pixels) -> i32 {
    // Q16.16 times 10,000 fits an i64.
    ((i64::from(place.to_bits()) * 10_000 + (1 << 15)) >> Pixels::FRACTION) as i32
}

/// The two registers of a number.
fn halves(number: u32) -> [u16; 2] {
    let [a, b, c, d] = number.to_be_bytes();
    [u16::from_be_bytes([a, b]), u16::from_be_bytes([c, d])]
}

#[cfg(test)]
mod tests {
    use super::*;

    const STATION: u8 = 17;

    fn with_checksum(body: &[u8]) -> std::vec::Vec<u8> {
        [body, &checksum(body).to_le_bytes()].concat()
    }

    #[test]
    fn the_checksum_is_that_of_modbus() {
        // https://reveng.sourceforge.io/crc-catalogue/16.htm#crc.cat.crc-16-modbus
        assert_eq!(checksum(b"123456789"), 0x4B37);
        let of_crate = crc::Crc::<u16>::new(&crc::CRC_16_MODBUS);
        for byte in 0..=255 {
            let bytes = [byte, 0, !byte, byte];
            assert_eq!(checksum(&bytes), of_crate.checksum(&bytes));
        }
    }

    /// Each bit of a request wrong, each beginning of it alone, and 100,000 random requests. Scripts in
    /// host-tests/tests/session have the registers and the exceptions.
    #[test]
    fn what_is_no_request_has_no_answer_and_changes_nothing() {
        let settings = Settings::default();
        let shown = Shown {
            inputs: &[0; INPUTS],
            settings: &settings,
            is_relative: false,
            can_save: true,
        };
        let request = with_checksum(&[STATION, 6, 0, 0, 0, 4]);
        assert_eq!(answer(&request, STATION, &shown).changes.len(), 1);
        let none = Answer::default();
        assert_eq!(answer(&request, STATION + 1, &shown), none);
        for end in 0..request.len() {
            assert_eq!(answer(&request[..end], STATION, &shown), none);
        }
        for bit in 0..8 * request.len() {
            let mut wrong = request.clone();
            wrong[bit / 8] ^= 1 << (bit % 8);
            assert_eq!(answer(&wrong, STATION, &shown), none);
        }
        for before in [1, 7, 8, 37, 250] {
            let behind = [&std::vec![STATION; before], &request[..]].concat();
            assert_eq!(answer(&behind, STATION, &shown).changes.len(), 1);
            assert_eq!(answer(&[&behind[..], &[0]].concat(), STATION, &shown), none);
        }
        let longest = with_checksum(&[STATION; 255]);
        assert_eq!(answer(&longest, STATION, &shown), none);
        // Random bytes behind the right start and before the right checksum: no panic, and no change without
        // its answer. A generator of Numerical Recipes.
        let mut state = 1u32;
        let mut random = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 24) as u8
        };
        let mut changed = 0;
        // Miri takes its time.
        let requests = if cfg!(miri) { 100 } else { 100_000 };
        for _ in 0..requests {
            let function = [3, 4, 6, 16][usize::from(random() % 4)];
            let mut body = std::vec![STATION, function, 0, random() % 6, 0];
            body.extend((0..random() % 10).map(|_| random() % 8));
            let Answer { bytes, changes, .. } = answer(&with_checksum(&body), STATION, &shown);
            assert!((5..=MAX_BYTES).contains(&bytes.len()));
            assert!(changes.is_empty() || bytes[1] == function);
            changed += usize::from(!changes.is_empty());
        }
        println!("{changed} of {requests} change a setting");
        assert!(cfg!(miri) || changed > 100);
    }
}
