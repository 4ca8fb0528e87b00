//! The record: encoding and decoding give the same record back, and damaged or unusable records are refused.

use super::common::{STEP, holds_what_it_promises, largest_rise};
use crate::records::{cases, longest, nominal, records};
use crate::support::*;
use slitrange::frame::comb::CombError;
use slitrange_device::record::{MAX_ENCODED, VERSION, decode, encode};

/// CRC-32 from its definition: the polynomial of IEEE 802.3.
fn crc32(bytes: &[u8]) -> u32 {
    reflected_crc(!0, 0xedb8_8320, bytes)
}

fn sealed(mut bytes: Vec<u8>) -> Vec<u8> {
    bytes.extend(crc32(&bytes).to_le_bytes());
    bytes
}

fn encoded(record: &Record) -> Vec<u8> {
    encode(record, &mut [0; MAX_ENCODED])
        .expect("a record")
        .to_vec()
}

/// CRC-32 of the bits of distances and slopes: at 4001 even centres, and at each knot and its two neighbours.
fn digest(calibration: &Calibration) -> u32 {
    let (first, last) = calibration.valid();
    let (from, to) = (i64::from(first.to_bits()), i64::from(last.to_bits()));
    let even = (0..=4000).map(|i| from + (to - from) * i / 4000);
    let knots = match calibration {
        Calibration::Eq1(_) => None,
        Calibration::Table(table) => Some(table.knots()),
        Calibration::Corrected(corrected) => Some(corrected.residuals()),
    };
    let knots = knots.into_iter().flat_map(Knots::iter);
    let near = knots.flat_map(|knot| (-1..=1).map(move |by| i64::from(knot.centre.to_bits()) + by));
    let places = even.chain(near).filter(|place| (from..=to).contains(place));
    let bytes = places.flat_map(|place| {
        let at = calibration.distance_at(Pixels::from_bits(place as i32));
        let (distance, slope) = at.expect("in range");
        [distance.to_bits(), slope.to_bits().cast_signed()].map(i32::to_le_bytes)
    });
    crc32(&bytes.flatten().collect::<Vec<u8>>())
}

/// Kind, estimator, [`digest`] and bytes of a record. The format must not change unless its version changes.
#[test]
fn records_of_version_1_decode_to_the_same_distances() {
    for line in include_str!("records_of_version_1.txt").lines() {
        let [kind, estimator, distances, bytes] = line.split(' ').collect::<Vec<_>>()[..] else {
            panic!("{line}");
        };
        let number = |text: &str| u32::from_str_radix(text, 16).expect("hexadecimal digits");
        let places = (0..bytes.len()).step_by(2);
        let bytes: Vec<u8> = places.map(|at| number(&bytes[at..at + 2]) as u8).collect();
        let record = decode(&bytes).expect("a record");
        let found = match &record.calibration {
            Calibration::Eq1(_) => "eq1",
            Calibration::Table(_) => "table",
            Calibration::Corrected(_) => "corrected",
        };
        assert_eq!((found, record.estimator.name()), (kind, estimator));
        assert_eq!(digest(&record.calibration), number(distances), "{kind}");
        assert_eq!(encoded(&record), bytes, "{kind}");
    }
    // A record with all parts.
    assert_eq!(crc32(&encoded(&longest())), 0x2144_df1c);
}

/// The slits and the front end are the last bytes of a record: each is 0 if there is none.
#[test]
fn slits_and_front_end_end_a_record() {
    let bytes = encoded(&nominal());
    let end = bytes.len() - 4;
    let (before, none) = bytes[..end].split_at(end - 2);
    assert_eq!(none, [0, 0]);
    let refused = |tail: &[u8], error| {
        assert_eq!(decode(&sealed([before, tail].concat())), Err(error));
    };
    for (comb, front_end) in [
        (Some(Comb::nominal()), None),
        (None, longest().front_end),
        (Some(Comb::nominal()), longest().front_end),
    ] {
        let record = with(nominal(), |it| (it.comb, it.front_end) = (comb, front_end));
        let bytes = encoded(&record);
        assert_eq!(bytes[..before.len()], *before);
        let tail = &bytes[before.len()..bytes.len() - 4];
        println!("{} bytes for slits and front end", tail.len());
        assert_eq!(decode(&bytes), Ok(record));
        refused(&[], RecordError::Shape);
        refused(&tail[..tail.len() - 1], RecordError::Shape);
        refused(&[tail, &[0]].concat(), RecordError::Shape);
    }
    // Too few slits, and more slits than there may be.
    refused(&[1, 0, 0], RecordError::Comb(CombError::Few { slits: 0 }));
    refused(&[&[1, 17], &[0; 200][..]].concat(), RecordError::Shape);
    // A gain of zero: zigzag and varint of 0.
    refused(&[&[0, 1], &[0; 8][..]].concat(), RecordError::FrontEnd);
}

#[test]
fn the_longest_record_is_as_long_as_is_stated() {
    let longest = longest();
    let bytes = encoded(&longest);
    let (all, least) = (bytes.len(), encoded(&nominal()).len());
    println!("{all} bytes; with eq. (1) alone {least}");
    assert_eq!(bytes.len(), MAX_ENCODED);
    assert_eq!(decode(&bytes), Ok(longest.clone()));
    for room in 0..MAX_ENCODED {
        let mut buffer = vec![0; room];
        let no_room = RecordError::NoRoom { bytes: room };
        assert_eq!(encode(&longest, &mut buffer), Err(no_room));
    }
}

#[test]
fn damaged_and_cut_off_records_are_refused() {
    let bytes = encoded(&nominal());
    assert_eq!(decode(&bytes), Ok(nominal()));
    for length in 0..bytes.len() {
        assert!(decode(&bytes[..length]).is_err(), "{length} bytes");
    }
    for bit in 0..8 * bytes.len() {
        let mut bytes = bytes.clone();
        bytes[bit / 8] ^= 1 << (bit % 8);
        let refused = matches!(decode(&bytes), Err(RecordError::Checksum { .. }));
        assert!(refused, "bit {bit}");
    }
    // Erased and cleared flash.
    for byte in [0xff, 0] {
        for length in 0..=64 {
            let decoded = decode(&vec![byte; length]);
            assert!(decoded.is_err(), "{length} bytes of {byte}");
        }
    }
    let body = bytes[..bytes.len() - 4].to_vec();
    let sum = "the CRC is that of its definition";
    assert_eq!(sealed(body.clone()), bytes, "{sum}");
    let mut newer = body.clone();
    newer[0] = VERSION + 1;
    let version = newer[0];
    for (body, error) in [
        ([&body[..], &[0]].concat(), RecordError::Shape),
        (body[..20].to_vec(), RecordError::Shape),
        (vec![VERSION], RecordError::Shape),
        (vec![], RecordError::Short { bytes: 4 }),
        (newer, RecordError::Version { version }),
    ] {
        assert_eq!(decode(&sealed(body)), Err(error));
    }
}

/// The encoder refuses every part that cannot be used; the decoder too, if it can be written at all.
#[test]
fn unusable_records_are_refused() {
    let wrong = |record: Record| encode(&record, &mut [0; MAX_ENCODED]).err();
    assert_eq!(wrong(nominal()), None);
    let changes: [fn(&mut Geometry); 8] = [
        |it| it.words = 3000,
        |it| it.words = 70_000,
        |it| it.light = 100..100,
        |it| (it.light.start, it.light.end) = (3000, 100),
        |it| (it.words, it.light) = (9000, 0..4097),
        |it| it.shielded = 3690..3700,
        |it| it.bits = 0,
        |it| it.bits = 13,
    ];
    for change in changes {
        let record = with(nominal(), |it| change(&mut it.geometry));
        let shown = format!("{:?}", record.geometry);
        assert_eq!(wrong(record), Some(RecordError::Geometry), "{shown}");
    }
    for level in [-1, (4095 << 8) + 1, i32::MAX].map(Counts::from_bits) {
        let record = with(nominal(), |it| it.black_level = BlackLevel::Fixed(level));
        assert_eq!(wrong(record), Some(RecordError::BlackLevel { level }));
    }
    // 3648 pixels, of half a pixel before the first's middle to half a pixel beyond the last's.
    let (begin, end) = (-(1 << 15), (3648 << 16) - (1 << 15));
    for (first, last, fits) in [
        (begin, end, true),
        (begin - 1, end, false),
        (begin, end + 1, false),
    ] {
        let [first, last] = [first, last].map(Pixels::from_bits);
        let mut knots = [knot(0, 900_000), knot(0, 500_000)];
        (knots[0].centre, knots[1].centre) = (first, last);
        let table = Calibration::Table(Table::new(&knots).expect("a table"));
        let record = with(nominal(), |it| it.calibration = table);
        let error = (!fits).then_some(RecordError::OffTheSensor { first, last });
        assert_eq!(wrong(record), error);
    }
    let errors = |curve, height| {
        let curve = [Micrometres::from_bits(curve); PLACES];
        let deviation = [Micrometres::from_int(300); PLACES];
        fitted(curve, deviation, [Counts::from_bits(height); PLACES])
    };
    for (errors, is_wrong) in [
        (errors(0, 1), false),
        (errors(-1, 1), true),
        (errors(0, 0), true),
    ] {
        let record = with(nominal(), |it| it.errors = errors);
        assert_eq!(wrong(record), is_wrong.then_some(RecordError::Errors));
    }
    // In bytes, as the format has them: 1 version, 2 serial number, 2 year, then month, day.
    let bytes = encoded(&nominal());
    let with = |place: usize, byte: u8| {
        let mut bytes = bytes[..bytes.len() - 4].to_vec();
        bytes[place] = byte;
        decode(&sealed(bytes)).err()
    };
    let before: [(usize, &[u8]); 4] = [(5, &[11, 21]), (14, &[1, 12]), (18, b"t"), (23, &[0])];
    for (place, expected) in before {
        assert_eq!(bytes[place..][..expected.len()], *expected, "{place}");
    }
    let letter = b'?';
    let level = Counts::from_bits(-(120 << 8) - 1);
    for (place, byte, error) in [
        (5, 13, Some(RecordError::Date)),
        (6, 31, Some(RecordError::Date)),
        (6, 30, None),
        // Words (2), shielded (1 + 1), light (1 + 2), falling, bits.
        (14, 2, Some(RecordError::Shape)),
        (15, 13, Some(RecordError::Geometry)),
        // Shot noise (2), estimator, black level (1 + 3).
        (18, letter, Some(RecordError::Estimator { letter })),
        (18, b'g', None),
        (19, 3, Some(RecordError::Shape)),
        // A black level less than zero: the lowest bit of a zigzag is its sign.
        (20, bytes[20] | 1, Some(RecordError::BlackLevel { level })),
        // The kind of calibration.
        (23, 3, Some(RecordError::Shape)),
    ] {
        assert_eq!(with(place, byte), error, "{place}");
    }
}

#[test]
fn errors_say_what_is_wrong_and_what_to_do() {
    let (written, computed, level) = (0x1234_abcd, 7, Counts::from_int(5000));
    let checksum = RecordError::Checksum { written, computed };
    let [first, last] = [-3, 4000].map(Pixels::from_int);
    let text = [
        RecordError::NoRoom { bytes: 100 },
        RecordError::Short { bytes: 3 },
        checksum,
        RecordError::Version { version: 2 },
        RecordError::Shape,
        RecordError::Date,
        RecordError::Geometry,
        RecordError::Estimator { letter: b'?' },
        RecordError::Estimator { letter: 0 },
        RecordError::BlackLevel { level },
        RecordError::Errors,
        RecordError::OffTheSensor { first, last },
    ]
    .map(|error| error.to_string());
    insta::assert_snapshot!(text.join("\n"));
}

/// The distances that rounding may be out of order by.
fn slack(calibration: &Calibration) -> f64 {
    match calibration {
        Calibration::Eq1(_) | Calibration::Table(_) => 0.0,
        Calibration::Corrected(corrected) => {
            4.0 * STEP + largest_rise(corrected.residuals()) / 2f64.powi(22)
        }
    }
}

proptest! {
    #![proptest_config(cases(4000))]

    /// Every possible record decodes to itself, and is encoded to the same bytes again.
    #[test]
    fn every_record_decodes_to_itself(record in records()) {
        let Some(record) = record else { return Ok(()) };
        let mut buffer = [0xa5; MAX_ENCODED];
        let bytes = match encode(&record, &mut buffer) {
            Ok(bytes) => bytes.to_vec(),
            Err(RecordError::OffTheSensor { last, .. }) => {
                prop_assert!(last.to_f64() > record.geometry.light.len() as f64 - 0.5);
                return Ok(());
            }
            Err(RecordError::Errors) => {
                let profile = record.profile.expect("only a profile of these may be impossible");
                prop_assert!(profile.width.contains(&Pixels::default()));
                return Ok(());
            }
            Err(error) => return Err(TestCaseError::fail(error.to_string())),
        };
        prop_assert!(bytes.len() <= MAX_ENCODED);
        let again = decode(&bytes);
        prop_assert_eq!(again.as_ref(), Ok(&record));
        prop_assert_eq!(encoded(&record), bytes);
    }

    /// The damage is a burst of up to 32 wrong bits, which a CRC-32 always finds, or any other bytes.
    #[test]
    fn a_damaged_record_is_refused(
        record in records(),
        place in any::<prop::sample::Index>(),
        damage in prop::collection::vec(any::<u8>(), 1..=4),
        many in prop::collection::vec((any::<prop::sample::Index>(), 1..=255u8), 1..20),
    ) {
        let Some(record) = record else { return Ok(()) };
        let Ok(bytes) = encode(&record, &mut [0; MAX_ENCODED]).map(<[u8]>::to_vec) else { return Ok(()) };
        let mut burst = bytes.clone();
        let place = place.index(bytes.len());
        burst.iter_mut().skip(place).zip(&damage).for_each(|(byte, damage)| *byte ^= damage);
        if burst != bytes {
            let refused = matches!(decode(&burst), Err(RecordError::Checksum { .. }));
            prop_assert!(refused);
        }
        let mut scattered = bytes.clone();
        for (place, damage) in many {
            scattered[place.index(bytes.len())] ^= damage;
        }
        prop_assert!(scattered == bytes || decode(&scattered).is_err());
    }

    /// Changed bytes with a right CRC: an accepted record keeps a calibration's promises, and can be encoded.
    #[test]
    fn accepted_records_can_be_used(
        record in records(),
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
        cut in prop::option::weighted(0.1, any::<prop::sample::Index>()),
        at in prop::collection::vec(0.0..1.0f64, 1..12),
    ) {
        let Some(record) = record else { return Ok(()) };
        let Ok(bytes) = encode(&record, &mut [0; MAX_ENCODED]).map(<[u8]>::to_vec) else { return Ok(()) };
        let mut body = bytes[..bytes.len() - 4].to_vec();
        for (place, byte) in changes {
            let place = place.index(body.len());
            body[place] = byte;
        }
        if let Some(cut) = cut {
            body.truncate(cut.index(body.len() + 1));
        }
        if let Ok(record) = decode(&sealed(body)) {
            holds_what_it_promises(&record.calibration, &at, slack(&record.calibration))?;
            prop_assert_eq!(decode(&encoded(&record)), Ok(record));
        }
    }

    /// Any bytes, with or without a right CRC and version.
    #[test]
    fn any_bytes_are_accepted_or_refused(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        if bytes.len() < 100 {
            prop_assert!(decode(&bytes).is_err());
        }
        let body: Vec<u8> = [VERSION].into_iter().chain(bytes).collect();
        if let Ok(record) = decode(&sealed(body)) {
            holds_what_it_promises(&record.calibration, &[0.5], slack(&record.calibration))?;
        }
    }
}
