//! Bytes of a calibration's record: every accepted record has distances all over its range, and is encoded to
//! itself.
#![no_main]
#![forbid(unsafe_code)]

use crc::{CRC_32_ISO_HDLC, Crc};
use libfuzzer_sys::fuzz_target;
use slitrange::{Calibration, Fault, Pixels};
use slitrange_device::record::{MAX_ENCODED, Record, decode, encode};

/// No mutation would meet it: each input is also tried with the sum that it should have.
const CRC: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);

fuzz_target!(|bytes: &[u8]| {
    check(bytes, bytes);
    check(&[bytes, &CRC.checksum(bytes).to_le_bytes()].concat(), bytes);
});

fn check(bytes: &[u8], places: &[u8]) {
    match decode(bytes) {
        Ok(record) => {
            written_as_read(&record);
            usable(&record.calibration, places);
        }
        Err(error) => assert!(!error.to_string().is_empty()),
    }
}

fn written_as_read(record: &Record) {
    let mut buffer = [0; MAX_ENCODED];
    let written = encode(record, &mut buffer).expect("what was read can be written");
    assert_eq!(decode(written).as_ref(), Ok(record));
}

/// Distances lie within their range and go one way, but for rounding; beyond the centres there are none.
fn usable(calibration: &Calibration, places: &[u8]) {
    let (first, last) = calibration.valid();
    assert!(first < last);
    let range = calibration.distances().expect("the ends are in the range");
    // Of a range of a few steps they may be the same.
    assert!(range.start() <= range.end());
    let fours = places.as_chunks().0.iter();
    let mut centres: Vec<i32> = fours.map(|&four| i32::from_le_bytes(four)).collect();
    // Close to each other too, where a step back would show, and where knots meet.
    centres.extend(first.to_bits()..=first.to_bits().saturating_add(40));
    for i in 0..64 {
        let length = i64::from(last.to_bits()) - i64::from(first.to_bits());
        let place = i64::from(first.to_bits()) + length * i / 63;
        centres.extend((-2..=2).filter_map(|by| i32::try_from(place + by).ok()));
    }
    centres.sort_unstable();
    let falls = calibration.distance_at(first).expect("in range").0
        > calibration.distance_at(last).expect("in range").0;
    let (least, most) = (range.start().to_bits(), range.end().to_bits());
    let rounding = rounding(calibration);
    let mut before: Option<i32> = None;
    for centre in centres.into_iter().map(Pixels::from_bits) {
        match calibration.distance_at(centre) {
            Ok((distance, slope)) => {
                assert!((first..=last).contains(&centre), "{centre}");
                let distance = distance.to_bits();
                let inside = least.saturating_sub(rounding)..=most.saturating_add(rounding);
                assert!(inside.contains(&distance), "{distance} at {centre}");
                assert!(slope.is_finite(), "{slope} at {centre}");
                if let Some(before) = before {
                    let rise = distance.saturating_sub(before);
                    let back = if falls { rise } else { rise.saturating_neg() };
                    assert!(back <= rounding, "{back} steps back at {centre}");
                }
                before = Some(distance);
            }
            Err(fault) => {
                assert_eq!(fault, Fault::OutOfRange { centre });
                assert!(!(first..=last).contains(&centre), "{centre}");
            }
        }
    }
}

/// Steps of a distance that rounding may take it back: see [`slitrange::distance::residuals::Corrected`].
fn rounding(calibration: &Calibration) -> i32 {
    let Calibration::Corrected(corrected) = calibration else {
        return 0;
    };
    let residuals = || {
        corrected
            .residuals()
            .iter()
            .map(|knot| knot.value.to_bits())
    };
    let steps = residuals().zip(residuals().skip(1));
    let most = steps.map(|(a, b)| a.abs_diff(b)).max();
    4 + (most.unwrap_or_default() >> 22) as i32
}
