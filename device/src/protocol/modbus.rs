//! Modbus RTU: a request's bytes in, the answer's bytes out. Pure; the firmware brings the bytes, and parts
//! them by the silence between requests.
//!
//! The sensor answers the functions 3 (read holding registers), 4 (read input registers), 6 (write a
//! register) and 16 (write registers). A register has 16 bits. A number of 32 bits takes two registers, the
//! high half first. All registers of one answer are of the same result.
//!
//! | input register | what it holds |
//! |---|---|
//! | 0 | 0 for a reading; for a fault its number, [`Fault::kind`] + 1; 65535 before the first result |
//! | 1 | flags, a bit for each from the lowest: `m`, `c`, `g`, `s` |
//! | 2, 3 | the number of results since the start |
//! | 4, 5 | distance, signed, in 0.1 um |
//! | 6, 7 | u, in 0.1 um |
//! | 8, 9 | r, in 0.1 um |
//! | 10, 11 | centre, signed, in 0.0001 px |
//! | 12 | height in counts |
//! | 13, 14 | rows used, rows of the frame |
//! | 15 | exposure in us; 0 if it is not known |
//!
//! Without a reading, each pair of the registers 4 to 11 holds 0x8000_0000, which is no distance, and the
//! registers 1 and 12 to 15 hold zero.
//!
//! | holding register | setting | values |
//! |---|---|---|
//! | 0 | `rows` | as on the serial line |
//! | 1 | `exposure` | as on the serial line; 0 is `auto` |
//! | 2 | `exposure limit` | as on the serial line |
//! | 3 | `laser` | 0 is `off`, 1 is `on` |
//! | 4 | `format` | 0 is `text`, 1 is `binary`, 2 is `modbus`, 3 is `csv`: the way back to lines |
//! | 5 | `address` | as on the serial line; the answer comes from the old one |
//! | 6 | none | 1 does what the command `save` does, after the answer; reads 0 |
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

use crate::settings::serial_line::Format;
use crate::settings::{Setting, Settings, Value};
use crate::text::Text;
use slitrange::base::exposure::{Exposure, ExposureMode};
use slitrange::{Fault, Micrometres, Pixels, Reading};

/// The longest request and the longest answer, in bytes (Modbus over serial line V1.02, section 2.3).
pub const MAX_BYTES: usize = 256;

/// The station that a request is for: this one, or 0 for all.
const ALL_STATIONS: u8 = 0;

/// The number of input registers.
pub const INPUTS: usize = 16;

/// The settings in holding registers, in the order of the registers. A register never changes its
/// number: new settings follow at the end.
pub const HOLDINGS: [Setting; 6] = [
    Setting::Rows,
    Setting::Exposure,
    Setting::ExposureLimit,
    Setting::Laser,
    Setting::Format,
    Setting::Address,
];

/// The holding register that saves, behind those of the settings.
const SAVE: usize = HOLDINGS.len();

const ALL_HOLDINGS: usize = SAVE + 1;

/// What a pair of registers holds instead of a number.
const NO_VALUE: i32 = i32::MIN;

/// Why a request is not carried out, by the numbers of the Modbus application protocol V1.1b3, section 7.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Exception {
    Function = 1,
    Address = 2,
    Value = 3,
    /// The sensor has nothing to save, or would lose a calibration.
    Failure = 4,
}

/// What the registers show.
#[derive(Clone, Copy, Debug)]
pub struct Shown<'a> {
    /// The input registers, as [`inputs`] makes them.
    pub inputs: &'a [u16; INPUTS],
    /// The settings in use.
    pub settings: &'a Settings,
    /// Whether a `save` would be carried out.
    pub can_save: bool,
}

/// What a request leads to.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Answer {
    /// The bytes to send. Empty if nobody expects an answer.
    pub bytes: Vec<u8, MAX_BYTES>,
    /// The settings to change.
    pub changes: Vec<Value, { HOLDINGS.len() }>,
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
fn checksum(bytes: &[u8]) -> u16 {
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
        (3, []) => registers(&holdings(shown.settings), first, count),
        (4, []) => registers(shown.inputs, first, count),
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

/// Reads the values of some holding registers, as the words of the serial line are read.
fn write(
    first: u16,
    values: &[[u8; 2]],
    shown: &Shown<'_>,
    answer: &mut Answer,
) -> Result<(), Exception> {
    let first = usize::from(first);
    let end = first.saturating_add(values.len());
    if end > ALL_HOLDINGS {
        return Err(Exception::Address);
    }
    for (register, &value) in (first..end).zip(values) {
        let value = u16::from_be_bytes(value);
        let Some(&setting) = HOLDINGS.get(register) else {
            answer.save = match value {
                0 => false,
                1 if shown.can_save => true,
                1 => return Err(Exception::Failure),
                _ => return Err(Exception::Value),
            };
            continue;
        };
        let mut number = Text::<5>::default();
        let word = match (setting, value) {
            (Setting::Laser, 0) => "off",
            (Setting::Laser, 1) => "on",
            (Setting::Exposure, 0) => "auto",
            (Setting::Format, value) => {
                let format = Format::ALL.get(usize::from(value));
                format.ok_or(Exception::Value)?.name()
            }
            (_, value) => {
                // A u16 has at most five digits.
                let _ = write!(number, "{value}");
                number.as_str()
            }
        };
        let value = setting.read(&[word]).map_err(|_| Exception::Value)?;
        // There is room for all.
        let _ = answer.changes.push(value);
    }
    Ok(())
}

fn holdings(settings: &Settings) -> [u16; ALL_HOLDINGS] {
    let values = HOLDINGS.map(|setting| match settings.get(setting) {
        Value::Rows(rows) => rows,
        Value::Exposure(ExposureMode::Fixed(exposure)) | Value::ExposureLimit(exposure) => {
            exposure.us()
        }
        Value::Laser(is_on) => is_on.into(),
        Value::Format(format) => format as u16,
        Value::Address(address) => address,
        // The exposure `auto`. No other setting is in the list.
        _ => 0,
    });
    let mut all = [0; ALL_HOLDINGS];
    for (place, value) in all.iter_mut().zip(values) {
        *place = value;
    }
    all
}

/// The input registers after the latest result, `None` before the first one. `counter` is the number of
/// results since the start.
pub fn inputs(result: Option<&Result<Reading, Fault>>, counter: u32) -> [u16; INPUTS] {
    let [count_high, count_low] = halves(counter);
    let none = halves(NO_VALUE.cast_unsigned());
    let (status, flags, pairs, rest) = match result {
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
                // At most full scale.
                rounded(reading.amplitude.to_f32()),
                reading.rows_used,
                reading.rows,
                reading.exposure.map_or(0, Exposure::us),
            ],
        ),
        Some(Err(fault)) => (number(fault), 0, [none; 4], [0; 4]),
        None => (u16::MAX, 0, [none; 4], [0; 4]),
    };
    let [[d0, d1], [u0, u1], [r0, r1], [x0, x1]] = pairs;
    let [height, rows_used, rows, exposure] = rest;
    [
        status, flags, count_high, count_low, d0, d1, u0, u1, r0, r1, x0, x1, height, rows_used,
        rows, exposure,
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
