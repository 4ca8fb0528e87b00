//! Two sectors of flash with any contents: the store reads only usable configurations, reads what it saved,
//! and reading never writes.
//!
//! The input is a list of steps of 8 bytes: what to do, a byte `a`, and three words `b`, `c`, `d`, low byte
//! first. They fill the flash and use the store; see [`step`]. Bytes behind the last whole step have
//! no effect.
#![no_main]
#![forbid(unsafe_code)]

#[path = "../../host-tests/tests/store/flash.rs"]
mod flash;

use crc::{Algorithm, Crc};
use embassy_futures::block_on;
use flash::{BYTES, Flash, SECTOR};
use libfuzzer_sys::fuzz_target;
use slitrange::distance::knots::{Knot, MAX_KNOTS};
use slitrange::distance::table::Table;
use slitrange::{
    BlackLevel, Calibration, CalibrationErrors, Counts, Estimator, Mean, Micrometres, Pixels,
    sensor_heads,
};
use slitrange_device::record::Record;
use slitrange_device::record::date::Date;
use slitrange_device::settings::Settings;
use slitrange_device::store::configuration::{Configuration, MAX_ENCODED, decode, encode};
use slitrange_device::store::{Store, Stored};

/// Steps at most, so that an input takes a few milliseconds.
const MAX_STEPS: usize = 64;

fuzz_target!(|bytes: &[u8]| {
    let mut flash = Flash::erased();
    for &[what, a, b0, b1, c0, c1, d0, d1] in bytes.as_chunks().0.iter().take(MAX_STEPS) {
        let [b, c, d] = [[b0, b1], [c0, c1], [d0, d1]].map(u16::from_le_bytes);
        step(&mut flash, what, a, [b, c, d]);
    }
    check(&mut flash);
    save(&mut flash, &sample(0, 1));
    save(&mut flash, &sample(2, 2));
});

fn step(flash: &mut Flash, what: u8, a: u8, [b, c, d]: [u16; 3]) {
    let (place, end) = (usize::from(b) % BYTES, BYTES);
    let length = usize::from(c) % BYTES;
    match what & 7 {
        0 => save(flash, &sample(a, b)),
        1 => flash.bytes[place] ^= a,
        2 => {
            let words = [c, d].map(u16::to_le_bytes);
            let bytes = flash.bytes[place..].iter_mut();
            let both = bytes.zip(words.as_flattened());
            both.for_each(|(old, &new)| *old = new);
        }
        3 => flash.bytes[place..end.min(place + length)].fill(a),
        4 => item(flash, place & !3, length, a),
        5 => {
            let whole = place..end.min(place + length);
            let to = (usize::from(d) % BYTES).min(BYTES - whole.len());
            flash.bytes.copy_within(whole, to);
        }
        6 => {
            // The power cut may find contents that no store has left. Then it need only hold that what flash
            // holds afterwards can be used.
            let torn = (a & 0x80 != 0).then_some(d.into());
            flash.cut_after(usize::from(c) % 1024, torn);
            let _ = block_on(Store::new(&mut *flash).save(&sample(a, b).as_ref()));
            flash.power_on();
        }
        _ => check(flash),
    }
}

/// Makes of what is at a place an item that the library takes for whole; or not quite, as `a` says.
fn item(flash: &mut Flash, place: usize, length: usize, a: u8) {
    let length = length % SECTOR;
    let item = flash.bytes.get_mut(place..);
    let item = item.and_then(|bytes| bytes.split_at_mut_checked(8));
    let Some((head, data)) = item.and_then(|(head, data)| Some((head, data.get_mut(..length)?)))
    else {
        return;
    };
    // Its number: not the last that there is.
    if let Some(high) = data.get_mut(3) {
        *high &= 0x7f;
    }
    if let Some(version) = data.get_mut(4).filter(|_| a & 4 != 0) {
        *version = 1;
    }
    let length = (length as u16).to_le_bytes();
    head[4..6].copy_from_slice(&length);
    let length_sum = Crc::<u16>::new(&CRC_16).checksum(&length).min(0xfffe);
    head[6..8].copy_from_slice(&length_sum.to_le_bytes());
    let sum = match Crc::<u32>::new(&CRC_32).checksum(data) {
        0 => 1,
        sum if matches!(sum & 0xff, 0 | 0xff) => sum ^ 1,
        sum => sum,
    };
    head[..4].copy_from_slice(&(sum ^ u32::from(a & 3 == 3)).to_le_bytes());
}

/// The library's sum of an item's length, where 0xffff is 0xfffe: reflected 0x1a2e, from and to ones.
const CRC_16: Algorithm<u16> = Algorithm {
    width: 16,
    poly: 0x1a2eu16.reverse_bits(),
    init: 0xffff,
    refin: true,
    refout: true,
    xorout: 0xffff,
    check: 0,
    residue: 0,
};

/// The library's sum of an item: CRC-32C from another start.
const CRC_32: Algorithm<u32> = Algorithm {
    width: 32,
    poly: 0x1edc_6f41,
    init: 0xeeee_eeeeu32.reverse_bits(),
    refin: true,
    refout: true,
    xorout: 0xffff_ffff,
    check: 0,
    residue: 0,
};

/// Reads: a configuration can be saved again, and the store finds nothing only in erased flash.
fn check(flash: &mut Flash) {
    let (operations, before) = (flash.operations, flash.bytes.clone());
    let stored = block_on(Store::new(&mut *flash).read());
    assert_eq!(flash.operations, operations);
    assert!(flash.bytes == before);
    assert_eq!(
        stored == Stored::Nothing,
        flash.bytes.iter().all(|&byte| byte == 0xff)
    );
    if let Some(saved) = stored.configuration() {
        let mut buffer = [0; MAX_ENCODED];
        let bytes = encode(&saved.as_ref(), &mut buffer).expect("what was read can be saved");
        assert_eq!(decode(bytes).as_ref(), Ok(saved));
    }
}

fn save(flash: &mut Flash, saved: &Configuration) {
    assert_eq!(
        block_on(Store::new(&mut *flash).save(&saved.as_ref())),
        Ok(())
    );
    let stored = block_on(Store::new(&mut *flash).read());
    assert!(stored == Stored::Newest(saved.clone()), "{stored:?}");
}

/// Settings alone, with eq. (1), or with a table.
fn sample(what: u8, i: u16) -> Configuration {
    let calibration = match what % 3 {
        0 => None,
        1 => Calibration::nominal(),
        _ => {
            let knots: Vec<Knot> = (0..2 + i32::from(i) % (MAX_KNOTS as i32 - 1))
                .map(|knot| Knot {
                    centre: Pixels::from_int(4 * knot),
                    value: Micrometres::from_int(1_000_000 - 1000 * knot),
                })
                .collect();
            Table::new(&knots).ok().map(Calibration::Table)
        }
    };
    Configuration {
        settings: Settings {
            rows: 16,
            mean: Mean::Weighted,
            estimator: Estimator::PhaseTable,
            black_level: BlackLevel::Fixed(Counts::from_int(i32::from(i % 4096))),
            ..Settings::default()
        },
        record: calibration.map(|calibration| Record {
            serial_number: i.into(),
            date: Date::new(2026, 11, 21).expect("a day"),
            geometry: sensor_heads::tcd1304dg(),
            estimator: Estimator::PhaseTable,
            black_level: BlackLevel::Shielded,
            calibration,
            errors: CalibrationErrors::Unknown,
            profile: None,
            comb: None,
            front_end: None,
        }),
    }
}
