//! The bytes of a configuration: encoding and decoding give it back, and what cannot be used is refused.

use proptest::prelude::*;
use slitrange::black_level::BlackLevel;
use slitrange::centre::Estimator;
use slitrange::frame::Mean;
use slitrange::measurement::Settings;
use slitrange::record::{self, Record, RecordError};
use slitrange::store::StoreError;
use slitrange::store::configuration::{
    Configuration, ConfigurationError, MAX_ENCODED, VERSION, decode, encode,
};
use slitrange::units::{Counts, Pixels};

use crate::records::{cases, records};
use crate::samples::{Size, sample};

fn encoded(configuration: &Configuration) -> Vec<u8> {
    encode(configuration, &mut [0; MAX_ENCODED])
        .expect("it can be used")
        .to_vec()
}

/// Later firmware reads what is in flash, unless the version changes.
#[test]
fn bytes_of_version_1_do_not_change() {
    let settings = |mean, estimator, black_level| Settings {
        rows: 16,
        mean,
        estimator,
        black_level,
    };
    let level = BlackLevel::Fixed(Counts::from_bits(0x0001_2345));
    let text: Vec<String> = [
        settings(Mean::Weighted, Estimator::PhaseTable, BlackLevel::Shielded),
        settings(Mean::Plain, Estimator::Centroid, BlackLevel::Frame),
        settings(Mean::Weighted, Estimator::Fraunhofer, level),
    ]
    .map(|settings| {
        let record = None;
        let bytes = encoded(&Configuration { settings, record });
        bytes.iter().map(|byte| format!("{byte:02x}")).collect()
    })
    .into();
    insta::assert_snapshot!(text.join("\n"));
    // The record's bytes follow; the test of the record holds them to old ones.
    let configuration = sample(Size::Middle, 5);
    let mut buffer = [0; record::MAX_ENCODED];
    let own =
        record::encode(configuration.record.as_ref().expect("one"), &mut buffer).expect("usable");
    assert_eq!(&encoded(&configuration)[10..], own);
}

#[test]
fn the_longest_configuration_has_the_stated_length() {
    let longest = sample(Size::Most, 7);
    let bytes = encoded(&longest);
    println!(
        "{} bytes; with eq. (1) {}, settings alone {}",
        bytes.len(),
        encoded(&sample(Size::Middle, 7)).len(),
        encoded(&sample(Size::Least, 7)).len()
    );
    assert_eq!(bytes.len(), MAX_ENCODED);
    for room in (0..MAX_ENCODED).step_by(97).chain(0..20) {
        let error = encode(&longest, &mut vec![0; room]).err();
        let expected = match room {
            0..10 => ConfigurationError::NoRoom { bytes: room },
            _ => RecordError::NoRoom { bytes: room - 10 }.into(),
        };
        assert_eq!(error, Some(expected));
    }
}

#[test]
fn unusable_configurations_are_refused() {
    let with = |change: fn(&mut Configuration)| {
        let mut configuration = sample(Size::Least, 0);
        change(&mut configuration);
        encode(&configuration, &mut [0; MAX_ENCODED]).err()
    };
    assert_eq!(with(|_| {}), None);
    for rows in [0, 65, u16::MAX] {
        let mut configuration = sample(Size::Least, 0);
        configuration.settings.rows = rows;
        let error = encode(&configuration, &mut [0; MAX_ENCODED]).err();
        assert_eq!(error, Some(ConfigurationError::Rows { rows }));
    }
    assert_eq!(with(|configuration| configuration.settings.rows = 1), None);
    assert_eq!(with(|configuration| configuration.settings.rows = 64), None);
    for (bits, fits) in [
        (-1, false),
        (0, true),
        (4095 << 8, true),
        ((4095 << 8) + 1, false),
    ] {
        let level = Counts::from_bits(bits);
        let mut configuration = sample(Size::Least, 0);
        configuration.settings.black_level = BlackLevel::Fixed(level);
        let error = encode(&configuration, &mut [0; MAX_ENCODED]).err();
        assert_eq!(
            error,
            (!fits).then_some(ConfigurationError::BlackLevel { level })
        );
    }
    // The same in bytes: 0 version, 1 rows, 3 mean, 4 estimator, 5 black level, 6 its value, 10 the record.
    let bytes = encoded(&sample(Size::Least, 0));
    let with = |place: usize, byte: u8| {
        let mut bytes = bytes.clone();
        bytes[place] = byte;
        decode(&bytes).err()
    };
    let version = VERSION + 1;
    assert_eq!(
        with(0, version),
        Some(ConfigurationError::Version { version })
    );
    assert_eq!(with(1, 0), Some(ConfigurationError::Rows { rows: 0 }));
    assert_eq!(with(2, 1), Some(ConfigurationError::Rows { rows: 0x110 }));
    for place in [3, 4, 5] {
        let letter = b'?';
        assert_eq!(
            with(place, letter),
            Some(ConfigurationError::Letter { letter })
        );
    }
    let level = Counts::from_bits(i32::MIN);
    assert_eq!(
        with(9, 0x80),
        Some(ConfigurationError::BlackLevel { level })
    );
    assert_eq!(with(5, b's'), None);
    let mut valued = bytes.clone();
    (valued[5], valued[6]) = (b's', 1);
    assert_eq!(
        decode(&valued).err(),
        Some(ConfigurationError::Letter { letter: b's' })
    );
    for bytes in (0..10).map(|length| &bytes[..length]) {
        let error = ConfigurationError::Short { bytes: bytes.len() };
        assert_eq!(decode(bytes), Err(error));
    }
    let mut longer = bytes;
    longer.push(0);
    assert_eq!(
        decode(&longer).err(),
        Some(ConfigurationError::Record(RecordError::Short { bytes: 1 }))
    );
}

#[test]
fn errors_say_what_is_wrong_and_what_to_do() {
    let text: Vec<String> = [
        StoreError::Configuration(ConfigurationError::NoRoom { bytes: 100 }),
        StoreError::Configuration(ConfigurationError::Short { bytes: 3 }),
        StoreError::Configuration(ConfigurationError::Version { version: 2 }),
        StoreError::Configuration(ConfigurationError::Rows { rows: 65 }),
        StoreError::Configuration(ConfigurationError::Letter { letter: b'?' }),
        StoreError::Configuration(ConfigurationError::Letter { letter: 0 }),
        StoreError::Configuration(ConfigurationError::BlackLevel {
            level: Counts::from_int(5000),
        }),
        StoreError::Configuration(ConfigurationError::Record(RecordError::OffTheSensor {
            first: Pixels::from_int(-3),
            last: Pixels::from_int(4000),
        })),
        StoreError::Flash,
        StoreError::Worn,
    ]
    .map(|error| error.to_string())
    .into();
    insta::assert_snapshot!(text.join("\n"));
}

/// Settings and records of every kind, most of them usable.
fn all() -> impl Strategy<Value = Configuration> {
    let black_levels = prop_oneof![
        Just(BlackLevel::Shielded),
        Just(BlackLevel::Frame),
        (0..=4095 << 8).prop_map(|bits| BlackLevel::Fixed(Counts::from_bits(bits))),
    ];
    let settings = (
        1..=64u16,
        prop::sample::select(Mean::ALL.to_vec()),
        prop::sample::select(Estimator::ALL.to_vec()),
        black_levels,
    )
        .prop_map(|(rows, mean, estimator, black_level)| Settings {
            rows,
            mean,
            estimator,
            black_level,
        });
    let records = prop::option::weighted(0.9, records()).prop_map(Option::flatten);
    (settings, records).prop_map(|(settings, record)| Configuration { settings, record })
}

/// Without a record whose centres reach beyond its sensor, which `encode` refuses: see the test of the
/// record.
fn usable(configuration: Configuration) -> Configuration {
    let fits = |record: &Record| record::encode(record, &mut [0; record::MAX_ENCODED]).is_ok();
    Configuration {
        record: configuration.record.filter(fits),
        ..configuration
    }
}

proptest! {
    #![proptest_config(cases(2000))]

    /// Every usable configuration decodes to itself.
    #[test]
    fn configurations_decode_to_themselves(configuration in all()) {
        let configuration = usable(configuration);
        let bytes = encoded(&configuration);
        prop_assert!(bytes.len() <= MAX_ENCODED);
        let again = decode(&bytes);
        prop_assert_eq!(again.as_ref(), Ok(&configuration));
    }

    /// Damaged bytes and any others: what decodes is encoded as the same bytes.
    #[test]
    fn decoded_configurations_are_encoded_the_same(
        configuration in all(),
        changes in prop::collection::vec((0..12usize, any::<u8>()), 1..4),
        any_bytes in prop::collection::vec(any::<u8>(), 0..60),
    ) {
        let mut near = encoded(&usable(configuration));
        for (place, byte) in changes {
            if let Some(changed) = near.get_mut(place) {
                *changed = byte;
            }
        }
        let versioned: Vec<u8> = [VERSION].into_iter().chain(any_bytes.iter().copied()).collect();
        for bytes in [near, any_bytes, versioned] {
            if let Ok(configuration) = decode(&bytes) {
                prop_assert_eq!(encoded(&configuration), bytes);
            }
        }
    }
}
